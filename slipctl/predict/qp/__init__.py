"""Does it solve the quadratic program of a tick, or serve the one that does?"""
