"""What a vehicle has by its cars: loads of the axles, the load that moves, pads, torsion."""

from __future__ import annotations

from typing import Any

import numpy as np

from slipctl import Block, Input, Output, Param, State, make_block, replicate
from slipctl.models.brake_pads import MATERIALS, pad
from slipctl.models.common_form import T_S
from slipctl.models.vehicle.parts import Vehicle
from slipctl.models.wheel_rail.torsion import Wheelset

ADDED = "of the vehicle"


def load_transfer(vehicle: Vehicle) -> Block:
    """Load that moves onto each axle when the vehicle brakes, by the acceleration of the last tick.

    Quasi-static: body and bogies pitch at once.
    """
    n, moved = vehicle.axles, np.array(vehicle.moved)

    def body(x: Any, u: Any, p: Any) -> Any:
        return {"a_last": u["a"]}, {"dN": -p["by_a"] * x["a_last"]}

    last = State("m/s^2", 0.0, "acceleration of the last tick", positive="traction")
    return make_block(
        "transfer", "step", body, period=T_S,
        states=[last.named("a_last")],
        inputs=[Input("m/s^2", "acceleration of the train", positive="traction").named("a")],
        params=[Param("kg", moved, "load that an axle gains by deceleration", ADDED,
                      shape=(n,)).named("by_a")],
        outputs=[Output("N", "load that moves onto an axle", shape=(n,)).named("dN")],
        doc="Load that moves onto each axle: dN_i = -k_i a.",
    )  # fmt: skip


def masses_of_axles(vehicle: Vehicle) -> dict[str, Any]:
    """What each axle carries, and its inertia, as ``rolling`` takes them."""
    carried, inertias = vehicle.carried, vehicle.inertias
    found: dict[str, Any] = {"J": inertias[0] if len(set(inertias)) == 1 else np.array(inertias)}
    if len(set(carried)) == 1:
        return found | {"m_axle": carried[0]}
    return found | {"share": np.array(carried) / vehicle.total}


def wheelset_that_twists(vehicle: Vehicle) -> Wheelset | None:
    """A driven wheelset with its shafts: rotor, wheel, wheel; None where wheelsets are rigid."""
    part = vehicle.torsion
    if part is None:
        return None
    first = vehicle.worked[0]
    rotor = part.rotor or 0.0
    wheel = (vehicle.inertias[first] - rotor) / 2
    load, radius = vehicle.carried[first] * vehicle.gravity / 2, vehicle.radii[first]
    if part.rotor is None or part.shaft is None:
        return Wheelset((wheel, wheel), (part.stiffness,), (0, 1), load, radius, part.damping)
    inertias, shafts = (rotor, wheel, wheel), (part.shaft, part.stiffness)
    return Wheelset(inertias, shafts, (1, 2), load, radius, part.damping)


def pads_of_axles(vehicle: Vehicle) -> Block | None:
    """Pads of all axles, each with its own numbers; None where the vehicle has none.

    An axle without pads has a constant friction.
    """
    given = vehicle.each_pads
    if not any(given):
        return None
    rows: list[dict[str, float]] = []
    for one, radius in zip(given, vehicle.radii, strict=True):
        row = dict.fromkeys(("mu_0", "by_V", "by_N", "by_N2", "iron"), 0.0) | {"r_w": radius}
        if one is None:
            rows.append(row | {"mu_0": 1.0, "mu_n": 1.0, "blocks": 1, "r_f": radius, "spread": 1.0,
                               "fade": 0.0, "theta_f": 0.0, "C": 1e9, "k": 0.0})  # fmt: skip
            continue
        rows.append(row | MATERIALS[one.material] | {
            "mu_n": one.friction, "blocks": one.blocks, "r_f": one.radius or radius,
            "spread": one.spread, "fade": one.fade, "theta_f": one.fade_from,
            "C": one.heat_capacity or 1e9, "k": one.cooling,
        })  # fmt: skip
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    return replicate(pad, vehicle.axles, distinct=list(columns)).with_params(**columns)
