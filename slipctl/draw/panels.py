"""What a panel shows of logs: the curve of each loop, its meaning and its unit."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from slipctl.block.units.unit_algebra import display_scale
from slipctl.errors import BadInput, nearest
from slipctl.run.roles import axles_of_columns
from slipctl.run.waveform import worst

if TYPE_CHECKING:
    from slipctl.run.results import Results


class Panel(NamedTuple):
    """What a panel shows: curves by loop, the share of the total variation that each has, axles."""

    first: str
    others: list[str]
    curves: dict[str, tuple[Any, Any]]
    rough: dict[str, float]
    text: str
    unit: str
    axles: dict[str, Any]


def make_panel(
    results: Results, scenario: str, logs: Mapping[str, Any], wanted: str | Sequence[str],
    span: tuple[float, float] | None, axle: int = 0,
) -> Panel:  # fmt: skip
    """One of the panels of ``plots.traces``; of what each axle has its own, that of one axle.

    Raises:
        BadInput: no loop logs it.
    """
    first, *others = [wanted] if isinstance(wanted, str) else wanted
    found = {loop: n for loop, log in logs.items() if (n := logged_name(results, log, first))}
    if not found:
        known = [str(n) for log in logs.values() for n in log]
        raise BadInput(f"no loop of {scenario} logs {first!r}{nearest(first, known)}")
    varied = {loop: float(np.abs(np.diff(logs[loop][name].values, axis=0)).sum())
              for loop, name in found.items()}  # fmt: skip
    most = max(varied.values()) or 1.0
    worked = results.study.signals.axles
    curves = {loop: samples(logs[loop], name, span, axle, worked) for loop, name in found.items()}
    loop, name = next(iter(found.items()))
    signal, rough = logs[loop][name], {n: v / most for n, v in varied.items()}
    unit = str(signal.attrs.get("units", "1"))
    every = {loop: each_axle(logs[loop], name, span, worked) for loop, name in found.items()}
    axles = {loop: a for loop, a in every.items() if a is not None}
    text = short_meaning(signal, name)
    if text.startswith("signal with"):  # it only says how it was made
        text = first.replace("_", " ")
    return Panel(first, others, curves, rough, text, unit, axles)


def short_meaning(signal: Any, name: str) -> str:
    """Meaning of a signal, up to its first comma."""
    return str(signal.attrs.get("long_name") or name).partition(",")[0]


def logged_name(results: Results, log: Any, wanted: str) -> str | None:
    """Logged name of a role or of a name; None if the log has neither."""
    if wanted in log:
        return wanted
    if hasattr(results.study.signals, wanted):
        return results.study.signals.find(wanted, log)
    return None


def samples(
    log: Any, name: str, span: tuple[float, float] | None, axle: int | None = None,
    worked: Sequence[int] | None = None,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Times in s and values of a signal, in the unit in which it is drawn.

    Args:
        log: of a run. name: of the signal. span: times in s from and to which.
        axle: the one that is shown, from 0 on, where each has its own; None shows the worst one.
        worked: axles of signals that only these have; of the others they are not numbers.
    """
    t, y = log["time"].values, np.asarray(log[name].values)
    if y.ndim > 1:
        y = worst(y.reshape(len(t), -1)) if axle is None else _of_axles(log, name, worked)
        y = y if axle is None else y[:, min(axle, y.shape[1] - 1)]
    if span is not None:
        inside = (t >= span[0] - 1e-9) & (t <= span[1] + 1e-9)
        t, y = t[inside], y[inside]
    return t, display_scale(str(log[name].attrs.get("units", "1")))[0] * y


def _of_axles(log: Any, name: str, worked: Sequence[int] | None) -> np.ndarray:
    """A column for each axle; one that is not a number where only others have the signal."""
    y = np.asarray(log[name].values).reshape(log.sizes["time"], -1)
    axles = axles_of_columns(worked, y.shape[1])
    if isinstance(axles, range) or log[name].ndim < 2:
        return y
    every = np.full((len(y), max(log.sizes.get("axle", 0), max(axles) + 1)), np.nan)
    every[:, list(axles)] = y
    return every


def each_axle(
    log: Any, name: str, span: tuple[float, float] | None, worked: Sequence[int] | None = None
) -> np.ndarray | None:
    """The same of all axles, a column for each; None where there are no several."""
    many = _of_axles(log, name, worked).shape[1]
    if many < 2:
        return None
    return np.stack([samples(log, name, span, k, worked)[1] for k in range(many)], axis=1)


def chosen_axle(results: Results, logs: Mapping[str, Any], wanted: Sequence[Any]) -> int | None:
    """Axle that slips most in these runs, from 0 on; None where no panel has several axles."""
    firsts = [w if isinstance(w, str) else w[0] for w in wanted]
    many = [
        n for log in logs.values() for w in firsts
        if (n := logged_name(results, log, w)) and np.prod(log[n].shape[1:], dtype=int) > 1
    ]  # fmt: skip
    if not many:
        return None
    largest: dict[int, float] = {}
    for log in logs.values():
        name = logged_name(results, log, "slip") or many[0]
        if name in log:
            each = np.abs(_of_axles(log, name, results.study.signals.axles)).max(axis=0)
            for k, v in enumerate(np.nan_to_num(each)):
                largest[k] = max(largest.get(k, 0.0), round(float(v), 9))
    return max(largest, key=lambda k: (largest[k], -k)) if largest else 0


def arrivals(results: Results, log: Any, starts: Sequence[float], axle: int) -> list[float] | None:
    """Times in s at which an axle gets to places of the rail; None where that is not known."""
    name = results.study.signals.find("position", log)
    if name is None:
        return None
    place = f"{name.rpartition('.')[0]}.behind"
    told = json.loads(log.attrs.get("parameters", "{}")).get(place)
    behind = np.ravel(told["value"]) if told else np.zeros(1)
    x = np.asarray(log[name].values).reshape(log.sizes["time"], -1)[:, 0]
    x = x - float(behind[min(axle, behind.size - 1)])
    reached = [x >= start for start in starts]
    return [float(log["time"].values[int(np.argmax(r))]) for r in reached if r.any()]
