"""One setting against the same loop built without any share, each place set by a table of names.

The loops by hand are made by the studies too, but with sharing switched off; each place is then
set by a table of names that knows nothing of shares. ``python tests/one_setting.py --out FILE``
takes every setting of every loop over whole runs, on all cores; what FILE has of the same source is
not run again.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from slipctl import BadInput, Block, Case, RunFailed, Scenario, prepare
from slipctl.block import connection
from slipctl.block.transforms import ranges
from slipctl.models import ranges as models_ranges
from slipctl.models.cheng_2022 import freight_traction_control
from slipctl.models.wheel_rail.contact import WHEEL_LOAD, patch
from slipctl.models.zhang_2021 import hst_braking_control
from slipctl.run import store
from slipctl.study import resolve
from slipctl.study.cache import key_of

STUDIES = ("subway_braking", "hst_braking", "freight_traction", "hst_traction", "all_rails")
SPEED = {"freight": "train.v_t", "hst_traction": "train.v"}
SETTINGS = [("speed", 0.3), ("speed", 0.7), ("speed", 1.3)] + [
    (what, f) for what in ("m", "r", "J") for f in (0.8, 1.2)
]
SCALING_MASS = ("law.scale.m", "law.torque.m", "law.law.m")
"""Mass of a law that drives another vehicle: a scale of its own, no vehicle has it."""


@contextmanager
def without_shares() -> Iterator[None]:
    """Connections that ignore ``share``, also when a block is built again with other values."""
    kept = connection.bind
    connection.bind = lambda *_: {}
    ranging: tuple[Any, ...] = (hst_braking_control, freight_traction_control, models_ranges)
    for module in ranging:  # ends that follow a shared number; what rolls does not look at them
        module.ranged = lambda block, **_: block
    try:
        yield
    finally:
        connection.bind = kept
        for module in ranging:
            module.ranged = ranges.ranged


def forget() -> None:
    """Drop the parts that loops have in common: those with shares and those without differ."""
    for name in ("hst_braking", "subway_braking", "freight_traction", "hst_traction"):
        made = __import__(f"slipctl.studies.{name}.loops", fromlist=["x"])
        for f in vars(made).values():
            getattr(f, "cache_clear", lambda: None)()


@cache
def cases(study: str, shared: bool) -> list[Case]:
    with nullcontext() if shared else without_shares():
        if not shared:
            forget()
        if study == "all_rails" and not shared:  # its scenarios speak of shared numbers
            made = __import__("slipctl.studies.all_rails.loops", fromlist=["x"])
            return [replace(c, loops=made.loops(c.scenario.name.partition("_")[0]))
                    for c in cases(study, True)]  # fmt: skip
        found = resolve.build_cases(resolve.load_study(study), quick=True)
        # a scenario with a difference on purpose, or a lag set by its shared name
        return [c for c in found if not c.scenario.name.startswith(("demand", "lag50"))]


def loops(study: str) -> list[tuple[str, int, str]]:
    """Every loop once: those of the scenarios without sensors, then those with."""
    found: dict[tuple[str, str], tuple[str, int, str]] = {}
    for k, case in enumerate(cases(study, True)):
        sensors = case.scenario.name in ("real", "estimated", "noise")
        world = case.scenario.name.partition("_")[0] if study == "all_rails" else ""
        for n in case.loops:
            found.setdefault((n, f"{sensors}{world}{case.scenario.name == 'position'}"),
                             (study, k, n))  # fmt: skip
    return list(found.values())


def by_hand(
    block: Block, study: str, scenario: str, what: str, value: float
) -> dict[str, float | np.ndarray]:
    """Numbers of a block without shares, each place set to ``value`` times what it was."""
    freight = study == "freight_traction" or scenario.startswith("freight")
    numbers = block.values_by_place()
    new: dict[str, float | np.ndarray] = {}
    names = {"m": {"m", "m_axle", "Q"} - ({"m_axle"} if freight else set())}.get(what, {what})
    for n, v in numbers.items():
        if n.rpartition(".")[2] in names and block.params[n].unit in ("kg", "kg m^2", "m", "N"):
            if n in SCALING_MASS and ("law.scale.m" in numbers or freight):
                continue
            new[n] = v * value
    fits = of_its_wheel(study, what, value)
    for n in numbers:
        if n.rpartition(".")[2] in fits and n.split(".")[-2] in ("adh", "curves"):
            new[n] = fits[n.rpartition(".")[2]]
    start = {k: float(np.ravel(v)[0]) for k, v in block.start().items() if np.size(v)}
    speed = next(k for k in start if k.endswith((".wheel.v", ".train.v", ".train.v_t")))
    v = start[speed] or (30.0 if study == "hst_traction" else 0.0)
    v *= value if what == "speed" else 1.0
    new[speed] = v
    plant = speed.rpartition(".")[0]
    if f"{plant}.r" not in numbers:
        return new
    omega = v / float(np.ravel(new.get(f"{plant}.r", numbers[f"{plant}.r"]))[0])
    for n in [*block.params, *block.states]:
        last = n.rpartition(".")[2]
        if last == "omega_start":
            new[n] = omega
        elif last == "v_h":
            new[n] = v
        elif n.endswith("observer.omega_m"):
            new[n] = v * float(numbers[f"{plant}.R_g"]) / (v / omega)
    return new


def of_its_wheel(study: str, what: str, factor: float) -> dict[str, float]:
    """Contact patch of another wheel, without which Polach's law refuses its load or radius."""
    if study != "hst_traction" or what not in ("m", "r"):
        return {}
    load, radius = (factor, 1.0) if what == "m" else (1.0, factor)
    found = patch(WHEEL_LOAD * load, 0.445 * radius)
    return {n: found[n] for n in ("a", "b", "c11")}


