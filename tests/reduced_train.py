"""The adhesion observer and the control laws of Wang 2025 on one wheel and one mass."""

import casadi as ca
import numpy as np

from slipctl import Input, Scenario, State, connect, flow, sampled, simulate
from slipctl.models.wang_2025 import hst_traction_control as control

J, R, W, G = 93.75, 0.445, 15625.0, 9.8
BY_MU = J / (R * W * G)
"""Adhesion per rad/s^2 of f."""


def observed(block, T, L=100.0, w=15.0, seconds=1.2):
    """Error of the adhesion over time: f = L sin wt, so |f'| <= L w, and no torque."""
    ticks = round(seconds / T)
    t = np.arange(ticks) * T
    omega = 100 + L / w * (1 - np.cos(w * t))
    f = block.with_params(T_o=T, B_t=0.0).f
    p = block.with_params(T_o=T, B_t=0.0)
    x = p.pack("state", p.start(z1=100.0))
    u = np.vstack([omega, np.zeros(ticks)])
    y = np.array(f.mapaccum(ticks)(x, u, ca.repmat(p.pack("param", p.param_values()), 1, ticks))[1])
    return (y.ravel() + BY_MU * L * np.sin(w * t))[ticks // 4 :]


@flow(name="reduced")
def reduced(
    x=State("m", 0.0, "position"),
    v=State("m/s", 30.0, "speed"),
    x_d=State("m", 0.0, "target position"),
    v_d=State("m/s", 30.0, "target speed"),
    a_d=Input("m/s^2", "target acceleration", positive="traction"),
    F=Input("N", "commanded force", positive="traction"),
    delta=Input("N", "what is not delivered"),
    F_d=Input("N", "running resistance", positive="braking"),
):
    """Train as (15) has it, with a prescribed delta."""
    return dict(x=v, v=(F - delta - F_d) / 500e3, x_d=v_d, v_d=a_d), {}


def reduced_run(F_max, compensation=True, form="consistent", seconds=60.0, T=1e-3):
    """s, e1 and gain over time; 40 s of an acceleration of 0.5 m/s^2."""
    names = {f"track.{n}": f"train.{n}" for n in ("x", "v", "x_d", "v_d")}
    wires = names | {
        "track.a_d": "a_d", "train.a_d": "a_d", "track.F_d": "F_d", "train.F_d": "F_d",
        "law.e1": "track.e1", "law.e2": "track.e2", "law.a_ff": "track.a_ff",
        "train.F": "law.F_contr", "law.F_hi": "F_hi", "law.F_lo": "F_lo",
    }  # fmt: skip
    law = control.higher_order(compensation=compensation, form=form)
    loop = connect("loop", wires, train=reduced, track=control.tracking, law=law)
    feeds = {
        "a_d": [(0.0, 0.5), (40.0, 0.0)],
        "delta": lambda t: 5e3 * np.sin(t) + 8e3,
        "F_d": 30e3, "F_hi": F_max, "F_lo": -F_max,
    }  # fmt: skip
    scenario = Scenario("reduced", seconds, inputs=feeds)
    log = simulate(sampled(loop, T, "rk4", check=False), scenario)
    e1 = log["train.x"].values - log["train.x_d"].values
    return log["law.s"].values, e1, log["law.k_1H"].values
