"""Files of a search: ``gains.toml``, which ``--set`` takes, and ``certificate.json``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from slipctl import __version__
from slipctl.certify import certificate as certificates
from slipctl.certify.entries import read_mapping, rows
from slipctl.design import statement
from slipctl.design.gain_search import Candidate
from slipctl.design.judgement import CLOSE, Judged
from slipctl.design.promises import certificate
from slipctl.design.ranges import Free
from slipctl.design.tune import Tuned
from slipctl.errors import BadInput
from slipctl.run import store
from slipctl.study.report.texts import number, with_unit

KIND = "certificate of gains"
FORMAT = 1
ENTRIES = ("format", "kind", "slipctl", "command", "loop", "gains", "exact", "statistical")


def gains_text(found: Tuned, command: str) -> str:
    """``gains.toml``: each number with its unit, to the last bit, and what it is worth."""
    rest = "" if found.judged else "# The search was stopped; these are the best so far.\n"
    if found.front:
        rest += "# The knee of the front; front.json has the others.\n"
    lines = "".join(
        "".join(f"# {line}\n" for line in worth(found, f))
        + f'"{f.name}" = "{value(found.gains[f.name], f.unit)}"\n' for f in found.frees
    )  # fmt: skip
    return (
        f"# {command}\n# slipctl {__version__}; --set FILE of slipctl run, sweep and c takes it\n"
        f'{rest}format = {FORMAT}\nloop = "{found.name}"\n\n[gains]\n{lines}'
    )


def worth(found: Tuned, free: Free) -> list[str]:
    """What a number is worth to each objective, the others as tuned, a line each."""
    lines = []
    for s in found.slices:
        if s.free is free:
            told = f"{s.objective} stays within {100 * CLOSE:g} % from {number(s.lo)} to" \
                   f" {with_unit(s.hi, free.unit)}"  # fmt: skip
            more = f"; 1 % more of it changes that by {number(s.answer, 2)} %"
            lines.append(told + (more if math.isfinite(s.answer) else ""))
    return lines


def front_of(found: Tuned, command: str) -> dict[str, Any]:
    """Entries of ``front.json``: the numbers and the means of each point."""
    goals = [goal.text for goal in found.search.objectives]
    return {
        "format": FORMAT, "slipctl": __version__, "command": command, "loop": found.name,
        "minimise": goals, "units": {f.name: f.unit for f in found.frees},
        "draws": found.search.samples, "by_hand": _point(found, found.search.by_hand),
        "knee": _point(found, found.search.best),
        "front": [_point(found, c) for c in found.front],
    }  # fmt: skip


def _point(found: Tuned, c: Candidate) -> dict[str, Any]:
    means = zip(found.search.objectives, c.scores, strict=True)
    return {
        "gains": {f.name: c.numbers[f.name] for f in found.frees},
        "means": {goal.text: s.mean() for goal, s in means},
    }


def value(of: float, unit: str) -> str:
    """Number with its unit, to the last bit."""
    return f"{of!r}" if unit == "1" else f"{of!r} {unit}"


def found_of(found: Tuned, command: str) -> dict[str, Any]:
    """What a search found, as ``slipctl tune --json`` prints it."""
    search, judged = found.search, found.judged
    said: dict[str, Any] = {
        "format": FORMAT, "slipctl": __version__, "command": command, "loop": found.name,
        "minimise": ", ".join(goal.text for goal in search.objectives),
        "gains": {f.name: {"value": found.gains[f.name], "unit": f.unit} for f in found.frees},
        "candidates": search.thought, "refused": sum(search.refused.values()),
        "runs": search.spent, "samples": search.samples,
        "margins": {
            name: {"tuned": tuned, "by_hand": by_hand}
            for name, (tuned, by_hand) in found.margins.items()
        },
    }  # fmt: skip
    if judged is not None:
        by = [_judged(its) for its in judged.each]
        said["judged"] = by[0]
        if judged.more:
            texts = [goal.text for goal in search.objectives]
            said["judged_each"] = dict(zip(texts, by, strict=True))
    said["worth"] = [
        {"objective": s.objective, "number": s.free.name, "lo": s.lo, "hi": s.hi,
         "percent_a_percent": s.answer if math.isfinite(s.answer) else None}
        for s in found.slices
    ]  # fmt: skip
    if found.front:
        said["front"] = front_of(found, command)["front"]
    return said | ({"statement": dict(found.statement)} if found.statement is not None else {})


def _judged(its: Judged) -> dict[str, Any]:
    return {
        "draws": len(its.tuned.values),
        "tuned": its.tuned.mean_reached(), "by_hand": its.by_hand.mean_reached(),
        "never": {"tuned": its.tuned.lost(), "by_hand": its.by_hand.lost()},
        "difference": its.difference, "standard_error": its.error,
    }  # fmt: skip


def certificate_of(
    found: Tuned, command: str, settings: Sequence[str] = (), swaps: Sequence[str] = ()
) -> dict[str, Any]:
    """Entries of ``certificate.json``."""
    loop = found.tuned_loop()
    asked = {g.name: margin for g, margin, _ in found.promises.needed()}
    exact = []
    for g in found.promises.gains:
        for margin in dict.fromkeys((1.0, asked.get(g.name, 1.0))):
            said = certificate(g, loop, found.promises, margin)
            exact.append({"name": g.name, "bounds_times": repr(margin), "certificate": said})
    gains = {f.name: {"value": repr(found.gains[f.name]), "unit": f.unit} for f in found.frees}
    entries: dict[str, Any] = {
        "format": FORMAT, "kind": KIND, "slipctl": __version__, "command": command,
        "loop": found.name, "gains": gains, "exact": exact,
    }  # fmt: skip
    if found.statement is not None:
        given = {"set": list(settings), "swapped": list(swaps)}
        entries["statistical"] = {**found.statement, **given}
    return entries


def check(payload: Mapping[str, Any]) -> str:
    """Check a certificate of gains; gives what each of its promises proves, a line each.

    Raises:
        DoesNotHold: a proof fails.
        BadInput: it is malformed.
    """
    found = read_mapping(payload, ENTRIES, "the certificate")
    store.check_format("the certificate", found.get("format"))
    lines = []
    for k, row in enumerate(rows(found.get("exact", []), "exact", 100)):
        entry = read_mapping(row, ("name", "bounds_times", "certificate"), f"exact[{k}]", True)
        if not isinstance(entry["certificate"], Mapping):
            raise BadInput(f"exact[{k}].certificate must hold a certificate")
        lines.append(f"{entry['name']!s:.40}: {certificates.check(entry['certificate'])}")
    if "statistical" in found:
        lines += statement.lines(found["statistical"])
    return "\n".join(lines)
