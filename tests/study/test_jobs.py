"""Jobs on all cores: outcomes, nested jobs, failures, and that none outlives its parent."""

from __future__ import annotations

import os
import time
from multiprocessing.context import ForkProcess
from pathlib import Path

import pytest

from slipctl.errors import BadInput, RunFailed
from slipctl.run.results import LeftToFull, NotRun
from slipctl.study.declaration import Context
from slipctl.study.jobs import Cores, available, run_jobs

forked = pytest.mark.skipif(available() == 1, reason="processes cannot be forked, or one core")


def silent(what: str, share: float) -> None:
    """Tell nobody."""


def gone(number: int) -> bool:
    try:
        os.kill(number, 0)
    except ProcessLookupError:
        return True
    return Path(f"/proc/{number}/stat").read_text().rsplit(")", 1)[1].split()[0] == "Z"


@pytest.mark.parametrize("count", [1, 3])
def test_every_job_is_done_and_failures_say_why(count: int) -> None:
    def bad(tell):
        raise ValueError("no number")

    def missing(tell):
        raise LeftToFull

    jobs = {str(k): (lambda tell, k=k: k * k) for k in range(7)} | {"bad": bad, "none": missing}
    with Cores(count) as cores:
        found = dict(run_jobs(jobs, cores, silent))
    assert {k: v.get() for k, v in found.items() if v.error is None} == {
        str(k): k * k for k in range(7)
    }
    with pytest.raises(RunFailed, match=r"test_jobs.py, line \d+: ValueError: no number"):
        found["bad"].get()
    with pytest.raises(NotRun, match="needs --full"):
        found["none"].get()


@pytest.mark.parametrize("count", [1, pytest.param(2, marks=forked)])
def test_how_far_each_job_is_is_told_with_its_name(count: int) -> None:
    """In the order in which each says so; what is done meanwhile is done once."""

    def work(tell, k):
        for share in (0.25, 0.5):
            tell(share + k)
        return k

    heard: dict[str, list[float]] = {"a": [], "b": []}
    done = []
    jobs = {"a": lambda tell: work(tell, 0), "b": lambda tell: work(tell, 8)}
    with Cores(count) as cores:
        found = dict(run_jobs(
            jobs, cores, lambda name, share: heard[name].append(share), lambda: done.append(1)
        ))  # fmt: skip
    assert {k: v.get() for k, v in found.items()} == {"a": 0, "b": 8}
    told = {name: [s for s in shares if s] for name, shares in heard.items()}
    every = slice(None) if count == 1 else slice(1)  # another process says it now and then
    assert (told["a"][every], told["b"][every]) == ([0.25, 0.5][every], [8.25, 8.5][every])
    assert done == [1]


@forked
def test_jobs_of_jobs_share_the_cores(tmp_path: Path) -> None:
    """At no time more processes compute than there are cores."""

    def leaf(k: int) -> int:
        mark = tmp_path / f"{os.getpid()}"
        mark.touch()
        running = len(list(tmp_path.iterdir()))
        time.sleep(0.05)
        mark.unlink()
        return running

    with Cores(2) as cores:
        context = Context(True, {}, [], cores=cores)
        jobs = {
            str(n): (lambda tell, n=n: context.each(f"leaf {n}", range(4), leaf)) for n in range(3)
        }
        most = [max(outcome.get()) for _, outcome in run_jobs(jobs, cores, silent)]
    assert len(most) == 3
    assert max(most) <= 2


@forked
@pytest.mark.parametrize("order", ["short first", "short last"])
def test_the_last_job_has_all_cores(tmp_path: Path, order: str) -> None:
    """Whichever job's token is whose: parts of the one that is left run side by side."""

    def part(k: int) -> bool:
        (tmp_path / f"{k}").touch()
        for _ in range(6000):
            if (tmp_path / f"{1 - k}").exists():  # the other part, while this one runs
                return True
            time.sleep(0.01)
        return False

    with Cores(2) as cores:
        context = Context(True, {}, [], cores=cores)
        jobs = {"short": lambda tell: [True], "long": lambda tell: context.each("p", [0, 1], part)}
        if order == "short last":
            jobs = dict(reversed(jobs.items()))
        assert all(all(outcome.get()) for _, outcome in run_jobs(jobs, cores, silent))
        assert cores.borrow()  # as many tokens as before
        assert not cores.borrow()


@forked
def test_a_killed_process_fails_its_job_and_the_others_go_on() -> None:
    jobs = {"dies": lambda tell: os.kill(os.getpid(), 9), "lives": lambda tell: 1}
    with Cores(2) as cores:
        found = dict(run_jobs(jobs, cores, silent))
    assert found["lives"].get() == 1
    with pytest.raises(RunFailed, match="ended with code -9"):
        found["dies"].get()


