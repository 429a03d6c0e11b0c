"""The suite itself: each test asserts something, and none of them reads the clock on the wall."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]
FILES = sorted(TESTS.rglob("test_*.py"))


pytestmark = pytest.mark.second

parsed = cache(lambda path: ast.parse(path.read_text(encoding="utf-8")))


@cache
def functions(path: Path) -> dict[str, ast.FunctionDef]:
    """Functions of a file of the suite, and those that it takes from the suite's helpers."""
    tree = parsed(path)
    found: dict[str, ast.FunctionDef] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            for folder in (TESTS, path.parent):
                helper = folder / (node.module.replace(".", "/") + ".py")
                if helper.exists() and helper != path:
                    taken = {a.name for a in node.names}
                    found |= {n: f for n, f in functions(helper).items() if n in taken}
    return found | {n.name: n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef)}


def name_of(call: ast.Call) -> str:
    return call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")


def asserts(test: ast.FunctionDef, known: dict[str, ast.FunctionDef]) -> bool:
    """Whether a test, or a function that it calls, can fail by what it says."""
    seen, todo = set(), [test]
    while todo:
        function = todo.pop()
        seen.add(function.name)
        for node in ast.walk(function):
            if isinstance(node, ast.Assert) and not isinstance(node.test, ast.Constant):
                return True
            if isinstance(node, ast.Call):
                name = name_of(node)
                if name in ("raises", "warns", "fail") or name.startswith("assert_"):
                    return True
                if name in known and name not in seen:
                    todo.append(known[name])
    return False


def test_every_test_asserts_something() -> None:
    assert [f"{path.name}:{f.lineno} {n}" for path in FILES for n, f in functions(path).items()
            if n.startswith("test_") and not asserts(f, functions(path))] == []  # fmt: skip


def test_a_test_that_asserts_nothing_is_found() -> None:
    text = "def test_a():\n    assert True\ndef test_b():\n    c()\ndef c():\n    assert x\n"
    known = {n.name: n for n in ast.parse(text).body if isinstance(n, ast.FunctionDef)}
    assert not asserts(known["test_a"], known)
    assert asserts(known["test_b"], known)


CLOCKS = {"perf_counter", "perf_counter_ns", "monotonic", "monotonic_ns", "time", "time_ns"}


def test_no_test_reads_the_clock_on_the_wall() -> None:
    """A busy machine fails no test; times of the processor may be compared."""
    found = []
    for path in FILES:
        for n in ast.walk(parsed(path)):
            if isinstance(n, ast.ImportFrom) and n.module == "time":
                found += [f"{path.name}:{n.lineno}" for a in n.names if a.name in CLOCKS]
            if isinstance(n, ast.Attribute) and n.attr in CLOCKS and ast.unparse(n.value) == "time":
                found.append(f"{path.name}:{n.lineno}")
    assert found == []
