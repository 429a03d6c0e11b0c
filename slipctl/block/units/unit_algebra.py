"""Units as algebra: parse them, compare them, and check the equations that use them.

A unit is a scale and exponents of SI base units, so km/h and m/s have one dimension and are two
units. Angles are pure numbers: rad is 1.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from fractions import Fraction
from functools import lru_cache
from typing import Any, NoReturn

from slipctl.block.units.unit_names import (
    ONE_IN,
    PLAIN,
    PREFIXED,
    REFUSED,
    SPOKEN,
    Dims,
    dims_of,
    unit_by_name,
)  # fmt: skip
from slipctl.errors import BadInput, nearest

_ONE = "one["
"""How the symbol of a hidden unit constant begins."""


@dataclass(frozen=True)
class Unit:
    """A unit: ``scale`` times a product of SI base units.

    Attributes:
        scale: how many of the SI unit it is; 1000/3600 for km/h.
        dims: exponents of ``kg, m, s, A, K, mol, cd``.
        names: the same as written, ``(("N", 1), ("m", 1))``; empty where it came from algebra.
    """

    scale: float
    dims: Dims
    names: Dims = field(default=(), compare=False)

    def __mul__(self, other: Unit) -> Unit:
        return Unit(self.scale * other.scale, _add(self.dims, other.dims, 1))

    def __truediv__(self, other: Unit) -> Unit:
        return Unit(self.scale / other.scale, _add(self.dims, other.dims, -1))

    def __pow__(self, exponent: Fraction | int) -> Unit:
        dims = tuple((n, e * exponent) for n, e in self.dims if exponent)
        return Unit(float(self.scale**exponent), dims)

    def same(self, other: Unit) -> bool:
        """Whether both are one unit: N m and J are, km/h and m/s are not."""
        return self.dims == other.dims and math.isclose(self.scale, other.scale, rel_tol=1e-9)

    @property
    def plain(self) -> bool:
        """Whether it is the pure number 1."""
        return not self.dims and math.isclose(self.scale, 1.0, rel_tol=1e-9)

    def __str__(self) -> str:
        return _written(self.names) if self.names else _composed(self)


def _add(a: Dims, b: Dims, sign: int) -> Dims:
    total = dict(a)
    for name, exponent in b:
        total[name] = total.get(name, Fraction(0)) + sign * exponent
    return tuple(sorted((n, e) for n, e in total.items() if e))


# ---- parsing ----------------------------------------------------------------------------------


_TOKEN = re.compile(
    r"\s*(?:(?P<number>[+-]?(?:\d+\.?\d*|\.\d+))|(?P<name>[^\W\d_]+(?:_[^\W\d_]+)*|[%‰°])"
    r"|(?P<op>\*\*|[*/^()]))"
)
_SIGNS = str.maketrans({"·": "*", "⋅": "*", "×": "*", "−": "-", "μ": "µ"})
_RAISED = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻·", "0123456789-.")


@lru_cache(maxsize=4096)
def unit(text: str) -> Unit:
    """Read a unit: ``"N m"``, ``"m/s^2"``, ``"kg m2"``, ``"m^.5/s^1.5"``, ``"1"``.

    A blank between names multiplies; after a slash it would be ambiguous and is refused.

    Raises:
        BadInput: unknown name, a constant or an offset scale (degC) in place of a unit, bad syntax.
    """
    if not isinstance(text, str):
        raise BadInput(f"a unit is a text such as 'm/s^2', not {text!r}")
    text = SPOKEN.get(text.strip(), text)
    if offset := re.search(r"°\s*[CFRK]\b", text):
        raise BadInput(f"unit {text!r} has {offset[0]}, a scale with an offset; write K")
    try:
        found = _Reader(text).read()
    except OverflowError:
        found = None
    if found is None or not 1e-150 < found.scale < 1e150:
        raise BadInput(f"unit {text!r} is beyond what a number can hold")
    return found


def read_unit(where: str, text: str) -> Unit:
    """Read the unit of what stands in ``where``.

    Raises:
        BadInput: as of :func:`unit`, with the place.
    """
    try:
        return unit(text)
    except BadInput as error:
        raise BadInput(f"{where}: {error}") from None


class _Reader:
    """Recursive descent over the tokens of one unit."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.tokens: list[tuple[str, str]] = []
        clean = re.sub(
            "[⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+", lambda m: "^" + m[0].translate(_RAISED), text.translate(_SIGNS)
        )
        at, clean = 0, clean.rstrip()
        while at < len(clean):
            match = _TOKEN.match(clean, at)
            if match is None or match.lastgroup is None:
                self.fail(f"{clean[at:].strip()[:1]!r} has no place in a unit")
            self.tokens.append((match.lastgroup, match[match.lastgroup]))
            at = match.end()
        if not self.tokens:
            self.fail("a pure number has the unit '1'")
        if len(self.tokens) > 200:
            self.fail("it is too long")

    def fail(self, why: str) -> NoReturn:
        shown = self.text if len(self.text) <= 40 else self.text[:37] + "..."
        raise BadInput(f"unit {shown!r} cannot be read: {why}")

    def unknown(self, name: str) -> NoReturn:
        close = nearest(name, [*PLAIN, *PREFIXED, *_USUAL])
        close = close if "mean" in close else ""
        if two := re.fullmatch("([kM]?N)(s|m)", name):
            close = f"; write '{two[1]} {two[2]}'"
        self.fail(f"{_cut(name)!r} is no known unit{close}")

    def peek(self) -> str:
        return self.tokens[0][1] if self.tokens else ""

    def read(self) -> Unit:
        value = self.product()
        if self.tokens:
            self.fail(f"{self.peek()!r} has no place there")
        return value

    def product(self) -> Unit:
        value, divided = self.power(), False
        while self.tokens and self.peek() != ")":
            op = self.peek()
            if op in ("*", "/"):
                self.tokens.pop(0)
                divided = op == "/"
            elif divided:
                self.fail(
                    f"write 1/(a b) or a b/c; what the blank before {op!r} multiplies is open"
                )
            factor = self.power()
            sign = -1 if op == "/" else 1
            both = value / factor if op == "/" else value * factor
            value = Unit(both.scale, both.dims, _add(value.names, factor.names, sign))
        return value

    def power(self) -> Unit:
        kind, token = self.tokens.pop(0) if self.tokens else ("", "")
        if token == "(":
            value = self.product()
            if self.peek() != ")":
                self.fail("a bracket is not closed")
            self.tokens.pop(0)
        elif kind == "name":
            value = self.named(token)
            if self.tokens and self.tokens[0][0] == "number":
                return self.raised(value)  # kg m2
        elif kind == "number":
            if float(token) != 1.0:
                self.fail(f"the number {token} has no place in a unit")
            value = Unit(1.0, ())
        else:
            self.fail(f"a name is missing {f'before {token!r}' if token else 'at its end'}")
        if self.peek() in ("^", "**"):
            self.tokens.pop(0)
            return self.raised(value)
        return value

    def raised(self, value: Unit) -> Unit:
        bracket = self.peek() == "("
        if bracket:
            self.tokens.pop(0)
        kind, token = self.tokens.pop(0) if self.tokens else ("", "")
        if kind != "number":
            self.fail("an exponent must be a number")
        exponent = Fraction(token)
        if bracket:
            if self.peek() == "/":
                self.tokens.pop(0)
                below = self.tokens.pop(0)[1] if self.tokens else ""
                if not re.fullmatch(r"[1-9]\d?", below):
                    self.fail("an exponent must be a number")
                exponent /= int(below)
            if self.peek() != ")":
                self.fail("a bracket is not closed")
            self.tokens.pop(0)
        if abs(exponent) > 99 or exponent.denominator > 1000:
            self.fail(f"the exponent {token} is beyond reason")
        power = value**exponent
        return Unit(
            power.scale, power.dims, tuple((n, e * exponent) for n, e in value.names if exponent)
        )

    def named(self, name: str) -> Unit:
        names: Dims = ((name, Fraction(1)),)
        if match := re.fullmatch(r"([mkM]?N)m", name):
            force, metre = self.named(match[1]), self.named("m")
            both = force * metre
            return Unit(both.scale, both.dims, _add(force.names, metre.names, 1))
        if name in REFUSED:
            self.fail(REFUSED[name])
        scale, dims = unit_by_name(name) or self.unknown(name)
        return Unit(scale, dims, names)


