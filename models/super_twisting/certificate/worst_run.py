"""Worst run of a law of the super-twisting kind, simulated: x1' = -pull(y) + x2, y = |x1|^(1/2).

With ds = dt/(2 y) the half plane x1 > 0 is smooth: y_s = x2 - pull(y), x2_s = 2 y (d - push(y)),
t_s = 2 y. The worst disturbance is d = +L while x1 grows and -L while it falls; both half planes
are alike. Integrated by the classical Runge-Kutta method, so that it owes nothing to the formula
of the worst ratio that it is compared with.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

Law = Callable[[float], float]


class Turns(NamedTuple):
    """A simulated run from x1 = 0.

    Attributes:
        crossings: |x2| at each crossing of x1 = 0, the start first.
        times: when they are, in s.
        t, x1, x2, d: the run, thinned.
    """

    crossings: list[float]
    times: list[float]
    t: list[float]
    x1: list[float]
    x2: list[float]
    d: list[float]

    def growth(self) -> float:
        """Mean growth of |x2| from crossing to crossing; inf if there is none after the start."""
        n = len(self.crossings) - 1
        if n < 1:
            return math.inf
        return (self.crossings[-1] / self.crossings[0]) ** (1 / n)


def run(pull: Law, push: Law, L: float, v: float, step: float, count: int = 4) -> Turns:
    """Simulate half turns against the worst disturbance.

    Args:
        pull, push: laws of y, see the module text. L: largest |d|. v: x2 at the start.
        step: step of s. count: half turns; it ends earlier if one does not come back within
            20 000 steps, or grows beyond what a double holds, or x2 has fallen below 1e-9 v.
    """
    out = Turns([v], [0.0], [0.0], [0.0], [v], [L])
    side, now = 1.0, 0.0

    def rates(y: float, z: float, d: float) -> tuple[float, float, float]:
        return z - pull(y), 2 * y * (d - push(y)), 2 * y

    for _ in range(count):
        y, z, t, grows = 0.0, out.crossings[-1], now, True
        for k in range(20_000):
            d = L if grows else -L
            try:
                new = _rk4(rates, (y, z, t), d, step)
            except OverflowError:
                return out  # it does not come back
            if grows and new[1] < pull(new[0]):  # the turn lies inside this step; go there
                share = (z - pull(y)) / (z - pull(y) - new[1] + pull(new[0]))
                new, grows = _rk4(rates, (y, z, t), d, step * share), False
            if new[0] <= 0 and k:
                _, z, t = _rk4(rates, (y, z, t), d, step * y / (y - new[0]))
                break
            y, z, t = new
            if k % 25 == 0:
                for to, value in zip(out[2:], (t, side * y * y, side * z, side * d), strict=True):
                    to.append(value)
        else:
            return out
        if -z < 1e-9 * v:
            out.crossings.append(max(-z, 0.0))
            out.times.append(t)
            return out
        out.crossings.append(-z)
        out.times.append(t)
        now, side = t, -side
    return out


def _rk4(
    f: Callable[[float, float, float], tuple[float, float, float]],
    x: Sequence[float], d: float, h: float,
) -> tuple[float, float, float]:  # fmt: skip
    """One step of (y, z, t)."""
    a = f(x[0], x[1], d)
    b = f(x[0] + h / 2 * a[0], x[1] + h / 2 * a[1], d)
    c = f(x[0] + h / 2 * b[0], x[1] + h / 2 * b[1], d)
    e = f(x[0] + h * c[0], x[1] + h * c[1], d)
    y, z, t = (x[i] + h / 6 * (a[i] + 2 * b[i] + 2 * c[i] + e[i]) for i in range(3))
    return y, z, t
