"""Numbers of a loop that a person can move: range, unit, source and where a slider ends."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from slipctl.block.block import Block
from slipctl.errors import BadInput
from slipctl.run.rail import Scenario
from slipctl.run.scenario_inputs import loop_at_start, rail_values
from slipctl.study.files.loop_files import ruled_numbers
from slipctl.workbench.curves import finite

FACTOR = 5.0
"""How far a slider goes from the default, to either side, where its declared range is wider."""


@dataclass(frozen=True)
class Slider:
    """A number that can be moved.

    Attributes:
        name: as ``--set`` takes it. value: as the loop has it. unit: of all numbers here.
        lo, hi: declared range; None where it has no end. left, right: ends of the slider.
        by_ratio: whether equal steps are equal ratios. doc, source: its meaning, where it is from.
        group: what it belongs to: ``law``, ``controller``, ``vehicle and rail``.
    """

    name: str
    value: float
    unit: str
    lo: float | None
    hi: float | None
    left: float
    right: float
    by_ratio: bool
    doc: str
    source: str
    group: str


def sliders_of_loop(loop: Block, scenario: Scenario, controller: str = "ctl") -> list[Slider]:
    """Numbers of a loop that stand for themselves and have an effect, the law's first.

    Left out are those that follow from others, that the rail sets, and the tick.
    """
    begun = loop_at_start(loop, scenario)
    ruled = {n for group in rail_values(begun, scenario) for n in group}
    ruled |= ruled_numbers(loop, scenario)
    values, found = begun.param_values(), []
    for name, s in loop.params.items():
        free = not (s.derived or isinstance(s.value, str) or s.value is None or s.values)
        if not free or s.shape or name in ruled or name not in values or _is_tick(loop, name):
            continue
        value = float(np.asarray(values[name]))
        left, right, by_ratio = ends_of_slider(value, float(s.lo), float(s.hi))
        found.append(Slider(
            name, value, s.unit, finite(s.lo), finite(s.hi), left, right, by_ratio,
            " ".join(s.doc.split()), s.source, _group(loop, name, controller),
        ))  # fmt: skip
    order = {"law": 0, "vehicle and rail": 1, "controller": 2}
    return sorted(found, key=lambda s: order[s.group])


def ends_of_slider(value: float, lo: float, hi: float) -> tuple[float, float, bool]:
    """Where a slider begins and ends within a declared range, and whether it goes by ratio."""
    if value == 0:
        wide = min(max(-lo, hi), 1.0) if math.isfinite(max(-lo, hi)) else 1.0
        return max(lo, -wide), min(hi, wide), False
    near, far = sorted((value / FACTOR, value * FACTOR))
    left, right = max(lo, near), min(hi, far)
    if not left < right:
        left, right = lo, hi
    return left, right, bool(left > 0 and right / left >= FACTOR)


def check_numbers(numbers: Any, sliders: Iterable[Slider]) -> dict[str, float]:
    """Numbers that a page sent, each a slider's and in its declared range.

    Raises:
        BadInput: another name, no number, or out of range.
    """
    known = {s.name: s for s in sliders}
    if not isinstance(numbers, Mapping):
        raise BadInput("numbers are no table of name and number")
    found = {}
    for name, value in numbers.items():
        if name not in known:
            raise BadInput(f"{str(name)[:80]!r} is no number that can be moved")
        s = known[name]
        plain = isinstance(value, int | float) and not isinstance(value, bool)
        if not plain or not math.isfinite(value):
            raise BadInput(f"{name} = {str(value)[:40]} is no number")
        low, high = (-math.inf if s.lo is None else s.lo), (math.inf if s.hi is None else s.hi)
        if not low <= value <= high:
            unit = "" if s.unit == "1" else f" {s.unit}"
            raise BadInput(f"{name} = {value:g}{unit} is outside {low:g} .. {high:g}{unit}")
        found[name] = float(value)
    return found


def _is_tick(loop: Block, name: str) -> bool:
    """Whether a number is the length of a tick: that is another loop, not another number."""
    value = loop.param_values().get(name)
    return (
        name.rpartition(".")[2] in ("T", "h")
        and loop.period is not None
        and math.isclose(float(np.asarray(value)), loop.period)
    )


def _group(loop: Block, name: str, controller: str) -> str:
    law = f"{controller}.law."
    while any(n.startswith(f"{law}law.") for n in loop.params):  # a law in its common form
        law += "law."
    if name.startswith(law) and "." not in name.removeprefix(law):
        return "law"
    return "controller" if name.startswith(f"{controller}.") else "vehicle and rail"
