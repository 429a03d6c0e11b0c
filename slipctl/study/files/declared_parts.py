"""A table read as declared parts: dataclasses whose fields carry unit, meaning and range.

Every fault of a table is found in one go, each with the path to where it stands. A field that is a
number has ``metadata["unit"]``; its text is a number with a unit. A part of several kinds is a
union of dataclasses that say with ``kind`` which they are. A field with ``metadata["rest"]`` takes
the keys that no other field has; ``metadata["instead_of"]`` are keys that a file must not have
beside it. One with ``metadata["free"]`` is a table whose names only the
blocks know. ``metadata["key"]`` is the key of a field whose name Python keeps for itself, ``from``.
"""

from __future__ import annotations

import math
import re
import types
import typing
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from functools import lru_cache
from typing import Any, Literal, Union, get_args, get_origin

from slipctl.block.units.unit_algebra import parse_quantity, split_quantity
from slipctl.errors import BadInput, nearest

Keys = tuple[str | int, ...]
Fault = tuple[Keys, str]
"""Where something stands, as keys from the outside, and what is wrong with it."""

BY = {"time": "s", "speed": "m/s", "position": "m"}
"""Units of a number whose unit follows from what the part says that it is over."""


class Each(float):
    """A number that was told by another quantity: N/kg where N is wanted, to be multiplied."""


class Bare(float):
    """A number that was written without a unit, where only a block knows whether it has one."""


def read(kind: type, content: Any) -> tuple[Any, list[Fault]]:
    """Read a table as a part.

    Args:
        kind: dataclass of the part.
        content: table, as a TOML file gives it.

    Returns:
        The part, or None where there are faults; and the faults.
    """
    reader = _Reader()
    part = reader.part(kind, content, ())
    return (None if reader.faults else part), reader.faults


def key_of(f: Field[Any]) -> str:
    """Key of a field in a file."""
    return str(f.metadata.get("key", f.name))


@lru_cache(maxsize=256)
def hints(kind: type) -> dict[str, Any]:
    """Types of the fields of a part."""
    return typing.get_type_hints(kind)


def options(kind: Any) -> list[Any]:
    """Members of a union, or the type itself; None is left out."""
    if get_origin(kind) in (Union, types.UnionType):
        return [k for k in get_args(kind) if k is not type(None)]
    return [kind]


def kinds(classes: list[Any]) -> dict[str, type]:
    """Dataclasses by what they may be called in ``kind``."""
    return {name: c for c in classes if "kind" in hints(c) for name in get_args(hints(c)["kind"])}


