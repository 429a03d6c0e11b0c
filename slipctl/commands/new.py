"""``slipctl new``: a file that describes a vehicle, commented, that runs as it is."""

from __future__ import annotations

import argparse
from pathlib import Path

from slipctl.errors import BadInput, nearest
from slipctl.run import store
from slipctl.study import doors, trip_files

SCHEMA = "slipctl.schema.json"
"""File beside it that editors check and complete with."""


def answer(options: argparse.Namespace, command: str) -> int:
    """Write the file and its schema, and say what to type next."""
    folder = doors.folder("models") / "vehicle" / "files"
    known = {p.stem: p for p in sorted(folder.glob("*.toml"))}
    if options.kind not in known:
        raise BadInput(f"there is no vehicle {options.kind!r}{nearest(options.kind, known)}")
    out = Path(options.file or f"{options.kind}.toml")
    if out.suffix != ".toml":
        raise BadInput(f"{out} is no TOML file; write {out}.toml")
    if out.exists():
        raise BadInput(f"{out} exists; name another file, or remove it")
    store.check_file(out)
    store.write_text(out.with_name(SCHEMA), trip_files.schema_text())
    store.write_text(out, known[options.kind].read_text(encoding="utf-8"))
    print(f"{out}: edit it, then slipctl run {out}\n{out.with_name(SCHEMA)}: for your editor")
    return 0
