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

if M = -(J'P+ + P+ J + W J'P+ J + (P+ - P)/W) >= 2 mu P for all phi. There P+ = P(phi + W) and J is
the Jacobian at the orbit. alpha bounds the product and rho what the sum for the orbit leaves over,
and the noise. So V ends below the smaller root of alpha V^2 - mu V + rho from wherever it is below
the larger one.

A dead time of n ticks and a lag weigh the values y of ticks ago. Heard is the sum of g_j y of j
ticks ago, n + E/(1 - E) <= n + lag/T ticks on average, E = exp(-T/lag). The orbit is that of the
loop which hears so: on it the weighted sum is one of harmonics, each with its own gain. Off it, x
of j ticks ago is x - D_j, D_j = -W q times the sum of j values z, and

    H - H(p) = d_x S1 - d_e - sum g_j (D_j - D_j(p)) ((x + x_j)/2 + S_j)
               - sum g_j D_j(p) (d_x + d_xj)/2,   S1 = sum g_j S_j

so the last two sums are a noise of at most (n + lag/T) W |q| (|d_z| (max|x| + 1) + max|p_z| |d_x|)
over all ticks before. V bounds them in turn: alpha and mu take them up. If V was at most M before
and M is below the larger root, V stays below M, and its upper limit is at most the smaller root.
Before the start th and xi rest, so M is at least what |d_z| <= max|p_z| and |d_x| <= start +
max|p_x| need.

``dither_search`` looks for P and p. ``check_proof`` needs no search: it bounds each of these
functions with balls at equally spaced nodes, and between them by the theorem of Ehlich and Zeller
(Math. Z. 86, 1964): a trigonometric sum of degree D is nowhere larger than at the best of N nodes
divided by cos(pi D/N).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from slipctl.models.cheng_2022.certificate.ball import DOWN, UP, WELL_DOWN, WELL_UP, Ball

NODES = 1024
PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))

Coefficients = tuple[tuple[float, ...], ...]
"""Row by row 1, cos phi, sin phi, cos 2 phi, sin 2 phi, ..."""