def told(
    loop: Block, study: str, scenario: str, what: str, factor: float
) -> dict[str, float | np.ndarray] | None:
    """The one setting, by its short name; None where the loop has no such number."""
    freight = study == "freight_traction" or scenario.startswith("freight")
    place = SPEED.get("freight" if freight else study, "wheel.v")
    if what == "speed":
        full = next(n for n in loop.states if n.endswith("." + place))
        return {place: (float(np.ravel(loop.start()[full])[0]) or 30.0) * factor}
    if what not in loop.params:
        return None  # a bound without wheels
    start = {place: 30.0} if study == "hst_traction" else {}
    fits = of_its_wheel(study, what, factor)
    return {what: loop.param_values()[what] * factor, **fits, **start}


def compare(
    study: str, k: int, name: str, settings: Sequence[tuple[str, float]], whole: bool
) -> list[str]:
    """What one setting gives against every place set by hand: "", or where they differ.

    Args:
        study, k, name: the study, its case and the loop.
        settings: what is set, and to how many times what it was.
        whole: the whole run, else 0.2 s.

    Returns:
        Of each setting "equal", "refused", "none" (the loop has no such number), "equal but
        for roundings" and where they matter, or the fault.
    """
    case, bare = cases(study, True)[k], cases(study, False)[k]
    loop, scenario = case.loops[name], case.scenario
    with without_shares():  # a loop is made when it is asked for
        forget()
        hand = bare.loops[name]
        forget()
    known = {s.name for s in loop.signals if s.role != "param"}
    log = [n for n in case.log if n in known] if case.log else None
    solver = sorted(n for n in known if n.endswith((".nmpc.status", ".nmpc.passes")))
    if log is not None and whole:
        log += [n for n in solver if n not in log]
    length = scenario.duration if whole else 0.2
    run = Scenario("s", length, scenario.rail, scenario.inputs, seed=scenario.seed)
    shared = prepare(loop, run, compile=whole, log=log)
    with without_shares():
        separate = prepare(hand, run, compile=whole, log=log)
    found = []
    for what, factor in settings:
        one = told(loop, study, scenario.name, what, factor)
        if one is None:
            found.append("none")
            continue
        places = by_hand(hand, study, scenario.name, what, factor)

        def rolled(beside: float, places: Any = places) -> Mapping[str, np.ndarray]:
            with without_shares():
                return separate({n: v * (1 + beside) for n, v in places.items()})

        outcomes: list[Mapping[str, np.ndarray] | str] = []
        for roll in (lambda one=one: shared(one), lambda: rolled(0.0)):
            try:
                outcomes.append(roll())
            except (BadInput, RunFailed) as error:
                outcomes.append(str(error))
        # equal numbers meet in another order of operations: roundings, far below a wrong number
        judged = _judged(*outcomes, solver)
        if "differs by" in judged:
            judged = _judged(*outcomes, solver, _rounded(outcomes[1], rolled))
        found.append(judged)
    return found


