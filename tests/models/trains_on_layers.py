"""Trains of practice on a rail that remembers: what the reference cases are, in one place."""

from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

from slipctl import End, Input, Output, Param, Scenario, State, connect, law, make_block
from slipctl.models.wheel_rail.axles import Axles, rolling
from slipctl.models.wheel_rail.falling_creep import falling_creep
from slipctl.models.wheel_rail.rail_memory import Cells, blended_law, rail_field
from slipctl.run.preparation import prepare

G, LOAD = 9.81, 12e3
"""Gravity in m/s^2, and the mass in kg that each axle carries."""

LEAVES = {"mu_0": 0.04, "A": 0.7, "B": 0.2}


def places(cars, length=20.0):
    """Axles of cars with two bogies, behind the first one in m."""
    return tuple(length * k + d for k in range(cars) for d in (0.0, 2.0, 14.0, 16.0))


@law(F_d=Output("N", "running resistance", positive="braking"))
def resistance(v=Input("m/s", "speed"), m=Param("kg", 48e3, "train")):
    """m (d0 + d2 v^2), of a train that moves."""
    return m * (0.012 * ca.sign(v) + 2e-5 * v * v)


def pressure(times, top=3.8, kf=0.44, supply=5 + 1.013):
    """Pressure in bar(g) of an isothermal cylinder that fills through an orifice, from 0."""
    critical, kappa = 0.52828, 1.4

    def flow(r):
        return np.sqrt(max(r ** (2 / kappa) - r ** ((kappa + 1) / kappa), 0.0))

    def rate(t, p):
        r = p[0] / supply
        return [kf * supply * (1.0 if r <= critical else flow(r) / flow(critical))]

    def full(t, p):
        return p[0] - 1.013 - top

    full.terminal = True
    found = solve_ivp(rate, (0, 60), [1.013], events=full, dense_output=True, max_step=0.01,
                      rtol=1e-10, atol=1e-10)  # fmt: skip
    end = found.t_events[0][0]
    return np.where(times < end, found.sol(np.minimum(times, end))[0] - 1.013, top)


@dataclass
class Stop:
    """What a run came to: places, times and heats in SI, and the energy books' differences."""

    way: float
    time: float
    heat: float
    locked: np.ndarray
    field_error: float
    train_error: float


def braked(behind, demand, tau, stretch=None, layer=LEAVES, v0=25.0, cell=0.25, h=1e-3):
    """Stop of a train whose cylinders fill, without slide protection."""
    n = len(behind)
    train = rolling(
        blended_law(falling_creep.with_params(**layer), falling_creep),
        Axles((1,) * n, behind, (False,) * n), h, apart=["T_b"], standing=True,
    ).with_params(m=LOAD * n, m_axle=LOAD, J=473.0, r=1.0, g=G, B_t=0.0, v=v0)  # fmt: skip
    field = rail_field(Cells(behind, cell), h).with_params(tau=tau)
    if stretch:
        field = field.with_params(start=[stretch[0]], end=[stretch[1]])
    wires = {"field.at": "train.at", "field.way": "train.way", "field.P": "train.P_contact",
             "train.recovered": "field.recovered", "train.height": "field.height",
             "res.v": "train.v", "train.F_d": "res.F_d"}  # fmt: skip
    loop = connect("loop", wires, share={"m": "*.m"}, train=train, field=field, res=resistance)
    by_pressure = 12000 * demand / 3.8

    def torque(t):
        return np.repeat((by_pressure * pressure(t + h))[:, None], n, axis=1)

    scenario = Scenario("stop", 70.0, inputs={"train.T_b": torque}, end=End("train.v", below=1e-3))
    powers = [f"train.P_{name}" for name in ("slip", "brake", "d", "bearing")]
    names = ["train.x", "train.v", "train.omega", "field.E_rail", *powers]
    log = prepare(loop, scenario, log=names)()
    v, omega = log["train.v"], log["train.omega"]
    kinetic = LOAD * n * v**2 / 2 + 473.0 * (omega**2).sum(axis=1) / 2
    taken = sum(log[name][:-1].sum() * h for name in powers)
    heat = log["train.P_slip"][:-1].sum() * h
    return Stop(
        log["train.x"][-1], log["time"][-1], heat,
        ((omega == 0) & (v[:, None] > 0.3)).sum(axis=0) * h,
        log["field.E_rail"][-1] / heat - 1, (kinetic[0] - kinetic[-1]) / taken - 1,
    )  # fmt: skip


def greedy(law_):
    """Slip ratio, up to 0.3, at which a law has its peak, of speed and share: a Function.

    The best of 60 ratios, then the vertex of the parabola through it and its neighbours, twice.
    """
    v, share = ca.SX.sym("v"), ca.SX.sym("share")

    def force(e):
        u = {"v_s": -e * v, "v": v, "recovered": share, "height": 1.0}
        return -law_.expr({}, u, law_.param_values())[1]["mu"]

    steps = np.geomspace(1e-4, 0.3, 60)
    heights = [force(e) for e in steps]
    best, height = ca.SX(steps[0]), heights[0]
    for e, f in zip(steps[1:], heights[1:], strict=True):
        best, height = ca.if_else(f > height, e, best), ca.fmax(f, height)
    for width in (0.05, 0.005):
        low, middle, high = (force(best * (1 + k * width)) for k in (-1, 0, 1))
        bend = low - 2 * middle + high
        best = best * (1 + ca.if_else(bend < 0, width * (low - high) / 2 / bend, 0))
    return ca.Function("greedy", [v, share], [ca.fmin(best, 0.3)])


def slipping(
    law_, behind, slip, tau, v0=25.0, load=LOAD * G / 2, drag=True, cap=1.2 / G, cell=0.25, h=1e-3
):
    """Stopping distance of a train whose slip ratios are given: numbers, or ``greedy``."""
    n = len(behind)
    best = greedy(law_) if isinstance(slip, str) else None

    def body(x, u, p):
        v, share = x["v"], u["recovered"]
        rows = []
        for k in range(n):
            e = best(v, share[k]) if best is not None else slip[k]
            given = {"v_s": -e * v, "v": v, "recovered": share[k], "height": 1.0}
            f = ca.fmin(-law_.expr({}, given, law_.param_values())[1]["mu"], cap)
            rows.append((e, f))
        e, f = (ca.vertcat(*column) for column in zip(*rows, strict=True))
        resisted = 0.012 + 2e-5 * v**2 if drag else 0.0
        v_next = ca.fmax(v - h * (G * ca.sum1(f) / n + resisted), 0)
        mean = (v + v_next) / 2
        place = x["x"] - ca.DM(behind)
        outputs = {"way": h * mean, "P": 2 * load * f * e * mean, "at": place}
        return {"x": x["x"] + h * mean, "v": v_next}, outputs

    train = make_block(
        "train", "step", body, period=h, sx=False,
        states=[State("m", 0.0).named("x"), State("m/s", v0).named("v")],
        inputs=[Input("1", "share", shape=(n,)).named("recovered")],
        outputs=[Output("m", "way").named("way"), Output("W", "heat", shape=(n,)).named("P"),
                 Output("m", "places", shape=(n,)).named("at")],
    )  # fmt: skip
    field = rail_field(Cells(behind, cell), h).with_params(tau=tau)
    wires = {f"field.{name}": f"train.{name}" for name in ("at", "way", "P")}
    loop = connect("loop", wires | {"train.recovered": "field.recovered"}, train=train, field=field)
    scenario = Scenario("stop", 120.0, end=End("train.v", below=1e-6))
    return float(prepare(loop, scenario, log=["train.x", "train.v"])()["train.x"][-1])
