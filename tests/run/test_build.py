"""A Function compiled and in CasADi's virtual machine: the same bits, for what C is rewritten."""

from __future__ import annotations

import platform

import casadi as ca
import numpy as np
import pytest

from slipctl.run import build

pytestmark = pytest.mark.skipif(build.compiler() is None, reason="needs a C compiler")


def _both(f: ca.Function, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Logged outputs of a Function without states, compiled and interpreted."""
    found = []
    for compile in (True, False):
        y = np.empty((len(u), f.size1_out(1)))
        x_log = np.empty((len(u), 1))
        roll = build.make_roller(f, compile)
        assert roll(np.zeros(1), u, np.zeros(0), x_log, y) == len(u)
        found.append(y)
    return found[0], found[1]


def _function(u: ca.MX | ca.SX, y: ca.MX | ca.SX) -> ca.Function:
    kind = type(u)
    x = kind.sym("x")
    return ca.Function("roll", [x, u, kind.sym("p", 0)], [x, y])


@pytest.mark.skipif(
    platform.machine() != "x86_64" or platform.libc_ver()[0] != "glibc",
    reason="elsewhere the library is called, and the sign of a zero among equals is its own",
)
def test_smaller_and_larger_of_two() -> None:
    """Every pair of zeros of both signs, infinities, NaN and plain numbers, bit by bit."""
    special = [0.0, -0.0, 1.0, -1.0, np.inf, -np.inf, np.nan, 5e-324, 1.7e308]
    pairs = np.array([(a, b) for a in special for b in special])
    u = ca.SX.sym("u", 2)
    f = _function(u, ca.vertcat(ca.fmin(u[0], u[1]), ca.fmax(u[0], u[1])))
    compiled, interpreted = _both(f, pairs)
    np.testing.assert_array_equal(np.isnan(compiled), np.isnan(interpreted))
    number = ~np.isnan(interpreted)
    assert (compiled.view(np.int64) == interpreted.view(np.int64))[number].all()


@pytest.mark.parametrize("shape", [(1, 1), (7, 5), (25, 25)])
def test_a_dense_product_is_summed_in_the_same_order(shape: tuple[int, int]) -> None:
    """Numbers of many sizes, so that another order of the sum would show."""
    rng = np.random.default_rng(3)
    spread = rng.normal(size=shape) * 10.0 ** rng.uniform(-8, 8, shape)
    u = ca.MX.sym("u", shape[1])
    f = _function(u, ca.mtimes(ca.MX(ca.DM(spread)), u))
    rows = rng.normal(size=(40, shape[1])) * 10.0 ** rng.uniform(-8, 8, (40, shape[1]))
    compiled, interpreted = _both(f, rows)
    assert (compiled.view(np.int64) == interpreted.view(np.int64)).all()


@pytest.mark.parametrize("columns", [1, 3])
def test_a_sparse_product_is_summed_in_the_same_order(columns: int) -> None:
    """On a vector (in place) and on several columns (as CasADi writes it)."""
    rng = np.random.default_rng(5)
    size = (30, 40)
    some = np.where(rng.random(size) < 0.2, rng.normal(size=size) * 10.0 ** rng.uniform(-8, 8), 0)
    u = ca.MX.sym("u", 40)
    wide = ca.horzcat(*(u * (k + 1) for k in range(columns)))
    f = _function(u, ca.vec(ca.mtimes(ca.MX(ca.sparsify(ca.DM(some))), wide)))
    rows = rng.normal(size=(40, 40)) * 10.0 ** rng.uniform(-8, 8, (40, 40))
    compiled, interpreted = _both(f, rows)
    assert (compiled.view(np.int64) == interpreted.view(np.int64)).all()
