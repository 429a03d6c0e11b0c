"""``slipctl list``: studies, models and the kinds of parts that a vehicle's file may hold."""

from __future__ import annotations

import argparse
import json
import textwrap
from dataclasses import MISSING, fields
from typing import Any

from slipctl.errors import BadInput, nearest
from slipctl.study import resolve
from slipctl.study.files import declared_parts, trip_files

TOPICS = ("studies", "models", "kinds")
"""What can be listed; kinds are those of the parts of a vehicle's file."""

Row = dict[str, Any]


def answer(options: argparse.Namespace, command: str) -> int:
    """Print what there is, of a topic or with a word in it."""
    word = (options.word or "").strip()
    topics = [word] if word in TOPICS else TOPICS if word or options.json else TOPICS[:2]
    found = {topic: topic_rows(topic, "" if word in TOPICS else word) for topic in topics}
    if not any(found.values()):
        names = [row["name"] for topic in TOPICS for row in topic_rows(topic, "")]
        names += [b["name"] for row in topic_rows("models", "") for b in row["blocks"]]
        raise BadInput(f"nothing is called {word!r}{nearest(word, [*TOPICS, *names])}")
    print(json.dumps(found, indent=1, ensure_ascii=False) if options.json else text(found))
    return 0


def topic_rows(topic: str, word: str) -> list[Row]:
    """Rows of a topic, those that have a word in name or meaning."""
    if topic == "studies":
        rows: list[Row] = [{"name": n, "doc": doc} for n, doc in resolve.studies().items()]
    elif topic == "kinds":
        rows = kinds()
    else:
        rows = []
        for name, (doc, blocks) in resolve.models().items():
            inner = [{"name": b, "doc": text} for b, text in blocks.items()]
            whole = _has({"name": name, "doc": doc}, word)
            inner = inner if whole else [b for b in inner if _has(b, word)]
            if whole or inner:
                rows.append({"name": name, "doc": doc, "blocks": inner})
        return rows
    return [row for row in rows if _has(row, word)]


def kinds() -> list[Row]:
    """Kinds of the parts of a vehicle's file, each with the table where it stands and its keys.

    Each row has in ``many`` whether the table may stand several times, and in ``kind`` what chooses
    it where a table has several forms.
    """
    files = trip_files.vehicle_files()
    rows: list[Row] = []
    seen: set[tuple[str, str]] = set()

    def row_of(where: str, kind: str, cls: type, many: bool) -> Row:
        needed = [k.name for k in fields(cls) if k.default is MISSING
                  and k.default_factory is MISSING]  # fmt: skip
        row: Row = {
            "name": f"{where}.{kind}" if kind else where, "kind": kind, "many": many,
            "doc": (cls.__doc__ or "").partition("\n")[0],
            "keys": [vars(k) for k in declared_parts.keys_of(cls) if not kind or k.name != "kind"],
            "needed": needed,
        }  # fmt: skip
        if where.startswith("controllers") and (law := files.law_of_kind(kind)) is not None:
            row |= {"doc": law[0], "gains": [vars(k) for k in trip_files.gain_keys(law[1])]}
        return row

    def of(part: type, path: str) -> None:
        for f in fields(part):
            hint = declared_parts.hints(part)[f.name]
            table: Any = getattr(hint, "__args__", ())
            inner = table[1] if f.name == "controllers" else hint
            where = f"{path}{f.name}" + (".NAME" if f.name == "controllers" else "")
            classes = [c for one in declared_parts.options(inner) for c in (one, *_items(one))
                       if isinstance(c, type) and hasattr(c, "__dataclass_fields__")]  # fmt: skip
            listed = {c for one in declared_parts.options(inner) for c in _items(one)}
            named = [c for c in classes if f.name == "controllers" or c not in listed]
            by_kind = declared_parts.kinds(named)
            plain = [("", c) for c in classes if c not in by_kind.values()]
            for kind, cls in (*by_kind.items(), *plain):
                if (f.name, kind) not in seen:
                    seen.add((f.name, kind))
                    rows.append(row_of(where, kind, cls, cls in listed))
            for cls in classes:
                if not f.name.startswith(("controllers", "reference")):
                    of(cls, f"{where}.")

    of(files.roots[0], "")
    return rows


def _items(hint: Any) -> tuple[Any, ...]:
    """What a list of tables has in it."""
    return tuple(a for a in getattr(hint, "__args__", ()) if isinstance(a, type))


def _has(row: Row, word: str) -> bool:
    return word.lower() in f"{row['name']} {row['doc']}".lower()


def _key_lines(key: Row) -> list[str]:
    """A key with its unit, default and range, and its meaning."""
    unit = f" [{key['unit']}]" if key["unit"] else ""
    must = key["default"] == "must be given"
    told = [key["default"] if must else f"default {key['default']}", key["range"]]
    text = f"{key['name']}{unit}, {', '.join(filter(None, told))}: {key['meaning']}"
    return textwrap.wrap(text, 96, initial_indent="    ", subsequent_indent="        ")


def text(found: dict[str, list[Row]]) -> str:
    """What a person reads."""
    lines = []
    for topic, rows in found.items():
        if rows:
            lines += ["", topic]
        wide = 40 if topic == "kinds" else 24
        for row in rows:
            lines.append(f"  {row['name']:<{wide}} {row['doc']}")
            lines += [f"    {b['name']:<22} {b['doc']}" for b in row.get("blocks", ())]
            lines += [line for k in (*row.get("keys", ()), *row.get("gains", ()))
                      for line in _key_lines(k)]  # fmt: skip
    return "\n".join(lines[1:])
