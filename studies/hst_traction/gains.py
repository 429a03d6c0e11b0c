"""What ``slipctl certify hst_traction`` asks: gains of Wang 2025, bounds from the model."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from slipctl import Block, Gains
from slipctl.analysis.bounds import Bound
from slipctl.models.wang_2025 import hst_traction_control as control
from slipctl.models.wang_2025.hst_traction import resistance
from slipctl.models.wang_2025.hst_traction_adhesion import SLOPE
from slipctl.models.wheel_rail.contact import peak
from slipctl.studies.hst_traction.experiments import DRY, slopes
from slipctl.studies.hst_traction.loops import MODELS

SPEED = 40.0
"""Train speed at the jump to ice in m/s."""

RESERVE = 0.9
"""Share of the ice's own peak that the limit uses."""


def number(loop: Block, name: str) -> float:
    """Parameter of a loop."""
    return float(loop.values_by_place()[name])


def _observer(loop: Block) -> dict[str, float]:
    gains = {f"K{i}": number(loop, f"ctl.observer.K_{i}") for i in (1, 2, 3)}
    return {**gains, "L": SLOPE}


@cache
def slope_met(form: str) -> Bound:
    """|delta'|/M in m/s^3 that the law meets on dry rail: its 99.9 % quantile over DRY."""
    start, end = DRY
    t, rates = slopes(MODELS, control.higher_order(form), start - 10.0, end + 1.0)
    rates = rates[(t >= start) & (t < end)]  # the ticks of the study's table, the last one too
    value = float(np.quantile(rates, 0.999))
    return Bound(value, float(rates.max()), "99.9 % of the ticks of a run, no proof")


def _higher(form: str) -> Callable[[Block], dict[str, float]]:
    def numbers(loop: Block) -> dict[str, float]:
        law = {k: number(loop, f"ctl.strategy.law.{k}") for k in ("alpha", "beta")}
        k4 = number(loop, "ctl.strategy.law.k_4")
        return {**law, "k4": k4, "eta": slope_met(form).value}

    return numbers


def _saturated(loop: Block) -> dict[str, float]:
    """Force to hold the speed on ice, and what ten axles of ice carry."""
    M, W, g = (number(loop, f"ctl.{n}") for n in ("m", "m_axle", "g"))
    need = float(resistance(v=SPEED)["F_d"])
    most = RESERVE * peak(SPEED, "ice").value * 10 * W * g
    return {
        "k1": number(loop, "ctl.strategy.law.k_1"), "k3": number(loop, "ctl.strategy.law.k_3"),
        "M": M, "F_min": -32 / 10 * most, "F_max": most, "F_low": 0.0, "F_high": need,
    }  # fmt: skip


WHY = (
    "what a run on dry rail meets in 99.9 % of its ticks; the law makes it through its motors' lag"
)

GAINS = (
    Gains("observer", "hosm_limited", "adhesion_observer", _observer,
          "what the observer is laid out for", "theorem_1", "chosen"),
    Gains("hosm", "hosm_limited", "higher_order", _higher("optimum"), WHY,
          "printed_49", "chosen"),
    Gains("hosm_printed", "hosm_limited_printed@stress", "higher_order", _higher("printed"), WHY,
          "printed_49", "Wang 2025, Table 1"),
    Gains("compensation", "hosm_limited", "saturation_compensation", _saturated,
          f"speed held at {SPEED:g} m/s on ice, ten axles", "", "Wang 2025, Table 1"),
)  # fmt: skip
