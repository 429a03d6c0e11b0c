"""What the claims of ``hst_traction`` are judged on: numbers read off the logs of a run."""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np

from slipctl import Results
from slipctl.models.wang_2025.hst_traction import M_EFF, resistance, tractive_effort
from slipctl.models.wheel_rail.contact import peak
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
    weight = r.number(scenario, loop, "ctl.limit.m_axle") * 9.8
    axles = r.number(scenario, loop, "ctl.limit.n_m")
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
        off = error(r, scenario, loop, a, b)
        what = f"{share[a, b]:.0%} of the squared error is of {stretch(a, b)}"
        fast = float((off[off > 0] ** 2).sum() / (off**2).sum())
        if fast < 0.5:
            return f"{what}: {held_back(r, scenario, loop, a, b)}"
        what += f", where the train is too fast, by up to {off.max():.2g} m/s"
        behind = {k: _lost(r, scenario, loop, *k) for k in share}
        a, b = max(behind, key=lambda k: behind[k])
        if behind[a, b] < 0.1:
            return what
        return (
            f"{what}, to regain its place; it falls behind by {behind[a, b]:.2g} m on"
            f" {stretch(a, b)}: {held_back(r, scenario, loop, a, b)}"
        )

    return told


def stretch(a: float, b: float) -> str:
    """Name of a part of the run."""
    return f"{surface_at(a)} rail, {a:g} s to {min(b, DURATION):g} s"


def _lost(r: Results, scenario: str, loop: str, a: float, b: float) -> float:
    """Way in m that a train falls behind its target over a stretch, from its begin on."""
    x, x_d = (after(r, scenario, loop, a, b, n) for n in ("plant.train.x", "x_d"))
    return float((x - x_d)[0] - (x - x_d).min())


def held_back(r: Results, scenario: str, loop: str, a: float, b: float) -> str:
    """What target, limit and rail say of a stretch, and which of them holds the train back."""
    need, rail = (f(r, scenario, loop, a, b) for f in (demand, carried))
    limit = after(r, scenario, loop, a, b, "ctl.limit.F_hi")
    numbers = (
        f"the target asks for {spread(need)} kN, the limit allows {spread(limit)}, the rail"
        f" and motors give {spread(rail)}"
    )
    short = need > limit
    if not short.any():
        return numbers
    if (need[short] > rail[short]).mean() > 0.5:
        return f"{numbers}; no law can follow"
    return f"{numbers}; the rule of the limit holds the train back"


def spread(force: np.ndarray) -> str:
    """Range of a force over a stretch in kN, a hundredth of the time left out to either side."""
    low, high = np.quantile(force, [0.01, 0.99]) / 1e3
    return f"{low:.0f} to {high:.0f}"


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
