"""Lipschitz constants and observability of small systems in closed form, sizes and all."""

from __future__ import annotations

import numpy as np
import pytest

from slipctl import BadInput, Input, Output, Param, State, flow, lipschitz, observability


@flow(y=Output("N", "one"), z=Output("W", "other"))
def pair(
    a=State("m", 1.0, "first"), b=State("m/s", 2.0, "second"), u=Input("1/s", "input", value=0.5),
    k=Param("N/m", 2.0, "stiffness"), c=Param("N s/m", 3.0, "damping"),
):  # fmt: skip
    """A spring and a damper."""
    return dict(a=b - u * a, b=-0.25 * u * u * a), dict(y=k * a + c * b, z=k * a * b)


@pytest.mark.parametrize("names", ["ab", "ba"])
def test_the_constant_of_measurements_is_the_norm_over_the_box(names):
    """Slopes (2, 3; 2 b, 2 a) over sizes; the largest where both states are, 2 and 3."""
    sizes, of = {"a": 0.5, "b": 4.0}, {"y": 8.0, "z": 0.25}
    found = lipschitz(
        pair, ("y", "z"), tuple(names), {"a": (1.0, 2.0), "b": (-1.0, 3.0)},
        scale=sizes, scale_of=of, tolerance=1e-4,
    )  # fmt: skip
    J = np.array([[2 * 0.5 / 8, 3 * 4 / 8], [2 * 3 * 0.5 / 0.25, 2 * 2 * 4 / 0.25]])
    constant = np.linalg.norm(J, 2)
    assert constant * (1 - 1e-3) <= found.reached <= constant * (1 + 1e-12)
    assert constant * (1 - 1e-12) <= found.constant <= constant * (1 + 1.1e-4)
    assert {n: pytest.approx(v, abs=2e-3) for n, v in found.slopes.items()} == {
        ("y", "a"): (2, 2), ("y", "b"): (3, 3), ("z", "a"): (-2, 6), ("z", "b"): (2, 4),
    }  # fmt: skip


def test_the_constant_of_states_is_that_of_their_rates():
    """(-u, 1; -u^2/4, 0) with u up to 2."""
    found = lipschitz(
        pair, "y", ("a", "b"), {"u": (0.5, 2.0)}, of="states", scale={"a": 3.0, "b": 0.5}, k=7.0,
        scale_of={"a": 2.0, "b": 5.0}, tolerance=1e-4,
    )  # fmt: skip
    J = np.array([[-2 * 3 / 2, 0.5 / 2], [-3 / 5, 0]])
    assert found.constant == pytest.approx(np.linalg.norm(J, 2), rel=2e-4)
    assert found.slopes["b", "a"] == pytest.approx((-1, -1 / 16), abs=1e-3)
    assert found.slopes["a", "a"] == pytest.approx((-2, -0.5), abs=1e-3)
    with pytest.raises(BadInput, match="has no of='rates'"):
        lipschitz(pair, "y", "a", {"u": (0.5, 2.0)}, of="rates")
    with pytest.raises(BadInput, match=r"range of u is 2..0.5; lowest first"):
        lipschitz(pair, "y", "a", {"u": (2.0, 0.5)})
    with pytest.raises(BadInput, match="names no signal that varies"):
        lipschitz(pair, "y", "a", {})


def test_what_is_seen_is_the_jacobian_of_derivatives_over_the_horizon():
    """Rows of y and of y' times the horizon; columns by the sizes of the unknowns."""
    scale, T = {"a": 0.5, "b": 4.0}, 0.2
    found = observability(pair, "y", ("a", "b"), scale=scale, horizon=T, u=0.8, a=1.5, b=0.5)
    A, C = np.array([[-0.8, 1.0], [-0.16, 0]]), np.array([[2.0, 3.0]])
    M = np.vstack([C, T * C @ A]) * [0.5, 4.0]
    _, singular, V = np.linalg.svd(M)
    assert found.singular == pytest.approx(singular)
    assert (found.rank, found.needed, found.full) == (2, 2, True)
    sign = np.sign(V[-1, 0] * found.unseen["a"])
    assert [found.unseen[n] for n in "ab"] == pytest.approx(sign * V[-1])
    least = singular[1] / singular[0]
    for tolerance, rank in ((0.99 * least, 2), (1.01 * least, 1)):
        seen = observability(pair, "y", ("a", "b"), scale=scale, horizon=T, tolerance=tolerance,
                             u=0.8, a=1.5, b=0.5)  # fmt: skip
        assert seen.rank == rank
