"""Quadratic programs of an optimal control problem by an interior point and Riccati's recursion.

Where the statuses of :mod:`slipctl.predict.qp.active_set` come back to where they were, and where
rows are hard. Every limit is a row r(y) = e + R y <= 0 of a stage, y = (z, v), with the cost

    firm (bounds, rates):  none, kept always
    soft:                  1/2 max(0, r)^2
    capped:                w t + q/2 t^2,  t >= max(0, r): multiplier l <= w + q t; q is 0 or 1

and a slack s > 0 and a multiplier l > 0: r + s = 0, l or t. Each step solves, for s l = m and
t n = m with n = w + q t - l, Newton's linear equations, those of one recursion: row by row

    t+ = t0 + d l+,  t0 = (t n + m - t w)/(q t + n),  d = t/(q t + n)       (soft: t0 = 0, d = 1)
    l+ = (s l + m + l (r+ - t0))/(s + d l),  s+ = t+ - r+                   (firm: t0 = d = 0)

so that a row adds R' W R and R' (W (e - t0) + (s l + m)/(s + d l)), W = l/(s + d l), to the cost.
In place of r+ a row has r+ - ease (l+ - l), a step of the method of multipliers. Without it the W
of a row with next to no slack turns a rounding of r into a multiplier that is wrong by a hundred.
Two solutions a step, after Mehrotra (1992): one for m = 0, whose success chooses m, one with its
product of steps taken off. Of a short step a part is taken off. Then m falls, and nothing cycles.
At the end the statuses are read off and the active set makes its passes from them, which gives the
solution to the last digits.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import casadi as ca

from slipctl.block.text.intermediates import elements, function, remember_locals
from slipctl.predict.qp import interior_tolerances as tolerance
from slipctl.predict.qp.stage_loops import Repeated, scan
from slipctl.predict.qp.status import DATA, FASTER, FREE, HIGH, NONE, SMALL, TIED

if TYPE_CHECKING:
    from slipctl.predict.qp.active_set import ActiveSet

FIRM, SOFT, CAPPED = "firm", "soft", "capped"


class Interior:
    """Interior point steps on the problem of an active set."""

    def __init__(self, of: ActiveSet) -> None:
        self.of, self.h = of, of.h
        h = self.h
        user = [CAPPED if i in h.capped else SOFT for i in range(h.nc)]
        self.rated = list(range(h.nu)) if of.rates else []
        self.bounded = list(range(h.nu)) if h.bounded else []
        self.kinds = [FIRM] * (2 * len(self.bounded) + 2 * len(self.rated)) + user
        self.last_kinds = user
        self.m, self.mc = len(self.kinds), len(h.capped)
        self._backward = self._make_backward()
        self._gains = self._backward.nnz_out(2)
        self._forward = self._make_forward()
        self._start, self._end = self._make_start(), self._make_end()

    # ---- the rows of one stage ------------------------------------------------------------------

    def _rows(self, t: Any, u: Any, earlier: Any, bounds: Any) -> tuple[Any, Any]:
        """(e, R) of the rows of a stage, over (z, v)."""
        h, nz = self.h, self.of.nz
        e, R = [], []
        for i in self.bounded:
            unit = ca.SX(1, nz + h.nu)
            unit[nz + i] = 1
            e += [
                ca.fmax(u[i] - bounds[h.nu + i], -tolerance.WIDE),
                ca.fmax(bounds[i] - u[i], -tolerance.WIDE),
            ]
            R += [unit, -unit]
        for i in self.rated:
            unit = ca.SX(1, nz + h.nu)
            unit[nz + i], unit[h.nx + i] = 1, -1
            moved, rate = u[i] - earlier[i], ca.fmin(bounds[2 * h.nu + i], tolerance.WIDE)
            e += [moved - rate, -moved - rate]
            R += [unit, -unit]
        wide = ca.SX(h.nc, nz + h.nu)
        wide[:, : h.nx], wide[:, nz:] = t.C[:, : h.nx], t.C[:, h.nx :]
        return ca.vertcat(*e, ca.fmax(t.c, -tolerance.FAR)), ca.vertcat(*R, wide)

    def _eliminated(self, kinds: list[str], w: Any, a: Any, target: Any) -> tuple[Any, ...]:
        """(d, t0, W, f) of each row at a = (l, s, t, n, corrections); f = (s l + m)/(s + d l).

        The target is m and the part of a multiplier's change by which its row is eased.
        """
        l, s, t, n, c1, c2 = a
        m, ease = target[0], target[1]
        d, t0, at = ca.SX.zeros(len(kinds)), ca.SX.zeros(len(kinds)), 0
        for i, kind in enumerate(kinds):
            if kind == SOFT:
                d[i] = 1
            if kind == CAPPED:
                q = self.h.square[at]
                over = q * t[at] + n[at]
                d[i] = t[at] / over
                t0[i] = (t[at] * n[at] + m - c2[at] - t[at] * w[at]) / over
                at += 1
        yielding = d + ease  # r - ease (l+ - l) in place of r+
        below = s + yielding * l
        product = s * l + m - c1
        return d, t0, l / below, (product + ease * l**2) / below

    def _symbols(self, m: int) -> tuple[Any, tuple[Any, ...]]:
        """Symbol of the packed (l, s, t, n, corrections), and its pieces."""
        sizes = [m, m, self.mc, self.mc, m, self.mc]
        a = ca.SX.sym("a", sum(sizes))
        edges = [sum(sizes[:k]) for k in range(len(sizes) + 1)]
        return a, tuple(a[i:j] for i, j in pairwise(edges))

    def _after(self, kinds: list[str], w: Any, r: Any, a: Any, target: Any) -> Any:
        """(l, s, t, n) of the whole step, where the rows become r."""
        d, t0, W, f = self._eliminated(kinds, w, a, target)
        l, (l0, s0, t0_, n0, c1, c2) = W * (r - t0) + f, a
        # s = t - r and n = w + q t - l, by the products: differences would lose the last digits
        s = (s0 * l0 + target[0] - c1 - s0 * l) / l0
        rows = [i for i, kind in enumerate(kinds) if kind == CAPPED]
        # the sum of two that are huge where n is small, which r + s is not; where t is small it is
        t = ca.if_else(t0_ > s0[rows], (r + s)[rows], (t0 + d * l)[rows])
        n = (t0_ * n0 + target[0] - c2 - n0 * t) / t0_
        return ca.densify(ca.vertcat(l, s, t, n))

    @remember_locals
    def _make_backward(self) -> Any:
        """Function (P, p, column, tied, u, earlier, bounds, a, target) -> (P, p, gains)."""
        of, nu, nz = self.of, self.h.nu, self.of.nz
        column, _, u, earlier, bounds = of._symbols()
        tied, target = ca.SX.sym("tied"), ca.SX.sym("target", 2)
        triangle, p = ca.SX.sym("P", of.upper.nnz()), ca.SX.sym("slope", nz)
        a, pieces = self._symbols(self.m)
        t = of._unpack(column)
        P = ca.triu2symm(ca.SX(of.upper, triangle))
        e, R = self._rows(t, u, earlier, bounds)
        _, t0, W, f = self._eliminated(self.kinds, t.w, pieces, target)
        _, Qvz, Qvv, _, qv = of._quadratic(P, p, t, bounds)
        Rz, Rv = R[:, :nz], R[:, nz:]
        Qvz, Qvv = Qvz + Rv.T @ ca.diag(W) @ Rz, Qvv + Rv.T @ ca.diag(W) @ Rv
        qv += Rv.T @ (W * (e - t0) + f)
        if any(of.tied):
            held, E = tied * ca.SX.eye(nu), ca.SX(nu, nz)
            E[:, self.h.nx :] = ca.SX.eye(nu)
            free, fixed = ca.SX.eye(nu) - held, earlier - u
            M = free @ Qvv @ free + held
            K = held @ E - free @ ca.solve(M, free @ (Qvz + Qvv @ held @ E))
            k = held @ fixed - free @ ca.solve(M, free @ (qv + Qvv @ held @ fixed))
        else:
            K, k = -ca.solve(Qvv, Qvz), -ca.solve(Qvv, qv)
        # W grows without bound: only sums of squares keep their digits
        A, B, b, H, g = of.augmented(t, bounds)
        closed, on = A + B @ K, ca.vertcat(ca.SX.eye(nz), K)
        G, still = Rz + Rv @ K, ca.vertcat(ca.SX.zeros(nz), k)
        back, bent, weighted = closed.T @ P, on.T @ H, G.T @ ca.diag(W)
        following = back @ closed + bent @ on + weighted @ G
        slope, gradient = P @ (B @ k + b) + p, H @ still + g
        pressed = W * (e + Rv @ k - t0) + f
        ahead = closed.T @ slope + on.T @ gradient
        ahead += G.T @ pressed
        gains = ca.densify(ca.vertcat(ca.vec(K), k))
        return (
            "ip_backward", [triangle, p, column, tied, u, earlier, bounds, a, target],
            [of._triangle(following), ca.densify(ahead), gains],
            ["P", "slope", "column", "tied", "control", "earlier", "bounds", "a", "target"],
            ["P_before", "slope_before", "gains"],
        )  # fmt: skip

    @remember_locals
    def _make_forward(self) -> Any:
        """Function (z, gains, column, u, earlier, bounds, a, target) -> (z, x, dv, rows' next)."""
        of, nu, nx, nz = self.of, self.h.nu, self.h.nx, self.of.nz
        column, _, u, earlier, bounds = of._symbols()
        z, G, target = ca.SX.sym("z", nz), ca.SX.sym("gains", self._gains), ca.SX.sym("target", 2)
        a, pieces = self._symbols(self.m)
        t = of._unpack(column)
        dv = ca.reshape(G[: nu * nz], nu, nz) @ z + G[nu * nz :]
        e, R = self._rows(t, u, earlier, bounds)
        r = e + R @ ca.vertcat(z, dv)
        x = t.A @ z[:nx] + t.B @ dv + t.b
        after = ca.vertcat(x, of.kept(dv, bounds)) if of.memory else x
        return (
            "ip_forward", [z, G, column, u, earlier, bounds, a, target],
            [
                ca.densify(after), ca.densify(x), dv,
                self._after(self.kinds, t.w, r, pieces, target),
            ],
            ["z", "gains", "column", "control", "earlier", "bounds", "a", "target"],
            ["z_after", "point_after", "dv", "rows"],
        )  # fmt: skip

    @remember_locals
    def _make_start(self) -> Any:
        """Function (column, a, target) -> (P, p) of the last stage."""
        of, nx = self.of, self.h.nx
        e, target = ca.SX.sym("column", of.end.size), ca.SX.sym("target", 2)
        a, pieces = self._symbols(self.h.nc)
        H, g, c, C, w = of.end.unpack(e)
        c = ca.fmax(c, -tolerance.FAR)
        _, t0, W, f = self._eliminated(self.last_kinds, w, pieces, target)
        P, p = ca.SX(of.nz, of.nz), ca.SX.zeros(of.nz)
        P[:nx, :nx] = ca.triu2symm(H) + C.T @ ca.diag(W) @ C
        p[:nx] = g + C.T @ (W * (c - t0) + f)
        return (
            "ip_end", [e, a, target], [of._triangle(P), p], ["column", "a", "target"],
            ["P", "slope"],
        )  # fmt: skip

    @remember_locals
    def _make_end(self) -> Any:
        """Function (x, column, a, target) -> rows' next of the last stage."""
        of, nx = self.of, self.h.nx
        e, x, target = ca.SX.sym("column", of.end.size), ca.SX.sym("x", nx), ca.SX.sym("target", 2)
        a, pieces = self._symbols(self.h.nc)
        _, _, c, C, w = of.end.unpack(e)
        c = ca.fmax(c, -tolerance.FAR)
        after = self._after(self.last_kinds, w, c + C @ x, pieces, target)
        return "ip_last", [x, e, a, target], [after], ["point", "column", "a", "target"], ["rows"]

    # ---- the whole ------------------------------------------------------------------------------

    @property
    def _lengths(self) -> list[int]:
        """Number of (l, s, t, n) of all stages."""
        N, nc = self.h.stages, self.h.nc
        rows, capped = self.m * N + nc, self.mc * (N + 1)
        return [rows, rows, capped, capped]

    def _by_stage(self, pieces: list[Any]) -> tuple[Any, Any]:
        """(l, s, t, n, corrections), a column per stage, and those of the last one."""
        N, nc, stages, last = self.h.stages, self.h.nc, [], []
        for j, v in enumerate(pieces):
            m, end = (self.m, nc) if j in (0, 1, 4) else (self.mc, self.mc)
            stages.append(ca.reshape(v[: m * N], m, N))
            last.append(ca.reshape(v[m * N : m * N + end], end, 1))
        return ca.vertcat(*stages), ca.vertcat(*last)

    def _together(self, stages: Any, last: Any) -> list[Any]:
        """(l, s, t, n) of all stages from the columns of the stages, and that of the last one."""
        found, nc = [], self.h.nc
        edges = [0, self.m, 2 * self.m, 2 * self.m + self.mc, 2 * (self.m + self.mc)]
        ends = [0, nc, 2 * nc, 2 * nc + self.mc, 2 * (nc + self.mc)]
        for (i, e), (k, g) in zip(pairwise(edges), pairwise(ends), strict=True):
            found.append(ca.vertcat(ca.vec(stages[i:e, :]), ca.reshape(last[k:g], g - k, 1)))
        return found

    @remember_locals
    def _solution(self) -> Any:
        """Function (a of all stages, target, data) -> (X, V, (l, s, t, n) of the whole step)."""
        of, nx, nu, N = self.of, self.h.nx, self.h.nu, self.h.stages
        D, E, U, before, bounds, dx = data = of.data()
        sizes = [*self._lengths, self._lengths[0], self._lengths[2]]
        pieces = [ca.MX.sym(f"a{i}", n) for i, n in enumerate(sizes)]
        target = ca.MX.sym("target", 2)
        a, last = self._by_stage(pieces)
        u: Any = ca.reshape(U, nu, N)
        earlier = of.earlier(before, u)
        tied = ca.MX(ca.DM([[float(t) for t in of.tied]]))
        P, p = self._start(E, last, target)
        _, _, gains = scan(self._backward, N, 2, 1, backward=True)(
            P, p, D, tied, u, earlier, bounds, a, target
        )
        z = ca.vertcat(dx, ca.MX.zeros(of.nz - nx))
        _, x, V, rows = scan(self._forward, N, 1, 1)(z, gains, D, u, earlier, bounds, a, target)
        X = ca.vertcat(dx, ca.vec(x))
        found = self._together(rows, self._end(X[-nx:], E, last, target))
        names = ["l", "s", "t", "n"]
        return (
            "ip_solution", [*pieces, target, *data], [X, ca.vec(V), *found],
            [*names, "ls", "tn", "target", *DATA], ["X", "V", *(f"{n}_next" for n in names)],
        )  # fmt: skip

    @remember_locals
    def _step(self) -> Any:
        """Function (state, data) -> state: one step of Mehrotra's method.

        The state is (X, V, l, s, t, n, mean product, open, residual, steps).
        """
        data = self.of.data()
        sizes = [*self.of.sizes[:2], *self._lengths, 1, 1, 1, 1]
        edges = [sum(sizes[:k]) for k in range(len(sizes) + 1)]
        point = ca.MX.sym("point", edges[-1])
        X, V, *rest = [point[i:j] for i, j in pairwise(edges)]
        now, (mean, was, before, steps) = rest[:4], rest[4:]
        solve = self._solution()
        zero = [ca.MX.zeros(self._lengths[0]), ca.MX.zeros(self._lengths[2])]
        # as a share of the multipliers: a row must weigh more than the cost, of whatever size
        heaviest = ca.mmax(now[0])
        ease = tolerance.EASE / (1 + heaviest) if self.bounded else tolerance.EASE_OF_UNKNOWNS
        whole = solve(*now, *zero, ca.vertcat(0, ease), *data)[2:]
        ahead = [b - a for a, b in zip(now, whole, strict=True)]
        reach = reach_of(now, ahead, 1.0)
        tried = mean_of([v + reach * d for v, d in zip(now, ahead, strict=True)])
        ratio = tried / mean
        target = mean * ratio**3
        share = ca.fmin(1, reach / tolerance.SHORT)
        turn = [share * ahead[0] * ahead[1], share * ahead[2] * ahead[3]]
        found = solve(*now, *turn, ca.vertcat(target, ease), *data)
        ahead = [b - a for a, b in zip(now, found[2:], strict=True)]
        part = reach_of(now, ahead, 0.995)
        nxt = [v + part * d for v, d in zip(now, ahead, strict=True)]
        dX, dV = found[0] - X, found[1] - V
        Xn, Vn = X + part * dX, V + part * dV
        left = mean_of(nxt)
        steps_ahead = ca.vertcat(dX, dV)
        moved = ca.mmax(ca.fabs(steps_ahead))
        if not self.bounded:  # then no bound tells how large a control is
            moved = moved / (1 + ca.mmax(ca.fabs(ca.vertcat(X, V))))
        everything = ca.vertcat(*nxt, Xn, Vn)
        size = ca.sumsqr(everything)
        sound = size < 1e30
        largest = ca.mmax(nxt[0])
        scale = 1 + largest
        residual, short = left / scale, (1 - part) * moved
        # no more digits come, as in float
        little = ca.logic_and(left > mean / 2, moved < 10 * SMALL)
        still = ca.logic_and(residual < (tolerance.STILL if self.bounded else SMALL), little)
        solved = ca.logic_or(residual < tolerance.END, still)
        near = short < SMALL
        if self.bounded:  # a row that is still eased is not kept
            farthest = ca.mmax(ca.fabs(ahead[0]))
            near = ca.logic_and(near, ease * farthest < tolerance.EASED)
        enough = ca.logic_and(residual < tolerance.ENOUGH, near)
        solved = ca.logic_and(solved, near)
        open_ = ca.if_else(solved, 0, ca.if_else(enough, tolerance.NEARLY, 1))
        made = steps + 1
        good = ca.vertcat(Xn, Vn, *nxt, left, open_, residual, made)
        bad = ca.vertcat(point[:-3], -2, 1, made)
        after = ca.if_else(sound, good, bad)
        nearer = ca.logic_and(sound, residual < before)
        worse = ca.logic_and(was == tolerance.NEARLY, ca.logic_not(ca.logic_and(nearer, open_ < 1)))
        if not self.bounded:  # rounding of what is that large leaves no step
            lost = ca.logic_or(ca.logic_not(nearer), part < tolerance.SHORT)
            worse = ca.logic_or(worse, ca.logic_and(before < tolerance.ROUNDED, lost))
        kept = ca.vertcat(point[:-3], 0, before, made)
        after = ca.if_else(worse, kept, after)
        return "ip_step", [point, *data], [after], ["point", *DATA], ["point_next"]

    @remember_locals
    def _make_begin(self, kinds: list[str], stage: bool) -> Any:
        """Function of a stage's point and a mean product -> (l, s, t, n) to begin with."""
        of, nx, nz = self.of, self.h.nx, self.of.nz
        mean = ca.SX.sym("mean")
        if stage:
            column, _, u, earlier, bounds = of._symbols()
            z, dv = ca.SX.sym("z", nz), ca.SX.sym("dv", self.h.nu)
            t_ = of._unpack(column)
            e, R = self._rows(t_, u, earlier, bounds)
            r, w, given = e + R @ ca.vertcat(z, dv), t_.w, [z, dv, column, u, earlier, bounds]
        else:
            x, column = ca.SX.sym("point", nx), ca.SX.sym("column", of.end.size)
            _, _, c, C, w = of.end.unpack(column)
            r, given = ca.fmax(c, -tolerance.FAR) + C @ x, [x, column]
        l, s, t, n, at = [], [], [], [], 0
        for i, kind in enumerate(kinds):
            if kind == SOFT:
                root = ca.sqrt(r[i] ** 2 + 4 * mean)
                large = (ca.fabs(r[i]) + root) / 2
                l.append(ca.if_else(r[i] > 0, large, mean / large))
                s.append(ca.if_else(r[i] > 0, mean / large, large))
            elif kind == FIRM:
                s.append(ca.fmax(-r[i], tolerance.NEAR))
                l.append(mean / s[-1])
            else:
                # r + s = t, s l = t n = mean, l + n = w
                root = ca.sqrt((w[at] * r[i]) ** 2 + 4 * mean**2)
                large = (2 * mean + root + w[at] * ca.fabs(r[i])) / (2 * w[at])
                small = mean * large / (w[at] * large - mean)
                s.append(ca.if_else(r[i] > 0, small, large))
                t.append(ca.if_else(r[i] > 0, large, small))
                l.append(mean / s[-1])
                n.append(mean / t[-1] + self.h.square[at] * t[-1])
                at += 1
        name = "ip_begin" if stage else "ip_begin_end"
        found = ca.densify(ca.vertcat(*l, *s, *t, *n))
        names = ["z", "dv", "column", "control", "earlier", "bounds"]
        names = [*(names if stage else ["point", "column"]), "mean"]
        return name, [*given, mean], [found], names, ["rows"]

    @remember_locals
    def _make_excess(self) -> Any:
        """Function (x, dv, column) -> size of the multipliers of rows that are exceeded."""
        column, x, dv = self.of._symbols()[0], ca.SX.sym("x", self.h.nx), ca.SX.sym("v", self.h.nu)
        t = self.of._unpack(column)
        r = t.c + t.C @ ca.vertcat(x, dv)
        rows = [r[i] for i, kind in enumerate(self.last_kinds) if kind == SOFT]
        rows += [tolerance.NEAR * t.w[j] * r[i] for j, i in enumerate(self.h.capped)]
        most = ca.SX(0)
        for row in rows:
            most = ca.fmax(most, row)
        return "ip_excess", [x, dv, column], [most], ["point", "dv", "column"], ["excess"]

    def _statuses(self, stages: Any, last: Any) -> Any:
        """Statuses as the multipliers tell them, all stages in one column."""
        a = ca.SX.sym("a", 2 * self.m + 2 * self.mc)
        l, s = a[: self.m], a[self.m :]
        on = [ca.if_else(l[i] > s[i], l[i], 0) for i in range(self.m)]
        nu, found = self.h.nu, [ca.SX(FREE)] * (self.h.nu - len(self.bounded))
        for i in self.bounded:
            high, low = on[2 * i], on[2 * i + 1]
            status = ca.if_else(high > low, HIGH, ca.if_else(low > 0, -HIGH, FREE))
            if self.rated:
                up, down = on[2 * nu + 2 * i], on[2 * nu + 2 * i + 1]
                bound, rate = ca.fmax(high, low), ca.fmax(up, down)
                status = ca.if_else(rate > bound, ca.if_else(up > down, FASTER, -FASTER), status)
            found.append(status)
        first = self.m - self.h.nc
        rows = [
            0 if kind == CAPPED else on[first + j] > 0 for j, kind in enumerate(self.last_kinds)
        ]
        statuses = [ca.densify(ca.vertcat(*found, *rows))]
        read = function(elements("on", on), "ip_statuses", [a], statuses, ["a"], ["statuses"])
        told: Any = read.map(self.h.stages)(stages)
        if any(self.of.tied):
            held = ca.repmat(ca.DM([[float(t) for t in self.of.tied]]), nu, 1)
            told = ca.vertcat(ca.if_else(held, TIED, told[:nu, :]), told[nu:, :])
        nc = self.h.nc
        marks = ca.DM([kind != CAPPED for kind in self.last_kinds])
        return ca.vertcat(ca.vec(told), (last[:nc] > last[nc : 2 * nc]) * marks)

    def _begun(self, X: Any, V: Any, data: tuple[Any, ...]) -> Any:
        """State of :meth:`_step` to begin with."""
        of, nx, nu, N = self.of, self.h.nx, self.h.nu, self.h.stages
        D, E, U, before, bounds, _ = data
        begin = self._make_begin(self.kinds, True)
        at, size = of.stage.gradient
        gradients = ca.vec(D[at : at + size, :])
        steepest = ca.mmax(ca.fabs(gradients))
        mean = ca.fmax(1, steepest)
        u: Any = ca.reshape(U, nu, N)
        v: Any = ca.reshape(V, nu, N)
        z: Any = ca.reshape(X[: nx * N], nx, N)
        most_exceeded = ca.mmax(self._make_excess().map(N)(z, v, D))
        mean = ca.fmax(mean, most_exceeded)
        if of.memory:
            z = ca.vertcat(z, of.earlier(ca.MX.zeros(nu), v))
        earlier = of.earlier(before, u)
        each = ca.repmat(mean, 1, N)
        last = self._make_begin(self.last_kinds, False)(X[nx * N :], E, mean)
        now = self._together(begin.map(N)(z, v, D, u, earlier, bounds, each), last)
        return ca.vertcat(X, V, *now, mean_of(now), 1, 1, 0)

    @remember_locals
    def _rescue(self) -> Any:
        """Function (z, data) -> z, z a column of :class:`~slipctl.predict.qp.active_set.Found`."""
        of, data = self.of, self.of.data()
        z = ca.MX.sym("z", sum(of.sizes))
        X0, V0, S0, M0, _, residual0, _, passes0 = of.split(z)
        first = self._begun(X0, V0, data)
        solution = Repeated(self._step(), -3)(of.rescue, first, *data, begun=True)
        sizes = [*of.sizes[:2], *self._lengths, 1, 1, 1, 1]
        edges = [sum(sizes[:k]) for k in range(len(sizes) + 1)]
        X, V, l, s, t, n, _, open_, residual, steps = (solution[i:j] for i, j in pairwise(edges))
        S = self._statuses(*self._by_stage([l, s, t, n]))
        open_ = ca.if_else(open_ == tolerance.NEARLY, 0, open_)
        over = self._given_up(s, t)
        sound, made = open_ >= 0, passes0 + steps
        inner = ca.vertcat(X, V, S, M0, open_, residual, over, made)
        broken = ca.vertcat(X0, V0, S0, M0, 1, residual0, 0, made)
        none = ca.MX.zeros(sum(of.sizes[:2]))
        begun = ca.vertcat(none, S, S * 0 + NONE, sound, 0, 0, made)
        exact = of.passed(begun, tolerance.POLISH, data)
        done = ca.logic_and(sound, exact[-4] == 0)
        after = ca.if_else(done, exact, ca.if_else(sound, inner, broken))
        return "qp_go_on", [z, *data], [after], ["z", *DATA], ["z_next"]

    def _given_up(self, s: Any, t: Any) -> Any:
        """Largest excess of the hard rows."""
        h, N = self.h, self.h.stages
        if not h.hard:
            return ca.MX(0)
        slack: Any = ca.reshape(s[: self.m * N], self.m, N)[self.m - h.nc :, :]
        slack = ca.horzcat(slack, s[self.m * N :])
        excess: Any = ca.reshape(t, self.mc, N + 1)
        which = [j for j, i in enumerate(h.capped) if i in h.hard]
        return ca.fmax(0, ca.mmax(excess[which, :] - slack[list(h.hard), :]))

    def function(self) -> ca.Function:
        """Function (open, z, data) -> z: it goes on from a column of ``Found`` that is open."""
        symbols = [ca.MX.sym("z", sum(self.of.sizes)), *self.of.data()]
        stay = ca.Function("qp_settled", symbols, [symbols[0]], ["z", *DATA], ["z_next"])
        return ca.Function.if_else("qp_rescue", self._rescue(), stay)


def reach_of(values: list[Any], steps: list[Any], part: float) -> Any:
    """Longest share of a step, at most 1, that leaves (1 - part) of each value."""
    v, d = ca.vertcat(*values), ca.vertcat(*steps)
    shortest = ca.mmin(ca.if_else(d < 0, -v / d, 1 / part))
    return ca.fmin(1, part * shortest)


def mean_of(values: list[Any]) -> Any:
    """Mean of s l and t n."""
    l, s, t, n = values
    products, capped_products = ca.dot(l, s), ca.dot(t, n)
    return (products + capped_products) / (l.numel() + t.numel())
