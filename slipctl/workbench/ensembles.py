"""A small ensemble of draws behind the run: how many of them are within the limits."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from slipctl.errors import BadInput, RunFailed
from slipctl.run.sweep.ensemble import World
from slipctl.run.sweep.spread import count_kept
from slipctl.workbench.desk import Rig

DRAWS = 20
"""Runs of a small ensemble."""


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
