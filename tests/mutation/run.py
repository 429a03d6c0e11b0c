"""Would the tests notice? Small changes of the code, and whether a test fails of each.

``python tests/mutation/run.py --mutations 400 --seed 1 --out mutations.json`` draws changes by seed
(operators, comparisons, signs, constants, conditions, results and arguments left out; of newer
kinds another local name, a statement skipped, a condition never or always true, an operand dropped,
two arguments swapped, break for continue, a refusal removed, index, slice, a constant by a tenth)
and runs, in a copy of the tree, the tests of the same room that enter the changed function, the
quickest first. What is in the file already is not done again, so that a run that was stopped goes
on. Tests beyond ``--longest`` seconds are not asked: a change that only they would notice counts as
one that lives.
Tables of what was computed once are not asked either, as they notice every change.

With ``--kinds`` the draw is of these kinds alone, each as often as every other, and over all rooms;
``--everywhere`` asks all default tests that enter the changed function, whatever room they are of.

``--again docs/evidence/mutations.json`` asks today's tests about the changes that lived in a run on
record. Its others count as it found them, and places that are gone are left out and named. Who has
seen what lived has written tests for it: the share that a new seed gives is the one to quote.

An own tool, because those that exist run one command of the whole suite for each change: here that
is 8 minutes against seconds, and hours against days for 400. This process has imported what the
package and pytest depend on, and forks for each change. Linux and macOS only (links, forks).
"""

from __future__ import annotations

import argparse
import importlib
import json
import multiprocessing
import os
import random
import shutil
import signal
import sys
import tempfile
import time
import tomllib
from pathlib import Path
from typing import Any

import pytest
from sites import Site, sites

ROOT = Path(__file__).parents[2]
ROOMS = {
    "slipctl/certify": ["tests/certify", "tests/commands/test_cli_certify.py",
                        "tests/seek/test_extremum.py", "tests/seek/test_extremum_lock.py",
                        "tests/block/test_discretisation.py", "tests/analysis/test_enclosures.py",
                        "tests/design/test_statement.py", "tests/estimate/test_filtering.py",
                        "tests/docs/test_errata_freight.py",
                        "tests/docs/test_errata_traction_control.py"],
    "slipctl/ccode": ["tests/ccode"],
    "slipctl/estimate": ["tests/estimate", "tests/models/test_parts.py"],
    "slipctl/predict": ["tests/predict", "tests/models/test_parts.py"],
    "models": ["tests/models", "tests/study/test_loop_files.py", "tests/study/test_trip_files.py",
               "tests/docs/test_errata.py", "tests/docs/test_errata_contact.py",
               "tests/docs/test_errata_freight.py", "tests/docs/test_errata_traction_control.py",
               "tests/docs/test_errata_train.py",
               "tests/studies/test_hst_traction.py", "tests/studies/test_subway_braking.py"],
}  # fmt: skip
"""Where changes are made, and the tests that are asked: the room's own and named neighbours."""

REST = [path.relative_to(ROOT).as_posix() for path in sorted((ROOT / "slipctl").iterdir())
        if (path / "__init__.py").exists() and f"slipctl/{path.name}" not in ROOMS]  # fmt: skip
ROOMS |= {room: [f"tests/{Path(room).name}", "tests/commands"] for room in REST
          if (ROOT / "tests" / Path(room).name).exists()}  # fmt: skip

EVERYWHERE = "everywhere"
"""What all default tests together are called where those of a room stand."""
ROOMS_OF_TESTS = ROOMS | {EVERYWHERE: ["tests"]}

NEW = ("name", "skipped", "never", "always", "operand", "swapped", "break", "refusal", "index",
       "slice", "tenth")  # fmt: skip
"""Kinds that are drawn where ``--kinds new`` is asked for."""

FIRST = 30
"""So many of the quickest tests go first: most changes fall there."""


