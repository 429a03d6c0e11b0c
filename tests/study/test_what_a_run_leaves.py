"""Files, pages and words of a run, of results that are written here."""

from __future__ import annotations

import errno
import json
from types import SimpleNamespace

import pytest

from slipctl import Input, Output, Param, State, connect, law, step
from slipctl.block.block import Block
from slipctl.errors import BadInput
from slipctl.run import store
from slipctl.run.metrics import METRICS, Metric
from slipctl.run.results import LeftToFull
from slipctl.study import case_setup, provenance, resolve
from slipctl.study.files import results_folder
from slipctl.study.files.results_folder import PAGE
from slipctl.study.jobs import Cores, Outcome
from slipctl.study.report import remarks, report_page
from slipctl.study.report.remarks import Remark

# ---- files ---------------------------------------------------------------------------------------


def results(**more):
    study = SimpleNamespace(name="toy", limits={}, figures={}, **more.pop("study", {}))
    return SimpleNamespace(study=study, quick=False, cases=[], tables={}, failed={}, metrics={},
                           **more)  # fmt: skip


@pytest.fixture(autouse=True)
def _from(monkeypatch):
    """Where numbers come from is short."""
    monkeypatch.setattr(results_folder, "provenance", lambda found, command: {"command": command})


def test_metrics_are_written_with_their_rows_and_limits(tmp_path, monkeypatch):
    made = results()
    made.metrics = {"dry": {"pid": {"distance": Metric(12.5, "m", ()),
                                    "slip": Metric([0.5, 0.25], "m/s", ("a", "b"))}},
                    "ice": {"pid": {}}}  # fmt: skip
    results_folder.save_metrics(made, tmp_path, "CMD")
    plain = {
        "dry": {"pid": {"distance": {"value": 12.5, "unit": "m"},
                        "slip": {"value": [0.5, 0.25], "unit": "m/s", "rows": ["a", "b"]}}},
        "ice": {"pid": {}},
    }  # fmt: skip
    found = store.read_json(tmp_path / "metrics.json")
    assert found.pop("format") == store.FORMAT
    assert found == {"study": "toy", "quick": False, "scenarios": plain, "command": "CMD"}
    made.study.limits, made.failed, made.quick = {"distance": 10.0}, {"dry/sta": "why"}, True
    monkeypatch.setattr(results_folder, "values_beyond_limit", lambda r, s: {"of": s})
    results_folder.save_metrics(made, tmp_path, "CMD", "stopped")
    found = store.read_json(tmp_path / "metrics.json")
    found.pop("format")
    assert found == {
        "study": "toy", "quick": True, "state": "stopped", "scenarios": plain,
        "limits": {"distance": 10.0}, "above_limits": {"dry": {"of": "dry"}, "ice": {"of": "ice"}},
        "failed": {"dry/sta": "why"}, "command": "CMD",
    }  # fmt: skip


def test_no_experiment_leaves_no_tables(tmp_path):
    from slipctl import Table

    made = results()
    results_folder.save_tables(made, tmp_path, "CMD")
    assert list(tmp_path.iterdir()) == []
    made.tables = {"one": {"t": Table("A", {"x": ("m", [1.0, 2.0]), "n": ("", ["a", "b"])}, "B")}}
    results_folder.save_tables(made, tmp_path, "CMD")
    columns = {"x": {"unit": "m", "values": [1.0, 2.0]}, "n": {"unit": "", "values": ["a", "b"]}}
    found = store.read_json(tmp_path / "tables.json")["experiments"]
    assert found == {"one": {"t": {"title": "A", "doc": "B", "columns": columns}}}


def test_a_full_disk_is_said_of_a_log(tmp_path):
    class Data:
        def to_netcdf(self, path, engine, encoding):
            self.given = (path, engine, encoding)
            raise RuntimeError("NetCDF: HDF error")

    data = Data()
    with pytest.raises(OSError, match="HDF error") as told:
        results_folder._save(data, tmp_path / "a.nc", {"v": {"zlib": True}})
    assert told.value.errno == errno.EIO
    assert data.given == (tmp_path / "a.nc", "netcdf4", {"v": {"zlib": True}})