@forked
@pytest.mark.parametrize("bad", [0, 1])  # the third job is done by the process of another
def test_a_process_that_cannot_be_made_costs_no_core(monkeypatch, bad: int) -> None:
    """Its job says so, the others are done, and there are as many tokens as before."""
    starts, start = iter(range(9)), ForkProcess.start

    def failing(process: ForkProcess) -> None:
        if next(starts) == bad:
            raise BlockingIOError(11, "Resource temporarily unavailable")
        start(process)

    monkeypatch.setattr(ForkProcess, "start", failing)
    with Cores(2) as cores:
        found = dict(run_jobs({str(k): (lambda tell, k=k: k) for k in range(3)}, cores, silent))
        assert {k: v.get() for k, v in found.items() if v.error is None} == {
            str(k): k for k in range(3) if k != bad
        }
        with pytest.raises(RunFailed, match="no process can be made for it: Resource"):
            found[str(bad)].get()
        assert cores.borrow()
        assert not cores.borrow()


@forked
def test_an_interrupt_while_a_process_is_made_leaves_none_behind(monkeypatch) -> None:
    """It waits until the process is there, and then costs neither process nor core."""
    made, start = [], ForkProcess.start

    def stopped(process: ForkProcess) -> None:
        start(process)
        made.append(process.pid)
        if len(made) == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(ForkProcess, "start", stopped)
    jobs = {name: (lambda tell: time.sleep(60)) for name in "abc"}
    with Cores(2) as cores:
        with pytest.raises(KeyboardInterrupt):
            list(run_jobs(jobs, cores, silent))
        assert len(made) == 2
        assert all(gone(pid) for pid in made)
        assert cores.borrow()
        assert not cores.borrow()


@forked
def test_no_job_outlives_an_interrupt(tmp_path: Path) -> None:
    def sleeps(tell):
        (tmp_path / str(os.getpid())).touch()
        time.sleep(60)

    def tell(what: str, share: float) -> None:
        if what == "c":
            raise KeyboardInterrupt

    jobs = {"a": sleeps, "b": lambda t: time.sleep(0.3), "c": sleeps}
    with Cores(2) as cores, pytest.raises(KeyboardInterrupt):
        list(run_jobs(jobs, cores, tell))
    assert all(gone(int(p.name)) for p in tmp_path.iterdir())


@pytest.mark.parametrize("count", [1, 2])
def test_parts_come_in_order_and_are_kept(tmp_path: Path, count: int) -> None:
    """Same values on one core and two, from the file as computed; another key computes anew."""

    def work(seed: int) -> dict[str, float]:
        with (tmp_path / "calls").open("a") as file:
            file.write(f"{seed}\n")
        return {"x": 1 / (seed + 3)}

    with Cores(count) as cores:
        context = Context(True, {}, [], folder=tmp_path / "parts", cores=cores, key="k")
        first = context.each("runs", range(5), work)
        assert first == [{"x": 1 / (seed + 3)} for seed in range(5)]
        assert context.each("runs", range(6), work)[:5] == first
        assert sorted((tmp_path / "calls").read_text().split()) == list("012345")
        other = Context(True, {}, [], folder=tmp_path / "parts", cores=cores, key="l")
        assert other.each("runs", range(5), work) == first
        assert len((tmp_path / "calls").read_text().split()) == 11


@forked
def test_processes_take_jobs_one_after_another(tmp_path: Path) -> None:
    """Nine jobs need as many processes as cores; one that is killed is followed by a new one."""

    def job(k: int) -> int:
        if k == 4:
            os.kill(os.getpid(), 9)
        return os.getpid()

    with Cores(2) as cores:
        jobs = {str(k): (lambda tell, k=k: job(k)) for k in range(9)}
        found = dict(run_jobs(jobs, cores, silent))
    assert [k for k, v in found.items() if v.error is not None] == ["4"]
    numbers = {v.value for v in found.values() if v.error is None}
    assert len(numbers) in (2, 3)  # the one that is killed may have done no other job
    assert all(gone(n) for n in numbers)


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("names", ["", "abc"])
def test_something_is_done_meanwhile(count: int, names: str) -> None:
    """Once, in this process, before the last outcome; also where there is no job."""
    done: list[int] = []
    given = 0
    with Cores(count) as cores:
        jobs = {n: (lambda tell: list(done)) for n in names}
        for _ in run_jobs(jobs, cores, silent, lambda: done.append(os.getpid())):
            given += 1
            assert given < len(names) or done == [os.getpid()]
    assert done == [os.getpid()]


def test_no_job_waits_for_what_is_done_meanwhile() -> None:
    """Both processes get their second job before this one is busy."""
    began: list[int] = []
    with Cores(2) as cores:
        jobs = {n: (lambda tell: os.getpid()) for n in "abcd"}
        told = lambda name, share: began.append(1) if share == 0.0 else None  # noqa: E731
        for _ in run_jobs(jobs, cores, told, lambda: began.append(0)):
            pass
    assert began == [1, 1, 1, 1, 0]


def test_no_core_is_refused() -> None:
    with pytest.raises(BadInput, match="--jobs 0: write how many"):
        Cores(0)
