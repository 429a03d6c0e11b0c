"""Names that mean the same in every model; ``connect(..., share=SHARED)`` makes each one number.

A paper's own letter for one of them is told in the source of the parameter.
"""

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
