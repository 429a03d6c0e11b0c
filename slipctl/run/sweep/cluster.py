"""Runs of a sweep on the workers of a Dask scheduler.

A task is a batch of runs. Workers give what their runs gave; this process alone writes it, as it
arrives. A batch of a worker that is lost is rolled by another one.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping
from itertools import islice
from threading import Lock
from typing import TYPE_CHECKING, Any

from slipctl.block import portable
from slipctl.errors import BadInput, RunFailed
from slipctl.run import machine
from slipctl.run.sweep.sweep_plan import Plan
from slipctl.run.sweep.sweep_store import Ended

if TYPE_CHECKING:
    from slipctl.run.sweep.sweep_runs import Measured

BATCH = 16
"""Most runs of a task: a task takes the scheduler some ms, a run tens of them."""

AHEAD = 3
"""Tasks for each thread of a worker that are sent before one of them has ended."""

ANSWER = 10.0
"""Time in s within which a scheduler answers."""

WORKERS = 60.0
"""Time in s within which it has a worker."""

LOST = 5
"""Times that a batch is sent again when the scheduler gives it up, each for several workers."""

MIXED = "--mixed lets it compute"

_built: dict[str, tuple[Measured, str]] = {}
_lock = Lock()


def roll_on_worker(
    recipe: bytes, told: Mapping[str, Any], mixed: bool, plan: Plan, runs: list[int]
) -> tuple[str, str, list[Ended]]:
    """On a worker: why it may not compute, its processor, and what the runs gave."""
    mine = machine.versions()
    for name, version in mine.items():
        if version != told[name]:
            return f"has {name} {version}, here it is {told[name]}; install the same", "", []
    processor = machine.processor()
    if processor != told["processor"] and not mixed:
        return f"has another processor ({processor}, here {told['processor']}); {MIXED}", "", []
    measured, numbers = _measured(recipe)
    if numbers != told["numbers"] and not mixed:
        return f"computes other numbers than this machine; {MIXED}", "", []
    return "", processor, [measured.ended(k, plan.numbers(k)) for k in runs]


def _measured(recipe: bytes) -> tuple[Measured, str]:
    """The loop, built once in a worker, and how the worker computes."""
    key = hashlib.sha256(recipe).hexdigest()
    with _lock:
        if key not in _built:
            _built.clear()  # a worker serves one sweep after another
            measured: Measured = portable.loads(recipe)
            _built[key] = measured, measured.fingerprint()
        return _built[key]


def run_all(
    run: Measured, plan: Plan, missing: Iterator[int], total: int,
    keep: Callable[[list[Ended]], None], scheduler: str, told: Mapping[str, Any],
    mixed: Callable[[list[str]], None] | None,
) -> None:  # fmt: skip
    """Let workers roll what is missing, and keep it as it arrives.

    Args:
        run, plan, missing, total: what is rolled, and how much of it.
        keep: keeps what ended. scheduler: its address. told: what the store says of the sweep.
        mixed: told of processors of another kind; None refuses them.

    Raises:
        BadInput: the extra is missing, no scheduler answers, a worker of another machine.
        RunFailed: the scheduler was lost, or worker after worker.
    """
    client = _connected(scheduler)
    try:
        _roll_all(client, run, plan, missing, total, keep, told, mixed)
    finally:
        client.close(timeout=ANSWER)


def _connected(scheduler: str) -> Any:
    try:
        from distributed import Client
    except ImportError:
        raise BadInput("--scheduler needs the extra dask: pip install 'slipctl[dask]'") from None
    try:
        client = Client(scheduler, timeout=ANSWER, set_as_default=False)
    except (OSError, ValueError, TypeError, ImportError):
        raise BadInput(
            f"--scheduler {scheduler}: no Dask scheduler answers there; start one by dask"
            " scheduler, its workers by dask worker, and write its address, tcp://host:8786"
        ) from None
    try:
        client.wait_for_workers(1, timeout=WORKERS)
    except TimeoutError:
        client.close(timeout=ANSWER)
        raise BadInput(
            f"--scheduler {scheduler} has no worker; start one by dask worker {scheduler}"
        ) from None
    return client


def _roll_all(
    client: Any, run: Measured, plan: Plan, missing: Iterator[int], total: int,
    keep: Callable[[list[Ended]], None], told: Mapping[str, Any],
    mixed: Callable[[list[str]], None] | None,
) -> None:  # fmt: skip
    from distributed import KilledWorker, as_completed

    threads = max(sum(client.nthreads().values()), 1)
    size = max(1, min(BATCH, total // (4 * threads)))
    # the result of a task, as what was merely sent is lost with the worker that holds it
    recipe = client.submit(bytes, portable.dumps(run), pure=False)
    few = {k: told[k] for k in (*machine.versions(), "processor", "numbers")}

    def sent(runs: list[int]) -> Any:
        future = client.submit(roll_on_worker, recipe, few, bool(mixed), plan, runs, pure=False)
        batches[future.key] = runs
        return future

    def batch() -> Iterator[list[int]]:
        while runs := list(islice(missing, size)):
            yield runs

    batches: dict[str, list[int]] = {}
    more, given_up = batch(), 0
    waiting = as_completed([sent(runs) for runs in islice(more, AHEAD * threads)], loop=client.loop)
    for future in waiting:
        runs = batches.pop(future.key)
        if future.status in ("lost", "pending"):  # its worker died with it: it is rolled again
            batches[future.key] = runs
            waiting.add(future)
            continue
        error = future.exception() if future.status == "error" else None
        if isinstance(error, KilledWorker) and given_up < LOST:
            given_up += 1
            waiting.add(sent(runs))
            continue
        if future.status != "finished":
            why = f"{type(error).__name__}: {error}" if error else "the scheduler was lost"
            raise RunFailed(f"{why}; what had ended is kept, and the same command resumes it")
        refused, processor, found = future.result()
        if refused:
            raise BadInput(f"--scheduler: a worker {refused}")
        keep(found)
        if mixed:
            mixed([processor])
        future.release()
        for runs in islice(more, 1):
            waiting.add(sent(runs))
