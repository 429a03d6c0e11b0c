"""Would the tests notice? Small changes of the code, and whether a test fails of each.

``python tests/mutation/run.py --mutations 400 --seed 1 --out mutations.json`` draws changes by seed
(operators, comparisons, signs, constants, conditions, results and arguments left out) and runs, in
a copy of the tree, the tests of the same room that enter the changed function, the quickest first.
What is in the file already is not done again, so that a run that was stopped goes on.

An own tool, because those that exist run one command of the whole suite for each change: here that
is 8 minutes against seconds, and hours against days for 400. Linux and macOS only (links).
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import threading
import tomllib
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

from sites import Site, sites

ROOT = Path(__file__).parents[2]
ROOMS = {
    "slipctl/certify": ["tests/certify", "tests/commands/test_cli_certify.py"],
    "slipctl/ccode": ["tests/ccode"],
    "slipctl/estimate": ["tests/estimate"],
    "slipctl/predict": ["tests/predict"],
    "models": ["tests/models", "tests/docs/test_errata.py", "tests/docs/test_errata_contact.py",
               "tests/docs/test_errata_freight.py", "tests/docs/test_errata_traction_control.py",
               "tests/docs/test_errata_train.py", "tests/study/test_jobs.py",
               "tests/studies/test_hst_traction.py", "tests/studies/test_subway_braking.py"],
}  # fmt: skip
"""Where changes are made, and the tests that are asked: the room's own and named neighbours."""

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
        self.environment = os.environ | {
            "PYTHONPATH": os.pathsep.join([str(self.site), str(Path(__file__).parent)]),
            "SLIPCTL_CACHE": str(cache), "PYTHONDONTWRITEBYTECODE": "1",
        }  # fmt: skip

    def pytest(self, words: list[str], limit: float, **more: str) -> tuple[int | None, str]:
        """Exit code, None where it takes longer than the limit, and what is printed."""
        command = [sys.executable, "-m", "pytest", "-n", "0", "-p", "no:cacheprovider", *words]
        process = subprocess.Popen(
            command, cwd=self.root, env=self.environment | more, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True, errors="replace", start_new_session=True,
        )  # fmt: skip
        try:
            said, _ = process.communicate(timeout=limit)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, 9)
            process.communicate()
            return None, ""
        return process.returncode, said

    def entered(self, room: str, limit: float) -> dict[str, Any]:
        """The room's passing tests: what each enters, and how long it takes."""
        file = self.root / "entered.json"
        file.unlink(missing_ok=True)
        code, said = self.pytest(["-p", "entered", *ROOMS[room]], limit, ENTERED=str(file))
        found = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
        if code is None or not found:  # then every change would seem to live
            raise SystemExit(f"{room}: no test passes without a change\n{said[-2000:]}")
        package = f"{self.site / 'slipctl'}{os.sep}"
        for test in found.values():
            test["entered"] = [e.removeprefix(package) for e in test["entered"]]
        return found


def asked(site: Site, tests: dict[str, Any]) -> list[str]:
    """Tests that enter the function; where none does (it ran before them), the file; all then."""
    inside = site.file.removeprefix("slipctl/")
    enters = [t for t, e in tests.items() if f"{inside}:{site.function}" in e["entered"]]
    reads = [t for t, e in tests.items() if any(f"{inside}:" in k for k in e["entered"])]
    known = set(enters)
    return [*sorted(enters, key=lambda t: tests[t]["seconds"]),
            *sorted((t for t in reads if t not in known), key=lambda t: tests[t]["seconds"])] or [
            *sorted(tests, key=lambda t: tests[t]["seconds"])]  # fmt: skip


