"""Loops of the studies as files: written, read again, run to the same numbers."""

import re
import tomllib
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from slipctl import Input, Output, Scenario, law, simulate
from slipctl.commands.cli import main
from slipctl.errors import BadInput
from slipctl.study import resolve
from slipctl.study.files import loop_files, trip_files

STUDIES = ("subway_braking", "hst_braking", "freight_traction", "hst_traction", "predictive")


@pytest.fixture(scope="module")
def once():
    """Cases of a study as they come."""
    build = resolve.build_cases
    return cache(lambda name: build(resolve.load_study(name)))


@pytest.fixture
def built(monkeypatch, once):
    """Cases of each study are built once, not for each of its loops."""
    monkeypatch.setattr(resolve, "build_cases", lambda study, *_: once(study.name))
    return once


def load(text, path):
    Path(path).write_text(text, encoding="utf-8")
    return trip_files.load(str(path))


@pytest.mark.long
@pytest.mark.parametrize("name", STUDIES)
def test_loops_of_a_study_are_written_out_and_run_to_their_bits(name, built, tmp_path):
    tried = set()
    for k, case in enumerate(built(name)):
        for loop in list(case.loops)[k :: 1 if k == 0 else 7]:
            where = f"{name}:{loop}@{case.scenario.name}"
            text = loop_files.loop_file_text(where, "own.toml")
            own = load(text, tmp_path / "own.toml")
            (copy,) = own.cases(own.models, False)
            assert set(copy.loops) == {loop, "ideal"} & set(case.loops) | {loop}
            there, here = case.scenario, copy.scenario
            assert (here.duration, here.seed, here.noise) == (
                there.duration, there.seed, there.noise,
            )  # fmt: skip
            assert here.inputs.keys() == there.inputs.keys()
            assert copy.known == case.known, "the rail differs"
            kind = (bool(there.params), bool(there.start))
            if copy.loops[loop] is case.loops[loop] or kind in tried:
                continue
            tried.add(kind)
            short = {"duration": 0.02}
            a = simulate(case.loops[loop], there.but(**short), compile=False)
            b = simulate(copy.loops[loop], here.but(**short), compile=False)
            assert set(a) == set(b)
            for n in a:
                assert np.array_equal(a[n].values, b[n].values, equal_nan=True), (where, n)


@pytest.mark.second
def test_what_is_edited_is_what_runs(tmp_path):
    text = loop_files.loop_file_text("hst_braking:eppfc", "own.toml")
    read = tomllib.loads(text)
    assert read["numbers"]["m"] == "13800 kg"
    text = text.replace('m = "13800 kg"', 'm = "15 t"')
    text = text.replace('time = "4 s"', 'time = "3 s"').replace("seed = 1", "seed = 7")
    text = text.replace("dry.plant.adh.a0 = 0.3546", "dry.plant.adh.a0 = 0.3")
    text = re.sub(r"(?m)^ctl\.filter\.gamma = [0-9.]+", "ctl.filter.gamma = 0.5", text)
    again = text[text.index("\n[controllers.eppfc]") : text.index("\n[controllers.ideal]")]
    text += "\n" + again.replace("controllers.eppfc", "controllers.other").replace("0.5", "0.4")
    own = load(text, tmp_path / "own.toml")
    (case,) = own.cases(own.models, False)
    assert list(case.loops) == ["eppfc", "ideal", "other"]
    assert [case.loops[n].param_values()["m"] for n in case.loops] == [15000.0] * 3
    assert case.loops["eppfc"].param_values()["ctl.filter.gamma"] == 0.5
    assert case.loops["other"].param_values()["ctl.filter.gamma"] == 0.4
    assert case.loops["eppfc"].conditions["dry"]["plant.adh.a0"] == 0.3
    assert case.scenario.rail.sections[2].start == 3.0
    assert case.scenario.seed == 7
    assert not case.known, "the study's best adhesion is that of another rail"


