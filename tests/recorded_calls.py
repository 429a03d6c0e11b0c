"""Single calls of a room's functions, and what they give: a net under its numbers.

``python tests/draw_calls.py slipctl/certify --again`` computes anew what the calls of the table
give and says what changed; a number that changed belongs into CHANGELOG. The net says that nothing
changed, not that it is right: the adversary, closed forms and the checker hold what is promised.
"""

from __future__ import annotations

import importlib
import inspect
import json
import lzma
import math
import sys
import types
import zlib
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from decimal import Context, Decimal
from fractions import Fraction
from functools import cached_property, lru_cache, partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[1]
SHOWN = 16
"""Numbers of a result that are kept one by one; the others are summed."""
OWN = ("slipctl.", "casadi.")
SAMPLES = ("samples",)
"""Whose objects have a name, and modules of tests that hold some to be handed over."""
TABLES = {"slipctl/certify": ("slipctl.certify.catalogue", "samples")}
"""Modules that hold objects in tables, by room."""
STEPS = 64
"""Values of a generator that are looked at."""


class Unwritten(Exception):
    """A value that has no text: a file, an object of another package."""


# ---- values as text ------------------------------------------------------------------------------


def named(place: str) -> Any:
    """What stands at ``module:name``."""
    module, _, name = place.partition(":")
    found = importlib.import_module(module)
    for part in name.split("."):
        found = inspect.getattr_static(found, part)
    return found


def place_of(value: Any) -> str:
    """Where a function or a class stands."""
    place = f"{value.__module__}:{value.__qualname__}"
    if "<" in place or named(place) is not value:
        raise Unwritten(place)
    return place


def bare(function: Any) -> types.FunctionType:
    """The function itself, under what is wrapped around it."""
    for own in ("__func__", "fget", "func", "__wrapped__"):
        function = getattr(function, own, function)
    if not isinstance(function, types.FunctionType):
        raise Unwritten(function)
    return function


def within(code: types.CodeType, name: str) -> list[types.CodeType]:
    """Codes of a name inside of a function, at any depth, in their order."""
    found = []
    for inner in code.co_consts:
        if isinstance(inner, types.CodeType):
            found += [inner] if inner.co_qualname == name else within(inner, name)
    return found


def code_at(place: str) -> types.CodeType:
    """Code of a function within a function: ``module:outer.<locals>.inner#number``."""
    path, _, number = place.partition("#")
    outer = bare(named(path.partition(".<locals>")[0]))
    return within(outer.__code__, path.partition(":")[2])[int(number)]


def place_of_code(code: types.CodeType, module: str) -> str:
    """Where such a code stands."""
    path = f"{module}:{code.co_qualname}"
    if ".<locals>." not in path:
        raise Unwritten(path)
    outer = bare(named(path.partition(".<locals>")[0]))
    every = within(outer.__code__, code.co_qualname)
    if code not in every:
        raise Unwritten(path)
    return f"{path}#{every.index(code)}"


def closure(place: str, held: Mapping[str, Any], defaults: Any) -> types.FunctionType:
    """A function within a function, with what it holds of that."""
    code, module = code_at(place), importlib.import_module(place.partition(":")[0])
    cells = tuple(types.CellType(held[n]) for n in code.co_freevars)
    return types.FunctionType(code, vars(module), code.co_name, defaults, cells)


def parts(value: Any) -> dict[str, Any]:
    """Attributes that make an object of this package what it is."""
    if is_dataclass(value):
        return {f.name: getattr(value, f.name) for f in fields(value)}
    slots = [s for c in type(value).__mro__ for s in getattr(c, "__slots__", ())]
    return {s: getattr(value, s) for s in slots if hasattr(value, s)} | getattr(
        value, "__dict__", {}
    )


def families() -> Iterator[tuple[list[Any], Iterator[tuple[Any, Any]]]]:
    """Objects that modules hold in tables, with the places of these."""
    for name, module in list(sys.modules.items()):
        if name in SAMPLES:
            for k, v in vars(module).items():
                if isinstance(v, tuple):
                    yield [name, k], enumerate(v)
    catalogue = sys.modules.get("slipctl.certify.catalogue")
    for key, system in catalogue.SYSTEMS.items() if catalogue else ():
        place = ["slipctl.certify.catalogue", "SYSTEMS"]
        yield place, iter([(key, system)])
        for part in ("criteria", "refuters", "numbers"):
            yield [*place, key, part], iter(getattr(system, part).items())


