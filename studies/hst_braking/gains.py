"""What ``slipctl certify hst_braking`` asks: gains of Zhang 2021, bounds from the model."""

from __future__ import annotations

from slipctl import Block, Gains
from slipctl.analysis.bounds import Bound, largest_slope
from slipctl.certify.bounds import filters
from slipctl.models.zhang_2021.hst_braking import RAILS, burckhardt, peak_height, peak_slip

SPEED = 36.0
"""Train speed at the end of the study's 6 s in m/s, where w is largest."""

STEP = 0.01
"""Step of the reference per tick, h_1 of Table 3."""

G, F_Z = 9.81, 13800 * 9.81 / 4


def slope_in_the_funnel(loop: Block) -> Bound:
    """Largest |mu'| of dry rail in the steady funnel about the best slip; proven."""
    best = float(peak_slip(**RAILS["dry"]))
    half = number(loop, "ctl.law.eta_inf") * number(loop, "ctl.law.delta_u")
    return largest_slope(burckhardt, "mu", "lam", {"lam": (best - half, best + half)})


def number(loop: Block, name: str) -> float:
    """Parameter of a loop."""
    return float(loop.values_by_place()[name])


def disturbance(loop: Block) -> float:
    """W in 1/s: the filter's lag times the rate of the force while the slip moves in the funnel.

    |F_a - F_a^| <= tau F_z max|mu'| max|lam'|, and |lam'| <= K1 eta_inf d there, what the law asks
    for at the edge of its linear part.
    """
    r, I_w = number(loop["ctl"], "r"), number(loop["ctl"], "J")
    tau = filters.time_constant(number(loop, "ctl.filter.gamma"), loop.period)
    rate = number(loop, "ctl.law.K1") * number(loop, "ctl.law.eta_inf") * number(
        loop, "ctl.law.delta_u")  # fmt: skip
    return r**2 / (I_w * SPEED) * tau * F_Z * slope_in_the_funnel(loop).value * rate


def change_of_rail(v: float, r: float = 0.43, I_w: float = 60.35) -> float:
    """Disturbance w in 1/s of a change from dry to snow at dry rail's best slip, at a speed.

    w = r^2 F_z |mu_dry - mu_snow|/(I_w v), while the filter still has the old force.
    """
    slip = float(peak_slip(**RAILS["dry"]))
    drop = burckhardt(lam=slip, **RAILS["dry"])["mu"] - burckhardt(lam=slip, **RAILS["snow"])["mu"]
    return r**2 * F_Z * abs(drop) / (I_w * v)


def _funnel(loop: Block) -> dict[str, float]:
    law = {k: number(loop["ctl.law"], k)
           for k in ("K1", "T", "eta_inf", "delta_l", "delta_u", "r")}  # fmt: skip
    return {**law, "I_w": number(loop["ctl.law"], "J"), "W": disturbance(loop), "v": SPEED}


def jump_of_rail() -> float:
    """Error in N of an estimate that still has the peak force of dry rail, on snow."""
    return F_Z * float(peak_height(**RAILS["dry"]) - peak_height(**RAILS["snow"]))


def _changing(loop: Block) -> dict[str, float]:
    return {**_funnel(loop), "F_error": jump_of_rail()}


def _behind_a_lag(loop: Block) -> dict[str, float]:
    return {**_changing(loop), "lag": number(loop, "plant.brake.tau")}


def _printed(loop: Block) -> dict[str, float]:
    slip = float(peak_slip(**RAILS["dry"]))
    a = G * float(peak_height(**RAILS["dry"]))
    return {**_changing(loop), "step": STEP, "a": a, "slip": slip}


def _filter(loop: Block) -> dict[str, float]:
    printed = "per" in loop["ctl.filter"].choices and loop["ctl.filter"].choices["per"] == "second"
    values = {k: number(loop["ctl.filter"], k) for k in ("gamma", "r", "J")}
    return {
        "gamma": values["gamma"], "R": number(loop, "ctl.filter.noise_omega"),
        "H": values["r"] / values["J"], "dt": 0.0 if printed else loop.period,
        "P": number(loop, "ctl.filter.prior_F_a"), "share": 0.02, "time": 0.05,
    }  # fmt: skip


def _linear(loop: Block) -> dict[str, float]:
    return {"K": number(loop, "ctl.law.K1"), "T": loop.period}


WHY = (
    "the lag of the filter times the steepest adhesion in the steady funnel, by interval arithmetic"
    f" on the exact Jacobian, at {SPEED:g} m/s"
)
CHANGE = f"{WHY}; a change from dry to snow, for as long as the filter has not seen it"
PRINTED = f"{CHANGE}; reference steps of {STEP:g}, the vehicle's own motion left out"

GAINS = (
    Gains("eppfc", "eppfc", "prescribed_performance", _changing, CHANGE, "",
          "Zhang 2021, Table 3"),
    Gains("eppfc_lag50", "eppfc@lag50", "prescribed_performance", _behind_a_lag,
          f"{CHANGE}; the brake's lag", "", "Zhang 2021, Table 3"),
    Gains("eppfc_steady", "eppfc", "prescribed_performance", _funnel,
          f"{WHY}; no change of the rail, no lag", "", "Zhang 2021, Table 3"),
    Gains("eppfc_printed", "eppfc_printed", "prescribed_performance", _printed, PRINTED, "",
          "Zhang 2021, Table 3"),
    Gains("filter", "eppfc", "filter", _filter, "2 % of the error after 50 ms", "lemma_2",
          "gamma per sample"),
    Gains("filter_printed", "filter_printed", "filter", _filter, "2 % of the error after 50 ms",
          "lemma_2", "Zhang 2021, Table 3: gamma per second"),
    Gains("linear", "eppfc", "lagged_loop", _linear, "near no error the law is K1 e", "",
          "Zhang 2021, Table 3"),
)  # fmt: skip
