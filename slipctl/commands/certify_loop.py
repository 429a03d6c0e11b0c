"""``slipctl certify STUDY:LOOP`` and ``--map``: gains of one loop, and maps of two numbers."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from slipctl.block.block import Block
from slipctl.certify import catalogue
from slipctl.certify.systems import System
from slipctl.commands.progress import Progress
from slipctl.errors import BadInput, nearest
from slipctl.run import store
from slipctl.study import doors
from slipctl.study.declaration import Gains, Study


def find(name: str) -> tuple[Study, list[Gains]]:
    """Gains that a study declares of ``STUDY:LOOP``, or by their own name ``STUDY:GAINS``.

    Raises:
        BadInput: no such study, loop or gains.
    """
    left, _, right = name.rpartition(":")
    study = doors.load_study(left)
    exact = [g for g in study.gains if g.name == right]
    loop, at, _ = right.partition("@")
    of_loop = [g for g in study.gains
               if g.loop == right or (not at and g.loop.partition("@")[0] == loop)]  # fmt: skip
    found = of_loop or exact
    if found:
        return study, found
    known = [*dict.fromkeys([*(g.loop for g in study.gains), *(g.name for g in study.gains)])]
    if loop in doors.loop_names(study):
        why = f": {study.uncertified[loop]}" if loop in study.uncertified else ""
        told = f"; it has {', '.join(known)}" if known else ""
        raise BadInput(f"{study.name} declares no gains of {right} to certify{why}{told}")
    raise BadInput(f"{study.name} has no loop {right!r}{nearest(right, known)}")


def is_loop(name: str) -> bool:
    """Whether a name is ``STUDY:LOOP``."""
    left, colon, _ = name.rpartition(":")
    return bool(colon) and (left in doors.studies() or left.endswith((".py", ".toml")))


def one(name: str) -> tuple[Gains, Block]:
    """Gains of ``STUDY:LOOP`` or ``STUDY:GAINS`` and their loop, where that is one certificate.

    Raises:
        BadInput: it has several.
    """
    study, gains = find(name)
    if len(gains) > 1:
        known = ", ".join(f"{study.name}:{g.name}" for g in gains)
        gains = [g for g in study.gains if g.name == name.rpartition(":")[2]]
        if len(gains) != 1:
            raise BadInput(f"{name} has several certificates; write which: {known}")
    return gains[0], doors.find_loop(study, gains[0].loop)[0]


def mapped(options: argparse.Namespace, command: str) -> str:
    """Answer of ``--map``: writes the map, and says what is in it.

    Raises:
        BadInput: a system or loop that there is not, axes that are none.
    """
    from slipctl.design import maps
    from slipctl.study.jobs import Cores

    system, given, what = _asked(options)
    axes = maps.read_axes(options.map, system, _known(system, given))
    stem = re.sub(r"\W", "_", options.system)
    folder = Path(options.out or Path("out") / f"map_{stem}")
    if folder.suffix == ".json":
        raise BadInput(f"--out {folder}: a map is a picture and data; write a folder")
    store.check_folder(folder)
    progress = Progress(1, sys.stderr, options.quiet)
    try:
        with Cores(None) as cores:
            found = maps.drawn_map(
                system, given, axes, what, options.points, cores,
                lambda share: progress("map", share),
            )  # fmt: skip
    finally:
        progress.end()
    files = maps.write(found, folder, command)
    return maps.text(found) + "\n\n" + "\n".join(map(str, files))


def _asked(options: argparse.Namespace) -> tuple[System, Mapping[str, Any], str]:
    from slipctl.commands.certify import read_numbers

    name = options.system
    if is_loop(name):
        if options.settings:
            raise BadInput(f"{name} is a loop; certify it without --set")
        gains, loop = one(name)
        numbers = {k: float(v) for k, v in gains.numbers(loop).items()}
        return catalogue.system(gains.system), numbers, f"{name.rpartition(':')[0]}:{gains.name}"
    if name not in catalogue.SYSTEMS:
        known_ = (*catalogue.SYSTEMS, *doors.studies())
        raise BadInput(f"cannot map {name!r}{nearest(name, known_)}; write a system or STUDY:LOOP")
    system = catalogue.system(name)
    return system, read_numbers(system, options.settings), name


def _known(system: System, given: Mapping[str, Any]) -> Mapping[str, Any]:
    declared = {k: n.value for k, n in system.numbers.items() if n.value is not None}
    return {**declared, **given}
