"""Bounds: each gain, sample-time or step limit is one pure function with a note of its proof."""
