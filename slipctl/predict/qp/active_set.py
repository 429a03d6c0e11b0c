"""Quadratic programs of an optimal control problem by an active set and Riccati's recursion.

Each control of each stage has a status. It is free, or held at one of its bounds, at the end of its
rate limit, or tied to the stage before (move blocking). Each soft row counts or does not. With all
of them fixed the problem is one of linear quadratic control. It takes a backward recursion for the
value function 1/2 z'P z + p'z, and a forward roll for steps and multipliers. A status changes where
a control passes a bound or a multiplier has the wrong sign, all at once: a primal-dual active set,
after Hintermueller, Ito and Kunisch (2002). Nothing changes at the solution. The roll cuts every
control at its bounds, so that what comes out is feasible after any number of passes.

Statuses that change all at once may come back to where they were, which is found as soon as it has
happened. From there, from the last pass, and where a hard row is exceeded,
:mod:`slipctl.predict.qp.interior` goes on.

Where scenarios share their controls, rates and ties of the next stage follow those of the first
scenario. One row below the bounds of a stage tells whether each has its own.

No loop depends on data but that over the passes, there is no heap, and memory is linear in the
number of stages.
"""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import casadi as ca

from slipctl.block.text.intermediates import remember_locals
from slipctl.predict.qp.interior import Interior
from slipctl.predict.qp.stage_loops import Repeated, scan
from slipctl.predict.qp.status import DATA, FASTER, FREE, HIGH, NONE, SMALL, TIED
from slipctl.predict.stages.horizon import Horizon, Layout, Stage

TINY = 1e-9
"""Residual below which a change of status is one of names only: two limits meet."""

LEAST = 1e-10
"""Curvature of each scaled control added to the cost, so that one without effect stays put."""


class Found(NamedTuple):
    """What a solver of the quadratic program gives.

    Attributes:
        X, U: steps of the states and of the controls.
        S: statuses.
        mark: statuses of an earlier pass, to see where they come back.
        open: 0 where the conditions of Karush, Kuhn and Tucker hold, above 0 where they do not
            yet, below where more passes bring nothing: the statuses come back to where they were,
            or have settled with a hard row exceeded.
        residual: by how much, over one and the size of the gradient.
        over: largest excess of a hard row that had to be given up.
        passes: made.
    """

    X: Any
    U: Any
    S: Any
    mark: Any
    open: Any
    residual: Any
    over: Any
    passes: Any


