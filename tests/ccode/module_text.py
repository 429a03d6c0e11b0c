"""The source of a module as one text, whichever of its files a line is in."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from slipctl.ccode.module.plan import Plan
from slipctl.ccode.module.source import sources


def of_plan(plan: Plan) -> str:
    """Text of the source, its parts first."""
    return "".join(sources(plan).values())


def of_folder(folder: Path, name: str) -> str:
    """Text of the source that was written into a folder."""
    return "".join(f.read_text(encoding="utf-8") for f in _files(folder, name))


def changed(made: Mapping[str, str], name: str, old: str, new: str) -> dict[str, str]:
    """Texts of a module with something else in the one file that has it."""
    (file,) = (f for f in (f"{name}_parts.h", f"{name}.c") if old in made.get(f, ""))
    return {**made, file: made[file].replace(old, new)}


def _files(folder: Path, name: str) -> list[Path]:
    return [f for f in (folder / f"{name}_parts.h", folder / f"{name}.c") if f.exists()]