@pytest.mark.usefixtures("built")
@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('m = "13800 kg"', 'm = "13800 km"', "numbers.m: .*another dimension"),
        ('m = "13800 kg"', "m = 13800", "numbers.m: 13800 has no unit; write '13800 kg'"),
        ('m = "13800 kg"', 'mm = "13800 kg"', "numbers.mm: .*has no number 'mm'"),
        ('scenario = "base"', 'scenario = "bass"', "no scenario 'bass'; did you mean 'base'"),
        ('study = "hst_braking"', 'study = "hst_breaking"', "did you mean 'hst_braking'"),
        ('loop = "eppfc"', 'loop = "epfc"', "controllers.eppfc.loop: .*did you mean 'eppfc'"),
        ('condition = "wet"', 'condition = "wett"', "knows no rail condition 'wett'"),
        ("values.lam_opt", "values.lam_op", "lam_op"),
        ("gamma = 0.23", "gamma = -3", "outside|below|range"),
        ("seed = 1", "seeds = 1", "no key 'seeds'; did you mean 'seed'"),
        (
            "dry.plant.adh.a0",
            "dry.plant.adh.a9",
            r"rail.conditions.dry.plant.adh.a9: .*'plant.adh.a9'",
        ),
        ("wet.plant.adh.a1 = 24", 'wet.plant.adh.a1 = "24 m"#', "conditions.wet.plant.adh.a1: "),
        ('plant.wheel.x = "0 m"', 'plant.wheel.x = "0 s"', "start.plant.wheel.x: .*another dimen"),
        ('ctl.v_off = "1 m/s"', 'ctl.v_of = "1 m/s"', "controllers.eppfc.numbers.ctl.v_of: "),
        ("values.lam_opt = 0.18", 'values.lam_opt = "1 m"#', r"rail.sections.0.values.lam_opt: "),
    ],
)
def test_each_slip_of_the_pen_is_told_with_its_line(old, new, said, tmp_path, eppfc):
    assert old in eppfc
    with pytest.raises(BadInput, match=said) as error:
        load(eppfc.replace(old, new, 1), tmp_path / "own.toml")
    first = str(error.value).partition("\n")[0]
    assert re.match(rf"{re.escape(str(tmp_path / 'own.toml'))}, line \d+: ", first)


def test_the_bound_of_a_study_stands_beside_its_loop(eppfc):
    """``ideal`` is what distances are compared with; alone it stands once."""
    assert list(tomllib.loads(eppfc)["controllers"]) == ["eppfc", "ideal"]
    alone = loop_files.loop_file_text("hst_braking:ideal", "own.toml")
    assert list(tomllib.loads(alone)["controllers"]) == ["ideal"]


@pytest.fixture(scope="module")
def eppfc():
    return loop_files.loop_file_text("hst_braking:eppfc", "own.toml")


def test_new_from_writes_the_file_and_refuses_what_is_no_loop(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["new", "--from", "predictive:pid", "mine.toml"]) == 0
    assert Path("slipctl.schema.json").is_file()
    out = capsys.readouterr().out
    assert "mine.toml: edit it" in out
    assert main(["show", "mine.toml:pid", "--json"]) == 0
    for wrong, said in (
        (["new", "--from", "predictive"], "write which loop: predictive:pid"),
        (["new", "--from", "predictive:pit"], "no loop 'pit'; did you mean 'pid'"),
        (["new", "--from", "mine.toml:pid", "a.toml"], "such a file already"),
        (["new"], "write which vehicle"),
    ):
        capsys.readouterr()
        assert main(wrong) == 2
        assert said in capsys.readouterr().err


@law(y=Output("N", "sum"))
def fed(a=Input("N", "one, in front (of b)"), b=Input("N", "two"), c=Input("N", "three" * 30)):
    """Three forces."""
    return a + b + c


def test_inputs_that_are_numbers_are_written_and_others_are_told():
    given = {"a": 2.5, "b": lambda t: t, "c": 3}
    lines = [*loop_files._inputs(fed, Scenario("s", 1.0, inputs=given))]
    told = tomllib.loads("\n".join(lines))
    assert told == {"inputs": {"a": "2.5 N", "c": "3 N"}}
    assert "# b changes over time, as the study has it" in lines
    assert next(k for k in lines if k.startswith("a = ")).endswith("# one, in front (of b)")
    assert [*loop_files._inputs(fed, Scenario("s", 1.0))] == []
