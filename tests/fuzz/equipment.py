"""Vehicles with all that a file may have, drawn by seed, and what no such vehicle does.

``python tests/fuzz/equipment.py --draws 200 --seed 1`` draws cars with bogies whose load moves,
pads, air brakes with valve bits, contaminated rail with sand, sensors that fail, estimated speeds,
and a controller of each kind. A file is refused in one line, or it runs without and with slip
control, and both logs are judged: momentum of the train and of each wheelset, loads, adhesion that
the rail has, energy, the shortest way to stop, ranges, and a brake that is let go for nothing.
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from mechanics import TICK, energies, rail_curve, slopes
from vehicles import Table, read_trip, toml

from slipctl import BadInput, RunFailed, simulate
from slipctl.models.vehicle import parts
from slipctl.study.files.declared_parts import Each
from slipctl.study.resolve import load_study

Log = dict[str, np.ndarray]
OWN = ("x", "v", "omega", "v_s", "mu", "F")
"""Signals of the train that are judged; beside them its torques, pressures and estimates."""
MORE = ("plant.T", "plant.pads.T_b", "plant.pressure", "plant.field.recovered", "speed.v_m")
CONTROLLERS = ("wsp", "pi", "pid", "sta", "smc", "efc")


def drawn(seed: int) -> Table:
    """A file whose parts are drawn, each near what a train has or far from it."""
    rng = random.Random(f"equipment {seed}")
    cars = [car(rng) for _ in range(rng.choice([1, 1, 2]))]
    table: Table = {
        "title": "drawn", "duration": "3 s", "seed": rng.randrange(9),
        "vehicle": {
            "radius": "0.46 m", "inertia": rng.choice(["100 kg m^2", "20 kg m^2", "400 kg m^2"]),
            "speed": rng.choice(["140 km/h", "60 km/h", "20 km/h", "3 km/h"]),
            "cars": cars, "resistance": {"a": "12 N/t", "c": "0.02 N s^2/m^2/t"},
        },
        "actuator": brake(rng),
        "rail": rail(rng, sum(c["axles"] for c in cars)),
        "demand": {"kind": "constant", "deceleration": rng.choice(["1 m/s^2", "2.5 m/s^2",
                                                                   "0.3 m/s^2"])},
        "sensors": sensors(rng, sum(c["axles"] for c in cars)),
        "reference": rng.choice([{"kind": "ratio", "slip": 0.15},
                                 {"kind": "speed", "slip": "0.8 m/s"}]),
        "control": {"period": rng.choice(["1 ms", "10 ms", "10 ms"])},
        "controllers": {"none": {"kind": "none"}, "own": {"kind": rng.choice(CONTROLLERS)}},
    }  # fmt: skip
    if table["actuator"]["kind"] != "air" and table["controllers"]["own"]["kind"] == "wsp":
        table["controllers"]["own"]["kind"] = "pi"  # no valves
    if rng.random() < 0.3:
        table["control"]["let_go"] = "1 s"
    return table


def car(rng: random.Random) -> Table:
    """A car with bogies or without, high or low, light or heavy."""
    axles = rng.choice([2, 2, 4])
    found: Table = {
        "mass": f"{rng.choice([12, 24, 48, 90])} t", "length": "20 m",
        "axles": axles, "bogies": rng.choice([0, axles // 2]), "wheelbase": "2.5 m",
        "bogie_centres": rng.choice(["14 m", "14 m", "5 m"]),
    }  # fmt: skip
    if rng.random() < 0.6:
        found |= {"height": rng.choice(["1.2 m", "1.8 m", "4.5 m"]),
                  "wheelset_mass": rng.choice(["0 t", "1.5 t"])}  # fmt: skip
        if found["bogies"]:
            found |= {"bogie_mass": rng.choice(["0 t", "4 t"]), "pivot_height": "0.8 m"}
    if rng.random() < 0.4:
        found["pads"] = {"material": rng.choice(["disc", "cast_iron", "composite", "cosid"])}
        if rng.random() < 0.4:
            found["pads"] |= {"heat_capacity": "60 kJ/K", "fade": "0.002 1/K", "cooling": "50 W/K"}
        if rng.random() < 0.3:
            found["pads"]["spread"] = rng.choice([0.3, 1.3, 3])
    if rng.random() < 0.2:
        found["radius"] = rng.choice(["0.43 m", "0.30 m"])
    return found


def brake(rng: random.Random) -> Table:
    """An air brake with its valves, a valve without air, or a lag."""
    kind = rng.choice(["air", "air", "lag", "valve"])
    found: Table = {"kind": kind, "torque": rng.choice(["6 kN m", "14 kN m", "0.5 kN m"])}
    if kind == "lag":
        return found | {"lag": "60 ms", "dead_time": rng.choice(["0 s", "40 ms"])}
    if kind == "valve":
        return found | {"fill": "0.15 s", "vent": "0.1 s"}
    found |= {"pressure": "3.8 bar", "supply": rng.choice(["5 bar", "4 bar", "10 bar"]),
              "dead_time": rng.choice(["0 s", "60 ms", "400 ms"]),
              "pulse": rng.choice(["0 s", "20 ms", "300 ms"]),
              "reaction": rng.choice(["0 s", "0.5 s"])}  # fmt: skip
    if rng.random() < 0.5:
        found |= {"reservoir": rng.choice(["300 l", "10 l", "2 l"]),
                  "reserve": rng.choice(["8 bar", "10 bar"])}  # fmt: skip
    if rng.random() < 0.3:
        found["weighed"] = rng.choice(["20 t", "60 t"])
    return found


def rail(rng: random.Random, axles: int) -> Table:
    """Dry or wet rail on a slope, with a layer of leaves and sand on it."""
    law = rng.choice(["falling_creep", "exponential_tail", "double_exponential"])
    dry: Table = {"mu_0": 0.3, "A": 0.4, "B": 0.3} if law == "falling_creep" else {}
    found: Table = {
        "law": law, "gradient": rng.choice([0.0, -0.015, 0.03]),
        "conditions": {"own": dry}, "sections": [{"place": "0 m", "condition": "own"}],
    }  # fmt: skip
    if rng.random() < 0.6:
        layer: Table = {"condition": "leaves", "peak": rng.choice([0.05, 0.02, 0.1])}
        layer["tau"] = rng.choice(["3.4e-5 m/J", "0 m/J", "1e-3 m/J"])
        if rng.random() < 0.5:
            layer["places"] = [{"from": "10 m", "to": "60 m"}]
        if rng.random() < 0.3:
            layer["layers"] = 2
        if rng.random() < 0.5:
            layer["sand"] = {
                "axles": sorted({1, rng.randrange(1, axles + 1)}),
                "rate": rng.choice(["0.03 kg/s", "1 kg/s"]),
                "delay": "0.2 s",
            }
        if law == "double_exponential":  # it knows no leaves
            layer["condition"] = "wet"
        found["contamination"] = layer
    return found


def sensors(rng: random.Random, axles: int) -> Table:
    """Sensors that are right, noisy or fail, and a speed that is measured or made of wheels."""
    found: Table = {
        "wheel_speed": rng.choice([{"kind": "exact"}, {"kind": "tooth_wheel", "teeth": 100}]),
        "vehicle_speed": rng.choice([{"kind": "exact"}, {"kind": "wheels"},
                                     {"kind": "largest_wheel"}, {"kind": "fused"}]),
    }  # fmt: skip
    if found["vehicle_speed"]["kind"] == "fused":
        found["accelerometer"] = {"bias": rng.choice(["0.05 m/s^2", "-0.5 m/s^2"])}
    if rng.random() < 0.5:
        found["faults"] = [
            {"kind": rng.choice(["frozen", "missing", "jumps"]), "axle": axle,
             "time": rng.choice(["0 s", "0.5 s", "1.5 s"])}
            for axle in sorted({rng.randrange(1, axles + 1) for _ in range(rng.choice([1, 2]))})
        ]  # fmt: skip
    return found


# ---- the judge -----------------------------------------------------------------------------------


def ended(table: Table, folder: Path) -> tuple[str, list[str]]:
    """How a file ends, ``refused``, ``told``, ``right`` or ``wrong``, and the lines of it."""
    path = folder / "drawn.toml"
    path.write_text(toml(table), encoding="utf-8")
    try:
        study = load_study(str(path))
        case = study.cases(None, False)[0]
        trip, slowed, wrong, told = read_trip(path), [], [], list(study.without_effect)
        for name in ("none", "own"):
            loop = case.loops[name]
            known = {**loop.states, **loop.outputs}
            names = [n for n in (*(f"plant.train.{k}" for k in OWN), *MORE) if n in known]
            data = simulate(loop, case.scenario, compile=False, log=names)
            log = {n: np.asarray(data[n].values, dtype=float) for n in names}
            wrong += [f"{name}: {line}" for line in nonsense(trip, loop, log)]
            told += str(data.attrs.get("told", "")).splitlines()
            slowed.append(float(log["plant.train.v"][0] - log["plant.train.v"][-1]))
        if slowed[0] > 0.5 and slowed[1] < 0.3 * slowed[0]:
            wrong.append(f"own: slows by {slowed[1]:.3g} m/s where the demand does {slowed[0]:.3g}")
    except RunFailed as error:
        return "broke", [str(error)]
    except BadInput as error:
        lines = list(getattr(error, "lines", [str(error)]))
        bad = [line for line in lines if "\n" in line or not line.strip()]
        return ("wrong", bad) if bad else ("refused", lines)
    except Exception as error:
        return "wrong", [f"{type(error).__name__}: {error}"]
    return ("right" if not wrong else "told" if told else "wrong"), [*wrong, *told]


def nonsense(trip: parts.Trip, loop: Any, log: Log) -> Iterator[str]:
    """What of a run no vehicle does, from its log alone."""
    if not all(np.isfinite(v).all() for v in log.values()):
        yield "not finite"
        return
    v, x, omega, slip, mu, F = (log[f"plant.train.{k}"].reshape(len(log["plant.train.v"]), -1)
                                for k in ("v", "x", "omega", "v_s", "mu", "F"))  # fmt: skip
    v, x = v[:, 0], x[:, 0]
    vehicle = trip.vehicle
    m, g = vehicle.total, vehicle.gravity
    a, b, c = (float(q) * (m if isinstance(q, Each) else 1) for q in (
        vehicle.resistance.a, vehicle.resistance.b, vehicle.resistance.c))  # fmt: skip
    drag = np.sign(v) * (a + b * np.abs(v) + c * v**2)
    slope = slopes(trip, x)
    rolls = (np.abs(v[:-1]) > 0.2) & (v[1:] != 0)
    gap = np.abs(np.diff(v) - TICK * (F.sum(axis=1) - drag - m * g * slope)[:-1] / m)[rolls]
    if gap.max(initial=0) > 1e-6:
        yield f"momentum: the speed changes by {gap.max():.3g} m/s in a tick beside its forces"
    yield from wheelsets(trip, log, omega, F)
    yield from loads(m * g, mu, F)
    yield from grips(trip, loop, v, x, mu, drag / m)
    pressure = log.get("plant.pressure", np.zeros(1))
    if (pressure < -1).any() or (pressure > getattr(trip.actuator, "supply", 0.0) + 1).any():
        yield f"range: pressure {pressure.min():.4g} .. {pressure.max():.4g} Pa"
    if "speed.v_m" in log and not ((log["speed.v_m"] > -1) & (log["speed.v_m"] < 60)).all():
        yield f"range: the speed is believed to be {abs(log['speed.v_m']).max():.4g} m/s"
    if (slip[v > 1.0] > 0.2).any():
        yield f"sign: a braked wheel runs ahead by {slip[v > 1.0].max():.3g} m/s"
    shares = log.get("plant.field.recovered", np.zeros(1))
    if (shares < -1e-9).any() or (shares > 1 + 1e-9).any():
        yield f"range: a share of {shares.min():.4g} .. {shares.max():.4g} of the rail is clean"
    J = np.array(vehicle.inertias)
    turned = omega * np.sqrt(J / J[0])  # of wheelsets that are all as heavy as the first
    yield from energies(trip, v, turned, log["plant.T"], m * g * slope, m, float(J[0]))


def wheelsets(trip: parts.Trip, log: Log, omega: np.ndarray, F: np.ndarray) -> Iterator[str]:
    """Each wheelset by Newton: what it slows by is its brake less its adhesion."""
    T = log.get("plant.pads.T_b", log["plant.T"]).reshape(omega.shape)
    J, r = np.array(trip.vehicle.inertias), np.array(trip.vehicle.radii)
    wanted = TICK * (-T - r * F)[:-1] / J
    turns = (omega[:-1] > 1.0) & (omega[1:] > 1.0)
    gap = np.abs(np.diff(omega, axis=0) - wanted)[turns]
    if gap.max(initial=0) > 1e-6 + 1e-4 * TICK * np.abs(T / J).max():
        yield f"wheel: its speed changes by {gap.max():.3g} rad/s in a tick beside its torques"


def loads(weight: float, mu: np.ndarray, F: np.ndarray) -> Iterator[str]:
    """Loads below the wheels: none pulls at the rail, all together are the weight."""
    known = (np.abs(mu) > 1e-4).all(axis=1)
    if not known.any():
        return
    N = F[known] / mu[known]
    if (-1e-6 * weight > N).any():
        yield f"load: an axle pulls at the rail by {-N.min():.4g} N"
    if np.abs(N.sum(axis=1) - weight).max() > 1e-6 * weight:
        yield f"load: all axles carry {N.sum(axis=1).max():.6g} N of {weight:.6g} N"


def grips(
    trip: parts.Trip, loop: Any, v: np.ndarray, x: np.ndarray, mu: np.ndarray, drag: np.ndarray
) -> Iterator[str]:
    """Adhesion that no rail of the file has, and a stop within less than that allows."""
    if trip.rail.contamination is None:
        curve, many = rail_curve(trip, loop)
        slips = -np.geomspace(1e-3, 60, 200)
        top = max(np.abs(curve(slips, np.full(200, s), k)).max()
                  for k in range(many) for s in np.linspace(0.1, max(v[0], 1.0), 5))  # fmt: skip
    else:
        top = 1.0  # the clean law is inside of the one with the layer
    if np.abs(mu).max() > 1.01 * top + 1e-6:
        yield f"adhesion {np.abs(mu).max():.4g}, the rail has {top:.4g}"
    hold = top * trip.vehicle.gravity + max(0.0, float(drag.max()))
    hold += trip.vehicle.gravity * max(0.0, float(slopes(trip, x).max()))
    lost = v[0] ** 2 - v**2
    if (x - x[0] < (lost / (2 * hold)) * (1 - 1e-3) - v[0] * TICK - 1e-6).any():
        yield f"distance: it slows within less than {lost.max() / (2 * hold):.4g} m"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--show", default="wrong,broke", help="ends that are printed, with commas")
    chosen = parser.parse_args()
    ends = Counter[str]()
    with tempfile.TemporaryDirectory(prefix="equipment") as scratch:
        for k in range(chosen.draws):
            seed = 100_000 * chosen.seed + k
            how, lines = ended(drawn(seed), Path(scratch))
            ends[how] += 1
            if how in chosen.show.split(","):
                print(f"{seed}: {how}: {'; '.join(lines)[:700]}", flush=True)
    print(", ".join(f"{how}: {n}" for how, n in sorted(ends.items())))
    return int("wrong" in ends)


if __name__ == "__main__":
    sys.exit(main())
