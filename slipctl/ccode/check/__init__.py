"""What a module is put through: back to back, float, sanitizers, fuzzing, boards in the loop.

Does a line try to show that a module is wrong? Then it lives here.
"""
