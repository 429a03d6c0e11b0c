"""What ``slipctl certify freight_traction`` asks: gains of Cheng 2022, bounds from the model."""

from __future__ import annotations

from slipctl import Block, Gains
from slipctl.analysis.bounds import Bound, largest_slope
from slipctl.models.cheng_2022.freight_traction import (
    SURFACES,
    adhesion,
    peak_creep,
    peak_curvature,
    peak_height,
)

DRY = SURFACES["dry"]
ERROR = 1e-3
"""Share by which the adhesion estimate may be wrong."""


def steepest() -> Bound:
    """Largest |mu'| of dry rail over creeps of 0 to 3 m/s, in s/m; proven."""
    return largest_slope(adhesion, "mu", "v_s", {"v_s": (1e-9, 3.0)}, **DRY)


def number(loop: Block, name: str) -> float:
    """Parameter of a loop, derived ones computed."""
    return float(loop.values_by_place()[name])


def disturbance(loop: Block) -> float:
    """W in m/s^2: (r^2/(J R_g^2) + n_d/M) ERROR max F_a."""
    J, r, R_g, W, n_d, M, g = (
        number(loop, f"ctl.disturbance.{k}") for k in ("J", "r", "R_g", "m_axle", "n_d", "m", "g")
    )
    force = ERROR * float(peak_height(**DRY)) * W * g
    return (r**2 / (J * R_g**2) + n_d / M) * force


def _barrier(loop: Block) -> dict[str, float]:
    k_s = number(loop, "ctl.barrier.k_s")
    return {
        "k": number(loop, "ctl.barrier.k"), "k_s": k_s,
        "k_a": k_s + number(loop, "ctl.barrier.v_sopt"), "W": disturbance(loop), "T": loop.period,
    }  # fmt: skip


def _sliding(loop: Block) -> dict[str, float]:
    seek = {k: number(loop, f"ctl.seek.{k}") for k in ("k", "rho", "beta", "T")}
    return {**seek, "slope": steepest().reached, "curvature": float(peak_curvature(**DRY))}


def _dither(loop: Block) -> dict[str, float]:
    seek = {k: number(loop, f"ctl.seek.{k}") for k in ("k", "w", "w_h", "w_l", "a", "T")}
    a, b, c = (DRY[k] for k in "abc")
    from math import exp

    v = float(peak_creep(a, b))
    third = c * (-(a**3) * exp(-a * v) + b**3 * exp(-b * v))
    return {**seek, "curvature": float(peak_curvature(**DRY)), "third": third}


def _observer(loop: Block) -> dict[str, float]:
    return {
        "L1": number(loop, "ctl.observer.L_omega_m"), "L2": number(loop, "ctl.observer.L_T_L"),
        "J": number(loop, "ctl.observer.J"), "slowest": 40.0,
    }  # fmt: skip


def _printed_observer(loop: Block) -> dict[str, float]:
    return {**_observer(loop), "L1": -40.0, "L2": -40.0}


WHY = f"adhesion known to {ERROR:.1%}"
SLOPE = "steepest adhesion over 0 to 3 m/s from the exact Jacobian"

GAINS = (
    Gains("barrier", "smes_corrected", "barrier_lyapunov", _barrier, WHY, "", "Cheng 2022, 4"),
    Gains("seek_printed", "smes_printed", "sliding_seek", _sliding, SLOPE, "sliding",
          "Cheng 2022, Table 3"),
    Gains("seek", "improved_corrected", "sliding_seek", _sliding, SLOPE, "sliding", "chosen"),
    Gains("dither", "esa_robust", "perturbation_seek", _dither, "curvature of the peak", "",
          "corners of Cheng 2022, the rest chosen"),
    Gains("observer", "smes_corrected", "load_observer", _observer, "40 1/s wanted", "", "chosen"),
    Gains("observer_printed", "smes_corrected", "load_observer", _printed_observer,
          "40 1/s wanted", "", "Cheng 2022, 4"),
)  # fmt: skip
