"""The text of a file while it is edited: faults at their lines, and what may be typed next."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, Literal, get_args, get_origin

from slipctl.block.units.unit_algebra import parse_quantity
from slipctl.errors import BadInput, Faults
from slipctl.study.files import declared_parts, equation_files, trip_files
from slipctl.study.files.declared_parts import hints, kinds, options


def faults_of_text(path: str, text: str) -> list[dict[str, Any]]:
    """What is wrong in a text as if it stood in that file: line (0 where none) and words.

    It reads the text alone: no loop is made and nothing of it is run.
    """
    try:
        trip_files.study_of_text(path, text)
    except Faults as error:
        lines = list(error.lines)
    except BadInput as error:
        lines = [str(error)]
    else:
        return []
    return [_placed(path, text, line) for line in lines]


def _placed(path: str, text: str, line: str) -> dict[str, Any]:
    match = re.search(r",? line (\d+)", line)
    end = text.rstrip().count("\n") + 1 if "at end of document" in line else 0
    number = int(match[1]) if match else end
    words = line.removeprefix(f"{path}, line {number}: ").removeprefix(f"{path}: ")
    return {"line": number, "text": words}


# ---- completion ----------------------------------------------------------------------------------


def completions(text: str, line: int) -> list[dict[str, str]]:
    """What may stand on a line of a text: keys of its table, or values of its key.

    Args:
        text: whole text, which need not be right. line: from 1 on.

    Returns:
        What to insert, and what it means; keys that are there already are left out.
    """
    lines = text.split("\n")
    if not 1 <= line <= len(lines):
        return []
    before, here = lines[: line - 1], lines[line - 1]
    path, present = _table_at(before)
    if here.lstrip().startswith("["):
        root = _root(text)
        tables = [f for f in fields(root) if any(map(is_dataclass, options(hints(root)[f.name])))]
        return [{"insert": f"[{f.name}]", "meaning": str(f.metadata.get("doc", ""))}
                for f in tables]  # fmt: skip
    part, classes, kind = _part_at(_root(text), path, _readable(text, before))
    if part is None:
        return []
    key, equals, _ = here.partition("=")
    if equals:
        return _values(part, classes, key.strip())
    kind_key = {"insert": "kind = ", "meaning": f"which: {', '.join(kinds(classes))}"}
    keys = [kind_key] if kinds(classes) else []
    keys += [
        {"insert": f"{k.name} = ", "meaning": " ".join(filter(None, (
            k.meaning, f"[{k.unit}]" if k.unit else "", f"({k.range})" if k.range else "",
            f"default {k.default}")))}
        for k in declared_parts.keys_of(part)
    ]  # fmt: skip
    keys += _gains(kind)
    return [k for k in keys if k["insert"].removesuffix(" = ") not in present]


def _root(text: str) -> Any:
    """Part that a file is read as, by what can be seen of its text."""
    study = re.search(r"(?m)^\s*kind\s*=\s*\"study\"", text) is not None
    return trip_files.vehicle_files().root({"vehicle": {"kind": "study"} if study else {}})


def _table_at(before: list[str]) -> tuple[list[str], set[str]]:
    """Keys down to the table that a line stands in, and the keys that stand there before it."""
    path: list[str] = []
    present: set[str] = set()
    for row in before:
        head = re.match(r"\s*\[\[?([^\[\]]+)\]\]?", row)
        if head:
            path, present = [k.strip().strip('"') for k in head[1].split(".")], set()
        elif found := re.match(r"\s*([\w.-]+)\s*=", row):
            present.add(found[1])
    return path, present


def _part_at(root: Any, path: list[str], content: Any) -> tuple[Any, list[Any], str]:
    """Part that a table is read as, all that it may be, and its kind as the text has it.

    The part is None where nothing is declared for the table.
    """
    part, classes, kind = root, [root], ""
    names = list(path)
    while names:
        key = names.pop(0)
        found = next((f for f in fields(part) if f.name == key), None)
        if found is None:
            return None, [], ""
        content = _below(content, key)
        field_kind = hints(part)[key]
        if _is_table(field_kind):  # [controllers.pid]: the name is a person's own
            if not names:
                return None, [], ""
            content = _below(content, names.pop(0))
        classes = _classes(field_kind)
        if not classes:
            return None, [], ""
        kind = str(content.get("kind", "")) if isinstance(content, Mapping) else ""
        part = kinds(classes).get(kind, classes[0])
    return part, classes, kind


def _below(content: Any, key: str) -> Any:
    """Content below a key; of a list of tables the last one."""
    inner = content.get(key, {}) if isinstance(content, Mapping) else {}
    return (inner[-1] if inner else {}) if isinstance(inner, list) else inner


def _classes(kind: Any) -> list[Any]:
    """Parts that a field may hold, in a list or a table of them too."""
    found = []
    for c in options(kind):
        inner = get_args(c)[0 if get_origin(c) is tuple else -1] if get_origin(c) else c
        found += [o for o in options(inner) if is_dataclass(o)]
    return found


def _is_table(kind: Any) -> bool:
    """Whether a field is a table of parts by names of a person's own."""
    return any(
        get_origin(c) is not None and get_origin(c) is not tuple and len(get_args(c)) == 2
        for c in options(kind)
    )


