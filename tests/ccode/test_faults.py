"""Wrong samples in closed loop: the short table. All of it: ``studies.bench.faults``."""

from __future__ import annotations

import numpy as np
import pytest

from slipctl import BadInput, Input, Output, Param, State, ranged, step
from slipctl.ccode.check import faults
from slipctl.ccode.compile import compilers
from slipctl.study import doors

try:
    compilers.compilers()
except BadInput:
    pytest.skip("no C compiler on this machine", allow_module_level=True)

CANNOT_BE = ("NaN", "infinity", "10000", "65535", "times 2", "times 1e30", "flipped")


@pytest.fixture(scope="module")
def eppfc():
    """Loop and scenario of the estimator-based controller with its sensors."""
    loop, case = doors.find_loop(doors.load_study("hst_braking"), "eppfc@real")
    return loop, case.scenario


def test_a_wheel_speed_that_cannot_be_does_no_harm(eppfc, tmp_path):
    """One tick and ten: told in each of them, forgotten after 100 ms, the wheel does not lock."""
    found = faults.faults(
        eppfc[0], "ctl", eppfc[1], tmp_path, 1.5, "plant.wheel.omega", kinds=CANNOT_BE,
        lengths=(1, 10), signals=["omega"],
    )  # fmt: skip
    assert len(found) == 2 * len(CANNOT_BE)
    assert [f for f in found if not f.passed] == []
    assert all(f.told == f.cannot_be == f.ticks for f in found)


def test_other_inputs_that_are_missing_do_no_harm(eppfc, tmp_path):
    found = faults.faults(
        eppfc[0], "ctl", eppfc[1], tmp_path, 1.5, "plant.wheel.omega",
        kinds=("NaN", "times 1e30"), lengths=(1, 10), signals=["T_b", "a_m"],
    )  # fmt: skip
    assert [f for f in found if not f.passed] == []
    assert {f.signal for f in found} == {"T_b", "a_m"}


def test_what_a_value_cannot_be():
    """Without the rule of the guards: range, and the change since the last good value."""
    read = np.array([1.0, 5.0, 1.9, np.nan, 3.8, np.inf, -1.0])
    told = faults._cannot_be(read, 0.5, 0.0, 10.0, 1.0)
    assert told.tolist() == [False, True, False, True, False, True, True]


def test_ranges_of_a_block_that_is_made():
    """``ranged`` changes ranges and nothing else; what it cannot declare is told."""

    @step(y=Output("N", "force"))
    def made(
        x=State("1", 0.0, "sum", lo=-5, hi=5), u=Input("1", "number"), k=Param("N", 2.0, "gain")
    ):
        """A block with a state."""
        return dict(x=x + u), dict(y=k * x)

    block = ranged(made, Output("N", lo="-k", hi=3).named("y"), u=Input("1", lo=-1, hi="k / 2"))
    assert block(x=1.0, u=0.5) == made(x=1.0, u=0.5)
    assert block.ends(block.inputs["u"], {"k": 2.0}) == ([-1], [1.0], [])
    assert block.ends(block.outputs["y"], {"k": 2.0}) == ([-2.0], [3], [])
    for wrong, said in (
        (dict(v=Input("1")), "made has no input 'v'"),
        (dict(u=Input("N")), "made.u is in 1, its range in N"),
        (dict(u=Input("1", hi="q")), "uses 'q'"),
    ):
        with pytest.raises(BadInput, match=said):
            ranged(made, **wrong)
    with pytest.raises(BadInput, match="is not an expression"):
        Input("1", hi="1 +")
    with pytest.raises(BadInput, match="largest change per tick is 0"):
        Input("1", change=0)
