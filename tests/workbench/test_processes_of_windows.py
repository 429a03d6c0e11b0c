"""Processes of a window: how they are begun, watched, asked and ended; what answers is a stub."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from slipctl.workbench.sources.openings import Opening
from slipctl.workbench.web import windows, worker
from slipctl.workbench.web.windows import Window, Worker

OPENING = Opening("toy:pid", "folder", ("a.py",), False)


@pytest.fixture
def begun(monkeypatch) -> list[Any]:
    """What is begun, in its order, where processes, pipes and threads are stubs."""
    done: list[Any] = []
    threads = windows.threading

    def process(target: Any, args: Any, daemon: bool) -> Any:
        done.append((target.__name__, args[1:], daemon))
        number = sum(row[0] == "_serve" for row in done)
        return SimpleNamespace(
            start=lambda: done.append(f"start {number}"), pid=100 + number,
            kill=lambda: done.append(f"kill {number}"),
            join=lambda s: done.append((f"join {number}", s)),
        )  # fmt: skip

    def pipe() -> Any:
        here = SimpleNamespace(close=lambda: done.append("here closed"))
        there = SimpleNamespace(close=lambda: done.append("there closed"))
        return here, there

    context = SimpleNamespace(Process=process, Pipe=pipe)
    monkeypatch.setattr(windows, "process_context", lambda: context)
    started = SimpleNamespace(
        Condition=threads.Condition,
        Thread=lambda target, args=(), daemon=False: SimpleNamespace(
            start=lambda: done.append((target.__name__, daemon))
        ),
    )
    monkeypatch.setattr(windows, "threading", started)
    return done


def test_a_worker_begins_a_process_and_threads_that_read_write_and_watch(begun) -> None:
    """Its own end of the pipe alone stays open; when it is closed its process is ended."""
    made = Worker(OPENING, lambda kind, data: None, limited=False)
    assert begun == [
        ("_serve", ("toy:pid", "folder", ("a.py",), False, False), True), "start 1",
        "there closed", ("_read", True), ("_write", True), ("_watch", True),
    ]  # fmt: skip
    assert made.pid == 101
    made.ask({"kind": "run", "id": 1})
    made.ask({"kind": "model", "id": 2})
    made.ask({"kind": "run", "id": 3})
    assert made._waiting == {"run": {"kind": "run", "id": 3}, "model": {"kind": "model", "id": 2}}
    begun.clear()
    made.close()
    assert made._closed
    assert begun == ["kill 1", ("join 1", 5)]


@pytest.mark.parametrize(("kind", "limit"), [("run", 8.0), ("region", windows.LIMITS["slow"])])
def test_work_that_takes_too_long_is_ended_and_a_new_process_begun(
    kind, limit, begun, monkeypatch
) -> None:
    """What waits of its kind goes with it; work of another process has its own limit."""
    made = Worker(replace(OPENING, patience=8.0), lambda kind, data: None)
    said: list[Any] = []
    made._say = lambda kind, text: said.append((kind, text))  # type: ignore[method-assign]
    made._waiting = {kind: {"id": 1}, "other": {"id": 2}}
    clock = iter([limit - 0.01, limit + 0.01])
    slept: list[float] = []

    def sleep(seconds: float) -> None:
        slept.append(seconds)
        if len(slept) == 2:
            made._step = (kind, 0.0)
        made._closed = len(slept) > 3

    monkeypatch.setattr(
        windows, "time", SimpleNamespace(sleep=sleep, monotonic=lambda: next(clock))
    )
    before = len(begun)
    made._watch()
    assert slept == [0.5] * 4
    assert said == [(kind, f"it took longer than {limit:g} s and was stopped")]
    assert made._waiting == {"other": {"id": 2}}
    assert made._step is None
    assert begun[before][0] == "_serve"
    assert begun[before + 1 :] == [
        "start 2", "there closed", ("_read", True), "kill 1", "here closed"]  # fmt: skip


def test_what_a_process_does_is_to_serve_what_it_is_given(monkeypatch) -> None:
    served: list[Any] = []
    monkeypatch.setattr(worker, "serve", lambda *given: served.append(given))
    windows._serve("pipe", "toy:pid", "folder")
    assert served == [("pipe", "toy:pid", "folder")]


@pytest.mark.parametrize("methods", [["fork", "spawn", "forkserver"], ["spawn"]])
def test_processes_are_forked_off_a_server_where_there_is_one(methods, monkeypatch) -> None:
    loaded: list[Any] = []
    monkeypatch.setattr(windows, "multiprocessing", SimpleNamespace(
        get_all_start_methods=lambda: methods,
        get_context=lambda name: SimpleNamespace(
            name=name, set_forkserver_preload=lambda names: loaded.append(names)),
    ))  # fmt: skip
    there = "forkserver" in methods
    assert windows.process_context().name == ("forkserver" if there else "spawn")
    assert loaded == ([["slipctl.workbench.web.worker"]] if there else [])


def test_a_window_has_a_process_for_each_lane_and_only_the_first_is_limited(monkeypatch) -> None:
    made: list[Any] = []

    class Stub:
        def __init__(self, opening: Any, send: Any, limited: bool) -> None:
            self.opening, self.send, self.limited, self.asked = opening, send, limited, []
            self.pid = len(made) or None
            made.append(self)

        def ask(self, request: Any) -> None:
            self.asked.append(request["kind"])

        def close(self) -> None:
            self.asked.append("closed")

    monkeypatch.setattr(windows, "Worker", Stub)
    sent: list[Any] = []
    window = Window(OPENING, lambda kind, data: sent.append((1, kind, data)))
    assert window.warm() is window
    for kind in ("run", "region", "command", "verdict", "model"):
        window.ask({"kind": kind, "id": 1})
    window.warm()
    assert [w.asked for w in made] == [
        ["model", "run", "model"],
        ["region", "verdict"],
        ["command"],
    ]
    assert [w.limited for w in made] == [True, False, False]
    assert all(w.opening is OPENING for w in made)
    window.send = lambda kind, data: sent.append((2, kind, data))  # as after a reload
    made[1].send("region", b"x")
    assert sent == [(2, "region", b"x")]
    assert window.processes() == [1, 2]
    window.close()
    assert all(w.asked[-1] == "closed" for w in made)
    assert window.processes() == []
