"""Does it make or read the test vectors of a module, or what they have to give?"""
