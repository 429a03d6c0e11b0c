"""Absurd vehicle files and laws of adhesion, drawn by seed, and what is wrong with how each ends.

``python tests/fuzz/vehicles.py --vehicles 200 --laws 200 --seed 1`` draws so many of each. A file
is refused in one line, or it runs. What runs is judged by ``mechanics``, from the log alone:
momentum, energy, the law of the rail, ``v0^2/(2 mu_max g)``, signs and ranges. A run that breaks
one of them without a word is silent nonsense, and the only thing that is not allowed.
"""

from __future__ import annotations

import argparse
import copy
import math
import random
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mechanics import LOGGED, nonsense

from slipctl import BadInput, RunFailed, simulate
from slipctl.models.vehicle import parts
from slipctl.study.resolve import load_study

Table = dict[str, Any]

BASE: Table = {
    "title": "drawn",
    "duration": "4 s",
    "seed": 1,
    "vehicle": {
        "mode": "brake", "mass": "38 t", "axles": 2, "places": ["0 m", "2 m"], "radius": "0.42 m",
        "inertia": "110 kg m^2", "speed": "60 km/h", "gravity": "9.81 m/s^2",
        "resistance": {"a": "1.2 kN", "b": "12 N s/m", "c": "4.5 N s^2/m^2"},
    },
    "actuator": {"kind": "lag", "torque": "16 kN m", "lag": "60 ms", "dead_time": "20 ms"},
    "rail": {
        "law": "double_exponential", "gradient": 0.0, "conditions": {"leaves": {"c": 0.18}},
        "sections": [{"place": "0 m", "condition": "dry"},
                     {"place": "20 m", "condition": "leaves"}],
    },
    "demand": {"kind": "constant", "deceleration": "1.2 m/s^2"},
    "sensors": {"wheel_speed": {"kind": "exact"}, "vehicle_speed": {"kind": "exact"}},
    "reference": {"kind": "speed", "slip": "0.8 m/s"},
    "control": {"least": "0.3 m/s"},
    "controllers": {"none": {"kind": "none"}, "pid": {"kind": "pid", "K": "100 1/s"}},
}  # fmt: skip
"""A file that is right: two axles of a metro car on dry rail and leaves."""


def toml(table: Table, head: str = "") -> str:
    """Table as TOML, its tables last."""

    def value(v: Any) -> str:
        if isinstance(v, dict):
            return "{ " + ", ".join(f"{k} = {value(x)}" for k, x in v.items()) + " }"
        if isinstance(v, list):
            return "[" + ", ".join(map(value, v)) + "]"
        if isinstance(v, bool):
            return str(v).lower()
        return repr(v) if isinstance(v, (int, float)) else f'"{v}"'

    inner = {k: v for k, v in table.items() if isinstance(v, dict)}
    rows = [f"{k} = {value(v)}" for k, v in table.items() if k not in inner]
    text = (f"[{head}]\n" if head else "") + "\n".join(rows) + "\n"
    return text + "".join(toml(v, f"{head}.{k}" if head else k) for k, v in inner.items())


# ---- what is drawn of a vehicle ------------------------------------------------------------------


def number_fields() -> Iterator[tuple[tuple[str, ...], dict[str, Any], bool]]:
    """Numbers that a file of the base's kinds may have: keys, what is declared, whether whole."""
    kinds: dict[tuple[str, ...], type] = {
        (): parts.Trip, ("vehicle",): parts.Vehicle, ("vehicle", "resistance"): parts.Davis,
        ("actuator",): parts.Lag, ("rail",): parts.Track, ("demand",): parts.Constant,
        ("reference",): parts.SlipSpeed, ("control",): parts.SlipControl,
        ("limits",): parts.Limits,
    }  # fmt: skip
    for keys, kind in kinds.items():
        assert is_dataclass(kind)
        for f in fields(kind):
            if "unit" in f.metadata and not f.metadata["unit"].startswith("by "):
                yield (*keys, f.name), dict(f.metadata), "int" in str(f.type)


def put(table: Table, keys: tuple[str, ...], value: Any) -> None:
    """Put a value there, with the tables that it needs."""
    for key in keys[:-1]:
        table = table.setdefault(key, {})
    table[keys[-1]] = value


