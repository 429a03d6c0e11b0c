"""A sweep that is open: the loop it ran, and its runs, each of which can be run again."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from slipctl.block.units.unit_algebra import display_scale, parse_quantity
from slipctl.errors import BadInput
from slipctl.run.sweep.spread import value_in_run
from slipctl.run.sweep.sweep_results import Sweep, open_sweep
from slipctl.study import resolve
from slipctl.study.case_setup import Setting
from slipctl.workbench.answers import Answers, Head, Request
from slipctl.workbench.curves import finite
from slipctl.workbench.desk import Desk
from slipctl.workbench.sliders import Slider

MOST = 5000
"""Runs that a page gets, the first ones."""


def loop_of_sweep(found: Sweep) -> str:
    """Name of the loop that a sweep ran, as ``slipctl open`` takes it.

    Raises:
        BadInput: its file is not here.
    """
    study, _, loop = str(found.about["loop"]).partition(":")
    scenario = str(found.about.get("scenario") or "")
    ending = f":{loop}" + (f"@{scenario}" if scenario else "")
    if study in resolve.studies():
        return study + ending
    words = shlex.split(str(found.about.get("command", "")))
    homes = [w.rpartition(":")[0] or w for w in words]
    file = next((h for h in homes if h.endswith((".toml", ".py")) and Path(h).stem == study), "")
    for folder in (Path(), *found.folder.resolve().parents):
        if file and (folder / file).is_file():
            return str(folder / file) + ending
    raise BadInput(f"{found.folder} ran {study}:{loop}, and {file or 'its file'} is not here")


def rows_of_sweep(found: Sweep, sliders: Sequence[Slider]) -> dict[str, Any]:
    """Runs of a sweep: numbers of each that a slider has, its metrics, why it failed.

    A metric that a run never reached is None. Of a metric with several values the worst counts.
    """
    units = {s.name: s.unit for s in sliders}
    kept = [Setting.read(t) for t in found.about.get("set") or []]
    given = {s.name: parse_quantity(s.value, units[s.name]) for s in kept if s.name in units}
    names = list(found.units)
    scales = {n: display_scale(found.units[n][0]) for n in names}
    runs: list[dict[str, Any]] = []
    for run, numbers, metrics, why in found.runs[:MOST]:
        values = [finite(value_in_run(n, metrics) * scales[n][0]) for n in names]
        mine = {n: v for n, v in numbers.items() if n in units}
        runs.append({"run": run, "numbers": {**given, **mine}, "all": dict(numbers),
                     "metrics": values, "failed": why})  # fmt: skip
    moved = {n for r in runs for n in r["all"]}
    lost = sorted(moved - set(units)) + [s.name for s in kept if s.name not in units]
    return {
        "folder": str(found.folder), "missing": found.missing, "axes": sorted(moved), "runs": runs,
        "metrics": [{"key": n, "name": n.replace("_", " "), "unit": scales[n][1],
                     "limit": scales[n][0] * found.limits[n] if n in found.limits else None}
                    for n in names],
        "kept": str(found.kept) if found.kept else "", "command": found.about.get("command", ""),
        "lost": lost, "swapped": found.about.get("swapped") or [],
    }  # fmt: skip


class SweepAnswers(Answers):
    """What answers a window in which a sweep is open: its loop, and its runs beside it.

    Args:
        folder: of the sweep. home: folder that files are written into. compile: compile loops.
    """

    def __init__(self, folder: str, home: str, compile: bool = True) -> None:
        self.sweep = open_sweep(folder)
        super().__init__(Desk(loop_of_sweep(self.sweep), home, compile))

    def model(self, request: Request) -> Iterator[Head]:
        """What is open, with the runs of the sweep where the loop is the one that it ran."""
        for head in super().model(request):
            if not head.get("broken"):
                sliders = self.desk.rig(self._text(request)).sliders
                head = {**head, "sweep": rows_of_sweep(self.sweep, sliders)}
            yield head
