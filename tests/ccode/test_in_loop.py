"""A controller on an emulated processor, its plant in Python, over the serial line."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
import xarray
from hypothesis import given
from hypothesis import strategies as st

from slipctl import (
    BadInput,
    Block,
    Input,
    Output,
    Param,
    Scenario,
    State,
    connect,
    flow,
    sampled,
    simulate,
    step,
)
from slipctl.ccode import codegen
from slipctl.ccode.check.processor.in_loop import Stored, run_in_loop
from slipctl.ccode.check.processor.rig import BROKEN, LATE, LOST, Rig, fletcher
from slipctl.ccode.compile import targets
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.passes.precision import neighbour_float
from slipctl.commands import cli
from slipctl.study import processor, resolve


@pytest.fixture(scope="module")
def board() -> None:
    try:
        targets.tool("cortex-m4")
        targets.emulator("cortex-m4")
    except BadInput as missing:
        pytest.skip(str(missing))


@flow(y=Output("m/s", "speed"))
def mass(
    v=State("m/s", 0.0, "speed"),
    F=Input("N", "force"),
    m=Param("kg", 2.0, "mass", lo=0.1),
    w=Param("N", 0.3, "load"),
):
    """A mass with a load."""
    return dict(v=(F - w) / m), dict(y=v)


@step(period=0.01, F=Output("N", "force", lo=-2, hi=2))
def pi(
    i=State("N", 0.0, "integral"),
    v=Input("m/s", "speed", lo=-1, hi=1),
    goal=Input("m/s", "wanted speed", value=0.0),
    k=Param("N s/m", 3.0, "gain", lo=0),
):
    """Proportional and integral."""
    e = goal - v
    return dict(i=i + 0.05 * k * e), dict(F=k * e + i)


def loop() -> Block:
    wires = {"ctl.v": "plant.y", "plant.F": "ctl.F", "ctl.goal": "goal"}
    return connect("loop", wires, plant=sampled(mass, 0.01, "rk4"), ctl=pi)


SCENARIO = Scenario("step", 6.0, inputs={"goal": [(0.0, 0.0), (0.5, 0.3)]}, params={"ctl.k": 3.3})


def run(real: str, faults: Any = None) -> Any:
    plan = Plan(pi, "ctl", 0.01, real)
    with Rig(plan, codegen.texts(plan), "cortex-m4", {"k": 3.3}) as rig:
        return run_in_loop(loop(), "ctl", SCENARIO, rig, faults)


@pytest.mark.second
@pytest.mark.usefixtures("board")
def test_trajectory_is_that_of_python() -> None:
    wanted = simulate(loop(), SCENARIO)
    got = run("double")
    assert not got.status.any()
    for n in ("plant.v", "ctl.F", "goal"):
        np.testing.assert_array_equal(got.data[n].values, wanted[n].values)
    single = run("float")
    np.testing.assert_allclose(single.data["ctl.F"], wanted["ctl.F"], atol=3e-6)
    assert np.abs(single.data["ctl.F"] - wanted["ctl.F"]).max() > 0


@pytest.mark.second
@pytest.mark.usefixtures("board")
def test_faults_are_told_and_the_loop_recovers() -> None:
    calm = run("double")
    faults = {20: "lost", 40: "late", 60: "broken", 61: "lost", 80: "lost", 81: "late"}
    got = run("double", faults)
    told = {20: -1, 21: LOST, 40: LATE, 60: BROKEN, 61: -1, 62: LOST, 80: -1, 81: LOST | LATE}
    assert {k: s for k, s in enumerate(got.status) if s} == told
    np.testing.assert_array_equal(got.status, processor._told(0 * got.status, faults))
    force = got.data["ctl.F"].values
    assert force[20] == force[19]  # the last command holds
    assert force[40] == force[39]
    # the missed ticks have moved the integral, and the loop has come back
    worst = float(np.abs(got.data["plant.v"] - calm.data["plant.v"]).max())
    assert worst > 0
    assert float(np.abs(got.data["plant.v"] - calm.data["plant.v"])[-1]) < 0.2 * worst


@pytest.mark.parametrize("seed", [None, 1])
def test_floats_stored_alone(seed: int | None) -> None:
    wanted = simulate(loop(), SCENARIO)
    shares: list[float] = []
    stored = Stored(pi, {"k": 3.3}, seed)
    got = run_in_loop(loop(), "ctl", SCENARIO, stored, report=shares.append)
    assert shares[0] == 0.0
    assert shares == sorted(shares)
    force = got.data["ctl.F"].values
    assert (force == force.astype(np.float32)).all()
    np.testing.assert_allclose(force, wanted["ctl.F"], atol=3e-6)


def test_floats_are_drawn_anew_only_for_what_changes() -> None:
    stored = Stored(pi, {"k": 3.3}, 1)
    draw = partial(stored._float, "input")
    first = draw(np.full(1000, 0.1))
    assert len(np.unique(first)) == 2  # the floats below and above
    np.testing.assert_array_equal(draw(np.full(1000, 0.1)), first)
    assert (draw(np.full(1000, 0.1 + 1e-12)) != first).any()


@pytest.mark.second
@given(value=st.floats(-1e30, 1e30), seed=st.integers(0, 99))
def test_drawn_floats_lie_beside_the_number_and_have_it_as_mean(value: float, seed: int) -> None:
    found = neighbour_float(np.full(400, value), np.random.default_rng(seed).random(400))
    below, above = found.min(), found.max()
    assert below <= value <= above or len(np.unique(found)) == 1
    assert np.nextafter(np.float32(below), np.float32(np.inf)) >= np.float32(above)
    spacing = float(np.spacing(np.abs(np.float32(value))))
    # the mean of 400 draws is within six deviations, .5 / 20 of the spacing each
    assert abs(found.mean() - value) <= 6 * 0.5 / 20 * spacing


def test_what_is_seen_at_once_is_refused() -> None:
    @flow(y=Output("m/s", "speed and force"))
    def leaky(v=State("m/s", 0.0), F=Input("N"), b=Param("s m/(N s)", 0.1)):
        """The force shows at once."""
        return dict(v=F), dict(y=v + b * F)

    @step(period=0.01, F=Output("N"))
    def held(i=State("N", 0.0), v=Input("m/s")):
        """Its output does not depend on its input, so the loop has no algebraic loop."""
        return dict(i=0.5 * i - v), dict(F=i)

    wires = {"ctl.v": "plant.y", "plant.F": "ctl.F"}
    closed = connect("loop", wires, plant=sampled(leaky, 0.01, "rk4"), ctl=held)
    with pytest.raises(BadInput, match="ctl sees at once what it gives; delay it by a tick"):
        run_in_loop(closed, "ctl", Scenario("s", 0.1), Stored(held, {}))
    with pytest.raises(BadInput, match="'gone' is no fault; write lost, late, broken"):
        run_in_loop(loop(), "ctl", SCENARIO, Stored(pi, {}), {3: "gone"})


def test_checksum_is_fletchers() -> None:
    assert fletcher(b"abcde") == bytes((0xF0, 0xC8))  # 0xC8F0, the usual example


@pytest.mark.second
def test_bad_input(capsys: pytest.CaptureFixture[str]) -> None:
    for words, said in (
        (["subway_braking"], "is a study; write which loop: subway_braking:ideal, subway_"),
        (["subway_braking:sta", "--fault", "7=gone"], "write TICK=WHAT, such as 1500=lost"),
        (
            ["subway_braking:sta", "--seconds", "0.3", "--fault", "299=late"],
            "the run has 300 ticks and one must follow; write a tick from 0 to 298",
        ),
        (["subway_braking:sta", "--fault", "7=lost", "7=late"], "tick 7 is lost already"),
        (["subway_braking:sta", "--target", "cortex-m3"], "is not known; did you mean"),
        (["subway_braking:sta", "--target", "host"], "'host' is not known; it has cortex-m4, "),
        (
            ["subway_braking:sta", "--seconds", "0"],
            "--seconds 0 holds no tick of subway_braking:sta",
        ),
        (["subway_braking:stb"], "has no loop 'stb'; did you mean 'sta'"),
    ):
        assert cli.main(["pil", *words]) == 2
        error = capsys.readouterr().err
        assert said in error
        assert error.count("\n") == 1


@pytest.mark.second
def test_metrics_are_compared_one_by_one() -> None:
    assert processor._close(1.0, 1.005, 0.0)
    assert not processor._close(1.0, 1.02, 0.0)
    assert processor._close(1.0, 1.02, 0.011)
    assert processor._close(None, None, 0.0)
    assert not processor._close(None, 2.0, 9.0)
    study = resolve.load_study("hst_braking")
    loop_, case = resolve.find_loop(study, "efc")
    scenario = replace(case.scenario, duration=0.05)
    found = processor._metrics(study, replace(case, scenario=scenario), simulate(loop_, scenario))
    assert "acceleration_variance[0]" in found
    assert "step_time" not in found
    assert all(v is None or isinstance(v, float) for v in found.values())


def test_recovery_is_judged_in_the_last_tenth_and_never_by_nan() -> None:
    study = resolve.load_study("hst_braking")
    time = np.arange(100.0)
    calm = xarray.Dataset({"plant.wheel.lam": ("time", np.sin(time))}, {"time": time})
    moved = calm["plant.wheel.lam"].copy()
    moved[89] += 1.0
    moved[90] += 0.02
    other = {"plant.wheel.lam": moved}
    assert processor._at_the_end(study, calm, other) == pytest.approx(0.02, rel=1e-3)
    assert np.isnan(processor._at_the_end(study, calm, {}))
    fine = {"real": "double", "signals": {"v": 0.0}, "metrics_differ": [], "wrong_status": 0,
            "faults": {}, "difference_at_the_end": np.nan}  # fmt: skip
    assert processor._failed(fine) == []
    assert processor._failed(fine | {"faults": {"3": "lost"}}) == ["no recovery"]
    assert processor._failed(fine | {"signals": {"v": np.nan}}) == ["trajectory"]
