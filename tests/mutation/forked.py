"""A plugin of pytest: small changes of functions, each asked in a child of this process.

``PYTHONPATH=tests/mutation python -m pytest -n 0 -p forked --changes 150 --seed 7 --kinds new
--rooms slipctl/run slipctl/study --put changes.json tests/run tests/study``

Every test runs once; what lines it reaches and how long it takes is kept beside ``--put`` (with
coverage). Then a child is forked for each change that ``run.py`` would draw. It has all imported:
it puts the new code in the place of the old and runs the tests that reach the line until one fails,
the quickest of the files of tests that are most about the changed file first. What is in no
function that there is, and with ``--alone`` what lives, is asked by the same tests in a process of
its own, in which every import gives the changed file. What is found of each change is kept in
``--put``, with the tests that were asked; ``run.py --out`` of the same draw goes on with it.
``--again`` asks what lived. A change that is argued to change nothing is not asked.
"""

from __future__ import annotations

import ast
import functools
import gc
import json
import os
import select
import signal
import subprocess
import sys
import tempfile
import time
import types
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import coverage
import entered
import pytest
from _pytest.runner import runtestprotocol
from run import NEW, ROOMS, ROOT, arguments, drawn
from sites import Site

LONGEST = 8.0
"""s of CPU: a test that takes longer as it is recorded is not asked."""

DECLARING = (
    "test_defaults.py", "test_declared_models.py", "test_declared_estimate.py",
    "test_declared_predict.py", "test_declared_certify.py", "test_declared_ccode.py",
)  # fmt: skip
"""Files of tests that hold what is declared as a file is imported, where no test runs its lines."""

NOT_IN = "NOT PUT IN"
"""Of a change that no function can be given."""

HOOK = """
import importlib.machinery as m, json, os, sys
path, text = json.loads(os.environ["CHANGED"])
own = m.SourceFileLoader.get_code
def get_code(self, name):
    same = os.path.realpath(self.path) == path
    return compile(text, self.path, "exec", dont_inherit=True) if same else own(self, name)
m.SourceFileLoader.get_code = get_code
"""
"""``sitecustomize`` of a process, and of those that it starts, that imports a changed file."""


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("small changes")
    group.addoption("--changes", type=int, default=60)
    group.addoption("--seed", type=int, default=1)
    group.addoption("--kinds", nargs="+")
    group.addoption("--rooms", nargs="+", default=list(ROOMS), help="folders of the tree")
    group.addoption("--longest", type=float, default=20, help="s of tests for each change")
    group.addoption("--put", type=Path, default=Path("changes.json"))
    group.addoption(
        "--alone", action="store_true", help="ask what lives so in a process of its own"
    )
    group.addoption("--again", action="store_true", help="ask what lived in --put")
    group.addoption("--share", nargs=2, type=int, default=[0, 1], metavar=("K", "N"),
                    help="every Nth change, from the Kth on")  # fmt: skip


def passed(items: Sequence[pytest.Item]) -> Iterator[tuple[str, bool]]:
    """Run tests; the name of each, and whether it passed."""
    for item, following in zip(items, [*items[1:], None], strict=True):
        item._initrequest()  # type: ignore[attr-defined]
        reports = runtestprotocol(item, nextitem=following, log=False)
        yield item.nodeid, all(r.passed for r in reports)


def recorded(items: Sequence[pytest.Item], beside: Path) -> tuple[Any, dict[str, float]]:
    """Tests that reach each line of each file, and the CPU time of each test that passes.

    What is kept beside is not run again: after an edit of tests, those that are new are.
    """
    data, times = beside.with_suffix(".coverage"), beside.with_suffix(".seconds")
    took: dict[str, float | None] = json.loads(times.read_text("utf-8")) if times.exists() else {}
    todo = [item for item in items if item.nodeid not in took]
    tool = coverage.Coverage(data, source=[str(ROOT / n) for n in ("slipctl", "models")])
    if data.exists():
        tool.load()
    signal.signal(signal.SIGPROF, entered.too_long)
    for begin in range(0, len(todo), 100):
        some = todo[begin : begin + 100]
        tool.start()
        tool.switch_context(some[0].nodeid)
        signal.setitimer(signal.ITIMER_PROF, LONGEST)
        begun = time.process_time()
        for (name, fine), following in zip(passed(some), [*some[1:], None], strict=True):
            now = time.process_time()
            took[name] = now - begun if fine else None
            begun = now
            signal.setitimer(signal.ITIMER_PROF, LONGEST)
            tool.switch_context(following.nodeid if following else "")
        signal.setitimer(signal.ITIMER_PROF, 0)
        tool.stop()
        tool.save()
        times.write_text(json.dumps(took), encoding="utf-8")
    known = coverage.CoverageData(data)
    known.read()
    return {f: known.contexts_by_lineno(f) for f in known.measured_files()}, {
        name: seconds for name, seconds in took.items() if seconds is not None}  # fmt: skip