def drawn_number(rng: random.Random, meta: dict[str, Any], whole: bool) -> Any:
    """A number at, near or beyond an end of what is declared, or a slip of the pen."""
    lo, hi = meta.get("lo", -math.inf), meta.get("hi", math.inf)
    lo, hi = (lo if math.isfinite(lo) else -1e6), (hi if math.isfinite(hi) else 1e6)
    inside = [lo, hi, lo + 1e-3 * (hi - lo), hi - 1e-3 * (hi - lo), rng.uniform(lo, hi)]
    if lo >= 0:
        low = max(lo, 1e-6 * hi)
        inside += [low * (hi / low) ** rng.random() for _ in range(4)]
    beyond = [0.0, -1.0, 10 * hi, -hi, lo / 10, 1e30]
    value = rng.choice(inside if rng.random() < 0.85 else beyond)
    value = round(value) if whole and rng.random() < 0.9 else float(f"{value:.6g}")
    unit = meta["unit"]
    return value if unit == "1" else f"{value!r} {unit}"


def sections(rng: random.Random, table: Table) -> None:
    """Sections out of order, beyond the run, by time, of unknown or unused conditions."""
    names = ["dry", "wet", "leaves", "ice", "dry", "LEAVES", ""]
    by, unit = rng.choice([("place", "m"), ("place", "m"), ("time", "s")])
    spots = [0.0, *(rng.choice([0.0, 1e-9, 1.0, 20.0, 45e3, 1e6, -5.0, rng.uniform(0, 60)])
                    for _ in range(rng.randrange(4)))]  # fmt: skip
    if rng.random() < 0.7:
        spots.sort()
    table["rail"]["sections"] = [
        {by: f"{s!r} {unit}", "condition": rng.choice(names[: rng.choice([3, 3, 7])])}
        for s in spots
    ]


def demand(rng: random.Random, table: Table) -> None:
    """A demand over time, speed or place with absurd points; none at all; an end of it."""
    drive = table["vehicle"]["mode"] == "drive"
    name = rng.choice(["force", "acceleration" if drive else "deceleration"])
    unit = "N" if name == "force" else "m/s^2"
    most = 1e5 if name == "force" else 10.0
    if rng.random() < 0.5:
        over, on = rng.choice([("time", "s"), ("speed", "m/s"), ("position", "m")])
        n = rng.randrange(1, 5)
        at = sorted(rng.choice([0.0, 1e-9, 1.0, 5.0, 1e4, -3.0]) + k for k in range(n))
        levels = [rng.choice([0.0, most, most / 10, -1.0]) for _ in range(n)]
        table["demand"] = {"kind": "table", "over": over, "at": [f"{a!r} {on}" for a in at],
                           name: [f"{x!r} {unit}" for x in levels]}  # fmt: skip
        return
    until = rng.choice(["", "1 s", "10 m", "1e9 s", "0.0001 s", "1 mm", "-3 s", "2"])
    table["demand"] = {"kind": "constant", name: f"{rng.choice([0.0, most / 5, most])} {unit}"}
    if until:
        table["demand"]["until"] = until
    if rng.random() < 0.3:
        table["demand"] = {"kind": "adhesion"}


def wheels(rng: random.Random, table: Table) -> None:
    """Axles, places and radii that do not fit, or hardly."""
    n = rng.choice([1, 2, 3, 4, 5])
    vehicle = table["vehicle"]
    vehicle["axles"] = n
    vehicle.pop("places", None)
    if rng.random() < 0.6:
        gaps = [rng.choice([0.0, 0.1, 0.84, 2.0, 2.0, 3000.0]) for _ in range(n - 1)]
        vehicle["places"] = [f"{p!r} m" for p in np.cumsum([0.0, *gaps]).tolist()]
    if rng.random() < 0.5:
        vehicle["radius"] = [f"{rng.choice([0.2, 0.42, 0.42, 0.39, 1.0])} m" for _ in range(n)]


def driving(rng: random.Random, table: Table) -> None:
    """A driven vehicle: some axles, a motor with a top, a start from standstill."""
    vehicle = table["vehicle"]
    vehicle["mode"] = "drive"
    vehicle["speed"] = rng.choice(["0 m/s", "0.001 m/s", "5 m/s", "60 m/s"])
    if rng.random() < 0.6:
        vehicle["driven"] = rng.choice([[1], [2], [1, 2], [1, 1], [3], []])
    table["demand"] = {"kind": "constant", "acceleration": rng.choice(["1 m/s^2", "9 m/s^2"])}
    if rng.random() < 0.5:
        table["actuator"]["power"] = rng.choice(["1 W", "100 kW", "100 MW"])
        table["actuator"]["top"] = rng.choice(["0.1 m/s", "20 m/s", "200 m/s"])