class _Reader:
    """Reads, and collects what is wrong."""

    def __init__(self) -> None:
        self.faults: list[Fault] = []

    def fault(self, keys: Keys, text: str) -> None:
        self.faults.append((keys, text))

    def is_table(self, given: Any, keys: Keys) -> bool:
        """Whether it is a table; what it is in place of one is told."""
        if not isinstance(given, Mapping):
            self.fault(keys, f"is {_shown(given)}; write a table")
        return isinstance(given, Mapping)

    def part(self, kind: type, content: Any, keys: Keys) -> Any:
        """Part of a table."""
        if not self.is_table(content, keys):
            return None
        before = len(self.faults)
        known = {key_of(f): f for f in fields(kind)}
        rest = next((n for n, f in known.items() if f.metadata.get("rest")), None)
        values: dict[str, Any] = {}
        extra = {k: v for k, v in content.items() if k not in known or k == rest}
        for name, f in known.items():
            if name == rest:
                values[f.name] = self.value(hints(kind)[f.name], extra, keys, f, content)
            elif name in content:
                here = (*keys, name)
                values[f.name] = self.value(hints(kind)[f.name], content[name], here, f, content)
            elif f.default is MISSING and f.default_factory is MISSING:
                self.fault(keys, f"needs {name}{_example(f)}")
        for name in known.keys() & content.keys():
            for other in known[name].metadata.get("instead_of", ()):
                if other in content:
                    self.fault((*keys, other), f"{name} tells it already; leave one of both out")
        if rest is None:
            for k in extra:
                self.fault((*keys, k), f"there is no key {k!r}{nearest(k, known)}")
        if len(self.faults) > before:
            return None
        made: Any = object.__new__(kind)
        for f in known.values():
            default = f.default_factory() if f.default_factory is not MISSING else f.default
            object.__setattr__(made, f.name, values.get(f.name, default))
        made.complete()
        for path, text in made.wrong():
            inner = (int(k) if k.isdigit() else k for k in path.split(".") if k)
            self.fault((*keys, *inner), text)
        return made

    def value(self, kind: Any, given: Any, keys: Keys, f: Field[Any], beside: Any) -> Any:
        """Value of a field, by its type."""
        if f.metadata.get("free"):
            return given if self.is_table(given, keys) else None
        choices = options(kind)
        classes = [c for c in choices if is_dataclass(c)]
        many = [c for c in choices if get_origin(c) is tuple]
        if classes:
            return self.one_of(classes, given, keys)
        if many and isinstance(given, list):
            inner: Any = get_args(many[0])[0]
            if isinstance(inner, type) and is_dataclass(inner):
                return tuple(self.part(inner, g, (*keys, k)) for k, g in enumerate(given))
            return tuple(self.value(inner, g, (*keys, k), f, beside) for k, g in enumerate(given))
        single = [c for c in choices if c not in many]
        if not single:
            return self.fault(keys, f"is {_shown(given)}; write a list")
        if "unit" in f.metadata:
            return self.number(given, f.metadata, int in single, keys, beside)
        for c in single:
            if get_origin(c) is Literal:
                if given not in get_args(c):
                    known = [str(k) for k in get_args(c)]
                    self.fault(keys, f"is {_shown(given)}{nearest(str(given), known)}")
                return given
            if get_origin(c) in (Mapping, dict) or getattr(c, "__origin__", None) is Mapping:
                return self.table(get_args(c)[1], given, keys, f)
        if bool in single and isinstance(given, bool):
            return given
        if str in single and isinstance(given, str):
            return given
        if str in single and float not in single:
            return self.fault(keys, f"is {_shown(given)}; write a text")
        if float in single and isinstance(given, (int, float)) and not isinstance(given, bool):
            try:
                return Bare(given)
            except OverflowError:
                return self.fault(keys, "is too large a number")
        return self.fault(keys, f"is {_shown(given)}, which cannot stand here")

    def one_of(self, classes: list[Any], given: Any, keys: Keys) -> Any:
        """Part of one of several kinds."""
        if not self.is_table(given, keys):
            return None
        by_kind = kinds(classes)
        if len(classes) == 1 and ("kind" not in given or not by_kind):
            return self.part(classes[0], given, keys)
        if "kind" not in given:
            return self.fault(keys, f"needs kind = ...{nearest('', by_kind)}")
        kind = given["kind"]
        if not isinstance(kind, str) or kind not in by_kind:
            return self.fault((*keys, "kind"), f"is {_shown(kind)}{nearest(str(kind), by_kind)}")
        return self.part(by_kind[kind], given, keys)

    def table(self, kind: Any, given: Any, keys: Keys, f: Field[Any]) -> Any:
        """Parts or values by names of a person's own."""
        if not self.is_table(given, keys):
            return None
        return {k: self.value(kind, v, (*keys, k), f, given) for k, v in given.items()}

    def number(
        self, given: Any, meta: Mapping[str, Any], whole: bool, keys: Keys, beside: Any
    ) -> Any:
        """Number of a text with its unit, in its range."""
        unit = meta["unit"]
        if unit.startswith("by "):
            over = beside.get(unit[3:], "time") if isinstance(beside, Mapping) else "time"
            unit = BY.get(str(over), "s")
        if isinstance(given, bool) or not isinstance(given, (int, float, str)):
            return self.fault(keys, f"is {_shown(given)}; write {_wanted(unit)}")
        if isinstance(given, str):
            try:
                value = parse_quantity(given, unit)
                if unit != "1" and split_quantity(given)[1] is None:
                    return self.fault(keys, f"{given!r} has no unit; write '{given} {unit}'")
                given = value
            except BadInput as error:
                if meta.get("by") and (each := _by(given, unit, meta["by"])) is not None:
                    if not (math.isfinite(each) and each >= meta.get("lo", -math.inf)):
                        return self.fault(keys, f"is {_shown(given)}, which is out of range")
                    return Each(each)
                return self.fault(keys, str(error))
            except (ValueError, OverflowError, RecursionError):
                return self.fault(keys, f"is no number in {unit}")
        elif unit != "1":
            return self.fault(keys, f"{given:g} has no unit; write '{given:g} {unit}'")
        try:
            value = float(given)
        except OverflowError:
            return self.fault(keys, "is too large a number")
        if whole and not value.is_integer():
            return self.fault(keys, f"is {value:g}; write a whole number")
        lo, hi = meta.get("lo", -math.inf), meta.get("hi", math.inf)
        if not (math.isfinite(value) and lo <= value <= hi):
            told = "" if unit == "1" else f" {unit}"
            return self.fault(keys, f"{value:g}{told} is outside {lo:g} .. {hi:g}{told}")
        return int(value) if whole else value


