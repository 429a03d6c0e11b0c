"""Files of equations: ``leaves.toml:law`` is the block that the table ``[law]`` of it describes.

A table is a block. Its texts are equations, ``mu = "c*v_s"``, or all of them stand in one text
``equations``; tables of it say what the names mean, see :func:`slipctl.from_text`.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from slipctl.errors import BadInput, Faults, check_known, nearest

if TYPE_CHECKING:
    from slipctl.block.block import Block

LARGEST = 100_000
"""Bytes of a file of equations."""

TABLES = ("inputs", "parameters", "states", "outputs", "tables", "conditions")
TEXTS = ("equations", "doc", "period", "units")
REACH = ("measured_to", "meant_to")

READ: set[Path] = set()
"""Files that were read: what a run kept depends on them."""


def is_file(path: str) -> bool:
    """Whether a path names a file of equations: a TOML file."""
    return path.endswith(".toml")


def load(name: str) -> Block:
    """Block by ``file.toml:table``, or ``file.toml`` if it has one table.

    Raises:
        BadInput: no such file or table.
        Faults: what is wrong in it, each with its line.
    """
    path, _, wanted = (name, "", "") if is_file(name) else name.rpartition(":")
    text, content = read(path)
    blocks = [k for k, v in content.items() if isinstance(v, Mapping)]
    if not blocks:
        raise BadInput(f"{path} has no block; write a table, [law], with mu = '...' in it")
    if not wanted and len(blocks) > 1:
        names = ", ".join(f"{path}:{b}" for b in blocks)
        raise BadInput(f"{path} has several blocks; write which: {names}")
    wanted = wanted or blocks[0]
    check_known(f"{path} has no block", wanted, blocks)
    try:
        return block(content[wanted], wanted, lambda keys: place_of(path, text, (wanted, *keys)))
    except Faults as error:
        raise Faults(sorted(error.lines, key=line_of_fault)) from None


def read(path: str) -> tuple[str, dict[str, Any]]:
    """Text and content of a TOML file.

    Raises:
        BadInput: there is no such file, it is too large, or it is no TOML; says the line.
    """
    try:
        size = Path(path).stat().st_size
        if size > LARGEST:
            raise BadInput(f"{path} has {size} bytes; a file of equations has at most {LARGEST}")
        text = Path(path).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise BadInput(f"{path} is no UTF-8 text: byte {error.start}") from None
    except OSError as error:
        raise BadInput(f"cannot read {path}: {error.strerror}") from None
    READ.add(Path(path).resolve())
    return text, content_of_text(path, text)


def content_of_text(path: str, text: str) -> dict[str, Any]:
    """Content of a TOML text that stands in a file, or is meant to.

    Raises:
        BadInput: it is too long, or no TOML; says the line.
    """
    if len(text) > LARGEST:
        raise BadInput(f"{path} has {len(text)} letters; such a file has at most {LARGEST}")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise BadInput(f"{path}: it is nested too deeply") from None
    except ValueError as error:
        raise BadInput(_said(path, str(error))) from None


SAID = {
    "Cannot overwrite a value": "this key stands twice; remove one of both",
    "Cannot declare": "this table stands twice; remove one of both",
    "Expected newline": "behind a value nothing may stand; write a number with its unit in quotes,"
    ' such as "38 t"',
    "Invalid value": "no value can be read here; write a text or a number with its unit in quotes",
}
"""What is wrong with a TOML text, by the words of its reader."""


def _said(path: str, error: str) -> str:
    """A fault of a TOML text with its line, where the reader tells one."""
    what = next((said for words, said in SAID.items() if error.startswith(words)), "")
    line = re.search(r"\(at line (\d+)", error)
    return f"{path}, line {line[1]}: {what}" if line and what else f"{path}: {what or error}"


def block(content: Mapping[str, Any], name: str, where: Any = None) -> Block:
    """Make the block that a table describes.

    Args:
        content: the table.
        name: of the block.
        where: gives the place of a fault from the keys that lead to it.

    Raises:
        Faults: all that is wrong.
    """
    from slipctl.block.reach import with_reach
    from slipctl.block.text.equations import from_text

    place = where or partial(_dotted, name)
    faults: list[str] = []
    equations: dict[str, str] = {}
    given: dict[str, Any] = {}
    reach: dict[str, Any] = {}
    for key, value in content.items():
        if key in TABLES:
            given[key] = value
            if not isinstance(value, Mapping):
                faults.append(f"{place((key,))}: write a table, [{name}.{key}]")
        elif key in REACH:
            reach[key] = value
        elif key in TEXTS:
            given[key] = value
            if not isinstance(value, str):
                faults.append(f"{place((key,))}: write a text in quotes")
        elif isinstance(value, str):
            equations[key] = value
        else:
            close = nearest(key, (*TABLES, *TEXTS, *REACH))
            faults.append(f"{place((key,))}: {key!r:.40} is no text of an equation{close}")
    if faults:
        raise Faults(faults)
    try:
        text = given.pop("equations", "")
        made = from_text(text, equations=equations, name=name, where=place, **given)
        return with_reach(made, reach) if reach else made
    except Faults:
        raise
    except BadInput as error:
        raise BadInput(f"{place(())}: {error}") from None


def _dotted(name: str, keys: tuple[str, ...]) -> str:
    return ".".join([name, *(k for k in keys if k)])


def place_of(path: str, text: str, keys: tuple[str | int, ...]) -> str:
    """File, line and path of what stands at some keys."""
    shown = tuple(k for k in keys if k != "")
    return f"{path}, line {line_of(text, shown)}: {'.'.join(map(str, shown))}"


def line_of(text: str, keys: tuple[str | int, ...]) -> int:
    """Line of a TOML text at which a key stands, or the last of its parents that does.

    A beginning of a TOML text that ends with a statement is a TOML text too: the first that has
    the key ends with its statement.
    """
    lines = text.split("\n")
    best, last_good = 1, 0
    depth = 0
    for n in range(1, len(lines) + 1):
        try:
            content: Any = tomllib.loads("\n".join(lines[:n]))
        except (ValueError, RecursionError):
            continue
        found = 0
        for key in keys:
            inside = range(len(content)) if isinstance(content, list) else content
            if not isinstance(content, Mapping | list) or key not in inside:
                break
            content, found = content[key], found + 1  # type: ignore[index]
        if found > depth:
            statement = range(last_good, n)
            begin = next((k for k in statement if _says(lines[k])), n - 1)
            depth, best = found, begin + 1
            if depth == len(keys):
                break
        last_good = n
    return best


def line_of_fault(fault: str) -> int:
    """Line that a fault names."""
    match = re.search(r", line (\d+): ", fault)
    return int(match[1]) if match else 0


def _says(line: str) -> bool:
    """Whether a line is neither empty nor a comment."""
    return bool(line.strip()) and not line.lstrip().startswith("#")