def dimension_equal(first: str, second: str) -> bool:
    """Whether two units measure the same kind of quantity: km/h and m/s do.

    Raises:
        BadInput: one of them cannot be read.
    """
    return first == second or unit(first).dims == unit(second).dims


def factor(source: str, target: str) -> float:
    """Number that turns a value in ``source`` into one in ``target``: 1000/3600 for km/h to m/s.

    Raises:
        BadInput: different dimensions, a unit that cannot be read, or a count per minute or in Hz
            for an angular speed.
    """
    a, b = unit(source), unit(target)
    if a.dims != b.dims:
        raise BadInput(f"{source} cannot be turned into {target}: the dimensions differ")
    if "rad" in target:
        refuse_count(source)
    return 1.0 if a.same(b) else float(_ratio(a, b))


def refuse_count(text: str) -> None:
    """Refuse a rate of which nobody can tell whether it counts revolutions or radians.

    Raises:
        BadInput: 1/min, Hz and the like, without rad, deg or rpm.
    """
    text = SPOKEN.get(text.strip(), text)
    if _counts(text) and ("Hz" in text or not unit(text).same(unit("1/s"))):
        raise BadInput(f"{text} may count revolutions or radians; write rpm, turn/s or rad/s")


def _counts(text: str) -> bool:
    """Whether a unit is a rate that does not say what it counts."""
    return unit(text).dims == dims_of(s=-1) and not re.search(r"rad|deg|turn|rpm|revol|°", text)


