"""How the text of a module reads: its length, and how much of it has names that a person gave."""

from __future__ import annotations

import re
from typing import Any

from slipctl.ccode.write.plan import Plan

_ASSIGNED = re.compile(
    r"^\s*(?:(?:static )?(?:const )?(?:double|float|int|bool|unsigned int) )?"
    r"\*?(?P<target>[A-Za-z_][\w.>-]*)(?:\[[^=]*\])*\s+(?:[-+*/|&])?=\s"
)
_ANONYMOUS = re.compile(r"[A-Za-z]+\d+")
_REGISTER = re.compile(r"^\s*w[r]?\d+\s+[-+*/]?=")


def reading(plan: Plan, source: str) -> dict[str, Any]:
    """Measure a source file.

    Args:
        plan: what it was written from.
        source: its text.

    Returns:
        ``lines``, ``assignments``, those of them that are ``anonymous`` (to a local of letters and
        digits that no model declares, such as ``a12``) and their ``share``, ``registers`` (lines
        of CasADi's register code), ``functions`` of the parts and what they call.
    """
    declared = {s.name.rpartition(".")[2] for s in plan.block.signals} | plan.equations.letters
    targets = [m["target"] for line in source.splitlines() if (m := _ASSIGNED.match(line))]
    anonymous = [t for t in targets if _ANONYMOUS.fullmatch(t) and t not in declared]
    return {
        "lines": source.count("\n"),
        "assignments": len(targets),
        "anonymous": len(anonymous),
        "share": round(len(anonymous) / max(len(targets), 1), 3),
        "registers": sum(bool(_REGISTER.match(line)) for line in source.splitlines()),
        "functions": len(plan.equations.functions),
    }
