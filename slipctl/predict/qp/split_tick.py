"""A tick that may be made in two parts: one before the measurement, and the rest."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import casadi as ca

from slipctl.predict.qp.stage_loops import as_function, if_else_call

Many = tuple[Any, ...]


def split_results(
    prepare: Any, feedback: Any, only: Any, prepared: Any, plan: Many, kept: Many, given: Many,
    measured: Many, still: Many,
) -> tuple[list[Any], list[Any]]:  # fmt: skip
    """Results of the rest, and what is prepared.

    One of four ways is gone: what is prepared is read where it lies. A Function that either takes
    a thing or makes it would copy it.

    Args:
        prepare: of (plan, given, whether to shift the plan), to plan and prepared.
        feedback: of (plan, prepared, measured), to plan and results.
        only: whether to prepare, and no more. prepared: whether it is prepared.
        plan: X, U and S. kept: what was prepared. given: what preparing sees beside the plan,
            whether there is one the first of it.
        measured: what the rest sees beside that.
        still: results of the rest, behind those of the plan, where there is no rest.
    """
    parts = plan, kept, given, measured, still
    sizes = [len(part) for part in parts]
    prepare, feedback = as_function("prepare", prepare), as_function("feedback", feedback)

    def pieces(flat: tuple[Any, ...]) -> list[tuple[Any, ...]]:
        ends = [sum(sizes[:k]) for k in range(len(sizes) + 1)]
        return [flat[a:b] for a, b in pairwise(ends)]

    def go_on(prepared: Any, *flat: Any) -> list[Any]:
        plan, kept, _, measured, _ = pieces(flat)
        return [*feedback(*plan, *kept, *measured), *kept]

    def whole(prepared: Any, *flat: Any) -> list[Any]:
        plan, _, given, measured, _ = pieces(flat)
        made = prepare(*plan, *given, 1)
        return [*feedback(*made, *measured), *made[len(plan) :]]

    def again(prepared: Any, *flat: Any) -> list[Any]:
        plan, _, given, _, still = pieces(flat)
        made = prepare(*plan, *given, ca.logic_not(prepared))
        return [*made[: len(plan)], *still, *made[len(plan) :]]

    def stay(prepared: Any, *flat: Any) -> list[Any]:
        plan, kept, _, _, still = pieces(flat)
        return [*plan, *still, *kept]

    def rest(prepared: Any, *flat: Any) -> list[Any]:
        return if_else_call("go_on", prepared > 0, go_on, whole, prepared, *flat)

    def ahead(prepared: Any, *flat: Any) -> list[Any]:
        begun = pieces(flat)[2][0]
        return if_else_call("ahead", begun > 0, again, stay, prepared, *flat)

    flat = [v for part in parts for v in part]
    found = if_else_call("rest", ca.logic_not(only), rest, ahead, prepared, *flat)
    return found[: -len(kept)], found[-len(kept) :]
