"""Stop when a person asks for it: Ctrl-C or SIGTERM, at once but never within a file.

An interrupt is raised as ``KeyboardInterrupt``. A library may swallow it (CasADi clears what is
raised in a property that it reads), so it is raised again until somebody says
:func:`note_interrupt`.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

AGAIN = 0.1
"""Time in s after which an interrupt that nobody heard is raised again."""

KEPT = "all finished results are written"
"""What a stopped command says, where it is so."""


class _State:
    """What was asked for, and how many files are being written."""

    listening = False
    asked = False  # and not heard yet
    stopped = False  # at any time
    whole = 0


def _ask(number: int, frame: FrameType | None) -> None:
    _State.asked = _State.stopped = True
    if _State.listening and hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_REAL, AGAIN)
    if not _State.whole:
        raise KeyboardInterrupt


@contextmanager
def raise_interrupts() -> Iterator[None]:
    """Raise Ctrl-C and SIGTERM as ``KeyboardInterrupt``, until :func:`note_interrupt`."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    known = ("SIGINT", "SIGTERM", "SIGALRM")
    numbers: list[Any] = [getattr(signal, n) for n in known if hasattr(signal, n)]
    before = {n: signal.getsignal(n) for n in numbers}
    ignored = [n for n in numbers if before[n] is signal.SIG_IGN]  # as nohup wants it
    for n in numbers:
        if n not in ignored:
            signal.signal(n, _ask)
    _State.listening, _State.asked, _State.stopped = True, False, False
    told, sys.unraisablehook = sys.unraisablehook, _unraisable
    try:
        yield
        check()
    except Exception:
        check()  # what an interrupt was turned into, by an import of a library for one
        raise
    finally:
        note_interrupt()
        _State.listening = False
        sys.unraisablehook = told
        for n, handler in before.items():
            signal.signal(n, signal.SIG_DFL if handler is None else handler)


def _unraisable(what: sys.UnraisableHookArgs) -> None:
    """Say what could not be raised where it happened.

    An interrupt is raised again, and what it left half made cannot end as it should.
    """
    if not _State.stopped and not issubclass(what.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(what)


def note_interrupt() -> None:
    """Say that the interrupt has arrived; it is not raised again."""
    if _State.listening and hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    _State.asked = False


def check() -> None:
    """Raise an interrupt that was asked for and swallowed.

    Raises:
        KeyboardInterrupt: it was.
    """
    if _State.asked and not _State.whole:
        raise KeyboardInterrupt


@contextmanager
def hold_interrupts() -> Iterator[None]:
    """Let an interrupt wait until a file is whole; not all libraries that write can be broken."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.getsignal(signal.SIGINT)
    ours = before is not _ask and before not in (None, signal.SIG_IGN)
    if ours:
        signal.signal(signal.SIGINT, _ask)
    _State.whole += 1
    try:
        yield
    finally:
        _State.whole -= 1
        if ours:
            signal.signal(signal.SIGINT, before)
        if not _State.whole and _State.asked:
            _State.asked = _State.listening  # whoever listens says that it was heard
            raise KeyboardInterrupt