class Tree:
    """A copy of the clone whose ``slipctl`` is that of the copy, with all of its tests."""

    def __init__(self, folder: Path, cache: Path) -> None:
        self.root, self.site = folder / "tree", folder / "site"
        skip = shutil.ignore_patterns(".git", ".venv", "out", "build", "dist", "__pycache__",
                                      "*.egg-info", ".*_cache", ".hypothesis")  # fmt: skip
        shutil.copytree(ROOT, self.root, ignore=skip)
        package = self.site / "slipctl"
        package.mkdir(parents=True)
        for path in (self.root / "slipctl").iterdir():
            (package / path.name).symlink_to(path)
        for name in ("models", "studies"):
            (package / name).symlink_to(self.root / name)
        self.environment = {
            "PYTHONPATH": os.pathsep.join([str(self.site), str(Path(__file__).parent)]),
            "SLIPCTL_CACHE": str(cache), "PYTHONDONTWRITEBYTECODE": "1",
        }  # fmt: skip

    def pytest(self, words: list[str], limit: float, **more: str) -> tuple[int | None, str]:
        """Exit code, None where it takes longer than the limit, and what is printed."""
        said, end = self.root / "said.txt", time.monotonic() + limit
        child = os.fork()
        if not child:
            self.test(["-n", "0", "-p", "no:cacheprovider", "-m", "not table", *words], said, more)
        while not (done := os.waitpid(child, os.WNOHANG))[0]:
            if time.monotonic() > end:
                os.killpg(child, signal.SIGKILL)
                os.waitpid(child, 0)
                return None, ""
            time.sleep(0.02)
        return os.waitstatus_to_exitcode(done[1]), said.read_text("utf-8", errors="replace")

    def test(self, words: list[str], said: Path, more: dict[str, str]) -> None:
        """What the child does: pytest in this tree, as a process of its own would."""
        code = 70
        try:
            os.setsid()
            os.chdir(self.root)
            os.environ.update(self.environment | more)
            sys.dont_write_bytecode = not more  # the run without a change leaves it for all others
            sys.path[:0] = self.environment["PYTHONPATH"].split(os.pathsep)
            target = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(target, 1)
            os.dup2(target, 2)
            code = int(pytest.main(words))
            sys.stdout.flush()
        finally:
            os._exit(code)

    def entered(self, room: str, limit: float) -> dict[str, Any]:
        """The room's passing tests: what each enters, and how long it takes."""
        file = self.root / "entered.json"
        file.unlink(missing_ok=True)
        code, said = self.pytest(["-p", "entered", *ROOMS_OF_TESTS[room]], limit, ENTERED=str(file))
        lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
        found: dict[str, Any] = {}
        for line in lines:
            found |= json.loads(line)
        if code is None or not found:  # then every change would seem to live
            raise SystemExit(f"{room}: no test passes without a change\n{said[-2000:]}")
        package = f"{self.site / 'slipctl'}{os.sep}"
        for test in found.values():
            test["entered"] = [e.removeprefix(package) for e in test["entered"]]
        return found


def asked(site: Site, tests: dict[str, Any], longest: float) -> list[str]:
    """Tests that enter the function, then the file, then (no test of it: it ran before) all.

    The quickest first; of all, those first whose file names the changed one. A test that reads what
    the room declares, defaults too, enters nothing of it, and is asked of every change.
    """
    inside, stem = site.file.removeprefix("slipctl/"), Path(site.file).stem
    naming = {f for f in {t.split("::")[0] for t in tests}
              if stem in (ROOT / f).read_text(encoding="utf-8")}  # fmt: skip

    def nearness(test: str) -> int:
        entered = tests[test]["entered"]
        if f"{inside}:{site.function}" in entered:
            return 0
        return 1 if any(e.startswith(f"{inside}:") for e in entered) else 2

    near = {t: nearness(t) for t in tests}
    if site.function == "<module>" or min(near.values()) == 2:  # seen by whoever imports it
        chosen = sorted(tests, key=lambda t: (t.split("::")[0] not in naming, tests[t]["seconds"]))
    else:
        chosen = sorted((t for t in tests if near[t] < 2),
                        key=lambda t: (near[t], tests[t]["seconds"]))  # fmt: skip
    declared = [t for t in tests if "/test_declared_" in t or "/test_defaults" in t]
    spent, inside_time = 0.0, list(declared)
    for test in (t for t in chosen if t not in declared):
        spent += tests[test]["seconds"]
        if spent > longest and inside_time:
            break
        inside_time.append(test)
    return inside_time


