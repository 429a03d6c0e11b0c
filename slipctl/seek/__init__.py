"""Searches and seekers: differential evolution, swarms, extremum seeking, random numbers.

Does a line look for the best argument of a function without its derivative, in one go or while the
loop runs? Then it lives here.
"""
