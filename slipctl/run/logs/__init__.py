"""Does it read a recorded log, or send one through a block?"""
