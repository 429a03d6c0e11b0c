"""Terminal weights: the cost to go of the linear quadratic regulator, or a matrix of one's own.

At a point (x0, u0, d0) the step is dx+ = A dx + B du + E dd + f, f = F(x0, u0, d0) - x0. Residuals
are r = r0 + X dx + U du + D dd. Directions of x that no residual ever sees (the speed of a
vehicle whose slip alone is held) are left out: y = T x spans the others. The best steady state

    minimise 1/2 |r|^2 over (y, u)  with  (A - 1) y + B u + T (f + E dd) = 0

is linear in the held inputs dd, and l is the multiplier of its constraint. From y the regulator's
cost to go, less that of resting there, is 1/2 (y - y_s)'P (y - y_s) + l'(y - y_s). P is of the
discrete Riccati equation (rotate the stage cost by l; Angeli, Amrit, Rawlings 2012). With P = L'L
it is 1/2 |L (y - y_s) + l_L|^2 but for a constant, l = L' l_L: residuals of the last stage that are
linear in x and d.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from slipctl.errors import BadInput, check_known, check_number
from slipctl.predict.stages.horizon import Horizon

SEEN = 1e-9
"""Part of the largest singular value below which no residual sees a direction."""

SOLVED = 1e-7
"""Part of its right side that a linear equation may leave."""


def with_lqr(
    where: str, horizon: Horizon, weights: Mapping[str, float], at: Mapping[str, float]
) -> Horizon:
    """The problem with the regulator's cost to go in place of the last stage's residuals.

    Raises:
        BadInput: no regulator there, no steady state, a control without weight.
    """
    s = slopes_at(where, horizon, weights, at)
    P = s.regulator(where)
    y, _, level = s.steady(where)
    w, vectors = np.linalg.eigh(P)
    keep = w > SEEN * max(w.max(), 1e-300)
    L = np.sqrt(w[keep])[:, None] * vectors[:, keep].T
    shift = vectors[:, keep].T @ level / np.sqrt(w[keep])[:, None]  # L' shift = level
    if not _close(L.T @ shift, level):
        raise BadInput(
            f"{where}: terminal='lqr': the best steady state is no minimum of the cost to go; give"
            " a reference for every residual, or a law for terminal="
        )
    return s.tailed(L @ s.T, shift - L @ y)


def with_matrix(
    where: str, horizon: Horizon, weights: Mapping[str, float], at: Mapping[str, float], given: Any
) -> Horizon:
    """The problem with 1/2 (x - x_s)'P (x - x_s), x_s the best steady state.

    Raises:
        BadInput: a matrix that is not symmetric and positive semidefinite, of the plant's states.
    """
    try:
        P = np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        P = np.empty(0)
    n = horizon.nx
    if P.shape != (n, n) or not np.isfinite(P).all() or not np.allclose(P, P.T, rtol=1e-12):
        raise BadInput(
            f"{where}: terminal= takes names of residuals, a law, 'lqr', or a symmetric {n} by {n}"
            " matrix of numbers (its states in their order)"
        )
    w, vectors = np.linalg.eigh(P)
    if w.min() < -SEEN * max(abs(w).max(), 1e-300):
        raise BadInput(
            f"{where}: the terminal weight has the eigenvalue {w.min():.3g}; make it positive"
            " semidefinite"
        )
    s = slopes_at(where, horizon, weights, at)
    y, _, _ = s.steady(where)
    L = np.sqrt(np.maximum(w, 0))[:, None] * vectors.T
    return s.tailed(L, -L @ s.lift @ y)


@dataclass(frozen=True)
class Slopes:
    """What the problem is near a point (x, v, d); y = T x are the states that residuals see."""

    horizon: Horizon
    x: np.ndarray
    v: np.ndarray  # scaled controls
    d: np.ndarray
    T: np.ndarray
    lift: np.ndarray
    A: np.ndarray
    B: np.ndarray
    E: np.ndarray  # of all states by the held inputs
    drift: np.ndarray  # of y per tick: a column for 1 and one per held input
    r: np.ndarray  # the same of the residuals
    X: np.ndarray
    U: np.ndarray

    def regulator(self, where: str) -> np.ndarray:
        """P of the discrete Riccati equation."""
        import control

        R = self.U.T @ self.U
        if np.linalg.matrix_rank(R, tol=1e-14 * max(np.abs(R).max(), 1e-300)) < len(R):
            raise BadInput(
                f"{where}: terminal='lqr' needs a residual of every control; add one to the cost"
            )
        try:
            _, P, poles = control.dlqr(self.A, self.B, self.X.T @ self.X, R, self.X.T @ self.U)
            stable = bool(np.isfinite(P).all() and (np.abs(poles) < 1 - 1e-9).all())
        except (ValueError, np.linalg.LinAlgError):
            stable = False
        if not stable:
            raise BadInput(
                f"{where}: terminal='lqr': no regulator brings all that the residuals see to rest;"
                " choose another point at={...}, or write a law for terminal="
            )
        return (np.asarray(P) + np.asarray(P).T) / 2

    def gain(self, P: np.ndarray) -> np.ndarray:
        """K of the regulator's law v = v_s - K (y - y_s), with P of :meth:`regulator`."""
        weight = self.U.T @ self.U + self.B.T @ P @ self.B
        return np.asarray(np.linalg.solve(weight, self.B.T @ P @ self.A + self.U.T @ self.X))

    def steady(self, where: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Best steady state y, its control and multiplier.

        Each has a column for 1 and one per change of a held input.
        """
        n, m = len(self.A), self.B.shape[1]
        rest = self.A - np.eye(n)
        K = np.block([
            [self.X.T @ self.X, self.X.T @ self.U, rest.T],
            [self.U.T @ self.X, self.U.T @ self.U, self.B.T],
            [rest, self.B, np.zeros((n, n))],
        ])  # fmt: skip
        right = -np.vstack([self.X.T @ self.r, self.U.T @ self.r, self.drift])
        sizes = np.sqrt(np.abs(K).max(axis=1, initial=1e-300, where=K != 0))
        scaled = K / sizes[:, None] / sizes
        found = np.linalg.lstsq(scaled, right / sizes[:, None], rcond=1e-13)[0] / sizes[:, None]
        if not _close(K @ found, right):
            raise BadInput(
                f"{where}: there is no steady state at the point of terminal=; give at={{...}} with"
                " values of states, controls and references"
            )
        return found[:n], found[n : n + m], found[n + m :]

    def left(self, columns: np.ndarray) -> float:
        """Part of these columns of drift and residuals that no state and control make up for.

        Where no residual sees it, a state may go on for ever, as the speed of a vehicle: y + k dy.
        """
        n, m = len(self.A), self.B.shape[1]
        still, r = np.hstack([self.A - np.eye(n), self.B]), np.hstack([self.X, self.U])
        none = np.zeros_like(still), np.zeros_like(r)
        K = np.block([
            [still, np.hstack([-np.eye(n), np.zeros((n, m))])], [r, none[1]],
            [none[0], still], [none[1], r],
        ])  # fmt: skip
        right = np.vstack([self.drift, self.r])[:, columns]
        right = np.vstack([right, np.zeros_like(right)])
        sizes = np.abs(K).max(axis=1, keepdims=True)
        sizes[sizes == 0] = 1
        found = np.linalg.lstsq(K / sizes, right / sizes, rcond=1e-13)[0]
        short, whole = np.abs((K @ found - right) / sizes), np.abs(right / sizes)
        return float(short.max(initial=0) / max(whole.max(initial=0), 1e-300))

    def tailed(self, L: np.ndarray, columns: np.ndarray) -> Horizon:
        """The problem with residuals L (x - x0) + columns (1, d - d0)."""
        c, M = columns[:, 0] - L @ self.x, columns[:, 1:]
        return replace(self.horizon, last=(), tail=(L, M, c - M @ self.d))


def slopes_at(
    where: str, horizon: Horizon, weights: Mapping[str, float], at: Mapping[str, float]
) -> Slopes:
    """Slopes of a problem at a point: values of states, controls and held inputs, else declared."""
    h = horizon
    x0, v0, d0, p0 = _point(where, h, at)
    x, v, d, _ = h.symbols()
    q = ca.DM([*p0, *(weights[n.split(".", 1)[1]] for n in h.weighed), *([0.0] * 4 * len(h.soft))])
    step, _ = h.step()(x, v * ca.DM(h.scale), d, p0)
    r = h._rows(h._outputs(x, v * ca.DM(h.scale), d, p0), h.residuals, q)
    f = ca.Function(
        "slopes", [x, v, d],
        [step - x, *(ca.jacobian(step, z) for z in (x, v, d)), r]
        + [ca.jacobian(r, z) for z in (x, v, d)],
    )  # fmt: skip
    drift, A, B, E, r0, X, U, D = (ca.DM(m).full() for m in f(x0, v0, d0))
    T, lift = _seen(A, X)
    if not len(T):
        raise BadInput(f"{where}: no residual of the cost sees a state; give terminal= a law")
    return Slopes(
        h, x0, v0, d0, T, lift, T @ A @ lift, T @ B, E, T @ np.hstack([drift, E]),
        np.hstack([r0, D]), X @ lift, U,
    )  # fmt: skip


def _seen(A: np.ndarray, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """T and its right inverse: y = T x are the directions of x that residuals see in time."""
    rows, power = [X], X
    for _ in range(len(A) - 1):
        power = power @ A
        rows.append(power)
    O = np.vstack(rows)
    size = np.abs(O).max(axis=0)
    size[size == 0] = 1
    _, w, V = np.linalg.svd(O / size)
    rank = int((w > SEEN * max(w.max(), 1e-300)).sum())
    V = V[:rank]
    return V * size, (V / size).T


def _point(
    where: str, h: Horizon, at: Mapping[str, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """States, scaled controls, held inputs and parameters of a point: given ones, else declared."""
    model = h.model
    short = {n.removeprefix("plant."): n for n in model.states} | {n: n for n in model.inputs}
    for n, value in at.items():
        check_known(f"{where}: at has", n, short, ", which is no state, control or held input")
        check_number(f"{where}: at {n}", value)
    given = {short[n]: float(v) for n, v in at.items()}
    p = model.param_values()
    x = model.start(**{n: v for n, v in given.items() if n in model.states})
    inputs = {}
    for n, s in model.inputs.items():
        value = given.get(n, 0.0 if n in h.controls and s.value is None else s.value)
        if value is None or isinstance(value, str):
            raise BadInput(f"{where}: the point of the slopes lacks {n}; give at={{{n!r}: ...}}")
        inputs[n] = float(value)
    controls = [inputs[n] / k for n, k in zip(h.controls, h.scale, strict=True)]
    return (
        np.array(ca.DM(model.pack("state", x))).ravel(), np.array(controls),
        np.array([inputs[n] for n in h.held]), np.array(ca.DM(model.pack("param", p))).ravel(),
    )  # fmt: skip


def _close(a: np.ndarray, b: np.ndarray) -> bool:
    return bool(np.abs(a - b).max(initial=0) <= SOLVED * (1e-300 + np.abs(b).max(initial=0)))
