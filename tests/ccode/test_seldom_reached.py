"""What a module is made and checked with where most models never come."""

from __future__ import annotations

import ctypes
import re
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from test_passes import in_two, whole_tick

from slipctl import BadInput, Input, Output, Param, RunFailed, State, step
from slipctl.ccode import codegen
from slipctl.ccode.check import comparison, float_error
from slipctl.ccode.check.proof import kernel_proof, module_proof
from slipctl.ccode.check.vectors import misuse, run_inputs
from slipctl.ccode.compile import module as modules
from slipctl.ccode.compile.template import fill_template
from slipctl.ccode.module.kernel import Kernel
from slipctl.ccode.module.layout import dense_value
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.passes import precision
from slipctl.ccode.passes.integers import with_integers
from slipctl.ccode.ship import bus, fmu, readable
from slipctl.ccode.tree import casadi_text, helpers
from slipctl.ccode.tree.parser import code
from slipctl.ccode.tree.printer import lines_of


@step(period=0.01, y=Output("m/s", "both", lo=-99, hi=99))
def beside(
    v=Input("m/s", "speed", lo=-9, hi=9),
    w=Input("m/s", "wheel", lo="v", hi="v + 0.001"),
    k=Param("1", 2.0, lo=0, hi=5),
):
    """An input that has to lie beside another one."""
    return {}, dict(y=v + k * w)


def test_inputs_that_must_fit_each_other_are_made_up_nearer_until_some_do() -> None:
    run, width = comparison.made_up(Plan(beside), {})
    assert width in comparison.WIDTHS[1:]
    assert len(run.rows) > 0
    v, w = comparison.trial_rows(Plan(beside), 1.0).T
    assert not ((w >= v) & (w <= v + 0.001)).any()


class Parts(SimpleNamespace):
    """A loop, or a part of it, by its names."""

    def __getitem__(self, name: str) -> Any:
        return self.parts[name]


def test_what_feeds_an_input_is_found_through_what_only_wraps_a_loop() -> None:
    law = Parts(transparent=False, inputs={"u", "v"})
    inner = Parts(transparent=False, inputs={"speed"}, parts={"law": law, "filter": law},
                  wires={"law.u": "speed", "law.v": "filter.y"})  # fmt: skip
    loop = Parts(
        transparent=False, parts={"ctl": inner}, wires={"ctl.speed": "plant.v"}, inputs=set()
    )
    wrapped = Parts(transparent=True, parts={"run": Parts(transparent=True, parts={"run": loop})})
    for whole in (loop, wrapped):
        assert run_inputs._source(whole, "ctl.law", "u") == "plant.v"  # type: ignore[arg-type]
        assert run_inputs._source(whole, "ctl.law", "v") == "ctl.filter.y"  # type: ignore[arg-type]
        assert run_inputs._source(whole, "ctl", "speed") == "plant.v"  # type: ignore[arg-type]
        assert run_inputs._source(whole, "ctl.filter", "u") == "ctl.filter.u"  # type: ignore[arg-type]


@step(period=0.01, y=Output("m", "sum", lo=-9, hi=9), z=Output("1", shape=(2,)))
def adds(
    x=State("m", 0.0, "kept", lo=-9, hi=9), u=Input("m", shape=(3,), lo=-1, hi=1),
    k=Param("1", 2.0, lo=0, hi=5), m=Param("1", 1.0, lo=0, hi=5),
):  # fmt: skip
    """A sum."""
    return dict(x=x + u[0]), dict(y=x + k * m * u[1], z=u[:2])


