"""Sweeps: each run is the single run, by its number alone; what ended is kept, nothing is mixed."""

from __future__ import annotations

import os
import signal
import sqlite3
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest
import xarray
from conftest import closed_loop, three_rails
from hypothesis import given
from hypothesis import strategies as st

from slipctl import (
    BadInput,
    Block,
    End,
    Param,
    Rail,
    RunFailed,
    Scenario,
    Section,
    Signals,
    State,
    open_sweep,
    simulate,
    step,
    sweep,
)
from slipctl.commands.cli import main
from slipctl.models import vehicle
from slipctl.run.metrics import Run, measure, rail_changes, rail_names
from slipctl.run.sweep import sweep_export, sweep_runs
from slipctl.run.sweep.ensemble import Ensemble, World
from slipctl.run.sweep.sweep_plan import Axis, Plan
from slipctl.run.sweep.sweep_runs import Measured

SIGNALS = Signals(speed="plant.wheel.v", slip="plant.wheel.v_s", torque="plant.brake.T_b",
                  reference="v_opt", adhesion="plant.adh.mu")  # fmt: skip
VARY = {"ctl.law.k1": (5, 20, 3), "plant.wheel.m": (6e3, 9e3)}


@cache
def world() -> tuple[Block, Scenario]:
    """Braked wheelset on three rails, 25 ticks."""
    return closed_loop(lag=True), three_rails(0.025)


def swept(out: Path, **changes: Any) -> Any:
    loop, scenario = world()
    options: dict[str, Any] = {"samples": 3, "signals": SIGNALS, "compile": False, "jobs": 2}
    vary = changes.pop("vary", VARY)
    return sweep(changes.pop("loop", loop), scenario, vary, out, **(options | changes))


