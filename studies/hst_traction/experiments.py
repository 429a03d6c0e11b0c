"""Experiments of the study ``hst_traction``: what is no loop in a scenario."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from slipctl import Block, Context, Experiment, Rail, Scenario, Section, Table, simulate
from slipctl.models.motors import vector_drive
from slipctl.models.wang_2025 import hst_traction_adhesion as adhesion
from slipctl.models.wang_2025 import hst_traction_control as control
from slipctl.models.wang_2025.certificate import adhesion_observer as observer_bounds
from slipctl.models.wang_2025.certificate import higher_order as proofs
from slipctl.models.wang_2025.hst_traction import DISTINCT
from slipctl.models.wheel_rail.contact import peak
from slipctl.studies.hst_traction.loops import (
    NAMES,
    H,
    loop,
    rail_by_time,
    shaped_target,
    target,
)

J, R, W, G, M = 93.75, 0.445, 15625.0, 9.8, 500e3
BY_MU = J / (R * W * G)
"""Adhesion per rad/s^2 of f = -r F/J."""

ICE = 115.0
"""When the ice begins, in s."""


def window(
    models: Mapping[str, Any], law: Block, limited: bool, start: float, length: float,
    log: tuple[str, ...], compile: bool = True, every: int = 1, kappa: float = 0.85, **how: Any,
) -> tuple[Any, np.ndarray]:  # fmt: skip
    """Run a loop on a piece of the target; gives the log and the loop's times in s."""
    wanted = target(kappa)
    scenario = Scenario(
        "window", length, rail_by_time(start), inputs=wanted.feeds(start), start=wanted.at(start)
    )
    block = loop(models, law, limited, **how)
    has = {s.name for s in block.signals}
    found = simulate(
        block, scenario, compile=compile, log=[n for n in log if n in has], every=every
    )
    return found, found["time"].values + start


# ---- observer and its gains ----------------------------------------------------------------------


