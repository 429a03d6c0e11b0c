"""Quadratic programs of fixed size with a constant Hessian: one kernel for Python and for C."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from slipctl.block.text.intermediates import remember_locals
from slipctl.errors import BadInput, check_whole

REGULAR, RELAXATION = 1e-6, 1.6
"""Added to the curvature, and by how much a step goes on; of the method."""


def qp_kernel(H: np.ndarray, A: np.ndarray, iterations: int = 25) -> ca.Function:
    """Make the solver of min x'Hx/2 + q'x subject to l <= A x <= u, for changing q, l, u.

    The alternating direction method of multipliers of OSQP with a fixed number of iterations, the
    matrix (H + sigma I + rho A'A)^-1 computed beforehand: no heap and no branch. What it ends with
    is where it starts in the next tick, so that it follows a problem that changes slowly.
    Source: Stellato et al., OSQP, Mathematical Programming Computation 12 (2020).

    Args:
        H: positive definite Hessian. A: one row per constraint.
        iterations: how many; the same every time.

    Returns:
        Function ``(q, l, u, start) -> (x, end)``; start and end have n + 2 m numbers, at first 0.

    Raises:
        BadInput: shapes that do not fit, or a Hessian that is not positive definite.
    """
    H, A = np.atleast_2d(np.asarray(H, float)), np.atleast_2d(np.asarray(A, float))
    n, m = len(H), len(A)
    if H.shape != (n, n) or A.shape != (m, n):
        raise BadInput(f"qp_kernel: H is {H.shape} and A {A.shape}; they must be (n, n) and (m, n)")
    if not np.allclose(H, H.T) or np.linalg.eigvalsh(H)[0] <= 0:
        raise BadInput("qp_kernel: H must be symmetric and positive definite")
    check_whole("qp_kernel: iterations", iterations)
    weight = 3 * float(np.trace(H) / np.trace(A.T @ A))  # of the constraints
    inverse = np.linalg.inv(H + REGULAR * np.eye(n) + weight * A.T @ A)
    K, rows = ca.DM(inverse), ca.sparsify(ca.DM(A))  # most of A is zero, and costs nothing so
    q, lo, hi = ca.MX.sym("q", n), ca.MX.sym("l", m), ca.MX.sym("u", m)
    state, given = ca.MX.sym("start", n + 2 * m), ca.vertcat(q, lo, hi)

    @remember_locals
    def one() -> Any:
        """Function (x, z, y; q, l, u) -> (x, z, y) of one iteration."""
        point, problem = ca.MX.sym("point", n + 2 * m), ca.MX.sym("problem", n + 2 * m)
        x, z, y = ca.vertsplit(point, [0, n, n + m, n + 2 * m])
        q, lo, hi = ca.vertsplit(problem, [0, n, n + m, n + 2 * m])
        slope = REGULAR * x - q + ca.mtimes(rows.T, weight * z - y)
        solved = ca.mtimes(K, slope)
        reached = ca.mtimes(rows, solved)
        moved = RELAXATION * reached + (1 - RELAXATION) * z
        following = ca.fmax(lo, ca.fmin(hi, moved + y / weight))
        after = ca.vertcat(
            RELAXATION * solved + (1 - RELAXATION) * x, following, y + weight * (moved - following)
        )  # fmt: skip
        return "qp_iteration", [point, problem], [after], ["point", "problem"], ["point_next"]

    whole = one().fold(int(iterations))
    end = whole(state, ca.repmat(given, 1, int(iterations)))
    names = ["q", "l", "u", "start"], ["x", "end"]
    return ca.Function("qp", [q, lo, hi, state], [end[:n], end], *names)
