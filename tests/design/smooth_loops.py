"""Which loops have exact slopes: python tests/design/smooth_loops.py --out FILE.

Each loop of the studies in its first scenario: slopes of its metrics by the numbers of its law, and
how far they are from central differences along a random direction; or why there are none.
"""

from __future__ import annotations

import argparse
import datetime
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

sys.path.append(str(Path(__file__).parents[2]))

from bench import speed
from slipctl.design.slopes.gradients import AGREES, SMOOTH, Slopes, slope_error
from slipctl.errors import BadInput, RunFailed
from slipctl.run import store
from slipctl.run.sweep.ensemble import Ensemble, World
from slipctl.study.resolve import build_cases, load_study

STUDIES = ("subway_braking", "hst_braking", "hst_traction", "freight_traction")
MOST = 4
"""Numbers of a law that are free at once."""


def own(loop: Any, controller: str) -> list[str]:
    """First numbers of a loop's law, else of its controller."""
    values = loop.values_by_place()
    for head in (f"{controller}.law.", f"{controller}."):
        plain = [n for n, s in loop.params.items() if not s.derived and not s.shape]
        found = [n for n in plain if n.startswith(head) and values[n] != 0]
        if found:
            return found[:MOST]
    return []


def answer(study: Any, case: Any, loop: Any) -> dict[str, Any]:
    """Difference by metric, or the reason why there is none."""
    names = own(loop, study.controller)
    if not names:
        return {"why": "its controller has no number"}
    now = {n: float(np.asarray(loop.values_by_place()[n])) for n in names}
    ensemble = Ensemble({names[0]: f"{0.9 * now[names[0]]!r}:{1.1 * now[names[0]]!r}"})
    try:
        world = World(loop, case.scenario, ensemble, signals=study.signals, known=case.known,
                      free=names)  # fmt: skip
        draw = world.draw(0, 0)
        there = [m for m in world.metrics(now, draw) if m in SMOOTH]
        slopes = Slopes(world, names).of(now, draw, there)
    except (BadInput, RunFailed) as error:
        return {"why": str(error)}

    def value(metric: str) -> Any:
        def at(numbers: np.ndarray) -> float:
            given = dict(zip(names, map(float, numbers), strict=True))
            return float(world.metrics(given, draw)[metric].value)

        return at

    at = np.array(list(now.values()))
    found = {m: slope_error(value(m), at, s) for m, s in slopes.items()}
    if not max(found.values(), default=0.0) <= AGREES:
        return {"why": "differences disagree", "numbers": names, "apart": found}
    return {"numbers": names, "apart": found}


def answers(wanted: str = "") -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Each loop with its answer."""
    for name in STUDIES:
        study = load_study(name)
        case = build_cases(study)[0]
        for n, loop in case.loops.items():
            if wanted in f"{name}:{n}":
                yield f"{name}:{n}", answer(study, case, loop)


def main() -> None:
    """Write what came out."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path)
    parser.add_argument("--only", default="", help="loops with this in their name")
    options = parser.parse_args()
    found = {}
    for name, said in answers(options.only):
        found[name] = said
        print(name, said, flush=True)
        if options.out:
            store.write_json(options.out, {
                "format": 1, "command": "python tests/design/smooth_loops.py",
                "date": datetime.date.today().isoformat(), "versions": speed.machine(),
                "numbers": {"gradients": found},
            })  # fmt: skip


if __name__ == "__main__":
    main()
