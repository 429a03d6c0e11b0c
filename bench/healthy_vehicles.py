"""Vehicle files by seed whose sensors are right: no sample and no state is refused.

``python -m bench.healthy_vehicles [--vehicles N] [--seed N] [--out FILE]`` draws vehicles of 5 to
160 km/h whose wheels differ by 3 % either way. It runs one of all kinds of controllers on each, on
dry rail and leaves, and counts ticks. A tick is refused where a sample is not believed, where the
law of an axle begins anew, and where the guards of the C would not take a state. Exit code 1 if one
is.
"""

from __future__ import annotations

import argparse
import random
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from slipctl.block.transforms.discretisation import runs_of_part
from slipctl.ccode.module.plan import Plan
from slipctl.models.vehicle import trip as trips
from slipctl.models.vehicle.parts import Trip
from slipctl.run import store
from slipctl.run.simulation import simulate
from slipctl.study.files.declared_parts import read

KINDS = ("pid", "smc", "sta", "efc", "eppfc", "eppfc_barrier", "barrier", "hosm", "pi", "nmpc")
"""Controllers with a slip control."""

JUDGED = ("ctl.trust.ok", "ctl.trust.v_ok", "ctl.trust.demand_ok", "ctl.trust.follows",
          "ctl.law.sound")  # fmt: skip
"""Outputs that are 1 while all is right."""


def drawn_vehicle(rng: random.Random, kind: str) -> dict[str, Any]:
    """Content of a vehicle file: a braked vehicle of two or four axles with sensors that are right.

    Args:
        rng: what draws. kind: of its controller, by the name ``one``.
    """
    axles, mass, r = rng.choice((2, 4)), rng.uniform(7.0, 16.0), rng.uniform(0.35, 0.5)
    radii = [f"{r * rng.uniform(0.97, 1.03):.4f} m" for _ in range(axles)]
    decelerated = rng.uniform(0.7, 1.3)
    torque = mass * 1e3 * decelerated * r * rng.uniform(1.2, 1.8)
    wheel = rng.choice((
        {"kind": "exact"},
        {"kind": "tooth_wheel", "teeth": rng.choice((60, 120))},
        {"kind": "noisy", "deviation": "0.05 rad/s", "step": "0.02 rad/s"},
    ))  # fmt: skip
    speed = rng.choice((
        {"kind": "exact"},
        {"kind": "noisy", "deviation": f"{rng.uniform(0.01, 0.1):.3f} m/s"},
    ))  # fmt: skip
    return {
        "title": "drawn", "duration": "6 s", "seed": rng.randrange(10**6), "end": "standstill",
        "vehicle": {
            "mode": "brake", "mass": f"{mass * axles:.2f} t", "axles": axles,
            "places": [f"{2.5 * k:g} m" for k in range(axles)], "radius": radii,
            "inertia": f"{rng.uniform(60, 160):.1f} kg m^2",
            "speed": f"{rng.uniform(5, 160):.2f} km/h",
            "resistance": {"a": "1.2 kN", "b": "12 N s/m", "c": "4.5 N s^2/m^2"},
        },
        "actuator": {"kind": "lag", "torque": f"{torque:.0f} N m",
                     "lag": f"{rng.uniform(30, 75):.0f} ms",
                     "dead_time": f"{rng.randrange(0, 60)} ms"},
        "rail": {
            "law": "exponential_tail", "conditions": {"leaves": {"c": 0.09, "s": 0.03}},
            "sections": [{"place": "0 m", "condition": "dry"},
                         {"place": f"{rng.uniform(5, 60):.1f} m", "condition": "leaves"}],
        },
        "demand": {"kind": "constant", "deceleration": f"{decelerated:.3f} m/s^2"},
        "sensors": {"wheel_speed": wheel, "vehicle_speed": speed},
        "reference": {"kind": "searched", "start": {"c": 0.7}},
        "control": {"radius": f"{r:.4f} m", "least": "0.5 m/s",
                    "period": rng.choice(("1 ms", "5 ms", "10 ms"))},
        "controllers": {"one": {"kind": kind}},
    }  # fmt: skip


def trip_of(content: Mapping[str, Any]) -> Trip:
    """Trip of such a content, which is right."""
    trip, faults = read(Trip, content)
    assert not faults, faults
    return trip


def refused_ticks(trip: Trip) -> dict[str, int]:
    """Ticks of a run in which something was refused, by what it was; empty where nothing was."""
    loop = trips.loop(trip, "one")
    runs = runs_of_part(loop, "ctl")
    plan, values = Plan(runs.block, "ctl", runs.period), runs.block.param_values()
    log = simulate(
        loop, trips.scenario(trip), log=[*JUDGED, *(f"ctl.{n}" for n in runs.block.states)]
    )
    found = {n: int((log[n].values.reshape(log.time.size, -1) < 0.5).any(axis=1).sum())
             for n in JUDGED}  # fmt: skip
    for m in plan.layout.states:
        lo, hi, *_ = plan.ends([m], values)
        given = log[f"ctl.{m.name}"].values.T.reshape(m.size, -1).T  # C has it by columns
        found[f"ctl.{m.name}"] = int(((given < lo) | (given > hi)).any(axis=1).sum())
    return {n: k for n, k in found.items() if k}


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw, run, tell."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vehicles", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out")
    options = parser.parse_args(arguments)
    rows: list[dict[str, Any]] = []
    for k in range(options.vehicles):
        rng = random.Random(f"{options.seed} {k}")
        content = drawn_vehicle(rng, KINDS[k % len(KINDS)])
        refused = refused_ticks(trip_of(content))
        rows.append({"number": k, "kind": KINDS[k % len(KINDS)], "refused": refused,
                     "vehicle": content})  # fmt: skip
        print(f"{k} {rows[-1]['kind']}: {refused or 'nothing refused'}", flush=True)
        if options.out:
            store.write_json(Path(options.out), {
                "seed": options.seed, "vehicles": len(rows),
                "refused": sum(bool(r["refused"]) for r in rows),
                "found": [r for r in rows if r["refused"]],
            })  # fmt: skip
    return 1 if any(r["refused"] for r in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