def test_a_log_that_cannot_be_written_leaves_no_half(tmp_path, monkeypatch):
    import xarray

    def full(*_):
        raise OSError(errno.ENOSPC, "full")

    data = xarray.Dataset({"v": ("time", [1.0, 2.0], {"units": "m/s"})}, {"time": [0.0, 0.1]},
                          {"period_s": 0.1, "rail_changes_s": []})  # fmt: skip
    monkeypatch.setattr(results_folder, "_save", full)
    with pytest.raises(OSError, match="full"):
        results_folder.draft_log(data, tmp_path, "pid")
    assert list(tmp_path.iterdir()) == []
    monkeypatch.undo()
    parts = results_folder.draft_log(data, tmp_path, "pid")
    assert [to.name for _, to in parts] == ["pid.csv", "pid.nc"]
    assert sorted(p for p, _ in parts) == sorted(tmp_path.iterdir())
    assert all(p.name.startswith(store.PART) for p, _ in parts)
    results_folder.publish(parts)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["pid.csv", "pid.nc"]
    again = xarray.load_dataset(tmp_path / "pid.nc", engine="netcdf4")
    assert again["v"].values.tolist() == [1.0, 2.0]
    assert "rail_changes_s" not in again.attrs
    assert again.attrs["period_s"] == 0.1


def test_a_figure_of_a_quick_run_is_marked_and_carries_its_stamp(tmp_path, monkeypatch):
    done = []
    draws = {n: SimpleNamespace(draw=lambda r, n=n: f"fig {n}") for n in ("one", "two")}
    made = results()
    made.study.figures = draws
    monkeypatch.setattr(results_folder, "stamp", lambda r, c: f"stamp {c}")
    monkeypatch.setattr(results_folder.plots, "mark_quick", lambda fig: done.append(("mark", fig)))
    monkeypatch.setattr(results_folder.plots, "save",
                        lambda *a: done.append(a) or f"svg {a[0]}")  # fmt: skip
    monkeypatch.setattr(results_folder.live, "of_figure", lambda fig: f"live {fig}")
    jobs = results_folder.figure_jobs(made, tmp_path, "CMD")
    assert list(jobs) == ["one", "two"]
    assert jobs["two"](None) == ("svg fig two", "live fig two")
    assert done == [("fig two", tmp_path / "figures", "two", "stamp CMD")]
    made.quick = True
    jobs["one"](None)
    assert done[1] == ("mark", "fig one")
    assert done[2][0] == "fig one"


@pytest.mark.parametrize("left", [1, 2])
def test_pages_hold_what_was_drawn_and_say_what_was_left(tmp_path, monkeypatch, caplog, left):
    """A section that was made before is not made again; a figure that breaks is noted."""

    def figure(what):
        def job(tell):
            if isinstance(what, BaseException):
                raise what
            return what

        return job

    from slipctl.run.results import NotRun

    figures = {"a": figure(("svg a", "live a")), "b": figure(("svg b", None)),
               "c": figure(ValueError("bad"))}  # fmt: skip
    figures |= {f"left{k}": figure(NotRun(f"scenario {k}")) for k in range(left)}
    figures["full"] = figure(LeftToFull())
    pages, judgements = [], []
    monkeypatch.setattr(results_folder, "figure_jobs", lambda *a: figures)
    monkeypatch.setattr(results_folder.plots, "load", lambda: None)
    sections = {"loops": lambda: "made here", "notation": lambda: "notation"}
    monkeypatch.setattr(results_folder.report_page, "constant", lambda r: sections)
    monkeypatch.setattr(results_folder.report_page, "of_runs", lambda r: {"rail": lambda: "rail"})

    def page(found, verdicts, drawn, command, texts, curves):
        pages.append((verdicts, drawn, command, texts, curves))
        return "PAGE"

    monkeypatch.setattr(results_folder.report_page, "page", page)
    made = results()
    there = {f"{PAGE}loops": Outcome(value="made before")}
    caplog.set_level("INFO", "slipctl")
    with Cores(1) as cores:
        results_folder.save_pages(
            made, lambda: judgements.append(1) or ["V"], tmp_path, "CMD", cores, there
        )
    ((verdicts, drawn, command, texts, curves),) = pages
    assert (verdicts, command) == (["V"], "CMD")
    assert drawn == {"a": "svg a", "b": "svg b"}
    assert curves == {"a": "live a"}
    assert texts == {"loops": "made before", "notation": "notation", "rail": "rail"}
    assert judgements == [1, 1]
    assert list(made.failed) == ["figure c"]
    assert "bad" in made.failed["figure c"]
    assert (tmp_path / "report.html").read_text() == "PAGE"
    told = [r.getMessage() for r in caplog.records]
    if left == 1:
        assert len(told) == 1
        assert "scenario 0" in told[0]
    else:
        assert [t for t in told if t.startswith("2 figures")]
        assert not any("scenario" in t for t in told)