def judged(tree: Tree, site: Site, tests: dict[str, Any], longest: float) -> dict[str, Any]:
    """How a change ends: the test that notices it, or that none does."""
    target = tree.root / site.file
    text = target.read_text(encoding="utf-8")
    names = asked(site, tests, longest)
    told = {"kind": site.kind, "line": site.line, "tests": len(names)}
    for stale in (target.parent / "__pycache__").glob(f"{target.stem}.*"):
        stale.unlink()  # its time does not tell the change from the original
    try:
        target.write_text(site.applied(text), encoding="utf-8")
        for part in (names[:FIRST], names[FIRST:]):
            if not part:
                continue
            listed = tree.root / "asked.txt"
            listed.write_text("\n".join(part), encoding="utf-8")
            limit = 240 + 10 * sum(tests[t]["seconds"] for t in part)
            code, said = tree.pytest(["-x", "--tb=no", f"@{listed}"], limit)
            if code is None:
                return told | {"caught": "takes too long"}
            if code == pytest.ExitCode.USAGE_ERROR and "ERROR: not found" in said:
                raise SystemExit(f"a test is gone; a new --out finds them anew\n{said[-500:]}")
            if code:
                failed = [k for k in said.splitlines() if k.startswith(("FAILED", "ERROR"))]
                return told | {"caught": failed[0][:160] if failed else said.strip()[-160:]}
    finally:
        target.write_text(text, encoding="utf-8")
    return told | {"caught": None}


def warm() -> None:
    """Import what tests import of others, once; nothing of the package, which changes."""
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # threads do not live on in a child
    for name in ("numpy", "scipy.optimize", "scipy.linalg", "scipy.signal", "casadi", "xarray",
                 "netCDF4", "matplotlib.pyplot", "pint", "hypothesis", "control", "osqp",
                 "_pytest.assertion.rewrite", "xdist.plugin"):  # fmt: skip
        importlib.import_module(name)


def drawn(
    number: int, seed: int, rooms: list[str], kinds: list[str] | None = None
) -> list[tuple[str, Site]]:
    """So many changes of the rooms, each as likely as every other; or kind by kind in turn."""
    every = [(room, site) for room in rooms for path in sorted((ROOT / room).rglob("*.py"))
             for site in sites(path.relative_to(ROOT).as_posix(),
                               path.read_text(encoding="utf-8"))]  # fmt: skip
    rng = random.Random(seed)
    if not kinds:
        return rng.sample(every, min(number, len(every)))
    piles = [[w for w in every if w[1].kind == kind] for kind in kinds]
    for pile in piles:
        rng.shuffle(pile)
    in_turn = [pile[k] for k in range(number) for pile in piles if k < len(pile)]
    return in_turn[:number]


def arguments() -> dict[str, str]:
    """Changes that change nothing that is promised: why."""
    text = (Path(__file__).parent / "equivalent.toml").read_text("utf-8")
    return dict(tomllib.loads(text))


def summary(found: dict[str, Any]) -> dict[str, Any]:
    """Score and survivors, each with the argument why it changes nothing, where there is one."""
    reasons = arguments()
    lived = {n: reasons.get(n, "") for n, r in found.items() if not r["caught"]}
    caught = len(found) - len(lived)
    return {
        "mutations": len(found), "caught": caught, "score": round(caught / max(1, len(found)), 4),
        "argued": {n: why for n, why in lived.items() if why},
        "open": [n for n, why in lived.items() if not why],
    }  # fmt: skip


def together(before: dict[str, Any], again: dict[str, Any], gone: list[str]) -> dict[str, Any]:
    """A run on record, and what was found of the changes that lived in it."""
    argued = again["argued"] | {n: why for n, why in arguments().items() if n in before["open"]}
    caught, number = before["caught"] + again["caught"], before["mutations"] - len(gone)
    return {
        "mutations": number, "caught": caught, "score": round(caught / number, 4),
        "caught at first": before["caught"], "asked again": again["mutations"], "gone": gone,
        "argued": argued, "open": again["open"],
    }  # fmt: skip


