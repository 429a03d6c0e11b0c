"""How the C of the representative controllers reads: its shape, its length, its names."""

from __future__ import annotations

import re

import pytest
from controllers import REPRESENTATIVE

from slipctl import Block
from slipctl.ccode.check.reading import reading
from slipctl.ccode.write.plan import Plan
from slipctl.ccode.write.source import source

MOST = {
    "subway_braking": (1640, 0.28),
    "hst_braking": (710, 0.09),
    "freight_traction": (270, 0.08),
    "hst_traction": (1690, 0.16),
}
"""Lines of the source and share of anonymous assignments: what is reached, to be lowered."""


@pytest.fixture(scope="module", params=REPRESENTATIVE)
def written(request: pytest.FixtureRequest) -> tuple[str, Block, Plan, str]:
    block = REPRESENTATIVE[request.param]()
    plan = Plan(block, "ctl")
    return request.param, block, plan, source(plan)


def test_the_source_is_no_longer_and_has_no_more_locals_without_a_name(written) -> None:
    name, _, plan, text = written
    told = reading(plan, text)
    lines, share = MOST[name]
    assert told["lines"] <= lines
    assert told["share"] <= share
    assert told["registers"] == 0


def test_each_part_is_a_function_called_in_the_order_of_the_wires(written) -> None:
    """A part comes behind those whose outputs of this tick it reads."""
    _, block, plan, text = written
    body = text[text.index("The parts, in the order of the wires") :]
    called = re.findall(r"^    (\w+)\((?:in|param|state|next|now)[^;]*;", body, flags=re.MULTILINE)
    assert all(any(c == b or c.startswith(f"{b}_") for c in called) for b in block.parts)
    done: set[str] = set()
    for line in body.partition("\n}\n")[0].splitlines():
        done |= set(re.findall(r"now->(\w+)(?:\[\w+\])? = ", line))
        call = re.match(r"    (\w+)\(", line)
        if call is None or call[1] == "copy":
            continue
        part = text[text.index(f"static void {call[1]}(") :].partition("\n}\n")[0]
        own = f"{call[1].removesuffix('_part')}_"  # an array is given by a call
        made = set(re.findall(r"now->(\w+)(?:\[\w+\])? = ", part))
        made |= {n for n in re.findall(r"now->(\w+)", part) if n.startswith(own)}
        assert set(re.findall(r"now->(\w+)", part)) - made <= done
        done |= made
    assert plan.equations.functions


def test_every_line_is_told_from_the_others() -> None:
    """The measure sees what it is to see: anonymous locals, names of a model, register code."""
    block = REPRESENTATIVE["freight_traction"]()
    plan = Plan(block, "ctl")
    text = (
        "    const double a12 = 1.0;\n    now->x = a12;\n    w07  = (w02*w07);\n    b[1] = 2.0;\n"
    )
    told = reading(plan, text)
    assert (told["lines"], told["anonymous"], told["registers"]) == (4, 2, 1)
