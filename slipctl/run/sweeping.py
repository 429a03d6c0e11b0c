"""Many runs of one loop: compiled once, rolled on all cores, kept as they end."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from dataclasses import dataclass, field
from importlib import import_module
from itertools import islice
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from slipctl import __version__
from slipctl.block.block import Block, as_block
from slipctl.errors import BadInput, RunFailed, check_whole, nearest
from slipctl.run import machine, stopping, sweep_store
from slipctl.run.metrics import (
    AGAINST_IDEAL,
    METRICS,
    Run,
    measure,
    place,
    rail_changes,
    rail_names,
)
from slipctl.run.prepared import Log, Prepared, logged, prepare
from slipctl.run.rail import Scenario
from slipctl.run.results import Known, known_column
from slipctl.run.roles import Signals
from slipctl.run.sweep_store import Ended, Store
from slipctl.run.varying import Axis, Plan, plan_of

if TYPE_CHECKING:
    import xarray

    from slipctl.run.ensemble import World

MEASURED = tuple(n for n in METRICS if n not in AGAINST_IDEAL)
"""Metrics of a run that is alone: the loop ``ideal`` does not run beside it."""


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

    Returns:
        The sweep, to be looked at.

    Raises:
        BadInput: nothing to vary, an unknown name, a folder that holds another sweep.
    """
    as_block("sweep: the loop", loop)
    if world is not None:
        loop = world.loop
    plan = plan_of(loop, scenario, vary, samples, seed, design, world.ranges if world else ())
    if jobs is not None:
        check_whole("--jobs", jobs, 1)
    run = Measured(
        loop, scenario, signals or Signals(), dict(known or {}), tuple(logs), compile, world
    )
    told = {
        **(about or {}),
        "scenario": scenario.name, "vary": [a.told() for a in plan.axes], "design": design,
        "seed": seed, "logs": list(logs), "samples": plan.samples, "slipctl": __version__,
        "casadi": ca.CasadiMeta.version(), "numpy": np.__version__, "machine": platform.machine(),
        "equations": hashlib.sha256(loop.f.serialize().encode()).hexdigest(),
        "numbers": run.fingerprint(), "period_s": loop.period,
        "log_units": {s.name: s.unit for s in loop.signals if s.name in logs},
        **({"ensemble": world.ensemble.told()} if world else {}),
    }  # fmt: skip
    kept = sweep_store.begin(Path(out), told)
    try:
        done = kept.done()
        missing = (k for k in range(plan.size) if k not in done)
        total = plan.size - sum(k < plan.size for k in done)
        _run_all(run, plan, missing, total, kept, jobs or machine.cores(), progress)
    finally:
        kept.close()
    return open_sweep(out)


def _run_all(
    run: Measured, plan: Plan, missing: Iterator[int], total: int, kept: Store, jobs: int,
    progress: Callable[[float], None] | None,
) -> None:  # fmt: skip
    """Roll what is missing on threads; this one alone writes, as runs end."""
    ended, stop = 0, Event()

    def one(k: int) -> Ended | None:
        return None if stop.is_set() else run.ended(k, plan.numbers(k))

    pool = ThreadPoolExecutor(jobs)
    waiting: set[Future[Ended | None]] = {pool.submit(one, k) for k in islice(missing, 2 * jobs)}
    try:
        while waiting:
            finished, waiting = wait(waiting, return_when=FIRST_COMPLETED)
            ended += _write(kept, finished)
            waiting |= {pool.submit(one, k) for k in islice(missing, len(finished))}
            if progress:
                progress(ended / max(total, 1))
    except BaseException as error:  # what was rolling is kept too
        if isinstance(error, KeyboardInterrupt):
            stopping.heard()
            error.args = (stopping.KEPT,)
        stop.set()
        pool.shutdown(wait=True, cancel_futures=True)
        _write(kept, {f for f in waiting if f.done() and not f.cancelled()})
        raise
    finally:
        stop.set()
        pool.shutdown(wait=True, cancel_futures=True)