@lru_cache
def held(imported: int) -> dict[int, Any]:
    """Places of objects that modules hold, while so many are imported; studies hold them last."""
    modules = sorted(sys.modules.items(), key=lambda m: not m[0].startswith("slipctl.studies"))
    found: dict[int, Any] = {
        id(v): {"g": f"{name}:{k}"} for name, module in modules
        if name.startswith("slipctl.") or name in SAMPLES for k, v in vars(module).items()
        if type(v).__module__.startswith(OWN) and not isinstance(v, tuple)
    }  # fmt: skip
    for place, of in families():
        found |= {id(v): {"h": [*place, k]} for k, v in of}
    return found


def at(path: list[Any]) -> Any:
    """What stands at such a place."""
    found: Any = importlib.import_module(path[0])
    for key in path[1:]:
        found = found[key] if isinstance(found, Mapping | tuple) else getattr(found, key)
    return found


class Writer:
    """Values as JSON; objects that modules hold by their names."""

    def __init__(self) -> None:
        self.held = held(len(sys.modules))

    def text(self, value: Any) -> Any:
        own = self.text
        if value is None or isinstance(value, bool | str) or type(value) is int:
            return value
        if type(value) is float:
            return value if math.isfinite(value) else {"x": str(value)}
        if id(value) in self.held:
            return self.held[id(value)]
        if isinstance(value, Fraction | Decimal):
            return {"q" if isinstance(value, Fraction) else "D": str(value)}
        if isinstance(value, complex):
            return {"c": [own(value.real), own(value.imag)]}
        if isinstance(value, np.generic):
            return {"n": [str(value.dtype), own(value.item())]}
        if type(value) is np.ndarray:
            if value.dtype.kind not in "bif":
                raise Unwritten(value.dtype)
            return {
                "a": [str(value.dtype), list(value.shape), [own(v) for v in value.ravel().tolist()]]
            }
        if type(value) is list:
            return [own(v) for v in value]
        if type(value) in (tuple, set, frozenset, deque):
            kind = {tuple: "t", set: "s", frozenset: "f", deque: "e"}[type(value)]
            return {kind: [own(v) for v in value]}
        if type(value) is dict or isinstance(value, types.MappingProxyType):
            return {"d": [[own(k), own(v)] for k, v in value.items()]}
        if isinstance(value, Context):
            return {"X": [value.prec, value.rounding, value.Emin, value.Emax]}
        if isinstance(value, np.ufunc):
            return {"u": value.__name__}
        if isinstance(value, types.FunctionType) and "<locals>" in value.__qualname__:
            place = place_of_code(value.__code__, value.__module__)
            if value.__kwdefaults__:
                raise Unwritten(place)
            cells = zip(value.__code__.co_freevars, value.__closure__ or (), strict=True)
            held = {n: own(c.cell_contents) for n, c in cells}
            return {"C": [place, held, own(value.__defaults__)]}
        if hasattr(value, "cache_parameters") and "<locals>" in value.__wrapped__.__qualname__:
            return {"L": own(value.__wrapped__)}
        if isinstance(value, types.MethodType) and type(value.__self__).__module__.startswith(
            "slipctl."
        ):
            return {"m": [own(value.__self__), value.__name__]}
        if isinstance(value, type | types.FunctionType | types.BuiltinFunctionType):
            return {"p": place_of(value)}
        if isinstance(value, partial):
            return {"P": [own(value.func), [own(v) for v in value.args],
                          own(dict(value.keywords))]}  # fmt: skip
        if not type(value).__module__.startswith("slipctl."):
            raise Unwritten(type(value))
        if isinstance(value, tuple):
            return {"N": [place_of(type(value)), [own(v) for v in value]]}
        return {"O": [place_of(type(value)), {k: own(v) for k, v in parts(value).items()}]}


def value(text: Any) -> Any:
    """The value of a text."""
    if isinstance(text, list):
        return [value(v) for v in text]
    if not isinstance(text, dict):
        return text
    ((kind, of),) = text.items()
    simple: dict[str, Callable[[Any], Any]] = {
        "x": float, "g": named, "q": Fraction, "D": Decimal, "p": named,
        "c": lambda v: complex(value(v[0]), value(v[1])),
        "n": lambda v: np.dtype(v[0]).type(value(v[1])),
        "a": lambda v: np.array([value(x) for x in v[2]], dtype=v[0]).reshape(v[1]),
        "t": lambda v: tuple(map(value, v)), "s": lambda v: set(map(value, v)),
        "f": lambda v: frozenset(map(value, v)), "e": lambda v: deque(map(value, v)),
        "d": lambda v: {value(k): value(x) for k, x in v},
        "P": lambda v: partial(value(v[0]), *map(value, v[1]), **value(v[2])),
        "N": lambda v: tuple.__new__(named(v[0]), [value(x) for x in v[1]]),
        "C": lambda v: closure(v[0], {k: value(x) for k, x in v[1].items()}, value(v[2])),
        "m": lambda v: getattr(value(v[0]), v[1]), "L": lambda v: lru_cache(None)(value(v)),
        "X": lambda v: Context(prec=v[0], rounding=v[1], Emin=v[2], Emax=v[3]),
        "u": lambda v: getattr(np, v), "h": at,
    }  # fmt: skip
    if kind in simple:
        return simple[kind](of)
    new = object.__new__(named(of[0]))
    for k, v in of[1].items():
        object.__setattr__(new, k, value(v))
    return new


