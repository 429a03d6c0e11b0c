"""From numbers to a verdict: each clause proved, or a counterexample that replays, or neither.

``decide`` looks for proofs and counterexamples with rationals and outward-rounded enclosures.
``write`` puts what it found into a file. ``check`` computes all of it again from the numbers in
the file and from what stands beside them, without a search: what does not come out is no proof.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any

from slipctl.certify import registry
from slipctl.certify.arithmetic.decimal_intervals import Interval
from slipctl.certify.entries import DoesNotHold, brief, rational, read_mapping, refuse_unknown
from slipctl.certify.promise import (
    CERTIFIED,
    REFUTED,
    UNDECIDED,
    Criterion,
    Entries,
    Promise,
    Refuter,
    Side,
    System,
    exact_numbers,
)
from slipctl.errors import BadInput

KIND = "certificate"
FORMAT = 2
"""Of certificates; format 1 left out what its proofs did not use."""

ENTRIES = ("format", "kind", "system", "asked", "promise", "verdict", "time", "proofs",
           "counterexample")  # fmt: skip


@dataclass(frozen=True)
class Decision:
    """What was found about a promise.

    Attributes:
        verdict: CERTIFIED, REFUTED or UNDECIDED.
        promise: the promise.
        proofs: what the file holds of each criterion that proves a clause.
        counterexample: what the file holds of a counterexample, None if there is none.
        open: clauses without a proof, whether or not one was looked for.
        shows: what the counterexample does, in a line.
    """

    verdict: str
    promise: Promise
    proofs: Mapping[str, Entries] = field(default_factory=dict)
    counterexample: Entries | None = None
    open: tuple[str, ...] = ()
    shows: str = ""


def decide(system: System, numbers: Mapping[str, Fraction], every: bool = False) -> Decision:
    """Prove each clause that is asked, or find a counterexample.

    A counterexample that takes little work to find is looked for before any proof. Every other
    one is, as soon as a clause has no proof: what is false is not proved any further.

    Args:
        system: the system. numbers: as ``exact_numbers`` gives them.
        every: whether each criterion that proves a clause is kept, not only the first.
    """
    inputs, clauses = system.inputs(numbers), system.clauses(numbers)
    criteria = trusted_criteria(system, numbers)
    tried: dict[str, Entries | None] = {}
    first: dict[str, str] = {}
    left: list[str] = []
    against, shows = counterexample(system, numbers, tuple(clauses), quick=True)
    for clause in clauses:
        if against is not None:
            break
        for name, c in criteria.items():
            if clause in c.proves and inputs <= set(c.covers):
                if name not in tried:
                    tried[name] = _try(c, numbers)
                if tried[name] is not None:
                    first.setdefault(clause, name)
                    if not every:
                        break
        if clause not in first:
            left.append(clause)
            against, shows = counterexample(system, numbers, (clause,))
    proofs = {k: v for k, v in tried.items() if v is not None}
    if against is not None:
        left = [k for k in clauses if k not in first]
    by = {} if left else {clause: proofs[name] for clause, name in first.items()}
    promise = promise_of_system(
        system, numbers, by
    )  # a bound that is proven stands in a whole promise only
    verdict = REFUTED if against else UNDECIDED if left else CERTIFIED
    return Decision(verdict, promise, proofs, against, tuple(left), shows)


def trusted_criteria(system: System, numbers: Mapping[str, Fraction]) -> Mapping[str, Criterion]:
    """Criteria that may prove and refute: those of this package, or those computed from a tick.

    That an inequality of somebody else's system proves a clause is a word, and so is a disturbance
    in words that refutes it.
    """
    if registry.of_the_house(system):
        return system.asked(numbers)
    return system.loop.criteria(numbers) if system.loop else {}


def refuters(system: System) -> Mapping[str, Refuter]:
    """Refuters of this package, or those computed from a tick."""
    if registry.of_the_house(system):
        return system.refuters
    return system.loop.refuters() if system.loop else {}


def promise_of_system(
    system: System, numbers: Mapping[str, Fraction], by: Mapping[str, Entries]
) -> Promise:
    """Promise of a system; of one that is declared elsewhere it says what is only its word."""
    promise = system.promise(numbers, by)
    if registry.of_the_house(system):
        return promise
    words = [f"what {name} is declared to prove: nobody proved it"
             for name, c in system.asked(numbers).items() if c.proves or c.refutes]  # fmt: skip
    words += [f"what {name} is declared to refute: nobody replayed it" for name in system.refuters]
    if system.loop:
        words.append(
            "that its tick is what runs: it is taken from the declaration, without rounding"
        )
    return replace(promise, not_promised=(*promise.not_promised, *words))


def _try(criterion: Criterion, numbers: Mapping[str, Fraction]) -> Entries | None:
    """Proof of a criterion; None too where a search meets numbers that floats cannot hold."""
    try:
        return proof(criterion, numbers)
    except ArithmeticError:
        return None


def proof(criterion: Criterion, numbers: Mapping[str, Fraction]) -> Entries | None:
    """What a file holds of a criterion that holds; None if it does not, or cannot be shown."""
    if criterion.evidence is not None:
        found = criterion.evidence.find(numbers)
        return None if found is None else {"evidence": dict(found)}
    multipliers = criterion.find(dict(numbers))
    if criterion.multipliers and multipliers is None:
        return None
    sides = _sides(criterion, {**numbers, **(multipliers or {})})
    if not all(s.holds() for s in sides) or not _finite(sides):
        return None
    return _entry(sides, multipliers or {})


def counterexample(
    system: System, numbers: Mapping[str, Fraction], unproved: Sequence[str], quick: bool = False
) -> tuple[dict[str, Any] | None, str]:
    """First counterexample that replays, as the file holds it, and what it does; else None.

    Args:
        system: the system. numbers: its numbers. unproved: clauses for which runs are searched.
        quick: only by searches of little work.
    """
    inputs, clauses = system.inputs(numbers), system.clauses(numbers)
    for name, c in trusted_criteria(system, numbers).items():
        clause = _refuted(c, inputs, clauses)
        if clause:
            sides = _sides(c, numbers)
            if _finite(sides) and any(s.holds() is False for s in sides):
                entry = {"clause": clause, "by": name, "disturbance": c.refutes, **_entry(sides)}
                return entry, c.refutes
    for name, r in refuters(system).items():
        search = r.quick if quick else r.find
        if r.target in unproved and search is not None:
            try:
                found = search(numbers)
                if found is None:
                    continue
                shows = r.replay(numbers, found)
            except (DoesNotHold, ArithmeticError):
                continue  # it leaves by less than rounding may be, or with numbers beyond floats
            return {"clause": r.target, "by": name, "run": dict(found)}, shows
    return None, ""


def _refuted(c: Criterion, inputs: set[str], clauses: Mapping[str, Any]) -> str:
    """Clause that a criterion in closed form refutes where it fails, empty if none."""
    under = c.covers if c.refuted_under is None else c.refuted_under
    if not c.refutes or not inputs <= set(under):
        return ""
    return next((k for k in c.proves if k in clauses), "")


# ---- the file -----------------------------------------------------------------------------------


def write(system: System, given: Mapping[str, Any]) -> dict[str, Any]:
    """Entries of a certificate: all that was asked, the promise, and what proves or refutes it.

    Raises:
        BadInput: numbers that mean nothing.
    """
    numbers = exact_numbers(system, given)
    return certificate_entries(system, numbers, decide(system, numbers, every=True))


def certificate_entries(
    system: System, numbers: Mapping[str, Fraction], found: Decision
) -> dict[str, Any]:
    """Entries of a certificate of a decision."""
    asked = {k: {"value": str(v), "unit": system.numbers[k].unit} for k, v in numbers.items()}
    payload: dict[str, Any] = {
        "format": FORMAT, "kind": KIND, "system": system.name, "asked": asked,
        "promise": found.promise.payload(), "verdict": found.verdict, "time": found.promise.time,
    }  # fmt: skip
    if found.verdict == CERTIFIED:
        payload["proofs"] = dict(found.proofs)
    if found.counterexample is not None:
        payload["counterexample"] = found.counterexample
    return payload


def check(system: System, payload: Mapping[str, Any]) -> str:
    """Check a certificate of a system; gives what it proves, in one line.

    Raises:
        DoesNotHold: a proof fails, or its numbers do not belong to what was asked.
        BadInput: it is malformed.
    """
    refuse_unknown(payload, ENTRIES, "the certificate")
    numbers = _numbers(system, payload.get("asked"))
    verdict = payload.get("verdict")
    if verdict not in (CERTIFIED, REFUTED, UNDECIDED):
        raise BadInput(f"the verdict must be {CERTIFIED}, {REFUTED} or {UNDECIDED}")
    for name, belongs in (("proofs", CERTIFIED), ("counterexample", REFUTED)):
        if (name in payload) != (verdict == belongs):
            said = "has" if name in payload else "lacks"
            raise DoesNotHold(f"it says {verdict} and {said} the entry {name!r}")
    by: Mapping[str, Entries] = {}
    how = ""
    if verdict == CERTIFIED:
        by, names = _check_proofs(system, numbers, payload["proofs"])
        how = f"{', '.join(names)} checked"
    elif verdict == REFUTED:
        how = _check_counterexample(system, numbers, payload["counterexample"])
    promise = promise_of_system(system, numbers, by)
    if payload.get("promise") != promise.payload() or payload.get("time") != promise.time:
        raise DoesNotHold("the promise in it is not the one that its numbers make")
    if verdict == UNDECIDED:
        return f"{system.name}: {UNDECIDED} {promise.time}: nothing is promised"
    said = "" if verdict == CERTIFIED else "it is false that, "
    gains = ", ".join(promise.of[1:])
    return f"{system.name}, {gains}: {verdict} {said}{promise} ({how})"


def _check_proofs(
    system: System, numbers: Mapping[str, Fraction], given: Any
) -> tuple[dict[str, Entries], list[str]]:
    """What proves each clause, and the names of all criteria that were checked."""
    inputs, criteria = system.inputs(numbers), trusted_criteria(system, numbers)
    given = read_mapping(given, tuple(criteria), "proofs")
    by: dict[str, Entries] = {}
    for clause in system.clauses(numbers):
        for name, c in criteria.items():
            if name in given and clause in c.proves and inputs <= set(c.covers):
                by.setdefault(clause, given[name])
    left = [k for k in system.clauses(numbers) if k not in by]
    if left:
        raise DoesNotHold(f"proofs: no proof of {', '.join(left)} that covers all that was asked")
    for name, entry in given.items():
        _check_proof(f"proofs.{name}", criteria[name], numbers, entry)
    return by, list(given)


def _check_proof(
    where: str, criterion: Criterion, numbers: Mapping[str, Fraction], given: Any
) -> None:
    if criterion.evidence is not None:
        entry = read_mapping(given, ("evidence",), where, True)["evidence"]
        if not isinstance(entry, Mapping):
            raise BadInput(f"{where}.evidence must hold what was found")
        criterion.evidence.check(numbers, entry)
        return
    entry = read_mapping(given, ("sides", "multipliers"), where)
    brought = entry.get("multipliers", {})
    if not isinstance(brought, Mapping) or set(brought) != set(criterion.multipliers):
        wanted = ", ".join(criterion.multipliers) or "nothing"
        raise BadInput(f"{where}.multipliers must hold {wanted}")
    found = {k: rational(v, f"{where}.multipliers.{k}") for k, v in brought.items()}
    try:
        sides = _sides(criterion, {**numbers, **found})
    except ZeroDivisionError:
        raise DoesNotHold(f"{where}: a multiplier is zero") from None
    if not _finite(sides):
        raise BadInput(f"{where} has no finite exact check at these numbers")
    for side in sides:
        if not side.holds():
            raise DoesNotHold(f"{where}: {side.text} is not shown")
    if dict(entry) != _entry(sides, found):
        raise DoesNotHold(f"{where}: its sides do not belong to what was asked")


def _check_counterexample(system: System, numbers: Mapping[str, Fraction], given: Any) -> str:
    where = "counterexample"
    entry = read_mapping(given, ("clause", "by", "disturbance", "sides", "run"), where)
    by, clause = entry.get("by"), entry.get("clause")
    inputs, clauses = system.inputs(numbers), system.clauses(numbers)
    if isinstance(by, str) and by in refuters(system) and "run" in entry:
        refuse_unknown(entry, ("clause", "by", "run"), where)
        refuter = refuters(system)[by]
        if refuter.target != clause or clause not in clauses:
            raise DoesNotHold(f"{where}: {by} does not refute {brief(clause)}")
        if not isinstance(entry["run"], Mapping):
            raise BadInput(f"{where}.run must hold a start and a disturbance")
        return f"{by} replayed: {refuter.replay(numbers, entry['run'])}"
    criteria = trusted_criteria(system, numbers)
    if not isinstance(by, str) or by not in criteria:
        raise BadInput(f"{where}.by: {system.name} has no counterexample {brief(by)}")
    c = criteria[by]
    if not clause or _refuted(c, inputs, clauses) != clause:
        raise DoesNotHold(f"{where}: {by} does not refute {brief(clause)} here")
    sides = _sides(c, numbers)
    if not _finite(sides) or not any(s.holds() is False for s in sides):
        raise DoesNotHold(f"{where}: {by} is not violated")
    if dict(entry) != {"clause": clause, "by": by, "disturbance": c.refutes, **_entry(sides)}:
        raise DoesNotHold(f"{where}: its sides do not belong to what was asked")
    return f"{by} violated: {c.refutes}"


def _numbers(system: System, given: Any) -> dict[str, Fraction]:
    given = read_mapping(given, tuple(system.numbers), "asked")
    out = {}
    for name, number in system.numbers.items():
        if name not in given:
            if number.value is not None:
                raise BadInput(f"asked.{name} is missing")
            continue
        entry = read_mapping(given[name], ("value", "unit"), f"asked.{name}", True)
        if entry["unit"] != number.unit:
            raise BadInput(
                f"asked.{name} has the unit {brief(entry['unit'])}, it must be {number.unit!r}"
            )
        out[name] = rational(entry["value"], f"asked.{name}")
        if str(out[name]) != entry["value"]:
            raise BadInput(f"asked.{name} must be written {str(out[name])[:40]!r}")
    return exact_numbers(system, out)


# ---- sides --------------------------------------------------------------------------------------


def _sides(criterion: Criterion, numbers: Mapping[str, Any]) -> Sequence[Side]:
    return criterion.sides(numbers) if criterion.sides else []


def _finite(sides: Sequence[Side]) -> bool:
    """Whether all of it is exact: rationals and enclosures; a float proves nothing."""
    return bool(sides) and not any(isinstance(x, float) for s in sides for x in (s.left, s.right))


def _entry(sides: Sequence[Side], found: Mapping[str, Fraction] | None = None) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "sides": [{"text": s.text, "left": _text(s.left), "right": _text(s.right)} for s in sides]
    }
    return entry | ({"multipliers": {k: str(v) for k, v in found.items()}} if found else {})


def _text(x: Any) -> Any:
    return x.texts() if isinstance(x, Interval) else str(Fraction(x))
