"""Certificates of tuned loops against disturbances: python tests/design/attacked.py --out FILE.

By hand before an issue is closed. Loops are tuned, and each promise that their certificate holds is
attacked twice: by the policies of ``tests/certify/adversary``, from random starts, and by a search
for the worst disturbance. Neither shares code with the criteria. Exits with 1 if a promise breaks.
"""

from __future__ import annotations

import argparse
import contextlib
import datetime
import json
import sys
import tempfile
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "certify"))
sys.path.append(str(Path(__file__).parents[2]))

from adversary import common, hunt

from bench import speed
from slipctl.commands.cli import main as slipctl
from slipctl.run import store

LINES = (
    "subway_braking:sta@base --free k1=1:60 k2=1:60 --minimise distance",
    "subway_braking:sta@base --free k1=1:60 k2=1:60 --minimise torque_ripple",
    "subway_braking:sta@base --free k1=1:60 k2=1:60 --minimise torque_ripple"
    " --subject-to margin>=1.2",
    "hst_braking:eppfc --free K1=20:300 eta_0=.05:.2 eta_inf=.002:.02 k=5:60 delta_l=.8:1.5"
    " delta_u=.8:1.5 --minimise distance",
    "hst_braking:eppfc --free K1=20:300 eta_inf=.002:.02 --minimise torque_ripple",
    "freight_traction:improved_corrected@base --free ctl.seek.k=.5:2 rho=.05:.2"
    " --minimise distance --samples 4 --runs 40 --held-out 20 --ensemble loads.toml",
    "metro.toml:super_twisting --free k1=5:60 k2=1:60 --minimise distance --samples 8 --runs 60"
    " --held-out 20",
)
"""What is tuned, as a person writes it, after ``slipctl new metro``."""
LOADS = '[draw]\nm = "5000t:6500t"\n'
AT_ONCE = 500
"""Copies of a case in a call; each meets as many disturbances as the adversary has."""


def promises(certificate: Path) -> Iterator[tuple[str, str, dict[str, float]]]:
    """Name, system and numbers of each promise that holds."""
    for exact in json.loads(certificate.read_text(encoding="utf-8"))["exact"]:
        its = exact["certificate"]
        if its["verdict"] == "CERTIFIED":
            asked = {k: float(Fraction(v["value"])) for k, v in its["asked"].items()}
            asked = {k: v for k, v in asked.items() if v or k == "W"}
            times = "" if float(exact["bounds_times"]) == 1 else f", bounds {exact['bounds_times']}"
            yield exact["name"] + times, its["system"], asked


def attack(system: str, numbers: dict[str, float], copies: int, runs: int, seed: int) -> Any:
    """What came of so many copies against all policies, and of a search of so many runs."""
    adversary, rng = common.adversaries()[system], np.random.default_rng(seed)
    numbers = dict.fromkeys(adversary.draw(np.random.default_rng(0), 1), np.nan) | numbers
    broken = 0
    for at in range(0, copies, AT_ONCE):
        many = min(AT_ONCE, copies - at)
        tiled = {k: np.full(many, v) for k, v in numbers.items()}
        broken += int(np.count_nonzero(adversary.leaves(tiled, rng, 4)))
    told: dict[str, Any] = {"system": system, "copies": copies, "broken": broken}
    if system in hunt.SHARES:
        told |= {"searched": runs, "worst": hunt.worst(system, numbers, runs, seed)}
    return told


def main() -> int:
    """Tune, attack, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--copies", type=int, default=10_000, help="each against all policies")
    parser.add_argument("--runs", type=int, default=10_000, help="of the search")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    target = options.out and options.out.resolve()
    numbers: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        Path("loads.toml").write_text(LOADS, encoding="utf-8")
        slipctl(["new", "metro", "--quiet"])
        for i, line in enumerate(LINES):
            out = Path(str(i))
            if slipctl(["tune", *line.split(), "--out", str(out), "--quiet"]):
                return 1
            found = {}
            for name, system, asked in promises(out / "certificate.json"):
                found[name] = attack(system, asked, options.copies, options.runs, options.seed)
                print(line, name, found[name], flush=True)
            numbers[f"slipctl tune {line}"] = found
    if target:
        told = {"format": 1, "command": "python tests/design/attacked.py",
                "date": datetime.date.today().isoformat(), "versions": speed.machine(),
                "numbers": numbers}  # fmt: skip
        store.write_json(target, told)
    bad = [p for found in numbers.values() for p in found.values()
           if p["broken"] or p.get("worst", 0) >= 1]  # fmt: skip
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
