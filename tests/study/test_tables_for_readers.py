"""Tables of metrics, lines of a file, and texts of a notebook, each letter against one by hand."""

from __future__ import annotations

import json
import math
from types import SimpleNamespace

import numpy as np
import pytest
from test_page_of_a_sweep import cells, swept

from slipctl import Scenario, connect, from_text, law
from slipctl.block.signals import Input, Output, Param
from slipctl.run.metrics import METRICS, Metric
from slipctl.study import notebook
from slipctl.study.files.declared_parts import _shown
from slipctl.study.files.equation_files import line_of, line_of_fault, place_of
from slipctl.study.files.loop_files import LONGEST, WIDTH, _entry
from slipctl.study.files.results_folder import _cells
from slipctl.study.report import sweep_page, texts

TOML = """\
# first

title = "x"   # a
a = [
  1,
  2,
]

[b]
c = { d = 1, e = 2 }
  # below
f = [{ g = 1 }, { g = 2 }]
text = '''
h = 3
'''
i = 4
[[k]]
m = 1
[[k]]
m = 2
"""


@pytest.mark.parametrize(
    ("keys", "line"),
    [
        (("title",), 3), (("a",), 4), (("a", 1), 4), (("b",), 9), (("b", "c"), 10),
        (("b", "c", "e"), 10), (("b", "f"), 12), (("b", "f", 1, "g"), 12), (("b", "text"), 13),
        (("b", "h"), 9), (("b", "i"), 16), (("k",), 17), (("k", 0, "m"), 18), (("k", 1), 19),
        (("k", 1, "m"), 20), (("k", 2, "m"), 17), (("z",), 1), (("a", 9), 4), ((), 1),
        (("b", "i", "j"), 16),
    ],
)  # fmt: skip
def test_a_key_stands_in_its_line(keys, line):
    assert line_of(TOML, keys) == line
    assert place_of("own.toml", TOML, (*keys, "")) == (
        f"own.toml, line {line}: {'.'.join(map(str, keys))}"
    )


def test_the_line_that_a_fault_names_is_read_from_it():
    assert line_of_fault("own.toml, line 12: b.c: odd, line 3: x") == 12
    assert line_of_fault("own.toml: odd") == 0


def test_a_long_value_is_shown_with_its_begin():
    assert _shown("x" * 38) == "'" + "x" * 38 + "'"
    assert _shown("x" * 39) == "'" + "x" * 36 + "..."


def entry(doc, source="", **more):
    signal = Param("kN", 2.5, doc, source=source).named("k")
    return _entry("car.k", 2.5, signal, **more)


def test_a_number_of_a_file_has_as_much_of_its_meaning_as_fits():
    """All of it with its source; all; the first words of it."""
    said = 'car.k = "2.5 kN"'
    front, room = said.ljust(WIDTH) + " # ", LONGEST - WIDTH - 3
    assert entry("") == said
    assert entry("a gain", "a book") == front + "a gain (a book)"
    assert entry("a gain", "a book", told=False) == front + "a gain"
    fits = "gain, of one axle ".ljust(room, "x")
    assert entry(fits, "a book") == front + fits
    assert entry(fits + "x", "a book") == front + "gain"
    long = "y" * (room + 9)
    assert entry(long) == front + long
    assert entry("a gain", quoted=True) == '"car.k" = "2.5 kN"'.ljust(WIDTH) + " # a gain"


def test_what_stands_still_in_a_column_is_written_once():
    """Also where its first number is the one that comes next."""
    column = np.array([2.5, 2.5, 2.5, 2.5, 1 / 3, 1 / 3, 1 / 3, 7.0])
    form, values = _cells(column)
    assert form == "%s"
    assert values == ["2.5"] * 4 + ["0.3333333333"] * 3 + ["7"]
    assert _cells(np.arange(5.0))[0] == "%.10g"


def results_of(limits=None, rows=(), **loops):
    metrics = {
        n: {k: v if isinstance(v, Metric) else Metric(v, "m") for k, v in m.items()}
        for n, m in loops.items()
    }
    study = SimpleNamespace(limits=limits or {}, signals=SimpleNamespace(find=lambda *_: "there"))
    return SimpleNamespace(metrics={"base": metrics}, study=study,
                           data={"base": {n: {} for n in loops}})  # fmt: skip


