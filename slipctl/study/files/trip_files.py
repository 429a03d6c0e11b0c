"""Files that describe a vehicle: ``metro.toml`` is a study, ``metro.toml:pid`` a loop of it.

Such a file has a table ``[vehicle]``. What may stand in it is declared in
the parts that are registered for them; a fault is told with its line, and all faults at once.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from slipctl import registry
from slipctl.errors import BadInput, Faults
from slipctl.run.results import Case, Loops
from slipctl.study.files import declared_parts, equation_files
from slipctl.study.files.declared_parts import Key, description, range_text

if TYPE_CHECKING:
    from slipctl.block.block import Block
    from slipctl.block.signals import Signal
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
    content = files_beside(tomllib.loads(text), Path(path).parent)
    if content and not set(content) & {f.name for f in fields(vehicle_files().root(content))}:
        raise BadInput(
            f"{path} describes no vehicle, it has {', '.join(list(content)[:5])}; slipctl new metro"
            " writes a vehicle's file, whose rail or controller may name a block of yours"
        )
    trip, faults = declared_parts.read(vehicle_files().root(content), content)
    if trip is not None:
        faults = vehicle_files().faults(trip)
    if faults:
        lines = [_line(path, text, keys, why) for keys, why in faults]
        raise Faults(sorted(lines, key=equation_files.line_of_fault))
    return trip


NAMED = re.compile(r"([^\s:=]+\.(?:toml|py))(:.*)?")
"""A file that a vehicle's file names, with the block of it."""
NAMING = ("law", "block", "study")
"""Keys that may name one."""


def files_beside(content: Any, folder: Path) -> Any:
    """Content whose files, ``law = "own.toml:law"``, are those in that folder, that of its file.

    One that is not there and is where slipctl runs is left as it is written.
    """
    if isinstance(content, list):
        return [files_beside(v, folder) for v in content]
    if not isinstance(content, dict):
        return content
    made = {k: files_beside(v, folder) for k, v in content.items()}
    for key in made.keys() & set(NAMING):
        found = NAMED.fullmatch(made[key]) if isinstance(made[key], str) else None
        if found and ((folder / found[1]).is_file() or not Path(found[1]).is_file()):
            made[key] = f"{folder / found[1]}{found[2] or ''}"
    return made


def vehicle_files() -> Any:
    """What is registered to read such files: its roots, their faults, and the study of one."""
    return registry.load(registry.FILES, "vehicle")


def _line(path: str, text: str, keys: tuple[str | int, ...], why: str) -> str:
    """Fault with file, line and path."""
    return f"{equation_files.place_of(path, text, keys) if keys else path}: {why}"


def load(path: str) -> Study:
    """Study of a file that describes a vehicle.

    Raises:
        Faults: what is wrong in it.
    """
    equation_files.READ.add(Path(path).resolve())
    text, _ = equation_files.read(path)
    return study_of_text(path, text)


def study_of_text(path: str, text: str) -> Study:
    """Study that a text describes as if it stood in that file, which need not be there.

    Raises:
        BadInput: it is no TOML, or too long; says the line.
        Faults: what is wrong in it.
    """
    equation_files.content_of_text(path, text)
    trip = _trip(path, text)
    name = re.sub(r"\W", "_", Path(path).stem) or "trip"
    made: Study = vehicle_files().study(trip, name, f"described in {Path(path).name}")
    return replace(made, cases=partial(_cases, path, text, made.cases))


def _cases(path: str, text: str, cases: Any, models: Any, quick: bool) -> list[Case]:
    """Cases; a loop that cannot be made says where in the file its controller stands."""
    return [
        replace(c, loops=Loops({n: partial(_loop, path, text, c.loops, n) for n in c.loops}))
        for c in cases(models, quick)
    ]


def _loop(path: str, text: str, loops: Mapping[str, Block], name: str) -> Block:
    try:
        return loops[name]
    except Faults:
        raise
    except BadInput as error:
        why = str(error).removeprefix(f"controllers.{name}: ")
        raise BadInput(_line(path, text, ("controllers", name), why)) from None


def gain_keys(found: Sequence[Signal]) -> list[Key]:
    """Gains of a law that a file may set, as keys; last names where they are alone."""
    from slipctl.study.report.texts import number

    last = [s.name.rpartition(".")[2] for s in found]
    return [
        Key(n if last.count(n) == 1 else s.name, s.doc, "" if s.unit == "1" else s.unit,
            number(s.value), range_text(s.lo, s.hi))
        for s, n in zip(found, last, strict=True)
    ]  # fmt: skip


def schema_text() -> str:
    """JSON schema of such files, as text."""
    files = vehicle_files()
    said = declared_parts.schema(files.roots, "A vehicle on its way, as slipctl reads it")
    for part in said["$defs"].values():
        for kind in part["properties"].get("kind", {}).get("enum", ()):
            if (law := files.law_of_kind(kind)) is not None:  # in a sentence, and each gain
                given = {k.name: {"description": description(k)} for k in gain_keys(law[1])}
                part.setdefault("allOf", []).append({
                    "if": {"properties": {"kind": {"const": kind}}, "required": ["kind"]},
                    "then": {"description": law[0], "properties": given},
                })  # fmt: skip
    return json.dumps(said, indent=1, ensure_ascii=False) + "\n"
