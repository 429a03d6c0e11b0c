"""What can go wrong, said in one line: where, what, and what to write instead."""

import builtins
import collections.abc
import functools
import inspect
import math
import sys
import types
import typing
from collections.abc import Callable, Collection, Iterable, Mapping
from copy import copy
from dataclasses import fields
from difflib import get_close_matches
from numbers import Integral, Number, Rational, Real
from typing import Any, TypeVar


class BadInput(ValueError):
    """Something a person wrote cannot be used; the command line prints it and exits with 2."""


class Faults(BadInput):
    """Several things at once, a line each, that a person wrote and that cannot be used.

    Attributes:
        lines: the faults, in the order in which they stand.
    """

    def __init__(self, lines: Iterable[str]) -> None:
        self.lines = tuple(dict.fromkeys(lines))
        super().__init__("; ".join(self.lines))

    def placed(self, where: str) -> "Faults":
        """Return the same faults with where they stand in front."""
        return Faults(f"{where}: {line}" for line in self.lines)


class RunFailed(RuntimeError):
    """A run broke (NaN or infinity in a state); the command line exits with 1."""


def own_copy(given: Mapping[str, Any]) -> dict[str, Any]:
    """A mapping of its own, with arrays and lists of its own: changed later, it changes nothing."""
    plain = given.items() if isinstance(given, dict) else ((n, given[n]) for n in given)
    return {n: copy(v) if hasattr(v, "__array__") or isinstance(v, list) else v for n, v in plain}


def nearest(name: str, candidates: Iterable[str]) -> str:
    """Tell which of the candidates was probably meant.

    Returns:
        ``"; did you mean 'x'?"`` where one is close, otherwise ``"; it has a, b, c"`` (at most 12).
    """
    known = [str(c) for c in candidates]
    lower = {c.lower(): c for c in known}
    close = get_close_matches(str(name).lower(), list(lower), n=1, cutoff=0.6)
    if close:
        return f"; did you mean {lower[close[0]]!r}?"
    if not known:
        return ""
    shown = ", ".join(known[:12])
    return f"; it has {shown}" + (", ..." if len(known) > 12 else "")


def check_known(what: str, name: Any, known: Collection[Any], told: str = "") -> None:
    """Refuse a name that is none of the known ones.

    Raises:
        BadInput: "what 'name'told; did you mean 'x'?", or what there is.
    """
    if name not in known:
        raise BadInput(f"{what} {name!r}{told}{nearest(name, known)}")


def check_all_known(what: str, names: Iterable[Any], known: Collection[Any]) -> None:
    """Refuse names of which one is none of the known ones; see :func:`check_known`."""
    for name in names:
        if name not in known:
            check_known(what, name, known)


def refuse_unknown_choice(what: str, choice: str, given: str, choices: Iterable[str]) -> None:
    """Refuse a structural choice that does not exist.

    Raises:
        BadInput: "what has no choice 'given'; it has ...".
    """
    choices = tuple(choices)
    if given not in choices:
        raise BadInput(f"{what} has no {choice} {given!r}; it has {', '.join(choices)}")


def _is_real(given: Any) -> bool:
    """Whether it is a number as float, int and numpy have it; a fraction or a time span is none."""
    if isinstance(given, Rational) and not isinstance(given, Integral):
        return False
    return isinstance(given, Real) and type(given).__name__ != "timedelta64"


def check_number(what: str, given: Any, unit: str = "1") -> None:
    """Refuse what is no number.

    Raises:
        BadInput: "what takes a number in unit, not given".
    """
    if not _is_real(given) or (isinstance(given, int) and abs(given) >= 2**1023):
        told = "" if unit == "1" else f" in {unit}"
        raise BadInput(f"{what} takes a number{told}, not {value_text(given)}")


def check_texts(what: str, owner: object, *names: str) -> None:
    """Refuse attributes that are no texts.

    Raises:
        BadInput: "what: name is a text, not given".
    """
    for name in names:
        given = getattr(owner, name)
        if not isinstance(given, str):
            raise BadInput(f"{what}: {name} is a text, not {value_text(given)}")