def _write(kept: Store, finished: Iterable[Future[Ended | None]]) -> int:
    """Keep what ended; gives how many."""
    found = [e for e in (f.result() for f in finished) if e is not None]
    with stopping.unbroken():
        kept.add(found)
    return len(found)


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

    def __post_init__(self) -> None:
        wanted = None if any(callable(k.values) for k in self.known.values()) else self._read()
        self._run = prepare(self.loop, self.scenario, compile=self.compile, log=wanted)
        last = {s.name: s.name.rpartition(".")[2] for s in self.loop.signals}
        there = {
            s.name: s
            for s in self.loop.signals
            if s.role != "param" and last[s.name] != "tick" and not last[s.name].startswith("held_")
        }
        for name in self.logs:
            if name not in there:
                raise BadInput(
                    f"{self.loop.name} has no signal {name!r} to log{nearest(name, there)}"
                )
            if there[name].shape:
                raise BadInput(f"{name} has shape {there[name].shape}; --log keeps single numbers")

    def _read(self) -> list[str]:
        """Signals that metrics or a log may ask for; to keep others takes a tenth of a run."""
        asked = {*self.logs, self.scenario.rail.by if self.scenario.rail else ""}
        waiting: list[Any] = list(vars(self.signals).values())
        while waiting:
            value = waiting.pop()
            if isinstance(value, str):
                asked.add(value)
            elif isinstance(value, (list, tuple)):
                waiting += value
        there = logged(self.loop, None)
        return [n for n in there if n in asked or n.rpartition(".")[2] == "x"]

    def ended(self, run: int, numbers: Mapping[str, float]) -> Ended:
        """Roll and measure; a run that breaks says why."""
        try:
            if self.world is None:
                log = self._run(numbers)
                found = self.metrics(log)
            else:
                given, draw = self.world.run(numbers, run)
                log = self._run(given, seed=draw.scenario.seed, rail=draw.scenario.rail)
                found = self.metrics(log, draw.scenario, draw.known)
            kept = {n: np.array(log[n]) for n in self.logs}
            return Ended(run, numbers, found, logs=kept)
        except (BadInput, RunFailed) as error:
            return Ended(run, numbers, failed=str(error))

    def on(
        self, numbers: Mapping[str, float], scenario: Scenario, known: Mapping[str, Known],
        wanted: Sequence[str] | None = None,
    ) -> dict[str, Any]:  # fmt: skip
        """Metrics with the seed and the rail of another scenario, and what is known of it.

        Raises:
            BadInput, RunFailed: as the run does.
        """
        log = self._run(numbers, seed=scenario.seed, rail=scenario.rail)
        return self.metrics(log, scenario, known, wanted)

    def metrics(
        self, log: Log, scenario: Scenario | None = None, known: Mapping[str, Known] | None = None,
        wanted: Sequence[str] | None = None,
    ) -> dict[str, Any]:  # fmt: skip
        """Metrics of a log; of another scenario and what is known of it, where they are given."""
        return measure(self.seen(log, scenario, known), wanted or MEASURED)

    def seen(
        self, log: Log, scenario: Scenario | None = None, known: Mapping[str, Known] | None = None
    ) -> Run:
        """A log as metrics see it."""
        scenario = scenario or self.scenario
        seen: Any = _Seen(log, float(self.loop.period or 0.0))
        rail = scenario.rail
        where = None if rail is None else place(seen, rail, self.signals)
        for name, known_ in (self.known if known is None else known).items():
            whole: Any = log.dataset() if callable(known_.values) else log
            seen.add(name, known_column(known_, rail, where, whole), known_.unit)
        changes = rail_changes(seen, scenario, self.signals)
        names = rail_names(scenario, changes)
        return Run(seen, self.signals, changes, rails=names)

    @property
    def prepared(self) -> Prepared:
        """What rolls."""
        return self._run

    def fingerprint(self) -> str:
        """Hash of the loop's own run: its numbers, its inputs, and how this machine computes."""
        digest = hashlib.sha256()
        values = {**self.loop.param_values(), **self.loop.start()}
        digest.update(json.dumps({n: np.asarray(v).tolist() for n, v in values.items()}).encode())
        try:
            log = prepare(self.loop, self.scenario, compile=self.compile)()
            for name in log:
                digest.update(name.encode() + np.ascontiguousarray(log[name]).tobytes())
        except RunFailed as error:
            digest.update(str(error).encode())
        return digest.hexdigest()


# ---- looking at it ------------------------------------------------------------------------------


def open_sweep(folder: str | Path) -> Sweep:
    """Open a sweep that was run, or is running.

    Args:
        folder: its folder.

    Raises:
        BadInput: there is none.
    """
    found = sweep_store.find(Path(folder))
    try:
        about, units = found.about(), found.units()
        axes = tuple(Axis(*a) for a in about["vary"])
        plan = Plan(axes, int(about["samples"]), int(about["seed"]), str(about["design"]))
        runs = list(found.runs())
    except (KeyError, TypeError, ValueError) as error:
        raise BadInput(f"{found.path} is no store of a sweep: {error}") from None
    finally:
        found.close()
    return Sweep(Path(folder), about, plan, units, runs)


