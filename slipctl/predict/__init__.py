"""Optimal control: predictive controllers, their horizon and solver, optimal trajectories.

Does a line look for an optimum over time? Then it lives here.
"""
