"""Pieces of generated C and of its checks that no whole run shows."""

from __future__ import annotations

import io
import shutil
import zipfile
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from bench.loops import long_run, wrong_samples
from slipctl import BadInput, Input, Output, Param, RunFailed, State, step
from slipctl.ccode import codegen
from slipctl.ccode.check import comparison, float_error
from slipctl.ccode.compile import compilers
from slipctl.ccode.compile.module import input_rows
from slipctl.ccode.module import guard, guard_functions
from slipctl.ccode.module.comments import WIDTH
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.passes.letters import letters
from slipctl.ccode.ship import fmu, fmu_source, readable
from slipctl.ccode.tree.printer import lines_of, signature


@step(y=Output("1", "sum", lo=-4, hi=4), far=Output("1", "twice the sum"))
def adds(
    x=State("1", 0.5, "sum"),
    u=Input("1", "what is added", lo=-1, hi=1),
    k=Param("1", 1.0, "factor", lo=0, hi=2),
):
    """A sum."""
    return dict(x=x + k * u), dict(y=x, far=2 * x)


def test_a_folder_tells_the_work_of_its_equations(tmp_path: Path) -> None:
    """Counts of the arrays that the function of the equations wants, as CasADi tells them."""
    told = codegen.export(adds, tmp_path / "c", inputs={"u": np.ones(5)}).data["work"]
    f = Plan(adds).equations
    assert [told[k] for k in ("arg", "res", "iw", "w")] == list(f.work)


def test_a_run_that_breaks_is_refused_unless_asked_otherwise() -> None:
    @step(y=Output("1", "square"))
    def grows(x=State("1", 2.0, "number"), u=Input("1", "factor")):
        """Square again and again."""
        return dict(x=u * x * x), dict(y=x)

    with pytest.raises(RunFailed):
        comparison.reference(Plan(grows), np.ones((30, 1)), {})


def test_a_target_without_counted_instructions_has_an_empty_place() -> None:
    target = {"target": "board", "bytes": {"text": 1, "data": 2, "bss": 3}, "stack": None,
              "double_helpers": [], "passed": True, "compiler": "cc 1"}  # fmt: skip
    assert "None" not in "\n".join(map(str, readable._targets({"targets": [target]})))


@pytest.mark.parametrize(("change", "wanted"), [
    (0.5, [0.0, 0.4, 0.4, 0.8]),  # from 0.4 to 1.4 it cannot come within a tick
    (1e30, [0.0, 0.4, 1.4, 0.8]),  # no bound of the change
])  # fmt: skip
def test_a_jump_is_taken_only_where_no_change_is_declared(change, wanted) -> None:
    rows = np.array([[0.0], [0.4], [1.4], [0.8]])
    *ends, stale = (np.array([v]) for v in (-9.0, 9.0, change, 0.0, 100.0))
    taken, told = guard.accepted_inputs(rows, ends, stale, 1e30)
    assert taken[:, 0].tolist() == wanted
    assert told.any() == (wanted[2] != 1.4)


def test_a_compiler_of_other_roundings_is_found() -> None:
    assert float_error.has_cpp_compiler() == any(map(shutil.which, ("g++", "clang++", "c++")))


@pytest.mark.skipif(compilers.first_compiler() is None, reason="no C compiler here")
def test_a_start_with_refused_parameters_is_one_with_those_of_the_block(tmp_path: Path) -> None:
    """It says so, and the steps go on with the factor 1, not with what was in the memory."""
    c = codegen.c_module(adds, tmp_path).compile().load()
    c._param[:] = 0.25
    assert c._call("init", c._param, c._state) == 0
    c._param[:] = 9.0
    assert c._call("init", c._param, c._state) == 4  # as tune tells it
    assert c.step(u=1.0)["y"] == 0.5
    assert c.step(u=1.0)["y"] == 1.5


def test_the_range_of_an_output_without_ends_is_what_it_swings_over() -> None:
    plan = Plan(adds)
    assert wrong_samples._ranges(plan, {}, np.array([[0.0, 3.0], [1.0, 10.0]])).tolist() == [
        8.0,
        7.0,
    ]


def test_whoever_unpacks_an_fmu_can_read_it() -> None:
    with zipfile.ZipFile(io.BytesIO(fmu._zipped({"a": b"1", "b/c": b"2"}))) as archive:
        modes = [entry.external_attr >> 16 for entry in archive.infolist()]
    assert modes == [0o644, 0o644]  # its owner writes, all read, none runs it


def test_a_finding_without_a_reason_has_an_empty_cell() -> None:
    found = {"misra": {"a.c": {"10.4": 2, "8.9": 1}}, "cppcheck": {}, "explained": {"10.4": "why"},
             "deviations": {}, "required": {}, "tool": "cppcheck", "kernel_lines": 0}  # fmt: skip
    text = "\n".join(readable._analysed({"analysis": found}))
    assert "None" not in text
    assert "| why |" in text