def observed(block: Block, T: float, amplitude: float = 100.0, w: float = 15.0) -> np.ndarray:
    """Error of the observed adhesion, f = amplitude sin wt, after the start."""
    ticks = round(3.0 / T)
    t = np.arange(ticks) * T
    block = block.with_params(T_o=T, B_t=0.0)
    omega = 100 + amplitude / w * (1 - np.cos(w * t))
    x = block.pack("state", block.start(z1=100.0))
    p = block.pack("param", block.param_values())
    u = np.vstack([omega, np.zeros(ticks)])
    y = np.array(block.f.mapaccum(ticks)(x, u, ca.repmat(p, 1, ticks))[1]).ravel()
    return (y + BY_MU * amplitude * np.sin(w * t))[ticks // 3 :]


def observer(context: Context) -> dict[str, Table]:
    """Errors of the sampled forms, and what each gain test says."""
    steps = (5e-3, 1e-3, 1e-4) if context.quick else (5e-3, 1e-3, 1e-4, 1e-5)
    forms = {
        "explicit Euler": adhesion.adhesion_observer("explicit"),
        "implicit": adhesion.adhesion_observer(),
        "linear": adhesion.linear_observer,
    }
    rows = [(name, T, observed(block, T)) for name, block in forms.items() for T in steps]
    sampled = Table(
        "Observed adhesion, |f'| up to 1500 rad/s^3",
        {
            "observer": ("", [n for n, _, _ in rows]),
            "sample period": ("ms", [1e3 * T for _, T, _ in rows]),
            "rms error": ("1", [float(np.sqrt(np.mean(e**2))) for *_, e in rows]),
            "largest error": ("1", [float(np.abs(e).max()) for *_, e in rows]),
            "bound": ("1", [BY_MU * observer_bounds.implicit_error(1500.0, T)
                            if n == "implicit" else None for n, T, _ in rows]),
        },
        "Both robust forms err in proportion to the period; the implicit one does not chatter and"
        " gives the mean over the last tick, within L T/2. The linear observer does not gain.",
    )  # fmt: skip
    p = adhesion.adhesion_observer().param_values()
    K1, K2, L = float(p["K_1"]), float(p["K_2"]), adhesion.SLOPE
    root = math.sqrt(L)
    gains = [
        ("exact: q(K1, K2/2, L) < 1", observer_bounds.smallest_K1(K2, L),
         observer_bounds.exact(K1, K2, L)),
        ("H-infinity, two branches", math.sqrt(2 * (K2 - math.sqrt(K2**2 - 4 * L**2))),
         observer_bounds.h_infinity(K1, K2, L)),
        ("root form, K1 > sqrt(2 K2)", math.sqrt(2 * K2), observer_bounds.root_form(K1, K2, L)),
        ("as printed, K1 > 2 K2", 2 * K2, observer_bounds.printed_verdict(K1, K2, L)),
    ]  # fmt: skip
    jump = 80.0  # mu by 0.11, dry to ice under traction
    tests = Table(
        "Gain tests of Theorem 1 for K2 = 2.2 L, L = 2000 rad/s^3",
        {
            "test": ("", [n for n, _, _ in gains]),
            "smallest K1": ("1/s^1.5", [k for _, k, _ in gains]),
            "smallest K1 / sqrt(L)": ("1", [k / root for _, k, _ in gains]),
            "accepts our K1": ("", [ok for *_, ok in gains]),
        },
        f"Ours is K1 = {K1:.1f}, K2 = {K2:.0f}; it holds L up to"
        f" {observer_bounds.largest_slope(K1, K2):.0f} rad/s^3. After a jump of 0.11 in mu the"
        f" error is gone within {observer_bounds.convergence_time(K1, K2, 1500.0, 0, jump):.3f} s"
        f" at |f'| < 1500 by the unit-free bound. It is within"
        f" {observer_bounds.convergence_time_printed(K1, K2, 1500.0, 0, jump):.0f} s by the printed"
        " one from the same matrix.",
    )
    return {"sampled": sampled, "tests": tests}


# ---- gains of the sliding mode -------------------------------------------------------------------


def gains(context: Context) -> Table:
    """What each proof of the higher-order sliding mode holds, printed gains and closed form."""
    rows: dict[str, list[Any]] = {
        k: [] for k in ("gains", "k4", "alpha", "beta", "eta", "any", "exact", "weighted")
    }
    chosen = [("printed, Table 5", 0.25, 0.02, 0.09)]
    for k4 in (0.25, proofs.smallest_k4(control.ETA), 1.0, proofs.smallest_k4(0.5)):
        chosen.append(("closed-form optimum", k4, *proofs.best(k4)[:2]))
    chosen.append(("printed alpha and beta", proofs.smallest_gain(0.02, 0.09, 0.05), 0.02, 0.09))
    for name, k4, alpha, beta in chosen:
        k2 = 2 * beta * k4
        values = (name, k4, alpha, beta, proofs.certified_eta(alpha, beta, k4),
                  proofs.quadratic_eta(k4, k2), proofs.exact_eta(k4, k2),
                  proofs.best_weighted(k4)[2])  # fmt: skip
        for key, value in zip(rows, values, strict=True):
            rows[key].append(value)
    return Table(
        "Largest |delta'|/M that is held",
        {
            "gains": ("", rows["gains"]),
            "k4": ("1/s", rows["k4"]),
            "alpha": ("1/s^2", rows["alpha"]),
            "beta": ("1/s", rows["beta"]),
            "eta by (49)": ("m/s^3", rows["eta"]),
            "eta by any quadratic function": ("m/s^3", rows["any"]),
            "eta, exact": ("m/s^3", rows["exact"]),
            "eta at this k4 with the best weight": ("m/s^3", rows["weighted"]),
        },
        "(49) uses Young's inequality with the weight 1, so its number depends on the unit of"
        " length; the exact limit is that of the continuous law.",
    )


DRY = (60.0, 115.0)
"""Part of the run in s on dry rail over which the slope of delta is taken, here and by certify."""


def slopes(
    models: Mapping[str, Any], law: Block, start: float, end: float, compile: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """Times in s and |delta'|/M in m/s^3 of a law with the limit, by its periods."""
    log, t = window(
        models, law, True, start, end - start, ("ctl.F_contr", "plant.train.F_all"), compile,
        every=5,
    )  # fmt: skip
    delta = (log["ctl.F_contr"].values - log["plant.train.F_all"].values) / M
    return t[:-1], np.abs(np.diff(delta)) / control.T_C


def certified(context: Context) -> Table:
    """Eta by the proof beside the eta that the run has, over the controller's periods."""
    names = {
        "hosm_limited": control.higher_order(),
        "hosm_limited_printed": control.higher_order("printed"),
        "pid_limited": control.pid,
        "robust_limited": control.robust,
    }
    spans = {"dry, 60 s to 115 s": DRY, "ice and oil, 115 s to 150 s": (115.0, 150.0)}
    start, end = (100.0, 125.0) if context.quick else (50.0, 150.0)
    rows: dict[str, list[Any]] = {k: [] for k in ("loop", "span", "proof", "half", "most", "top")}
    for count, (name, law) in enumerate(names.items()):
        t, slope = slopes(context.models, law, start, end, context.compile)
        proof = None
        if name.startswith("hosm"):
            p = {k: float(v) for k, v in law.param_values().items()}
            proof = proofs.certified_eta(p["alpha"], p["beta"], p["k_4"])
        for span, (a, b) in spans.items():
            inside = slope[(t >= max(a, start + 5)) & (t < min(b, end))]
            values = (name, span, proof, float(np.median(inside)),
                      float(np.quantile(inside, 0.999)), float(inside.max()))  # fmt: skip
            for key, value in zip(rows, values, strict=True):
                rows[key].append(value)
        context.progress((count + 1) / len(names))
    return Table(
        "|delta'|/M: proven and met",
        {
            "loop": ("", rows["loop"]),
            "span": ("", rows["span"]),
            "eta by (49)": ("m/s^3", rows["proof"]),
            "median": ("m/s^3", rows["half"]),
            "99.9 % of the time below": ("m/s^3", rows["most"]),
            "largest": ("m/s^3", rows["top"]),
        },
        "delta contains what motor and limit keep back from the command, so it depends on the"
        " command itself: the sliding mode meets the slopes that it makes. A jump of the rail is no"
        " bounded slope, and no gain covers it.",
    )


# ---- saturation ----------------------------------------------------------------------------------


def saturation(context: Context) -> Table:
    """How much the sliding variable knows of the limit on the whole train."""
    start, length = 105.0, 25.0 if context.quick else 60.0
    log = ("ctl.strategy.law.s", "ctl.F_contr", "plant.train.F_all", "ctl.strategy.law.k_1H")
    runs = {
        "limited, compensated": (control.higher_order(), True),
        "limited, not compensated": (control.higher_order(compensation=False), True),
        "not limited": (control.higher_order(), False),
    }
    rows: dict[str, list[Any]] = {k: [] for k in ("run", "s", "ice", "gain", "delta")}
    for name, (law, limited) in runs.items():
        found, t = window(
            context.models, law, limited, start, length, log, context.compile, every=5
        )
        s = np.abs(found["ctl.strategy.law.s"].values)
        delta = (found["ctl.F_contr"].values - found["plant.train.F_all"].values) / M
        ice = (t >= ICE) & (t < ICE + 5)
        before = (t >= ICE - 5) & (t < ICE)
        values = (name, float(s[before].max()), float(s[t >= ICE].max()),
                  float(found["ctl.strategy.law.k_1H"].values.max()),
                  float(np.ptp(delta[ice])))  # fmt: skip
        for key, value in zip(rows, values, strict=True):
            rows[key].append(value)
    return Table(
        "Sliding variable of hosm on the train, target at 0.85",
        {
            "run": ("", rows["run"]),
            "largest abs(s), 110 s to 115 s": ("m/s", rows["s"]),
            "largest abs(s) from 115 s on": ("m/s", rows["ice"]),
            "largest gain k_1H": ("1/s", rows["gain"]),
            "range of delta/M on ice": ("m/s^2", rows["delta"]),
        },
        "On the reduced train (15) with a prescribed delta, s is the same with and without a limit"
        " to rounding (tests). On the train delta is what the rail does not take of the command, so"
        " it depends on the limit, and s with it.",
    )


# ---- response ------------------------------------------------------------------------------------


def response(context: Context) -> Table:
    """From the ice to the first change of the command, and to 90 % of its change."""
    rows: dict[str, list[Any]] = {k: [] for k in ("law", "first", "most", "creep", "after")}
    for count, name in enumerate(NAMES):
        log, _ = window(
            context.models, context.models[name], True, ICE - 5, 8.0,
            ("ctl.F_contr", "ctl.limit.F_hi", "worst.highest"), context.compile,
        )  # fmt: skip
        F = log["ctl.F_contr"].values
        k = round(5.0 / H)
        before, end = F[k], float(np.mean(F[k + 300 : k + 500]))
        first = np.flatnonzero(F[k:] < F[k - 1000 : k].min() - 500.0)
        most = np.flatnonzero(np.abs(F[k:] - before) >= 0.9 * abs(end - before))
        creep = log["worst.highest"].values
        values = (name, _ms(first), _ms(most), 3.6 * float(creep[k : k + 2900].max()),
                  float((before - end) / 1e3))  # fmt: skip
        for key, value in zip(rows, values, strict=True):
            rows[key].append(value)
        context.progress((count + 1) / len(NAMES))
    return Table(
        "Response to the ice at 115 s, with the limit, target at 0.85",
        {
            "law": ("", rows["law"]),
            "first change of the command after": ("ms", rows["first"]),
            "90 % of the change after": ("ms", rows["most"]),
            "largest creep": ("km/h", rows["creep"]),
            "change of the command": ("kN", rows["after"]),
        },
        "The limit does it, not the law: observers and limit run every 1 ms, laws every 5 ms. The"
        " motor follows with its lag of 50 ms.",
    )


def _ms(ticks: np.ndarray) -> float | None:
    return float(ticks[0] * H * 1e3) if len(ticks) else None


# ---- what the motor's lag leaves out -------------------------------------------------------------


def motors(context: Context) -> Table:
    """The lag of 50 ms beside an induction motor with vector control, one window around the ice."""
    start, length = (ICE - 1.0, 3.0) if context.quick else (ICE - 3.0, 10.0)
    speed = target(0.85).at(start)["plant.train.v"]
    kinds = {
        "lag of 50 ms": (None, H),
        "vector control": (vector_drive(speed), 1e-4),
    }
    rows: dict[str, list[Any]] = {k: [] for k in ("motor", "rise", "creep", "low", "slope", "rms")}
    for count, (name, (drive, h)) in enumerate(kinds.items()):
        log, t = window(
            context.models, control.higher_order(), True, start, length,
            ("ctl.F_contr", "plant.motor.T", "plant.train.v_s_max", "plant.train.F_all"),
            context.compile, motors=drive, h=h,
        )  # fmt: skip
        F, T = log["ctl.F_contr"].values, log["plant.motor.T"].values.reshape(len(t), -1)[:, 0]
        k = int(np.searchsorted(t, ICE))
        cut = k + int(np.flatnonzero(F[k:] < F[k - round(0.5 / h) : k].min() - 500.0)[0])
        last = cut + round(0.6 / h)
        end = float(T[last - round(0.05 / h) : last].mean())
        fallen = np.flatnonzero(T[cut:last] <= T[cut] + 0.632 * (end - T[cut]))
        calm = slice(k - round(0.9 / h), k)
        delta = (F - log["plant.train.F_all"].values)[calm] / M
        stride = round(control.T_C / h)
        values = (
            name, float(fallen[0] * h * 1e3), 3.6 * float(log["plant.train.v_s_max"].values.max()),
            float(T[cut:last].min() - end),
            float(np.median(np.abs(np.diff(delta[::stride]))) / control.T_C),
            float(np.std(F[calm]) / 1e3),
        )  # fmt: skip
        for key, value in zip(rows, values, strict=True):
            rows[key].append(value)
        context.progress((count + 1) / len(kinds))
    return Table(
        "hosm with the limit on ice, target at 0.85",
        {
            "motor": ("", rows["motor"]),
            "63 % of the cut in torque after": ("ms", rows["rise"]),
            "largest creep": ("km/h", rows["creep"]),
            "torque below its later value": ("N m", rows["low"]),
            "median abs(delta')/M before the ice": ("m/s^3", rows["slope"]),
            "scatter of the command before the ice": ("kN", rows["rms"]),
        },
        "The times count from the cut of the command. Current loops of 100 Hz follow in"
        " milliseconds: the lag is what lets the wheel slip further, and what the sliding mode"
        " chatters through. The lag leaves out currents, voltage limit and flux; with it the"
        " results are on the safe side.",
    )


# ---- adhesion lost and regained by place ---------------------------------------------------------


def patch(begin: float = 60.0, length: float = 200.0) -> Rail:
    """Dry rail with a patch of ice, by position in m."""
    return Rail(
        [Section(0.0, "dry"), Section(begin, "ice"), Section(begin + length, "dry")], by="position"
    )


def braked(
    context: Context, a: float, limited: bool, v: float = 30.0, law: Block | None = None
) -> dict[str, float | None]:
    """Brake onto a patch of ice at a deceleration; extremes of the creep, and time beyond the peak.

    Args:
        context: of the experiment.
        a: deceleration in m/s^2. limited: with the anti-slip limit. v: speed in m/s.
        law: control law, by default the robust one.
    """
    duration = 14.0
    wanted = shaped_target(v, ((0.0, -a),), duration)
    rail = patch(begin=v * 4.0)
    scenario = Scenario("braked", duration, rail, inputs=wanted.feeds(), start={"plant.train.v": v})
    block = loop(context.models, law or control.robust, limited, axles=DISTINCT)
    log = simulate(
        block, scenario, compile=context.compile,
        log=["plant.train.v", "plant.train.v_s_min", "plant.train.x"],
    )  # fmt: skip
    speed, creep = log["plant.train.v"].values, log["plant.train.v_s_min"].values
    at = np.linspace(0.5, v + 1, 60)
    tops = np.interp(speed, at, [peak(float(s), "ice").location for s in at])
    moving = speed > 3.0
    beyond = np.flatnonzero((creep < -tops) & moving)
    x = log["plant.train.x"].values
    return {
        "creep": float(creep[moving].min()),
        "share": float((-creep / tops)[moving].max()),
        "time": float(len(beyond) * H),
        "recovered": float((beyond[-1] - beyond[0]) * H) if len(beyond) else 0.0,
        "slipping": bool(len(beyond) and beyond[-1] >= np.flatnonzero(moving)[-1] - 5),
        "distance": float(x[-1]),
    }


def position(context: Context) -> dict[str, Table]:
    """Braking onto ice: how much deceleration the limit and a brake of 0.4 s lag hold."""
    rates = (0.4, 0.6, 0.8) if context.quick else (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
    rows: dict[str, list[Any]] = {
        k: [] for k in ("a", "limited", "creep", "share", "beyond", "recovery", "distance")
    }
    for count, a in enumerate(rates):
        for limited in (False, True):
            found = braked(context, a, limited)
            recovered = None if found["slipping"] else found["recovered"]
            values = (a, limited, found["creep"], found["share"], found["time"], recovered,
                      found["distance"])  # fmt: skip
            for key, value in zip(rows, values, strict=True):
                rows[key].append(value)
        context.progress(0.6 * (count + 1) / len(rates))
    sweep = Table(
        "Brake onto 200 m of ice from 30 m/s, 32 axles, brakes with 0.4 s of lag",
        {
            "deceleration": ("m/s^2", rows["a"]),
            "with the limit": ("", rows["limited"]),
            "lowest creep": ("m/s", rows["creep"]),
            "creep by that of the peak": ("1", rows["share"]),
            "time beyond the peak": ("s", rows["beyond"]),
            "from first to last time beyond it": ("s", rows["recovery"]),
            "distance in 14 s": ("m", rows["distance"]),
        },
        "Law: robust. The whole train brakes by what its poorest observed axle may use.",
    )
    edges = []
    for limited in (False, True):
        low, high = 0.2, 0.9
        for _ in range(4 if context.quick else 6):
            middle = (low + high) / 2
            fine = braked(context, middle, limited)["share"] < 1.0  # type: ignore[operator]
            low, high = (middle, high) if fine else (low, middle)
        edges.append(low)
    carried = peak(30.0, "ice").value * G
    edge = Table(
        "Largest deceleration at which the creep stays below the peak",
        {
            "with the limit": ("", [False, True]),
            "deceleration": ("m/s^2", edges),
            "share of what ice carries": ("1", [a / carried for a in edges]),
        },
        f"Ice carries {carried:.3f} m/s^2 at 30 m/s. By bisection between 0.2 and 0.9 m/s^2; the"
        " brakes give no more than 0.93.",
    )
    return {"sweep": sweep, "edge": edge}


EXPERIMENTS = {
    "observer": Experiment("Observer", observer, "How good is it sampled, what holds its gains?"),
    "gains": Experiment("Gains", gains, "How much slope of delta do the gains hold?"),
    "certified": Experiment("Certified eta", certified, "And how much does the run have?"),
    "saturation": Experiment("Saturation", saturation, "Does s know of the limit?"),
    "response": Experiment("Response", response, "When does the command change on ice?"),
    "motors": Experiment("Motors", motors, "What does the motor's lag leave out?"),
    "position": Experiment("Position", position, "How hard may a train brake onto ice?"),
}
