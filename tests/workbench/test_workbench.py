"""What the workbench says is what a script gets: curves, sliders, law, region, text, files."""

from __future__ import annotations

import math
import shlex
import shutil
from contextlib import nullcontext
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from workbench_frames import answered

from slipctl import BadInput, registry, simulate
from slipctl.commands.cli import main
from slipctl.models.super_twisting.certificate import super_twisting as sta
from slipctl.study import resolve
from slipctl.workbench import curves, laws, safety, saved_files, sliders, texts
from slipctl.workbench.answers import Answers
from slipctl.workbench.command_lines import command_words, replayed_curves, run_command
from slipctl.workbench.desk import Desk, numbers_in_words, words_of_run
from slipctl.workbench.questions import KINDS
from slipctl.workbench.sources import openings

METRO = registry.folder("models") / "vehicle" / "files" / "metro.toml"
TEXT = METRO.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def subway() -> Desk:
    return Desk("subway_braking:sta", compile=False)


@pytest.fixture
def metro(tmp_path, monkeypatch) -> Desk:
    shutil.copy(METRO, tmp_path / "metro.toml")
    monkeypatch.chdir(tmp_path)
    return Desk("metro.toml:super_twisting", tmp_path, compile=False)


@pytest.mark.parametrize(("request_", "said"), [
    ({"kind": "command", "command": "rnu"}, "there is no command 'rnu'"),
    ({"kind": "block", "path": 3}, "a part is named by a text"),
    ({"kind": "save", "name": 3}, "a file is named by a text"),
    ({"kind": "run", "loop": 3}, "loop and scenario are no names"),
    ({"kind": "law", "law": "x" * 2001}, "a law has at most 2000 letters"),
])  # fmt: skip
def test_a_question_that_no_page_asks_is_refused_in_words(subway, request_, said):
    ((head, _),) = answered(Answers(subway), **request_)
    assert head["end"]
    assert any(said in str(fault) for fault in head["faults"])


# ---- a run --------------------------------------------------------------------------------------


def test_a_run_on_the_page_is_the_run_of_a_script(subway):
    """Every axis of a curve keeps its extremes, and the parts before the end are its beginning."""
    found = answered(Answers(subway), kind="run", numbers={"ctl.law.k1": 31.0})
    runs = [(h, c) for h, c in found if "rows" in h]
    head, columns = runs[-1]
    rig = subway.rig()
    log = simulate(rig.loop.with_params(**{"ctl.law.k1": 31.0}), rig.case.scenario, compile=False)
    panels = {p["name"]: p for p in head["panels"]}
    assert list(panels) == ["speed", "slip", "torque", "adhesion", "distance"]
    assert panels["torque"]["unit"] == "kN m"
    names = [(p["name"], s["name"]) for p in head["panels"] for s in p["series"]]
    shown = dict(zip(names, columns[1:], strict=True))
    slip, torque = log["plant.wheel.v_s"].values, log["plant.brake.T_b"].values / 1e3
    for column, values in (
        (shown["slip", "slip"], slip),
        (shown["torque", "at the wheel"], torque),
    ):
        assert column.max() == pytest.approx(values.max(), rel=1e-6)
        assert column.min() == pytest.approx(values.min(), rel=1e-6, abs=1e-9)
    v, rim = shown["speed", "vehicle"] / 3.6, shown["speed", "rim"] / 3.6
    assert (v - rim).max() == pytest.approx(slip.max(), rel=2e-2)
    assert head["share"] == 1.0
    assert all(a["share"] <= b["share"] for (a, _), (b, _) in pairwise(runs))
    for early, cut in runs[:-1]:
        last = cut[0][-1]
        assert early["share"] == pytest.approx(last / log["time"].values[-1], abs=0.01)
    metrics = {m["key"]: m for m in found[-1][0]["metrics"]}
    moved = rig.measured.metrics(rig.measured.prepared({"ctl.law.k1": 31.0}))
    assert metrics["distance"]["value"] == moved["distance"].value
    assert found[-1][0]["command"].endswith("--set 'ctl.law.k1=31.0 m^.5/s^1.5'")


def test_compiled_code_takes_over_with_the_same_bits(subway):
    from slipctl.run import build

    if build.compiler() is None:
        pytest.skip("no C compiler")
    rig = Desk("subway_braking:sta").rig().wait()
    assert rig.compiled
    slow = subway.rig().measured.prepared({"ctl.law.k1": 17.0})
    fast = rig.measured.prepared({"ctl.law.k1": 17.0})
    assert all(slow[n].tobytes() == fast[n].tobytes() for n in fast)


