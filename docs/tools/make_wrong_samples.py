"""Wrong samples in c_interface.md: ``python docs/tools/make_wrong_samples.py [--check]``.

Its rows are those of evidence/wrong_samples.json, which ``python -m bench.faults``
measures.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

from made import made

HERE = Path(__file__).resolve().parents[1]
PAGE, EVIDENCE = HERE / "c_interface.md", HERE / "evidence" / "wrong_samples.json"
HEAD = (
    "| controller | faults | back | the loop needs its time | harm: 1 tick | 10 ticks | 100 ticks"
    " | seen |\n| --- | --- | --- | --- | --- | --- | --- | --- |\n"
)


def harms(fault: dict[str, Any]) -> bool:
    """Whether a fault that is not back is not forgotten either."""
    own = min(math.inf if fault[n] is None else fault[n] for n in ("own", "alike"))
    return bool(fault["missed"] or fault["locks"] or own > fault["allowed"])


def rows(controllers: dict[str, Any]) -> str:
    """A row for each controller."""
    lines = []
    for name, found in controllers.items():
        harm = [f for f in found["slow"] if harms(f)]
        slow = len(found["slow"])
        by_length = [sum(f["ticks"] == n for f in harm) for n in (1, 10, 100)]
        seen = sum(f["told"] == f["ticks"] for f in harm)
        cells = [f"`{name}`", found["faults"], found["faults"] - slow, slow - len(harm),
                 *by_length, seen]  # fmt: skip
        lines.append("| " + " | ".join(map(str, cells)) + " |\n")
    return "".join(lines)


def page() -> str:
    """The page with the rows of the evidence."""
    numbers = json.loads(EVIDENCE.read_text(encoding="utf-8"))["numbers"]["wrong_samples"]
    before, head, after = PAGE.read_text(encoding="utf-8").partition(HEAD)
    assert head, f"docs/{PAGE.name} has no table of wrong samples"
    rest = after[after.index("\n\n") + 1 :]
    return before + head + rows(numbers["controllers"]) + rest


if __name__ == "__main__":
    sys.exit(made(PAGE, page()))
