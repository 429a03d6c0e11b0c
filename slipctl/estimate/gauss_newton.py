"""Steps of a windowed fit: normal equations, damped iterations, and factors of small matrices.

The cost is that of :mod:`slipctl.estimate.window`. An iteration is a step of Levenberg and
Marquardt: refused where it does not lower the cost, and more damped the next time.
"""

from __future__ import annotations

import casadi as ca

from slipctl.block.text.intermediates import remember_locals
from slipctl.estimate.model import Model

DAMPING = 0.1
"""Damping of the first iteration after a change, relative to the diagonal of the Hessian
(Marquardt 1963); a success divides it by 4, a failure multiplies it by 4, and it is kept from tick
to tick, because the valley along which a, b and c trade off is narrow and bent."""

LEAST, MOST = 1e-9, 1e9
"""Range of the damping: without effect, and standing still."""

BLIND = 64.0
"""Beyond BLIND / sqrt(eps) damping begins anew. Steps as short as that change J by less than its
rounding, so they fail whatever the data say, and damping would stay at MOST for ever, the estimate
still. In double it is beyond MOST, in float 2e5: far above what a bent valley needs."""

ROUNDED = 1e-5
"""Rounding that a variance may have beyond the spread, in float and in double."""

DATA = ("theta", "kept", "weights", "mean", "Lambda", "sigma2", "constants")
"""Arguments of the normal equations."""

HAND = ("theta_now", "J", "squares", "H", "r", "damping")
"""States of a fit in hand, in the order of an iteration."""


def normal_equations(model: Model, sums: ca.Function) -> ca.Function:
    """Function (theta, data) -> (J, squares, H, r).

    These are the cost, the sum of squared residuals, the Hessian in Gauss-Newton form and minus
    the gradient.
    """
    n, (rows, window) = model.n, sums.size_in(1)
    theta, kept = ca.MX.sym("theta", n), ca.MX.sym("kept", rows, window)
    weights, mean = ca.MX.sym("weights", 1, window), ca.MX.sym("mean", n)
    Lambda, sigma2 = ca.MX.sym("Lambda", n, n), ca.MX.sym("sigma2")
    constants = ca.MX.sym("constants", model.output.size1_in(2))
    values, slopes = model.parameters(theta)
    squares, JJ, Je = sums(values, kept, weights, constants)[:3]
    off = mean - theta
    J = (squares / sigma2 + off.T @ Lambda @ off) / 2
    H = slopes.T @ JJ @ slopes / sigma2 + Lambda
    r = slopes.T @ Je / sigma2 + Lambda @ off
    return ca.Function(
        "normal_equations", [theta, kept, weights, mean, Lambda, sigma2, constants],
        [J, squares, H, r], list(DATA), ["J", "squares", "H", "r"],
    )  # fmt: skip


def iteration(normal: ca.Function) -> ca.Function:
    """Function (theta, J, squares, H, r, damping, pivots, eps, data) -> the first six anew."""
    inputs = [ca.MX.sym(n, normal.sparsity_in(k)) for k, n in enumerate(normal.name_in())]
    theta, data = inputs[0], inputs[1:]
    now = [ca.MX.sym(n, normal.sparsity_out(k)) for k, n in enumerate(normal.name_out())]
    J, _, H, r = now
    damping, eps = ca.MX.sym("damping"), ca.MX.sym("eps")
    least = ca.MX.sym("least", theta.shape[0])
    there = theta + solver(theta.shape[0])(H + damping * ca.diag(ca.diag(H)), r, least)
    then = normal(there, *data)
    better = then[0] < J  # false for NaN too, so a step out of range is refused
    pairs = zip([theta, *now], [there, *then], strict=True)
    following = [ca.if_else(better, b, a) for a, b in pairs]
    more = ca.if_else(4 * damping > BLIND / ca.sqrt(eps), DAMPING, ca.fmin(damping * 4, MOST))
    after = ca.if_else(better, ca.fmax(damping / 4, LEAST), more)
    taken = [theta, *now, damping, least, eps, *data]
    names = [DATA[0], *normal.name_out(), "damping", "least", "eps", *DATA[1:]]
    given = [f"{n}_next" for n in names[: len(following) + 1]]
    return ca.Function("iteration", taken, [*following, after], names, given)


def _ldl(A: ca.SX, least: ca.SX) -> tuple[ca.SX, ca.SX]:
    """D and strict upper triangle L' of A = (I + L) diag(D) (I + L'); no pivot is below ``least``.

    A is Lambda_0 plus squares, so in exact arithmetic no pivot is below that of Lambda_0. In float
    it is lost where the squares are 1e7 times as large, and pivots would come out negative.
    """
    n = A.shape[0]
    D, LT = ca.SX(n, 1), ca.SX(n, n)
    for j in range(n):
        column = [A[i, j] for i in range(j + 1)]
        for i in range(j):
            LT[i, j] = column[i] / D[i]
            for k in range(i + 1, j):
                column[k] -= LT[i, k] * column[i]
            column[j] -= column[i] * LT[i, j]
        D[j] = ca.fmax(column[j], least[j])
    return D, LT


@remember_locals
def solver(n: int) -> ca.Function:
    """Function (A, b, least pivots) -> A^-1 b for symmetric positive definite A."""
    A, b, least = ca.SX.sym("A", n, n), ca.SX.sym("b", n), ca.SX.sym("least", n)
    D, LT = _ldl(A, least)
    return ca.Function(
        "solve", [A, b, least], [ca.ldl_solve(b, D, LT, range(n))],
        ["A", "b", "least"], ["solution"], {"cse": True},
    )  # fmt: skip


@remember_locals
def inverse(n: int) -> ca.Function:
    """Function (A, least pivots) -> A^-1 for symmetric positive definite A, or 1/least.

    A^-1 is at most diag(1/least). Where rounding has lost it, nothing is known but that.
    """
    A, least = ca.SX.sym("A", n, n), ca.SX.sym("least", n)
    D, LT = _ldl(A, least)
    columns = ca.ldl_solve(ca.SX.eye(n), D, LT, range(n))
    inverse = ca.densify((columns + columns.T) / 2)
    lost = ca.logic_not(ca.mmin(ca.diag(inverse) * least <= 1 + ROUNDED))
    known = ca.if_else(lost, ca.densify(ca.diag(1 / least)), inverse)
    return ca.Function("inverse", [A, least], [known], ["A", "least"], ["inverse"], {"cse": True})
