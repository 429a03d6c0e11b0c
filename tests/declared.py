"""What the modules of a room declare: defaults of functions, fields of classes, constants."""

from __future__ import annotations

import csv
import inspect
import re
import zlib
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from decimal import Decimal
from fractions import Fraction
from functools import cached_property
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages
from types import ModuleType
from typing import Any

HEAD = ["module", "name", "declares"]


def rows(package: str) -> Iterator[list[str]]:
    """Module, name and what is declared, of each function, class and constant."""
    room = import_module(package)
    names = sorted(m.name for m in walk_packages(room.__path__, f"{package}."))
    seen: set[tuple[str, str]] = set()  # what another module imports is told once
    for name in names:
        for row in declared(import_module(name)):
            if row not in seen:
                yield [name.removeprefix(f"{package}."), *row]
            seen.add(row)


def declared(module: ModuleType) -> Iterator[tuple[str, str]]:
    """Name and declaration of each thing that is the module's own."""
    for name, value in vars(module).items():
        if inspect.isclass(value) and value.__module__ == module.__name__:
            yield from of_class(name, value)
        elif inspect.isroutine(value) and getattr(value, "__module__", "") == module.__name__:
            if text := defaults(value):
                yield name, text
        elif name.strip("_").isupper() and plain(value) and not isinstance(value, str):
            yield name, short(value)


def of_class(name: str, kind: type) -> Iterator[tuple[str, str]]:
    if is_dataclass(kind):
        how = kind.__dataclass_params__  # type: ignore[attr-defined]
        more = [{k: v for k, v in f.metadata.items() if k != "doc"} for f in fields(kind)]
        given = [
            f"{f.name}{' by name' * f.kw_only} = {short(f.default)}{f' {short(m)}' if m else ''}"
            for f, m in zip(fields(kind), more, strict=True)
        ]
        yield name, f"frozen {how.frozen}, eq {how.eq}: {', '.join(given)}"
    elif hasattr(kind, "_field_defaults"):
        yield name, short(kind._field_defaults)
    for n, method in vars(kind).items():
        for f in (method, getattr(method, "fget", None), getattr(method, "__func__", None)):
            if inspect.isfunction(f) and (text := defaults(f)):
                yield f"{name}.{n}", text
        if isinstance(method, cached_property) and (text := defaults(method.func)):
            yield f"{name}.{n}", text


def defaults(f: Any) -> str:
    """Keywords of a function with their values."""
    try:
        wanted = inspect.signature(f).parameters.values()
    except (TypeError, ValueError):
        return ""
    more = ""
    if hasattr(f, "cache_parameters"):
        more = f"remembers {f.cache_parameters()['maxsize']}; "
    return more + ", ".join(f"{p.name} = {short(p.default)}" for p in wanted
                            if p.default is not p.empty)  # fmt: skip


def short(value: object) -> str:
    """A value in words that are the same in each run; texts are told by their beginning."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{short(k)}: {short(v)}" for k, v in value.items()) + "}"
    if isinstance(value, set | frozenset):
        return "{" + ", ".join(sorted(map(short, value))) + "}"
    if isinstance(value, list | tuple):
        return "(" + ", ".join(map(short, value)) + ")"
    if isinstance(value, int | float):
        return f"{value:.14g}"
    text = " ".join(re.sub(r" at 0x[0-9a-f]+", "", str(value)).split())
    return text if len(text) < 40 else f"{text[:30]}... {zlib.crc32(text.encode()):08x}"


def plain(value: object) -> bool:
    """Numbers, texts, and tables of them."""
    if isinstance(value, dict):
        return all(map(plain, (*value, *value.values())))
    if isinstance(value, list | tuple | set | frozenset):
        return all(map(plain, value))
    return isinstance(value, int | float | str | Fraction | Decimal)


def changed(package: str, table: Path) -> list[tuple[list[str], str | None]]:
    """Rows of a table that are others now, each with what is declared instead."""
    have = {(m, n): text for m, n, text in rows(package)}
    with table.open(newline="", encoding="utf-8") as file:
        wanted = list(csv.reader(file))[1:]
    assert len(wanted) > 20
    return [(r, have.get((r[0], r[1]))) for r in wanted if have.get((r[0], r[1])) != r[2]]


def write(package: str, table: Path) -> None:
    with table.open("w", newline="", encoding="utf-8") as out:
        csv.writer(out, lineterminator="\n").writerows([HEAD, *rows(package)])
