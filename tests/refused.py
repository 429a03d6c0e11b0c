"""A plugin of pytest: which refusals of bad input do the tests of this run never reach?

``PYTHONPATH=tests pytest -n 0 -p refused tests/block`` prints, at its end, each ``raise BadInput``
of the package that no test came to. What other runs came to counts too, where ``REACHED=file``
names a file that all of them write to. A refusal notes from where it is made, which costs nothing.
"""

from __future__ import annotations

import ast
import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from slipctl.errors import BadInput

ROOT = Path(__file__).parents[1]
KEPT = Path(os.environ["REACHED"]) if "REACHED" in os.environ else None
reached: set[tuple[str, int]] = set()
made = BadInput.__init__


def noted(self: BadInput, *words: Any) -> None:
    """As BadInput is made; the lines of those who make it are noted."""
    frame = sys._getframe(1)
    reached.add((os.path.realpath(frame.f_code.co_filename), frame.f_lineno))
    made(self, *words)


def refusals() -> Iterator[tuple[Path, int, int, str]]:
    """File, first and last line and words of each ``raise BadInput``."""
    for path in sorted((ROOT / "slipctl").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            call = node.exc if isinstance(node, ast.Raise) else None
            if isinstance(call, ast.Call) and getattr(call.func, "id", "") == "BadInput":
                yield path, call.lineno, call.end_lineno or call.lineno, ast.unparse(call)


def unreached() -> Iterator[str]:
    for path, first, last, words in refusals():
        lines = {(os.path.realpath(path), k) for k in range(first, last + 1)}
        if not lines & reached:
            yield f"{path.relative_to(ROOT)}:{first}: {words}"


def pytest_configure() -> None:
    BadInput.__init__ = noted  # type: ignore[method-assign, assignment]
    if KEPT and KEPT.exists():
        reached.update((file, line) for file, line in json.loads(KEPT.read_text("utf-8")))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    if KEPT:
        KEPT.write_text(json.dumps(sorted(reached)), encoding="utf-8")
    never = list(unreached())
    terminalreporter.section(f"refusals never reached: {len(never)} of {len(list(refusals()))}")
    for line in never:
        terminalreporter.write_line(line)
