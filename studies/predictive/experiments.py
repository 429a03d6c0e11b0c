"""What the study ``predictive`` computes beside its loops: solvers, limits, preview, offset."""

from __future__ import annotations

from contextlib import suppress
from importlib.util import find_spec
from typing import Any

import casadi as ca
import numpy as np

from slipctl import Context, Experiment, Table, sampled
from slipctl.predict import reference
from slipctl.predict.qp.active_set import ActiveSet
from slipctl.predict.stages.horizon import Horizon
from slipctl.predict.stages.linear_stage import stage_functions
from slipctl.predict.trials import Driver
from slipctl.studies.predictive.estimation import estimation
from slipctl.studies.predictive.loops import GAINS
from slipctl.studies.predictive.problems import (
    AXLE_H,
    HARDEST,
    RAIL,
    Problem,
    axle_problem,
    problems,
    rolled,
    run,
    slip,
)  # fmt: skip
from slipctl.studies.predictive.reference_speed import reference_speed
from slipctl.studies.predictive.slip_problem import axle, cost, make

FOUR = ("reference", "rates", "hard", "car")

WAYS: dict[str, dict[str, Any]] = {
    "one iteration": {},
    "three iterations": {"iterations": 3},
    "OSQP": {"solver": "osqp"},
    "qrqp": {"solver": "qrqp"},
    "IPOPT": {"solver": "ipopt"},
    "FATROP": {"solver": "fatrop"},
}
"""How a problem is solved. OSQP and qrqp make one iteration, IPOPT and FATROP solve to the end."""

TO_THE_END = ("IPOPT", "FATROP")
DO_MPC = "do-mpc"


def solvers(context: Context) -> Table:
    """Each problem in closed loop, each way."""
    jobs = [[name, way] for name in FOUR for way in WAYS if (name, way) != ("rates", "FATROP")]
    jobs += [["late", "one iteration"], ["late", "three iterations"], ["late", "IPOPT"]]
    if find_spec("do_mpc") and not context.quick:
        jobs += [["reference", DO_MPC], ["car", DO_MPC]]

    def work(job: list[str]) -> dict[str, Any]:
        name, way = job
        if way == DO_MPC:
            from slipctl.studies.predictive.outside import do_mpc

            return do_mpc(problems()[name]) | {"how": "interpreted"}
        return by_way(problems()[name], way, context.compile)

    found = context.each("solvers", jobs, work)
    columns: dict[str, tuple[str, list[Any]]] = {
        "problem": ("", [j[0] for j in jobs]),
        "solver": ("", [j[1] for j in jobs]),
        "cost": ("1", [f["cost"] for f in found]),
        "residual": ("1", [f["residual"] for f in found]),
        "ticks not solved": ("", [f["unsettled"] for f in found]),
        "largest slip": ("1", [f["slip"] for f in found]),
        "its functions": ("", [f["how"] for f in found]),
    }
    return Table(
        "Cost of the states reached, largest residual of the conditions of optimality",
        columns,
        "The first two ways are slipctl's own. A row without numbers: in some tick the answer left"
        " more than 1e-6 of the conditions of Karush, Kuhn and Tucker, so the run stopped. FATROP"
        " takes no rates. do-mpc has a discretisation of its own, and runs where it is installed."
        " What IPOPT and FATROP call is compiled, where there is a compiler.",
    )


def by_way(p: Problem, way: str, compile: bool = True) -> dict[str, Any]:
    """Closed loop of a problem, solved a way; ``how``: whether what a solver calls is compiled.

    IPOPT and FATROP call compiled C of cost, rows and slopes. Where that cannot be made, and all
    others, run interpreted, with the same bits.
    """
    if compile and way in TO_THE_END:
        with suppress(RuntimeError), reference.compile_callbacks():
            return run(p, **WAYS[way]) | {"how": "compiled"}
    return run(p, **WAYS[way]) | {"how": "interpreted"}


def controls(context: Context) -> Table:
    """Along the closed loop of IPOPT: what our controllers command in the same states."""

    def work(name: str) -> dict[str, float]:
        p = problems()[name]
        counts = (1, 3)
        ours = {k: Driver(p.make(iterations=k), compile=False) for k in counts}
        theirs = Driver(p.make(solver="ipopt"), compile=False)
        apart = dict.fromkeys(counts, 0.0)
        s = next(iter(p.plant.inputs.values()))
        width = s.hi - s.lo

        def both(*given: float) -> np.ndarray:
            found = theirs(*given)
            for k, driver in ours.items():
                apart[k] = max(apart[k], abs(float(driver(*given)[0] - found[0])) / width)
            return found

        rolled(p, both, slice(20) if context.quick else slice(None))
        return {str(k): v for k, v in apart.items()}

    found = context.each("controls", FOUR, work)
    return Table(
        "Largest difference from IPOPT's control, over the range of the control",
        {
            "problem": ("", list(FOUR)),
            "one iteration": ("1", [f["1"] for f in found]),
            "three": ("1", [f["3"] for f in found]),
        },
        "In every tick all get the same state; IPOPT's control drives the plant.",
    )


