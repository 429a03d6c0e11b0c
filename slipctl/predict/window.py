"""Moving-horizon estimation: the problem of one window, packed as stages of an active set.

Over M samples, x_0 that of the oldest, with w = noise of the motion per tick over its deviation,

    minimise  1/2 |e|^2 + 1/2 sum |w_k|^2 + 1/2 sum |(h(x_k) - y_k)/s|^2
    with      x_0 = a + L e,  x_{k+1} = F(x_k, u_k) + Q^1/2 w_k,  limits of x_k,  k = 0 ... M - 1

a and P = L L' are the arrival: what the samples before the window tell. e is the control of one
more stage in front, which starts from nothing, so the window is an optimal control problem of M
stages and goes to :mod:`slipctl.predict.qp.active_set`. Samples that have not come yet do not move
the state.

When the window moves on, the oldest sample goes into the arrival by a step of a Kalman filter with
the exact Jacobians at the estimate (Rao, Rawlings, Mayne 2003). In a linear problem without limits
the estimate is that of the Kalman filter, for any length of the window.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca

from slipctl.errors import BadInput
from slipctl.estimate.kalman.model import Problem
from slipctl.predict.qp.active_set import ActiveSet, Found
from slipctl.predict.stages.horizon import HARD, Layout, Soft

FREE = 1e30
"""Bound of a noise: none."""


@dataclass(frozen=True)
class Window:
    """Sizes and Functions of a window; the sizes are those that an active set asks for.

    Attributes:
        problem: unknowns and measurements.
        stages: M, one for each sample.
        period: from sample to sample in s.
        substeps: steps of Runge and Kutta in a period.
        limits: of unknowns and outputs, by name.
    """

    problem: Problem
    stages: int
    period: float
    substeps: int
    limits: Mapping[str, Soft]

    @property
    def nx(self) -> int:
        """Number of unknowns."""
        return self.problem.n

    nu = nx
    """As many noises of a stage."""

    @property
    def nc(self) -> int:
        """Number of rows of limits."""
        return 2 * len(self.limits)

    @property
    def hard(self) -> tuple[int, ...]:
        """Rows that are hard."""
        limits = enumerate(self.limits.values())
        return tuple(2 * k + i for k, s in limits if s.hard for i in (0, 1))

    capped = hard
    """Rows with a largest multiplier."""

    @property
    def square(self) -> tuple[bool, ...]:
        """Whether the excess of a capped row is squared too."""
        return (False,) * len(self.hard)

    shared, bounded = 0, False

    # ---- equations ----------------------------------------------------------------------------

    def equations(self) -> ca.Function:
        """Function (x, known, params) -> (x a period later, measured, limited)."""
        problem, names = self.problem, [s.name for s in self.problem.unknown]
        symbols = problem.symbols()
        known, params = ([symbols[s.name] for s in g] for g in (problem.known, problem.params))
        moving, _ = problem.rates(symbols)
        _, y = problem.equations(symbols)
        limited = [symbols[n] if n in symbols else y[n] for n in self.limits]
        make: Any = ca.SX if problem.block.sx else ca.MX
        columns: list[Any] = [
            ca.vertcat(*[make(v) for v in rows]) if rows else make(0, 1)
            for rows in (moving, problem.outputs(symbols), limited)
        ]
        raw = ca.Function("motion", [*(symbols[n] for n in names), *known, *params], columns)
        try:
            raw = raw if problem.block.sx else raw.expand()
        except RuntimeError:
            raise BadInput(
                f"{problem.who}: {problem.block.name} cannot be differentiated; write it in"
                " expressions, an equation solved inside as a fixed number of its steps"
            ) from None
        x = ca.SX.sym("x", self.nx)
        k = [ca.SX.sym("k", *v.shape) for v in known]
        p = [ca.SX.sym("p", *v.shape) for v in params]

        def rates(at: Any) -> Any:
            return raw(*ca.vertsplit(at), *k, *p)[0]

        after, step = x, self.period / self.substeps
        for _ in range(self.substeps):
            k1 = rates(after)
            k2 = rates(after + step / 2 * k1)
            k3 = rates(after + step / 2 * k2)
            k4 = rates(after + step * k3)
            after = after + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        _, seen, within = raw(*ca.vertsplit(x), *k, *p)
        return ca.Function("sample", [x, _column(k), _column(p)], [after, seen, within])

    @property
    def ny(self) -> int:
        """Number of measurements."""
        return len(self.problem.measured)

    def symbols(self) -> tuple[Any, Any, Any, Any, Any]:
        """Symbols of x, of what is known of a sample, and of what all samples share.

        The second is (known signals, measurements, whether they are there), the last
        (parameters, deviations of measurements, of noises per tick, (lo, hi, weight) of limits).
        """
        known, params = len(self.problem.known), len(self.problem.params)
        return (
            ca.SX.sym("x", self.nx), ca.SX.sym("k", known), ca.SX.sym("y", 2 * self.ny),
            ca.SX.sym("p", params), ca.SX.sym("s", self.ny + self.nx + 3 * len(self.limits)),
        )  # fmt: skip

    def _of_sample(self) -> tuple[list[Any], Any, Any, Any, Any]:
        """Symbols as arguments, and (F, residuals, weighted excess, deviations of the noises)."""
        x, k, y, p, s = self.symbols()
        after, seen, within = self.equations()(x, k, p)
        r = y[self.ny :] * (seen - y[: self.ny]) / s[: self.ny]
        rows, at = [], self.ny + self.nx
        for i in range(len(self.limits)):
            lo, hi, weight = s[at + 3 * i], s[at + 3 * i + 1], s[at + 3 * i + 2]
            rows += [weight * (within[i] - hi), weight * (lo - within[i])]
        c = ca.vertcat(*rows) if rows else ca.SX(0, 1)
        return [x, k, y, p, s], after, r, c, s[self.ny : at]

    def stage(self) -> tuple[ca.Function, Layout]:
        """Function (sample, whether it has come, next x) -> column of a stage."""
        arguments, after, r, c, sigma = self._of_sample()
        x, live, following = arguments[0], ca.SX.sym("live"), ca.SX.sym("following", self.nx)
        n, J, C = self.nx, ca.jacobian(r, arguments[0]), ca.jacobian(c, arguments[0])
        A = live * ca.jacobian(after, x) + (1 - live) * ca.SX.eye(n)
        H = ca.diagcat(live * ca.densify(J.T @ J), ca.SX.eye(n))
        pieces = [
            A, live * ca.diag(sigma), live * (after - x) + x - following, H,
            ca.vertcat(live * (J.T @ r), ca.SX.zeros(n)), live * (c + 1) - 1,
            live * ca.horzcat(C, ca.SX(C.shape[0], n)), ca.SX.ones(len(self.hard)) * HARD,
        ]  # fmt: skip
        layout = self._layout(2 * n, True)
        return ca.Function(
            "mhe_stage", [*arguments, live, following], [_packed(layout, pieces)], {"cse": True}
        ), layout  # fmt: skip

    def front(self, layout: Layout) -> ca.Function:
        """Function (arrival, its factor, x of the oldest sample) -> column of the first stage."""
        n = self.nx
        a, L, x = ca.SX.sym("a", n), ca.SX.sym("L", n, n), ca.SX.sym("x", n)
        pieces = [
            ca.SX(n, n), L, a - x, ca.diagcat(ca.SX(n, n), ca.SX.eye(n)), ca.SX(2 * n, 1),
            -ca.SX.ones(self.nc), ca.SX(self.nc, 2 * n), ca.SX.ones(len(self.hard)) * HARD,
        ]  # fmt: skip
        return ca.Function("mhe_front", [a, L, x], [_packed(layout, pieces)])

    def end(self) -> tuple[ca.Function, Layout]:
        """Function of the newest sample -> column of the last stage."""
        arguments, _, r, c, _ = self._of_sample()
        J, C = ca.jacobian(r, arguments[0]), ca.jacobian(c, arguments[0])
        layout = self._layout(self.nx, False)
        pieces = [J.T @ J, J.T @ r, c, C, ca.SX.ones(len(self.hard)) * HARD]
        return ca.Function("mhe_end", arguments, [_packed(layout, pieces)], {"cse": True}), layout

    def _layout(self, n: int, moving: bool) -> Layout:
        """Layout of a column over n variables; the matrices are full but for noises and H."""
        nx, full = self.nx, ca.Sparsity.dense
        H = ca.Sparsity.upper(nx)
        factor = self.factor().sparsity_out(0)
        motion = [full(nx, nx), factor, full(nx, 1)] if moving else []
        C = full(self.nc, nx)
        if moving:
            H = ca.diagcat(H, ca.Sparsity.diag(nx))
            C = ca.horzcat(C, ca.Sparsity(self.nc, nx))
        rows = [full(self.nc, 1), C, full(len(self.hard), 1)]
        return Layout((*motion, H, full(n, 1), *rows))

    def misfit(self) -> ca.Function:
        """Function (sample, whether it has come) -> sum of squares of its residuals."""
        arguments, _, r, _, _ = self._of_sample()
        live = ca.SX.sym("live")
        return ca.Function("mhe_misfit", [*arguments, live], [live * ca.sumsqr(r)])

    def arrived(self) -> ca.Function:
        """Function (sample at the estimate, a, P) -> (a, P) one sample later.

        One measurement after the other, in Joseph's form, which keeps P symmetric and positive.
        """
        arguments, after, _, _, sigma = self._of_sample()
        x, k, y, p, s = arguments
        n = self.nx
        a, lower = ca.SX.sym("a", n), ca.SX.sym("P", n * (n + 1) // 2)
        P = symmetric(lower, n)
        _, seen, _ = self.equations()(x, k, p)
        J, mean = ca.jacobian(seen, x), a
        for i in range(self.ny):
            row, R = J[i, :], s[i] ** 2
            gain = y[self.ny + i] * (P @ row.T) / (row @ P @ row.T + R)
            mean += gain * (y[i] - seen[i] - row @ (mean - x))
            rest = ca.SX.eye(n) - gain @ row
            P = rest @ P @ rest.T + R * gain @ gain.T
        A = ca.jacobian(after, x)
        P = A @ P @ A.T + ca.diag(sigma**2)
        return ca.Function(
            "mhe_arrival", [*arguments, a, lower],
            [after + A @ (mean - x), triangle(P)], {"cse": True},
        )  # fmt: skip

    @property
    def order(self) -> list[int]:
        """Unknowns in the order of the factor: those with limits first.

        A limit of the first one is moved by one part of e alone, and so on.
        """
        names = [s.name for s in self.problem.unknown]
        return sorted(range(self.nx), key=lambda i: names[i] not in self.limits)

    def factor(self) -> ca.Function:
        """Function P -> L with L L' = P; a pivot that rounding made negative is zero."""
        n, order = self.nx, self.order
        lower = ca.SX.sym("P", n * (n + 1) // 2)
        P, L = symmetric(lower, n)[order, order], ca.SX(n, n)
        for j in range(n):
            L[j, j] = ca.sqrt(ca.fmax(P[j, j] - ca.sumsqr(L[j, :j]), TINY))
            for i in range(j + 1, n):
                L[i, j] = (P[i, j] - ca.dot(L[i, :j], L[j, :j])) / L[j, j]
        found = ca.SX(n, n)
        found[order, order] = L
        return ca.Function("mhe_factor", [lower], [found], {"cse": True})

    def solver(self, stage: Layout, end: Layout, passes: int, rescue: int) -> ActiveSet:
        """Active set of the window."""
        tied = [False] * self.stages
        rescue = rescue if self.limits else 0
        return ActiveSet(self, stage, end, tied, False, passes, rescue)  # type: ignore[arg-type]

    def solve(self, qp: ActiveSet, D: Any, E: Any, S: Any) -> Found:
        """Solve the window around a guess without noise."""
        n, M = self.nx, self.stages
        free = ca.MX(ca.DM([-FREE] * n + [FREE] * 2 * n))
        zero = ca.MX.zeros
        return qp.solve(D, E, S, zero(n * M), zero(n), ca.repmat(free, 1, M), zero(n))


TINY = 1e-30
"""Least pivot of a covariance."""


def symmetric(lower: Any, n: int) -> Any:
    """Matrix from its lower triangle, row by row."""
    return ca.triu2symm(ca.SX(ca.Sparsity.upper(n), lower))


def triangle(P: Any) -> Any:
    """Lower triangle of a matrix, row by row."""
    n = P.shape[0]
    return ca.vertcat(*[(P[i, j] + P[j, i]) / 2 for i in range(n) for j in range(i + 1)])


def _packed(layout: Layout, pieces: list[Any]) -> Any:
    """Pieces as the layout has them, whatever zeros they have themselves."""
    return layout.pack(
        [ca.project(ca.SX(m), s) for m, s in zip(pieces, layout.sparsity, strict=True)]
    )


def _column(parts: list[Any]) -> Any:
    return ca.vertcat(*parts) if parts else ca.SX(0, 1)
