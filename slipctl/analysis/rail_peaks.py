"""Peak of an adhesion law over the vehicle's speed, and over what is left of a layer."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from slipctl.block.block import Block

SHARES = np.linspace(0.0, 1.0, 65)
"""Shares of the clean curve at which the peak of a contaminated rail is looked for."""

LAYER = ("recovered", "height")
"""Inputs of a law between two curves: share of the clean one, factor on the one of the layer."""


class Peaks:
    """Best slip and peak of a law from ``v_s`` and ``v`` to ``mu``, traction positive.

    A law with the inputs of a layer is (1 - recovered) height fouled + recovered clean. Its other
    inputs have a value of their own.

    Args:
        law: the law.
        numbers: its parameters, by name; of the rest those that it has.
        speed: largest speed of the vehicle in m/s.
    """

    def __init__(self, law: Block, numbers: Mapping[str, Any], speed: float) -> None:
        self.speeds = np.linspace(0.5, max(speed, 1.0), 40)
        self.shares = SHARES if set(LAYER) <= set(law.inputs) else SHARES[-1:]
        s, v, own = ca.SX.sym("s"), ca.SX.sym("v"), law.param_values(**numbers)
        curves = []
        for share in (0.0, 1.0):
            u = {"v_s": -s, "v": v, "height": 1.0, "recovered": share}
            given = {n: u.get(n, k.value) for n, k in law.inputs.items()}
            curves.append(-law.expr({}, given, own)[1]["mu"])
        slips = np.geomspace(1e-3, 1.0, 400)[:, None] * self.speeds  # slip by speed
        both = ca.Function("curves", [s, v], curves)(slips, np.tile(self.speeds, (400, 1)))
        fouled, clean = (np.array(curve) for curve in both)
        blends = [(1 - q) * fouled + q * clean for q in self.shares]
        at = np.array([b.argmax(axis=0) for b in blends])
        self.heights = np.array([b.max(axis=0) for b in blends])
        self.slips = slips[at, np.arange(len(self.speeds))]

    def at(self, v: np.ndarray, fouled: np.ndarray, clean: np.ndarray) -> tuple[Any, Any]:
        """Best slip in m/s and peak, where the factors on the two curves are these."""
        both = np.maximum(fouled + clean, 1e-12)
        if len(self.shares) == 1:
            slips, heights = self.slips[0], self.heights[0]
            return np.interp(v, self.speeds, slips), np.interp(v, self.speeds, heights)
        j = np.rint(np.interp(v, self.speeds, np.arange(len(self.speeds)))).astype(int)
        q = clean / both * (len(self.shares) - 1)
        k = np.rint(q).astype(int)
        low = np.minimum(q.astype(int), len(self.shares) - 2)  # beside the grid, a straight line
        peak = self.heights[low, j] * (low + 1 - q) + self.heights[low + 1, j] * (q - low)
        return self.slips[k, j], both * peak
