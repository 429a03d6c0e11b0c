"""Scenarios and loops of the study: one place of leaves, weakly and better cleaned, and none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

from slipctl import Block, Case
from slipctl.models.vehicle import Trip, case
from slipctl.models.vehicle.contamination import patches_of_seed
from slipctl.models.vehicle.parts import TrainSlip
from slipctl.models.vehicle.slip.train_reference import believed_train, counted_share
from slipctl.models.vehicle.study import signals_of_trip
from slipctl.models.vehicle.trip import CLEAN, clean_case
from slipctl.run.results import Loops
from slipctl.run.sweep.ensemble import Ensemble
from slipctl.studies.leaf_fall.trains import MEDIUM, PATCHES, RIVALS, trip

KEPT = (
    "plant.train.x", "plant.train.v", "plant.train.omega", "plant.train.mu", "slip.y", "plant.T",
    "ctl.reference.v_best", "plant.field.recovered", "plant.field.height", "plant.field.W_seen",
    "plant.train.P_contact", "plant.act.switched", "plant.air.used", "plant.air.left",
)  # fmt: skip
"""Signals that the logs keep: what metrics and figures need."""

ROWS = 10
"""Ticks from one row of the logs to the next: the period of the controllers."""

BOOKS = "books.error"
"""What the energy books lose, of a log of each tick."""

SIGNALS = signals_of_trip(trip())


def measured(made: Trip, name: str) -> Case:
    """Case of a trip, with what the logs keep; the books need each tick, and are their own."""
    found = case(made, name)
    known = {n: k for n, k in found.known.items() if n != BOOKS}
    return replace(found, log=KEPT, every=ROWS, known=known)


def _loop_that_knows(loops: Mapping[str, Block], name: str, tau: float) -> Block:
    """A loop whose law is told how strongly wheels clean, where it does not learn.

    Its caution is then that of this strength, as in a file that says so.
    """
    loop, reference = loops[name], getattr(RIVALS[name], "reference", None)
    if not isinstance(reference, TrainSlip) or reference.learn or reference.tau == 0:
        return loop
    made, part = trip(tau=tau), "ctl.plan" if reference.plan else "ctl.reference"
    share = counted_share(believed_train(made, reference), made, reference)
    return loop.with_params(**{f"{part}.strength": tau, f"{part}.caution": share})


def cases(models: Mapping[str, Any], quick: bool) -> list[Case]:
    """Leaves that are cleaned weakly, then better, and the rail without them."""
    made = trip()
    base = replace(measured(made, "base"), clean=CLEAN)
    if quick:
        short = base.scenario.but(duration=0.5)
        base = replace(base, scenario=short)
    old = base.scenario
    medium = old.but(
        name="medium", params={**old.params, "plant.field.tau": MEDIUM},
        doc="the same where a joule cleans three times as much",
    )  # fmt: skip
    knowing = Loops({k: partial(_loop_that_knows, base.loops, k, MEDIUM) for k in base.loops})
    return [
        replace(base, scenario=old.but(doc="300 m of leaves that clean weakly")),
        replace(base, scenario=medium, loops=knowing),
        replace(clean_case(made, base), clean=""),
    ]


ENSEMBLE = Ensemble(seeds=True, also=patches_of_seed(trip()), also_told={"patches": vars(PATCHES)})
"""Leaves by chance, which ``slipctl tune`` draws."""
