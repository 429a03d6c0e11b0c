"""Anti-slip control of a high-speed train: observer, limit, and six laws with and without it."""

from __future__ import annotations

from typing import Any

import numpy as np

from slipctl import Claim, Figure, Results, Signals, Study
from slipctl.draw import plots
from slipctl.models.contact import peak
from slipctl.models.hst_traction import tractive_effort
from slipctl.run.results import NotRun
from slipctl.studies.hst_traction import contact, experiments
from slipctl.studies.hst_traction import regret as lost
from slipctl.studies.hst_traction.gains import GAINS
from slipctl.studies.hst_traction.loops import BAND, MODELS, NAMES, RAIL, cases

SLIDING = ("smc", "asmc", "hosm")
"""The three laws of Figs 7 to 10."""

SHOWN = ("smc", "asmc", "hosm_limited")
"""As the paper shows them: the first two without a limit."""

KMH = 3.6


# ---- answers to the claims -----------------------------------------------------------------------


def creep(r: Results, scenario: str, loop: str, which: str) -> float:
    """Largest (``"highest"``) or smallest (``"lowest"``) creep of a run in km/h."""
    values = r.log(scenario, loop)[f"worst.{which}"].values
    return KMH * float(values.max() if which == "highest" else values.min())


def after(r: Results, scenario: str, loop: str, start: float, stop: float, name: str) -> np.ndarray:
    """Values of a logged signal between two times in s of the paper's run."""
    log = r.log(scenario, loop)
    t = log["time"].values + begin(r)
    inside = (t >= start) & (t < stop)
    if not inside.any():
        raise NotRun(f"{scenario}/{loop} was not run from {start:g} s to {stop:g} s")
    return np.asarray(log[name].values[inside])


def begin(r: Results) -> float:
    """Time of the paper's run in s at which the runs begin."""
    return 105.0 if r.quick else 0.0


def error(
    r: Results, scenario: str, loop: str, start: float = 0.0, stop: float = 1e9
) -> np.ndarray:
    """Speed less its target in m/s."""
    speed = after(r, scenario, loop, start, stop, "plant.train.v")
    return speed - after(r, scenario, loop, start, stop, "v_d")


def rms(values: np.ndarray) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def speed_errors(r: Results) -> dict[str, float]:
    """RMS speed error in m/s in ``stress``: without the limit, but hosm with it, as in print."""
    return {name: rms(error(r, "stress", name)) for name in SHOWN}


def limited_errors(r: Results) -> dict[str, float]:
    """RMS speed error in m/s in ``stress``, every law with the limit."""
    names = ("hosm", "smc", "asmc")
    return {n: rms(error(r, "stress", f"{n}_limited")) for n in names}


def response(name: str, column: str = "first change of the command after") -> Any:
    """Response to the ice in ms, from the experiment."""
    return lambda r: r.table("response").where(column, law=name)


def recovers(r: Results, loop: str) -> bool:
    """Whether a run on damp rail keeps within 0.5 m/s of its target, 400 s on."""
    return bool(np.abs(error(r, "stress", loop, 400.0, 530.0)).max() < 0.5)


def misled(r: Results) -> bool:
    """Whether the limit falls below 100 kN while the train coasts on wet rail, 200 s to 250 s."""
    return bool(after(r, "stress", "hosm_limited", 200.0, 250.0, "ctl.limit.F_hi").min() < 100e3)


def worst_limited(r: Results) -> float:
    """Largest creep in km/h of any law with the limit, in ``base`` and ``stress``."""
    found = [
        creep(r, s, f"{n}_limited", "highest")
        for s in ("base", "stress")
        for n in NAMES
        if f"{n}_limited" in r.data.get(s, {})
    ]
    return max(found)


TABLE_4 = {
    "hosm": ("0.02", "0.10", 5.0), "mpc": ("0.05", "0.20", 30.0), "robust": ("0.04", "0.18", 25.0),
    "pid": ("0.07", "0.25", 15.0),
}  # fmt: skip
"""RMSE, largest error, response in ms as printed; the units of the first two are not."""

