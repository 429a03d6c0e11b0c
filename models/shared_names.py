"""Names that mean the same in every model; ``connect(..., share=SHARED)`` makes each one number.

A paper's own letter for one of them is told in the source of the parameter.
"""

from slipctl import Param

SLOPE = Param("1", 0.0, "gradient, rise over run, uphill positive", lo=-0.1, hi=0.1)
"""Gradient of the track: a plant slows by g slope, an accelerometer shows as much more."""

GRADIENT = {"slope": "*.slope"}
"""The gradient is one number of plant and sensors; a rail section may set it."""

SHARED = {
    "m": "*.m",
    "J": "*.J",
    "r": "*.r",
    "g": "*.g",
    "T": "*.T",
    "tau": "*.tau",
    "T_max": "*.T_max",
}
"""Mass, inertia and radius of a wheel, gravity, sample time, lag and largest torque of what turns
the wheel. The pattern means every part that has the name; the first one declares it."""