# ---- pages ---------------------------------------------------------------------------------------


def controller(name="ctl", gain=1.0):
    @step(u=Output("1", "command"), name=name)
    def block(e=Input("1", "error"), K=Param("1", gain, "gain"), x=State("1", 0.0, "sum")):
        """Proportional and integral."""
        return dict(x=x + e), dict(u=K * e + x)

    return block


@law(y=Output("1", "position"))
def plant(u=Input("1", "command"), c=Param("1", 1.0, "slope")):
    """A line."""
    return c * u


def loop_of(part, name="loop", wire="e"):
    return connect(name, {f"ctl.{wire}": "r", "y": "ctl.u"}, ctl=part)


def test_loops_are_named_by_their_scenario_where_they_differ():
    """The same block, and one that is written the same, count once; another form has a name."""
    one, same = loop_of(controller()), loop_of(controller())
    other = loop_of(controller(gain=1.0).with_params(K=2.0))

    @step(u=Output("1", "command"), name="ctl")
    def another(e=Input("1", "error"), K=Param("1", 1.0, "gain"), x=State("1", 0.0, "sum")):
        """Proportional and integral."""
        return dict(x=x + e), dict(u=K * e - x)

    cases = [
        SimpleNamespace(scenario=SimpleNamespace(name=n), loops=loops)
        for n, loops in (("dry", {"a": one, "b": one}), ("ice", {"a": same, "b": one}),
                         ("wet", {"a": loop_of(another), "c": other}))
    ]  # fmt: skip
    found = report_page.distinct_loops(SimpleNamespace(cases=cases))
    assert list(found) == ["a", "b", "a in wet", "c"]
    assert found["a"] is one
    assert found["c"] is other
    assert found["a in wet"] is cases[2].loops["a"]


def test_loops_are_the_same_by_parts_wires_choices_and_equations():
    from slipctl.draw import show

    same = report_page._same
    one = loop_of(controller())
    assert same(one, one, show)
    assert same(one, loop_of(controller()), show)
    two = connect("loop", {"ctl.e": "r", "p.u": "ctl.u", "y": "p.y"}, ctl=controller(), p=plant)
    assert not same(one, two, show)
    assert not same(two, one, show)
    asked = []
    texts = SimpleNamespace(text=lambda b, jacobian: asked.append(jacobian) or b.name)
    assert same(one, loop_of(controller()), texts)
    assert set(asked) <= {False}
    leaves = dict(one.leaves())

    class Made:
        """A loop of parts, wires and choices."""

        def __init__(self, leaves, wires="w", choices="c"):
            self.wires, self.choices, self._leaves = wires, choices, leaves

        def leaves(self):
            return self._leaves.items()

    first = Made({"a": 1, "b": 2})
    words = SimpleNamespace(text=lambda x, jacobian: str(x)[0])
    assert same(first, Made({"a": 1, "b": 2}), words)
    assert same(first, Made({"a": 11, "b": 29}), words)  # written the same
    assert not same(first, Made({"a": 1, "b": 3}), words)
    assert not same(first, Made({"a": 2, "b": 2}), words)
    assert not same(first, Made({"b": 2, "a": 1}), words)
    assert not same(first, Made({"a": 1}), words)
    assert not same(first, Made({"a": 1, "b": 2}, wires="v"), words)
    assert not same(first, Made({"a": 1, "b": 2}, choices="d"), words)
    assert leaves


