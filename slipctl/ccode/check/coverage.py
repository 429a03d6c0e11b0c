"""What of a module its own test reaches: statements and branches, counted by gcov.

A branch is one way out of one condition: ``a && b`` and ``x ? y : z`` have theirs. gcc writes the
counters into the module at ``-O0``, so that none is merged with another.
"""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from slipctl.ccode.compile import compilers as cc
from slipctl.ccode.compile.programs import run_program
from slipctl.ccode.module.kernel import KERNEL
from slipctl.ccode.module.plan import Plan

COUNTER = "gcov"

DEFENSIVE = ("part_off", "recover")
"""Functions, and ``init``, that guard states against values that most equations cannot give."""

REACHABLE = "reachable branches"
"""Branches besides these guards, and besides what CasADi's text asks of the way it is called.

There, a pointer is passed or not, a product is transposed or not: each call says it by a constant.
And no function fails where none has a ``return 1`` but for a failure of what it calls."""

_ASKED = re.compile(
    r"\b(?:arg|res)\d*\[\d+\] ?(?:\?|!= 0\)|\))|^if \(!?[xy]\)|^if \(tr\)|is_dense \?"
)
_PASSED_ON = re.compile(r"^if \(\w+\(arg.*\)\) return 1;$")

_FAILED = re.compile(r"\bfailed\b|\(arg, res, .*\) != 0\) \{$")
"""The same behind CasADi's text: what is done where it failed."""

_WATCHED = ("--coverage", "-O0")


def run_with_counters(plan: Plan, folder: Path, used: Iterable[str]) -> dict[str, Any]:
    """Run the folder's own test with counters.

    Args:
        plan: the module.
        folder: has its texts and its vectors.
        used: compilers; one of them must be gcc.

    Returns:
        ``statements`` and ``branches``, each with ``all`` and ``reached``; ``missing``, lines with
        a statement that was not reached or a condition that went one way only, each with
        ``file``, ``line``, ``function``, ``text``, ``reached`` (the statement was), ``branches``
        not taken and ``asked``, whether any call could take them; ``untouched``, functions that
        were never called. Empty without gcc and gcov.
    """
    n = plan.name
    compiler = next((c for c in used if "gcc" in Path(c).name), None)
    tool = shutil.which(COUNTER)
    if compiler is None or tool is None:
        return {}
    program, counted = folder / f"covered_{n}", f"covered_{n}.o"
    for command in (
        [*cc.lenient_command(compiler), *_WATCHED, "-c", f"{n}.c", "-o", counted],
        [*cc.lenient_command(compiler), "--coverage", f"test_{n}.c", counted, "-o", program, "-lm"],
    ):
        if run_program(command, folder).returncode:
            return {}
    for old in folder.glob("covered_*.gcda"):  # else a run adds to what one before has counted
        old.unlink()
    run_program([program, "vectors.txt"], folder)
    told = [tool, "--branch-probabilities", "--json-format", "--stdout", f"covered_{n}.gcda"]
    said = run_program(told, folder)
    files = json.loads(said.stdout or "{}").get("files", [])
    found = {f["file"]: f for f in files if f["file"] in plan.files}
    if f"{n}.c" not in found:
        return {}
    texts = {f: (folder / f).read_text(encoding="utf-8").splitlines() for f in plan.files}
    home = texts[plan.files[1]]  # that may have CasADi's text
    each = [_counted(found[f], texts[f], f, home) for f in plan.files if f in found]
    return _added(each)


def _added(each: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Numbers of all files of a module."""
    return {
        "by": COUNTER,
        **{
            k: {w: sum(c[k][w] for c in each) for w in ("all", "reached")}
            for k in ("statements", "branches", REACHABLE)
        },
        **{k: [row for c in each for row in c[k]] for k in ("missing", "untouched")},
    }


def _counted(
    found: Mapping[str, Any], text: list[str], file: str, home: list[str]
) -> dict[str, Any]:
    """Numbers of a file's counters."""
    lines = found["lines"]
    asked = _by_call(lines, text, home)
    branches = [b["count"] > 0 for line in lines for b in line["branches"]]
    proper = [
        reached
        for line in lines
        if line.get("function_name", "") not in DEFENSIVE
        and not line.get("function_name", "").endswith("_init")
        for reached in _decided(line, asked)
    ]
    missing = [
        {
            "file": file, "line": line["line_number"], "function": line.get("function_name", ""),
            "text": text[line["line_number"] - 1].strip(), "reached": line["count"] > 0,
            "branches": sum(b["count"] == 0 for b in line["branches"]),
            "asked": line["line_number"] not in asked,
        }
        for line in lines
        if line["count"] == 0 or any(b["count"] == 0 for b in line["branches"])
    ]  # fmt: skip
    return {
        "statements": {"all": len(lines), "reached": sum(line["count"] > 0 for line in lines)},
        "branches": {"all": len(branches), "reached": sum(branches)},
        REACHABLE: {"all": len(proper), "reached": sum(proper)},
        "missing": missing,
        "untouched": [f["name"] for f in found["functions"] if f["execution_count"] == 0],
    }


def _by_call(lines: Iterable[Mapping[str, Any]], text: list[str], home: list[str]) -> set[int]:
    """Numbers of lines with a way that no call of the module asks for, in CasADi's text mostly.

    Such a line was reached, and one of its ways was not. Or it stands in a template of CasADi
    behind such a condition, or says what is done where that text failed, and it cannot fail.
    """
    marks = [k for k, line in enumerate(home, start=1) if any(m in line for m in KERNEL)]
    if len(marks) != 2:
        return set()
    first, last = marks
    fails = any("return 1;" in t and not _PASSED_ON.match(t.strip()) for t in home[first:last])
    found = set()
    for line in lines:
        number = line["line_number"]
        said = text[number - 1].strip()
        if text is not home or not first < number < last:
            if not fails and _FAILED.search(said):
                found.add(number)
            continue
        template = line.get("function_name", "").startswith("casadi_")
        if line["count"] == 0:
            asked = template
        else:
            asked = bool(_ASKED.search(said)) or (not fails and bool(_PASSED_ON.match(said)))
        if asked:
            found.add(number)
    return found


def _decided(line: Mapping[str, Any], asked: set[int]) -> list[bool]:
    """Whether each branch of a line was reached, without those that no call asks for."""
    ways = [b["count"] > 0 for b in line["branches"]]
    if line["line_number"] not in asked:
        return ways
    if line["count"] == 0:
        return []
    missed = ways.count(False)
    return [True] * ways.count(True) + [False] * max(0, missed - 1)


def summary(found: Mapping[str, Any]) -> str:
    """Coverage in one line."""
    if not found:
        return f"coverage not measured: needs gcc and {COUNTER}"
    shares = ", ".join(
        f"{found[k]['reached']} of {found[k]['all']} {k} ({share(found, k):.1%})"
        for k in ("statements", "branches", REACHABLE)
    )
    never = "".join(
        f"; never called: {', '.join(found['untouched'])}" for _ in found["untouched"][:1]
    )
    return f"own test reaches {shares}{never}"


def share(found: Mapping[str, Any], what: str) -> float:
    """Part of the statements or branches that is reached; 1 where there is none."""
    return float(found[what]["reached"] / found[what]["all"]) if found[what]["all"] else 1.0
