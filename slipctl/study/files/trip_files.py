"""Files that describe a vehicle: ``metro.toml`` is a study, ``metro.toml:pid`` a loop of it.

Such a file has a table ``[vehicle]``. What may stand in it is declared in
``slipctl.models.vehicle.parts``; a fault is told with its line, and all faults at once.
"""

from __future__ import annotations

import importlib
import re
import tomllib
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from slipctl.errors import BadInput, Faults
from slipctl.study.files import equation_files

if TYPE_CHECKING:
    from slipctl.study.declaration import Study


def is_trip(path: str) -> bool:
    """Whether a path names a file that describes a vehicle.

    A file that cannot be read as TOML is one where it has such a table's head, so that its fault
    is told as a trip's.
    """
    if not path.endswith(".toml"):
        return False
    try:
        text = Path(path).read_text(encoding="utf-8-sig", errors="replace")
    except (OSError, ValueError):
        return False
    return re.search(r"(?m)^\s*(\[\s*vehicle\s*[\].]|vehicle\s*[.=])", text) is not None


def load_trip(path: str) -> Any:
    """Trip that a file describes, as it is now.

    Raises:
        BadInput: it cannot be read.
        Faults: what is wrong in it, each with its line.
    """
    text, _ = equation_files.read(path)
    return _trip(path, text)


@lru_cache(maxsize=8)  # of the text: a file may be edited while slipctl runs
def _trip(path: str, text: str) -> Any:
    """Trip of a text, which stands in that file."""
    from slipctl.study.files import declared_parts

    content, kinds = tomllib.loads(text), _kinds()
    of_study = content.get("vehicle")
    of_study = isinstance(of_study, Mapping) and of_study.get("kind") == "study"
    trip, faults = declared_parts.read(kinds[of_study], content)
    if trip is not None:
        faults = _of_study(trip) if of_study else _of_laws(trip)
    if faults:
        lines = [_line(path, text, keys, why) for keys, why in faults]
        raise Faults(sorted(lines, key=_number))
    return trip


def _kinds() -> tuple[type, type]:
    """Parts that a file may hold: a vehicle of one's own, and loops of a study."""
    own = importlib.import_module("slipctl.models.vehicle.parts")
    study = importlib.import_module("slipctl.models.vehicle.of_study")
    return own.Trip, study.StudyTrip


def _of_study(trip: Any) -> list[tuple[tuple[str | int, ...], str]]:
    """What is wrong with the numbers of a study's loops."""
    of_study = importlib.import_module("slipctl.models.vehicle.of_study")
    try:
        found: list[tuple[tuple[str | int, ...], str]] = of_study.Reading(trip).check()
    except BadInput as error:
        return [(("vehicle",), str(error))]
    return found


def _of_laws(trip: Any) -> list[tuple[tuple[str | int, ...], str]]:
    """What is wrong with laws, conditions and gains, which the blocks themselves know."""
    control = importlib.import_module("slipctl.models.vehicle.control")
    whole = importlib.import_module("slipctl.models.vehicle.trip")
    faults: list[tuple[tuple[str | int, ...], str]] = []

    def tried(keys: tuple[str | int, ...], check: Any) -> None:
        try:
            check()
        except BadInput as error:
            lines = error.lines if isinstance(error, Faults) else (str(error),)
            for line in lines:
                found = re.match(r"((?:rail|start|gains)(?:\.\w+)*):? (.+)", line)
                if found:
                    path, rest = found[1].split("."), found[2]
                    inner = tuple(int(k) if k.isdigit() else k for k in path)
                    inner = inner[1:] if path[0] == "gains" or keys[:1] == ("rail",) else inner
                    faults.append(((*keys, *inner), rest))
                else:
                    faults.append((keys, line))

    tried(("rail",), lambda: whole.rail_law(trip))
    if hasattr(trip.reference, "noise"):
        tried(("reference",), lambda: control.law_and_guess(trip.reference))
    if faults:
        return faults
    for name, part in trip.controllers.items():
        if hasattr(part, "gains"):
            tried(
                ("controllers", name),
                lambda part=part: control.slip_law(trip, part, control.wheel(trip)),
            )
    return faults


def _line(path: str, text: str, keys: tuple[str | int, ...], why: str) -> str:
    """Fault with file, line and path."""
    dotted = ".".join(str(k) for k in keys)
    if not dotted:
        return f"{path}: {why}"
    return f"{path}, line {equation_files.line_of(text, keys)}: {dotted}: {why}"


def _number(line: str) -> int:
    found = re.search(r", line (\d+): ", line)
    return int(found[1]) if found else 0


def load(path: str) -> Study:
    """Study of a file that describes a vehicle.

    Raises:
        Faults: what is wrong in it.
    """
    equation_files.READ.add(Path(path).resolve())
    trip = load_trip(path)
    name = re.sub(r"\W", "_", Path(path).stem) or "trip"
    room = "study" if type(trip) is _kinds()[0] else "of_study"
    study = importlib.import_module(f"slipctl.models.vehicle.{room}")
    made: Study = study.study(trip, name, f"described in {Path(path).name}")
    return made


def schema_text() -> str:
    """JSON schema of such files, as text."""
    import json

    from slipctl.study.files import declared_parts

    said = declared_parts.schema(_kinds(), "A vehicle on its way, as slipctl reads it")
    return json.dumps(said, indent=1, ensure_ascii=False) + "\n"
