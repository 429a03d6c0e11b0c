"""Metrics of sliding wheels, on logs whose numbers are known in closed form."""

import numpy as np
import pytest
import xarray

from slipctl.run.measures.measured_run import Run
from slipctl.run.metrics import measure
from slipctl.run.roles import Signals

SIGNALS = Signals(
    speed="v", slip="s", contact_power="P", wear_rate="k", flash="T", energy_error="e"
)


def log(v, slip, power, tick=0.01, **more):
    time = np.arange(len(v)) * tick
    data = {"v": ("time", v, {"units": "m/s"}),
            "s": (("time", "axle"), slip, {"units": "m/s", "positive": "braking"}),
            "P": (("time", "axle"), power, {"units": "W"})}  # fmt: skip
    data |= {n: (("time", "axle")[: np.ndim(x)], x, {"units": "1"}) for n, x in more.items()}
    return xarray.Dataset(data, coords={"time": time}, attrs={"period_s": tick})


def found(*args, **more):
    return {n: m.value for n, m in measure(Run(log(*args, **more), SIGNALS)).items()}


def test_a_wheel_that_is_locked_for_a_second():
    """v 20 m/s held, axle 2 locked from 1 to 2 s with 12 kN at the rail, axle 1 slides at 10 %."""
    v = np.full(400, 20.0)
    slip = np.column_stack([np.full(400, 2.0), np.zeros(400)])
    slip[100:200, 1] = 20.0
    power = np.column_stack([np.full(400, 1e4), np.where(slip[:, 1] > 0, 12e3 * 20.0, 0.0)])
    got = found(v, slip, power)
    assert got["longest_lock"] == pytest.approx(1.0)
    assert got["longest_slide"] == pytest.approx(20.0)
    assert got["contact_energy"] == pytest.approx(4 * 1e4 + 240e3)
    assert got["flat_energy"] == pytest.approx(120e3)  # of one of its two wheels
    assert got["t_gamma"] == pytest.approx(6e3)
    assert got["lock_time"] == pytest.approx(1.0)


@pytest.mark.parametrize("worked", [(0, 2), (1,), None])
def test_what_is_told_of_worked_axles_is_theirs(worked):
    """Three axles of which some have a brake: heat of a lock, share of the adhesion."""
    axles = [0, 1, 2] if worked is None else list(worked)
    v, slip, power = np.full(300, 10.0), np.zeros((300, 3)), np.zeros((300, 3))
    slip[:100, axles[-1]] = 10.0
    power[:100] = np.array([1e3, 2e3, 4e3])
    mu, best = (np.tile(x, (300, 1)) for x in ([0.01, 0.02, 0.06], [0.1, 0.1, 0.1]))
    whole = log(v, slip, power, mu=mu, best=best)
    whole["s"] = (("time", "worked"), slip[:, axles], whole["s"].attrs)
    signals = Signals(speed="v", slip="s", contact_power="P", adhesion="mu", best_adhesion="best",
                      axles=worked)  # fmt: skip
    got = {n: m.value for n, m in measure(Run(whole, signals)).items()}
    assert got["flat_energy"] == pytest.approx(power[0, axles[-1]] / 2)
    assert got["adhesion_use"] == pytest.approx(mu[0, axles].mean() / 0.1)
    assert got["contact_energy"] == pytest.approx(7e3)  # of all axles


def test_two_locks_are_not_one():
    """The longest of each, not the sum; a wheel that turns between two locks is at another spot."""
    v, slip = np.full(300, 10.0), np.zeros((300, 1))
    slip[50:80] = slip[100:170] = 10.0
    got = found(v, slip, slip * 1e3)
    assert got["longest_lock"] == pytest.approx(0.7)
    assert got["flat_energy"] == pytest.approx(0.7 * 10e3 / 2)
    assert found(v, 0 * slip, 0 * slip)["longest_lock"] == 0.0


def test_a_stop_ends_with_its_deceleration():
    v = np.maximum(5 - 1.25 * 0.01 * np.arange(600), 0.0)
    zero = np.zeros((600, 1))
    assert found(v, zero, zero)["stop_jolt"] == pytest.approx(1.25, rel=1e-6)
    assert "stop_jolt" not in found(v + 1, zero, zero)  # it does not stop


def test_wear_heat_and_books_are_taken_as_they_are():
    v, zero = np.full(100, 10.0), np.zeros((100, 2))
    rates = np.column_stack([np.full(100, 1e-6), np.full(100, 3e-6)])
    flash = np.column_stack([np.linspace(0, 50, 100), np.linspace(0, 300, 100)])
    got = found(v, zero, zero, k=rates, T=flash, e=np.linspace(0, -2e-9, 100))
    assert got["wear"] == pytest.approx(10.0 * 3e-6)  # 1 s at 10 m/s
    assert got["flash_temperature"] == 300
    assert got["energy_error"] == pytest.approx(2e-9)


def test_a_run_without_the_heat_of_its_contacts_has_none_of_them():
    v = np.full(50, 10.0)
    data = log(v, np.zeros((50, 1)), np.zeros((50, 1))).drop_vars("P")
    got = measure(Run(data, SIGNALS))
    assert not {"longest_slide", "flat_energy", "t_gamma", "contact_energy"} & set(got)
