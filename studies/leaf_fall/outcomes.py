"""Runs of the experiments, and what is kept of each."""

from __future__ import annotations

from functools import cache
from typing import Any

from slipctl import Block, Scenario, simulate
from slipctl.models.vehicle import Trip, case
from slipctl.models.vehicle.books import known_of_trip
from slipctl.run.measures.measured_run import Run
from slipctl.run.metrics import measure
from slipctl.studies.leaf_fall.bound import Begin, full_brake
from slipctl.studies.leaf_fall.loops import SIGNALS
from slipctl.studies.leaf_fall.trains import MEDIUM, RIVALS, WEAK, trip

STRENGTHS = {"weak": WEAK, "medium": MEDIUM}
"""Strengths of the cleaning in m/J by name."""

WANTED = ("stopping_distance", "longest_lock", "flash_temperature", "air_used", "valve_operations")
"""Metrics of a run in the experiments."""

LOGGED = ("plant.train.x", "plant.train.v", "plant.train.omega", "slip.y",
          "plant.train.P_contact", "plant.air.used", "plant.act.switched")  # fmt: skip
"""Signals that these metrics need."""


@cache
def begin_of(axles: int) -> Begin:
    """Where the cylinders of a train are full: alike for all controllers, and before all leaves."""
    found = case(trip(axles, patches=((100.0, 200.0),), rivals={"none": RIVALS["none"]}))
    kept = ["plant.T", "demand.T_demand", "plant.train.x", "plant.train.v"]
    scenario = found.scenario.but(duration=4.0, end=None)
    return full_brake(simulate(found.loops["none"], scenario, log=kept))


def outcome(
    made: Trip, loop: Block, scenario: Scenario, compile: bool
) -> dict[str, float | None]:  # fmt: skip
    """Numbers of one run, by the names of :data:`WANTED`."""
    log = simulate(loop, scenario, compile=compile, log=list(LOGGED))
    flash: Any = known_of_trip(made)["contact.flash"].values
    log = log.assign({"contact.flash": (("time", "axle"), flash(log), {"units": "K"})})
    return {n: m.value for n, m in measure(Run(log, SIGNALS), WANTED).items()}  # type: ignore[misc]
