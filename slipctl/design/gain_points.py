"""A certificate of a loop at other numbers: the bounds are those that the loop has there."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from slipctl.block.block import Block
from slipctl.certify import catalogue
from slipctl.certify.promise import System
from slipctl.design.levels import NEAR, places
from slipctl.errors import BadInput
from slipctl.run.numbers import check_guards
from slipctl.study.declaration import Gains

Asked = tuple[System, Mapping[str, Any]]
"""A system and its numbers."""

PROBES = (1.05, 0.95)
"""Factors by which a number of the loop is moved to see that the certificate follows it."""


@dataclass(frozen=True)
class GainPoints:
    """What is asked of a loop, at numbers of its certificate other than its own.

    A bound may depend on a gain, as the slope of a disturbance does on how fast a law acts. So the
    numbers of a point are those that ``slipctl certify STUDY:LOOP --set`` gets: of the loop with
    the gains of the point. A number that the loop does not have, as a bound that is told, is
    replaced in the certificate alone.

    Attributes:
        gains: the certificate. loop: whose it is. controller: part of it that has the gains.
    """

    gains: Gains
    loop: Block
    controller: str

    @cached_property
    def here(self) -> dict[str, float]:
        """Numbers of the loop as it is."""
        return self._numbers(self.loop)

    def place(self, name: str) -> str | None:
        """Number of the loop that sets one of the certificate; None where none does."""
        if name not in self._places:
            self._places[name] = self._place(name)
        return self._places[name]

    @cached_property
    def _places(self) -> dict[str, str | None]:
        return {}

    def _place(self, name: str) -> str | None:
        value = self.here.get(name)
        if not value:
            return None
        try:
            at, _ = places(self.loop, self.controller, [name, name], self.here)
        except BadInput:
            return None
        for factor in PROBES:
            try:
                moved = self._numbers(self.loop.with_params(**{at: factor * value}))
            except BadInput:
                continue  # not in its range
            return at if math.isclose(moved[name], factor * value, rel_tol=NEAR) else None
        return None

    def at(self, numbers: Mapping[str, float]) -> Asked:
        """System and numbers of a point.

        Args:
            numbers: of the certificate, by its names.

        Raises:
            BadInput: numbers that mean nothing, or that the loop refuses.
        """
        own = {at: float(v) for n, v in numbers.items() if (at := self.place(n)) is not None}
        loop = self.loop.with_params(**own) if own else self.loop
        return catalogue.system_of_gains(self.gains, loop), {**self._numbers(loop), **numbers}

    def _numbers(self, loop: Block) -> dict[str, float]:
        check_guards(loop)
        return {k: float(v) for k, v in self.gains.numbers(loop).items()}


def replaced_numbers(
    system: System, given: Mapping[str, Any]
) -> Callable[[Mapping[str, float]], Asked]:
    """Points of a system that no loop stands behind: its numbers with some of them replaced."""
    return lambda numbers: (system, {**given, **numbers})
