"""A tick in two parts: what is prepared before the measurement, and the rest; the same bits."""

import numpy as np
import pytest

from slipctl import BadInput, c_module, sampled
from slipctl.predict.trials import Driver
from slipctl.studies.predictive.slip_problem import PEAKS, axle, make

UNREAD = np.full(4, np.nan)
"""Measurements that preparing does not read."""


def closed_loop(options, prepares):
    """Outputs over a change of rail; each tick is prepared so often before it is measured."""
    tick, plant = Driver(make(horizon=8, **options), compile=False), sampled(axle, 0.02, "rk4", 4).f
    x, p, rows = np.array([10, 10.05, 1.0, 0.0]), axle.pack("param", axle.param_values()), []
    for k in range(40, 80):
        for _ in range(prepares):
            tick.prepare(*UNREAD, PEAKS[k], 0.02)
        rows.append(tick(*x, PEAKS[k], 0.02))
        x = np.array(plant(x, [rows[-1][0], PEAKS[k], 0.02], p)[0]).ravel()
    return np.array(rows)


@pytest.mark.second
@pytest.mark.parametrize(
    "options",
    [
        {}, {"rates": {"u": 20.0}, "iterations": 2}, {"soft": {"s": (-0.1, 0.018, 300.0)}},
        {"scenarios": [{"mu_p": 0.6}, {}], "shared": 1, "rates": {"u": 20.0}},
    ],
)  # fmt: skip
@pytest.mark.others("long")
def test_prepare_and_the_rest_give_the_bits_of_the_whole_tick(options):
    """Once, twice or not at all prepared, or in a block that is not split."""
    whole = closed_loop(options, 0)
    for prepares in (0, 1, 2):
        assert (closed_loop({**options, "split": True}, prepares) == whole).all()


def test_a_bound_that_falls_after_preparing_acts_in_this_tick():
    """Only the model is prepared: a limit of the torque from outside is kept as it is now."""
    block = make(horizon=8, bounds={"u": (0.0, "u_most")}, split=True)
    tick = Driver(block, compile=False)
    tick(10, 10.05, 3.0, 0, 0.3, 0.02, 8.0)
    tick.prepare(*UNREAD, 0.3, 0.02, 8.0)
    assert tick(10, 10.05, 3.0, 0, 0.3, 0.02, 0.5)[0] == pytest.approx(0.5)


@pytest.mark.second
def test_c_has_two_functions_that_give_the_bits_of_step(tmp_path):
    """And a part that cannot be prepared is made with the tick."""
    block = make(horizon=5, rescue=0, passes=4, split=True)
    unit = c_module(block, tmp_path).compile().load()
    given = [dict(v=10.0, q=10.05 + 0.01 * k, T=1.0, xi=0.0) for k in range(12)]
    held = [dict(mu_p=0.3 if k < 6 else 0.12, s_ref=0.02) for k in range(12)]
    whole = [unit.step(**g, **h) for g, h in zip(given, held, strict=True)]
    states = unit.state
    for prepares, broken in ((1, False), (2, False), (1, True)):
        unit.reset()
        for g, h, y in zip(given, held, whole, strict=True):
            for _ in range(prepares):
                assert unit.prepare(**h) == 0
            if broken:  # refused; what was prepared before it stays
                assert unit.prepare(mu_p=np.nan, s_ref=0.02) & 32
            assert unit.step(**g, **h) == y
        for n, v in unit.state.items():
            assert np.array_equal(v, states[n]), n
    text = (tmp_path / "nmpc.h").read_text()
    assert "int nmpc_prepare(" in text
    assert "int nmpc_feedback(" in text


def test_what_is_not_split_prepares_nothing(tmp_path):
    with pytest.raises(BadInput, match="prepares nothing; make it with split=True"):
        Driver(make(horizon=4), compile=False).prepare(*UNREAD, 0.3, 0.02)
    with pytest.raises(BadInput, match="ipopt solves a tick as a whole; leave split= out"):
        make(solver="ipopt", split=True)
