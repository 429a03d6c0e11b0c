"""What a seeker with a fixed dither does on a parabola, tick by tick, by a Lyapunov function.

    y = c/2 (v - v*)^2, v = th + a sin phi, phi+ = phi + w T
    high = y + n - eta,  eta+ = eta + T w_h high
    th+ = th + T k xi,  xi+ = xi + T w_l (high sin phi - xi)

In x = (th - v*)/a, z = xi/(c a^2), e = (eta - c/2 (th - v*)^2)/(c a^2), and with S = sin phi,

    x+ = x - W q z,  z+ = z + W l (S H - z),  e+ = e + W (h H + q x z - q^2 W z^2/2)
    H = x S + S^2/2 - e + n/(c a^2),  W = w T,  q = -k c a/w,  l = w_l/w,  h = w_h/w

exactly: taking c/2 (th - v*)^2 off eta leaves one product that is not linear. The loop follows a
periodic orbit p(phi). With d = (x, z, e) - p(phi) and V^2 = d' P(phi) d, both trigonometric sums,

    V+ <= (1 - W mu) V + W (alpha V^2 + rho)

if M = -(J'P+ + P+ J + W J'P+ J + (P+ - P)/W) >= 2 mu P for all phi, where P+ = P(phi + W), J is the
Jacobian at the orbit, alpha bounds the product and rho what the sum for the orbit leaves over, and
the noise. So V ends below the smaller root of alpha V^2 - mu V + rho from wherever it is below the
larger one. ``find`` looks for P and p with floats; ``proven`` needs no search: it bounds each of
these functions with balls at equally spaced nodes, and between them by the theorem of Ehlich and
Zeller (Math. Z. 86, 1964): a trigonometric sum of degree D is nowhere larger than at the best of N
nodes divided by cos(pi D/N).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from slipctl.certify.ball import Ball

DEGREE = 8
NODES = 1024
FINE = 2 * np.pi * np.arange(64) / 64
PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))

Coefficients = tuple[tuple[float, ...], ...]
"""Row by row 1, cos phi, sin phi, cos 2 phi, sin 2 phi, ..."""


class Loop(NamedTuple):
    """A seeker without dimensions: q, l, h, W as above, noise as a share of |c| a^2."""

    q: Any
    l: Any
    h: Any
    W: Any
    noise: Any


class Proof(NamedTuple):
    """What ``find`` brings: the orbit (3 sums), P (6, upper triangle), units of d, rate mu."""

    orbit: Coefficients
    P: Coefficients
    units: tuple[float, float, float]
    mu: float


@dataclass(frozen=True)
class Found:
    """What is proven, lengths in amplitudes of the dither.

    Attributes:
        farthest: largest V from which the loop returns. last: V below which it ends.
        spread: |x - orbit| is at most this times V. swing: largest |x| of the orbit.
        mu, alpha, rho: of the inequality above. proof: what was checked.
    """

    farthest: float
    last: float
    spread: float
    swing: float
    mu: float
    alpha: float
    rho: float
    proof: Proof

    def from_start(self, start: float) -> float | None:
        """V at a start at x = start or -start, xi = 0, eta = y; None if it lies too far out."""
        worst = 0.0
        at = Ball.of(self.proof.orbit).dot(Ball.of(_basis(np.zeros(1), _degree(self.proof.orbit))))
        P = _matrix(Ball.of(self.proof.P).dot(Ball.of(_basis(np.zeros(1), _degree(self.proof.P)))))
        for x in (start, -start):
            d = [(Ball.of(v) - at[i]) * Ball.of(1.0).over(self.proof.units[i])
                 for i, v in enumerate((x, 0.0, 0.0))]  # fmt: skip
            worst = max(worst, float(_form(P, d).sqrt().high().max()))
        return worst if worst <= self.farthest else None

    def reach(self, start: float) -> float | None:
        """Bound of |x| for all ticks from such a start."""
        V = self.from_start(start)
        return None if V is None else (self.swing + self.spread * max(V, self.last)) * (1 + 1e-12)

    def rest(self) -> float:
        """Bound of |x| in the end."""
        return (self.swing + self.spread * self.last) * (1 + 1e-12)

    def at_least(self, loop: Loop, start: float, tick: int) -> float:
        """Number that |x| exceeds at a tick, from |x| <= start; below zero if it need not.

        Proof note: u = V - last obeys u+ <= (1 - W (mu - alpha (V + last))) u, and V does not
        rise from above ``last``; |x| is within spread V of the orbit.
        """
        V = self.from_start(start)
        if V is None:
            return -1.0
        W = Ball.of(loop.W)
        fall = self.mu - self.alpha * (V + self.last) * (1 + 1e-12)
        slow = fall * float(W.low()) * tick * (1 - 1e-9)
        near = (self.last + V * math.exp(-max(slow, 0.0))) * (1 + 1e-9)
        degree = _degree(self.proof.orbit)
        angle = float(W.mid) * tick
        error = degree * (angle * 1e-15 + tick * float(W.rad) + 1e-14)
        basis = Ball.near(_basis(np.array([angle]), degree), error)
        at = Ball.of(self.proof.orbit[:1]).dot(basis)
        return float((abs(at.mid) - at.rad).min()) * (1 - 1e-12) - self.spread * near

    def beyond(self, loop: Loop, start: float, limit: float) -> int | None:
        """Tick at which |x| certainly exceeds a limit, late on its orbit; None if there is none."""
        V = self.from_start(start)
        if V is None or not self.swing > limit:
            return None
        W = float(loop.W)
        fall = self.mu - self.alpha * (V + self.last)
        spare = (self.swing - limit) / self.spread - self.last
        if not (fall > 0 and spare > 0):
            return None
        first = math.ceil(max(math.log(V / spare), 0.0) / (fall * W) + 10 / (fall * W))
        ticks = first + np.arange(4000)
        row = np.asarray(self.proof.orbit[0])
        x = np.abs(row @ _basis(np.remainder(ticks * W, 2 * np.pi), _degree(self.proof.orbit)))
        best = int(ticks[int(x.argmax())])
        return best if self.at_least(loop, start, best) > limit * (1 + 1e-9) else None


# ---- the proof ----------------------------------------------------------------------------------


@lru_cache(maxsize=64)
def proven(loop: Loop, proof: Proof) -> Found | None:
    """Check a proof, without any search; None if it proves nothing.

    Args:
        loop: rationals, or floats as they are. proof: as ``find`` gives it.
    """
    try:
        return _proven(Loop(*(Ball.of(v) for v in loop)), proof)
    except ZeroDivisionError:
        return None


def _proven(loop: Loop, proof: Proof) -> Found | None:
    q, l, h, W, noise = loop
    degree = _degree(proof.P)
    angles = 2 * np.pi * np.arange(NODES) / NODES
    here = Ball.near(_basis(angles, degree), 1e-14 * (degree + 1))
    turned, slope = _shifted(here, W, degree)
    S = here[2]
    units = [Ball.of(u) for u in proof.units]
    coefficients, sums = Ball.of(proof.P), Ball.of(proof.orbit)
    P, after, rate = (_matrix(coefficients.dot(b)) for b in (here, turned, slope))
    x, z, e = (sums.dot(here)[i] for i in range(3))
    p_rate = sums.dot(slope)

    zero = x * 0.0
    J = [[zero, zero - q, zero],
         [l * S * S, zero - l, zero - l * S],
         [h * S + q * z, q * x - q * q * W * z, zero - h]]  # fmt: skip
    J = [[J[i][j] * units[j] * Ball.of(1.0).over(units[i]) for j in range(3)] for i in range(3)]
    PJ = _product(after, J)
    JPJ = _product(_transposed(J), PJ)
    mu = Ball.of(proof.mu)
    F = [[-(PJ[i][j] + PJ[j][i] + W * JPJ[i][j] + rate[i][j]) - 2.0 * mu * P[i][j]
          for j in range(3)] for i in range(3)]  # fmt: skip
    if not (proof.mu > 0 and min(proof.units) > 0 and _positive(P, degree)):
        return None
    if not _positive(F, 3 * degree) or not float(mu.high() * W.high()) < 1:
        return None

    N = [[zero, q * 0.5 + zero, zero], [q * 0.5 + zero, q * q * W * -0.5 + zero, zero],
         [zero, zero, zero]]  # fmt: skip
    N = [[N[i][j] * units[i] * units[j] * Ball.of(1.0).over(units[2]) for j in range(3)]
         for i in range(3)]  # fmt: skip
    nu = _dominated(P, N, degree)
    spread = _dominated(P, _corner(zero, units[0] * units[0]), degree)
    if nu is None or spread is None:
        return None
    alpha = nu * math.sqrt(_most(P[2][2], degree))

    H = x * S + S * S * 0.5 - e
    f = [zero - q * z, l * (S * H - z), h * H + q * x * z - q * q * W * 0.5 * z * z]
    rho = sum(
        _largest((f[i] - p_rate[i]) * Ball.of(1.0).over(units[i]), 2 * degree)
        * math.sqrt(_most(P[i][i], degree))
        for i in range(3)
    )  # fmt: skip
    heard = [zero, l * S * Ball.of(1.0).over(units[1]), h * Ball.of(1.0).over(units[2]) + zero]
    rho += math.sqrt(_most(_form(after, heard), degree + 2)) * float(noise.high())
    rho, alpha, least = rho * (1 + 1e-12), alpha * (1 + 1e-12), proof.mu * (1 - 1e-12)
    room = least * least - 4 * alpha * rho
    if not room > 0:
        return None
    root = math.sqrt(room) * (1 - 1e-12)
    farthest = (least + root) / (2 * alpha) * (1 - 1e-12)
    last = 2 * rho / (least + root) * (1 + 1e-12)
    return Found(farthest, last, math.sqrt(spread) * (1 + 1e-12), _largest(x, degree), proof.mu,
                 alpha, rho, proof)  # fmt: skip


def _shifted(here: Ball, W: Ball, degree: int) -> tuple[Ball, Ball]:
    """The sums 1, cos, sin, ... one tick later, and their difference quotient by W.

    Proof note: sin(n W) and 2 sin(n W/2)^2 over W, so that nothing cancels; an argument that is off
    by r moves a sine by r at most, and its quotient by W then by r/W.
    """
    mid, rad = float(W.mid), float(W.rad)
    later, slope = [here[0]], [here[0] * 0.0]
    for n in range(1, degree + 1):
        c, s = here[2 * n - 1], here[2 * n]
        error = n * (1e-15 + 2 * rad / mid)
        turn = Ball.near(math.sin(n * mid) / mid, error)
        half = Ball.near(math.sin(n * mid / 2) / mid, error)
        fall = half * half * 2.0 * W
        slope += [-(c * fall) - s * turn, c * turn - s * fall]
        later += [c + slope[-2] * W, s + slope[-1] * W]
    return _stacked(later), _stacked(slope)


def _stacked(rows: Sequence[Ball]) -> Ball:
    return Ball(np.stack([r.mid for r in rows]), np.stack([r.rad for r in rows]))


def _degree(sums: Coefficients) -> int:
    return (len(sums[0]) - 1) // 2


def _basis(angles: np.ndarray, degree: int) -> np.ndarray:
    n = np.outer(np.arange(1, degree + 1), angles)
    rows = np.empty((2 * degree + 1, len(angles)))
    rows[0], rows[1::2], rows[2::2] = 1.0, np.cos(n), np.sin(n)
    return rows


def _matrix(entries: Ball) -> list[list[Ball]]:
    found: list[list[Ball]] = [[entries[0]] * 3 for _ in range(3)]
    for n, (i, j) in enumerate(PAIRS):
        found[i][j] = found[j][i] = entries[n]
    return found


def _transposed(A: list[list[Ball]]) -> list[list[Ball]]:
    return [[A[j][i] for j in range(3)] for i in range(3)]


def _product(A: list[list[Ball]], B: list[list[Ball]]) -> list[list[Ball]]:
    return [[A[i][0] * B[0][j] + A[i][1] * B[1][j] + A[i][2] * B[2][j] for j in range(3)]
            for i in range(3)]  # fmt: skip


def _form(A: list[list[Ball]], d: Sequence[Ball]) -> Ball:
    found = d[0] * 0.0
    for i in range(3):
        for j in range(3):
            found = found + A[i][j] * d[i] * d[j]
    return found


def _corner(zero: Ball, value: Ball) -> list[list[Ball]]:
    return [[zero + value if i == j == 0 else zero for j in range(3)] for i in range(3)]


def _between(degree: int) -> float:
    """How much larger than at the nodes a sum of this degree can be."""
    return 1 / math.cos(math.pi * degree / NODES) * (1 + 1e-12)


def _largest(values: Ball, degree: int) -> float:
    return float(values.size().max()) * _between(degree)


def _most(values: Ball, degree: int) -> float:
    """Largest value of a sum, from its nodes."""
    high, low = float(values.high().max()), float(values.low().min())
    return high + (high - low) / 2 * (_between(degree) - 1) * (1 + 1e-9)


def _definite(F: list[list[Ball]], least: float) -> bool:
    """Whether all eigenvalues at all nodes exceed a number, by Sylvester's minors."""
    a, b, c = (F[i][i] - least for i in range(3))
    r, s, t = F[0][1], F[0][2], F[1][2]
    second = a * b - r * r
    third = second * c - (a * t * t - 2.0 * r * s * t + b * s * s)
    return all(bool(np.all(m.low() > 0)) for m in (a, second, third))


