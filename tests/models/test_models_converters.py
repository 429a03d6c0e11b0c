"""Converters: steps, saturation, noise, a full turn through D/A and A/D."""

import numpy as np
import pytest

from slipctl import BadInput, Output, Scenario, State, connect, replicate, simulate, step
from slipctl.models import converters


@step(period=1e-3, w=Output("rad/s", "speed of a wheel"))
def wheel(w=State("rad/s", 100.0, "speed of a wheel")):
    return dict(w=w), dict(w=w)


def test_error_is_half_a_step_in_range_and_the_end_outside():
    block = converters.converter("m/s", -10.0, 30.0, bits=8)
    q = 40 / 255
    u = np.linspace(-12, 32, 4001)
    y = np.array([block(u=x)["y"] for x in u])
    inside = (u >= -10) & (u <= 30)
    assert np.abs(y - u)[inside].max() <= q / 2 * (1 + 1e-12)
    assert set(y[u < -10]) == {-10}
    assert set(y[u > 30]) == {30}
    codes = (y + 10) / q
    np.testing.assert_allclose(codes, np.round(codes), atol=1e-9)
    assert len(set(np.round(codes))) == 256
    assert [block(u=x)["full"] for x in (-10.1, 0.0, 30.0, 31.0)] == [1, 0, 0, 1]


def test_12_bits_of_the_rig():
    for block in (converters.force_output, converters.speed_input, converters.wheel_input):
        assert block.params["codes"].value == 4095
        assert block.check_units() == []


def test_noise_goes_through_the_steps_and_each_axle_has_its_own():
    wires = {"ad.u": "wheel.w"}
    many = replicate(converters.wheel_input, 10, axis="driven")
    loop = connect("loop", wires, ad=many, wheel=replicate(wheel, 10, axis="driven"))
    loop = loop.with_params(**{"ad.sigma": 0.5})
    y = simulate(loop, Scenario("s", 4.0))["ad.y"].values
    q = 225 / 4095
    np.testing.assert_allclose(y / q, np.round(y / q), atol=1e-6)
    # 4000 samples: the spread of a standard deviation is 1.1 %; a step adds q^2/12
    np.testing.assert_allclose(y.std(axis=0), np.hypot(0.5, q / 12**0.5), rtol=0.05)
    assert np.abs(np.corrcoef(y.T) - np.eye(10)).max() < 0.08
    silent = simulate(loop, Scenario("s", 0.01, noise=0.0))
    assert np.ptp(silent["ad.y"].values) == 0


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (("m", 1.0, 1.0), "lo < hi"),
        (("m", 0.0, 1.0, 0), "1 to 32"),
        (("m", 0, 1, 8.5), "bits = 8.5"),
    ],
)
def test_refused(values, words):
    with pytest.raises(BadInput, match=words):
        converters.converter(*values)
