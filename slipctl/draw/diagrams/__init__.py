"""Does it draw how blocks are wired?"""
