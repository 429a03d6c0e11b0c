"""All that a written block says of its names arrives, and each fault of it stands at its key."""

from __future__ import annotations

import copy
import math
from typing import Any

import pytest

from slipctl import BadInput, Input, Output, from_text, law
from slipctl.block.reach import reach_text, slip_input
from slipctl.block.text.equations import _lines
from slipctl.errors import Faults
from slipctl.study.files import equation_files

LAW: dict[str, Any] = {
    "mu": "c*v_s + F(v_s)",
    "inputs": {"v_s": "m/s"},
    "parameters": {"c": "1 s/m in 0 .. 5"},
    "tables": {"F": {"over": "m/s", "unit": "1", "points": [[0, 0.0], [1, 1.0]]}},
    "conditions": {"wet": {"c": 0.5}},
}


def changed(path: str, value: Any) -> dict[str, Any]:
    """The law with another value at dotted keys."""
    content = copy.deepcopy(LAW)
    *outer, last = path.split("/")
    at = content
    for key in outer:
        at = at.setdefault(key, {})
    at[last] = value
    return content


def test_the_law_itself_is_taken():
    law = equation_files.block(LAW, "law")
    assert (law(v_s=0.5), law(v_s=3.0)) == ({"mu": 1.0}, {"mu": 4.0})
    assert law.conditions == {"wet": {"c": 0.5}}


FAULTS = [
    ("parameters/c", True, "parameters.c: True is no unit, quantity or table"),
    ("parameters/c", {"valu": 1}, "parameters.c.valu: c takes no 'valu'; did you mean 'value'"),
    ("parameters/c", {"value": "1 s/m", "doc": 3}, "parameters.c.doc: doc is a text"),
    ("parameters/c", {"value": "1 s/m", "source": 3}, "parameters.c.source: source is a text"),
    ("parameters/c", {"value": "1 s/m", "start": "1 s/m"}, "value and start are the same"),
    ("parameters/c", {"value": True}, "parameters.c: value True is no number"),
    ("parameters/c", {"value": [1]}, r"parameters.c: value \[1\] is no number"),
    ("parameters/c", {"value": "1 s/m", "range": ["0 s/m"]}, "parameters.c: is no range"),
    ("parameters/c", {"value": "1 s/m", "range": 3}, "parameters.c: 3 is no range"),
    ("parameters/c", {"value": "1 s/m", "range": [True, 2]}, "an end of its range is True"),
    ("parameters/c", {"value": "1 s/m", "range": [2, 1]}, "begins at 2, above its end 1"),
    ("parameters/c", {"value": "1 s/m", "range": [1, 1]}, "begins at 1, above its end 1"),
    ("parameters/c", "1 s/m in 3", "parameters.c: 'in 3' is no range; write in 0.1 .. 2"),
    ("parameters/c", "1 s/m in .. 3", "parameters.c: 'in .. 3' is no range"),
    ("parameters/c", "1 s/m in 3 ..", "parameters.c: 'in 3 ..' is no range"),
    ("parameters/c", "9 s/m in 0 .. 5", "c = 9 s/m is out of range"),
    ("parameters/d", "1", "parameters.d: the parameter d is used nowhere"),
    ("parameters/2d", "1", "parameters.2d: '2d' is no name"),
    ("parameters/" + 50 * "x" + "-", "1", "x{37}...' is no name"),
    ("parameters/in", "1", "parameters.in: in is a word of the grammar; write in_"),
    ("parameters/exp", "1", "parameters.exp: exp is a function or constant; write exp_"),
    ("parameters/v_s", "1 m/s", "parameters.v_s: v_s is declared twice"),
    ("inputs/v_s", {"unit": "m/s", "positive": "up"},
     "inputs.v_s.positive: positive is braking or traction, not 'up'"),
    ("inputs/v_s", {"unit": "m/s", "per": "hour"},
     "inputs.v_s.per: per is speed or ratio, not 'hour'"),
    ("inputs/v_s", {"unit": 3}, "inputs.v_s.unit: unit 3 is no text such as 'm/s'"),
    ("inputs/v_s", {}, "inputs.v_s: v_s needs a unit"),
    ("inputs/v_s", {"unit": "furlongs/s2x"}, "inputs.v_s: .*cannot be read"),
    ("inputs/mu", "1", "inputs.mu: mu has an equation, so it is a result and not among the inp"),
    ("states/mu", "1", "states.mu: mu has an equation, so it is a result and not among the stat"),
    ("outputs/q", "m", "outputs.q: q has no equation; write q = "),
    ("states/z", "1 m", "states.z: z has no equation; write z' = "),
    ("outputs/mu", {"unit": "1", "value": 3}, "outputs.mu: mu has an equation and a value"),
    ("mu", "c*v_s + F(v_s) + F_at", "'F_at' is not declared"),
    ("tables/F", 3, "tables.F: write { over = 'm/s', unit = 'kN'"),
    ("tables/F/over_", "m/s", "tables.F.over_: a table takes no 'over_'; did you mean 'over'"),
    ("tables/F/points", 3, "tables.F: points are 2 to 400 pairs"),
    ("tables/F/points", [[0, 1]], "tables.F: points are 2 to 400 pairs"),
    ("tables/F/points", [[k, 1] for k in range(401)], "tables.F: points are 2 to 400 pairs"),
    ("tables/F/points", [[0, 1], [1, 2, 3]], "tables.F: points are 2 to 400 pairs"),
    ("tables/F/points", [[0, 1], 3], "tables.F: points are 2 to 400 pairs"),
    ("tables/F/points", [[0, 1], [1, True]], "tables.F: an end of its range is True"),
    ("tables/F/points", [[0, 1], ["1 kg", 1]], "tables.F: .*1 kg"),
    ("tables/F/points", [[0, 1], [0, 2]], "tables.F: the places of its points must increase"),
    ("tables/exp", {"points": [[0, 1], [1, 2]]}, "tables.exp: exp is a function"),
    ("conditions/wet", 3, "conditions.wet: write { c = 0.3, a = '0.5 s/m' }"),
    ("conditions/wet/d", 1, "conditions.wet.d: there is no parameter 'd'; did you mean 'c'|'d'"),
    ("conditions/wet/v_s", 1, "conditions.wet.v_s: there is no parameter 'v_s'"),
    ("conditions/wet/c", 9, "conditions.wet.c: .* = 9 s/m is out of range"),
    ("conditions/wet/c", True, "conditions.wet.c: an end of its range is True"),
    ("conditions/wet/c", "1 kg", "conditions.wet.c: .*kg"),
    ("conditions", 3, r"conditions: write a table, \[law.conditions\]"),
    ("units", 3, "law.units: write a text in quotes"),
    ("output", {}, "law.output: 'output' is no text of an equation; did you mean 'outputs'"),
    ("period", "1 ms", "law.period: only a step, x. = ..., has a period"),
    ("measured_to", "-1 m/s", "measured_to = '-1 m/s' is no slip; write one from 0 on"),
    ("meant_to", "3 kg", "meant_to .*kg"),
]  # fmt: skip


