"""Slip laws on a wheel whose numbers all differ: what of it each law has, and within which ends."""

from __future__ import annotations

import numpy as np
import pytest
from drawn_points import Draw, assert_same, values

from slipctl.models import common_form as form

WHEEL = form.Wheel(J=131.0, r=0.43, W=9.1e3, m=7.7e3, g=9.7, T_max=6.6e3, tau=0.07, v_best=2.3,
                   v=19.0)  # fmt: skip
SHARE = 2.3 / 1.2098601
"""Of the best creep of the freight locomotive, at which the barrier was made."""

OWN = {
    "pid": {"T_max": 6.6e3, "lam_ref_start": 0.1},
    "smc": {}, "sta": {"T_max": 6.6e3},
    "efc": {"lam_ref_start": 0.1, "m": 7.7e3, "law.n": 1.0},
    "eppfc": {"lam_ref_start": 0.1, "m": 7.7e3, "law.n": 1.0},
    "eppfc_barrier": {"lam_ref_start": 0.1, "m": 7.7e3, "law.n": 1.0},
    "barrier": {"T": 2e-3, "T_max": 6.6e3, "reference.most": 10 * SHARE,
                "barrier.k_s": 0.02 * SHARE, "barrier.v_sopt": 2.3, "barrier.R_g": 1.0,
                "barrier.k_a": 2.3 + 0.02 * SHARE},
    "hosm": {"T_max": 6.6e3, "m_law": 500e3, "law.k_3": 10.0},
}  # fmt: skip


@pytest.mark.parametrize("driven", [False, True])
@pytest.mark.parametrize("name", OWN)
def test_a_law_has_the_numbers_of_its_wheel(name, driven):
    block = form.laws(driven, 2e-3)[name](WHEEL)
    found = {n: float(v) for n, v in block.param_values().items()}
    assert {"J": found["J"], "r": found["r"]} == {"J": 131.0, "r": 0.43}
    assert not [n for n in found if n.endswith((".J", ".r", ".T_max"))]  # each is one number
    motion = "m" in OWN[name] and not driven
    for n, value in OWN[name].items():
        if driven and n in ("m", "law.n"):
            continue  # a driven wheel leaves the term of the motion out
        assert found[n] == pytest.approx(value), n
    assert ("m" in found) == motion
    assert block.period == (2e-3 if name in ("barrier", "hosm") else None)
    ends = {s.name: (s.lo, s.hi) for s in [*block.inputs.values(), *block.outputs.values()]}
    assert ends["v_best"] == (0, pytest.approx(6.9))
    assert ends["T_wanted"] == (-250 * 6.6e3, 250 * 6.6e3)
    for n, wanted in {"v": (-1, 120), "v_s": (-0.5, 120), "F": (-1e6, 1e6),
                      "best.y": (-20, 20), "ratio.y": (-125, 125), "fall.y": (-1e5, 1e5),
                      "slip.y": (-120, 120)}.items():  # fmt: skip
        assert ends.get(n, wanted) == wanted
    small = form.laws(driven)[name](WHEEL._replace(v_best=1.3, v=40.0))
    assert small.inputs["v_best"].hi == 6.0
    if "lam_ref_start" in OWN[name]:
        assert float(small.param_values()["lam_ref_start"]) == pytest.approx(1.3 / 40)


def test_blocks_of_the_common_form_are_their_equations():
    d = Draw(300, 1)
    J, r, m, T_max = d.even(60, 300), d.even(0.3, 0.6), d.even(5e3, 9e3), d.even(5e3, 9e3)
    wheel = {"J": J, "r": r}
    F, a = d.even(-9e3, 2e4), d.even(-1, 1)
    D = r**2 / J * F + F / m + a
    assert_same(values(form.fall, wheel | {"m": m, "F": F, "a_R": a}, 300)[2], {"D": D})
    assert_same(values(form.keeping, wheel | {"D": D}, 300)[2], {"T_eq": J * D / r})
    mu, g = d.even(-0.3, 0.3), d.even(9, 10.5)
    force = {"mu": mu, "m_axle": m, "g": g}
    assert_same(values(form.force, force, 300)[2], {"F": mu * m * g})
    T, wanted, lead = d.even(0, 1) * T_max, d.even(-0.3, 1.3) * T_max, d.even(1, 4)
    limited = T + lead * (np.clip(wanted, 0, T_max) - T)
    given = {"T_wanted": wanted, "T": T, "T_max": T_max, "lead": lead}
    assert_same(values(form.limits, given, 300)[2], {"T_cmd": np.clip(limited, 0, T_max)})
    assert_same(values(form.most, {"T_max": T_max}, 300)[2], {"T_top": T_max})
    M = d.even(1e5, 9e5)
    assert_same(values(form.force_limits, wheel | {"m": M, "T_max": T_max}, 300)[2],
                {"F_hi": M * r / J * T_max, "F_lo": 0})  # fmt: skip
    assert_same(values(form.torque_of, wheel | {"m": M, "F": F}, 300)[2], {"T": J / r / M * F})
    slip = {"v_s": d.even(0, 3), "v_ref": d.even(0, 3)}
    assert_same(values(form.slip_error, slip, 300)[2], {"e1": 0, "e2": slip["v_s"] - slip["v_ref"]})