def lines_of(text: str, line: int) -> range:
    """Lines of the statement at a line; of one that holds others, of its head."""
    found = range(line, line + 1)
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.stmt) and node.lineno <= line <= (node.end_lineno or line):
            body = getattr(node, "body", None)
            end = max(body[0].lineno - 1, node.lineno) if body else node.end_lineno or line
            found = range(node.lineno, end + 1) if line <= end else found
    return found


def by_name(text: str, path: str) -> dict[str, list[types.CodeType]]:
    """Codes of a file by their names, in their order."""
    found, left = defaultdict(list), [compile(text, path, "exec")]
    while left:
        code = left.pop()
        found[code.co_qualname].append(code)
        left += [c for c in code.co_consts if isinstance(c, types.CodeType)]
    return found


def acts(code: types.CodeType) -> list[Any]:
    """What a code does, wherever it stands: its operations and numbers, those of codes inside."""
    own = [acts(c) if isinstance(c, types.CodeType) else repr(c) for c in code.co_consts]
    return [code.co_code, code.co_names, own]


def put_in(site: Site, functions: Sequence[types.FunctionType]) -> bool:
    """Give the functions that there are the code of the changed file; whether the change is in."""
    path = str(ROOT / site.file)
    text = Path(path).read_text(encoding="utf-8")
    old, new = by_name(text, path), by_name(site.applied(text), path)
    pairs = {(n, a.co_firstlineno): b for n in old for a, b in zip(old[n], new[n], strict=False)}
    changed = {(n, a.co_firstlineno) for n in old for a, b in zip(old[n], new[n], strict=False)
               if acts(a) != acts(b)}  # fmt: skip
    took = False
    for f in functions:
        place = f.__code__.co_qualname, f.__code__.co_firstlineno
        if (code := pairs.get(place)) and code.co_freevars == f.__code__.co_freevars:
            f.__code__, took = code, took or place in changed
    return took


def asked_in_a_child(
    site: Site | None, items: Sequence[pytest.Item], live: Mapping[str, Any], limit: float
) -> str:
    """The test that fails with a change, empty where none does; or that the change is not put in.

    Without a change: the one that fails as it is.
    """
    read, write = os.pipe()
    child = os.fork()
    if not child:
        os.setsid()
        signal.signal(signal.SIGPROF, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_PROF, limit)  # s of CPU, after which it ends
        said = "ended"
        try:
            for memory in live["memories"]:
                memory.cache_clear()
            there = site is None or put_in(site, live["functions"][str(ROOT / site.file)])
            said = next((n for n, fine in passed(items) if not fine), "") if there else NOT_IN
        finally:
            os.write(write, said.encode())
            os._exit(0)
    os.close(write)
    ready = select.select([read], [], [], 4 * limit)[0]
    said = os.read(read, 10_000).decode() if ready else "takes too long"
    os.close(read)
    if not ready:
        os.killpg(child, signal.SIGKILL)
    return said or ("takes too long" if os.waitpid(child, 0)[1] else "")


def asked_alone(site: Site, names: Sequence[str], limit: float, change: bool = True) -> str:
    """The test that fails in a process that imports a change; empty where none does."""
    with tempfile.TemporaryDirectory(prefix="change") as scratch:
        Path(scratch, "sitecustomize.py").write_text(HOOK, encoding="utf-8")
        Path(scratch, "asked.txt").write_text("\n".join(names), encoding="utf-8")
        text = (ROOT / site.file).read_text(encoding="utf-8")
        text = site.applied(text) if change else text
        path = os.path.realpath(ROOT / site.file)
        more = {"PYTHONPATH": scratch, "CHANGED": json.dumps([path, text])}
        words = ["-n", "0", "-x", "--tb=no", "-p", "no:cacheprovider", f"@{scratch}/asked.txt"]
        try:
            run = subprocess.run([sys.executable, "-m", "pytest", *words], cwd=ROOT, timeout=limit,
                                 env=os.environ | more, capture_output=True, text=True)  # fmt: skip
        except subprocess.TimeoutExpired:
            return "takes too long"
    failed = [k for k in run.stdout.splitlines() if k.startswith(("FAILED", "ERROR"))]
    if not run.returncode or any(k.startswith("ERROR: not found") for k in failed):
        return ""
    name = failed[0].partition(" ")[2].partition(" - ")[0] if failed else ""
    return name if name in names else run.stderr.strip()[-160:] or "ended"