def test_a_metric_has_its_meaning_a_click_away():
    name = next(iter(METRICS))
    for label in (name, f"{name} [m]", f"{name}, axle 1"):
        found = report_page._told(label).text
        assert found.startswith("<details><summary>" + label)
        words = METRICS[name].meaning.split("`")[0].split("<")[0].split("&")[0][:20]
        assert words in found
    assert report_page._told("of my own <b>") == "of my own <b>"


# ---- words ---------------------------------------------------------------------------------------


def test_remarks_on_a_page_have_their_numbers(monkeypatch):
    made = [Remark("dry", "a<b", "it is off & late", ("c < 1", "d"), True),
            Remark("ice", "e", "fine", (), False)]  # fmt: skip
    monkeypatch.setattr(remarks, "estimator_remarks", lambda results: made)
    found = remarks.remarks_html(SimpleNamespace())
    assert found.count("<p") == 4
    rows = found.split("</p>")
    assert rows[0] == "<p>dry/a&lt;b: it is off &amp; late."
    assert rows[1].endswith(">c &lt; 1.")
    assert rows[2].endswith(">d.")
    assert rows[3] == "<p>ice/e: fine."
    monkeypatch.setattr(remarks, "estimator_remarks", lambda results: [])
    assert remarks.remarks_html(SimpleNamespace()) == ""


def test_wheels_lock_or_slip():
    brakes, drives = SimpleNamespace(slip_sign=1), SimpleNamespace(slip_sign=-1)
    slip = {"slip_max": Metric(2.5, "m/s")}
    lock = {"lock_time": Metric(0.25, "s"), **slip}
    assert remarks._wheels(brakes, lock) == "wheels lock for 0.25 s"
    assert remarks._wheels(brakes, {**lock, "lock_time": Metric(0.0, "s")}) == "wheels never lock"
    for run, metrics in ((drives, lock), (brakes, slip)):
        assert remarks._wheels(run, metrics) == "largest slip 2.5 m/s"
    assert remarks._wheels(brakes, {"slip_max": Metric(0.5, "1")}) == "largest slip 0.5"
    assert remarks._wheels(drives, {"lock_time": Metric(1.0, "s")}) == ""
    assert remarks._wheels(brakes, {}) == ""


def test_a_warning_stands_once_with_all_its_runs(monkeypatch):
    """Physics first; what a remark has said already is left out, and what did not hold is told."""
    made = [Remark("dry", "a", "off", ("known",), False), Remark("ice", "b", "held", (), True)]
    monkeypatch.setattr(remarks, "estimator_remarks", lambda results: made)
    monkeypatch.setattr(remarks, "warnings_before_run",
                        lambda loop, scenario: [f"{remarks.FIRST} of {loop}"])  # fmt: skip
    log = {"dry": {"a": SimpleNamespace(attrs={"told": "late\nknown\n"})},
           "ice": {"a": SimpleNamespace(attrs={"told": "late\nknown"}),
                   "b": SimpleNamespace(attrs={})}}  # fmt: skip
    cases = [SimpleNamespace(scenario=SimpleNamespace(name=s), loops={"a": 1, "b": 2})
             for s in ("dry", "ice")]  # fmt: skip
    study = SimpleNamespace(without_effect=("no effect",))
    found = remarks.warnings_of_runs(SimpleNamespace(cases=cases, data=log, study=study))
    assert found == [
        (f"{remarks.FIRST} of 1", "dry: a; ice: a"), (f"{remarks.FIRST} of 2", "dry: b; ice: b"),
        ("late", "dry: a; ice: a"), ("no effect", "dry: a, b; ice: a, b"), ("known", "ice: a"),
        ("off", "dry: a"),
    ]  # fmt: skip


# ---- names ---------------------------------------------------------------------------------------