RATES = (2.0, 5.0, 10.0, 20.0, 50.0, 200.0)


def limits(context: Context) -> dict[str, Table]:
    """Rates from tight to loose, and a hard limit that some rails do not let be kept."""
    tried = list(RATES[:2] if context.quick else RATES)
    found = context.each("rates", tried, _rated)
    rates = Table(
        "The problem `reference` with a rate limit",
        {
            "rate": ("kN m/s", tried),
            "ticks": ("", [len(RAIL)] * len(tried)),
            "ticks not solved": ("", [f["unsettled"] for f in found]),
            "most passes": ("", [f["passes"] for f in found]),
            "residual": ("1", [f["residual"] for f in found]),
            "largest excess of the rate": ("kN m/s", [f["excess"] for f in found]),
        },
    )
    told = _told()
    return {
        "rates": rates,
        "told": Table(
            "A hard limit of the slip over a change of rail",
            {k: ("", [v]) for k, v in told.items()},
            "Slip below 0.019 on all three rails of `reference`. A tick is hopeless where not even"
            " no torque at all keeps the slip below the limit over the horizon; a simulation says"
            " so.",
        ),
    }


def _rated(rate: float) -> dict[str, Any]:
    p = axle_problem(rates={"u": rate})
    found = rolled(p, Driver(p.make(), compile=False))
    moved = np.abs(np.diff(np.r_[1.0, found.u])) / 0.02
    return dict(
        unsettled=int((found.status != 0).sum()), passes=float(found.passes.max()),
        residual=float(found.residual.max()), excess=float(max(moved.max() - rate, 0.0)),
    )  # fmt: skip


def _told() -> dict[str, Any]:
    """How many ticks were hopeless, how many were told, and how many of them were not the same."""
    p = axle_problem(hard={"s": (-0.1, HARDEST)})
    found = rolled(p, Driver(p.make(), compile=False))
    step = sampled(axle, 0.02, "rk4", 4).f
    numbers = axle.pack("param", axle.param_values())
    hopeless = []
    for x, given in zip(found.x, RAIL, strict=False):
        most = slip(x)
        for _ in range(20):
            x = np.array(step(x, [0.0, *given], numbers)[0]).ravel()
            most = max(most, slip(x))
        hopeless.append(most - HARDEST)
    over = np.array(hopeless)
    told = found.status == 3
    return {
        "ticks": len(told), "hopeless": int((over > CLEAR).sum()), "told": int(told.sum()),
        "not the same": int((told != (over > CLEAR)).sum()),
        "other than 0 and 3": int((~np.isin(found.status, (0, 3))).sum()),
        "largest slip": max(slip(x) for x in found.x),
    }  # fmt: skip


CLEAR = 1e-7
"""Excess of the slip that counts: a millionth of the size of its limits, as in the solver."""


def preview(context: Context) -> dict[str, Table]:
    """The problem `rates`, with the peak of the adhesion held over the horizon or known ahead."""
    p = problems()["rates"]
    ahead = np.array([RAIL[np.minimum(np.arange(k, k + 21), 249), 0] for k in range(len(p.given))])

    def work(way: str) -> dict[str, Any]:
        if way == "held":
            found = rolled(p, Driver(p.make(), compile=False))
        else:
            tick = Driver(p.make(preview=["mu_p"]), compile=False)
            rows = iter(ahead)
            found = rolled(p, lambda *given: tick(*given[:-2], next(rows), given[-1]))
        return dict(cost=found.cost, slip=[slip(x) for x in found.x], u=list(found.u))

    ways = ["held", "known ahead"]
    found = context.each("preview", ways, work)
    time = AXLE_H * np.arange(len(p.given))
    columns: dict[str, tuple[str, Any]] = {"time": ("s", time.tolist())}
    for way, f in zip(ways, found, strict=True):
        columns |= {f"slip, {way}": ("1", f["slip"][:-1]), f"command, {way}": ("kN m", f["u"])}
    return {
        "costs": Table(
            "Preview of a change of rail behind a tight rate",
            {
                "peak": ("", ways),
                "cost": ("1", [f["cost"] for f in found]),
                "largest slip": ("1", [max(f["slip"]) for f in found]),
            },
            "The problem `rates`: from dry to wet at 1.2 s, the command no faster than 20 kN m/s.",
        ),
        "runs": Table("The runs with and without preview", columns),
    }


GRID = 25
"""Points of each gain of the PI law."""


