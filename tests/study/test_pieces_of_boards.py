"""What a board is expected to say, columns of a log as text, and names that mean no model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest
import xarray
from test_page_of_a_sweep import swept

from slipctl import BadInput, Input, Output, Scenario, State, connect, every, simulate, step
from slipctl.ccode.module.header import bit
from slipctl.errors import Faults
from slipctl.study import processor, resolve
from slipctl.study.case_setup import in_words, prepare, read_swaps
from slipctl.study.declaration import Context
from slipctl.study.files import declared_parts
from slipctl.study.files.results_folder import csv_text, draft_log, publish
from slipctl.study.files.trip_files import _loop
from slipctl.study.report import sweep_page
from slipctl.study.request import Request


def test_faults_are_told_by_the_next_frame_that_is_heard():
    late, lost, broken = (processor.FAULTS[n] for n in ("late", "lost", "broken"))
    status = np.array([0, 8, 0, 0, 0, 0, 16, 0, 0])
    told = processor._told(status, {1: "late", 2: "lost", 3: "broken", 4: "late", 7: "lost"})
    assert told.tolist() == [0, 8 | late, -1, broken, late | lost, 0, 16, -1, lost]
    assert status[2] == 0  # what was given stays
    first = processor._told(np.zeros(4, dtype=int), {0: "late", 1: "broken"})
    assert first.tolist() == [late, broken, lost, 0]


def test_a_difference_is_one_of_the_largest_value():
    wanted, got = np.array([1.0, -4.0, 2.0]), np.array([3.0, -4.0, 2.5])
    assert processor._difference(wanted, got) == 0.5
    assert processor._difference(wanted, got, 1) == 0.125
    assert processor._difference(wanted, got, -1) == 0.125
    assert processor._difference(0 * wanted, got) == 4.0
    assert processor._difference(wanted[:0], got[:0]) == 0.0


@pytest.mark.parametrize(
    ("a", "b", "moved", "so"),
    [
        (100.0, 100.95, 0, True), (100.0, 101.05, 0, False), (100.0, 103.9, 2.0, True),
        (100.0, 104.1, 2.0, False), (-100.0, -100.95, 0, True), (None, None, 0, True),
        (None, 1.0, 9, False), (1.0, None, 9, False), (0.0, 0.0, 0, True), (0.0, 1e-9, 0, False),
    ],
)  # fmt: skip
def test_metrics_are_one_within_a_hundredth_or_twice_what_they_move_by(a, b, moved, so):
    assert processor._close(a, b, moved) == so


def test_a_log_as_text_has_a_column_for_each_element():
    data = xarray.Dataset(
        {"v": ("time", [2.5, 1 / 3], {"units": "m/s"}), "k": ("time", [7, 8]),
         "s": (("time", "axle"), [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], {"units": "1"})},
        coords={"time": [0.0, 0.1]},
    )  # fmt: skip
    assert csv_text(data).split("\n") == [
        "time [s],v [m/s],k [1],s[0] [1],s[1] [1],s[2] [1]", "0,2.5,7,1,2,3",
        "0.1,0.3333333333,8,4,5,6", ""]  # fmt: skip


def test_a_page_of_several_sweeps_is_named_by_their_study(monkeypatch):
    monkeypatch.setattr(sweep_page, "_pictures", lambda sweeps, command: "")
    monkeypatch.setattr(sweep_page, "_spread", lambda name, one, named: f"[{name} {named}]")
    about = {"loop": "toy:soft", "scenario": "base <1>"}
    one, other = swept([1.0, 2.0], about=about), swept([3.0], about=about)
    alone = sweep_page.page({"soft": one}, "slipctl <a>")
    assert "<title>Sweep of toy:soft" in alone
    assert "[soft False]" in alone
    both = sweep_page.page({"soft": one, "hard": other}, "slipctl <a>")
    assert "<title>Sweep of all loops of toy<" in both
    assert "[soft True][hard True]" in both
    for said in (
        "2 runs of each loop in scenario",
        "base &lt;1&gt;",
        "<pre>slipctl &lt;a&gt;</pre>",
    ):
        assert said in both
    assert "<h2>Limits</h2>" not in both


def test_a_file_of_models_is_no_block_and_its_first_model_is_meant():
    known = resolve.models()
    name = next(m for m, (_, own) in known.items() if "." not in m and len(own) > 1)
    first, *_, last = known[name][1]
    with pytest.raises(
        BadInput, match=rf"{name} is a file of models; write which: {name}\.{first}"
    ):
        resolve._model(name)
    assert resolve.model_source(name)[:2] == (name, first)
    assert resolve.model_source(f"{name}.{last}")[:2] == (name, last)
    for wrong in (f"{name}.nothing", "nothing.block"):
        with pytest.raises(BadInput, match="there is no model"):
            resolve.model_source(wrong)


def test_what_ends_a_file_ends_the_program_and_what_breaks_an_import_is_told(tmp_path, monkeypatch):
    file = tmp_path / "ends.py"
    file.write_text("raise KeyboardInterrupt\n", encoding="utf-8")
    with pytest.raises(KeyboardInterrupt):
        resolve.load_file(str(file))

    def broken(package, name):
        raise BadInput(f"{package}.{name} is broken")

    monkeypatch.setattr(resolve.registry, "module", broken)
    with pytest.raises(BadInput, match=r"models\.mine is broken"):
        resolve._import("models", "mine")


class Made:
    """Loops of which none can be made."""

    def __init__(self, error):
        self.error = error

    def __getitem__(self, name):
        raise self.error


def test_a_loop_that_cannot_be_made_names_its_line_in_the_file():
    text = "title = 'x'\n\n[controllers.pid]\nkind = 'pid'\n\n[controllers.sta]\nkind = 'sta'\n"
    with pytest.raises(BadInput, match=r"my\.toml, line 6: controllers\.sta: too fast"):
        _loop("my.toml", text, Made(BadInput("controllers.sta: too fast")), "sta")
    with pytest.raises(BadInput, match=r"my\.toml, line 3: controllers\.pid: odd"):
        _loop("my.toml", text, Made(BadInput("odd")), "pid")
    with pytest.raises(Faults) as told:
        _loop("my.toml", text, Made(Faults(["one", "two"])), "pid")
    assert list(told.value.lines) == ["one", "two"]
    assert _loop("my.toml", text, {"pid": 7}, "pid") == 7


def test_swaps_are_of_models_that_a_study_has():
    study = SimpleNamespace(name="toy", models={"adh": 1, "train": 2, "other": 3})
    swapped = read_swaps(study, ["adh = mu = v where v [m/s]", "train=y = 2*a where a [1]"])
    assert list(swapped) == ["adh", "train", "other"]
    assert float(swapped["adh"](v=3.0)["mu"]) == 3.0
    assert float(swapped["train"](a=3.0)["y"]) == 6.0
    assert (swapped["other"], study.models["adh"]) == (3, 1)
    with pytest.raises(BadInput, match="toy has no models that --swap replaces"):
        read_swaps(SimpleNamespace(name="toy", models={}), ["adh=my.py:law"])
    for text in ("adh", "adh=", "="):
        with pytest.raises(BadInput, match=r"write name=file\.py:block"):
            read_swaps(study, [text])
    with pytest.raises(BadInput, match="toy has no model 'adhe'"):
        read_swaps(study, ["adhe=my.py:law"])
    assert in_words(["adh = my.py:law"], [" car.m=8.2t "]) == (
        "adh swapped for my.py:law, car.m=8.2t set"
    )


def test_parts_of_an_experiment_tell_how_far_it_is():
    """From nothing to all of it; in a part of it from where that begins to its end."""
    shares = []
    context = Context(quick=True, models={}, cases=[], progress=shares.append)
    assert context.each("squares", [1, 2, 3, 4], lambda k: k * k) == [1, 4, 9, 16]
    assert shares[-1] == 1.0
    assert sorted(shares) == shares
    shares.clear()
    assert context.each("more", [1, 2], lambda k: -k, share=(0.5, 0.75)) == [-1, -2]
    assert (min(shares) >= 0.5, shares[-1]) == (True, 0.75)


def case_of(name, **loops):
    return SimpleNamespace(scenario=SimpleNamespace(name=name), loops=loops)


CASES = [case_of("dry", a=1, b=2), case_of("wet", b=3, c=4), case_of("ice", b=5)]


@pytest.mark.parametrize(
    ("name", "loop", "case"),
    [("a", 1, 0), ("b", 2, 0), ("b@wet", 3, 1), ("c", 4, 1), ("b@ice", 5, 2), ("c@wet", 4, 1)],
)
def test_a_loop_is_that_of_the_first_case_or_of_its_scenario(name, loop, case):
    study = SimpleNamespace(name="toy")
    assert resolve.pick_loop(study, CASES, name) == (loop, CASES[case])
    made = Request("toy:" + name, "toy", loop=name.partition("@")[0],
                   scenario=name.partition("@")[2])  # fmt: skip
    vars(made).update(study=study, cases=CASES)
    assert made.declared == made.chosen == (loop, CASES[case])
    assert made.block == loop


@pytest.mark.parametrize(
    ("name", "said"),
    [("b@we", "toy has no scenario 'we'; did you mean 'wet'"), ("d", "toy has no loop 'd'"),
     ("a@wet", "toy has no loop 'a'; it has b, c"), ("c@ice", "toy has no loop 'c'; it has b")],
)  # fmt: skip
def test_a_loop_or_scenario_that_is_not_there_is_refused(name, said):
    with pytest.raises(BadInput, match=said):
        resolve.pick_loop(SimpleNamespace(name="toy"), CASES, name)


@pytest.mark.parametrize(
    ("name", "parts"),
    [
        ("subway_braking:sta@real.ctl.law", ("subway_braking", "sta", "real", "ctl.law")),
        ("subway_braking:sta", ("subway_braking", "sta", "", "")),
        ("subway_braking", ("subway_braking", "", "", "")), ("huang_2020.x", ("", "", "", "")),
        ("y = 2*x where x [1]", ("", "", "", "")),
    ],
)  # fmt: skip
def test_a_name_is_taken_apart(name, parts):
    found = Request.read(name)
    assert (found.home, found.loop, found.scenario, found.part) == parts
    other = found.at("eppfc@dry")
    assert (other.home, other.loop, other.scenario, other.part) == (parts[0], "eppfc", "dry", "")
    assert found.at("eppfc", "ice").scenario == "ice"


def test_settings_are_named_once():
    study = SimpleNamespace(cases=lambda models, quick: [], name="toy", models={})
    for settings in (["car.m=1t", "b:car.m=3t", "car.m=2t"], ["b:k=1", "a:k=1", "b:k=2"]):
        with pytest.raises(BadInput, match=r"--set names (car\.m|k) twice; write it once"):
            prepare(study, settings=settings)


def test_a_log_is_written_whole_under_other_names(tmp_path, monkeypatch):
    """Text and exact numbers; where the second one breaks the first goes too."""
    pytest.importorskip("netCDF4")
    data = xarray.Dataset({"v": ("time", [2.5, 1 / 3], {"units": "m/s"})}, coords={"time": [0, 1]})
    data = data.assign_attrs(none=[], seed=3)
    found = draft_log(data, tmp_path, "sta")
    assert [p.name for _, p in found] == ["sta.csv", "sta.nc"]
    text, log = (part for part, _ in found)
    assert text.read_text(encoding="utf-8") == csv_text(data)
    again = xarray.load_dataset(log, engine="netcdf4")
    assert again["v"].values.tolist() == [2.5, 1 / 3]
    assert dict(again.attrs) == {"seed": 3}
    assert sorted(tmp_path.iterdir()) == sorted([text, log])
    publish(found)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["sta.csv", "sta.nc"]

    def full(*given, **more):
        raise RuntimeError("NetCDF: HDF error")

    monkeypatch.setattr(xarray.Dataset, "to_netcdf", full)
    with pytest.raises(OSError, match=r"HDF error \(is the disk full\?\)"):
        draft_log(data, tmp_path, "pid")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["sta.csv", "sta.nc"]


def test_a_file_without_a_study_is_none(tmp_path):
    for text in ("x = 1\n", "study = 3\n"):
        (tmp_path / "mine.py").write_text(text, encoding="utf-8")
        with pytest.raises(BadInput, match=r"mine\.py has no study; it must end in: study = Study"):
            resolve.load_study(str(tmp_path / "mine.py"))
        assert resolve.has_study(str(tmp_path / "mine.py")) == text.startswith("study")
    with pytest.raises(
        BadInput, match=r"there is no file .*no\.toml; slipctl new metro .*no\.toml"
    ):
        resolve.load_study(str(tmp_path / "no.toml"))
    with pytest.raises(
        BadInput, match="there is no study 'subway_brakin'; did you mean 'subway_br"
    ):
        resolve.load_study("subway_brakin")


@dataclass(frozen=True)
class Inner:
    """A part of it.

    More of it.
    """

    size: float = field(default=2.0, metadata={"unit": "m", "doc": "its size", "lo": 0.0})


@dataclass(frozen=True)
class Outer:
    """The whole."""

    mass: float = field(metadata={"unit": "t", "doc": "its mass"})
    kind: str = field(default="one", metadata={"doc": "of which kind"})
    inner: Inner = field(default_factory=Inner, metadata={"doc": "a part"})
    gains: Mapping[str, float] = field(default_factory=dict, metadata={"rest": True})


def test_the_schema_of_a_part_has_its_keys_and_those_of_the_parts_in_it():
    """What has no default is needed; where there is a rest further names may stand."""
    found = declared_parts.schema([Outer], "a file")
    assert (found["title"], found["anyOf"]) == ("a file", [{"$ref": "#/$defs/Outer"}])
    outer, inner = (found["$defs"][n] for n in ("Outer", "Inner"))
    assert list(found["$defs"]) == ["Inner", "Outer"]
    assert list(outer["properties"]) == ["mass", "kind", "inner"]
    assert outer["required"] == ["mass"]
    assert outer["additionalProperties"] == {"type": ["string", "number"]}
    assert outer["description"] == "The whole."
    assert (inner["required"], inner["additionalProperties"]) == ([], False)
    assert inner["description"] == "A part of it."
    keys = declared_parts.keys_of(Outer)
    assert [(k.name, k.meaning, k.unit) for k in keys[:2]] == [
        ("mass", "its mass", "t"), ("kind", "of which kind", "")]  # fmt: skip
    (size,) = declared_parts.keys_of(Inner)
    assert (size.name, size.meaning, size.unit) == ("size", "its size", "m")


def test_the_status_of_a_part_is_that_of_the_ticks_in_which_it_runs():
    """Every second tick from the second on: what leaves its range there is limited, once held too.

    The ticks between have the output from before.
    """

    @step(y=Output("1", lo=-1, hi=1))
    def ctl(n=State("1", 0.0), u=Input("1", lo=-5, hi=5)):
        return dict(n=n + 1), dict(y=u)

    loop = connect("loop", {"ctl.u": "u", "out": "ctl.y"}, ctl=every(ctl, 2, 1))
    loop = loop._copy(loop.signals, period=0.1)
    given = [0.5, 0.5, 2.0, 2.0, 0.5, -3.0, 0.1, 0.1]
    python = simulate(loop, Scenario("s", 0.8, inputs={"u": np.array(given)}),
                      log=[*loop.inputs, *loop.outputs, *loop.states], compile=False)  # fmt: skip
    limited = bit("LIMITED")
    assert processor._statuses(loop, "ctl", python).tolist() == [0, limited, limited, 0]
