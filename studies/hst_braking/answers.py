"""Answers to the claims of Zhang 2021: each reads what a run says, as a number or in words."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from slipctl import Results
from slipctl.models.zhang_2021.certificate import prescribed_performance as ppc
from slipctl.models.zhang_2021.hst_braking import I_W, R
from slipctl.run.periods import mean as period_mean
from slipctl.studies.hst_braking.loops import NAMES, H
from slipctl.studies.hst_braking.measures import (
    LENGTH,
    NEAR_FORCE,
    NEAR_SLIP,
    spans,
    time_until,
)

FOUR = ("fixed_slip", "pid", "efc", "eppfc")
THREE = FOUR[1:]

OURS: Mapping[str, str] = {k: k for k in FOUR}
PRINTED_PID: Mapping[str, str] = {
    "pid": "pid_printed", "efc": "efc_true_reference", "eppfc": "eppfc_true_reference",
}  # fmt: skip
"""Loops that compare the printed gains of PID: all three follow the true best slip."""

STEADY = 0.02
"""Share of its steady value within which a torque has arrived."""

ARRIVED = 5e-4
"""Slip error that counts as arrived."""

Answer = Callable[[Results], Any]


def found_after(loop: str, rail: str = "snow") -> Answer:
    """Time in s from which the searched slip is within 0.01 of the best one for good."""

    def time(r: Results) -> float | None:
        log = r.log("base", loop)
        off = np.abs(log["ctl.search.best"].values - log["lam_opt"].values)
        return time_until(off[spans(log)[NAMES.index(rail)]], NEAR_SLIP)

    return time


def way_of_the_slip(loop: str) -> Answer:
    """How far the slip gets after the change at 2 s, and how long it takes to the best one."""

    def said(r: Results) -> str:
        log = r.log("base", loop)
        snow = spans(log)[1]
        lam = log["plant.wheel.lam"].values[snow]
        t = time_until(np.abs(lam - log["lam_opt"].values[snow]), NEAR_SLIP)
        arrived = "never gets there" if t is None else f"is there after {t:.3f} s"
        return f"the slip itself moves by {np.ptp(lam[:51]):.3f} in 50 ms and {arrived}"

    return said


def adhesion_in_time(r: Results) -> float | None:
    """Longest time in s until the adhesion force is within 2 % after a change of the rail."""
    log = r.log("base", "eppfc")
    off = np.abs(log["ctl.filter.F_a"].values - log["plant.wheel.F_a"].values)
    times = [time_until(off[s], NEAR_FORCE) for s in spans(log)[1:]]
    return None if None in times else max(t for t in times if t is not None)


def printed_filter(r: Results) -> str:
    """How far the printed filter is off at the end of the dry rail."""
    log = r.log("base", "filter_printed")
    k = spans(log)[0].stop - 1
    off = abs(log["ctl.filter.F_a"].values[k] - log["plant.wheel.F_a"].values[k]) / 1e3
    return f"as printed, gamma per second and P(0) = 0.5, it is {off:.1f} kN off after 2 s"


def distances(scenario: str = "base", loops: Mapping[str, str] = OURS) -> Answer:
    """Distance in m of each controller in 6 s."""
    return lambda r: {k: float(r.metric(scenario, v, "distance")) for k, v in loops.items()}


def distance_of(scenario: str, loop: str) -> Answer:
    """Distance in m of one controller in 6 s."""
    return lambda r: r.metric(scenario, loop, "distance")


def bound_of(loop: str) -> Answer:
    """Shortest way of this model without resistance, in words."""
    ideal = "ideal_fixed" if loop == "fixed_slip" else "ideal"
    held = "at slip 0.1" if loop == "fixed_slip" else "held at its peak from the start"

    def said(r: Results) -> str:
        bound = float(r.metric("base", ideal, "distance"))
        return f"adhesion {held} needs {bound:.4f} m without resistance"

    return said


def lead(scenario: str, before: str, after: str) -> Answer:
    """How much shorter one controller's way is than another's, in m."""
    return lambda r: r.metric(scenario, after, "distance") - r.metric(scenario, before, "distance")


def variance(r: Results, scenario: str, loop: str, window: float = 0.5, joint: bool = False
             ) -> float:  # fmt: skip
    """Variance of the acceleration in m2/s4 in the windows after 0, 2 and 4 s.

    Args:
        r: the results.
        scenario, loop: of which run.
        window: length of each window in s.
        joint: one variance of all samples together, in place of the mean of three.
    """
    log = r.log(scenario, loop)
    a, n = log["plant.wheel.a"].values, round(window / H)
    parts = [a[s.start : s.start + n] for s in spans(log)]
    return float(np.var(np.concatenate(parts)) if joint else np.mean([np.var(p) for p in parts]))


def variances(scenario: str = "base", **how: Any) -> Answer:
    """Variance of the acceleration in m2/s4 of each controller."""
    return lambda r: {k: variance(r, scenario, k, **how) for k in THREE}


def falls(values: Mapping[str, float]) -> bool:
    """Whether PID has the largest value and E-PPFC the smallest."""
    return values["pid"] > values["efc"] > values["eppfc"]


def where_it_turns(r: Results) -> str:
    """Windows with which the order of the variances is the paper's, and with which it is not."""
    holds: dict[bool, list[str]] = {True: [], False: []}
    for window in (0.1, 0.2, 0.5, 1.0, 2.0):
        for joint, words in ((False, "mean"), (True, "joint")):
            values = variances(window=window, joint=joint)(r)
            holds[falls(values)].append(f"{1e3 * window:g} ms {words}")
    texts = {k: ", ".join(v) or "no window" for k, v in holds.items()}
    values = variances()(r)
    spread = 100 * (max(values.values()) / min(values.values()) - 1)
    return (
        f"the three differ by {spread:.2g} %; the order holds with {texts[True]} and turns with"
        f" {texts[False]}"
    )


