"""All signals of a loop at one time of its run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from slipctl.block.units.unit_algebra import display_scale
from slipctl.errors import BadInput
from slipctl.run.preparation import prepare
from slipctl.workbench.desk import Rig


def signals_at(rig: Rig, numbers: Mapping[str, float], time: float) -> list[dict[str, Any]]:
    """Every signal of a loop in the tick that contains a time, the run rolled again up to it.

    Args:
        rig: the loop. numbers: that were moved. time: in s, from the start of the run on.

    Returns:
        For each signal its name, its values (one, or one per axle) in the unit beside them, its
        kind and its meaning; of a state the value at the start of the tick.

    Raises:
        BadInput: the run does not reach the time.
    """
    loop, scenario = rig.loop, rig.case.scenario
    tick = float(loop.period or 0.0)
    row = int(time / tick + 1e-9)
    if not 0 <= time < scenario.duration:
        raise BadInput(f"the run goes from 0 s to {scenario.duration:g} s; {time:g} s is not in it")
    # the noise of a shorter run begins as that of the long one
    part = prepare(
        loop, scenario.but(duration=(row + 1) * tick), compile=rig.compiled, every=max(row, 1)
    )
    log = part(numbers)
    if abs(float(log["time"][-1]) - row * tick) > tick / 2:
        raise BadInput(f"the run ended before {time:g} s")
    by_name = {s.name: s for s in loop.signals}
    found = []
    for name in log:
        signal = by_name.get(name)
        if signal is None:
            continue
        scale, unit = display_scale(signal.unit)
        values = scale * np.atleast_1d(np.asarray(log[name], dtype=float)[-1])
        plain = [float(v) if np.isfinite(v) else None for v in values]
        found.append({"name": name, "values": plain, "unit": unit, "role": signal.role,
                      "doc": signal.doc})  # fmt: skip
    return found
