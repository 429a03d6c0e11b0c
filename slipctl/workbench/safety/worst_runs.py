"""The worst disturbance of a certificate, as curves over time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from slipctl.block.units.unit_algebra import display_scale
from slipctl.certify import systems
from slipctl.errors import BadInput
from slipctl.workbench.curves import Curves, Panel, Series
from slipctl.workbench.safety.gain_regions import points_of_gains

if TYPE_CHECKING:
    from slipctl.study.declaration import Gains
    from slipctl.workbench.desk import Rig


def worst_run(rig: Rig, gains: Gains, numbers: Mapping[str, float]) -> tuple[Curves, list[str]]:
    """What the law of a certificate does against the worst disturbance that is allowed.

    It is a run of the equations that the certificate speaks of, the error and its law, not of the
    whole vehicle: from there the disturbance is the worst.

    Args:
        rig, gains: loop and certificate. numbers: as the sliders have them.

    Returns:
        A panel for each signal, and the disturbance and what the run shows, in words.

    Raises:
        BadInput: the certificate knows no such run; numbers that mean nothing.
    """
    system, given = points_of_gains(rig, gains, numbers).at({})
    found = systems.worst_disturbance(system, given)
    if found is None:
        raise BadInput(f"{gains.name}: the certificate knows no worst run, only bounds of all runs")
    lines = found.lines()
    rows = dict(found.trajectory)
    if "t" not in rows:
        raise BadInput(f"{gains.name} has no curve of its worst run; {'; '.join(lines)}")
    time = np.array(rows.pop("t")[1], dtype=float)
    panels = []
    for name, (unit, values) in rows.items():
        scale, shown = display_scale(unit)
        series = Series(name, 0, "wanted" if name == "d" else "main", scale * np.array(values))
        panels.append(Panel("disturbance" if name == "d" else name, shown, [series]))
    return Curves(time, panels, []), lines