class Nearness:
    """Which tests are asked of a change of a file, and in which order."""

    def __init__(self, reached: Mapping[str, Any], seconds: Mapping[str, float]) -> None:
        self.reached, self.seconds = reached, seconds
        self.sizes = Counter(name.partition("::")[0] for name in seconds)

    def order(self, site: Site) -> list[str]:
        """Those that reach the line, others of their files, others that reach the file.

        Of each the quick ones first, of files of tests that are most about the file. What a
        fixture or the collection of tests reached, and is kept since, counts so for all.
        """
        lines = self.reached.get(str(ROOT / site.file), {})
        text = (ROOT / site.file).read_text(encoding="utf-8")
        entering = [{n for n in names if n in self.seconds} for names in lines.values()]
        all_of_it = set().union(*entering)
        near = set().union(*(lines.get(n, ()) for n in lines_of(text, site.line))) & all_of_it
        files = {n.partition("::")[0] for n in near}
        about = Counter(name.partition("::")[0] for own in entering for name in own)

        def cost(name: str) -> tuple[int, float]:
            file = name.partition("::")[0]
            far = 0 if name in near else 1 if file in files else 2
            return far, (0.05 + self.seconds[name]) * self.sizes[file] / (about[file] or 1)

        wanted = all_of_it | {n for n in self.seconds if n.partition("::")[0] in files}
        declaring = [n for n in self.seconds if n.partition("::")[0].endswith(DECLARING)]
        rows = sorted(wanted - set(declaring), key=cost)
        k = 0 if not near else len(near - set(declaring))
        return [*rows[:k], *declaring, *rows[k:]]

    def asked(self, site: Site, longest: float) -> list[str]:
        """The first of them, as many as so many seconds hold."""
        spent, chosen = 0.0, list[str]()
        for name in self.order(site):
            spent += self.seconds[name]
            chosen += [name] if spent < longest or not chosen else []
        return chosen


def noticing(
    site: Site,
    names: Sequence[str],
    items: Mapping[str, pytest.Item],
    near: Nearness,
    live: Any,
    alone: bool,
) -> str:
    """The test that notices a change; empty where none does. Without the change it passes."""
    left = list(names)
    while left:
        limit = 8 + 3 * sum(near.seconds[n] for n in left)
        said = asked_in_a_child(site, [items[n] for n in left], live, limit)
        if said == NOT_IN:
            break
        failing = [said] if said in items else left
        if not said or not asked_in_a_child(None, [items[n] for n in failing], live, limit):
            if said or not alone:
                return said
            break
        if said not in items:  # what is not changed takes as long here
            break
        left = left[left.index(said) + 1 :]
    said = asked_alone(site, names, 60 + 8 * sum(near.seconds[n] for n in names))
    return said if said not in items or not asked_alone(site, [said], 200, change=False) else ""


@pytest.hookimpl(tryfirst=True)
def pytest_runtestloop(session: pytest.Session) -> bool:
    given = session.config.option
    reached, seconds = recorded(session.items, given.put)
    gc.unfreeze()
    live: dict[str, Any] = {"functions": defaultdict(list), "memories": []}
    for thing in gc.get_objects():
        if isinstance(thing, types.FunctionType):
            live["functions"][thing.__code__.co_filename].append(thing)
        elif isinstance(thing, functools._lru_cache_wrapper) and "slipctl" in thing.__module__:
            live["memories"].append(thing)
    gc.freeze()  # a child that looks at all would copy it
    items = {item.nodeid: item for item in session.items if item.nodeid in seconds}
    near = Nearness(reached, {name: seconds[name] for name in items})
    kept = json.loads(given.put.read_text("utf-8")) if given.put.exists() else {"found": {}}
    kinds, argued = list(NEW) if given.kinds == ["new"] else given.kinds, arguments()
    score = Counter[str]()
    first, step = given.share
    for _, site in drawn(given.changes, given.seed, given.rooms, kinds)[first::step]:
        before = kept["found"].get(site.name)
        if site.name in argued or (before and (before["caught"] or not given.again)):
            score["argued" if site.name in argued else "known"] += 1
            continue
        names = near.asked(site, given.longest)
        said = noticing(site, names, items, near, live, given.alone) if names else ""
        told = {"kind": site.kind, "line": site.line, "tests": len(names), "caught": said or None}
        kept["found"][site.name] = told | {"asked": [] if said else names[:8]}
        given.put.write_text(json.dumps(kept, indent=1), encoding="utf-8")
        score["noticed" if said else "lives"] += 1
        print(f"{said or 'LIVES'}\n    {len(names)} tests: {site.file}:{site.line} {site.kind} "
              f"{site.name.partition(':')[2][:200]}", flush=True)  # fmt: skip
    print(dict(score), flush=True)
    return True