def _readable(text: str, before: list[str]) -> Mapping[str, Any]:
    """Content of a text; of one that is no TOML, of the lines before, as far as they are."""
    for n in (None, *range(len(before), max(len(before) - 40, -1), -1)):
        try:
            return tomllib.loads(text if n is None else "\n".join(before[:n]))
        except (ValueError, RecursionError):
            continue
    return {}


def _values(part: Any, classes: list[Any], key: str) -> list[dict[str, str]]:
    """Values that a key may have, or an example with its unit."""
    if key == "kind" and kinds(classes):
        return [
            {"insert": f'"{name}"', "meaning": (c.__doc__ or "").strip().partition("\n")[0]}
            for name, c in kinds(classes).items()
        ]
    found = next((f for f in fields(part) if f.name == key), None)
    if found is None:
        return []
    meaning = str(found.metadata.get("doc", ""))
    choices = [a for c in options(hints(part)[key]) if get_origin(c) is Literal
               for a in get_args(c)]  # fmt: skip
    if choices:
        return [{"insert": f'"{c}"', "meaning": meaning} for c in choices]
    unit = found.metadata.get("unit")
    if unit and unit != "1" and not unit.startswith("by "):
        return [{"insert": f'"1 {unit}"', "meaning": meaning}]
    return []


def _gains(kind: str) -> list[dict[str, str]]:
    """Gains of a law of the papers, which stand beside the declared keys."""
    law = trip_files.vehicle_files().law_of_kind(kind)
    return [
        {"insert": f"{s.name.rpartition('.')[2]} = ",
         "meaning": f"{' '.join(s.doc.split())} [{s.unit}]"}
        for s in (law[1] if law else [])
    ]  # fmt: skip


# ---- edits that keep comments --------------------------------------------------------------------


def with_value(text: str, keys: tuple[str, ...], value: str) -> str:
    """Text with another value at a key; all else, comments too, stays letter by letter.

    Args:
        text: TOML. keys: down to the value, which must be there. value: as TOML writes it.

    Raises:
        BadInput: there is no such key, or its value does not stand on a line of its own.
    """
    before = equation_files.content_of_text("the text", text)
    inside: Any = before
    for key in keys:
        if not isinstance(inside, Mapping) or key not in inside:
            raise BadInput(f"the text has no {'.'.join(keys)}")
        inside = inside[key]
    wanted = _changed(before, keys, tomllib.loads(f"x = {value}")["x"])
    lines = text.split("\n")
    n = equation_files.line_of(text, keys) - 1
    plain = r'"(?:[^"\\]|\\.)*"|\'[^\']*\'|[^\s,#}\]"\']+'
    names = re.escape(keys[-1])
    for match in re.finditer(rf'(?<![\w-])"?{names}"?\s*=\s*({plain})', lines[n]):
        start, stop = match.span(1)
        row = lines[n][:start] + value + _padding(lines[n][start:], value, stop - start)
        made = "\n".join([*lines[:n], row, *lines[n + 1 :]])
        try:
            if tomllib.loads(made) == wanted:
                return made
        except ValueError:
            continue
    raise BadInput(f"{'.'.join(keys)} does not stand on a line of its own; edit the text")


def _padding(rest: str, value: str, long: int) -> str:
    """What follows a value, its comment at the column where it was if there is room."""
    tail = rest[long:]
    spaces = len(tail) - len(tail.lstrip(" "))
    if not tail.lstrip(" ").startswith("#"):
        return tail
    return " " * max(spaces - (len(value) - long), 1) + tail.lstrip(" ")


def _changed(content: Mapping[str, Any], keys: tuple[str, ...], value: Any) -> dict[str, Any]:
    key, rest = keys[0], keys[1:]
    return {**content, key: _changed(content[key], rest, value) if rest else value}


def keys_with_number(text: str, name: str, value: float, unit: str) -> list[tuple[str, ...]]:
    """Keys of a text whose number, in this unit, is this one: those of that name first."""
    found: list[tuple[str, ...]] = []

    def search(content: Any, keys: tuple[str, ...]) -> None:
        if isinstance(content, Mapping):
            for k, v in content.items():
                search(v, (*keys, k))
        elif isinstance(content, str | int | float) and not isinstance(content, bool):
            try:
                number = parse_quantity(str(content), unit)
            except (BadInput, ValueError, OverflowError, RecursionError):
                return
            if abs(number - value) <= 1e-9 * max(abs(value), 1e-300):
                found.append(keys)

    search(equation_files.content_of_text("the text", text), ())
    last = name.rpartition(".")[2].lower()
    return sorted(found, key=lambda k: (k[-1].lower() != last, ".".join(k) != name, len(k)))
