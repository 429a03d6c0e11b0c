"""Search for what ``slipctl.certify.dither`` proves: an orbit and a matrix, by collocation."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from slipctl.certify.dither import PAIRS, Found, Loop, Proof, basis_at, gain, heard_dither, proven

DEGREE = 8
FINE = 2 * np.pi * np.arange(64) / 64


@lru_cache(maxsize=64)
def find(loop: Loop, start: float, reach: float | None = None) -> Found | None:
    """Look for a proof that holds from |x| <= start, and within ``reach`` if that is given.

    Args:
        loop: of rationals, or of floats. start, reach: in amplitudes of the dither.

    Returns:
        The best proof that was found, whether or not it reaches that far; None if there is none.
    """
    try:
        with np.errstate(all="ignore"):
            return _find(Loop(*(float(v) for v in loop)), loop, start, reach)
    except np.linalg.LinAlgError:
        return None


def swing(loop: Loop) -> float | None:
    """Largest |x| of the periodic orbit, in amplitudes; None if none is found. Proves nothing."""
    try:
        with np.errstate(all="ignore"):
            orbit = _orbit(Loop(*(float(v) for v in loop)))
    except np.linalg.LinAlgError:
        return None
    return None if orbit is None else float(abs(orbit[0] @ basis_at(FINE, DEGREE)).max())


def _find(loop: Loop, exact: Loop, start: float, reach: float | None) -> Found | None:
    orbit = _orbit(loop)
    if orbit is None:
        return None
    solutions = _solutions(loop, orbit)
    best: tuple[float, _Trial] | None = None
    for second in (0.3, 1.0, 3.0, 10.0):
        for third in 10.0 ** np.arange(-3.5, 0.5, 0.5):
            trial = _trial(solutions, (second, float(third)))
            score = None if trial is None else _score(loop, orbit, trial, start, reach)
            if trial is not None and score is not None and (best is None or score > best[0]):
                best = score, trial
    if best is None:
        return None
    P, rate = best[1].P, best[1].mu
    first, second, third = (2.0 ** -round(math.log2(P[n][0]) / 2) for n in (0, 3, 5))
    units = first, second, third
    scaled = [[v * units[i] * units[j] for v in P[n]] for n, (i, j) in enumerate(PAIRS)]
    size = max(row[0] for row in scaled)
    short = tuple(tuple(float(f"{v / size:.13g}") for v in row) for row in scaled)
    path = tuple(tuple(float(f"{v:.15g}") for v in row) for row in orbit)
    for share in (0.995, 0.97, 0.9, 0.7):
        mu = float(f"{rate * share:.6g}")
        done = proven(exact, Proof(path, short, units, mu))
        if done is not None:
            return done
    return None


def _collocation(degree: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    angles = 2 * np.pi * np.arange(2 * degree + 1) / (2 * degree + 1)
    basis = basis_at(angles, degree).T
    return angles, basis, np.linalg.inv(basis)


def _turn(W: float, degree: int) -> np.ndarray:
    """Values at phi + W less those at phi, over W, from values at the nodes of collocation."""
    _, basis, inverse = _collocation(degree)
    rows = np.zeros_like(basis)
    for n in range(1, degree + 1):
        c, s = basis[:, 2 * n - 1], basis[:, 2 * n]
        turn, fall = math.sin(n * W) / W, 2 * math.sin(n * W / 2) ** 2 / W
        rows[:, 2 * n - 1], rows[:, 2 * n] = -c * fall - s * turn, c * turn - s * fall
    return np.asarray(rows @ inverse)


def _orbit(loop: Loop) -> np.ndarray | None:
    """Coefficients of the periodic orbit, by Newton's method on a collocation."""
    q, l, h, W = loop[:4]
    angles, _, inverse = _collocation(DEGREE)
    turn, S = _turn(W, DEGREE), np.sin(angles)
    S1, S2 = _heard(loop, angles)
    n, late = len(angles), bool(loop.late or loop.lag)
    w = np.zeros((3, n))
    eye, diag = np.eye(n), np.diag
    for _ in range(100 if late else 30):
        x, z, e = w
        H = (_heard_of(loop, inverse @ x, angles) - x * x / 2 if late else x * S1 + S2 / 2) - e
        miss = np.concatenate([turn @ x + q * z, turn @ z - l * (S * H - z),
                               turn @ e - h * H - q * x * z + q * q * W / 2 * z * z])  # fmt: skip
        slope = np.block([
            [turn, q * eye, 0 * eye],
            [-l * diag(S * S1), turn + l * eye, l * diag(S)],
            [-h * diag(S1) - q * diag(z), -q * diag(x) + q * q * W * diag(z), turn + h * eye],
        ])  # fmt: skip
        step = np.linalg.solve(slope, miss)
        w = w - step.reshape(3, n)
        if not np.all(np.isfinite(w)) or abs(w).max() > 1e3:
            return None
        if abs(step).max() < 1e-14:
            break
    return np.asarray((inverse @ w.T).T)


