"""Roots of scalar equations inside a step: Newton's method that a bracket keeps from straying."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca

Residual = Callable[[Any], tuple[Any, Any]]
"""Value and slope of an equation at a place; the value rises through its root."""

SMALL = 1e-9
"""Share of the bracket below which a Newton step is no longer compared with the one before."""


def bracketed_newton(residual: Residual, x: Any, lo: Any, hi: Any, updates: int) -> Any:
    """Root of an equation, after a fixed number of updates.

    Each update moves the end of the bracket that has the sign of the residual to ``x``. It takes
    Newton's step if that stays in the bracket and is at most half of the step before, and halves
    the bracket otherwise. So the root is never lost, and near it the convergence is quadratic.
    Steps below ``SMALL`` of the first bracket are taken as they are: they may be rounding.
    Source: Press et al., Numerical Recipes, section 9.4.

    Args:
        residual: gives value and slope at a place, as expressions (SX).
        x: start, between ``lo`` and ``hi``.
        lo, hi: the value is not positive at ``lo`` and not negative at ``hi``.
        updates: how many; each evaluates the residual once.
    """
    before, small = hi - lo, SMALL * (hi - lo)
    for _ in range(updates):
        value, slope = residual(x)
        lo = ca.if_else(value < 0, x, lo)
        hi = ca.if_else(value > 0, x, hi)
        newton = x - value / slope
        inside = ca.logic_and(newton >= lo, newton <= hi)
        shorter = 2 * ca.fabs(value) <= ca.fmax(before, small) * slope  # not with slope < 0
        following = ca.if_else(ca.logic_and(inside, shorter), newton, (lo + hi) / 2)
        before = ca.fabs(following - x)
        x = following
    return x
