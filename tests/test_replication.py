"""Copies of a block and the bracketed Newton: equal to n blocks, equal to scipy's roots."""

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import brentq

from slipctl import (
    BadInput,
    Input,
    Noise,
    Output,
    Param,
    Scenario,
    State,
    c_module,
    connect,
    flow,
    replicate,
    sampled,
    simulate,
)
from slipctl.rooting import bracketed_newton


@flow(y=Output("m", "place"), both=Output("m/s", "sum"))
def lag(
    x=State("m", "L / 2", "place"),
    u=Input("m", "wanted"),
    wind=Input("m/s", "the same for all", value=0.0),
    n=Noise(),
    tau=Param("s", 2.0, "time constant", lo=0.1),
    L=Param("m", 4.0, "length", lo=0),
    gain=Param("1/s", "1 / tau", "derived"),
):
    return dict(x=gain * (u - x) + wind), dict(y=x + 0 * n * L, both=wind + u * gain)


def test_copies_are_blocks_side_by_side():
    many = replicate(lag, 3, shared=("wind",), distinct=("tau",))
    tau, u = np.array([1.0, 2.0, 4.0]), np.array([5.0, -1.0, 0.5])
    rates, outputs = many.with_params(tau=tau)(u=u, wind=0.25)
    for k in range(3):
        rate, output = lag(tau=tau[k], u=u[k], wind=0.25)
        assert rates["x"][k] == rate["x"]
        assert outputs["y"][k] == output["y"]
        assert outputs["both"][k] == output["both"]
    assert many.params["gain"].shape == (3,)
    assert many.params["L"].shape == ()
    assert list(many.start(x=[1.0, 2.0, 3.0])["x"]) == [1, 2, 3]
    assert list(many.with_params(L=6.0).start()["x"]) == [3, 3, 3]
    assert many.check_units() == lag.check_units() == []


def test_values_of_copies_outlive_a_connection_and_a_swap():
    many = sampled(replicate(lag, 2, ("wind",), ("tau",)), 0.1, "rk4")
    loop = connect("loop", {"a.wind": "wind"}, a=many)
    loop = loop.with_params(**{"a.tau": [1.0, 3.0], "a.L": 2.0})
    assert list(loop.param_values()["a.gain"]) == [1, 1 / 3]
    assert list(loop.swap("a", many).param_values()["a.tau"]) == [2, 2]
    assert list(loop.start()["a.x"]) == [1, 1]


def test_copies_in_c_are_those_of_the_block(tmp_path, needs_compiler):
    many = sampled(replicate(lag, 3, ("wind",), ("tau",)), 0.1, "rk4")
    many = many.with_params(tau=[1.0, 2.0, 4.0])
    c = c_module(many, tmp_path).compile().load()
    x = many.start()
    for k in range(5):
        u = {"u": np.array([k, 1.0, -k]), "wind": 0.1 * k}
        x, wanted = many(**x, **u)
        found = c.step(**u)
        for name, value in wanted.items():
            np.testing.assert_array_equal(found[name], value)


@pytest.mark.parametrize("compile", [True, False])
def test_log_has_an_axis(compile):
    loop = connect("loop", {}, a=sampled(replicate(lag, 2), 0.1, "rk4"))
    run = Scenario("s", 1.0, inputs={"u": lambda t: np.stack([t, -t], axis=1)})
    log = simulate(loop, run, compile=compile)
    assert log["a.y"].dims == ("time", "axle")
    assert log["a.y"].shape == (10, 2)
    alone = connect("loop", {}, a=sampled(lag, 0.1, "rk4"))
    for k, sign in enumerate((1, -1)):
        one = simulate(alone, run.but(inputs={"u": lambda t, s=sign: s * t}))
        np.testing.assert_array_equal(log["a.y"][:, k], one["a.y"])


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: replicate(lag, 0), "whole number >= 1"),
        (lambda: replicate(lag, 2, shared=("winds",)), "no input 'winds'; did you mean 'wind'"),
        (lambda: replicate(lag, 2, distinct=("T",)), "no parameter 'T'"),
    ],
)
def test_refused(call, words):
    with pytest.raises(BadInput, match=words):
        call()


def test_bracketed_newton_finds_what_brentq_finds():
    """Steep in the middle, flat far out: Newton alone diverges from most of these starts."""
    x, c = ca.SX.sym("x"), ca.SX.sym("c")

    def residual(s):
        return 0.05 * s + ca.atan(40 * s) - c, 0.05 + 40 / (1 + (40 * s) ** 2)

    root = ca.Function("root", [x, c], [bracketed_newton(residual, x, -100.0, 100.0, 30)])
    longer = [  # it stays where it is once it is there
        ca.Function("root", [x, c], [bracketed_newton(residual, x, -100.0, 100.0, n)])
        for n in range(31, 40)
    ]
    rng = np.random.default_rng(1)
    for start, wanted in zip(rng.uniform(-90, 90, 200), rng.uniform(-3, 3, 200), strict=True):
        exact = brentq(lambda s: 0.05 * s + np.arctan(40 * s) - wanted, -100, 100, xtol=1e-14)  # noqa: B023
        assert float(root(start, wanted)) == pytest.approx(exact, rel=1e-12, abs=1e-13)
        found = [float(ca.Function.call(more, [start, wanted])[0]) for more in longer]
        assert found == pytest.approx([exact] * len(longer), rel=1e-12, abs=1e-13)
