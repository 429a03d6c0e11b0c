"""What the workbench cannot show is said in a line: of laws, draws, logs, files and windows."""

from __future__ import annotations

import asyncio
import json
import sys
import threading
import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from slipctl import (
    BadInput,
    End,
    Ensemble,
    Input,
    Known,
    Output,
    Param,
    Rail,
    Scenario,
    Section,
    Signals,
    State,
    connect,
    law,
    step,
)
from slipctl.errors import RunFailed
from slipctl.registry import folder
from slipctl.run.logs.recorded_log import read_recording
from slipctl.run.metrics import Metric
from slipctl.workbench import (
    answers,
    curves,
    effects,
    findings,
    laws,
    saved_files,
    sliders,
    texts,
)
from slipctl.workbench.desk import Desk
from slipctl.workbench.sources import openings
from slipctl.workbench.sources.opened_logs import MOST, LogAnswers, curves_of_recording
from slipctl.workbench.web import windows
from slipctl.workbench.web.windows import Worker


def refused(said: str, what, *given, **named) -> None:
    with pytest.raises(BadInput, match=said) as told:
        what(*given, **named)
    assert "\n" not in str(told.value)


@step(period=0.1, w=Output("m/s", "twice", lo=-1e3, hi=1e3), T=Output("N m", "of it"))
def falls(
    v=State("m/s", 5.0, "speed"),
    x=State("m", 0.0, "way"),
    m=Param("kg", 2.0, "mass", lo=1, hi=9),
    a=Param("m/s^2", 1.0, "deceleration", lo=0, hi=9),
):
    """A body that slows down."""
    return dict(v=v - 0.1 * a, x=x + 0.1 * v), dict(w=2 * v, T=4 * m)


LOOP = connect("loop", {"w": "car.w"}, car=falls)


def rig(duration=3.0, end=None, ensemble=None, limits=None) -> SimpleNamespace:
    scenario = Scenario("base", duration, Rail([Section(0.0)]), end=end)
    study = SimpleNamespace(
        name="own", ensembles={} if ensemble is None else {"base": ensemble},
        limits=limits or {}, models={},
        signals=Signals(speed="car.v", position="car.x"),
    )  # fmt: skip
    case = SimpleNamespace(scenario=scenario, known={}, loops={"loop": LOOP})
    return SimpleNamespace(loop=LOOP, case=case, study=study, compiled=False, compile=False)


@pytest.mark.parametrize(("time", "row"), [(0.0, 0), (0.05, 0), (0.1, 1), (1.27, 12), (2.99, 29)])
def test_signals_of_a_time_are_those_of_the_tick_that_contains_it(time: float, row: int) -> None:
    found = {s["name"]: s for s in findings.signals_at(rig(), {}, time)}
    assert found["car.v"]["values"] == [pytest.approx(5 - 0.1 * row)]
    assert (found["car.T"]["unit"], found["car.T"]["values"]) == ("kN m", [pytest.approx(0.008)])
    assert (found["car.v"]["role"], found["car.v"]["doc"]) == ("state", "speed")
    moved = {s["name"]: s for s in findings.signals_at(rig(), {"car.a": 2.0}, time)}
    assert moved["car.v"]["values"] == [pytest.approx(5 - 0.2 * row)]


@pytest.mark.parametrize("time", [-0.1, 3.0, 99.0])
def test_a_time_outside_of_the_run_is_refused(time: float) -> None:
    said = f"the run goes from 0 s to 3 s; {time:g} s is not in it"
    refused(said, findings.signals_at, rig(), {}, time)


def test_a_time_behind_the_end_of_a_run_is_refused() -> None:
    """It ends where the body is slow; up to there it is shown."""
    ended = rig(end=End("car.v", below=4.0))
    assert findings.signals_at(ended, {}, 0.5)
    refused("the run ended before 2.5 s", findings.signals_at, ended, {}, 2.5)


def test_draws_need_what_is_drawn_and_limits() -> None:
    drawn = Ensemble({"car.m": "1.5kg:3kg"})

    def rows(asked, numbers):
        return list(effects.ensemble_rows(asked, numbers, 2))

    refused("own declares no ensemble of base", rows, rig(), {})
    refused("own declares no limits", rows, rig(ensemble=drawn), {})
    whole = rig(ensemble=drawn, limits={"distance": 9.0})
    refused("car.m is drawn by the ensemble and moved; reset its slider", rows, whole,
            {"car.m": 2.0})  # fmt: skip


