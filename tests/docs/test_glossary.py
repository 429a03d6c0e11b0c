"""The glossary has the words that commands print, collected from the code."""

import re
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import get_args, get_type_hints

from slipctl.certify import catalogue
from slipctl.models.vehicle.parts import Trip

ROOT = Path(__file__).parents[2]
COMMON = {"speed", "ratio", "constant", "table", "adhesion", "davis"}
"""Kinds whose name is an everyday word with its everyday meaning."""


def words() -> set[str]:
    """Words that have an entry."""
    text = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
    found = set()
    for row in re.findall(r"^\| (?!word \|)([^|]+?) \|", text, re.M):
        found |= {w.strip().split(" (")[0] for w in row.split(",")}
    for kind in re.findall(r"\(`(\w+)`", text) + re.findall(r"`(\w+)`", text):
        found.add(kind)
    return found


def test_every_kind_of_a_part_has_an_entry():
    seen, todo = set(), [Trip]
    names = set()
    while todo:
        part = todo.pop()
        if part in seen:
            continue
        seen.add(part)
        hints = get_type_hints(part)
        for field in fields(part):
            for one in (hints[field.name], *nested(hints[field.name])):
                if isinstance(one, type) and is_dataclass(one):
                    todo.append(one)
                    if "kind" in {f.name for f in fields(one)}:
                        names |= set(get_args(get_type_hints(one)["kind"]))
    assert {"wsp", "fused", "pi", "sta"} <= names
    assert names - COMMON - words() == set()


def nested(hint):
    """Types inside a type."""
    for one in get_args(hint):
        yield one
        yield from nested(one)


def test_the_letters_that_certify_asks_for_have_an_entry():
    """The numbers of super-twisting and of loops of a vehicle file, and the words of a proof."""
    asked = set(catalogue.SYSTEMS["super_twisting"].numbers)
    asked |= set(catalogue.OF_LOOPS["axle_loop"].numbers)
    assert {"k1", "L", "T"} <= asked
    spoken = {"tube", "funnel", "prompt", "x1", "r1", "L", "cell", "sums", "mode", "band", "push"}
    known = words()
    assert spoken <= known
    letters = {n for n in asked if re.fullmatch(r"[A-Z]|[a-z]+_?[0-9]*", n) and len(n) < 4}
    assert {n for n in letters if n not in known and not re.fullmatch(r"k[0-9]|v0", n)} <= {"off"}
