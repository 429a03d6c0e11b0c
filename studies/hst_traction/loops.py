"""Loops, targets, rails and scenarios of the study ``hst_traction``."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from functools import lru_cache, partial
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from casadi import fabs, fmax, fmin, if_else

from slipctl import (
    BadInput,
    Block,
    Case,
    Input,
    Output,
    Rail,
    Scenario,
    Section,
    State,
    connect,
    every,
    law,
    replicate,
    step,
)
from slipctl.models import converters
from slipctl.models.wang_2025 import hst_traction_adhesion as adhesion
from slipctl.models.wang_2025 import hst_traction_control as control
from slipctl.models.wang_2025.hst_traction import (
    DISTINCT,
    GROUPED,
    M_EFF,
    check_target,
    motor,
    plant,
    resistance,
    tractive_effort,
)
from slipctl.models.wheel_rail.axles import Axles
from slipctl.models.wheel_rail.contact import polach
from slipctl.run.results import Loops

log = logging.getLogger("slipctl")

FITS = 0.01
"""Share of the mass by which the loads of the axles may differ from it."""

H = 1e-3
"""Tick of every loop in s."""

ROW = 10
"""Ticks from one row of a log to the next."""

DURATION = 533.0
"""Length of the paper's run in s."""

RAIL = (("dry", 0.0), ("ice", 115.0), ("oily", 120.0), ("wet", 170.0), ("damp", 320.0))
"""Surfaces and when each begins in s; Wang 2025, Table 2."""

POSITION = ((0.0, 0.2), (14.0, -0.6))
"""Times in s and accelerations in m/s^2 of the scenario ``position``."""

PATCHES = (("dry", 0.0), ("ice", 150.0), ("dry", 300.0), ("ice", 600.0), ("dry", 800.0))
"""Surfaces of the scenario ``position`` and where each begins in m."""

CREEP_ERROR = 0.08
"""Largest error in m/s of the creep as the rig measures it: half a step of 24 mm/s and three
standard deviations of the noise, of train speed and of rim speed together."""

BAND = (-0.2, 0.8)
"""Creep in m/s that the paper gives for its controller: -0.72 to 2.88 km/h."""

NAMES = ("hosm", "smc", "asmc", "mpc", "robust", "pid")

MODELS: dict[str, Any] = {"adh": polach, "observer": adhesion.adhesion_observer(), **control.laws()}


# ---- target --------------------------------------------------------------------------------------


class Target(NamedTuple):
    """Target over time: times in s, position in m, speed in m/s, acceleration in m/s^2."""

    t: np.ndarray
    x: np.ndarray
    v: np.ndarray
    a: np.ndarray

    def feeds(self, start: float = 0.0) -> dict[str, Any]:
        """Inputs of a loop that begins at ``start`` in s."""
        return {
            f"{n}_d": (lambda t, y=y: np.interp(t + start, self.t, y))
            for n, y in (("x", self.x), ("v", self.v), ("a", self.a))
        }

    def at(self, start: float) -> dict[str, float]:
        """Start values of position and speed of the train."""
        return {
            "plant.train.x": float(np.interp(start, self.t, self.x)),
            "plant.train.v": float(np.interp(start, self.t, self.v)),
        }


@lru_cache(maxsize=8)
def target(kappa: float) -> Target:
    """Target of the paper's run, which it does not give; a guess.

    0.5 m/s^2 or the share kappa of the tractive effort up to 195 s, coasting to 250 s. Then
    constant speed to 370 s, constant deceleration to standstill; two moving means of 4 s.

    Args:
        kappa: share of the tractive effort.
    """
    dt, speeds = 0.05, np.linspace(0.0, 90.0, 9001)
    p = ca.repmat(resistance.pack("param", resistance.param_values()), 1, speeds.size)
    drag = resistance.f.map(speeds.size)(ca.DM(0, speeds.size), speeds[None], p)[1]
    drag = np.array(drag).ravel()
    t = np.arange(round(DURATION / dt) + 1) * dt
    v, held = np.zeros(t.size), 0.0
    for k in range(t.size - 1):
        now = float(v[k])
        F_d = float(np.interp(now, speeds, drag))
        if t[k] < 195:
            a = min(0.5, (kappa * float(tractive_effort(now)) - F_d) / M_EFF)
        elif t[k] < 250:
            a = -F_d / M_EFF
        elif t[k] < 370:
            a, held = 0.0, now
        else:
            a = -held / (DURATION - 370)
        v[k + 1] = max(now + a * dt, 0.0)
    n = round(4.0 / dt)
    mean = np.ones(n) / n
    padded = np.pad(v, n)
    smooth = np.convolve(np.convolve(padded, mean, "same"), mean, "same")[n:-n]
    x = np.concatenate([[0.0], np.cumsum((smooth[1:] + smooth[:-1]) / 2 * dt)])
    wanted = np.gradient(smooth, dt)
    check_target(t, smooth, wanted, f"target({kappa:g})")
    return Target(t, x, smooth, wanted)


