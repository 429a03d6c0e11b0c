"""Speed of a step in generated C, guards and status included, against hand-written C."""

from __future__ import annotations

import ctypes
import tempfile
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from casadi import log

from slipctl import Block, Input, Output, connect, law, rls, simulate
from slipctl.ccode import codegen
from slipctl.ccode.compile.module import input_rows

TICKS = 6000


@law(v_opt=Output("m/s", "best slip speed", positive="braking", per="speed"))
def peak(
    c=Input("1", "height of the adhesion"),
    a=Input("s/m", "slow decay"),
    b=Input("s/m", "fast decay"),
):
    """Where c (exp(-a v) - exp(-b v)) is largest: ln(b/a)/(b - a)."""
    return log(b / a) / (b - a)


def sta_rls() -> Block:
    """Super-twisting slip control at the peak that recursive least squares sees."""
    from slipctl.models.huang_2020.subway_braking import double_exponential
    from slipctl.models.huang_2020.subway_braking_control import controller, super_twisting

    wires = {
        "estimator.v_s": "v_s", "estimator.mu": "mu", "peak.c": "estimator.c",
        "peak.a": "estimator.a", "peak.b": "estimator.b", "slip.v": "v", "slip.f_hat": "f",
        "slip.W_hat": "W", "slip.a_demand": "a_demand", "slip.v_s": "v_s", "slip.mu_hat": "mu",
        "slip.v_opt": "peak.v_opt", "T_out": "slip.T_b",
    }  # fmt: skip
    return connect(
        "ctl", wires, estimator=rls(double_exponential, period=1e-3), peak=peak,
        slip=controller(super_twisting()),
    )  # fmt: skip


def eppfc() -> Block:
    """Prescribed performance with filter and gradient reference."""
    from slipctl.studies.hst_braking.loops import MODELS, loop

    return loop(MODELS, MODELS["eppfc"], "gradient")["ctl"]


def run_of(name: str) -> dict[str, np.ndarray]:
    """Inputs of a run of the study: dry rail with noise on what is measured."""
    from slipctl import Rail, Scenario, Section

    rng = np.random.default_rng(1)
    if name == "eppfc":
        from slipctl.studies.hst_braking.loops import MODELS, best, loop

        whole = loop(MODELS, MODELS["eppfc"], "gradient").with_params(**{"tacho.sigma": 1e-3})
        rail = Rail([Section(0, "dry", {"lam_opt": best(MODELS["adh"], "dry")[0]})])
        log_ = simulate(whole, Scenario("run", TICKS * 1e-3, rail),
                        log=[*whole.inputs, *whole.outputs, *whole.states])  # fmt: skip
        return codegen.logged_inputs(whole, "ctl", log_)
    t = np.arange(TICKS) * 1e-3
    v_s = 1.2 + 0.8 * np.sin(9 * t)
    mu = np.exp(-0.54 * v_s) - np.exp(-1.2 * v_s)
    return {
        "v_s": v_s, "mu": mu + 1e-3 * rng.standard_normal(TICKS), "v": 20.0 - 2.5 * t,
        "f": np.full(TICKS, 300.0), "W": np.zeros(TICKS), "a_demand": np.full(TICKS, 10.0),
    }  # fmt: skip


BLOCKS = {"sta_rls": sta_rls, "eppfc": eppfc}


