"""When the interior point ends, and from which size on a limit is none."""

POLISH = 4
"""Passes of the active set from the statuses that were found."""

END = 1e-15
"""Mean product of slack and multiplier, over the largest multiplier, at which it is solved."""

ENOUGH = 1e-13
"""The same, where rounding brings no more digits or no step is left."""

ROUNDED = 1e-8
"""The same for controls without bounds, which may be so large that no step leads nearer."""

STILL = 1e-11
"""The same, below which a step that brings little ends it."""

NEARLY = 0.5
"""Mark of a state that is near enough, from which steps may still lead nearer."""

SHORT = 0.3
"""Share of a whole step below which its product of steps counts less; else it may go on for ever
(Salahi, Peng, Terlaky, SIAM Journal on Optimization 18, 2007)."""

WIDE = 1e3
"""Distance, in sizes of a control, at which a bound is none."""

FAR = 1e6
"""Distance at which the limit of a row is none."""

EASE = 1e-7
"""Part of the change of a multiplier, over the largest, by which its row is eased for one step."""

EASED = 1e-8
"""Excess of a row that is still eased, where it is solved: rows of a million are rounded by a tenth
of a billionth."""

EASE_OF_UNKNOWNS = 1e-8
"""The same where controls have no bounds: noises of several unknowns move a row together, and the
largest W must leave them apart."""

NEAR = 0.1
"""Smallest slack to begin with."""
