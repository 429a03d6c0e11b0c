"""Draw the calls of ``recorded_calls``: python tests/draw_calls.py slipctl/certify.

It runs the room's tests, looks at the arguments with which its functions are called, and varies
their numbers. Of each function it keeps few calls: the smallest that take all of its branches, some
with many numbers, and those that tell small changes of its code apart (``mutation/sites.py``; a
quarter of them, drawn by name, so that the others say how well the choice carries over).
``--again`` keeps the calls of the table and computes anew what they give. Both say what changed.

What a result may be off by is measured: calls are repeated with other kernels of BLAS and with
elementary functions that are one unit off in the last place.
"""

from __future__ import annotations

import argparse
import importlib
import inspect
import json
import lzma
import math
import multiprocessing
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
import types
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recorded_calls import (
    ROOT,
    Unwritten,
    Writer,
    called,
    changed,
    leaves,
    off,
    place_of_code,
    read,
    table,
    told,
)

sys.path += [str(Path(__file__).parent / f) for f in ("mutation", "certify")]
import inside
from sites import Site

ROOMS = {
    "slipctl/certify": ["tests/certify", "tests/commands/test_cli_certify.py",
                        "tests/seek/test_extremum.py", "tests/seek/test_extremum_lock.py"],
    "slipctl/estimate": ["tests/estimate", "tests/models/test_parts.py"],
}  # fmt: skip
LARGEST, SMALL, LONGEST = 40_000, 1500, 0.6
"""Letters of the arguments that are kept and of those that are varied, and s of CPU of a call."""
NAMELESS = ("<module>", "<listcomp>", "<setcomp>", "<dictcomp>", "<genexpr>")
LOOKED_AT, STEPS = 8, 5_000
"""Calls of a function that are looked at in each test, and steps of a call that are followed."""
MORE, VARIED = 2, 16
"""Calls of a function with many numbers that are kept, and with other numbers that are tried."""
PATIENCE, BUDGET = 0.2, 3.0
"""s of CPU that calls are tried for one change, and for all changes of a function."""
CHANGED = 1e-13
"""Share by which a result is another one."""
EXACT, LOOSE = 1e-14, 1e-6
"""Shares by which a float may be off, at least; where it may be off by more, it is not kept."""


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
        self.unwritten: Counter[str] = Counter()

    def of(self, frame: types.FrameType) -> Seen | None:
        code = frame.f_code
        self.codes.append(code)  # lives, so that its id is its own
        if not code.co_filename.startswith(self.prefix) or code.co_name in NAMELESS:
            return None
        module = frame.f_globals["__name__"]
        if "<" not in code.co_qualname:
            return Seen(f"{module}:{code.co_qualname}")
        try:
            return Seen(place_of_code(code, module))
        except (Unwritten, AttributeError):
            return None

    def arguments(self, frame: types.FrameType) -> str | None:
        """Text of the arguments, None if they have none or a long one."""
        code, local = frame.f_code, frame.f_locals
        number, only = code.co_argcount, code.co_kwonlyargcount
        names, held = code.co_varnames[:number], code.co_freevars
        if "<locals>" not in code.co_qualname:
            held = ()  # __class__
        try:
            spread = bool(code.co_flags & inspect.CO_VARARGS)
            named = bool(code.co_flags & inspect.CO_VARKEYWORDS)
            if code.co_flags & inspect.CO_GENERATOR and len(local) > (
                number + only + spread + named + len(held)
            ):
                return None  # it goes on
            text = self.writer.text  # type: ignore[union-attr]
            first = [text(local[k]) for k in names]
            more = {k: text(local[k]) for k in code.co_varnames[number : number + only]}
            if spread:
                first += map(text, local[code.co_varnames[number + only]])
            if named:
                more |= {
                    k: text(v) for k, v in local[code.co_varnames[number + only + spread]].items()
                }
            cells = {k: text(local[k]) for k in held}
        except (Unwritten, KeyError, AttributeError, RecursionError) as why:
            self.unwritten[f"{frame.f_globals['__name__']}:{code.co_qualname}: {why!r}"[:160]] += 1
            return None
        text = json.dumps([first, more, *([cells] if "<locals>" in code.co_qualname else [])])
        local_path = str(ROOT) in text or tempfile.gettempdir() in text
        return text if len(text) <= LARGEST and not local_path else None

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
        before, taken, left = -1, set[tuple[int, int]](), STEPS
        frame.f_trace_lines, frame.f_trace_opcodes = False, True  # conditions within a line, too

        def step(frame: types.FrameType, event: str, arg: Any) -> Any:
            nonlocal before, left
            if event == "opcode":
                taken.add((before, frame.f_lasti))
                before, left = frame.f_lasti, left - 1
                frame.f_trace_opcodes = left > 0
            elif event == "return":
                seen.kept[text] = taken
            return step

        return step

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