@dataclass(frozen=True)
class Sweep:
    """A sweep as its store has it.

    Attributes:
        folder: where it is.
        about: what it is: loop, scenario, what varies, seed, versions.
        plan: its axes, and the numbers of each run.
        units: unit and row names by metric.
        runs: number, numbers, metrics and failure of each run that ended.
    """

    folder: Path
    about: Mapping[str, Any]
    plan: Plan
    units: Mapping[str, tuple[str, tuple[str, ...]]]
    runs: Sequence[tuple[int, Mapping[str, float], Mapping[str, Any], str]]

    def _repr_html_(self) -> str:
        return str(import_module("slipctl.study.notebook").html(self))

    @property
    def failed(self) -> dict[int, str]:
        """Why runs failed, by their number."""
        return {run: why for run, _, _, why in self.runs if why}

    @property
    def missing(self) -> int:
        """Runs that have not ended yet."""
        return self.plan.size - sum(run < self.plan.size for run, *_ in self.runs)

    def column(self, metric: str, row: int | None = None) -> np.ndarray:
        """Values of a metric in order of the runs that ended, NaN where there is none."""
        found = [m.get(metric) for _, _, m, _ in self.runs]
        if row is not None:
            found = [v[row] if isinstance(v, list) and row < len(v) else None for v in found]
        return np.array([np.nan if v is None else v for v in found], dtype=float)

    def rows(self, metric: str) -> int | None:
        """Numbers that a metric has, or None where it has one."""
        found = [m[metric] for _, _, m, _ in self.runs if isinstance(m.get(metric), list)]
        return max(map(len, found), default=None) if found else None

    def dataset(self) -> xarray.Dataset:
        """All numbers and metrics as one labelled Dataset.

        Its dimensions are the axes of the grid, and ``sample`` where something is drawn; a run
        that is missing or failed is NaN.
        """
        import xarray

        plan = self.plan
        dims = [*(a.name for a in plan.grid), *(["sample"] if plan.drawn else [])]
        shape = (*plan.shape, *([plan.repeats] if plan.drawn else []))
        places = [plan.place(run)[: len(dims)] for run, *_ in self.runs]
        inside = [k for k, (run, *_) in enumerate(self.runs) if run < plan.size]
        index = tuple(np.array([places[k] for k in inside], dtype=int).reshape(-1, len(dims)).T)

        def spread(values: np.ndarray) -> np.ndarray:
            found = np.full(shape, np.nan)
            found[index] = values[inside]
            return found

        variables: dict[str, Any] = {}
        for a in plan.drawn:
            drawn = np.array([numbers[a.name] for _, numbers, _, _ in self.runs], dtype=float)
            variables[a.name] = (dims, spread(drawn), {"units": a.unit})
        for name, (unit, rows) in self.units.items():
            many = self.rows(name)
            attrs = {"units": unit, "long_name": METRICS[name][1] if name in METRICS else name}
            if many is None:
                variables[name] = (dims, spread(self.column(name)), attrs)
                continue
            each = [spread(self.column(name, k)) for k in range(many)]
            label = f"{name}_row"
            variables[name] = ([*dims, label], np.stack(each, axis=-1), attrs)
            names = rows if len(rows) == many else [str(k) for k in range(many)]
            variables[label] = (label, list(names))
        coords: dict[str, Any] = {
            a.name: (a.name, np.linspace(a.lo, a.hi, int(a.points or 1)), {"units": a.unit})
            for a in plan.grid
        }
        coords |= {n: variables.pop(n) for n in list(variables) if n.endswith("_row")}
        coords |= {a.name: variables.pop(a.name) for a in plan.drawn}
        about: dict[str, Any] = {
            k: v if isinstance(v, (str, int, float)) else json.dumps(v)
            for k, v in self.about.items()
        }
        return xarray.Dataset(variables, coords=coords, attrs=about)

    def log(self, run: int) -> xarray.Dataset:
        """Signals over time that a run kept.

        Raises:
            BadInput: the sweep keeps none, or the run has not ended.
        """
        import xarray

        found = sweep_store.find(self.folder)
        try:
            arrays = found.log(run)
        finally:
            found.close()
        if not arrays:
            kept = self.about.get("logs")
            why = f"run {run} has not ended" if kept else "it was made without --log"
            raise BadInput(f"{self.folder} keeps no log of run {run}: {why}")
        units = self.about.get("log_units", {})
        time = np.arange(len(next(iter(arrays.values())))) * float(self.about["period_s"])
        variables = {n: ("time", v, {"units": units.get(n, "1")}) for n, v in arrays.items()}
        return xarray.Dataset(variables, coords={"time": ("time", time, {"units": "s"})})

    def save(self, file: str | Path) -> None:
        """Write :meth:`dataset` as netCDF, whole or not at all."""
        from slipctl.run import store

        data = self.dataset()
        store.check_file(Path(file))
        with suppress(AttributeError):
            data = data.load()
        store.write_with(Path(file), lambda path: data.to_netcdf(path, engine="netcdf4"))
