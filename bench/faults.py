"""Wrong samples on each input of every controller in C, in closed loop: what they lead to.

``python -m bench.faults metro.toml[:CONTROLLER] [--c] [--drawn N] [--out FILE]`` runs those of a
vehicle's file (:mod:`bench.loops.vehicle_faults`), on the C as on the model with ``--c``, and
faults that are drawn in the place of the table with ``--drawn``.
``python -m bench.faults [STUDY[:LOOP[@SCENARIO]] ...] [--out FILE]`` runs every
fault of :mod:`bench.loops.wrong_samples` at two instants of a run of each, and prints a line for
each that does harm. Exit code 1 where one does; with ``--told FILE`` only one that the file does
not have. Each row is written when it is there, of a vehicle's file a situation at once. So
``--missing`` goes on where a run has ended.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

from bench.loops import vehicle_faults
from bench.loops.wrong_samples import NEAR, SETTLED, Fault, faults
from slipctl.block.block import Block
from slipctl.errors import BadInput
from slipctl.models.vehicle.parts import DemandAlone, Predictive, Trip
from slipctl.models.zhang_2021 import hst_braking
from slipctl.run import store
from slipctl.run.rail import Scenario
from slipctl.study import resolve
from slipctl.study.files.trip_files import load_trip


class Where(NamedTuple):
    """Where faults are put in the runs of a study.

    Attributes:
        wheel: state that is the wheel's speed.
        at: times in s of the first wrong sample.
        outside: inputs of the controllers that the estimator of the study finds.
        lasts: time in s of the run, where that of the study ends too soon after a fault.
    """

    wheel: str
    at: tuple[float, ...]
    outside: tuple[str, ...] = ()
    lasts: float | None = None


WHERE = {
    "subway_braking": Where("plant.wheel.omega", (1.5, 3.2)),
    "hst_braking": Where("plant.wheel.omega", (1.5, 3.2)),
    "freight_traction": Where("plant.train.omega_m", (6.0, 12.0)),
    "hst_traction": Where("plant.train.omega", (12.0, 25.0)),
    "all_rails": Where("world.plant.wheel.omega", (1.5, 3.2), ("v_best", "c", "a", "b")),
    "gain_bounds": Where("plant.wheel.omega", (0.3, 0.6)),
    "predictive": Where("plant.q", (0.6, 2.0), lasts=8.0),
}
"""In each study: within the first rail and after a change of it."""


def controllers(wanted: Sequence[str]) -> Iterator[tuple[str, Block, str, Scenario]]:
    """Name, loop, part and scenario of each controller, or of those wanted."""
    for name in wanted or WHERE:
        left, _, loop_name = name.rpartition(":") if ":" in name else (name, "", "")
        if left not in WHERE:
            raise BadInput(f"{left} has no place for faults; there are {', '.join(WHERE)}")
        study, lasts = resolve.load_study(left), WHERE[left].lasts
        if loop_name:
            found = iter([(loop_name, *resolve.find_loop(study, loop_name))])
        else:
            cases = resolve.build_cases(study)
            names = dict.fromkeys(n for case in cases for n in case.loops)
            found = ((n, *resolve.pick_loop(study, cases, n)) for n in names)
        for one, loop, case in found:
            if loop_name or study.controller in loop.parts:  # a bound has no controller
                # where it is to last longer, the last section goes on
                scenario = case.scenario.but(duration=lasts) if lasts else case.scenario
                yield f"{left}:{one}", loop, study.controller, scenario


LED = {
    "u_sw": "super-twisting's integral moves by k2 per second",
    "limited": "the shaped reference of hst_braking moves by up per second",
    "best_h": "the gradient search moves by rate per second",
    "part": "the integral of a PI law moves by K_i e per second",
}
"""States that move at a limited rate: what a fault has led astray needs as long to come back."""


def settling(block: Block) -> Callable[[float], float]:
    """Time in s after which a fault that was heard has left what a controller remembers.

    Returns:
        Function of the time in s that the fault lasted. 100 ms for filters and laws. A window of
        least squares adds its length; one that forgets, and a filter of the best slip, add the time
        until a sample counts for 2 %. A seeker adds four time constants of its slowest filter, and
        one that slides adds a cycle. One that locks opens on a wrong sample, as it cannot know it
        from a change of the rail. It waits, slides through ``planes`` cells and one more, and its
        dither dies out to 2 % with exp(-q t). The gradient search takes it for such a change too:
        its filter settles, and it walks back, see ``_walk``. A state of ``LED`` adds the time that
        the fault lasted. An adaptive law adds until its perturbation estimate has lost 98 % in
        closed loop, s'' + (k_2/sigma) s' + d_1 s = 0; a plan, its length.
    """
    found = [0.0]
    own = block.param_values()
    for path, part in block.leaves():
        at = f"{path}." if path else ""
        period = part.period or block.period or 1e-3
        if f"{at}kept" in block.states and len(block.states[f"{at}kept"].shape) == 2:
            found.append(block.states[f"{at}kept"].shape[1] * period)
        if 0 < float(own.get(f"{at}forgetting", 1.0)) < 1:
            found.append(math.log(NEAR) / math.log(float(own[f"{at}forgetting"])) * period)
        found += [4 / float(own[f"{at}{c}"]) for c in ("w_l", "w_h") if f"{at}{c}" in own]
        if f"{at}tau_s" in own:
            found.append(-math.log(NEAR) * float(own[f"{at}tau_s"]))
        if f"{at}chi_0" in own:
            found.append(_walk(own, at))
        if f"{at}d_hat" in block.states and f"{at}sigma" in own:
            rate = float(own[f"{at}k_2"]) / (2 * float(own[f"{at}sigma"]))
            found.append(-math.log(NEAR) / rate)
        if part.choices.get("solver") == "riccati":
            found.append(float(part.choices["horizon"]) * period)
        if f"{at}planes" in own:
            wait, planes, q = (float(own[f"{at}{c}"]) for c in ("wait", "planes", "q"))
            found.append(wait + (planes + 1) * _cell(own, at) - math.log(NEAR) / q)
        elif f"{at}rho" in own and f"{at}beta" in own:
            found.append(2 * _cell(own, at))
    again = any(n.rpartition(".")[2] in LED for n in block.states)
    return lambda lasted: SETTLED + max(found) + lasted * again


def _walk(own: Mapping[str, Any], at: str) -> float:
    """Time in s in which the gradient search of hst_braking comes back from a slip ``near``.

    About a peak the force is F - F'' (lam - lam*)^2/2 with F'' = a1 a2 F_z, by the paper's curve
    and its slope of 0 there. So the search comes back with lam' = -rate F''/chi_0 (lam - lam*),
    until it is slower than ``gate``, at which the slope is no longer learnt. The reference follows
    behind a filter with ``tau_ref``.
    """
    walked = _tau(own, at) * math.log(max(1.0, float(own[f"{at}near"]) / _dead(own, at)))
    return _one(own, "settle") + walked - math.log(NEAR) * _one(own, "tau_ref", 0.0)


def _tau(own: Mapping[str, Any], at: str) -> float:
    """Time constant in s of the gradient search about a peak."""
    F_z = hst_braking.M * hst_braking.G / hst_braking.N
    bend = min(p["a1"] * p["a2"] for p in hst_braking.RAILS.values()) * F_z
    return float(own[f"{at}chi_0"]) / (float(own[f"{at}rate"]) * bend)


def _dead(own: Mapping[str, Any], at: str) -> float:
    """Slip beside the peak within which the gradient search learns nothing more."""
    return _tau(own, at) * _one(own, "gate")


def _one(own: Mapping[str, Any], last: str, *without: float) -> float:
    """The parameter of that last name; ``without`` is taken where there may be none."""
    (found,) = [float(v) for n, v in own.items() if n.rpartition(".")[2] == last] or without
    return found


def rests(block: Block) -> dict[str, float]:
    """States that may rest beside their place without any fault, and how far."""
    own = block.param_values()
    searches = [n[: -len("chi_0")] for n in own if n.rpartition(".")[2] == "chi_0"]
    return {n: _dead(own, at) for at in searches for n in block.states if n.endswith("best_h")}


def cycle(block: Block) -> float:
    """Time in s of the cycle that a sliding seeker walks for ever: two cells; 0 for none."""
    own = block.param_values()
    slides = [n[:-3] for n in own if n.rpartition(".")[2] == "rho" and f"{n[:-3]}beta" in own]
    return max((2 * _cell(own, at) for at in slides), default=0.0)


def _cell(own: Mapping[str, Any], at: str) -> float:
    """Time in s that the target of a sliding seeker takes through a cell."""
    return float(own[f"{at}beta"]) / float(own[f"{at}rho"])


def table(name: str) -> list[Fault]:
    """Each fault on each input of the controller of a loop, ``STUDY:LOOP[@SCENARIO]``."""
    _, loop, part, scenario = next(controllers([name]))
    where = WHERE[name.partition(":")[0]]
    with tempfile.TemporaryDirectory(prefix="slipctl_") as scratch:
        return faults(
            loop, part, scenario, Path(scratch), where.at, where.wheel,
            settling=settling(loop[part]), cycle=cycle(loop[part]), rests=rests(loop[part]),
            outside=where.outside,
        )  # fmt: skip


def harm_of(evidence: Mapping[str, Any]) -> set[tuple[Any, ...]]:
    """Faults that do harm by the evidence: controller, input, kind, ticks, time."""
    rows = evidence["numbers"]["wrong_samples"]["controllers"]
    found = (
        (name, Fault(**{k: math.inf if v is None else v for k, v in fault.items()}))
        for name, row in rows.items() for fault in row["slow"]
    )  # fmt: skip
    return {(name, *_which(f)) for name, f in found if not f.forgotten}


def _which(f: Fault) -> tuple[Any, ...]:
    """Input, kind, ticks and time."""
    return f.signal, f.kind, f.ticks, f.at


def said(f: Fault) -> str:
    """A fault in one line."""
    back = "back" if f.passed else f"{100 * f.back:.1f} % back, after {f.settled:.3f} s, {f.worst}"
    back += "" if f.passed else f", its own {f.own:.3f} s, alike {f.alike:.3f} s"
    locks = ", the wheel locks" if f.locks else ""
    missed = f", {f.missed} not told" if f.missed else ""
    return f"{f.signal} {f.kind}, {f.ticks} ticks at {f.at:g} s: {back}{missed}{locks}"


def _faults_of(trip: Trip, name: str, drawn: int) -> Iterator[tuple[vehicle_faults.Wrong, ...]]:
    """Faults for a controller: the table, or as many as are drawn.

    One that plans takes those that last for ever alone: its runs are slow.
    """
    plans = isinstance(trip.controllers[name], Predictive)
    if drawn:
        yield from vehicle_faults.random_faults(trip, drawn, seed=1)
        return
    for found in vehicle_faults.table_of_faults(trip):
        if not plans or all(math.isinf(f.lasts) for f in found):
            yield found


def vehicle_rows(
    path: str,
    wanted: Sequence[str],
    in_c: bool,
    drawn: int = 0,
    done: Collection[tuple[str, str]] = (),
) -> Iterator[list[dict[str, Any]]]:
    """Rows of the campaign of a vehicle's file: controller, situation, fault, what came of it.

    Args:
        path: the file.
        wanted: names of controllers; none takes all that slip control has.
        in_c: compare each run with the C, to the last bit.
        drawn: faults that are drawn, in the place of the table; 0 takes the table.
        done: controllers and situations that are left out.
    """
    trip = load_trip(path)
    names = [n for n, c in trip.controllers.items() if not isinstance(c, DemandAlone)]
    for name, situation in product(wanted or names, vehicle_faults.situations(trip)):
        if (name, situation) in done:
            continue
        campaign, rows = vehicle_faults.Campaign(trip, name, situation), list[dict[str, Any]]()
        with tempfile.TemporaryDirectory(prefix="slipctl_") as scratch:
            c = vehicle_faults.InC(campaign, Path(scratch)) if in_c else None
            for faults_ in [(), *_faults_of(trip, name, drawn)]:
                log = campaign.log(*faults_)
                row = {"controller": name, "situation": situation,
                       "fault": "; ".join(map(str, faults_)) or "none",
                       **asdict(campaign.outcome(log)),
                       "c_differs": c.differs(log) if c else None}  # fmt: skip
                rows.append(row)
                print(*row.values(), sep="  ", flush=True)
        yield rows


def _vehicle(path: str, name: str, options: argparse.Namespace) -> int:
    """Campaign of a vehicle's file; each situation is written when it is there."""
    out, kept = Path(options.out or ""), list[dict[str, Any]]()
    if options.missing and options.out and out.exists():
        kept = store.read_json(out)["rows"]
    done = {(row["controller"], row["situation"]) for row in kept}
    for rows in vehicle_rows(path, [name] if name else [], options.c, options.drawn, done):
        kept += vehicle_faults.worst_rows(rows)
        if options.out:
            store.write_json(out, {"file": Path(path).name, "rows": kept})
    return int(any(row["latched"] or row["c_differs"] for row in kept))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the faults."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("loops", nargs="*")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", help="file to write; what it has of other controllers stays")
    parser.add_argument("--missing", action="store_true", help="only those that --out lacks")
    parser.add_argument(
        "--told", help="evidence, docs/evidence/wrong_samples.json: harm in it is known"
    )
    parser.add_argument("--c", action="store_true", help="a vehicle's file: its C, too")
    parser.add_argument("--drawn", type=int, default=0, help="of a vehicle's file: draw so many")
    options = parser.parse_args(arguments)
    if any(name.partition(":")[0].endswith(".toml") for name in options.loops):
        (path, _, name), *more = (n.partition(":") for n in options.loops)
        if more:
            raise BadInput("one vehicle's file at a time: metro.toml, or metro.toml:pid")
        return _vehicle(path, name, options)
    found: dict[str, dict[str, Any]] = {}
    if options.out and Path(options.out).exists():
        found = store.read_json(Path(options.out))["controllers"]
    names = [name for name, *_ in controllers(options.loops)
             if not (options.missing and name in found)]  # fmt: skip
    known = harm_of(store.read_json(Path(options.told))) if options.told else set()
    harmed = 0
    with ProcessPoolExecutor(options.jobs) as pool:
        for name, rows in zip(names, pool.map(table, names), strict=True):
            slow = [f for f in rows if not f.passed]
            harm = [f for f in slow if not f.forgotten]
            for f in slow:
                print(f"{name} {said(f)}")
            print(f"{name}: {len(rows)} faults, {len(rows) - len(slow)} back, {len(harm)} do harm",
                  flush=True)  # fmt: skip
            harmed += sum((name, *_which(f)) not in known for f in harm)
            found[name] = {"faults": len(rows), "slow": [asdict(f) for f in slow]}
            if options.out:
                store.write_json(Path(options.out), {"controllers": found})
    return 1 if harmed else 0


if __name__ == "__main__":
    sys.exit(main())