def needed(seen: Seen) -> list[str]:
    """Smallest calls that take all branches that were taken."""
    found: list[str] = []
    taken: set[tuple[int, int]] = set()
    while True:
        best = max(seen.kept, key=lambda t: (len(seen.kept[t] - taken), -len(t)), default=None)
        if best is None or not (seen.kept[best] - taken or not found):
            return found
        found.append(best)
        taken |= seen.kept[best]


def candidates(room: str, tests: list[str]) -> dict[str, list[Any]]:
    """Calls of a room's functions, of those that its tests make; the needed ones first."""
    watch = Watch(room)
    pytest.main(["-n", "0", "-q", "-p", "no:cacheprovider", *tests], plugins=[watch])
    for why, number in watch.unwritten.most_common():
        print(f"without text {number:7} {why}", file=sys.stderr)
    found = {}
    for seen in sorted((s for s in watch.known.values() if s and s.kept), key=lambda s: s.place):
        first = needed(seen)
        others = sorted(set(seen.kept) - set(first), key=lambda t: (-numbers_in(t), len(t), t))
        others = [t for t in others if len(t) < SMALL]
        found[seen.place] = [len(first), *map(json.loads, first + others[:24])]
    return found


# ---- choosing ------------------------------------------------------------------------------------


def varied(text: Any, rng: random.Random, share: float) -> Any:
    """The same arguments with some other numbers."""
    if isinstance(text, bool) or not isinstance(text, int | float | list | dict):
        return text
    if isinstance(text, list):
        return [varied(v, rng, share) for v in text]
    if isinstance(text, dict):
        ((kind, of),) = text.items()
        if kind == "C":
            held = {k: varied(v, rng, share) for k, v in of[1].items()}
            return {kind: [of[0], held, of[2]]}
        if kind == "m":
            return {kind: [varied(of[0], rng, share), of[1]]}
        if kind in ("q", "D"):
            if rng.random() > share:
                return text
            number = Fraction(of) * Fraction(rng.choice(("1/3", "7/8", "1.01", "5/3", "4", "-1")))
            number += Fraction(rng.choice((0, 0, 0, "1/7", 1)))
            return {kind: str(number) if kind == "q" else repr(float(number))}
        if kind in ("x", "g", "p", "h", "X", "u"):
            return text
        if kind in ("N", "O", "n"):
            return {kind: [of[0], varied(of[1], rng, share) if kind != "O" else
                           {k: varied(v, rng, share) for k, v in of[1].items()}]}  # fmt: skip
        if kind == "a":
            return {kind: [*of[:2], varied(of[2], rng, share)]}
        if kind == "d":
            return {kind: [[k, varied(v, rng, share)] for k, v in of]}
        return {kind: varied(of, rng, share)}
    if rng.random() > share:
        return text
    if isinstance(text, int):
        return text + rng.choice((-2, -1, 1, 2, 5))
    return text * rng.choice((0.0, 0.3, 0.875, 1.01, 1.7, 4.0, -1.0)) + rng.choice((0, 0, 0.1, 1))


class Late(BaseException):
    """A call that takes too long."""


def given(place: str, arguments: Any, patience: float = LONGEST) -> list[Any] | None:
    """What is told of a call; None of one that takes long or has no text."""
    signal.setitimer(signal.ITIMER_PROF, patience)
    try:
        return told(called(place, arguments))
    except (Unwritten, AttributeError, ImportError, LookupError, TypeError, ValueError, Late):
        return None
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)


def late(*_: Any) -> None:
    raise Late


Known = list[tuple[str, Any, list[Any] | None, float]]
"""Calls: place, arguments, what is told of the result, s of CPU."""


def known(place: str, task: list[Any]) -> tuple[Known, Known]:
    """Calls of a function that take all of its branches, and others: as seen, and varied."""
    number, *calls = task
    rng = random.Random(zlib.crc32(place.encode()))
    for _ in range(VARIED):
        (first, *named), share = rng.choice(calls), rng.choice((0.1, 0.3, 1.0))
        others = [{k: varied(v, rng, share) for k, v in of.items()} for of in named]
        calls.append([varied(first, rng, share), *others])
    told: Known = []
    for i, arguments in enumerate(calls):
        start = time.process_time()
        wanted = given(place, arguments, LONGEST if i < number + MORE else LONGEST / 3)
        told.append((place, arguments, wanted, time.process_time() - start))
    return ([c for c in told[: number + MORE] if c[2] is not None],
            [c for c in told[number + MORE :] if c[2] is not None])  # fmt: skip


