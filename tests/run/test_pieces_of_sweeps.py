"""Stores, workers and compilers of sweeps: what stands behind them is a stub here."""

from __future__ import annotations

import os
import platform
import shutil
import sqlite3
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from slipctl.block import portable
from slipctl.errors import BadInput, RunFailed
from slipctl.run import build, machine, store
from slipctl.run.logs import log_signals
from slipctl.run.sweep import cluster, sweep_store

# ---- a store -------------------------------------------------------------------------------------

ABOUT = {"loop": "toy:pid", "samples": 4, "processor": "one", "numbers": "n"}


def told(folder, **more):
    """What a store says of its sweep after it was begun with these words."""
    found = sweep_store.begin(folder, {**ABOUT, **more.pop("about", {})}, **more)
    try:
        return found.about()
    finally:
        found.close()


def test_a_store_that_is_begun_again_keeps_most_samples(tmp_path):
    first = told(tmp_path)
    assert {k: first[k] for k in ABOUT} == ABOUT
    assert first["format"] == sweep_store.store.FORMAT
    assert told(tmp_path, about={"samples": 9})["samples"] == 9
    assert told(tmp_path, about={"samples": 2})["samples"] == 9
    with pytest.raises(BadInput):
        told(tmp_path, about={"loop": "toy:sta"})
    assert told(tmp_path)["samples"] == 9  # what is refused changes nothing, and leaves no lock


def test_another_processor_is_refused_or_told(tmp_path):
    told(tmp_path)
    with pytest.raises(BadInput):
        told(tmp_path, about={"processor": "two"})
    found = told(tmp_path, about={"processor": "two", "numbers": "m"}, mixed=True)
    assert (found["processor"], found["numbers"], found["mixed"]) == ("one", "n", ["two"])
    found = told(tmp_path, about={"processor": "three"}, mixed=True)
    assert found["mixed"] == ["three", "two"]
    assert told(tmp_path, mixed=True)["mixed"] == ["three", "two"]
    with pytest.raises(BadInput):
        told(tmp_path, about={"loop": "toy:sta", "processor": "two"}, mixed=True)
    made = sweep_store.begin(tmp_path, ABOUT)
    try:
        made.tell_mixed(["one"])
        assert made.about()["mixed"] == ["three", "two"]
        made.tell_mixed(["four", "two", "one"])
        assert made.about()["mixed"] == ["four", "three", "two"]
    finally:
        made.close()


def test_the_first_processor_alone_is_no_mix(tmp_path):
    assert "mixed" not in told(tmp_path, mixed=True)
    assert "mixed" not in told(tmp_path, mixed=True)


def test_a_file_that_cannot_be_opened_is_no_store(tmp_path, monkeypatch):
    def broken(*_, **__):
        raise sqlite3.OperationalError("unable to open")

    monkeypatch.setattr(sweep_store.sqlite3, "connect", broken)
    with pytest.raises(BadInput, match="unable to open"):
        sweep_store._opened(tmp_path / "runs.db")
    with pytest.raises(BadInput):
        told(tmp_path)
    monkeypatch.undo()
    told(tmp_path)  # the folder is free again


# ---- workers -------------------------------------------------------------------------------------


class Future:
    """What a worker gives, or why not."""

    def __init__(self, key, status, value):
        self.key, self.status, self.value, self.released = key, status, value, False

    def exception(self):
        return self.value

    def result(self):
        return self.value

    def release(self):
        self.released = True


class Waiting(list):
    """Futures in the order in which they came."""

    def __iter__(self):
        while self:
            yield self.pop(0)

    def add(self, future):
        self.append(future)


class Killed(Exception):
    """A worker died."""