class ActiveSet:
    """Solver of the QP of one horizon.

    Args:
        horizon: the problem.
        stage, end: layouts of its packed columns.
        tied: whether each stage's controls are tied to those of the stage before.
        rates: whether the controls have rate limits.
        passes: largest number of passes.
        rescue: largest number of steps of the interior point method after them.
        exactly: make all passes, also where nothing changes any more.
    """

    def __init__(
        self, horizon: Horizon, stage: Layout, end: Layout, tied: list[bool], rates: bool,
        passes: int, rescue: int = 0, exactly: bool = False,
    ) -> None:  # fmt: skip
        self.exactly = exactly
        self.h, self.stage, self.end = horizon, stage, end
        self.tied, self.rates, self.passes, self.rescue = tied, rates, passes, rescue
        self.memory = rates or any(tied)
        self.branches = self.memory and horizon.shared > 0
        self.nz = horizon.nx + (horizon.nu if self.memory else 0)
        self.upper = ca.Sparsity.upper(self.nz)
        self._backward = self._make_backward()
        self._gains = self._backward.nnz_out(2)
        self._forward, self._start = self._make_forward(), self._make_start()

    @property
    def statuses(self) -> int:
        """Number of statuses of all stages, the last one's soft rows included."""
        return self.h.stages * (self.h.nu + self.h.nc) + self.h.nc

    def shifted(self, S: Any, places: list[int] | None = None) -> Any:
        """Statuses of the plan one stage later, or of other stages; ties stay where they belong."""
        m, N = self.h.nu + self.h.nc, self.h.stages
        places = [*range(1, N), N - 1] if places is None else places
        stages: Any = ca.reshape(S[: m * N], m, N)
        last = ca.reshape(S[m * N :], self.h.nc, 1)
        return self._tie(stages[:, places], last)

    def first(self) -> Any:
        """Statuses without any guess."""
        m, N = self.h.nu + self.h.nc, self.h.stages
        return self._tie(ca.MX.zeros(m, N), ca.MX.zeros(self.h.nc))

    def _tie(self, stages: Any, last: Any) -> Any:
        if any(self.tied):
            nu = self.h.nu
            held = ca.repmat(ca.DM([[float(t) for t in self.tied]]), nu, 1)
            kept = ca.if_else(stages[:nu, :] == TIED, FREE, stages[:nu, :])
            stages = ca.vertcat(ca.if_else(held, TIED, kept), stages[nu:, :])
        return ca.vertcat(ca.vec(stages), last)

    def solve(self, D: Any, E: Any, S: Any, U: Any, before: Any, bounds: Any, dx: Any) -> Found:
        """Solve the QP around a guess.

        Args:
            D: columns of the stages, one per column.
            E: column of the last stage.
            S: statuses to begin with.
            U: controls of the guess, scaled, stage by stage.
            before: control before the first stage, scaled.
            bounds: (lo, hi, rate) of the controls, scaled, one column per stage.
            dx: measured state less the guess of it.
        """
        data = (D, E, U, before, self._marked(bounds), dx)
        none = ca.MX.ones(self.statuses) * NONE
        z = ca.vertcat(ca.MX.zeros(self.sizes[0] + self.sizes[1]), S, none, 1, 0, 0, 0)
        z = self.passed(z, self.passes, data, begun=True)
        if self.rescue:
            z = self._interior(self.split(z)[4] != 0, z, *data)
        return Found(*self.split(z))

    def _marked(self, bounds: Any) -> Any:
        """Bounds, and below those of a plan that branches whether scenarios have their own."""
        if not self.branches:
            return bounds
        both = self.h.shared, self.h.stages - self.h.shared
        return ca.vertcat(bounds, ca.DM([[0.0] * both[0] + [1.0] * both[1]]))

    def earlier(self, before: Any, u: Any) -> Any:
        """Controls before each stage: where the scenarios shared them, those of the first."""
        if not self.branches:
            return ca.horzcat(before, u[:, :-1])
        first, k = self.h.leaders, self.h.shared
        return ca.horzcat(before[first], u[first, :k], u[:, k:-1])

    def kept(self, dv: Any, bounds: Any) -> Any:
        """Steps of the controls of a stage that the next one follows."""
        if not self.branches:
            return dv
        return ca.if_else(bounds[-1] > 0, dv, dv[self.h.leaders])

    @property
    def sizes(self) -> list[int]:
        """Sizes of the fields of :class:`Found`."""
        h = self.h
        return [h.nx * (h.stages + 1), h.nu * h.stages, self.statuses, self.statuses, 1, 1, 1, 1]

    def split(self, z: Any) -> list[Any]:
        """The fields of :class:`Found` in one column."""
        edges = [sum(self.sizes[:k]) for k in range(len(self.sizes) + 1)]
        return [z[a:b] for a, b in pairwise(edges)]

    def passed(self, z: Any, passes: int, data: tuple[Any, ...], begun: bool = False) -> Any:
        """Make at most so many passes from a column of :class:`Found`, open if ``begun``."""
        if self.exactly:
            for _ in range(passes):
                z = self._once(z, *data)
            return z
        return self._passing(passes, z, *data, begun=begun)

    @cached_property
    def _interior(self) -> ca.Function:
        return Interior(self).function()

    @cached_property
    def _passing(self) -> Repeated:
        return Repeated(self._once, -4)

    @cached_property
    def _once(self) -> ca.Function:
        return self._one_pass()

    @remember_locals
    def _one_pass(self) -> Any:
        """Function (z, data) -> z, z the fields of :class:`Found` in one column."""
        nx, nu, nc, N = self.h.nx, self.h.nu, self.h.nc, self.h.stages
        m = nu + nc
        data = self.data()
        D, E, U, before, bounds, dx = data
        z = ca.MX.sym("z", sum(self.sizes))
        S, mark = self.split(z)[2:4]
        s: Any = ca.reshape(S[: m * N], m, N)
        last = S[m * N :] if nc else ca.MX(0, 1)
        u: Any = ca.reshape(U, nu, N)
        stages = (D, s, u, self.earlier(before, u), bounds)
        P, p = self._start(E, last)
        _, _, gains = scan(self._backward, N, 2, backward=True)(P, p, *stages)
        step = ca.vertcat(dx, ca.MX.zeros(self.nz - nx))
        _, after, V, kept, off, excess = scan(self._forward, N, 1)(step, gains, *stages)
        X, statuses = ca.vertcat(dx, ca.vec(after)), [ca.vec(kept)]
        wrong, beyond = [ca.vec(off)], [ca.vec(excess)]
        if nc:
            status, off, excess = self._last_statuses()(X[-nx:], E, last)
            statuses.append(status)
            wrong.append(off)
            beyond.append(excess)
        found = ca.vertcat(*statuses)
        residuals, excesses = ca.vertcat(*wrong), ca.vertcat(*beyond)
        residual = ca.mmax(residuals)
        over = ca.mmax(excesses) if self.h.capped else ca.MX(0)
        change, since_mark = found - S, found - mark
        differences, from_mark = ca.sumsqr(change), ca.sumsqr(since_mark)
        changed = differences > 0
        made = z[-1] + 1
        again = from_mark == 0
        open_ = ca.if_else(ca.logic_and(changed, residual > TINY), 1 - 2 * again, -(over > SMALL))
        due = sum(made == 2**i for i in range(8))  # Brent (1980): a mark at powers of two
        mark = ca.if_else(due, found, mark)
        after = ca.vertcat(X, ca.vec(V), found, mark, open_, ca.fmax(residual, over), 0, made)
        return "qp_pass", [z, *data], [after], ["z", *DATA], ["z_next"]

    def data(self) -> tuple[Any, ...]:
        """Symbols of (D, E, U, before, bounds, dx)."""
        nx, nu, N = self.h.nx, self.h.nu, self.h.stages
        return (
            ca.MX.sym("D", self.stage.size, N), ca.MX.sym("E", self.end.size),
            ca.MX.sym("U", nu * N), ca.MX.sym("before", nu),
            ca.MX.sym("bounds", 3 * nu + self.branches, N),
            ca.MX.sym("dx", nx),
        )  # fmt: skip

    # ---- one stage ----------------------------------------------------------------------------

    def _unpack(self, column: Any) -> Stage:
        A, B, b, H, *rows = self.stage.unpack(column)
        return Stage(A, B, b, ca.triu2symm(H), *rows)

    def _symbols(self) -> tuple[Any, ...]:
        nu = self.h.nu
        return (
            ca.SX.sym("column", self.stage.size), ca.SX.sym("s", nu + self.h.nc),
            ca.SX.sym("control", nu),
            ca.SX.sym("earlier", nu), ca.SX.sym("bounds", 3 * nu + self.branches),
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

    @remember_locals
    def _make_start(self) -> Any:
        """Function (column of the last stage, its statuses) -> (P, p)."""
        nx, nc = self.h.nx, self.h.nc
        e, s = ca.SX.sym("column", self.end.size), ca.SX.sym("s", nc)
        H, g, c, C, _ = self.end.unpack(e)
        P, p = ca.SX(self.nz, self.nz), ca.SX.zeros(self.nz)
        P[:nx, :nx] = ca.triu2symm(H) + C.T @ ca.diag(s) @ C
        p[:nx] = g + C.T @ (s * c)
        return "qp_end", [e, s], [self._triangle(P), p], ["column", "s"], ["P", "slope"]

    def _triangle(self, P: Any) -> Any:
        P = ca.densify(P)
        return ca.vertcat(*[P[i, j] for j in range(self.nz) for i in range(j + 1)])

    @remember_locals
    def _last_statuses(self) -> Any:
        """Function (x, column, statuses) -> (statuses, residual, excess) of the last stage."""
        x, e = ca.SX.sym("point", self.h.nx), ca.SX.sym("column", self.end.size)
        s = ca.SX.sym("s", self.h.nc)
        _, g, c, C, _ = self.end.unpack(e)
        found = list(self._count(c + C @ x, C, s, g))
        return "qp_last", [x, e, s], found, ["point", "column", "s"], ["status", "residual", "over"]

    def _count(self, r: Any, C: Any, s: Any, g: Any) -> tuple[Any, Any, Any]:
        """Statuses of the rows with excess r and slope C, residual, and excess of hard rows."""
        counts, slope, over = ca.densify(r > 0), ca.SX.zeros(C.shape[1]), ca.SX(0)
        for i in range(self.h.nc):
            if i in self.h.capped:
                counts[i] = 0
                over = ca.fmax(over, r[i])
            else:
                slope += ca.fabs(ca.if_else(counts[i] == s[i], 0, r[i]) * C[i, :].T)
        size = ca.fabs(ca.reshape(g, slope.shape))
        return counts, _most(slope / (1 + size)), over

    def _quadratic(self, P: Any, p: Any, t: Stage, bounds: Any) -> tuple[Any, ...]:
        """Cost to go over (z, v) of a stage: Qzz, Qvz, Qvv, qz, qv."""
        n = self.nz
        A, B, b, H, g = self.augmented(t, bounds)
        PA, PB, pb = P @ A, P @ B, P @ b + p
        Qzz, Qvz, qz = H[:n, :n] + A.T @ PA, H[n:, :n] + B.T @ PA, g[:n] + A.T @ pb
        return Qzz, Qvz, H[n:, n:] + B.T @ PB, qz, g[n:] + B.T @ pb

    def augmented(self, t: Stage, bounds: Any) -> tuple[Any, ...]:
        """A, B, b, H, g over (z, v): with the controls of the stage before, where they matter."""
        nx, nu, n = self.h.nx, self.h.nu, self.nz
        A, B, b = ca.SX(n, n), ca.SX(n, nu), ca.SX(n, 1)
        A[:nx, :nx], B[:nx, :], b[:nx] = t.A, t.B, t.b
        if self.memory:
            B[nx:, :] = ca.SX.eye(nu)
        if self.branches:
            B[nx:, :] = ca.if_else(bounds[-1] > 0, B[nx:, :], ca.SX.eye(nu)[self.h.leaders, :])
        H, g = ca.SX(n + nu, n + nu), ca.SX(n + nu, 1)
        both = [*range(nx), *range(n, n + nu)]
        H[both, both], g[both] = t.H, t.g
        H[n:, n:] += LEAST * ca.SX.eye(nu)
        return A, B, b, H, g

    @remember_locals
    def _make_backward(self) -> Any:
        """Function (P, p, column, statuses, u, earlier, bounds) -> (P, p, gains)."""
        nu = self.h.nu
        column, s, u, earlier, bounds = self._symbols()
        triangle, p = ca.SX.sym("P", self.upper.nnz()), ca.SX.sym("slope", self.nz)
        t = self._unpack(column)
        sigma = ca.reshape(s[nu:], self.h.nc, 1)
        H = t.H + t.C.T @ ca.diag(sigma) @ t.C
        g = t.g + t.C.T @ (sigma * t.c)
        P = ca.triu2symm(ca.SX(self.upper, triangle))
        Qzz, Qvz, Qvv, qz, qv = self._quadratic(P, p, t._replace(H=H, g=g), bounds)
        a, E = self._held(s, u, earlier, bounds)
        free = s[:nu] == FREE
        F, held = ca.diag(free), ca.diag(1 - free)
        M = F @ Qvv @ F + held
        turn = F @ ca.solve(M, F @ (Qvz + Qvv @ held @ E))
        push = F @ ca.solve(M, F @ (qv + Qvv @ held @ a))
        K, k = held @ E - turn, held @ a - push
        if self.memory:
            following = Qzz + K.T @ Qvv @ K + K.T @ Qvz + Qvz.T @ K
            ahead = qz + K.T @ (Qvv @ k + qv) + Qvz.T @ k
        else:  # rows of K are zero, or solve Qvv K = -Qvz
            following, ahead = Qzz + Qvz.T @ K, qz + Qvz.T @ k
        gains = ca.densify(ca.vertcat(ca.vec(K), k, ca.vec(Qvz), ca.vec(Qvv), qv))
        return (
            "qp_backward", [triangle, p, column, s, u, earlier, bounds],
            [self._triangle(following), ca.densify(ahead), gains],
            ["P", "slope", "column", "s", "control", "earlier", "bounds"],
            ["P_before", "slope_before", "gains"],
        )  # fmt: skip

    @remember_locals
    def _make_forward(self) -> Any:
        """Function of one stage of the roll.

        From (z, gains, column, statuses, u, earlier, bounds) to (z after, state after, dv,
        statuses, residual, excess of hard rows).
        """
        nx, nu, nz = self.h.nx, self.h.nu, self.nz
        column, s, u, earlier, bounds = self._symbols()
        z, G = ca.SX.sym("z", nz), ca.SX.sym("gains", self._gains)
        sizes = [nu * nz, nu, nu * nz, nu * nu, nu]
        K, k, Qvz, Qvv, qv = ca.vertsplit(G, [sum(sizes[:i]) for i in range(6)])
        K, Qvz = ca.reshape(K, nu, nz), ca.reshape(Qvz, nu, nz)
        wanted = u + K @ z + k
        dv, hi_rate, lo_rate, room = ca.SX.zeros(nu), [], [], []
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
            cut = ca.fmin(hi, ca.fmax(lo, wanted[i]))
            dv[i] = cut - u[i]
            room.append((cut < hi - SMALL, cut > lo + SMALL))
        slope = qv + Qvz @ z + ca.reshape(Qvv, nu, nu) @ dv
        status, wrong = ca.SX.zeros(nu), ca.SX.zeros(nu)
        for i in range(nu):
            high = ca.if_else(hi_rate[i], FASTER, HIGH)
            low = -ca.if_else(lo_rate[i], FASTER, HIGH)
            beyond = wanted[i] - u[i] - dv[i]
            much = SMALL * (1 + ca.fabs(qv[i]))
            push = ca.if_else(room[i][0], ca.fmax(-slope[i], 0), 0)
            pull = ca.if_else(room[i][1], ca.fmax(slope[i], 0), 0)
            bent = ca.if_else(ca.fabs(beyond) > SMALL, ca.fabs(Qvv[i * nu + i] * beyond), 0)
            wrong[i] = ca.if_else(
                s[i] == TIED, 0, (bent + ca.fmax(push, pull)) / (1 + ca.fabs(qv[i]))
            )
            outside = ca.if_else(beyond > SMALL, high, ca.if_else(beyond < -SMALL, low, FREE))
            above = ca.if_else(slope[i] > much, FREE, high)
            below = ca.if_else(slope[i] < -much, FREE, low)
            status[i] = ca.if_else(
                s[i] == FREE, outside,
                ca.if_else(s[i] == TIED, TIED, ca.if_else(s[i] > 0, above, below)),
            )  # fmt: skip
        t = self._unpack(column)
        x = t.A @ z[:nx] + t.B @ dv + t.b
        zv = ca.vertcat(z[:nx], dv)
        counts, flipped, over = self._count(t.c + t.C @ zv, t.C, s[nu:], t.g)
        after = ca.vertcat(x, self.kept(dv, bounds)) if self.memory else x
        return (
            "qp_forward", [z, G, column, s, u, earlier, bounds],
            [
                ca.densify(after), ca.densify(x), dv, ca.densify(ca.vertcat(status, counts)),
                ca.fmax(_most(wrong), flipped), over,
            ],
            ["z", "gains", "column", "s", "control", "earlier", "bounds"],
            ["z_after", "point_after", "dv", "statuses", "residual", "excess"],
        )  # fmt: skip


def _most(values: Any) -> Any:
    """Largest of some numbers that are not negative."""
    found = ca.SX(0)
    for v in ca.vertsplit(ca.densify(values)):
        found = ca.fmax(found, v)
    return found