def _rounded(log: Any, rolled: Callable[[float], Mapping[str, np.ndarray]]) -> dict[str, Any]:
    """How far each signal has gone, up to each row, when the numbers by hand are off by roundings.

    An estimator that takes or leaves a step by the sign of a difference of roundings goes another
    way then, and what it does says nothing of the places.
    """
    far = {n: np.zeros(len(v)) for n, v in log.items()}
    for places in range(46, 53):
        for sign in (-1, 1):
            for n, v in rolled(sign * 2.0**-places).items():
                off = np.abs(v - log[n]).reshape(len(v), -1).max(axis=1)
                far[n] = np.maximum(far[n], np.maximum.accumulate(off))
    return far


LIMIT = 1e-9
"""Largest difference of what is told to be equal, in its unit, or of its largest value."""

WIDER = 30.0
"""Roundings of each tick go at most this much further than those of the first numbers alone."""


def _judged(
    one: Any,
    two: Any,
    solver: Sequence[str],
    rounded: Mapping[str, np.ndarray] | None = None,
) -> str:
    """What two outcomes say of each other, logs or refusals."""
    if isinstance(one, str) or isinstance(two, str):
        for said in (one, two):  # refused, or a printed law that breaks: in both
            if not re.search("out of range|too long|became", said if isinstance(said, str) else ""):
                return f"one is refused, or says something else: {said}"
        return "refused"
    if set(one) != set(two):
        return f"logged differently: {sorted(set(one) ^ set(two))}"
    wide = []
    for n in one:
        a, b = one[n], two[n]
        if n in solver and not np.array_equal(a, b):
            return f"{n}: another way of the solver"
        off = np.abs(a - b).reshape(len(a), -1).max(axis=1)
        allowed = LIMIT * max(1.0, float(np.abs(b).max()))
        if rounded is not None:
            wide += [n] if (off > allowed).any() else []
            allowed = allowed + WIDER * rounded[n]
        if not (off <= allowed).all():
            return f"{n}: differs by {off.max():.3g}"
    return f"equal but for roundings in {', '.join(wide)}" if wide else "equal"


def job(study: str, k: int, name: str) -> tuple[list[str], float]:
    """All settings of one loop over its whole run, and the CPU time in s."""
    begun = sum(os.times()[:4])  # the compiler's too
    return compare(study, k, name, SETTINGS, whole=True), sum(os.times()[:4]) - begun


def main() -> int:
    """Every setting of every loop, over whole runs."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("studies", nargs="*", default=STUDIES, metavar="STUDY")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    keys = {s: key_of(resolve.load_study(s), quick=True, settings=(), swaps=()) for s in STUDIES}
    rows: dict[str, Any] = {}
    if options.out.exists():
        rows = json.loads(options.out.read_text(encoding="utf-8"))["rows"]
    wanted = [one for s in options.studies for one in loops(s)]
    names = {one: f"{one[0]}/{cases(*one[:1], True)[one[1]].scenario.name}/{one[2]}"
             for one in wanted}  # fmt: skip
    open_ = [one for one in wanted if rows.get(names[one], {}).get("key") != keys[one[0]]]
    begun, done = time.monotonic(), 0
    with ProcessPoolExecutor(options.jobs, mp_context=get_context("fork")) as pool:
        jobs = {pool.submit(job, *one): one for one in open_}
        for ended in as_completed(jobs):
            one, (found, cpu) = jobs[ended], ended.result()
            rows[names[one]] = {"key": keys[one[0]], "cpu_s": round(cpu, 1), "found": found}
            store.write_json(options.out, {"format": 1, "settings": SETTINGS, "rows": rows})
            done += 1
            left = (time.monotonic() - begun) / done * (len(open_) - done)
            print(f"{done}/{len(open_)} {names[one]}: {', '.join(dict.fromkeys(found))};"
                  f" {cpu:.0f} s of CPU, about {left / 60:.0f} min left", flush=True)  # fmt: skip
    every = [(n, f) for n in names.values() for f in rows[n]["found"]]
    wrong = [f"{n}: {f}" for n, f in every if not f.startswith(("equal", "refused", "none"))]
    cpu = sum(rows[n]["cpu_s"] for n in names.values())
    print(f"{len(every)} runs of {len(wanted)} loops, {len(wrong)} wrong, {cpu:.0f} s of CPU")
    print("\n".join(wrong), end="\n" if wrong else "")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
