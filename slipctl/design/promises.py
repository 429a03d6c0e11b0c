"""What is proved of a candidate: the certificates of its loop, asked before anything is rolled."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from time import perf_counter
from typing import Any

import numpy as np

from slipctl.block.block import Block
from slipctl.certify import catalogue, proofs
from slipctl.certify.promise import CERTIFIED, INPUT, UNDECIDED, System, exact_numbers
from slipctl.design.goals import Proved
from slipctl.errors import BadInput
from slipctl.study.declaration import Gains

STEPS = 7
"""Halvings of the interval in which the margin that is told lies; it then is known to 1 %."""

FARTHEST = 1024.0
"""Largest margin that is looked for."""

MARGINS = (1.0, 1.25, 1.5, 2.0)
"""Margins that are tried of a promise whose proof takes long."""

REMEMBERED = 24
"""Worst runs of earlier candidates that a new one is put to."""


@dataclass(frozen=True)
class Promises:
    """The certificates of a loop.

    Some proofs take longer than many runs of the loop (``catalogue.PROVED_LAST``). These are asked
    last, of a candidate that would be the best one, and once. Before, a candidate meets the worst
    runs of the earlier ones: what leaves its bound there has no proof.

    Attributes:
        gains: what a study declares of it.
        wanted: what a person asks for.
        kept: names of those that the hand-set gains have proved.
        tell: told a line of each proof that took long.
    """

    gains: tuple[Gains, ...]
    wanted: tuple[Proved, ...] = ()
    kept: tuple[str, ...] = ()
    tell: Callable[[str], None] = lambda text: None
    _decided: dict[Any, proofs.Decision] = field(default_factory=dict, repr=False, compare=False)
    _runs: dict[str, list[Any]] = field(default_factory=dict, repr=False, compare=False)

    def asked(
        self, gains: Gains, loop: Block, margin: float = 1.0
    ) -> tuple[System, dict[str, Fraction]]:
        """System of a certificate, and its numbers with bounds so many times as large."""
        system = catalogue.system_of_gains(gains, loop)
        own = {k: float(v) for k, v in gains.numbers(loop).items()}
        return system, with_margin(system, exact_numbers(system, own), margin)

    def decision(self, gains: Gains, loop: Block, margin: float = 1.0) -> proofs.Decision:
        """What is proved with bounds so many times as large; of a long proof asked once.

        Raises:
            BadInput, ArithmeticError: the numbers mean nothing.
        """
        system, numbers = self.asked(gains, loop, margin)
        if not is_last(gains):
            return proofs.decide(system, numbers)
        own = sorted(loop.values_by_place().items())
        key = (gains.name, margin, *((k, np.asarray(v).tobytes()) for k, v in own))
        if key not in self._decided:
            begun = perf_counter()
            self._decided[key] = found = proofs.decide(system, numbers)
            runs = self._runs.setdefault(gains.name, [])
            runs.extend(system.loop.worst_runs(numbers))
            del runs[:-REMEMBERED]
            times = "" if margin == 1 else f" with bounds times {margin:g}"
            self.tell(f"{gains.name}{times}: {found.verdict} after {perf_counter() - begun:.0f} s")
        return self._decided[key]

    def verdict(self, gains: Gains, loop: Block, margin: float = 1.0) -> str:
        """Verdict with every bound of the disturbances so many times as large."""
        try:
            return self.decision(gains, loop, margin).verdict
        except (BadInput, ArithmeticError):
            return UNDECIDED

    def promise(self, gains: Gains, loop: Block) -> str:
        """What is promised, in words."""
        return str(self.decision(gains, loop).promise)

    def needed(self) -> list[tuple[Gains, float, str]]:
        """Each certificate that has to be, with its margin and who wants it.

        What the hand-set gains have proved stays proved. A constraint without a name speaks of
        these; where there is none of them, of every certificate.
        """
        found = []
        for g in self.gains:
            margin, text = (1.0, f"{g.name}.certified") if g.name in self.kept else (0.0, "")
            for p in self.wanted:
                meant = g.name == p.name or (not p.name and (g.name in self.kept or not self.kept))
                if meant and p.margin >= margin:
                    margin, text = p.margin, p.text
            if margin:
                found.append((g, margin, text))
        return found

    def has_last(self) -> bool:
        """Whether something is wanted whose proof takes long."""
        return any(is_last(gains) for gains, _, _ in self.needed())

    def fails(self, loop: Block) -> str:
        """First thing that is wanted and not proved, or that has no proof; empty where none is."""
        for gains, margin, text in self.needed():
            if is_last(gains):
                if self._leaves(gains, loop, margin):
                    return text
            elif self.verdict(gains, loop, margin) != CERTIFIED:
                return text
        return ""

    def fails_last(self, loop: Block) -> str:
        """First thing that is wanted, takes long and is not proved; empty where all is."""
        for gains, margin, text in self.needed():
            if is_last(gains) and self.verdict(gains, loop, margin) != CERTIFIED:
                return text
        return ""

    def _leaves(self, gains: Gains, loop: Block, margin: float) -> bool:
        """Whether a loop leaves its bound in a run that was bad for another one."""
        runs = self._runs.get(gains.name, [])
        try:
            system, numbers = self.asked(gains, loop, margin)
            return bool(system.loop.exceeds(numbers, runs))
        except (BadInput, ArithmeticError):
            return True

    def margin(self, gains: Gains, loop: Block) -> float:
        """Factor on the bounds up to which the promise was found proved; 0 where it is not."""
        good, bad = 0.0, 1.0
        if is_last(gains):
            wanted = (m for g, m, _ in self.needed() if g is gains)
            for margin in sorted({*MARGINS, *wanted}):
                if self.verdict(gains, loop, margin) != CERTIFIED:
                    break
                good = margin
            return good
        while bad <= FARTHEST and self.verdict(gains, loop, bad) == CERTIFIED:
            good, bad = bad, 2 * bad
        if not good or bad > FARTHEST:
            return good
        for _ in range(STEPS):
            middle = (good + bad) / 2
            if self.verdict(gains, loop, middle) == CERTIFIED:
                good = middle
            else:
                bad = middle
        return good


def is_last(gains: Gains) -> bool:
    """Whether the proof of a certificate takes so long that it is asked last."""
    return gains.system in catalogue.PROVED_LAST


def with_margin(
    system: System, numbers: Mapping[str, Fraction], margin: float
) -> dict[str, Fraction]:
    """Numbers with the bounds of what is withstood ``margin`` times as large.

    Those are all inputs that are no times (a sample period, a lag); where there is none of them,
    the times. The lower end of a range is divided, so that the larger range holds the smaller one.
    """
    inputs = [k for k, v in numbers.items() if system.numbers[k].role == INPUT and v]
    bounds = [k for k in inputs if system.numbers[k].unit != "s"] or inputs
    by = Fraction(margin).limit_denominator(10**6)
    lowest = {k for k in bounds if system.numbers[k].lowest and numbers[k] > 0}
    return {k: v / by if k in lowest else v * by if k in bounds else v for k, v in numbers.items()}


def promises_of_loop(gains: Sequence[Gains], loop: str, scenario: str) -> tuple[Gains, ...]:
    """Certificates that a study declares of a loop, in this scenario or in any."""
    found = []
    for g in gains:
        name, at, where = g.loop.partition("@")
        if name == loop and (not at or where == scenario):
            found.append(g)
    return tuple(found)


def certificate(gains: Gains, loop: Block, promises: Promises, margin: float) -> dict[str, Any]:
    """Certificate as ``slipctl certify --out`` writes it, with the bounds times the margin."""
    system, numbers = promises.asked(gains, loop, margin)
    if is_last(gains):
        found = promises.decision(gains, loop, margin)
        return proofs.certificate_entries(system, numbers, found)
    return proofs.write(system, numbers)
