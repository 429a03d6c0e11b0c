"""C compilers of this machine, what they make of a module, and how big it is."""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Iterable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from slipctl.ccode.compile.files import OPTIMISE, WARNINGS
from slipctl.ccode.compile.programs import run_program
from slipctl.ccode.passes.precision import MATH
from slipctl.errors import BadInput, RunFailed

FLAGS = (*WARNINGS.split(), "-Werror", *OPTIMISE.split())
TOLD = "-fstack-usage"
"""Writes what :func:`stack` reads beside the object file."""


@lru_cache(maxsize=1)
def compilers() -> tuple[str, ...]:
    """Compilers found: ``$CC``, gcc and clang, otherwise cc.

    Raises:
        BadInput: none.
    """
    names = [os.environ.get("CC") or "", "gcc", "clang"]
    found = {path: None for name in names if name and (path := shutil.which(name))}
    if not found and (path := shutil.which("cc")):
        found[path] = None
    if not found:
        raise BadInput(
            "no C compiler found; install gcc or clang (Debian, Ubuntu: apt install gcc), or set CC"
        )
    return tuple(found)


def first_compiler() -> str | None:
    """The first compiler, if there is one."""
    try:
        return compilers()[0]
    except BadInput:
        return None


@lru_cache(maxsize=8)
def version(compiler: str) -> str:
    """First line of what a compiler says of itself."""
    return run_program([compiler, "--version"]).stdout.partition("\n")[0].strip()


def lenient_command(compiler: str) -> list[str]:
    """Command that compiles what is only watched: a warning is none of its matters."""
    return [compiler, *(f for f in FLAGS if f not in ("-Werror", "-O2"))]


def compile_object(compiler: str, source: Path, target: Path, *flags: str) -> None:
    """Compile one file with all warnings as errors.

    Raises:
        RunFailed: with the first complaint.
    """
    _run([compiler, *FLAGS, *flags, "-c", source.name, "-o", str(target)], source.parent)


def link(compiler: str, objects: Sequence[Path], target: Path, *flags: str) -> None:
    """Link object files with the mathematics library."""
    command = [compiler, *flags, *(str(o) for o in objects), "-o", str(target), "-lm"]
    _run(command, target.parent)


def _run(command: list[str], folder: Path) -> None:
    done = run_program(command, folder)
    if done.returncode:
        silent = f"it ended with code {done.returncode} and said nothing; CC chooses a compiler"
        lines = done.stderr.strip().splitlines() or [silent]
        worst = next((line for line in lines if "error" in line), lines[0])
        raise RunFailed(f"{Path(command[0]).name} refuses the generated C: {worst}")


def sizes(target: Path, tools: str = "") -> dict[str, int] | None:
    """Bytes of text, data and bss of an object file; None without binutils."""
    said = _told(f"{tools}size", target) or ""
    found = re.search(r"^\s*(\d+)\s+(\d+)\s+(\d+)", said, flags=re.MULTILINE)
    return (
        dict(zip(("text", "data", "bss"), map(int, found.groups()), strict=True)) if found else None
    )


def _told(tool: str, target: Path, *options: str) -> str | None:
    """What a tool of binutils tells of an object file; None where it is not installed."""
    found = shutil.which(tool)
    return run_program([found, *options, target]).stdout if found else None


def symbols(target: Path, tools: str = "") -> dict[str, list[str]] | None:
    """Names an object file defines for others, and names it needs; None without binutils."""
    said = _told(f"{tools}nm", target, "-g")
    if said is None:
        return None
    found: dict[str, list[str]] = {"defined": [], "needed": []}
    for line in said.splitlines():
        kind, name = line.split()[-2:]
        found["needed" if kind in "Uw" else "defined"].append(name.lstrip("_"))
    return {k: sorted(v) for k, v in found.items()}


def code(target: Path, tools: str = "") -> dict[str, dict[str, int]] | None:
    """Bytes of ``code`` or ``data`` of each function and table of an object file.

    None without binutils. A function that the compiler put into its callers is not among them.
    """
    said = _told(f"{tools}nm", target, "--print-size", "--radix=d")
    if said is None:
        return None
    found = {}
    for line in said.splitlines():
        _, *rest = line.split()
        if len(rest) == 3:  # what is not defined here has no size
            found[rest[2].lstrip("_")] = {"code" if rest[1] in "tT" else "data": int(rest[0])}
    return found


_HELPER = re.compile(
    r"aeabi_(d\w+|cd\w+|\w+2d)|(add|sub|mul|div|neg|eq|ne|lt|le|gt|ge|unord|cmp)df\d"
    r"|extendsfdf2|truncdfsf2|float(un)?[sd]idf|fix(uns)?df[sd]i"
)


def in_double(names: Iterable[str]) -> list[str]:
    """Those of some functions that take double: of the C library, or of the compiler for it."""
    return [n for n in names if n in MATH or _HELPER.fullmatch(n)]


def stack(target: Path) -> dict[str, int] | None:
    """Bytes of stack of each function of an object made with ``TOLD``; None if not told.

    The C library's are not among them. A function that is inlined has none of its own. ``worst``
    is that of the deepest chain if no function called another one twice: the sum of all, which is
    never too small.
    """
    try:
        text = target.with_suffix(".su").read_text(encoding="utf-8")
    except OSError:
        return None
    found = {}
    for line in text.splitlines():
        place, bytes_, kind = line.split("\t")
        if kind not in ("static", "dynamic,bounded"):
            return None
        found[place.rpartition(":")[2]] = int(bytes_)
    return found | {"worst": sum(found.values())}


def as_json(data: Any) -> str:
    """JSON text of a report."""
    return json.dumps(data, indent=1, ensure_ascii=True) + "\n"
