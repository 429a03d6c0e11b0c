"""Verdicts now against those of an older commit: python tests/certify/paces.py --out FILE.

Both are asked the same questions, the panels of the systems, which tell no argument that the older
one does not know. Each runs in a process of its own, in turn, ``ROUNDS`` times; after a first round
of other numbers, so that nothing is loaded or remembered, each verdict is asked once. Of the rounds
the least CPU time counts. The ratio of a system is that of the sums over its panel.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path
from typing import Any

BEFORE = "3fc3fbf"
"""Last commit before verdicts had to cover all that was asked."""

OTHERS: list[tuple[str, dict[str, float]]] = [
    ("rls", {"forgetting": 0.98, "least": 0.2, "samples": 50, "idle": 20}),
    ("filter", {"gamma": 0.02, "R": 1e-4, "H": 0.007, "share": 0.05, "time": 0.4}),
    ("filter", {"gamma": 0.02, "R": 1e-4, "H": 0.007, "q": 2e6}),
]
"""Of systems that have no panel."""

ROUNDS = 7
ROOT = Path(__file__).parents[2]

ASKED = """
import json, sys
from time import process_time
from slipctl.certify.catalogue import SYSTEMS, system
from slipctl.certify.systems import report

questions, found = json.load(sys.stdin), []
for factor in (1.01, 1):
    found = []
    for name, numbers in questions:
        told = {k: v * factor if v else v for k, v in numbers.items()}
        start = process_time()
        try:
            report(system(name), told)
            found.append(process_time() - start)
        except Exception as error:
            found.append(str(error))
json.dump(found, sys.stdout)
"""


def questions() -> list[tuple[str, dict[str, float]]]:
    """Panels of all systems that both know."""
    from slipctl.certify.catalogue import SYSTEMS, system

    panels = [(name, dict(numbers)) for name in SYSTEMS for numbers in system(name).panel]
    return panels + OTHERS


def times(tree: Path, asked: list[Any]) -> list[Any]:
    """CPU time of each verdict in s, or why there is none."""
    env = {**os.environ, "PYTHONPATH": str(tree), "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run([sys.executable, "-c", ASKED], input=json.dumps(asked), text=True,
                          capture_output=True, check=True, env=env, cwd=tree)  # fmt: skip
    found: list[Any] = json.loads(done.stdout)
    return found


def unpacked(commit: str, folder: Path) -> Path:
    """Package as it was at a commit."""
    packed = subprocess.run(["git", "archive", commit, "slipctl"], cwd=ROOT, check=True,
                            capture_output=True).stdout  # fmt: skip
    with tarfile.open(fileobj=io.BytesIO(packed)) as archive:
        archive.extractall(folder, filter="data")
    return folder


def compared(commit: str) -> dict[str, dict[str, Any]]:
    """Sums over each panel in s, before and now, and their ratio."""
    asked = questions()
    with tempfile.TemporaryDirectory() as folder:
        before = unpacked(commit, Path(folder))
        rounds = [(times(before, asked), times(ROOT, asked)) for _ in range(ROUNDS)]
    found: dict[str, dict[str, Any]] = {}
    for i, (name, numbers) in enumerate(asked):
        pairs = [(old[i], new[i]) for old, new in rounds]
        if any(isinstance(x, str) for pair in pairs for x in pair):
            print(f"{name} {numbers}: left out, {pairs[0]}", file=sys.stderr)
            continue
        entry = found.setdefault(name, {"verdicts": 0, "before": 0.0, "now": 0.0})
        entry["verdicts"] += 1
        entry["before"] += min(old for old, _ in pairs)
        entry["now"] += min(new for _, new in pairs)
    for entry in found.values():
        entry["ratio"] = round(entry["now"] / entry["before"], 2)
        entry["before"], entry["now"] = round(entry["before"], 4), round(entry["now"], 4)
    return found


def main() -> int:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--before", default=BEFORE)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    found = compared(options.before)
    for name, entry in found.items():
        print(f"{name}: {entry['verdicts']} verdicts, {entry['before']} s before, {entry['now']} s"
              f" now, {entry['ratio']} times", flush=True)  # fmt: skip
    if options.out:
        from slipctl.run import store

        whole = json.loads(options.out.read_text(encoding="utf-8"))
        command = f"python tests/certify/paces.py --before {options.before}"
        whole["paces"] = {"command": command, "numbers": found}
        store.write_json(options.out, whole)
    return 0


if __name__ == "__main__":
    sys.exit(main())
