"""What can be certified: a system with its numbers, its criteria, and what refutes it.

A criterion is a list of inequalities. Asked with floats it gives margins and maps; asked with
rationals it is decided exactly, or by an outward-rounded enclosure, and the same two sides are what
a certificate holds. Kinds of criteria:

    exact        necessary and sufficient for what it says; where it fails, a trajectory is given
    necessary    where it fails, a trajectory is given; where it holds, others have to say more
    sufficient   proves, or says nothing
    printed      a condition of a paper that proves nothing by itself
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, NamedTuple

from slipctl.certify.outward import Interval
from slipctl.errors import BadInput, nearest

CERTIFIED = "CERTIFIED"
SILENT = "NOT CERTIFIED BY THIS CRITERION"
REFUTED = "REFUTED"

CONTINUOUS, SAMPLED = "in continuous time", "as sampled"
"""Of what a verdict speaks: of the equations, or of the law that is computed once per period."""

EXACT, NECESSARY, SUFFICIENT, PRINTED = "exact", "necessary", "sufficient", "printed"

Numbers = Mapping[str, Any]
"""Values by name: floats, or rationals."""

Quantity = tuple[float, str]
"""Value and unit."""

LARGEST, SMALLEST = 10**40, Fraction(1, 10**40)


@dataclass(frozen=True)
class Number:
    """A number that a system needs.

    Attributes:
        unit: SI unit as text.
        doc: meaning.
        value: what it is when it is not told; None if it must be told.
        low: ``"positive"``, ``"not negative"`` or ``"any"``.
        power: how it grows with the state when that is told in another unit.
        optional: criteria that need it are left out when it is not told.
    """

    unit: str
    doc: str
    value: float | None = None
    low: str = "positive"
    power: float = 0.0
    optional: bool = False


class Side(NamedTuple):
    """An inequality: left < right, or left <= right where the text says so."""

    text: str
    left: Any
    right: Any

    def holds(self) -> bool | None:
        """Whether it holds; None if enclosures cannot tell."""
        closed = "<=" in self.text
        if not any(isinstance(x, Interval) for x in (self.left, self.right)):
            return bool(self.left <= self.right if closed else self.left < self.right)
        (a, b), (c, d) = _ends(self.left), _ends(self.right)
        if b < c:
            return True
        return False if a > d else None


def _ends(x: Any) -> tuple[Any, Any]:
    return x.ends() if isinstance(x, Interval) else (x, x)


@dataclass(frozen=True)
class Criterion:
    """A criterion of a system.

    Attributes:
        title: what it is, and after whom.
        sides: function of the numbers that gives its inequalities, all of which must hold.
        kind: see the module text.
        margins: ends to look for, ``("largest_W", "smallest_K1")``.
        needs: optional numbers without which it is left out.
        find: function that finds multipliers for a certificate (a matrix, a weight), None if there
            are none; ``sides`` then gets them beside the numbers.
        multipliers: their names.
    """

    title: str
    sides: Callable[[Numbers], Sequence[Side]]
    kind: str = SUFFICIENT
    margins: tuple[str, ...] = ()
    needs: tuple[str, ...] = ()
    find: Callable[[Numbers], Mapping[str, Fraction] | None] = lambda n: None
    multipliers: tuple[str, ...] = ()

    def holds(self, numbers: Numbers) -> bool:
        """Whether it holds.

        Raises:
            BadInput: the numbers lie on its boundary.
        """
        found = [(s, s.holds()) for s in self.sides(numbers)]
        if any(value is False for _, value in found):
            return False
        open_ = next((s for s, value in found if value is None), None)
        if open_ is not None:
            raise BadInput(f"on the boundary of '{open_.text}'; change a number in its last digit")
        return True


@dataclass(frozen=True)
class Finding:
    """What one criterion says.

    Attributes:
        verdict: CERTIFIED, NOT CERTIFIED BY THIS CRITERION or REFUTED.
        margins: the ends at which its verdict changes when only that number changes; None where it
            holds for none, infinite where for all.
        unit_dependent: its verdict may change with the unit in which the state is told.
        title: what the criterion is.
        holds: whether its inequalities hold; differs from the verdict for a printed condition that
            holds and proves nothing.
    """

    verdict: str
    margins: Mapping[str, float | None]
    unit_dependent: bool
    title: str
    holds: bool | None = None


@dataclass(frozen=True)
class Witness:
    """A run that refutes, or the worst one.

    Attributes:
        law: the disturbance in words.
        found: what the simulated run shows, value and unit by name.
        trajectory: unit and values by signal, thinned.
    """

    law: str
    found: Mapping[str, Quantity] = field(default_factory=dict)
    trajectory: Mapping[str, tuple[str, Sequence[float]]] = field(default_factory=dict)

    def payload(self) -> dict[str, Any]:
        """Entries of the JSON answer."""
        return {
            "law": self.law,
            **{k: {"value": v, "unit": u} for k, (v, u) in self.found.items()},
            "trajectory": {
                k: {"unit": u, "value": [float(f"{v:.8g}") for v in values]}
                for k, (u, values) in self.trajectory.items()
            },
        }

    def lines(self) -> list[str]:
        """Lines of the table."""
        shown = "; ".join(f"{k.replace('_', ' ')} {v:.6g}{_spaced(u)}"
                          for k, (v, u) in self.found.items())  # fmt: skip
        return [f"disturbance: {self.law}", *([f"simulated: {shown}"] if shown else [])]


def _spaced(unit: str) -> str:
    return "" if unit == "1" else f" {unit}"


@dataclass(frozen=True)
class System:
    """A system that can be certified.

    Attributes:
        name: as on the command line.
        title: its equations and what is asked, in a sentence.
        numbers: what it needs, by name.
        criteria: its criteria by name.
        values: function that computes what else is worth knowing.
        witness: function that simulates the worst disturbance, or what refutes; None if the
            verdict needs none.
        panel: numbers at which the unit of the state is changed.
        answer: its own report, where ends are known in closed form.
        time: function that says whether the verdict is CONTINUOUS or SAMPLED.
    """

    name: str
    title: str
    numbers: Mapping[str, Number]
    criteria: Mapping[str, Criterion]
    values: Callable[[Numbers], Mapping[str, Quantity]] = lambda n: {}
    witness: Callable[[Numbers], Witness | None] = lambda n: None
    panel: tuple[Mapping[str, float], ...] = ()
    answer: Callable[[Mapping[str, Any]], Report] | None = None
    time: Callable[[Numbers], str] = lambda n: CONTINUOUS

    def asked(self, numbers: Numbers) -> dict[str, Criterion]:
        """Criteria whose numbers are all told."""
        return {k: c for k, c in self.criteria.items() if all(n in numbers for n in c.needs)}


@dataclass(frozen=True)
class Report:
    """Verdicts of all criteria of a system.

    Attributes:
        system: its name.
        gains: its numbers.
        units: their units.
        verdict: REFUTED if an exact or necessary criterion fails; else CERTIFIED if all exact ones
            hold, or, where there are none, one that is sufficient.
        criteria: what each criterion says.
        values: what else is worth knowing.
        witness: a disturbance and what it does.
        time: of what the verdict speaks, CONTINUOUS or SAMPLED.
    """

    system: str
    gains: Mapping[str, float]
    units: Mapping[str, str]
    verdict: str
    criteria: Mapping[str, Finding]
    values: Mapping[str, Quantity]
    witness: Any = None
    time: str = CONTINUOUS

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
            "criteria": {
                name: {
                    "verdict": f.verdict,
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


# ---- numbers ------------------------------------------------------------------------------------


def checked(
    system: System, given: Mapping[str, float | Fraction], whole: bool = True
) -> dict[str, Fraction]:
    """Numbers of a system as exact rationals, those that were not told in their place.

    Args:
        system: the system. given: numbers by name. whole: whether all that it needs must be there.

    Raises:
        BadInput: an unknown or missing name, or a number that means nothing.
    """
    known = system.numbers
    for name in given:
        if name not in known:
            raise BadInput(f"{system.name} has no {name!r}{nearest(name, known)}")
    missing = [k for k, n in known.items() if k not in given and n.value is None and not n.optional]
    if missing and whole:
        lacking = " ".join(f"{k}=VALUE" for k in missing)
        raise BadInput(f"{system.name} needs {', '.join(missing)}; add --set {lacking}")
    out = {}
    for name, number in known.items():
        value = given.get(name, number.value)
        if value is None:
            continue
        unit = "" if number.unit == "1" else f" {number.unit}"
        if isinstance(value, float) and not math.isfinite(value):
            raise BadInput(f"{name} = {value} is no finite number; write one in {number.unit}")
        exact = Fraction(value)
        if number.low != "any" and (exact < 0 or (exact == 0 and number.low == "positive")):
            least = "more than 0" if number.low == "positive" else "0 or more"
            raise BadInput(f"{name} = {float(value):g}{unit} must be {least}")
        if exact and not SMALLEST <= abs(exact) <= LARGEST:
            raise BadInput(f"{name} must lie between 1e-40 and 1e40{unit}")
        out[name] = exact
    return out


# ---- margins ------------------------------------------------------------------------------------


def end(holds: Callable[[float], bool], value: float, up: bool) -> float | None:
    """Largest (``up``) or smallest number at which a verdict still holds, searched from ``value``.

    From a value that holds, doubling (halving) finds one that does not; from one that does not, a
    factor of 1.1 finds one that does, within 1e-6 to 1e6. Then bisection to the last digits. So it
    is the end of the stretch of numbers of one sign that hold next to ``value``.

    Returns:
        The end; None if none holds, inf or 0 if there is no end.
    """
    if value < 0:
        found = end(lambda x: holds(-x), -value, not up)
        return None if found is None else -found
    away, limit = (2.0, 1e40) if up else (0.5, 1e-40)
    start = value or (1e-12 if up else 0.0)
    if not holds(value):
        if value == 0:
            return None
        back = 1 / 1.1 if up else 1.1
        outside = value
        for _ in range(150):
            inside = outside * back
            if holds(inside):
                break
            outside = inside
        else:
            return None
    elif value == 0 and not up:
        return 0.0
    else:
        inside = value
        outside = start
        while holds(outside):
            inside, outside = outside, outside * away
            if (outside > limit) if up else (outside < limit):
                return math.inf if up else 0.0
    for _ in range(200):
        middle = (outside + inside) / 2
        if middle in (outside, inside):
            break
        inside, outside = (middle, outside) if holds(middle) else (inside, middle)
    return inside


def margins(criterion: Criterion, numbers: Mapping[str, float]) -> dict[str, float | None]:
    """Ends at which the verdict of a criterion changes, each with the other numbers as they are."""
    found: dict[str, float | None] = {}
    for margin in criterion.margins:
        side, _, name = margin.partition("_")
        if name in numbers:

            def holds(x: float, name: str = name) -> bool:
                try:
                    return criterion.holds({**numbers, name: x})
                except (ArithmeticError, ValueError):
                    return False

            found[margin] = end(holds, float(numbers[name]), side == "largest")
    return found


def unit_dependent(system: System, name: str, scale: float = 1000.0) -> bool:
    """Whether a verdict of a criterion changes when the state is told in another unit."""
    criterion = system.criteria[name]
    for panel in system.panel:
        defaults = {k: n.value for k, n in system.numbers.items() if n.value is not None}
        numbers = {**defaults, **panel}
        if not all(n in numbers for n in criterion.needs):
            continue
        for c in (scale, 1 / scale):
            moved = {k: v * c ** system.numbers[k].power for k, v in numbers.items()}
            if criterion.holds(numbers) != criterion.holds(moved):
                return True
    return False


# ---- the report ---------------------------------------------------------------------------------


def verdict_of(system: System, held: Mapping[str, bool]) -> str:
    """Overall verdict from what each criterion says."""
    kinds = {k: system.criteria[k].kind for k in held}
    hard = [k for k in held if kinds[k] in (EXACT, NECESSARY)]
    if not all(held[k] for k in hard):
        return REFUTED
    if any(kinds[k] == EXACT for k in hard):
        return CERTIFIED
    return CERTIFIED if any(held[k] and kinds[k] == SUFFICIENT for k in held) else SILENT


def report(system: System, given: Mapping[str, float | Fraction]) -> Report:
    """Verdict and margins of every criterion of a system.

    Verdicts are decided with rationals (or enclosures); margins are computed with floats.

    Raises:
        BadInput: numbers that mean nothing, or that lie on the boundary of a criterion.
    """
    if system.answer is not None:
        return system.answer(given)
    numbers = checked(system, given)
    asked = system.asked(numbers)
    held = {k: c.holds(numbers) for k, c in asked.items()}
    verdict = verdict_of(system, held)
    n = {k: float(v) for k, v in numbers.items()}
    found = {}
    for name, c in asked.items():
        said = CERTIFIED if held[name] else REFUTED if c.kind in (EXACT, NECESSARY) else SILENT
        if c.kind == PRINTED:
            said = SILENT
        found[name] = Finding(said, margins(c, n), unit_dependent(system, name), c.title,
                              held[name])  # fmt: skip
    units = {k: v.unit for k, v in system.numbers.items()}
    return Report(
        system.name, n, units, verdict, found, system.values(n),
        system.witness(n) if verdict == REFUTED else None, system.time(n),
    )  # fmt: skip
