"""Is it about a log: one that a run gives, one that was recorded, one sent through a block?"""
