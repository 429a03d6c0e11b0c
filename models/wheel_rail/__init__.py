"""Wheel on rail: the patch, creep laws, and the step of the axles on them."""