def shaped_target(v: float, pieces: tuple[tuple[float, float], ...], duration: float) -> Target:
    """Accelerations that hold from given times on, each change spread over 2 s, not below 0 m/s.

    Args:
        v: speed at the start in m/s.
        pieces: times in s, and accelerations in m/s^2 from then on.
        duration: in s.
    """
    dt = 0.01
    t = np.arange(round(duration / dt) + 1) * dt
    a, before = np.zeros(t.size), 0.0
    for begin, rate in pieces:
        a += (rate - before) * np.clip((t - begin) / 2.0, 0.0, 1.0)
        before = rate
    speed = np.maximum(v + np.concatenate([[0.0], np.cumsum((a[1:] + a[:-1]) / 2 * dt)]), 0.0)
    x = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * dt)])
    wanted = np.where(speed > 0, a, 0.0)
    check_target(t, speed, wanted, "shaped_target")
    return Target(t, x, speed, wanted)


def rail_by_time(start: float = 0.0) -> Rail:
    """Surfaces of Table 2 from ``start`` in s on."""
    ends = [begin for _, begin in RAIL[1:]] + [DURATION]
    left = [(n, a) for (n, a), b in zip(RAIL, ends, strict=True) if b > start]
    return Rail([Section(max(a - start, 0.0), n) for n, a in left])


# ---- loops ---------------------------------------------------------------------------------------


@step(
    creep=Output("m/s", "creep, the one furthest from zero since the last row",
                 positive="traction", per="speed"),
    highest=Output("m/s", "largest creep since the last row", positive="traction", per="speed"),
    lowest=Output("m/s", "smallest creep since the last row", positive="traction", per="speed"),
    name="worst",
)  # fmt: skip
def worst(
    hi=State("m/s", 0.0, "largest so far"),
    lo=State("m/s", 0.0, "smallest so far"),
    k=State("1", 0.0, "ticks since the last row"),
    v_s_max=Input("m/s", "largest creep of an axle", positive="traction", per="speed"),
    v_s_min=Input("m/s", "smallest creep of an axle", positive="traction", per="speed"),
):
    """Extremes of the creep between two rows of the log."""
    top, low = fmax(hi, v_s_max), fmin(lo, v_s_min)
    row = k == 0
    nxt = dict(
        hi=if_else(row, v_s_max, top), lo=if_else(row, v_s_min, low),
        k=if_else(k >= ROW - 1, 0, k + 1),
    )  # fmt: skip
    return nxt, dict(creep=if_else(top > fabs(low), top, low), highest=top, lowest=low)


def net_torque(axles: int) -> Block:
    """Make the torque on the driven axles: motor less brake.

    Args:
        axles: how many.
    """

    @law(T=Output("N m", "torque on the axle", positive="traction", shape=(axles,)), name="net")
    def net(
        T_m=Input("N m", "torque of the motor", positive="traction", shape=(axles,)),
        T_b=Input("N m", "torque of the brake", positive="braking"),
    ):
        """Torque that the observer is told."""
        return T_m - T_b

    return net


