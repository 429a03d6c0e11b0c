"""Peaks of a law over another of its inputs as a table: the optimum for C, without a search."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from slipctl.analysis.objective import best_outputs
from slipctl.analysis.optimum import highest_peak, objective_functions
from slipctl.block.block import Block, Exprs, doc_of_maker, make_block
from slipctl.block.signals import Param
from slipctl.errors import BadInput, RunFailed, check_known, check_positive, check_range

MOST = 400
"""Largest number of nodes of a table."""

FAR = 1e12
"""End of the range of heights where the law has none."""


def argmax_table(
    law: Block,
    over: str,
    by: str,
    maximise: str | None = None,
    *,
    lo: float,
    hi: float,
    span: tuple[float, float],
    error: float = 1e-3,
    conditions: Mapping[str, Mapping[str, float]] | None = None,
) -> Block:
    """Make a law that knows the peak of another one on each of its rail conditions.

    Place and height of the peak are computed at nodes of ``by``, which are set closer where they
    bend. Between them are straight lines. Nodes, places and heights are parameters, tables over
    ``<by>_at``: they are of the law as it is now, and stay when its numbers change.

    Args:
        law: a law of scalar expressions.
        over: input whose best value is wanted. lo, hi: its range, in its unit.
        by: input that the table goes by. span: its range; outside, the ends hold.
        maximise: output that is maximised; may be left out if there is only one.
        error: largest relative error of place and of height, at the middles of all intervals.
        conditions: parameters by name; those of the law's rail conditions by default.

    Returns:
        A law. Input: ``by``. Outputs: ``best`` (places) and ``value`` (heights), one element per
        condition, in the order of ``choices["conditions"]``.

    Raises:
        BadInput: unknown names, an empty range, or no condition.
        RunFailed: the error is not reached with 400 nodes.
    """
    where = f"argmax_table({law.name})"
    check_range(where, lo, hi)
    check_positive(f"{where}: error", error)
    check_range(where, *span)
    check_known(f"{where} has no other input", by, [n for n in law.inputs if n != over])
    rails = dict(conditions if conditions is not None else law.conditions)
    if odd := [n for n in rails if not n.isidentifier()]:
        raise BadInput(f"{where}: condition {odd[0]!r} is no name; tables are called by it")
    if not rails:
        raise BadInput(f"{where}: {law.name} has no conditions; give conditions={{...}}")
    peaks = _peaks(where, law, over, by, maximise, (lo, hi), list(rails.values()))
    xs, ys, worst = _nodes(where, peaks, span, error)
    x, axis = law.inputs[by], f"{by}_at"
    outputs = best_outputs(law, over, maximise or next(iter(law.outputs)), (len(rails),))
    height = outputs[1]
    most = ((lo, hi), (max(height.lo, -FAR), min(height.hi, FAR)))
    places = Param(
        x.unit, xs, f"places of the table: {x.doc}", shape=xs.shape, lo=span[0], hi=span[1],
        rising=True,
    )  # fmt: skip
    tables = [
        Param(
            s.unit, ys[:, k, i], f"{s.doc}: {rail}", shape=xs.shape, lo=most[k][0], hi=most[k][1],
            positive=s.positive, per=s.per, over=axis,
        ).named(f"{s.name}_{rail}")
        for k, s in enumerate(outputs) for i, rail in enumerate(rails)
    ]  # fmt: skip
    return make_block(
        "argmax_table", "law", _straight_lines(by, axis, list(rails)), inputs=[x],
        outputs=outputs, sx=False, params=[places.named(axis), *tables],
        choices={"law": law.name, "over": over, "by": by, "conditions": ", ".join(rails),
                 "nodes": len(xs), "error": float(f"{worst:.2g}")},
        doc=doc_of_maker(argmax_table),
    )  # fmt: skip


def _peaks(
    where: str, law: Block, over: str, by: str, maximise: str | None,
    ends: tuple[float, float], rails: Sequence[Mapping[str, float]],
) -> Callable[[float], np.ndarray]:  # fmt: skip
    """Function of ``by``: places and heights of the peak on each rail, one row each."""
    found = [objective_functions(where, law, [over], maximise, {by: 0.0, **v}) for v in rails]
    column = [n for n in law.inputs if n != over].index(by)

    def peaks(x: float) -> np.ndarray:
        rows = []
        for value, slope, p in found:
            p[column] = x
            peak = highest_peak(where, value, slope, p, *ends)
            rows.append((peak.location, peak.value))
        return np.array(rows).T

    return peaks


def _straight_lines(by: str, axis: str, rails: Sequence[str]) -> Callable[..., Any]:
    """Body of the table: straight lines between its nodes."""

    def body(states: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        at = p[axis]
        before = ca.low(at, u[by])
        begin = at[before]
        wide = at[before + 1] - begin
        share = ca.fmin(ca.fmax((u[by] - begin) / wide, 0.0), 1.0)
        rest = 1 - share

        def between(heights: Any) -> Any:
            return rest * heights[before] + share * heights[before + 1]

        return {}, {
            n: ca.vertcat(*[between(p[f"{n}_{rail}"]) for rail in rails]) for n in ("best", "value")
        }

    return body


def _nodes(
    where: str, peaks: Any, span: tuple[float, float], error: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """Nodes, peaks there (node, place or height, condition), and the error in the middles."""
    known = {x: peaks(x) for x in map(float, span)}
    waiting, worst = [(float(span[0]), float(span[1]))], 0.0
    while waiting:
        a, b = waiting.pop()
        middle = a + (b - a) / 2
        true = known[middle] = peaks(middle)
        miss = np.abs((known[a] + known[b]) / 2 - true) / np.abs(true)
        if not miss.max() <= error:
            waiting += [(a, middle), (middle, b)]
            if len(known) > MOST:
                raise RunFailed(f"{where}: {MOST} nodes do not reach an error of {error:g}")
        else:
            worst = max(worst, float(miss.max()))
            if miss.max() <= error / 16:  # as good without it
                del known[middle]
    xs = np.array(sorted(known))
    return xs, np.array([known[x] for x in xs]), worst
