"""What a panel shows of logs: the curve of each loop, its meaning and its unit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from slipctl.block.units.unit_algebra import display_scale
from slipctl.errors import BadInput, nearest
from slipctl.run.metrics import worst

if TYPE_CHECKING:
    from slipctl.run.results import Results


class Panel(NamedTuple):
    """What a panel shows: curves by loop, and the share of the total variation that each has."""

    first: str
    others: list[str]
    curves: dict[str, tuple[Any, Any]]
    rough: dict[str, float]
    text: str
    unit: str


def make_panel(
    results: Results,
    scenario: str,
    logs: Mapping[str, Any],
    wanted: str | Sequence[str],
    span: tuple[float, float] | None,
) -> Panel:
    """One of the panels of ``plots.traces``.

    Raises:
        BadInput: no loop logs it.
    """
    first, *others = [wanted] if isinstance(wanted, str) else wanted
    found = {loop: n for loop, log in logs.items() if (n := logged_name(results, log, first))}
    if not found:
        known = [str(n) for log in logs.values() for n in log]
        raise BadInput(f"no loop of {scenario} logs {first!r}{nearest(first, known)}")
    varied = {
        loop: float(np.abs(np.diff(logs[loop][name].values, axis=0)).sum())
        for loop, name in found.items()
    }
    most = max(varied.values()) or 1.0
    curves = {loop: samples(logs[loop], name, span) for loop, name in found.items()}
    loop, name = next(iter(found.items()))
    signal, rough = logs[loop][name], {n: v / most for n, v in varied.items()}
    unit = str(signal.attrs.get("units", "1"))
    return Panel(first, others, curves, rough, short_meaning(signal, name), unit)


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


def samples(log: Any, name: str, span: tuple[float, float] | None) -> tuple[np.ndarray, np.ndarray]:
    """Times in s and values of a signal, of the worst axle, in the unit in which it is drawn."""
    t, y = log["time"].values, np.asarray(log[name].values)
    if y.ndim > 1:
        y = worst(y.reshape(len(t), -1))
    if span is not None:
        inside = (t >= span[0] - 1e-9) & (t <= span[1] + 1e-9)
        t, y = t[inside], y[inside]
    return t, display_scale(str(log[name].attrs.get("units", "1")))[0] * y
