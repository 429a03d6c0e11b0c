"""How far the gains of the four papers reach: criteria, regions, Lyapunov functions, sampling."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from slipctl import Case, Claim, Figure, Rail, Results, Scenario, Section, Signals, Study
from slipctl.models.super_twisting.certificate import super_twisting
from slipctl.models.wang_2025.certificate import higher_order
from slipctl.studies.gain_bounds.experiments import EXPERIMENTS
from slipctl.studies.gain_bounds.figures import DRAWN
from slipctl.studies.subway_braking.loops import MODELS, best, perfect


def cases(models: Mapping[str, Any], quick: bool) -> list[Case]:
    """The subway train on dry rail under the gains that are used and those that are printed."""
    from slipctl.models.huang_2020.subway_braking_control import super_twisting as law

    v_opt = best(models["adh"], "dry")[0]
    rail = Rail([Section(0.0, "dry", {"v_opt": v_opt})])
    loops = {
        "sta": perfect(models, models["sta"]),
        "sta_printed": perfect(models, law(gains="printed")),
        "smc": perfect(models, models["smc"]),
    }
    return [Case(Scenario("base", 1.0, rail, doc="dry rail, perfect sensors"), loops)]


def _row(r: Results, study: str, gains: str, column: str) -> Any:
    table = r.table("papers")
    for k, name in enumerate(table["study"]):
        if (name, table["gains"][k]) == (study, gains):
            return table[column][k]
    return None


def _own(study: str, gains: str) -> Any:
    return lambda r: _row(r, study, gains, "the paper's own condition") == "holds"


CLAIMS = (
    Claim("gains_of_000", "Huang 2020, (48)", "k1 = 2000, k2 = 1.5 satisfy (48)", "yes/no", True,
          _own("subway_braking", "sta_printed"),
          why="stable all the same in continuous time for L < 1.5 m/s^3; at 1 ms the chattering of"
          " explicit Euler is 1 m/s"),
    Claim("gains_of_003", "Wang 2025, (49)", "alpha, beta, k4 satisfy (49)", "yes/no", True,
          _own("hst_traction", "hosm_printed"),
          why=f"they certify eta up to {higher_order.certified_eta(0.02, 0.09, 0.25):.6f}"
          " m/s^3, less than the law itself makes through the lag of its motors"),
    Claim("gains_of_004", "Cheng 2022, section 3.3.1", "k and rho let the seeker slide", "yes/no",
          True, _own("freight_traction", "seek_printed"),
          why="rho/k = 1 is above the steepest slope, 0.66 s/m"),
    Claim("proofs_fall", "all four", "the Lyapunov functions fall where the proofs say", "yes/no",
          True, lambda r: min(r.table("lyapunov")["V falls there"]) == 100.0,
          assumption="disturbances within the bound that the proof needs"),
    Claim("one_unit", "all four", "no printed condition depends on the unit", "yes/no", True,
          lambda r: not any(r.table("units")["verdict changes"]),
          why="(48), (49) and the text of Theorem 1 compare numbers of different units"),
    Claim("proper_implicit", "after Seeber and Andritsch 2025",
          "sliding error of the proper implicit form at 1 ms", "number",
          super_twisting.proper_implicit_amplitude(1.0, 1e-3),
          lambda r: r.table("amplitudes", "error").where("proper implicit", period=1e-3), "m/s",
          tolerance=1e-9, tolerance_why="1.001 L T^2", bound="at most"),
)  # fmt: skip

study = Study(
    name="gain_bounds",
    title="How far the gains of the four papers reach",
    source="Huang 2020; Zhang 2021; Wang 2025; Cheng 2022",
    doc="Which gains satisfy the papers' own conditions, which suffice in truth, and what does the"
    " sampled controller need?",
    short="The gains that Huang 2020 prints fail the paper's own condition, and explicit Euler"
    " chatters with them at 1 ms. Those of Wang 2025 certify less than what the law itself"
    " makes through the lag of its motors. Those of Cheng 2022 do not let the seeker slide.",
    headline="gains_of_000",
    models=MODELS,
    cases=cases,
    signals=Signals(
        speed="plant.wheel.v", slip="plant.wheel.v_s", best_slip="v_opt", torque="plant.brake.T_b"
    ),
    claims=CLAIMS,
    figures={name: Figure(caption, draw) for name, (caption, draw) in DRAWN.items()},
    experiments=EXPERIMENTS,
)
