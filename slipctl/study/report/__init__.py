"""Does it write the report of a study: its page, its style, its texts?"""
