"""The motor, its loops and the search of a best slip: equations at drawn points, and numbers."""

from __future__ import annotations

import numpy as np
import pytest
from drawn_points import Draw, assert_same, values

from slipctl import rls
from slipctl.models import best_slip, motors, ranges
from slipctl.models.huang_2020.subway_braking import double_exponential

MANY = 2000


def circuit(d):
    return {"R_s": d.even(0.1, 0.3), "R_r": d.even(0.1, 0.3), "L_ls": d.even(1e-3, 3e-3),
            "L_lr": d.even(1e-3, 3e-3), "L_m": d.even(0.02, 0.05), "p": np.floor(d.even(2, 5)),
            "R_g": d.even(2, 4)}  # fmt: skip


def test_a_machine_is_its_voltage_equations():
    """With complex numbers: u = R i + psi' + j omega psi in the stator, 0 = ... in the rotor."""
    d = Draw(MANY, 1)
    s = circuit(d) | {
        "i_d": d.even(0, 300), "i_q": d.even(-300, 300), "psi_d": d.even(0.5, 4),
        "psi_q": d.even(-1, 1), "u_d": d.even(-900, 900), "u_q": d.even(-900, 900),
        "omega_sl": d.even(-9, 9), "omega": d.even(0, 150),
    }  # fmt: skip
    _, rate, told = values(motors.machine, s, MANY)
    L_s, L_r, L_m = s["L_ls"] + s["L_m"], s["L_lr"] + s["L_m"], s["L_m"]
    i, psi, u = (s[f"{k}_d"] + 1j * s[f"{k}_q"] for k in ("i", "psi", "u"))
    turns = s["p"] * s["R_g"] * s["omega"]
    i_r = (psi - L_m * i) / L_r  # psi_r = L_m i_s + L_r i_r
    flux = -s["R_r"] * i_r - 1j * s["omega_sl"] * psi
    omega = turns + s["omega_sl"]
    psi_s = L_s * i + L_m * i_r
    stator = u - s["R_s"] * i - 1j * omega * psi_s
    current = (stator - L_m / L_r * flux) / (L_s - L_m**2 / L_r)
    assert_same(rate, {"psi_d": flux.real, "psi_q": flux.imag, "i_d": current.real,
                       "i_q": current.imag}, rtol=1e-8, atol=1e-6)  # fmt: skip
    T = 1.5 * s["p"] * np.imag(np.conj(psi_s) * i)
    assert_same(told, {"T_m": T, "T": s["R_g"] * T}, rtol=1e-8, atol=1e-6)


def test_a_controller_s_flux_currents_and_voltages():
    d = Draw(MANY, 2)
    f = {"psi_h": d.even(0, 0.3), "i_d": d.even(0, 300), "i_q": d.even(-300, 300),
         "R_r": d.even(0.1, 0.3), "L_r": d.even(0.02, 0.05), "L_m": d.even(0.02, 0.05),
         "psi_min": d.even(0.05, 0.2)}  # fmt: skip
    _, rate, told = values(motors.flux_model, f, MANY)
    tau = f["L_r"] / f["R_r"]
    assert_same(rate, {"psi_h": (f["L_m"] * f["i_d"] - f["psi_h"]) / tau})
    slip = f["L_m"] * f["i_q"] / tau / np.maximum(f["psi_h"], f["psi_min"])
    assert_same(told, {"psi": f["psi_h"], "omega_sl": slip})
    r = {"F_cmd": d.even(-2e4, 6e4), "omega": d.even(0, 200), "psi": d.even(0, 4),
         "F_top": d.even(2e5, 4e5), "P_top": d.even(3e6, 8e6), "n_m": np.floor(d.even(8, 13)),
         "r": d.even(0.4, 0.5), "R_g": d.even(2, 4), "p": np.floor(d.even(2, 5)),
         "L_r": f["L_r"], "L_m": f["L_m"], "psi_N": d.even(2, 4), "omega_w": d.even(90, 300),
         "k_psi": d.even(50, 200), "I_d": d.even(60, 300), "I_q": d.even(100, 400),
         "psi_min": d.even(0.05, 1)}  # fmt: skip
    _, _, told = values(motors.references, r, MANY)
    v = r["r"] * r["omega"]
    most = np.minimum(r["F_top"], r["P_top"] / np.maximum(v, 1e-9)) / r["n_m"]
    T = np.clip(r["F_cmd"], 0, most) * r["r"] / r["R_g"]
    psi = r["psi_N"] * np.minimum(r["omega_w"] / np.maximum(r["R_g"] * r["omega"], 1e-9), 1)
    i_d = psi / r["L_m"] + r["k_psi"] * (psi - r["psi"])
    i_q = T * r["L_r"] / r["L_m"] / (1.5 * r["p"] * np.maximum(r["psi"], r["psi_min"]))
    assert_same(told, {"i_d_ref": np.clip(i_d, 0, r["I_d"]), "psi_ref": psi,
                       "i_q_ref": np.minimum(i_q, r["I_q"])})  # fmt: skip
    c = {"x_d": d.even(-300, 300), "x_q": d.even(-300, 300), "i_d_ref": d.even(0, 300),
         "i_q_ref": d.even(0, 300), "i_d": d.even(0, 300), "i_q": d.even(0, 300),
         "psi": d.even(0, 4), "omega_sl": d.even(-9, 9), "omega": d.even(0, 150),
         "alpha": d.even(300, 900), "R_s": d.even(0.1, 0.3), "sigma_L": d.even(2e-3, 5e-3),
         "k_r": d.even(0.9, 1), "p": np.floor(d.even(2, 5)), "R_g": d.even(2, 4),
         "U_max": d.even(500, 2500)}  # fmt: skip
    _, rate, told = values(motors.current_loops, c, MANY)
    error = c["i_d_ref"] - c["i_d"] + 1j * (c["i_q_ref"] - c["i_q"])
    i, turns = c["i_d"] + 1j * c["i_q"], c["p"] * c["R_g"] * c["omega"] + c["omega_sl"]
    wanted = c["alpha"] * c["sigma_L"] * error + c["x_d"] + 1j * c["x_q"]
    wanted = wanted + 1j * turns * (c["sigma_L"] * i + c["k_r"] * c["psi"])
    full = np.abs(wanted) / c["U_max"]
    u = wanted / np.maximum(full, 1)
    assert_same(told, {"u_d": u.real, "u_q": u.imag, "full": full}, rtol=1e-8)
    x = c["alpha"] * c["R_s"] * error + c["R_s"] / c["sigma_L"] * (u - wanted)
    assert_same(rate, {"x_d": x.real, "x_q": x.imag}, rtol=1e-8, atol=1e-6)
    assert 0.1 < (full > 1).mean() < 0.9


