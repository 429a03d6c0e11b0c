"""Proven bounds of a function over a box, by interval arithmetic on its instructions.

Each operation of a CasADi Function maps intervals to an interval that contains every result. Each
end is moved outwards by 8 units in the last place, more than the rounding of an operation (1/2) and
of NumPy's functions (4).
Boxes are halved until the bound is tight (branch and bound; Moore, Kearfott, Cloud, Introduction to
Interval Analysis, 2009, chapters 5 and 11).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import casadi as ca
import numpy as np

from slipctl.errors import BadInput

Interval = tuple[np.ndarray, np.ndarray]
"""Lower and upper ends, one entry per box."""

ULPS = 8

AT_ONCE = 4096
"""Boxes that are halved together, those with the largest bounds first."""


class Bracket(NamedTuple):
    """Where the largest value of a function over a box lies.

    Attributes:
        reached: value at a point of the box.
        bound: proven upper bound.
        boxes: boxes that were looked at.
    """

    reached: float
    bound: float
    boxes: int


def scalar_function(f: ca.Function) -> ca.Function:
    """Same Function on scalar operations.

    Raises:
        BadInput: it has an operation that CasADi cannot take apart.
    """
    if f.is_a("SXFunction"):
        return f
    try:
        return f.expand()
    except RuntimeError:
        raise BadInput(
            f"{f.name()} cannot be written as scalar operations, so it cannot be enclosed;"
            f" leave out tables, maps and solvers"
        ) from None


def enclose(
    f: ca.Function,
    lo: np.ndarray,
    hi: np.ndarray,
    open_: dict[int, Interval] | None = None,
    forced: Mapping[int, np.ndarray] | None = None,
) -> Interval:
    """Enclosure of every output element over many boxes at once.

    Args:
        f: Function of one column with one dense column as result; MX is expanded.
        lo, hi: ends of the boxes, one column per box.
        open_: is filled with the enclosures of what jumps (comparisons, signs, floors), by the
            number of the instruction.
        forced: values that stand in the place of such an instruction's enclosure.

    Returns:
        Ends of the enclosures, one row per output element; infinite where nothing can be said.

    Raises:
        BadInput: an operation that is not known here.
    """
    f = scalar_function(f)
    many = lo.shape[1]
    work: dict[int, Interval] = {}
    out_lo, out_hi = np.zeros((f.numel_out(0), many)), np.zeros((f.numel_out(0), many))
    with np.errstate(all="ignore"):
        for k in range(f.n_instructions()):
            op, args, to = f.instruction_id(k), f.instruction_input(k), f.instruction_output(k)
            if op == ca.OP_CONST:
                c = np.full(many, f.instruction_constant(k))
                work[to[0]] = (c, c)
            elif op == ca.OP_INPUT:
                work[to[0]] = (lo[args[1]], hi[args[1]])
            elif op == ca.OP_OUTPUT:
                out_lo[to[1]], out_hi[to[1]] = work[args[0]]
            elif op in _RULES:
                ends = _RULES[op](*(work[a] for a in args))
                work[to[0]] = ends if op in _EXACT else _sound(*ends)
                if op in _JUMPS:
                    if open_ is not None:
                        open_[k] = ends
                    if forced is not None and k in forced:
                        work[to[0]] = (forced[k], forced[k])
            else:
                raise BadInput(
                    f"{f.name()}: CasADi operation {op} cannot be enclosed; known are"
                    f" arithmetic, {', '.join(n.lower() for n in _NAMED)}"
                )
    return out_lo, out_hi


def jumps(f: ca.Function) -> bool:
    """Whether a Function has an operation that jumps: a comparison, a sign, a floor."""
    f = scalar_function(f)
    return any(f.instruction_id(k) in _JUMPS for k in range(f.n_instructions()))


def largest(
    f: ca.Function,
    lo: np.ndarray,
    hi: np.ndarray,
    gap: float,
    value: Callable[[np.ndarray], np.ndarray] | None = None,
    bound: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
    most: int = 200_000,
    slope: ca.Function | None = None,
) -> Bracket:
    """Largest value of a function over a box.

    Args:
        f: as of :func:`enclose`.
        lo, hi: ends of the box.
        gap: difference of bound and value reached at which the search ends.
        value: from results at points, one column each, to what is made large; default row 0.
        bound: from enclosures to upper bounds of that; default the upper end of row 0.
        most: boxes after which the search ends with what it has.
        slope: gradient of row 0, a column, where f is continuous and row 0 is made large. A box
            along which it only rises or only falls shrinks to the side where it is largest. What
            is left is also bounded from its middle, by the enclosed slopes (mean value form; Moore,
            Kearfott, Cloud, chapter 6), and halved where slope times width is largest.

    Returns:
        The bracket; its bound is proven even where the search ended early.
    """
    value = value or (lambda y: y[0])
    bound = bound or (lambda a, b: b[0])
    width = np.where(hi > lo, hi - lo, 1.0)[:, None]
    low, high = lo.reshape(-1, 1).astype(float), hi.reshape(-1, 1).astype(float)
    known = np.array([np.inf])  # upper bound of each box, from the one that it is a half of
    best, done, boxes = -np.inf, -np.inf, 0
    while known.size:
        order = np.argsort(-known, kind="stable")
        now, later = order[:AT_ONCE], order[AT_ONCE:]
        waiting = low[:, later], high[:, later], known[later]
        low, high = low[:, now], high[:, now]
        boxes += now.size
        if slope is not None:
            a, b = enclose(slope, low, high)
            rises, falls = a >= 0, (b <= 0) & (a < 0)
            low, high = np.where(rises, high, low), np.where(falls, low, high)
        middle = low + (high - low) / 2
        reach = (high - low) / width
        points = np.hstack([low, middle, high]) if boxes == 1 else middle
        if slope is not None:  # and the corner that is uphill from the middle
            uphill = np.array(slope(middle).full()) > 0
            points = np.hstack([points, np.where(uphill, high, low)])
        found = value(np.array(f(points).full()))
        best = max(best, float(np.nanmax(found, initial=-np.inf)))
        ends = bound(*enclose(f, low, high))
        if slope is not None:
            ends = np.fmin(ends, from_middle(f, low, high, (a, b)))
            change = np.maximum(np.abs(a), np.abs(b)) * (high - low)
            reach = np.where(np.isfinite(change).all(axis=0), change, reach)
        open_ = (ends > best + gap) & (high > low).any(axis=0)
        if boxes > most:
            return Bracket(best, float(max(done, *ends, *waiting[2])), boxes)
        done = max(done, float(ends[~open_].max(initial=-np.inf)))
        low, high, middle = low[:, open_], high[:, open_], middle[:, open_]
        along = np.argmax(reach[:, open_], axis=0)
        cut = np.arange(low.shape[0])[:, None] == along
        low = np.hstack([waiting[0], low, np.where(cut, middle, low)])
        high = np.hstack([waiting[1], np.where(cut, middle, high), high])
        known = np.concatenate([waiting[2], ends[open_], ends[open_]])
        open_ = known > best + gap
        done = max(done, float(known[~open_].max(initial=-np.inf)))
        low, high, known = low[:, open_], high[:, open_], known[open_]
    return Bracket(best, max(done, best), boxes)


def from_middle(f: ca.Function, low: np.ndarray, high: np.ndarray, slope: Interval) -> np.ndarray:
    """Upper bounds of row 0 over boxes, from its middles and enclosed slopes; mean value form.

    Args:
        f: as of :func:`enclose`. low, high: ends of the boxes, one column per box.
        slope: enclosure of its gradient over them.
    """
    middle = low + (high - low) / 2
    with np.errstate(all="ignore"):
        total = tuple(end[0] for end in enclose(f, middle, middle))
        for k in range(low.shape[0]):
            apart = _sound(low[k] - middle[k], high[k] - middle[k])
            step = _sound(*_mul(apart, (slope[0][k], slope[1][k])))
            still = low[k] == high[k]  # an infinite slope times nothing
            step = np.where(still, 0.0, step[0]), np.where(still, 0.0, step[1])
            total = _sound(total[0] + step[0], total[1] + step[1])
    return np.asarray(total[1])


# ---- rules --------------------------------------------------------------------------------------


def _sound(lo: np.ndarray, hi: np.ndarray) -> Interval:
    """Ends moved outwards; the whole line where an end is not a number."""
    lost = np.isnan(lo) | np.isnan(hi)
    low = np.where(lost, -np.inf, lo - ULPS * np.spacing(np.abs(np.nan_to_num(lo, posinf=0.0))))
    high = np.where(lost, np.inf, hi + ULPS * np.spacing(np.abs(np.nan_to_num(hi, neginf=0.0))))
    return np.where(np.isneginf(lo), -np.inf, low), np.where(np.isposinf(hi), np.inf, high)


def _hull(*values: np.ndarray) -> Interval:
    return np.minimum.reduce(values), np.maximum.reduce(values)


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Product of ends, in which zero times infinity is zero."""
    return np.where((a == 0) | (b == 0), 0.0, a * b)


