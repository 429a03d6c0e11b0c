"""What a run came to: metrics beside their limits, doubts in words, all signals at one time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from slipctl.block.units.unit_algebra import display_scale
from slipctl.design.goals import single
from slipctl.errors import BadInput
from slipctl.run.logs.run_log import Log
from slipctl.run.metrics import METRICS, Metric
from slipctl.run.preparation import prepare
from slipctl.study.case_setup import warnings_before_run
from slipctl.study.report.texts import number
from slipctl.workbench.curves import finite
from slipctl.workbench.desk import Rig


def metric_rows(metrics: Mapping[str, Metric], limits: Mapping[str, float]) -> list[dict[str, Any]]:
    """A row for each metric: its worst value, unit, better end, limit, whether it is kept.

    A value of None is an event that never came; above a limit it counts as not kept. A limit
    without its metric has a row too.
    """
    rows = []
    for name in dict.fromkeys([*metrics, *limits]):
        metric, limit = metrics.get(name), limits.get(name)
        better = METRICS[name].better
        value = math.nan if metric is None else single(metric, better != "high")
        scale, unit = display_scale(metric.unit if metric else "1")
        known = math.isfinite(value)
        rows.append({
            "name": name.replace("_", " "), "key": name, "unit": unit, "better": better,
            "meaning": METRICS[name].meaning, "value": scale * value if known else None,
            "shown": number(scale * value) if known else "never" if metric else "not measured",
            "limit": None if limit is None else scale * limit,
            "limit_shown": "" if limit is None else number(scale * limit),
            "kept": None if limit is None else bool(known and value <= limit),
        })  # fmt: skip
    return rows


def warnings_of_rig(rig: Rig, log: Log) -> list[str]:
    """What gives reason to doubt a run, in words: of the loop, then of its log."""
    lines = [
        *rig.study.without_effect,
        *log.told(),
        *warnings_before_run(rig.loop, rig.case.scenario),
    ]
    return list(dict.fromkeys(lines))


def signals_at(rig: Rig, numbers: Mapping[str, float], time: float) -> list[dict[str, Any]]:
    """Every signal of a loop in the tick that contains a time, the run rolled again up to it.

    Args:
        rig: the loop. numbers: that were moved. time: in s, from the start of the run on.

    Returns:
        For each signal its name, its values (one, or one per axle) in the unit beside them, its
        kind and its meaning; of a state the value at the start of the tick.

    Raises:
        BadInput: the run does not reach the time.
    """
    loop, scenario = rig.loop, rig.case.scenario
    tick = float(loop.period or 0.0)
    row = int(time / tick + 1e-9)
    if not 0 <= time < scenario.duration:
        raise BadInput(f"the run goes from 0 s to {scenario.duration:g} s; {time:g} s is not in it")
    # the noise of a shorter run begins as that of the long one
    part = prepare(
        loop, scenario.but(duration=(row + 1) * tick), compile=rig.compiled, every=max(row, 1)
    )
    log = part(numbers)
    if abs(float(log["time"][-1]) - row * tick) > tick / 2:
        raise BadInput(f"the run ended before {time:g} s")
    by_name = {s.name: s for s in loop.signals}
    found = []
    for name in log:
        signal = by_name.get(name)
        if signal is None:
            continue
        scale, unit = display_scale(signal.unit)
        values = scale * np.atleast_1d(np.asarray(log[name], dtype=float)[-1])
        found.append({"name": name, "values": list(map(finite, values)), "unit": unit,
                      "role": signal.role, "doc": signal.doc})  # fmt: skip
    return found
