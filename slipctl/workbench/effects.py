"""What numbers do to the metrics: exact slopes where the loop is smooth, differences, draws."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from slipctl.design.goals import single
from slipctl.design.slopes.gradients import SMOOTH, Slopes
from slipctl.errors import BadInput, RunFailed
from slipctl.run.metrics import METRICS, Metric
from slipctl.run.sweep.ensemble import Draw, Ensemble, World
from slipctl.run.sweep.spread import count_kept
from slipctl.workbench.desk import Rig
from slipctl.workbench.sliders import Slider

STEP = 0.02
"""Share by which a number is moved to either side where its effect is a difference."""

METRICS_SHOWN = ("distance", "slip_error_rms", "slip_max", "torque_ripple", "lock_time")
"""Metrics whose change is told, of those that a run has."""

DRAWS = 20
"""Runs of a small ensemble."""

SMOOTH_SHOWN = tuple(m for m in SMOOTH if m in ("slip_error_rms", "distance"))
"""Metrics whose slope is exact, where the loop has one."""


def exact_slopes(
    rig: Rig, numbers: Mapping[str, float], names: Sequence[str]
) -> dict[str, dict[str, float]]:
    """Slopes of metrics by numbers of a loop, from CasADi's derivatives along the whole run.

    Returns:
        By metric that the run has and number, in the unit of the metric by that of the number.

    Raises:
        BadInput: the loop is not smooth in them; says why.
    """
    first = next(s for s in rig.sliders if s.name == names[0])
    beside = f"{first.left!r}:{first.right!r}"  # a world wants one; what it draws is not asked for
    world = World(
        rig.loop, rig.case.scenario, Ensemble({first.name: beside}), signals=rig.study.signals,
        known=rig.case.known, free=tuple(names), compile=False,
    )  # fmt: skip
    draw = Draw({}, rig.case.scenario, rig.case.known, {})
    slopes, known = Slopes(world, list(names)), world.metrics(numbers, draw)
    found = slopes.of(numbers, draw, [m for m in SMOOTH_SHOWN if m in known])
    return {
        m: {n: float(v) for n, v in zip(names, values, strict=True)} for m, values in found.items()
    }


def difference_rows(
    rig: Rig, numbers: Mapping[str, float], sliders: Sequence[Slider]
) -> Iterator[dict[str, Any]]:
    """Change of each metric with each number, from two runs a number, told number by number.

    Yields:
        Name, unit, value, the step, and for each metric the change when the number grows by 1 %.
        A metric that jumps, as an event that comes on one side only, has none.
    """
    for s in sliders:
        value = float(numbers.get(s.name, s.value))
        low = max(value * (1 - STEP), -math.inf if s.lo is None else s.lo)
        high = min(value * (1 + STEP), math.inf if s.hi is None else s.hi)
        if value == 0 or low == high:
            continue
        try:
            down, up = (
                rig.measured.metrics(rig.measured.prepared({**numbers, s.name: v}))
                for v in sorted((low, high))
            )
        except (BadInput, RunFailed) as error:
            yield {"name": s.name, "why": str(error)}
            continue
        share = abs(high - low) / abs(value)
        yield {
            "name": s.name, "unit": s.unit, "value": value,
            "effects": {m: _change(m, down, up, share) for m in METRICS_SHOWN if m in up},
        }  # fmt: skip


def _change(
    name: str, down: Mapping[str, Metric], up: Mapping[str, Metric], share: float
) -> dict[str, Any]:
    largest = METRICS[name].better != "high"
    pair = [single(m[name], largest) if name in m else math.nan for m in (down, up)]
    if not all(map(math.isfinite, pair)):
        return {"by": None, "unit": up[name].unit}
    return {"by": (pair[1] - pair[0]) / share / 100, "unit": up[name].unit}


def ensemble_rows(
    rig: Rig, numbers: Mapping[str, float], draws: int = DRAWS
) -> Iterator[dict[str, Any]]:
    """Draws of the study's ensemble with these numbers, told run by run.

    Yields:
        How many have run and failed, the share within the limits with its interval in words, and
        of each metric with a limit the values so far.

    Raises:
        BadInput: the study declares no ensemble or no limits; a number is both drawn and moved.
    """
    study, scenario = rig.study, rig.case.scenario.name
    ensemble = study.ensembles.get(scenario)
    if ensemble is None:
        raise BadInput(f"{study.name} declares no ensemble of {scenario}; write [ensemble] into the"
                       " file, draw = { m = \"34 t:42 t\" }")  # fmt: skip
    if not study.limits:
        raise BadInput(f"{study.name} declares no limits; write [limits] into the file,"
                       " stopping_distance = \"140 m\"")  # fmt: skip
    world = World(
        rig.loop, rig.case.scenario, ensemble, signals=study.signals, known=rig.case.known,
        free=tuple(numbers), compile=rig.compile,
    )  # fmt: skip
    drawn = {a.name for a in world.ranges}
    both = sorted(drawn & set(numbers))
    if both:
        raise BadInput(f"{', '.join(both)} is drawn by the ensemble and moved; reset its slider")
    runs: list[dict[str, Any]] = []
    failed = 0
    for k in range(draws):
        try:
            found = world.metrics(numbers, world.draw(0, k))
            runs.append({n: m.value for n, m in found.items()})
        except (BadInput, RunFailed):
            runs.append({})  # keeps no limit
            failed += 1
        kept = count_kept(runs, study.limits)
        yield {
            "runs": len(runs), "draws": draws, "failed": failed, "text": str(kept),
            "within": kept.within if kept else 0,
            "values": {n: [r.get(n) for r in runs] for n in study.limits},
            "limits": dict(study.limits), "notes": list(world.notes),
        }  # fmt: skip
