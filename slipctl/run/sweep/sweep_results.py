"""A sweep as its folder has it: its runs, as columns and as one labelled Dataset."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from slipctl import registry
from slipctl.errors import BadInput
from slipctl.run.metrics import METRICS
from slipctl.run.sweep import sweep_store
from slipctl.run.sweep.spread import Kept, count_kept, value_in_run
from slipctl.run.sweep.sweep_plan import Axis, Plan

if TYPE_CHECKING:
    import xarray


def open_sweep(folder: str | Path) -> Sweep:
    """Open a sweep that was run, or is running.

    Args:
        folder: its folder.

    Raises:
        BadInput: there is none.
    """
    with sweep_store.find(Path(folder)) as found:
        try:
            about, units = found.about(), found.units()
            axes = tuple(Axis(*a) for a in about["vary"])
            plan = Plan(axes, int(about["samples"]), int(about["seed"]), str(about["design"]))
        except (KeyError, TypeError, ValueError) as error:
            raise BadInput(f"{found.path} is no store of a sweep: {error}") from None
    return Sweep(Path(folder), about, plan, units)


@dataclass(frozen=True)
class Sweep:
    """A sweep as its store has it.

    Attributes:
        folder: where it is.
        about: what it is: loop, scenario, what varies, seed, versions.
        plan: its axes, and the numbers of each run.
        units: unit and row names by metric.
    """

    folder: Path
    about: Mapping[str, Any]
    plan: Plan
    units: Mapping[str, tuple[str, tuple[str, ...]]]

    @cached_property
    def runs(self) -> Sequence[tuple[int, Mapping[str, float], Mapping[str, Any], str]]:
        """Number, numbers, metrics and failure of each run that ended, read when first asked for.

        Raises:
            BadInput: the store is damaged or gone.
        """
        with sweep_store.find(self.folder) as found:
            try:
                return list(found.runs())
            except (TypeError, ValueError) as error:
                raise BadInput(f"{found.path} is no store of a sweep: {error}") from None

    def _repr_html_(self) -> str:
        return registry.view(self, "html")

    @property
    def failed(self) -> dict[int, str]:
        """Why runs failed, by their number."""
        return {run: why for run, _, _, why in self.runs if why}

    @property
    def missing(self) -> int:
        """Runs that have not ended yet."""
        return self.plan.size - sum(run < self.plan.size for run, *_ in self.runs)

    def column(self, metric: str, row: int | None = None) -> np.ndarray:
        """Values of a metric in order of the runs that ended.

        A run that never reached the metric, or that broke off, has the worst value there is: plus
        infinity for a distance or a time. NaN where the metric has no meaning in a run.
        """
        return np.array([value_in_run(metric, m, row) for _, _, m, _ in self.runs], dtype=float)

    def labelled(self) -> Iterator[tuple[str, str, np.ndarray]]:
        """Each number of the metrics: its name with its rail, its unit, its :meth:`column`."""
        for name, (unit, labels) in self.units.items():
            many = self.rows(name)
            if many is None or many == 1:
                yield name, unit, self.column(name, None if many is None else 0)
                continue
            for k in range(many):
                label = labels[k] if len(labels) == many else str(k + 1)
                yield f"{name}, {label}", unit, self.column(name, k)

    @property
    def limits(self) -> Mapping[str, float]:
        """Limits of the study, by metric; those of a sweep that was made without are empty."""
        return dict(self.about.get("limits", {}))

    @property
    def kept(self) -> Kept | None:
        """How many runs are within the limits; None where there are no limits."""
        return count_kept([m for _, _, m, _ in self.runs], self.limits)

    def rows(self, metric: str) -> int | None:
        """Numbers that a metric has, or None where it has one."""
        found = [m[metric] for _, _, m, _ in self.runs if isinstance(m.get(metric), list)]
        return max(map(len, found), default=None) if found else None

    def dataset(self) -> xarray.Dataset:
        """All numbers and metrics as one labelled Dataset.

        Its dimensions are the axes of the grid, and ``sample`` where something is drawn; a run
        that is missing is NaN; see :meth:`column` for one that never reached a metric.
        """
        import xarray

        plan = self.plan
        dims, shape = self._dims()
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
            attrs = {"units": unit, "long_name": METRICS[name].meaning if name in METRICS else name}
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

        arrays = next(self.logs([run]), (run, {}))[1]
        if not arrays:
            kept = self.about.get("logs")
            why = f"run {run} has not ended" if kept else "it was made without --log"
            raise BadInput(f"{self.folder} keeps no log of run {run}: {why}")
        units = self.about.get("log_units", {})
        time = np.arange(len(next(iter(arrays.values())))) * float(self.about["period_s"])
        variables = {n: ("time", v, {"units": units.get(n, "1")}) for n, v in arrays.items()}
        return xarray.Dataset(variables, coords={"time": ("time", time, {"units": "s"})})

    def _dims(self) -> tuple[list[str], tuple[int, ...]]:
        """Dimensions of what each run has one of, and how long they are."""
        plan = self.plan
        names = [*(a.name for a in plan.grid), *(["sample"] if plan.drawn else [])]
        return names, (*plan.shape, *([plan.repeats] if plan.drawn else []))

    def save(self, file: str | Path) -> None:
        """Write :meth:`dataset` and all logs, whole or not at all.

        A file ``.nc`` is netCDF. A folder ``.zarr`` is Zarr, and each chunk a batch of runs; it
        needs the extra ``zarr``. Logs have ``time`` as their last dimension; where a run ended
        earlier than another there is NaN. They are written batch by batch, never held whole.

        Raises:
            BadInput: the extra is missing, or the place cannot be written.
        """
        from slipctl.run.sweep import sweep_export

        sweep_export.save(self, Path(file))

    def logs(self, runs: Iterable[int]) -> Iterator[tuple[int, dict[str, np.ndarray]]]:
        """Run and its signals over time, of those of these runs that kept some."""
        with sweep_store.find(self.folder) as found:
            for run in runs:
                if arrays := found.log(run):
                    yield run, arrays

    def longest(self) -> int:
        """Ticks of the longest log."""
        with sweep_store.find(self.folder) as found:
            return found.longest()