# ---- what a call gives ---------------------------------------------------------------------------


def leaves(found: Any) -> Iterator[float | str]:
    """Floats and words of a value's text, in its order; exact numbers are words."""
    if isinstance(found, float):
        yield found
    elif isinstance(found, Mapping):
        for k, v in found.items():
            yield str(k)
            yield from leaves(v)
    elif isinstance(found, list):
        yield f"[{len(found)}"
        for v in found:
            yield from leaves(v)
    else:
        yield str(found)


def told(text: Any) -> list[Any]:
    """Words and floats of a result: a sum of check over the words, floats, sums of the others."""
    every = list(leaves(text))
    words = zlib.crc32("\n".join(v for v in every if isinstance(v, str)).encode())
    numbers = [v for v in every if isinstance(v, float)]
    rest = numbers[SHOWN:]
    sums = [sum(rest), sum((1 + i % 7) * v for i, v in enumerate(rest)), sum(map(abs, rest))]
    return [words, *numbers[:SHOWN], *(sums if rest else [])]


def called(place: str, arguments: Any) -> Any:
    """Text of what a call gives, or of what it refuses; and of what it did to its arguments."""
    first, more = [value(v) for v in arguments[0]], {k: value(v) for k, v in arguments[1].items()}
    if "<locals>" in place:
        function: Any = closure(place, {k: value(v) for k, v in arguments[2].items()}, None)
    else:
        function = named(place)
    for kind, own in ((classmethod, "__func__"), (staticmethod, "__func__"), (property, "fget"),
                      (cached_property, "func")):  # fmt: skip
        if isinstance(function, kind):
            function = getattr(function, own)
    writer = Writer()
    before = writer.text(first)
    try:
        with np.errstate(all="ignore"):
            found = function(*first, **more)
            if isinstance(found, Iterator):
                found = list(islice(found, STEPS))
        text = writer.text(found)
    except Unwritten:
        raise
    except Exception as refused:  # whatever it is, it is what the call gives
        text = {"refused": type(refused).__name__}
    after = writer.text(first)
    return text if after == before else [text, after]


def off(found: list[Any], wanted: list[Any]) -> float:
    """Share by which the floats of two results differ at most; infinite where words do."""
    if len(found) != len(wanted) or found[0] != wanted[0]:
        return math.inf
    pairs = list(zip(found[1:], wanted[1:], strict=True))
    size = max((abs(b) for _, b in pairs[SHOWN:]), default=0.0)
    return max(
        (abs(a - b) / (max(abs(b), size if i >= SHOWN else 0.0) or 1.0)
         for i, (a, b) in enumerate(pairs)), default=0.0,
    )  # fmt: skip


# ---- the table -----------------------------------------------------------------------------------


def table(room: str) -> Path:
    return ROOT / "tests" / Path(room).name / "calls.json.xz"


@lru_cache
def read(room: str) -> dict[str, list[Any]]:
    """Calls by function: arguments, what is told of the result, what it may be off by."""
    for module in TABLES.get(room, ()):
        importlib.import_module(module)  # so that their objects have the same names in each run
    found: dict[str, list[Any]] = json.loads(lzma.decompress(table(room).read_bytes()))
    return found


def changed(room: str, module: str = "") -> list[str]:
    """Calls of a module's functions, or of all, that give something else than the table says."""
    found = []
    for place, calls in read(room).items():
        if module and place.split(":")[0] != module:
            continue
        for arguments, wanted, near in calls:
            try:
                got = told(called(place, arguments))
            except (AttributeError, ImportError, LookupError, Unwritten) as gone:
                found.append(f"{place}: {gone!r}")
                break
            if not off(got, wanted) <= near:
                found.append(
                    f"{place} of {json.dumps(arguments)[:200]}: {got[:5]}, not {wanted[:5]}"
                )
    return found