CLAIMS = (
    *(
        Claim(
            f"creep_high_{scenario}", "section 4, Fig. 9(c)",
            f"the proposed controller keeps the creep below 2.88 km/h, {scenario}", "number",
            2.88, lambda r, s=scenario: creep(r, s, "hosm_limited", "highest"), "km/h",
            bound="at most", scenario=scenario, loop="hosm_limited",
            assumption="Hertz, brake, motor lag and target are not given; margin 0.9 on ice",
        )
        for scenario in ("base", "stress")
    ),
    *(
        Claim(
            f"creep_low_{scenario}", "section 4, Fig. 9(c)",
            f"and above -0.72 km/h, {scenario}", "number", -0.72,
            lambda r, s=scenario: creep(r, s, "hosm_limited", "lowest"), "km/h",
            bound="at least", scenario=scenario, loop="hosm_limited", assumption="as above",
        )
        for scenario in ("base", "stress")
    ),
    Claim(
        "creep_every_law", "section 3.2", "the limit prevents slip, whatever the law", "number",
        2.0, worst_limited, "km/h", bound="at most", scenario="stress",
        assumption="below 2.0 km/h in base and stress for all six laws; the bound is ours",
    ),
    *(
        Claim(
            f"slips_{name}", "section 4, Fig. 9", f"{name} without the limit slips by over 200 km/h"
            " after 115 s", "number", 200.0,
            lambda r, n=name: creep(r, "stress", n, "highest"), "km/h", bound="at least",
            scenario="stress", loop=name,
            why_not="it slips away, but a motor whose power is limited by its own wheel's speed"
            " (docs/errata.md) comes to rest where the falling adhesion meets that limit",
        )
        for name in ("smc", "asmc")
    ),
    Claim(
        "slips_printed_motor", "section 4, Fig. 9; (33)", "the same, with the power limited by the"
        " train's speed as printed", "number", 200.0,
        lambda r: creep(r, "stress", "smc_motor_printed", "highest"), "km/h", bound="at least",
        scenario="stress", loop="smc_motor_printed",
    ),
    *(
        Claim(
            f"rmse_{name}", "Table 4", f"RMSE of {name}", "number", printed[0],
            lambda r, n=name: r.metric("base", f"{n}_limited", "speed_error_rms"), "m/s",
            tolerance="last digit", scenario="base", loop=f"{name}_limited",
            assumption="of the speed in m/s over the whole run; Table 4 prints \'(Units)\'",
            why_not="while the rail carries less than the target asks for, no law can follow; that"
            " makes nearly all of the error, and depends on the target, which is not given",
        )
        for name, printed in TABLE_4.items()
    ),
    *(
        Claim(
            f"error_{name}", "Table 4", f"largest error of {name}", "number", printed[1],
            lambda r, n=name: r.metric("base", f"{n}_limited", "speed_error_max"), "m/s",
            tolerance="last digit", scenario="base", loop=f"{name}_limited",
            assumption="of the speed in m/s", why_not="as above",
        )
        for name, printed in TABLE_4.items()
    ),
    *(
        Claim(
            f"response_{name}", "Table 4", f"response time of {name}", "number", printed[2],
            response(name), "ms", bound="at most", scenario="stress", loop=f"{name}_limited",
            assumption="from the ice to the first change of the command; with the limit, which the"
            " paper gives to its own controller only",
        )
        for name, printed in TABLE_4.items()
    ),
    *(
        Claim(
            f"execution_{name}", "Table 4", f"execution time of {name}", "number", printed, None,
            "s", not_checkable="measured on the authors' DSP",
        )
        for name, printed in (("hosm", "0.005"), ("mpc", "0.030"), ("robust", "0.020"),
                              ("pid", "0.010"))
    ),
    Claim(
        "smc_recovers", "section 4, Fig. 7(a)", "conventional sliding mode recovers after 320 s",
        "yes/no", True, lambda r: recovers(r, "smc"), scenario="stress", loop="smc",
        assumption="speed within 0.5 m/s from 400 s on",
    ),
    Claim(
        "asmc_fails", "section 4, Fig. 7(b)", "adaptive sliding mode does not, because of its"
        " integral", "yes/no", True, lambda r: not recovers(r, "asmc"), scenario="stress",
        loop="asmc", assumption="as above; without anti-windup",
        why="with the limit it fails in the same way: the limit prevents slip, not windup",
    ),
    Claim(
        "limit_misled", "section 4, Fig. 10(c)", "the limit misbehaves at 200 s to 250 s, where the"
        " command is near zero", "yes/no", True, misled, scenario="stress", loop="hosm_limited",
        assumption="it falls below 100 kN on wet rail, where it should be 154 kN",
        why_not="where the curves lie closer than 0.01 the class is kept",
    ),
    Claim(
        "smallest_error", "section 4, Figs 7, 8", "the proposed controller tracks best", "order",
        "asmc > smc > hosm_limited", speed_errors, "m/s", tolerance=0.0, tolerance_why="an order",
        scenario="stress", assumption="the others without the limit, as in the paper",
        why="RMS speed error over the run",
    ),
    Claim(
        "smallest_error_limited", "section 4, Figs 7, 8", "and so it does where every law has the"
        " limit", "order", "asmc > smc > hosm", limited_errors, "m/s", tolerance=0.0,
        tolerance_why="an order", scenario="stress", assumption="as above",
    ),
)  # fmt: skip


