"""The source of a module as one text, whichever of its files a line is in."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from slipctl.ccode.module.plan import Plan
from slipctl.ccode.module.source import sources
from slipctl.ccode.tree.parser import code
from slipctl.ccode.tree.printer import lines_of


def of_plan(plan: Plan) -> str:
    """Text of the source, its parts first."""
    return "".join(sources(plan).values())


def laid_out(lines: Sequence[str], indent: str = "") -> list[str]:
    """Lines of some C as the printer lays them out."""
    return lines_of(code("\n".join(lines)), indent)


def with_pass(change: Callable[..., Any], lines: Sequence[str], *more: Any) -> list[str]:
    """Lines of some C after a pass over its nodes."""
    return lines_of(change(code("\n".join(lines)), *more))


def of_folder(folder: Path, name: str) -> str:
    """Text of the source that was written into a folder."""
    return "".join(f.read_text(encoding="utf-8") for f in _files(folder, name))


def changed(made: Mapping[str, str], name: str, old: str, new: str) -> dict[str, str]:
    """Texts of a module with something else in the one file that has it."""
    (file,) = (f for f in (f"{name}_parts.h", f"{name}.c") if old in made.get(f, ""))
    return {**made, file: made[file].replace(old, new)}


def _files(folder: Path, name: str) -> list[Path]:
    return [f for f in (folder / f"{name}_parts.h", folder / f"{name}.c") if f.exists()]
