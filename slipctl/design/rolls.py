"""Runs of candidates on draws: on all cores, kept as they end, so that nothing is run twice."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from slipctl.errors import BadInput, RunFailed
from slipctl.run import interrupts
from slipctl.run.metrics import Metric
from slipctl.run.sweep.ensemble import Draw, World
from slipctl.run.sweep.sweep_store import Ended, Store
from slipctl.run.sweep.threads import run_tasks

FILE = "runs.sqlite"
"""Name of the store in the folder of a search."""

MANY = 1_000_000
"""Draws of a stream, and candidates of a search, that a number of a run can tell apart."""

Asked = tuple[int, Mapping[str, float], int]
"""Number of a candidate, its numbers, number of the draw."""


class Rolls:
    """What runs candidates on the draws of a world.

    Args:
        world: loop, scenario and ensemble.
        jobs: runs at once.
        store: keeps what ends; None keeps it in memory only.

    Attributes:
        done: runs of the search itself, kept ones too.
        progress: told what goes on, and the share of its runs that have ended.
    """

    def __init__(self, world: World, jobs: int = 1, store: Store | None = None) -> None:
        self.world, self.jobs, self.store, self.done = world, jobs, store, 0
        self.progress: Callable[[str, float], None] = lambda stage, share: None
        self._stage, self._ended, self._runs = "", 0, 1
        self._draws: dict[tuple[int, int], Draw] = {}
        self._kept: dict[int, Mapping[str, Metric] | None] = {}
        if store is not None:
            units = store.units()
            for run, _, metrics, failed in store.runs():
                made = {n: Metric(v, *units[n]) for n, v in metrics.items()}
                self._kept[run] = None if failed else made

    def begin(self, stage: str, runs: int) -> None:
        """Say what the next runs are for, and how many there are at most."""
        self._stage, self._ended, self._runs = stage, 0, max(runs, 1)
        self.advance(0)

    def advance(self, runs: int = 1) -> None:
        """Say that so many of the runs have ended."""
        self._ended += runs
        if self._stage:
            self.progress(self._stage, min(self._ended / self._runs, 0.999))

    def end(self) -> None:
        """Say that what was begun has ended."""
        if self._stage:
            self.progress(self._stage, 1.0)

    def all(self, stream: int, asked: Sequence[Asked]) -> list[Mapping[str, Metric] | None]:
        """Metrics of each, None where the run failed; in their order, on all cores.

        A run that is refused or breaks is kept as failed.
        """
        keys = [((stream * MANY) + number + 1) * MANY + k for number, _, k in asked]
        missing = {key: a for key, a in zip(keys, asked, strict=True) if key not in self._kept}
        self.advance(len(keys) - len(missing))
        if missing:
            self._run(stream, missing)
        if stream == 0:
            self.done += len(asked)
        return [self._kept[key] for key in keys]

    def count(self, stream: int) -> int:
        """Runs of a stream that were kept."""
        return sum(key // MANY // MANY == stream for key in self._kept)

    def draw(self, stream: int, k: int) -> Draw:
        """Draw, made once."""
        if stream > 1:  # draws of a statement are used once
            return self.world.draw(stream, k)
        if (stream, k) not in self._draws:
            self._draws[stream, k] = self.world.draw(stream, k)
        return self._draws[stream, k]

    def _run(self, stream: int, missing: Mapping[int, Asked]) -> None:
        """Run on threads; this one alone writes, as runs end."""

        def one(task: tuple[int, Asked]) -> tuple[Ended, Mapping[str, Metric] | None]:
            key, (_, numbers, k) = task
            try:
                metrics = self.world.metrics(numbers, self.draw(stream, k))
                return Ended(key, numbers, metrics), metrics
            except (BadInput, RunFailed) as error:
                return Ended(key, numbers, failed=str(error)), None

        run_tasks(iter(missing.items()), one, self.jobs, self._keep)

    def _keep(self, found: list[tuple[Ended, Mapping[str, Metric] | None]]) -> None:
        if self.store is not None:
            with interrupts.hold_interrupts():
                self.store.add([e for e, _ in found])
        self._kept |= {e.run: metrics for e, metrics in found}
        self.advance(len(found))
