"""A process that holds the prepared loops of a window and answers it, the latest question first."""

from __future__ import annotations

import gc
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

from slipctl.errors import BadInput
from slipctl.study import resolve
from slipctl.workbench.answers import Answers
from slipctl.workbench.curves import frame
from slipctl.workbench.questions import KINDS
from slipctl.workbench.sources.openings import answers_of_opening

MEMORY = 8 * 2**30
"""Bytes that a worker may ask for; a law that wants more is refused by the system."""


def serve(
    pipe: Connection, name: str, folder: str, files: Sequence[str], compile: bool = True,
    limited: bool = True,
) -> None:  # fmt: skip
    """Answer until the pipe is closed.

    What is sent: ``("step", kind)`` before each piece of work, ``("frame", bytes)``, ``("idle",)``.

    Args:
        pipe: questions in, answers out. name: what is open. folder: where files are written.
        files: Python files that may be imported; no others are.
        compile: compile loops where there is a compiler.
        limited: refuse more than :data:`MEMORY`. Where C is checked it is not: a sanitizer reserves
            addresses that it never uses.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if limited:
        _limit_memory()
    gc.set_threshold(100_000, 50, 100)
    resolve.load_only(files)
    try:
        answers = answers_of_opening(name, folder, compile)
    except BadInput as error:
        pipe.send(("frame", frame({"kind": "model", "id": 0, "end": True, "faults": [str(error)]})))
        return
    waiting: dict[str, Any] = {}
    going: dict[str, Iterator[bytes]] = {}
    with suppress(EOFError, BrokenPipeError, ConnectionResetError):
        while True:
            while pipe.poll(0 if waiting or going else None):
                request = pipe.recv()
                if request is None:
                    return
                waiting[str(request.get("kind"))] = request
            _step(pipe, answers, waiting, going)
            if not (waiting or going):
                pipe.send(("idle",))


def _step(
    pipe: Connection, answers: Answers, waiting: dict[str, Any], going: dict[str, Iterator[bytes]]
) -> None:
    """Do a piece of the most urgent work; a newer question of a kind ends the older one."""
    kind = min({*waiting, *going}, key=lambda k: KINDS.index(k) if k in KINDS else -1)
    pipe.send(("step", kind))
    if kind in waiting:
        if kind in going:
            going.pop(kind).close()  # type: ignore[attr-defined]
        going[kind] = answers.begin(waiting.pop(kind))
    piece = next(going[kind], None)
    if piece is None:
        del going[kind]
    elif piece:
        pipe.send(("frame", piece))


def _limit_memory() -> None:
    if sys.platform.startswith("linux"):
        import resource

        with suppress(ValueError, OSError):
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
