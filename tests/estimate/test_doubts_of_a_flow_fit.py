"""What a fit over time cannot tell, and what it says beside its numbers."""

from __future__ import annotations

import numpy as np
import pytest

from slipctl import BadInput, Input, Output, Param, State, fit_over_time, flow

T = np.linspace(0, 4, 81)


@flow(
    a_v=Output("m/s^2", "rate", lo=-0.5, hi=0.5),
    share=Output("1", "rate over its start", lo=-0.6, hi=1),
    calm=Output("1", "half of the state", lo=-9, hi=9),
)
def falls(
    v=State("m/s", 1.0, "speed"), u=Input("m/s^2", "push"),
    a=Param("1", 1.0, "one factor", lo=0.1, hi=10), b=Param("1/s", 1.0, "another", lo=0.1, hi=10),
    c=Param("1", 0.5, "factor of the push", lo=-5, hi=5),
):  # fmt: skip
    rate = -a * b * v + c * u
    return dict(v=rate), dict(a_v=rate, share=rate / 1.0, calm=v / 2)


def log(rate=0.8, gain=0.7):
    """Exact answer to a push that stands from 2 s on."""
    push = np.where(T >= 2, 1.0, 0.0)
    begun = np.exp(-rate * T)
    pushed = gain / rate * (1 - np.exp(-rate * np.maximum(T - 2, 0)))
    return {"time": T, "v": begun + pushed, "u": push}


def test_numbers_of_which_only_the_product_tells_are_named_and_no_other():
    with pytest.raises(BadInput, match="does not determine a, b: other values fit as well"):
        fit_over_time(falls, log(), "v", ["a", "b", "c"])


def test_outputs_beyond_their_ranges_are_told_with_their_units():
    found = fit_over_time(falls, log(), "v", ["a", "c"])
    assert found.values["a"] == pytest.approx(0.8, rel=0.01)
    assert found.values["c"] == pytest.approx(0.7, rel=0.05)
    said = " | ".join(found.doubts)
    assert "a_v comes to -0.8 m/s^2, beyond its range of -0.5 to 0.5 m/s^2:" in said
    assert "share comes to -0.8, beyond its range of -0.6 to 1:" in said
    assert "calm comes" not in said


@pytest.mark.parametrize(("rate", "at_end"), [(0.8, True), (0.3, False)])
def test_a_number_that_ends_at_its_range_is_told(rate, at_end):
    @flow(y=Output("m/s", "speed"))
    def slow(v=State("m/s", 1.0, "speed"), k=Param("1/s", 0.2, "rate", lo=0.1, hi=0.5)):
        return dict(v=-k * v), dict(y=v)

    found = fit_over_time(slow, {"time": T, "v": np.exp(-rate * T)}, "v")
    assert found.values["k"] == pytest.approx(min(rate, 0.5), rel=1e-3)
    assert any("is at the end of its range" in line for line in found.doubts) == at_end
