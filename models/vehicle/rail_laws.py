"""Adhesion laws of a trip's rail: without its layer, under it, and between both."""

from __future__ import annotations

from collections.abc import Mapping

from slipctl import BadInput, Block, argmax
from slipctl.block.units.unit_algebra import parse_quantity
from slipctl.errors import Faults, nearest
from slipctl.models.vehicle.adhesion import law_faults
from slipctl.models.vehicle.parts import Contamination, Trip
from slipctl.models.vehicle.plant import on_train
from slipctl.models.wheel_rail.rail_memory import blended_law
from slipctl.study.resolve import load_block

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


def rail_law(trip: Trip) -> Block:
    """Adhesion law of the rail with its own conditions and those of the trip.

    Raises:
        Faults: no such law, parameters that it has not, conditions that nobody has.
    """
    track = trip.rail
    block = load_block(track.law)
    on_train(block)  # says what is wrong with it
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