def _mul(a: Interval, b: Interval) -> Interval:
    return _hull(*(_product(s, t) for s in a for t in b))


def _inv(a: Interval) -> Interval:
    across = (a[0] <= 0) & (a[1] >= 0)
    return np.where(across, -np.inf, 1 / a[1]), np.where(across, np.inf, 1 / a[0])


def _sq(a: Interval) -> Interval:
    low, high = _hull(a[0] ** 2, a[1] ** 2)
    return np.where((a[0] <= 0) & (a[1] >= 0), 0.0, low), high


def _rising(function: Callable[[np.ndarray], np.ndarray]) -> Callable[[Interval], Interval]:
    return lambda a: (function(a[0]), function(a[1]))


def _domain(
    function: Callable[[np.ndarray], np.ndarray], least: float
) -> Callable[[Interval], Interval]:
    """Rising function with a domain; where a box sticks out of it, nothing can be said."""

    def rule(a: Interval) -> Interval:
        out = a[0] < least
        return np.where(out, -np.inf, function(a[0])), np.where(out, np.inf, function(a[1]))

    return rule


def _arc(
    function: Callable[[np.ndarray], np.ndarray], falls: bool = False
) -> Callable[[Interval], Interval]:
    """Monotonic function on -1 to 1; where a box sticks out of that, nothing can be said."""

    def rule(a: Interval) -> Interval:
        out = (a[0] < -1) | (a[1] > 1)
        low, high = (function(e) for e in (a[::-1] if falls else a))
        return np.where(out, -np.inf, low), np.where(out, np.inf, high)

    return rule


