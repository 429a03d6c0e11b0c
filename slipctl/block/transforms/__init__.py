"""Does it make a block of another block: in ticks, over distance, in copies, with ranges?"""
