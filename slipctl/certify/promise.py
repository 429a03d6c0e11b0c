"""What can be certified: a system, its numbers, what is promised of it, and what proves or refutes.

A promise is one sentence: from every start in this set, this quantity stays below this number, or
tends to zero. It holds for every disturbance in a set, a step, an error, a noise, a lag and a
sample time, together. It is put together from the numbers that are told:

    gain    a number of the law or of the plant. Every criterion uses it as it is
    input   what the promise has to withstand (a disturbance, a lag, a sample time)
    target  what has to be reached (a band, a time). Each that is told is a clause of the promise
    aside   a number that only values are computed from; it is listed as not promised

A criterion proves a clause only where it covers every input that is told. A promise is refuted only
by a counterexample that is replayed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, NamedTuple

from slipctl.certify.arithmetic.decimal_intervals import Interval
from slipctl.errors import BadInput, nearest

CERTIFIED, REFUTED, UNDECIDED = "CERTIFIED", "REFUTED", "UNDECIDED"
SILENT = UNDECIDED
"""A criterion that says nothing."""

CONTINUOUS, SAMPLED = "in continuous time", "as sampled"
"""Of what a verdict speaks: of the equations, or of the law that is computed once per period."""

GAIN, INPUT, TARGET, ASIDE = "gain", "input", "target", "aside"

EXACT, NECESSARY, SUFFICIENT, PRINTED = "exact", "necessary", "sufficient", "printed"
"""What a criterion is, in words for the reader; no verdict follows from the word."""

Numbers = Mapping[str, Any]
"""Values by name: floats, or rationals."""

Entries = Mapping[str, Any]
"""What a file holds: texts, whole numbers, lists and mappings of them."""

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
        role: GAIN, INPUT, TARGET or ASIDE, see the module text.
        says: clause of the promise for an input, ``"every |d| <= {}"``; {} is the number.
        absent: what is not promised where an input is zero or not told, ``"a disturbance"``.
        hint: what the line says more that refuses a number that is too low.
        lowest: whether it is the lower end of a range, of which less is more to withstand.
    """

    unit: str
    doc: str
    value: float | None = None
    low: str = "positive"
    power: float = 0.0
    optional: bool = False
    role: str = GAIN
    says: str = ""
    absent: str = ""
    hint: str = ""
    lowest: bool = False


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
class Evidence:
    """A proof that is more than inequalities of the numbers: an invariant set, a matrix per cell.

    Attributes:
        find: from the numbers as rationals to what the file holds, by any search; None if it finds
            none.
        check: confirms it without a search, with rationals or outward-rounded enclosures, in a
            bounded number of steps.

            Raises: ``DoesNotHold`` if it proves nothing, ``BadInput`` if it is malformed.
    """

    find: Callable[[Numbers], Entries | None]
    check: Callable[[Numbers, Entries], None]


@dataclass(frozen=True)
class Refuter:
    """Counterexamples of a clause: how one is found, and how it is replayed.

    Attributes:
        target: the clause that it refutes.
        find: from the numbers as rationals to a start and a disturbance; None if it finds none.
        replay: runs it with rationals or outward-rounded enclosures, and says in a line what
            happens.

            Raises: ``DoesNotHold`` if it does not leave, or uses a disturbance that is not
            allowed; ``BadInput`` if it is malformed.
        quick: a search of little work for the same, which is tried before any proof.
    """

    target: str
    find: Callable[[Numbers], Entries | None]
    replay: Callable[[Numbers, Entries], str]
    quick: Callable[[Numbers], Entries | None] | None = None


