"""Numbers that the parts of a vehicle's slip control have in common: each is one parameter.

What follows from others, as the wheel speed at the start from speed and radius, is derived, so that
it follows where they are tuned in C. The period is that of the file. Windows and times between runs
were made of it and stand in the code, so it cannot be tuned beside them.
"""

from __future__ import annotations

from collections.abc import Mapping

from slipctl import Block
from slipctl.block.transforms.discretisation import SAMPLE_TIMES
from slipctl.models.common_form import Wheel
from slipctl.models.vehicle.parts import TICK, Air, Trip
from slipctl.models.vehicle.parts.file_keys import of_the_wheel
from slipctl.models.vehicle.ranges import derived_of_inputs

RADIUS = "r"
"""The number of a wheel of which each axle has its own."""

WHEEL = (RADIUS, "J", "g", "tau", "T_max", "m_axle")
"""Numbers of a wheel that have their name in every part."""

MOVED = ("law.m", "fall.m", "trust.m")
"""Masses that one wheel stops; that of the meter is the load on the rail."""


ALIKE = {"wake.v_off": "v_off", "safe.v_off": "v_off", "trust.fastest": "fastest",
         "trust.gate": "v_error", "trust.noise": "noise"}  # fmt: skip
"""Other numbers, by the place of each, and the name that they have together."""


def is_period(name: str, block: Block) -> bool:
    """Whether a parameter is the sample time of a part that runs in every tick."""
    s = block.params[name]
    known = not s.derived and s.unit == "s" and not name.startswith("estimator.")
    return known and name.rpartition(".")[2] in SAMPLE_TIMES


def numbers_of_each_wheel(block: Block) -> list[str]:
    """Parameters of a part of which each axle has its own: the radius, and what follows from it."""
    s = block.params.get(RADIUS)
    if s is None or s.derived or not of_the_wheel(s, RADIUS):
        return []
    return [RADIUS, *(n for n in ("omega_start",) if n in block.params)]


def common_numbers(trip: Trip, parts: Mapping[str, Block]) -> dict[str, list[str]]:
    """Shares of the control of a vehicle, for ``connect(..., share=)``, by its parts of all axles.

    A radius of all axles together is left apart: each axle has its own.
    """
    found: dict[str, list[str]] = {
        n: [] for n in (*WHEEL, "m", "period", "v_off", "v_start", *ALIKE.values())
    }
    follows = derived_of_inputs(trip)
    for part, block in parts.items():
        for name, s in block.params.items():
            last = name.rpartition(".")[2]
            place = f"{part}.{name}"
            if s.derived or part == "estimator" or place == "law.law.lead":
                continue
            if ALIKE.get(place) in follows:
                continue
            if is_period(name, block):
                found["period"].append(place)
            elif place in ALIKE or (last == "v_start" and s.unit == "m/s"):
                found[ALIKE.get(place, last)].append(place)
            elif not of_the_wheel(s, last):
                continue
            elif place in MOVED:
                found["m"].append(place)
            elif place == "meter.m":
                found["m_axle"].append(place)
            elif last in WHEEL and not (last == RADIUS and not s.shape):
                found[last].append(place)
    if isinstance(trip.actuator, Air):  # the bits explain the torque, so its model has no lag
        found["tau"] = [p for p in found["tau"] if p != "trust.tau"]
    if "law" in parts and "m_law" in parts["law"].params:
        found["m"] = [p for p in found["m"] if p != "law.m"]
    shares = {n: places for n, places in found.items() if places}
    if "period" in shares:
        shares[f"period = {trip.control.period!r}"] = shares.pop("period")
    if "v_error" in shares and trip.sensors.of_wheels:
        value = float(parts["trust"].params["gate"].value)
        shares[f"v_error = {value!r}"] = shares.pop("v_error")
    known = {f"{b}.{n}" for b, block in parts.items() for n, s in block.params.items()
             if not s.derived}  # fmt: skip
    return shares | {
        f"{name} = {text}": places
        for name, (text, wanted) in follows.items()
        if (places := [p for p in wanted if p in known])
    }


def numbers_of_wheel(block: Block, trip: Trip, w: Wheel) -> dict[str, float]:
    """What the file says of the common numbers that a control has."""
    own = {"J": w.J, RADIUS: w.r, "g": w.g, "tau": w.tau, "T_max": w.T_max, "m_axle": w.W, "m": w.m}
    found = {n: v for n, v in own.items() if n in block.params and not block.params[n].derived}
    if "law.m" in block.params:  # of a law that scales by the mass of its own, ``law.m_law``
        found["law.m"] = w.m
    if isinstance(trip.actuator, Air):
        found |= {"trust.tau": TICK, "trust.other": 0.15}
    return found