@pytest.mark.parametrize(
    ("sizes", "said"),
    [
        ((24, 16, 8, 24), ""), ((24, 16, 64, 24), ""),
        ((32, 16, 8, 24), "adds_in has gaps: 32 bytes instead of 24"),
        ((24, 24, 8, 24), "adds_param has gaps: 24 bytes instead of 16"),
        ((24, 16, 8, 32), "adds_out has gaps: 32 bytes instead of 24"),
    ],
)  # fmt: skip
def test_structs_with_gaps_are_not_loaded(sizes, said, tmp_path, monkeypatch) -> None:
    """A state may be larger than its numbers."""

    class Ready(modules.CModule):
        def reset(self, **params: Any) -> Any:
            return self

    library = SimpleNamespace(bind_sizes=lambda k: sizes[k])
    monkeypatch.setattr(ctypes, "CDLL", lambda name: library)
    module = Ready(tmp_path, Plan(adds))
    if said:
        with pytest.raises(RunFailed, match=said):
            module.load(tmp_path / "adds.so")
        return
    assert module.load(tmp_path / "adds.so")._lib is library
    assert [len(a) for a in (module._in, module._param, module._state, module._out)] == [
        n // 8 + 1 for n in sizes]  # fmt: skip


def test_a_value_has_the_shape_that_its_signal_declares() -> None:
    """Written as a list, as a column, as a number for all, or turned."""
    block, signal = SimpleNamespace(name="b"), SimpleNamespace(name="s", shape=(3,))
    for value in ([1.0, ca.SX(2), 3.0], (1.0, 2.0, 3.0), np.array([1.0, 2.0, 3.0])):
        found = dense_value(block, signal, value)  # type: ignore[arg-type]
        assert found.shape == (3, 1)
        assert [float(found[k]) for k in range(3)] == [1, 2, 3]
    found = dense_value(block, signal, [ca.DM(4), 5.0, 6.0])  # type: ignore[arg-type]
    assert np.array(found).ravel().tolist() == [4, 5, 6]
    with pytest.raises(BadInput, match=r"b\.s has shape \(2, 1\), declared \(3,\)"):
        dense_value(block, signal, [1.0, 2.0])  # type: ignore[arg-type]


def test_small_functions_come_with_those_that_they_call() -> None:
    """All of them are in one text; each stands behind what it calls."""
    text = fill_template("helpers.c")
    every = helpers.all_helpers.__wrapped__()
    assert list(every) == re.findall(r"^static [\w ]+?\*?(\w+)\(", text, re.M)
    seen: set[str] = set()
    for name, made in every.items():
        assert made.parts[0].head == name
        assert made.calls() & every.keys() - {name} <= seen
        seen.add(name)
    calls = {name: made.calls() & every.keys() - {name} for name, made in every.items()}
    name, called = next((n, c) for n, c in calls.items() if c)
    found = [n.parts[0].head for n in helpers.helpers(code(f"x = {name}(y);"))]
    assert found[-1] == name
    assert called <= set(found)
    left = helpers.helpers(code(f"x = {name}(y);"), [*code("int q;"), every[name]])
    assert [n.parts[0].head for n in left] == found[:-1]
    assert helpers.helpers(code("x = y;")) == []


@dataclass
class Lay:
    measured: list[Any]
    states: list[Any]
    kinds: dict[Any, str] = field(default_factory=dict)


def _member(
    name: str, value: Any = 0.0, hi: float = 1.0, scalar: bool = True, values: Any = ()
) -> Any:
    signal = SimpleNamespace(lo=0.0, hi=hi, values=values, value=value, derived=False)
    return SimpleNamespace(c=name, signal=signal, scalar=scalar)


COUNTED = ["next->n = (state->n < 4.0) ? state->n + 1.0 : 0.0;",
           "const double late = (2.0 < state->n) ? 1.0 : 0.0;", "now->on = late;",
           "next->held = (state->held > 0.0) ? late : 0.0;"]  # fmt: skip


def test_counters_are_integers_unless_one_is_used_as_a_number() -> None:
    """Then all of them are numbers; what is true or false stays so."""
    lay = Lay([_member("on")], [_member("n", hi=9.0), _member("held", 1.0), _member("w", 0.5)])

    def made(more: list[str]) -> tuple[list[str], dict[Any, str]]:
        kernel = Kernel(tuple(code("\n".join([*COUNTED, *more]))))
        new, layout = with_integers(kernel, lay, [lay.states[0]])  # type: ignore[arg-type]
        return lines_of(new.lines), layout.kinds

    truths = {("now", "on"): "bool", ("kept", "held"): "bool"}
    lines, kinds = made([])
    assert lines == [
        "next->n = (state->n < 4U) ? state->n + 1U : 0U;",
        "const bool late = 2U < state->n;", "now->on = late;", "next->held = state->held && late;",
    ]  # fmt: skip
    assert kinds == truths | {("kept", "n"): "unsigned int"}
    lines, kinds = made(["now->z = 0.5 * state->n;"])
    assert lines == [
        COUNTED[0], "const bool late = 2.0 < state->n;", "now->on = late;",
        "next->held = state->held && late;", "now->z = 0.5 * state->n;",
    ]  # fmt: skip
    assert kinds == truths
    lines, kinds = made(["now->on = 0.5;"])
    assert kinds == {("kept", "held"): "bool", ("kept", "n"): "unsigned int"}


def test_kernels_with_contracts_are_proven_by_a_program_of_their_own(monkeypatch) -> None:
    asked: list[list[str]] = []

    def analysed(folder: Path, command: list[str], seconds: int) -> Any:
        asked.append([word for word in command if word.endswith(".c")])
        assert all((folder / name).exists() for name in asked[-1] if name != kernel_proof.PROOFS)
        return [], 1.0

    whole = module_proof._with_contracts
    monkeypatch.setattr(module_proof, "tool", lambda: "true")
    monkeypatch.setattr(module_proof, "_analysed", analysed)
    monkeypatch.setattr(
        module_proof, "_with_contracts", lambda p, t: (whole(p, t)[0], ["a kernel"])
    )
    plan = Plan(adds)
    module_proof.run_eva(plan, codegen.texts(plan))
    assert asked == [[module_proof.HARNESS, module_proof.GUARDS], [module_proof.EQUATIONS],
                     [kernel_proof.PROOFS]]  # fmt: skip


@pytest.mark.parametrize(
    ("real", "hurry", "ticks", "operations", "left"),
    [
        ("float", True, 5000, 64 * 20_000, 2000), ("float", True, 5000, 64 * 10**9, 1000),
        ("float", True, 5000, 0, 5000), ("float", True, 900, 64 * 10**9, 900),
        ("float", False, 5000, 64 * 10**9, 5000), ("double", True, 5000, 64 * 10**9, 5000),
    ],
)  # fmt: skip
def test_in_a_hurry_a_run_ends_after_enough_operations(
    real, hurry, ticks, operations, left, tmp_path, monkeypatch
) -> None:
    """4e7 of them; they are counted over 64 ticks, and a thousand ticks are made in any case."""
    seen: list[int] = []

    class Counts:
        binding, status = "", (0, 0)

        def load(self, library: Path) -> Any:
            return self

        def reset(self, **params: Any) -> Any:
            return self

        def replay_rows(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            seen.append(len(rows))
            return rows, rows

    monkeypatch.setattr(float_error, "CModule", lambda folder, plan: Counts())
    monkeypatch.setattr(float_error, "compiler", lambda: "none")
    monkeypatch.setattr(float_error, "run_program", lambda *_: SimpleNamespace(returncode=0))
    monkeypatch.setattr(float_error.shutil, "copy", lambda *_: None)
    library = SimpleNamespace(rounding_choose=lambda *_: None)
    monkeypatch.setattr(float_error.ctypes, "CDLL", lambda name: library)
    count = SimpleNamespace(in_dll=lambda *_: SimpleNamespace(value=operations))
    monkeypatch.setattr(float_error.ctypes, "c_ulonglong", count)
    plan = Plan(adds, real=real)
    float_error.trials(
        plan, dict.fromkeys(plan.files, ""), np.zeros((ticks, 3)), {}, tmp_path, hurry
    )
    counted = [64] if hurry and real == "float" and ticks > 1000 else []
    assert sorted(seen) == sorted([*counted, *[left] * len(float_error.RUNS)])


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.5, "0.5f"), (3.0, "3.0f"), (-2.5, "-2.5f"), (3.4e38, "3.4e+38f"),
        (1e-50, "1.1754944e-38f"),
        (1 - 1e-12, "0.99999994f"), (1 + 1e-12, "1.0f"), (0.0, "0.0f"), (-1e-50, "-1.1754944e-38f"),
        (16777217.0, "1.6777216e+07f"),
    ],
)  # fmt: skip
def test_a_number_in_float_keeps_what_keeps_from_0_and_1(value: float, text: str) -> None:
    assert precision.literal(value, "float", "here") == text
    with pytest.raises(BadInput, match="too large for float; write it with double"):
        precision.literal(-3.5e38, "float", "here")
    with pytest.raises(BadInput, match=r"here: the number 3\.5e38 is too large for float"):
        precision.literal(np.copysign(3.5e38, value), "float", "here")


