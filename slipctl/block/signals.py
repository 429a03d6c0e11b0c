"""Signals: what a name in an equation means: unit, value, range, sign convention, source."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import Any, ClassVar, NamedTuple

import numpy as np

from slipctl.block.text.named_expressions import names_in
from slipctl.errors import (
    BadInput,
    check_known,
    check_number,
    check_texts,
    check_whole,
    refuse_unknown_choice,
    value_text,
)


class Split(NamedTuple):
    """How the tick of a step is made in two: what can be done before its inputs, and the rest.

    Attributes:
        only: state that is 1 where it is to prepare, and no more.
        prepared: state that is above 0 where the next tick is prepared.
        inputs: those that preparing reads.
        ahead: states that preparing makes, and the rest leaves as they are.
    """

    only: str
    prepared: str
    inputs: tuple[str, ...]
    ahead: tuple[str, ...]


End = float | str | tuple[float | str, ...]
"""An end of a range: a number, an expression, or a number and expressions that all hold."""

KINDS = ("int", "bool", "enum")
"""What stands in the place of a unit where a signal is a whole number, true or not, or a choice."""


@dataclass(frozen=True)
class Bound:
    """An end of a range, a largest change per tick, or its noise, that follows parameters.

    Attributes:
        what: ``"lo"``, ``"hi"``, ``"change"`` or ``"noise"``.
        expression: of the block that declares it, ``"v_max / r"``.
        home: the signal that declares it, with the path of its part; empty for the signal itself.
    """

    what: str
    expression: str
    home: str = ""


@dataclass(frozen=True)
class Signal:
    """One named quantity of a block.

    Attributes:
        role: ``"state"``, ``"input"``, ``"param"`` or ``"output"``.
        unit: unit as text, ``"kg m^2"``; ``"1"`` for a pure number.
        value: start value of a state, value of a parameter, value of an input left unwired.
            A string is an expression of the block's other signals (``"v / r"``).
        doc: meaning in words.
        source: where the number comes from.
        lo, hi: range; parameters and start values outside are refused, and the C code guards it.
        shape: ``()`` scalar, ``(n,)`` vector, ``(n, m)`` matrix.
        positive: sign convention, ``"braking"`` or ``"traction"``.
        per: slip convention, ``"speed"`` or ``"ratio"``.
        noise: the scenario fills this input with unit normal numbers.
        name: the name in the equations; set by the block.
        axis: what the last index of the shape counts, ``"axle"``; set by ``replicate``.
        safe: what an output gives in generated C while a step is refused, each element of it; by
            default the value of the last good step.
        deviation: standard deviation of an estimator's start value, as an expression of its block,
            ``"sqrt(P)"``.
        change: largest change of an input from one tick to the next that can be true.
        jitter: what noise and steps of its sensor make of two samples of the same quantity, at
            most; beside ``change``, which grows with the time between them.
        bounds: ends and changes that follow parameters.
        stale: ticks in a row for which generated C goes on with the last good value of an input.
        truth: what an estimator's state estimates, an expression of names that the rest of the loop
            has, ``"v"``; one expression for each element.
        whole: whole numbers only.
        values: what 0, 1, 2, ... mean, ``("apply", "hold", "release")``; of a signal that is true
            or not ``("no", "yes")``.
        rising: each element of a parameter is above the one before: places of a table.
        over: parameter of these places, of one that holds the heights of a table there; of a
            matrix two, of its rows and of its columns.
        judged: the block judges this input itself, and is given whatever comes.
        size: number of elements.
        derived: whether the value is an expression of other signals.
    """

    role: str
    unit: str
    value: Any = None
    doc: str = ""
    source: str = ""
    lo: float = -math.inf
    hi: float = math.inf
    shape: tuple[int, ...] = ()
    positive: str | None = None
    per: str | None = None
    noise: bool = False
    name: str = ""
    axis: str = ""
    safe: float | None = None
    deviation: str = ""
    change: float = math.inf
    jitter: float = 0.0
    bounds: tuple[Bound, ...] = ()
    stale: int = 200
    truth: tuple[str, ...] = ()
    whole: bool = False
    values: tuple[str, ...] = ()
    rising: bool = False
    over: str | tuple[str, ...] = ""
    judged: bool = False
    size: int = field(init=False, repr=False, compare=False)
    derived: bool = field(init=False, repr=False, compare=False)
    declared: ClassVar[bool] = False
    """Whether a block has declared it, whose unit and own number are in order, under any name."""

    def __post_init__(self) -> None:
        if {*map(type, (self.role, self.doc, self.source, self.name, self.axis))} != {str}:
            check_texts("a signal", self, "role", "doc", "source", "name", "axis")
        if self.unit in KINDS:
            self._typed()
        for what, choice, choices in (
            ("role", self.role, ("state", "input", "param", "output")),
            ("sign convention", self.positive, ("braking", "traction")),
            ("slip convention", self.per, ("speed", "ratio")),
        ):
            if choice is not None:
                refuse_unknown_choice(self.name or self.doc or self.unit, what, choice, choices)
        where = self.name or self.doc or f"a {self.role}"
        for what, given in (("lo", self.lo), ("hi", self.hi), ("change", self.change),
                            ("noise", self.jitter)):  # fmt: skip
            if type(given) is not float:
                check_number(f"{where}: {what}", given, str(self.unit))
            if math.isnan(given):
                raise BadInput(f"{where}: {what} is NaN; give a number, or leave it out")
        if self.lo > self.hi:
            raise BadInput(f"{where}: its range has lo = {self.lo:g} above hi = {self.hi:g}")
        if not self.change > 0:
            raise BadInput(
                f"{where}: its largest change per tick is {self.change:g}; give a positive number"
            )
        if not 0 <= self.jitter < math.inf:
            raise BadInput(f"{where}: noise = {self.jitter:g} is no finite number from 0 on")
        if (self.jitter or self.bounds) and math.isinf(self.change):
            follows = {b.what for b in self.bounds}
            if "change" not in follows and (self.jitter or "noise" in follows):
                raise BadInput(
                    f"{where}: noise widens the limit on the change of a tick; give change, too"
                )
        if self.stale != 200:
            check_whole(f"{where}: stale", self.stale, 0)
        for b in self.bounds:
            names_in(b.expression)
        plain = isinstance(self.shape, tuple)
        if not plain or (self.shape and any(not isinstance(n, int) or n < 1 for n in self.shape)):
            raise BadInput(f"{where}: shape {self.shape} has an extent below 1; write (n,), (n, m)")
        check_whole(f"{where}: elements of shape {self.shape}", math.prod(self.shape), 1, 10**7)
        if self.rising and (len(self.shape) != 1 or self.shape[0] < 2):
            raise BadInput(f"{where}: places of a table have a shape (n,), n at least 2")
        self._take_value(where)

    def _take_value(self, where: str) -> None:
        """Check the value that the signal is made with, and note what is asked of it often."""
        self.__dict__["derived"] = isinstance(self.value, str)
        self.__dict__["size"] = math.prod(self.shape)
        if self.value is not None and not self.derived:
            self.finite(where, self.value)
            if isinstance(self.value, (list, np.ndarray)):
                self.__dict__["value"] = self.value.copy()  # whoever changes theirs later

    def _typed(self) -> None:
        """Make what is declared as ``int``, ``bool`` or ``enum`` a pure number with its range.

        Raises:
            BadInput: an enumeration without values, or with what is no name; values or a range
                where they do not belong; a name that is not among the values.
        """
        where = self.name or self.doc or f"a {self.role}"
        values = ("no", "yes") if self.unit == "bool" else tuple(self.values)
        change: dict[str, Any] = {"unit": "1", "whole": True, "values": values}
        if self.unit == "int":
            if values:
                raise BadInput(f'{where}: values are those of "enum"; declare it so')
        else:
            if self.unit == "bool" and self.values:
                raise BadInput(f'{where}: "bool" is no or yes; declare other values as "enum"')
            odd = [v for v in values if not (isinstance(v, str) and v.isidentifier())]
            if len(values) < 2 or odd or len(set(values)) < len(values):
                raise BadInput(
                    f"{where}: an enumeration has two names or more, each once; write"
                    ' values=("apply", "hold", "release")'
                )
            if self.lo != -math.inf or self.hi != math.inf or self.bounds:
                raise BadInput(f"{where}: its values are its range; leave out lo and hi")
            change |= {"lo": 0.0, "hi": len(values) - 1.0}
        self.__dict__.update(change)
        if isinstance(self.value, str) and values:
            self.__dict__["value"] = float(self.code(where, self.value))
        if self.safe is not None:
            self.__dict__["safe"] = float(self.finite(f"{where}: safe", self.safe))

    def code(self, where: str, name: str) -> int:
        """Return the number that the name of a value stands for.

        Raises:
            BadInput: it has no such value.
        """
        check_known(f"{where} has no value", name, self.values)
        return self.values.index(name)

    def named(self, name: str) -> Signal:
        """Return the same signal under another name."""
        same = object.__new__(Signal)  # all else has been checked
        same.__dict__.update(self.__dict__, name=name)
        return same

    def valued(self, value: Any) -> Signal:
        """Return the same signal with another value."""
        same = object.__new__(Signal)
        same.__dict__.update(self.__dict__, value=value, declared=False)
        same._take_value(self.name or self.doc or f"a {self.role}")
        return same

    def as_role(self, role: str, **changes: Any) -> Signal:
        """Return the same quantity in another role (an output becomes an input, say)."""
        kept = {
            "safe": self.safe if role == "output" else None,
            "change": self.change if role == "input" else math.inf,
            "jitter": self.jitter if role == "input" else 0.0,
            "bounds": tuple(b for b in self.bounds if b.what not in changes),
        }
        return replace(self, role=role, **{**kept, **changes})

    def moved(self, name: str, part: str = "") -> Signal:
        """Return the same signal as another block has it: under a name, in one of its parts.

        Its bounds go on speaking of the block that declares them.
        """
        same = self.named(name)
        if self.bounds:
            inside = f"{part}." if part else ""
            same.__dict__["bounds"] = tuple(
                replace(b, home=f"{inside}{b.home or self.name}") for b in self.bounds
            )
        return same

    @property
    def meanings(self) -> str:
        """What its numbers mean, ``0 apply, 1 hold, 2 release``; empty for a quantity."""
        return ", ".join(f"{k} {name}" for k, name in enumerate(self.values))

    def shaped(self, where: str, value: Any) -> np.ndarray:
        """Return ``value`` as an array of this signal's shape, whatever its numbers.

        Raises:
            BadInput: with the place and what it takes.
        """
        if self.values and isinstance(value, str):
            value = self.code(where, value)
        try:
            array = real_array(value)
            if hasattr(value, "full") and array.size != 1:  # CasADi's is always two-dimensional
                array = array.reshape(self.shape)
            return np.broadcast_to(array, self.shape)
        except (TypeError, ValueError):
            raise BadInput(
                f"{where} takes {'a number' if not self.shape else f'an array {self.shape}'}"
                f" in {self.unit}, not {value_text(value)}"
            ) from None

    def finite(self, where: str, value: Any) -> np.ndarray:
        """Return ``value`` as an array of this signal's shape, refusing NaN and infinity.

        Raises:
            BadInput: with the place.
        """
        array = self.shaped(where, value).copy()
        if np.isnan(array).any():
            raise BadInput(f"{where} is NaN; give a number in {self._range}")
        if np.isinf(array).any():
            raise BadInput(f"{where} is infinite; give a number in {self._range}")
        if self.whole and (array != np.rint(array)).any():
            odd = array.flat[int(np.argmax(array != np.rint(array)))]
            named = f", one of {', '.join(self.values)}" if self.values else ""
            raise BadInput(f"{where} is {odd:g}; it must be a whole number{named}")
        if self.rising and (np.diff(array) <= 0).any():
            k = int(np.argmax(np.diff(array) <= 0))
            raise BadInput(
                f"{where} goes from {array[k]:g} to {array[k + 1]:g} {self.unit}; the places of a"
                " table must rise"
            )
        return array

    @property
    def _range(self) -> str:
        return f"[{self.lo:g}, {self.hi:g}]" + ("" if self.unit == "1" else f" {self.unit}")

    def check(self, where: str, value: Any) -> np.ndarray:
        """Return ``value`` as an array of this signal's shape, refusing NaN and what is off range.

        Raises:
            BadInput: with the place, the value and the range.
        """
        if not self.shape and not self.whole:  # most values are floats already
            plain = value
            if type(plain) is np.ndarray and plain.shape == () and plain.dtype == float:
                plain = plain.item()
            if isinstance(plain, float) and self.lo <= plain <= self.hi and math.isfinite(plain):
                return np.array(float(plain))
        array = self.finite(where, value)
        if (array < self.lo).any() or (array > self.hi).any():
            worst = array.flat[int(np.argmax(np.abs(array - np.clip(array, self.lo, self.hi))))]
            unit = "" if self.unit == "1" else f" {self.unit}"
            raise BadInput(
                f"{where} = {worst:g}{unit} is out of range; it must lie in {self._range}"
            )
        return array


def real_array(value: Any) -> np.ndarray:
    """Return numbers as an array of floats; of text or complex numbers a TypeError, ValueError."""
    if hasattr(value, "full"):  # a CasADi number, always two-dimensional
        value = value.full() if value.numel() != 1 else float(value)
    array = np.asarray(value)
    if array.dtype.kind in "UScmM":
        raise TypeError(f"{value!r} is no real number")
    try:
        return array.astype(float)
    except OverflowError:
        raise ValueError(f"{value!r} is beyond what a float holds") from None


def State(
    unit: str,
    value: Any = 0.0,
    doc: str = "",
    source: str = "",
    *,
    lo: float | str = -math.inf,
    hi: float | str = math.inf,
    shape: tuple[int, ...] = (),
    positive: str | None = None,
    per: str | None = None,
    deviation: str = "",
    truth: str | tuple[str, ...] = (),
    values: tuple[str, ...] = (),
) -> Any:
    """Declare a state; ``value`` is its start, a number or an expression such as ``"v / r"``.

    A range whose ends follow parameters has expressions, ``hi="v_max / r"``. An estimate says with
    ``deviation``, ``"sqrt(P)"``, how far off it may begin, and with ``truth`` of what, ``"v"``, by
    the name which that has in the rest of a loop. A run that begins further off says so.

    A whole number has ``"int"`` in the place of the unit, what is true or not ``"bool"``, a choice
    ``"enum"`` with ``values=("apply", "hold", "release")``; equations see 0, 1, 2. So for
    parameters, inputs and outputs.
    """
    given = numbers_and_bounds(lo, hi)
    return Signal(
        "state", unit, value, doc, source, shape=shape, positive=positive, per=per,
        deviation=deviation, truth=(truth,) if isinstance(truth, str) else tuple(truth),
        values=values, **given,
    )  # fmt: skip


def Param(
    unit: str,
    value: Any = None,
    doc: str = "",
    source: str = "",
    *,
    lo: float = -math.inf,
    hi: float = math.inf,
    shape: tuple[int, ...] = (),
    positive: str | None = None,
    per: str | None = None,
    values: tuple[str, ...] = (),
    rising: bool = False,
    over: str | tuple[str, ...] = "",
) -> Any:
    """Declare a parameter; an expression as ``value`` makes it derived, not settable itself."""
    return Signal("param", unit, value, doc, source, lo, hi, shape, positive, per, values=values,
                  rising=rising, over=over)  # fmt: skip


def Input(
    unit: str,
    doc: str = "",
    source: str = "",
    *,
    value: Any = None,
    lo: End = -math.inf,
    hi: End = math.inf,
    change: End = math.inf,
    noise: End = 0.0,
    stale: int = 200,
    shape: tuple[int, ...] = (),
    positive: str | None = None,
    per: str | None = None,
    values: tuple[str, ...] = (),
    judged: bool = False,
) -> Any:
    """Declare an input; ``value`` is what it reads when no wire and no scenario feeds it.

    Range and ``change``, the most that it can truly change from one tick to the next, may be
    expressions of parameters. So may ``noise``, what two samples of the same quantity differ by at
    most. ``(0, "v - 0.2")`` is a number and an expression beside it, which may name other inputs of
    the block too: it is that of their last good values. Generated C puts the last good value in the
    place of one that is outside, or further from it than noise and change since then allow. It does
    so for ``stale`` ticks in a row; then it refuses the tick. An input that is ``judged`` by the
    block itself is handed over as it is, NaN and infinity too, and no tick is refused for it.
    """
    given = numbers_and_bounds(lo, hi, change=change, noise=noise)
    given["jitter"] = given.pop("noise", 0.0)
    return Signal(
        "input", unit, value, doc, source, shape=shape, positive=positive, per=per,
        stale=stale, values=values, judged=judged, **given,
    )  # fmt: skip


def Noise(unit: str = "1", doc: str = "unit normal number, drawn afresh each tick") -> Any:
    """Declare an input that the scenario fills with unit normal numbers (zero without noise)."""
    return Signal("input", unit, 0.0, doc, noise=True)


def Output(
    unit: str,
    doc: str = "",
    source: str = "",
    *,
    lo: float | str = -math.inf,
    hi: float | str = math.inf,
    shape: tuple[int, ...] = (),
    positive: str | None = None,
    per: str | None = None,
    safe: float | str | None = None,
    values: tuple[str, ...] = (),
) -> Any:
    """Declare an output; ``safe`` is what it gives in generated C while a step is refused.

    An end of its range may be an expression of parameters, ``lo="-T_max"``.
    """
    given = numbers_and_bounds(lo, hi)
    return Signal(
        "output", unit, None, doc, source, shape=shape, positive=positive, per=per,
        safe=safe,  # type: ignore[arg-type]  # a name becomes its number
        values=values, **given,
    )  # fmt: skip


def numbers_and_bounds(lo: End, hi: End, **rest: End) -> dict[str, Any]:
    """Ends, and what else there is, that are numbers, and bounds for those that are expressions."""
    all_ = {"lo": lo, "hi": hi, **rest}
    given = {k: v if isinstance(v, tuple) else (v,) for k, v in all_.items()}
    bounds = tuple(Bound(k, e) for k, v in given.items() for e in v if isinstance(e, str))
    numbers = {k: e for k, v in given.items() for e in v if not isinstance(e, str)}
    return numbers | {"bounds": bounds}


def common_range(signals: Iterable[Signal]) -> tuple[float, float]:
    """Range that all signals have in common; where they have none its ends are in wrong order."""
    every = tuple(signals)
    return max(map(attrgetter("lo"), every)), min(map(attrgetter("hi"), every))


def total_size(signals: Iterable[Signal]) -> int:
    """Number of elements of all signals together."""
    return sum(map(attrgetter("size"), signals))


def packed_numbers(signals: Mapping[str, Signal], values: Mapping[str, Any]) -> np.ndarray | None:
    """Numbers of signals one below the other, a matrix by columns; None where one is no number."""
    found, at = np.empty(total_size(signals.values())), 0
    for n, s in signals.items():
        v = values[n]
        if isinstance(v, float) and s.shape == ():
            found[at] = v
            at += 1
        elif type(v) is np.ndarray and v.dtype == float and v.shape == s.shape:
            found[at : at + v.size] = v.ravel(order="F") if v.ndim > 1 else v
            at += v.size
        else:
            return None
    return found if at else None
