"""Intervals of numbers and arrays that are rounded outwards, and what is enclosed with them.

Is it arithmetic that a proof rests on, whatever is proved?
"""
