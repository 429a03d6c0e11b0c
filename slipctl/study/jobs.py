"""Jobs on all cores, in processes that are forked, so that a job sees what its parent has.

A process that has done a job takes the next one; making a process for each would take a tenth of
the time of a run. A job may have jobs itself (an experiment and its parts). All of them share the
cores by tokens, as ``make`` does: a process has one token, lends it to its first job, and takes
more where there are some. Where processes cannot be forked (Windows, macOS) jobs are done one after
another; the numbers are the same, because no job knows of another.
"""

from __future__ import annotations

import gc
import logging
import multiprocessing
import os
import signal
import sys
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import Any, Generic, TypeVar

from slipctl.errors import BadInput, RunFailed
from slipctl.run import interrupts, machine
from slipctl.run.results import NotRun
from slipctl.study.failures import reason

log = logging.getLogger("slipctl")

T = TypeVar("T")

Tell = Callable[[float], None]
"""Called by a job with the share of it that is done, 0 to 1."""

Job = Callable[[Tell], T]

STOPS = {signal.SIGINT, signal.SIGTERM}
"""What stops a process from outside."""

GRACE = 0.5
"""Time in s that a job has to stop before it is killed."""


@dataclass(frozen=True)
class Outcome(Generic[T]):
    """What a job gave: a value, or what ended it, ``NotRun`` or ``RunFailed`` with its reason."""

    value: T | None = None
    error: Exception | None = None

    def get(self) -> T:
        """Value of the job.

        Raises:
            NotRun, RunFailed: it gave none.
        """
        if self.error is not None:
            raise self.error
        return self.value  # type: ignore[return-value]


def available() -> int:
    """Cores that this process may use; 1 where processes cannot be forked."""
    if not hasattr(os, "fork") or sys.platform == "darwin":
        return 1
    return machine.cores()


class Cores:
    """Tokens of the cores that are not in use, shared by all processes that are forked from here.

    Args:
        count: how many cores; 1 does all jobs in this process. None: all there are.
    """

    def __init__(self, count: int | None = None) -> None:
        if count is not None and count < 1:
            raise BadInput(f"--jobs {count}: write how many processes may run, 1 or more")
        self.count = min(available(), 64) if count is None else count if available() > 1 else 1
        self._tokens, self._alive = (-1, -1), (-1, -1)
        if self.count > 1:
            self._tokens, self._alive = os.pipe(), os.pipe()
            os.set_blocking(self._tokens[0], False)
            os.write(self._tokens[1], b"." * (self.count - 1))

    def borrow(self) -> bool:
        """Take a token, if there is one."""
        try:
            return bool(os.read(self._tokens[0], 1))
        except BlockingIOError:
            return False

    def give_back(self) -> None:
        """Put a token back."""
        os.write(self._tokens[1], b".")

    def close(self) -> None:
        """Free what it holds; no job may run any more."""
        for end in {*self._tokens, *self._alive} - {-1}:
            os.close(end)
        self._tokens, self._alive, self.count = (-1, -1), (-1, -1), 1

    def __enter__(self) -> Cores:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def adopt(self) -> None:
        """In a forked process: end it when the first process is gone, however that ended."""
        if self._alive[1] != -1:
            os.close(self._alive[1])
            self._alive = (self._alive[0], -1)
        threading.Thread(target=self._watch, daemon=True).start()

    def _watch(self) -> None:
        os.read(self._alive[0], 1)  # nobody writes: it returns when the last writer is gone
        os._exit(1)


def run_jobs(
    jobs: Mapping[str, Job[T]],
    cores: Cores,
    tell: Callable[[str, float], None],
    meanwhile: Callable[[], object] = lambda: None,
) -> Generator[tuple[str, Outcome[T]], None, None]:
    """Do all jobs; give each outcome as it comes.

    Whoever leaves before the end closes it, so that no process is left behind.

    Args:
        jobs: by name, in the order in which they start.
        cores: what they share.
        tell: told the share done of a job.
        meanwhile: done once in this process, while the last jobs run; they do not see it.
    """
    if cores.count == 1 or not jobs:
        meanwhile()
        for name, job in jobs.items():
            yield name, _attempt(job, lambda share, name=name: tell(name, share))  # type: ignore[misc]
        return
    waiting, running = deque(jobs), dict[Connection, _Running]()
    beside = [meanwhile]
    free = 1  # tokens held that no job uses; this process came with its own
    try:
        while waiting or running:
            interrupts.check()
            while waiting and (free or cores.borrow()):
                free = max(free, 1)  # a borrowed one is held, also where no process can be made
                name = waiting.popleft()
                try:
                    started = _Running(name, jobs, cores, others=tuple(running))
                except OSError as error:
                    why = RunFailed(f"no process can be made for it: {error.strerror or error}")
                    yield name, Outcome(error=why)
                    continue
                running[started.pipe] = started
                free -= 1
                tell(name, 0.0)
            while free and running:  # none waits: others may use the core, also within a job
                cores.give_back()
                free -= 1
            if beside and not waiting:
                beside.pop()()
            watched: list[Any] = [*running, *([cores._tokens[0]] if waiting else [])]
            for pipe in wait(watched, timeout=1.0):
                if not isinstance(pipe, Connection):
                    continue
                job_ = running[pipe]
                kind, value = job_.hear()
                if kind == "share":
                    tell(job_.name, value)
                    continue
                name = job_.name
                if waiting and job_.take(waiting[0]):
                    tell(waiting.popleft(), 0.0)
                else:
                    del running[pipe]
                    job_.end()
                    free += 1
                yield name, value
    finally:
        with interrupts.hold_interrupts():  # a process that is left behind would go on writing
            _stop(list(running.values()))
            for _ in range(len(running) + free - 1):
                cores.give_back()