@pytest.fixture
def scheduler(monkeypatch):
    """Workers that answer as ``answers`` says, batch by batch; else with a run each."""
    sent, answers, futures = [], [], []

    class Client:
        loop = "LOOP"
        failing = None

        def __init__(self, address, **more):
            if isinstance(self.failing, type) and self.failing is not TimeoutError:
                raise self.failing("no")
            self.address, self.more, self.closed, self.waited = address, more, [], []

        def wait_for_workers(self, many, timeout):
            self.waited.append((many, timeout))
            if self.failing is TimeoutError:
                raise TimeoutError

        def nthreads(self):
            return {"a": 1, "b": 1}

        def close(self, timeout):
            made.append(self)
            self.closed.append(timeout)

        def submit(self, what, *given, pure):
            assert pure is False
            if what is bytes:
                return given[0]
            recipe, few, mixed, plan, runs = given
            sent.append(list(runs))
            status, value = answers.pop(0) if answers else ("finished", None)
            value = ("", "Z80", [f"run {k}" for k in runs]) if value is None else value
            futures.append(Future(f"key {len(sent)}", status, value))
            futures[-1].told = (what, recipe, few, mixed, plan)
            return futures[-1]

    made = []
    fake = ModuleType("distributed")
    fake.Client, fake.KilledWorker = Client, Killed
    fake.as_completed = lambda many, loop: Waiting(many)
    monkeypatch.setitem(sys.modules, "distributed", fake)
    return SimpleNamespace(Client=Client, sent=sent, answers=answers, futures=futures, made=made)


TOLD = {**machine.versions(), "processor": "P", "numbers": "N", "samples": 9}


def rolled(scheduler, total, mixed=None):
    """What is kept of so many runs."""
    kept = []
    client = scheduler.Client("tcp://x:1")
    cluster._roll_all(client, {"a": 1}, "PLAN", iter(range(total)), total, kept.append, TOLD, mixed)
    return kept


def test_every_run_is_sent_once_in_batches_and_kept(scheduler):
    """A quarter of what each of two threads has to do, in order."""
    kept = rolled(scheduler, 40)
    assert scheduler.sent == [list(range(k, k + 5)) for k in range(0, 40, 5)]
    assert [r for batch in kept for r in batch] == [f"run {k}" for k in range(40)]
    assert all(f.released for f in scheduler.futures)
    what, recipe, few, mixed, plan = scheduler.futures[0].told
    assert what is cluster.roll_on_worker
    assert portable.loads(recipe) == {"a": 1}
    assert few == {k: v for k, v in TOLD.items() if k != "samples"}
    assert (mixed, plan) == (False, "PLAN")


@pytest.mark.second
def test_few_runs_are_sent_one_by_one_and_many_in_bounded_batches(scheduler):
    rolled(scheduler, 3)
    assert scheduler.sent == [[0], [1], [2]]
    scheduler.sent.clear()
    total = 9 * 8 * cluster.BATCH
    rolled(scheduler, total)
    assert {len(b) for b in scheduler.sent} == {cluster.BATCH}
    assert [k for b in scheduler.sent for k in b] == list(range(total))
    assert rolled(scheduler, 0) == []


def test_what_was_lost_is_waited_for_or_sent_again(scheduler):
    scheduler.answers += [("lost", None), ("error", Killed("k")), ("pending", None)]
    wanted = [f"run {k}" for k in range(3)]

    class Healing(Waiting):
        def add(self, future):
            if future.status in ("lost", "pending"):
                future.status = "finished"
            super().add(future)

    sys.modules["distributed"].as_completed = lambda many, loop: Healing(many)
    kept = rolled(scheduler, 3)
    assert sorted(r for batch in kept for r in batch) == wanted
    assert scheduler.sent == [[0], [1], [2], [1]]


@pytest.mark.second
def test_a_batch_that_is_lost_again_and_again_ends_the_sweep(scheduler):
    scheduler.answers += [("error", Killed("again"))] * (cluster.LOST + 1)
    with pytest.raises(RunFailed, match="again"):
        rolled(scheduler, 1)
    assert scheduler.sent == [[0]] * (cluster.LOST + 1)
    scheduler.sent.clear()
    scheduler.answers[:] = [("error", Killed("again"))] * cluster.LOST
    assert rolled(scheduler, 1) == [["run 0"]]


def test_what_breaks_on_a_worker_is_said(scheduler):
    scheduler.answers += [("error", ValueError("no number"))]
    with pytest.raises(RunFailed, match="ValueError: no number"):
        rolled(scheduler, 2)
    scheduler.answers += [("cancelled", None)]
    with pytest.raises(RunFailed, match="scheduler was lost"):
        rolled(scheduler, 2)
    scheduler.answers += [("finished", ("has numpy 1", "", []))]
    with pytest.raises(BadInput, match="has numpy 1"):
        rolled(scheduler, 2)