@given(st.sampled_from(["random", "sobol"]), st.integers(0, 2**32), st.integers(1, 40))
def test_a_run_does_not_know_how_many_there_are(design: str, seed: int, samples: int) -> None:
    """Numbers follow from the number of the run; they lie in their range, the grid goes first."""
    axes = (Axis("a", 0.0, 4.0, 3, "1"), Axis("b", 2.0, 3.0, None, "1"))
    few, many = (Plan(axes, n, seed, design) for n in (samples, samples + 7))
    assert few.size == 3 * samples
    for run in range(few.size):
        numbers = few.numbers(run)
        assert numbers == many.numbers(run)
        assert 2.0 <= numbers["b"] <= 3.0
        assert numbers["a"] == 2.0 * (run % 3)
        assert few.place(run) == (run % 3, run // 3)


def test_designs_fill_the_range() -> None:
    """A Latin hypercube has one draw in each stratum, a Sobol sequence of 2^k points too."""
    for design in ("lhs", "sobol"):
        plan = Plan((Axis("a", 0.0, 1.0, None, "1"), Axis("b", 0.0, 1.0, None, "1")), 64, 3, design)
        drawn = np.array([list(plan.numbers(k).values()) for k in range(64)])
        for column in drawn.T:
            assert sorted(np.floor(64 * column)) == list(range(64))


@pytest.mark.second
def test_runs_are_single_runs(tmp_path: Path) -> None:
    """Metrics of each run have the bits of those of the loop with its numbers, simulated alone."""
    loop, scenario = world()
    found = swept(tmp_path)
    assert len(found.runs) == 9
    for run, numbers, metrics, failed in found.runs:
        assert not failed
        assert numbers == found.plan.numbers(run)
        log = simulate(loop.with_params(**numbers), scenario, compile=False)
        changes = rail_changes(log, scenario, SIGNALS)
        own = measure(Run(log, SIGNALS, changes, rails=rail_names(scenario, changes)))
        assert metrics == {n: m.value for n, m in own.items()}
        assert {n: (m.unit, m.rows) for n, m in own.items()} == dict(found.units)


@pytest.mark.second
def test_resumed_and_extended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same again does nothing, more samples do the new ones only, on any number of threads."""
    begun: list[int] = []
    real = Measured.ended
    monkeypatch.setattr(Measured, "ended", lambda m, k, n: begun.append(k) or real(m, k, n))
    swept(tmp_path / "a", samples=1)
    assert sorted(begun) == [0, 1, 2]
    swept(tmp_path / "a", samples=1)
    grown = swept(tmp_path / "a", samples=3)
    assert sorted(begun) == list(range(9))
    assert swept(tmp_path / "a", samples=2).plan.samples == 3  # what is there stays
    alone = swept(tmp_path / "b", jobs=1)
    xarray.testing.assert_identical(grown.dataset().drop_attrs(), alone.dataset().drop_attrs())


def test_stopped(tmp_path: Path) -> None:
    """Ctrl-C keeps what has ended, and the same line again does the rest."""

    def stop(share: float) -> None:
        if share > 0.3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        swept(tmp_path, progress=stop)
    half = open_sweep(tmp_path)
    assert 0 < len(half.runs) < 9
    assert half.missing == 9 - len(half.runs)
    assert swept(tmp_path).missing == 0


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_killed(tmp_path: Path) -> None:
    """SIGKILL loses no run that was told as ended."""
    told, tell = os.pipe()
    child = os.fork()
    if child == 0:

        def kill(share: float) -> None:
            os.write(tell, b".")
            if share > 0.5:
                os.kill(os.getpid(), signal.SIGKILL)

        swept(tmp_path, progress=kill, jobs=1)
        os._exit(0)
    os.close(tell)
    _, status = os.waitpid(child, 0)
    assert os.WTERMSIG(status) == signal.SIGKILL
    ended = len(os.read(told, 100))
    os.close(told)
    assert ended == len(open_sweep(tmp_path).runs) == 5
    assert swept(tmp_path).missing == 0


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"seed": 2}, r"its seed differs \(1 there, 2 now\)"),
        ({"design": "sobol"}, "its design differs"),
        ({"vary": {"ctl.law.k1": (5, 20, 3)}}, "its vary differs"),
        ({"loop": "other"}, "its numbers differ;"),
    ],
)
def test_never_mixed(tmp_path: Path, changes: dict[str, Any], said: str) -> None:
    """A folder of another sweep is refused, by what differs; it stays as it was."""
    swept(tmp_path, samples=1)
    if "loop" in changes:
        changes = {"loop": world()[0].with_params(**{"plant.wheel.J": 300.0})}
    with pytest.raises(BadInput, match=said):
        swept(tmp_path, samples=1, **changes)
    assert open_sweep(tmp_path).missing == 0


def test_a_latin_hypercube_is_not_extended(tmp_path: Path) -> None:
    """Its strata follow from the number of samples."""
    swept(tmp_path, design="lhs", samples=2)
    with pytest.raises(BadInput, match="cannot be extended to 3"):
        swept(tmp_path, design="lhs", samples=3)


def test_what_is_no_store(tmp_path: Path) -> None:
    """Another file, a newer format, an empty folder: one line."""
    with pytest.raises(BadInput, match="there is no sweep"):
        open_sweep(tmp_path)
    (tmp_path / "sweep.sqlite").write_bytes(b"no database at all, but long enough to be one" * 99)
    for use in (open_sweep, swept):
        with pytest.raises(BadInput, match="cannot be used as the store"):
            use(tmp_path)
    swept(tmp_path / "new", samples=1)
    with sqlite3.connect(tmp_path / "new" / "sweep.sqlite") as db:
        db.execute("update about set value = '99' where key = 'format'")
    with pytest.raises(BadInput, match="format 99"):
        open_sweep(tmp_path / "new")


def test_failed_runs_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run that breaks says why, the others go on; its metrics are no numbers."""
    real = sweep_runs.Measured.metrics
    count = iter(range(100))

    def broken(self: Measured, log: Any) -> Any:
        if next(count) == 1:
            raise RunFailed("v became nan at t = 1 s")
        return real(self, log)

    monkeypatch.setattr(sweep_runs.Measured, "metrics", broken)
    found = swept(tmp_path, jobs=1, samples=1)
    assert found.failed == {1: "v became nan at t = 1 s"}
    assert list(np.isnan(found.dataset()["distance"].values.ravel())) == [False, True, False]


def test_labelled(tmp_path: Path) -> None:
    """Axes of the grid and samples are dimensions, with units; netCDF gives the same."""
    found = swept(tmp_path)
    data = found.dataset()
    assert dict(data["distance"].sizes) == {"ctl.law.k1": 3, "sample": 3}
    assert list(data["ctl.law.k1"].values) == [5.0, 12.5, 20.0]
    assert data["plant.wheel.m"].attrs["units"] == "kg"
    assert list(data["tracking_time_row"].values) == ["dry", "wet", "ice"]
    run, numbers, metrics, _ = found.runs[5]
    k, sample = found.plan.place(run)
    one = data.isel({"ctl.law.k1": k, "sample": sample})
    assert float(one["distance"]) == metrics["distance"]
    assert float(one["plant.wheel.m"]) == numbers["plant.wheel.m"]
    found.save(tmp_path / "all.nc")
    with xarray.open_dataset(tmp_path / "all.nc") as again:
        xarray.testing.assert_equal(again.load(), data)


@pytest.mark.second
def test_logs_on_demand(tmp_path: Path) -> None:
    """Signals that are asked for are kept over time, bit for bit, and belong to the sweep."""
    loop, scenario = world()
    found = swept(tmp_path, logs=["plant.wheel.v", "ctl.T_b"])
    log = simulate(loop.with_params(**found.plan.numbers(4)), scenario, compile=False)
    kept = found.log(4)
    for name in ("time", "plant.wheel.v", "ctl.T_b"):
        assert (kept[name].values == log[name].values).all()
        assert kept[name].attrs["units"] == log[name].attrs["units"]
    with pytest.raises(BadInput, match="its logs differ"):
        swept(tmp_path)
    with pytest.raises(BadInput, match="has no signal"):
        swept(tmp_path / "new", logs=["ctl.T"])
    with pytest.raises(BadInput, match="without --log"):
        swept(tmp_path / "new").log(0)


@pytest.mark.parametrize("end", [".nc", ".zarr"])
@pytest.mark.parametrize("vary", [VARY, {"ctl.law.k1": (5, 20, 3)}, {"plant.wheel.m": (6e3, 9e3)}])
def test_logs_are_exported(end: str, vary: Any, tmp_path: Path, monkeypatch: Any) -> None:
    """Metrics and logs of all runs in one labelled file, batch by batch, bit for bit."""
    if end == ".zarr":
        pytest.importorskip("zarr")
    monkeypatch.setattr(sweep_export, "CHUNK", 8 * 25 * 2)  # two runs of one grid point a batch
    logs = ["plant.wheel.v", "ctl.T_b"]
    found = swept(tmp_path / "sweep", vary=vary, logs=logs)
    file = tmp_path / f"all{end}"
    for _ in range(2):  # an export takes the place of an older one
        found.save(file)
    engine: Any = {"engine": "zarr", "consolidated": False} if end == ".zarr" else {}
    with xarray.open_dataset(file, **engine) as data:
        again = data.load()
    metrics = again.drop_vars([*logs, "time"])
    xarray.testing.assert_equal(metrics.drop_attrs(), found.dataset().drop_attrs())
    for run, numbers, _, _ in found.runs:
        place = found.plan.place(run)
        dims = [d for d in again["ctl.T_b"].dims if d != "time"]
        one = again.isel(dict(zip(dims, place, strict=False)))
        xarray.testing.assert_equal(one[logs].reset_coords(drop=True), found.log(run)[logs])
        assert all(float(one[n]) == v for n, v in numbers.items())
        assert one["ctl.T_b"].attrs["units"] == "N m"
    assert [p.name for p in tmp_path.iterdir() if p.name.startswith(".")] == []


def test_an_export_that_cannot_be(tmp_path: Path, monkeypatch: Any) -> None:
    """Another ending, a folder that is something else, a missing extra: one line."""
    found = swept(tmp_path / "sweep", samples=1)
    (tmp_path / "mine.zarr").mkdir()
    for name, said in (("all.csv", r"ends in \.nc or \.zarr"), ("mine.zarr", "no Zarr folder")):
        with pytest.raises(BadInput, match=said):
            found.save(tmp_path / name)
    monkeypatch.setitem(sys.modules, "zarr", None)
    with pytest.raises(BadInput, match=r"slipctl\[zarr\]"):
        found.save(tmp_path / "all.zarr")


@pytest.mark.second
def test_runs_of_an_ensemble_are_single_runs(tmp_path: Path) -> None:
    """Mass drawn, and the height of every rail times a drawn factor: built by hand it is the same.

    More samples later find the runs that are there, with the same numbers.
    """
    loop, scenario = world()
    ensemble = Ensemble({"plant.wheel.m": "6t:9t"}, {"peak": "0.8:1.2 of plant.adh.c"})
    drawn = World(loop, scenario, ensemble, signals=SIGNALS, compile=False)
    swept(tmp_path, vary=[], world=drawn, samples=2)
    found = swept(tmp_path, vary=[], world=drawn, samples=4)
    assert len(found.runs) == 4
    adhesion = dict(loop.parts)["plant"].conditions
    for _, numbers, metrics, failed in found.runs:
        assert not failed
        assert set(numbers) == {"plant.wheel.m", "peak"}
        assert 0.8 <= numbers["peak"] <= 1.2
        high = [
            replace(s, values={**s.values, "plant.adh.c": numbers["peak"] * height(adhesion, s)})
            for s in scenario.rail.sections
        ]
        own = scenario.but(rail=Rail(high))
        log = simulate(
            loop.with_params(**{"plant.wheel.m": numbers["plant.wheel.m"]}), own, compile=False
        )
        assert metrics["distance"] == measure(Run(log, SIGNALS))["distance"].value


def height(conditions: Any, section: Section) -> float:
    """Parameter c of the condition of a section."""
    return next(v for n, v in conditions[section.condition].items() if n.endswith("c"))


@pytest.mark.parametrize(
    ("vary", "said"),
    [
        ([], "something to vary"),
        (["ctl.law.k1"], "write P=lo:hi:n"),
        (["ctl.law.k1=1:2:3:4"], "write P=lo:hi:n"),
        (["ctl.law.k1=2:1"], "is no range"),
        (["plant.wheel.m=7:8t"], "has a unit at one end; write '7 t' or '7 kg'"),
        (["plant.wheel.m=7t:8"], "has a unit at one end; write '8 t' or '8 kg'"),
        (["ctl.law.k1=1:2:x"], "is no number of values"),
        (["ctl.law.k1=1:2:1"], "is no number of values"),
        (["ctl.law.k1=a:2"], "is no number with a unit"),
        (["ctl.law.k1=1kg:2kg"], "another dimension"),
        (["ctl.law.kay=1:2"], "has no parameter 'ctl.law.kay'; did you mean"),
        (["plant.wheel.r=1m:200m"], "out of range"),
        (["plant.adh.c=0.1:0.2"], "the rail sets plant.adh.c"),
        (["ctl.law.k1=1:2", "ctl.law.k1=3:4"], "twice"),
        (["ctl.law.k1=1:2:9999", "plant.wheel.m=7t:8t:99999"], "at most"),
        ({"ctl.law.k1": 3}, r"give \(lo, hi\)"),
    ],
)
def test_bad_axes(vary: Any, said: str, tmp_path: Path) -> None:
    """What can be mistyped is told, and leaves no folder behind."""
    with pytest.raises(BadInput, match=said):
        swept(tmp_path / "out", vary=vary)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("hst_traction:hosm_limited", "something to vary"),
        ("subway_braking@nowhere --vary m=1t:2t", "no scenario 'nowhere'"),
        ("subway_braking:star --vary ctl.law.k1=1:2", "did you mean 'sta'"),
        ("subway_braking:sta --vary ctl.law.k1=1:2 --samples 0", "--samples = 0"),
        ("subway_braking:sta --vary ctl.law.k1=1:2 --export x.csv", "ends in .nc"),
        ("subway_braking:sta --vary ctl.law.k1=1:2 --design x", "there is no --design 'x'"),
    ],
)
def test_bad_lines(line: str, said: str, tmp_path: Path, capsys: Any) -> None:
    """What can be mistyped is one line, and leaves no folder behind."""
    out = tmp_path / "out"
    assert main(["sweep", *line.split(), "--out", str(out)]) == 2
    told = [x for x in capsys.readouterr().err.splitlines() if x]
    assert len(told) == 1
    assert said in told[0]
    assert not out.exists()


