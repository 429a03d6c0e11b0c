"""The slip control of a vehicle's file: what it can measure and hold has ranges, like ours."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from bench.loops.closed_loop import ClosedLoop, Wrong
from slipctl.ccode import codegen
from slipctl.ccode.check.proof import function_proof, module_proof
from slipctl.ccode.check.vectors.run_inputs import record_part
from slipctl.ccode.codegen import c_module
from slipctl.ccode.compile import compilers
from slipctl.ccode.module import guard
from slipctl.ccode.module.plan import Plan
from slipctl.commands.cli import main
from slipctl.run.simulation import simulate
from slipctl.study import resolve

TOOTHED, RADAR = (
    '{ kind = "tooth_wheel", teeth = 120 }',
    '{ kind = "noisy", deviation = "0.05 m/s" }',
)
WHEELS = (
    '{ kind = "exact" }',
    '{ kind = "tooth_wheel", teeth = 30, jitter = "2e-5 s" }',
    '{ kind = "noisy", deviation = "0.3 rad/s", step = "0.1 rad/s", dropout = 0.5 }',
)
SPEEDS = (
    '{ kind = "exact" }',
    '{ kind = "noisy", deviation = "0.5 m/s", step = "0.3 m/s", dropout = 0.9 }',
    '{ kind = "wheels" }',
)
SENSORS = [(TOOTHED, RADAR), *((w, RADAR) for w in WHEELS), *((TOOTHED, v) for v in SPEEDS)]


@pytest.fixture(scope="module")
def text(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The file that ``slipctl new metro`` writes."""
    file = tmp_path_factory.mktemp("new") / "metro.toml"
    assert main(["new", "metro", str(file), "-q"]) == 0
    return file.read_text(encoding="utf-8")


def written(folder: Path, text: str, *changes: tuple[str, str]) -> resolve.Study:
    """Study of the file with some of its text changed."""
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    file = folder / "car.toml"
    file.write_text(text, encoding="utf-8")
    return resolve.load_study(str(file))


@pytest.mark.second
@pytest.mark.parametrize(
    "changes",
    [
        [],
        [('mode = "brake"', 'mode = "drive"'), ("deceleration =", "acceleration =")],
        [('kind = "searched"                        #', 'kind = "ratio" #'),
         ('start = { c = 0.7 }', 'slip = 0.05')],
        [('kind = "searched"                        #', 'kind = "speed" #'),
         ('start = { c = 0.7 }', 'slip = "1.2 m/s"')],
        [('kind = "pid"\nK = "10 1/s"', 'kind = "barrier"'),
         ('kind = "sta"\nk1 = "20 m^.5/s^1.5"\nk2 = "10 m/s^3"', 'kind = "smc"')],
    ],
    ids=["as it is", "driven", "a share of the speed", "a slip speed", "other laws"],
)  # fmt: skip
@pytest.mark.others("long")
def test_no_number_of_a_controller_is_without_a_range(tmp_path, text, changes):
    """Nor of one that is told another reference, or has another law."""
    study = written(tmp_path, text, *changes)
    for name in ("none", "pid", "super_twisting", "predictive"):
        loop, _ = resolve.find_loop(study, name)
        assert loop[study.controller].without_range() == [], name


@pytest.mark.second
@pytest.mark.parametrize(("wheel", "speed"), [
    pytest.param(*pair, marks=pytest.mark.long) if k % 2 else pair for k, pair in enumerate(SENSORS)
])  # fmt: skip
@pytest.mark.others("long")
def test_every_true_sample_is_believed(tmp_path, text, wheel, speed):
    """Of any sensor that a file may name, on dry rail and on leaves."""
    study = written(tmp_path, text, (TOOTHED, wheel), (RADAR, speed), ('"17 s"', '"5 s"'))
    loop, case = resolve.find_loop(study, "pid")
    names = [f"ctl.trust.{n}" for n in ("ok", "v_ok", "follows", "demand_ok")]
    log = simulate(loop, case.scenario, compile=False, log=names)
    for name in names:
        assert log[name].values.all(), name


@pytest.mark.long
@pytest.mark.skipif(compilers.first_compiler() is None, reason="no C compiler here")
def test_ten_wrong_wheel_speeds_do_nothing(tmp_path, text):
    """10 000 rad/s for ten ticks took super-twisting's torque off its course to the end."""
    study = written(tmp_path, text)
    loop, case = resolve.find_loop(study, "super_twisting")
    _, params = record_part(loop, study.controller, case.scenario, 1)
    module = c_module(loop[study.controller], tmp_path, "ctl", period=loop.period)
    whole = ClosedLoop(loop, study.controller, case.scenario, module.compile().load())
    module.reset(**params)
    lay = whole.plan.layout
    names = [m.name for m in lay.inputs for _ in range(m.size)]
    torques = [k for k, m in enumerate(m for m in lay.outputs for _ in range(m.size))
               if m.name == "T_cmd"]  # fmt: skip
    whole.run(6000)
    kept = whole.keep()
    plain = whole.run(2000)
    for value, bit in (
        (1e4, 0), (65535.0, 0), (np.nan, guard.BAD_INPUT)
    ):  # fmt: skip
        whole.go_back(kept)
        got = whole.run(2000, Wrong(names.index("omega"), 10, 0.0, value))
        assert (got.status[:10] & guard.BAD_INPUT == bit).all()
        assert not (got.status[30:] & ~guard.LIMITED).any()
        off = np.abs(got.outputs[30:, torques] - plain.outputs[30:, torques])
        assert off.max() < 0.02 * 8000


@pytest.mark.second
@pytest.mark.long
def test_a_loop_that_sums_is_marked_once_for_the_proof(tmp_path, text):
    """Its functions are proven one by one, and some of its loops in pairs of turns."""
    study = written(tmp_path, text)
    loop, _ = resolve.find_loop(study, "pid")
    plan = Plan(loop[study.controller], "ctl", loop.period)
    made = {
        f: module_proof.written_out(t)
        for f, t in codegen.texts(plan).items()
        if f in plan.files[1:]
    }
    assert any("loop unroll 2;" in t for t in made.values())
    done, many = function_proof.text_with_contracts("ctl", made, "double", plan.equations.functions)
    assert many >= 10  # those of numbers and vectors; a part is given structs
    lines = "\n".join(done.values()).splitlines()
    assert max(len(re.findall("loop unroll", line)) for line in lines) == 1
