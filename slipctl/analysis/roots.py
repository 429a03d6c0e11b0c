"""Roots of scalar equations inside a step: Newton's method that a bracket keeps from straying."""

from __future__ import annotations

import casadi as ca

SMALL = 1e-9
"""Share of the bracket below which a Newton step is no longer compared with the one before."""


def bracketed_newton(residual: ca.Function, *updates: int) -> list[ca.Function]:
    """Make searches of a root, each with a fixed number of updates; a loop, in C too.

    Each update moves the end of the bracket that has the sign of the residual to x. It takes
    Newton's step if that stays in the bracket and is at most half of the step before, and halves
    the bracket otherwise. So the root is never lost, and near it the convergence is quadratic.
    Steps below ``SMALL`` of the first bracket are taken as they are: they may be rounding.
    Source: Press et al., Numerical Recipes, section 9.4.

    Args:
        residual: Function of a place and of a column of parameters, giving value and slope there;
            the value rises through the root.
        *updates: how many; each evaluates the residual once.

    Returns:
        Per number of updates a Function ``(x, lo, hi, q) -> root``: start and bracket (the value is
        not positive at ``lo`` and not negative at ``hi``) and the parameters.
    """
    z, q = ca.SX.sym("z", 5), ca.SX.sym("q", residual.size1_in(1))
    x, lo, hi, before, small = ca.vertsplit(z)
    value, slope = residual(x, q)
    lo, hi = ca.if_else(value < 0, x, lo), ca.if_else(value > 0, x, hi)
    newton = x - value / slope
    inside = ca.logic_and(newton >= lo, newton <= hi)
    shorter = 2 * ca.fabs(value) <= ca.fmax(before, small) * slope  # not with slope < 0
    following = ca.if_else(ca.logic_and(inside, shorter), newton, (lo + hi) / 2)
    after = ca.vertcat(following, lo, hi, ca.fabs(following - x), small)
    update = ca.Function("newton_update", [z, q], [after], {"cse": True})

    names = ["x", "lo", "hi", "q"]
    at, low, high = (ca.MX.sym(n) for n in names[:3])
    params = ca.MX.sym("q", residual.size1_in(1))
    start = ca.vertcat(at, low, high, high - low, SMALL * (high - low))
    found = []
    for n in updates:
        end = update.fold(n)(start, ca.repmat(params, 1, n))
        given = [at, low, high, params]
        found.append(ca.Function(f"newton_{n}", given, [end[0]], names, ["root"]))
    return found
