"""Adhesion from the equation of a wheel: exact means over a window, of signals with a known law."""

from __future__ import annotations

import numpy as np
import pytest

from slipctl import BadInput
from slipctl.models.sensors import adhesion_meter

J, R, M, G, T = 200.0, 0.46, 9000.0, 9.81, 2e-3
NUMBERS = {"J": J, "r": R, "m": M, "g": G, "T": T}


def measured(meter, omega, torque, slip):
    """Outputs of each tick over signals."""
    found = []
    start = {"omega_start": omega[0], "T_b_start": torque[0], "v_s_start": slip[0]}
    block = meter.with_params(**{k: v for k, v in (NUMBERS | start).items() if k in meter.params})
    x = block.start()
    for w, t, s in zip(omega, torque, slip, strict=True):
        u = block.pack("input", {"omega": w, "T_b": t, "v_s": s})
        n, y = block.f(block.pack("state", x), u, block.pack("param", block.param_values()))
        x = block.unpack("state", n)
        found.append([float(v) for v in block.unpack("output", y).values()])
    return np.array(found)


@pytest.mark.parametrize("window", [1, 2, 5])
@pytest.mark.parametrize("torque", ["held", "sampled"])
def test_the_mean_adhesion_is_exact_for_a_torque_that_is_held_or_a_ramp(window, torque):
    """J dw/dt = mu r m g - T_b, integrated: held from tick to tick, or straight between samples."""
    rng = np.random.default_rng(window)
    many, mu = 40, 0.2
    brake = rng.uniform(0, 9e3, many)
    mean = brake[:-1] if torque == "held" else (brake[:-1] + brake[1:]) / 2
    omega = 60 + np.concatenate([[0.0], np.cumsum(T / J * (mu * R * M * G - mean))])
    slip = rng.uniform(0, 2, many)
    meter = adhesion_meter(window, torque=torque, noise=False)
    found = measured(meter, omega, brake, slip)[window:]
    assert found[:, 0] == pytest.approx(np.full(many - window, mu), rel=1e-9)
    halves = (slip[:-1] + slip[1:]) / 2
    wanted = [halves[k : k + window].mean() for k in range(many - window)]
    assert found[:, 1] == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize("window", [0, -1, 1.5])
def test_a_window_is_a_whole_number_of_ticks(window):
    with pytest.raises(BadInput, match="takes a whole number of ticks >= 1"):
        adhesion_meter(window)


def test_a_torque_is_held_or_sampled():
    with pytest.raises(BadInput, match="no torque 'mean'; it has held, sampled"):
        adhesion_meter(3, torque="mean")
