"""Numbers that are free: which one a name means, and the range in which it is searched."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from slipctl.block.block import Block
from slipctl.block.shared_numbers import number_at, targets
from slipctl.block.signals import Signal
from slipctl.errors import BadInput
from slipctl.run.rail import Scenario
from slipctl.run.sweep.sweep_plan import read_axis

DOOR = "--free"


@dataclass(frozen=True)
class Free:
    """A number that is searched.

    Attributes:
        name: its name in the loop. short: as a person wrote it. lo, hi: range, in ``unit``.
        now: the hand-set number.
    """

    name: str
    short: str
    lo: float
    hi: float
    unit: str
    now: float


def read_frees(
    texts: Sequence[str] | Mapping[str, Any], loop: Block, scenario: Scenario, controller: str
) -> list[Free]:
    """Read ``["k1=1:60", "k2=1:60"]`` or ``{"k1": (1, 60)}``.

    A bare name means the parameter of the controller where that has one of the name.

    Args:
        texts: as a person wrote them. loop, scenario: what runs. controller: part of the loop.

    Raises:
        BadInput: nothing, an unknown name, no range, a number that has no effect.
    """
    if isinstance(texts, Mapping):
        texts = [n if r is None else f"{n}={':'.join(str(e) for e in r)}" for n, r in texts.items()]
    if not texts:
        raise BadInput("nothing is free; write --free NAME=LO:HI, such as --free k1=1:60")
    found: list[Free] = []
    for text in texts:
        short, _, ends = (part.strip() for part in text.partition("="))
        name = _meant(short, loop, controller)
        if not ends and targets(loop, name):
            raise _no_range(short, loop.declared(name))
        axis = read_axis(f"{name}={ends}", loop, scenario, DOOR)
        if axis.points is not None:
            raise BadInput(f"{DOOR} {text!r}: write {short}=LO:HI, without a number of values")
        if any(number_at(loop, f.name) == number_at(loop, name) for f in found):
            raise BadInput(f"{DOOR} names {short} twice; write it once")
        now = float(np.asarray(loop.values_by_place()[name]))
        found.append(Free(name, short, axis.lo, axis.hi, axis.unit, now))
    return found


def _meant(short: str, loop: Block, controller: str) -> str:
    """Full name: the controller's own parameter where a bare name could be several."""
    own = [n for n in loop.params if n.startswith(f"{controller}.") and n.endswith(f".{short}")]
    if len(own) == 1 and short not in loop.params:
        return own[0]
    found = targets(loop, short)
    if len(found) > 1:
        known = ", ".join(found)
        raise BadInput(f"{DOOR} {short} means {len(found)} numbers; write one of {known}")
    return found[0] if found else short


def _no_range(short: str, signal: Signal) -> BadInput:
    """What to write where a number has no range; what is declared is what makes sense, not more."""
    told = "" if signal.unit == "1" else f" {signal.unit}"
    ends = [f"{e:g}" if isinstance(e, (int, float)) else str(e) for e in (signal.lo, signal.hi)]
    return BadInput(
        f"{DOOR} {short} has no range; write {short}=LO:HI, within the declared"
        f" {ends[0]} .. {ends[1]}{told}"
    )
