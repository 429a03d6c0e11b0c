"""A train whose wheels slip as they are told, on a rail that they clean for each other.

Position is the independent variable, dz/dx = -a with z = v^2/2, and

    a   = (2 N/M) sum_i f_i + d0 + d2 v^2 + g i,     M = n m
    f_i = min((1 - lam) f_fouled + lam f_clean, f_most)(e_i, v),   lam = 1 - exp(-(tau W)^n)
    W   energy per metre of one rail that the axles before have left; behind an axle W + N f e

e is the creep ratio, f_most the brake's limit. Nothing swings here: this is what a choice of slips
is worth, without the controller that holds them. A step is a cell of the rail. Forces are those of
the middle of the step and the same in both balances, so energy is exact at any length of a cell.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from slipctl import BadInput, Block
from slipctl.errors import check_positive

Slips = Callable[[float, float, np.ndarray, np.ndarray], np.ndarray]
"""From the place of the first axle in m, speed in m/s, energy in J/m that each axle finds, and
whether its rail is fouled, to the creep ratio of each axle."""


@dataclass(frozen=True)
class SlidingTrain:
    """A train and its rail.

    Attributes:
        fouled, clean: laws under the layer and without it, from ``v_s`` and ``v`` to ``mu``,
            traction positive.
        behind: place of each axle behind the first one in m, rising from 0.
        load: of one wheel in N.
        tau: strength of the cleaning in m/J.
        layers: exponent n, 1 where the first joule cleans.
        stretches: fouled places, from and to in m; none given: everywhere.
        most: largest adhesion that the brake asks for.
        slip: largest creep ratio.
        t_gamma: largest energy in J/m that a wheel may leave in its contact.
        resistance: d0 in m/s^2 and d2 in 1/m.
        gradient: rise over run, uphill positive.
        gravity: in m/s^2; the train weighs what its wheels carry.
    """

    fouled: Block
    clean: Block
    behind: tuple[float, ...]
    load: float
    tau: float
    layers: float = 1.0
    stretches: tuple[tuple[float, float], ...] | None = None
    most: float = 1.2 / 9.81
    slip: float = 0.3
    t_gamma: float = np.inf
    resistance: tuple[float, float] = (0.0, 0.0)
    gradient: float = 0.0
    gravity: float = 9.81
    _made: dict[float, tuple[np.ndarray, np.ndarray]] = field(
        default_factory=dict, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        if not self.behind or self.behind[0] != 0 or np.any(np.diff(self.behind) <= 0):
            raise BadInput("places of a train begin with 0 m and rise from axle to axle")
        for name in ("load", "most", "slip", "layers", "gravity"):
            check_positive(f"train: {name}", getattr(self, name))
        if not 0 <= self.tau < np.inf:
            raise BadInput(f"train: tau = {self.tau:g} m/J is no finite strength from 0 on")

    @property
    def axles(self) -> int:
        """How many axles it has."""
        return len(self.behind)

    @cached_property
    def curves(self) -> ca.Function:
        """Function (e, v) -> adhesion under the layer and without it, braking positive."""
        e, v = ca.SX.sym("e"), ca.SX.sym("v")
        given = {"v_s": -e * v, "v": v}
        found = [
            -block.expr({}, {k: given[k] for k in block.inputs}, block.param_values())[1]["mu"]
            for block in (self.fouled, self.clean)
        ]
        return ca.Function("curves", [e, v], found)

    def heights(self, e: np.ndarray, v: float) -> tuple[np.ndarray, np.ndarray]:
        """Adhesion under the layer and without it at creep ratios and a speed in m/s."""
        low, high = self.curves(np.asarray(e)[None, :], v)
        return low.full().ravel(), high.full().ravel()

    def recovered(self, W: Any) -> Any:
        """Share of the clean curve at an energy in J/m."""
        return -np.expm1(-((self.tau * np.asarray(W)) ** self.layers))

    def cells_behind(self, cell: float) -> np.ndarray:
        """Cells by which each axle is behind the first one.

        Raises:
            BadInput: a cell that two axles would be in.
        """
        off = np.rint(np.asarray(self.behind) / cell).astype(int)
        if np.any(np.diff(off) < 1):
            raise BadInput(f"a cell of {cell:g} m is longer than two axles are apart; write less")
        return off

    def fouled_at(self, place: np.ndarray) -> np.ndarray:
        """Whether the rail is fouled at places in m."""
        dirty = np.full(place.shape, self.stretches is None)
        for begin, end in self.stretches or ():
            dirty |= (place >= begin) & (place < end)
        return dirty

    def lost(self, v: float) -> float:
        """Deceleration in m/s^2 by resistance and gradient."""
        d0, d2 = self.resistance
        return d0 + d2 * v * v + self.gravity * self.gradient


@dataclass(frozen=True)
class Stop:
    """A stop: its distance in m, and what every axle did.

    Attributes:
        distance: from where the first axle was at the start.
        x: place of the first axle in m at the middle of each step, shape (steps,).
        v: speed there in m/s.
        e, f, W: creep ratio, adhesion, and energy in J/m that was found, shape (steps, axles).
    """

    distance: float
    x: np.ndarray
    v: np.ndarray
    e: np.ndarray
    f: np.ndarray
    W: np.ndarray


def stop(
    train: SlidingTrain, slips: Slips, speed: float, cell: float = 0.25, longest: float = 5e3
) -> Stop:
    """Stop of a train whose slips follow a rule.

    Args:
        train: the train.
        slips: its rule.
        speed: at the start, in m/s.
        cell: of the rail, in m; places of axles are rounded to it.
        longest: way in m after which it is given up.

    Raises:
        BadInput: the train does not stop on that way, a cell that two axles would be in.
    """
    off = train.cells_behind(cell)
    back, many = int(off[-1]), int(longest / cell)
    dirty = train.fouled_at((np.arange(many + back + 1) - back + 0.5) * cell)
    W, z, rows = np.zeros(dirty.shape), speed**2 / 2, []

    def forces(x: float, z: float, at: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        v, found = float(np.sqrt(2 * z)), W[at]
        e = slips(x, v, found, dirty[at])
        low, high = train.heights(e, v)
        share = np.where(dirty[at], train.recovered(found), 1.0)
        f = np.minimum((1 - share) * low + share * high, train.most)
        return train.gravity * f.mean() + train.lost(v), f, e

    for k in range(many):
        at = back + k - off
        x = (k + 0.5) * cell
        a, f, e = forces(x, z, at)
        middle = z - a * cell / 2
        if middle > 0:
            a, f, e = forces(x, middle, at)
        if z - a * cell <= 0:
            found = [np.array(column) for column in zip(*rows, strict=True)]
            return Stop(k * cell + z / a, *found)
        rows.append((x, np.sqrt(2 * middle), e, f, W[at].copy()))
        W[at] += train.load * f * e
        z -= a * cell
    raise BadInput(f"the train still moves at {np.sqrt(2 * z):.3g} m/s after {longest:g} m")