# ---- figures -------------------------------------------------------------------------------------


def clock(r: Results, scenario: str, loop: str) -> tuple[Any, np.ndarray]:
    """Log of a run and its times in s of the paper's run."""
    log = r.log(scenario, loop)
    return log, log["time"].values + begin(r)


def limit_at_work(r: Results) -> Any:
    """Adhesion limit and command around the ice and the oil, with what the rail carries."""
    fig, axes = plots.panels(2, 1, height=2.3)
    log, t = clock(r, "stress", "hosm_limited")
    inside = (t >= 113.0) & (t < 125.0)
    v = log["plant.train.v"].values
    speeds = np.linspace(1, 80, 80)
    W, g, n = 15625.0, 9.8, 10
    carried = np.zeros(t.size)
    for (name, a), b in zip(RAIL, [*(a for _, a in RAIL[1:]), 1e9], strict=True):
        heights = np.interp(v, speeds, [peak(float(s), name).value for s in speeds])
        carried[(t >= a) & (t < b)] = (heights * n * W * g)[(t >= a) & (t < b)]
    traction = np.array([float(tractive_effort(float(s))) for s in v])
    curves = {
        "rail": np.minimum(carried, traction), "limit": log["ctl.limit.F_hi"].values,
        "command": log["ctl.F_contr"].values, "contact": log["plant.train.F_all"].values,
    }  # fmt: skip
    plots.lines(
        {k: (t[inside], y[inside] / 1e3) for k, y in curves.items()}, ("time", "s"),
        ("force of the train", "kN"), axis=axes[0, 0], title="hosm_limited: ice from 115 s, oil"
        " from 120 s",
    )  # fmt: skip
    axes[0, 0].set_ylim(60, 160)
    plots.lines(
        {"creep": (t[inside], KMH * log["worst.highest"].values[inside])}, ("time", "s"),
        ("largest creep", "km/h"), axis=axes[1, 0],
    )  # fmt: skip
    return fig


def tracking(r: Results) -> Any:
    """Speed under the three sliding modes, and its error."""
    fig, axes = plots.panels(2, 1, height=2.3, sharex=True)
    speeds, off = {}, {}
    for name in (*SHOWN, "hosm"):
        log, t = clock(r, "stress", name)
        speeds[name] = (t, log["plant.train.v"].values)
        off[name] = (t, log["plant.train.v"].values - log["v_d"].values)
    axes[0, 0].plot(t, log["v_d"].values, color=plots.GREY, lw=0.9, label="target")
    plots.lines(speeds, ("time", "s"), ("train speed", "m/s"), axis=axes[0, 0])
    plots.lines(off, ("time", "s"), ("speed error", "m/s"), axis=axes[1, 0], legend=False)
    return fig


def displacement(r: Results) -> Any:
    """Position error under the three sliding modes, each with and without the limit."""
    fig, axes = plots.panels(1, 2, height=2.8)
    for axis, ending in zip(axes[0], ("", "_limited"), strict=True):
        off = {}
        for name in SLIDING:
            log, t = clock(r, "stress", name + ending)
            off[name] = (t, log["plant.train.x"].values - log["x_d"].values)
        title = "with the limit" if ending else "without the limit"
        plots.lines(off, ("time", "s"), ("position error", "m"), axis=axis, title=title)
    return fig