SOURCE = '''"""Models of a toy.

More of it.
"""
from slipctl import Block, law

@law(y=1)
def called(x=1):
    """First.

    Second."""

@step
def plain(x): "Plain."

@flow(y=2)
def _hidden(x): "Hidden."

@other
def decorated(x): "No block."

@slipctl.law
def by_attribute(x): "No name."

def makes(k) -> Block:
    return k

def gives(k) -> dict: ...

class Own:
    @law
    def inside(x): ...
'''


def test_blocks_of_a_file_are_read_without_importing_it(tmp_path):
    path = tmp_path / "toy.py"
    path.write_text(SOURCE, encoding="utf-8")
    title, blocks = resolve._described(path, 1)
    assert title == "Models of a toy."
    assert blocks == {"called": "First.", "plain": "Plain.", "makes": ""}
    assert resolve._text(path, 1) == SOURCE
    path.write_text('"""Other."""', encoding="utf-8")
    assert resolve._described(path, 1)[0] == "Models of a toy."  # as it was when it changed last
    assert resolve._described(path, 2) == ("Other.", {})
    path.write_text("def wrong(:", encoding="utf-8")
    assert resolve._described(path, 3) == ("", {})


def test_studies_are_files_that_assign_one(tmp_path, monkeypatch):
    texts = {"assigned": '"""A."""\nstudy = 1\n', "typed": '"""B."""\nstudy: int = 1\n',
             "none": '"""C."""\nother = 1\n', "broken": "study = (",
             "_own": "study = 1"}  # fmt: skip
    for name, text in texts.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "study.py").write_text(text, encoding="utf-8")
    monkeypatch.setattr(resolve.registry, "folder", lambda package: tmp_path)
    assert resolve.studies() == {"assigned": "A.", "broken": "", "typed": "B."}


def test_a_name_that_several_models_have_is_refused(tmp_path, monkeypatch):
    texts = {"one": "@law\ndef twice(x): 'A.'\n@law\ndef once(x): 'B.'\n",
             "two": "@law\ndef twice(x): 'C.'\ndef once(y): 'no block'\n"}  # fmt: skip
    for name, text in texts.items():
        (tmp_path / f"{name}.py").write_text(text, encoding="utf-8")
    monkeypatch.setattr(
        resolve, "model_files", lambda: {n: tmp_path / f"{n}.py" for n in ("two", "one")}
    )
    asked = []
    monkeypatch.setattr(resolve, "_import", lambda *a: asked.append(a) or "MODULE")
    monkeypatch.setattr(resolve, "find_block", lambda *a: asked.append(a) or "BLOCK")
    model = resolve._model.__wrapped__
    assert resolve.models() == {"one": ("", {"twice": "A.", "once": "B."}),
                                "two": ("", {"twice": "C."})}  # fmt: skip
    assert model("once") == "BLOCK"
    assert asked == [("models", "one"), ("MODULE", "once", "one")]
    with pytest.raises(BadInput, match=r"one\.twice or two\.twice"):
        model("twice")
    for wrong in ("never", "three.twice"):
        with pytest.raises(BadInput):
            model(wrong)