TREE: Tree
"""The worker's own."""


def begin(trees: multiprocessing.Queue[Tree]) -> None:
    global TREE
    TREE = trees.get()


def do(task: tuple[Site, dict[str, Any], float]) -> tuple[str, dict[str, Any]]:
    site, tests, longest = task
    return site.name, judged(TREE, site, tests, longest)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--mutations", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--room", nargs="+", choices=ROOMS, default=list(ROOMS))
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--longest", type=float, default=60, help="s of tests for each change")
    parser.add_argument("--match", default="", help="only changes whose name has this text")
    parser.add_argument("--kinds", nargs="+", help="of changes that are drawn in turn; 'new'")
    parser.add_argument("--everywhere", action="store_true", help="ask the tests of all rooms")
    parser.add_argument("--again", type=Path, help="only changes that lived in this evidence")
    parser.add_argument("--out", type=Path, default=Path("mutations.json"))
    chosen = parser.parse_args()

    all_of_them = chosen.match or chosen.again
    kinds = list(NEW) if chosen.kinds == ["new"] else chosen.kinds
    number = 10**9 if all_of_them else chosen.mutations
    wanted = drawn(number, chosen.seed, chosen.room, None if all_of_them else kinds)
    if chosen.everywhere:
        wanted = [(EVERYWHERE, site) for _, site in wanted]
    wanted = [w for w in wanted if chosen.match in w[1].name]
    before: dict[str, Any] = {}
    gone: list[str] = []
    if chosen.again:
        before = json.loads(chosen.again.read_text("utf-8"))["numbers"]["mutations"]
        stands = {site.name for _, site in drawn(10**9, chosen.seed, list(ROOMS))}
        gone = [n for n in before["open"] if n not in stands]
        asked_again = set(before["open"]) - set(arguments())
        wanted = [w for w in wanted if w[1].name in asked_again]
    kept = json.loads(chosen.out.read_text("utf-8")) if chosen.out.exists() else {}
    found: dict[str, Any] = kept.get("found", {})
    tests: dict[str, Any] = kept.get("tests", {})
    todo = [w for w in wanted if w[1].name not in found]

    def keep() -> None:
        names = {w[1].name for w in wanted}
        told = summary({n: r for n, r in found.items() if n in names})
        told = together(before, told, gone) if chosen.again else told
        text = json.dumps({"summary": told, "found": found, "tests": tests}, indent=1)
        part = chosen.out.with_suffix(".part")
        part.write_text(text, encoding="utf-8")
        part.replace(chosen.out)

    warm()
    with tempfile.TemporaryDirectory(prefix="mutation") as scratch:
        cache = Path(scratch, "cache")
        trees: multiprocessing.Queue[Tree] = multiprocessing.Queue()
        made = [Tree(Path(scratch, str(k)), cache) for k in range(chosen.jobs)]
        for tree in made:
            trees.put(tree)
        known = [w for w in todo if w[0] in tests]  # in the order drawn; then room by room
        others = dict.fromkeys(w[0] for w in todo if w[0] not in tests)
        for batch in (known, *([w for w in todo if w[0] == room] for room in others)):
            for room in {w[0] for w in batch} - set(tests):
                print(f"{room}: which test enters what", flush=True)
                tests[room] = made[0].entered(room, 7200)
                keep()
            with multiprocessing.get_context("fork").Pool(chosen.jobs, begin, (trees,)) as pool:
                tasks = [(site, tests[room], chosen.longest) for room, site in batch]
                for name, result in pool.imap_unordered(do, tasks):
                    found[name] = result
                    keep()
                    print(f"{result['caught'] or 'SURVIVES'}\n    {name}"[:300], flush=True)
            for tree in made:
                trees.put(tree)
    keep()
    print(json.dumps(json.loads(chosen.out.read_text("utf-8"))["summary"], indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
