"""Does it make many runs of one loop, or keep what they gave?"""
