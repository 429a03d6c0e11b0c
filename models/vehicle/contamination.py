"""Contaminated rail of a trip: the law between its two curves, and the field under the train."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from slipctl import Block, Known, Rail
from slipctl.models.common_form import T_S
from slipctl.models.vehicle.parts import Trip
from slipctl.models.vehicle.rail_laws import contaminated_law, layer_law, peak_of_layer
from slipctl.models.wheel_rail.rail_memory import EVERYWHERE, Cells, Layer, rail_field


def field_of_rail(trip: Trip) -> Block | None:
    """Rail under the train, or None where it does not remember."""
    part = trip.rail.contamination
    if part is None:
        return None
    peak = peak_of_layer(layer_law(trip, part), trip.vehicle.speed)
    sand, behind = part.sand, trip.vehicle.behind
    nozzles = tuple(behind[k - 1] - sand.ahead for k in sorted(sand.axles)) if sand else ()
    cells = Cells(behind, part.cell, lead=max(0.0, -min(nozzles, default=0.0)))
    drawn = trip.ensemble.patches if trip.ensemble else None
    most = max(len(part.places), drawn.many[1] if drawn else 0, 1)
    layer = Layer(most, part.own, part.drying is not None, part.fouling is not None, nozzles)
    block = rail_field(cells, T_S, layer).with_params(tau=part.tau, n=part.layers)
    general = 1.0 if part.peak is None else part.peak / peak
    rows = [
        (p.begin, p.end, general if p.peak is None else p.peak / peak) for p in part.places
    ] or [(-EVERYWHERE, EVERYWHERE, general)]
    given: dict[str, Any] = dict(_columns(rows, most))
    if sand is not None:
        given |= {"rate": sand.rate, "S_0": sand.grip, "carry": sand.carry, "delay": sand.delay,
                  "v_least": sand.above, "e_slide": sand.slip}  # fmt: skip
    if part.drying is not None:
        given["T_dry"] = part.drying
    if part.fouling is not None:
        given["T_foul"] = part.fouling
    return block.with_params(**given)


def _columns(rows: Sequence[tuple[float, float, float]], most: int) -> dict[str, np.ndarray]:
    """Begin, end and factor of places as the field has them, with empty ones up to the most."""
    empty = [(EVERYWHERE, EVERYWHERE, 1.0)] * (most - len(rows))
    columns = zip(*[*rows, *empty], strict=True)
    return {k: np.array(v) for k, v in zip(("start", "end", "factor"), columns, strict=True)}


def patches_of_seed(trip: Trip) -> Callable[[int], dict[str, np.ndarray]] | None:
    """Function from the seed of a draw to the places of the field; None where none are drawn."""
    drawn = trip.ensemble.patches if trip.ensemble else None
    part, field = trip.rail.contamination, field_of_rail(trip)
    if drawn is None or part is None or field is None:
        return None
    peak, most = (
        peak_of_layer(layer_law(trip, part), trip.vehicle.speed),
        field.params["start"].size,
    )

    def patches(seed: int) -> dict[str, np.ndarray]:
        random = np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, 42])))
        many = int(random.integers(drawn.many[0], drawn.many[1] + 1))
        begin = np.sort(random.uniform(drawn.begin, drawn.end, many))
        length = random.uniform(*drawn.length, many)
        factor = random.uniform(*drawn.peak, many) / peak
        rows = list(zip(begin, begin + length, factor, strict=True))
        return {f"plant.field.{k}": v for k, v in _columns(rows, most).items()}

    return patches


# ---- what the rail carries -----------------------------------------------------------------------

SHARES = np.linspace(0.0, 1.0, 65)
"""Shares of the clean curve in the blend at which its peak is looked for."""

READS = ("plant.train.v", "plant.field.recovered", "plant.field.height", "plant.train.x", "time")
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


def best_of_layer(trip: Trip, clean: Block, track: Rail) -> dict[str, Known]:
    """Best slip and adhesion under each axle of a contaminated rail, which follow from the log.

    Args:
        trip: the trip. clean: law of its rail. track: its rail, with the conditions of ``clean``.
    """
    conditions = [s.condition or "" for s in track.sections]
    law, behind = contaminated_law(trip, clean), trip.vehicle.behind
    known = {c: Peaks(law, c, trip.vehicle.speed) for c in dict.fromkeys(conditions)}
    worked = list(trip.vehicle.worked)

    def section(log: Any, shape: tuple[int, ...]) -> np.ndarray:
        """Number of the section under each axle."""
        at = np.broadcast_to(np.asarray(log["time"], dtype=float)[:, None], shape)
        if trip.rail.placed:
            at = np.asarray(log["plant.train.x"], dtype=float)[:, None] - np.array(behind)
        return np.maximum(np.searchsorted(track.starts, at + 1e-9, side="right") - 1, 0)

    def found(log: Any) -> tuple[np.ndarray, np.ndarray]:
        v, share, height = (np.asarray(log[name], dtype=float) for name in READS[:3])
        v = np.broadcast_to(np.abs(v)[:, None], share.shape)
        here = section(log, share.shape)
        slip, peak = np.zeros(share.shape), np.zeros(share.shape)
        for k, condition in enumerate(conditions):
            there = here == k
            slip[there], peak[there] = known[condition].at(
                v[there], ((1 - share) * height)[there], share[there]
            )
        return slip, peak

    return {
        "rail.best_slip": Known(
            "m/s", lambda log: found(log)[0][:, worked], "best slip, as the rail has it",
            tuple(behind[k] for k in worked), READS),
        "rail.best_adhesion": Known("1", lambda log: found(log)[1], "peak of the rail", behind,
                                    READS),
    }  # fmt: skip
