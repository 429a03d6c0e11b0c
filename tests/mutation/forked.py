"""A plugin of pytest: small changes of functions, each asked in a child of this process.

``PYTHONPATH=tests/mutation python -m pytest -n 0 -p forked --changes 150 --seed 7 --kinds new
--rooms slipctl/run slipctl/study --put changes.json tests/run tests/study``

Every test runs once; what lines it reaches and how long it takes is kept beside ``--put`` (with
coverage). Then a child is forked for each change that ``run.py`` would draw. It has all imported:
it puts the new code in the place of the old and runs the tests that reach the line, the quickest
first, until one fails. What is noticed so is entered where ``run.py --out`` of the same draw goes
on with the others: what runs as a module is imported, what tests made as they were collected.
"""

from __future__ import annotations

import ast
import functools
import gc
import json
import os
import signal
import time
import types
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import coverage
import entered
import pytest
from _pytest.runner import runtestprotocol
from run import NEW, ROOMS, ROOT, drawn
from sites import Site

LONGEST = 8.0
"""s of CPU: a test that takes longer as it is recorded is not asked."""

NOT_IN = "NOT PUT IN"
"""Of a change that no function can be given."""


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("small changes")
    group.addoption("--changes", type=int, default=60)
    group.addoption("--seed", type=int, default=1)
    group.addoption("--kinds", nargs="+")
    group.addoption("--rooms", nargs="+", choices=ROOMS, default=list(ROOMS))
    group.addoption("--longest", type=float, default=10, help="s of tests for each change")
    group.addoption("--put", type=Path, default=Path("changes.json"))


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


def asked_in_a_child(site: Site, items: Sequence[pytest.Item], live: Mapping[str, Any]) -> str:
    """The test that notices a change, empty where none does; or that the change is not put in."""
    read, write = os.pipe()
    child = os.fork()
    if not child:
        signal.setitimer(signal.ITIMER_PROF, 120)  # s of CPU, after which it ends
        said = "ended"
        try:
            for memory in live["memories"]:
                memory.cache_clear()
            there = put_in(site, live["functions"][str(ROOT / site.file)])
            said = next((n for n, fine in passed(items) if not fine), "") if there else NOT_IN
        finally:
            os.write(write, said.encode())
            os._exit(0)
    os.close(write)
    with os.fdopen(read, "rb") as pipe:
        said = pipe.read().decode()
    return said or ("takes too long" if os.waitpid(child, 0)[1] else "")


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
    kept = json.loads(given.put.read_text("utf-8")) if given.put.exists() else {"found": {}}
    kinds = list(NEW) if given.kinds == ["new"] else given.kinds
    for _, site in drawn(given.changes, given.seed, given.rooms, kinds):
        lines = reached.get(str(ROOT / site.file), {})
        text = (ROOT / site.file).read_text(encoding="utf-8")
        near = set().union(*(lines.get(n, ()) for n in lines_of(text, site.line))) & set(items)
        files = {name.partition("::")[0] for name in near}  # what a fixture reached counts for all
        order = sorted((n for n in items if n.partition("::")[0] in files),
                       key=lambda n: (n not in near, seconds[n]))  # fmt: skip
        spent, chosen = 0.0, []
        for name in order:
            spent += seconds[name]
            chosen += [items[name]] if spent < given.longest or not chosen else []
        caught = asked_in_a_child(site, chosen, live) if chosen else ""
        print(f"{caught or 'LIVES'}\n    {len(chosen)} tests: {site.name[:200]}", flush=True)
        if caught and caught != NOT_IN:
            told = {"kind": site.kind, "line": site.line, "tests": len(chosen), "caught": caught}
            kept["found"].setdefault(site.name, told)
            given.put.write_text(json.dumps(kept, indent=1), encoding="utf-8")
    return True
