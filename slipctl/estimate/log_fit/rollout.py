"""A flow rolled over a log with its slopes by parameters, starts and a dead time.

Between two samples the state goes by Runge-Kutta steps of order four. Its slopes S = dx/dtheta
go with it, S+ = (dF/dx) S + dF/dq, exact for those steps. An input with a dead time d is held, and
changes within an interval where t_j + d falls: intervals end there too, and dS/dd = (dF/dh) dh/dd.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from slipctl.block.block import Block
from slipctl.errors import BadInput
from slipctl.estimate.model import known_parameters, stack_column

LATEST = 2.0
"""Longest dead time in s."""


NOTHING = np.empty(0), np.empty(0)


@dataclass(frozen=True)
class Stretch:
    """Samples of a log without a gap.

    Attributes:
        time: of each in s, rising.
        inputs: of the flow by name, one number per sample.
        measured: what was measured, NaN where nothing.
        before: time and value of samples of the delayed input before the stretch.
    """

    time: np.ndarray
    inputs: Mapping[str, np.ndarray]
    measured: np.ndarray
    before: tuple[np.ndarray, np.ndarray] = NOTHING

    def thinned(self, most: int) -> Stretch:
        """About so many of its samples."""
        every = -(-self.time.size // most)
        inputs = {n: v[::every] for n, v in self.inputs.items()}
        return Stretch(self.time[::every], inputs, self.measured[::every], self.before)


def stretches(
    time: np.ndarray, inputs: Mapping[str, np.ndarray], measured: np.ndarray,
    begins: Sequence[int], delayed: str,
) -> list[Stretch]:  # fmt: skip
    """Cut a log where there are gaps; ``begins`` are the first rows behind them."""
    edges = [0, *begins, time.size]
    found = []
    for a, b in pairwise(edges):
        if b - a < 2 or not np.isfinite(measured[a:b]).any():
            continue
        early = (time < time[a]) & (time > time[a] - LATEST - 1.0)
        before = (time[early], inputs[delayed][early]) if delayed else NOTHING
        own = {n: v[a:b] for n, v in inputs.items()}
        found.append(Stretch(time[a:b], own, measured[a:b], before))
    return found


class Rolled:
    """A flow with unknown parameters, rolled over stretches of a log.

    Attributes:
        unknown: names of the parameters that are found.
        free: state whose start is found too, for each stretch; empty for none.
        delayed: input with a dead time, which is found; empty for none.
    """

    def __init__(
        self, flow: Block, output: str, unknown: Sequence[str], free: str, delayed: str, rule: str,
        start: Mapping[str, float],
    ) -> None:  # fmt: skip
        self.flow, self.output, self.unknown = flow, output, tuple(unknown)
        self.free, self.delayed, self.rule = free, delayed, rule
        known = known_parameters(flow, unknown)
        self.constants = ca.DM(stack_column(ca.DM(s.value) for s in known))
        self.states = list(flow.states)
        self.start = np.array([start[n] for n in self.states])
        self.columns = len(unknown) + bool(free) + bool(delayed)
        self._step, self._output = cache(self._make_step), cache(self._make_output)
        self._steps = cache(lambda parts, many: self._step(parts).mapaccum(many))
        self._outputs = cache(lambda many: self._output().map(many))

    def _symbols(self) -> tuple[Any, ...]:
        sym: Any = ca.SX.sym if self.flow.sx else ca.MX.sym
        return (sym("x", len(self.states)), sym("u", len(self.flow.inputs)),
                sym("q", len(self.unknown)), sym("c", self.constants.numel()))  # fmt: skip

    def _equations(self, x: Any, u: Any, q: Any, c: Any) -> tuple[Any, Any]:
        """Slope of the states, and the output."""
        free = {n: q[i] for i, n in enumerate(self.unknown)}
        free |= {s.name: c[i] for i, s in enumerate(known_parameters(self.flow, self.unknown))}
        n, y = self.flow.expr(
            self.flow.unpack("state", x), self.flow.unpack("input", u), self.flow.derive(free)
        )
        y = {**self.flow.unpack("state", x), **y}[self.output]
        return stack_column(n[k] for k in self.states), y

    def _make_step(self, parts: int) -> ca.Function:
        """Function (z, u, q, c, h, dh) -> z of state and slopes after an interval."""
        x, u, q, c = self._symbols()
        sym: Any = ca.SX.sym if self.flow.sx else ca.MX.sym
        h, dh = sym("h"), sym("dh")
        rate = ca.Function("rate", [x, u, q, c], [self._equations(x, u, q, c)[0]])
        n, w = len(self.states), self.columns
        end, part = x, h / parts
        for _ in range(parts):
            k1 = rate(end, u, q, c)
            k2 = rate(end + part / 2 * k1, u, q, c)
            k3 = rate(end + part / 2 * k2, u, q, c)
            k4 = rate(end + part * k3, u, q, c)
            end = end + part / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        S = sym("S", n, w)
        new = ca.jacobian(end, x) @ S
        extra = [ca.jacobian(end, q)]
        if self.free:
            extra.append(ca.MX(n, 1) if not self.flow.sx else ca.SX(n, 1))
        if self.delayed:
            extra.append(ca.jacobian(end, h) * dh)
        new = new + ca.horzcat(*extra)
        after = ca.densify(ca.vertcat(end, ca.reshape(new, n * w, 1)))
        step = ca.Function("step", [x, S, u, q, c, h, dh], [after], {"cse": True})
        whole = ca.MX.sym("z", n + n * w)
        given = [ca.MX.sym(f"g{i}", *s.shape) for i, s in enumerate((u, q, c, h, dh))]
        moved = step(whole[:n], ca.reshape(whole[n:], n, w), *given)
        return ca.Function("step", [whole, *given], [moved])

    def _make_output(self) -> ca.Function:
        """Function (x, u, q, c) -> output, its slopes by x and by q."""
        x, u, q, c = self._symbols()
        y = self._equations(x, u, q, c)[1]
        rows = [ca.densify(ca.jacobian(y, k)) for k in (x, q)]
        return ca.Function("output", [x, u, q, c], [y, *rows], {"cse": True})

    def _grid(
        self, piece: Stretch, dead: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Intervals of a stretch: lengths, slopes by the dead time, inputs, rows of samples."""
        t, n = piece.time, piece.time.size
        rows = np.array([piece.inputs[k] for k in self.flow.inputs]).reshape(-1, n)
        if not self.delayed:
            held = rows[:, :-1]
            if self.rule == "linear":
                held = (rows[:, :-1] + rows[:, 1:]) / 2
            return np.diff(t), np.zeros(n - 1), held, np.arange(n)
        s = np.concatenate([piece.before[0], t])
        u = np.concatenate([piece.before[1], piece.inputs[self.delayed]])
        changed = np.flatnonzero(np.diff(u)) + 1
        ends = np.clip(s[changed] + dead, t[0], t[-1])
        moves = (s[changed] + dead > t[0]) & (s[changed] + dead < t[-1])
        times = np.concatenate([t, ends])
        slopes = np.concatenate([np.zeros(n), moves.astype(float)])
        order = np.argsort(times, kind="stable")
        sample = order < n
        place = np.cumsum(sample) - 1
        past = np.searchsorted(s[changed] + dead, times[order], side="right")
        values = np.concatenate([u[:1], u[changed]])[past]
        i = list(self.flow.inputs).index(self.delayed)
        held = rows[:, np.maximum(place, 0)]
        if self.rule == "linear":
            held = (held + rows[:, np.minimum(place + 1, n - 1)]) / 2
        held[i] = values
        return np.diff(times[order]), np.diff(slopes[order]), held[:, :-1], np.flatnonzero(sample)

    def over(
        self, piece: Stretch, q: np.ndarray, start: float | None, dead: float, parts: int = 1
    ) -> tuple[np.ndarray, np.ndarray]:
        """Output at the samples, and its slopes by unknowns, start and dead time as columns."""
        h, dh, u, samples = self._grid(piece, dead)
        n, w = len(self.states), self.columns
        x0 = self.start.copy()
        S0 = np.zeros((n, w))
        if self.free:
            at = self.states.index(self.free)
            x0[at] = start
            S0[at, len(self.unknown)] = 1.0
        z0 = np.concatenate([x0, S0.ravel(order="F")])
        many = h.size
        f = self._steps(parts, many)
        fixed = [np.tile(np.asarray(v, dtype=float).reshape(-1, 1), (1, many))
                 for v in (q, self.constants.full())]  # fmt: skip
        z = f(z0, u, *fixed, h.reshape(1, -1), dh.reshape(1, -1)).full()
        z = np.column_stack([z0, z])[:, samples]
        x, S = z[:n], z[n:].reshape(w, n, -1)
        count = samples.size
        now = np.array([piece.inputs[k] for k in self.flow.inputs]).reshape(-1, count)
        tiled = (np.tile(v[:, :1], (1, count)) for v in fixed)
        y, by_x, by_q = self._outputs(count)(x, now, *tiled)
        by_x = by_x.full().reshape(n, count, order="F")
        J = np.einsum("nk,wnk->kw", by_x, S)
        J[:, : len(self.unknown)] += by_q.full().reshape(-1, count, order="F").T
        return y.full().ravel(), J


def free_state(flow: Block, output: str) -> str:
    """State whose start is sought: the only one, or the measured one; empty for none.

    Raises:
        BadInput: a state or an input that is no single number, or no state at all.
    """
    for s in (*flow.states.values(), *flow.inputs.values(), flow.outputs.get(output)):
        if s is not None and s.shape:
            raise BadInput(f"{flow.name}.{s.name} is no single number; a fit over time takes those")
    if not flow.states:
        raise BadInput(f"{flow.name} has no state; a fit over time takes a flow that has one")
    if len(flow.states) == 1:
        return next(iter(flow.states))
    return output if output in flow.states else ""
