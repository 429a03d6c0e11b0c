"""Search for what ``dither`` proves: an orbit and a matrix, by collocation."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from slipctl.models.cheng_2022.certificate.dither import (
    PAIRS,
    Found,
    Loop,
    Proof,
    basis_at,
    check_proof,
    gain,
    heard_dither,
)

DEGREE = 8
FINE = 2 * np.pi * np.arange(64) / 64

WRITTEN = 1e10
"""Steps from 0 to the largest number of a row that is written. A proof may be any numbers; those
that are found end in digits that depend on the processor, at 1e-13 or so."""

TIE = 1e-9
"""Difference of scores, as a share, that is one of rounding."""


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
    weights = np.array([(1.0, second, third) for second in (0.3, 1.0, 3.0, 10.0)
                        for third in 10.0 ** np.arange(-3.5, 0.5, 0.5)])  # fmt: skip
    trials = _trials(solutions, weights)
    score = _scores(loop, orbit, trials, start, reach)
    if not len(score) or not score.max() > -math.inf:
        return None
    best = first_of_the_best(score)
    P, rate = trials.P[best], float(trials.mu[best])
    first, second, third = (2.0 ** -round(math.log2(P[n][0]) / 2) for n in (0, 3, 5))
    units = first, second, third
    scaled = [[v * units[i] * units[j] for v in P[n]] for n, (i, j) in enumerate(PAIRS)]
    size = max(row[0] for row in scaled)
    short = tuple(tuple(_on_grid(v / size, WRITTEN) for v in row) for row in scaled)
    path = tuple(tuple(_on_grid(v, WRITTEN / max(map(abs, row))) for v in row) for row in orbit)
    for share in (0.995, 0.97, 0.9, 0.7):
        mu = float(f"{rate * share:.6g}")
        done = check_proof(exact, Proof(path, short, units, mu))
        if done is not None:
            return done
    return None


def _on_grid(value: float, steps: float) -> float:
    """The number of whole steps that is nearest, of which there are so many in 1."""
    digits = math.ceil(math.log10(steps)) if steps > 0 and math.isfinite(steps) else 15
    return round(float(value), digits) + 0.0


def first_of_the_best(scores: np.ndarray) -> int:
    """Index of the first score that is the largest, or equal to it but for rounding."""
    most = float(scores.max())
    return int(np.flatnonzero(scores >= most - TIE * (1 + abs(most)))[0])


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


class _Trials(NamedTuple):
    """Each P with some weights of M, at 64 angles too, the inverse of its root, and its rate mu."""

    P: np.ndarray
    at: np.ndarray
    roots: np.ndarray
    mu: np.ndarray


def _trials(solutions: np.ndarray, weights: np.ndarray) -> _Trials:
    """Those that are positive definite."""
    P = np.tensordot(weights, solutions, 1)
    at = np.zeros((len(P), len(FINE), 3, 3))
    values = P @ basis_at(FINE, DEGREE)
    for n, (i, j) in enumerate(PAIRS):
        at[:, :, i, j] = at[:, :, j, i] = values[:, n]
    minors = at[..., 0, 0], at[..., 0, 0] * at[..., 1, 1] - at[..., 0, 1] ** 2, np.linalg.det(at)
    good = np.all([(m > 0).all(axis=1) for m in minors], axis=0)
    P, at, weights = P[good], at[good], weights[good]
    roots = np.linalg.inv(np.linalg.cholesky(at))
    M = (roots * weights[:, None, None, :]) @ roots.swapaxes(2, 3)
    return _Trials(P, at, roots, np.linalg.eigvalsh(M).min(axis=(1, 2), initial=math.inf) / 2)


def _scores(
    loop: Loop, orbit: np.ndarray, trials: _Trials, start: float, reach: float | None
) -> np.ndarray:
    """How far from the orbit a proof with these weights carries, or how near it keeps."""
    q, l, h, W, noise = loop[:5]
    at, roots, mu = trials.at, trials.roots, trials.mu
    # |q x z - q^2 W z^2/2| over V^2, at most: its two eigenvalues that are not 0
    one, two = roots[..., 0], roots[..., 1]
    mean = q * (one * two).sum(-1) / 2 - q * q * W / 4 * (two * two).sum(-1)
    N = np.array([[0, q / 2, 0], [q / 2, -q * q * W / 2, 0], [0, 0, 0]])
    whole = roots @ N @ roots.swapaxes(2, 3)
    spread = np.sqrt(np.maximum((whole * whole).sum((-1, -2)) / 2 - mean**2, 0.0))
    nu = (abs(mean) + spread).max(axis=1)
    alpha = nu * np.sqrt(at[..., 2, 2].max(axis=1))
    heard = np.stack([0 * FINE, l * np.sin(FINE), h + 0 * FINE], 1)
    loud = np.sqrt(np.einsum("ji,sjik,jk->sj", heard, at, heard).max(axis=1))
    rho = noise * loud
    inverse = (roots * roots).sum(axis=2).max(axis=1)  # of P, its diagonal
    old, swing = loop.late + loop.lag, abs(orbit @ basis_at(FINE, DEGREE)).max(axis=1)
    b, d = np.sqrt(inverse[:, 1]), np.sqrt(inverse[:, 0])
    if old:
        loud = loud * old * W * abs(q)
        a, c = swing[1], swing[0] + 1
        alpha, mu = alpha + loud * b * d, mu - loud * (a * d + b * c)
    room = mu * mu - 4 * alpha * rho
    root = np.sqrt(np.maximum(room, 0.0))
    farthest = (mu + root) / (2 * alpha)
    p = orbit @ basis_at(np.zeros(1), DEGREE)[:, 0]
    ends = np.array([[s, 0, 0] - p for s in (start, -start)])
    worst = np.sqrt(np.einsum("ei,sik,ek->se", ends, at[:, 0], ends).max(axis=1))
    if old:
        worst = np.maximum(worst, np.maximum(swing[1] / b, (start + swing[0]) / d))
    score = np.minimum(farthest / worst, 5.0)
    if reach is not None or noise:
        near = worst if reach is not None else 2 * rho / (mu + root)
        score = np.where(worst <= farthest * 0.95, 10 - near * d / start, score)
    return np.where((room > 0) & (mu > 0), score, -math.inf)