def telling(task: tuple[str, list[tuple[str, list[Any]]], list[Site]]) -> dict[str, list[Any]]:
    """Of a function and those within: calls for all branches, and those that tell changes apart."""
    top, seen, guides = task
    signal.signal(signal.SIGPROF, late)
    resource.setrlimit(resource.RLIMIT_AS, (4 * 2**30, resource.RLIM_INFINITY))
    kept, others = Known(), Known()
    for place, own in seen:
        first, more = known(place, own)
        kept, others = kept + first, others + more
    others.sort(key=lambda call: call[3])
    memories, began = inside.remembered(), time.process_time()
    for site in guides:
        if time.process_time() - began > BUDGET:
            break
        with inside.changed(top, site) as fits:
            spent = 0.0
            for call in [*kept, *others] if fits else ():
                for memory in memories:
                    memory.cache_clear()
                place, arguments, wanted, seconds = call
                got = given(place, arguments, 0.1 + 5 * seconds)
                if got is None or not off(got, wanted) <= CHANGED:
                    if call in others:
                        kept.append(call)
                        others.remove(call)
                    break
                spent += seconds
                if spent > PATIENCE:
                    break
    found: dict[str, list[Any]] = {}
    for place, arguments, *_ in kept:
        found.setdefault(place, []).append(arguments)
    return found


def guiding(site: Site) -> bool:
    """Whether a change is of the quarter by which calls are chosen."""
    return zlib.crc32(site.name.encode()) % 4 == 0


def drawn(room: str, seen: Mapping[str, list[Any]]) -> dict[str, list[Any]]:
    of = inside.by_place(filter(guiding, inside.changes(room)), seen)
    tops: dict[str, list[tuple[str, list[Any]]]] = {}
    for place, task in seen.items():
        tops.setdefault(place.partition(".<locals>")[0], []).append((place, task))
    tasks = [(top, own, of.get(top, [])) for top, own in tops.items() if inside.is_function(top)]
    with multiprocessing.get_context("fork").Pool(1, maxtasksperchild=50) as pool:
        found: dict[str, list[Any]] = {}
        for more in pool.imap_unordered(telling, tasks):
            found |= more
        return dict(sorted(found.items()))


# ---- what a result may be off by -----------------------------------------------------------------


VARIANTS: list[dict[str, str]] = [
    {}, {"OPENBLAS_CORETYPE": "Prescott"}, {"NUDGED": "1"}, {"NUDGED": "-1"},
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
    for name in ("control", "scipy.integrate", "scipy.optimize", "scipy.linalg"):
        importlib.import_module(name)  # by functions; an import that is cut short stays broken
    signal.signal(signal.SIGPROF, late)
    resource.setrlimit(resource.RLIMIT_AS, (4 * 2**30, resource.RLIM_INFINITY))
    for place, every in calls.items():
        own: list[Any] = []
        for arguments in every:
            start = time.process_time()
            got = given(place, arguments)
            own.append([got, time.process_time() - start])
        found[place] = own
    return found


def measured(calls: Mapping[str, list[Any]]) -> dict[str, list[Any]]:
    """Calls with what they give and what that may be off by; without those that wander or last."""
    children = [
        subprocess.Popen(
            [sys.executable, __file__, "--results"], text=True, stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, env={**os.environ, "OPENBLAS_NUM_THREADS": "1", **more},
        )
        for more in VARIANTS
    ]  # fmt: skip
    with ThreadPoolExecutor() as pool:
        said = pool.map(lambda child: child.communicate(json.dumps(calls))[0], children)
        runs = [json.loads(text) for text in said]
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
    parser.add_argument("--seen", type=Path, help="file of what the tests call, made or taken")
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
        if options.seen and options.seen.exists():
            seen = json.loads(options.seen.read_text(encoding="utf-8"))
        else:
            seen = candidates(room, options.tests or ROOMS[room])
        if options.seen:
            options.seen.write_text(json.dumps(seen), encoding="utf-8")
        calls = drawn(room, seen)
    found = measured(calls)
    file.write_bytes(lzma.compress(json.dumps(found, indent=0).encode(), preset=9))
    print(f"{room}: {sum(map(len, found.values()))} calls of {len(found)} functions, of"
          f" {sum(map(len, calls.values()))} of {len(calls)}")  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