@pytest.mark.parametrize("v", [0.0, 30.0, 80.0])
def test_a_drive_starts_with_the_flux_of_its_speed(v):
    start = motors.vector_drive(v).start()
    full = float(motors.references.param_values()["psi_N"])
    psi = full * min(1, motors.OMEGA_C / max(2.5 * v / 0.445, 1e-9))
    L_m = float(motors.machine.param_values()["L_m"])
    wanted = {"machine.psi_d": psi, "flux.psi_h": psi, "machine.i_d": psi / L_m,
              "machine.i_q": 0, "machine.psi_q": 0, "loops.x_d": 0, "loops.x_q": 0}  # fmt: skip
    assert {n: pytest.approx(float(k)) for n, k in start.items()} == wanted


# ---- a search ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("runs", "ticks", "cut"), [
    (1, 16, 1), (4, 16, 4), (3, 16, 2), (4, 10, 2), (4, 15, 1), (2, 12, 2), (9, 8, 4),
])  # fmt: skip
def test_a_fit_is_cut_into_runs_that_divide_its_ticks(monkeypatch, runs, ticks, cut):
    seen = {}

    def fit(curve, **given):
        seen.update(given)
        return rls(curve, form="window", start=given["start"], period=given["period"],
                   **{k: v for k, v in given.items() if k.startswith("iter")})  # fmt: skip

    monkeypatch.setattr(best_slip, "rls", fit)
    start = {"c": 0.31, "a": 0.52, "b": 1.4}
    parts, wires = best_slip.search_parts(start=start, noise=0.03, ticks=ticks, tick=2e-3,
                                          runs=runs)  # fmt: skip
    assert seen.pop("start") == start
    assert seen.pop("form") == "window"
    assert seen.pop("period") == pytest.approx(ticks * 2e-3 / cut)
    assert seen == ({"iterations": 8, "iterations_per_tick": 8 // cut} if cut > 1 else {})
    numbers = parts["estimator"].param_values()
    for name, value in {"noise": 0.03, "spread": 0.5, "gate": 4.0, "settling": 1.0}.items():
        assert (np.asarray(numbers[name]) == value).all()
    many = {n: parts[n].choices.get("every") for n in ("estimator", "search", "probe")}
    if None not in many.values():
        assert many == {"estimator": ticks // cut, "search": ticks, "probe": ticks}
    far = 12 + max(abs(np.log([0.31, 0.52, 1.4 - 0.52])))
    theta = parts["estimator"].states["theta"]
    assert (theta.lo, theta.hi) == (pytest.approx(-far), pytest.approx(far))
    own = {f"{b}.{n}": f"estimator.{n}" for b in ("search", "probe", "curve") for n in "cab"}
    assert wires == own | {n: f"estimator.{n}" for n in "cab"} | {
        "probe.best": "search.best", "probe.covariance": "estimator.covariance",
        "probe.changed": "estimator.changed", "v_best": "probe.reference",
    }  # fmt: skip
    assert set(parts) == {"estimator", "search", "probe", "curve"}


def test_a_window_of_samples_has_ranges_by_its_size_and_its_law():
    made = rls(double_exponential, form="window", start=best_slip.START, period=0.016)
    found = ranges.fit_ranged(made, double_exponential, slip=77.0, most=500.0, far=9.0)
    window = made.states["kept"].shape[1]
    wanted = {
        "theta": (-9, 9), "mean": (-9, 9), "P": (-1e3, 1e3), "scatter": (0, 5e3),
        "Lambda": (-1e14, 1e14), "count": (0, window), "unsettled": (0, 1000),
        "damping": (0, 1e12), "kept": (-5, 77.0), "v_s": (-5, 77.0), "mu": (-2, 2),
        "predicted": (-500, 500), "residual": (-505, 505), "changed": (0, 1),
        "covariance": (-1e9, 1e9),
    } | {n: (s.lo, s.hi) for n, s in double_exponential.params.items() if n in "cab"}  # fmt: skip
    have = {s.name: (s.lo, s.hi) for s in found.signals if s.role != "param"}
    assert {n: have[n] for n in wanted} == wanted
    assert window == 128
    former = ranges.fit_ranged(
        rls(double_exponential, form="recursive", start=best_slip.START, period=0.016),
        double_exponential,
    )
    assert [(former.outputs[n].lo, former.outputs[n].hi) for n in "cab"] == [(0, 1e6)] * 3