@pytest.mark.parametrize(("path", "value", "said"), FAULTS)
def test_a_fault_stands_at_its_key(path: str, value: Any, said: str) -> None:
    with pytest.raises(BadInput, match=said) as told:
        equation_files.block(changed(path, value), "law")
    lines = told.value.lines if isinstance(told.value, Faults) else [str(told.value)]
    assert all(line.startswith("law") for line in lines), lines


@pytest.mark.parametrize(
    ("path", "wrong"),
    [
        ("conditions/wet", {"d": 1, "v_s": 1, "c": 9, "e": 2}),
        ("conditions", {"wet": 3, "icy": {"d": 1}, "dry": 3, "oily": {"c": 9}}),
        ("inputs", {"v_s": "foo", "b": "quux", "c1": {"unit": "bar", "range": 3}, "d": "baz"}),
        ("inputs", {"v_s": {}, "b": {}, "c1": {}}),
        ("parameters", {"c": "1 foo", "b": True, "d": "1 N in 3 .. 2", "e": "2 baz"}),
    ],
)
def test_each_fault_is_told_beside_the_others(path: str, wrong: dict[str, Any]) -> None:
    """In each order in which they may stand."""
    for k in range(len(wrong)):
        turned = dict([*list(wrong.items())[k:], *list(wrong.items())[:k]])
        with pytest.raises(Faults) as told:
            equation_files.block(changed(path, turned), "law")
        for name in wrong:
            place = f"law.{path.replace('/', '.')}.{name}"
            assert any(line.startswith(place) for line in told.value.lines), (name, told.value)


def test_all_that_is_declared_arrives():
    law = equation_files.block(
        {
            "F": "k*lam + e",
            "x'": "-x*rate",
            "inputs": {
                "lam": {"unit": "1", "doc": "slip", "per": "ratio", "positive": "braking"},
                "e": {"unit": "N", "range": [-3, "4 kN"], "source": "a book"},
            },
            "parameters": {"k": {"value": "2 kN", "range": ["1 kN", "3 kN"], "doc": "gain"},
                           "rate": "3 1/s in 1 .. 9"},
            "states": {"x": {"start": "20 cm", "range": ["0 m", "2 m"]}},
            "outputs": {"F": {"unit": "N", "positive": "traction", "doc": "force"}},
        },
        "made",
    )  # fmt: skip
    lam, e, k = law.inputs["lam"], law.inputs["e"], law.params["k"]
    assert (lam.unit, lam.doc, lam.per, lam.positive) == ("1", "slip", "ratio", "braking")
    assert (e.unit, e.lo, e.hi, e.source) == ("N", -3000, 4000, "a book")  # kN
    assert (k.unit, k.value, k.lo, k.hi, k.doc) == ("N", 2000, 1000, 3000, "gain")
    rate, x, F = law.params["rate"], law.states["x"], law.outputs["F"]
    assert (rate.value, rate.lo, rate.hi, rate.unit) == (3, 1, 9, "1/s")
    assert (x.value, x.lo, x.hi, x.unit) == (pytest.approx(0.2), 0, 2, "m")
    assert (F.unit, F.positive, F.doc) == ("N", "traction", "force")
    assert law(x=2.0, lam=0.1, e=5.0) == ({"x": -6.0}, {"F": 205.0})


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("y = a where a [1] on wet a = 3", "'on wet a = 3': write on wet: c = 0.3"),
        ("y = a where a [1] on 2: a = 3", "'on 2: a = 3': write on wet"),
        ("y = a where a", "where: 'a': write v_s .m/s. for an input"),
        ("y = a where a [1], = 3", "where: '= 3': write"),
        ("; ".join(f"y{k} = 1" for k in range(401)), "there are 401 equations, at most 400"),
        ("y = " + 10_000 * " " + "1", "the text has 10005 characters, at most 10000 are read"),
    ],
)
def test_a_sentence_that_means_nothing(text: str, said: str) -> None:
    with pytest.raises(Faults, match=said):
        from_text(text)


