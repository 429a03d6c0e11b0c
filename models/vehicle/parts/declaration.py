"""How a part of a file is declared: numbers with unit and range, and what it refuses."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, field, fields
from typing import Any

import numpy as np

from slipctl import BadInput
from slipctl.block.units.unit_algebra import parse_quantity, split_quantity
from slipctl.block.units.unit_algebra import unit as unit_of
from slipctl.errors import check_kinds

Fault = tuple[str, str]
"""A path such as ``"rail.sections.1"`` and what is wrong there."""


def number(
    unit: str, value: Any = MISSING, doc: str = "", *, lo: float = -math.inf, hi: float = math.inf,
    by: str = "", key: str = "", instead_of: tuple[str, ...] = (), needs: tuple[str, ...] = (),
) -> Any:  # fmt: skip
    """Declare a number of a part, or a list of them; without ``value`` it must be given.

    With ``by`` it may be told by another quantity too, ``by="kg"`` takes N/kg for N; see ``Each``.
    ``key`` is its name in a file, where Python has no such name. A file has none of the keys
    ``instead_of`` beside it. Without each of ``needs`` it has no effect.

    Raises:
        BadInput: unit and value are swapped, a value that is no number or is outside its range.
    """
    if any(isinstance(x, bool) or not isinstance(x, (int, float)) for x in (lo, hi)) or not lo < hi:
        raise BadInput(f"number({unit!r}, ...): lo {lo!r} and hi {hi!r} are no range")
    if not isinstance(unit, str) or isinstance(value, str) or not isinstance(doc, str):
        raise BadInput(f"number({unit!r}, {value!r}, ...): write the unit, the number, and what it"
                       " means, number('s', 0.02, 'lag')")  # fmt: skip
    for one in value if isinstance(value, (tuple, list)) else (value,):
        none = one is MISSING or one is None
        if why := "" if none else off_range(one, {"unit": unit, "lo": lo, "hi": hi}):
            raise BadInput(f"number({unit!r}, {one!r}, ...): {why}")
    meta = {"unit": unit, "doc": doc, "lo": lo, "hi": hi} | ({"by": by} if by else {})
    meta |= {"key": key} if key else {}
    meta |= {"instead_of": instead_of} if instead_of else {}
    meta |= {"needs": needs} if needs else {}
    return field(default=value, metadata=meta)


def text_field(
    value: Any, doc: str, instead_of: tuple[str, ...] = (), needs: tuple[str, ...] = ()
) -> Any:
    """Declare what is no number, with its meaning; ``instead_of`` and ``needs`` as of a number."""
    meta = {"doc": doc} | ({"instead_of": instead_of} if instead_of else {})
    meta |= {"needs": needs} if needs else {}
    if isinstance(value, (dict, list)):
        return field(default_factory=lambda: type(value)(value), metadata=meta)
    return field(default=value, metadata=meta)


def off_range(value: float, meta: Mapping[str, Any]) -> str:
    """What is wrong with a number of a field, in words; empty where nothing is."""
    unit = "" if meta["unit"] == "1" else f" {meta['unit']}"
    if isinstance(value, bool) or not isinstance(value, (int, float, np.floating)):
        return f"{value!r} is no number{f' in{unit}' if unit else ''}"
    if not math.isfinite(value):
        return f"{value:g}{unit} is not finite"
    if not meta["lo"] <= value <= meta["hi"]:
        return f"{value:g}{unit} is outside {meta['lo']:g} .. {meta['hi']:g}{unit}"
    return ""


STANDSTILL = "standstill"
"""What ends a trip when the vehicle has stopped."""


def size_of(text: str) -> float | None:
    """Number of a text in SI, whatever it is of; None where it is none."""
    try:
        value, name = split_quantity(text.strip())
        return float(value) * (unit_of(name).scale if name else 1.0)
    except (BadInput, ValueError):
        return None


def number_with_unit(text: str, *units: str) -> tuple[float, str] | str:
    """Positive number in one of some units, with that unit; or what is wrong with the text."""
    bare = text.strip()[-1:]
    for unit in units if bare.isalpha() else ():
        try:
            value = parse_quantity(text, unit)
        except BadInput:
            continue
        if math.isfinite(value) and value > 0:
            return value, unit
        return f"is {text!r}, which is not above 0"
    return f"is {text!r}; write a number in {' or '.join(units)}, such as '12 {units[0]}'"


def torque_of(given: str | float) -> float | str:
    """Torque in N m from 0 on, of a number or a text with its unit; or what is wrong with it."""
    if not isinstance(given, str):
        return float(given)
    try:
        value = parse_quantity(given, "N m")
    except BadInput as error:
        return str(error)
    return value if 0 <= value <= 1e6 else f"{value:g} N m is outside 0 .. 1e6 N m"


class Part:
    """A part; it refuses another kind than declared, numbers off range, and what does not fit."""

    def __post_init__(self) -> None:
        given = {f.name: value for f in fields(self)  # type: ignore[arg-type]
                 if (value := getattr(self, f.name)) is not f.default}  # fmt: skip
        check_kinds(type(self).__name__, type(self), given)
        for f in fields(self):  # type: ignore[arg-type]
            if isinstance(given.get(f.name), list) and "tuple[" in f.type:
                object.__setattr__(self, f.name, tuple(given[f.name]))
        self.complete()
        for path, text in self.wrong():
            raise BadInput(f"{type(self).__name__}: {path}: {text}" if path else text)

    def complete(self) -> None:
        """Fill what follows from other fields; a part that has nothing of this kind leaves it."""

    def wrong(self) -> Iterator[Fault]:
        """Everything that is wrong with the part itself, its parts left out."""
        for f in fields(self):  # type: ignore[arg-type]
            value = getattr(self, f.name)
            if "unit" in f.metadata and value is not None:
                many = value if isinstance(value, (list, tuple)) else [value]
                for k, one in enumerate(many):
                    text = off_range(one, f.metadata)
                    if text:
                        yield f.name if many is not value else f"{f.name}.{k}", text
        yield from self.misfits()

    def misfits(self) -> Iterator[Fault]:
        """What does not fit together."""
        return iter(())


TICK = 1e-3
"""Sample time of a trip in s; that of ``slipctl.models.common_form``."""


def faults_off_ticks(name: str, value: float) -> Iterator[Fault]:
    """A time that would be rounded."""
    ticks = value / TICK
    if abs(ticks - round(ticks)) > 1e-6:
        low, high = int(ticks), int(ticks) + 1
        yield (
            name,
            (
                f"{1e3 * value:g} ms is no whole number of samples of {1e3 * TICK:g} ms; write"
                f" '{1e3 * TICK * low:g} ms' or '{1e3 * TICK * high:g} ms'"
            ),
        )
