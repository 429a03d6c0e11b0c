"""Every controller of the papers, PID and predictive control on every wheel and rail."""

from __future__ import annotations

from typing import Any

from slipctl import Claim, Results, Signals, Study
from slipctl.studies.all_rails_loops import NAMES, PAPERS, VEHICLES, cases
from slipctl.studies.all_rails_runs import EXPERIMENTS
from slipctl.studying import NotRun

SOURCE = "this study"


def rows(r: Results, vehicle: str, rail: str) -> dict[str, float]:
    """Mean regret in m of each loop of a vehicle on a rail."""
    t = r.table("seeds", "regret")
    if t.where("mean regret", vehicle=vehicle, rail=rail) is None:
        raise NotRun(f"{vehicle} on {rail} was not run")
    return {n: t.where("mean regret", vehicle=vehicle, rail=rail, loop=n) for n in NAMES}


def nobody_beats_it(r: Results) -> bool:
    """Whether every regret is positive."""
    return min(r.table("seeds", "bound")["least regret of any loop and seed"]) > 0


def below_every_paper(vehicle: str, rail: str) -> Any:
    """Whether the mean regret of NMPC is below that of every paper's controller."""

    def check(r: Results) -> bool:
        found = rows(r, vehicle, rail)
        return found["nmpc"] < min(found[n] for n in PAPERS)

    return check


CLAIMS = (
    Claim("bound", SOURCE, "no loop beats the clairvoyant optimum", "yes/no", True,
          nobody_beats_it),
    Claim("stable", SOURCE, "the optimum rests to 1e-4 m when the mesh is refined", "number", 1e-4,
          lambda r: max(r.table("seeds", "bound")["change on the last mesh, largest"]), "m",
          bound="at most"),
    *(
        Claim(f"nmpc_{name}_{rail}", SOURCE,
              f"NMPC's mean regret on {name}, {rail}, is below that of every paper's controller",
              "yes/no", True, below_every_paper(name, rail), loop="nmpc",
              scenario=f"{name}_{rail}")
        for name, v in VEHICLES.items() if not v.driven
        for rail in v.rails
    ),
)  # fmt: skip

study = Study(
    name="all_rails",
    title="Every controller on every wheel and rail, against the best that physics allows",
    source=SOURCE,
    doc="Which controller loses how much way on which rail, with the same estimator, with noise,"
    " lag, and masses and adhesion that are not what it was told?",
    cases=cases,
    signals=Signals(
        speed="world.v_true",
        position="world.x_true",
        slip="world.slip_true",
        reference="world.v_best",
        best_slip="rail.best_slip",
        torque="world.T",
    ),
    controller="law",
    experiments=EXPERIMENTS,
    claims=CLAIMS,
    figures={},
)