@dataclass(frozen=True)
class Criterion:
    """A criterion of a system.

    Attributes:
        title: what it is, and after whom.
        sides: function of the numbers that gives its inequalities, all of which must hold.
        kind: EXACT, NECESSARY, SUFFICIENT or PRINTED, for the reader.
        margins: ends to look for, ``("largest_W", "smallest_K1")``.
        needs: optional numbers without which it is left out.
        find: function that finds multipliers for a certificate (a matrix, a weight), None if there
            are none; ``sides`` then gets them beside the numbers.
        multipliers: their names.
        proves: clauses that hold where its inequalities hold.
        covers: inputs that its proof includes; it proves nothing where another one is told.
        refutes: a disturbance in closed form, in words, that breaks the first clause of ``proves``
            wherever an inequality is false; empty if there is none.
        refuted_under: inputs under which that disturbance does so; those of ``covers`` if None.
        evidence: a proof that is more than inequalities; it stands in the place of ``sides``.
        step: gives the negation of the step of its proof as SMT-LIB, of the numbers and of what
            the file holds, in one problem or several; see ``smtlib``.
    """

    title: str
    sides: Callable[[Numbers], Sequence[Side]] | None = None
    kind: str = SUFFICIENT
    margins: tuple[str, ...] = ()
    needs: tuple[str, ...] = ()
    find: Callable[[Numbers], Mapping[str, Fraction] | None] = lambda n: None
    multipliers: tuple[str, ...] = ()
    proves: tuple[str, ...] = ()
    covers: tuple[str, ...] = ()
    refutes: str = ""
    refuted_under: tuple[str, ...] | None = None
    evidence: Evidence | None = None
    step: Callable[[Numbers, Entries], str | Sequence[str] | None] | None = None

    def holds(self, numbers: Numbers) -> bool:
        """Whether all its inequalities hold; where an enclosure cannot tell, it does not hold."""
        if self.sides is None:
            found = self.evidence.find(numbers) if self.evidence else None
            return found is not None
        return all(s.holds() for s in self.sides(numbers))


@dataclass(frozen=True)
class Target:
    """A clause of the promise.

    Attributes:
        claim: ``"|s| stays below {band} in the end"``, numbers in braces. Or a function of the
            numbers and of what its proof holds (empty where there is none), for a bound that the
            proof finds itself.
        needs: numbers that ask for it; one without is always asked.
        unasked: what is listed as not promised where it is not asked.
        unless: targets that stand in its place where they are asked.
    """

    claim: str | Callable[[Numbers, Entries], str]
    needs: tuple[str, ...] = ()
    unasked: str = ""
    unless: tuple[str, ...] = ()


@dataclass(frozen=True)
class Promise:
    """A promise in words.

    Attributes:
        of: the system's name and its gains.
        against: what it withstands, all of it together.
        start: the set of starts.
        claims: what then holds, by the name of the clause.
        time: CONTINUOUS or SAMPLED.
        not_promised: what it does not speak of.
    """

    of: tuple[str, ...]
    against: tuple[str, ...]
    start: str
    claims: Mapping[str, str]
    time: str
    not_promised: tuple[str, ...] = ()

    def __str__(self) -> str:
        """Give the one sentence."""
        many = ", together" if len(self.against) > 1 else ""
        against = f"for {and_list(self.against)}{many}, " if self.against else ""
        return f"{self.time}, {against}from {self.start}: {and_list(tuple(self.claims.values()))}"

    def payload(self) -> dict[str, Any]:
        """Entries of the file."""
        return {
            "of": list(self.of), "against": list(self.against), "from": self.start,
            "claims": dict(self.claims), "time": self.time, "not_promised": list(self.not_promised),
        }  # fmt: skip


def and_list(words: Sequence[str]) -> str:
    """Words as "a, b and c"."""
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


