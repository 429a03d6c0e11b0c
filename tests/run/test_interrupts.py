"""Interrupts are raised at once, but never within a file; signals are sent to this process."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from contextlib import suppress
from types import SimpleNamespace

import pytest

from slipctl.run import interrupts
from slipctl.run.interrupts import check, hold_interrupts, note_interrupt, raise_interrupts


@pytest.fixture(autouse=True)
def _as_before():
    """Nobody listens, interrupts are not ignored; afterwards the process has its own handlers."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)
    before = {n: signal.getsignal(n) for n in numbers}
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may have it ignored
    state = {k: getattr(interrupts._State, k) for k in ("listening", "asked", "stopped", "whole")}
    yield
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    for n, handler in before.items():
        signal.signal(n, handler)
    for k, v in state.items():
        setattr(interrupts._State, k, v)


def interrupt(number: int = signal.SIGINT) -> None:
    os.kill(os.getpid(), number)
    for _ in range(100):  # the handler runs between two steps of Python
        time.sleep(0)


def swallowed() -> None:
    with suppress(KeyboardInterrupt):
        interrupt()


def test_an_interrupt_waits_until_a_file_is_whole() -> None:
    """However many files are within each other; the handler is as before."""
    before = signal.getsignal(signal.SIGINT)
    done = []

    def write() -> None:
        with hold_interrupts():
            with hold_interrupts():
                interrupt()
                done.append("inner")
            check()  # not yet
            done.append("outer")

    with pytest.raises(KeyboardInterrupt):
        write()
    assert done == ["inner", "outer"]
    assert signal.getsignal(signal.SIGINT) is before
    assert interrupts._State.whole == 0
    check()  # it was raised, and nobody listens: it is not raised again


def test_without_an_interrupt_a_file_is_written_as_ever() -> None:
    before = signal.getsignal(signal.SIGINT)
    with hold_interrupts():
        assert signal.getsignal(signal.SIGINT) is interrupts._ask
    assert signal.getsignal(signal.SIGINT) is before
    with pytest.raises(ValueError, match="own"), hold_interrupts():
        raise ValueError("own")
    assert interrupts._State.whole == 0
    assert signal.getsignal(signal.SIGINT) is before


def test_who_ignores_interrupts_goes_on_to() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with hold_interrupts():
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
        interrupt()
    assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    with raise_interrupts():
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
        assert signal.getsignal(signal.SIGTERM) is interrupts._ask
        interrupt()
    assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_who_listens_is_interrupted_at_once(number) -> None:
    before = signal.getsignal(number)
    done = []

    def work() -> None:
        with raise_interrupts():
            interrupt(number)
            done.append("it goes on")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert done == []
    assert signal.getsignal(number) is before
    assert not interrupts._State.listening
    check()


def test_an_interrupt_that_was_swallowed_is_raised_again() -> None:
    """At the end, or where somebody asks; unless it is said to have been heard."""
    done = []

    def ends() -> None:
        with raise_interrupts():
            swallowed()
            done.append("end")

    def asks() -> None:
        with raise_interrupts():
            swallowed()
            check()
            done.append("it goes on")

    def turned() -> None:
        with raise_interrupts():
            try:
                interrupt()
            except KeyboardInterrupt:
                raise RuntimeError("a library made this of it") from None

    for work in (ends, asks, turned):
        with pytest.raises(KeyboardInterrupt):
            work()
    assert done == ["end"]
    with raise_interrupts():
        swallowed()
        note_interrupt()
        check()
    with pytest.raises(ValueError, match="own"), raise_interrupts():
        raise ValueError("own")


def test_a_listener_hears_at_the_end_of_a_file_what_was_asked_within_it() -> None:
    """And again where that was swallowed."""
    asked = []

    def work() -> None:
        with raise_interrupts():
            with suppress(KeyboardInterrupt), hold_interrupts():
                interrupt()
            asked.append(interrupts._State.asked)
            check()
            asked.append("it goes on")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert asked == [True]


def test_another_thread_holds_and_listens_to_nothing() -> None:
    seen = []

    def work():
        before = signal.getsignal(signal.SIGINT)
        with raise_interrupts(), hold_interrupts():
            seen.append(signal.getsignal(signal.SIGINT) is before)
            seen.append((interrupts._State.listening, interrupts._State.whole))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [True, (False, 0)]


def test_what_an_interrupt_left_half_made_is_not_told(monkeypatch) -> None:
    """Other errors that cannot be raised are, until somebody was stopped."""
    told = []
    monkeypatch.setattr(sys, "__unraisablehook__", told.append)
    error, stop = (SimpleNamespace(exc_type=t) for t in (ValueError, KeyboardInterrupt))
    for stopped, wanted in ((False, [error]), (True, [])):
        interrupts._State.stopped = stopped
        told.clear()
        interrupts._unraisable(error)
        interrupts._unraisable(stop)
        assert told == wanted
    before = sys.unraisablehook
    with raise_interrupts():
        assert sys.unraisablehook is interrupts._unraisable
        assert not interrupts._State.stopped
    assert sys.unraisablehook is before


def test_an_interrupt_that_nobody_hears_comes_again_by_itself() -> None:
    """After a tenth of a second, to who listens; a note of it stops that."""
    done = []

    def work() -> None:
        with raise_interrupts():
            swallowed()
            time.sleep(5)
            done.append("it goes on")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert done == []
    with raise_interrupts():
        swallowed()
        note_interrupt()
        assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
    with suppress(KeyboardInterrupt), hold_interrupts():
        interrupt()  # nobody listens: no alarm is set
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
