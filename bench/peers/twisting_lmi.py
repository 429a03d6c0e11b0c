"""Speed of the super-twisting criteria against one LMI, built and solved by cvxpy and Clarabel."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np

from slipctl.models.super_twisting.certificate import super_twisting
from slipctl.models.super_twisting.certificate.twisting_report import exact_gains, exact_verdict

GAINS = (2.0, 1.1, 1.0)
SIDE = 200
"""Gains along each side of the map."""


def margin(k1: float, k2: float, L: float) -> float:
    """Largest t with [[A'P + PA + th L^2 C'C, PB], [B'P, -th]] <= -t I and P >= t I, trace P = 1.

    A quadratic function of (|x1|^.5 sgn x1, x2) proves the gains if and only if it is positive.
    """
    import cvxpy as cp

    A = np.array([[-k1 / 2, 0.5], [-k2, 0.0]])
    B, C = np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]])
    P, theta, t = cp.Variable((2, 2), symmetric=True), cp.Variable((1, 1)), cp.Variable()
    inner = A.T @ P + P @ A + theta[0, 0] * L**2 * (C.T @ C)
    whole = cp.bmat([[inner, P @ B], [B.T @ P, -theta]])
    held = [(whole + whole.T) / 2 << -t * np.eye(3), P >> t * np.eye(2), cp.trace(P) == 1]
    problem = cp.Problem(cp.Maximize(t), held)
    problem.solve(solver=cp.CLARABEL)
    return float(problem.value)


def bench(pairs: int = 9) -> dict[str, Any]:
    """Map of every closed-form criterion, the exact one included, and one exact verdict.

    Returns:
        ``map_vs_20_lmis``: time of a 200 x 200 map over that of 20 LMIs; ``lmi_vs_verdict``: time
        of one LMI over that of one exact verdict in floats, and ``lmi_vs_proven_verdict`` over that
        of one decided with rationals.
    """
    from bench.speed import ratio

    k1, k2 = np.meshgrid(np.geomspace(0.1, 30, SIDE), np.geomspace(1.001, 100, SIDE))
    proven = exact_gains(*(Fraction(str(x)) for x in GAINS))

    def repeated(call: Callable[[], Any], times: int) -> Callable[[], None]:
        def run() -> None:
            for _ in range(times):
                call()

        return run

    lmi = repeated(lambda: margin(*GAINS), 1)
    whole = ratio(
        lambda: super_twisting.regions(k1, k2, 1.0), repeated(lmi, 20), max(pairs // 3, 2)
    )
    floats = ratio(lmi, repeated(lambda: super_twisting.exact(*GAINS), 1000), pairs)
    exact = ratio(lmi, repeated(lambda: exact_verdict(proven), 1000), pairs)
    for row in (floats, exact):
        for key in ("ratio", "ratio_min", "ratio_max"):
            row[key] *= 1000
        row["peer_s"] /= 1000
    return {"map_vs_20_lmis": whole, "lmi_vs_verdict": floats, "lmi_vs_proven_verdict": exact}
