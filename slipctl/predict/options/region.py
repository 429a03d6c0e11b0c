"""Where the regulator's law alone brings a plant to rest within its limits: a proved ellipsoid.

The law v = v_s - K (x - x_s) of :mod:`slipctl.predict.options.terminal` has, on the nonlinear
plant, a rest x_f. With P = L'L and w = L (x - x_f), V = |w|^2 and a step is w+ = F(w), F(0) = 0.
Three things make the ball |w|^2 <= level a region of attraction:

* Limits hold in it. Of a row that is linear in w, c + a'w <= 0, the largest radius is -c/|a|.
  Others are enclosed.
* |F'(w)| < 1 in a ball about 0. Then |F(w)| is at most the integral of |F'(t w)||w| over t, so the
  law contracts there.
* V(F(w)) < V(w) from there to the edge.

The last two are enclosed by intervals over boxes that are halved until each is decided
(``certify.arithmetic.enclosure``). How far the proof could go at most is told by samples: the
nearest state found where a limit is passed or V does not fall.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from slipctl.block.block import Block, Exprs, as_block, make_block
from slipctl.block.signals import Output, Signal
from slipctl.certify.arithmetic.enclosure import enclose, from_middle
from slipctl.errors import BadInput, check_positive
from slipctl.predict.options.arguments import Limit, bounds_of, by_name, scale_of, weights_of
from slipctl.predict.options.limits import FAR, limits_of
from slipctl.predict.options.terminal import Slopes, slopes_at
from slipctl.predict.stages.horizon import Horizon, Soft

BOXES = 40_000
"""Boxes after which a level counts as not proved."""

ROOM = 1e-9
"""Left for the rounding of the change from x to w, which is not enclosed."""

NEAR = 1e-3
"""Part of a radius that fails by which the first one is smaller that a proof is tried of."""

HALVINGS = 10
"""How often that part is doubled, and how often a radius that fails is brought nearer."""

RAYS = 1000
"""Directions in which a counterexample is looked for."""


@dataclass(frozen=True)
class Region:
    """An ellipsoid in which the regulator's law keeps its limits and comes to rest.

    Attributes:
        rest: the rest x_f, by name.
        matrix: P of V = (x - x_f)'P (x - x_f), twice the cost to go of the regulator.
        level: largest V that is proved.
        contracting: V below which two motions come closer with each step.
        beyond: V of the nearest counterexample that was found, not below ``level``.
        witness: its state. why: what fails there.
        boxes: boxes of the proof.
        law: V/level as a law with the limit 1, for ``final=`` of :func:`nmpc`.
    """

    rest: dict[str, float]
    matrix: np.ndarray
    level: float
    contracting: float
    beyond: float
    witness: dict[str, float]
    why: str
    boxes: int
    law: Block

    def __str__(self) -> str:
        at, there = (_named(d) for d in (self.rest, self.witness))
        return "\n".join([
            f"region of attraction of the regulator's law about {at}",
            f"  proved    V <= {self.level:.6g}: limits hold and V falls in every step"
            f" ({self.boxes} boxes)",
            f"            V <= {self.contracting:.6g}: motions come closer",
            f"  not so at V = {self.beyond:.6g}: {there}: {self.why}",
        ])  # fmt: skip


def terminal_region(
    plant: Block,
    cost: Block,
    control: str | Sequence[str],
    *,
    h: float,
    weights: Mapping[str, float] | None = None,
    at: Mapping[str, float] | None = None,
    bounds: Mapping[str, tuple[Limit, Limit]] | None = None,
    hard: Mapping[str, tuple[float | None, float | None]] | None = None,
    method: str = "rk4",
    substeps: int = 1,
) -> Region:
    """Prove a region of attraction of the linear quadratic regulator on the nonlinear plant.

    It is that of ``nmpc(..., terminal="lqr", at=at)`` with the same arguments. Given to it as
    ``final=region.law``, the plan has to end where the regulator alone would do.

    Args:
        plant, cost, control, h, weights, at, bounds, hard, method, substeps: as of :func:`nmpc`;
            the bounds are numbers. What is held stays as it is at the point.

    Returns:
        The region. It is proved for this point, these parameters, and stages of ``h`` without
        rate limits.

    Raises:
        BadInput: no regulator at the point, a rest outside the limits, a state that no residual
            sees, a law that does not contract at its rest.
    """
    where = f"terminal_region({as_block('terminal_region: the plant', plant).name})"
    as_block(f"{where}: the cost", cost)
    check_positive(f"{where}: h", h, "s")
    controls = [control] if isinstance(control, str) else list(control)
    full = {c: plant.find(c, "input") for c in controls}
    ends = bounds_of(where, plant, full, by_name(where, "bounds", bounds))
    for c, pair in ends.items():
        if any(isinstance(b, str) for b in pair):
            raise BadInput(f"{where}: bounds of {c} have to be numbers, for which it is proved")
    softs = limits_of(where, plant, {}, {}, by_name(where, "hard", hard))
    scale = {c: scale_of(*ends[c]) for c in controls}
    weigh = weights_of(where, [cost], by_name(where, "weights", weights))
    problem = Horizon.of(
        plant, cost, controls, None, softs, 1_000_000, h, method, substeps, scale
    )  # fmt: skip
    s = slopes_at(where, problem, weigh, by_name(where, "at", at))
    rows = [(float(lo), float(hi)) for lo, hi in ends.values()]
    return _Search(where, s, controls, rows, softs).region()


class _Search:
    """Functions of w, and what is proved of them."""

    def __init__(
        self, where: str, s: Slopes, controls: Sequence[str],
        ends: Sequence[tuple[float, float]], softs: Mapping[str, Soft],
    ) -> None:  # fmt: skip
        h = s.horizon
        states = list(h.model.states.values())
        if len(s.T) < h.nx:
            raise BadInput(
                f"{where}: {h.nx - len(s.T)} of {h.nx} directions of the states are seen by no"
                " residual, so nothing is proved of them; add residuals to the cost"
            )
        self.where, self.s, self.boxes = where, s, 0
        self.names = [x.name.removeprefix("plant.") for x in states]
        P = s.regulator(where)
        y, v, _ = s.steady(where)
        try:
            self.L = np.linalg.cholesky(P).T @ s.T
        except np.linalg.LinAlgError:
            raise BadInput(
                f"{where}: the cost to go does not rise in every direction; add residuals"
            ) from None
        self.G, self.K = np.linalg.inv(self.L), s.gain(P) @ s.T
        self.x_s, self.v_s = s.x + s.lift @ y[:, 0], s.v + v[:, 0]
        self.labels = [f"{c} {side}" for c in controls for side in ("above", "below")]
        self.labels += [f"{n.removeprefix('plant.')} {side}" for n in softs
                        for side in ("above", "below")]  # fmt: skip
        self.rest = self._rest(*self._motion(ends, self.x_s))
        self._functions(*self._motion(ends, self.rest))

    def _motion(
        self, ends: Sequence[tuple[float, float]], center: np.ndarray
    ) -> tuple[Any, Any, Any]:
        """Symbol w, its next value, and rows that are at most 0 within the limits."""
        s, h = self.s, self.s.horizon
        w = ca.SX.sym("w", h.nx)
        x = ca.DM(center) + ca.DM(self.G) @ w
        v = ca.DM(self.v_s) - ca.DM(self.K) @ (x - ca.DM(self.x_s))
        p = ca.DM(h.model.pack("param", h.model.param_values()))
        u = v * ca.DM(h.scale)
        after, _ = h.step()(x, u, ca.DM(s.d), p)
        following = ca.DM(self.L) @ (after - ca.DM(center))
        rows = []
        for k, (lo, hi) in enumerate(ends):
            rows += [v[k] - hi / h.scale[k], lo / h.scale[k] - v[k]]
        y = h._outputs(x, u, ca.DM(s.d), p)
        for n, limit in zip(h.soft, h.limits, strict=True):
            for far, excess in ((limit.hi, y[n] - limit.hi), (-limit.lo, limit.lo - y[n])):
                rows.append(limit.weight * excess if far < FAR else ca.SX(-1))
        return w, following, ca.densify(ca.vertcat(*rows))

    def _rest(self, w: Any, following: Any, _: Any) -> np.ndarray:
        """The rest of the law by Newton's method, from the steady state of the linear problem."""
        slope = ca.densify(ca.jacobian(following, w)) - ca.SX.eye(len(self.L))
        f = ca.Function("rest", [w], [w - ca.solve(slope, following - w)])
        at = np.zeros(len(self.L))
        for _step in range(20):
            at = np.array(f(at)).ravel()
        left = np.array(ca.Function("left", [w], [following - w])(at)).ravel()
        size = np.abs(self.L @ np.maximum(np.abs(self.x_s), 1)).max()
        if not np.abs(left).max() <= 1e-12 * size:
            raise BadInput(
                f"{self.where}: the regulator's law has no rest near the point; give at={{...}}"
                " with a steady state"
            )
        return np.asarray(self.x_s + self.G @ at)

    def _functions(self, w: Any, following: Any, rows: Any) -> None:
        J = ca.densify(ca.jacobian(following, w))
        fall = ca.sumsqr(following) - ca.sumsqr(w)
        self.slope = ca.Function("slope", [w], [ca.vec(J)], {"cse": True})
        self.fall = ca.Function("fall", [w], [fall], {"cse": True})
        gradient = ca.densify(2 * J.T @ following - 2 * w)
        self.fall_slope = ca.Function("fall_slope", [w], [gradient], {"cse": True})
        self.rows = ca.Function("rows", [w], [rows])
        bends = [k for k in range(rows.numel())
                 if ca.depends_on(ca.jacobian(rows[k], w), w)]  # fmt: skip
        self.bent = [ca.Function("row", [w], [rows[k]]) for k in bends]
        self.bent_slopes = [
            ca.Function("row_slope", [w], [ca.densify(ca.gradient(rows[k], w))]) for k in bends
        ]
        at = np.array(self.rows(np.zeros(len(self.L)))).ravel()
        worst = int(at.argmax())
        if at[worst] >= 0:
            raise BadInput(
                f"{self.where}: at the rest {_named(self._state(np.zeros(len(self.L))))}"
                f" {self.labels[worst].split()[0]} is not within its limits; give another"
                " at={...}, or widen them"
            )
        a = np.array(ca.Function("a", [w], [ca.jacobian(rows, w)])(0.0).full())
        flat = [k for k in range(len(at)) if k not in bends and np.abs(a[k]).max(initial=0) > 0]
        rooms = [-at[k] / np.linalg.norm(a[k]) for k in flat]
        first = int(np.argmin(rooms))
        self.edge, corner = rooms[first], a[flat[first]]
        axes = np.eye(len(self.L))
        rays = np.random.default_rng(1).normal(size=(len(axes), RAYS))
        rays = np.hstack([rays, axes, -axes, corner[:, None]])
        self.rays = rays / np.linalg.norm(rays, axis=0)

    def _state(self, w: np.ndarray) -> dict[str, float]:
        x = self.rest + self.G @ w
        return {n: float(v) for n, v in zip(self.names, x, strict=True)}

    # ---- proof ----------------------------------------------------------------------------------

    def _contracts(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Upper bounds of |F'| - 1 over boxes."""
        n = len(low)
        a, b = enclose(self.slope, low, high)
        middle, half = (a + b) / 2, (b - a) / 2
        with np.errstate(all="ignore"):
            sound = np.isfinite(middle).all(axis=0) & np.isfinite(half).all(axis=0)
        safe = np.where(sound, middle, 0).T.reshape(-1, n, n)
        norms = np.linalg.norm(safe, 2, axis=(1, 2)) + np.linalg.norm(half, axis=0)
        return np.where(sound, norms - 1 + ROOM, np.inf)

    def _falls(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Upper bounds of V(F) - V, over the size of V in the box."""
        slope = enclose(self.fall_slope, low, high)
        size = (np.maximum(np.abs(low), np.abs(high)) ** 2).sum(axis=0)
        whole = enclose(self.fall, low, high)[1][0]
        ends = np.fmin(whole, from_middle(self.fall, low, high, slope))
        return np.asarray(ends / size + ROOM)

    def _within(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Upper bounds of the rows that are not linear."""
        worst = np.full(low.shape[1], -np.inf)
        for f, gradient in zip(self.bent, self.bent_slopes, strict=True):
            slope = enclose(gradient, low, high)
            ends = np.fmin(enclose(f, low, high)[1][0], from_middle(f, low, high, slope))
            worst = np.maximum(worst, ends + ROOM)
        return worst

    def _holds(
        self, bound: Callable[[np.ndarray, np.ndarray], np.ndarray], inner: float, outer: float
    ) -> bool:
        """Whether a bound is negative wherever inner <= |w| <= outer."""
        n, seen = len(self.L), 0
        low, high = np.full((n, 1), -outer), np.full((n, 1), outer)
        while low.shape[1]:
            nearest = np.maximum(np.maximum(low, -high), 0)
            farthest = np.maximum(np.abs(low), np.abs(high))
            there = ((nearest**2).sum(axis=0) <= outer**2) & ((farthest**2).sum(axis=0) >= inner**2)
            low, high = low[:, there], high[:, there]
            seen += low.shape[1]
            if seen > BOXES:
                self.boxes += seen
                return False
            middle = low + (high - low) / 2
            size = np.sqrt((middle**2).sum(axis=0))
            points = middle[:, (size >= inner) & (size <= outer)]
            if points.shape[1] and (bound(points, points) >= 0).any():
                self.boxes += seen
                return False
            open_ = bound(low, high) >= 0
            low, high, middle = low[:, open_], high[:, open_], middle[:, open_]
            cut = np.arange(n)[:, None] == np.argmax(high - low, axis=0)
            cuts = np.where(cut, middle, high), np.where(cut, middle, low)
            low, high = np.hstack([low, cuts[1]]), np.hstack([cuts[0], high])
        self.boxes += seen
        return True

    def _largest(self, bound: Any, inner: float, outer: float) -> float:
        """Largest radius up to which a bound is proved to be negative, from ``inner`` on."""

        def fails(radius: float) -> bool:
            w = radius * self.rays
            return bool((bound(w, w) >= 0).any())

        seen = _first(fails, max(inner, 1e-3 * outer), outer)
        for gap in (0.0, *(NEAR * 2.0**k for k in range(HALVINGS))):
            radius = seen * (1 - gap)
            if radius <= inner:
                break
            if (gap > 0 or seen == outer) and self._holds(bound, inner, radius):
                return radius
        return inner

    def region(self) -> Region:
        """The largest region that is proved."""
        edge = self.edge * (1 - ROOM)
        if self.bent:
            edge = self._largest(self._within, 0.0, edge)
        near = self._largest(self._contracts, 0.0, edge)
        if near == 0:
            raise BadInput(
                f"{self.where}: the regulator's law does not come closer to its rest with each"
                " step; weigh what it leaves out, or give another at={...}"
            )
        r = self._largest(self._falls, near, edge) if near < edge else near
        beyond, w, why = self._beyond(r)
        P = self.L.T @ self.L
        return Region(
            self._state(np.zeros(len(w))), P, r * r, near * near, beyond * beyond, self._state(w),
            why, self.boxes, self._law(P, r * r),
        )  # fmt: skip

    def _beyond(self, r: float) -> tuple[float, np.ndarray, str]:
        """Radius, w and reason of the nearest counterexample among samples."""
        last = self.edge * (1 + 1e-6)  # where a linear limit is passed
        radius = _first(lambda a: self._fails(a * self.rays) is not None, min(r, last), last)
        found = self._fails(radius * self.rays)
        assert found is not None
        return radius, radius * self.rays[:, found[0]], found[1]

    def _fails(self, w: np.ndarray) -> tuple[int, str] | None:
        """First of some w where a limit is passed or V does not fall, and what it is."""
        rows, fall = np.array(self.rows(w).full()), np.array(self.fall(w).full())[0]
        bad = (rows.max(axis=0) > 0) | ~(fall < 0)
        if not bad.any():
            return None
        k = int(bad.argmax())
        passed = rows[:, k].max() > 0
        why = f"{self.labels[int(rows[:, k].argmax())]} its limit" if passed else "V does not fall"
        return k, why

    def _law(self, P: np.ndarray, level: float) -> Block:
        states: list[Signal] = [
            s.as_role("input", value=None).named(n)
            for n, s in zip(self.names, self.s.horizon.model.states.values(), strict=True)
        ]
        rest = ca.DM(self.rest)

        def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
            e = ca.vertcat(*[u[n] for n in self.names]) - rest
            return {}, {"inside": ca.dot(e, ca.DM(P) @ e) / level}

        doc = f"Region of attraction of the regulator's law, proved up to V = {level:.6g}."
        inside = Output("1", "V over its largest proved value", lo=-np.inf, hi=1.0).named("inside")
        return make_block("region", "law", body, inputs=states, outputs=[inside], doc=doc)


def _named(state: Mapping[str, float]) -> str:
    """State in words; what is rounding beside 1 is 0."""
    return ", ".join(f"{n} = {0 if abs(v) < 1e-12 else v:.6g}" for n, v in state.items())


def _first(fails: Callable[[float], bool], inner: float, outer: float) -> float:
    """Smallest radius that was seen to fail from ``inner`` on, ``outer`` if none does."""
    radii = np.append(np.geomspace(inner, outer, 30)[:-1], outer) if outer > inner else [outer]
    k = next((k for k, radius in enumerate(radii) if fails(radius)), -1)
    if k <= 0:
        return float(radii[k])
    good, bad = radii[k - 1], radii[k]
    for _ in range(HALVINGS):
        middle = (good + bad) / 2
        good, bad = (good, middle) if fails(middle) else (middle, bad)
    return float(bad)
