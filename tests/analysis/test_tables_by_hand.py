"""Nodes of a table of peaks by hand, and how points, slopes and observers are put together."""

from __future__ import annotations

import numpy as np
import pytest

from slipctl import Input, Output, Param, State, flow, linear, luenberger, operating_point
from slipctl.analysis import lookup
from slipctl.analysis.linearise import _plain, matrices
from slipctl.analysis.observers import _ackermann, _observability


def by_hand(f, a, b, error):
    """Nodes of straight lines within a share of f, left out where the middle is 16 times better."""
    nodes, worst = {a, b}, 0.0

    def split(a, b):
        nonlocal worst
        middle = (a + b) / 2
        miss = np.max(abs((f(a) + f(b)) / 2 - f(middle)) / abs(f(middle)))
        if miss > error:
            nodes.add(middle)
            split(a, middle)
            split(middle, b)
        else:
            worst = max(worst, miss)
            if miss > error / 16:
                nodes.add(middle)

    split(a, b)
    return sorted(nodes), worst


@pytest.mark.parametrize("error", [0.1, 0.01, 2e-3])
def test_nodes_are_put_where_straight_lines_miss(error):
    def peaks(x):
        return np.array([[np.exp(x), 2 + x], [3.0 + x**3, 5.0]])

    xs, ys, worst = lookup._nodes("here", peaks, (0.25, 2.0), error)
    nodes, missed = by_hand(peaks, 0.25, 2.0, error)
    assert xs.tolist() == nodes
    assert ys == pytest.approx(np.array([peaks(x) for x in nodes]))
    assert worst == pytest.approx(missed)
    assert 0 < worst <= error


@flow(y=Output("1", "sum"), z=Output("1", "pair", shape=(2,)))
def plant(
    a=State("1", 0.2, "first"), v=State("1", (0.3, -0.4), "two", shape=(2,)),
    u=Input("1", "one", value=0.5), w=Input("1", "two", value=(0.1, 0.2), shape=(2,)),
    k=Param("1", 1.5, "factor"), m=Param("1", "2 * k", "follows"),
):  # fmt: skip
    """Vectors and a number that follows."""
    return (
        dict(a=k * a * u - v[1], v=[w[0] * a - 2 * v[0] * v[1], m * w[1] - v[1] ** 2]),
        dict(y=a * v[0] + 3 * w[1], z=[u * v[1], k**2 * a]),
    )


def test_matrices_are_the_slopes_by_chosen_signals_in_their_order():
    """By w, then k, of which m follows; of v and y."""
    at = {"a": 0.7, "v": [0.6, -0.9], "u": 1.1, "w": [0.25, -0.5], "k": 1.25}
    A, B, C, D, columns, rows = matrices(plant, at, ["w", "k"], ["y", "v"])
    assert columns == ["w[0]", "w[1]", "k"]
    assert rows == ["y", "v[0]", "v[1]"]
    assert pytest.approx(np.array([
        [1.25 * 1.1, 0, -1], [0.25, 1.8, -1.2], [0, 0, 1.8]])) == A  # fmt: skip
    assert pytest.approx(np.array([[0, 0, 0.7 * 1.1], [0.7, 0, 0], [0, 2.5, -0.5 * 2]])) == B
    assert pytest.approx(np.array([[0.6, 0.7, 0], [0, 1, 0], [0, 0, 1]])) == C
    assert pytest.approx(np.array([[0, 3, 0], [0, 0, 0], [0, 0, 0]])) == D
    made = linear(plant, at, ["u"], ["z"])
    assert pytest.approx(np.array([[1.25 * 0.7], [0], [0]])) == made.B
    assert pytest.approx(np.array([[0, 0, 1.1], [1.25**2, 0, 0]])) == made.C
    assert pytest.approx(np.array([[-0.9], [0]])) == made.D
    assert made.state_labels == ["a", "v[0]", "v[1]"]
    assert _plain(["a.b", "a_b", "c"]) == ["a_b", "a_b_", "c"]


def test_a_point_of_vectors_stands_still_and_gives_an_output():
    """a' = 0, v' = 0 and z[0] as wanted, by a, v, u and w[0] ... of four equations each."""
    found = operating_point(
        plant, {"w": [0.25, 0.27], "y": 1.0, "k": 1.5}, free={"a": 0.5, "v": [0.5, 0.9], "u": 1.0},
        steady=["a", "v"],
    )  # fmt: skip
    v1 = np.sqrt(3 * 0.27)
    a = found.states["a"]
    v0 = 0.25 * a / (2 * v1)
    assert found.states["v"] == pytest.approx([v0, v1])
    assert a * v0 + 3 * 0.27 == pytest.approx(1.0)
    assert found.inputs["u"] == pytest.approx(v1 / (1.5 * a))
    assert found.outputs["z"] == pytest.approx([found.inputs["u"] * v1, 2.25 * a])
    assert found.params["m"] == 3.0
    assert np.abs(np.r_[found.rates["a"], found.rates["v"]]).max() < 1e-12


def test_gains_of_one_and_of_two_measured_signals_place_the_poles():
    A = np.array([[-2.0, 1, 0], [-1, 0, 1], [1, 0.5, -3]])
    C = np.array([[1.0, 0, 0.25]])
    seen = _observability(A, C)
    assert seen == pytest.approx(np.vstack([C, C @ A, C @ A @ A]))
    poles = np.array([-4.0, -5.0 + 2j, -5.0 - 2j])
    L = _ackermann(A, seen, poles)
    found = np.linalg.eigvals(A - L @ C)
    assert np.sort_complex(found) == pytest.approx(np.sort_complex(poles))

    @flow(p=Output("1", "first"), q=Output("1", "second"))
    def chain(a=State("1"), b=State("1"), c=State("1"), u=Input("1", value=0.0)):
        """Driven in its middle."""
        return dict(a=b - 2 * a, b=c - a + u, c=0.5 * b - 3 * c + a), dict(p=a + 0.25 * c, q=b)

    block = luenberger(chain, [-4.0, -5.0, -6.5], measured=["p", "q"])
    gains = block.param_values()
    L = np.array([[float(gains[f"L_{n}_{m}"]) for m in "pq"] for n in "abc"])
    C = np.array([[1, 0, 0.25], [0, 1, 0]])
    assert np.sort(np.linalg.eigvals(A - L @ C).real) == pytest.approx([-6.5, -5, -4])
    rates, _ = block(a=0.2, b=-0.3, c=0.5, u=0.7, p_measured=0.9, q_measured=-0.4)
    x = np.array([0.2, -0.3, 0.5])
    wanted = A @ x + [0, 0.7, 0] + L @ (np.array([0.9, -0.4]) - C @ x)
    assert [float(rates[n]) for n in block.states] == pytest.approx(wanted)
