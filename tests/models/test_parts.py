"""What every part of every loop computes, at two points, changes on purpose only.

``python tests/models/test_parts.py`` writes the tables anew; a changed number then belongs into
CHANGELOG. They say that nothing changed, not that it is right: other tests hold the equations
against closed forms and printed numbers. What is new is free until it is in a table.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).parents[1])]

from recorded import HEAD, close, leaves, signals, told

from slipctl import Block
from slipctl.models.vehicle import parts as trip_parts
from slipctl.models.vehicle.trip import case
from slipctl.study import resolve
from slipctl.study.files import trip_files

pytestmark = pytest.mark.table  # left out unless asked for: pytest -m table

FOLDER = Path(__file__).parent / "parts"

VEHICLES = {
    "braked": """
[vehicle]
mass = "38 t"
radius = ["0.42 m", "0.41 m", "0.42 m", "0.42 m"]
rotating_mass = 0.08
speed = "60 km/h"
resistance = { a = "1.2 kN", b = "12 N s/m", c = "4.5 N s^2/m^2" }
[actuator]
kind = "valve"
torque = "8 kN m"
dead_time = "5 ms"
[rail]
law = "burckhardt"
gradient = 0.01
[[rail.sections]]
place = "0 m"
condition = "dry"
[demand]
kind = "table"
over = "speed"
at = ["0 m/s", "20 m/s"]
deceleration = ["0.5 m/s^2", "1.2 m/s^2"]
[sensors]
wheel_speed = { kind = "noisy", deviation = "0.01 rad/s", step = "0.02 rad/s", dropout = 0.01 }
vehicle_speed = { kind = "wheels", rate = "2 m/s^2" }
[reference]
kind = "ratio"
slip = 0.1
least = "0.3 m/s"
""",
    "driven": """
[vehicle]
mode = "drive"
mass = "80 t"
driven = [1, 3]
inertia = "150 kg m^2"
radius = "0.6 m"
speed = "20 km/h"
[actuator]
kind = "lag"
torque = "20 kN m"
lag = "40 ms"
rate = "100 kN m/s"
[rail]
law = "double_exponential"
[[rail.sections]]
time = "0 s"
condition = "wet"
[demand]
kind = "adhesion"
[sensors]
vehicle_speed = { kind = "noisy", deviation = "0.05 m/s" }
[reference]
kind = "searched"
start = { c = 0.7 }
""",
}
LAWS = "".join(f'[controllers.{k}]\nkind = "{k}"\n' for k in (*trip_parts.SLIP_LAWS, "none"))
LAWS += '[controllers.nmpc]\nkind = "nmpc"\nhorizon = 100\n'


def loops(name: str) -> Iterator[Block]:
    """Loops of a study, or of a vehicle above."""
    if name in VEHICLES:
        import tempfile

        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"{name}.toml"
            path.write_text(VEHICLES[name] + LAWS, encoding="utf-8")
            found = case(trip_files.load_trip(str(path)))
            yield from (found.loops[k] for k in found.loops)
        return
    for each in resolve.build_cases(resolve.load_study(name)):
        yield from (each.loops[k] for k in each.loops)


@cache
def rows(name: str) -> dict[tuple[str, str, str], list[str]]:
    """Signals of the parts of a study's loops, each part once."""
    found: dict[tuple[str, str, str], list[str]] = {}
    seen: set[tuple[str, str]] = set()
    for loop in loops(name):
        for part in leaves(loop):
            title, numbers = told(part), repr(sorted(map(repr, part.param_values().items())))
            if (title, numbers) in seen:
                continue
            seen.add((title, numbers))
            again = sum(t == title for t, _ in seen)
            title += f" [{again}]" if again > 1 else ""
            for row in signals(part):
                found[title, row[0], row[1]] = [title, *row]
    return found


NAMES = [s for s in resolve.studies() if s not in ("all_rails", "gain_bounds", "leaf_fall")] + [
    *VEHICLES
]
"""The other three put together parts that these have."""


@pytest.mark.parametrize("name", NAMES)
def test_each_part_computes_what_the_table_says(name: str) -> None:
    with (FOLDER / f"{name}.csv").open(newline="", encoding="utf-8") as file:
        wanted = list(csv.reader(file))[1:]
    have = rows(name)
    changed = [
        (row, have.get((row[0], row[1], row[2])))
        for row in wanted
        if not all(map(close, have.get((row[0], row[1], row[2]), [""] * len(row)), row))
    ]
    assert changed == []
    assert len(wanted) > 50


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for study in sys.argv[1:] or NAMES:
        with (FOLDER / f"{study}.csv").open("w", newline="", encoding="utf-8") as out:
            csv.writer(out, lineterminator="\n").writerows([HEAD, *rows(study).values()])
