"""Speed of the loop `eppfc_gradient` of hst_braking: against hand-written C, and do-mpc."""

from __future__ import annotations

import ctypes
from typing import Any

import casadi as ca
import numpy as np

from slipctl.run import build

TICKS = 6000

P = dict(
    m=13800.0, n=4.0, I=60.35, r=0.43, g=9.81, v_0=0.1, omega_0=0.1, a0=0.3546, a1=23.129,
    a2=0.1246, c0=0.0, c1=0.0, c2=0.0, vf=0.1, theta=-33.56e-3, P_max=600e3, sigma_w=1e-3,
    gamma=0.23, sigma=2.0, floor=4e-6, R_w=1.0, rho_1=0.8, rho_2=0.7, zeta=1000.0, gate=0.01,
    P_top=1e4, jump=300e3, settle=0.02, gain=0.187, rate=0.5, chi_0=3000.0, near=0.01, lo=0.005,
    hi=0.4, up=0.5, share=0.8, tau=0.01, near_ref=0.02, v_off=1.0, eta_0=0.1, eta_inf=0.005,
    k=30.0, dl=1.2, du=1.2, K1=100.0, trip=0.95, reserve=0.6, v_min=0.5, T_max=20e3, part=0.7,
    T=1e-3,
)  # fmt: skip
"""Parameters in the order of the struct in hst_loop.c, SI units."""


def bench(pairs: int = 21, simulator: bool = True) -> dict[str, Any]:
    """Closed loop with filter and gradient reference on dry rail: ours against C and do-mpc.

    Args:
        pairs: how often both are run in turn.
        simulator: also against do-mpc's simulator, where that is installed.

    Returns:
        ``ours_vs_c`` with the largest difference of a state over the run, and, where do-mpc is
        installed, ``do_mpc_vs_ours``: its simulator stepping the same plant with the same
        controller called from Python.
    """
    from bench.speed import peer_library, ratio
    from slipctl.studies.hst_braking.loops import MODELS, best, loop

    block = loop(MODELS, MODELS["eppfc"], "gradient").with_params(**{"tacho.sigma": 1e-3})
    roller = build.compile_roller(block.f)
    assert roller is not None
    library = peer_library("hst_loop")
    lam_opt = best(MODELS["adh"], "dry")[0]
    noise = np.random.default_rng(1).standard_normal(TICKS)
    feed = {
        "lam_opt": np.full(TICKS, lam_opt),
        "tacho.n": noise,
        "ctl.a_demand": np.full(TICKS, 15.0),
    }
    u = np.ascontiguousarray(np.column_stack([feed[n] for n in block.inputs]))
    x0 = np.array(ca.DM(block.pack("state", block.start())).full()).ravel()
    p = np.array(ca.DM(block.pack("param", block.param_values())).full()).ravel().copy()
    x_log, y_log = np.empty((TICKS, x0.size)), np.empty((TICKS, block.f.size1_out(1)))

    def ours(ticks: int = TICKS) -> None:
        roller.roll(x0.copy(), u[:ticks], p, x_log[:ticks], y_log[:ticks])

    q = np.array(list(P.values()))
    start = np.array(
        [0, 50, 50 / 0.43, 0, 4e6, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0.1, 0.1, 0.1, 0.1, 0, 0.0]
    )
    peer_x, peer_y = np.empty((TICKS, 20)), np.empty((TICKS, 27))
    opt = feed["lam_opt"]

    def in_c() -> None:
        x = start.copy()
        pointers = [a.ctypes.data_as(ctypes.c_void_p) for a in (x, opt, noise)]
        rest = [a.ctypes.data_as(ctypes.c_void_p) for a in (q, peer_x, peer_y)]
        library.peer_loop(ctypes.c_long(TICKS), *pointers, ctypes.c_double(15.0), *rest)

    found: dict[str, Any] = {"ours_vs_c": ratio(ours, in_c, pairs)}
    names = list(block.states)
    places = {
        "plant.wheel.x": 0,
        "plant.wheel.v": 1,
        "plant.wheel.omega": 2,
        "ctl.search.best_h": 14,
    }
    found["ours_vs_c"]["largest_state_difference"] = max(
        float(np.abs(x_log[:, names.index(n)] - peer_x[:, k]).max()) for n, k in places.items()
    )
    if not simulator:
        return found
    try:
        import do_mpc  # noqa: F401
    except ImportError:
        return found
    few = 300
    row = ratio(lambda: ours(few), _do_mpc(few, block), 3)
    found["do_mpc_vs_ours"] = {
        "ratio": 1 / row["ratio"], "ours_s": row["ours_s"], "peer_s": row["peer_s"]
    }  # fmt: skip
    return found


def _do_mpc(ticks: int, block: Any) -> Any:
    """Call that steps the plant by do-mpc's simulator, with our controller called from Python."""
    import do_mpc

    dt = block.period
    model = do_mpc.model.Model("continuous")
    v = model.set_variable("_x", "v")
    omega = model.set_variable("_x", "omega")
    model.set_variable("_x", "x")
    T_b = model.set_variable("_u", "T_b")
    lam = (v - P["r"] * omega) / ca.fmax(v, P["v_0"])
    F = P["m"] * P["g"] / P["n"] * -(P["a0"] * (1 - ca.exp(-P["a1"] * lam)) - P["a2"] * lam)
    model.set_rhs("v", P["n"] * F / P["m"])
    model.set_rhs("omega", (T_b - P["r"] * F) / P["I"])
    model.set_rhs("x", v)
    model.setup()
    simulator = do_mpc.simulator.Simulator(model)
    simulator.set_param(t_step=dt)
    simulator.setup()
    ctl = block["ctl"]
    step = ctl.f
    at_input = {n: k for k, n in enumerate(ctl.inputs)}
    at_output = {n: k for k, n in enumerate(ctl.outputs)}

    def run() -> None:
        x = ctl.pack("state", ctl.start())
        p = ctl.pack("param", ctl.param_values())
        state = np.array([[50.0], [50.0 / P["r"]], [0.0]])
        simulator.x0 = state
        simulator.reset_history()
        u, T_last = ca.DM.zeros(len(at_input)), 0.0
        for _ in range(ticks):
            speed, wheel = float(state[0, 0]), float(state[1, 0])
            for n, value in (
                ("omega", wheel), ("v", speed), ("T_b", T_last), ("a_demand", 15.0),
                ("lam", (speed - P["r"] * wheel) / max(speed, P["v_0"])),
            ):  # fmt: skip
                u[at_input[n]] = value
            wanted = step(x, u, p)[1]
            T_last = float(wanted[at_output["T_out"]])
            u[at_input["T_b"]] = T_last
            x, _ = step(x, u, p)
            state = simulator.make_step(np.array([[T_last]]))

    return run