def check_positive(what: str, given: Any, unit: str = "1") -> None:
    """Refuse what is no number, not finite or not positive.

    Raises:
        BadInput: "what = given unit must be positive".
    """
    check_number(what, str(given) if isinstance(given, bool) else given, unit)
    if not (math.isfinite(given) and given > 0):
        told = "" if unit == "1" else f" {unit}"
        raise BadInput(f"{what} = {given:g}{told} must be positive")


def check_finite(what: str, given: Any, unit: str = "1") -> None:
    """Refuse what is no number, or not finite.

    Raises:
        BadInput: "what = given unit must be finite".
    """
    check_number(what, given, unit)
    if not math.isfinite(given):
        raise BadInput(f"{what} = {given}{'' if unit == '1' else f' {unit}'} must be finite")


def check_whole(what: str, given: Any, least: int = 1, most: int | None = None) -> None:
    """Refuse what is no whole number from ``least`` on, up to ``most``.

    Raises:
        BadInput: "what = given must be a whole number >= least".
    """
    whole = _is_real(given) and (isinstance(given, Integral) or float(given).is_integer())
    whole = whole and not isinstance(given, bool)
    if not (whole and least <= given and (most is None or given <= most)):
        told = given if isinstance(given, Real) else value_text(given)
        wanted = f">= {least}" if most is None else f"in {least}..{most}"
        raise BadInput(f"{what} = {told} must be a whole number {wanted}")


def check_range(where: str, lo: Any, hi: Any) -> None:
    """Refuse ends that are no finite numbers, and a range without width.

    Raises:
        BadInput: says what the range is, and that lo < hi is needed.
    """
    for end in (lo, hi):
        if not hasattr(end, "__float__"):
            raise BadInput(f"{where}: an end of the range is {end!r}; give numbers, lo < hi")
    a, b = float(lo), float(hi)
    if not (math.isfinite(a) and math.isfinite(b) and a < b):
        raise BadInput(f"{where}: range {a:g} to {b:g} is none; give lo < hi")


def check_ranges(where: str, over: Any) -> None:
    """Refuse ``over`` unless it has a range for each name.

    Raises:
        BadInput: says how it is written, or which range is none.
    """
    if not isinstance(over, Mapping) or not over:
        raise BadInput(f"{where}: over = {over!r} has no ranges; give over={{name: (lo, hi)}}")
    for name, ends in over.items():
        if not isinstance(ends, (tuple, list)) or len(ends) != 2:
            raise BadInput(f"{where}: over has {name!r}: {ends!r}; give its range, (lo, hi)")
        check_range(f"{where}: {name}", *ends)


# ---- kinds of arguments --------------------------------------------------------------------------

F = TypeVar("F", bound=Callable[..., Any])


def door(function: F, name: str) -> F:
    """Return a public function that refuses an argument of another kind than its annotation says.

    The signature stays what it was. Only what is called from outside goes through the door: the
    engine calls the function itself.

    Raises:
        BadInput: "simulate: loop is None, which is no Block".
    """
    signature = inspect.signature(function)

    @functools.wraps(function)
    def checked(*args: Any, **kwargs: Any) -> Any:
        try:
            given = signature.bind(*args, **kwargs).arguments
        except TypeError as error:
            raise TypeError(f"{function.__name__}: {error}") from None
        wrong = _wrong_kind(function.__name__, function, given)
        if not wrong:
            return function(*args, **kwargs)
        try:  # its own words say more, where it has some
            function(*args, **kwargs)
        except (BadInput, RunFailed):
            raise
        except Exception as error:
            raise BadInput(wrong) from error
        raise BadInput(wrong)

    checked.__module__, checked.__qualname__ = "slipctl", name  # where a pickle finds it
    return typing.cast(F, checked)