def test_an_event_that_never_came_is_above_its_limit():
    from slipctl.run.metrics import Metric
    from slipctl.workbench.findings import metric_rows

    rows = {r["key"]: r for r in metric_rows(
        {"stopping_distance": Metric(None, "m"), "lock_time": Metric(0.2, "s")},
        {"stopping_distance": 140.0, "lock_time": 0.3, "slip_max": 1.0})}  # fmt: skip
    assert rows["stopping_distance"]["kept"] is False
    assert rows["stopping_distance"]["shown"] == "never"
    assert rows["lock_time"]["kept"] is True
    assert rows["slip_max"]["kept"] is False


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=300), st.integers(1, 40))
def test_thinned_curves_keep_every_extreme(values, stretches):
    y = np.array(values)
    t, thin = curves.thin_columns([np.arange(y.size) * 0.1, y], stretches)
    assert len(t) == len(thin) <= max(2 * stretches, y.size)
    assert thin.max() == y.max()
    assert thin.min() == y.min()
    assert (np.diff(t) >= 0).all()


# ---- numbers ------------------------------------------------------------------------------------


def test_sliders_are_what_may_be_moved_within_its_range(subway, metro):
    for desk in (subway, metro):
        found = {s.name: s for s in desk.rig().sliders}
        assert not {"T", "omega_start", "plant.adh.c"} & set(found), (
            "tick, derived, set by the rail"
        )
        for s in found.values():
            low, high = (-math.inf if s.lo is None else s.lo), (math.inf if s.hi is None else s.hi)
            assert low <= s.left <= s.value <= s.right <= high
            assert s.left < s.right
        assert found["m"].unit == "kg"
    assert next(iter(subway.rig().sliders)).group == "law"


@pytest.mark.parametrize(
    ("numbers", "said"),
    [({"ctl.law.k1": -1.0}, "outside"), ({"nobody": 1.0}, "no number that can be moved"),
     ({"ctl.law.k1": "1"}, "no number"), ({"ctl.law.k1": math.nan}, "no number"),
     ({"ctl.law.k1": True}, "no number"), ([1], "no table")],
)  # fmt: skip
def test_numbers_of_a_page_are_checked(subway, numbers, said):
    with pytest.raises(BadInput, match=said):
        sliders.check_numbers(numbers, subway.rig().sliders)


@given(st.floats(-1e3, 1e3), st.floats(0, 1e4), st.floats(0, 1e4))
def test_a_slider_lies_within_its_range_and_holds_its_number(value, below, above):
    lo, hi = value - below, value + above + 1e-3
    left, right, by_ratio = sliders.ends_of_slider(value, lo, hi)
    assert lo <= left < right <= hi
    assert left <= value <= right
    assert left > 0 or not by_ratio


# ---- the law ------------------------------------------------------------------------------------


def test_peak_and_slope_of_a_law_are_those_of_its_formula():
    c, a, b = 0.8, 0.54, 1.2
    law = laws.law_of_text(
        f"mu = c*(exp(-a*v_s) - exp(-b*v_s)) where v_s [m/s], c = {c}, a = {a} s/m, b = {b} s/m"
    )
    view = laws.law_view(law)
    at = math.log(b / a) / (b - a)
    (curve,) = view["curves"]
    assert curve["peak_at"] == pytest.approx(at, rel=1e-9)
    assert curve["peak"] == pytest.approx(c * (math.exp(-a * at) - math.exp(-b * at)), rel=1e-9)
    assert curve["slope"] == pytest.approx(c * (b - a), rel=1e-12)
    assert view["equations"][0][0] == "<mrow><mi>μ</mi></mrow>"


def test_peak_of_a_law_that_is_negative_in_braking():
    """Zhang 2021: lam* = ln(a0 a1/a2)/a1, of the dry rail of section 5.1."""
    a0, a1, a2 = 0.3546, 23.129, 0.1246
    law = laws.law_of_text("burckhardt")
    dry = next(c for c in laws.law_view(law)["curves"] if c["name"] == "dry")
    at = math.log(a0 * a1 / a2) / a1
    assert dry["peak_at"] == pytest.approx(at, rel=1e-9)
    assert dry["peak"] == pytest.approx(-(a0 * (1 - math.exp(-a1 * at)) - a2 * at), rel=1e-9)
    assert dry["slope"] == pytest.approx(-(a0 * a1 - a2), rel=1e-9)


