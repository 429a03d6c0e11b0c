"""Every controller of the papers, PID and predictive control on every wheel and rail."""

from __future__ import annotations

import math
from typing import Any

from slipctl import Claim, Figure, Results, Signals, Study, Table
from slipctl.draw import plots
from slipctl.run.results import NotRun
from slipctl.studies.all_rails.loops import NAMES, PAPERS, VEHICLES, cases
from slipctl.studies.all_rails.runs import EXPERIMENTS

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
    Claim("bound", SOURCE, "no loop beats the optimal control bound", "yes/no", True,
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

# ---- figures -------------------------------------------------------------------------------------


def regret_spread(r: Results) -> Any:
    """Regret of each draw, a panel per vehicle and rail."""
    t = r.table("seeds", "draws")
    pairs = list(dict.fromkeys(zip(t["vehicle"], t["rail"], strict=True)))
    fig, axes = plots.panels(len(pairs), 1, height=1.9)
    for axis, (vehicle, rail) in zip(axes[:, 0], pairs, strict=True):
        at = [k for k, p in enumerate(zip(t["vehicle"], t["rail"], strict=True))
              if p == (vehicle, rail)]  # fmt: skip
        groups = {n: [t[n][k] for k in at] for n in NAMES}
        title = f"{vehicle}, {rail}"
        lost = all(v > 0 for values in groups.values() for v in values)
        plots.spread(groups, ("regret", "m"), axis=axis, log=lost, title=title)
    return fig


def ripple(r: Results) -> Any:
    """Torque ripple of each loop, a panel per vehicle."""
    t = r.table("seeds", "regret")
    what = "ripple of the torque, of its limit"
    vehicles = list(dict.fromkeys(t["vehicle"]))
    fig, axes = plots.panels(len(vehicles), 1, height=1.9)
    for axis, vehicle in zip(axes[:, 0], vehicles, strict=True):
        rows = [k for k, v in enumerate(t["vehicle"]) if v == vehicle]
        rails = list(dict.fromkeys(t["rail"][k] for k in rows))
        called = dict(zip(rails, ("rails of the paper", "other rails"), strict=True))
        groups: dict[str, dict[str, float]] = {n: {} for n in NAMES}
        for k in rows:
            groups[t["loop"][k]][called[t["rail"][k]]] = t[what][k]
        title = f"{vehicle}: {' and '.join(rails)}"
        plots.bars(groups, ("ripple", "%"), axis=axis, log=True, title=title)
    return fig


def profiles(r: Results) -> Any:
    """Distance that each tuned law loses against the best one, off the ensemble."""
    return profile_panels(r.table("fair", "profile"))


def profile_panels(t: Table) -> Any:
    """Draw the table ``profile``: a row for what is swept, a column per vehicle."""
    vehicles, swept = (list(dict.fromkeys(t[n])) for n in ("vehicle", "swept"))
    fig, axes = plots.panels(len(swept), len(vehicles), height=1.9)
    for row, what in zip(axes, swept, strict=True):
        for axis, vehicle in zip(row, vehicles, strict=True):
            at = [k for k, (v, w) in enumerate(zip(t["vehicle"], t["swept"], strict=True))
                  if (v, w) == (vehicle, what)]  # fmt: skip
            factors = [t["factor"][k] for k in at]
            lost = {n: [math.nan if t[n][k] is None else t[n][k] for k in at] for n in NAMES}
            plots.lines({n: (factors, y) for n, y in lost.items()}, (f"factor on the {what}", "1"),
                        ("behind the best", "m"), axis=axis, title=vehicle, points=True,
                        legend=axis is axes[0, 0])  # fmt: skip
    return fig


SHOWN = ("smc", "sta", "efc", "barrier", "nmpc")


def changes(scenario: str, span: tuple[float, float]) -> Any:
    """Slip and torque over a span of a scenario."""
    return lambda r: plots.traces(
        r, scenario, SHOWN, [("slip", "best_slip"), "torque"], span=span,
        labels={"slip": "slip speed", "torque": "torque at the wheel"},
    )  # fmt: skip


FIGURES = {
    "regret": Figure(
        "Regret against the optimal control bound of the same draw: every draw a dot, the middle"
        " half a box, the median a line.", regret_spread,
    ),
    "ripple": Figure(
        "Ripple of the torque over the last 0.5 s of each section, peak to peak, of its limit.",
        ripple,
    ),
    "profiles": Figure(
        "Tuned alike, off the ensemble: what each law loses against the best one at the same"
        " point, mean of four seeds of the noise.", profiles,
    ),
    "subway_start": Figure(
        "Subway: the first 0.6 s, in which most distance is lost.",
        changes("subway_table_1", (0, 0.6)),
    ),
    "subway_change": Figure(
        "Subway: from dry to wet at 2 s.", changes("subway_table_1", (1.9, 2.7))
    ),
    "hst_start": Figure("High-speed train: the first second.", changes("hst_section_5", (0, 1.0))),
    "hst_change": Figure(
        "High-speed train: from dry to snow at 2 s.", changes("hst_section_5", (1.9, 2.7))
    ),
    "freight_change": Figure(
        "Freight train in the mirror: from dry to wet at 3 s.",
        changes("freight_table_1", (2.9, 3.7)),
    ),
}  # fmt: skip

study = Study(
    name="all_rails",
    title="Every controller on every wheel and rail, against the best that physics allows",
    source=SOURCE,
    doc="Which controller loses how much distance on which rail, with the same estimator, with"
    " noise, lag, and masses and adhesion that are not what it was told?",
    short="With gains set by hand, predictive control has the lowest mean on every braking rail,"
    " and PID tuned alike is close behind on one of them. On the driven train all laws end within"
    " a centimetre or two. On the subway the estimator causes most of the loss of all laws.",
    headline="bound",
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
    uncertified={
        "pid": "its integral and its limits have no criterion here: it"
        " does not cancel the adhesion, whose slope has both signs",
        "nmpc": "what it does is the solution of a program at each"
        " tick; its terminal weight knows no limits and no other adhesion",
    },
    experiments=EXPERIMENTS,
    claims=CLAIMS,
    figures=FIGURES,
)
