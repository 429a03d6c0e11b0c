"""What a predictive controller is asked for: bounds, rates, weights and moves, checked."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from slipctl.block.block import Block
from slipctl.errors import BadInput, check_number, check_positive, check_whole, nearest
from slipctl.predict.options.limits import entries_of
from slipctl.predict.reference import available

SOLVERS = ("riccati", "osqp", "qrqp", "ipopt", "fatrop")

Limit = float | str
"""A bound of a control: a number, or the name of the input that it is."""


def check_numbers(
    where: str, h: float, horizon: int, iterations: int, passes: int, rescue: int, solver: str
) -> None:
    """Refuse settings that are no numbers of their kind, and a solver that is not there."""
    check_positive(f"{where}: h", h, "s")
    check_whole(f"{where}: rescue", rescue, 0)
    for word, count in (("horizon", horizon), ("iterations", iterations), ("passes", passes)):
        check_whole(f"{where}: {word}", count)
    if solver not in SOLVERS:
        raise BadInput(f"{where} has no solver {solver!r}; it has {', '.join(SOLVERS)}")
    if solver != "riccati":
        available(where, solver)


def bounds_of(
    where: str, plant: Block, full: Mapping[str, str], given: Mapping[str, tuple[Limit, Limit]]
) -> dict[str, tuple[Limit, Limit]]:
    """(lo, hi) of each control, as given or declared."""
    for n in given:
        if n not in full:
            raise BadInput(f"{where}: bounds of {n!r}, which is no control{nearest(n, full)}")
    found = {}
    for c, n in full.items():
        s = plant.inputs[n]
        lo, hi = entries_of(f"{where}: bounds of {c}", given.get(c, (s.lo, s.hi)), "(lo, hi)")
        for b in (lo, hi):
            if not isinstance(b, str):
                check_number(f"{where}: bounds of {c}: an end", b, s.unit)
        if not isinstance(lo, str) and not isinstance(hi, str) and not lo < hi:
            raise BadInput(
                f"{where}: {c} from {lo:g} to {hi:g} {s.unit} leaves nothing; give lo < hi"
            )
        for b in (lo, hi):
            if isinstance(b, str) and not b.isidentifier():
                raise BadInput(f"{where}: {b!r} is no name for the input that bounds {c}")
            if not isinstance(b, str) and not math.isfinite(b):
                raise BadInput(
                    f"{where}: {c} is unbounded; give bounds={{{c!r}: (lo, hi)}} in {s.unit}"
                )
        found[c] = (lo, hi)
    return found


def by_name(where: str, what: str, given: Any) -> dict[str, Any]:
    """Settings by name, none where they are left out."""
    if not isinstance(given, Mapping | None):
        raise BadInput(f"{where}: {what} = {given!r}; give {what}={{name: ...}}")
    return dict(given or {})


def scale_of(lo: Limit, hi: Limit) -> float:
    """Size of a control: its largest bound that is a number."""
    numbers = [abs(b) for b in (lo, hi) if not isinstance(b, str)]
    return max(numbers, default=1.0) or 1.0


def rates_of(where: str, controls: Sequence[str], rates: Mapping[str, float]) -> dict[str, float]:
    """Largest rates by control."""
    for c, r in rates.items():
        if c not in controls:
            raise BadInput(f"{where}: rate of {c!r}, which is no control{nearest(c, controls)}")
        check_positive(f"{where}: rate of {c}", r)
    return dict(rates)


def weights_of(where: str, laws: Sequence[Block], weights: Mapping[str, float]) -> dict[str, float]:
    """Weights of the residuals of all laws, by default 1."""
    names = [n for block in laws for n in block.outputs]
    for n in names:
        if names.count(n) > 1:
            raise BadInput(f"{where}: two laws have a residual {n!r}; rename one")
    for n, w in weights.items():
        if n not in names:
            raise BadInput(f"{where}: the cost has no residual {n!r}{nearest(n, names)}")
        check_positive(f"{where}: weight of {n}", w)
    return {n: float(weights.get(n, 1.0)) for n in names}


def tied_of(where: str, horizon: int, moves: Sequence[int] | None) -> list[bool]:
    """Whether the controls of each stage are those of the stage before."""
    if moves is None:
        return [False] * horizon
    if not isinstance(moves, Sequence):
        raise BadInput(f"{where}: moves = {moves!r} is no list of whole numbers")
    for m in moves:
        check_whole(f"{where}: moves: a length", m)
    if sum(moves) != horizon:
        raise BadInput(f"{where}: moves = {list(moves)} must have the sum {horizon}")
    return [k > 0 for m in moves for k in range(int(m))]


def preview_names(where: str, preview: Sequence[str], known: Sequence[Limit]) -> tuple[str, ...]:
    """Names of inputs that are known ahead."""
    if isinstance(preview, str) or not isinstance(preview, Sequence):
        raise BadInput(f"{where}: preview = {preview!r}; give a list of names of inputs")
    names = [n for n in known if isinstance(n, str)]
    for n in preview:
        if n not in names:
            raise BadInput(
                f"{where}: preview of {n!r}, which is no held input or named bound"
                f"{nearest(str(n), names)}"
            )
    return tuple(preview)