@pytest.mark.parametrize(
    "text",
    ["mu = __import__('os').system('touch made') where v_s [m/s]",
     "mu = open('made') where v_s [m/s]",
     "mu = v_s.__class__ where v_s [m/s]", "mu = (lambda: 1)() where v_s [m/s]",
     "x = 3*y where y [m]", "mu = 9**9**9**9*v_s where v_s [m/s]", "(" * 3000, "no_such_law"],
)  # fmt: skip
def test_an_expression_is_never_run_as_python(subway, tmp_path, monkeypatch, text):
    monkeypatch.chdir(tmp_path)
    ((head, _),) = answered(Answers(subway), kind="law", law=text)
    assert head["faults"]
    assert not any("fault of slipctl" in line for line in head["faults"])
    assert list(tmp_path.iterdir()) == []


def test_python_is_loaded_only_where_it_was_named(metro, monkeypatch):
    (metro.folder / "own.py").write_text(
        "from pathlib import Path\nPath('made').touch()\n"
        "from slipctl.models.subway_braking import double_exponential as own\n"
    )
    monkeypatch.setattr(resolve, "ONLY", [])
    resolve.load_only([])
    text = TEXT.replace('law = "exponential_tail"', 'law = "own.py:own"')
    faults = texts.faults_of_text("metro.toml", text)
    assert "was not named at the start" in faults[0]["text"]
    ((head, _),) = answered(Answers(metro), kind="law", law="own.py:own")
    assert "was not named" in head["faults"][0]
    assert not Path("made").exists()
    resolve.load_only(["own.py"])
    answered(Answers(metro), kind="law", law="own.py:own")
    assert Path("made").exists()


# ---- certificates -------------------------------------------------------------------------------


def test_each_point_of_a_region_is_the_certificate_of_its_loop(subway):
    """Also where a bound depends on the gains."""
    rig = subway.rig()
    gains = rig.gains_by_name()
    axes, *rows = [r for r in safety.region_rows(rig, gains, {}, points=3) if r]
    assert axes["movable"] == {"k1": "ctl.law.k1", "k2": "ctl.law.k2"}
    seen = set()
    for row, y in zip(rows, axes["y"]["values"], strict=True):
        for x, verdict in zip(axes["x"]["values"], row["verdicts"], strict=True):
            at = {"ctl.law.k1": x, "ctl.law.k2": y}
            assert safety.verdict_of_gains(rig, gains, at)["verdict"] == verdict
            seen.add(verdict)
    assert len(seen) > 1


def test_the_worst_disturbance_is_the_largest_allowed_and_turns_with_the_error():
    """d = +-L throughout, outward while |x1| grows: the largest work that |d| <= L can do."""
    desk = Desk("hst_traction:composite", compile=False)
    rig = next(
        r for n, c in desk.loops() if (r := desk.rig(loop=n, scenario=c)).gains
        and any(g.name == "observer" for g in r.gains)
    )  # fmt: skip
    gains = rig.gains_by_name("observer")
    found, lines = safety.worst_run(rig, gains, {})
    rows = {p.name: p.series[0].values for p in found.panels}
    bound = safety.points_of_gains(rig, gains, {}).here["L"]
    x1, d = rows["x1"], rows["disturbance"]
    assert np.abs(d) == pytest.approx(bound)
    grows = np.diff(np.abs(x1)) > 0
    inside = (x1[:-1] * x1[1:] > 0) & (d[:-1] == d[1:])
    assert inside.sum() > 20
    assert (np.sign(d[1:]) == np.where(grows, 1, -1) * np.sign(x1[1:]))[inside].all()
    assert "disturbance: d = L sgn x1" in lines[0]


def test_a_worst_run_of_the_page_is_that_of_the_certificate(subway):
    """Explicit super-twisting ends in an orbit of two ticks; its swing has a closed form."""
    head, columns = answered(Answers(subway), kind="worst")[-1]
    swing = sta.explicit_amplitude(20.0, 10.0, 1e-3)
    assert np.abs(columns[1]) == pytest.approx(swing, rel=1e-6)
    assert (columns[1][1:] * columns[1][:-1] < 0).all()
    assert head["end"]
    assert [p["unit"] for p in head["panels"]] == ["m/s"]