def check_kinds(where: str, declared: Any, given: Mapping[str, Any]) -> None:
    """Refuse values of another kind than the annotations of a function or class say.

    Args:
        where: what is called. declared: function or dataclass with annotations.
        given: values by name; of ``*args`` and ``**kwargs`` each one is checked.

    Raises:
        BadInput: names the argument, what it is and what is wanted.
    """
    wrong = _wrong_kind(where, declared, given)
    if wrong:
        raise BadInput(wrong)


def _wrong_kind(where: str, declared: Any, given: Mapping[str, Any]) -> str:
    """What is of another kind than declared, in a line; empty where nothing is."""
    kinds = _kinds(declared)
    for name, value in given.items():
        kind, many = kinds.get(name, (Any, None))
        rows: Iterable[tuple[Any, Any]] = [(name, value)]
        if many:
            rows = value.items() if many == "**" else enumerate(value)
        for key, one in rows:
            told = name if many is None else f"{name}[{key}]" if many == "*" else key
            if type(one) is kind is not int:
                continue
            if isinstance(one, (list, tuple)) and _nested(one):
                return f"{where}: {told} is nested deeper than {DEEPEST} lists"
            if not _is(one, kind):
                return f"{where}: {told} is {value_text(one)}, which is no {_told(kind)}"
    return ""


def list_of_kind(where: str, given: Any, kind: type) -> list[Any]:
    """A list of what all is of a kind.

    Raises:
        BadInput: it is no list, or of something else.
    """
    found = list(given) if has_many(given) else [None]
    if [one for one in found if not isinstance(one, kind)]:
        raise BadInput(f"{where}: give a list of {kind.__name__}, not {value_text(given)}")
    return found


def has_many(given: Any) -> bool:
    """Whether one can go through it: no matrix of CasADi, and no array without an axis."""
    alone = hasattr(given, "sparsity") or getattr(given, "ndim", 1) == 0
    return isinstance(given, Iterable) and not alone


DEEPEST = 50
"""Lists in lists that an argument may be made of."""


def _nested(value: Any) -> bool:
    """Whether a value is lists in lists without end."""
    for _ in range(DEEPEST):
        if not isinstance(value, (list, tuple)) or not value:
            return False
        value = value[0]
    return True


def value_text(value: Any) -> str:
    """A value as it is written, where that is short and can be."""
    try:
        text = repr(value)
    except Exception:  # nested too deep, or one of a class whose repr fails
        text = ""
    return text if 0 < len(text) < 60 and "\n" not in text else f"of type {type(value).__name__}"


@functools.lru_cache(maxsize=512)
def _kinds(declared: Any) -> dict[str, tuple[Any, str | None]]:
    """Annotation of each argument, and whether it stands for many (``*``, ``**``)."""
    names = {**vars(builtins), **vars(typing), **vars(collections.abc)}
    names |= vars(sys.modules[declared.__module__])
    many: dict[Any, str] = {
        inspect.Parameter.VAR_POSITIONAL: "*",
        inspect.Parameter.VAR_KEYWORD: "**",
    }
    kinds = {}
    for p in inspect.signature(declared).parameters.values():
        kind = p.annotation
        if isinstance(kind, str):
            try:
                kind = eval(kind, dict(names))
            except Exception:  # a name that only a type checker imports
                kind = Any
        kinds[p.name] = (Any if kind is p.empty else kind, many.get(p.kind))
    return kinds