def _positive(F: list[list[Ball]], degree: int) -> bool:
    """Whether a symmetric matrix of sums is positive definite at all angles.

    Proof note: at a unit vector it is a sum between least and most at the nodes, so it falls below
    least by at most half of most - least times what a sum can rise between nodes.
    """
    mid = np.array([[F[i][j].mid for j in range(3)] for i in range(3)]).transpose(2, 0, 1)
    least = float(np.linalg.eigvalsh(mid).min()) * (1 - 1e-6)
    most = max(float((F[i][0].size() + F[i][1].size() + F[i][2].size()).max()) for i in range(3))
    drop = (most - least) / 2 * (_between(degree) - 1)
    return least - drop * (1 + 1e-9) > 0 and _definite(F, least)


def _dominated(P: list[list[Ball]], N: list[list[Ball]], degree: int) -> float | None:
    """Number g with -g P <= N <= g P at all angles; N does not depend on the angle."""
    array = np.array([[[A[i][j].mid for j in range(3)] for i in range(3)] for A in (P, N)])
    p, n = array.transpose(0, 3, 1, 2)
    inverse = np.linalg.inv(np.linalg.cholesky(p))
    sizes = np.linalg.eigvalsh(inverse @ n @ inverse.transpose(0, 2, 1))
    for room in (1.003, 1.03, 1.2):
        g = float(abs(sizes).max()) * room
        both = ([[g * P[i][j] + s * N[i][j] for j in range(3)] for i in range(3)]
                for s in (1.0, -1.0))  # fmt: skip
        if all(_positive(F, degree) for F in both):
            return g
    return None


