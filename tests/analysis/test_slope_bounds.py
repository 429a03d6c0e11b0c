"""Bounds of slopes against an adversary: random curves, and the slopes that are seen of them."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from slipctl import BadInput, Input, Output, law
from slipctl.analysis.bounds import largest_slope

LOW, HIGH = -1.0, 2.0


def block(curve):
    """A block of one curve."""

    @law(mu=Output("1", "adhesion"))
    def made(v_s=Input("1", "slip")):
        """A random curve."""
        return dict(mu=curve(v_s))

    return made


def curve(rng):
    """Sum of smooth pieces and of pieces with a kink; no part of it jumps."""
    a, b, c = rng.uniform(0.2, 3, (3, 4))
    at = rng.uniform(LOW + 0.1, HIGH - 0.1, 4)
    parts = [
        lambda s: a[0] * ca.exp(-b[0] * (s - at[0])),
        lambda s: a[0] * ca.sin(b[0] * s) + a[1] * ca.tanh(c[0] * (s - at[0])),
        lambda s: a[1] * ca.fabs(s - at[1]) - c[1] * ca.fmin(s, at[2]),
        lambda s: a[2] * ca.sqrt(0.01 + (s - at[2]) ** 2) / (1 + b[2] * s**2),
        lambda s: a[3] * ca.atan(b[3] * s) + ca.if_else(s < at[3], c[3] * (s - at[3]), 0),
    ]
    some = [parts[i] for i in rng.choice(len(parts), 2, replace=False)]
    return lambda s: sum(part(s) for part in some), at


def seen(curve, at):
    """Largest |slope| of chords, short ones beside each kink too."""
    s = ca.SX.sym("s")
    f = ca.Function("f", [s], [curve(s)])
    near = at[:, None] + np.array([-2e-5, -1e-5, 1e-5, 2e-5])
    grid = np.unique(np.concatenate([np.linspace(LOW, HIGH, 4001), near.ravel()]))
    grid = grid[np.concatenate([[True], np.diff(grid) > 5e-6])]
    values = f(grid[None, :]).full().ravel()
    return float(np.abs(np.diff(values) / np.diff(grid)).max())


@pytest.mark.parametrize("seed", range(12))
def test_no_chord_is_steeper_than_the_bound(seed):
    """A chord's slope is that of some point, or lies between those beside a kink."""
    own, at = curve(np.random.default_rng(seed))
    bound = largest_slope(block(own), "mu", "v_s", {"v_s": (LOW, HIGH)})
    steepest = seen(own, at)
    assert steepest <= bound.value * (1 + 1e-6)  # the rounding of a difference over 1e-5
    assert bound.value <= 1.01 * steepest + 1e-9  # and no bound is far above what is seen


@pytest.mark.parametrize("seed", range(8))
def test_a_jump_anywhere_is_refused(seed):
    """However small the step is beside the curve, and whichever operation makes it."""
    rng = np.random.default_rng(100 + seed)
    own, _ = curve(rng)
    step, at = rng.choice([-1, 1]) * 10 ** rng.uniform(-3, 0), rng.uniform(LOW + 0.1, HIGH - 0.1)
    jumps = (
        lambda s: ca.if_else(s < at, step, 0),
        lambda s: step * ca.sign(s - at),
        lambda s: step * ca.floor(s - at),
    )
    jump = jumps[seed % 3]
    with pytest.raises(BadInput, match="may jump"):
        largest_slope(block(lambda s: own(s) + jump(s)), "mu", "v_s", {"v_s": (LOW, HIGH)})
