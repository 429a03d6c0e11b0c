"""Single calls of a room's functions, and what they give: a net under its numbers.

``python tests/recorded_calls.py slipctl/certify`` draws the calls anew: it runs the room's tests,
looks at the arguments with which its functions are called, and keeps of each function the smallest
few that take all of its branches. ``--again`` keeps the calls of the table and computes anew what
they give. Both say what changed; a number that changed belongs into CHANGELOG.

The net says that nothing changed, not that it is right: the adversary, closed forms and the checker
hold what is promised. What a result may be off by is measured: calls are repeated with other
kernels of BLAS and with elementary functions that are one unit off in the last place.
"""

from __future__ import annotations

import argparse
import importlib
import inspect
import json
import lzma
import math
import os
import subprocess
import sys
import time
import types
import zlib
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from decimal import Decimal
from fractions import Fraction
from functools import cached_property, lru_cache, partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
ROOMS = {
    "slipctl/certify": ["tests/certify", "tests/commands/test_cli_certify.py",
                        "tests/seek/test_extremum.py", "tests/seek/test_extremum_lock.py"],
    "slipctl/estimate": ["tests/estimate", "tests/models/test_parts.py"],
}  # fmt: skip
LARGEST, LONGEST = 6000, 0.25
"""Letters of the arguments that are kept, and s of CPU of a call."""
LOOKED_AT = 6
"""Calls of a function that are looked at in each test."""
MORE = 3
"""Calls that are kept beside those that are needed for all branches."""
SHOWN = 16
"""Numbers of a result that are kept one by one; the others are summed."""
STEPS = 64
"""Values of a generator that are looked at."""
EXACT, LOOSE = 1e-14, 1e-6
"""Shares by which a float may be off, at least; where it may be off by more, it is not kept."""


class Unwritten(Exception):
    """A value that has no text: a closure, a file, an object of another package."""


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


def parts(value: Any) -> dict[str, Any]:
    """Attributes that make an object of this package what it is."""
    if is_dataclass(value):
        return {f.name: getattr(value, f.name) for f in fields(value)}
    slots = [s for c in type(value).__mro__ for s in getattr(c, "__slots__", ())]
    return {s: getattr(value, s) for s in slots if hasattr(value, s)} | getattr(
        value, "__dict__", {}
    )


class Writer:
    """Values as JSON; objects that modules hold by their names."""

    def __init__(self) -> None:
        self.held = {
            id(v): f"{name}:{k}" for name, module in list(sys.modules.items())
            if name.startswith("slipctl.") for k, v in vars(module).items()
            if type(v).__module__.startswith("slipctl.") and not isinstance(v, tuple)
        }  # fmt: skip

    def text(self, value: Any) -> Any:
        own = self.text
        if value is None or isinstance(value, bool | str) or type(value) is int:
            return value
        if type(value) is float:
            return value if math.isfinite(value) else {"x": str(value)}
        if id(value) in self.held:
            return {"g": self.held[id(value)]}
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
        if isinstance(value, type | types.FunctionType):
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
    function = named(place)
    for kind, own in ((classmethod, "__func__"), (staticmethod, "__func__"), (property, "fget"),
                      (cached_property, "func")):  # fmt: skip
        if isinstance(function, kind):
            function = getattr(function, own)
    first, more = [value(v) for v in arguments[0]], {k: value(v) for k, v in arguments[1].items()}
    writer = Writer()
    before = writer.text(first)
    try:
        found = function(*first, **more)
        if isinstance(found, Iterator):
            found = list(islice(found, STEPS))
        text = writer.text(found)
    except Unwritten:
        raise
    except Exception as refused:  # noqa: BLE001  # whatever it is, it is what the call gives
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
            except (AttributeError, ImportError, Unwritten) as gone:
                found.append(f"{place}: {gone!r}")
                break
            if not off(got, wanted) <= near:
                found.append(
                    f"{place} of {json.dumps(arguments)[:200]}: {got[:5]}, not {wanted[:5]}"
                )
    return found