def brake(rng: random.Random, table: Table) -> None:
    """An air brake, or a lag with a gain and a rate that no brake has."""
    if rng.random() < 0.5:
        table["actuator"] = {
            "kind": "valve", "torque": rng.choice(["1 N m", "16 kN m", "1 MN m"]),
            "fill": rng.choice(["1 ms", "0.2 s", "5 s"]), "vent": rng.choice(["1 ms", "5 s"]),
            "band": rng.choice([0, 0.005, 0.5]), "dead_time": rng.choice(["0 ms", "2 s", "0.3 ms"]),
        }  # fmt: skip
        return
    table["actuator"] |= {"gain": rng.choice([0.1, 1, 10]),
                          "rate": rng.choice(["1 N m/s", "1 MN m/s", "1e9 N m/s"])}  # fmt: skip


def gradient(rng: random.Random, table: Table) -> None:
    """Gradients by place, as steep as may be, out of order."""
    spots = [0.0, *(rng.choice([1e-6, 5.0, 30.0, 1e6]) for _ in range(rng.randrange(3)))]
    table["rail"]["gradient"] = [
        {"place": f"{s!r} m", "gradient": rng.choice([0.1, -0.1, 0.0, 0.2])} for s in spots
    ]


def measured(rng: random.Random, table: Table) -> None:
    """Sensors that tell next to nothing."""
    table["sensors"] = {
        "wheel_speed": rng.choice([
            {"kind": "tooth_wheel", "teeth": rng.choice([1, 2, 1000]), "clock": "1 ms"},
            {"kind": "noisy", "deviation": "100 rad/s", "dropout": 0.99},
            {"kind": "noisy", "step": "100 rad/s"},
        ]),
        "vehicle_speed": rng.choice([
            {"kind": "noisy", "deviation": "10 m/s", "step": "10 m/s"},
            {"kind": "noisy", "dropout": 0.99}, {"kind": "wheels", "rate": "0.01 m/s^2"},
        ]),
    }  # fmt: skip


def ending(rng: random.Random, table: Table) -> None:
    """Ends and durations of a run that are none."""
    table["end"] = rng.choice(["standstill", "5 km", "1 m", "-5 m", "0 m", "1e-9 m", "5"])
    table["duration"] = rng.choice(["4 s", "10 ms", "100.5 ms", "1e5 s", "0 s"])


def slip_control(rng: random.Random, table: Table) -> None:
    """Another law of slip control and another reference."""
    table["reference"] = rng.choice([
        {"kind": "ratio", "slip": rng.choice([1e-3, 0.9, "15 %", 15])},
        {"kind": "speed", "slip": rng.choice(["0.01 m/s", "20 m/s"])},
    ])  # fmt: skip
    table["controllers"]["pid"] = rng.choice([
        {"kind": "pid", "K": rng.choice(["0 1/s", "1e5 1/s", "-1 1/s"])},
        {"kind": "sta", "k1": "20 m^.5/s^1.5", "k2": rng.choice(["10 m/s^3", "1e6 m/s^3"])},
        {"kind": "smc"}, {"kind": "efc"}, {"kind": "barrier"},
    ])  # fmt: skip


STRUCTURES: tuple[Callable[[random.Random, Table], None], ...] = (
    sections, demand, wheels, driving, brake, gradient, measured, ending, slip_control,
)  # fmt: skip


def absurd_vehicle(seed: int) -> Table:
    """A file with one to four absurd places."""
    rng = random.Random(f"vehicle {seed}")
    table = copy.deepcopy(BASE)
    every = list(number_fields())
    for _ in range(rng.choice([1, 1, 2, 3])):
        if rng.random() < 0.5:
            keys, meta, whole = rng.choice(every)
            if keys[-1] == "duration" or not isinstance(_at(table, keys[:-1]), dict):
                continue
            value = drawn_number(rng, meta, whole)
            put(table, keys, value)
            if keys == ("vehicle", "tare"):
                table["vehicle"].pop("mass")
            if keys == ("vehicle", "rotating_mass"):
                table["vehicle"].pop("inertia", None)
        else:
            rng.choice(STRUCTURES)(rng, table)
    return table


def _at(table: Table, keys: tuple[str, ...]) -> Any:
    for key in keys:
        table = table.get(key, {})
    return table


# ---- what is drawn of a law ----------------------------------------------------------------------