def test_a_block_of_somebodys_file_is_found_by_its_name(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(
        "from slipctl import Input, Output, law\n"
        "@law(y=Output('1', 'twice'))\n"
        "def own(x=Input('1', 'once')):\n    'Twice.'\n    return 2 * x\n"
        "def made():\n    return own\n"
        "def needs(k):\n    return own\n"
        "def wrong():\n    return 3\n"
        "def breaks():\n    return 1 / 0\n",
        encoding="utf-8",
    )
    for name in ("own", "made"):
        block = resolve.load_block(f"{path}:{name}")
        assert isinstance(block, Block)
        assert float(block(x=3.0)["y"]) == 6
    for name in ("needs", "wrong", "breaks", "never"):
        with pytest.raises(BadInput):
            resolve.load_block(f"{path}:{name}")
    for name in (str(path), str(tmp_path / "x.toml")):
        with pytest.raises(BadInput):
            resolve.load_block(name)


# ---- settings ------------------------------------------------------------------------------------


def test_names_that_a_person_may_write_end_a_dotted_name():
    assert case_setup._endings("plant.train.adh.c") == ["adh.c", "train.adh.c", "plant.train.adh.c"]
    assert case_setup._endings("car.m") == ["car.m"]
    assert case_setup._endings("m") == ["m"]


def test_values_of_settings_are_numbers_lists_or_names():
    class Loop:
        """A loop with three numbers."""

        def __init__(self):
            self.given = {}

        def declared(self, name):
            modes = {"off": 0.0, "on": 1.0} if name == "mode" else None
            code = lambda where, text: modes[text]  # noqa: E731
            return SimpleNamespace(values=modes, unit="1" if modes else "m", code=code)

        def with_params(self, **values):
            self.given = values
            return self

    loop = Loop()

    def given(names, value):
        assert case_setup._with(loop, names, case_setup.Setting("", "x", value)) is loop
        return loop.given

    assert given(["a", "b"], "2 km") == {"a": 2000.0, "b": 2000.0}
    assert given(["a"], " [1 m, 20 cm, 3] ") == {"a": [1.0, pytest.approx(0.2), 3.0]}
    assert given(["mode"], " on") == {"mode": 1.0}
    assert isinstance(loop.given["mode"], float)
    assert given(["mode"], "1") == {"mode": 1.0}
    with pytest.raises(BadInput):
        given(["a"], "on")


@pytest.mark.parametrize("text", ["car.m", "=3", "car.m=", "loop:=3", " = ", "car.m= "])
def test_a_setting_has_a_name_and_a_value(text):
    with pytest.raises(BadInput):
        case_setup.Setting.read(text)


def test_a_setting_is_split_at_its_first_mark():
    read = case_setup.Setting.read
    assert read(" pid : car.m = 8.2t ") == case_setup.Setting("pid", "car.m", "8.2t")
    assert read("car.m=a=b") == case_setup.Setting("", "car.m", "a=b")


# ---- where numbers come from ---------------------------------------------------------------------


def test_parameters_stand_once_and_where_they_differ(monkeypatch):
    one = controller()
    cases = [
        SimpleNamespace(scenario=SimpleNamespace(name=n, seed=s), loops=loops)
        for n, s, loops in (("dry", 1, {"a": one, "b": one}), ("ice", 5, {"a": one}),
                            ("wet", 7, {"a": one.with_params(K=3.0), "c": plant}))
    ]  # fmt: skip
    made = results()
    made.cases = cases
    found = provenance.provenance(made, "CMD")
    assert found["parameters"] == {
        "a": {"K": {"value": 1.0, "unit": "1"}}, "b": {"K": {"value": 1.0, "unit": "1"}},
        "a@wet": {"K": {"value": 3.0, "unit": "1"}}, "c": {"c": {"value": 1.0, "unit": "1"}},
    }  # fmt: skip
    assert found["seed"] == {"dry": 1, "ice": 5, "wet": 7}
    assert (found["command"], found["study"], found["quick"]) == ("CMD", "toy", False)
    made.tables = {"one": {}}
    assert provenance.provenance(made, "CMD")["seed"]["experiments"] == provenance.EXPERIMENT_SEED
    line = json.loads(provenance.stamp(made, "CMD"))
    assert line["format"] == store.FORMAT
    assert line["command"] == "CMD"


def test_a_loop_of_a_study_and_its_parts_are_blocks(monkeypatch):
    asked = []
    monkeypatch.setattr(resolve, "load_study", lambda name: asked.append(name) or "STUDY")
    monkeypatch.setattr(resolve, "find_loop", lambda study, name: ((study, name), "CASE"))
    monkeypatch.setattr("slipctl.run.logs.replay.part_of", lambda loop, path: (loop, path))
    monkeypatch.setattr(resolve, "has_study", lambda name: name == "mine.py")
    assert resolve.load_block("toy:pid") == ("STUDY", "pid")
    assert resolve.load_block("toy:pid.ctl.law") == (("STUDY", "pid"), "ctl.law")
    assert resolve.load_block("mine.py:pid") == ("STUDY", "pid")
    assert asked == ["toy", "toy", "mine.py"]
