"""Peaks of the typical surfaces of Wang 2025 as a table, which follows the curves that it is of."""

from functools import lru_cache
from typing import Any

import numpy as np

from slipctl import BadInput, Block, ranged
from slipctl.models.ranges import FRICTION
from slipctl.models.wheel_rail.contact import peak_table


@lru_cache(maxsize=8)
def peaks(creep_law: Block) -> Block:
    """Table of :func:`slipctl.models.wheel_rail.contact.peak_table` with its ranges."""
    rows = {"best": (0, 50, "twice the range that is searched"), "value": (0, 2, FRICTION)}
    return ranged(peak_table(creep_law), table=rows)


def with_own_peaks(block: Block, creep_law: Block) -> Block:
    """Block whose table of peaks is made anew when its curves get other numbers.

    A table that was set by itself stays as it was set.

    Args:
        block: of the parts ``peaks`` and ``axle``, with the table of ``creep_law``.
        creep_law: law whose conditions are the typical surfaces.

    Raises:
        BadInput: when the curves are swapped for those of a law with other parameters.
    """
    rebuild = block.composition.rebuild
    free = [n for n, s in creep_law.params.items() if not s.derived]
    assert rebuild is not None

    def numbers(of: Block, part: str) -> dict[str, np.ndarray]:
        return {n: v for n, v in of.param_values().items() if n.startswith(part)}

    curves, table = (numbers(block, part) for part in ("axle.curves.", "peaks."))

    def again(parts: dict[str, Block], *shares: Any) -> Block:
        new = rebuild(parts, *shares)
        now, there = (numbers(new, part) for part in ("axle.curves.", "peaks."))
        if _equal(now, curves) or not _equal(there, table):
            return new.with_rebuild(again)
        if now.keys() != curves.keys():
            raise BadInput(
                f"{block.name}: its table of peaks is of {creep_law.name}; make the controller"
                " with creep_law=, or swap peaks first"
            )
        values = {n: now[f"axle.curves.{n}"] for n in free}
        rails = {
            rail: {n: float(np.ravel(v)[i]) for n, v in values.items() if np.size(v) > 1}
            for i, rail in enumerate(creep_law.conditions)
        }
        own = creep_law.with_params(**{n: v for n, v in values.items() if np.size(v) == 1})
        own = own.with_conditions(**rails)
        return with_own_peaks(rebuild(parts | {"peaks": peaks(own)}, *shares), own)

    return block.with_rebuild(again)


def _equal(a: dict[str, np.ndarray], b: dict[str, np.ndarray]) -> bool:
    return a.keys() == b.keys() and all(np.array_equal(a[n], b[n]) for n in a)
