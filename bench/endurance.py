"""Very many steps of the representative loops in C: ``python -m bench.endurance``.

The whole loop, plant, sensors with their noise and controller, is written as one C module and runs
for as many ticks as asked. Is the state bounded, does a covariance drift? The windowed estimator
also runs alone on the noise of one operating point, where nothing excites it.
"""

from __future__ import annotations

import argparse
import math
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from casadi import cos, if_else, sin

from bench.loops import long_run
from slipctl import Output, Param, State, connect, step
from slipctl.ccode import codegen
from slipctl.ccode.module.header import bit
from slipctl.ccode.module.plan import Plan
from slipctl.run import store
from slipctl.studies.hst_traction.loops import H
from slipctl.study import resolve


@step(
    x_d=Output("m", "target position"), v_d=Output("m/s", "target speed"),
    a_d=Output("m/s^2", "target acceleration", positive="traction"), period=H, name="course",
)  # fmt: skip
def course(
    x=State("m", 0.0, "target position"),
    phase=State("rad", 0.0, "of the way from stop to stop"),
    top=Param("m/s", 30.0, "largest speed"),
    w=Param("rad/s", 2 * math.pi / 200, "from stop to stop"),
    T=Param("s", H, "sample period"),
):
    """Target of a train that goes from stop to stop: v_d = top (1 - cos wt)/2."""
    v, following = top * (1 - cos(phase)) / 2, phase + T * w
    around = if_else(following >= 2 * math.pi, following - 2 * math.pi, following)
    return dict(x=x + T * v, phase=around), dict(x_d=x, v_d=v, a_d=top * w * sin(phase) / 2)


class Subject(NamedTuple):
    """What runs.

    Attributes:
        loop: ``study:loop@scenario``.
        part: a part of the loop alone, on ``held`` inputs; empty: the loop itself.
        held: input and its noise by name, for a part.
        driven: by ``course``, in place of the target of the scenario.
        share: of the ticks asked for; a search by differential evolution is a hundred times slower.
        explained: why signals grow, by the end of their names.
    """

    loop: str
    part: str = ""
    held: Mapping[str, tuple[float, float]] = {}
    driven: bool = False
    share: float = 1.0
    explained: Mapping[str, str] = {}


MOVES = {
    "plant.wheel.x": "the train moves on", "plant.train.x": "the train moves on",
    "plant.wheel.phi": "the wheel turns on", "tooth.age": "time since the last tooth",
    "tooth.q": "the wheel turns on", "tooth.edge": "the wheel turns on",
}  # fmt: skip

SUBJECTS = {
    "subway_braking": Subject("subway_braking:sta@real", explained=MOVES),
    "subway_braking_search": Subject("subway_braking:sta_online@real", share=0.01, explained=MOVES),
    "subway_braking_estimator": Subject(
        "subway_braking:sta_online@real", "ctl.estimator",
        {"mu": (0.286, 0.01), "v_s": (1.21, 0.02)},
        explained={
            "Lambda": "information on a rail that stays the same; nothing is forgotten",
        },
    ),
    "hst_braking": Subject("hst_braking:eppfc_gradient@noise", explained=MOVES | {
        "law.count": "counts", "law.restarts": "counts", "slope.age": "age of the last change",
    }),
    "hst_traction": Subject("hst_traction:hosm_limited@real", driven=True, explained=MOVES | {
        "course.x": "the train moves on", "course.x_d": "the train moves on",
    }),
    "freight_traction": Subject("freight_traction:improved_robust@real", explained=MOVES),
}  # fmt: skip
"""What runs, by name; at least one loop per paper."""


_VARIANCE = re.compile(r"\b(P|P_\w+)(\[\d+\])?$")
"""States that are variances and covariances."""


