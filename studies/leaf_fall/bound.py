"""The least distance that physics allows: slips held exactly, of every axle at each place.

No controller of the study can brake by more than the demand, nor before the cylinders are full. So
the bound begins where they are full, at the speed that the train has there. A brake stops its
wheels too, so that much less of the demand reaches the rail. No cylinder is vented or filled, and
no wheel takes time to slow down or to run up. One that runs up again behind the leaves pushes the
train by what it has lost before: less than 2 m, which the bound does not have.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from slipctl.models.vehicle import Trip
from slipctl.models.vehicle.slip.train_reference import filling_rate
from slipctl.models.wheel_rail.falling_creep import falling_creep
from slipctl.models.wheel_rail.sliding_train import SlidingTrain, Slips, Stop, stop
from slipctl.models.wheel_rail.train_optimum import LocalRule, Rule, best_stop
from slipctl.studies.leaf_fall.trains import AXLE, FORCE, HALF, LADDER, LIMIT, SPEED

FULL = 0.999
"""Share of the demanded torque from which on the cylinders count as full."""


@dataclass(frozen=True)
class Begin:
    """Where the cylinders are full: place of the first axle in m, and speed in m/s."""

    place: float
    speed: float


def full_brake(log: Any) -> Begin:
    """Where the cylinders are full, in the log of a run."""
    torque, demand = log["plant.T"].values.min(axis=1), log["demand.T_demand"].values
    k = int(np.argmax(torque >= FULL * demand))
    return Begin(float(log["plant.train.x"].values[k]), float(log["plant.train.v"].values[k]))


def sliding_train(trip: Trip, begin: Begin, slip: float = LIMIT) -> SlidingTrain:
    """The train of a trip as one whose slips are told, from where its brakes are full.

    Args:
        trip: the trip. begin: where that is. slip: largest slip ratio.
    """
    layer, vehicle = trip.rail.contamination, trip.vehicle
    assert layer is not None  # every trip of the study has leaves
    stretches = tuple((p.begin - begin.place, p.end - begin.place) for p in layer.places) or None
    numbers = falling_creep.conditions[layer.condition] | layer.numbers
    leaves = falling_creep.with_params(**numbers)
    c0, _, c2 = vehicle.resistance.of(vehicle.total)
    wheels = vehicle.wheel_inertia / trip.one_radius**2 / AXLE
    return SlidingTrain(
        leaves, falling_creep, vehicle.behind, load=AXLE * vehicle.gravity / 2, tau=layer.tau,
        layers=layer.layers, stretches=stretches, slip=slip,
        most=FORCE / (AXLE * vehicle.gravity) / (1 + wheels),
        resistance=(c0 / vehicle.total, c2 / vehicle.total), gravity=vehicle.gravity,
    )  # fmt: skip


def on_leaves(train: SlidingTrain, slips: Slips) -> Slips:
    """Rule that holds on leaves alone; where the rail is clean each axle is at its peak."""
    peak = Rule(train, greedy=True)

    def rule(x: float, v: float, W: np.ndarray, fouled: np.ndarray) -> np.ndarray:
        return np.where(fouled, slips(x, v, W, fouled), peak(x, v, W, fouled))

    return rule


def common(train: SlidingTrain, slip: float | tuple[float, ...]) -> Slips:
    """Rule of one slip for all axles or of one for each."""
    given = np.asarray(slip)
    return on_leaves(train, lambda x, v, W, fouled: given)


RULES: dict[str, Callable[[SlidingTrain], Slips]] = {
    "best slip of each axle": lambda train: Rule(train, greedy=True),
    "one slip of 15 %": lambda train: common(train, 0.15),
    "one slip of 30 %": lambda train: common(train, LIMIT),
    "first half at the limit": lambda train: common(train, HALF),
    "ladder": lambda train: common(train, LADDER),
    "law of each axle": lambda train: on_leaves(train, LocalRule(train, fastest=SPEED + 1)),
    "best of the train": lambda train: Rule(train),
}
"""Choices of slips, each a rule by place, speed and what an axle finds."""


def filled_behind(trip: Trip, train: SlidingTrain, slips: Slips) -> Slips:
    """Rule whose brakes fill no sooner than where the leaves end, and no faster than they can.

    There the force of an axle grows from what it had. The flow is taken as choked all the time, so
    a cylinder is never faster.
    """
    wheels = trip.vehicle.wheel_inertia / trip.one_radius**2 / AXLE
    rate = filling_rate(trip) / trip.one_radius / (2 * train.load) / (1 + wheels)
    e = np.geomspace(1e-6, 0.02, 300)
    before: dict[str, Any] = {"x": 0.0, "f": np.full(train.axles, train.most)}

    def rule(x: float, v: float, W: np.ndarray, fouled: np.ndarray) -> np.ndarray:
        wanted = slips(x, v, W, fouled)
        low, high = train.heights(wanted, v)
        share = np.where(fouled, train.recovered(W), 1.0)
        f = np.minimum((1 - share) * low + share * high, train.most)
        reach = before["f"] + rate * (x - before["x"]) / v
        short = ~fouled & (f > reach)
        before.update(x=x, f=np.where(short, reach, f))
        return np.where(short, np.interp(reach, train.heights(e, v)[1], e), wanted)

    return rule


ENDS = ("best slip of each axle", "best of the train")
"""Rules between which a choice lies that is any good."""


def stops(
    trip: Trip, begin: Begin, cell: float = 0.25, rules: Sequence[str] = tuple(RULES)
) -> dict[str, Stop]:  # fmt: skip
    """Stop of a train by some rules, from where its brakes are full."""
    train = sliding_train(trip, begin)
    return {n: stop(train, RULES[n](train), begin.speed, cell) for n in rules}


def best_common_slip(trip: Trip, begin: Begin, cell: float = 2.0) -> float:
    """The one slip for all axles with which the train stops shortest."""
    train = sliding_train(trip, begin)
    found = minimize_scalar(
        lambda slip: stop(train, common(train, float(slip)), begin.speed, cell).distance,
        bounds=(0.01, LIMIT), method="bounded", options={"xatol": 0.005},
    )  # fmt: skip
    return float(found.x)


def least_distance(trip: Trip, begin: Begin, mesh: float = 2.0) -> float:
    """Least stopping distance in m over the slips of all axles at all places, from the start on."""
    return begin.place + best_stop(sliding_train(trip, begin), begin.speed, mesh).distance
