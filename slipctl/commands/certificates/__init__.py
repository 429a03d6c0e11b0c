"""Is it a command that proves something, or checks a proof?"""
