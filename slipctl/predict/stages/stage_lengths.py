"""Stages of growing length: far ahead coarsely, with few stages.

Stage k is s_k h long, s_k = grow^k. The plant has the further input ``stretch``, by which its rates
are multiplied: a step over h is one over s_k h. A plan is shifted by h, which is not a stage any
more: states are taken between its stages, controls and statuses from the stage that is there.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from slipctl.block.block import Block
from slipctl.block.signals import Input
from slipctl.errors import BadInput, check_positive
from slipctl.predict.stages.joint_flow import with_inputs

STRETCH = "stretch"
"""Input of the plant: length of a stage over h."""

LONGEST = 1e3
"""Longest stage over the first one."""


def lengths(where: str, grow: float, stages: int) -> tuple[float, ...]:
    """Length of each stage over h; none where they are all alike.

    Raises:
        BadInput: stages that get shorter, or longer than a thousand of the first.
    """
    check_positive(f"{where}: grow", grow)
    if grow < 1 or grow ** (stages - 1) > LONGEST:
        most = LONGEST ** (1 / max(stages - 1, 1))
        raise BadInput(f"{where}: grow = {grow:g}; give 1 to {most:.3g} for {stages} stages")
    return () if grow == 1 else tuple(float(grow**k) for k in range(stages))


def with_time_scale(plant: Block) -> Block:
    """The plant with its rates multiplied by a further input."""

    def change(n: dict[str, Any], u: Mapping[str, Any]) -> dict[str, Any]:
        return {k: u[STRETCH] * v for k, v in n.items()}

    told = Input("1", "length of a stage over the first one", value=1.0).named(STRETCH)
    return with_inputs(plant, [told], change)


def plan_shift(lengths: tuple[float, ...]) -> tuple[ca.DM, list[int]]:
    """How a plan is shifted by the first stage.

    Returns:
        The matrix that takes states at the ends of the stages, and one more a first stage after
        the last, to those a first stage later; and for each stage the one whose control is there.
    """
    edges = np.concatenate([[0.0], np.cumsum(lengths)])
    known = np.append(edges, edges[-1] + 1)
    places = ca.DM(len(known), len(edges))
    for k, t in enumerate(edges + 1):
        j = min(int(np.searchsorted(known, t, side="right")) - 1, len(known) - 2)
        share = (t - known[j]) / (known[j + 1] - known[j])
        for row, part in ((j, 1 - share), (j + 1, share)):
            if part > 0:
                places[row, k] = part
    middle = (edges[1:] + edges[:-1]) / 2 + 1
    stages = np.minimum(np.searchsorted(edges, middle, side="right") - 1, len(lengths) - 1)
    return places, [int(k) for k in stages]
