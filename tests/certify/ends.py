"""How large sample time and lag may be: python tests/certify/ends.py --out FILE.

Every certificate of the studies and of the shipped vehicle file whose system takes a sample time:
the largest sample time and lag that are proved, and the smallest that a run refutes, all other
numbers those of the loop. Both certificates are written out and checked as a stranger would.
"""

from __future__ import annotations

import argparse
import datetime
import sys
from collections.abc import Iterator, Mapping
from fractions import Fraction
from importlib.resources import files
from pathlib import Path
from time import process_time
from typing import Any

sys.path.append(str(Path(__file__).parents[2]))

from bench import speed
from slipctl.certify import catalogue, certificate, proofs
from slipctl.certify.boundary import Farthest, farthest
from slipctl.certify.systems import System, exact_numbers
from slipctl.design.gain_points import replaced_numbers
from slipctl.run import store
from slipctl.study.resolve import find_loop, load_study

STUDIES = ("subway_braking", "hst_braking", "hst_traction", "freight_traction")
ENDS = ("T", "lag")


def asked(names: tuple[str, ...] = STUDIES) -> Iterator[tuple[str, System, Mapping[str, float]]]:
    """Name, system and numbers of each certificate that takes a sample time."""
    for name in (*names, str(files("slipctl.models.vehicle") / "files" / "metro.toml")):
        study = load_study(name)
        for gains in study.certificates.gains:
            loop = find_loop(study, gains.loop)[0]
            own = catalogue.system_of_gains(gains, loop)
            if "T" in own.numbers:
                numbers = gains.numbers(loop)
                yield f"{study.name}:{gains.name}", own, {
                    k: float(v) for k, v in numbers.items()
                }  # fmt: skip


def end(own: System, numbers: Mapping[str, float], of: str) -> Farthest:
    """How far a number may go; the certificates of both sides hold."""
    found = farthest(replaced_numbers(own, numbers), of)
    for side in ("certified", "refuted"):
        value = getattr(found, side)
        if value is not None:
            told = exact_numbers(own, {**numbers, of: Fraction(str(value))})
            payload = proofs.write(own, told)
            assert payload["verdict"] == side.upper(), (own.name, of, value, payload["verdict"])
            certificate.check(payload)
    return found


def main() -> int:
    """Look for all ends."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    numbers: dict[str, Any] = {}
    for name, system, told in asked():
        for of in ENDS:
            built_in = of == "T" and system.name == "axle_loop"  # the sample time of its block
            if of not in system.numbers or built_in:
                continue
            start = process_time()
            found = end(system, told, of)
            entry = {
                "certified": found.certified,
                "refuted": found.refuted,
                "tried": len(found.tried),
                "seconds": round(process_time() - start, 2),
            }
            now = {k: told.get(k, 0.0) for k in ENDS}
            own = numbers.setdefault(name, {"system": system.name, "now": now, "ends": {}})
            own["ends"][of] = entry
            print(name, of, entry, flush=True)
    if options.out:
        store.write_json(options.out, {
            "format": 1, "command": "python tests/certify/ends.py", "versions": speed.machine(),
            "date": datetime.date.today().isoformat(), "numbers": numbers,
        })  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