def test_processors_of_workers_are_told_where_they_may_be_mixed(scheduler):
    heard = []
    rolled(scheduler, 2, heard.append)
    assert heard == [["Z80"], ["Z80"]]
    assert scheduler.futures[0].told[3] is True


@pytest.mark.parametrize("error", [OSError, ValueError, TypeError, ImportError])
def test_a_scheduler_that_does_not_answer_is_refused(scheduler, error):
    scheduler.Client.failing = error
    with pytest.raises(BadInput, match="tcp://x:1"):
        cluster._connected("tcp://x:1")


def test_a_scheduler_without_workers_is_left(scheduler):
    scheduler.Client.failing = TimeoutError
    with pytest.raises(BadInput, match="no worker"):
        cluster._connected("tcp://x:1")
    assert [c.closed for c in scheduler.made] == [[cluster.ANSWER]]
    scheduler.Client.failing = None
    found = cluster._connected("tcp://x:1")
    assert found.address == "tcp://x:1"
    assert found.more == {"timeout": cluster.ANSWER, "set_as_default": False}
    assert found.waited == [(1, cluster.WORKERS)]
    assert found.closed == []


def test_without_the_extra_no_scheduler_is_asked(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(BadInput, match="extra dask"):
        cluster._connected("tcp://x:1")


def test_a_client_is_closed_whatever_happens(scheduler, monkeypatch):
    given = ({"a": 1}, "PLAN", iter(range(2)), 2, lambda found: None, "tcp://x:1", TOLD, None)
    cluster.run_all(*given)
    assert scheduler.sent == [[0], [1]]
    scheduler.answers += [("error", ValueError("no"))]
    with pytest.raises(RunFailed):
        cluster.run_all(given[0], given[1], iter(range(2)), *given[3:])
    assert [c.closed for c in scheduler.made] == [[cluster.ANSWER]] * 2


def test_a_worker_of_another_kind_may_not_compute(monkeypatch):
    class Loop:
        def fingerprint(self):
            return "N"

        def ended(self, k, numbers):
            return (k, numbers)

    monkeypatch.setattr(cluster, "_built", {})
    monkeypatch.setattr(cluster.portable, "loads", lambda recipe: Loop())
    monkeypatch.setattr(machine, "processor", lambda: "P")
    plan = SimpleNamespace(numbers=lambda k: k * k)
    good = ("", "P", [(2, 4), (5, 25)])
    assert cluster.roll_on_worker(b"r", TOLD, False, plan, [2, 5]) == good
    for name in (*machine.versions(), "processor", "numbers"):
        why, processor, runs = cluster.roll_on_worker(b"r", {**TOLD, name: "x"}, False, plan, [2])
        assert (bool(why), processor, runs) == (True, "", [])
        why, processor, runs = cluster.roll_on_worker(b"r", {**TOLD, name: "x"}, True, plan, [2])
        if name in machine.versions():
            assert name in why
            assert runs == []
        else:
            assert (why, processor, runs) == ("", "P", [(2, 4)])


def test_a_worker_builds_a_loop_once_and_forgets_the_one_before(monkeypatch):
    made = []

    def load(recipe):
        made.append(recipe)
        return SimpleNamespace(fingerprint=lambda: f"of {recipe!r}")

    monkeypatch.setattr(cluster, "_built", {})
    monkeypatch.setattr(cluster.portable, "loads", load)
    first = cluster._measured(b"a")
    assert first[1] == "of b'a'"
    assert cluster._measured(b"a") is first
    assert cluster._measured(b"b")[1] == "of b'b'"
    assert made == [b"a", b"b"]
    assert len(cluster._built) == 1
    cluster._measured(b"a")
    assert made == [b"a", b"b", b"a"]


# ---- the machine ---------------------------------------------------------------------------------

AMD = "processor\t: 0\nmodel name\t: AMD EPYC\nflags\t\t: a b\n\nmodel name\t: Other\n"
ARM = "processor\t: 0\nCPU implementer\t: 0x41\nCPU part\t: 0xd0c\n"


@pytest.mark.parametrize(
    ("text", "name"),
    [(AMD, "AMD EPYC"), (ARM, "0x41 0xd0c"), ("CPU part : 0x1\n", "0x1"), (None, "chip"),
     ("", "chip"), ("model name\t: a : b\n", "a : b")],
)  # fmt: skip
def test_a_processor_is_called_as_its_first_core_says(monkeypatch, text, name):
    def read(path, **more):
        assert str(path) == "/proc/cpuinfo"
        if text is None:
            raise FileNotFoundError
        return text

    monkeypatch.setattr(machine.Path, "read_text", read)
    monkeypatch.setattr(platform, "processor", lambda: "chip")
    for libc, told in ((("glibc", "2.36"), "glibc 2.36"), (("", ""), "Sys 9")):
        monkeypatch.setattr(platform, "libc_ver", lambda libc=libc: libc)
        monkeypatch.setattr(platform, "system", lambda: "Sys")
        monkeypatch.setattr(platform, "release", lambda: "9")
        assert machine.processor.__wrapped__() == f"{name}, {told}"
    if name == "chip":
        monkeypatch.setattr(platform, "processor", lambda: "")
        monkeypatch.setattr(platform, "machine", lambda: "x86")
        assert machine.processor.__wrapped__().startswith("x86, ")


# ---- compilers -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("cc", "there", "found"),
    [
        (None, ["gcc", "clang"], "/bin/gcc"), (None, ["cc", "gcc"], "/bin/cc"),
        ("mine", ["mine", "cc"], "/bin/mine"), ("mine", ["clang"], "/bin/clang"), (None, [], None),
        ("", ["cc"], "/bin/cc"),
    ],
)  # fmt: skip
def test_a_compiler_is_the_first_one_that_is_there(monkeypatch, cc, there, found):
    if cc is None:
        monkeypatch.delenv("CC", raising=False)
    else:
        monkeypatch.setenv("CC", cc)
    monkeypatch.setattr(shutil, "which", lambda name: f"/bin/{name}" if name in there else None)
    assert build.compiler.__wrapped__() == found


