"""What runs give: cases, logs, metrics and tables, by the names under which they are looked up."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from slipctl import registry
from slipctl.errors import BadInput, check_kinds, check_known, nearest, own_copy

if TYPE_CHECKING:
    import xarray

    from slipctl.block.block import Block
    from slipctl.run.metrics import Metric
    from slipctl.run.rail import Rail, Scenario


@dataclass(frozen=True)
class Known:
    """A quantity that no block computes but the study knows, put into the log beside the rest.

    Args:
        unit: unit as text.
        values: one number per rail section (one number without a rail), or a function of the log.
        doc: meaning in words.
        behind: places of axles behind the one that the rail counts by, in m, for a column per axle;
            none for the rail under that one alone.
        reads: signals of the log that a function needs; none given, all are kept for it.
    """

    unit: str
    values: float | Sequence[float] | Callable[[xarray.Dataset], np.ndarray]
    doc: str = ""
    behind: tuple[float, ...] = ()
    reads: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_kinds("Known", Known, vars(self))


def known_column(known: Known, rail: Rail | None, where: Any, log: Any) -> np.ndarray:
    """Values over time of what a study knows beside its loops, a column per axle if it says so.

    Args:
        known: the quantity.
        rail: of the scenario.
        where: time or position of each tick, as the rail counts.
        log: of the run.
    """
    values: Any = known.values
    if callable(values):
        values = np.asarray(values(log), dtype=float)
    elif isinstance(values, Sequence):
        if rail is None or where is None:
            values = values[0]
        else:
            there = np.asarray(where) + 1e-9
            if known.behind:
                there = there[:, None] - np.array(known.behind) * (rail.by != "time")
            section = np.searchsorted(rail.starts, there, side="right") - 1
            values = np.asarray(values, dtype=float)[np.maximum(section, 0)]
    if known.behind and np.ndim(values) > 1:
        return np.asarray(values)
    return np.array(np.broadcast_to(values, log["time"].shape), dtype=float)


class Loops(Mapping[str, "Block"]):
    """Loops by name, each made when it is first asked for: many scenarios are named, few run.

    Args:
        made: function without arguments that makes the loop, by name.
    """

    def __init__(self, made: Mapping[str, Callable[[], Block]]) -> None:
        self._make = dict(made)
        self._made: dict[str, Block] = {}

    def _repr_html_(self) -> str:
        return registry.view(self, "html")

    def __getitem__(self, name: str) -> Block:
        if name not in self._made:
            self._made[name] = self._make[name]()
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._make)

    def __len__(self) -> int:
        return len(self._make)

    def __contains__(self, name: object) -> bool:
        return name in self._make

    def __or__(self, other: Mapping[str, Block]) -> Loops:
        """Loops of both, those of the other where both have the name."""
        return Loops({n: partial(m.__getitem__, n) for m in (self, other) for n in m})

    def __ror__(self, other: Mapping[str, Block]) -> Loops:
        return Loops({n: partial(m.__getitem__, n) for m in (other, self) for n in m})

    def only(self, *names: str) -> Loops:
        """These loops alone."""
        return Loops({n: partial(self.__getitem__, n) for n in names})

    def each(self, change: Callable[[Block], Block]) -> Loops:
        """The same loops, each changed."""

        def changed(name: str) -> Block:
            return change(self[name])

        return Loops({n: partial(changed, n) for n in self})


@dataclass(frozen=True)
class Case:
    """A scenario with the loops that run in it.

    Args:
        scenario: what happens.
        loops: step blocks by name; ``ideal`` is the bound that the others are measured against.
            :class:`Loops` makes each when it is first asked for.
        known: further quantities for the log, ``{"rail.best_slip": Known("m/s", [1.2, 1.8])}``.
        log: names to keep in the logs, of those that a loop has; None keeps every scalar signal.
        every: ticks from one row of the logs to the next; metrics see the rows.
        clean: scenario in which the same loops run on clean rail, for the metric ``extension``.
    """

    scenario: Scenario
    loops: Mapping[str, Block]
    known: Mapping[str, Known] = field(default_factory=dict)
    log: Sequence[str] | None = None
    every: int = 1
    clean: str = ""

    def __post_init__(self) -> None:
        check_kinds("Case", Case, vars(self))
        object.__setattr__(self, "known", own_copy(self.known))


@dataclass(frozen=True)
class Table:
    """What an experiment found: columns by name, each with its unit.

    Args:
        title: what it shows.
        columns: ``{"peak": ("m/s", [1.2, 1.8])}``; numbers, texts, yes/no or None, equally long.
        doc: what it means; how many runs and seeds it took.
    """

    title: str
    columns: Mapping[str, tuple[str, Sequence[Any]]]
    doc: str = ""

    def __post_init__(self) -> None:
        check_kinds("Table", Table, vars(self))
        lengths = {name: len(values) for name, (_, values) in self.columns.items()}
        if len(set(lengths.values())) > 1:
            raise BadInput(f"table {self.title!r}: columns of unequal length, {lengths}")

    def __getitem__(self, column: str) -> Sequence[Any]:
        check_known(f"table {self.title!r} has no column", column, self.columns)
        return self.columns[column][1]

    def where(self, wanted: str, **given: Any) -> Any:
        """Value of column ``wanted`` in the first row in which the given columns match, or None."""
        for k, value in enumerate(self[wanted]):
            if all(self[c][k] == v for c, v in given.items()):
                return value
        return None


class NotRun(LookupError):
    """A claim or figure asks for something that was not run; it says so and the rest goes on."""


class LeftToFull(NotRun):
    """It asks for something that only a run with ``--full`` does."""

    def __init__(self, said: str = "needs --full") -> None:
        super().__init__(said)


@dataclass
class Results:
    """What a study gave.

    Attributes:
        study: the study.
        cases: its cases as they ran, ``--set`` applied.
        quick: whether it was the quick form.
        data: logs by scenario and loop.
        metrics: metrics by scenario and loop.
        tables: tables by experiment and name.
        failed: why a run failed, by ``scenario/loop`` or experiment.
        changed: what was swapped and set, in words; empty for the study as it stands.
        left: scenarios and experiments that were left to ``--full``.
        asked: ``scenario/loop`` and experiments that were looked up, for whoever wants to know what
            an answer speaks of.
    """

    study: Any
    cases: Sequence[Case]
    quick: bool = False
    data: dict[str, dict[str, xarray.Dataset]] = field(default_factory=dict)
    metrics: dict[str, dict[str, dict[str, Metric]]] = field(default_factory=dict)
    tables: dict[str, dict[str, Table]] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)
    changed: str = ""
    left: Sequence[str] = ()
    asked: set[str] = field(default_factory=set)

    def part(self, path: str) -> Block:
        """Part that every loop has, such as ``"plant.adh"``, of the first one."""
        return next(iter(self.cases[0].loops.values()))[path]

    def loop(self, scenario: str, loop: str) -> Block:
        """A loop as it ran, with its parameters.

        Raises:
            NotRun: it was left out, or left to ``--full``.
        """
        key = f"{scenario}/{loop}"
        self.asked.add(key)
        for case in self.cases:
            if case.scenario.name == scenario and loop in case.loops:
                return case.loops[loop]
        raise self._not_run(scenario, key, "")

    def _not_run(self, part: str, key: str, what: str) -> NotRun:
        """Why there is nothing: it was left to ``--full``, it failed, or nobody ran it."""
        if part in self.left:
            return LeftToFull()
        why = f"failed: {self.failed[key]}" if key in self.failed else "was not run"
        return NotRun(f"{what}{key} {why}")

    def number(self, scenario: str, loop: str, path: str) -> float:
        """Parameter of a loop as it ran, such as ``"ctl.law.k1"``; of many axles the first one's.

        Raises:
            NotRun: the loop was left out, or left to ``--full``.
            BadInput: it has no such parameter.
        """
        values = self.loop(scenario, loop).values_by_place()
        check_known(f"{loop} has no parameter", path, values)
        return float(np.ravel(values[path])[0])

    def log(self, scenario: str, loop: str) -> xarray.Dataset:
        """Log of a loop in a scenario.

        Raises:
            NotRun: it was left out, left to ``--full``, or failed.
        """
        key = f"{scenario}/{loop}"
        self.asked.add(key)
        if loop in self.data.get(scenario, {}):
            return self.data[scenario][loop]
        raise self._not_run(scenario, key, "")

    def metric(self, scenario: str, loop: str, name: str) -> Any:
        """Value of a metric: a number, a list, or None where it has no meaning for the loop.

        Raises:
            NotRun: the loop was left out or failed.
        """
        self.log(scenario, loop)
        found = self.metrics[scenario][loop].get(name)
        return None if found is None else found.value

    def signal(self, scenario: str, loop: str, role: str) -> np.ndarray:
        """Values over time of a signal by its role (``"slip"``) or by its name.

        Raises:
            NotRun: the loop was left out or failed.
            BadInput: the loop logs no such signal.
        """
        log = self.log(scenario, loop)
        name = self.study.signals.find(role, log) if hasattr(self.study.signals, role) else role
        if name not in log:
            raise BadInput(f"{scenario}/{loop} logs no {role}{nearest(role, map(str, log))}")
        return log[name].values

    def table(self, experiment: str, name: str | None = None) -> Table:
        """Table of an experiment (its only or first one, unless named).

        Raises:
            NotRun: the experiment was left out or failed.
        """
        self.asked.add(experiment)
        found = self.tables.get(experiment)
        if not found:
            raise self._not_run(experiment, experiment, "experiment ")
        if name is not None and name not in found:
            raise NotRun(f"experiment {experiment} gave no table {name!r}{nearest(name, found)}")
        return found[name or next(iter(found))]