def test_a_long_declaration_goes_over_several_lines_none_too_long() -> None:
    arguments = [f"double argument_{k:02d}" for k in range(12)]
    lines = signature("static void", "ten_of_them", arguments).splitlines()
    assert len(lines) > 1
    assert max(map(len, lines)) <= WIDTH
    assert all(line.startswith(" " * len("static void ten_of_them(")) for line in lines[1:])
    assert " ".join("".join(lines).replace("static void ten_of_them(", "").split()) == (
        ", ".join(arguments) + ")")  # fmt: skip


def test_inputs_that_are_left_out_have_their_value_in_every_tick() -> None:
    @step(y=Output("1", "sum"))
    def two(a=Input("1", "given"), b=Input("1", "left out", value=3.0), x=State("1", 0.0)):
        """Two inputs."""
        return dict(x=x), dict(y=a + b)

    rows = input_rows(two, Plan(two).layout.inputs, {"a": [1.0, 2.0, 4.0]})
    assert rows.tolist() == [[1, 3], [2, 3], [4, 3]]
    assert input_rows(two, Plan(two).layout.inputs, {"a": 1.0}).tolist() == [[1, 3]]
    with pytest.raises(BadInput, match="inputs differ in length: a 3, b 2"):
        input_rows(two, Plan(two).layout.inputs, {"a": [1.0, 2.0, 4.0], "b": [0.0, 1.0]})
    with pytest.raises(BadInput, match="two needs the input a"):
        input_rows(two, Plan(two).layout.inputs, {"b": 1.0})


def test_a_signal_drifts_where_its_second_half_is_larger_than_parts_two_to_five():
    """Ten parts of a run; by a share of 0.3, on either side, whatever the first part does."""

    def of(*sizes, side=1):
        ends = [side * np.array(sizes, dtype=float), 0 * np.array(sizes, dtype=float)]
        return {"low": list(np.minimum(*ends)), "high": list(np.maximum(*ends))}

    signals = {
        "settles": of(9, 2, 1, 1, 1, 1, 1, 1, 1, 1), "grows": of(0, 1, 1, 1, 1, 1, 1, 1, 1, 1.31),
        "just not": of(0, 1, 1, 1, 1, 1, 1.29, 1, 1, 1),
        "lost": of(1, 1, 1, 1, 1, 1, np.nan, 1, 1, 1),
        "below": of(5, 1, 1, 1, 1, 1.4, 1, 1, 1, 1, side=-1),
    }  # fmt: skip
    assert long_run.drifting({"signals": signals}) == ["grows", "lost", "below"]
    assert long_run.drifting({"signals": signals}, share=0.5) == ["lost"]


def test_locals_of_the_equations_are_told_beside_what_is_none_of_them() -> None:
    """Left out are names that are hidden, inputs, numbers, and what is made of other symbols."""
    a, foreign = ca.SX.sym("a"), ca.SX.sym("foreign")

    def equations(a: ca.SX) -> ca.SX:
        _hidden = 5 * a
        early = ca.SX(3)
        strange = 2 * foreign
        other = ca.MX.sym("m") * 2  # noqa: F841
        last = a + early + 0 * strange.numel()
        return 7 * last

    with letters([{"a": a}]) as told:
        result = equations(a)
    found = told([result])
    assert list(found.names.values()) == ["last"]
    assert [str(h) for h in found.hidden] == [str(a + 3)]
    assert list(found.origins) == list(found.names) == [1]


@step(period=0.1, y=Output("1", "y"))
def started(
    free=State("1", 0.0, "no range"), a=State("1", "b + 1", "from b", lo=-5, hi=5),
    b=State("1", "2 * c", "from c"), c=State("1", "3 * k", "from k", lo=-9, hi=9),
    w=State("1", [1.0, 2.0], "alike", shape=(2,), lo=-1, hi=3), last=State("1", 0.0, "l", hi=1),
    k=Param("1", 1.0, "number"),
):  # fmt: skip
    """Start values that follow from each other, told in the wrong order."""
    return dict(free=free, a=a, b=b, c=c, w=w, last=last), dict(y=a + b + c)


def test_each_state_with_a_range_is_asked_whatever_stands_before_it() -> None:
    text = "\n".join(lines_of(guard_functions.part_off(Plan(started))))
    for asked in ("within(x->a, -5.0, 5.0)", "within(x->c, -9.0, 9.0)",
                  "all_within(x->w, 2, -1.0, 3.0)", "within(x->last, -"):  # fmt: skip
        assert asked in text
    assert "x->free" not in text
    assert "x->b" not in text


def test_start_values_that_follow_are_told_behind_plain_ones() -> None:
    plan = Plan(started)
    text = "\n".join(lines_of(plan.start_lines(plan.layout.states, 0, "state->")))
    for name in "abc":
        assert f"state->{name} = " in text
    assert "state->free" not in text
    assert "state->last" not in text


def test_start_values_are_computed_after_those_that_they_use() -> None:
    lines = fmu_source._starts(Plan(started))
    text = "".join(lines_of(lines))
    given = [f"if (!m->given[{k}]) {{ m->state.kept.{s}" for k, s in ((3, "c"), (2, "b"), (1, "a"))]
    places = [text.index(g) for g in given]
    assert places == sorted(places)
    assert text.count("m->given") == 3
