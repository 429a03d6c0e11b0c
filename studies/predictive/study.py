"""Predictive control of slip by slipctl's own solver, beside general solvers and PI."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

from slipctl import Claim, Figure, Results, Signals, Study
from slipctl.draw import plots
from slipctl.run.results import NotRun
from slipctl.studies.predictive.experiments import DO_MPC, EXPERIMENTS, FOUR
from slipctl.studies.predictive.loops import cases
from slipctl.studies.predictive.problems import HARDEST

OWN = ("one iteration", "three iterations")
PROBLEM = "the problem of studies/predictive/slip_problem.py"
OURS = "ours"


def of(r: Results, problem: str, solver: str, column: str = "cost") -> Any:
    """A number of the solvers' table."""
    return r.table("solvers").where(column, problem=problem, solver=solver)


def apart(r: Results, problem: str, ours: str, theirs: str) -> float | None:
    """Relative distance of two costs; None where an answer was refused."""
    a, b = of(r, problem, ours), of(r, problem, theirs)
    return None if a is None or b is None else abs(a - b) / abs(b)


def same_program(solver: str) -> Callable[[Results], float | None]:
    """Largest relative distance of one iteration's cost from a solver's, over all problems."""

    def ours(r: Results) -> float | None:
        found = [apart(r, n, OWN[0], solver) for n in FOUR]
        return None if None in found else max(v for v in found if v is not None)

    return ours


def own(column: str, names: tuple[str, ...] = (*FOUR, "late")) -> Callable[[Results], Any]:
    """Largest number of a column over problems, of our own ways."""
    return lambda r: max(of(r, n, w, column) for n in names for w in OWN)


def control(problem: str) -> Callable[[Results], Any]:
    """Distance of our control from IPOPT's."""
    return lambda r: r.table("controls").where("three", problem=problem)


def by_do_mpc(r: Results) -> float | None:
    """Largest relative distance of our cost from that of do-mpc."""
    if not find_spec("do_mpc"):
        raise NotRun("do-mpc is not installed: pip install slipctl[bench]")
    if r.quick:
        raise NotRun("do-mpc was not run")
    found = [apart(r, n, OWN[1], DO_MPC) for n in ("reference", "car")]
    return None if None in found else max(v for v in found if v is not None)


def told(column: str) -> Callable[[Results], Any]:
    """A number about the hard limit over all rails."""
    return lambda r: r.table("limits", "told")[column][0]


def in_order(name: str) -> Callable[[Results], Any]:
    """Costs of PI and prediction on a plant."""

    def ours(r: Results) -> dict[str, float]:
        t = r.table("pi_gains")
        return {"nmpc": t.where("cost of nmpc", plant=name),
                "PI": t.where("least cost of 625 pairs", plant=name)}  # fmt: skip

    return ours


def worst_ratio(r: Results) -> float:
    """Largest error of the window over that of the paper's filter, rail by rail."""
    t = r.table("estimation", "errors")
    return max(a / b for a, b in zip(t["mhe"], t["ctukf"], strict=True))


def where_worse(r: Results) -> str:
    """Rails on which the filter of the paper is nearer."""
    t = r.table("estimation", "errors")
    rows = zip(t["noise"], t["rail"], t["part"], t["mhe"], t["ctukf"], strict=True)
    found = [f"{rail} ({part}, {noise:g} rad/s)" for noise, rail, part, a, b in rows if a > b]
    return f"not on {', '.join(found)}; on the other {len(t['mhe']) - len(found)} it is"


def speed_ratio(r: Results) -> float:
    """Error of the train's speed by the window over that of the filter."""
    t = r.table("reference_speed")
    return float(t.where("rms error", estimator="mhe") / t.where("rms error", estimator="ekf"))


def growth(r: Results) -> float:
    """Operations of 160 stages over those of 80, mean of the ticks."""
    t, column = r.table("horizons"), "operations, mean"
    return float(t.where(column, stages=160) / t.where(column, stages=80))


