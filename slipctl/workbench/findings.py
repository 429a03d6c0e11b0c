"""What a run came to: metrics beside those of another run and their limits, and doubts in words."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from slipctl.block.units.unit_algebra import display_scale
from slipctl.design.goals import single
from slipctl.run.metrics import METRICS, Metric
from slipctl.study.case_setup import warnings_before_run
from slipctl.study.report.texts import number

if TYPE_CHECKING:
    from slipctl.run.logs.run_log import Log
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
