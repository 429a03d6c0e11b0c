"""Jobs on all cores: outcomes, nested jobs, failures, and that none outlives its parent."""

from __future__ import annotations

import os
import time
from multiprocessing.context import ForkProcess
from pathlib import Path
from types import SimpleNamespace

import pytest

from slipctl.errors import BadInput, RunFailed
from slipctl.run.results import LeftToFull, NotRun
from slipctl.study import jobs
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


# ---- in the process of a job ---------------------------------------------------------------------


class Pipe:
    """An end of a pipe that keeps what is sent; it takes so many messages at most."""

    def __init__(self, names=(), fails=None):
        self.sent, self.names, self.fails, self.closed = [], list(names), fails, False

    def send(self, what):
        if self.fails is not None and what[0] == "done":
            fails, self.fails = self.fails, None
            raise fails
        self.sent.append(what)

    def recv(self):
        if not self.names:
            raise EOFError
        return self.names.pop(0)

    def close(self):
        self.closed = True

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


def test_what_a_job_gives_is_sent_with_how_far_it_is_now_and_then(monkeypatch) -> None:
    """At most ten times in a second, from the first one on."""
    now = iter([10.0, 10.0, 10.05, 10.1, 10.2, 10.2, 10.25])
    monkeypatch.setattr(jobs.time, "monotonic", lambda: next(now))

    def job(tell):
        for share in (0.1, 0.2, 0.3, 0.4, 0.5):
            tell(share)
        return "done"

    pipe = Pipe()
    jobs._send(job, pipe)
    assert [s for kind, s in pipe.sent if kind == "share"] == [0.1, 0.4]
    kind, outcome = pipe.sent[-1]
    assert kind == "done"
    assert outcome.get() == "done"


def test_a_result_that_cannot_be_sent_is_a_failed_job() -> None:
    pipe = Pipe(fails=TypeError("cannot pickle"))
    jobs._send(lambda tell: 1, pipe)
    ((kind, outcome),) = pipe.sent
    assert kind == "done"
    with pytest.raises(RunFailed, match="cannot pickle"):
        outcome.get()
    with pytest.raises(ConnectionError):  # the parent is gone: nobody is told
        jobs._send(lambda tell: 1, Pipe(fails=BrokenPipeError()))


@pytest.mark.parametrize("error", [ValueError, SystemExit, GeneratorExit])
def test_whatever_breaks_is_said_where_it_broke(error) -> None:
    def job(tell):
        raise error("odd")

    with pytest.raises(RunFailed, match=f"{error.__name__}: odd"):
        jobs._attempt(job, lambda share: None).get()

    def left(tell):
        raise LeftToFull("later")

    outcome = jobs._attempt(left, lambda share: None)
    assert type(outcome.error) is LeftToFull
    assert str(outcome.error) == str(LeftToFull("later"))
    with pytest.raises(KeyboardInterrupt):
        jobs._attempt(lambda tell: (_ for _ in ()).throw(KeyboardInterrupt), lambda share: None)


@pytest.fixture
def signals(monkeypatch):
    """Handlers by signal, of a process that is not ours."""
    found = {}
    monkeypatch.setattr(jobs.signal, "signal", lambda n, handler: found.__setitem__(n, handler))
    monkeypatch.setattr(jobs.signal, "setitimer", lambda *a: found.__setitem__("timer", a),
                        raising=False)  # fmt: skip
    monkeypatch.setattr(jobs.signal, "pthread_sigmask", lambda *a: found.__setitem__("mask", a),
                        raising=False)  # fmt: skip
    monkeypatch.setattr(jobs.gc, "freeze", lambda: found.__setitem__("frozen", True))
    return found


def test_a_process_does_jobs_until_its_parent_has_none(signals) -> None:
    adopted, others = [], (Pipe(), Pipe())
    cores = SimpleNamespace(adopt=lambda: adopted.append(1))
    pipe = Pipe(["b", "c"])
    done = {n: (lambda tell, n=n: n * 2) for n in "abc"}
    jobs._forked(done, "a", pipe, cores, others)
    assert [outcome.get() for _, outcome in pipe.sent] == ["aa", "bb", "cc"]
    assert adopted == [1]
    assert all(p.closed for p in (pipe, *others))
    ignored = jobs.signal.SIG_IGN
    assert signals[jobs.signal.SIGINT] is ignored
    assert signals[jobs.signal.SIGTERM] is ignored
    assert signals["timer"] == (jobs.signal.ITIMER_REAL, 0.0)
    assert signals["mask"] == (jobs.signal.SIG_UNBLOCK, jobs.STOPS)
    assert signals["frozen"]


def test_a_process_that_is_asked_to_leave_does_so_once_without_a_word(signals) -> None:
    def job(tell):
        leave = signals[jobs.signal.SIGTERM]
        with pytest.raises(KeyboardInterrupt):
            leave(jobs.signal.SIGTERM, None)
        assert signals[jobs.signal.SIGTERM] is jobs.signal.SIG_IGN
        signals[jobs.signal.SIGTERM] = None
        leave(jobs.signal.SIGTERM, None)

    pipe = Pipe(["b"])
    jobs._forked({"a": job}, "a", pipe, SimpleNamespace(adopt=lambda: None), ())
    assert pipe.sent == []
    assert pipe.closed
    assert pipe.names == ["b"]


def test_a_process_whose_parent_is_gone_ends(signals) -> None:
    pipe = Pipe(["b"], fails=BrokenPipeError())
    jobs._forked({"a": lambda tell: 1}, "a", pipe, SimpleNamespace(adopt=lambda: None), ())
    assert pipe.sent == []
    assert pipe.closed


def test_a_process_watches_the_first_one(monkeypatch) -> None:
    """The end that writes is closed here; when nobody holds it any more, the process ends."""
    watched, closed, ended = [], [], []

    class Thread:
        def __init__(self, target, daemon):
            watched.append((target, daemon))

        def start(self):
            watched.append("started")

    monkeypatch.setattr(jobs.threading, "Thread", Thread)
    with Cores(1) as cores:
        real = os.close
        read, write = os.pipe()
        cores._alive = (read, write)
        monkeypatch.setattr(jobs.os, "close", lambda end: closed.append(end) or real(end))
        cores.adopt()
        assert closed == [write]
        assert cores._alive == (read, -1)
        cores.adopt()
        assert closed == [write]
        assert [w for w in watched if w != "started"] == [(cores._watch, True)] * 2
        assert watched.count("started") == 2
        monkeypatch.setattr(jobs.os, "_exit", ended.append)
        cores._watch()
        assert ended == [1]


def test_processes_are_asked_to_end_and_then_killed(monkeypatch) -> None:
    """All are asked before any is waited for; together they have the grace of one."""
    done = []

    class Process:
        def __init__(self, name, alive):
            self.name, self.alive = name, alive

        def __getattr__(self, what):
            return lambda *a: done.append((self.name, what, *a))

        def is_alive(self):
            return self.alive

    now = iter([100.0, 100.0 + jobs.GRACE / 2, 100.0 + 2 * jobs.GRACE])
    monkeypatch.setattr(jobs.time, "monotonic", lambda: next(now))
    running = [SimpleNamespace(pipe=Pipe(), process=Process(n, n == "b")) for n in "ab"]
    jobs._stop(running)
    assert all(r.pipe.closed for r in running)
    assert done == [("a", "terminate"), ("b", "terminate"), ("a", "join", jobs.GRACE / 2),
                    ("b", "join", 0.0), ("b", "kill"), ("b", "join")]  # fmt: skip