ODD = (
    "k*tanh(v_s/w)", "k*sin(v_s/w)*exp(-abs(v_s)/w)", "k*v_s/(abs(v_s) + w)", "k*tanh(v_s/w)**3",
    "k*clip(v_s/w, -1, 1)", "k*v_s/w/(1 + (v_s/w)**2)", "k*atan(v_s/w)/2",
    "k*tanh(v_s/w)*u/(v + u)",
    "k*root(v_s/w)/(1 + abs(v_s/w))", "k*sign(v_s)*(1 - exp(-abs(v_s)/w))",
    "k*sign(v_s)*min(abs(v_s)/w, 1)", "k*sign(v_s)*(abs(v_s)/w if abs(v_s) < w else 0.2)",
)  # fmt: skip
"""Shapes that oppose slip, most of them: smooth ones and steep ones, with corners and steps."""


def absurd_law(seed: int) -> tuple[Table, str]:
    """A file with a law of its own, and the text of ``own.toml``, where the law is in a file."""
    rng = random.Random(f"law {seed}")
    table = copy.deepcopy(BASE)
    size = rng.choice([0.02, 0.1, 0.3, 0.3, 0.6, 0.6, 0.9, 1.0, 1.0, 1.5, 30.0, -0.2, 0.0])
    width = 10 ** rng.uniform(-3, 1.5)
    shape = rng.choice([
        "k*v_s/w", "k*v_s/(v_s + w)", "k*v_s/(abs(v_s) + w)", "k*tanh(v_s/w)", "k*sign(v_s)",
        "k*sin(v_s/w)", "k*(exp(-v_s/w) - exp(-2*v_s/w))", "k*v_s/w*exp(-v_s/w)", "k",
        "k*(1 - exp(-v_s/w)) - j*v_s/w", "k*v_s**2/w**2", "k*(v_s/w)**0.5", "k*log(v_s/w)",
        "k*v_s/v_s", "k + v_s/w", "k*clip(v_s/w, -1, 1)", "k*clip(v_s/w, -1, 0.5)",
        "k*tanh(v_s/w)*exp(-v/(10*w))", "k*tanh(v_s/w)*(1 - v/u)", "k*tanh(v_s/w) + j",
        "k*v_s/w if v_s < w else j", "k*atan(v_s/w)", "k*abs(v_s)/w*exp(-abs(v_s)/w)",
        "k*tanh(v_s/w)*sin(v/w)", "k*tanh(v_s/w)*v/u", "k*tanh(v_s/w) + j*v_s*v/(u*u)",
        "k*v_s/w/(1 + (v_s/w)**2)", "-k*tanh(v_s/w)", "k*F(v_s)", "k*F(v_s)",
        "k*F(abs(v_s))*sign(v_s)", "k*F(abs(v_s))*sign(v_s)", "k*lam/l*exp(-abs(lam)/l)",
        "k*tanh(lam/l)", "k*lam", *ODD, *ODD,
    ])  # fmt: skip
    turn = rng.choice([*["" for _ in range(8)], "-1*", "percent"])
    body = f"{'100*' if turn == 'percent' else turn}{'(' + shape + ')'}"
    slip = "lam" if "lam" in shape else "v_s"
    inputs = {slip: "1" if slip == "lam" else "m/s"} | (
        {"v": "m/s"} if re.search(r"\bv\b", shape) else {}
    )
    numbers = {"k": f"{size!r}", "w": f"{width:.4g} m/s", "u": "20 m/s",
               "j": f"{rng.choice([0.05, 0.5, -0.1])}", "l": f"{width / 20:.4g}"}  # fmt: skip
    used = {n: v for n, v in numbers.items() if re.search(rf"\b{n}\b", shape)}
    conditions = {}
    if rng.random() < 0.5:
        conditions["x"] = {"k": rng.choice([0.3, 0.3, "30 %", 30, 0.05, -0.1, 1.2, 0.999])}
    name = rng.choice(list(conditions) or ["y"])
    conditions.setdefault(name, {})
    points = sorted(rng.uniform(0, 20) for _ in range(4))
    heights = [rng.choice([0.0, 0.3, 0.9, -0.2, 1.5, 0.1]) for _ in range(4)]
    start = rng.choice([[[0, 0]], [[0, 0.1]], []])
    rows = [*start, *([p, h] for p, h in zip(points, heights, strict=True))]
    own = {"law": {"mu": body, "inputs": inputs, "parameters": used}}
    if "F(" in shape:
        own["law"]["tables"] = {"F": {"over": "m/s", "unit": "1", "points": rows}}
    if "F(" in shape or rng.random() < 0.4:
        table["rail"]["law"] = "own.toml:law"
    else:
        where = [f"{n} [{u}]" for n, u in inputs.items()] + [f"{n} = {v}" for n, v in used.items()]
        table["rail"]["law"] = f"mu = {body} where {', '.join(where)}"
    table["rail"] |= {"conditions": conditions,
                      "sections": [{"place": "0 m", "condition": name}]}  # fmt: skip
    if rng.random() < 0.2:
        law, names = rng.choice([("double_exponential", "cab"), ("exponential_tail", "cabs")])
        value = rng.choice([1e-3, 4.9, 3.5, 3.49, 1.0, 0.02, 5.0])
        unit = {"a": " s/m", "b": " s/m"}
        key = rng.choice(names)
        table["rail"]["law"] = law
        table["rail"]["conditions"] = {name: {key: f"{value}{unit.get(key, '')}"}}
    if rng.random() < 0.3:
        driving(rng, table)
    table["vehicle"]["speed"] = rng.choice(["60 km/h", "3 m/s", "80 m/s", "0.5 m/s"])
    table["actuator"]["torque"] = rng.choice(["16 kN m", "60 kN m", "2 kN m"])
    if table["vehicle"]["mode"] == "brake":
        table["demand"]["deceleration"] = rng.choice(["1.2 m/s^2", "8 m/s^2"])
    return table, toml(own)