@law(mu=Output("1", positive="traction"))
def plain(u=Input("1", "no slip")):
    return u


def test_a_law_that_is_none_of_adhesion_is_refused() -> None:
    refused("plain has no slip among its inputs", laws.law_view, plain)
    refused("own has no adhesion law that stands alone", laws.law_of_desk,
            SimpleNamespace(text=None), rig())  # fmt: skip
    refused("no slip among its inputs: name it v_s", laws.law_of_text, "mu = 2*u where u [1]")


def test_numbers_of_numpy_are_plain_and_nothing_else_is() -> None:
    assert curves._plain(np.float64(0.5)) == 0.5
    assert curves._plain(np.arange(3)) == [0, 1, 2]
    for odd in (object(), {1}, 1j):
        with pytest.raises(TypeError, match="is no plain value"):
            curves._plain(odd)
    assert json.dumps({"a": np.int64(3)}, default=curves._plain) == '{"a": 3}'


def test_what_is_not_there_cannot_be_opened(tmp_path: Path) -> None:
    gone = str(tmp_path / "gone.toml")
    refused("gone.toml is no vehicle's file, study or loop; see", Desk, gone, tmp_path)
    refused("there is no file|is no vehicle's", openings.opening_of_name, gone, (), False)
    assert replace(openings.opening_of_name("subway_braking", (), False), name="x").name == "x"
    assert Known("1", [0.3])


# ---- what cannot be shown ends nothing that can --------------------------------------------------


@pytest.mark.parametrize("words", [0, 1, 5])
def test_a_column_of_words_ends_no_drawing_and_many_columns_are_told_once(words, tmp_path):
    """The first columns of numbers are drawn, wherever one of words stands."""
    many = MOST + 6
    names = [*(f"c{k} [m/s]" for k in range(many))]
    cells = [str(float(k)) for k in range(many)]
    names.insert(words, "note")
    cells.insert(words, "ok")
    rows = [",".join([f"{0.1 * k:.1f}", *cells]) for k in range(4)]
    path = tmp_path / "run.csv"
    path.write_text("\n".join([",".join(["t [s]", *names]), *rows]) + "\n")
    drawn, notes = curves_of_recording(read_recording(path))
    assert [p.name for p in drawn.panels] == [f"c{k}" for k in range(MOST)]
    assert sum("note is not drawn" in n for n in notes) == 1
    assert sum("are drawn" in n for n in notes) == 1


def test_a_number_that_has_no_effect_ends_no_table_of_effects():
    """One that is 0, one whose runs fail, one at both ends of its range; others are told."""

    def metrics(numbers):
        if "fails" in numbers:
            raise RunFailed("it became NaN")
        return {"distance": Metric(10 * next(iter(numbers.values())), "m")}

    made = {n: sliders.Slider(n, v, "1", lo, hi, 0.0, 9.0, False, "", "", "law")
            for n, v, lo, hi in (("zero", 0.0, None, None), ("fails", 2.0, None, None),
                                 ("fixed", 2.0, 2.0, 2.0), ("good", 2.0, None, None),
                                 ("last", 3.0, None, 3.0))}  # fmt: skip
    asked = SimpleNamespace(measured=SimpleNamespace(prepared=lambda n: n, metrics=metrics))
    for order in (list(made), list(made)[::-1]):
        rows = {r["name"]: r for r in effects.difference_rows(asked, {}, [made[n] for n in order])}
        assert list(rows) == [n for n in order if n in ("fails", "good", "last")]
        assert rows["fails"]["why"] == "it became NaN"
        assert rows["good"]["effects"]["distance"] == {"by": pytest.approx(0.2), "unit": "m"}
        assert rows["last"]["effects"]["distance"]["by"] == pytest.approx(0.3)


