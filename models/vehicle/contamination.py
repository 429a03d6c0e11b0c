"""Contaminated rail of a trip: the law between its two curves, and the field under the train."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from slipctl import BadInput, Block, argmax
from slipctl.errors import Faults, nearest
from slipctl.models.common_form import T_S
from slipctl.models.vehicle.adhesion import law_faults
from slipctl.models.vehicle.control import numbers_of
from slipctl.models.vehicle.parts import Contamination, Trip
from slipctl.models.vehicle.plant import on_train
from slipctl.models.wheel_rail.rail_memory import EVERYWHERE, Cells, blended_law, rail_field
from slipctl.study.resolve import load_block

WHERE = "rail.contamination"


def layer_law(trip: Trip, part: Contamination) -> Block:
    """Law under the layer, as a train takes it, with its own numbers.

    Raises:
        Faults: no such law or condition, parameters that it has not, what no rail does.
    """
    try:
        block = load_block(part.law or trip.rail.law)
        on_train(block)  # says what is wrong with it
    except BadInput as error:
        raise Faults([f"{WHERE}.law: {error}"]) from None
    values: dict[str, float] = {}
    if part.condition:
        if part.condition not in block.conditions:
            raise Faults(
                [
                    f"{WHERE}.condition: {block.name} has no condition {part.condition!r}"
                    f"{nearest(part.condition, block.conditions)}"
                ]
            )
        values |= block.conditions[part.condition]
    values |= numbers_of(block, part.numbers, f"{WHERE}.numbers")
    driven = trip.vehicle.mode == "drive"
    wrong = list(law_faults(block, {"layer": values}, trip.vehicle.speed, driven))
    if wrong:
        raise Faults([f"{WHERE}.law: {why}" for _, why in wrong])
    return on_train(block.with_params(**values))


def peak_of_layer(law: Block, speed: float) -> float:
    """Largest adhesion of a law as a train takes it, at a speed in m/s of 1 at least."""
    v = max(speed, 1.0)
    return float(argmax(law, "v_s", "mu", lo=1e-4, hi=max(10.0, v), at={"v": v}).value)


def contaminated_law(trip: Trip, clean: Block) -> Block:
    """Law of the rail: between the layer and what is under it, where the trip has a layer.

    Args:
        trip: the trip.
        clean: law of its rail, with its conditions.
    """
    part = trip.rail.contamination
    return clean if part is None else blended_law(layer_law(trip, part), on_train(clean))


def field_of_rail(trip: Trip) -> Block | None:
    """Rail under the train, or None where it does not remember."""
    part = trip.rail.contamination
    if part is None:
        return None
    peak = peak_of_layer(layer_law(trip, part), trip.vehicle.speed)
    cells = Cells(trip.vehicle.behind, part.cell)
    block = rail_field(
        cells,
        T_S,
        max(len(part.places), 1),
        part.own,
        part.drying is not None,
        part.fouling is not None,
    ).with_params(tau=part.tau, n=part.layers)
    general = 1.0 if part.peak is None else part.peak / peak
    rows = [
        (p.begin, p.end, general if p.peak is None else p.peak / peak) for p in part.places
    ] or [(-EVERYWHERE, EVERYWHERE, general)]
    begin, end, factor = (np.array(column) for column in zip(*rows, strict=True))
    given = {"start": begin, "end": end, "factor": factor}
    if part.drying is not None:
        given["T_dry"] = part.drying
    if part.fouling is not None:
        given["T_foul"] = part.fouling
    return block.with_params(**given)


# ---- what the rail carries -----------------------------------------------------------------------

SHARES = np.linspace(0.0, 1.0, 65)
"""Shares of the clean curve in the blend at which its peak is looked for."""

READS = ("plant.train.v", "plant.field.recovered", "plant.field.height")
"""Signals that the peak of the rail follows from."""


class Peaks:
    """Peak of a rail between two curves, over the vehicle's speed and the shares of both.

    Args:
        law: between the curves, see :func:`contaminated_law`, with the rail's conditions.
        condition: one of them.
        speed: largest speed in m/s.
    """

    def __init__(self, law: Block, condition: str, speed: float) -> None:
        self.speeds = np.linspace(0.5, max(speed, 1.0), 40)
        values = law.param_values(**law.conditions[condition])
        s, v, share = (ca.SX.sym(name) for name in ("s", "v", "share"))
        u = {"v_s": -s, "v": v, "height": 1.0, "recovered": share}
        curve = ca.Function("curve", [s, v, share], [-law.expr({}, u, values)[1]["mu"]])
        slips = np.geomspace(1e-3, 1.0, 400)[:, None] * self.speeds  # slip by speed
        fouled, clean = (np.array(curve(slips, np.tile(self.speeds, (400, 1)), k)) for k in (0, 1))
        blends = [(1 - q) * fouled + q * clean for q in SHARES]
        at = np.array([b.argmax(axis=0) for b in blends])
        self.heights = np.array([b.max(axis=0) for b in blends])
        self.slips = slips[at, np.arange(len(self.speeds))]

    def at(self, v: np.ndarray, fouled: np.ndarray, clean: np.ndarray) -> tuple[Any, Any]:
        """Best slip in m/s and peak, where the shares of both curves are these."""
        both = np.maximum(fouled + clean, 1e-12)
        j = np.rint(np.interp(v, self.speeds, np.arange(len(self.speeds)))).astype(int)
        k = np.rint(clean / both * (len(SHARES) - 1)).astype(int)
        # beside the grid, the line between its shares
        q = clean / both * (len(SHARES) - 1)
        low = np.minimum(q.astype(int), len(SHARES) - 2)
        peak = self.heights[low, j] * (low + 1 - q) + self.heights[low + 1, j] * (q - low)
        return self.slips[k, j], both * peak


def peaks_under_axles(
    trip: Trip, clean: Block, conditions: Sequence[str], section: Callable[[Any], np.ndarray]
) -> Callable[[Any], tuple[np.ndarray, np.ndarray]]:
    """Function of a log: best slip in m/s and peak under each axle, of a contaminated rail.

    Args:
        trip: the trip.
        clean: law of its rail.
        conditions: of the sections of the rail, in their order.
        section: number of the section under each axle, from a log.
    """
    law = contaminated_law(trip, clean)
    known = {c: Peaks(law, c, trip.vehicle.speed) for c in dict.fromkeys(conditions)}

    def found(log: Any) -> tuple[np.ndarray, np.ndarray]:
        v, share, height = (np.asarray(log[name], dtype=float) for name in READS)
        v = np.broadcast_to(np.abs(v)[:, None], share.shape)
        here = section(log)
        slip, peak = np.zeros(share.shape), np.zeros(share.shape)
        for k, condition in enumerate(conditions):
            there = here == k
            slip[there], peak[there] = known[condition].at(
                v[there], ((1 - share) * height)[there], share[there]
            )
        return slip, peak

    return found