def pi_gains(context: Context) -> Table:
    """The PI law of least cost on its own run, beside the predictive controller."""
    spans = {"axle": ("reference", (1, 3000)), "car": ("car", (10, 30000))}

    def work(name: str) -> dict[str, Any]:
        problem, (low, high) = spans[name]
        p = problems()[problem]
        costs, gains = pi_costs(
            p, np.geomspace(low, high, GRID), np.geomspace(low, 30 * high, GRID)
        )
        best = int(np.argmin(costs))
        K_p, K_i = gains[best]
        used = float(pi_costs(p, [GAINS[name][0]], [GAINS[name][1]])[0][0])
        return dict(cost=float(costs[best]), K_p=K_p, K_i=K_i, used=used, nmpc=run(p)["cost"])

    found = context.each("pi_gains", list(spans), work)
    return Table(
        "PI with the best of a grid of gains, chosen on the run that is judged",
        {
            "plant": ("", list(spans)),
            "least cost of 625 pairs": ("1", [f["cost"] for f in found]),
            "K_p over 1 kN m or N m": ("1", [f["K_p"] for f in found]),
            "K_i over 1 kN m/s or N m/s": ("1", [f["K_i"] for f in found]),
            "cost of PI with the gains of the loops": ("1", [f["used"] for f in found]),
            "cost of nmpc": ("1", [f["nmpc"] for f in found]),
        },
    )


def pi_costs(p: Problem, K_p: Any, K_i: Any) -> tuple[np.ndarray, list[tuple[float, float]]]:
    """Cost of a problem's run under PI for each pair of gains, all at once; :func:`loops.pi`."""
    gains = [(float(a), float(b)) for a in K_p for b in K_i]
    n, hi = len(gains), next(iter(p.plant.inputs.values())).hi
    step = sampled(p.plant, p.h, "rk4", 4).f.map(n)
    numbers = np.tile(np.array(p.plant.pack("param", p.plant.param_values())).reshape(-1, 1), n)
    start = p.plant.start()
    x = np.tile(np.array([[float(start[s])] for s in p.plant.states]), n)
    a, b = (np.array([g[k] for g in gains]) / hi for k in (0, 1))
    part, total = np.full(n, 0.1), np.zeros(n)
    for given in p.given:
        e = given[1] - (x[1] - x[0]) / np.hypot(x[0], 0.5)
        wanted = a * e + part
        share = np.clip(wanted, 0, 1)
        u = hi * share
        part = np.clip(part + np.where((wanted - share) * e > 0, 0, p.h * b * e), 0, 1)
        x = np.array(step(x, np.vstack([u, np.tile(given[:, None], n)]), numbers)[0])
        total += [p.price(x[:, k], u[k]) for k in range(n)]
    return np.where(np.isfinite(total), total, np.inf), gains


HORIZONS = (20, 40, 80, 160)


def horizons(context: Context) -> Table:
    """Operations of a tick over the length of the horizon."""

    def work(N: int) -> dict[str, Any]:
        p = problems()["reference"]
        found = rolled(p, Driver(make(horizon=N), compile=False))
        stage, one_pass = operations(N)
        return dict(stage=stage, one=one_pass, mean=float(found.passes.mean()),
                    most=float(found.passes.max()), cost=found.cost)  # fmt: skip

    found = context.each("horizons", HORIZONS, work)
    return Table(
        "Operations of a tick over the number of stages",
        {
            "stages": ("", list(HORIZONS)),
            "linearisation": ("", [f["stage"] for f in found]),
            "a pass": ("", [f["one"] for f in found]),
            "mean passes": ("", [f["mean"] for f in found]),
            "most passes": ("", [f["most"] for f in found]),
            "operations, mean": ("", [f["stage"] + f["mean"] * f["one"] for f in found]),
            "operations, most": ("", [f["stage"] + f["most"] * f["one"] for f in found]),
            "cost": ("1", [f["cost"] for f in found]),
        },
        "Operations of scalars, as CasADi counts them, over the 250 ticks of `reference`.",
    )


def operations(stages: int) -> tuple[int, int]:
    """Operations of the linearisation and of one pass over a horizon."""
    problem = Horizon.of(axle, cost, ["u"], None, {}, stages, 0.02, "rk4", 4, {"u": 8.0})
    of_stage = stage_functions("horizons", problem)
    end, last = problem.end()
    qp = ActiveSet(problem, of_stage.layout, last, [False] * stages, False, 1)
    both = qp._backward.n_instructions() + qp._forward.n_instructions()
    return (
        stages * scalar(of_stage.stage) + end.n_instructions(),
        stages * both + qp._start.n_instructions(),
    )


def scalar(f: ca.Function) -> int:
    """Operations of the scalar functions that a function calls, as often as it calls them."""
    if f.is_a("SXFunction"):
        return f.n_instructions()
    calls = (k for k in range(f.n_instructions()) if f.instruction_id(k) == ca.OP_CALL)
    return sum(scalar(f.instruction_MX(k).which_function()) for k in calls)


EXPERIMENTS = {
    "solvers": Experiment("Four problems, several ways to solve them", solvers),
    "controls": Experiment("The same control as IPOPT", controls),
    "limits": Experiment("Limits that are tight, and limits that contradict", limits),
    "preview": Experiment("What it brings to know the rail ahead", preview),
    "pi_gains": Experiment("The best PI law on the same run", pi_gains),
    "horizons": Experiment("Operations over the horizon", horizons),
    "estimation": Experiment("The adhesion force by a window of samples", estimation),
    "reference_speed": Experiment(
        "The train's speed by a window that knows slip's sign", reference_speed
    ),
}
