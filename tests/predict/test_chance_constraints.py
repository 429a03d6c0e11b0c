"""Limits that hold with a probability: against runs with drawn noise, and against closed forms."""

import numpy as np
import pytest
from scipy.stats import binomtest, norm

from slipctl import BadInput, Input, Output, State, flow, law, nmpc, one, tightening
from slipctl.predict.trials import Driver

H, N, Q = 0.1, 10, 0.04


@flow()
def cart(
    x=State("m", 0.0, "place"), v=State("m/s", 0.0, "speed"),
    F=Input("N", "force", lo=-50, hi=50),
):  # fmt: skip
    """One kilogram."""
    return dict(x=v, v=F / one("kg")), {}


@law(e=Output("m/s"), f=Output("N"))
def speed(v=Input("m/s", "speed"), w=Input("m/s", "wanted", value=2.0), F=Input("N", "force")):
    """Speed error and force."""
    return dict(e=v - w, f=F)


@law(over=Output("m/s", "speed above its limit, drawn in", hi=0.0, lo=-100.0))
def below(v=Input("m/s", "speed"), spare=Input("m/s", "what is kept free")):
    """At most 1 m/s, less what is kept free."""
    return v - one("m/s") + spare


WEIGHTS = {"e": 3.0, "f": 0.3}


def margins(**options):
    """Of the speed of the cart."""
    given = {"h": H, "horizon": N, "noise": {"v": Q}, "weights": WEIGHTS, **options}
    return tightening(cart, speed, "F", given.pop("limited", "v"), **given)


@pytest.mark.second
@pytest.mark.long
def test_in_closed_loop_the_limit_is_broken_as_often_as_was_said():
    """The plan wants 2 m/s, so each next speed is planned at the limit, and noise decides."""
    block = nmpc(
        cart, speed, "F", h=H, horizon=N, weights=WEIGHTS, path=below, preview=["spare"]
    )  # fmt: skip
    for chance in (0.8, 0.99):
        spare = margins(chance=chance)["v"]
        tick, rng = Driver(block), np.random.default_rng(3)
        x, v, over, ticks = 0.0, 0.9, 0, 1500
        for _ in range(ticks):
            told = {"x": x, "v": v, "w": 2.0, "spare": spare}
            F = tick(*(told[n] for n in block.inputs))[0]
            x, v = x + H * v, v + H * F + np.sqrt(Q * H) * rng.normal()
            over += v > 1
        inside = binomtest(over, ticks).proportion_ci(1 - 1e-4)
        assert inside.low < 1 - chance < inside.high, chance


def test_without_an_answer_the_variance_of_a_walk_grows_with_time():
    spare = margins(answered=False, chance=0.95, start={"v": 0.01})["v"]
    wanted = norm.ppf(0.95) * np.sqrt(0.01 + Q * H * np.arange(N + 1))
    assert spare == pytest.approx(wanted, rel=1e-9)
    assert np.all(margins(chance=0.95)["v"][2:] < spare[2:])  # the regulator holds it


def test_later_stages_are_those_of_runs_with_the_regulator():
    """Answered by the gain of python-control on the same weights; 20 000 runs of 10 stages."""
    import control

    A, B = np.array([[1, H], [0, 1]]), np.array([[H * H / 2], [H]])
    K = np.zeros((1, 2))
    K[:, 1:] = control.dlqr(A[1:, 1:], B[1:], [[9.0]], [[0.09]])[0]
    rng, e = np.random.default_rng(4), np.zeros((20_000, 2))
    found = margins(limited=["v", "x"], chance=norm.cdf(1.0))
    for k in range(1, N + 1):
        M = A - B @ K if k > 1 else A
        e = e @ M.T + np.sqrt(Q * H) * rng.normal(size=e.shape) * [0, 1]
        assert found["v"][k] == pytest.approx(e[:, 1].std(), rel=0.03)
        if k > 1:
            assert found["x"][k] == pytest.approx(e[:, 0].std(), rel=0.03)


BAD = [
    (dict(noise={"z": 1.0}), "noise has 'z', which is no state"),
    (dict(noise={"v": -1.0}), "noise of v = -1 is a variance"),
    (dict(noise={"v": float("nan")}), "noise of v"),
    (dict(noise=3), "give noise="),
    (dict(chance=0.3), "chance = 0.3; give a probability between 0.5 and 1"),
    (dict(chance=1.0), "chance = 1; give"),
    (dict(limited="z"), "'z'"),
    (dict(horizon=0), "horizon = 0 must be a whole number >= 1"),
    (dict(h=-1.0), "h = -1 s must be positive"),
    (dict(weights={"f": 0.0}), "weight"),
]


@pytest.mark.parametrize(("options", "text"), BAD, ids=[t for _, t in BAD])
def test_bad_input_is_one_line(options, text):
    with pytest.raises(BadInput, match=text) as error:
        margins(**options)
    assert "\n" not in str(error.value)