def test_samples_of_nothing_that_is_drawn_are_told(tmp_path: Path, capsys: Any) -> None:
    """A grid alone has one run for each point; who asks for more of each is told."""
    text = (Path(vehicle.__file__).parent / "files" / "metro.toml").read_text(encoding="utf-8")
    short = text.replace('duration = "17 s"', 'duration = "20 ms"')
    (tmp_path / "metro.toml").write_text(short, encoding="utf-8")
    line = ["sweep", f"{tmp_path / 'metro.toml'}:none", "--vary", "m=36t:40t:2", "--samples", "5"]
    assert main([*line, "--out", str(tmp_path / "out"), "--no-compile"]) == 0
    said = capsys.readouterr()
    assert "2 runs" in said.out
    assert "--samples 5 is left out, as nothing is drawn" in said.err


class KilledWorker(Exception):
    """A task that the scheduler gave up, as each worker that had it died."""


class Task:
    """What a client sends: the result at once, or how it ended instead, as often as is told."""

    def __init__(self, key: int, made: Any, ends: list[str]) -> None:
        self.key, self.made, self.ends = key, made, ends

    @property
    def status(self) -> str:
        return self.ends[0] if self.ends else "finished"

    def exception(self) -> BaseException:
        return KilledWorker()

    def result(self) -> Any:
        return self.made

    def release(self) -> None:
        """Nothing is held."""