def test_loops_that_do_not_fit_stand_below_the_others():
    found = results_of(
        limits={"slip_max": 2.0},
        first={"distance": 100.0, "slip_max": Metric(1.5, "m/s")},
        second={"distance": 90.0, "slip_max": Metric(2.5, "m/s")},
        third={"distance": 80.5},
    )
    assert texts.metric_table(found, "base", 37).split("\n") == [
        "scenario base",
        "  metric          first  second",
        "  distance [m]      100      90",
        "  slip_max [m/s]    1.5   2.5 !",
        "",
        "  metric          third",
        "  distance [m]     80.5",
        "  ! loop second exceeds its limits:",
        "  slip_max 2.5 m/s, at most 2 m/s",
        "  ! loop third exceeds its limits:",
        "  it has no slip_max, which may be",
        "  2 at most",
    ]
    assert texts.side_by_side([10, 5, 6, 7, 8], 25) == [[1, 2], [3], [4]]
    assert texts.side_by_side([10, 50, 6, 7], 27) == [[1], [2, 3]]
    assert texts.side_by_side([10], 27) == [[]]


def test_numbers_of_the_sections_are_ranked_section_by_section():
    """Only who is the best in each is told; forces are shown in kN; the bound is no competitor."""
    name = next(n for n, d in METRICS.items() if d.better == "low" and not d.event and not d.bound)
    rows = ("dry", "wet", "ice")
    found = results_of(
        a={name: Metric([2e3, 3e3, None], "N", rows)}, b={name: Metric([1e3, 2e3, 5e3], "N", rows)},
        ideal={name: Metric([0.0, 0.0, 0.0], "N", rows)},
    )  # fmt: skip
    (head, _), (cells_, best) = texts.ranked_rows(found, "base")
    assert head == ["metric", "a", "b", "ideal"]
    assert cells_ == [f"{name} [kN]", "2 / 3 / –", "1 / 2 / 5", "0 / 0 / 0"]
    assert best == [2]
    found.metrics["base"]["a"][name] = Metric([0.5e3, 3e3, 9e3], "N", rows)
    assert texts.ranked_rows(found, "base")[1][1] == []  # a is better on dry rail
    assert texts.sections_line(found, "base") == "Sections in order: dry / wet / ice"


def test_the_spread_of_each_metric_leaves_out_those_without_one():
    """Shares by hand: of five runs the middle one; one never came."""
    columns = {("none", "m"): [np.nan, np.nan], ("force", "N"): [1e3, 3e3, 2e3],
               ("share", "1"): [0.5, 0.5], ("time", "s"): [1.0, math.inf]}  # fmt: skip
    labelled = [(*key, np.array(values)) for key, values in columns.items()]
    one = SimpleNamespace(labelled=lambda: iter(labelled))
    head, *rows = cells(sweep_page._spread("loop <a>", one, True))
    assert head == ["metric", *sweep_page.HEAD]
    assert [r[0] for r in rows] == ["force [kN]", "share", "time [s]"]
    assert [rows[0][k] for k in (1, 3, 5, 6)] == ["1", "2", "3", "–"]
    assert rows[1][1:] == ["0.5"] * 5 + ["–"]
    assert (rows[2][1], rows[2][5], rows[2][6]) == ("1", "never", "1")
    assert "<h3>loop &lt;a&gt;</h3>" in sweep_page._spread("loop <a>", one, True)
    assert "<h3>" not in sweep_page._spread("a", one, False)
    even = SimpleNamespace(labelled=lambda: iter([("x", "1", np.arange(101.0))]))
    _, row = cells(sweep_page._spread("a", even, False))
    assert row[1:6] == ["0", "5", "50", "95", "100"]


def test_metrics_of_a_sweep_that_are_drawn_are_so_many():
    """All with a limit, then five; the way of a run only where it does not stop."""
    names = list(sweep_page.PICTURED)
    every = {n: np.array([1.0, 2.0]) for n in names}

    def sweep_of(limits):
        return SimpleNamespace(limits=limits, units=dict.fromkeys(names, ("m", ())),
                               rows=lambda n: None, column=lambda n: every[n])  # fmt: skip

    rest = [n for n in names if n != "distance"]
    assert sweep_page._metrics_to_draw({"a": sweep_of({})}) == rest[:5]
    limited = sweep_of({"distance": 3.0, "jerk_rms": 1.0})
    free = [n for n in names if n not in limited.limits][:5]
    assert sweep_page._metrics_to_draw({"a": limited}) == ["distance", "jerk_rms", *free]


def test_what_was_varied_is_told_with_its_range():
    one = swept([1.0, 2.0])
    _, *rows = cells(sweep_page._varied(one))
    assert rows == [["car.m", "7000 to 12000", "kg", "drawn"], ["K", "1 to 2", "", "drawn"]]
    assert "Design lhs, seed 1." in sweep_page._varied(one)