def test_as_many_names_as_are_read():
    many = {f"a{k}": "1" for k in range(400)}
    names = list(many)
    text = "; ".join(f"y{k} = " + " + ".join(names[k::4]) for k in range(4))
    assert sum(from_text(text, parameters=many)().values()) == 400.0
    with pytest.raises(Faults, match="more than 400 names"):
        from_text(text, parameters=many, inputs={"b": "1"})


SLIP = "mu = c*v_s where v_s [m/s], c = 1 s/m"


@pytest.mark.parametrize(
    ("measured", "meant", "said"),
    [
        (None, None, ""),
        ("2 m/s", None, "measured up to |v_s| = 2 m/s; not said up to which slip it is meant"),
        ("3.6 km/h", "locked", "measured up to |v_s| = 1 m/s; meant up to a locked wheel"),
        ("0 m/s", "5 m/s", "not measured; meant up to |v_s| = 5 m/s"),
        (None, "5 m/s", "not said up to which slip it was measured; meant up to |v_s| = 5 m/s"),
    ],
)
def test_a_law_says_how_far_it_reaches(measured: str, meant: str, said: str) -> None:
    given = {"measured_to": measured, "meant_to": meant}
    content = {"mu": "c*v_s", "inputs": {"v_s": "m/s"}, "parameters": {"c": "1 s/m"}}
    law = equation_files.block(content | {k: v for k, v in given.items() if v}, "law")
    assert reach_text(law) == said
    if meant:
        assert law.law_data.meant_to == (math.inf if meant == "locked" else 5.0)


@pytest.mark.parametrize("key", ["measured_to", "meant_to"])
@pytest.mark.parametrize("upto", [-1.0, math.nan, "5"])
def test_a_law_of_python_is_not_meant_up_to_what_is_no_slip(key: str, upto: Any) -> None:
    with pytest.raises(BadInput, match=f"line: {key}"):

        @law(mu=Output("1", "adhesion"), **{key: upto})
        def line(v_s=Input("m/s", "slip")):
            return 0.1 * v_s


def test_a_law_without_slip_has_no_reach():
    with pytest.raises(BadInput, match="law has no slip among its inputs, so it has no meant_to"):
        equation_files.block({"mu": "x", "inputs": {"x": "1"}, "meant_to": "locked"}, "law")
    assert slip_input(from_text("mu = x where x [1]")) is None
    assert slip_input(from_text("mu = lam where lam [1]")) == "lam"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a = 1\na = 2\n", "line 2: this key stands twice"),
        ("[a]\n[a]\n", "line 2: this table stands twice"),
        ("mass = 38 t\n", "line 1: behind a value nothing may stand; write .* in quotes"),
        ("mass =\n", "line 1: no value can be read here"),
        ("= 3\n", "Invalid statement .at line 1"),
    ],
)
def test_a_text_that_is_no_toml_is_told_with_its_line(text: str, said: str) -> None:
    with pytest.raises(BadInput, match=said):
        equation_files.content_of_text("my.toml", text)


@pytest.mark.parametrize(
    ("text", "lines"),
    [
        ("a = 1\nb = 2", [(1, "a = 1"), (2, "b = 2")]),
        ("a = 1; b = 2", [(1, "a = 1"), (1, "b = 2")]),
        ("a = 1 # (b; c = 3\nd = 4", [(1, "a = 1"), (2, "d = 4")]),
        ("a = f(1,\n 2)\nb = [1,\n\n 2]", [(1, "a = f(1,  2)"), (3, "b = [1,   2]")]),
        ("a = (1 # ))\n + 2); b = 3", [(1, "a = (1       + 2)"), (2, "b = 3")]),
    ],
)
def test_comments_end_with_their_line_and_open_brackets_join_lines(text, lines):
    found = [(line, " ".join(said.split())) for line, _, said in _lines(text) if said.strip()]
    assert found == [(line, " ".join(said.split())) for line, said in lines]
