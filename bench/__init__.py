"""Benchmarks and long checks: speed against peers, controllers in C, endurance, FMUs.

``python -m bench.NAME`` in the clone: they are not installed.
"""
