"""Where the numbers of a vehicle's controllers stand in its file."""

from __future__ import annotations

from collections.abc import Collection

from slipctl import Block
from slipctl.block.signals import Signal
from slipctl.block.transforms.discretisation import SAMPLE_TIMES
from slipctl.block.units.unit_algebra import unit

UNITS = {"J": "kg m^2", "r": "m", "m": "kg", "g": "m/s^2", "tau": "s", "T_max": "N m"}
"""Units of a wheel's numbers: one of that name in another unit is a law's own."""

KEYS = {
    "J": "[vehicle] inertia", "r": "radius of [vehicle] or [control]", "g": "[vehicle] gravity",
    "tau": "lag of [actuator]", "T_max": "[actuator] torque", "m_axle": "[vehicle] mass, per axle",
    "m": "[vehicle] mass, per axle",
}  # fmt: skip
"""Keys of the numbers of a wheel, by their names in the controllers."""


def of_the_wheel(s: Signal, name: str) -> bool:
    """Whether a signal of this name is a number of the wheel: one of another unit is a law's."""
    return name not in UNITS or unit(s.unit).same(unit(UNITS[name]))


def with_keys(block: Block, gains: Collection[str]) -> Block:
    """The control of a vehicle that tells of a number of the file where it stands there.

    Args:
        block: the control, its numbers set.
        gains: names of the law's own numbers that the file gives.
    """
    found: dict[str, str] = {}
    for name, s in block.params.items():
        last = name.rpartition(".")[2]
        if s.derived or name.startswith("estimator."):
            continue
        if last in SAMPLE_TIMES and s.unit == "s":
            found[name] = "[control] period"
        elif last in KEYS and of_the_wheel(s, last):
            found[name] = KEYS[last]
        elif last in gains and name.startswith("law."):
            found[name] = "gains of the controller"
    made = block.with_sources({n: f"the vehicle's file, {key}" for n, key in found.items()})
    rebuild = block.composition.rebuild
    if rebuild is None:
        return made
    return made.with_rebuild(lambda *parts: with_keys(rebuild(*parts), gains))
