"""What the claims of ``hst_traction`` are judged on: numbers read off the logs of a run."""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np

from slipctl import Results
from slipctl.models.contact import peak
from slipctl.models.hst_traction import M_EFF, resistance, tractive_effort
from slipctl.run.results import NotRun
from slipctl.studies.hst_traction.loops import DURATION, RAIL

KMH = 3.6
EDGES = (*(begin for _, begin in RAIL), 200.0, 250.0, DURATION)
"""Times in s at which a stretch of the run begins: a surface, or the coasting of 200 s to 250 s."""

KEPT = 0.02
"""Share of a force within which two of them count as the same."""


def begin(r: Results) -> float:
    """Time of the paper's run in s at which the runs begin."""
    return 105.0 if r.quick else 0.0


def times(r: Results, scenario: str, loop: str) -> np.ndarray:
    """Times of a log in s of the paper's run."""
    return np.asarray(r.log(scenario, loop)["time"].values + begin(r))


def after(r: Results, scenario: str, loop: str, start: float, stop: float, name: str) -> np.ndarray:
    """Values of a logged signal between two times in s of the paper's run."""
    t = times(r, scenario, loop)
    inside = (t >= start) & (t < stop)
    if not inside.any():
        raise NotRun(f"{scenario}/{loop} was not run from {start:g} s to {stop:g} s")
    return np.asarray(r.log(scenario, loop)[name].values[inside])


def creep(r: Results, scenario: str, loop: str, which: str) -> float:
    """Largest (``"highest"``) or smallest (``"lowest"``) creep of a run in km/h."""
    values = r.log(scenario, loop)[f"worst.{which}"].values
    return KMH * float(values.max() if which == "highest" else values.min())


def error(
    r: Results, scenario: str, loop: str, start: float = 0.0, stop: float = 1e9
) -> np.ndarray:
    """Speed less its target in m/s."""
    speed = after(r, scenario, loop, start, stop, "plant.train.v")
    return speed - after(r, scenario, loop, start, stop, "v_d")


def rms(values: np.ndarray) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def parameter(r: Results, scenario: str, loop: str, name: str) -> float:
    """Parameter of a loop as it ran; the first of those that each axle has."""
    case = next(c for c in r.cases if c.scenario.name == scenario)
    return float(np.ravel(case.loops[loop].param_values()[name])[0])


@cache
def heights(surface: str) -> tuple[np.ndarray, np.ndarray]:
    """Peak adhesion of a surface over the speed in m/s."""
    speeds = np.linspace(1.0, 80.0, 40)
    return speeds, np.array([peak(float(v), surface).value for v in speeds])


def surface_at(t: float) -> str:
    """Surface of the paper's run at a time in s."""
    return [name for name, start in RAIL if start <= t + 1e-9][-1]


def carried(r: Results, scenario: str, loop: str, start: float, stop: float) -> np.ndarray:
    """Force in N that ten axles can put on the rail, the tractive effort included."""
    v = after(r, scenario, loop, start, stop, "plant.train.v")
    weight = parameter(r, scenario, loop, "ctl.limit.W") * 9.8
    axles = parameter(r, scenario, loop, "ctl.limit.n_traction")
    most = axles * weight * np.interp(v, *heights(surface_at(start)))
    return np.minimum(most, [float(tractive_effort(float(x))) for x in v])


def demand(r: Results, scenario: str, loop: str, start: float, stop: float) -> np.ndarray:
    """Force in N that the target asks for."""
    v_d = after(r, scenario, loop, start, stop, "v_d")
    t = times(r, scenario, loop)
    t = t[(t >= start) & (t < stop)]
    grid = np.linspace(0.0, 90.0, 91)
    drag = [float(resistance(v=float(v))["F_d"]) for v in grid]
    return M_EFF * np.gradient(v_d, t) + np.interp(v_d, grid, drag)


def stretches(r: Results, scenario: str, loop: str) -> dict[tuple[float, float], float]:
    """Share of the squared speed error by stretch of the run that was run."""
    t, square = times(r, scenario, loop), error(r, scenario, loop) ** 2
    found = {}
    for a, b in pairwise(sorted(EDGES)):
        inside = (t >= a) & (t < b)
        if inside.any():
            found[a, b] = float(square[inside].sum() / square.sum())
    return found


def where_lost(scenario: str, loop: str) -> Any:
    """Where a law with the limit loses most, and what rail, limit and target say of it there."""

    def told(r: Results) -> str:
        share = stretches(r, scenario, loop)
        a, b = max(share, key=lambda k: share[k])
        off = float(np.mean(error(r, scenario, loop, a, b)))
        what = f"{share[a, b]:.0%} of the squared error is of {surface_at(a)} rail, {a:g} s to"
        what += f" {min(b, DURATION):g} s"
        forces = [f(r, scenario, loop, a, b) for f in (demand, carried)]
        limit = after(r, scenario, loop, a, b, "ctl.limit.F_hi")
        need, rail, allowed = (float(np.mean(f)) for f in (*forces, limit))
        numbers = (
            f"on average the target asks for {need / 1e3:.0f} kN, the limit allows"
            f" {allowed / 1e3:.0f}, the rail carries {rail / 1e3:.0f}"
        )
        if off > 0:
            return f"{what}, where the train is too fast by {off:.2g} m/s"
        if need > rail:
            return f"{what}: {numbers}; no law can follow"
        if allowed < rail * (1 - KEPT) and (limit < forces[0]).any():
            return f"{what}: {numbers}; the rule of the next poorer surface holds the train back"
        return f"{what}: {numbers}"

    return told


def believed(r: Results, scenario: str, loop: str) -> float:
    """Adhesion that the limit believes in from 200 s to 250 s, by what its rule means on wet rail.

    The rule means the peak of the next poorer surface; the smallest value counts.
    """
    v = after(r, scenario, loop, 200.0, 250.0, "plant.train.v")
    mu = after(r, scenario, loop, 200.0, 250.0, "ctl.limit.mu_least")
    each = {name: np.interp(v, *heights(name)) for name, _ in RAIL}
    poorer = [np.where(h < each["wet"], h, 0.0) for h in each.values()]
    return float((mu / np.max(poorer, axis=0)).min())


def recovers(r: Results, scenario: str, loop: str) -> bool:
    """Whether a run on damp rail keeps within 0.5 m/s of its target, 400 s on."""
    return bool(np.abs(error(r, scenario, loop, 400.0, 530.0)).max() < 0.5)
