"""A small problem of an active set with all that it may have, and its steps by dense algebra."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from bench.programs import dense, upper
from slipctl.predict.qp.active_set import LEAST, ActiveSet

NX, NU, NC, N = 2, 2, 4, 3
CAPPED, SQUARE, HARD = (1, 2), (False, True), (1,)


def solver(tied: list[bool], rates: bool, bounded: bool = True, **more: Any) -> ActiveSet:
    """Two states, two controls, four soft rows and three stages; rows 1 and 2 have caps."""
    sizes: Any = SimpleNamespace(
        nx=NX, nu=NU, nc=NC, stages=N, capped=CAPPED, square=SQUARE, hard=HARD, shared=0,
        bounded=bounded,
    )  # fmt: skip
    n = NX + NU
    stage = dense((NX, NX), (NX, NU), (NX, 1), n, (n, 1), (NC, 1), (NC, n), (len(CAPPED), 1))
    end = dense(NX, (NX, 1), (NC, 1), (NC, NX), (len(CAPPED), 1))
    return ActiveSet(sizes, stage, end, tied, rates, **{"passes": 20, "rescue": 60} | more)


class Numbers:
    """Numbers of such a problem, as dense matrices and as an active set is given them."""

    def __init__(self, seed: int, caps: tuple[float, float] = (3.0, 5.0)) -> None:
        rng, n = np.random.default_rng(seed), NX + NU
        self.A, self.B = rng.normal(size=(N, NX, NX)), rng.normal(size=(N, NX, NU))
        self.b = rng.normal(size=(N, NX))
        J = rng.normal(size=(N + 1, n, n))
        self.H, self.g = np.swapaxes(J, 1, 2) @ J, rng.normal(size=(N + 1, n))
        self.c, self.C = rng.normal(size=(N + 1, NC)), rng.normal(size=(N + 1, NC, n))
        self.w = np.array(caps) * rng.uniform(0.8, 1.2, size=(N + 1, 2))
        self.lo, self.hi = -rng.uniform(2, 3, size=(N, NU)), rng.uniform(2, 3, size=(N, NU))
        self.rate = rng.uniform(1, 2, size=(N, NU))
        self.U, self.before = rng.uniform(-1, 1, size=(N, NU)), rng.uniform(-1, 1, size=NU)
        self.dx = rng.normal(size=NX)

    @property
    def data(self) -> tuple[np.ndarray, ...]:
        """(D, E, U, before, bounds, dx)."""
        D = [
            np.r_[
                self.A[k].ravel("F"), self.B[k].ravel("F"), self.b[k], upper(self.H[k]),
                self.g[k], self.c[k], self.C[k].ravel("F"), self.w[k],
            ]
            for k in range(N)
        ]  # fmt: skip
        E = np.r_[
            upper(self.H[N, :NX, :NX]), self.g[N, :NX], self.c[N],
            self.C[N, :, :NX].ravel("F"), self.w[N],
        ]  # fmt: skip
        bounds = np.hstack([self.lo, self.hi, self.rate]).T
        return np.array(D).T, E, self.U.ravel(), self.before, bounds, self.dx

    # ---- over y = (x_0 ... x_N, v_0 ... v_N-1) ------------------------------------------------

    size = NX * (N + 1) + NU * N

    def x(self, k: int) -> np.ndarray:
        """Matrix that takes the state of a stage from y."""
        return np.eye(self.size)[NX * k : NX * (k + 1)]

    def v(self, k: int) -> np.ndarray:
        """The same of its control."""
        at = NX * (N + 1) + NU * k
        return np.eye(self.size)[at : at + NU]

    def z(self, k: int) -> np.ndarray:
        """Of both; of the last stage its state and nothing."""
        return np.vstack([self.x(k), self.v(k) if k < N else np.zeros((NU, self.size))])

    def cost(self) -> tuple[np.ndarray, np.ndarray]:
        """(H, g) of all stages."""
        H = sum(self.z(k).T @ self.H[k] @ self.z(k) for k in range(N + 1))
        H = H + LEAST * sum(self.v(k).T @ self.v(k) for k in range(N))
        return H, sum(self.z(k).T @ self.g[k] for k in range(N + 1))

    def moved(self, k: int) -> tuple[np.ndarray, np.ndarray]:
        """(M, m): the control of a stage less that of the stage before is M y + m."""
        if k:
            return self.v(k) - self.v(k - 1), self.U[k] - self.U[k - 1]
        return self.v(0), self.U[0] - self.before

    def motion(self) -> tuple[np.ndarray, np.ndarray]:
        """(A, b) with A y = b: the first state, and the steps."""
        rows, right = [self.x(0)], [self.dx]
        for k in range(N):
            rows.append(self.x(k + 1) - self.A[k] @ self.x(k) - self.B[k] @ self.v(k))
            right.append(self.b[k])
        return np.vstack(rows), np.concatenate(right)
