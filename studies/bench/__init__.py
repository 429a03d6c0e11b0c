"""Benchmarks and long checks: speed against peers, controllers in C, endurance, FMUs."""
