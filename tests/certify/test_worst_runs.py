"""The run that refutes ``higher_order``, against scipy on the equations of the paper."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from slipctl.models.wang_2025.certificate.twisting_kind import _higher_run


@pytest.mark.parametrize(
    ("k4", "beta", "eta"), [(1.0, 0.6, 0.3), (3.0, 2.0, 4.0), (0.4, 0.3, 0.05)]
)
def test_a_half_turn_is_that_of_the_equations(k4: float, beta: float, eta: float) -> None:
    """s' = -k4 phi1(s) + v and v' = -2 beta k4 phi2(s) + d, d the worst: eta while s grows."""
    found = _higher_run({"k4": k4, "beta": beta, "eta": eta})

    def rates(t: float, x: np.ndarray, d: float) -> list[float]:
        root = np.sqrt(max(x[0], 0.0))
        phi2 = 0.5 + 1.5 * root + x[0]  # phi1 phi1', s > 0
        return [-k4 * (root + x[0]) + x[1], -2 * beta * k4 * phi2 + d]

    def top(t: float, x: np.ndarray, d: float) -> float:
        return rates(t, x, d)[0] if t > 0 else 1.0

    def down(t: float, x: np.ndarray, d: float) -> float:
        return float(x[0])

    top.terminal = down.terminal = True  # type: ignore[attr-defined]
    top.direction = down.direction = -1  # type: ignore[attr-defined]
    v = found.crossings[0]
    near = dict(rtol=1e-10, atol=1e-14 * v, max_step=1e-2 * v / eta)
    up = solve_ivp(rates, (0, 1), [0.0, v], events=top, args=(eta,), **near)
    falls = solve_ivp(rates, (up.t[-1], 1), up.y[:, -1], events=down, args=(-eta,), **near)
    assert found.crossings[1] == pytest.approx(-falls.y[1, -1], rel=1e-4)
    assert found.times[1] == pytest.approx(falls.t[-1], rel=1e-4)