class Client:
    """A scheduler whose workers are this process; ``ends``: how its tasks end, in their order."""

    ends: ClassVar[list[str]] = []

    def __init__(self, scheduler: str, **options: Any) -> None:
        self.sent, self.loop = 0, None

    def submit(self, function: Any, *given: Any, **options: Any) -> Task:
        made = function(*(g.result() if isinstance(g, Task) else g for g in given))
        self.sent += 1
        return Task(self.sent, made, [self.ends.pop(0)] if self.sent > 1 and self.ends else [])

    def nthreads(self) -> dict[str, int]:
        return {"worker": 1}

    def wait_for_workers(self, *given: Any, **options: Any) -> None:
        """One is there."""

    close = wait_for_workers


class AsCompleted(list[Task]):
    """Tasks in the order of their ends; one that was lost ends at last."""

    def __init__(self, tasks: list[Task], loop: Any) -> None:
        super().__init__(tasks)

    def add(self, task: Task) -> None:
        if task.status == "lost":
            task.ends.pop()
        self.append(task)


@pytest.mark.parametrize("ends", [["lost", "error", "lost"], ["error"] * 6])
def test_a_batch_that_is_lost_or_given_up_is_rolled_again_and_no_other_is_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ends: list[str]
) -> None:
    """Five times a batch may be given up."""
    fake = SimpleNamespace(Client=Client, KilledWorker=KilledWorker, as_completed=AsCompleted)
    monkeypatch.setitem(sys.modules, "distributed", fake)
    monkeypatch.setattr(Client, "ends", list(ends))

    @step(period=0.1)
    def counter(n=State("1", 0.0), k=Param("1", 1.0)):  # type: ignore[no-untyped-def]
        """Counts."""
        return dict(n=n + k), {}

    def runs(folder: str, **more: Any) -> Any:
        given = {"samples": 9, "compile": False, "jobs": 1} | more
        return sweep(counter, Scenario("s", 0.2), ["k=1:2"], tmp_path / folder, **given)

    with pytest.raises(BadInput, match="--jobs"):
        runs("none", jobs=0)
    if len(ends) > 5:
        with pytest.raises(RunFailed, match="the same command resumes it"):
            runs("there", scheduler="tcp://fake")
    found = runs("there", scheduler="tcp://fake")
    assert found.runs == runs("here").runs
    assert not found.missing


def test_changes_of_a_rail_by_time_are_those_until_the_run_ended():
    rail = Rail([Section(t, None, {"k": 1.0 + t}) for t in (0.0, 0.5, 2.0)])
    scenario = Scenario("s", 3.0, rail, end=End("n", above=4.0))
    for last, wanted in ((0.4, []), (0.5, [0.5]), (1.9, [0.5]), (2.0, [0.5, 2.0])):
        log = xarray.Dataset(coords={"time": np.linspace(0.0, last, 5)})
        assert rail_changes(log, scenario, Signals()) == wanted
