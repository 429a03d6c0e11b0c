"""What each public function of models makes or gives, with each choice it has, changes on purpose.

``python tests/models/test_made.py`` writes the table anew; a changed number then belongs into
CHANGELOG. Of each function: what it makes as it comes, with each switch turned, each word that its
text names, each number doubled. Of each part that is made: what it declares and what it computes at
two points, where no row above or in the tables of parts is the same. The table says that nothing
changed, not that it is right: other tests hold equations against closed forms and printed numbers.
"""

from __future__ import annotations

import csv
import inspect
import re
import sys
import zlib
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).parents[1])]

from recorded import HEAD, close, leaves, of_block, rest, said, signals, told
from test_defaults import EXAMPLES, MODELS, SUBWAY, WHEEL

from slipctl import BadInput, Block, RunFailed, Signal
from slipctl.models import common_form, motors
from slipctl.models.cheng_2022 import freight_resistance, freight_traction
from slipctl.models.huang_2020 import subway_braking, subway_braking_control
from slipctl.models.predictive import predictive_slip
from slipctl.models.wang_2025 import hst_traction, hst_traction_adhesion, hst_traction_control
from slipctl.models.wheel_rail import axles, contact, hertz
from slipctl.models.zhang_2021 import hst_braking, hst_braking_control

pytestmark = pytest.mark.table  # left out unless asked for: pytest -m table

TABLE = Path(__file__).parent / "made.csv"
POINT = (0.54, 1.2, 1.0)
SMALL = axles.Axles((2, 1), (0.0, 3.0), (True, False))

GIVEN: dict[str, Callable[[], Any]] = {
    **{f"{n}()": make for n, make in EXAMPLES.items()},
    **{f"laws({driven})[{n}]": lambda make=make: make(WHEEL)
       for driven in (False, True) for n, make in common_form.laws(driven).items()},
    "of_cheng(consistent)": lambda: common_form.of_cheng("consistent")(WHEEL),
    "cheng_barrier": lambda: common_form.cheng_barrier(WHEEL),
    "predictive_slip": lambda: predictive_slip.predictive(SUBWAY)(WHEEL),
    "predictive_slip(gate)": lambda: predictive_slip.predictive(
        SUBWAY, horizon=12, gate=True)(WHEEL),
    "rolling": lambda: axles.rolling(contact.polach, SMALL, 1e-3, ("k_A",), ("r", "T_b")),
    "Axles.grouped": lambda: axles.Axles((4, 2, 2), (0.0, 9.0, 18.0), (True, False, True))
    .grouped(),
    "hst_traction.plant": lambda: hst_traction.plant(axles=SMALL, distinct=("k_A",)),
    "hst_traction.plant(motors)": lambda: hst_traction.plant(
        h=1e-4, motor=motors.vector_drive(20.0)),
    "hst_traction.formation": lambda: hst_traction.formation((True, False)),
    "hst_traction.tractive_effort": lambda: [hst_traction.tractive_effort(v) for v in (3.0, 60.0)],
    **{f"hst_traction_control.{n}": lambda b=b: b for n, b in hst_traction_control.laws().items()},
    "hst_traction_control.controller": lambda: hst_traction_control.controller(
        hst_traction_control.laws()["hosm"], axles=2),
    "hst_traction_control.controller(free)": lambda: hst_traction_control.controller(
        hst_traction_control.laws()["smc"], limited=False, ticks=3),
    "hst_braking_control.controller": lambda: hst_braking_control.controller(
        hst_braking_control.prescribed(), checked=False),
    "subway_braking_control.controller": lambda: subway_braking_control.controller(
        subway_braking_control.super_twisting()),
    "subway_braking.peak": lambda: [subway_braking.peak_slip(1.0, 0.54, 1.2)],
    "hst_braking.peak": lambda: [
        f(1.28, 23.99, 0.52) for f in (hst_braking.peak_slip, hst_braking.peak_height)],
    "freight_traction.peak": lambda: [
        freight_traction.peak_creep(*POINT), freight_traction.peak_height(*POINT),
        freight_traction.peak_curvature(*POINT), freight_traction.steepest_slope(*POINT)],
    **{f"freight_resistance.swarm_settings({f})":
       lambda f=f: freight_resistance.swarm_settings(f) for f in ("consistent", "printed-21")},
    "contact.patch": lambda: [[*contact.patch(65e3, 0.46).values()],
                              [*contact.patch(65e3, 0.6, nu=0.2).values()]],
    "contact.patch_of_curve": lambda: [
        [*contact.patch_of_curve(65e3, 80e9, 0.46, 0.3, nu).values()] for nu in (0.25, 0.28)],
    "contact.peak": lambda: [contact.peak(v, s) for v in (2.0, 30.0) for s in ("dry", "wet")],
    "contact.slope": lambda: [contact.slope("dry"), contact.slope("wet")],
    "contact.curtius_kniffler": lambda: [contact.curtius_kniffler(v) for v in (0.0, 40.0)],
    "hertz.ellipse": lambda: [hertz.ellipse(6e4, 1.1, 1.7), hertz.ellipse(6e4, 2.1, 0.2, nu=0.2)],
    "hertz.ellipse_of_ratio": lambda: [hertz.ellipse_of_ratio(6e4, 0.46, r) for r in (0.7, 1.8)],
    "hertz.c11": lambda: [hertz.c11(r, nu) for r in (0.15, 0.7, 1.0, 2.3, 9.0)
                          for nu in (0.1, 0.27)],
    "hertz.elliptic": lambda: [hertz.elliptic(m) for m in (0.0, 0.3, 0.9)],
    "typical_surfaces": hst_traction_adhesion.typical_surfaces,
}  # fmt: skip
"""What functions with arguments of their own give, by name."""


