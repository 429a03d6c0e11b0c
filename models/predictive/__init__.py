"""Predictive control of slip and of speed."""
