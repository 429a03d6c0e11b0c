"""Make docs/claims.md from the studies: ``python docs/tools/make_claims.py [--check]``.

One table a paper: what it says, where, and what each row is judged on. Verdicts are not here: they
come from a run, and stand on the page of the study.
"""

from __future__ import annotations

import sys
from pathlib import Path

from made import made

from slipctl.study.declaration import Claim, Study
from slipctl.study.report.texts import number, tolerance_text
from slipctl.study.resolve import load_study

PAGE = Path(__file__).parents[1] / "claims.md"
STUDIES = ("subway_braking", "hst_braking", "hst_traction", "freight_traction")
HEAD = """# What the papers claim, and where each claim is judged

The claims of the four papers that have a number or an order, as we read them in abstract, results
and conclusions, sentence by sentence. Not among them: what is praised without a measure (parking
more accurately, a torque that is convex at first), and the convergence of the theorems, which
`slipctl certify` takes up. *Asked* is the paper's answer with the tolerance that the row allows.
*Judged in* is the scenario and the loop of a run, and what had to be assumed. Verdicts and our
answers stand on the page of the study. Rows that are our own promises have the place *ours*.
`docs/tools/make_claims.py` makes this page.
"""


def asked(c: Claim) -> str:
    """The paper's answer and what is allowed beside it."""
    unit = "" if c.unit == "1" or c.kind == "yes/no" else f" {c.unit}"
    text = c.paper if isinstance(c.paper, str) else number(c.paper, 6)
    said = f"{c.bound} {text}".strip() + (unit if c.kind == "number" else "")
    if c.kind != "number" or c.not_checkable:
        return said
    return said if c.bound and not c.allowed() else f"{said}, +-{number(c.allowed(), 3)}"


def judged_on(c: Claim) -> str:
    """Scenario, loop, assumption and the reason of the tolerance, or why there is no verdict."""
    where = "/".join(filter(None, [c.scenario, c.loop]))
    parts = [f"`{where}`" if where else "", c.assumption, tolerance_text(c)]
    parts += [f"not checkable: {c.not_checkable}" if c.not_checkable else ""]
    return "; ".join(filter(None, parts)) or "the equations alone"


def table(study: Study) -> str:
    """The claims of a paper, in the order of its sections."""
    rows = [[c.source, c.claim, asked(c), judged_on(c), f"`{c.id}`"] for c in study.claims]
    head = ["where", "what it says", "asked", "judged in", "row"]
    cells = [head, ["---"] * len(head), *([t.replace("|", "\\|") for t in r] for r in rows)]
    return "".join("| " + " | ".join(r) + " |\n" for r in cells)


def page() -> str:
    """Text of the page."""
    parts = [HEAD]
    for name in STUDIES:
        study = load_study(name)
        many = len([c for c in study.claims if c.source != "ours"])
        parts.append(f"## {name}\n\n{study.source}\n\n{many} rows; [the page]({name}.md) has their"
                     f" verdicts.\n\n{table(study)}")  # fmt: skip
    return "\n".join(parts)


if __name__ == "__main__":
    sys.exit(made(PAGE, page()))