def _by(text: str, unit: str, by: str) -> float | None:
    """Number of a text by another quantity, in ``unit/by``; None where it is none.

    ``ton`` is the American one of 2000 lb, as Davis and AREMA write lbf/ton.
    """
    short, found = re.subn(r"/\s*ton\b", "/lb", text)
    try:
        return parse_quantity(short, f"{unit}/{by}") / 2000**found
    except (BadInput, ValueError, OverflowError, RecursionError):
        return None


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "..."


def _wanted(unit: str) -> str:
    return "a number" if unit == "1" else f"a number with its unit, such as '1 {unit}'"


def _example(f: Field[Any]) -> str:
    unit, doc = f.metadata.get("unit"), f.metadata.get("doc", "")
    told = f" ({doc})" if doc else ""
    if unit and unit.startswith("by "):
        return f"{told}, in the unit of {unit[3:]}"
    return f"{told}, in {unit}" if unit and unit != "1" else told


# ---- what a file may hold, as JSON schema --------------------------------------------------------


def schema(kinds: Sequence[type], title: str) -> dict[str, Any]:
    """JSON schema (2020-12) of a file that holds one of these parts."""
    found: dict[str, Any] = {}
    tops = [_schema_of(kind, found) for kind in kinds]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema", "title": title,
        "anyOf": tops, "$defs": dict(sorted(found.items())),
    }  # fmt: skip


def _schema_of(kind: Any, found: dict[str, Any]) -> dict[str, Any]:
    """Schema of a part, its own one among the definitions."""
    name = kind.__name__
    if name not in found:
        found[name] = {}
        rest = [f for f in fields(kind) if f.metadata.get("rest")]
        shown = [f for f in fields(kind) if not f.metadata.get("rest")]
        needed = [key_of(f) for f in shown if f.default is MISSING and f.default_factory is MISSING]
        found[name] = {
            "type": "object",
            "description": (kind.__doc__ or "").strip().partition("\n")[0],
            "properties": {key_of(f): _field(hints(kind)[f.name], f, found) for f in shown},
            "additionalProperties": {"type": ["string", "number"]} if rest else False,
            "required": needed,
        }
    return {"$ref": f"#/$defs/{name}"}