def _is(value: Any, kind: Any) -> bool:
    """Whether a value is of an annotated kind; of a sequence or mapping, every member too."""
    origin, inside = typing.get_origin(kind), typing.get_args(kind)
    if kind is Any or isinstance(kind, TypeVar | str):
        return True
    if kind is None or kind is type(None):
        return value is None
    if origin in (typing.Union, types.UnionType):
        plainly = type(value) is not int and type(value) in inside
        return plainly or any(_is(value, k) for k in inside)
    if kind is float:
        return _is_number(value)
    if kind is complex:
        return isinstance(value, Number)
    if kind is int:
        whole = isinstance(value, Integral) or (isinstance(value, float) and value.is_integer())
        return whole and not isinstance(value, bool) and _is_real(value) and abs(value) < 2**63
    if kind is bool:
        return isinstance(value, bool) or type(value).__name__ == "bool"
    if origin is collections.abc.Callable:
        return callable(value)
    if origin is tuple and inside and inside[-1] is not Ellipsis:
        return isinstance(value, tuple | list) and len(value) == len(inside) and all(
            _is(v, k) for v, k in zip(value, inside, strict=True))  # fmt: skip
    if origin is typing.Literal:
        return value in inside
    plain = origin or kind
    if not isinstance(plain, type):
        return True
    if issubclass(plain, Mapping):  # a data frame is one too
        if not (hasattr(value, "keys") and hasattr(value, "__getitem__")):
            return False
        plainly = isinstance(value, dict) and bool(inside)
        return not plainly or all(_is(k, inside[0]) and _is(v, inside[1]) for k, v in value.items())
    if plain in _MANY:
        once = plain is collections.abc.Iterable and isinstance(value, _ROLLED)
        if not _has_members(value) and not once:
            return False
        if not inside or isinstance(value, collections.abc.Iterator):
            return True
        if hasattr(value, "__array__"):  # numbers, or of a kind that cannot be told
            return inside[0] in (float, complex, int) or not isinstance(inside[0], type)
        return all(_is(v, inside[0]) for v in value)
    return isinstance(value, plain)


def _is_number(value: Any) -> bool:
    """Whether it is one real number that a float can hold (also an array or DM of one element)."""
    single = getattr(value, "ndim", None) == 0 or type(value).__name__ == "DM"
    if not _is_real(value) and not (single and not isinstance(value, Real)):
        return False
    try:
        float(value)
    except (TypeError, ValueError, OverflowError, RuntimeError):
        return False
    return True


def _has_members(value: Any) -> bool:
    """Whether it is a list, a tuple, or an array or series with a length."""
    if isinstance(value, str | bytes):
        return False
    return isinstance(value, collections.abc.Sequence) or (
        hasattr(value, "__array__") and getattr(value, "ndim", 0) >= 1
    )


_ROLLED = (
    collections.abc.Set, collections.abc.MappingView, collections.abc.Iterator, Mapping
)  # fmt: skip
"""What one can only go through."""

_MANY = (
    collections.abc.Sequence, collections.abc.Iterable, collections.abc.Collection, list, tuple
)  # fmt: skip
"""Kinds with members; an array is one too."""


def _told(kind: Any) -> str:
    """Kind in words."""
    origin, inside = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        return " or ".join(dict.fromkeys(_told(k) for k in inside))
    if kind is None or kind is type(None):
        return "None"
    words = {
        float: "number",
        complex: "number",
        int: "whole number",
        str: "text",
        bool: "True or False",
    }
    if kind in words:
        return words[kind]
    if origin is collections.abc.Callable:
        return "function"
    if origin is typing.Literal:
        return " or ".join(map(repr, inside))
    if origin and issubclass(origin, Mapping) and len(inside) == 2:
        return f"mapping from {_told(inside[0])} to {_told(inside[1])}"
    if origin and inside and origin in _MANY:
        return f"list of {_told(inside[0])}"
    if kind is Any:
        return "anything"
    return getattr(origin or kind, "__name__", str(kind))


def split_options(where: str, options: Mapping[str, Any], *kinds: type) -> list[Any]:
    """Options by name, as the dataclasses that they are fields of, one of each kind.

    Raises:
        BadInput: an option that no kind has.
    """
    names = [f.name for kind in kinds for f in fields(kind)]
    for name in options:
        if name not in names:
            raise BadInput(f"{where} has no option {name}{nearest(name, names)}")
    return [
        kind(**{f.name: options[f.name] for f in fields(kind) if f.name in options})
        for kind in kinds
    ]