CLAIMS = (
    Claim("reference", PROBLEM, "cost where the rail is known", "number", "29.031",
          lambda r: of(r, "reference", OWN[0]), tolerance="last digit"),
    Claim("late", PROBLEM, "cost where the rail is told late and 15 % high, one iteration",
          "number", "932.15", lambda r: of(r, "late", OWN[0]), tolerance="last digit"),
    Claim("late_three", PROBLEM, "the same with three iterations", "number", "844.480",
          lambda r: of(r, "late", OWN[1]), tolerance="last digit"),
    *(Claim(f"control_{name}", "IPOPT, solved to the end",
            f"{name}: largest difference from IPOPT's control, over its range, three iterations",
            "number", 1e-6, control(name), bound="at most",
            assumption="in every tick both get the same state")
      for name in FOUR),
    Claim("program", "OSQP", "one iteration costs what OSQP's does on all problems, relative"
          " distance", "number", 1e-6, same_program("OSQP"), bound="at most"),
    Claim("program_qrqp", "qrqp", "one iteration costs what qrqp's does on all problems, relative"
          " distance", "number", 1e-6, same_program("qrqp"), bound="at most",
          why_not="its own accuracy: on `rates` it finds no direction to go on, on `hard` it says"
          " success with the limit exceeded; such answers are refused"),
    Claim("do_mpc", "do-mpc, collocation and IPOPT",
          "three iterations cost what do-mpc's solution costs on `reference` and `car`", "number",
          1e-4, by_do_mpc, bound="at most",
          assumption="its discretisation is another one, which moves the optimum"),
    Claim("acados", "acados", "the same cost on the four problems", "yes/no", True,
          not_checkable="acados is no Python package; it is built by hand, and not run here"),
    Claim("settled", OURS, "ticks of the problems that end unsolved", "number", 0,
          own("ticks not solved"), bound="at most"),
    Claim("residual", OURS, "what is left of the conditions of optimality", "number", 1e-9,
          own("residual"), bound="at most"),
    Claim("hard", OURS, "largest slip under a hard limit", "number", HARDEST,
          own("largest slip", ("hard",)), tolerance=1e-7, bound="at most",
          tolerance_why="a millionth of the size of the limits"),
    Claim("hopeless", "a simulation of no torque",
          "ticks in which a limit is told as given up and could be kept, or the other way round",
          "number", 0, told("not the same"), bound="at most",
          why=lambda r: f"{told('told')(r)} of {told('ticks')(r)} ticks were hopeless and told"),
    Claim("rates", OURS, "ticks behind rates of 2 to 200 kN m/s that end unsolved", "number", 0,
          lambda r: sum(r.table("limits", "rates")["ticks not solved"]), bound="at most"),
    Claim("rate_kept", OURS, "largest excess of a rate", "number", 0,
          lambda r: max(r.table("limits", "rates")["largest excess of the rate"]), "kN m/s",
          tolerance=1e-9, tolerance_why="rounding", bound="at most"),
    Claim("preview", OURS, "a rail known ahead costs less behind a tight rate", "order",
          "known ahead < held",
          lambda r: dict(zip(r.table("preview", "costs")["peak"],
                             r.table("preview", "costs")["cost"], strict=True))),
    Claim("pi_axle", OURS, "prediction costs less than the best PI on the axle", "order",
          "nmpc < PI", in_order("axle"), tolerance="10 %", tolerance_why="a gain worth its price"),
    Claim("pi_car", OURS, "prediction costs less than the best PI on the quarter car", "order",
          "nmpc < PI", in_order("car"), tolerance="10 %", tolerance_why="a gain worth its price",
          why_not="dry, the car's largest torque is too small for the wanted slip; wet, its wheel"
          " follows the torque at once, and PI does as well"),
    Claim("mhe_accuracy", "filter of Zhang 2021",
          "rms error of the adhesion force by a window of 30 samples over that of the paper's"
          " filter, worst of rails, noises and changes", "number", 1.0, worst_ratio,
          bound="at most", assumption="the window is told the noise, the filter is not",
          why_not=where_worse),
    Claim("mhe_pays", "filter of Zhang 2021 and extended Kalman filter",
          "samples in which the window tells an adhesion force that pushes the train", "number", 0,
          lambda r: sum(r.table("estimation", "limits")["samples, mhe"]), bound="at most",
          why=lambda r: "of ctukf "
          f"{sum(r.table('estimation', 'limits')['samples, ctukf'])}, of ekf"
          f" {sum(r.table('estimation', 'limits')['samples, ekf'])}"),
    Claim("mhe_ekf", "extended Kalman filter",
          "distance of the window from the extended Kalman filter where no limit is near", "number",
          1e-5, lambda r: max(r.table("estimation", "limits")["mhe from ekf, away from the limit"]),
          "N", bound="at most", assumption="the wheel is linear in its speed and force"),
    Claim("reference_speed", "extended Kalman filter",
          "rms error of the train's speed by a window that knows the sign of slip, over that of the"
          " filter", "number", 1.0, speed_ratio, bound="at most",
          assumption="the filter trusts the rim as is best for it on this run"),
    Claim("slip_sign", "extended Kalman filter",
          "ticks in which the window tells a train slower than its braked rim, by more than five"
          " standard deviations", "number", 0,
          lambda r: r.table("reference_speed").where("ticks below the rim", estimator="mhe"),
          bound="at most", why=lambda r: "of the filter "
          f"{r.table('reference_speed').where('ticks below the rim', estimator='ekf')}"),
    Claim("growth", OURS, "operations of 160 stages over those of 80, mean of the ticks", "number",
          2.1, growth, bound="at most"),
)  # fmt: skip