# ---- the judge -----------------------------------------------------------------------------------


def ended(
    table: Table, own: str, folder: Path, loop: str, run: bool = True
) -> tuple[str, list[str]]:
    """How a file ends, ``refused``, ``told``, ``right`` or ``wrong``, and the lines of it."""
    (folder / "own.toml").write_text(own, encoding="utf-8")
    path = folder / "drawn.toml"
    text = toml(table).replace("own.toml:", f"{folder / 'own.toml'}:")
    path.write_text(text, encoding="utf-8")
    try:
        study = load_study(str(path))
        case = study.cases(None, False)[0]
        made = case.loops[loop]
        if not run:
            return "right", []
        data = simulate(made, case.scenario, compile=False, log=LOGGED)
    except RunFailed as error:
        return "broke", [str(error)]
    except BadInput as error:
        lines = list(getattr(error, "lines", [str(error)]))
        bad = [line for line in lines if "\n" in line or not line.strip()]
        unplaced = [k for k in lines if "drawn.toml" not in k]
        return ("wrong", bad) if bad else ("unplaced" if unplaced else "refused", lines)
    except Exception as error:
        return "wrong", [f"{type(error).__name__}: {error}"]
    trip = read_trip(path)
    log = {n: np.asarray(data[n].values, dtype=float) for n in LOGGED}
    told = [*str(data.attrs.get("told", "")).splitlines(), *study.without_effect]
    wrong = list(nonsense(trip, made, log))
    if wrong:
        return "told" if told else "wrong", [*wrong, *(f"told: {t}" for t in told)]
    return "right", told


def read_trip(path: Path) -> parts.Trip:
    """The parts of a file."""
    import tomllib

    from slipctl.study.files.declared_parts import read

    trip, _ = read(parts.Trip, tomllib.loads(path.read_text(encoding="utf-8")))
    assert isinstance(trip, parts.Trip)
    return trip


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vehicles", type=int, default=200)
    parser.add_argument("--laws", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--show", default="wrong", help="ends that are printed, with commas")
    chosen = parser.parse_args()
    shown, ends = chosen.show.split(","), Counter[tuple[str, str]]()
    with tempfile.TemporaryDirectory(prefix="vehicles") as scratch:
        for kind, number in (("vehicle", chosen.vehicles), ("law", chosen.laws)):
            for k in range(number):
                seed = 100_000 * chosen.seed + k
                drawn = absurd_vehicle(seed) if kind == "vehicle" else absurd_law(seed)
                table, own = drawn if isinstance(drawn, tuple) else (drawn, "")
                for loop in ("none", "pid"):
                    how, lines = ended(table, own, Path(scratch), loop)
                    ends[kind, how] += 1
                    if how in shown:
                        print(f"{kind} {seed} {loop}: {how}: {'; '.join(lines)[:600]}", flush=True)
                    if how != "right":
                        break
    print(", ".join(f"{kind}s {how}: {n}" for (kind, how), n in sorted(ends.items())))
    return int(any(how == "wrong" for _, how in ends))


if __name__ == "__main__":
    sys.exit(main())
