"""Small programs with each keyword: what they declare, tell and plan changes on purpose only.

``python tests/predict/test_programs.py`` writes the table anew; a changed number then belongs into
CHANGELOG. The table says that nothing changed, not that it is right: other tests compare plans with
general solvers and closed forms. What is new is free until it is in the table.
"""

from __future__ import annotations

import csv
import sys
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).parents[1])]

from programs import FOUND, PROGRAMS
from recorded import HEAD, NEAR, close, said, signals

from slipctl import Block
from slipctl.predict.trials import Driver

pytestmark = pytest.mark.table  # left out unless asked for: pytest -m table

TABLE = Path(__file__).parent / "programs.csv"
LOOSE = 1e-5
"""What an optimum that IPOPT ends at has, and searches that stop within a tolerance."""
TICKS = 3


def rows(what: str) -> Iterator[list[str]]:
    """Signals and plans of a program, what it tells; or the numbers of another result."""
    if what in FOUND:
        for place, number in flat("", FOUND[what]()):
            yield [what, place, "gives", *[""] * 6, said(number), ""]
        return
    block = PROGRAMS[what]()
    yield from ([what, *r] for r in signals(block))
    for k, row in enumerate(block.composition.solves):
        text = " ".join(str(row).split())
        yield [what, f"told {k}", "text", f"{zlib.crc32(text.encode()):08x}", *[""] * 7]
    for k, outputs in enumerate(ticks(block)):
        for n, value in zip(block.outputs, outputs, strict=True):
            yield [what, n, f"tick {k}", *[""] * 6, said(float(value)), ""]


def ticks(block: Block) -> Iterator[np.ndarray]:
    """Outputs of some ticks, from a state that moves on, with all that is seen."""
    tick = Driver(block, compile=False)
    given: dict[str, Any] = {n: s.value if s.value is not None else 1.0
                             for n, s in block.inputs.items()}  # fmt: skip
    given |= {n: 0.6 for n in ("v", "F_top", "F_low") if n in given}
    given |= {n: -2.5 for n in ("F_low",) if n in given}
    for k in range(TICKS):
        given |= {n: 0.1 * k for n in ("x", "age_x", "age_v") if n in given}
        if block.composition.split is not None and k:
            tick.prepare(*given.values())
        yield tick(*given.values())


def flat(place: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Numbers of a result with their places; of an array one number, no entry without weight."""
    if isinstance(value, Block):
        yield from ((f"{place}.{n}", s.hi) for n, s in value.outputs.items())
    elif isinstance(value, xarray.Dataset):
        yield from flat(place, {n: value[n].values for n in sorted(map(str, value.variables))})
    elif hasattr(value, "_fields"):
        yield from flat(place, value._asdict())
    elif is_dataclass(value):
        yield from flat(place, {f.name: getattr(value, f.name) for f in fields(value)})
    elif isinstance(value, Mapping):
        for n, v in value.items():
            yield from flat(f"{place}.{n}" if place else str(n), v)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "fib":
        numbers = value.astype(float).ravel()
        yield f"{place} ({value.size})", float(np.cos(np.arange(value.size)) @ numbers)
    elif isinstance(value, tuple | list):
        for k, v in enumerate(value):
            yield from flat(f"{place}.{k}", v)
    else:
        yield place, value if isinstance(value, str | None) else float(value)


@cache
def table() -> dict[str, list[list[str]]]:
    found: dict[str, list[list[str]]] = {}
    with TABLE.open(newline="", encoding="utf-8") as file:
        for r in list(csv.reader(file))[1:]:
            found.setdefault(r[0], []).append(r)
    return found


@pytest.mark.parametrize("what", [*PROGRAMS, *FOUND])
def test_a_program_is_what_the_table_says(what: str) -> None:
    have = {(r[1], r[2]): r for r in rows(what)}
    near = LOOSE if what in FOUND or "ipopt" in what or "osqp" in what else NEAR
    changed = [
        (r, have.get((r[1], r[2])))
        for r in table()[what]
        if not all(close(h, w, near) for h, w in
                   zip(have.get((r[1], r[2]), [""] * len(r)), r, strict=True))
    ]  # fmt: skip
    assert changed == []


def test_every_program_is_in_the_table() -> None:
    assert {*table()} == {*PROGRAMS, *FOUND}


if __name__ == "__main__":
    with TABLE.open("w", newline="", encoding="utf-8") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(HEAD)
        seen: set[tuple[str, ...]] = set()
        for what in [*PROGRAMS, *FOUND]:
            for r in rows(what):
                key = tuple(r[1:])
                if r[2] in ("gives", "text") or r[2].startswith("tick") or key not in seen:
                    writer.writerow(r)
                seen.add(key)
