"""Files of a search: ``gains.toml``, which ``--set`` takes, and ``certificate.json``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from slipctl import __version__
from slipctl.certify import certificate as certificates
from slipctl.certify.entries import mapping, rows
from slipctl.design import statement
from slipctl.design.promises import certificate
from slipctl.design.tune import Tuned
from slipctl.errors import BadInput
from slipctl.run import store

KIND = "certificate of gains"
FORMAT = 1
ENTRIES = ("format", "kind", "slipctl", "command", "loop", "gains", "exact", "statistical")


def gains_text(found: Tuned, command: str) -> str:
    """``gains.toml``: each number with its unit, to the last bit."""
    rest = "" if found.judged else "# The search was stopped; these are the best so far.\n"
    lines = "".join(f'"{f.name}" = "{value(found.gains[f.name], f.unit)}"\n' for f in found.frees)
    return (
        f"# {command}\n# slipctl {__version__}; --set FILE of slipctl run, sweep and c takes it\n"
        f'{rest}format = {FORMAT}\nloop = "{found.name}"\n\n[gains]\n{lines}'
    )


def value(number: float, unit: str) -> str:
    """Number with its unit, to the last bit."""
    return f"{number!r}" if unit == "1" else f"{number!r} {unit}"


def found_of(found: Tuned, command: str) -> dict[str, Any]:
    """What a search found, as ``slipctl tune --json`` prints it."""
    search, judged = found.search, found.judged
    said: dict[str, Any] = {
        "format": FORMAT, "slipctl": __version__, "command": command, "loop": found.name,
        "minimise": search.objective.text,
        "gains": {f.name: {"value": found.gains[f.name], "unit": f.unit} for f in found.frees},
        "candidates": search.thought, "refused": sum(search.refused.values()),
        "runs": search.spent, "samples": search.samples,
        "margins": {
            name: {"tuned": tuned, "by_hand": by_hand}
            for name, (tuned, by_hand) in found.margins.items()
        },
    }  # fmt: skip
    if judged is not None:
        said["judged"] = {
            "draws": len(judged.tuned.values), "tuned": judged.tuned.mean(),
            "by_hand": judged.by_hand.mean(), "difference": judged.difference,
            "standard_error": judged.error,
        }  # fmt: skip
    return said | ({"statement": dict(found.statement)} if found.statement is not None else {})


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
    found = mapping(payload, ENTRIES, "the certificate")
    store.check_format("the certificate", found.get("format"))
    lines = []
    for k, row in enumerate(rows(found.get("exact", []), "exact", 100)):
        entry = mapping(row, ("name", "bounds_times", "certificate"), f"exact[{k}]", True)
        if not isinstance(entry["certificate"], Mapping):
            raise BadInput(f"exact[{k}].certificate must hold a certificate")
        lines.append(f"{entry['name']!s:.40}: {certificates.check(entry['certificate'])}")
    if "statistical" in found:
        lines += statement.lines(found["statistical"])
    return "\n".join(lines)
