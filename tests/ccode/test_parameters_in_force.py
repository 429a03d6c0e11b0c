"""Parameters of generated C take effect when they are checked, a state begins with init, and no
input is refused for ever."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from slipctl import Input, Output, Param, State, step
from slipctl.ccode import codegen
from slipctl.ccode.compile import compilers
from slipctl.ccode.module import guard
from slipctl.ccode.module.guard import BAD_INPUT, LIMITED, NO_INIT, OFF_RANGE, REFUSED

pytestmark = pytest.mark.skipif(compilers.first_compiler() is None, reason="no C compiler here")


@step(
    T=Output("N m", "torque", lo="-T_max", hi="T_max"),
    v=Output("1", "vector", shape=(2,), lo=0.25, hi="2 * k", safe=0.5),
)
def gain(
    x=State("1", 1.0, "sum", lo=-1e3, hi=1e3),
    u=Input("1", "number", stale=1),
    k=Param("N m", 2.0, "gain", lo=1, hi=10),
    double=Param("N m", "2 * k", "derived", lo=1, hi=15),
    T_max=Param("N m", 40.0, "largest torque", lo=1, hi=100),
):
    """Law with a derived parameter."""
    return dict(x=x + u), dict(T=double * u, v=[u, u])


@pytest.fixture(params=["double", "float"])
def module(request: pytest.FixtureRequest, tmp_path: Path) -> codegen.CModule:
    return codegen.c_module(gain, tmp_path, real=request.param).compile().load()


def _tune(c: codegen.CModule) -> int:
    return int(c._call("tune", c._param, c._state))


def test_what_tune_refuses_is_not_in_force(module: codegen.CModule) -> None:
    """NaN, off range, or a derived one off range: those before stay, for every later step."""
    c = module
    for k, T_max in ((np.nan, 40.0), (0.5, 40.0), (9.0, 40.0), (2.0, -1.0), (np.inf, 1e30)):
        c.reset()
        c._param[:2] = [k, T_max]
        for u in (1.0, -3.0, 30.0):
            assert (c.step(u=u)["T"], c.status & ~LIMITED) == (np.clip(4.0 * u, -40, 40), 0)
            assert _tune(c) == 4


def test_parameters_written_one_by_one_take_effect_together(module: codegen.CModule) -> None:
    """Half of a new set is never stepped with, and may even be none that tune would take."""
    c = module
    c.reset()
    c._param[0] = 7.5
    assert c.step(u=3.0)["T"] == 12.0
    c._param[1] = 30.0
    assert c.step(u=3.0)["T"] == 12.0
    assert _tune(c) == 0
    assert (c.step(u=3.0)["T"], c.step(u=-30.0)["T"]) == (30.0, -30.0)


def test_init_that_refuses_steps_with_the_defaults(module: codegen.CModule) -> None:
    c = module
    c.reset()
    c._param[:2] = [-1.0, np.nan]
    assert c._call("init", c._param, c._state) == 4
    assert (c.step(u=3.0)["T"], c.status) == (12.0, 0)


def test_held_outputs_follow_a_range_that_became_smaller(module: codegen.CModule) -> None:
    c = module
    c.reset()
    assert c.step(u=10.0)["T"] == 40.0
    c._param[1] = 5.0
    assert _tune(c) == 0
    c.step(u=np.nan)  # one tick with the last good value
    held = c.step(u=np.nan)
    assert c.status == BAD_INPUT | REFUSED
    assert held["T"] == 5.0
    assert held["v"].tolist() == [0.5, 0.5]


@pytest.mark.parametrize("byte", [0x00, 0x55, 0xFF])
def test_a_state_without_init_is_found(module: codegen.CModule, byte: int) -> None:
    """Whatever memory holds: refused, told, untouched, with outputs safe or in their ranges."""
    c = module
    c.reset()
    c._state.view(np.uint8)[:] = byte
    for _ in range(3):
        out = c.step(u=1.0)
        assert c.status == NO_INIT | REFUSED
        assert (out["T"], out["v"].tolist()) == (0.0, [0.5, 0.5])
        assert (c._state.view(np.uint8) == byte).all()
    assert c._call("init", c._param, c._state) == 0
    assert (c.step(u=1.0)["T"], c.status) == (4.0, 0)


@pytest.mark.parametrize("real", ["double", "float"])
def test_an_input_that_was_wrong_first_is_taken_after_a_second(real: str, tmp_path: Path) -> None:
    """By its change alone the true value would be taken after 2400 ticks, 2.4 s."""

    @step(period=1e-3, y=Output("m/s", "speed", lo=0, hi=120))
    def speed(x=State("1", 0.0, "ticks", lo=0, hi=1e6),
              v=Input("m/s", "speed", lo=0, hi=120, change=0.05, stale=10)):  # fmt: skip
        """What is measured."""
        return dict(x=x), dict(y=v)

    c = codegen.c_module(speed, tmp_path, real=real).compile().load()
    c.step(v=120.0)
    refused = 0
    while c.step(v=0.0)["y"] > 0.0:
        refused += 1
        assert c.status & OFF_RANGE
    assert refused == guard.memory(1e-3, np.array([10.0])) == 1000
    assert c.status == 0
