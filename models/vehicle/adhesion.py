"""Adhesion laws of a trip's rail, without its layer and under it, and what no adhesion law does.

A law opposes slip, is 0 at 0, and carries less than the load. One that pushes a wheel the way it
slips gives energy. One above 1 carries more than what presses the wheel on the rail; the step of
``slipctl.models.wheel_rail.axles`` brackets no root of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import lru_cache
from itertools import product
from typing import Any

import casadi as ca
import numpy as np

from slipctl import BadInput, Block, argmax, make_block
from slipctl.block.signals import Signal
from slipctl.block.units.unit_algebra import parse_quantity, split_quantity
from slipctl.errors import Faults, nearest
from slipctl.models.vehicle.parts import Contamination, Trip, Vehicle
from slipctl.models.vehicle.plant import on_train
from slipctl.models.wheel_rail.contact import law_of_wheel
from slipctl.models.wheel_rail.rail_memory import blended_law
from slipctl.study.files.declared_parts import Bare
from slipctl.study.resolve import load_block

BEYOND = 20.0
"""How much faster than the vehicle a driven wheel is looked at, in m/s."""

STEEP = 0.01
"""Adhesion at a slip of 1e-6 m/s that is a step: of laws by Hertz and Kalker it is below 1e-4."""

SPEEDS, SLIPS = 14, 600
"""How many speeds and slips a law is asked at, by equal shares; a quarter of the slips at a speed.
So many speeds again are by equal steps, where a row of a table by speed may be wrong."""

SLOWEST = 0.1
"""Speed in m/s down to which a law is asked: a braked vehicle comes to a stand."""

NOTHING = 1e-9
"""Adhesion that is none."""

SHARE = 1e-9
"""Of the largest adhesion, what is rounding."""


def law_faults(
    law: Block, conditions: Mapping[str, Mapping[str, float]], speed: float, driven: bool
) -> Iterator[tuple[str, str]]:
    """What no rail does, by the name of the condition: the first fault of each.

    Args:
        law: from ``v_s`` or ``lam`` to ``mu``, as the models have it.
        conditions: parameters of the law by the name of a condition; those that are used.
        speed: of the vehicle in m/s.
        driven: whether wheels may turn faster than the vehicle runs.
    """
    for name, rows in _rows_of_law(law, conditions, speed, driven):
        faults = [_fault(*row) or _beyond(law, row[1]) for row in rows]
        fault = next(filter(None, faults), "")
        # of each speed there are two rows, of slip forward and back
        none = [
            max(a.max(), b.max()) <= NOTHING
            for (_, a, _), (_, b, _) in zip(rows[::2], rows[1::2], strict=True)
        ]
        if not fault and any(none):
            where = "" if all(none) else ", but not at all speeds of the trip"
            fault = f"adhesion is 0 at all slips{where}; write a law that opposes slip"
        if fault:
            yield name, fault


def highest(law: Block, speed: float, driven: bool) -> float:
    """Largest adhesion of a law with its numbers as they stand, over the speeds of a trip."""
    ((_, rows),) = _rows_of_law(law, {"": {}}, speed, driven)
    return max(float(mu.max()) for _, mu, _ in rows)


def heights_of_law(law: Block, speed: float, driven: bool) -> dict[str, float]:
    """Largest adhesion of each condition of a law, over the slips and speeds of a trip."""
    found = _rows_of_law(law, law.conditions, speed, driven)
    return {name: max(float(mu.max()) for _, mu, _ in rows) for name, rows in found}


def _rows_of_law(
    law: Block, conditions: Mapping[str, Mapping[str, float]], speed: float, driven: bool
) -> Iterator[tuple[str, list[tuple[np.ndarray, np.ndarray, str]]]]:
    """Slips in m/s, adhesion seen against them, and at which speed, of each condition.

    A row by speed and direction.
    """
    train = on_train(law)
    curve, by_speed = law.of_equations("curve", lambda: _curve(train))
    top = max(speed, 1.0)
    speeds = np.array([top])
    if by_speed:
        speeds = np.union1d(np.geomspace(top, SLOWEST, SPEEDS), np.linspace(top, 1.0, SPEEDS))
    many = SLIPS // 4 if by_speed else SLIPS
    for name, values in conditions.items():
        known = train.param_values(**values)
        numbers = [known[n] for n in train.params]
        rows = []
        for at, side in product(speeds.tolist(), (1.0, -1.0)):
            # a braked wheel slips by the speed at most; and a ratio above 1 is no law's
            reach = at + BEYOND if driven and "lam" not in law.inputs else at
            slips = np.concatenate([[0.0], np.geomspace(1e-6, reach, many)])
            mu_of = np.array(curve(side * slips[None, :], at, *numbers))
            told = f" and a speed of {at:.3g} m/s" if by_speed else ""
            rows.append((slips, side * mu_of.ravel(), told))
        yield name, rows


def _curve(train: Block) -> tuple[ca.Function, bool]:
    """Adhesion over slip and speed in m/s and parameters, and whether the speed matters."""
    p = {n: ca.SX.sym(n.replace(".", "_"), *s.shape) for n, s in train.params.items()}
    s, v = ca.SX.sym("s"), ca.SX.sym("v")
    mu = train.expr({}, {"v_s": s, "v": v}, p)[1]["mu"]
    return ca.Function("curve", [s, v, *p.values()], [mu]), ca.depends_on(mu, v)


def _fault(slips: np.ndarray, mu: np.ndarray, told: str) -> str:
    """What is wrong with the adhesion at these slips, seen against the slip; empty if nothing."""
    if not np.isfinite(mu).all():
        at = int(np.flatnonzero(~np.isfinite(mu))[0])
        return (
            f"adhesion is no number at a slip of {slips[at]:.3g} m/s{told}; write a law that is 0"
            " at 0"
        )
    size = SHARE * max(float(abs(mu).max()), 1.0)
    if abs(mu[0]) > size or abs(mu[1]) > STEEP:
        found = mu[0] if abs(mu[0]) > size else mu[1]
        return f"adhesion is {found:.3g} without slip; write a law that is 0 at 0"
    if mu.min() < -size:
        at = int(np.flatnonzero(mu < 0.01 * mu.min())[0])
        return (
            f"adhesion is {mu[at]:.3g} at a slip of {slips[at]:.3g} m/s{told}, the wrong sign;"
            " write a law with the sign of the slip at all speeds of the trip"
        )
    if mu.max() > 1:
        at = int(np.flatnonzero(mu > 1)[0])
        percent = ", a coefficient in percent is written '30 %'" if mu.max() > 5 else ""
        return (
            f"adhesion is above 1 from a slip of {slips[at]:.3g} m/s{told} on, {mu.max():.3g} at"
            " most:"
            f" more than the load of the wheel{percent}; write a law below 1"
        )
    return ""


def _beyond(law: Block, mu: np.ndarray) -> str:
    """What is told where adhesion, seen against the slip, is above the range that its law has."""
    ends = abs(law.outputs["mu"].lo), abs(law.outputs["mu"].hi)
    if mu.max() > max(ends) * (1 + SHARE):
        return (
            f"adhesion is {mu.max():.3g} at most, and the law's own range ends at {max(ends):.3g};"
            " write a wider range or a lower law"
        )
    return ""


def rise_with_speed(law: Block, values: Mapping[str, float], speed: float) -> tuple[float, float]:
    """Largest adhesion of a law at any slip, at a quarter of a speed in m/s and at that speed."""
    train = on_train(law)
    curve, _ = law.of_equations("curve", lambda: _curve(train))
    known = train.param_values(**values)
    slips = np.geomspace(1e-4, speed, SLIPS)[None, :]
    slow, fast = (
        float(np.array(curve(slips, v, *(known[n] for n in train.params))).max())
        for v in (speed / 4, speed)
    )
    return slow, fast


# ---- of a trip ----------------------------------------------------------------------------------

WHERE = "rail.contamination"


def numbers_of(block: Block, given: Mapping[str, float | str], where: str) -> dict[str, float]:
    """Numbers of a block's parameters, with their units where they are texts.

    Raises:
        Faults: unknown or derived parameters, another dimension, values off range.
    """
    found, faults = {}, []
    for name, value in given.items():
        hits = [k for k in block.params if k == name or k.endswith(f".{name}")]
        if len(hits) != 1:
            free = [k for k, s in block.params.items() if not s.derived]
            unknown = f" {block.name} has no parameter of this name{nearest(name, free)}"
            why = f" could be {' or '.join(hits)}" if hits else unknown
            faults.append(f"{where}.{name}:{why}")
            continue
        try:
            signal = block._settable(hits[0])
            number = value
            if isinstance(value, str):
                number = parse_quantity(value, signal.unit, f"{where}.{name}")
            signal.check(f"{where}.{name}", number)
            found[hits[0]] = float(number)
        except BadInput as error:
            faults.append(str(error))
    if faults:
        raise Faults(faults)
    return found


def without_unit(
    params: Mapping[str, Signal], given: Mapping[str, float | str], where: str
) -> Iterator[str]:
    """Numbers of a file that have no unit and whose parameters have one, a line each."""
    for name, value in given.items():
        bare = split_quantity(value)[1] is None if isinstance(value, str) else (
            isinstance(value, Bare))  # fmt: skip
        units = {s.unit for k, s in params.items() if k == name or k.endswith(f".{name}")}
        if bare and len(units) == 1 and units != {"1"}:
            told = f"{float(value):g} {units.pop()}"
            yield f"{where}.{name}: {value} has no unit; it is read as {told}, write '{told}'"


def rail_law(trip: Trip) -> Block:
    """Adhesion law of the rail with its own conditions and those of the trip.

    Raises:
        Faults: no such law, parameters that it has not, conditions that nobody has.
    """
    track = trip.rail
    block = load_block(track.law)
    on_train(block)  # says what is wrong with it
    own = {n for values in track.conditions.values() for n in values}
    block = _on_own_wheels(block, trip.vehicle, own)
    known = {k: dict(v) for k, v in block.conditions.items()} | {c: {} for c in track.conditions}
    faults: list[str] = []
    for name, values in track.conditions.items():
        try:
            own = block.conditions.get(name, {})
            known[name] = {**own, **numbers_of(block, values, f"rail.conditions.{name}")}
        except Faults as error:
            faults += error.lines
    for k, stretch in enumerate(track.sections):
        if stretch.condition not in known:
            faults.append(
                f"rail.sections.{k}.condition: the rail has no condition {stretch.condition!r}"
                f"{nearest(stretch.condition, known)}; {stretch.condition} = {{}} under"
                f" [rail.conditions] is the law as it stands"
            )
    if faults:
        raise Faults(faults)
    used = dict.fromkeys(s.condition for s in track.sections)
    # what one condition sets is set in all, so that none keeps what the one before left
    names = dict.fromkeys(n for c in used for n in known[c])
    whole = {n: float(block.params[n].value) for n in names}
    vehicle, conditions = trip.vehicle, {c: whole | known[c] for c in used}
    wrong = law_faults(block, conditions, vehicle.speed, vehicle.mode == "drive")
    faults = [
        f"rail.conditions.{c}: {why}" if c in track.conditions else f"rail.law: on {c}, {why}"
        for c, why in wrong
    ]
    if faults:
        raise Faults(faults)
    return block.with_conditions(**conditions)


def _on_own_wheels(block: Block, vehicle: Vehicle, given: set[str]) -> Block:
    """Law with the patch of this vehicle's wheels, where it has one and the file gives none of it.

    Cars whose axles carry unlike loads have no such patch in common.
    """
    if given & {"Q", "a", "b", "c11"} or len(set(vehicle.carried)) > 1:
        return block
    load = vehicle.carried[0] * vehicle.gravity / 2
    return law_of_wheel(block, load, vehicle.wheel_radius, 2 * vehicle.axles)


def layer_law(trip: Trip, part: Contamination) -> Block:
    """Law under the layer, as a train takes it, with its own numbers.

    Raises:
        Faults: no such law or condition, parameters that it has not, what no rail does.
    """
    try:
        block = load_block(part.law or trip.rail.law)
        on_train(block)  # says what is wrong with it
    except BadInput as error:
        raise Faults([f"{WHERE}.law: {error}"]) from None
    values: dict[str, float] = {}
    if part.condition:
        if part.condition not in block.conditions:
            raise Faults(
                [
                    f"{WHERE}.condition: {block.name} has no condition {part.condition!r}"
                    f"{nearest(part.condition, block.conditions)}"
                ]
            )
        values |= block.conditions[part.condition]
    block = _on_own_wheels(block, trip.vehicle, set(part.numbers))
    values |= numbers_of(block, part.numbers, f"{WHERE}.numbers")
    driven = trip.vehicle.mode == "drive"
    wrong = list(law_faults(block, {"layer": values}, trip.vehicle.speed, driven))
    if wrong:
        raise Faults([f"{WHERE}.law: {why}" for _, why in wrong])
    return on_train(block.with_params(**values))


def peak_of_layer(law: Block, speed: float) -> float:
    """Largest adhesion of a law as a train takes it, at a speed in m/s of 1 at least."""
    v = max(speed, 1.0)
    return float(argmax(law, "v_s", "mu", lo=1e-4, hi=max(10.0, v), at={"v": v}).value)


def contaminated_law(trip: Trip, clean: Block) -> Block:
    """Law of the rail: between the layer and what is under it, where the trip has a layer.

    Args:
        trip: the trip.
        clean: law of its rail, with its conditions.
    """
    part = trip.rail.contamination
    return clean if part is None else blended_law(layer_law(trip, part), on_train(clean))


@lru_cache(maxsize=8)
def odd_law(curve: Block) -> Block:
    """Law from a slip of one sign, made odd in it: what exponentials do below 0 is no adhesion.

    The size of the slip is written so that the slope at 0 is the law's own, which a plan needs. An
    interval of it has no sign.

    Args:
        curve: law from ``v_s``.
    """

    def body(x: Any, u: Any, p: Any) -> Any:
        s = u["v_s"]
        found = curve.expr({}, {"v_s": ca.fmax(s, 0) + ca.fmax(0, -s)}, p)[1]
        side = ca.if_else(s >= 0, 1, -1)
        return {}, {n: side * value for n, value in found.items()}

    data = curve.law_data
    return make_block(
        curve.name, "law", body, inputs=list(curve.inputs.values()),
        params=list(curve.params.values()), outputs=list(curve.outputs.values()), sx=curve.sx,
        conditions=curve.conditions, closed_form=data.closed_form, coordinates=data.coordinates,
        measured_to=data.measured_to, meant_to=data.meant_to, choices=curve.choices,
        doc=f"{curve.doc}\n\nOdd in the slip.",
    )  # fmt: skip