def test_a_certificate_without_a_worst_run_says_so(metro):
    found = answered(Answers(metro), kind="worst", loop="pid")[-1][0]
    assert "no worst run" in found["faults"][0]


def test_a_loop_without_certificate_says_why(metro):
    rig = metro.rig(loop="predictive")
    assert "solution of a program" in rig.certificates()["why"]
    with pytest.raises(BadInput, match="solution of a program"):
        rig.gains_by_name()


# ---- the text -----------------------------------------------------------------------------------


def test_faults_stand_at_their_lines():
    text = TEXT.replace("axles = 4", "axels = 4").replace('"38 t"', '"38 kW"')
    lines = text.split("\n")
    found = {lines[f["line"] - 1].split()[0]: f["text"] for f in
             texts.faults_of_text("metro.toml", text)}  # fmt: skip
    assert "did you mean 'axles'" in found["axels"]
    assert "another dimension" in found["mass"]
    assert texts.faults_of_text("metro.toml", TEXT) == []


def test_a_text_that_is_no_toml_has_a_fault_at_a_line():
    for text in ("[[", TEXT + "\n[[", TEXT.replace("seed = 1", "seed = = 1")):
        (fault,) = texts.faults_of_text("metro.toml", text)
        assert 1 <= fault["line"] <= text.count("\n") + 1


def offered(text: str, row: str) -> list[str]:
    lines = text.split("\n")
    line = next(k for k, told in enumerate(lines, 1) if told.startswith(row))
    return [c["insert"] for c in texts.completions(text, line)]


def test_completion_offers_what_is_declared():
    assert '"sta"' in offered(TEXT, 'kind = "sta"')
    assert set(offered(TEXT, 'kind = "lag"')) == {'"air"', '"lag"', '"valve"'}
    assert offered(TEXT, "mass") == ['"1 kg"']
    keys = offered(TEXT.replace('k2 = "10 m/s^3"', "?"), "?")
    assert "k2 = " in keys
    assert "k1 = " not in keys, "it is there already"
    assert "[limits]" in offered(TEXT, "[rail]")


@pytest.mark.long
@settings(max_examples=20)
@given(st.data())
def test_no_edit_of_a_text_is_a_traceback(data):
    """Lines cut, doubled, swapped, letters changed: faults, or none, and completions."""
    text = TEXT
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(text)))
        many = data.draw(st.integers(0, 12))
        text = text[:at] + data.draw(st.text(max_size=6)) + text[at + many :]
    for fault in texts.faults_of_text("metro.toml", text):
        assert fault["text"]
        assert 0 <= fault["line"] <= text.count("\n") + 1
    texts.completions(text, data.draw(st.integers(-1, text.count("\n") + 3)))


@given(st.floats(1.0, 1e6))
def test_a_value_is_changed_and_nothing_else(value):
    made = texts.with_value(TEXT, ("vehicle", "mass"), f'"{value!r} kg"')
    pairs = [(a, b) for a, b in zip(TEXT.split("\n"), made.split("\n"), strict=True) if a != b]
    ((before, after),) = pairs
    assert after.startswith(f'mass = "{value!r} kg"')
    assert after.endswith('# or tare = "28 t" and load = "10 t"')
    assert before.startswith("mass")


def test_what_stands_before_a_broken_line_is_read_and_of_a_list_its_last_table():
    for broken in ("b = ", "b = [\nc", "b = 1\nb = 2\nc"):
        text = f"a = 1\n{broken}"
        assert texts._readable(text, text.split("\n")) in ({"a": 1}, {"a": 1, "b": 1})
    assert texts._readable("b = 2", []) == {"b": 2}
    assert texts._readable("= 2", ["= 2"]) == {}
    content = {"k": [{"a": 1}, {"b": 2}], "none": [], "t": {"c": 3}}
    below = [texts._below(content, key) for key in ("k", "none", "t", "other")]
    assert below == [{"b": 2}, {}, {"c": 3}, {}]
    assert texts._below("no table", "k") == {}


@pytest.mark.parametrize("keys", [("vehicle", "nothing"), ("vehicle",), ("rail", "sections")])
def test_what_has_no_line_of_its_own_is_not_changed(keys):
    with pytest.raises(BadInput):
        texts.with_value(TEXT, keys, "3")


# ---- files --------------------------------------------------------------------------------------


