"""Numbers of ``certify --set`` as a person writes them, read as exact rationals in SI."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from fractions import Fraction

from slipctl.block.units.unit_algebra import unit
from slipctl.certify.systems import System
from slipctl.errors import BadInput, check_known

NUMBER = re.compile(
    r"([+-]?\d{1,60}/\d{1,60}|[+-]?(?:\d{1,60}(?:\.\d{0,60})?|\.\d{1,60})(?:[eE][+-]?\d{1,2})?)(.*)"
)


def read_numbers(system: System, settings: Sequence[str]) -> dict[str, Fraction]:
    """Numbers of ``k1=1.5`` or ``k1=1.5m^.5/s^1.5`` as exact rationals in SI.

    Without any unit all are in SI. Where one has its unit, each one with a dimension needs its own.

    Raises:
        BadInput: an unknown, repeated or missing name, no number, a wrong or missing unit.
    """
    found: dict[str, Fraction] = {}
    bare: list[str] = []
    told = False
    for text in settings:
        name, equals, value = text.partition("=")
        if not equals:
            first = next(iter(system.numbers))
            raise BadInput(f"--set {text}: write NAME=VALUE, {first}=1.5")
        check_known(f"{system.name} has no", name, system.numbers)
        if name in found:
            raise BadInput(f"--set names {name} twice; write it once")
        wanted = system.numbers[name].unit
        match = NUMBER.fullmatch(value)
        if not match or re.search(r"/0+$", match[1]) or match[2][:1].isdigit():
            raise BadInput(f"{name}={value} is no finite number; write one in {wanted}, {name}=1.5")
        found[name] = Fraction(match[1])
        written = match[2].strip()
        if written:
            found[name] *= _scale(name, written, wanted)
            told = True
        elif wanted != "1":
            bare.append(name)
    if told and bare:
        raise BadInput(
            f"{bare[0]} has no unit and others have one; write {bare[0]} in"
            f" {system.numbers[bare[0]].unit} with its unit, or leave out all units (SI)"
        )
    return found


def _scale(name: str, written: str, wanted: str) -> Fraction:
    """How many SI units one unit as written is."""
    text = "1" + written if written.startswith("/") else written
    given, target = unit(text), unit(wanted)
    if given.dims != target.dims:
        raise BadInput(f"{name} is in {wanted}, not in {text}")
    ratio = given.scale / target.scale
    short = Fraction(ratio).limit_denominator(10**9)
    return short if math.isclose(short, ratio, rel_tol=1e-15) else Fraction(ratio)
