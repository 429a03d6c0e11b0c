"""CPU time of every kind of verdict, and of its check: python tests/certify/costs.py --out FILE.

The cases are those of the adversaries, which lie where verdicts are hard. Each is asked as a
command does, margins and values included, then written out and checked. They are grouped by what
the promise has to withstand and to reach. Exits with 1 if one takes longer than ``LIMIT``. In the
file of --out systems that are not run keep what they had.
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import sys
from fractions import Fraction
from pathlib import Path
from statistics import median
from time import process_time
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parent))
sys.path.append(str(Path(__file__).parents[2]))

from adversary import common

LIMIT = 2.0
"""Most CPU time of a verdict and of a check, in s."""


def asked(system: Any, numbers: dict[str, Fraction]) -> str:
    """Inputs and targets that are told and not zero."""
    kinds = ("input", "target")
    return " ".join(k for k, n in system.numbers.items() if n.role in kinds and numbers.get(k))


def measured(name: str, cases: int, seed: int) -> dict[str, dict[str, Any]]:
    """Times of a system's verdicts, by what is asked."""
    from slipctl.certify import certificate, proofs
    from slipctl.certify.catalogue import system
    from slipctl.certify.systems import report

    own = system(name)
    groups: dict[str, list[tuple[float, float, str, str]]] = {}
    found = common.cases(common.adversaries()[name], cases, seed)
    for numbers in common.singles(found):
        told = proofs.exact_numbers(own, {k: Fraction(f"{v:.10g}") for k, v in numbers.items()})
        start = process_time()
        answer = report(own, told)
        verdict = process_time() - start
        payload = proofs.certificate_entries(own, told, answer.decision)
        start = process_time()
        certificate.check(payload)
        check = process_time() - start
        entry = (verdict, check, answer.verdict, common.as_set(numbers))
        groups.setdefault(asked(own, told), []).append(entry)
    return {
        what: {
            "cases": len(entries),
            "median": round(median(e[0] for e in entries), 3),
            "worst": round(max(e[0] for e in entries), 3),
            "worst_check": round(max(e[1] for e in entries), 3),
            "worst_case": max(entries)[3],
        }
        for what, entries in sorted(groups.items())
    }


def main() -> int:
    """Run what is asked for."""
    known = list(common.adversaries())
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("systems", nargs="*", default=known, metavar="SYSTEM")
    parser.add_argument("--cases", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    kept: dict[str, Any] = {}
    if options.out and options.out.exists():  # systems that are not run keep what they had
        kept = json.loads(options.out.read_text(encoding="utf-8"))
    numbers: dict[str, Any] = kept.get("numbers", {})
    for name in options.systems or known:
        numbers[name] = measured(name, options.cases, options.seed)
        for what, found in numbers[name].items():
            print(f"{name} [{what}]: {found['cases']} cases, {found['median']} s, at most"
                  f" {found['worst']} s, check {found['worst_check']} s", flush=True)  # fmt: skip
            if max(found["worst"], found["worst_check"]) > LIMIT:
                print(f"  too long: {found['worst_case']}", flush=True)
    if options.out:
        from bench import speed
        from slipctl.run import store

        command = f"python tests/certify/costs.py --cases {options.cases} --seed {options.seed}"
        store.write_json(options.out, kept | {
            "format": 1, "command": command, "date": datetime.date.today().isoformat(),
            "versions": speed.machine(), "numbers": dict(sorted(numbers.items())),
        })  # fmt: skip
    every = [g for groups in numbers.values() for g in groups.values()]
    return 1 if max(max(g["worst"], g["worst_check"]) for g in every) > LIMIT else 0


if __name__ == "__main__":
    sys.exit(main())