def test_the_folder_of_compiled_functions_is_what_is_set_or_the_users(monkeypatch):
    monkeypatch.setenv("SLIPCTL_CACHE", "/a/b")
    monkeypatch.setenv("XDG_CACHE_HOME", "/x")
    assert build.cache_folder() == Path("/a/b")
    monkeypatch.delenv("SLIPCTL_CACHE")
    assert build.cache_folder() == Path("/x/slipctl")
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", "/h")
    assert build.cache_folder() == Path("/h/.cache/slipctl")


@pytest.mark.skipif(build.compiler() is None, reason="needs a C compiler")
def test_a_library_that_is_damaged_is_built_again(tmp_path, monkeypatch, caplog):
    monkeypatch.setenv("SLIPCTL_CACHE", str(tmp_path / "cache"))
    x, u, p = (ca.SX.sym(k, n) for k, n in (("x", 1), ("u", 1), ("p", 0)))
    f = ca.Function("roll", [x, u, p], [x + u, 2 * x])

    def runs(roller):
        y, log = np.empty((3, 1)), np.empty((3, 1))
        assert roller.roll(np.ones(1), np.array([[1.0], [2.0], [4.0]]), np.zeros(0), log, y) == 3
        return y[:, 0].tolist()

    assert runs(build.compile_roller(f, 3)) == [2, 4, 8]
    (library,) = (tmp_path / "cache").glob("*.so")
    whole = library.read_bytes()
    before = library.stat().st_mtime_ns
    assert runs(build.compile_roller(f, 3)) == [2, 4, 8]
    assert library.stat().st_mtime_ns == before
    copy = tmp_path / "copy.so"  # the library itself is loaded: another file takes its place
    copy.write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
    os.replace(copy, library)
    assert runs(build.compile_roller(f, 3)) == [2, 4, 8]
    assert "damaged" in caplog.text
    assert build._whole(library, library.stem)


def test_what_cannot_be_compiled_goes_on_without(tmp_path, monkeypatch, caplog):
    monkeypatch.setenv("SLIPCTL_CACHE", str(tmp_path / "cache"))
    x = ca.SX.sym("x")
    f = ca.Function("roll", [x, ca.SX.sym("u"), ca.SX.sym("p", 0)], [x, x])
    monkeypatch.setattr(build, "compiler", lambda: "/bin/cc")
    monkeypatch.setattr(build, "_compiler_version", lambda cc: "1")
    for done, says in ((SimpleNamespace(returncode=1, stderr="first\nsecond"), "first"),
                       (SimpleNamespace(returncode=7, stderr=""), "code 7")):  # fmt: skip
        monkeypatch.setattr(build.subprocess, "run", lambda *a, done=done, **k: done)
        caplog.clear()
        assert build.compile_roller(f, 3) is None
        assert says in caplog.text
        assert "second" not in caplog.text
    assert list((tmp_path / "cache").iterdir()) == []
    monkeypatch.setattr(build, "compiler", lambda: None)
    assert build.compile_roller(f, 3) is None


