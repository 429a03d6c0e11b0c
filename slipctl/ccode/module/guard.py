"""What guards a step: rules for one number, for C and for the run in Python.

``accept`` says what an input becomes, as a CasADi Function of scalars that Python calls. In C it is
written by hand, with integers for ages and bits, and compared with this one tick by tick.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

BAD_INPUT, BAD_RESULT, BAD_PARAM, OFF_RANGE, LIMITED, REFUSED, RESET, NO_INIT, TIMING = (
    1 << k for k in range(9)
)
"""Bits of the status; ``header.STATUS`` says what they mean."""

MARK_NAME = "INITIALISED"
"""What ``init`` leaves in a state; a step of a state without it is refused."""

PATIENCE = 10
"""Ticks refused in a row after which a part is reset, and after as many more the next one."""

MANY = 1e6
"""Ticks that a float can count, with room: no memory is longer."""


FORGOTTEN = 1.0
"""Seconds after which the last good value of an input says nothing of the next one."""

UNSURE = 256
"""Beside the bits of the status: an input is good, but was not for a while before."""


NUMBERS = {
    MARK_NAME: ("9240613U", "what init leaves in a state"),
    "UNSURE": (f"{UNSURE}U", "beside the status: good, but was not for a while before"),
    "FORGOTTEN": ("", "ticks after which the last good value says nothing"),
    "PATIENCE": (f"{PATIENCE}U", "ticks refused in a row before a reset"),
}
"""Numbers of the guards by their names in C; ``FORGOTTEN`` is :func:`memory`."""


def memory(period: float | None, stale: np.ndarray) -> float:
    """``FORGOTTEN`` in ticks, of 1 ms where no period is known; not before a value is stale."""
    ticks = float(np.ceil(FORGOTTEN / (period or 1e-3)))
    return min(max(ticks, float(np.max(stale, initial=1.0))), MANY)


@lru_cache(maxsize=1)
def accept() -> ca.Function:
    """(value, last, age, lo, hi, change, noise, stale, memory, most) -> (taken, age, told).

    ``age`` counts the ticks without a good value, up to ``memory``, and is -1 before the first. A
    value is good that is finite and in its range; ``most`` is the largest number. It is no further
    from the last good one than ``noise`` and the way that it can have come since. From ``memory``
    on the last one says nothing. In the place of a value that is not good, the last good one is
    taken for ``stale`` ticks. After them the tick is refused, and before there is a good one.

    A good value takes one tick of the age away, not all. Where a wrong one was believed at last, as
    it could have come so far, the true one is away no longer than the wrong one was believed. Such
    an age has a half besides: the value of the tick before was good. One that is further from that
    than a tick allows is told, though it may be taken. Until the age is 0 there is ``UNSURE``,
    which stays inside.
    """
    names = ["value", "last", "age", "lo", "hi", "change", "noise", "stale", "memory", "most"]
    given = [ca.SX.sym(n) for n in names]
    value, last, age, lo, hi, change, noise, stale, memory, most = given
    whole = ca.floor(age)
    first = age < 0
    way = ca.fabs(value - last)
    near = way <= noise + change * (whole + 1)
    unknown = ca.logic_or(first, whole >= memory)
    anything = ca.logic_or(unknown, change >= most)
    good = ca.logic_and(ca.logic_and(value >= lo, value <= hi), ca.logic_or(anything, near))
    older = ca.if_else(unknown, whole, whole + 1)
    younger = ca.if_else(whole > 1, ca.if_else(whole > memory, memory, whole) - 0.5, 0)
    follows = ca.logic_or(ca.logic_or(anything, way <= noise + change), age <= whole)
    doubted = ca.if_else(follows, ca.if_else(whole > 1, UNSURE, 0), OFF_RANGE)
    why = ca.if_else(ca.fabs(value) <= most, OFF_RANGE, BAD_INPUT)
    told = why + ca.if_else(ca.logic_or(first, whole >= stale), REFUSED, 0)
    return ca.Function(
        "accept",
        given,
        [
            ca.if_else(good, value, last),
            ca.if_else(good, younger, older),
            ca.if_else(good, doubted, told),
        ],
        names,
        ["taken", "age_next", "bits"],
    )


@lru_cache(maxsize=1)
def counter_after() -> ca.Function:
    """(tick, missed, ticks) -> where a counter from 0 to ``ticks`` stands that missed some."""
    tick, missed, ticks = (ca.SX.sym(n) for n in ("tick", "missed", "ticks"))
    whole = tick + missed
    rest = whole - ticks * ca.floor(whole / ticks)
    found = ca.if_else(ca.logic_and(rest >= 0, rest < ticks), rest, 0)
    names = ["tick", "missed", "ticks"]
    return ca.Function("later", [tick, missed, ticks], [found], names, ["counted"])


def accepted_inputs(
    rows: np.ndarray,
    ends: ca.Function | Sequence[np.ndarray],
    stale: np.ndarray,
    most: float,
    period: float | None = None,
    judged: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """What the step takes of rows of inputs, and what it tells in each tick.

    Args:
        rows: input elements, one row per tick; anything.
        ends: lo, hi, change and noise of each element, or a Function of the last good inputs that
            gives a column of each.
        stale: of each element.
        most: the largest number.
        period: of a tick in s.
        judged: whether the block judges the element itself; None for none.
    """
    looked = np.ones(rows.shape[1], dtype=bool)
    if not isinstance(ends, ca.Function):  # then each element is judged by itself
        lo, hi, change, noise = ends
        with np.errstate(invalid="ignore", over="ignore"):
            steps = np.abs(np.diff(rows, axis=0)) <= noise + change
        good = ((rows >= lo) & (rows <= hi)).all(axis=0) & ((change >= most) | steps.all(axis=0))
        looked = ~good
    taken_, ticks, n = rows.astype(float), len(rows), int(looked.sum())
    if not ticks or not n:
        return taken_, np.zeros(ticks, dtype=int)
    x, value = ca.SX.sym("x", 2 * n), ca.SX.sym("value", n)
    last, age, longest = x[:n], x[n:], memory(period, stale)
    gone = ca.logic_or(age < 0, age >= longest)
    known = ca.if_else(gone, value, last)  # before there is a good one it speaks for itself
    columns = [ca.vertsplit(c) for c in ends(known)] if isinstance(ends, ca.Function) else [
        e[looked] for e in ends]  # fmt: skip
    found: list[Any] = [
        accept()(value[k], last[k], age[k], *(c[k] for c in columns), held, longest, most)
        for k, held in enumerate(stale[looked])
    ]
    for k in [] if judged is None else np.flatnonzero(judged[looked]).tolist():
        bad = ca.logic_not(ca.fabs(value[k]) <= most)
        found[k] = (value[k], found[k][1], ca.if_else(bad, BAD_INPUT, 0))
    taken, ages, told = (ca.vertcat(*column) for column in zip(*found, strict=True))
    one = ca.Function("tick", [x, value], [ca.vertcat(taken, ages), taken, told])
    run = one.mapaccum(ticks)
    result: Any = run(ca.DM([0.0] * n + [-1.0] * n), ca.DM(rows[:, looked].T))
    bits = np.array(result[2].full()).astype(int) % UNSURE
    taken_[:, looked] = np.array(result[1].full()).T
    return taken_, np.bitwise_or.reduce(bits, axis=0)
