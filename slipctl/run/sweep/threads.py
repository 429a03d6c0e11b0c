"""Tasks on threads: who asks for them alone keeps what ends, also where a person stops them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from itertools import islice
from threading import Event
from typing import TypeVar

from slipctl.run import interrupts

Task = TypeVar("Task")
Ended = TypeVar("Ended")

AHEAD = 4
"""Tasks for each thread that are handed over before one of them has ended."""


def run_tasks(
    tasks: Iterator[Task], one: Callable[[Task], Ended], jobs: int,
    keep: Callable[[list[Ended]], None],
) -> None:  # fmt: skip
    """Do tasks on so many threads; ``keep`` is called here with what has ended.

    What is being done when it is stopped is kept too.
    """
    stop = Event()

    def unless_stopped(task: Task) -> Ended | None:
        return None if stop.is_set() else one(task)

    def kept(ended: Iterable[Future[Ended | None]]) -> None:
        keep([e for e in (f.result() for f in ended) if e is not None])

    pool = ThreadPoolExecutor(jobs)
    waiting = {pool.submit(unless_stopped, t) for t in islice(tasks, AHEAD * jobs)}
    try:
        while waiting:
            ended, waiting = wait(waiting, return_when=FIRST_COMPLETED)
            kept(ended)
            waiting |= {pool.submit(unless_stopped, t) for t in islice(tasks, len(ended))}
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            interrupts.note_interrupt()
        stop.set()
        pool.shutdown(wait=True, cancel_futures=True)
        kept(f for f in waiting if f.done() and not f.cancelled())
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
