"""Contaminated rail of a trip: the law between its two curves, and the field under the train."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from slipctl import Block, Known, Rail
from slipctl.analysis.rail_peaks import Peaks
from slipctl.errors import Faults
from slipctl.models.common_form import T_S
from slipctl.models.vehicle.adhesion import (
    contaminated_law,
    highest,
    layer_law,
    peak_of_layer,
)
from slipctl.models.vehicle.parts import Trip
from slipctl.models.vehicle.plant import on_train
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
    factor = max([f for *_, f in rows] + ([drawn.peak[1] / peak] if drawn else []))
    if factor > 1:
        law, driven = layer_law(trip, part), trip.vehicle.mode == "drive"
        if (height := factor * highest(law, trip.vehicle.speed, driven)) > 1:
            raise Faults(
                [
                    f"rail.contamination.peak: with {factor * peak:.3g} at the speed at the start,"
                    f" adhesion is {height:.3g} at lower speeds, above 1; write less"
                ]
            )
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

READS = ("plant.train.v", "plant.train.x", "time")
"""Signals that the peak of the rail follows from."""

LAYER_READS = ("plant.field.recovered", "plant.field.height")
"""Those that it follows from beside, on a contaminated rail."""


@lru_cache(maxsize=16)
def _peaks(law: Block, condition: str, speed: float) -> Peaks:
    """Peaks of a law under a condition; both quantities of a run ask for the same."""
    return Peaks(law, law.conditions[condition], speed)


def best_under_axles(trip: Trip, clean: Block, track: Rail) -> dict[str, Known]:
    """Best slip and adhesion under each axle where they follow from the log: by speed or layer.

    Args:
        trip: the trip. clean: law of its rail. track: its rail, with the conditions of ``clean``.
    """
    conditions = [s.condition or "" for s in track.sections]
    layered = trip.rail.contamination is not None
    law = contaminated_law(trip, clean) if layered else on_train(clean)
    behind = trip.vehicle.behind
    worked, reads = list(trip.vehicle.worked), READS + (LAYER_READS if layered else ())

    def section(log: Any, shape: tuple[int, ...]) -> np.ndarray:
        """Number of the section under each axle."""
        at = np.broadcast_to(np.asarray(log["time"], dtype=float)[:, None], shape)
        if trip.rail.placed:
            at = np.asarray(log["plant.train.x"], dtype=float)[:, None] - np.array(behind)
        return np.maximum(np.searchsorted(track.starts, at + 1e-9, side="right") - 1, 0)

    def found(log: Any) -> tuple[np.ndarray, np.ndarray]:
        v = np.abs(np.asarray(log["plant.train.v"], dtype=float))
        speed = max(trip.vehicle.speed, float(v.max()))
        v = np.repeat(v[:, None], len(behind), axis=1)
        share, height = (np.asarray(log[name], dtype=float) if layered else np.ones(v.shape)
                         for name in LAYER_READS)  # fmt: skip
        here = section(log, share.shape)
        slip, peak = np.zeros(share.shape), np.zeros(share.shape)
        for k, condition in enumerate(conditions):
            there = here == k
            slip[there], peak[there] = _peaks(law, condition, speed).at(
                v[there], ((1 - share) * height)[there], share[there]
            )
        return slip, peak

    return {
        "rail.best_slip": Known(
            "m/s", lambda log: found(log)[0][:, worked], "best slip, as the rail has it",
            tuple(behind[k] for k in worked), reads),
        "rail.best_adhesion": Known("1", lambda log: found(log)[1], "peak of the rail", behind,
                                    reads),
    }  # fmt: skip