@dataclass(frozen=True)
class Key:
    """A key of a part, as a reader wants it.

    Attributes:
        name: of the key. meaning: in words. unit: empty where it has none. default: as text; empty
            where it must be given. range: as text; empty where there is none.
    """

    name: str
    meaning: str
    unit: str
    default: str
    range: str


def keys_of(kind: Any) -> list[Key]:
    """Keys of a part that are no tables of their own, in their order."""
    found = []
    for f in fields(kind):
        if f.metadata.get("rest") or (f.name == "kind" and not f.metadata.get("doc")):
            continue
        meaning = str(f.metadata.get("doc", ""))
        choices = [a for c in options(hints(kind)[f.name]) if get_origin(c) is Literal
                   for a in get_args(c)]  # fmt: skip
        if choices and not f.metadata.get("unit"):
            meaning += f": {' or '.join(map(str, choices))}"
        unit = str(f.metadata.get("unit") or "")
        found.append(Key(key_of(f), meaning, "" if unit == "1" else unit, _default(f), _range(f)))
    return found


def description(key: Key) -> str:
    """A key's meaning with its unit, range and default, for an editor."""
    must = key.default == "must be given"
    more = [f"unit {key.unit}" if key.unit else "", key.range,
            key.default if must else f"default {key.default}"]  # fmt: skip
    return f"{key.meaning} ({', '.join(filter(None, more))})"


def _default(f: Field[Any]) -> str:
    if f.default is MISSING and f.default_factory is MISSING:
        return "must be given"
    value = f.default_factory() if callable(f.default_factory) else f.default
    if value is None or (not isinstance(value, (bool, int, float)) and not value):
        return "none"
    if is_dataclass(value):
        kind = getattr(value, "kind", "")
        return f'kind = "{kind}"' if kind else "as below"
    return {True: "true", False: "false"}.get(value, "") if isinstance(value, bool) else (
        f"{value:g}" if isinstance(value, (int, float)) else str(value))  # fmt: skip


def _range(f: Field[Any]) -> str:
    return range_text(*(f.metadata.get(end, math.inf) for end in ("lo", "hi")))


def range_text(lo: float, hi: float) -> str:
    """Range of a number in words; an end that is infinite is not told."""
    low, high = math.isfinite(lo), math.isfinite(hi)
    if low and high:
        return f"{lo:g} to {hi:g}"
    return f"at least {lo:g}" if low else f"at most {hi:g}" if high else ""


def _field(kind: Any, f: Field[Any], found: dict[str, Any]) -> dict[str, Any]:
    unit, doc = f.metadata.get("unit") or "1", f.metadata.get("doc")
    plain = Key(f.name, doc, "" if unit == "1" else unit, _default(f), _range(f)) if doc else None
    said: dict[str, Any] = {"description": description(plain)} if plain else {}
    return said | _any_of(_types(kind, f, found))


def _any_of(types: Iterable[dict[str, Any]]) -> dict[str, Any]:
    either = list(types)
    return either[0] if len(either) == 1 else {"anyOf": either}


def _types(kind: Any, f: Field[Any], found: dict[str, Any]) -> Iterator[dict[str, Any]]:
    unit = f.metadata.get("unit")
    if f.metadata.get("free"):
        yield {"type": "object"}
        return
    for c in options(kind):
        if is_dataclass(c):
            yield _schema_of(c, found)
        elif get_origin(c) is tuple:
            yield {"type": "array", "items": _any_of(_types(get_args(c)[0], f, found))}
        elif get_origin(c) is Literal:
            yield {"enum": list(get_args(c))}
        elif get_args(c):
            values = _any_of(_types(get_args(c)[1], f, found))
            yield {"type": "object", "additionalProperties": values}
        elif unit is not None and unit != "1":
            yield {"type": "string", "examples": [f"1 {unit}"]}
        elif c is bool:
            yield {"type": "boolean"}
        elif c is int:
            yield {"type": "integer"}
        elif c is float:
            yield {"type": ["number", "string"]}
        else:
            yield {"type": "string"}
