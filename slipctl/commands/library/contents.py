"""``slipctl list``: studies, models and the kinds of parts that a vehicle's file may hold."""

from __future__ import annotations

import argparse
import json
from dataclasses import MISSING, fields
from typing import Any

from slipctl.errors import BadInput, nearest
from slipctl.study import resolve
from slipctl.study.files import trip_files

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
    """Kinds of the parts of a vehicle's file, each with the table where it stands and its keys."""
    from slipctl.study.files import declared_parts

    rows: list[Row] = []
    seen: set[tuple[str, str]] = set()

    def of(part: type, path: str) -> None:
        for f in fields(part):
            hint = declared_parts.hints(part)[f.name]
            table: Any = getattr(hint, "__args__", ())
            inner = table[1] if f.name == "controllers" else hint
            where = f"{path}{f.name}" + (".NAME" if f.name == "controllers" else "")
            classes = [c for c in declared_parts.options(inner) if isinstance(c, type)
                       and hasattr(c, "__dataclass_fields__")]  # fmt: skip
            for kind, cls in declared_parts.kinds(classes).items():
                if (f.name, kind) in seen:
                    continue
                seen.add((f.name, kind))
                keys = [
                    "its own numbers" if k.metadata.get("rest") else k.name
                    for k in fields(cls)
                    if k.name != "kind"
                ]
                needed = [k.name for k in fields(cls) if k.default is MISSING
                          and k.default_factory is MISSING]  # fmt: skip
                doc = (cls.__doc__ or "").partition("\n")[0]
                rows.append({"name": f"{where}.{kind}", "doc": doc, "keys": keys, "needed": needed})
            for cls in classes:
                if cls.__name__ in ("Vehicle", "Sensors"):
                    of(cls, f"{where}.")

    of(trip_files.vehicle_files().roots[0], "")
    return rows


def _has(row: Row, word: str) -> bool:
    return word.lower() in f"{row['name']} {row['doc']}".lower()


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
            if row.get("keys"):
                lines.append(f"    keys: {', '.join(row['keys'])}")
    return "\n".join(lines[1:])
