"""Taking a change back: an estimate that was put aside is in force again if samples agree with it.

What an estimate knew is put aside when a change is told. It is in force again once so many samples
in a row agree with it. Where sums of residuals tell a change, their sum has to agree too: with t_i
what sample i is off, over what it may be, |t_i| <= 1 and (t_1 + ... + t_k)^2 <= k.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from slipctl.block.block import Exprs
from slipctl.block.signals import Output, Signal, State


def count_sample(x: Exprs, agrees: Any, recall: int, t: Any = None) -> tuple[Exprs, Any]:
    """Count a sample: states ``agreed`` and ``summed`` after it, and whether the estimate is back.

    Args:
        x: states before it.
        agrees: whether the sample alone agrees with what was put aside.
        recall: samples in a row that are wanted.
        t: what it is off, over what it may be, where the sum is asked too.
    """
    once_more = x["agreed"] + 1
    following: Exprs = {}
    if t is not None:
        summed = x["summed"] + t
        agrees = ca.logic_and(agrees, summed**2 <= once_more)
        following["summed"] = ca.if_else(agrees, summed, 0)
    agreed = ca.if_else(x["agreed"] < 0, -1, ca.if_else(agrees, once_more, 0))
    return {"agreed": agreed} | following, agreed >= recall


def put_aside(x: Exprs, names: tuple[str, ...], counts: Exprs, left: Any, over: Any) -> Exprs:
    """States of a recall after a sample.

    Args:
        x: states before it.
        names: those that are what an estimate knows.
        counts: of :func:`count_sample`.
        left: whether the estimate is left now, and worth keeping.
        over: whether what was put aside is sought no longer.
    """
    former = {f"former_{n}": ca.if_else(left, x[n], x[f"former_{n}"]) for n in names}
    counts = counts | {"agreed": ca.if_else(over, -1, counts["agreed"])}
    return former | {k: ca.if_else(left, 0, v) for k, v in counts.items()}


def states(known: list[Signal], sums: bool) -> list[Signal]:
    """States of a recall, beside those that are what an estimate knows."""
    former = [
        State(s.unit, s.value, f"before the last change: {s.doc}",
              shape=s.shape).named(f"former_{s.name}") for s in known
    ]  # fmt: skip
    doc = "samples in a row that agree with that; -1 where it is not sought"
    former.append(State("1", -1.0, doc).named("agreed"))
    if sums:
        doc = "sum of what they are off, over what each may be"
        former.append(State("1", 0.0, doc).named("summed"))
    return former


def outputs(recall: int) -> list[Signal]:
    """What tells that it happened; nothing where it is not asked for."""
    doc = "1 when the estimate before the last change is in force again"
    return [Output("1", doc).named("recalled")] if recall else []