class Loop(NamedTuple):
    """A seeker without dimensions: q, l, h, W as above, noise as a share of |c| a^2.

    ``late`` is the dead time and ``lag`` the time constant of what is heard, both in ticks.
    """

    q: Any
    l: Any
    h: Any
    W: Any
    noise: Any
    late: Any = 0
    lag: Any = 0


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
        before: largest |z| of the orbit over what |z - orbit| is of V, if the loop hears late.
        loud: V of a unit of noise over W. stiff: V of an error of 1 in x, in z, in e, at most.
        spreads: |x - orbit|, |z - orbit|, |e - orbit| are at most these times V.
    """

    farthest: float
    last: float
    spread: float
    swing: float
    mu: float
    alpha: float
    rho: float
    proof: Proof
    before: float | None = None
    loud: float = math.inf
    stiff: tuple[float, ...] = (math.inf,) * 3
    spreads: tuple[float, ...] = (math.inf,) * 3

    def from_start(self, start: float) -> float | None:
        """V at a start at x = start or -start, xi = 0, eta = y; None if it lies too far out."""
        worst = 0.0
        if self.before is not None:
            worst = max(self.before, (abs(start) + self.swing) / self.spread * UP)
        at = Ball.of(self.proof.orbit).dot(
            Ball.of(basis_at(np.zeros(1), _degree(self.proof.orbit)))
        )
        P = _matrix(
            Ball.of(self.proof.P).dot(Ball.of(basis_at(np.zeros(1), _degree(self.proof.P))))
        )
        for x in (start, -start):
            d = [(Ball.of(v) - at[i]) * Ball.of(1.0).over(self.proof.units[i])
                 for i, v in enumerate((x, 0.0, 0.0))]  # fmt: skip
            worst = max(worst, float(_form(P, d).sqrt().high().max()))
        return worst if worst <= self.farthest else None

    def reach(self, start: float) -> float | None:
        """Bound of |x| for all ticks from such a start."""
        V = self.from_start(start)
        return None if V is None else (self.swing + self.spread * max(V, self.last)) * UP

    def rest(self) -> float:
        """Bound of |x| in the end."""
        return (self.swing + self.spread * self.last) * UP

    def at_least(self, loop: Loop, start: float, tick: int) -> float:
        """Number that |x| exceeds at a tick, from |x| <= start; below zero if it need not.

        Proof note: u = V - last obeys u+ <= (1 - W (mu - alpha (V + last))) u, and V does not
        rise from above ``last``. |x| is within spread V of the orbit. Of a loop that hears late it
        is exceeded at later ticks. There V comes as near to ``last`` as one likes, and the phase
        as near to that of this tick, since a rational W is no part of a turn.
        """
        V = self.from_start(start)
        if V is None:
            return -1.0
        W = Ball.of(loop.W)
        fall = self.mu - self.alpha * (V + self.last) * UP
        slow = fall * float(W.low()) * tick * WELL_DOWN
        late = math.inf if loop.late or loop.lag else max(slow, 0.0)
        near = (self.last + V * math.exp(-late)) * WELL_UP
        degree = _degree(self.proof.orbit)
        angle = float(W.mid) * tick
        error = degree * (angle * 1e-15 + tick * float(W.rad) + 1e-14)
        basis = Ball.near(basis_at(np.array([angle]), degree), error)
        at = Ball.of(self.proof.orbit[:1]).dot(basis)
        return float((abs(at.mid) - at.rad).min()) * DOWN - self.spread * near

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
        x = np.abs(row @ basis_at(np.remainder(ticks * W, 2 * np.pi), _degree(self.proof.orbit)))
        best = int(ticks[int(x.argmax())])
        return best if self.at_least(loop, start, best) > limit * WELL_UP else None


# ---- what is heard ------------------------------------------------------------------------------


def heard_dither(loop: Loop, c: Any, s: Any, c2: Any, s2: Any) -> tuple[Any, Any]:
    """What is heard of S and of S^2 at angles, of the cosines and sines of phi and of 2 phi.

    Balls, or arrays where the loop is of floats.
    """
    re, im = gain(loop, 1)
    twice_re, twice_im = gain(loop, 2)
    return s * re + c * im, (c2 * twice_re - s2 * twice_im) * -0.5 + 0.5


def heard_sum(loop: Loop, values: Ball, degree: int) -> Ball:
    """What is heard of a sum of that degree, from its values at the nodes to those."""
    angles = 2 * np.pi * np.arange(NODES) / NODES
    basis = Ball.near(basis_at(angles, degree), 1e-14 * (degree + 1))
    found = basis.dot(values) * (2 / NODES)
    rows = [found[0] * 0.5]
    for n in range(1, degree + 1):
        re, im = (Ball.of(v) for v in gain(loop, n))
        c, s = found[2 * n - 1], found[2 * n]
        rows += [c * re + s * im, s * re - c * im]  # cos(phi - t) = cos phi re - sin phi im
    return _stacked(rows).dot(basis)


def gain(loop: Loop, n: int) -> tuple[Any, Any]:
    """Sum of g_j exp(-i j n W): real and imaginary part.

    Proof note: exp(-i n late W) (1 - E)/(1 - E exp(-i n W)).
    """
    if not loop.late and not loop.lag:
        return 1.0, 0.0
    c, s = _turned_by(loop.W, n)
    re: Any = c * 0.0 + 1.0
    im: Any = c * 0.0
    if loop.lag:
        E = _forgotten(loop.lag)
        size = (c * E * -2.0 + E * E + 1.0) if isinstance(E, Ball) else 1 - 2 * E * c + E * E
        gone = -E + 1.0
        re, im = gone * (-(c * E) + 1.0), gone * (s * E) * -1.0
        re, im = (re.over(size), im.over(size)) if isinstance(E, Ball) else (re / size, im / size)
    if loop.late:
        c, s = _turned_by(loop.W, n * int(loop.late))
        re, im = re * c + im * s, im * c - re * s
    return re, im


def _turned_by(W: Any, n: int) -> tuple[Any, Any]:
    if not isinstance(W, Ball):
        return math.cos(n * W), math.sin(n * W)
    angle = n * float(W.mid)
    error = n * float(W.rad) + abs(angle) * 3e-16 + 1e-15
    return Ball.near(math.cos(angle), error), Ball.near(math.sin(angle), error)


def _forgotten(lag: Any) -> Any:
    """exp(-1/lag)."""
    if not isinstance(lag, Ball):
        return math.exp(-1 / lag)
    x = Ball.of(1.0).over(lag)
    mid = math.exp(-float(x.mid))
    return Ball.near(mid, mid * 4e-16 + float(x.rad) + 1e-300)


# ---- the proof ----------------------------------------------------------------------------------


@lru_cache(maxsize=64)
def check_proof(loop: Loop, proof: Proof) -> Found | None:
    """Check a proof, without any search; None if it proves nothing.

    Args:
        loop: rationals, or floats as they are. proof: as ``find`` gives it.
    """
    try:
        q, l, h, W, noise = (Ball.of(v) for v in loop[:5])
        lag = Ball.of(loop.lag) if loop.lag else 0
        return _proven(Loop(q, l, h, W, noise, int(loop.late), lag), proof)
    except ZeroDivisionError:
        return None


def _proven(loop: Loop, proof: Proof) -> Found | None:
    q, l, h, W, noise = loop[:5]
    degree = _degree(proof.P)
    angles = 2 * np.pi * np.arange(NODES) / NODES
    here = Ball.near(basis_at(angles, degree), 1e-14 * (degree + 1))
    turned, slope = _shifted(here, W, degree)
    S = here[2]
    S1, S2 = heard_dither(loop, here[1], S, here[3], here[4])
    units = [Ball.of(u) for u in proof.units]
    coefficients, sums = Ball.of(proof.P), Ball.of(proof.orbit)
    P, after, rate = (_matrix(coefficients.dot(b)) for b in (here, turned, slope))
    x, z, e = (sums.dot(here)[i] for i in range(3))
    p_rate = sums.dot(slope)

    zero = x * 0.0
    J = _table([[zero, zero - q, zero],
                [l * S * S1, zero - l, zero - l * S],
                [h * S1 + q * z, q * x - q * q * W * z, zero - h]])  # fmt: skip
    sizes = np.array(proof.units)
    J = J * (sizes / sizes[:, None])[..., None]
    PJ = _product(after, J)
    JPJ = _product(_transposed(J), PJ)
    mu = Ball.of(proof.mu)
    F = -(PJ + _transposed(PJ) + W * JPJ + rate) - 2.0 * mu * P
    if not (proof.mu > 0 and min(proof.units) > 0 and _positive(P, degree)):
        return None
    if not _positive(F, 3 * degree) or not float(mu.high() * W.high()) < 1:
        return None

    none = q * 0.0
    N = _table([[none, q * 0.5, none], [q * 0.5, q * q * W * -0.5, none], [none, none, none]])
    N = N * (sizes * sizes[:, None])
    roots = np.linalg.inv(np.linalg.cholesky(np.moveaxis(P.mid, 2, 0)))  # of the inverse
    M = roots @ N.mid / proof.units[2] @ roots.transpose(0, 2, 1)
    guess = float(abs(np.linalg.eigvalsh(M)).max())
    nu = _dominated(P, N * (1 / proof.units[2]), degree, guess)
    corners = []
    for i in range(3):
        square = proof.units[i] ** 2
        own = Ball.of(np.diag([square * (i == j) for j in range(3)]))
        most = float((roots[:, :, i] ** 2).sum(axis=1).max()) * square
        corners.append(_dominated(P, own, degree, most, (-1.0,)))
    spreads = tuple(math.sqrt(v) * UP for v in corners if v is not None)
    if nu is None or len(spreads) < 3:
        return None
    alpha = nu * math.sqrt(_most(P[2][2], degree))

    H = x * S1 + S2 * 0.5 - e
    if loop.late or loop.lag:
        there = x + S
        H = heard_sum(loop, there * there * 0.5, 2 * degree) - x * x * 0.5 - e
    f = [zero - q * z, l * (S * H - z), h * H + q * x * z - q * q * W * 0.5 * z * z]
    rho = sum(
        _largest((f[i] - p_rate[i]) * Ball.of(1.0).over(units[i]), 2 * degree + 1)
        * math.sqrt(_most(P[i][i], degree))
        for i in range(3)
    )  # fmt: skip
    heard = [zero, l * S * Ball.of(1.0).over(units[1]), h * Ball.of(1.0).over(units[2]) + zero]
    loud = heard_loud = math.sqrt(_most(_form(after, heard), degree + 2)) * UP
    stiff = tuple(math.sqrt(_most(P[i][i], degree)) / proof.units[i] * WELL_UP for i in range(3))
    rho += loud * float(noise.high())
    rho, alpha, least = rho * UP, alpha * UP, proof.mu * DOWN
    before = None
    old = loop.late + (float(loop.lag.high()) if loop.lag else 0.0)
    if old:
        loud *= old * float((W * q).size()) * UP
        a, b = _largest(z, degree), spreads[1]  # |z| <= a + b V, |x| + 1 <= c + d V
        c, d = _largest(x, degree) + 1, spreads[0]
        before, alpha = a / b * UP, (alpha + loud * b * d) * UP
        least = (least - loud * (a * d + b * c) * UP) * DOWN
        if not least > 0:
            return None
    room = least * least - 4 * alpha * rho
    if not room > 0:
        return None
    root = math.sqrt(room) * DOWN
    farthest = (least + root) / (2 * alpha) * DOWN
    last = 2 * rho / (least + root) * UP
    return Found(farthest, last, spreads[0], _largest(x, degree), least,
                 alpha, rho, proof, before, heard_loud, stiff, spreads)  # fmt: skip


def _shifted(here: Ball, W: Ball, degree: int) -> tuple[Ball, Ball]:
    """The sums 1, cos, sin, ... one tick later, and their difference quotient by W.

    Proof note: sin(n W) and 2 sin(n W/2)^2 over W, so that nothing cancels. An argument that is off
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


