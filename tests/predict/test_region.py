"""Regions of attraction of the regulator's law, proved and refuted."""

import numpy as np
import pytest

from slipctl import (
    BadInput,
    Input,
    Output,
    Scenario,
    State,
    connect,
    flow,
    law,
    nmpc,
    sampled,
    simulate,
    terminal_region,
)
from slipctl.draw import show

H = 0.05


@flow(y=Output("rad^2", "bowl"))
def stick(
    a=State("rad", 0.0, "angle"), w=State("rad/s", 0.0, "rate"),
    M=Input("1/s^2", "torque", lo=-300, hi=300),
):  # fmt: skip
    """A stick that falls the faster the further it leans."""
    return dict(a=w, w=5 * a + 8 * a**3 + M), dict(y=a * a + 0.1 * w * w)


@law(e=Output("rad"), r=Output("rad/s"), m=Output("1/s^2"))
def upright(
    a=Input("rad", "angle"), w=Input("rad/s", "rate"), M=Input("1/s^2", "torque"),
    to=Input("rad", "wanted", value=0.0),
):  # fmt: skip
    """Lean, rate and torque."""
    return dict(e=a - to, r=w, m=M)


WEIGHTS = {"e": 3.0, "r": 0.5, "m": 0.3}


def find(**options):
    """Region of the stick."""
    return terminal_region(stick, upright, "M", **{"h": H, "weights": WEIGHTS} | options)


@pytest.fixture(scope="module")
def wide():
    return find()


def regulated(region, starts, ticks):
    """V of runs of the regulator's law by itself, written anew: scipy's Riccati, own RK4."""
    import scipy.linalg

    def rate(x, M):
        return np.array([x[1], 5 * x[0] + 8 * x[0] ** 3 + M])

    def step(x, M):
        k = [rate(x, M)]
        for way in (H / 2, H / 2, H):
            k.append(rate(x + way * k[-1], M))
        return x + H / 6 * (k[0] + 2 * k[1] + 2 * k[2] + k[3])

    eps = 1e-6
    axes = np.eye(2) * eps
    A = np.column_stack([(step(e, 0) - step(-e, 0)) / (2 * eps) for e in axes])
    B = ((step(np.zeros(2), eps) - step(np.zeros(2), -eps)) / (2 * eps))[:, None]
    P = scipy.linalg.solve_discrete_are(A, B, np.diag([9.0, 0.25]), np.array([[0.09]]))
    K = np.linalg.solve(np.array([[0.09]]) + B.T @ P @ B, B.T @ P @ A)
    assert region.matrix == pytest.approx(P, rel=1e-5)
    x, found = np.array(starts), []
    for _ in range(ticks):
        found.append(np.einsum("ik,ij,jk->k", x, P, x))
        x = step(x, -(K @ x)[0])
    return np.array(found)


@pytest.mark.second
def test_v_falls_from_every_start_inside_and_rises_from_the_counterexample(wide):
    """The model is written a second time; proved and refuted levels are 1 % apart."""
    assert wide.contracting < wide.level <= wide.beyond < 1.01 * wide.level
    assert wide.why == "V does not fall"
    rng = np.random.default_rng(0)
    rays = np.linalg.solve(np.linalg.cholesky(wide.matrix).T, rng.normal(size=(2, 500)))
    sizes = np.sqrt(np.einsum("ik,ij,jk->k", rays, wide.matrix, rays))
    V = regulated(wide, rays / sizes * np.sqrt(wide.level) * (1 - 1e-6), 200)
    assert (np.diff(V[:3], axis=0) < 0).all()
    assert V[-1].max() < 1e-6
    V = regulated(wide, np.array([list(wide.witness.values())]).T, 2)
    assert V[0, 0] == pytest.approx(wide.beyond)
    assert V[1, 0] >= V[0, 0]


def test_a_linear_limit_cuts_where_its_row_touches_the_ellipsoid():
    """|a| <= .3: V = .09/(P^-1)_aa, in closed form."""
    found = find(hard={"a": (-0.3, 0.3)})
    assert found.level == pytest.approx(0.09 / np.linalg.inv(found.matrix)[0, 0], rel=1e-6)
    assert found.why in ("a above its limit", "a below its limit")
    assert abs(found.witness["a"]) == pytest.approx(0.3, rel=1e-5)


@pytest.mark.second
def test_a_limit_that_bends_is_enclosed(wide):
    """A round bowl a^2 + w^2/10 <= .3: its smallest V, by the eigenvalues of P against it."""
    found = find(hard={"y": (-1.0, 0.3)})
    D = np.diag([1.0, np.sqrt(10)])
    least = 0.3 * np.linalg.eigvalsh(D @ wide.matrix @ D)[0]
    assert 0.99 * least < found.level <= least <= found.beyond < 1.01 * least


@pytest.mark.second
def test_a_plan_that_has_to_end_inside_brings_a_short_horizon_up(wide):
    """Four stages: the end is held in the region, or told where no torque leads there."""
    point = dict(terminal="lqr", at={"a": 0.0})
    tight = find(bounds={"M": (-12.0, 12.0)})
    assert tight.level < wide.level
    block = nmpc(
        stick, upright, "M", h=H, horizon=4, weights=WEIGHTS, bounds={"M": (-12.0, 12.0)},
        final=tight.law, iterations=2, **point,
    )  # fmt: skip
    wires = {"ctl.a": "stick.a", "ctl.w": "stick.w", "stick.M": "ctl.M"}
    loop = connect("loop", wires, ctl=block, stick=sampled(stick, H, "rk4"))
    log = simulate(loop, Scenario("up", 4.0, start={"stick.a": 0.6, "stick.w": 0.0}), compile=False)
    status = log["ctl.status"].values
    assert status[-1] == 0
    assert abs(float(log["stick.a"][-1])) < 1e-2
    assert "proved up to V" in show.text(block, False)
    assert block(a=2.0, w=5.0)[1]["status"] == 3


def test_it_is_told_in_words(wide):
    text = str(wide)
    assert "limits hold and V falls in every step" in text
    assert "V does not fall" in text


@law(e=Output("rad"), m=Output("1/s^2"))
def rate_alone(w=Input("rad/s", "rate"), M=Input("1/s^2", "torque")):
    """Rate and torque."""
    return dict(e=w, m=M)


@flow()
def two(v=State("m/s", 0.0, "speed"), z=State("m", 0.0, "place"), F=Input("m/s^2", lo=-1, hi=1)):
    """Place and speed."""
    return dict(v=F, z=v), {}


@law(e=Output("m/s"), m=Output("m/s^2"))
def slow(v=Input("m/s", "speed"), F=Input("m/s^2", "force")):
    """Speed alone."""
    return dict(e=v, m=F)


BAD = [
    (
        lambda: terminal_region(two, slow, "F", h=H),
        "1 of 2 directions of the states are seen",
    ),
    (lambda: find(hard={"a": (0.1, 0.5)}), "a is not within its limits; give another at="),
    (lambda: find(bounds={"M": ("low", 5.0)}), "bounds of M have to be numbers"),
    (lambda: find(h=0.0), "h = 0 s must be positive"),
    (lambda: find(at={"b": 1.0}), "at has 'b', which is no state"),
    (lambda: terminal_region(upright, upright, "M", h=H, bounds={"M": (-1, 1)}), "give the flow"),
]


@pytest.mark.parametrize(("call", "text"), BAD, ids=[t for _, t in BAD])
def test_bad_input_is_one_line(call, text):
    with pytest.raises(BadInput, match=text) as error:
        call()
    assert "\n" not in str(error.value)
