"""Statuses of a control in the plan, and what is small enough to leave them as they are."""

FREE, HIGH, FASTER, TIED = 0.0, 1.0, 2.0, 3.0
"""Status of a control; -1 and -2 are the low bound and the fastest fall."""

NONE = 9.0
"""No status."""

SMALL = 1e-6
"""Part of its size by which a multiplier or a control must be wrong before a status changes."""
