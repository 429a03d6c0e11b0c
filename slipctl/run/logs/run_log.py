"""The log of a run: arrays by name, and how its rows are filled while it rolls."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from slipctl.block.block import Block
from slipctl.block.signals import Signal
from slipctl.run.rail import Scenario
from slipctl.run.warnings.doubts import estimates_off, warnings_of_log
from slipctl.run.warnings.first_guesses import warnings_of_starts
from slipctl.run.warnings.wheels import wheel_warnings

if TYPE_CHECKING:
    import xarray


@dataclass(frozen=True)
class Column:
    """Where a logged signal stands: among which packed values, from which number on."""

    role: str
    at: int
    signal: Signal


def log_columns(loop: Block, wanted: set[str] | None) -> dict[str, Column]:
    """Signals that a log keeps, by name; by default every number that is no held copy."""
    found: dict[str, Column] = {}
    for role in ("input", "output", "state"):
        at = 0
        for n, s in loop._signals[role].items():
            here, at = at, at + s.size
            last = n.rpartition(".")[2]
            shown = s.shape == () or (s.axis != "" and len(s.shape) == 1)
            keep = shown and not last.startswith("held_") and last != "tick"
            if not (keep if wanted is None else n in wanted):
                continue
            if role != "output" and n in loop.outputs:
                continue  # a wire from this name carries the output too
            found[n] = Column(role, here, s)
    return found


def _places(columns: Mapping[str, Column], role: str) -> np.ndarray:
    """Numbers of a role that a log keeps, by their place among all of them."""
    spans = [range(c.at, c.at + c.signal.size) for c in columns.values() if c.role == role]
    return np.array([k for span in spans for k in span], dtype=int)


class Log(Mapping[str, np.ndarray]):
    """What a run gave: arrays by name, each made when it is asked for; ``"time"`` in s first.

    A signal of one number is an array of rows, one of a shape has the rows in front.

    Attributes:
        loop: the loop as it ran.
        scenario: the scenario as it ran.
        watched: what gives reason to doubt the run, where it was watched.
    """

    def __init__(
        self, loop: Block, scenario: Scenario, time: np.ndarray, values: Mapping[str, np.ndarray],
        columns: Mapping[str, Column], first: Mapping[str, np.ndarray], every: int = 1,
    ) -> None:  # fmt: skip
        self.loop, self.scenario, self._time, self._every = loop, scenario, time, every
        self._values, self._first = values, first
        self.watched: Log | None = None
        self._columns: dict[str, Column] = {}
        ends = dict.fromkeys(values, 0)
        for n, c in columns.items():
            self._columns[n] = Column(c.role, ends[c.role], c.signal)
            ends[c.role] += c.signal.size

    @classmethod
    def of(
        cls, loop: Block, scenario: Scenario, time: np.ndarray, values: Mapping[str, np.ndarray]
    ) -> Log:
        """Log of all numbers of a run, a row per tick for inputs, outputs and states."""
        columns = log_columns(loop, None)
        kept = {role: v[:, _places(columns, role)] for role, v in values.items()}
        return cls(loop, scenario, time, kept, columns, {r: v[:1] for r, v in values.items()})

    def __getitem__(self, name: str) -> np.ndarray:
        if name == "time":
            return self._time
        if name not in self._columns:
            raise KeyError(name)
        c = self._columns[name]
        s, rows = c.signal, len(self._time)
        columns = self._values[c.role][:, c.at : c.at + s.size]
        if len(s.shape) == 2:  # stored column by column
            data = columns.reshape(rows, s.shape[1], s.shape[0]).transpose(0, 2, 1)
        else:
            data = columns.reshape(rows, *s.shape)
        return np.ascontiguousarray(data)

    def __iter__(self) -> Iterator[str]:
        yield "time"
        yield from self._columns

    def __len__(self) -> int:
        return 1 + len(self._columns)

    def told(self) -> list[str]:
        """What to know before the numbers are believed: of estimators, and of limits."""
        every = {s.name for s in self.loop.signals if s.role != "param"}
        begin = Log(self.loop, self.scenario, self._time[:1], self._first,
                    log_columns(self.loop, every), self._first)  # fmt: skip
        scenario = self.scenario.but(params={}, start={})
        starts = warnings_of_starts(self.loop, scenario, lambda _: begin)
        if self.watched is None:
            return starts
        wheels = wheel_warnings(self.loop, scenario, self.watched)
        return [*wheels, *starts, *warnings_of_log(self.loop, scenario, self.watched)]

    def dataset(self) -> xarray.Dataset:
        """The same as a Dataset, with units and provenance; see :func:`simulate`."""
        import xarray

        from slipctl import __version__

        variables: dict[str, Any] = {}
        sizes: dict[str, int] = {}
        for n, c in self._columns.items():
            s = c.signal
            attributes = {"units": s.unit, "long_name": s.doc or n}
            if s.positive:
                attributes["positive"] = s.positive
            dims = ["time", *(f"{n}.{i}" for i in range(len(s.shape)))]
            if s.axis and sizes.setdefault(s.axis, s.shape[-1]) == s.shape[-1]:
                dims[-1] = s.axis
            variables[n] = (dims, self[n], attributes)
        loop, scenario = self.loop, self.scenario
        parameters = {n: {"value": np.asarray(v).tolist(), "unit": loop.params[n].unit}
                      for n, v in loop.param_values().items()}  # fmt: skip
        period = loop.period
        if self._every > 1:
            period = float(loop.period or 0.0) * int(self._every)
        provenance: dict[str, Any] = {
            "format": 1, "slipctl_version": __version__, "loop": loop.name,
            "scenario": scenario.name, "seed": scenario.seed, "noise": scenario.noise,
            "period_s": period, "rail_changes_s": scenario.changes,
            "parameters": json.dumps(parameters),
        }  # fmt: skip
        if lines := self.told():
            provenance["told"] = "\n".join(lines)
        if self.watched is not None:
            scenario = self.scenario.but(params={}, start={})
            off = [vars(e) for e in estimates_off(self.loop, scenario, self.watched)]
            provenance |= {"estimates_off": json.dumps(off)} if off else {}
        coordinate = ("time", self._time, {"units": "s", "long_name": "time"})
        return xarray.Dataset(variables, coords={"time": coordinate}, attrs=provenance)


class Rows:
    """Rows of a run that its log keeps, filled piece by piece."""

    def __init__(
        self, block: Block, scenario: Scenario, u: np.ndarray, rows: np.ndarray,
        columns: Mapping[str, Column], beside: Mapping[str, Column], every: int,
    ) -> None:  # fmt: skip
        self._every = every
        self._block, self._scenario, self._u, self._rows = block, scenario, u, rows
        self._columns, self._beside, self._many = columns, beside, 0
        self._first: dict[str, np.ndarray] = {"input": u[:1]}
        self._kept = {role: _places(columns, role) for role in ("input", "output", "state")}
        self._seen = {role: _places(beside, role) for role in ("output", "state")}
        self._logs, self._watch = (
            {role: np.empty((rows.size, places[role].size)) for role in ("output", "state")}
            for places in (self._kept, self._seen)
        )

    def add(self, k: int, stop: int, x: np.ndarray, y: np.ndarray) -> None:
        """Keep the rows from tick ``k`` to before ``stop``; x and y begin with those of ``k``."""
        a, b = np.searchsorted(self._rows, (k, stop))
        if k == 0:
            self._first |= {"output": y[:1].copy(), "state": x[:1].copy()}
        here = slice(None, stop - k) if self._every == 1 else self._rows[a:b] - k
        for role, whole in (("state", x), ("output", y)):
            for log_, places in ((self._logs, self._kept), (self._watch, self._seen)):
                if places[role].size:  # clip: written where it belongs, without a copy between
                    np.take(whole[here], places[role], axis=1, out=log_[role][a:b], mode="clip")
        self._many = int(b)

    def log(self) -> Log:
        """Log of the rows so far."""
        many, rows = self._many, self._rows[: self._many]
        h = float(self._block.period or 0.0)
        u_log = self._u[np.ix_(rows, self._kept["input"])]
        values = {"input": u_log, **{role: v[:many] for role, v in self._logs.items()}}
        of = self._block, self._scenario, rows * h
        made = Log(*of, values, self._columns, self._first, self._every)
        if self._beside:
            seen = {role: v[:many] for role, v in self._watch.items()}
            made.watched = Log(*of, seen, self._beside, self._first, self._every)
        return made