SHARES: dict[str, Any] = {
    **{n: f"*.{n}" for n in ("m", "J", "r", "g", "tau", "n_m", "n_b", "F_top", "P_top", "B_t")},
    **{n: ["plant." + n, f"*.res.{n}"] for n in ("w_0", "w_1", "w_2")},
    "v_0": "*.res.v_0",
    "slope": "*.slope",
    "m_axle": ["plant.m_axle", "*.m_axle"],
    "Q = m_axle * g / 2": "*.Q",
    **{n: [f"*.adh.{n}", f"*.curves.{n}"] for n in ("G", "a", "b", "c11", "v_min")},
    "F_max": "*.F_max",
    "F_brake = n_b * F_max": "*.F_brake",
    "v_start": "plant.train.v",
    "omega_start": ["plant.train.omega", "*.omega_start"],
    "p_start": "plant.brake.p",
    "p_max": "plant.brake.p_max",
}
"""Numbers that the parts of a loop have in common."""

_DRIVEN = "fmin(F_m_start, P_top / fmax(r * omega_start, P_top / F_top) / n_m)"
TORQUES = {
    "F_m_start": "plant.motor.F_m",
    f"T_start = r * ({_DRIVEN} - F_max * p_start / p_max)": "*.T_start",
    f"F_start = n_m * {_DRIVEN} - n_b * F_max * p_start / p_max": "*.F_start",
}
"""What motors and brakes give at the start: observers and laws begin with it. A motor with its
currents begins without flux, so without torque."""


_plant = lru_cache(maxsize=4)(plant)
"""The same train in all loops, so that its equations are worked out once."""


def loop(
    models: Mapping[str, Any],
    control_law: Block,
    limited: bool = True,
    axles: Axles = GROUPED,
    motors: Block | None = None,
    observer: Block | None = None,
    rig: bool = False,
    h: float = H,
) -> Block:
    """Closed loop: train, observers, limit and law.

    Args:
        models: the study's models.
        control_law: one of ``hst_traction_control.laws()``.
        limited: with the anti-slip limit.
        axles: ``GROUPED``, or ``DISTINCT`` for a rail by position.
        motors: of the train, by default the lag.
        observer: of the adhesion, by default the study's.
        rig: converters of 12 bit and noise between controller and train; the position is exact.
        h: tick of the train in s, a part of that of the controller, 1 ms.
    """
    n = len(axles.motors)
    ctl = control.controller(control_law, n, limited, observer or models["observer"], models["adh"])
    ctl = ctl if h == H else every(ctl, round(H / h))
    parts = {"plant": _plant(models["adh"], axles, h, motors), "ctl": ctl, "worst": worst}
    wires = {f"ctl.{n}_d": f"{n}_d" for n in "xva"} | {
        "ctl.x": "plant.train.x",
        "ctl.v": "plant.train.v",
        "plant.F_contr": "ctl.F_contr",
        "worst.v_s_max": "plant.train.v_s_max",
        "worst.v_s_min": "plant.train.v_s_min",
    }
    if limited:
        parts["net"] = net_torque(n)
        wires |= {
            "net.T_m": "plant.motor.T",
            "net.T_b": "plant.brake.T_b",
            "ctl.omega": "plant.train.omega_d",
            "ctl.T": "net.T",
        }
    if rig:
        parts["out"], parts["v_in"] = converters.force_output, converters.speed_input
        wires |= {
            "out.u": "ctl.F_contr",
            "plant.F_contr": "out.y",
            "v_in.u": "plant.train.v",
            "ctl.v": "v_in.y",
        }
    if rig and limited:
        parts["omega_in"] = replicate(converters.wheel_input, n)
        parts["T_in"] = replicate(converters.torque_input, n)
        wires |= {
            "omega_in.u": "plant.train.omega_d",
            "ctl.omega": "omega_in.y",
            "T_in.u": "net.T",
            "ctl.T": "T_in.y",
        }
    lagging = "motor.F_m" in parts["plant"].states
    return connect("loop", wires, share=SHARES | (TORQUES if lagging else {}), **parts)


def both(models: Mapping[str, Any], names: tuple[str, ...] = NAMES, **how: Any) -> Loops:
    """Loops of these laws, each without and with the limit."""
    return Loops({
        f"{name}_limited" if limited else name: partial(loop, models, models[name], limited, **how)
        for name in names
        for limited in (False, True)
    })  # fmt: skip