def test_a_table_of_a_cell_has_twenty_rows():
    rows = [(f"r{k}", k) for k in range(23)]
    said = notebook._rows(("name", "number"), rows, (1,))
    assert len(cells(said)) == 21
    assert cells(said)[-1] == ["r19", "19"]
    assert said.endswith("<p>and 3 more</p>")
    assert "more" not in notebook._rows(("name", "number"), rows[:20])
    assert notebook._rows(("name", "number"), []) == ""
    assert [notebook._value(v) for v in (None, "2*m", 2.5, [1, 2, 3])] == ["", "2*m", "2.5",
                                                                          "3 numbers"]  # fmt: skip


def test_a_law_is_drawn_over_its_slip_where_all_else_is_known(monkeypatch):
    """Up to 5 m/s, or a ratio of 0.5."""
    drawn = []
    monkeypatch.setattr(notebook.plots, "laws", lambda block, upto: drawn.append(upto) or "fig")
    monkeypatch.setattr(notebook.plots, "svg_text", lambda fig: fig)
    monkeypatch.setattr(notebook, "image", lambda svg, said: f"{svg}: {said}")

    def curve(per="speed", value=None, mu="mu", k=2.0):
        unit = "1" if per == "ratio" else "m/s"

        @law(**{mu: Output("1", "adhesion")})
        def made(s=Input(unit, "slip", per=per), v=Input("m/s", value=value), k=Param("1", k)):
            return k * s + 0 * v

        return made

    assert notebook._curve(curve(value=3.0)) == "fig: adhesion of made"
    assert notebook._curve(curve("ratio", 3.0)) == "fig: adhesion of made"
    assert drawn == [5.0, 0.5]
    for other in (curve(), curve(None, 3.0), curve(value=3.0, mu="F"), curve(value=3.0, k=None),
                  from_text("mu = a where a [1]")):  # fmt: skip
        assert notebook._curve(other) == ""
    assert drawn == [5.0, 0.5]


def test_a_cell_of_a_scenario_tells_its_noise_where_it_is_not_one():
    assert "3 s, seed 4" in notebook.html(Scenario("s", 3.0, seed=4))
    assert "3 s, noise x 0.5, seed 1. why" in notebook.html(
        Scenario("s", 3.0, noise=0.5, doc="why")
    )
    shown = notebook.html(Scenario("s", 3.0, inputs={"a": 2.0, "b": lambda t: t}))
    assert cells(shown)[1:] == [["inputs", "a", "2"], ["inputs", "b", "changes"]]
    assert json.dumps(cells(shown)[0]) == '["set", "name", "value"]'


def test_a_cell_of_a_sweep_has_the_least_the_middle_and_the_largest():
    values = [("x", "kg", np.arange(101.0)), ("none", "m", np.array([np.nan]))]
    sweep = SimpleNamespace(runs=[1, 2], plan=SimpleNamespace(size=3), failed={1: "why"},
                            labelled=lambda: iter(values), kept="1 of 2 within",
                            folder=SimpleNamespace(name="out"))  # fmt: skip
    shown = notebook._sweep(sweep)
    assert cells(shown)[1:] == [["x", "0", "50", "100", "", "kg"]]
    assert "2 of 3 runs, 1 failed; 1 of 2 within" in shown
    sweep.kept = None
    assert "1 failed</p>" in notebook._sweep(sweep)


def test_a_cell_of_a_loop_has_its_parts_and_what_comes_in_and_goes_out():
    """Of each part the first line of what it is."""

    @law(y=Output("m/s", "doubled speed"))
    def twice(a=Input("m/s", "speed\n  of the car"), k=Param("1", 2.0, "gain")):
        """Doubles.

        And no more."""
        return k * a

    loop = connect("loop", {"second.a": "first.y", "out": "second.y"}, first=twice, second=twice)
    parts, signals = (cells(t) for t in notebook.html(loop).split("</table>")[:2])
    assert parts == [["part", "kind", "what it is"], ["first", "law", "Doubles."],
                     ["second", "law", "Doubles."]]  # fmt: skip
    assert [row[0] for row in signals[1:]] == ["first.a", "first.y", "second.y", "out"]
    assert signals[1] == ["first.a", "input", "m/s", "", "speed of the car"]
    own = notebook.html(twice)
    assert "<b>twice</b> · Doubles.</p>" in own
    rows = cells("<table" + own.rpartition("<table")[2])[1:]
    assert [r[:4] for r in rows] == [
        ["a", "input", "m/s", ""],
        ["k", "param", "1", "2"],
        ["y", "output", "m/s", ""],
    ]


def test_a_limit_of_a_sweep_is_told_in_the_unit_of_its_picture():
    head, row = cells(sweep_page._limits({"a": swept([1.0, 2.0], {"ripple": 3000.0})}))
    assert head[3] == "runs that miss ripple ≤ 3 kN m"
    assert row[0:2] == ["a", "2 of 2"]
