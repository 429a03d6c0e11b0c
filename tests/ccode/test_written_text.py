"""What is written in C changes on purpose only: a checksum of each file, each function, each fact.

``python tests/ccode/test_written_text.py`` writes the table anew; a failing test names what
changed. The table says that nothing changed, not that it is right: other tests compile what is
written and compare it with Python, bit for bit. What is new is free until it is in the table.
"""

from __future__ import annotations

import csv
import io
import json
import re
import sys
import tempfile
import zipfile
import zlib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).parents[1])]

from controllers import REPRESENTATIVE
from module_text import of_plan
from written_blocks import ASKED, FOLDERS, MADE

from slipctl import Block, __version__
from slipctl.ccode import codegen
from slipctl.ccode.check import float_error, fuzz
from slipctl.ccode.check.comparison import trial_rows
from slipctl.ccode.check.proof import module_proof
from slipctl.ccode.compile.module import CModule
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.request import Content
from slipctl.ccode.ship.fmu import fmus

pytestmark = pytest.mark.table  # left out unless asked for: pytest -m table

TABLE = Path(__file__).parent / "written_text.csv"
HEAD = ["what", "file", "code", "with comments", "functions"]
VERSIONS = f"CasADi {ca.CasadiMeta.version()} and NumPy {np.__version__}"
"""Others put operations in another order, and may draw other numbers."""

_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_NAMED = re.compile(r"^(?:static )?(?:[\w]+[ *]+)+(\w+)(?=\(|\[| =)", re.MULTILINE)

Rows = dict[tuple[str, str], list[str]]


@cache
def block(name: str) -> Block:
    return MADE[name]() if name in MADE else REPRESENTATIVE[name]()


def crc(text: str) -> str:
    return f"{zlib.crc32(text.encode()):08x}"


def settled(text: str) -> str:
    """Without versions, and without numbers of lines, which move, and sums of texts with them."""
    for version in (ca.CasadiMeta.version(), __version__):
        text = text.replace(version, "VERSION")
    text = re.sub(r"\{[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}\}", "{TOKEN}", text)
    return re.sub(r"(\.py:|\bline )\d+", r"\1N", text)


def bare(text: str) -> str:
    """The code alone, however it is laid out."""
    return " ".join(_COMMENT.sub(" ", text).split())


def functions(text: str) -> str:
    """Name and a few digits of the checksum of each function and table."""
    found = []
    for piece in re.split(r"\n\n(?=\S)", text):
        code = _COMMENT.sub("", piece).strip()
        if m := _NAMED.search(code):
            found.append(f"{m[1]}:{crc(bare(code))[:3]}")
    return " ".join(found)


def row(what: str, file: str, text: str, own: bool = False) -> list[str]:
    """A file in the table; the functions of the module's own source one by one."""
    text = settled(text)
    return [what, file, crc(bare(text)), crc(text), functions(text) if own else ""]


def module(what: str) -> Iterator[list[str]]:
    """Files of what is asked; where nothing is, those with the name of the module."""
    name, planned, more = ASKED[what]
    plan = Plan(block(name), **planned)
    whole = more or planned or what in FOLDERS
    for file, text in codegen.texts(plan, Content(**more)).items():
        if whole or plan.name in file:
            yield row(what, file, text, own=file in plan.files[1:])


def folder(what: str) -> Iterator[list[str]]:
    """What is beside the sources: each fact of the report, the vectors, the FMUs."""
    given = FOLDERS[what]
    with tempfile.TemporaryDirectory() as scratch:
        made = codegen.export(block(what), scratch, **given)
        texts = {n: Path(scratch, n).read_text("utf-8") for n in ("report.md", "vectors.txt")}
    own = {"files", "content", "casadi_version", "slipctl_version", "work"}
    facts = {k: json.dumps(v) for k, v in made.data.items() if k not in own}
    texts = {n: re.sub(r"\b[0-9a-f]{16}\b", "", t) for n, t in texts.items()} | facts
    texts["printed"] = str(made).replace(scratch, "").replace(made.data["content"], "")
    plan = made.module._plan
    zipped = fmus(plan, codegen.texts(plan), "0" * 16, [])
    for name, raw in zipped.items():
        with zipfile.ZipFile(io.BytesIO(raw)) as archive:
            for n in archive.namelist():
                texts[f"{name[-8:-4]}/{n}"] = archive.read(n).decode()
    yield from (row(f"folder of {what}", n, t) for n, t in texts.items())