def _even(function: Callable[[np.ndarray], np.ndarray]) -> Callable[[Interval], Interval]:
    """Even function that rises from zero on."""

    def rule(a: Interval) -> Interval:
        low, high = _hull(function(a[0]), function(a[1]))
        return np.where((a[0] <= 0) & (a[1] >= 0), function(np.zeros_like(low)), low), high

    return rule


def _sin(a: Interval, shift: float = 0.0) -> Interval:
    """sin(x + shift pi/2), shift 0 or 1."""
    low, high = _hull(*(np.cos(e) if shift else np.sin(e) for e in a))
    turns = [(e / (np.pi / 2) + shift) / 4 for e in a]
    # a margin of 1e-9 turns, because pi is rounded
    top = np.floor(turns[1] - 0.25 + 1e-9) >= np.ceil(turns[0] - 0.25 - 1e-9)
    bottom = np.floor(turns[1] + 0.25 + 1e-9) >= np.ceil(turns[0] + 0.25 - 1e-9)
    wild = ~(np.isfinite(a[0]) & np.isfinite(a[1])) | (np.abs(a[0]) > 1e6) | (np.abs(a[1]) > 1e6)
    return np.where(wild | bottom, -1.0, low), np.where(wild | top, 1.0, high)


def _constpow(a: Interval, b: Interval) -> Interval:
    """a^b with a constant b."""
    n = b[0]
    whole = n == np.floor(n)
    positive = _hull(a[0] ** n, a[1] ** n)
    across = (a[0] < 0) & (a[1] > 0) | (a[0] == 0) & (n < 0) | (a[1] == 0) & (n < 0)
    low = np.where(across & (n % 2 == 0) & (n > 0), 0.0, positive[0])
    bad = (b[0] != b[1]) | (~whole & (a[0] < 0)) | (across & (n < 0))
    return np.where(bad, -np.inf, low), np.where(bad, np.inf, positive[1])


def _compare(sure: np.ndarray, possible: np.ndarray) -> Interval:
    return sure.astype(float), possible.astype(float)