def stays_inside(r: Results) -> bool:
    """Whether the error stays in the funnel without any restart, noise-free and with noise."""
    for scenario in ("base", "noise"):
        restarts = r.log(scenario, "eppfc")["ctl.law.restarts"].values[-1]
        if r.metric(scenario, "eppfc", "funnel_exits") or restarts:
            return False
    return True


def torque_overshoot(log: Any, first: float) -> float:
    """How far the torque goes past its steady value after a change at ``first`` s, in %.

    Past it means further on the way from the torque before the change, in shares of the steady one.
    """
    torque, k = np.abs(log["plant.brake.T_b"].values), round(first / H)
    n = round(LENGTH / H)
    steady = period_mean(torque[k + 3 * n // 4 : k + n])
    before = torque[k - 1] if k else 0.0
    way = 1 if steady > before else -1
    return 100 * max(0.0, float((way * (torque[k : k + n] - steady)).max())) / steady


def torque_overshoots(*loops: str) -> Answer:
    """In words: overshoot of the torque after 0 s and 2 s."""

    def said(r: Results) -> str:
        parts = []
        for k in loops:
            both = [torque_overshoot(r.log("base", k), t) for t in (0, 2)]
            parts.append(f"{k} {both[0]:.0f} / {both[1]:.0f} %")
        return f"of the torque after 0 s / 2 s: {', '.join(parts)}"

    return said


def torque_times(first: float) -> Answer:
    """Time in s from a change until the torque stays within 2 % of its steady value."""

    def times(r: Results) -> dict[str, float | None]:
        found = {}
        for name in THREE:
            torque = r.log("base", name)["plant.brake.T_b"].values
            k, n = round(first / H), round(LENGTH / H)
            steady = period_mean(torque[k + 3 * n // 4 : k + n])
            found[name] = time_until(np.abs(torque[k : k + n] / steady - 1), STEADY)
        return found

    return times


def slip_error(r: Results, loop: str) -> np.ndarray:
    """Slip minus its reference over the run."""
    log = r.log("base", loop)
    return np.asarray(log["plant.wheel.lam"].values - log["ctl.reference.lam_ref"].values)


def steady_errors(scenario: str) -> Answer:
    """Rms of slip minus its reference over the last 0.5 s of each rail, of each controller."""

    def found(r: Results) -> dict[str, float]:
        errors = {}
        for name, loop in OURS.items():
            log = r.log(scenario, loop)
            off = log["plant.wheel.lam"].values - log["ctl.reference.lam_ref"].values
            late = np.concatenate([off[k - 500 : k] for k in (2000, 4000, 6000)])
            errors[name] = float(np.sqrt(np.mean(late**2)))
        return {n: errors[n] for n in THREE}

    return found


def slip_overshoot(r: Results, loop: str) -> float:
    """Largest slip error past zero after the start (from below) and the change at 2 s (above)."""
    e = slip_error(r, loop)
    return max(0.0, float(e[:2000].max()), float(-e[2020:4000].min()))


def slip_overshoots(loops: Mapping[str, str]) -> Answer:
    """Slip error past zero of each controller."""
    return lambda r: {k: slip_overshoot(r, v) for k, v in loops.items() if k in THREE}


def slip_times(first: int, loops: Mapping[str, str] = OURS, never: float | None = None) -> Answer:
    """Time in s until the slip error stays below 0.0005 from tick ``first`` on."""

    def times(r: Results) -> dict[str, float | None]:
        found = {}
        for k in THREE:
            t = time_until(np.abs(slip_error(r, loops[k])[first : first + 2000]), ARRIVED)
            found[k] = never if t is None else t
        return found

    return times


def no_lock(r: Results) -> bool:
    """Whether the wheel never locks under fixed slip, in base and real."""
    return not any(r.metric(s, "fixed_slip", "lock_time") for s in ("base", "real"))


def adhesion_used(*loops: str) -> Answer:
    """Mean share of the peak adhesion that each controller uses."""
    return lambda r: {k: r.metric("base", k, "adhesion_use") for k in loops}


def shorter_than_the_bound(r: Results) -> bool:
    """Whether 254.0479 m is possible without resistance: at least the bound's distance."""
    return float(r.metric("base", "ideal", "distance")) <= 254.0479


def edge_of_the_funnel() -> tuple[float, float]:
    """Disturbance that the printed funnel holds in 1/s, and how long it holds 1.01 times that."""
    W = ppc.largest_disturbance(100, 0.005, 1.2, 1.2)
    return W, ppc.escape_time(1.01 * W, 100, 0.005, 1.2, 1.2)


def theorem_in_words(r: Results) -> str:
    """What the funnel of the printed numbers holds, as a force at 50 m/s."""
    W, _ = edge_of_the_funnel()
    force = ppc.adhesion_budget(50.0, 1.01 * W, R, I_W)
    return (
        "Lambda grows without bound near the funnel's edge, where K1 eps/l vanishes: a constant"
        f" error of 1.01 times {W:.4f} 1/s ({force:.0f} N at 50 m/s) leaves the funnel"
    )


def turns_with(r: Results) -> str:
    """Where the order of the distances turns, from the experiment."""
    table = r.table("order")
    bad = [
        f"{what} {value:g} {unit}".strip()
        for what, value, unit, holds in zip(
            table["what"], table["value"], table["unit"], table["pid > efc > eppfc"], strict=True
        )
        if not holds
    ]
    return f"the order turns with {', '.join(bad)}" if bad else "the order holds in every case"


def margins(r: Results) -> str:
    """By how much the distances differ."""
    x = distances()(r)
    return f"E-FC to E-PPFC {1e3 * (x['efc'] - x['eppfc']):.1f} mm"
