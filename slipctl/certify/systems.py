"""Report of a system: its promise, the verdict, what each criterion says, and how far it reaches.

A criterion is a list of inequalities. Asked with floats it gives margins and maps; asked with
rationals it is decided exactly, or by an outward-rounded enclosure, and the same two sides are what
a certificate holds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from typing import Any

from slipctl.certify import proofs
from slipctl.certify.margins import end, margins, unit_dependent
from slipctl.certify.promise import (
    ASIDE,
    CERTIFIED,
    CONTINUOUS,
    EXACT,
    GAIN,
    INPUT,
    NECESSARY,
    PRINTED,
    REFUTED,
    SAMPLED,
    SILENT,
    SUFFICIENT,
    TARGET,
    UNDECIDED,
    Criterion,
    Entries,
    Evidence,
    Number,
    Numbers,
    Promise,
    Quantity,
    Refuter,
    Side,
    System,
    Target,
    Witness,
    exact_numbers,
    number_text,
    rounded_up,
)

__all__ = [
    "ASIDE",
    "CERTIFIED",
    "CONTINUOUS",
    "EXACT",
    "GAIN",
    "INPUT",
    "NECESSARY",
    "PRINTED",
    "REFUTED",
    "SAMPLED",
    "SILENT",
    "SUFFICIENT",
    "TARGET",
    "UNDECIDED",
    "Criterion",
    "Entries",
    "Evidence",
    "Finding",
    "Number",
    "Numbers",
    "Promise",
    "Quantity",
    "Refuter",
    "Report",
    "Side",
    "System",
    "Target",
    "Witness",
    "end",
    "exact_numbers",
    "margins",
    "number_text",
    "report",
    "rounded_up",
    "unit_dependent",
    "worst_disturbance",
]  # fmt: skip


@dataclass(frozen=True)
class Finding:
    """What one criterion says.

    Attributes:
        verdict: CERTIFIED where it proves a clause of the promise under all that was asked, REFUTED
            where it refutes one, else UNDECIDED.
        margins: the ends at which its inequalities turn when only that number changes; None where
            they hold for none, infinite where for all.
        unit_dependent: its verdict may change with the unit in which the state is told.
        title: what the criterion is.
        holds: whether its inequalities hold; None where that was not needed.
    """

    verdict: str
    margins: Mapping[str, float | None]
    unit_dependent: bool
    title: str
    holds: bool | None = None


@dataclass(frozen=True)
class Report:
    """Verdict on a promise, and what all criteria of the system say.

    Attributes:
        system: its name.
        gains: its numbers.
        units: their units.
        verdict: CERTIFIED if a proof covers every word of the promise, REFUTED if a counterexample
            replays, else UNDECIDED.
        criteria: what each criterion says.
        values: what else is worth knowing.
        witness: a disturbance and what it does.
        time: of what the verdict speaks, CONTINUOUS or SAMPLED.
        decision: the promise, the proofs and the counterexample.
    """

    system: str
    gains: Mapping[str, float]
    units: Mapping[str, str]
    verdict: str
    criteria: Mapping[str, Finding]
    values: Mapping[str, Quantity]
    witness: Any
    time: str
    decision: proofs.Decision

    def __str__(self) -> str:
        """System and verdict in a line."""
        return f"{self.system}: {self.verdict} {self.time}"

    def payload(self) -> dict[str, Any]:
        """Entries of the JSON answer."""
        return {
            "system": self.system,
            "gains": {k: {"value": v, "unit": self.units[k]} for k, v in self.gains.items()},
            "verdict": self.verdict,
            "time": self.time,
            "promise": {"sentence": str(self.decision.promise), **self.decision.promise.payload()},
            "unproved": list(self.decision.open),
            "counterexample": self.decision.counterexample,
            "criteria": {
                name: {
                    "verdict": f.verdict,
                    "holds": f.holds,
                    "margins": {k: self._limit(k, v) for k, v in f.margins.items()},
                    "unit_dependent": f.unit_dependent,
                    "title": f.title,
                }
                for name, f in self.criteria.items()
            },
            "values": {k: {"value": v, "unit": u} for k, (v, u) in self.values.items()},
            "witness": None if self.witness is None else self.witness.payload(),
        }

    def _limit(self, name: str, value: float | None) -> dict[str, Any]:
        found = {"value": value, "unit": self.units[name.partition("_")[2]]}
        return found | ({"unlimited": True} if value == math.inf else {})


def report(system: System, given: Mapping[str, float | Fraction]) -> Report:
    """Verdict on the promise, and margins of every criterion of a system.

    Verdicts are decided with rationals (or enclosures); margins are computed with floats.

    Raises:
        BadInput: numbers that mean nothing.
    """
    numbers = exact_numbers(system, given)
    found = proofs.decide(system, numbers)
    n = {k: float(v) for k, v in numbers.items()}
    refuted = (found.counterexample or {}).get("by")
    inputs, clauses = system.inputs(numbers), system.clauses(numbers)
    criteria = {}
    trusted = proofs.trusted_criteria(system, numbers)
    for name, c in {**system.asked(numbers), **trusted}.items():
        holds: bool | None = True if name in found.proofs else None
        if holds is None and c.evidence is None:
            holds = _shown(partial(c.holds, numbers), None)
        proves = (
            trusted.get(name) is c
            and inputs <= set(c.covers)
            and any(k in clauses for k in c.proves)
        )
        said = CERTIFIED if holds and proves else REFUTED if name == refuted else UNDECIDED
        ends = system.ends(name, n) if system.ends and name in system.criteria else margins(c, n)
        unit = name in system.criteria and unit_dependent(system, name)
        criteria[name] = Finding(said, ends, unit, c.title, holds)
    units = {k: v.unit for k, v in system.numbers.items()}
    shown = system.show_witness or found.verdict == REFUTED
    return Report(
        system.name, n, units, found.verdict, criteria, _shown(lambda: system.values(n), {}),
        _shown(lambda: system.witness(n), None) if shown else None, found.promise.time, found,
    )  # fmt: skip


def worst_disturbance(system: System, given: Mapping[str, float | Fraction]) -> Any:
    """Run against the worst disturbance that a system knows; None without one.

    Raises:
        BadInput: numbers that mean nothing.
    """
    n = {k: float(v) for k, v in exact_numbers(system, given).items()}
    return _shown(lambda: system.witness(n), None)


def _shown(compute: Callable[[], Any], otherwise: Any) -> Any:
    """What is shown beside a verdict; left out where numbers are beyond what floats can hold."""
    try:
        return compute()
    except (ArithmeticError, ValueError):
        return otherwise
