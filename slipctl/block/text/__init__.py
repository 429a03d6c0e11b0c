"""Does it read equations that a person wrote, or write those of a block for a person?"""