def _heard_of(loop: Loop, x: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """What is heard of (x + S)^2/2, of the coefficients of x."""
    values = (x @ basis_at(FINE, DEGREE) + np.sin(FINE)) ** 2 / 2
    basis = basis_at(FINE, 2 * DEGREE)
    found = basis @ values * (2 / len(FINE))
    found[0] /= 2
    for n in range(1, 2 * DEGREE + 1):
        re, im = gain(loop, n)
        c, s = found[2 * n - 1], found[2 * n]
        found[2 * n - 1], found[2 * n] = c * re + s * im, s * re - c * im
    return np.asarray(found @ basis_at(angles, 2 * DEGREE))


def _heard(loop: Loop, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return heard_dither(
        loop, np.cos(angles), np.sin(angles), np.cos(2 * angles), np.sin(2 * angles)
    )


def _jacobians(loop: Loop, angles: np.ndarray, at: np.ndarray) -> np.ndarray:
    q, l, h, W = loop[:4]
    S, x, z = np.sin(angles), at[0], at[1]
    S1, _ = _heard(loop, angles)
    J = np.zeros((len(angles), 3, 3))
    J[:, 0, 1] = -q
    J[:, 1, 0], J[:, 1, 1], J[:, 1, 2] = l * S * S1, -l, -l * S
    J[:, 2, 0], J[:, 2, 1], J[:, 2, 2] = h * S1 + q * z, q * x - q * q * W * z, -h
    return J


def _solutions(loop: Loop, orbit: np.ndarray) -> np.ndarray:
    """P for M = diag(1, 0, 0), diag(0, 1, 0) and diag(0, 0, 1), by collocation."""
    angles, basis, inverse = _collocation(DEGREE)
    turn, n = _turn(loop.W, DEGREE), len(angles)
    J = _jacobians(loop, angles, orbit @ basis.T)
    step = np.eye(3) + loop.W * J
    part = np.zeros((n, 6, 6))  # A'EA for each entry E of P+, less E, over W
    for col, (i, j) in enumerate(PAIRS):
        E = np.zeros((3, 3))
        E[i, j] = E[j, i] = 1.0
        both = J.transpose(0, 2, 1) @ E @ step + E @ J
        for row, (a, b) in enumerate(PAIRS):
            part[:, row, col] = both[:, a, b]
    later = np.eye(n) + loop.W * turn
    big = np.einsum("jab,jk->jakb", part, later) + np.einsum("jk,ab->jakb", turn, np.eye(6))
    wanted = np.zeros((n, 6, 3))
    wanted[:, 0, 0] = wanted[:, 3, 1] = wanted[:, 5, 2] = -1.0
    values = np.linalg.solve(big.reshape(6 * n, 6 * n), wanted.reshape(6 * n, 3))
    return np.asarray(np.einsum("kj,jes->sek", inverse, values.reshape(n, 6, 3)))


class _Trial(NamedTuple):
    """P with some weights of M, at 64 angles too, the inverse of its root, and its rate mu."""

    P: np.ndarray
    at: np.ndarray
    roots: np.ndarray
    mu: float


def _trial(solutions: np.ndarray, weights: tuple[float, float]) -> _Trial | None:
    scale = np.array([1.0, *weights])
    P = np.tensordot(scale, solutions, 1)
    at = _full(P @ basis_at(FINE, DEGREE))
    if not np.linalg.eigvalsh(at).min() > 0:
        return None
    roots = np.linalg.inv(np.linalg.cholesky(at))
    M = (roots * scale) @ roots.transpose(0, 2, 1)
    return _Trial(P, at, roots, float(np.linalg.eigvalsh(M).min()) / 2)


def _full(entries: np.ndarray) -> np.ndarray:
    found = np.zeros((entries.shape[1], 3, 3))
    for n, (i, j) in enumerate(PAIRS):
        found[:, i, j] = found[:, j, i] = entries[n]
    return found


def _score(
    loop: Loop, orbit: np.ndarray, trial: _Trial, start: float, reach: float | None
) -> float | None:
    """How far from the orbit a proof with these weights carries, or how near it keeps."""
    q, l, h, W, noise = loop[:5]
    at, roots, mu = trial.at, trial.roots, trial.mu
    N = np.array([[0, q / 2, 0], [q / 2, -q * q * W / 2, 0], [0, 0, 0]])
    nu = float(abs(np.linalg.eigvalsh(roots @ N @ roots.transpose(0, 2, 1))).max())
    alpha = nu * math.sqrt(float(at[:, 2, 2].max()))
    heard = np.stack([0 * FINE, l * np.sin(FINE), h + 0 * FINE], 1)
    loud = math.sqrt(float(np.einsum("ji,jik,jk->j", heard, at, heard).max()))
    rho = noise * loud
    old = loop.late + loop.lag
    if old:
        loud *= old * W * abs(q)
        inverse, swing = np.linalg.inv(at), abs(orbit @ basis_at(FINE, DEGREE)).max(axis=1)
        b, d = (math.sqrt(float(inverse[:, i, i].max())) for i in (1, 0))
        a, c = float(swing[1]), float(swing[0]) + 1
        alpha, mu = alpha + loud * b * d, mu - loud * (a * d + b * c)
        if not mu > 0:
            return None
    room = mu * mu - 4 * alpha * rho
    if not room > 0:
        return None
    farthest = (mu + math.sqrt(room)) / (2 * alpha)
    p = orbit @ basis_at(np.zeros(1), DEGREE)[:, 0]
    worst = max(math.sqrt((far := np.array([s, 0, 0]) - p) @ at[0] @ far) for s in (start, -start))
    if old:
        worst = max(worst, float(swing[1]) / b, (start + float(swing[0])) / d)
    if worst <= farthest * 0.95:
        spread = float(np.linalg.inv(at)[:, 0, 0].max())
        if reach is not None:
            return 10 - worst * math.sqrt(spread) / start
        if noise:
            return 10 - 2 * rho / (mu + math.sqrt(room)) * math.sqrt(spread) / start
    return min(farthest / worst, 5.0)
