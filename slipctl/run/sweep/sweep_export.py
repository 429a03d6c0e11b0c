"""A sweep as one labelled file: metrics of all runs, and their logs batch by batch."""

from __future__ import annotations

import math
import shutil
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from slipctl.errors import BadInput
from slipctl.run import store

if TYPE_CHECKING:
    from slipctl.run.sweep.sweep_results import Sweep

CHUNK = 2**24
"""Bytes of a signal that a batch of logs has at most, where fewer runs can be a batch."""

NAN = "AAAAAAAA+H8="
"""NaN as xarray writes a fill value into the attributes of Zarr: its bytes in base64."""

ENDS = (".nc", ".zarr")
"""What the name of an export ends in."""

Put = Callable[[str, tuple[slice, ...], np.ndarray], None]


def check(file: Path) -> None:
    """Refuse a name or a place that an export cannot have, and an extra that is missing.

    Raises:
        BadInput: which, in one line.
    """
    if file.suffix not in ENDS:
        raise BadInput(f"--export {file}: write a file that ends in {' or '.join(ENDS)}")
    if file.suffix == ".nc":
        store.check_file(file)
        return
    store.check_folder(file)
    if file.exists() and not (file / "zarr.json").is_file():
        raise BadInput(f"--export {file}: it is no Zarr folder; choose another name")
    try:
        import zarr  # noqa: F401
    except ImportError:
        raise BadInput(
            f"--export {file} needs the extra zarr: pip install 'slipctl[zarr]'; a file that ends"
            " in .nc does not"
        ) from None


def save(sweep: Sweep, file: Path) -> None:
    """Write a sweep; see :meth:`slipctl.Sweep.save`."""
    check(file)
    if file.suffix == ".nc":
        store.write_with(file, lambda path: _netcdf(sweep, path))
        return
    file.parent.mkdir(parents=True, exist_ok=True)
    scratch = Path(tempfile.mkdtemp(prefix=store.PART, dir=file.parent))
    try:
        _zarr(sweep, scratch / file.name)
        if file.exists():
            file.rename(scratch / "before")
        (scratch / file.name).rename(file)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def _netcdf(sweep: Sweep, path: Path) -> None:
    sweep.dataset().load().to_netcdf(path, engine="netcdf4")
    ticks = sweep.longest()
    if not ticks:
        return
    import netCDF4

    dims, _ = sweep._dims()
    with netCDF4.Dataset(path, "a") as data:
        data.createDimension("time", ticks)
        time = data.createVariable("time", "f8", ("time",))
        time[:], time.units = _time(sweep, ticks), "s"
        for name, unit in _signals(sweep):
            made = data.createVariable(name, "f8", (*dims, "time"), fill_value=np.nan)
            made.units = unit
        coordinates = " ".join(a.name for a in sweep.plan.drawn)
        if coordinates:
            for name, _ in _signals(sweep):
                data[name].coordinates = coordinates
        _fill(sweep, ticks, lambda n, where, values: data[n].__setitem__(where, values))


def _zarr(sweep: Sweep, path: Path) -> None:
    import zarr

    with warnings.catch_warnings():  # names of rows are texts, whose form Zarr has not fixed yet
        warnings.simplefilter("ignore")
        sweep.dataset().load().to_zarr(path, zarr_format=3, consolidated=False)
    ticks = sweep.longest()
    if ticks:
        dims, shape = sweep._dims()
        group: Any = zarr.open_group(path, mode="a")
        time = group.create_array(
            "time", shape=(ticks,), dtype="f8", dimension_names=["time"], attributes={"units": "s"}
        )
        time[:] = _time(sweep, ticks)
        drawn = " ".join(a.name for a in sweep.plan.drawn)
        for name, unit in _signals(sweep):
            about = {"units": unit} | ({"coordinates": drawn} if drawn else {})
            group.create_array(
                name, shape=(*shape, ticks), chunks=(*_batch(sweep, ticks)[1], ticks), dtype="f8",
                fill_value=np.nan, dimension_names=[*dims, "time"],
                attributes={**about, "_FillValue": NAN},
            )  # fmt: skip
        _fill(sweep, ticks, lambda n, where, values: group[n].__setitem__(where, values))


def _time(sweep: Sweep, ticks: int) -> np.ndarray:
    return np.arange(ticks) * float(sweep.about["period_s"])


def _signals(sweep: Sweep) -> list[tuple[str, str]]:
    """Logged signals and their units."""
    units = sweep.about.get("log_units", {})
    return [(n, units.get(n, "1")) for n in sweep.about.get("logs", ())]


def _batch(sweep: Sweep, ticks: int) -> tuple[int, tuple[int, ...]]:
    """Dimension along which batches follow each other, and how long one is in each.

    It is the one that the number of a run goes along last: the sample, or the first axis of a grid
    alone. So the runs of a batch have numbers one after the other.
    """
    _, shape = sweep._dims()
    along = len(shape) - 1 if sweep.plan.drawn else 0
    each = math.prod(shape) // shape[along] * ticks * 8
    size = max(1, min(shape[along], CHUNK // each))
    return along, (*shape[:along], size, *shape[along + 1 :])


def _fill(sweep: Sweep, ticks: int, put: Put) -> None:
    """Put the logs of all runs, a batch at a time."""
    _, shape = sweep._dims()
    along, size = _batch(sweep, ticks)
    others = math.prod(shape) // shape[along]
    for first in range(0, shape[along], size[along]):
        last = min(first + size[along], shape[along])
        here = (*shape[:along], last - first, *shape[along + 1 :], ticks)
        rows = {n: np.full(here, np.nan) for n, _ in _signals(sweep)}
        for run, arrays in sweep.logs(range(first * others, last * others)):
            place = list(sweep.plan.place(run)[: len(shape)])
            place[along] -= first
            for name, values in arrays.items():
                rows[name][tuple(place)][: values.size] = values
        where = [slice(0, n) for n in here]
        where[along] = slice(first, last)
        for name, values in rows.items():
            put(name, tuple(where), values)