LOOP: dict[str, Any] = {
    "ticks": 7, "period": 0.25, "passed": True, "metrics_differ": ["slip"],
    "commands": {"a": {"absolute": 0.5, "largest": 0.0, "unit": "N", "tick": 3, "element": None},
                 "b": {"absolute": 0.54, "largest": 1.0, "unit": "N", "tick": 5, "element": 2}},
    "metrics": {"stopping_distance": (10.0, 10.5), "slip": (None, 1.0)},
}  # fmt: skip


def test_the_command_that_differs_most_for_its_size_is_told() -> None:
    """One that is never other than 0 is taken as it is."""
    said = readable.closed_loop_said(LOOP, "ctl")
    assert said == (
        "in closed loop 7 ticks, b[2] differs most, by 0.54 of 1 N at tick 5 (1.25 s);"
        " stopping_distance 10.5, in Python 10: passed"
    )
    small = LOOP["commands"]["b"] | {"absolute": 0.49}
    said = readable.closed_loop_said(LOOP | {"commands": LOOP["commands"] | {"b": small}}, "ctl")
    assert ", a differs most, by 0.5 of 0 N at tick 3 (0.75 s);" in said


def test_inputs_that_fill_their_ranges_are_told_nothing() -> None:
    assert readable.vectors_said({"made_up": 1.0, "ticks": 5}) == ""
    assert readable.vectors_said({"made_up": None, "ticks": 0}) == ""
    assert "fill 10 % of" in readable.vectors_said({"made_up": 0.1, "ticks": 5})
    assert readable.vectors_said({"made_up": 1.0, "ticks": 0}).startswith("No test vectors")