def basis_at(angles: np.ndarray, degree: int) -> np.ndarray:
    """Rows 1, cos phi, sin phi, cos 2 phi, sin 2 phi, ... at angles."""
    n = np.outer(np.arange(1, degree + 1), angles)
    rows = np.empty((2 * degree + 1, len(angles)))
    rows[0], rows[1::2], rows[2::2] = 1.0, np.cos(n), np.sin(n)
    return rows


WHERE = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
"""Place of each entry of a symmetric matrix among the pairs."""


def _matrix(entries: Ball) -> Ball:
    return entries[WHERE]


def _table(rows: Sequence[Sequence[Ball]]) -> Ball:
    """Matrix of balls as one, (3, 3, ...)."""
    return Ball(np.array([[x.mid for x in row] for row in rows]),
                np.array([[x.rad for x in row] for row in rows]))  # fmt: skip


def _transposed(A: Ball) -> Ball:
    return Ball(A.mid.swapaxes(0, 1), A.rad.swapaxes(0, 1))


def _product(A: Ball, B: Ball) -> Ball:
    found = [A[:, k, None] * B[None, k] for k in range(3)]
    return found[0] + found[1] + found[2]


def _form(A: Ball, d: Sequence[Ball]) -> Ball:
    found = d[0] * 0.0
    for i in range(3):
        for j in range(3):
            found = found + A[i][j] * d[i] * d[j]
    return found


