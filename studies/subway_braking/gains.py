"""What ``slipctl certify subway_braking`` asks: gains of Huang 2020, bounds from the model."""

from __future__ import annotations

from slipctl import Block, Gains, argmax
from slipctl.analysis.bounds import Bound, largest_slope
from slipctl.models.huang_2020.subway_braking import double_exponential
from slipctl.models.huang_2020.subway_braking_control import super_twisting

BAND = 5e-3
"""Wanted half-swing of the slip speed in m/s; the study's second settling band."""

ERROR = 0.1
"""Share by which the adhesion estimate may be wrong."""

TUBE = 0.05
"""Distance from the best slip within which the slip is held, m/s; the study's settling band."""


_SLOPES: dict[str, Bound] = {}
"""What was found, by equations and rails: tuning asks for the same law again and again."""


def slope_in_the_tube(law: Block = double_exponential) -> Bound:
    """Largest |mu'| in the tube about the peak, on the worst of the law's rails, s/m; proven."""
    own = {n: float(v) for n, v in law.param_values().items()}
    every = [own | dict(at) for at in (law.conditions or {"": {}}).values()]
    rails = [at for k, at in enumerate(every) if at not in every[:k]]
    key = f"{law.f.serialize()} {rails}"
    if key not in _SLOPES:
        peaks = [argmax(law, "v_s", lo=0.01, hi=10, at=at).location for at in rails]
        _SLOPES[key] = max(
            (largest_slope(law, "mu", "v_s", {"v_s": (best - TUBE, best + TUBE)}, **at)
             for best, at in zip(peaks, rails, strict=True)),
            key=lambda bound: bound.value,
        )  # fmt: skip
    return _SLOPES[key]


def disturbance_slope(loop: Block, k1: float | None = None) -> float:
    """L in m/s^3: d = -(1/m + r^2/J) (F - F^), an estimate wrong by ERROR, within the tube.

    |d'| <= ERROR (1/m + r^2/J) m g max|mu'| max|s'|, and |s'| <= 2 k1 sqrt(TUBE) there: x2 is no
    larger than what k1 balances at the edge of the tube. Without a k1 it is that of the law in use,
    so that all gains meet the same disturbance.
    """
    m, J, r, g = (_number(loop["ctl"], n) for n in ("m", "J", "r", "g"))
    own = float(super_twisting().params["k1"].value) if k1 is None else k1
    fastest = 2 * own * TUBE**0.5
    slope = slope_in_the_tube(loop["plant.adh"]).value
    return ERROR * (1 / m + r * r / J) * m * g * slope * fastest


def _number(loop: Block, name: str) -> float:
    return float(loop.values_by_place()[name])


def _twisting(loop: Block, k1: float | None = None) -> dict[str, float]:
    return {
        "k1": _number(loop, "ctl.law.k1"), "k2": _number(loop, "ctl.law.k2"),
        "L": disturbance_slope(loop, k1), "T": loop.period, "band": BAND,
    }  # fmt: skip


def _in_use(loop: Block) -> dict[str, float]:
    """The law in use: gains that make the slip faster meet a faster disturbance."""
    return _twisting(loop, _number(loop, "ctl.law.k1"))


def _reaching(loop: Block) -> dict[str, float]:
    m, J, r, g = (_number(loop["ctl"], n) for n in ("m", "J", "r", "g"))
    peak = double_exponential(v_s=1.21, **double_exponential.conditions["dry"])["mu"]
    return {
        "g1": _number(loop, "ctl.law.g1"), "g2": _number(loop, "ctl.law.g2"), "T": loop.period,
        "D": ERROR * (1 / m + r * r / J) * m * g * peak, "band": BAND,
    }  # fmt: skip


WHY = (
    f"adhesion known to {ERROR:.0%}; |mu'| within {TUBE:g} m/s of the peak by interval arithmetic"
    " on the exact Jacobian"
)

GAINS = (
    Gains("sta", "sta", "super_twisting", _in_use, WHY, "printed_48", "chosen"),
    Gains("sta_printed", "sta_printed", "super_twisting", _twisting, WHY, "printed_48",
          "Huang 2020, section 5"),
    Gains("smc", "smc", "reaching_law", _reaching, f"adhesion known to {ERROR:.0%}, dry peak",
          "", "Huang 2020, section 5"),
)  # fmt: skip