def _if_else_zero(c: Interval, a: Interval) -> Interval:
    sure, possible = (c[0] > 0) | (c[1] < 0), (c[0] != 0) | (c[1] != 0)
    low, high = np.minimum(a[0], 0.0), np.maximum(a[1], 0.0)
    return (
        np.where(sure, a[0], np.where(possible, low, 0.0)),
        np.where(sure, a[1], np.where(possible, high, 0.0)),
    )


_NAMED: dict[str, Callable[..., Interval]] = {
    "SQRT": _domain(np.sqrt, 0.0),
    "LOG": _domain(np.log, 0.0),
    "LOG1P": _domain(np.log1p, -1.0),
    "EXP": _rising(np.exp),
    "EXPM1": _rising(np.expm1),
    "TANH": _rising(np.tanh),
    "SINH": _rising(np.sinh),
    "ASINH": _rising(np.arcsinh),
    "ATAN": _rising(np.arctan),
    "ASIN": _arc(np.arcsin),
    "ACOS": _arc(np.arccos, falls=True),
    "SIGN": _rising(np.sign),
    "FLOOR": _rising(np.floor),
    "CEIL": _rising(np.ceil),
    "COSH": _even(np.cosh),
    "FABS": _even(np.abs),
    "SIN": _sin,
    "COS": lambda a: _sin(a, 1.0),
    "FMIN": lambda a, b: (np.minimum(a[0], b[0]), np.minimum(a[1], b[1])),
    "FMAX": lambda a, b: (np.maximum(a[0], b[0]), np.maximum(a[1], b[1])),
}
_RULES: dict[int, Callable[..., Interval]] = {
    **{getattr(ca, f"OP_{n}"): rule for n, rule in _NAMED.items()},
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: lambda a, b: (a[0] + b[0], a[1] + b[1]),
    ca.OP_SUB: lambda a, b: (a[0] - b[1], a[1] - b[0]),
    ca.OP_NEG: lambda a: (-a[1], -a[0]),
    ca.OP_TWICE: lambda a: (2 * a[0], 2 * a[1]),
    ca.OP_MUL: _mul,
    ca.OP_DIV: lambda a, b: _mul(a, _sound(*_inv(b))),
    ca.OP_INV: _inv,
    ca.OP_SQ: _sq,
    ca.OP_CONSTPOW: _constpow,
    ca.OP_POW: _constpow,
    ca.OP_LT: lambda a, b: _compare(a[1] < b[0], a[0] < b[1]),
    ca.OP_LE: lambda a, b: _compare(a[1] <= b[0], a[0] <= b[1]),
    ca.OP_EQ: lambda a, b: _compare(
        (a[0] == a[1]) & (b[0] == b[1]) & (a[0] == b[0]), (a[0] <= b[1]) & (b[0] <= a[1])
    ),
    ca.OP_NE: lambda a, b: _compare(
        (a[1] < b[0]) | (b[1] < a[0]), ~((a[0] == a[1]) & (b[0] == b[1]) & (a[0] == b[0]))
    ),
    ca.OP_NOT: lambda a: _compare((a[0] == 0) & (a[1] == 0), (a[0] <= 0) & (a[1] >= 0)),
    ca.OP_AND: lambda a, b: _compare(_nonzero(a) & _nonzero(b), _maybe(a) & _maybe(b)),
    ca.OP_IF_ELSE_ZERO: _if_else_zero,
    ca.OP_OR: lambda a, b: _compare(_nonzero(a) | _nonzero(b), _maybe(a) | _maybe(b)),
}

_EXACT = {
    getattr(ca, f"OP_{n}")
    for n in (
        "ASSIGN", "NEG", "TWICE", "FABS", "FMIN", "FMAX", "SIGN", "FLOOR", "CEIL", "LT", "LE",
        "EQ", "NE", "NOT", "AND", "OR", "IF_ELSE_ZERO",
    )
}  # fmt: skip
"""Operations without rounding."""

_JUMPS = {getattr(ca, f"OP_{n}") for n in ("SIGN", "FLOOR", "CEIL", "LT", "LE", "EQ", "NE")}
"""Operations that jump; all other ones with a rule are continuous where they are finite."""


def _nonzero(a: Interval) -> np.ndarray:
    return (a[0] > 0) | (a[1] < 0)


def _maybe(a: Interval) -> np.ndarray:
    return (a[0] != 0) | (a[1] != 0)
