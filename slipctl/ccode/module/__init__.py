"""Does it know the structs, the header, the guards or the source of a module?"""
