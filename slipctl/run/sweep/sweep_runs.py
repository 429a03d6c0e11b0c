"""Many runs of one loop: compiled once, rolled on all cores, kept as they end."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from slipctl.block.block import Block, as_block
from slipctl.errors import BadInput, RunFailed, check_known, check_whole
from slipctl.run import interrupts, machine
from slipctl.run import metrics as measures
from slipctl.run.logs.run_log import Log, log_columns
from slipctl.run.metrics import Run
from slipctl.run.preparation import prepare
from slipctl.run.rail import Scenario
from slipctl.run.results import Known, known_column
from slipctl.run.roles import Signals
from slipctl.run.sweep import sweep_store
from slipctl.run.sweep.sweep_plan import Plan, plan_of
from slipctl.run.sweep.sweep_results import Sweep, open_sweep
from slipctl.run.sweep.sweep_store import Ended, Store
from slipctl.run.sweep.threads import run_tasks

if TYPE_CHECKING:
    from slipctl.run.sweep.ensemble import World

MEASURED = tuple(n for n in measures.METRICS if n not in measures.AGAINST_OTHERS)
"""Metrics of a run that is alone: no other loop runs beside it."""


def sweep(
    loop: Block,
    scenario: Scenario,
    vary: Sequence[str] | Mapping[str, Sequence[float]],
    out: str | Path,
    *,
    samples: int = 1,
    seed: int = 1,
    design: str = "random",
    signals: Signals | None = None,
    known: Mapping[str, Known] | None = None,
    logs: Sequence[str] = (),
    jobs: int | None = None,
    compile: bool = True,
    progress: Callable[[float], None] | None = None,
    about: Mapping[str, Any] | None = None,
    world: World | None = None,
    scheduler: str = "",
    mixed: bool = False,
) -> Sweep:
    """Run a loop with many sets of numbers; what a folder holds already is not done again.

    Args:
        loop: the loop.
        scenario: what happens; its noise is the same in every run.
        vary: ``["ctl.k1=5:50:10", "m=28t:42t"]`` or ``{"ctl.k1": (5, 50, 10), "m": (28e3, 42e3)}``:
            (lo, hi, n) is a grid axis of n values, (lo, hi) a uniform draw.
        out: folder of the sweep.
        samples: runs of each point of the grid, where something is drawn; a larger number later
            extends the sweep.
        seed: of the draws.
        design: ``"random"``, ``"sobol"``, or ``"lhs"``, which cannot be extended.
        signals: what the metrics speak of.
        known: quantities that no block computes, as of a :class:`Case`.
        logs: signals of which each run keeps every tick, :meth:`Sweep.log`.
        jobs: runs at once; by default one for each core.
        compile: compile the loop when a C compiler is there.
        progress: called with the share done.
        about: what else a store of this sweep has to agree in.
        world: an ensemble of this loop and scenario; what it draws varies in every run.
        scheduler: address of a Dask scheduler, ``"tcp://host:8786"``, whose workers roll; needs the
            extra ``dask``. Each run is the same, bit by bit, as one rolled here.
        mixed: let machines with another processor or library of mathematics compute too. The
            store then says which there were.

    Returns:
        The sweep, to be looked at.

    Raises:
        BadInput: nothing to vary, an unknown name, a folder that holds another sweep, a scheduler
            that does not answer, a worker of another machine.
        RunFailed: the scheduler was lost, or worker after worker; what had ended is kept.
    """
    as_block("sweep: the loop", loop)
    if world is not None:
        loop = world.loop
    plan = plan_of(loop, scenario, vary, samples, seed, design, world.ranges if world else ())
    if jobs is not None:
        check_whole("--jobs", jobs, 1)
    run = Measured(
        loop, scenario, signals or Signals(), dict(known or {}), tuple(logs), compile, world,
        plan.size,
    )  # fmt: skip
    told = _agreed(run, plan, seed, design, about)
    with sweep_store.begin(Path(out), told, mixed=mixed) as kept:
        _run_missing(
            run, plan, kept, told, scheduler=scheduler, mixed=mixed, jobs=jobs, progress=progress
        )
    return open_sweep(out)


def _run_missing(
    run: Measured, plan: Plan, kept: Store, told: Mapping[str, Any], *, scheduler: str, mixed: bool,
    jobs: int | None, progress: Callable[[float], None] | None,
) -> None:  # fmt: skip
    """Roll what a store has not; the rest as of :func:`sweep`."""
    done = kept.done()
    missing = (k for k in range(plan.size) if k not in done)
    total, ended = max(plan.size - sum(k < plan.size for k in done), 1), 0

    def keep(found: list[Ended]) -> None:
        nonlocal ended
        kept.add(found)
        ended += len(found)
        if progress:
            progress(ended / total)

    try:
        if scheduler:
            from slipctl.run.sweep import cluster

            mixed_of = kept.tell_mixed if mixed else None
            cluster.run_all(run, plan, missing, total, keep, scheduler, told, mixed_of)
        else:
            cores = jobs or machine.cores()
            run_tasks(missing, lambda k: run.ended(k, plan.numbers(k)), cores, keep)
    except KeyboardInterrupt as error:
        interrupts.note_interrupt()
        error.args = (interrupts.KEPT,)
        raise


def _agreed(
    run: Measured, plan: Plan, seed: int, design: str, about: Mapping[str, Any] | None
) -> dict[str, Any]:
    """What a store of this sweep has to agree in."""
    return {
        **(about or {}),
        "scenario": run.scenario.name, "vary": [a.told() for a in plan.axes], "design": design,
        "seed": seed, "logs": list(run.logs), "samples": plan.samples,
        **machine.versions(), "machine": platform.machine(), "processor": machine.processor(),
        "equations": hashlib.sha256(run.loop.f.serialize().encode()).hexdigest(),
        "numbers": run.fingerprint(), "period_s": run.loop.period,
        "log_units": {s.name: s.unit for s in run.loop.signals if s.name in run.logs},
        **({"ensemble": run.world.ensemble.told()} if run.world else {}),
    }  # fmt: skip


@dataclass(frozen=True)
class _Column:
    """A logged signal as metrics see it."""

    values: np.ndarray
    attrs: Mapping[str, Any]


class _Seen(Mapping[str, _Column]):
    """Arrays of a run as metrics see a log: values and attributes, no copies."""

    def __init__(self, log: Log, period: float) -> None:
        self._log, self._found = log, dict[str, _Column]()
        self._names = dict.fromkeys(log)
        self.attrs = {"period_s": period}

    def add(self, name: str, values: np.ndarray, unit: str) -> None:
        """Add what no block computes."""
        self._names[name] = None
        self._found[name] = _Column(values, {"units": unit})

    def __getitem__(self, name: str) -> _Column:
        if name not in self._found:
            self._found[name] = _Column(self._log[name], self._attributes(name))
        return self._found[name]

    def _attributes(self, name: str) -> dict[str, Any]:
        if name == "time":
            return {"units": "s"}
        loop = self._log.loop
        signal = next(r[name] for r in (loop.outputs, loop.states, loop.inputs) if name in r)
        return {"units": signal.unit} | ({"positive": signal.positive} if signal.positive else {})

    def __contains__(self, name: object) -> bool:
        return name in self._names

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


@dataclass
class Measured:
    """A loop in a scenario, built once, that gives metrics for numbers; threads may share it."""

    loop: Block
    scenario: Scenario
    signals: Signals
    known: Mapping[str, Known] = field(default_factory=dict)
    logs: Sequence[str] = ()
    compile: bool = True
    world: World | None = None
    runs: int = 1

    def __reduce__(self) -> tuple[Any, ...]:
        """What was built is built again where it arrives."""
        made_of = (self.loop, self.scenario, self.signals, self.known, self.logs, self.compile)
        return Measured, (*made_of, self.world, self.runs)

    def __post_init__(self) -> None:
        asked = [k for k in self.known.values() if callable(k.values)]
        reads = [n for k in asked for n in k.reads]
        wanted = self._read(reads) if all(k.reads for k in asked) else None
        self.prepared = prepare(
            self.loop, self.scenario, compile=self.compile, log=wanted, runs=self.runs
        )
        last = {s.name: s.name.rpartition(".")[2] for s in self.loop.signals}
        there = {
            s.name: s
            for s in self.loop.signals
            if s.role != "param" and last[s.name] != "tick" and not last[s.name].startswith("held_")
        }
        for name in self.logs:
            check_known(f"{self.loop.name} has no signal", name, there, " to log")
            if there[name].shape:
                raise BadInput(f"{name} has shape {there[name].shape}; --log keeps single numbers")

    def _read(self, reads: Sequence[str] = ()) -> list[str]:
        """Signals that metrics or a log may ask for; to keep others takes a tenth of a run."""
        asked = {*self.logs, *reads, self.scenario.rail.by if self.scenario.rail else ""}
        waiting: list[Any] = list(vars(self.signals).values())
        while waiting:
            value = waiting.pop()
            if isinstance(value, str):
                asked.add(value)
            elif isinstance(value, (list, tuple)):
                waiting += value
        there = log_columns(self.loop, None)
        return [n for n in there if n in asked or n.rpartition(".")[2] == "x"]

    def ended(self, run: int, numbers: Mapping[str, float]) -> Ended:
        """Roll and measure; a run that breaks says why."""
        try:
            if self.world is None:
                log = self.prepared(numbers)
                found = self.metrics(log)
            else:
                given, draw = self.world.run(numbers, run)
                log = self.prepared(given, seed=draw.scenario.seed, rail=draw.scenario.rail)
                found = self.metrics(log, draw.scenario, draw.known)
            kept = {n: np.array(log[n]) for n in self.logs}
            return Ended(run, numbers, found, logs=kept)
        except (BadInput, RunFailed) as error:
            return Ended(run, numbers, failed=str(error))

    def metrics(
        self, log: Log, scenario: Scenario | None = None, known: Mapping[str, Known] | None = None,
        wanted: Sequence[str] | None = None,
    ) -> dict[str, Any]:  # fmt: skip
        """Metrics of a log; of another scenario and what is known of it, where they are given."""
        return measures.measure(self.seen(log, scenario, known), wanted or MEASURED)

    def seen(
        self, log: Log, scenario: Scenario | None = None, known: Mapping[str, Known] | None = None
    ) -> Run:
        """A log as metrics see it."""
        scenario = scenario or self.scenario
        seen: Any = _Seen(log, float(self.loop.period or 0.0))
        rail = scenario.rail
        where = None if rail is None else measures.place(seen, rail, self.signals)
        for name, known_ in (self.known if known is None else known).items():
            whole: Any = log.dataset() if callable(known_.values) and not known_.reads else log
            seen.add(name, known_column(known_, rail, where, whole), known_.unit)
        changes = measures.rail_changes(seen, scenario, self.signals)
        names = measures.rail_names(scenario, changes)
        return Run(seen, self.signals, changes, rails=names)

    def fingerprint(self) -> str:
        """Hash of the loop's own run: its numbers, its inputs, and how this machine computes."""
        digest = hashlib.sha256()
        values = {**self.loop.param_values(), **self.loop.start()}
        digest.update(json.dumps({n: np.asarray(v).tolist() for n, v in values.items()}).encode())
        try:
            log = prepare(self.loop, self.scenario, compile=self.compile, runs=self.runs)()
            for name in log:
                digest.update(name.encode() + np.ascontiguousarray(log[name]).tobytes())
        except RunFailed as error:
            digest.update(str(error).encode())
        return digest.hexdigest()
