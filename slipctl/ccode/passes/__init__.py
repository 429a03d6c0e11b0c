"""Does it make statements of C into others that do the same?"""