class _Running:
    """A process and the job that it does."""

    def __init__(
        self, name: str, jobs: Mapping[str, Job[Any]], cores: Cores,
        others: tuple[Connection, ...],
    ) -> None:  # fmt: skip
        self.name = name
        fork = multiprocessing.get_context("fork")
        self.pipe, theirs = fork.Pipe()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # idle threads of libraries
            self.process = fork.Process(
                target=_forked, args=(jobs, name, theirs, cores, (self.pipe, *others)), name=name
            )
            try:
                with _no_signals():  # the new process hears them when it knows what they mean
                    self.process.start()
            except BaseException:  # an interrupt too, that waited until the process was there
                self.pipe.close()
                if self.process.pid is not None:
                    _stop([self])
                raise
            finally:
                theirs.close()

    def hear(self) -> tuple[str, Any]:
        """Next message: the share done, or the outcome."""
        try:
            kind, value = self.pipe.recv()
            return kind, value
        except (EOFError, OSError):
            self.process.join()
            code = self.process.exitcode
            why = RunFailed(f"its process ended with code {code}, out of memory perhaps")
            return "done", Outcome(error=why)

    def take(self, name: str) -> bool:
        """Hand the process, which has done its job, the next one; False where it is gone."""
        try:
            self.pipe.send(name)
        except OSError:
            return False
        self.name = name
        return True

    def end(self) -> None:
        """Wait for the process, which has nothing left to do."""
        self.pipe.close()
        self.process.join()


@contextmanager
def _no_signals() -> Iterator[None]:
    """Hold back what stops a process, until the end of the block."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, STOPS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _stop(running: list[_Running]) -> None:
    """End processes: first asked, then killed."""
    for job in running:
        job.pipe.close()
        job.process.terminate()
    deadline = time.monotonic() + GRACE
    for job in running:
        job.process.join(max(deadline - time.monotonic(), 0.0))
        if job.process.is_alive():
            job.process.kill()
            job.process.join()


def _forked(
    jobs: Mapping[str, Job[Any]], name: str, pipe: Connection, cores: Cores,
    others: tuple[Connection, ...],
) -> None:  # fmt: skip
    """Do jobs in this process, one after the other; leave without a word when asked to."""
    gc.freeze()  # what the first process made is no garbage; looking at it would copy its pages

    def leave(number: int, frame: Any) -> None:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # once is enough
        raise KeyboardInterrupt

    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent hears it and ends this process
    signal.signal(signal.SIGTERM, leave)
    with suppress(KeyboardInterrupt):
        if hasattr(signal, "pthread_sigmask"):
            signal.pthread_sigmask(signal.SIG_UNBLOCK, STOPS)
        for other in others:
            other.close()
        cores.adopt()
        with pipe, suppress(EOFError, ConnectionError):  # the parent has nothing left to do
            while True:
                _send(jobs[name], pipe)
                name = pipe.recv()
        signal.signal(signal.SIGTERM, signal.SIG_IGN)


def _send(job: Job[Any], pipe: Connection) -> None:
    """Do a job and send what it gives."""
    last = 0.0

    def tell(share: float) -> None:
        nonlocal last
        if time.monotonic() - last > 0.1:
            last = time.monotonic()
            pipe.send(("share", share))

    outcome = _attempt(job, tell)
    try:
        pipe.send(("done", outcome))
    except ConnectionError:
        raise
    except Exception as error:
        fault = RunFailed(f"its result cannot be sent: {error}")
        pipe.send(("done", Outcome(error=fault)))


def _attempt(job: Job[T], tell: Tell) -> Outcome[T]:
    """Do a job; what breaks is said here, where its traceback is."""
    try:
        return Outcome(value=job(tell))
    except NotRun as missing:
        return Outcome(error=type(missing)(str(missing)))
    except (Exception, SystemExit, GeneratorExit) as error:  # sys.exit() in somebody's file
        log.debug("a job broke", exc_info=True)
        return Outcome(error=RunFailed(reason(error)))