# ---- drawing calls -------------------------------------------------------------------------------


@dataclass
class Seen:
    """Calls of one function that were looked at."""

    place: str
    branches: set[tuple[int, int]] = field(default_factory=set)
    kept: dict[str, set[tuple[int, int]]] = field(default_factory=dict)
    test: int = -1
    left: int = 0
    calls: int = 0


class Watch:
    """Looks at the calls of the functions of a room while its tests run."""

    def __init__(self, room: str) -> None:
        self.prefix, self.room = str(ROOT / room) + os.sep, room.replace("/", ".")
        self.known: dict[int, Seen | None] = {}
        self.codes: list[types.CodeType] = []
        self.test = 0
        self.writer: Writer | None = None

    def of(self, frame: types.FrameType) -> Seen | None:
        code = frame.f_code
        self.codes.append(code)  # lives, so that its id is its own
        if not code.co_filename.startswith(self.prefix) or "<" in code.co_qualname:
            return None
        return Seen(f"{frame.f_globals['__name__']}:{code.co_qualname}")

    def arguments(self, frame: types.FrameType) -> str | None:
        """Text of the arguments, None if they have none or a long one."""
        code, local = frame.f_code, frame.f_locals
        number, only = code.co_argcount, code.co_kwonlyargcount
        names = code.co_varnames[:number]
        try:
            if code.co_flags & inspect.CO_GENERATOR and len(local) > number + only:
                return None  # it goes on
            if code.co_flags & (inspect.CO_VARARGS | inspect.CO_VARKEYWORDS):
                return None
            assert self.writer
            first = [self.writer.text(local[k]) for k in names]
            more = {k: self.writer.text(local[k])
                    for k in code.co_varnames[number : number + only]}  # fmt: skip
        except (Unwritten, KeyError, AttributeError, RecursionError):
            return None
        text = json.dumps([first, more])
        return text if len(text) <= LARGEST else None

    def __call__(self, frame: types.FrameType, event: str, arg: Any) -> Any:
        key = id(frame.f_code)
        if key not in self.known:
            self.known[key] = self.of(frame)
        seen = self.known[key]
        if seen is None:
            return None
        seen.calls += 1
        if seen.test != self.test:
            seen.test, seen.left = self.test, LOOKED_AT
        if seen.left <= 0 and seen.calls & (seen.calls - 1):
            return None
        seen.left -= 1
        text = self.arguments(frame)
        if text is None or text in seen.kept:
            return None
        before, taken = [frame.f_lineno], set[tuple[int, int]]()

        def line(frame: types.FrameType, event: str, arg: Any) -> Any:
            if event == "line":
                taken.add((before[0], frame.f_lineno))
                before[0] = frame.f_lineno
            elif event == "return":
                seen.kept[text] = taken
            return line

        return line

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[Any]:
        self.test += 1
        self.writer = Writer()
        start = time.process_time()
        sys.settrace(self)
        try:
            return (yield)
        finally:
            sys.settrace(None)
            print(f"{time.process_time() - start:.1f} s {item.nodeid}", file=sys.stderr, flush=True)


def numbers_in(text: str) -> int:
    """How many different numbers there are in arguments."""
    return len({v for v in leaves(json.loads(text)) if v not in (0.0, "0", "1", 1.0)})


def chosen(seen: Seen) -> list[str]:
    """Smallest calls that take all branches that were taken, and some that hold many numbers."""
    found: list[str] = []
    taken: set[tuple[int, int]] = set()
    while True:
        best = max(seen.kept, key=lambda t: (len(seen.kept[t] - taken), -len(t)), default=None)
        if best is None or not (seen.kept[best] - taken or not found):
            break
        found.append(best)
        taken |= seen.kept[best]
    others = sorted(set(seen.kept) - set(found), key=lambda t: (-numbers_in(t), len(t), t))
    return found + [t for t in others if len(t) < LARGEST / 4][:MORE]


