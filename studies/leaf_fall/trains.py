"""The train of the study, its leaves, and the controllers that act by its valves.

12 t an axle, 90 km/h, cars of 20 m, air brakes with two valves on each axle, a speed that is made
of wheels and an accelerometer. Rail and numbers are those of the reference cases of
a simulation made apart from slipctl; see ``docs/slide_protection.md``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from slipctl.models.vehicle import (
    Air,
    Constant,
    Contamination,
    DemandAlone,
    Exact,
    Predictive,
    ScheduledPI,
    Sensors,
    SlideProtection,
    SlipControl,
    SlipLaw,
    Stretch,
    Track,
    Trip,
    Vehicle,
)
from slipctl.models.vehicle.parts import (
    Accelerometer,
    Controller,
    Davis,
    Drawn,
    DrawnPatches,
    Fused,
    Searched,
    SlipRatio,
    TrainSlip,
)
from slipctl.models.vehicle.parts.rail import Patch

SPEED = 25.0
"""Speed at the start in m/s."""

AXLE = 12e3
"""Load of an axle in kg."""

FORCE = 12e3
"""Brake force of an axle at the rims in N, at the full pressure: what is demanded."""

RADIUS, INERTIA = 0.46, 473 * 0.46**2
"""Of the wheels in m, and of a wheelset in kg m^2."""

WEAK, MEDIUM = 3.4e-5, 1e-4
"""Strength of the cleaning in m/J; the weak one is the most that RSSB T1107 allows (15 % slip)."""

PATCH = (60.0, 360.0)
"""Where the leaves lie in m; the brakes are full before."""

LIMIT = 0.3
"""Slip ratio above which no law of the study shall go."""

RESERVOIR = 0.3
"""Air for eight axles in m^3."""

TUNED = {"slip": 2.05, "share": 0.19, "deceleration": 1.83}
"""Thresholds that ``slipctl tune`` found on other draws; see ``docs/slide_protection.md``."""

PI = ScheduledPI(reference=SlipRatio(slip=0.15))

STA = SlipLaw(kind="sta", gains={"k1": 4.0, "k2": 2.0}, reference=SlipRatio(slip=0.15))

RIVALS: Mapping[str, Controller] = {
    "none": DemandAlone(),
    "wsp": SlideProtection(),
    "wsp_tuned": SlideProtection(**TUNED),
    "pi": PI,
    "super_twisting": STA,
    "predictive": Predictive(horizon=20, reference=SlipRatio(slip=0.15)),
    "best_slip": replace(PI, reference=Searched()),
    "common_slip": replace(PI, reference=SlipRatio(slip=LIMIT)),
    "own_slip": replace(STA, reference=TrainSlip(tau=0.0)),
    "train": replace(STA, reference=TrainSlip()),
    "train_plan": replace(STA, reference=TrainSlip(plan=True)),
    "train_ahead": replace(STA, reference=TrainSlip(ahead=True, learn=True)),
}
"""Who acts by the valves. The laws hold 15 %, ``common_slip`` the limit, ``best_slip`` what it
finds to be best for each axle by itself. ``own_slip`` goes to each axle's own peak on the curves
that it knows; ``train`` is the same law, and counts what an axle cleans for those behind it.
``train_plan`` plans the slips of all axles together, by a program that is solved anew meanwhile.
``train_ahead`` also fills each brake before the leaves end, as leading axles have seen where, and
learns how strongly wheels clean: on better rail too it begins with the weak strength."""

HALF = (LIMIT,) * 4 + (0.03,) * 4
"""First half of the train at the limit, the others near their peak."""

LADDER = tuple(round(LIMIT + (0.03 - LIMIT) * k / 7, 3) for k in range(8))
"""Slips from the limit down to the peak, from axle to axle."""

DRAWN: Mapping[str, Controller] = {
    **RIVALS,
    "first_half": replace(STA, reference=SlipRatio(slip=HALF)),
    "ladder": replace(STA, reference=SlipRatio(slip=LADDER)),
}
"""Rivals on leaves by chance: also slips that are fixed by axle, for trains of eight axles."""


PATCHES = DrawnPatches(many=(1, 3), length=(50.0, 250.0), peak=(0.03, 0.08), begin=50.0, end=300.0)
"""Leaves by chance: how many places, how long, how slippery, and where each may begin in m."""


def places(axles: int) -> tuple[float, ...]:
    """Place of each axle behind the first one in m: cars of 20 m with two bogies, or two axles."""
    if axles == 2:
        return (0.0, 8.0)
    return tuple(20.0 * car + d for car in range(axles // 4) for d in (0.0, 2.0, 14.0, 16.0))


def trip(
    axles: int = 8, tau: float = WEAK, patches: Sequence[tuple[float, float]] = (PATCH,),
    true_speed: bool = False, rivals: Mapping[str, Controller] = RIVALS,
) -> Trip:  # fmt: skip
    """Trip of a train into leaves.

    Args:
        axles: how many, 2 or a multiple of 4.
        tau: strength of the cleaning in m/J.
        patches: from and to of the leaves in m; none: everywhere.
        true_speed: whether the controllers are told the true speed.
        rivals: its controllers.
    """
    mass = AXLE * axles
    sensors: dict[str, Any] = {"wheel_speed": Exact()}
    if not true_speed:
        sensors["vehicle_speed"] = Fused(spread=0.2)
        sensors["accelerometer"] = Accelerometer(bias=0.05, deviation=0.02)
    return Trip(
        title=f"{axles} axles, leaves",
        duration=120.0, end="standstill",
        vehicle=Vehicle(
            mass=mass, axles=axles, places=places(axles), inertia=INERTIA, radius=RADIUS,
            speed=SPEED, resistance=Davis(a=0.012 * mass, c=2e-5 * mass),
        ),
        actuator=Air(torque=FORCE * RADIUS, dead_time=0.06, fill_rate=0.44, vent_rate=1.75,
                     reservoir=RESERVOIR * axles / 8, reserve=8e5),
        rail=Track(
            law="falling_creep", sections=(Stretch(place=0.0, condition="clean"),),
            contamination=Contamination(
                condition="leaves", tau=tau, places=tuple(Patch(begin=a, end=b) for a, b in patches)
            ),
        ),
        demand=Constant(force=FORCE * axles),
        sensors=Sensors(**sensors),
        control=SlipControl(period=0.01, let_go=None if true_speed else 1.0, spread=False),
        controllers=dict(rivals),
        ensemble=Drawn(seeds=True, patches=PATCHES),
    )  # fmt: skip
