"""How the text of a module reads: its length, names that a person gave, where its equations are."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from slipctl.ccode.module.comments import FILE
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.passes.scratch import OWN

_ORIGIN = re.compile(
    r"(?P<code>.*[;}])  /\* (?:(?P<name>[^,*]+), )?(?P<source>(?:line |[^ ,*]+\.py:)\d+[^*]*) \*/$"
)
"""A statement, and behind it where its equation comes from, with its name if C has another."""

_ASSIGNED = re.compile(
    r"^\s*(?:for \(.*\) \{ )?(?:(?:static )?(?:const )?(?:double|float|int|bool|unsigned int) )?"
    r"\*?(?P<target>[A-Za-z_][\w.>-]*)(?:\[[^=]*\])*\s+(?:[-+*/|&])?=\s"
)
_MEMBER = re.compile(r"(?<=[{ ])\.(\w+)(?= = )")
_ANONYMOUS = re.compile(r"[A-Za-z]+\d+")
_REGISTER = re.compile(r"^\s*w[r]?\d+\s+[-+*/]?=")
_ALONE = re.compile(
    r"\s*/\* (?:(?P<name>[^,*]+), )?(?P<source>(?:line |[^ ,*]+\.py:)\d+[^*]*) \*/$"
)
_STARTS = re.compile(
    r"(?:for \(.*\) \{ )?(?:copy\(&?|(?:const )?(?:double|float|bool) )?"
    r"(?P<target>\w+(?:->[\w.]+)?)(?:\[[^\]]*\])*(?: =|,)"
)
_RESULT = re.compile(r"(?:next|now)->[\w.]+(?=(?:\[\w+\])? = )|(?<=copy\()(?:next|now)->[\w.]+")
_FILE = re.compile(r"\s+(?:\* )?".join(FILE.split()) + r"\s+(?:\* )?([^ ,*]+\.py)\.")
_FUNCTION = re.compile(r"static \w+ (\w+)\(")


def measure_source(plan: Plan, sources: Mapping[str, str]) -> dict[str, Any]:
    """Measure the source of a module.

    Args:
        plan: what it was written from.
        sources: text of its files by name.

    Returns:
        ``lines`` of each file, ``assignments``, those of them that are ``anonymous`` (to a local of
        letters and digits that no model declares, such as ``a12``) and their ``share``,
        ``registers`` (lines of CasADi's register code), ``functions`` of the parts and what they
        call.
    """
    source = "".join(sources.values())
    declared = {s.name.rpartition(".")[2] for s in plan.block.signals} | plan.equations.letters
    targets = [m["target"] for line in source.splitlines() if (m := _ASSIGNED.match(line))]
    targets += _MEMBER.findall(source)
    targets = [t.removeprefix(f"{OWN}->") for t in targets]
    anonymous = [t for t in targets if _ANONYMOUS.fullmatch(t) and t not in declared]
    return {
        "lines": {file: text.count("\n") for file, text in sources.items()},
        "assignments": len(targets),
        "anonymous": len(anonymous),
        "share": round(len(anonymous) / max(len(targets), 1), 3),
        "registers": sum(bool(_REGISTER.match(line)) for line in source.splitlines()),
        "functions": len(plan.equations.functions),
    }


def equations(plan: Plan, sources: Mapping[str, str]) -> list[dict[str, Any]]:
    """Where each equation is, where it comes from, and in which signals it is compared.

    Args:
        plan: what it was written from.
        sources: text of its files by name.

    Returns:
        For each: ``file`` and ``line``, ``function``, ``equation`` (its name in the model, with
        `` next`` behind for a state of the next tick), ``source`` (file and line of the model, and
        the paper's numbers), ``compared``: states and outputs that the replay against Python
        compares in every tick, those of the function for a local.
    """
    return [
        {"file": file, **row}
        for file, text in sources.items() for row in _equations(plan, text)
    ]  # fmt: skip


def _equations(plan: Plan, source: str) -> list[dict[str, Any]]:
    members = {f"next->{plan.layout.places[m.c]}": m.name for m in plan.layout.states}
    members |= {f"now->{m.c}": m.name for m in plan.layout.signals}
    lines, function, file, begun, own = source.splitlines(), "", "", 0, ""
    files = {source.count("\n", 0, m.end()): m[1] for m in _FILE.finditer(source)}
    found: list[dict[str, Any]] = []
    given: dict[str, list[str]] = {}
    of_part = re.compile(rf"struct {plan.name}_kept_(\w+) \*(?:state|next)\b")
    for k, line in enumerate(lines):
        file = files.get(k, file)
        if opened := _FUNCTION.match(line):
            function, own = opened[1], ""
        if struct := of_part.search(line):  # its states stand without their part
            own = f"next->{struct[1]}."
        here = [_whole(t, own) for t in _RESULT.findall(line)]
        given.setdefault(function, []).extend(here)
        alone, behind = _ALONE.match(line), _ORIGIN.match(line)
        begun = k if _ended(lines[k - 1]) else begun
        told = alone or behind
        if told is None:
            continue
        at = k + 1 if alone else begun
        begins = _STARTS.match(lines[at].strip())
        target = _whole(begins["target"], own) if begins else ""
        found.append({
            "line": at + 1, "function": function,
            "source": told["source"].replace("line ", f"{file}:", 1),
            "equation": told["name"] or target, "compared": [],
        })  # fmt: skip
    for row in found:
        results = dict.fromkeys(given.get(row["function"], []))
        last = row["equation"].removesuffix(" next")
        kind = "next->" if row["equation"].endswith(" next") else "now->"
        same = [t for t in results if t.startswith(kind) and members[t].rpartition(".")[2] == last]
        row["compared"] = list(dict.fromkeys(members[t] for t in same or results))
    return found


def _whole(target: str, own: str) -> str:
    """A next state with the struct of its part, in a function that has no other."""
    return own + target.removeprefix("next->") if own and target.startswith("next->") else target


def _ended(line: str) -> bool:
    """Whether a statement begins behind a line."""
    return line.rstrip().endswith((";", "{", "}", "*/")) or not line.strip()
