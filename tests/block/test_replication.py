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
    step,
)
from slipctl.analysis.roots import bracketed_newton


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


def test_matrices_of_copies_stand_beside_each_other():
    """Two rows and three columns each: six columns of two copies, and of one state each two."""

    @step(period=0.1, y=Output("1", shape=(2, 3)))
    def turned(A=State("1", ((1.0, 2.0, 3.0), (4.0, 5.0, 6.0)), shape=(2, 3)), u=Input("1")):
        return dict(A=A + u), dict(y=2 * A)

    many = replicate(turned, 2)
    assert many.states["A"].shape == many.outputs["y"].shape == (2, 6)
    x, y = many(u=np.array([10.0, 20.0]))
    one = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    np.testing.assert_array_equal(x["A"], np.hstack([one + 10, one + 20]))
    np.testing.assert_array_equal(y["y"], np.hstack([2 * one, 2 * one]))


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
    equation = [0.05 * x + ca.atan(40 * x) - c, 0.05 + 40 / (1 + (40 * x) ** 2)]
    residual = ca.Function("residual", [x, c], equation)
    rng = np.random.default_rng(1)
    starts, wanted = rng.uniform(-90, 90, 200), rng.uniform(-3, 3, 200)
    exact = [
        brentq(lambda s: 0.05 * s + np.arctan(40 * s) - c, -100, 100, xtol=1e-14)  # noqa: B023
        for c in wanted
    ]
    for root in bracketed_newton(residual, 30, 31, 32, 37):  # it stays once it is there
        found = np.array(root.map(200)(starts[None], -100.0, 100.0, wanted[None])).ravel()
        np.testing.assert_allclose(found, exact, rtol=1e-12, atol=1e-13)