@pytest.mark.long
def test_saving_writes_the_number_at_its_key_and_keeps_comments(metro):
    numbers = {"ctl.law.law.k1": 25.0, "tau": 0.08}
    done = saved_files.save_desk(metro, "", metro.text, numbers)
    text = Path("metro.toml").read_text(encoding="utf-8")
    changed = [b for a, b in zip(TEXT.split("\n"), text.split("\n"), strict=True) if a != b]
    assert changed == ['lag = "0.08 s"', 'k1 = "25 m^.5/s^1.5"']
    assert done["notes"] == []  # the time to follow a command in is derived from tau
    again = Desk("metro.toml:super_twisting", compile=False).rig().loop.param_values()
    assert float(again["ctl.law.law.k1"]) == 25.0
    assert float(again["tau"]) == pytest.approx(0.08)


@pytest.mark.second
def test_a_number_without_a_key_is_refused_and_nothing_written(metro):
    with pytest.raises(BadInput, match=r"no key of metro\.toml sets ctl\.estimator\.gate"):
        saved_files.save_desk(metro, "", metro.text, {"ctl.estimator.gate": 5.0})
    assert Path("metro.toml").read_text(encoding="utf-8") == TEXT


@pytest.mark.parametrize(
    "name",
    ["../other.toml", "/tmp/other.toml", "sub/../../x.toml", "own.py", "x\0.toml", "there.toml"],
)
def test_files_are_written_in_the_folder_alone_and_over_no_other(metro, name):
    (metro.folder / "there.toml").write_text("")
    before = sorted(p for p in metro.folder.parent.rglob("*"))
    with pytest.raises((BadInput, ValueError)):
        saved_files.save_desk(metro, name, metro.text, {})
    assert sorted(p for p in metro.folder.parent.rglob("*")) == before


def test_a_link_out_of_the_folder_is_no_way_out(metro, tmp_path_factory):
    other = tmp_path_factory.mktemp("other")
    (metro.folder / "out").symlink_to(other)
    with pytest.raises(BadInput, match="outside"):
        metro.within("out/x.toml")


def test_the_command_repeats_what_is_shown(metro):
    moved = numbers_in_words({"m": 40e3}, metro.rig().sliders)
    said = words_of_run(metro, metro.loop, moved)
    assert said == ["run", "metro.toml", "--loop", "super_twisting", "--set", "m=40000.0 kg"]


def test_signals_of_a_time_are_those_of_the_run_in_that_tick(metro):
    """Noise of the sensors too, with a moved number; beyond the run it is refused in words."""
    rig = metro.rig()
    moved = {"m": 40e3}
    log = simulate(
        rig.loop.with_params(**moved), rig.case.scenario.but(duration=1.0), compile=False
    )
    row = int(np.searchsorted(log["time"].values, 0.4995))
    head = answered(Answers(metro), kind="signals", numbers=moved, time=0.4995)[-1][0]
    found = {r["name"]: r for r in head["signals"]}
    for name, scale in (("plant.train.v_s", 1.0), ("plant.act.T_b", 1e-3), ("speed.n", 1.0)):
        assert found[name]["values"] == pytest.approx(
            np.atleast_1d(scale * log[name].values[row - 1])
        )
    assert found["plant.act.T_b"]["unit"] == "kN m"
    assert {s for s in log if s != "time"} == set(found)
    for time in (-1.0, 1e6, "soon", None):
        assert answered(Answers(metro), kind="signals", time=time)[-1][0]["faults"]


# ---- questions ----------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [*KINDS, "nothing", ""])
@pytest.mark.parametrize(
    "more",
    [{"text": 3}, {"loop": ["a"]}, {"numbers": 7}, {"loop": "nobody", "keys": 1, "line": "a"}],
)
def test_a_question_that_makes_no_sense_is_answered_in_words(metro, kind, more):
    if kind in ("model", "law", "text", "doubts", "c", "effects") and "numbers" in more:
        pytest.skip("it takes no numbers, or runs long")
    metro.rig = lambda *given: (_ for _ in ()).throw(BadInput("no loop"))  # type: ignore[method-assign]
    for head, _ in answered(Answers(metro), kind=kind, **more):
        for line in head.get("faults", []):
            assert "fault of slipctl" not in line, line


# ---- commands -----------------------------------------------------------------------------------