# ---- the search ---------------------------------------------------------------------------------


@lru_cache(maxsize=64)
def find(loop: Loop, start: float, reach: float | None = None) -> Found | None:
    """Look for a proof that holds from |x| <= start, and within ``reach`` if that is given.

    Args:
        loop: as floats. start, reach: in amplitudes of the dither.

    Returns:
        The best proof that was found, whether or not it reaches that far; None if there is none.
    """
    loop = Loop(*(float(v) for v in loop))
    try:
        with np.errstate(all="ignore"):
            return _find(loop, start, reach)
    except np.linalg.LinAlgError:
        return None


def _find(loop: Loop, start: float, reach: float | None) -> Found | None:
    orbit = _orbit(loop)
    if orbit is None:
        return None
    solutions = _solutions(loop, orbit)
    best: tuple[float, _Trial] | None = None
    for second in (0.1, 0.3, 1.0, 3.0, 10.0, 30.0):
        for third in 10.0 ** np.arange(-4, 1.0, 0.5):
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
        done = proven(loop, Proof(path, short, units, mu))
        if done is not None:
            return done
    return None


def _collocation(degree: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    angles = 2 * np.pi * np.arange(2 * degree + 1) / (2 * degree + 1)
    basis = _basis(angles, degree).T
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
    q, l, h, W, _ = loop
    angles, _, inverse = _collocation(DEGREE)
    turn, S = _turn(W, DEGREE), np.sin(angles)
    n = len(angles)
    w = np.zeros((3, n))
    eye, diag = np.eye(n), np.diag
    for _ in range(30):
        x, z, e = w
        H = x * S + S * S / 2 - e
        miss = np.concatenate([turn @ x + q * z, turn @ z - l * (S * H - z),
                               turn @ e - h * H - q * x * z + q * q * W / 2 * z * z])  # fmt: skip
        slope = np.block([
            [turn, q * eye, 0 * eye],
            [-l * diag(S * S), turn + l * eye, l * diag(S)],
            [-h * diag(S) - q * diag(z), -q * diag(x) + q * q * W * diag(z), turn + h * eye],
        ])  # fmt: skip
        step = np.linalg.solve(slope, miss)
        w = w - step.reshape(3, n)
        if not np.all(np.isfinite(w)) or abs(w).max() > 1e3:
            return None
        if abs(step).max() < 1e-14:
            break
    return np.asarray((inverse @ w.T).T)


def _jacobians(loop: Loop, angles: np.ndarray, at: np.ndarray) -> np.ndarray:
    q, l, h, W, _ = loop
    S, x, z = np.sin(angles), at[0], at[1]
    J = np.zeros((len(angles), 3, 3))
    J[:, 0, 1] = -q
    J[:, 1, 0], J[:, 1, 1], J[:, 1, 2] = l * S * S, -l, -l * S
    J[:, 2, 0], J[:, 2, 1], J[:, 2, 2] = h * S + q * z, q * x - q * q * W * z, -h
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
    at = _full(P @ _basis(FINE, DEGREE))
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
    q, l, h, W, noise = loop
    at, roots, mu = trial.at, trial.roots, trial.mu
    N = np.array([[0, q / 2, 0], [q / 2, -q * q * W / 2, 0], [0, 0, 0]])
    nu = float(abs(np.linalg.eigvalsh(roots @ N @ roots.transpose(0, 2, 1))).max())
    alpha = nu * math.sqrt(float(at[:, 2, 2].max()))
    heard = np.stack([0 * FINE, l * np.sin(FINE), h + 0 * FINE], 1)
    rho = noise * math.sqrt(float(np.einsum("ji,jik,jk->j", heard, at, heard).max()))
    room = mu * mu - 4 * alpha * rho
    if not room > 0:
        return None
    farthest = (mu + math.sqrt(room)) / (2 * alpha)
    p = orbit @ _basis(np.zeros(1), DEGREE)[:, 0]
    worst = max(math.sqrt((d := np.array([s, 0, 0]) - p) @ at[0] @ d) for s in (start, -start))
    if worst <= farthest * 0.95:
        spread = float(np.linalg.inv(at)[:, 0, 0].max())
        if reach is not None:
            return 10 - worst * math.sqrt(spread) / start
        if noise:
            return 10 - 2 * rho / (mu + math.sqrt(room)) * math.sqrt(spread) / start
    return min(farthest / worst, 5.0)


# ---- a run that leaves --------------------------------------------------------------------------

DIGITS = 64


def flight(
    n: Mapping[str, Fraction], start: Fraction, noise: Fraction, ticks: int
) -> float | None:  # fmt: skip
    """Number that |th - v*| exceeds after so many ticks, from xi = 0, eta = y; None if unknown.

    Whole numbers of 64 decimals with a bound of their error, tick by tick; the noise is -noise or
    noise, so as to drive th outward. Each product is off by less than one unit, and what a tick
    makes of the errors before it is at most its Jacobian times them.

    Args:
        n: k, w, w_l, w_h, a, curvature, T as rationals.
    """
    D = 10**DIGITS
    k, l, h, a, c, step = (
        _units(x, D) for x in (n["T"] * n["k"], n["T"] * n["w_l"], n["T"] * n["w_h"], n["a"],
                               n["curvature"] / 2, n["w"] * n["T"])
    )  # fmt: skip
    turn_s, turn_c = _sine(step, D)
    heard = _units(noise, D)
    sign = 1 if (start > 0) == (n["k"] > 0) else -1
    th, xi = _units(start, D), 0
    eta = c * (th * th // D) // D
    s, co = 0, D
    sizes = (abs(k) / D, l / D, h / D, a / D, abs(c) / D)
    e_th, e_xi, e_eta, e_s, one = 1.0, 0.0, 4.0 + sizes[4] * 8 * abs(start), 0.0, 1.0
    for _ in range(ticks):
        v = th + a * s // D
        high = c * (v * v // D) // D - eta + (heard if (s > 0) == (sign > 0) else -heard)
        x, z = abs(v) / D, abs(high) / D
        e_v = e_th + sizes[3] * e_s + 1 + one
        e_high = sizes[4] * (2 * x * e_v + e_v * e_v / D) + e_eta + x * x + 4 * sizes[4] + 4
        th_next = th + k * xi // D
        xi, eta = xi + l * (high * s // D - xi) // D, eta + h * high // D
        new_th = e_th + sizes[0] * e_xi + abs(xi) / D + 2
        new_xi = (1 + sizes[1]) * e_xi + sizes[1] * (e_high + z * e_s + 2) + z + abs(xi) / D + 4
        e_eta = e_eta + sizes[2] * e_high + z + 2
        e_th, e_xi, th = new_th * (1 + 1e-9), new_xi * (1 + 1e-9), th_next
        e_eta *= 1 + 1e-9
        s, co = (s * turn_c + co * turn_s) // D, (co * turn_c - s * turn_s) // D
        e_s = e_s * (1 + 1e-30) + 8
        if not e_th < D:
            return None
    return (abs(th) - math.ceil(e_th)) / D * (1 - 1e-12)


def _units(x: Fraction, D: int) -> int:
    return int(x * D // 1)


def _sine(x: int, D: int) -> tuple[int, int]:
    """Sine and cosine of x/D in units of 1/D, off by less than two units for |x| <= 4 D.

    Proof note: the series with ten guard digits; the first term that is left out is below a unit of
    the guard, and so is each rounding.
    """
    guard = 10**10
    x, D = x * guard, D * guard
    sine, cosine, term, count = 0, 0, D, 0
    while term:
        part = term if count % 4 < 2 else -term
        if count % 2:
            sine += part
        else:
            cosine += part
        count += 1
        term = term * x // D // count
    return sine // guard, cosine // guard
