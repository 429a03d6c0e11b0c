"""Numbers that the parts of a vehicle of ``all_rails`` have in common, and its law with it."""

from __future__ import annotations

from typing import Any

from slipctl import Block
from slipctl.models.cheng_2022 import freight_traction as freight
from slipctl.models.cheng_2022.freight_traction import TRAIN
from slipctl.models.huang_2020 import subway_braking as subway
from slipctl.models.shared_names import GRADIENT, SHARED
from slipctl.models.zhang_2021 import hst_braking as hst
from slipctl.models.zhang_2021.hst_braking_reference import PRIOR

SUBWAY_SHARES = SHARED | GRADIENT | {"m_axle = m": "force.m_axle"} | subway.MEASURED_STARTS
HST_SHARES = (
    SHARED
    | GRADIENT
    | {
        "m": ["plant.m", "meter.m"],
        "n": "*.n",
        "m_wheel = m / n": "fall.m",
        "theta": "plant.brake.theta",
        "P_max": "plant.brake.P_max",
        "v_0": ["plant.wheel.v_0", "fusion.v_0"],
        **hst.STARTS,
        "v_start": [*hst.STARTS["v_start"], "fusion.v_h"],
        **hst.BRAKE_STARTS,
        **PRIOR,
    }
)
FREIGHT_SHARES = SHARED | TRAIN | GRADIENT | {
    "m": ["plant.m", "resistance.m", "mirrored.m"],
    "J": ["plant.J", "observer.J"],
    "m_wheel = m / n_d": "fall.m",
    "J_wheel = J * R_g**2": "fall.J",
    **{n: [f"plant.res.{n}", f"resistance.{n}"] for n in ("a1", "a2", "a3", "v_0")},
    **freight.STARTS,
    "omega_m_start": [*freight.STARTS["omega_m_start"], "observer.omega_m"],
}  # fmt: skip
"""Numbers that the parts of a vehicle have in common; fall has those of one wheel."""


def shares(world: Block, control_law: Block, slowed: bool = False) -> dict[str, Any]:
    """Numbers that a vehicle and its law have in common; a law has those of one wheel.

    A law that is ``slowed`` has a tick of its own.
    """
    has = world.params
    found: dict[str, Any] = {n: f"*.{n}" for n in ("r", "g", "tau")}
    if slowed:
        found |= {"T": "world.T"} if "T" in has else {}
    else:
        found["T"] = ["*.T", "*.T_s"]
    found |= {
        n: f"world.{n}"
        for n in ("m", "J", "n", "n_d", "R_g", "theta", "P_max", "slope")
        if n in has
    }
    found |= {n: f"*.{n}" for n in ("a0_at", "a1_at", "a2_at") if n in has}
    for n in "mJ":  # of one wheel
        name = f"{n}_wheel" if f"{n}_wheel" in has else n
        found[name] = [f"world.{name}", *(["law." + n] if n in control_law.params else [])]
    T_max = ["limits.T_max", *(["law.T_max"] if "T_max" in control_law.params else [])]
    if "theta" in has:
        found["T_max = -theta * P_max"] = T_max
    elif "R_g" in has:
        found |= {"T_max": "world.T_max", "T_wheel = T_max * R_g": T_max}
    else:
        found["T_max"] = ["world.T_max", *T_max]
    if "m_axle" in has:
        found["m_axle"] = ["world.m_axle", "*.m_axle"]
    else:
        found["m_axle = m / n"] = "*.m_axle"
    return found | _start(world, control_law)


def _start(world: Block, control_law: Block) -> dict[str, Any]:
    """Speeds at the start, and the slip for laws that hold one of the last tick."""
    law, has = control_law.params, world.params
    wheel = "omega_m_start" if "R_g" in has else "omega_start"
    found: dict[str, Any] = {"v_start": "world.v_start", wheel: f"world.{wheel}"}
    # a driven wheel is seen in the mirror
    slip = "v_start - r * omega_start"
    if "R_g" in has:
        slip = "r * omega_m_start / R_g - v_start"
    if "v_s_start" in has:
        found["v_s_start"] = ["world.v_s_start", "*.v_s_start"]
    elif "offset.v_s_start" in law:
        found[f"v_s_start = {slip}"] = "*.v_s_start"
    if "lam_start" in law:
        found["v_min"] = "law.ratio.v_min"
        found[f"lam_start = ({slip}) / fmax(fabs(v_start), v_min)"] = "law.lam_start"
    return found