def test_commands_of_the_page_are_lines_that_a_person_can_repeat(metro):
    rig = metro.rig()
    given = {"ranges": ["ctl.law.law.k1=10:30"], "metric": "stopping_distance", "draws": 3}
    words, out = command_words("tune", metro, rig, {"m": 40e3}, given)
    assert shlex.join(words) == (
        "tune metro.toml:super_twisting --samples 3 --free ctl.law.law.k1=10:30"
        f" --minimise stopping_distance --set 'm=40000.0 kg' --out {out}"
    )
    assert out.parent == metro.folder / "out"
    moved = {"m": 40e3, "ctl.law.law.k1": 20.0}  # a slider of what a sweep varies says nothing
    words, _ = command_words("sweep", metro, rig, moved, given)
    assert words[words.index("--set") : words.index("--out")] == ["--set", "m=40000.0 kg"]


@pytest.mark.parametrize(
    ("kind", "given"),
    [
        ("tune", {"ranges": ["--out=/tmp"], "metric": "distance"}),
        ("tune", {"ranges": [], "metric": "distance"}),
        ("tune", {"ranges": ["a=1:2"], "metric": "--json"}),
        ("sweep", {"ranges": "a=1:2"}),
        ("sweep", {"ranges": ["a=1:2"] * 99}),
        ("sweep", {"draws": 0}),
        ("sweep", {"draws": 1e9}),
        ("replay", {"log": "../../etc/passwd", "part": "ctl"}),
        ("replay", {"log": "a.csv", "part": "--with"}),
        ("replay", {"log": "a.csv", "part": "ctl", "columns": ["-v"]}),
    ],
)
def test_no_question_adds_an_option_or_leaves_the_folder(metro, kind, given):
    with pytest.raises(BadInput):
        command_words(kind, metro, metro.rig(), {}, given)


def test_a_command_of_what_is_not_saved_is_refused(metro):
    found = answered(Answers(metro), kind="command", command="sweep", text=TEXT + "\n")
    assert "save the text first" in found[-1][0]["faults"][0]


@pytest.mark.second
def test_a_replay_gives_the_curves_of_the_run_that_it_records(metro):
    """A log of the law's own inputs, replayed, is what the law gave."""
    text = "mu = c*v_s where v_s [m/s], c = 0.5 s/m"
    times = np.arange(0.0, 1.0, 0.01)
    rows = "".join(f"{t:.2f},{t:.4f},{0.5 * t:.4f}\n" for t in times)
    (metro.folder / "log.csv").write_text("time [s],v_s [m/s],mu\n" + rows)
    out = metro.folder / "out" / "x"
    words = ["replay", "log.csv", "--with", text, "--beside", "mu=mu", "--out", str(out)]
    said = list(run_command(words))[-1]["said"]
    assert "100 ticks" in said
    curves = replayed_curves(out)
    panel = next(p for p in curves.panels if p.name == "mu")
    assert [s.name for s in panel.series] == ["computed", "recorded"]
    assert panel.series[0].values == pytest.approx(0.5 * times, abs=1e-9)
    assert panel.series[1].values == pytest.approx(0.5 * times, abs=1e-9)


@pytest.mark.second
def test_a_command_that_is_stopped_keeps_what_it_has(metro):
    words = ["sweep", "subway_braking:sta", "--vary", "m=28t:38t", "--samples", "5000",
             "--jobs", "1", "--out", "out/s"]  # fmt: skip
    going = run_command(words)
    for said in going:
        if "%" in said.get("progress", ""):
            break
    going.close()
    assert list((metro.folder / "out" / "s").glob("*.sqlite"))


# ---- what else can be open ----------------------------------------------------------------------


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """A sweep of a study's loop over a gain, two runs."""
    folder = tmp_path_factory.mktemp("swept") / "sweep"
    words = ["-q", "sweep", "subway_braking:sta", "--vary", "ctl.law.k1=10:40:2", "--set",
             "m=7000kg", "--no-compile", "--out", str(folder)]  # fmt: skip
    assert main(words) == 0
    return folder


