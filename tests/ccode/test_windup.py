"""No law of the studies winds up behind a limit, whichever of its limits is set, and to what.

Each law with an integral is held at a limit for 2 s by an error that stays, and then gets one of
the other sign. Its command has to leave the limit within 100 ms.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from bench.faults import controllers
from slipctl.block.block import Block
from slipctl.run import build

pytestmark = pytest.mark.second

HELD, BACK = 2.0, 0.1
"""Times in s at the limit, and until the command has left it."""

BRAKED = dict(v=20.0, mu_hat=0.3, v_opt=1.2, a_demand=20.0)
TRAIN = dict(x=0.0, x_d=0.0, omega=20.0 / 0.445, T=0.0)
SLIP = dict(v=20.0, v_best=1.2, D=20.0, F=20e3, T=8e3)
LAMBDA = dict(v=50.0, T_b=-15e3, omega=115.0, lam_opt=0.15, a_demand=20.0)

LAWS = {
    "subway_braking:sta": (("T_max",), BRAKED, ("v_s", 0.2, 1.6), ("T_b", 1)),
    "subway_braking:sta_implicit": (("T_max",), BRAKED, ("v_s", 0.2, 1.6), ("T_b", 1)),
    "hst_braking:pid_true_reference": (("T_max",), LAMBDA, ("lam", 0.01, 0.25), ("T_out", -1)),
    "hst_braking:pid_printed": (("T_max",), LAMBDA, ("lam", 0.01, 0.25), ("T_out", -1)),
    **{
        f"hst_traction:{name}": (("F_top", "P_top", "F_brake"), TRAIN, ("v_d", 30.0, 2.0),
                                 ("F_contr", 1))
        for name in ("hosm", "hosm_limited_rule", "hosm_limited_uncompensated", "asmc")
    },
    "all_rails:pid": (("T_max",), SLIP, ("v_s", 0.2, 1.6), ("T_wanted", 1)),
    "all_rails:sta": (("T_max",), SLIP, ("v_s", 0.2, 1.6), ("T_wanted", 1)),
    "all_rails:hosm": (("T_max",), SLIP, ("v_s", 0.2, 1.6), ("T_wanted", 1)),
    "predictive:pid": (("T_max",), dict(s_ref=0.02), ("s", 0.001, 0.05), ("u", 1)),
}  # fmt: skip
"""Limits, inputs, the error's input with its values at the limit and after it, command and sign.

Each law that a study runs and that has an integral; what a controller feeds it with is not asked.
``T_low`` of ``subway_braking`` is in force below ``v_off``, where slip control is off.
"""

AT_SPEED = {"F_top": 10.0, "P_top": 30.0, "F_brake": 10.0}
"""Speed in m/s at which a limit of the train is in force."""

WINDS_UP = {"hst_traction:asmc"}
"""As in the paper, which says that it fails by its integral (docs/hst_traction.md)."""


def _rolled(block: Block, rows: dict[str, np.ndarray], command: str) -> np.ndarray:
    """An output of a block over ticks of these inputs."""
    ticks = len(next(iter(rows.values())))
    u = np.zeros((ticks, block.f.size1_in(1)))
    k = 0
    for n, s in block.inputs.items():
        u[:, k : k + s.size] = rows[n][:, None] if n in rows else float(s.value or 0.0)
        k += s.size
    x = np.array(ca.DM(block.pack("state", block.start())).full()).ravel()
    p = np.array(ca.DM(block.pack("param", block.param_values())).full()).ravel()
    x_log, y_log = np.empty((ticks, x.size)), np.empty((ticks, block.f.size1_out(1)))
    assert build.make_roller(block.f, False)(x, u, p, x_log, y_log) == ticks
    names = [n for n, s in block.outputs.items() for _ in range(s.size)]
    return y_log[:, names.index(command)]


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.others("long")
def test_no_law_winds_up_behind_any_of_its_limits(name):
    limits, given, (error, at_limit, after), (command, sign) = LAWS[name]
    _, loop, part, _ = next(controllers([name]))
    n, more = round(HELD / loop.period), round(1.5 / loop.period)
    for short in limits:
        limit = next(k for k in loop[part].params if k.rpartition(".")[2] == short)
        way = -1 if short == "F_brake" else 1
        held = []
        for share in (0.5, 1.0, 1.5):
            signal = loop[part].params[limit]
            value = min(share * float(signal.value), signal.hi)
            rows = {k: np.full(n + more, v) for k, v in given.items()}
            speed = AT_SPEED.get(short, 20.0)
            if given is TRAIN:
                rows |= {"v": np.full(n + more, speed), "omega": np.full(n + more, speed / 0.445)}
                at_limit, after = speed + 15 * way, speed - 15 * way
            rows[error] = np.where(np.arange(n + more) < n, at_limit, after)
            torque = sign * way * _rolled(loop[part].with_params(**{limit: value}), rows, command)
            if name.startswith("all_rails"):  # it is limited behind the law
                torque = np.minimum(torque, value)
            held.append(torque[n - 1])
            gone = np.flatnonzero(torque[n:] < 0.95 * held[-1])
            late = not gone.size or gone[0] * loop.period > BACK
            assert late == (name in WINDS_UP), (limit, value, gone[:1])
        assert held[0] < held[1] <= held[2], limit  # it is this limit that is in force
