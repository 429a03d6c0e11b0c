"""A search along the step of an iteration, so that several iterations come down from far away.

With f the cost of the plan, d the step and c by how much its stages miss each other, the merit is
f + mu |c|_1. mu is twice what makes d a descent of it (J. Nocedal, S. Wright, Numerical
Optimization, 2006, eq. 18.36, with no share of the curvature). Of the steps 1, 1/2, 1/4 and 1/8 the
first is taken that gains a ten-thousandth of what the slope promises; the whole one if none does.
Limits of controls are kept by each, as by plan and step.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from slipctl.predict.stages.horizon import Horizon, on_the_way

STEPS = (1.0, 0.5, 0.25, 0.125)

GAIN = 1e-4
"""Part of the slope's promise that a step has to gain."""


class Search:
    """Search along a step.

    Args:
        horizon: the problem.
        step: Function (x, v, d, shared) -> state after a stage.
        shared: size of what all stages share.
    """

    def __init__(self, horizon: Horizon, step: ca.Function) -> None:
        self.h = h = horizon
        x, v, d, q, y = h.of_stage()
        dx, dv = ca.SX.sym("dx", h.nx), ca.SX.sym("dv", h.nu)
        f = self._cost(h._stage_rows(y, d, q), h._soft_rows(on_the_way(y), q), q)
        f += h._priced(y, d, q)
        z, dz = ca.vertcat(x, v), ca.vertcat(dx, dv)
        price = [f, ca.jtimes(f, z, dz)]
        self.price = ca.Function("price", [x, v, d, q, dx, dv], price, {"cse": True})
        still = {n: s for n, s in y.items() if not ca.depends_on(s, v)}
        e = self._cost(h._last_rows(y, x, d, q), h._soft_rows(still, q), q)
        price = [e, ca.jtimes(e, x, dx)]
        self.last = ca.Function("price_at_the_end", [x, d, q, dx], price, {"cse": True})
        self.step = step

    def _cost(self, r: Any, c: Any, q: Any) -> Any:
        """Half the squares of residuals and excesses, and the prices of linear and hard ones."""
        over, caps = ca.fmax(0, c), self.h._caps(q)
        cost = ca.sumsqr(r) / 2
        for i in range(self.h.nc):
            if i not in self.h.capped:
                cost += over[i] ** 2 / 2
        for j, i in enumerate(self.h.capped):
            cost += caps[j] * over[i] + self.h.square[j] * over[i] ** 2 / 2
        return cost

    def _total(self, X: Any, V: Any, dX: Any, dV: Any, held: Any, q: Any, shared: Any) -> Any:
        """Cost of a plan, its slope along a step, and by how much its stages miss each other."""
        nx, N = self.h.nx, self.h.stages
        d, d_last = held
        x, dx = (ca.reshape(m, nx, N + 1) for m in (X, dX))
        v, dv = (ca.reshape(m, self.h.nu, N) for m in (V, dV))
        each = ca.repmat(q, 1, N)
        f, slope = self.price.map(N)(x[:, :-1], v, d, each, dx[:, :-1], dv)
        end, end_slope = self.last(x[:, -1], d_last, q, dx[:, -1])
        after = self.step.map(N)(x[:, :-1], v, d, ca.repmat(shared, 1, N))
        missed = ca.norm_1(ca.vec(after - x[:, 1:]))
        return ca.sum2(f) + end, ca.sum2(slope) + end_slope, missed

    def __call__(
        self, X: Any, V: Any, dX: Any, dV: Any, held: Any, q: Any, shared: Any
    ) -> tuple[Any, Any]:
        """Plan after the step that is taken."""
        f, slope, missed = self._total(X, V, dX, dV, held, q, shared)
        mu = 2 * ca.fmax(slope, 0) / ca.fmax(missed, 1e-12)
        promise, merit = slope - mu * missed, f + mu * missed
        part: Any = 1.0
        for a in reversed(STEPS):
            g, _, rest = self._total(X + a * dX, V + a * dV, dX, dV, held, q, shared)
            good = g + mu * rest <= merit + GAIN * a * promise
            part = ca.if_else(good, a, part)
        return X + part * dX, V + part * dV