# ---- one writer of a folder ----------------------------------------------------------------------


locks = pytest.mark.skipif(store.fcntl is None, reason="this system has no locks of folders")


@locks
def test_a_folder_has_one_writer_until_it_is_closed(tmp_path):
    with store.FolderLock(tmp_path) as first:
        assert first._handle in store._HELD
        with pytest.raises(BadInput):
            store.FolderLock(tmp_path)
        (tmp_path / "other").mkdir()
        store.FolderLock(tmp_path / "other").close()
    assert first._handle is None
    again = store.FolderLock(tmp_path)
    again.close()
    again.close()  # once more changes nothing
    store.FolderLock(tmp_path).close()
    assert list(tmp_path.iterdir()) == [tmp_path / "other"]


@locks
def test_a_drive_without_locks_refuses_nobody(tmp_path, monkeypatch):
    held = set(store._HELD)
    closed = []
    real = os.close
    monkeypatch.setattr(store.os, "close", lambda handle: closed.append(handle) or real(handle))

    def none(*_):
        raise OSError(95, "not supported")

    monkeypatch.setattr(store.fcntl, "flock", none)
    lock = store.FolderLock(tmp_path)
    assert lock._handle is None
    assert len(closed) == 1
    assert held == store._HELD
    lock.close()
    monkeypatch.setattr(store, "fcntl", None)
    assert store.FolderLock(tmp_path)._handle is None
    assert len(closed) == 1


@locks
def test_a_process_that_is_forked_keeps_no_folder(tmp_path, monkeypatch):
    monkeypatch.setattr(store, "_HELD", set())
    lock = store.FolderLock(tmp_path)
    handle = lock._handle
    assert {handle} == store._HELD
    store._give_up()
    assert set() == store._HELD
    with pytest.raises(OSError, match="descriptor"):
        os.fstat(handle)
    lock.close()
    store.FolderLock(tmp_path).close()  # it is free


def test_a_folder_that_cannot_be_written_is_refused_before(tmp_path, monkeypatch):
    store.check_folder(tmp_path / "a" / "b")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "file").write_text("x", encoding="utf-8")
    for place in (tmp_path / "file", tmp_path / "file" / "b"):
        with pytest.raises(BadInput, match="not a folder"):
            store.check_folder(place)
    monkeypatch.setattr(store.os, "access", lambda place, how: place != tmp_path)
    with pytest.raises(BadInput, match="no permission"):
        store.check_folder(tmp_path / "a")


def test_formats_of_files_are_numbers_up_to_ours():
    for good in (1, store.FORMAT, np.int64(1), np.float64(store.FORMAT)):
        store.check_format("a file", good)
    for wrong in (None, "1", 1.5, np.float64(1.5), store.FORMAT + 1, [1]):
        with pytest.raises(BadInput, match="a file"):
            store.check_format("a file", wrong)


# ---- columns at ticks ----------------------------------------------------------------------------


def test_a_column_is_held_between_its_samples_and_told_where_it_says_nothing(monkeypatch):
    log = SimpleNamespace(time=np.array([0.0, 1.0, 2.0, 3.0]))
    source = object.__new__(log_signals.Source)
    values = np.array([5.0, np.nan, 7.0, np.inf])
    monkeypatch.setattr(log_signals.Source, "values", lambda self, log: values)
    ticks = np.array([0.0, 0.5, 1.5, 2.0, 2.5])
    keep = np.array([True, True, True, True, False])
    found = source.at(log, ticks, "hold", keep)
    assert found[:4].tolist() == [5, 5, 5, 7]
    assert np.isnan(found[4])
    found = source.at(log, ticks, "linear", keep)
    assert found[:4].tolist() == [5, 5.5, 6.5, 7]
    values = np.full(4, np.nan)
    assert np.isnan(source.at(log, ticks, "hold", keep)).all()
    assert len(source.at(log, ticks, "hold", keep)) == 5