def _between(degree: int) -> float:
    """How much larger than at the nodes a sum of this degree can be."""
    return 1 / math.cos(math.pi * degree / NODES) * UP


def _largest(values: Ball, degree: int) -> float:
    return float(values.size().max()) * _between(degree)


def _most(values: Ball, degree: int) -> float:
    """Largest value of a sum, from its nodes."""
    high, low = float(values.high().max()), float(values.low().min())
    return high + (high - low) / 2 * (_between(degree) - 1) * WELL_UP


def _definite(F: Ball, least: float) -> bool:
    """Whether all eigenvalues at all nodes exceed a number, by Sylvester's minors."""
    a, b, c = (F[i][i] - least for i in range(3))
    r, s, t = F[0][1], F[0][2], F[1][2]
    second = a * b - r * r
    third = second * c - (a * t * t - 2.0 * r * s * t + b * s * s)
    return all(bool(np.all(m.low() > 0)) for m in (a, second, third))


def _positive(F: Ball, degree: int) -> bool:
    """Whether a symmetric matrix of sums is positive definite at all angles.

    Proof note: at a unit vector it is a sum between least and most at the nodes. So it falls below
    least by at most half of most - least times what a sum can rise between nodes.
    """
    least = _least(F.mid) * (1 - 1e-6)
    most = max(float((F[i][0].size() + F[i][1].size() + F[i][2].size()).max()) for i in range(3))
    drop = (most - least) / 2 * (_between(degree) - 1)
    return least - drop * WELL_UP > 0 and _definite(F, least)


def _least(A: np.ndarray) -> float:
    """Least eigenvalue of symmetric matrices (3, 3, n), or a little less; a guess in floats."""
    mean = np.trace(A) / 3
    B = A - mean * np.eye(3)[..., None]
    size = np.sqrt((B * B).sum(axis=(0, 1)) / 6) + 1e-300
    B = B / size
    det = (B[0, 0] * (B[1, 1] * B[2, 2] - B[1, 2] ** 2)
           - B[0, 1] * (B[0, 1] * B[2, 2] - B[1, 2] * B[0, 2])
           + B[0, 2] * (B[0, 1] * B[1, 2] - B[1, 1] * B[0, 2]))  # fmt: skip
    turn = np.arccos(np.clip(det / 2, -1, 1)) / 3 + 2 * np.pi / 3
    return float((mean + 2 * size * np.cos(turn) - 1e-7 * size).min())


def _dominated(
    P: Ball, N: Ball, degree: int, guess: float, signs: Sequence[float] = (1.0, -1.0)
) -> float | None:  # fmt: skip
    """Number g with -g P <= N <= g P at all angles; N does not depend on the angle.

    Of an N that is not negative, signs = (-1,): the other half needs no proof. ``guess`` is g at
    the nodes, about.
    """
    N = Ball(N.mid[..., None], N.rad[..., None])
    for room in (1.003, 1.03, 1.2):
        if all(_positive(guess * room * P + s * N, degree) for s in signs):
            return guess * room
    return None
