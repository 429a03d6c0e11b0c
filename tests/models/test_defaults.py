"""Units, defaults, ranges and signs of models and seekers change on purpose: files rely on them.

``python tests/models/test_defaults.py`` writes the table anew; a changed number then belongs into
CHANGELOG. What is new is free until it is in the table.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator
from dataclasses import MISSING, fields, is_dataclass
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages

import numpy as np

from slipctl import (
    BadInput,
    Block,
    Signal,
    argmax_block,
    differential_evolution,
    locking_seek,
    particle_swarm,
    perturbation_seek,
    probe,
    rls,
    sliding_seek,
)
from slipctl import models as package
from slipctl.models import common_form, converters, ranges, sensors
from slipctl.models.cheng_2022 import freight_resistance
from slipctl.models.huang_2020 import subway_braking
from slipctl.models.vehicle import failure, parts, plant, wheels
from slipctl.models.vehicle.air import pneumatics, slide_protection
from slipctl.models.vehicle.measurement import fused_speed
from slipctl.models.vehicle.slip import takeover
from slipctl.models.wang_2025 import hst_traction, hst_traction_adhesion
from slipctl.models.wheel_rail import contact, torsion
from slipctl.models.zhang_2021 import ep_valve, hst_braking
from slipctl.study import resolve

TABLE = Path(__file__).parent / "defaults.csv"
HEAD = ["block", "signal", "role", "unit", "value", "lo", "hi", "positive", "per",
        "safe", "change", "stale", "deviation", "ends", "source"]  # fmt: skip
MODELS = [f"{m}.{b}" for m, (_, blocks) in resolve.models().items() for b in blocks]
WHEEL = common_form.Wheel(240.0, 0.5, 8e3, 8e3, 9.81, 20e3, 0.05, 1.21, 20.0)
SUBWAY, HST = subway_braking.double_exponential, hst_braking.burckhardt
EXAMPLES: dict[str, Callable[[], Block]] = {
    "converters.converter": lambda: converters.converter("V", -1.0, 1.0),
    "analysis.argmax": lambda: argmax_block(hst_braking.grip(HST), "lam", lo=0.005, hi=0.4),
    "estimate.rls": lambda: rls(
        SUBWAY, form="window", start={"c": 0.3, "a": 0.54, "b": 1.2}, period=1e-3),
    "ep_valve.dead_time": lambda: ep_valve.dead_time(3),
    "freight_resistance.balance": lambda: freight_resistance.balance(1.0),
    "hst_braking.grip": lambda: hst_braking.grip(HST),
    "hst_traction_adhesion.peaks": lambda: hst_traction_adhesion.peaks(hst_traction.polach),
    "hst_traction_adhesion.usable_adhesion": lambda: hst_traction_adhesion.usable_adhesion(2),
    "hst_traction_adhesion.antislip_limit": lambda: hst_traction_adhesion.antislip_limit(2),
    "ranges.fit_ranged": lambda: ranges.fit_ranged(
        rls(SUBWAY, form="recursive", start={"c": 0.3, "a": 0.54, "b": 1.2}, period=1e-3), SUBWAY),
    "ranges.peak_ranged": lambda: ranges.peak_ranged(
        argmax_block(hst_braking.grip(HST), "lam", lo=0.005, hi=0.4), 1.0),
    "ranges.probe_ranged": lambda: ranges.probe_ranged(probe(SUBWAY, "v_s", within=(0.1, 6.0))),
    **{f"seek.perturbation_seek({dither})": lambda dither=dither: perturbation_seek(
        0.01, dither=dither) for dither in ("fixed", "vanishing")},
    "seek.sliding_seek": lambda: sliding_seek(0.01),
    "seek.locking_seek": lambda: locking_seek(0.01),
    "seek.differential_evolution": lambda: differential_evolution(HST, "lam", lo=0.005, hi=0.4),
    "seek.particle_swarm": lambda: particle_swarm(HST, {"lam": (0.005, 0.4)}, "mu"),
    "sensors.reading": lambda: sensors.noisy_sensor("m/s"),
    "sensors.speed_of_wheels": lambda: sensors.speed_of_wheels(4),
    **{f"vehicle.failure.trust({driven})": lambda driven=driven: failure.trust(2, driven)
       for driven in (False, True)},
    "vehicle.air.pneumatics.magnet_valves": lambda: pneumatics.magnet_valves(2),
    "vehicle.air.pneumatics.reservoir": lambda: pneumatics.reservoir(2),
    "vehicle.air.pneumatics.brake_model": lambda: pneumatics.brake_model(2),
    "vehicle.air.slide_protection.slide_machine": slide_protection.slide_machine,
    "vehicle.measurement.fused_speed.accelerometer": fused_speed.accelerometer,
    "vehicle.measurement.fused_speed.largest_wheel": lambda: fused_speed.largest_wheel(2),
    "vehicle.measurement.fused_speed.axle_weights": lambda: fused_speed.axle_weights(2),
    "vehicle.plant.valve_brake": plant.valve_brake,
    "vehicle.slip.takeover.turns": lambda: takeover.turns(2),
    **{f"vehicle.slip.takeover.{make.__name__}({choice})":
       lambda make=make, choice=choice: make(choice)
       for make in (takeover.slip_from_speeds, takeover.wake, takeover.watch)
       for choice in (False, True)},
    "vehicle.wheels.known_radii": lambda: wheels.known_radii(2),
    "vehicle.wheels.learnt_radii": lambda: wheels.learnt_radii(2),
    **{f"vehicle.wheels.bounded_speed({driven})":
       lambda driven=driven: wheels.bounded_speed(2, driven) for driven in (False, True)},
    "wheel_rail.torsion.twisting_axle": lambda: torsion.twisting_axle(contact.polach),
}  # fmt: skip
"""What functions that need arguments make."""


def model(name: str) -> Block | None:
    """A model as it comes, None for a function that needs arguments."""
    try:
        return EXAMPLES[name]() if name in EXAMPLES else resolve.load_block(name)
    except BadInput as error:
        if "is a function that needs" in str(error):
            return None
        raise


def rows(name: str, block: Block) -> Iterator[list[str]]:
    """Signals of a block; of a connected one those of its parts, and its outputs."""
    if block.parts:
        yield from (row(name, f"= {s.name}", s) for s in block.outputs.values())
    for path, leaf in block.leaves():
        yield [name, path, "name", "", leaf.name, *[""] * 10]
        for s in leaf.signals:
            yield row(name, f"{path}.{s.name}" if path else s.name, s)


def row(of: str, name: str, s: Signal) -> list[str]:
    """What is declared of a signal."""
    return [of, name, s.role, s.unit, said(s.value), said(s.lo), said(s.hi), s.positive or "",
            s.per or "", said(s.safe), said(s.change) + f" and {said(s.jitter)}" * (s.jitter > 0),
            said(s.stale), s.deviation,
            "; ".join(f"{b.what} {b.expression}" for b in s.bounds), s.source]  # fmt: skip


def modules() -> Iterator[list[str]]:
    """What files of models have beside their blocks: parts, signals that are shared, constants."""
    for found in walk_packages(package.__path__, f"{package.__name__}."):
        module = import_module(found.name)
        of = found.name.removeprefix(f"{package.__name__}.")
        for name, value in vars(module).items():
            if isinstance(value, Block) and f"{of}.{name}" not in MODELS:
                yield from rows(f"{of}.{name}", value)
            elif isinstance(value, Signal):
                yield row(of, name, value)
            elif name.isupper() and plain(value):
                yield [of, name, "constant", "", said(value), *[""] * 10]
    for driven in (False, True):
        for name, make in common_form.laws(driven).items():
            yield from rows(f"common_form.laws({driven})[{name}]", make(WHEEL))


def plain(value: object) -> bool:
    """Numbers and texts, and tables of them."""
    if isinstance(value, dict):
        return all(map(plain, value.values()))
    if isinstance(value, list | tuple):
        return all(map(plain, value))
    return isinstance(value, int | float | str)


def keys() -> Iterator[list[str]]:
    """Keys of the parts of a file that describes a vehicle."""
    for kind in vars(parts).values():
        if isinstance(kind, type) and issubclass(kind, parts.Part) and is_dataclass(kind):
            for f in fields(kind):
                meta = f.metadata
                yield [f"[{kind.__name__}]", f.name, "key", str(meta.get("unit", "")),
                       "" if f.default is MISSING else said(f.default), said(meta.get("lo", "")),
                       said(meta.get("hi", "")), *[""] * 8]  # fmt: skip


def said(value: object) -> str:
    """Numbers to twelve digits: the last ones are those of a system's ``exp``."""
    if isinstance(value, np.ndarray):
        return said(value.tolist())
    if isinstance(value, dict):
        return said([part for pair in value.items() for part in pair])
    if isinstance(value, list | tuple):
        return " ".join(map(said, value))
    return f"{value:.12g}" if isinstance(value, int | float) else str(value)


def all_rows() -> list[list[str]]:
    blocks = {name: model(name) for name in MODELS}
    told = (row for name, block in blocks.items() if block for row in rows(name, block))
    made = (row for name, make in EXAMPLES.items() if name not in MODELS
            for row in rows(name, make()))  # fmt: skip
    return [*keys(), *told, *modules(), *made]


def test_defaults_and_ranges_are_those_of_the_table() -> None:
    with TABLE.open(newline="", encoding="utf-8") as file:
        wanted = list(csv.reader(file))[1:]
    have = {tuple(row[:3]): row for row in all_rows()}
    assert [row for row in wanted if have.get(tuple(row[:3])) != row] == []
    assert len(wanted) > 1500
    for row in have.values():
        if row[2] not in ("key", "constant", "name"):
            assert float(row[5]) < float(row[6]), row  # no range is empty


if __name__ == "__main__":
    with TABLE.open("w", newline="", encoding="utf-8") as out:
        csv.writer(out, lineterminator="\n").writerows([HEAD, *all_rows()])
