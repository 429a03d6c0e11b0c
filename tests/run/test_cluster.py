"""A sweep on the workers of a Dask scheduler: the same bits, no run lost, no machine mixed in."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import closed_loop, three_rails

from slipctl import BadInput, open_sweep, simulate, sweep
from slipctl.block import portable
from slipctl.commands.cli import main
from slipctl.run import machine
from slipctl.run.sweep import cluster
from slipctl.run.sweep.sweep_results import Sweep
from slipctl.run.sweep.sweep_runs import Measured
from slipctl.study.resolve import find_loop, load_study

pytestmark = pytest.mark.second

TOY = Path(__file__).parents[1] / "toy_study.py"
LOOP = "soft"
VARY = ["plant.car.m=6t:10t"]


@cache
def toy() -> Any:
    """Loop, case and study of a person's file."""
    study = load_study(str(TOY))
    return *find_loop(study, LOOP), study


def swept(out: Path, **options: Any) -> Sweep:
    """Forty runs of the toy, 0.2 s each."""
    loop, case, study = toy()
    scenario = case.scenario.but(duration=0.2)
    return sweep(loop, scenario, VARY, out, samples=options.pop("samples", 40),
                 signals=study.signals, compile=False, **options)  # fmt: skip


@pytest.fixture(scope="module")
def workers() -> Iterator[Any]:
    """Two workers, each a process of its own."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50
    ) as found:
        yield found


def test_the_same_bits(tmp_path: Path, workers: Any) -> None:
    """Runs of workers are those of this machine; a folder goes on here or there."""
    logs = ["plant.car.v"]
    here = swept(tmp_path / "here", logs=logs)
    address = workers.scheduler_address
    swept(tmp_path / "there", logs=logs, scheduler=address, samples=10)
    swept(tmp_path / "there", logs=logs, samples=15)
    there = swept(tmp_path / "there", logs=logs, scheduler=address)
    assert there.runs == here.runs
    assert len(there.runs) == 40
    for run in (0, 12, 39):
        assert there.log(run).identical(here.log(run))
    assert "mixed" not in there.about
    assert there.about["processor"] == machine.processor()


@pytest.mark.long
def test_a_lost_worker_loses_no_run(
    tmp_path: Path, workers: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """SIGKILL of a worker among the runs: another one rolls what it held."""
    monkeypatch.setattr(cluster, "BATCH", 2)
    killed: list[int] = []

    def kill(share: float) -> None:
        if not killed and share > 0.2:
            killed.append(next(iter(workers.workers.values())).pid)
            os.kill(killed[0], signal.SIGKILL)

    found = swept(tmp_path / "there", scheduler=workers.scheduler_address, progress=kill)
    assert killed
    assert found.runs == swept(tmp_path / "here").runs


def test_what_ended_and_was_lost_is_waited_for(
    tmp_path: Path, workers: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The result of runs dies with its worker before it is fetched: no scheduler was lost.

    The client hears of the loss and of the second end by messages; both are played here.
    """
    distributed = pytest.importorskip("distributed")
    lost: list[str] = []

    class Losing(distributed.as_completed):
        def __next__(self) -> Any:
            future = super().__next__()
            if not lost:
                lost.append(future.key)
                future._state.lose()
                self.loop.call_later(0.2, future._state.finish)
            return future

    monkeypatch.setattr(distributed, "as_completed", Losing)
    found = swept(tmp_path / "there", scheduler=workers.scheduler_address)
    assert lost
    assert found.runs == swept(tmp_path / "here").runs


def test_machines_are_not_mixed(
    tmp_path: Path, workers: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A worker of another machine is refused, by what differs; or told, where it is allowed."""
    address, its = workers.scheduler_address, machine.processor()
    monkeypatch.setattr(machine, "processor", lambda: "Z80, libm 1")
    with pytest.raises(BadInput, match=r"another processor .*Z80, libm 1.*--mixed lets it"):
        swept(tmp_path / "one", scheduler=address, samples=2)
    assert open_sweep(tmp_path / "one").missing == 2
    found = swept(tmp_path / "two", scheduler=address, samples=2, mixed=True)
    assert not found.missing
    assert (found.about["processor"], found.about["mixed"]) == ("Z80, libm 1", [its])
    monkeypatch.undo()
    with pytest.raises(BadInput, match="its processor differs"):
        swept(tmp_path / "two", samples=3)
    assert swept(tmp_path / "two", samples=3, mixed=True).missing == 0
    monkeypatch.setattr(machine, "versions", lambda: {"slipctl": "0", "casadi": "0", "numpy": "0"})
    with pytest.raises(BadInput, match=r"a worker has slipctl .* here it is 0; install the same"):
        swept(tmp_path / "three", scheduler=address, samples=2)


def test_no_scheduler(tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody answers, no address, no extra: one line each."""
    line = ["sweep", f"{TOY}:{LOOP}", "--vary", *VARY, "--no-compile", "--out"]
    cases = [("tcp://127.0.0.1:1", "no Dask scheduler answers there"), ("x y", "no Dask scheduler")]
    monkeypatch.setattr(cluster, "ANSWER", 0.5)
    if find_spec("distributed") is None:
        cases = []
    for address, said in [*cases, ("tcp://127.0.0.1:1", "pip install 'slipctl[dask]'")]:
        if "pip" in said:
            monkeypatch.setitem(sys.modules, "distributed", None)
        assert main([*line, str(tmp_path / "out"), "--scheduler", address]) == 2
        told = capsys.readouterr().err.splitlines()
        assert len(told) == 1, told
        assert said in told[0]


def test_loops_pickle() -> None:
    """A loop that went through pickle gives the same log, bit for bit, and can still be changed."""
    loop, scenario = closed_loop(lag=True), three_rails(0.02)
    again = pickle.loads(pickle.dumps(loop))
    for numbers in ({}, {"ctl.law.k1": 7.0}):
        one, other = (
            simulate(b.with_params(**numbers), scenario, compile=False) for b in (loop, again)
        )
        for name in one:
            assert np.array_equal(one[name].values, other[name].values), name
    assert again.f.serialize() == loop.f.serialize()
    assert again["plant.adh"].conditions == loop["plant.adh"].conditions


def test_a_loop_of_a_persons_file_pickles(tmp_path: Path) -> None:
    """What the file defines goes along, so that who reads it needs no such file."""
    loop, case, study = toy()
    raw = portable.dumps(Measured(loop, case.scenario, study.signals, compile=False))
    script = tmp_path / "read.py"
    (tmp_path / "raw").write_bytes(raw)
    script.write_text(
        "import pathlib, sys\nfrom slipctl.block import portable\n"
        f"m = portable.loads(pathlib.Path({str(tmp_path / 'raw')!r}).read_bytes())\n"
        "print(m.fingerprint())\n", encoding="utf-8",
    )  # fmt: skip
    done = subprocess.run([sys.executable, "-P", str(script)], capture_output=True, text=True,
                          check=True, cwd=tmp_path)  # fmt: skip
    assert (
        done.stdout.strip()
        == Measured(loop, case.scenario, study.signals, compile=False).fingerprint()
    )
