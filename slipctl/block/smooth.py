"""Functions with a corner, exact and rounded: each states its rounding and its slope there.

``eps`` says how far from the corner the rounding reaches and has the unit of the argument; 0, the
default, is the exact function. Arguments are numbers, SX, MX or DM. CasADi's own derivatives at a
corner: 0 of sign and |x|, 1/2 of min and max at equal arguments, NaN of the exact ``root``.
Use the exact form where values count, and a rounded one where a derivative is taken at the corner.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from slipctl.errors import BadInput


def sign(x: Any, eps: Any = 0.0) -> Any:
    """Sign of x.

    Exact: -1, 0 or 1; the derivative is 0 everywhere, at 0 too.
    Rounded: x/sqrt(x^2 + eps^2); slope 1/eps at 0, short of 1 by less than eps^2/(2 x^2).
    """
    if _exact("sign", eps):
        return ca.sign(x)
    return x / ca.sqrt(x**2 + eps**2)


def root(x: Any, eps: Any = 0.0) -> Any:
    """Signed square root |x|^(1/2) sign x, as the super-twisting law has it.

    Exact: 0 at 0, where the slope is infinite and CasADi's derivative is NaN.
    Rounded: x/(x^2 + eps^2)^(1/4); slope 1/sqrt(eps) at 0, too small by less than the fraction
    eps^2/(4 x^2).
    """
    if _exact("root", eps):
        return ca.sqrt(ca.fabs(x)) * ca.sign(x)
    return x / ca.sqrt(ca.sqrt(x**2 + eps**2))


def magnitude(x: Any, eps: Any = 0.0) -> Any:
    """Magnitude |x|.

    Exact: derivative 0 at 0, -1 and 1 beside it.
    Rounded: x^2/sqrt(x^2 + eps^2); 0 at 0 with slope 0 and curvature 2/eps, too small by at most
    0.301 eps (at |x| = 0.786 eps) and by less than eps^2/(2 |x|).
    """
    if _exact("magnitude", eps):
        return ca.fabs(x)
    return x**2 / ca.sqrt(x**2 + eps**2)


def minimum(a: Any, b: Any, eps: Any = 0.0) -> Any:
    """Smaller of a and b, for instance of a demand and what slip control allows.

    Exact: CasADi's derivative is 1/2 towards each of two equal arguments.
    Rounded by a parabola: eps/4 below at a = b, with slope 1/2 towards each, never above, and
    exact where a and b are eps apart.
    """
    if _exact("minimum", eps):
        return ca.fmin(a, b)
    return ca.fmin(a, b) - _parabola(a - b, eps)


def maximum(a: Any, b: Any, eps: Any = 0.0) -> Any:
    """Larger of a and b; exact and rounded as ``minimum``, the rounding eps/4 above at a = b."""
    if _exact("maximum", eps):
        return ca.fmax(a, b)
    return ca.fmax(a, b) + _parabola(a - b, eps)


def sat(x: Any, lo: Any, hi: Any, eps: Any = 0.0) -> Any:
    """Value limited to [lo, hi].

    Exact: CasADi's derivative is 1/2 at both corners, 1 between, 0 outside.
    Rounded by parabolas: eps/4 inside the range at a corner, with slope 1/2; exact at eps from the
    corners, and never outside the range. Needs hi - lo >= 2 eps.
    """
    limited = ca.fmin(ca.fmax(x, lo), hi)
    if _exact("sat", eps):
        return limited
    return limited + _parabola(x - lo, eps) - _parabola(x - hi, eps)


def blend(x: Any, lo: Any, hi: Any, below: Any = 0.0, above: Any = 1.0) -> Any:
    """Switch without hysteresis from ``below`` (x <= lo) to ``above`` (x >= hi).

    The weight of ``above`` is w = t^2 (3 - 2 t) with t = (x - lo)/(hi - lo) between lo and hi.
    Slope 0 at both ends, at most 1.5/(hi - lo) in the middle, where w = 1/2.
    """
    t = sat((x - lo) / (hi - lo), 0.0, 1.0)
    w = t * t * (3.0 - 2.0 * t)
    if isinstance(below, (int, float)) and below == 0.0:
        return above * w
    return below + (above - below) * w


def _parabola(distance: Any, eps: Any) -> Any:
    """Rounding of a corner: eps/4 and slope +-1/2 at the corner, 0 where ``eps`` away from it."""
    return ca.fmax(eps - ca.fabs(distance), 0.0) ** 2 / (4.0 * eps)


def _exact(name: str, eps: Any) -> bool:
    """Whether the exact form is asked for; a symbolic ``eps`` never is."""
    if hasattr(eps, "is_constant") and not eps.is_constant():
        return False
    number = float(eps)
    if not number >= 0.0:
        raise BadInput(f"{name} is rounded over a positive distance, not eps = {number:g}")
    return number == 0.0