@step(w=Output("kg", "all of it"))
def weighed(
    x=State("m", 0.0, "way"),
    n=Param("1", 2.0, "how many", lo=1, hi=9),
    both=Param("kg", "n*m", "all of them"),
    m=Param("kg", 3.0, "of each", lo=1, hi=9),
    h=Param("s", 0.1, "tick", lo=0),
    last=Param("m", 1.0, "a length", lo=0, hi=9),
):
    """Many of a kind."""
    return dict(x=x + h * last), dict(w=both)


def test_every_number_that_may_be_moved_has_a_slider() -> None:
    """Those behind one that follows from others too."""
    loop = connect("loop", {}, car=weighed)
    found = sliders.sliders_of_loop(loop, Scenario("base", 1.0, Rail([Section(0.0)])))
    names = {s.name.rpartition(".")[2] for s in found}
    assert {"n", "m", "last"} <= names
    assert "both" not in names


def test_a_key_that_cannot_take_a_number_ends_no_search_for_the_one_that_can() -> None:
    """A text that looks like the key before it on its line; a number that stands at two keys."""
    text = 'a = { note = "k = 1", k = 2 }  # kept'
    made = texts.with_value(text, ("a", "k"), '"3 kg"')
    assert made == 'a = { note = "k = 1", k = "3 kg" }  # kept'


def test_each_table_is_offered_once() -> None:
    metro = (folder("models") / "vehicle" / "files" / "metro.toml").read_text(encoding="utf-8")
    line = next(k for k, row in enumerate(metro.split("\n"), 1) if row.startswith("["))
    found = [c["insert"] for c in texts.completions(metro, line)]
    assert found
    assert len(found) == len(set(found))


def test_a_run_begins_anew_as_soon_as_its_code_is_compiled(monkeypatch) -> None:
    """What rolled before is left; the whole run is that of the compiled code."""

    class Measured:
        def __init__(self, name, many):
            self.name, self.many, self.rolled = name, many, 0
            self.prepared = self

        def pieces(self, numbers):
            for k in range(1, self.many + 1):
                self.rolled += 1
                yield k / self.many, lambda: self.name

        def seen(self, rolled):
            return rolled

        def metrics(self, rolled):
            return rolled

    class Rig:
        name, slow, fast = "loop", Measured("slow", 50), Measured("fast", 3)
        case, study, sliders = SimpleNamespace(known={}), SimpleNamespace(limits={}), []

        @property
        def compiled(self):
            return self.slow.rolled > 4

        @property
        def measured(self):
            return self.fast if self.compiled else self.slow

    made = Rig()
    own = answers.Answers(SimpleNamespace(folder=None, loop="loop"))
    monkeypatch.setattr(own, "_rig", lambda request: made)
    monkeypatch.setattr(own, "_moved", lambda request, rig: {})
    monkeypatch.setattr(answers, "curves_of_run", lambda seen, known: seen)
    monkeypatch.setattr(answers, "frame", lambda head, seen, *most: (head, seen))
    monkeypatch.setattr(answers, "metric_rows", lambda metrics, limits: metrics)
    monkeypatch.setattr(answers, "words_of_run", lambda *given: "")
    *_, (head, seen), end = own.run({})
    assert (head["compiled"], head["share"], seen, end["metrics"]) == (True, 1.0, "fast", "fast")
    assert made.slow.rolled < 10


def test_who_listens_to_a_process_stops_where_it_has_ended() -> None:
    """And begins another one, unless the window is closed."""
    begun, told = [], []

    class Ended:
        def __init__(self):
            self.asked = 0

        def recv(self):
            self.asked += 1
            assert self.asked == 1, "nobody is there any more"
            raise EOFError

    worker = object.__new__(Worker)
    worker.__dict__.update(_lock=threading.Condition(), _closed=False, _lost=0, _step=None)
    worker._pipe = Ended()
    worker._begin = lambda: begun.append(1)  # type: ignore[method-assign]
    worker._say = lambda kind, text: told.append(text)  # type: ignore[method-assign]
    worker._read(worker._pipe)
    assert begun == [1]
    assert "a new one has begun" in told[0]
    worker._closed, worker._pipe = True, Ended()
    worker._read(worker._pipe)
    assert begun == [1]