def says_what_counts(text: str, said: str) -> bool:
    """Whether ``said`` tells what a rate counts, in the same time: rpm or rad/min for 1/min."""
    text, said = (SPOKEN.get(t.strip(), t) for t in (text, said))
    if not _counts(text) or _counts(said) or unit(said).dims != unit(text).dims:
        return False
    ratio = unit(said).scale / unit(text).scale
    return any(math.isclose(ratio, one, rel_tol=1e-12) for one in (1.0, 2 * math.pi))


def _ratio(a: Unit, b: Unit) -> Fraction:
    """Ratio of the scales, exact where a short fraction is what was meant."""
    ratio = a.scale / b.scale
    short = Fraction(max(ratio, 1 / ratio)).limit_denominator(10**6)
    if ratio < 1.0:
        short = 1 / short
    if math.isclose(short, ratio, rel_tol=4e-16):
        return short
    return Fraction(ratio)


def display_scale(unit: str) -> tuple[float, str]:
    """Factor and unit in which a quantity is shown: forces in kN and torques in kN m."""
    return (1e-3, f"k{unit}") if unit in ("N", "N m", "N m/s", "N/s") else (1.0, unit)


_QUANTITY = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?)\s*(.*)", re.DOTALL)


def parse_quantity(text: str, wanted: str, where: str = "") -> float:
    """Read ``"8.2t"``, ``"20 km/h"`` or ``"8200"`` as a number in the wanted unit.

    A pure number may be a gradient, ``"1 in 25"``.

    Args:
        text: number and unit; a plain number is in the wanted unit already.
        wanted: declared unit, ``"kg"``.
        where: name of what takes it (``"car.m"``), for the message.

    Raises:
        BadInput: one line: no number, unknown unit, another dimension.
    """
    name = f"{where} " if where else ""
    text = str(text).replace("−", "-")
    if (ratio := ONE_IN.fullmatch(text)) and not unit(wanted).dims:
        if not float(ratio[2]):
            raise BadInput(f"{name}[{wanted}]: {_cut(text)!r} is no gradient; write '1 in 25'")
        return float(f"{ratio[1]}1") / float(ratio[2]) / unit(wanted).scale
    match = _QUANTITY.fullmatch(text)
    if match is None:
        raise BadInput(
            f"{name}[{wanted}]: {_cut(text)!r} is no number"
            + ("" if wanted == "1" else f" with a unit, such as '8.2 {wanted}'")
        )
    number, given = match[1], match[2].strip()
    if re.match(r"[,_'\d.eE+-]", given) and not re.match(r"[eE][^\W\d]|1\s*/\s*\(?[^\W\d]", given):
        hint = "; write a point for a comma" if given.startswith(",") else ""
        raise BadInput(f"{name}[{wanted}]: {_cut(text)!r} is no number with a unit{hint}")
    target = unit(wanted)
    value = float(number)
    if not math.isfinite(value):
        raise BadInput(f"{name}[{wanted}]: {_cut(text)!r} is too large a number")
    if not given:
        return value
    try:
        source = unit(given)
        if "rad" in wanted:
            refuse_count(given)
    except BadInput as error:
        raise BadInput(f"{name}[{wanted}]: {error}") from None
    if source.dims != target.dims:
        raise BadInput(
            f"{name}[{wanted}] cannot be {_cut(text)!r}: [{_composed(source)}] is another"
            f" dimension; write for instance '{number}{'' if wanted == '1' else f' {wanted}'}'"
        )
    return float(Fraction(repr(value)) * _ratio(source, target))


def split_quantity(text: str) -> tuple[str, str | None]:
    """Split ``"8.2 t"`` into number and unit; the unit is None where there is none.

    Raises:
        BadInput: no number in front.
    """
    match = _QUANTITY.fullmatch(text.replace("−", "-"))
    if match is None:
        raise BadInput(f"{_cut(text)!r} is no number with a unit, such as '8.2 kg'")
    return match[1], match[2].strip() or None