# ---- figures -------------------------------------------------------------------------------------


def shown(scenario: str, span: tuple[float, float] | None = None) -> Callable[[Results], Any]:
    """Slip with its reference, and torque."""
    labels = {"slip": "slip", "torque": "torque"}
    return lambda r: plots.traces(
        r, scenario, ("pid", "nmpc", "nmpc_told_dry"), [("slip", "reference"), "torque"],
        labels=labels, span=span,
    )  # fmt: skip


def ahead(r: Results) -> Any:
    """Slip and command with and without preview."""
    t = r.table("preview", "runs")
    fig, axes = plots.panels(2, 1, sharex=True)
    for axis, what, unit in ((axes[0, 0], "slip", "1"), (axes[1, 0], "command", "kN m")):
        curves = {w: (t["time"], t[f"{what}, {w}"]) for w in ("held", "known ahead")}
        x = ("time", "s")
        plots.lines(curves, x, (what, unit), axis=axis, legend=what == "slip")
    return fig


def work(r: Results) -> Any:
    """Operations over the horizon."""
    t = r.table("horizons")
    curves = {w: (t["stages"], t[f"operations, {w}"]) for w in ("mean", "most")}
    return plots.lines(curves, ("stages", "1"), ("operations of a tick", "1"), points=True)


FIGURES = {
    "axle": Figure(
        "Axle over dry, wet and damp rail: the best PI law, prediction that knows the rail, and"
        " prediction that believes it dry.", shown("base"),
    ),
    "car": Figure(
        "Quarter car from dry to wet at 0.12 s: dry, no law reaches the wanted slip.",
        shown("car"),
    ),
    "preview": Figure(
        "Dry to wet at 1.2 s, the command no faster than 20 kN m/s: with preview the torque falls"
        " before the rail does.", ahead,
    ),
    "horizon": Figure("Operations of a tick over the number of stages.", work),
}  # fmt: skip

study = Study(
    name="predictive",
    title="Predictive slip control beside general solvers and PI",
    source="problems of docs/predictive.md",
    doc="Does the solver find the optimum on ordinary and hard problems, does it tell the truth"
    " about limits, and where is prediction worth its price?",
    short="Where the torque comes late or may not jump, prediction keeps the slip where PID"
    " overshoots. Where the wheel follows the torque at once, a good PID does as well. A"
    " prediction for the wrong rail is worse than either.",
    headline="pi_axle",
    cases=cases,
    signals=Signals(
        speed="plant.v", slip="plant.s", reference="s_ref", torque=("plant.T", "ctl.T")
    ),
    uncertified={
        "pid": "its integral and its limits have no criterion here",
        **dict.fromkeys(
            ("nmpc", "nmpc_told_dry"),
            "what it does is the solution of a program at each tick; its terminal weight knows no"
            " limits and no other adhesion",
        ),
    },
    experiments=EXPERIMENTS,
    claims=CLAIMS,
    figures=FIGURES,
    plain=("base", "car", *EXPERIMENTS),
)