def drawn(room: str, tests: list[str]) -> dict[str, list[Any]]:
    """Calls of a room's functions, of those that its tests make."""
    watch = Watch(room)
    pytest.main(["-n", "0", "-q", "-p", "no:cacheprovider", *tests], plugins=[watch])
    seen = sorted((s for s in watch.known.values() if s and s.kept), key=lambda s: s.place)
    return {s.place: [json.loads(t) for t in chosen(s)] for s in seen}


VARIANTS: list[dict[str, str]] = [
    {}, {"OPENBLAS_CORETYPE": "Prescott"}, {"OPENBLAS_CORETYPE": "Haswell"},
    {"OPENBLAS_CORETYPE": "SkylakeX"}, {"NUDGED": "1"}, {"NUDGED": "-1"},
]  # fmt: skip


def nudge(side: int) -> None:
    """Elementary functions that are one unit off in the last place, as on another machine."""

    def other(function: Callable[..., Any]) -> Callable[..., Any]:
        def moved(*given: Any, **more: Any) -> Any:
            found = function(*given, **more)
            return np.nextafter(found, side * np.inf) if isinstance(found, np.ndarray) else (
                math.nextafter(found, side * math.inf))  # fmt: skip

        return moved

    for module in (math, np):
        for name in ("sin", "cos", "tan", "exp", "log", "log1p", "expm1", "atan", "acos", "asin",
                     "atan2", "log10", "sinh", "cosh", "tanh"):  # fmt: skip
            if hasattr(module, name):
                setattr(module, name, other(getattr(module, name)))


def results(calls: Mapping[str, list[Any]]) -> dict[str, list[Any]]:
    """What calls give, and s of CPU; None where a result has no text."""
    found: dict[str, list[Any]] = {}
    for place, every in calls.items():
        own: list[Any] = []
        for arguments in every:
            start = time.process_time()
            try:
                got = told(called(place, arguments))
            except (Unwritten, AttributeError, ImportError, TypeError):
                got = None
            own.append([got, time.process_time() - start])
        found[place] = own
    return found


def measured(calls: Mapping[str, list[Any]]) -> dict[str, list[Any]]:
    """Calls with what they give and what that may be off by; without those that wander or last."""
    runs = []
    for more in VARIANTS:
        done = subprocess.run(
            [sys.executable, __file__, "--results"], input=json.dumps(calls), text=True, check=True,
            stdout=subprocess.PIPE, env={**os.environ, "OPENBLAS_NUM_THREADS": "1", **more},
        )  # fmt: skip
        runs.append(json.loads(done.stdout))
    kept: dict[str, list[Any]] = {}
    for place, every in calls.items():
        for i, arguments in enumerate(every):
            (wanted, seconds), *others = [run[place][i] for run in runs]
            if wanted is None or seconds > LONGEST or any(o[0] is None for o in others):
                continue
            near = max(EXACT, 100 * max(off(o[0], wanted) for o in others))
            if near <= LOOSE:
                kept.setdefault(place, []).append([arguments, wanted, near])
    return kept


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("room", nargs="?", choices=ROOMS)
    parser.add_argument("--again", action="store_true", help="keep the calls, not what they give")
    parser.add_argument("--tests", nargs="+", help="draw from these tests only")
    parser.add_argument("--results", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.results:
        if "NUDGED" in os.environ:
            nudge(int(os.environ["NUDGED"]))
        print(json.dumps(results(json.load(sys.stdin))))
        return 0
    room, file = options.room, table(options.room)
    if file.exists():
        print("\n".join(changed(room)) or "nothing changed")
    if options.again:
        calls = {k: [c[0] for c in v] for k, v in read(room).items()}
    else:
        calls = drawn(room, options.tests or ROOMS[room])
    found = measured(calls)
    file.write_bytes(lzma.compress(json.dumps(found, indent=0).encode(), preset=9))
    print(f"{room}: {sum(map(len, found.values()))} calls of {len(found)} functions, of"
          f" {sum(map(len, calls.values()))} of {len(calls)}")  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
