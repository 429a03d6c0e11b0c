"""What is said of runs in words: a line for each controller, and what of it is to be doubted."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from html import escape

import numpy as np

from slipctl.block.units.unit_algebra import display_scale
from slipctl.run.metrics import Metric, Run
from slipctl.run.results import Results
from slipctl.run.warnings.doubts import EstimateOff
from slipctl.run.warnings.wheels import BACK, FIRST
from slipctl.run.waveform import rms
from slipctl.study.case_setup import warnings_before_run
from slipctl.study.report.texts import number, values_beyond_limit

HELD = 1.5
"""The slip was held all the same: its error was at most so many times that of the other time."""

KMH = 3.6
"""Kilometres an hour in a metre a second."""


# ---- a line for each controller ------------------------------------------------------------------


def answer_line(results: Results, scenario: str, loop: str) -> str:
    """What a loop reached in a scenario."""
    metrics = results.metrics[scenario][loop]
    run = Run(results.data[scenario][loop], results.study.signals)
    said = [text for text in (_stop(run, metrics), _wheels(run, metrics)) if text]
    names = list(values_beyond_limit(results, scenario).get(loop, {}))
    if names:
        said.append(f"misses its limit{'s' if len(names) > 1 else ''} of {' and '.join(names)}")
    return f"{loop} {'; '.join(said)}" if said else f"{loop} has run"


def _stop(run: Run, metrics: Mapping[str, Metric]) -> str:
    """Where the vehicle stopped, or how far it came."""
    v, distance = run.get("speed"), metrics.get("distance")
    stop = metrics.get("stopping_distance")
    back = v is not None and float(v[0]) >= 0 and float(v[-1]) < -BACK
    if stop is not None and stop.value is not None:
        return f"stops in {number(stop.value)} m" + (" and rolls back" if back else "")
    if v is None or distance is None:
        return ""
    ends = f"{number(KMH * abs(float(v[-1])), 3)} km/h" + (" backwards" if back else "")
    there = f"{number(run.duration, 3)} s, {number(distance.value)} m"
    if stop is not None:
        return f"does not stop: {ends} after {there}"
    begins = f"{number(KMH * abs(float(v[0])), 3)} km/h"
    return f"goes from {begins} to {ends} in {there}"


def _wheels(run: Run, metrics: Mapping[str, Metric]) -> str:
    """How the wheels fared: locked, or how far they slipped."""
    lock, slip = metrics.get("lock_time"), metrics.get("slip_max")
    if run.slip_sign > 0 and lock is not None:
        locked = float(lock.value)  # type: ignore[arg-type]
        return f"wheels lock for {number(locked, 3)} s" if locked else "wheels never lock"
    if slip is None:
        return ""
    return f"largest slip {number(slip.value, 3)}" + (f" {slip.unit}" if slip.unit != "1" else "")


# ---- doubts --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Remark:
    """A doubt about the estimator of a loop.

    Attributes:
        scenario, loop: the run. text: in words. numbers: each estimate that was off, a line each.
        held: whether the slip was held all the same.
    """

    scenario: str
    loop: str
    text: str
    numbers: tuple[str, ...]
    held: bool


def estimator_remarks(results: Results) -> list[Remark]:
    """What is to be doubted of the estimates, a sentence for each loop that has a doubt."""
    found = []
    for scenario, logs in results.data.items():
        for loop, log in logs.items():
            off = [EstimateOff(**row) for row in json.loads(log.attrs.get("estimates_off") or "[]")]
            if not off:
                continue
            longest = max(off, key=lambda e: e.stop - e.start)
            held, said = _fared(Run(log, results.study.signals), longest)
            axle = f" of axle {longest.axle}" if longest.axle else ""
            when = f"from {longest.start:.1f} s " + (
                "on" if longest.to_end else f"to {longest.stop:.1f} s")  # fmt: skip
            text = f"the estimated {longest.what}{axle} was wrong {when}; {said}"
            found.append(Remark(scenario, loop, text, tuple(e.numbers for e in off), held))
    return found


def _fared(run: Run, off: EstimateOff) -> tuple[bool, str]:
    """Whether the slip was held while an estimate was off, and that in words."""
    v, slip, error = run.each("speed"), run.each("slip"), run.slip_error
    if v is None or slip is None:
        return False, "whether the slip was held is not known"
    signed = slip * run.slip_sign
    rim = v - signed if run.unit("slip") == "m/s" else v * (1 - signed)
    then = (run.time >= off.start) & (run.time <= off.stop) & run.moving
    locked = then & (np.abs(rim) < 0.05 * np.abs(v)).any(axis=1)
    if locked.any():
        return False, f"wheels locked for {number(run.tick * np.count_nonzero(locked), 3)} s then"
    rest = run.moving & ~then
    known = error if then.any() and rest.any() else None
    if known is not None and rms(known[then]) <= HELD * rms(known[rest]):
        return True, "the controller held the slip all the same"
    factor, unit = display_scale(run.unit("slip"))
    most = number(factor * float(signed[then].max()) if then.any() else 0.0, 3)
    said = most if unit == "1" else f"{most} {unit}"
    return False, f"the slip came to {said} then, no wheel locked"


def warnings_of_runs(results: Results) -> list[tuple[str, str]]:
    """What gives reason to doubt the runs, each line with the runs that it is about.

    What is physics comes first; then the estimators of loops that did not hold the slip.
    """
    by_line: dict[str, dict[str, list[str]]] = {}
    remarks = estimator_remarks(results)
    for case in results.cases:
        scenario = case.scenario.name
        for name, loop in case.loops.items():
            log = results.data.get(scenario, {}).get(name)
            late = str(log.attrs.get("told", "")) if log is not None else ""
            known = {n for r in remarks if (r.scenario, r.loop) == (scenario, name)
                     for n in r.numbers}  # fmt: skip
            for line in [
                *filter(None, late.split("\n")),
                *results.study.without_effect,
                *warnings_before_run(loop, case.scenario),
            ]:
                if line not in known:
                    by_line.setdefault(line, {}).setdefault(scenario, []).append(name)
    for r in remarks:
        if not r.held:
            by_line.setdefault(r.text, {}).setdefault(r.scenario, []).append(r.loop)
    return [
        (line, "; ".join(f"{s}: {', '.join(names)}" for s, names in runs.items()))
        for line, runs in sorted(by_line.items(), key=lambda item: not item[0].startswith(FIRST))
    ]


# ---- in a page ----------------------------------------------------------------------------------


def answer_html(results: Results) -> str:
    """The answer of a study; of a vehicle, a line for each controller."""
    if results.study.short:
        return f"<p><b>In short.</b> {escape(results.study.short)}</p>"
    if results.study.claims:
        return ""
    lines = [answer_line(results, s, n) for s, loops in results.metrics.items() for n in loops]
    return f"<ul>{''.join(f'<li>{escape(line)}.</li>' for line in lines)}</ul>" if lines else ""


def remarks_html(results: Results) -> str:
    """What is to be doubted of the estimators, and all numbers of it."""
    out = []
    for r in estimator_remarks(results):
        out.append(f"<p>{escape(f'{r.scenario}/{r.loop}: {r.text}')}.</p>")
        out += [f'<p class="soft">{escape(n)}.</p>' for n in r.numbers]
    return "".join(out)