@dataclass(frozen=True)
class Witness:
    """A run that refutes, or the worst one, for a person to look at.

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
        shown = "; ".join(f"{k.replace('_', ' ')} {number_text(v, u, 6)}"
                          for k, (v, u) in self.found.items())  # fmt: skip
        return [f"disturbance: {self.law}", *([f"simulated: {shown}"] if shown else [])]


def number_text(value: Any, unit: str, digits: int = 10) -> str:
    """Number with its unit; a promise shows 10 digits, the numbers of the file are exact."""
    return f"{float(value):.{digits}g}" + ("" if unit == "1" else f" {unit}")


def rounded_up(value: Fraction, digits: int = 6) -> Fraction:
    """Smallest number of so many digits that is not below a positive one; for a bound in words."""
    if value <= 0:
        return Fraction(0)
    power = digits - 1 - math.floor(math.log10(value.numerator) - math.log10(value.denominator))
    scale = Fraction(10) ** power
    return Fraction(math.ceil(value * scale)) / scale


@dataclass(frozen=True)
class System:
    """A system that can be certified.

    Attributes:
        name: as on the command line.
        title: its equations and what is asked, in a sentence.
        numbers: what it needs, by name.
        criteria: its criteria by name; of those that prove the same the first is tried first.
        targets: clauses of its promise by name.
        start: the set of starts, in words; numbers in braces.
        refuters: what finds and replays counterexamples, by name.
        never: what no certificate of this system speaks of.
        values: function that computes what else is worth knowing.
        witness: function that simulates the worst disturbance, or what refutes; None if the
            verdict needs none.
        show_witness: whether it is shown whatever the verdict.
        panel: numbers at which the unit of the state is changed.
        ends: margins of a criterion in closed form, of its name and the numbers.
        guard: refuses further numbers that mean nothing.
        loop: its equations tick by tick (``tick_sets.Loop``), so that the verdict is SAMPLED; of a
            system that this package does not have, what is computed from them is all that proves
            or refutes.
        time: function that says whether the verdict is CONTINUOUS or SAMPLED.
    """

    name: str
    title: str
    numbers: Mapping[str, Number]
    criteria: Mapping[str, Criterion]
    targets: Mapping[str, Target]
    start: str | Callable[[Numbers], str] = "every start"
    refuters: Mapping[str, Refuter] = field(default_factory=dict)
    never: tuple[str, ...] = ()
    values: Callable[[Numbers], Mapping[str, Quantity]] = lambda n: {}
    witness: Callable[[Numbers], Any] = lambda n: None
    show_witness: bool = False
    panel: tuple[Mapping[str, float], ...] = ()
    ends: Callable[[str, Numbers], Mapping[str, float | None]] | None = None
    guard: Callable[[Numbers], None] = lambda n: None
    loop: Any = None
    time: Callable[[Numbers], str] = lambda n: CONTINUOUS

    def asked(self, numbers: Numbers) -> dict[str, Criterion]:
        """Criteria whose numbers are all told."""
        return {k: c for k, c in self.criteria.items() if all(n in numbers for n in c.needs)}

    def clauses(self, numbers: Numbers) -> dict[str, Target]:
        """Clauses that are asked for."""
        told = {k: t for k, t in self.targets.items() if all(n in numbers for n in t.needs)}
        return {k: t for k, t in told.items() if not any(u in told for u in t.unless)}

    def inputs(self, numbers: Numbers) -> set[str]:
        """Inputs that are told and not zero: what a proof has to cover."""
        return {k for k, n in self.numbers.items() if n.role == INPUT and numbers.get(k)}

    def promise(self, numbers: Numbers, proofs: Mapping[str, Entries] | None = None) -> Promise:
        """Put the promise into words.

        Args:
            numbers: the numbers. proofs: what proves each clause, by its name.
        """
        words = {k: number_text(v, self.numbers[k].unit) for k, v in numbers.items()}
        told = self.inputs(numbers)
        against = [n.says.format(words[k]) for k, n in self.numbers.items() if k in told and n.says]
        left = [n.absent for k, n in self.numbers.items() if k not in told and n.absent]
        asked = self.clauses(numbers)
        left += [t.unasked for k, t in self.targets.items() if k not in asked and t.unasked]
        left += [f"{k}: values only" for k, n in self.numbers.items()
                 if n.role == ASIDE and k in numbers]  # fmt: skip
        claims = {
            k: t.claim.format(**words) if isinstance(t.claim, str)
            else t.claim(numbers, (proofs or {}).get(k, {}))
            for k, t in asked.items()
        }  # fmt: skip
        start = self.start.format(**words) if isinstance(self.start, str) else self.start(numbers)
        of = [f"{k} = {words[k]}" for k, n in self.numbers.items()
              if k in numbers and n.role in (GAIN, TARGET)]  # fmt: skip
        left = [*dict.fromkeys(left), *self.never]
        time = SAMPLED if self.loop is not None else self.time(numbers)
        return Promise((self.name, *of), tuple(against), start, claims, time, tuple(left))


# ---- numbers ------------------------------------------------------------------------------------


def exact_numbers(
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
        exact = Fraction(value) if name in given else Fraction(str(value))
        if number.low != "any" and (exact < 0 or (exact == 0 and number.low == "positive")):
            least = "more than 0" if number.low == "positive" else "0 or more"
            raise BadInput(f"{name} = {float(value):g}{unit} must be {least}{number.hint}")
        if exact and not SMALLEST <= abs(exact) <= LARGEST:
            raise BadInput(f"{name} must lie between 1e-40 and 1e40{unit}")
        out[name] = exact
    if whole:
        system.guard(out)
    return out


def check_whole(system: str, n: Numbers, *names: str) -> None:
    """Refuse numbers that count something and are not whole.

    Raises:
        BadInput: with the first of them.
    """
    for name in names:
        if name in n and (n[name] != int(n[name]) or n[name] > 10**15):
            raise BadInput(
                f"{system}: {name} = {float(n[name]):g} must be a whole number, at most 1e15"
            )