@cache
def functions() -> dict[str, Callable[[], Any]]:
    """How each thing of the table is made."""
    found = dict(GIVEN)
    for name in MODELS:
        module, _, short = name.rpartition(".")
        made = getattr(import_module(f"slipctl.models.{module}"), short)
        if isinstance(made, Block):
            found[name] = lambda b=made: b
            continue
        if name in EXAMPLES:
            continue
        wanted = inspect.signature(made).parameters.values()
        if any(p.default is p.empty and p.kind is not p.VAR_KEYWORD for p in wanted):
            continue
        found[f"{name}()"] = made
        for p in wanted:
            for value in others(p.default, made.__doc__ or ""):
                found[f"{name}({p.name} = {value})"] = lambda f=made, n=p.name, v=value: f(**{n: v})
    return found


def others(default: object, text: str) -> list[Any]:
    """Other values of a keyword: the switch turned, words that the text names, twice the number."""
    if isinstance(default, bool):
        return [not default]
    if isinstance(default, str):
        return [w for w in dict.fromkeys(re.findall(r'``"([\w-]+)"``', text)) if w != default]
    return [2 * default] if isinstance(default, int | float) else []


def rows(what: str) -> Iterator[list[str]]:
    """What is made, or what is given, or why it is refused."""
    try:
        made = functions()[what]()
    except (BadInput, RunFailed) as error:
        yield ["", "", "refused", "", str(error), *[""] * 6]
        return
    if not isinstance(made, Block):
        for k, value in enumerate(made if isinstance(made, list) else [made]):
            for n, number in enumerate(flat(value)):
                yield ["", f"{k}.{n}", "gives", "", *[""] * 5, number, ""]
        return
    if made.parts:
        yield ["", "", "whole", "", "", "", "", "", of_block(made), "", ""]
        yield ["", "", "names", "", *map(counted, (made.params, made.inputs, made.wires.items())),
               *[""] * 4]  # fmt: skip
        for s in made.outputs.values():
            yield ["", s.name, "whole", s.unit, "", said(s.lo), said(s.hi), s.positive or "",
                   rest(s), "", ""]  # fmt: skip
    seen: dict[str, int] = {}
    for part in leaves(made):
        title = told(part)
        seen[title] = seen.get(title, 0) + 1
        title += f" [{seen[title]}]" if seen[title] > 1 else ""
        yield from ([title, *r] for r in signals(part))


def counted(names: Iterable[object]) -> str:
    """How many there are, and a checksum of them: of what is shared or wired there are less."""
    text = " ".join(sorted(map(str, names)))
    return f"{len(text.split())} {zlib.crc32(text.encode()):08x}"


def flat(value: Any) -> list[str]:
    """Numbers of a value, one by one."""
    if isinstance(value, dict):
        return [part for v in value.values() for part in flat(v)]
    if isinstance(value, list | tuple | np.ndarray):
        return [part for v in value for part in flat(v)]
    if callable(value):
        return flat([value(0.0), value(0.3), value(1.0)])
    if isinstance(value, Signal):
        return [said(value.value)]
    if hasattr(value, "__dataclass_fields__"):
        return flat([getattr(value, n) for n in value.__dataclass_fields__])
    return [said(value)]


@cache
def table() -> dict[str, dict[tuple[str, str, str], list[str]]]:
    found: dict[str, dict[tuple[str, str, str], list[str]]] = {}
    with TABLE.open(newline="", encoding="utf-8") as file:
        for what, *r in list(csv.reader(file))[1:]:
            found.setdefault(what, {})[r[0], r[1], r[2]] = r
    return found


@pytest.mark.parametrize("what", functions())
def test_what_is_made_is_what_the_table_says(what: str) -> None:
    have: dict[tuple[str, str, str], list[str]] = {}
    for r in rows(what):
        have.setdefault((r[0], r[1], r[2]), r)
    wanted = table().get(what, {})
    changed = [(r, have.get(key)) for key, r in wanted.items()
               if not all(map(close, have.get(key, [""] * len(r)), r))]  # fmt: skip
    assert changed == []


def test_the_table_is_of_most_functions() -> None:
    assert len(table()) > 120
    assert {*table()} <= {*functions()}


if __name__ == "__main__":
    seen: set[tuple[str, ...]] = set()
    for path in (Path(__file__).parent / "parts").glob("*.csv"):
        with path.open(newline="", encoding="utf-8") as file:
            seen |= {tuple(r) for r in csv.reader(file)}
    with TABLE.open("w", newline="", encoding="utf-8") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(["what", *HEAD])
        for what in functions():
            for r in rows(what):
                if not r[0] or tuple(r) not in seen:
                    writer.writerow([what, *r])
                seen.add(tuple(r))