def test_a_piece_of_work_that_takes_too_long_is_ended_whenever_it_began(monkeypatch) -> None:
    """Who watches goes on where nothing is done, and after a process that was ended."""
    begun, told, ended, slept = [], [], [], []
    worker = object.__new__(Worker)
    worker.__dict__.update(
        _lock=threading.Condition(), _closed=False, _step=None, _waiting={"run": {}},
        opening=SimpleNamespace(patience=0.4), _begin=lambda: begun.append(1),
        _say=lambda kind, text: told.append((kind, text)),
        _process=SimpleNamespace(kill=lambda: ended.append("process")),
        _pipe=SimpleNamespace(close=lambda: ended.append("pipe")),
    )  # fmt: skip

    def sleep(seconds):
        slept.append(seconds)
        if len(slept) in (3, 5):
            worker._step = ("run", -1e9)
        worker._closed = len(slept) > 5

    monkeypatch.setattr(windows, "time", SimpleNamespace(sleep=sleep, monotonic=lambda: 0.0))
    worker._watch()
    assert [kind for kind, _ in told] == ["run", "run"]
    assert begun == [1, 1]
    assert ended == ["process", "pipe"] * 2
    assert worker._waiting == {}


def test_a_page_that_is_closed_is_no_error(monkeypatch) -> None:
    """Its window is left; nothing is asked of a page that has gone."""
    server = pytest.importorskip("slipctl.workbench.web.server")
    pytest.importorskip("starlette")
    left = []

    class Windows:
        def __init__(self, opening):
            pass

        def enter(self, name, send):
            return SimpleNamespace(ask=lambda request: None)

        def leave(self, name):
            left.append(name)

    monkeypatch.setattr(server, "Windows", Windows)
    app, _ = server.application(openings.Opening("x", ".", (), False), 80, "secret")
    heads = [(b"host", b"127.0.0.1:80"), (b"origin", b"http://127.0.0.1:80")]
    query = f"window={'ab' * 16}&token=secret".encode()
    scope = {"type": "websocket", "path": "/socket", "raw_path": b"/socket", "root_path": "",
             "query_string": query, "headers": heads, "subprotocols": []}  # fmt: skip
    heard = [{"type": "websocket.connect"}, {"type": "websocket.disconnect", "code": 1000}]

    async def receive():
        return heard.pop(0)

    async def send(message):
        assert message["type"] == "websocket.accept"

    asyncio.run(app(scope, receive, send))
    assert left == ["ab" * 16]
    assert not heard


def test_a_number_is_written_at_the_one_key_that_sets_it_alone(monkeypatch) -> None:
    """Keys of the same number before it that cannot be written, or that set others too."""
    text = "bad = [2.0,\n 3.0]\nboth = 2.0\nown = 2.0\n"

    def loop(path, text, name):
        content = tomllib.loads(text)
        values = {"m": content["own"] * content["both"] / 2.0, "n": content["both"]}
        return SimpleNamespace(param_values=lambda: values,
                               with_params=lambda m: SimpleNamespace(
                                   param_values=lambda: values | {"m": m}))  # fmt: skip

    monkeypatch.setattr(saved_files, "_loop", loop)
    keys = [("nobody",), ("bad",), ("both",), ("own",)]
    for order in (keys, keys[::-1]):
        monkeypatch.setattr(saved_files, "keys_with_number", lambda *given, order=order: order)
        made, notes = saved_files.text_with_numbers(
            "x.toml", text, "loop", {"m": 5.0}, [SimpleNamespace(name="m", unit="1")]
        )
        assert (made, notes) == (text.replace("own = 2.0", "own = 5"), [])
    made, _ = saved_files.text_with_numbers(
        "x.toml", text, "loop", {"n": 2.0, "m": 5.0},
        [SimpleNamespace(name=n, unit="1") for n in "mn"],
    )  # fmt: skip
    assert made == text.replace("own = 2.0", "own = 5"), "what is as it was ends nothing"
    monkeypatch.setattr(saved_files, "keys_with_number", lambda *given: keys[:3])
    _, notes = saved_files.text_with_numbers(
        "x.toml", text, "loop", {"m": 5.0}, [SimpleNamespace(name="m", unit="1")]
    )
    assert notes == ["m in the file sets n too"]