def creeps(r: Results) -> Any:
    """Creep without and with the limit."""
    fig, axes = plots.panels(2, 1, height=2.3, sharex=True)
    for axis, ending in zip(axes[:, 0], ("", "_limited"), strict=True):
        curves = {}
        for name in SLIDING:
            log, t = clock(r, "stress", name + ending)
            curves[name] = (t, KMH * log["worst.creep"].values)
        title = "with the limit, and the paper's band" if ending else "without the limit"
        plots.lines(curves, ("time", "s"), ("creep", "km/h"), axis=axis, title=title)
    for edge in BAND:
        axes[1, 0].axhline(KMH * edge, color=plots.GREY, lw=0.8, ls=(0, (4, 2)))
    return fig


def outputs(r: Results) -> Any:
    """Commands without and with the limit."""
    fig, axes = plots.panels(2, 1, height=2.3, sharex=True)
    for axis, ending in zip(axes[:, 0], ("", "_limited"), strict=True):
        curves = {}
        for name in SLIDING:
            log, t = clock(r, "stress", name + ending)
            curves[name] = (t, log["ctl.F_contr"].values / 1e3)
        title = "with the limit" if ending else "without the limit"
        plots.lines(curves, ("time", "s"), ("commanded force", "kN"), axis=axis, title=title)
    return fig


def by_place(r: Results) -> Any:
    """Ice by place under traction and under the brake: creep and speed, 32 axles."""
    return plots.traces(
        r, "position", ("hosm", "hosm_limited"),
        ("worst.creep", ("plant.train.v", "v_d"), "ctl.F_contr"),
        limits={"worst.creep": (-3.0, 6.0)},
        labels={"worst.creep": "creep", "ctl.F_contr": "force"},
    )  # fmt: skip


def compensation(r: Results) -> Any:
    """Sliding variable and position error with and without saturation compensation."""
    fig, axes = plots.panels(2, 1, height=2.3, sharex=True)
    s, off = {}, {}
    for name in ("hosm_limited", "hosm_limited_uncompensated"):
        log, t = clock(r, "stress", name)
        what = "not compensated" if name.endswith("uncompensated") else "compensated"
        s[what] = (t, log["ctl.strategy.law.s"].values)
        off[what] = (t, log["plant.train.x"].values - log["x_d"].values)
    plots.lines(s, ("time", "s"), ("sliding variable", "m/s"), axis=axes[0, 0])
    plots.lines(off, ("time", "s"), ("position error", "m"), axis=axes[1, 0], legend=False)
    return fig


FIGURES = {
    "fig02": Figure("Adhesion on dry rail at several speeds.", contact.dry_curves, "Fig. 2"),
    "fig03": Figure("Typical surfaces, and their peaks.", contact.surface_curves, "Fig. 3"),
    "fig04": Figure(
        "The limit at work: it follows the next poorer surface, on ice 0.9 of its own peak.",
        limit_at_work, "Fig. 4",
    ),
    "fig07": Figure("Speed and its error, stress.", tracking, "Fig. 7"),
    "fig08": Figure("Position error, stress.", displacement, "Fig. 8"),
    "fig09": Figure("Creep, stress.", creeps, "Fig. 9"),
    "fig10": Figure("Commanded force, stress.", outputs, "Fig. 10"),
    "position": Figure("Ice by place: creep (cut off), speed, command.", by_place),
    "compensation": Figure("What the saturation compensation does.", compensation),
    "fit": Figure(
        "Polach's law fitted to a curve of CONTACT, with and without k_A >= k_S.",
        contact.fitted_curves,
    ),
}  # fmt: skip

study = Study(
    name="hst_traction",
    title="Anti-slip control of a high-speed train",
    source="Wang, Zhang, Wang, Cao: Research on Active Anti-Slip Control of High-Speed Trains Based"
    " on High-Order Sliding Mode, Appl. Sci. 2025, 15, 3909",
    doc="What prevents slip, the limit or the law? How fast and how honest is the observer? What do"
    " the gains of the higher-order sliding mode hold, and what does the run ask of them?",
    models=MODELS,
    cases=cases,
    signals=Signals(
        speed="plant.train.v", position="plant.train.x", slip="worst.creep",
        torque="ctl.F_contr", deceleration="plant.train.a",
        wanted_speed="v_d", wanted_position="x_d",
    ),
    experiments=experiments.EXPERIMENTS | contact.EXPERIMENTS | lost.EXPERIMENTS,
    claims=CLAIMS,
    figures=FIGURES,
    gains=GAINS,
)  # fmt: skip
