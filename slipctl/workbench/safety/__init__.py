"""How safe: certificates of a loop, regions of its gains, worst runs."""
