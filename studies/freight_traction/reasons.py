"""Reasons of the claims of ``freight_traction``, read off the run that they explain."""

from __future__ import annotations

from typing import Any

import numpy as np

from slipctl import Results
from slipctl.certify.bounds import extremum
from slipctl.models.cheng_2022 import freight_traction as freight
from slipctl.models.cheng_2022.certificate import barrier as barrier_bounds
from slipctl.studies.freight_traction.measures import (
    NEAR,
    TORQUE,
    TRIED,
    ends,
    last,
    middle,
    part,
    ripple,
)

DRY = 1
"""First section of the paper's rail."""


def dry(r: Results) -> dict[str, float]:
    """Parameters of the adhesion on dry rail, as the run had them."""
    found = r.loop("base", "smes_robust").conditions["dry"]
    return {n.rpartition(".")[2]: float(v) for n, v in found.items()}


def steepest(r: Results) -> float:
    """Largest slope of the adhesion on dry rail in s/m."""
    return float(freight.steepest_slope(**dry(r)))


def regime(loop: str) -> Any:
    """Regime of a sliding-mode seeker on dry rail, by its parameters."""

    def told(r: Results) -> str:
        k, rho = (r.number("base", loop, f"ctl.seek.{n}") for n in ("k", "rho"))
        slope, curve = steepest(r), float(freight.peak_curvature(**dry(r)))
        name = extremum.regime(k, rho, slope)
        tau = extremum.time_constant(k, rho, curve)
        return (
            f"rho/k = {rho / k:g} s/m and the steepest slope is {slope:.3g}: {name} regime, time"
            f" constant {tau:.3g} s at the peak"
        )

    return told


def formula(loop: str) -> Any:
    """Ripple of the creep that a sliding-mode seeker has by its formula."""

    def told(r: Results) -> str:
        k, rho, beta = (r.number("base", loop, f"ctl.seek.{n}") for n in ("k", "rho", "beta"))
        return f"by the formula k beta/rho the creep ripples by {k * beta / rho:.3g} m/s"

    return told


def excursion(r: Results) -> str:
    """Largest torque that the ripple reaches."""
    most = float(last(r, "smes_robust", TORQUE, DRY).max())
    return f"the mean over whole periods; the ripple takes the torque up to {most:.3f} kN m"


def locks(loop: str, section: int) -> Any:
    """What a seeker does instead of holding a lock."""

    def told(r: Results) -> str:
        span = ends(r, loop, section)
        mode = part(r, loop, "ctl.seek.mode", *span)
        opened = int(np.count_nonzero((mode[1:] == 0) & (mode[:-1] == 2)))
        swing = ripple(loop, TRIED, section)(r)
        at = middle(r, loop, section)
        return (
            f"the lock opens {opened} times, the creep tried swings by {swing:.2g} m/s around"
            f" {at:.0%} of the best one"
        )

    return told


def middle_of_esa(r: Results) -> str:
    """Where the dither of the perturbation seeker is."""
    return f"the middle of the dither is at {middle(r, 'esa_robust'):.1%} of the best creep"


def other_dithers(r: Results) -> str:
    """Which gains and dithers would meet both claims on perturbation seeking."""
    t = r.table("dither")
    both = [
        f"{k:g} and {a:g}"
        for k, a, at, torque in zip(
            t["gain"], t["dither"], t["middle of the dither, of the best creep"], t["mean torque"],
            strict=True,
        )
        if abs(at - 1) > NEAR and abs(torque - 8250) <= 50
    ]  # fmt: skip
    if not both:
        return "no gain and dither that we tried meets this claim and the other one on it"
    return (
        "gain and dither are not printed, and the outcome is that of our guess: with"
        f" {' or '.join(both)} m/s both claims on this seeker hold"
    )


def esa_reason(r: Results) -> str:
    """Where the middle is, and what other guesses give where they were run."""
    return f"{middle_of_esa(r)}; {other_dithers(r)}" if "dither" in r.tables else middle_of_esa(r)


def pull_of_printed(r: Results) -> str:
    """What the printed shape can hold, and where it was left."""
    loop = "improved_corrected"
    most = barrier_bounds.largest_disturbance(
        *(r.number("base", loop, f"ctl.barrier.{n}") for n in ("k", "k_s"))
    )
    return (
        f"the pull of the printed shape is at most {most:.2g} m/s^2 and none at the barrier;"
        f" {left_by(loop)(r)}"
    )


def left_by(loop: str) -> Any:
    """When and where a loop leaves its barrier for the first time, and what becomes of it."""

    def told(r: Results) -> str:
        log = r.log("base", loop)
        e, t = np.asarray(log["ctl.barrier.e"].values), log["time"].values
        k_a, k_s = (r.number("base", loop, f"ctl.barrier.{n}") for n in ("k_a", "k_s"))
        out = (e < -k_a) | (e > k_s)
        if not out.any():
            return "it is left between two rows of the log"
        k = int(np.argmax(out))
        side = "above" if e[k] > 0 else "below"
        far = float(np.abs(e[out]).max())
        inside = "back inside at the end" if not out[-1] else "and stays outside"
        return f"left {side} after {t[k]:.3g} s, by up to {far:.3g} m/s, {inside}"

    return told


def rest_of_printed(loop: str) -> Any:
    """Where the creep rests under the printed law."""

    def told(r: Results) -> str:
        e = float(np.mean(last(r, loop, "ctl.barrier.e", DRY)))
        return (
            f"it rests {abs(e) * 1e3:.3g} mm/s {'below' if e < 0 else 'above'} the creep asked for"
        )

    return told
