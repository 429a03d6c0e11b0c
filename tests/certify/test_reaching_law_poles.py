"""Where the sampled reaching law is stable, by poles of a matrix exponential."""

import numpy as np
import pytest
from scipy.linalg import expm

from slipctl.models.huang_2020.certificate.reaching_law import stable_sampled


@pytest.mark.parametrize("lagged", [False, True])
def test_stable_where_the_poles_lie_inside_one(lagged):
    """s' = a, lag a' = u - a, u = -g1 s held over T; the poles are those of numpy."""
    rng, said = np.random.default_rng(4), []
    for _ in range(300):
        T = 10 ** rng.uniform(-3, -1)
        lag = T * 10 ** rng.uniform(-1, 1.5) if lagged else 0.0
        g1 = 10 ** rng.uniform(-1, 2 if lagged else 0.6) / (T + lag)
        if lagged:
            flow = expm(T * np.array([[0, 1, 0], [0, -1 / lag, 1 / lag], [0, 0, 0]]))
            loop = flow[:2, :2] + flow[:2, 2:] @ np.array([[-g1, 0.0]])
        else:
            loop = np.array([[1 - T * g1]])
        radius = np.abs(np.linalg.eigvals(loop)).max()
        if abs(radius - 1) < 1e-9:  # too close to tell by rounded poles
            continue
        said.append(stable_sampled(g1, T, lag))
        assert said[-1] == (radius < 1), (g1, T, lag, radius)
    assert 30 < sum(said) < len(said) - 30
