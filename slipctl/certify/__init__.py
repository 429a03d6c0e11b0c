"""Bounds: each gain, sample-time or step limit is one pure function with a note of its proof.

Is a line a bound, a criterion or a proof, a pure function of numbers? Then it lives here.
"""