def judged(tree: Tree, site: Site, tests: dict[str, Any]) -> dict[str, Any]:
    """How a change ends: the test that notices it, or that none does."""
    target = tree.root / site.file
    text = target.read_text(encoding="utf-8")
    names = asked(site, tests)
    told = {"kind": site.kind, "line": site.line, "tests": len(names)}
    try:
        target.write_text(site.applied(text), encoding="utf-8")
        for part in (names[:FIRST], names[FIRST:]):
            if not part:
                continue
            listed = tree.root / "asked.txt"
            listed.write_text("\n".join(part), encoding="utf-8")
            limit = 120 + 10 * sum(tests[t]["seconds"] for t in part)
            code, said = tree.pytest(["-x", "--tb=no", f"@{listed}"], limit)
            if code is None:
                return told | {"caught": "takes too long"}
            if code:
                failed = [k for k in said.splitlines() if k.startswith(("FAILED", "ERROR"))]
                return told | {"caught": failed[0][:160] if failed else said.strip()[-160:]}
    finally:
        target.write_text(text, encoding="utf-8")
    return told | {"caught": None}


def drawn(number: int, seed: int, rooms: list[str]) -> list[tuple[str, Site]]:
    """So many changes of the rooms, each as likely as every other."""
    every = [(room, site) for room in rooms for path in sorted((ROOT / room).rglob("*.py"))
             for site in sites(path.relative_to(ROOT).as_posix(),
                               path.read_text(encoding="utf-8"))]  # fmt: skip
    return random.Random(seed).sample(every, min(number, len(every)))


def summary(found: dict[str, Any]) -> dict[str, Any]:
    """Score and survivors, each with the argument why it changes nothing, where there is one."""
    reasons = tomllib.loads((Path(__file__).parent / "equivalent.toml").read_text("utf-8"))
    lived = {n: reasons.get(n, "") for n, r in found.items() if not r["caught"]}
    caught = len(found) - len(lived)
    return {
        "mutations": len(found), "caught": caught, "score": round(caught / max(1, len(found)), 4),
        "argued": {n: why for n, why in lived.items() if why},
        "open": [n for n, why in lived.items() if not why],
    }  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--mutations", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--room", nargs="+", choices=ROOMS, default=list(ROOMS))
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--match", default="", help="only changes whose name has this text")
    parser.add_argument("--out", type=Path, default=Path("mutations.json"))
    chosen = parser.parse_args()

    wanted = drawn(10**9 if chosen.match else chosen.mutations, chosen.seed, chosen.room)
    wanted = [w for w in wanted if chosen.match in w[1].name]
    kept = json.loads(chosen.out.read_text("utf-8")) if chosen.out.exists() else {}
    found: dict[str, Any] = kept.get("found", {})
    tests: dict[str, Any] = kept.get("tests", {})
    todo = [w for w in wanted if w[1].name not in found]
    lock = threading.Lock()

    def keep() -> None:
        names = {w[1].name for w in wanted}
        told = summary({n: r for n, r in found.items() if n in names})
        text = json.dumps({"summary": told, "found": found, "tests": tests}, indent=1)
        part = chosen.out.with_suffix(".part")
        part.write_text(text, encoding="utf-8")
        part.replace(chosen.out)

    with tempfile.TemporaryDirectory(prefix="mutation") as scratch:
        cache = Path(scratch, "cache")
        trees = [Tree(Path(scratch, str(k)), cache) for k in range(chosen.jobs)]
        for room in dict.fromkeys(w[0] for w in todo):
            if room not in tests:
                print(f"{room}: which test enters what", flush=True)
                tests[room] = trees[0].entered(room, 7200)
                keep()
        free = list(trees)

        def do(tests: dict[str, Any], item: tuple[str, Site]) -> None:
            room, site = item
            with lock:
                tree = free.pop()
            result = judged(tree, site, tests[room])
            with lock:
                free.append(tree)
                found[site.name] = result
                keep()
                print(f"{result['caught'] or 'SURVIVES'}\n    {site.name}"[:300], flush=True)

        with ThreadPoolExecutor(chosen.jobs) as pool:
            list(pool.map(partial(do, tests), todo))
    keep()
    print(json.dumps(json.loads(chosen.out.read_text("utf-8"))["summary"], indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
