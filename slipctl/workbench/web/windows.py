"""Windows of the page: each has its own processes, which are ended when they take too long."""

from __future__ import annotations

import math
import multiprocessing
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from slipctl.workbench.curves import frame
from slipctl.workbench.questions import KINDS, LANES
from slipctl.workbench.sources.openings import Opening

LIMITS = {"slow": 300.0, "command": math.inf}
"""Seconds that work may take which compiles or counts; a command ends when it is stopped."""

MOST_LOST = 3
"""Processes that may end one after the other before one has answered; no more are begun."""

Send = Callable[[str, bytes], None]
"""Called, from a thread, with the kind of an answer and its frame."""


def _serve(*given: Any) -> None:
    """What a process does; the server itself does not load what answers."""
    from slipctl.workbench.web.worker import serve

    serve(*given)


def process_context() -> Any:
    """How processes are begun: forked off a server that has loaded slipctl, where there is one."""
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    made = multiprocessing.get_context("forkserver")
    made.set_forkserver_preload(["slipctl.workbench.web.worker"])
    return made


class Worker:
    """A process that answers, seen from the server.

    Args:
        opening: what is open. send: gets the answers. limited: whether its memory is.
    """

    def __init__(self, opening: Opening, send: Send, limited: bool = True) -> None:
        self.opening, self.send, self.limited = opening, send, limited
        self._lock = threading.Condition()
        self._waiting: dict[str, Mapping[str, Any]] = {}
        self._step: tuple[str, float] | None = None
        self._closed = False
        self._lost = 0
        self._begin()
        threading.Thread(target=self._write, daemon=True).start()
        threading.Thread(target=self._watch, daemon=True).start()

    def _begin(self) -> None:
        context = process_context()
        here, there = context.Pipe()
        o = self.opening
        self._process = context.Process(
            target=_serve,
            args=(there, o.name, o.folder, o.files, o.compile, self.limited),
            daemon=True,
        )
        self._process.start()
        there.close()
        self._pipe, self._step = here, None
        threading.Thread(target=self._read, args=(here,), daemon=True).start()

    @property
    def pid(self) -> int | None:
        """Of the process that is there now."""
        pid: int | None = self._process.pid
        return pid

    def ask(self, request: Mapping[str, Any]) -> None:
        """Hand on a question; a newer one of a kind replaces one that still waits."""
        with self._lock:
            self._waiting[str(request.get("kind"))] = request
            self._lock.notify_all()

    def close(self) -> None:
        """End the process."""
        with self._lock:
            self._closed = True
            self._lock.notify_all()
        self._process.kill()
        self._process.join(5)

    def _write(self) -> None:
        """Hand questions to the process: a pipe that is full stops this thread alone."""
        while True:
            with self._lock:
                while not self._waiting and not self._closed:
                    self._lock.wait()
                if self._closed:
                    return
                kind = next(iter(self._waiting))
                request, pipe = self._waiting.pop(kind), self._pipe
            try:
                pipe.send(request)
            except (OSError, ValueError):
                time.sleep(0.05)  # the process has ended; a new one begins

    def _read(self, pipe: Any) -> None:
        """Take what the process says, until it ends."""
        while True:
            try:
                said = pipe.recv()
            except (EOFError, OSError):
                break
            self._lost = 0 if said[0] == "idle" else self._lost
            if said[0] == "frame":
                kind = self._step[0] if self._step else "model"
                self.send(kind, said[1])
            elif said[0] == "step":
                self._step = (said[1], time.monotonic())
            else:
                self._step = None
        with self._lock:
            if self._closed or pipe is not self._pipe:
                return
            kind = self._step[0] if self._step else ""
            self._lost += 1
            self._closed = self._lost > MOST_LOST
            self._lock.notify_all()
        if self._closed:
            self._say(kind or "model", "what answers ends at once; the terminal says why")
            return
        self._say(kind, "the process that answers has ended; a new one has begun")
        self._begin()

    def _watch(self) -> None:
        """End a process whose piece of work takes too long."""
        while not self._closed:
            time.sleep(min(self.opening.patience / 4, 0.5))
            step = self._step
            if step is None:
                continue
            kind, since = step
            limit = LIMITS.get(LANES.get(kind, "first"), self.opening.patience)
            if time.monotonic() - since > limit:
                self._step = None
                self._say(kind, f"it took longer than {limit:g} s and was stopped")
                with self._lock:
                    if self._closed:
                        return
                    self._waiting.pop(kind, None)
                    old, pipe = self._process, self._pipe
                    self._begin()
                old.kill()
                pipe.close()

    def _say(self, kind: str, text: str) -> None:
        if kind:
            self.send(kind, frame({"kind": kind, "id": 0, "end": True, "faults": [text],
                                   "stopped": True}))  # fmt: skip


@dataclass
class Window:
    """Processes of a window: one for what is edited, one for what takes long, one for commands.

    Attributes:
        opening: what is open. send: gets the answers.
    """

    opening: Opening
    send: Send
    _workers: dict[str, Worker] = field(default_factory=dict)

    def ask(self, request: Mapping[str, Any]) -> None:
        """Hand on a question."""
        lane = LANES.get(str(request.get("kind")), "first")
        if lane not in self._workers:
            self._workers[lane] = Worker(
                self.opening, lambda kind, data: self.send(kind, data), limited=lane == "first"
            )
        self._workers[lane].ask(request)

    def warm(self) -> Window:
        """The same, with a process that already reads what is open."""
        if "first" not in self._workers:
            self.ask({"kind": "model", "id": 0})
        return self

    def processes(self) -> list[int]:
        """Numbers of its processes."""
        return [w.pid for w in self._workers.values() if w.pid]

    def close(self) -> None:
        """End its processes."""
        for worker in self._workers.values():
            worker.close()
        self._workers.clear()


assert set(LANES) <= set(KINDS)