def variants(models: Mapping[str, Any]) -> Loops:
    """Loops in which one thing is left out or as printed."""
    law = control.higher_order
    return Loops({
        "hosm_limited_uncompensated": lambda: loop(models, law(compensation=False)),
        "hosm_limited_printed": lambda: loop(models, law("printed")),
        "hosm_limited_rule": lambda: loop(models, models["hosm"]).with_params(**RULE),
        "smc_motor_printed": lambda: loop(
            models, models["smc"], False, motors=motor("printed-33")
        ),
    })  # fmt: skip


RULE = {"ctl.usable.axle.class.blind": 0.0, "ctl.usable.axle.class.cut": 1.0}
"""Limit by the rule of Fig. 4 alone: a class at any creep, no further cut beyond the peak."""

LOGGED = (
    "x_d", "v_d", "plant.train.x", "plant.train.v", "plant.train.a", "plant.train.F_all",
    "worst.creep", "worst.highest", "worst.lowest", "ctl.F_contr", "ctl.strategy.law.F_wanted",
    "ctl.strategy.law.s", "ctl.strategy.law.k_1H", "ctl.limit.F_hi",
    "ctl.limit.F_lo", "ctl.limit.mu_least",
)  # fmt: skip
"""Signals that are kept of the long runs."""


def cases(models: Mapping[str, Any], quick: bool) -> list[Case]:
    """Scenarios and the loops that run in each.

    Quick, the runs begin 10 s before the ice and end 20 s after it.
    """
    start, length = (105.0, 30.0) if quick else (0.0, DURATION)
    pairs = both(models)

    def scenario(name: str, kappa: float, doc: str, **how: Any) -> Scenario:
        wanted = target(kappa)
        return Scenario(
            name, length, rail_by_time(start), inputs=wanted.feeds(start), start=wanted.at(start),
            doc=doc, **how,
        )  # fmt: skip

    base = scenario("base", 0.5, "target at half of the tractive effort")
    stress = scenario("stress", 0.85, "target at 0.85 of the tractive effort")
    real = scenario("real", 0.85, "stress, with converters of 12 bit and noise")
    some = ("hosm", "pid") if quick else NAMES
    rig = Loops({f"{n}_limited": partial(loop, models, models[n], rig=True) for n in some})
    rig = rig.each(lambda block: block.with_params(**{"ctl.usable.axle.class.least": CREEP_ERROR}))
    wanted = shaped_target(30.0, POSITION, 40.0)
    position = Scenario(
        "position", 20.0 if quick else 40.0, Rail([Section(x, n) for n, x in PATCHES], "position"),
        inputs=wanted.feeds(), start={"plant.train.v": 30.0},
        doc="32 axles, ice by place: under traction, and under the brake",
    )  # fmt: skip
    placed = both(models, ("hosm",) if quick else ("hosm", "pid"), axles=DISTINCT)
    return [
        Case(base, pairs.only(*(k for k in pairs if not quick or "hosm" in k)), log=LOGGED,
             every=ROW),
        Case(stress, pairs | variants(models), log=LOGGED, every=ROW),
        Case(position, placed, log=LOGGED, every=ROW),
        Case(real, rig, log=LOGGED, every=ROW),
    ]  # fmt: skip


def check(name: str, loop: Block, scenario: Scenario) -> None:
    """Refuse or warn of numbers of the train that do not fit together, before anything runs.

    Raises:
        BadInput: counts that are not those of the axles that the train was built of.
    """
    p = loop.values_by_place()
    axles = loop["plant.train"].choices["axles"]
    count = np.ravel(np.asarray(p["plant.train.count"], dtype=float))
    load = np.broadcast_to(np.asarray(p["plant.train.m_axle"], dtype=float), count.shape)
    where = f"{scenario.name}/{name}: plant.train"
    if count.sum() != axles:
        given = " + ".join(f"{c:g}" for c in count[:3]) + (" + ..." if len(count) > 3 else "")
        raise BadInput(
            f"{where}.count = {given} makes {count.sum():g} axles of a train of {axles}; its sum"
            f" must stay {axles}, and another train is made by Axles(...)"
        )
    m, carried = float(np.ravel(p["plant.train.m"])[0]), float(count @ load)
    if abs(carried - m) > FITS * m:
        log.warning(
            "%s.m = %g kg, but its %d axles carry %g kg; m_axle = %g kg would fit", where, m,
            axles, carried, m / axles,
        )  # fmt: skip
