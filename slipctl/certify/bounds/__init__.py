"""Bounds that hold for no single paper: each one pure function with a note of its proof.

Is it a bound that an estimator, a seeker or a discretiser needs?
"""
