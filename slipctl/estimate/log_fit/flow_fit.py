"""Fit a flow to a log over time: its output follows what was measured, no speed is differentiated.

The unknowns theta are parameters, the start of each stretch, and perhaps a dead time. The output
y(theta) of the flow is rolled over the log (:mod:`.rolled`). Least is sum (measured - y)^2.
With s^2 that sum by samples minus unknowns,

    cov theta = c s^2 (J'J)^-1,   c = 1 + 2 sum_k r_k  (at least 1)

r_k is the correlation of residuals k samples apart. It is 0 for white noise. Wind, a gradient that
nobody told and a law that does not fit make residuals alike, and c samples count as one. The sum
ends where k is five times c (Sokal, Lecture Notes, Cargese 1996).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from slipctl.block.block import Block
from slipctl.errors import BadInput, check_all_known, check_known
from slipctl.estimate.curve import quantity
from slipctl.estimate.log_fit.fit_search import Search
from slipctl.estimate.log_fit.record import FittedOverTime, Record
from slipctl.estimate.log_fit.rollout import Rolled, free_state, stretches
from slipctl.estimate.model import unknown_parameters
from slipctl.estimate.samples import samples_of


def fit_over_time(
    flow: Block,
    data: Mapping[str, Any] | Record | Sequence[Record],
    measured: str,
    unknown: Sequence[str] | None = None,
    *,
    start: Mapping[str, Any] | None = None,
    at: Mapping[str, Any] | None = None,
    delay: str = "",
    rule: str = "hold",
) -> FittedOverTime:
    """Fit parameters of a flow to logs by least squares on its trajectory.

    Args:
        flow: a flow whose states and inputs are single numbers.
        data: columns by name in SI units with ``time``, or logs; what is NaN in the measured one
            was not measured. Each stretch of a log has a start of its own.
        measured: state or output that was measured.
        unknown: parameters to find; by default ``coordinates`` of the flow, or all that have a
            value.
        start: values to start from; else those of the flow.
        at: known parameters, as numbers or texts with a unit.
        delay: input that acts after a dead time, which is found too.
        rule: how an input goes between two samples, ``"hold"`` or ``"linear"``; a delayed one is
            held.

    Raises:
        BadInput: an unknown name, a column that lacks, a parameter without a value, or unknowns
            that the log does not tell. Says which.
    """
    if flow.kind != "flow":
        raise BadInput(f"{flow.name} is a {flow.kind}; a fit over time takes a flow, x' = f")
    check_known(f"{flow.name} has no state or output", measured, [*flow.states, *flow.outputs])
    if delay:
        check_known(f"{flow.name} has no input", delay, flow.inputs)
    check_known("there is no rule", rule, ("hold", "linear"))
    free = free_state(flow, measured)
    if unknown is None:
        unknown = flow.law_data.coordinates or [
            n for n, s in flow.params.items() if not s.derived and s.value is not None
        ]
        unknown = [n for n in unknown if n not in (at or {})]
    unknown = unknown_parameters(flow, unknown)
    told = {n: quantity(flow, n, v) for n, v in (at or {}).items()}
    if twice := [n for n in told if n in unknown]:
        raise BadInput(f"{twice[0]} is both given and unknown; leave it out of one of them")
    check_all_known("start has", start or {}, unknown)
    first = {n: quantity(flow, n, v) for n, v in (start or {}).items()}
    settled = {n: v for n, v in {**told, **first}.items() if n in flow.params}
    flow = flow.with_params(**settled) if settled else flow
    lacking = [s for s in flow.params.values() if s.value is None]
    if lacking:
        words = ", ".join(f"{s.name} ({s.doc}{'' if s.unit == '1' else f', {s.unit}'})"
                          for s in lacking)  # fmt: skip
        raise BadInput(f"{flow.name} needs {words}; give it, --set {lacking[0].name}=VALUE")
    records = _records(flow, data, measured)
    pieces = [p for r in records
              for p in stretches(r.time, r.inputs, r.measured, r.begins, delay)]  # fmt: skip
    if not pieces:
        raise BadInput(f"{records[0].source}: {measured} was measured in no stretch of two samples")
    if not free and len(pieces) > 1:
        raise BadInput(f"{flow.name} has states that are not measured, so nobody knows them behind"
                       " a gap; give a log without one")  # fmt: skip
    begin = {n: float(v) for n, v in flow.start().items()}
    rolled = Rolled(flow, measured, unknown, free, delay, rule, begin)
    try:
        return Search(rolled, pieces, records, set(told)).found()
    except np.linalg.LinAlgError:
        raise BadInput(
            f"{records[0].source}: {flow.name} is not finite over it; look at the units of time and"
            f" {measured}, or give another start, --start NAME=VALUE"
        ) from None


def _records(
    flow: Block, data: Mapping[str, Any] | Record | Sequence[Record], measured: str
) -> list[Record]:
    """The logs, checked."""
    if isinstance(data, Record):
        return [data]
    if not isinstance(data, Mapping):
        if not data:
            raise BadInput("there is no log")
        return list(data)
    found: dict[str, np.ndarray] = {}
    for n in ("time", measured, *flow.inputs):
        if n in data:
            found[n] = samples_of(f"data: {n}", data[n]).ravel()
        elif n in flow.inputs and flow.inputs[n].value is not None:
            found[n] = np.full(len(found["time"]), float(flow.inputs[n].value))
        else:
            check_known("data has no column", n, [str(k) for k in data])
    if len({v.size for v in found.values()}) != 1:
        raise BadInput("data: give columns of one length")
    for n, v in found.items():
        if n != measured and not np.isfinite(v).all():
            raise BadInput(f"data: {n} is not finite everywhere")
    if found["time"].size < 2 or (np.diff(found["time"]) <= 0).any():
        raise BadInput("data: time has to rise from sample to sample")
    y = np.where(np.isfinite(found[measured]), found[measured], np.nan)
    return [Record("data", found["time"], {n: found[n] for n in flow.inputs}, y)]