def bench(pairs: int = 21) -> dict[str, Any]:
    """Both controllers replayed in C, ours and the hand-written one in turn.

    Returns:
        For each: times and ratios as of :func:`bench.speed.ratio`, and the largest
        difference of an output, relative to its largest value.
    """
    from bench.speed import peer_library, ratio

    library = peer_library("steps")
    found: dict[str, Any] = {}
    for name, make in BLOCKS.items():
        block = make()
        with tempfile.TemporaryDirectory(prefix="slipctl_") as scratch:
            module = codegen.c_module(block, Path(scratch), name).compile().load()
        plan = module._plan
        rows = input_rows(block, plan.layout.inputs, run_of(name))
        n_out = sum(m.size for m in plan.layout.outputs)
        n_state = sum(m.size for m in plan.layout.states)
        in_ = np.ascontiguousarray(rows[:, _order(name, plan.layout.inputs)])
        out, states = np.zeros((len(rows), n_out)), np.zeros((len(rows), n_state))
        status = np.zeros(len(rows), np.intc)
        peer_out, peer_states = np.zeros_like(out), np.zeros_like(states)

        ours = partial(
            _call, module._lib.bind_replay,
            (rows, module._param.copy(), module._state.copy(), out, states, status, None, None),
        )  # fmt: skip
        peer = partial(
            _call, library[f"{name}_replay"],
            (in_, *_peer(name, block), peer_out, peer_states, status),
        )  # fmt: skip
        row = ratio(ours, peer, pairs)
        largest = np.maximum(np.abs(out).max(axis=0), 1e-300)
        row["largest_difference"] = float((np.abs(out - peer_out).max(axis=0) / largest).max())
        row["ours_ns"] = 1e9 * row["ours_s"] / len(rows)
        row["peer_ns"] = 1e9 * row["peer_s"] / len(rows)
        found[f"{name}_vs_c"] = row
    return found


def _call(replay: Any, arrays: tuple[np.ndarray | None, ...]) -> None:
    """Replay from the start state, which comes third and is copied."""
    given = [a.copy() if k == 2 and a is not None else a for k, a in enumerate(arrays)]
    pointers = [None if a is None else a.ctypes.data_as(ctypes.c_void_p) for a in given]
    replay(ctypes.c_int(TICKS), *pointers)


_INPUTS = {
    "sta_rls": ("v_s", "mu", "v", "f", "W", "a_demand"),
    "eppfc": ("omega", "T_b", "lam", "v", "a_demand"),
}


def _order(name: str, members: Any) -> list[int]:
    """Columns of our inputs in the order of the peer's struct."""
    names = [m.name for m in members]
    return [names.index(n) for n in _INPUTS[name]]


# each part of the peer has its own copy of what ours shares
_PARAMS = {
    "sta_rls": (
        "estimator.noise", "estimator.spread", "estimator.forgetting", "estimator.jump",
        "estimator.cap", "slip.equivalent.m", "slip.equivalent.J", "slip.equivalent.r",
        "slip.equivalent.g", "slip.reference.share", "slip.law.k1", "slip.law.k2", "slip.law.T",
        "slip.law.J", "slip.law.r", "slip.arbitration.m", "slip.arbitration.J",
        "slip.arbitration.r", "slip.arbitration.T_max", "slip.arbitration.v_off",
        "slip.arbitration.T_low",
    ),
    "eppfc": (
        "filter.gamma", "filter.sigma", "filter.prior_F_a", "filter.drift_F_a",
        "filter.floor_F_a", "filter.cap_F_a", "filter.noise_omega", "filter.J",
        "filter.r", "slope.rho_1", "slope.rho_2", "slope.zeta", "slope.gate",
        "slope.P_top", "slope.jump", "slope.settle", "slope.gain", "slope.T",
        "search.h_1", "search.rate", "search.chi_0", "search.near", "search.lo",
        "search.hi", "search.T", "reference.up", "reference.share", "reference.tau_ref",
        "reference.near", "reference.v_off", "reference.J", "reference.r",
        "reference.T", "law.eta_0", "law.eta_inf", "law.k", "law.delta_l",
        "law.delta_u", "law.K1", "law.trip", "law.reserve", "law.v_min", "law.v_off",
        "law.m", "law.n", "law.J", "law.r", "law.T", "arbitration.m", "arbitration.n",
        "arbitration.J", "arbitration.r", "arbitration.T_max", "arbitration.v_off",
        "arbitration.part",
    ),
}  # fmt: skip


def _peer(name: str, block: Block) -> tuple[np.ndarray, np.ndarray]:
    """Parameters and start state of the peer, from the block."""
    values = block.param_values()
    param = np.concatenate([np.ravel(values[block.sharing.name(n)]) for n in _PARAMS[name]])
    state = np.concatenate([np.ravel(v, order="F") for v in block.start().values()])
    return param, np.concatenate([state, np.zeros(64)])