def checked(what: str) -> Iterator[list[str]]:
    """What tools are given to run a module: harnesses, options, texts made for them."""
    name, planned, _ = ASKED[what]
    plan = Plan(block(name), **planned)
    text = of_plan(plan)
    made = {
        "harness.c": module_proof.harness(plan),
        "options": " ".join(module_proof._options(plan, text)),
        "written out": module_proof.written_out(text), "any": module_proof.any_results(plan, text),
        "claims": str(module_proof._claims(module_proof.harness(plan))),
        "fuzz.c": fuzz.harness(plan),
        "binding": CModule(Path("."), plan).binding, "inexact": str(float_error.inexact(text)),
        "rows": vectors(trial_rows(plan)), "narrow": vectors(trial_rows(plan, 1e-2)),
    }  # fmt: skip
    yield from (row(f"tools for {what}", n, t) for n, t in made.items())


def vectors(rows: np.ndarray) -> str:
    """Numbers that are made up by sums and products alone."""
    return " ".join(float(v).hex() for v in rows.ravel())


def representative(name: str) -> Iterator[list[str]]:
    """The source of a shipped controller, without the words of its models."""
    plan = Plan(block(name))
    made = row(f"controller of {name}", "", of_plan(plan), own=True)
    yield [*made[:3], "", made[4]]


TOOLS = ("part", "bounded", "careful in float", "sums", "tables", "repeating", "another name",
         "derived", "long_names in float", "alone")  # fmt: skip
WHAT: dict[str, Any] = {
    **{w: (module, w) for w in ASKED},
    **{f"folder of {w}": (folder, w) for w in FOLDERS},
    **{f"tools for {w}": (checked, w) for w in TOOLS},
    **{f"controller of {n}": (representative, n) for n in REPRESENTATIVE},
}


@cache
def table() -> tuple[str, dict[str, Rows]]:
    """The versions that it was made with, and its rows by what they are of."""
    with TABLE.open(newline="", encoding="utf-8") as file:
        (versions, *_), _, *wanted = csv.reader(file)
    found: dict[str, Rows] = {}
    for r in wanted:
        found.setdefault(r[0], {})[r[0], r[1]] = r
    return versions, found


@pytest.mark.parametrize("what", WHAT)
def test_what_is_written_is_what_the_table_says(what: str) -> None:
    versions, wanted = table()
    if versions != VERSIONS:
        pytest.skip(f"the table was made with {versions}")
    make, name = WHAT[what]
    have = {(r[0], r[1]): r for r in make(name)}
    changed = {}
    for key, old in wanted[what].items():
        new = have.get(key, [*key, "gone", "gone", ""])
        if new != old:
            parts = {*new[4].split()} - {*old[4].split()}
            said = "comments or layout" if new[2] == old[2] else "code"
            changed[key[1]] = [said, *sorted(p.partition(":")[0] for p in parts)]
    assert changed == {}


def test_the_table_has_most_of_what_can_be_asked() -> None:
    assert {*table()[1]} == {*WHAT}
    assert sum(map(len, table()[1].values())) > 300


if __name__ == "__main__":
    seen: set[tuple[str, ...]] = set()
    with TABLE.open("w", newline="", encoding="utf-8") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerows([[VERSIONS], HEAD])
        for make, name in WHAT.values():
            new = [r for r in make(name) if (r[1], r[3]) not in seen or not r[3]]
            seen |= {(r[1], r[3]) for r in new}
            writer.writerows(new)
