"""Measure how the house stands: ``python docs/measure_house.py [--suite SECONDS] [--static]``.

Each row has what is there now and what is wanted. Lines are raw lines of ``.py`` of the engine
(``slipctl``) and of ``models``; ``certify`` counts in the lines of the engine, in names and in
circles, and in no other row. ``--static`` leaves out what a run has to tell.
"""

from __future__ import annotations

import argparse
import ast
import inspect
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "tests" / "docs"))

from test_names import is_equation, says_nothing

HERE = Path(__file__).parent
ROOT = HERE.parent
APART = "certify"


@dataclass(frozen=True)
class Row:
    """A number of the house, and how large it may be."""

    what: str
    now: float
    wanted: float

    @property
    def reached(self) -> bool:
        return self.now <= self.wanted


def sources(apart: bool = True) -> Iterator[Path]:
    """Files of engine and models, in their order; without ``certify`` where it is apart."""
    for folder in ("slipctl", "models"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            if not (apart and path.relative_to(ROOT).parts[1] == APART):
                yield path


def lines(path: Path) -> int:
    return len(path.read_text(encoding="utf-8").splitlines())


def functions(tree: ast.AST) -> Iterator[ast.FunctionDef]:
    yield from (n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef))


def largest_circle() -> int:
    """Files that import each other, inside functions too, and by their names in strings."""
    paths = {}
    for package, folder in (("slipctl", "slipctl"), ("slipctl.models", "models")):
        for path in sorted((ROOT / folder).rglob("*.py")):
            parts = [package, *path.relative_to(ROOT / folder).with_suffix("").parts]
            paths[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    graph = {m: {t for t in named(path) if t in paths and t != m} for m, path in paths.items()}
    for targets in graph.values():
        targets.discard("slipctl")  # exports lazily
    return max(map(len, circles(graph)))


def named(path: Path) -> set[str]:
    """What a file imports where it runs, or looks up by a string that is a module's name."""
    found, nodes = set(), [ast.parse(path.read_text(encoding="utf-8")).body]
    while nodes:
        for node in nodes.pop():
            if isinstance(node, ast.ImportFrom) and node.module:
                found |= {node.module, *(f"{node.module}.{a.name}" for a in node.names)}
            elif isinstance(node, ast.Call) and "import_module" in ast.unparse(node.func):
                found |= {a.value for a in node.args if isinstance(a, ast.Constant)}
                nodes.append(list(ast.iter_child_nodes(node)))
            elif not (isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)):
                nodes.append(list(ast.iter_child_nodes(node)))
    return found


def circles(graph: dict[str, set[str]]) -> list[set[str]]:
    """Parts of a graph from each of which one comes back to itself; single nodes are left out."""

    def reached(start: str) -> set[str]:
        seen: set[str] = set()
        todo = [start]
        while todo:
            for target in graph[todo.pop()] - seen:
                seen.add(target)
                todo.append(target)
        return seen

    onward = {m: reached(m) for m in graph}
    return [{o for o in onward[m] if m in onward[o]} for m in graph] or [set()]


def static() -> Iterator[Row]:
    """What the files themselves tell."""
    engine = sum(map(lines, (ROOT / "slipctl").rglob("*.py")))
    yield Row("engine, raw lines", engine, 66_000)
    beside: dict[Path, int] = {}
    for path in sources():
        beside[path.parent] = beside.get(path.parent, 0) + (path.name != "__init__.py")
    yield Row("most files side by side", max(beside.values()), 15)
    yield Row("files above 500 lines", sum(lines(p) > 500 for p in sources()), 0)
    trees = {p: ast.parse(p.read_text(encoding="utf-8")) for p in sources(apart=False)}
    public = [n.name for t in trees.values() for n in t.body
              if isinstance(n, ast.FunctionDef) and not is_equation(n)]  # fmt: skip
    yield Row("public functions whose names say nothing", sum(map(says_nothing, public)), 10)
    yield Row("modules whose names say nothing", sum(says_nothing(p.stem) for p in trees), 0)
    yield Row("files in the largest circle", largest_circle(), 0)
    longest = max(f.end_lineno - f.lineno + 1 for p in sources()  # type: ignore[operator]
                  for f in functions(trees[p]))  # fmt: skip
    yield Row("longest function, lines", longest, 80)
    yield from parameters()
    yield from touched()


def parameters() -> Iterator[Row]:
    """How many arguments the largest doors have."""
    import slipctl
    from slipctl.ccode.codegen import export

    for door, wanted in ((export, 8), (slipctl.Block, 12), (slipctl.nmpc, 8)):
        yield Row(f"parameters of {door.__name__}", len(inspect.signature(door).parameters), wanted)


def touched() -> Iterator[Row]:
    """Files that each worked example of docs/extending.md makes or changes, its tests left out."""
    page = (HERE / "extending.md").read_text(encoding="utf-8")
    sections = dict(re.findall(r"^## ([^\n]+)\n(.*?)(?=^## |\Z)", page, re.M | re.S))
    for title, wanted in (("A controller", 3), ("A metric", 1), ("A command", 3),
                          ("A kind of plant", 3)):  # fmt: skip
        found = re.findall(r"^(?:`|\+\+\+ b/)((?!tests/)[\w/]+\.py)", sections[title], re.M)
        yield Row(f"files to touch: {title.lower()}", len(set(found)), wanted)


CALLS = """
import json, os, sys
from slipctl.commands.cli import main
import slipctl, slipctl.models
found = {"calls": 0, "resolved": 0}
ours = tuple(os.path.dirname(m.__file__) + os.sep for m in (slipctl, slipctl.models))
def count(frame, event, argument):
    if event == "call":
        found["calls"] += frame.f_code.co_filename.startswith(ours)
        found["resolved"] += frame.f_code.co_name == "load_study"
sys.stdout = open(os.devnull, "w")
sys.setprofile(count)
code = main(["run", "metro.toml", "--set", "m=40t", "--out", "out", "--quiet"])
sys.setprofile(None)
sys.__stdout__.write(json.dumps(found))
sys.exit(code)
"""


def running() -> Iterator[Row]:
    """What ``slipctl run metro.toml --set m=40t`` calls in its first process.

    Calls of our own functions: those of packages hang on which of them are installed beside.
    """
    with tempfile.TemporaryDirectory() as folder:
        new = [sys.executable, "-m", "slipctl", "new", "metro"]
        subprocess.run(new, cwd=folder, check=True, capture_output=True)
        for _ in range(2):  # the first one compiles
            subprocess.run(["rm", "-rf", "out"], cwd=folder, check=True)
            done = subprocess.run([sys.executable, "-c", CALLS], cwd=folder, check=True,
                                  capture_output=True, text=True)  # fmt: skip
    found = json.loads(done.stdout)
    yield Row("own calls of `run metro.toml --set m=40t`", found["calls"], 250_000)
    yield Row("resolutions of its name", found["resolved"], 1)


def table(rows: list[Row]) -> str:
    """The rows as a person reads them."""
    wide = max(len(r.what) for r in rows)
    return "\n".join(
        f"{r.what:<{wide}}  {r.now:>9,.0f}  wanted at most {r.wanted:>7,.0f}"
        f"  {'reached' if r.reached else 'open'}"
        for r in rows
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--suite", type=float, metavar="SECONDS", help="of the first tier")
    parser.add_argument("--static", action="store_true", help="only what the files tell")
    options = parser.parse_args()
    rows = [*static(), *([] if options.static else running())]
    if options.suite:
        rows.append(Row("first tier of the suite, s", options.suite, 300))
    print(table(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
