"""What is proved of a candidate: the certificates of its loop, asked before anything is rolled."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

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


@dataclass(frozen=True)
class Promises:
    """The certificates of a loop.

    Attributes:
        gains: what a study declares of it.
        wanted: what a person asks for.
        kept: names of those that the hand-set gains have proved.
    """

    gains: tuple[Gains, ...]
    wanted: tuple[Proved, ...] = ()
    kept: tuple[str, ...] = ()

    def numbers(self, gains: Gains, loop: Block) -> dict[str, Fraction]:
        """Numbers of a certificate for a loop as it is."""
        system = catalogue.system_of_gains(gains, loop)
        return exact_numbers(system, {k: float(v) for k, v in gains.numbers(loop).items()})

    def verdict(self, gains: Gains, loop: Block, margin: float = 1.0) -> str:
        """Verdict with every bound of the disturbances so many times as large."""
        system = catalogue.system_of_gains(gains, loop)
        try:
            numbers = with_margin(system, self.numbers(gains, loop), margin)
            return proofs.decide(system, numbers).verdict
        except (BadInput, ArithmeticError):
            return UNDECIDED

    def promise(self, gains: Gains, loop: Block) -> str:
        """What is promised, in words."""
        system = catalogue.system_of_gains(gains, loop)
        return str(proofs.decide(system, self.numbers(gains, loop)).promise)

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

    def fails(self, loop: Block) -> str:
        """First thing that is wanted and not proved, empty where all is."""
        for gains, margin, text in self.needed():
            if self.verdict(gains, loop, margin) != CERTIFIED:
                return text
        return ""

    def margin(self, gains: Gains, loop: Block) -> float:
        """Factor on the bounds up to which the promise was found proved; 0 where it is not."""
        good, bad = 0.0, 1.0
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
    system = catalogue.system_of_gains(gains, loop)
    return proofs.write(system, with_margin(system, promises.numbers(gains, loop), margin))
