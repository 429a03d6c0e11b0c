"""Slip reference of a train from what its file believes of the rail: curves, strength, caution."""

from __future__ import annotations

import numpy as np

from slipctl import Block
from slipctl.errors import Faults, nearest
from slipctl.models.vehicle.adhesion import layer_law, numbers_of, rail_law
from slipctl.models.vehicle.air.pneumatics import ATMOSPHERE
from slipctl.models.vehicle.parts import Air, TrainSlip, Trip
from slipctl.models.vehicle.plant import on_train
from slipctl.models.vehicle.slip.fill_ahead import fill_ahead
from slipctl.models.vehicle.slip.rail_seen import rail_seen
from slipctl.models.vehicle.slip.train_plan import train_plan
from slipctl.models.vehicle.slip.train_slip import train_slip
from slipctl.models.wheel_rail.sliding_train import SlidingTrain
from slipctl.models.wheel_rail.train_caution import cautious_share


def believed_curves(trip: Trip, part: TrainSlip) -> tuple[Block, Block]:
    """Curves under the layer and without it, as the controllers believe them.

    Raises:
        Faults: no such condition, unknown parameters.
    """
    layer, rail = trip.rail.contamination, rail_law(trip)
    assert layer is not None
    name = part.condition or trip.rail.sections[0].condition
    if name not in rail.conditions:
        raise Faults([
            f"condition: no section of the rail has the condition {name!r}"
            f"{nearest(name, rail.conditions)}"
        ])  # fmt: skip
    fouled, clean = layer_law(trip, layer), on_train(rail.with_params(**rail.conditions[name]))
    fouled = fouled.with_params(**numbers_of(fouled, part.layer, "layer"))
    clean = clean.with_params(**numbers_of(clean, part.clean, "clean"))
    return fouled, clean.with_conditions()


def believed_train(trip: Trip, part: TrainSlip) -> SlidingTrain:
    """Train and rail as the controllers believe them: the axles that are worked, alike."""
    layer, vehicle = trip.rail.contamination, trip.vehicle
    fouled, clean = believed_curves(trip, part)
    assert layer is not None
    at = [vehicle.behind[k] for k in vehicle.worked]
    a, _, c = vehicle.resistance.of(vehicle.total)
    load = vehicle.total * vehicle.gravity / vehicle.axles / 2
    return SlidingTrain(
        fouled, clean, tuple(x - at[0] for x in at), load=load,
        tau=layer.tau if part.tau is None else part.tau, layers=layer.layers, slip=part.slip,
        most=trip.actuator.torque / trip.one_radius / (2 * load),
        resistance=(a / vehicle.total, c / vehicle.total), gravity=vehicle.gravity,
    )  # fmt: skip


def counted_share(train: SlidingTrain, trip: Trip, part: TrainSlip) -> float:
    """Share of the believed strength that a train counts on."""
    if part.caution is not None:
        return part.caution
    return cautious_share(
        train, max(trip.vehicle.speed, 5.0), part.within, plan=part.plan, learn=part.learn
    )  # fmt: skip


def train_reference(trip: Trip, part: TrainSlip) -> Block:
    """Slip reference of the axles of a trip; ``behind`` is each axle's own.

    Raises:
        Faults: as :func:`believed_curves`.
    """
    train = believed_train(trip, part)
    block = train_slip(train.fouled, train.clean, learn=part.learn, plan=part.plan)
    block = block.with_params(slip=part.slip, least=part.least)
    if part.plan:
        return block
    return block.with_params(
        strength=train.tau, load=train.load, caution=counted_share(train, trip, part)
    )  # fmt: skip


def plan_of_axles(trip: Trip, part: TrainSlip) -> Block:
    """Plan over the axles of a trip."""
    train = believed_train(trip, part)
    block = train_plan(train.fouled, train.clean, train.axles, learn=part.learn)
    return block.with_params(
        strength=train.tau, load=train.load, slip=part.slip, most=train.most,
        caution=counted_share(train, trip, part),
    )  # fmt: skip


def parts_of_train(
    trip: Trip, part: TrainSlip
) -> tuple[dict[str, Block], dict[str, str]]:  # fmt: skip
    """Parts that a train has once, for the slip references of all axles, and their wires."""
    parts: dict[str, Block] = {}
    wires: dict[str, str] = {}
    if part.ahead or part.learn:
        parts["rail"] = field_of_axles(trip, part)
        wires |= {"rail.v": "trust.v", "rail.mu": "sample.mu", "rail.v_s": "sample.v_s"}
    if part.plan:
        parts["plan"] = plan_of_axles(trip, part)
        wires["plan.v"] = "trust.v"
    if part.learn:
        wires["plan.factor" if part.plan else "reference.factor"] = "rail.factor"
    return parts, wires


def filling_rate(trip: Trip) -> float:
    """Largest rate in N m/s at which the torque of an axle rises."""
    act = trip.actuator
    if isinstance(act, Air):  # the flow is choked
        return float(act.torque / act.pressure * act.rates[0] * (act.supply + ATMOSPHERE))
    return float(act.torque / max(act.usual_lag, 0.01))


def field_of_axles(trip: Trip, part: TrainSlip) -> Block:
    """What the axles of a trip see of the rail."""
    train = believed_train(trip, part)
    return rail_seen(train.fouled, train.clean, train.behind).with_params(
        tau_0=max(train.tau, 1e-9), load=train.load, most=part.within
    )


def parts_of_train_slip(
    trip: Trip, part: TrainSlip
) -> tuple[dict[str, Block], dict[str, str], str]:  # fmt: skip
    """Parts of one axle that give its slip reference, their wires, and where the reference is."""
    parts = {"reference": train_reference(trip, part)}
    wires = {"reference.v": "trust.v", "reference.mu": "sample.mu", "reference.v_s": "sample.v_s"}
    if part.plan:
        wires |= {"reference.value": "plan.value", "reference.rate": "plan.rate"}
    if not part.ahead:
        return parts, wires, "reference.v_best"
    parts["fill"] = fill_ahead.with_params(
        slip=part.slip, rate=filling_rate(trip), dead=trip.actuator.dead_time
    )
    wires |= {"fill.v": "trust.v", "fill.v_s": "sample.v_s", "fill.own": "reference.v_best",
              "fill.ahead": "rail.ahead"}  # fmt: skip
    return parts, wires, "fill.v_best"


def axles_behind(trip: Trip) -> np.ndarray:
    """How many axles with an actuator follow each of them."""
    return np.arange(len(trip.vehicle.worked) - 1.0, -1.0, -1.0)