def read_range(first: str, last: str, wanted: str, where: str) -> tuple[float, float]:
    """Both ends of a range in the wanted unit; where one has a unit, the other needs it too.

    Plain numbers are in the wanted unit already. An end without a unit beside one that has it,
    ``34:42t``, could be 34 kg or 34 t. Only 0 is the same in both.

    Args:
        first, last: the ends, ``"34t"`` and ``"42t"``.
        wanted: declared unit, ``"kg"``.
        where: what takes them, for the message.

    Raises:
        BadInput: no number, an unknown unit, another dimension, a unit at one end alone.
    """
    ends = (parse_quantity(first, wanted, where), parse_quantity(last, wanted, where))
    units = [split_quantity(end)[1] for end in (first, last) if float(split_quantity(end)[0])]
    if len(units) == 2 and (units[0] is None) != (units[1] is None):
        bare, unit = (first, units[1]) if units[0] is None else (last, units[0])
        raise BadInput(
            f"{where}: {first.strip()}:{last.strip()} has a unit at one end; write '{bare.strip()}"
            f" {unit}' or '{bare.strip()} {wanted}'"
        )
    return ends


def si_text(text: str) -> str:
    """The SI unit of what a unit measures, ``"N"`` of kN; the unit itself where its scale is 1.

    Raises:
        BadInput: it cannot be read.
    """
    found = unit(text)
    return text if math.isclose(found.scale, 1.0, rel_tol=1e-12) else str(Unit(1.0, found.dims))


def _cut(text: str, limit: int = 40) -> str:
    return text if len(text) <= limit else text[: limit - 3] + "..."


# ---- rendering --------------------------------------------------------------------------------


def _exponent(e: Fraction) -> str:
    if e.denominator == 1:
        return str(e.numerator)
    text = repr(float(e))
    return f"({e})" if len(text) > 6 else text


def _written(names: Dims) -> str:
    """``(("N", 1), ("s", -2))`` as ``"N/s^2"``; names keep their order."""
    up = [n + ("" if e == 1 else f"^{_exponent(e)}") for n, e in names if e > 0]
    down = [n + ("" if e == -1 else f"^{_exponent(-e)}") for n, e in names if e < 0]
    if not up and not down:
        return "1"
    below = f"({' '.join(down)})" if len(down) > 1 else "".join(down)
    return (" ".join(up) or "1") + (f"/{below}" if down else "")


_USUAL = ("km", "mm", "t", "ms", "min", "h", "kN", "kW", "deg", "%")
_COMPOSED = ("N", "N m", "W", "Pa", "N/m", "N s", "N s/m", "N m s", "N m/s", "N/s", "V")


def _composed(u: Unit) -> str:
    """Shortest usual name of a unit that came out of algebra."""
    if not math.isclose(u.scale, 1.0, rel_tol=1e-9):
        for name in _USUAL:
            if unit(name).same(u):
                return name
        return f"{u.scale:g} {_composed(Unit(1.0, u.dims))}"
    for name in _COMPOSED:
        if u.dims == unit(name).dims:
            return name
    order = ("kg", "m", "A", "K", "mol", "cd", "s")
    return _written(tuple(sorted(u.dims, key=lambda d: order.index(d[0]) if d[0] in order else 9)))


# ---- units of equations -----------------------------------------------------------------------


_hidden: ContextVar[dict[str, tuple[Any, str]] | None] = ContextVar("_hidden", default=None)


@contextmanager
def checking_units() -> Iterator[dict[str, tuple[Any, str]]]:
    """Make :func:`one` return symbols that carry their unit; for bodies on SX symbols.

    Yields:
        The hidden unit constants met so far: (symbol, meaning) by unit.
    """
    found: dict[str, tuple[Any, str]] = {}
    token = _hidden.set(found)
    try:
        yield found
    finally:
        _hidden.reset(token)


def one(text: str, doc: str = "") -> Any:
    """Return the unit constant that an empirical formula hides.

    The curve resistance 600/R, in N/kN with R in m, is written ``600 * one("m N/kN") / R``. The
    constant is 1.0 wherever equations are computed, and carries its unit where they are checked.

    Args:
        text: the unit.
        doc: where it hides, for ``slipctl show``.
    """
    found = _hidden.get()
    if found is None:
        return 1.0
    if text not in found:
        import casadi as ca

        unit(text)
        found[text] = (ca.SX.sym(f"{_ONE}{text}]"), doc)
    return found[text][0]
