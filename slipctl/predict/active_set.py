"""Quadratic programs of an optimal control problem by an active set and Riccati's recursion.

Each control of each stage has a status: free, or held at one of its bounds, at the end of its rate
limit, or tied to the stage before (move blocking); each soft row counts or does not. With all of
them fixed the problem is one of linear quadratic control: a backward recursion for the value
function 1/2 z'P z + p'z, a forward roll for steps and multipliers. A status changes where a control
passes a bound or a multiplier has the wrong sign, all at once: a primal-dual active set, after
Hintermueller, Ito and Kunisch (2002). Nothing changes at the solution. The roll cuts every control
at its bounds, so that what comes out is feasible after any number of passes.

No loop depends on data but that over the passes, there is no heap, and memory is linear in the
number of stages.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import casadi as ca

from slipctl.predict.horizon import Horizon, Layout, Stage

FREE, HIGH, FASTER, TIED = 0.0, 1.0, 2.0, 3.0
"""Status of a control; -1 and -2 are the low bound and the fastest fall."""

SMALL = 1e-6
"""Part of its size by which a multiplier or a control must be wrong before a status changes."""

LEAST = 1e-10
"""Curvature of each scaled control added to the cost, so that one without effect stays put."""


class ActiveSet:
    """Solver of the QP of one horizon.

    Args:
        horizon: the problem.
        stage, end: layouts of its packed columns.
        tied: whether each stage's controls are tied to those of the stage before.
        rates: whether the controls have rate limits.
        passes: largest number of passes.
    """

    def __init__(
        self, horizon: Horizon, stage: Layout, end: Layout, tied: list[bool], rates: bool,
        passes: int,
    ) -> None:  # fmt: skip
        self.h, self.stage, self.end = horizon, stage, end
        self.tied, self.rates, self.passes = tied, rates, passes
        self.memory = rates or any(tied)
        self.nz = horizon.nx + (horizon.nu if self.memory else 0)
        self.upper = ca.Sparsity.upper(self.nz)
        self._backward, self._gains = self._make_backward()
        self._forward, self._start = self._make_forward(), self._make_start()

    @property
    def statuses(self) -> int:
        """Number of statuses of all stages, the last one's soft rows included."""
        return self.h.stages * (self.h.nu + self.h.nc) + self.h.nc

    def shifted(self, S: Any) -> Any:
        """Statuses of the plan one stage later, with the ties where they belong."""
        m, N = self.h.nu + self.h.nc, self.h.stages
        columns = [S[m * k : m * (k + 1)] for k in range(N)]
        columns = [*columns[1:], columns[-1]]
        return self._tie(columns, S[m * N :])

    def first(self) -> Any:
        """Statuses without any guess."""
        m, N = self.h.nu + self.h.nc, self.h.stages
        return self._tie([ca.MX.zeros(m) for _ in range(N)], ca.MX.zeros(self.h.nc))

    def _tie(self, columns: list[Any], last: Any) -> Any:
        if not any(self.tied):
            return ca.vertcat(*columns, last)
        nu, done = self.h.nu, []
        for column, tied in zip(columns, self.tied, strict=True):
            u = column[:nu]
            kept = ca.MX.ones(nu) * TIED if tied else ca.if_else(u == TIED, FREE, u)
            done.append(ca.vertcat(kept, ca.reshape(column[nu:], self.h.nc, 1)))
        return ca.vertcat(*done, last)

    def solve(self, D: Any, E: Any, S: Any, U: Any, before: Any, bounds: Any, dx: Any) -> Any:
        """Solve the QP around a guess.

        Args:
            D: columns of the stages, one per column.
            E: column of the last stage.
            S: statuses to begin with.
            U: controls of the guess, scaled, stage by stage.
            before: control before the first stage, scaled.
            bounds: (lo, hi, rate) of the controls, scaled.
            dx: measured state less the guess of it.

        Returns:
            Steps of the states and of the controls, statuses, how many statuses the last pass
            changed, passes made.
        """
        nx, nu, N = self.h.nx, self.h.nu, self.h.stages
        once = self._one_pass()
        zeros = (ca.MX.zeros(nx * (N + 1)), ca.MX.zeros(nu * N))
        z = ca.vertcat(*zeros, S, 1, 0)
        for _ in range(self.passes):
            z = once(z[-2] > 0, z, D, E, U, before, bounds, dx)
        sizes = [0, nx * (N + 1), nu * N, self.statuses, 1, 1]
        edges = [sum(sizes[: k + 1]) for k in range(len(sizes))]
        return tuple(z[a:b] for a, b in pairwise(edges))

    def _one_pass(self) -> ca.Function:
        """Function (go on?, z, data) -> z, z the five results of :meth:`solve` in one column."""
        nx, nu, nc, N = self.h.nx, self.h.nu, self.h.nc, self.h.stages
        m = nu + nc
        D, E = ca.MX.sym("D", self.stage.size, N), ca.MX.sym("E", self.end.size)
        U, before = ca.MX.sym("U", nu * N), ca.MX.sym("before", nu)
        bounds, dx = ca.MX.sym("bounds", 3 * nu), ca.MX.sym("dx", nx)
        z = ca.MX.sym("z", nx * (N + 1) + nu * N + self.statuses + 2)
        S = z[nx * (N + 1) + nu * N : -2]
        columns = ca.horzsplit(D)
        s = ca.vertsplit(S, [*range(0, m * N + 1, m), *([m * N + nc] if nc else [])])
        last = s[N] if nc else ca.MX(0, 1)
        u = ca.vertsplit(U, nu)
        P, p = self._start(E, last)
        gains: list[Any] = [None] * N
        for k in reversed(range(N)):
            earlier = u[k - 1] if k else before
            P, p, gains[k] = self._backward(P, p, columns[k], s[k], u[k], earlier, bounds)
        step = ca.vertcat(dx, ca.MX.zeros(self.nz - nx))
        X, V, statuses = [dx], [], []
        for k in range(N):
            earlier = u[k - 1] if k else before
            step, dv, status = self._forward(
                step, gains[k], columns[k], s[k], u[k], earlier, bounds
            )
            X.append(step[:nx])
            V.append(dv)
            statuses.append(status)
        if nc:
            statuses.append(self._last_statuses()(X[-1], E))
        found = ca.vertcat(*statuses)
        after = ca.vertcat(*X, *V, found, ca.sumsqr(found - S), z[-1] + 1)
        data = [D, E, U, before, bounds, dx]
        go = ca.Function("qp_pass", [z, *data], [after])
        stay = ca.Function("qp_done", [z, *data], [z])
        return ca.Function.if_else("qp_maybe", go, stay)

    # ---- one stage ----------------------------------------------------------------------------

    def _unpack(self, column: Any) -> Stage:
        A, B, b, H, g, c, C = self.stage.unpack(column)
        return Stage(A, B, b, ca.triu2symm(H), g, c, C)

    def _symbols(self) -> tuple[Any, ...]:
        nu = self.h.nu
        return (
            ca.SX.sym("d", self.stage.size), ca.SX.sym("s", nu + self.h.nc), ca.SX.sym("u", nu),
            ca.SX.sym("earlier", nu), ca.SX.sym("bounds", 3 * nu),
        )  # fmt: skip

    def _held(self, s: Any, u: Any, earlier: Any, bounds: Any) -> tuple[Any, Any]:
        """Step (a + E z) of the controls that are not free."""
        nx, nu = self.h.nx, self.h.nu
        a, E = ca.SX.zeros(nu), ca.SX(nu, self.nz)
        for i in range(nu):
            lo, hi, rate = bounds[i], bounds[nu + i], bounds[2 * nu + i]
            a[i] = ca.if_else(s[i] > 0, hi, lo) - u[i]
            if self.memory:
                follows = ca.fabs(s[i]) >= FASTER
                by = ca.if_else(s[i] == TIED, 0, ca.if_else(s[i] > 0, rate, -rate))
                a[i] = ca.if_else(follows, earlier[i] + by - u[i], a[i])
                E[i, nx + i] = ca.if_else(follows, 1, 0)
        return a, E

    def _make_start(self) -> ca.Function:
        """Function (column of the last stage, its statuses) -> (P, p)."""
        nx, nc = self.h.nx, self.h.nc
        e, s = ca.SX.sym("e", self.end.size), ca.SX.sym("s", nc)
        H, g, c, C = self.end.unpack(e)
        P, p = ca.SX(self.nz, self.nz), ca.SX.zeros(self.nz)
        P[:nx, :nx] = ca.triu2symm(H) + C.T @ ca.diag(s) @ C
        p[:nx] = g + C.T @ (s * c)
        return ca.Function("qp_end", [e, s], [self._triangle(P), p], {"cse": True})

    def _triangle(self, P: Any) -> Any:
        P = ca.densify(P)
        return ca.vertcat(*[P[i, j] for j in range(self.nz) for i in range(j + 1)])

    def _last_statuses(self) -> ca.Function:
        x, e = ca.SX.sym("x", self.h.nx), ca.SX.sym("e", self.end.size)
        _, _, c, C = self.end.unpack(e)
        return ca.Function("qp_last", [x, e], [ca.densify((c + C @ x) > 0)])

    def _quadratic(self, P: Any, p: Any, column: Any, s: Any) -> tuple[Any, ...]:
        """Cost to go over (z, v): Qzz, Qvz, Qvv, qz, qv."""
        nx, nu = self.h.nx, self.h.nu
        t = self._unpack(column)
        sigma = ca.reshape(s[nu:], self.h.nc, 1)
        H = t.H + t.C.T @ ca.diag(sigma) @ t.C
        g = t.g + t.C.T @ (sigma * t.c)
        A, B, b = ca.SX(self.nz, self.nz), ca.SX(self.nz, nu), ca.SX(self.nz, 1)
        A[:nx, :nx], B[:nx, :], b[:nx] = t.A, t.B, t.b
        if self.memory:
            B[nx:, :] = ca.SX.eye(nu)
        PA, PB, pb = P @ A, P @ B, P @ b + p
        Qzz, Qvz, qz = A.T @ PA, B.T @ PA, A.T @ pb
        Qzz[:nx, :nx] += H[:nx, :nx]
        Qvz[:, :nx] += H[nx:, :nx]
        qz[:nx] += g[:nx]
        Qvv = H[nx:, nx:] + B.T @ PB + LEAST * ca.SX.eye(nu)
        return Qzz, Qvz, Qvv, qz, g[nx:] + B.T @ pb

    def _make_backward(self) -> tuple[ca.Function, int]:
        """Function (P, p, column, statuses, u, earlier, bounds) -> (P, p, gains)."""
        nu = self.h.nu
        column, s, u, earlier, bounds = self._symbols()
        triangle, p = ca.SX.sym("P", self.upper.nnz()), ca.SX.sym("p", self.nz)
        Qzz, Qvz, Qvv, qz, qv = self._quadratic(
            ca.triu2symm(ca.SX(self.upper, triangle)), p, column, s
        )
        a, E = self._held(s, u, earlier, bounds)
        free = s[:nu] == FREE
        F, held = ca.diag(free), ca.diag(1 - free)
        M = F @ Qvv @ F + held
        K = held @ E - F @ ca.solve(M, F @ (Qvz + Qvv @ held @ E))
        k = held @ a - F @ ca.solve(M, F @ (qv + Qvv @ held @ a))
        if self.memory:
            following = Qzz + K.T @ Qvv @ K + K.T @ Qvz + Qvz.T @ K
            ahead = qz + K.T @ (Qvv @ k + qv) + Qvz.T @ k
        else:  # rows of K are zero, or solve Qvv K = -Qvz
            following, ahead = Qzz + Qvz.T @ K, qz + Qvz.T @ k
        gains = ca.densify(ca.vertcat(ca.vec(K), k, ca.vec(Qvz), ca.vec(Qvv), qv))
        f = ca.Function(
            "qp_backward", [triangle, p, column, s, u, earlier, bounds],
            [self._triangle(following), ca.densify(ahead), gains], {"cse": True},
        )  # fmt: skip
        return f, gains.numel()

    def _make_forward(self) -> ca.Function:
        """Function (z, gains, column, statuses, u, earlier, bounds) -> (z after, dv, statuses)."""
        nx, nu, nz = self.h.nx, self.h.nu, self.nz
        column, s, u, earlier, bounds = self._symbols()
        z, G = ca.SX.sym("z", nz), ca.SX.sym("G", self._gains)
        sizes = [nu * nz, nu, nu * nz, nu * nu, nu]
        K, k, Qvz, Qvv, qv = ca.vertsplit(G, [sum(sizes[:i]) for i in range(6)])
        K, Qvz = ca.reshape(K, nu, nz), ca.reshape(Qvz, nu, nz)
        wanted = u + K @ z + k
        dv, hi_rate, lo_rate = ca.SX.zeros(nu), [], []
        for i in range(nu):
            lo, hi = bounds[i], bounds[nu + i]
            if self.rates:
                was = earlier[i] + z[nx + i]
                fastest, slowest = was + bounds[2 * nu + i], was - bounds[2 * nu + i]
                hi_rate.append(fastest < hi)
                lo_rate.append(slowest > lo)
                hi, lo = ca.fmin(hi, fastest), ca.fmax(lo, slowest)
            else:
                hi_rate.append(ca.SX(0))
                lo_rate.append(ca.SX(0))
            dv[i] = ca.fmin(hi, ca.fmax(lo, wanted[i])) - u[i]
        slope = qv + Qvz @ z + ca.reshape(Qvv, nu, nu) @ dv
        status = ca.SX.zeros(nu)
        for i in range(nu):
            high = ca.if_else(hi_rate[i], FASTER, HIGH)
            low = -ca.if_else(lo_rate[i], FASTER, HIGH)
            beyond = wanted[i] - u[i] - dv[i]
            much = SMALL * (1 + ca.fabs(qv[i]))
            outside = ca.if_else(beyond > SMALL, high, ca.if_else(beyond < -SMALL, low, FREE))
            above = ca.if_else(slope[i] > much, FREE, high)
            below = ca.if_else(slope[i] < -much, FREE, low)
            status[i] = ca.if_else(
                s[i] == FREE, outside,
                ca.if_else(s[i] == TIED, TIED, ca.if_else(s[i] > 0, above, below)),
            )  # fmt: skip
        t = self._unpack(column)
        x = t.A @ z[:nx] + t.B @ dv + t.b
        counts = (t.c + t.C @ ca.vertcat(z[:nx], dv)) > 0
        after = ca.vertcat(x, dv) if self.memory else x
        return ca.Function(
            "qp_forward", [z, G, column, s, u, earlier, bounds],
            [ca.densify(after), dv, ca.densify(ca.vertcat(status, counts))], {"cse": True},
        )  # fmt: skip