@step(period=0.01, y=Output("m", "sum", lo=-9, hi=9))
def wanders(
    u=Input("m", shape=(2,), lo=-2, hi=6), v=Input("m", lo=-3, hi=1, change=0.25, noise=0.05),
    w=Input("m", lo=0), k=Param("1", 2.0, lo=-1), m=Param("1", (1.0, 2.0), shape=(2,), hi=4),
    n=Param("1", 1.0),
):  # fmt: skip
    """Ranges with and without ends."""
    return {}, dict(y=u[0] + v + w * k + m[1] + n)


def test_wrong_use_draws_from_all_of_a_range_and_wanders_by_a_tenth_of_it() -> None:
    """Or by the change of a tick with its noise; where there is no end it turns at a million."""
    plan = Plan(wanders)
    assert misuse.input_travel(plan, 0.1) == [
        "{-2.0, 6.0, 0.8}", "{-2.0, 6.0, 0.8}", "{-3.0, 1.0, 0.3}", "{0.0, 1e6, 1e5}",
    ]  # fmt: skip
    text = misuse.misuse(plan)
    for table in (["{-2.0, 6.0, 0.8}", "{-2.0, 6.0, 0.8}", "{-3.0, 1.0, 0.3}", "{0.0, 1e6, 1e5}"],
                  ["{-1.0, 1e30}", "{-1e30, 4.0}", "{-1e30, 4.0}", "{-1e30, 1e30}"]):  # fmt: skip
        assert ", ".join(table) in " ".join(text.split())


@pytest.mark.parametrize(("hi", "said"), [(1.05e30, "it has no range"), (9.5e29, "its range is")])
def test_a_range_that_is_that_of_the_type_is_none(hi: float, said: str) -> None:
    @step(period=0.01, y=Output("1", lo=0, hi=hi))
    def wide(u=Input("1", lo=-1, hi=1)):
        """Wide."""
        return {}, dict(y=u)

    with pytest.raises(BadInput, match=said):
        bus.read(Plan(wide), ["y=int16:1"])


def test_what_lacks_a_value_a_period_or_a_library_is_refused(monkeypatch) -> None:
    @step(y=Output("1", lo=-1, hi=1))
    def timeless(u=Input("1", lo=-1, hi=1)):
        """Without a period."""
        return {}, dict(y=u)

    plan = Plan(timeless)
    with pytest.raises(BadInput, match="timeless has no period, which an FMU needs"):
        fmu.fmus(plan, dict.fromkeys(plan.files, ""), "", [])

    @step(period=0.01, y=Output("1", lo=-9, hi=9))
    def valueless(u=Input("1", lo=-1, hi=1), k=Param("kg", lo=0, hi=9)):
        """A parameter without a value."""
        return {}, dict(y=k * u)

    with pytest.raises(BadInput, match=r"valueless\.k has no value; give it a default in kg"):
        Plan(valueless)

    def refuse(found: Any, where: str) -> None:
        raise BadInput(f"{where}: {len(found) > 0}")

    monkeypatch.setattr(casadi_text, "_refuse", refuse)
    x = ca.SX.sym("x")
    with pytest.raises(BadInput, match="here: True"):
        casadi_text.casadi_c([ca.Function("f", [x], [2 * x])], "here")


def test_a_tick_in_two_parts_is_written_by_casadi_alone() -> None:
    """Only its text leaves what is prepared where it lies."""
    for block, by_casadi in ((in_two(), True), (whole_tick, False)):
        plan = Plan(block)
        assert bool(plan.equations.static) == by_casadi
        assert plan.can_fail == by_casadi
