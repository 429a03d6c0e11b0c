"""Statuses of a control in the plan, what is small enough to leave them so, and of what data."""

FREE, HIGH, FASTER, TIED = 0.0, 1.0, 2.0, 3.0
"""Status of a control; -1 and -2 are the low bound and the fastest fall."""

NONE = 9.0
"""No status."""

SMALL = 1e-6
"""Part of its size by which a multiplier or a control must be wrong before a status changes."""

DATA = ("D", "E", "U", "before", "bounds", "dx")
"""What the program is made of, as arguments of Functions: see :meth:`ActiveSet.solve`."""
