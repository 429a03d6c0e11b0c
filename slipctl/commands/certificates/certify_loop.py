"""``slipctl certify STUDY:LOOP``, ``--map`` and ``--largest``: gains of a loop, maps, and ends."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

from slipctl import __version__
from slipctl.block.block import Block
from slipctl.certify import boundary, catalogue, proofs, systems
from slipctl.certify.boundary import Farthest
from slipctl.certify.systems import System
from slipctl.commands.certificates.certify_numbers import read_numbers
from slipctl.commands.progress import Progress
from slipctl.design import maps
from slipctl.design.gain_points import Asked, GainPoints, replaced_numbers
from slipctl.design.levels import levels, places
from slipctl.design.maps import Axis
from slipctl.errors import BadInput, nearest
from slipctl.run import machine, store
from slipctl.run.metrics import METRICS
from slipctl.run.numbers import check_guards
from slipctl.run.sweep.sweep_runs import Measured
from slipctl.study import resolve
from slipctl.study.declaration import Gains, Study
from slipctl.study.jobs import Cores
from slipctl.study.request import Request


def find(name: str) -> tuple[Study, list[Gains]]:
    """Gains that a study declares of ``STUDY:LOOP``, or by their own name ``STUDY:GAINS``.

    Raises:
        BadInput: no such study, loop or gains.
    """
    left, _, right = name.rpartition(":")
    if left.endswith(".py") and not hasattr(resolve.load_file(left), "study"):
        raise BadInput(
            f"{left} declares no study, so it does not say what {right} has to withstand;"
            " write its gains into a Study, or its tick as a System (slipctl docs certify)"
        )
    study = resolve.load_study(left)
    asked, reasons = study.certificates
    exact = [g for g in asked if g.name == right]
    loop, at, _ = right.partition("@")
    of_loop = [g for g in asked
               if g.loop == right or (not at and g.loop.partition("@")[0] == loop)]  # fmt: skip
    found = of_loop or exact
    if found:
        return study, found
    known = [*dict.fromkeys([*(g.loop for g in asked), *(g.name for g in asked)])]
    if loop in resolve.loop_names(study):
        why = f": {reasons[loop]}" if loop in reasons else ""
        told = f"; it has {', '.join(known)}" if known else ""
        raise BadInput(f"{study.name} declares no gains of {right} to certify{why}{told}")
    raise BadInput(f"{study.name} has no loop {right!r}{nearest(right, known)}")


def own_system(name: str) -> System | None:
    """System that a file of one's own declares, ``my.py:own``; None where it is something else.

    Raises:
        BadInput: no such file, or it cannot be run.
    """
    left, _, right = name.rpartition(":")
    found = getattr(resolve.load_file(left), right, None) if left.endswith(".py") else None
    return found if isinstance(found, System) else None


def system_by_name(name: str, hint: str = "") -> System:
    """System of a file of one's own, or of the catalogue.

    Raises:
        BadInput: there is none, with the nearest and a hint behind it.
    """
    own = own_system(name)
    if own is None and name not in catalogue.SYSTEMS:
        names = (*catalogue.SYSTEMS, *resolve.studies())
        raise BadInput(f"cannot certify {name!r}{nearest(name, names)}{hint}")
    return own or catalogue.system(name)


def is_loop(name: str) -> bool:
    """Whether a name is ``STUDY:LOOP``."""
    left, colon, _ = name.rpartition(":")
    return bool(colon) and (left in resolve.studies() or left.endswith((".py", ".toml")))


def one(name: str, settings: Sequence[str] = ()) -> tuple[Gains, Block]:
    """Gains of ``STUDY:LOOP`` or ``STUDY:GAINS`` and their loop, where that is one certificate.

    The loop has what was set, as :class:`slipctl.study.request.Request` gives it.

    Raises:
        BadInput: it has several.
    """
    study, gains = find(name)
    if len(gains) > 1:
        known = ", ".join(f"{study.name}:{g.name}" for g in gains)
        gains = [g for g in study.certificates.gains if g.name == name.rpartition(":")[2]]
        if len(gains) != 1:
            raise BadInput(f"{name} has several certificates; write which: {known}")
    loop = Request.of(study, gains[0].loop, settings).chosen[0]
    check_guards(loop)
    return gains[0], loop


def map_answer(options: argparse.Namespace, command: str) -> str:
    """Answer of ``--map``: writes the map, and says what is in it.

    Raises:
        BadInput: a system or loop that there is not, axes that are none.
    """
    at, what = _asked(options)
    system, given = at({})
    declared: dict[str, Any] = {
        k: n.value for k, n in system.numbers.items() if n.value is not None
    }
    axes = maps.read_axes(options.map, system, {**declared, **given})
    stem = re.sub(r"\W", "_", options.system)
    folder = Path(options.out or Path("out") / f"map_{stem}")
    if folder.suffix == ".json":
        raise BadInput(f"--out {folder}: a map is a picture and data; write a folder")
    store.check_folder(folder)
    seen = _measured(options, axes, given) if options.metric is not None else None
    progress = Progress(1 + (seen is not None), sys.stderr, options.quiet)
    try:
        with Cores(None) as cores:
            found = maps.drawn_map(
                at, axes, what, options.points, cores, lambda share: progress("map", share)
            )
        if seen is not None:
            xs, ys = (a.values(options.points) for a in axes)
            found = replace(found, levels=levels(
                *seen, xs, ys, machine.cores(), lambda share: progress(options.metric, share)
            ))  # fmt: skip
    finally:
        progress.end()
    files = maps.write(found, folder, command)
    return maps.text(found) + "\n\n" + "\n".join(map(str, files))


def _measured(
    options: argparse.Namespace, axes: Sequence[Axis], given: Mapping[str, Any]
) -> tuple[Measured, str, tuple[str, str]]:
    """Loop of a map, its metric, and the numbers of the loop that the axes set.

    Raises:
        BadInput: no such metric, a system in place of a loop, or axes that are no numbers of it.
    """
    if options.metric not in METRICS:
        known = nearest(options.metric, METRICS)
        raise BadInput(f"--metric {options.metric}: there is no such metric{known}")
    if not is_loop(options.system):
        raise BadInput(f"--metric runs a loop, and {options.system} is a system; map STUDY:LOOP")
    gains, _ = one(options.system)
    study, _ = find(options.system)
    loop, case = Request.of(study, gains.loop, options.settings).chosen
    at = places(loop, study.controller, [a.name for a in axes], given)
    return Measured(loop, case.scenario, study.signals, case.known), options.metric, at


def ends(options: argparse.Namespace, command: str) -> str:
    """Answer of ``--largest`` and ``--smallest``: how far a number may go, with both certificates.

    Raises:
        BadInput: a system or number that there is not, or both questions at once.
    """
    up = options.largest is not None
    if up and options.smallest is not None:
        raise BadInput("ask for --largest or for --smallest")
    at, what = _asked(options)
    system = at({})[0]
    folder = Path(options.out) if options.out else None
    if folder is not None:
        if folder.suffix == ".json":
            raise BadInput(f"--out {folder}: this writes two certificates; write a folder")
        store.check_folder(folder)
    found = boundary.farthest(at, options.largest if up else options.smallest, up)
    files = []
    for side in ("certified", "refuted"):
        value = getattr(found, side)
        if folder is not None and value is not None:
            there, given = at({found.name: value})
            numbers = systems.exact_numbers(there, {**given, found.name: Fraction(str(value))})
            folder.mkdir(parents=True, exist_ok=True)
            files.append(str(folder / f"{side}.json"))
            store.write_text(Path(files[-1]), store.json_text(proofs.write(there, numbers)))
    if options.json:
        said = {"format": store.FORMAT, "of": what, "system": system.name, **found.payload()}
        return store.json_text(said | {"slipctl": __version__, "command": command}).rstrip()
    return "\n".join([f"{what}: the {'largest' if up else 'smallest'} {found.name}",
                      *_told(found), *files])  # fmt: skip


def _told(found: Farthest) -> list[str]:
    """What was found of a number, in words."""
    unit = "" if found.unit == "1" else f" {found.unit}"
    span = [v for v, _ in found.tried]
    far = max(span) if found.up else min(span)
    to, on = ("up to", "from") if found.up else ("down to", "from")
    rows = [f"  CERTIFIED {to} {found.certified:g}{unit}" if found.certified is not None
            else f"  CERTIFIED nowhere from {min(span):g} to {max(span):g}{unit}"]  # fmt: skip
    if found.refuted is not None:
        rows.append(f"  REFUTED   {on} {found.refuted:g}{unit}")
    elif found.certified == far:
        rows.append(f"  no limit was found up to {far:g}{unit}")
    else:
        rows.append(f"  REFUTED   nowhere up to {far:g}{unit}")
    rows.append(f"  {len(found.tried)} values were tried; between them nothing is promised")
    return rows


def _asked(options: argparse.Namespace) -> tuple[Callable[[Mapping[str, float]], Asked], str]:
    """System and numbers of a question, at the numbers of a point, and its name in words.

    Raises:
        BadInput: a system or loop that there is not; numbers of a loop that were typed.
    """
    name = options.system
    if is_loop(name) and own_system(name) is None:
        gains, loop = one(name, options.settings)
        points = GainPoints(gains, loop, find(name)[0].controller)
        return points.at, f"{name.rpartition(':')[0]}:{gains.name}"
    system = system_by_name(name, "; write a system or STUDY:LOOP")
    return replaced_numbers(system, read_numbers(system, options.settings)), name