def test_a_widget_that_is_not_installed_is_named(monkeypatch) -> None:
    from slipctl.workbench.web import widget

    monkeypatch.setitem(sys.modules, "anywidget", None)
    widget._widget_class.cache_clear()
    refused("a widget needs anywidget; pip install", widget._widget_class)


@pytest.mark.parametrize(("lo", "hi", "left", "right"), [
    (-float("inf"), float("inf"), -1.0, 1.0), (-0.3, 0.2, -0.3, 0.2), (-5.0, 3.0, -1.0, 1.0),
    (0.0, float("inf"), 0.0, 1.0), (0.0, 0.5, 0.0, 0.5),
])  # fmt: skip
def test_a_number_of_zero_is_moved_by_one_or_to_its_ends(lo, hi, left, right) -> None:
    assert sliders.ends_of_slider(0.0, lo, hi) == (left, right, False)


def test_curves_are_in_the_units_that_a_person_reads() -> None:
    """km/h, kN m, bar; a valve fills, holds or vents; the rim is slower by the slip."""
    given = {"speed": [[10.0], [5.0], [0.0]], "slip": [[1.0], [0.5], [0.0]],
             "pressure": [[3e5], [2e5], [0.0]], "holding": [[0.0, 1.0], [1.0, 0.0], [0.52, 0.48]],
             "venting": [[0.0, 0.0], [0.0, 1.0], [0.48, 0.52]]}  # fmt: skip
    each = {n: np.array(v) for n, v in given.items()}
    units = {"slip": "m/s", "pressure": "Pa", "speed": "m/s"}
    run = SimpleNamespace(time=np.arange(3.0), changes=[], rows=["dry"], slip_sign=1, each=each.get,
                          travelled=None, signals=Signals(axles=(0, 2)),
                          unit=lambda n: units.get(n, "1"))  # fmt: skip
    panels = {p.name: p for p in curves.curves_of_run(run).panels}
    shown = {(n, s.name, s.axle): list(s.values) for n, p in panels.items() for s in p.series}
    assert shown["speed", "vehicle", 0] == pytest.approx([36.0, 18.0, 0.0])
    assert shown["speed", "rim", 0] == pytest.approx([32.4, 16.2, 0.0])
    assert shown["pressure", "in the cylinder", 0] == pytest.approx([3.0, 2.0, 0.0])
    assert (panels["speed"].unit, panels["pressure"].unit) == ("km/h", "bar")
    valves = [v for (n, *_), v in shown.items() if n.startswith("valves")]
    assert valves == [[1.0, 0.0, 0.0], [0.0, -1.0, -1.0]]
    assert [axle for n, _, axle in shown if n.startswith("valves")] == [1, 3]  # those with a brake


def test_a_part_is_shown_with_the_first_line_of_what_it_is() -> None:
    found = laws.block_view(LOOP, "car")
    assert (found["name"], found["doc"]) == ("falls", "A body that slows down.")
    assert (found["kind"], found["parts"]) == ("step", [])
    assert [s["name"] for s in found["signals"]] == ["w", "T"]
    assert laws.block_view(LOOP, "")["parts"] == ["car"]


def test_effects_of_a_law_without_gains_need_a_number_that_was_moved(monkeypatch) -> None:
    own = answers.Answers(SimpleNamespace(folder=None))
    beside = sliders.Slider("m", 1.0, "kg", 0.5, 2.0, 0.5, 2.0, False, "", "", "vehicle and rail")
    monkeypatch.setattr(own, "_rig", lambda request: SimpleNamespace(sliders=[beside]))
    monkeypatch.setattr(own, "_moved", lambda request, rig: {})
    refused("the law has no gains; move a number", list, own.effects({}))


def test_a_log_answers_what_needs_no_loop(tmp_path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("t [s],note\n0.0,ok\n0.1,ok\n0.2,ok\n")
    refused("has no column of numbers", curves_of_recording, read_recording(path))
    path.write_text("t [s],v [m/s]\n0.0,1\n0.1,2\n0.2,3\n")
    opened = LogAnswers(str(path), str(tmp_path))
    refused("sweep needs a loop; open a vehicle's file", list, opened.command({"command": "sweep"}))
    assert list(opened.command({"command": "stop"}))[-1]["said"] == "stopped"
