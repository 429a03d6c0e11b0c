"""The windowed estimator generated in float: it goes on moving, and finds what double finds."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_estimate import SWEEP, TWO_EXPONENTIALS, curve, peak

from slipctl import rls
from slipctl.ccode import codegen
from slipctl.ccode.compile.module import CModule
from slipctl.models.huang_2020.subway_braking import double_exponential
from slipctl.seek.random import epsilon

WINDOW, LONG = 32, 300
CURVES = st.tuples(st.floats(0.1, 1.0), st.floats(0.3, 0.8), st.floats(0.6, 1.5)).map(
    lambda p: (p[0], p[1], p[1] + p[2])
)
"""Numbers c, a, b whose peak lies within the sweep."""


@pytest.fixture(scope="module")
def modules(tmp_path_factory) -> dict[str, CModule]:
    """The estimator in double and in float."""
    block = rls(double_exponential, "mu", form="window", window=WINDOW, **TWO_EXPONENTIALS)
    return {
        real: codegen.c_module(block, tmp_path_factory.mktemp(real), real=real).compile().load()
        for real in ("double", "float")
    }


def estimated(modules, v, mu) -> dict[str, tuple[dict, dict]]:
    """Outputs over ticks, and states at the end, in double and float."""
    found = {}
    for real, module in modules.items():
        y = module.reset().replay({"v_s": v, "mu": mu})
        found[real] = y, module.state
    return found


@pytest.mark.second
@given(before=CURVES, after=CURVES, share=st.floats(0.003, 0.01), up=st.booleans())
@settings(max_examples=30, deadline=None)
def test_float_estimator_does_not_stand_still(modules, before, after, share, up):
    """After long convergence a small change, which no gate sees, is followed; then a large one.

    The slip goes to and fro about the peak. The prediction in float follows that in double, and the
    peak of the curve after the large change is found as well as in double.
    """
    k = np.arange(LONG)
    v = peak(*before)[0] * (1 + 0.3 * np.sin(k))
    mu = curve(v, *before) * np.where(k < LONG // 2, 1.0, 1 + share if up else 1 - share)
    found = estimated(modules, v, mu)
    assert all((m.status == 0).all() for m in modules.values())
    double, single = (found[real][0]["predicted"] for real in ("double", "float"))
    assert np.abs(single - double)[-WINDOW:].max() < 0.5 * share * np.abs(mu).max()

    sweeps = np.concatenate([SWEEP[::-1], SWEEP])
    found = estimated(
        modules, np.concatenate([v, sweeps]), np.concatenate([mu, curve(sweeps, *after)])
    )
    true = peak(*after)[0]
    double, single = (
        abs(peak(*(found[real][0][n][-1] for n in "cab"))[0] / true - 1)
        for real in ("double", "float")
    )
    assert single < max(0.02, 1.5 * double)


@given(seed=st.integers(0, 2**31), scale=st.floats(0.02, 1.0), n=st.integers(1, 80))
@settings(max_examples=50, deadline=None)
def test_float_covariance_and_damping_stay_in_range(modules, seed, scale, n):
    """Whatever is measured: variances are positive; damping in float ends at 64/sqrt(eps).

    A tick whose nonsense leads beyond the range of float is refused and leaves the state.
    """
    rng = np.random.default_rng(seed)
    found = estimated(modules, rng.uniform(0, 4, n), scale * rng.standard_normal(n))
    for real, most in (("double", 1e9), ("float", 64 / np.sqrt(np.finfo(np.float32).eps))):
        state = found[real][1]
        assert 0 < state["damping"] <= most
        assert (np.diag(state["P"]) > 0).all()
        assert np.linalg.eigvalsh(state["P"]).min() > -1e-6 * np.abs(state["P"]).max()


def test_epsilon_is_that_of_the_arithmetic():
    assert epsilon(1.0) == np.finfo(float).eps
    assert epsilon(np.float32(1)) == np.finfo(np.float32).eps


@pytest.mark.parametrize("memory", [1, 8])
def test_a_covariance_that_rounding_made_indefinite_gives_no_change_and_no_nan(memory):
    """P in float may say that a prediction has a variance below 0; then it is that of the noise.

    The root of it was NaN and refused the step. Without memory the interval was empty, and every
    sample was a change.
    """
    settings = TWO_EXPONENTIALS | {"noise": 1e-3}
    block = rls(double_exponential, "mu", form="window", window=WINDOW, memory=memory, **settings)
    x = block.start()
    given = {"v_s": 1.0, "mu": float(block(**x, v_s=1.0, mu=0.1)[1]["predicted"]) + 2e-4}
    indefinite = {"P": -1e-3 * np.eye(3), "scatter": 1e-6, "count": 20.0}
    following, found = block(**(x | indefinite), **given)
    assert found["changed"] == 0
    assert all(np.isfinite(v).all() for v in (following | found).values())