def run(subject: Subject, ticks: int) -> dict[str, Any]:
    """Run one subject and say what grows.

    Args:
        subject: what runs.
        ticks: how many; the subject's share of it.

    Returns:
        ``ticks``, ``seconds_per_step``, ``status``, ``finite``, ``largest`` (absolute value of a
        state) and ``growing``: range in the second and the last tenth of the run of each signal
        that grew, and ``why`` it may; ``covariance``: mean of each variance in the same tenths.
    """
    study, _, name = subject.loop.partition(":")
    loop, case = resolve.find_loop(resolve.load_study(study), name)
    if subject.driven:
        wires = {f"train.{n}": f"course.{n}" for n in course.outputs}
        loop = connect("loop", wires, course=course, train=loop)
    block = loop[subject.part] if subject.part else loop
    plan = Plan(block, "endurance", loop.period)
    given = {n: float(v) for n, v in case.scenario.rail.sections[0].values.items()}
    given |= {n: float(v) for n, v in case.scenario.inputs.items() if n in block.inputs}
    row, sigma = [], []
    for m in plan.layout.inputs:
        held = subject.held.get(m.name, (given.get(m.name, m.signal.value or 0.0), 0.0))
        row += [held[0]] * m.size
        sigma += [1.0 if m.signal.noise else held[1]] * m.size
    params = {n: v for n, v in case.scenario.params.items() if n in block.params}
    made = codegen.texts(plan)
    found = long_run.endured(
        plan, made, np.array([row], dtype=float), np.array(sigma), params,
        int(ticks * subject.share),
    )  # fmt: skip
    growing = {}
    for n in long_run.drifting(found):
        s = found["signals"][n]
        why = next((w for end, w in subject.explained.items() if end in n), "")
        growing[n] = {
            "second": [s["low"][1], s["high"][1]], "last": [s["low"][-1], s["high"][-1]],
            "why": why,
        }  # fmt: skip
    covariance = {
        n: [s["mean"][1], s["mean"][-1]] for n, s in found["signals"].items()
        if n.startswith("state") and _VARIANCE.search(n)
    }  # fmt: skip
    values = np.array([[s["low"], s["high"]] for s in found["signals"].values()])
    return {
        "loop": subject.loop, "part": subject.part, "ticks": found["ticks"],
        "seconds_per_step": found["seconds_per_step"], "status": found["status"],
        "finite": bool(np.isfinite(values).all()), "largest": float(np.abs(values).max()),
        "growing": growing, "covariance": covariance,
    }  # fmt: skip


def main(words: list[str] | None = None) -> int:
    """Run the subjects named, or all, and write ``endurance.json``."""
    from bench import speed

    parser = argparse.ArgumentParser(prog="python -m bench.endurance", description=__doc__)
    parser.add_argument("name", nargs="*", help=f"of {', '.join(SUBJECTS)}; all by default")
    parser.add_argument("--ticks", type=float, default=1e8, help="ticks of each, 1e8 by default")
    parser.add_argument("--out", default="endurance.json", help="file to write")
    chosen = parser.parse_args(words)
    for name in chosen.name:
        if name not in SUBJECTS:
            print(f"slipctl: no subject {name!r}; it has {', '.join(SUBJECTS)}", file=sys.stderr)
            return 2
    results: dict[str, Any] = {}
    bad = False
    for name in chosen.name or SUBJECTS:
        print(f"{name} ...", file=sys.stderr, flush=True)
        results[name] = found = run(SUBJECTS[name], int(chosen.ticks))
        drift = [n for n, g in found["growing"].items() if not g["why"]]
        refused = sum(c for k, c in found["status"].items() if int(k) & ~bit("LIMITED"))
        bad = bad or bool(drift or refused) or not found["finite"]
        print(
            f"{name}: {found['ticks']} ticks, {1e6 * found['seconds_per_step']:.3g} us each,"
            f" largest {found['largest']:.3g}, {refused} refused,"
            f" drifting: {', '.join(drift) or 'nothing'}",
            flush=True,
        )  # fmt: skip
        store.write_json(
            Path(chosen.out), {"format": 1, "machine": speed.machine(), "results": results}
        )
    return int(bad)


if __name__ == "__main__":
    sys.exit(main())