def test_a_run_of_a_sweep_is_run_again_by_its_numbers(swept):
    """The metrics of a dot are those of the loop with the numbers that a click takes."""
    answers = openings.answers_of_opening(str(swept), str(swept.parent), compile=False)
    model = answered(answers, kind="model")[-1][0]
    sweep = model["sweep"]
    assert (model["loop"], sweep["missing"], sweep["lost"]) == ("sta", 0, [])
    assert [r["numbers"]["ctl.law.k1"] for r in sweep["runs"]] == [10.0, 40.0]
    assert all(r["numbers"]["m"] == 7000.0 for r in sweep["runs"])
    names = [m["key"] for m in sweep["metrics"]]
    for run in sweep["runs"]:
        rows = answered(answers, kind="run", numbers=run["numbers"])[-1][0]["metrics"]
        for row in rows:
            was = run["metrics"][names.index(row["key"])]
            assert row["value"] == (None if was is None else pytest.approx(was, rel=1e-12))


def test_a_sweep_whose_file_is_gone_is_refused_in_a_line(metro, tmp_path):
    out = tmp_path / "sw"
    short = TEXT.replace('duration = "17 s"', 'duration = "0.2 s"').replace(
        'end = "standstill" ', "# "
    )
    Path("metro.toml").write_text(short)
    words = ["-q", "sweep", "metro.toml:pid", "--vary", "m=38t:39t:2", "--no-compile"]
    assert main([*words, "--out", str(out)]) == 0
    assert openings.opening_of_name(str(out)).folder == str(tmp_path)
    (tmp_path / "metro.toml").rename(tmp_path / "other.toml")
    with pytest.raises(BadInput, match=r"metro.toml is not here"):
        openings.opening_of_name(str(out))


def test_a_recorded_log_is_drawn_as_it_was_recorded(tmp_path, monkeypatch):
    """Each column of numbers over the time of the log, in its unit; words are told of the rest."""
    monkeypatch.chdir(tmp_path)
    rows = [f"{0.1 * k:.1f},{60 - k},ok" for k in range(30)]
    Path("run.csv").write_text("\n".join(["t [s],v [km/h],note", *rows]) + "\n")
    answers = openings.answers_of_opening("run.csv", str(tmp_path))
    model = answered(answers, kind="model")[-1][0]
    assert (model["log"], model["sliders"], model["text"]) == ("run.csv", [], None)
    head, columns = next(f for f in answered(answers, kind="run") if "rows" in f[0])
    assert [(p["name"], p["unit"]) for p in head["panels"]] == [("v", "km/h")]
    assert head["share"] == 1.0
    assert columns[0] == pytest.approx(0.1 * np.arange(30), abs=1e-6)
    assert columns[1] == pytest.approx(60.0 - np.arange(30))
    told = answered(answers, kind="doubts")[-1][0]["warnings"]
    assert any("note is not drawn" in line for line in told)
    for kind in ("law", "verdict", "effects", "c", "save", "draws", "region"):
        assert "open a vehicle's file" in answered(answers, kind=kind)[-1][0]["faults"][0]


def test_what_is_no_sweep_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("empty").mkdir()
    with pytest.raises(BadInput):
        openings.opening_of_name("empty")
    with pytest.raises(BadInput):
        openings.opening_of_name("nobody.csv")


@pytest.mark.parametrize("loop", ["", ":pid", ":nobody"])
def test_a_file_with_a_fault_opens_whatever_loop_is_named(tmp_path, monkeypatch, loop):
    """The page shows the fault at its line; of a file without faults an unknown loop is refused."""
    monkeypatch.chdir(tmp_path)
    Path("bad.toml").write_text(METRO.read_text(encoding="utf-8").replace("38 t", "38 m"))
    opening = openings.opening_of_name(f"bad.toml{loop}")
    openings.check_opening(opening)
    answers = openings.answers_of_opening(opening.name, opening.folder, compile=False)
    head = answered(answers, kind="model")[-1][0]
    assert head["broken"]
    assert head["found"][0]["line"] > 1
    shutil.copy(METRO, "bad.toml")
    with pytest.raises(BadInput, match="nobody") if loop == ":nobody" else nullcontext():
        openings.check_opening(opening)


def test_a_file_in_a_folder_below_is_saved_where_it_is(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("below").mkdir()
    shutil.copy(METRO, "below/metro.toml")
    opening = openings.opening_of_name("below/metro.toml:pid")
    answers = openings.answers_of_opening(opening.name, opening.folder, compile=False)
    assert "faults" not in answered(answers, kind="save", numbers={"m": 39000.0})[-1][0]
    assert "39000" in Path("below/metro.toml").read_text().replace("39 t", "39000")
    assert sorted(p.name for p in Path().rglob("*.toml")) == ["metro.toml"]
