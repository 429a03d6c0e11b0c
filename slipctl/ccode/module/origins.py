"""Where an equation was written: the file and the line that gave a name its value.

Read from the source of the Python functions that made the expressions. Where there is none (typed
in, made at run time), nothing is told.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import CodeType

_NUMBER = re.compile(r"\((?:[A-Z]\.?)?\d+[a-z]?\)(?:-\((?:[A-Z]\.?)?\d+[a-z]?\))?")
"""Number of an equation, (12), or of some, (10)-(17)."""


@dataclass(frozen=True)
class Written:
    """What the text of a function says.

    Attributes:
        file: its name, without folders.
        names: line of the last assignment to a local.
        keys: line of each name that goes into a dict, as next states and outputs do.
        numbers: equations of the paper that its docstring names.
    """

    file: str = ""
    names: Mapping[str, int] | None = None
    keys: Mapping[str, int] | None = None
    numbers: tuple[str, ...] = ()

    def told(self, line: int, doc: str) -> str:
        """``file.py:12``, with the paper's numbers behind that are not in ``doc``."""
        own = [n for n in self.numbers if n not in doc]
        return ", ".join([f"{self.file}:{line}", *own])


def of_local(code: CodeType, name: str, doc: str) -> str:
    """Where a local of a function got its value; empty if that is not known."""
    found = source_of_code(code)
    line = (found.names or {}).get(name)
    return found.told(line, doc) if line else ""


def of_result(codes: list[CodeType], name: str, doc: str) -> str:
    """Where a next state or an output got its value, in the first function that says so."""
    for code in codes:
        found = source_of_code(code)
        line = (found.keys or {}).get(name)
        if line:
            return found.told(line, doc)
    return ""


@lru_cache(maxsize=4096)
def source_of_code(code: CodeType) -> Written:
    """What the text of a function says; empty where there is no text."""
    tree = _tree(code.co_filename)
    for node in ast.walk(tree) if tree else ():
        if not isinstance(node, ast.FunctionDef) or node.name != code.co_name:
            continue
        begins = min([node.lineno, *(d.lineno for d in node.decorator_list)])
        if begins == code.co_firstlineno:
            return _read(node, Path(code.co_filename).name)
    return Written()


def _read(function: ast.FunctionDef, file: str) -> Written:
    names: dict[str, int] = {}
    keys: dict[str, int] = {}
    waiting: list[ast.AST] = list(function.body)
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.FunctionDef | ast.Lambda):
            continue  # its own locals
        waiting += ast.iter_child_nodes(node)
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names[node.id] = max(node.lineno, names.get(node.id, 0))
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            if node.func.id == "dict":
                keys |= {k.arg: k.value.lineno for k in node.keywords if k.arg}
        elif isinstance(node, ast.Dict):
            for key, value in zip(node.keys, node.values, strict=True):
                if isinstance(key, ast.Constant) and isinstance(key.value, str):
                    keys[key.value] = value.lineno
    # a result that only hands a local on was written where that local was
    handed = {
        k.arg: k.value.id
        for node in ast.walk(function) if isinstance(node, ast.Call)
        for k in node.keywords if k.arg and isinstance(k.value, ast.Name)
    }  # fmt: skip
    keys |= {k: names[v] for k, v in handed.items() if k in keys and v in names}
    doc = (ast.get_docstring(function) or "").partition("\n\n")[0]
    return Written(file, names, keys, tuple(dict.fromkeys(_NUMBER.findall(doc))))


@lru_cache(maxsize=256)
def _tree(file: str) -> ast.Module | None:
    try:
        return ast.parse(Path(file).read_text(encoding="utf-8"))
    except (OSError, SyntaxError, ValueError):
        return None
