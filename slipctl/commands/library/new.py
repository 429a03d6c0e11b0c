"""``slipctl new``: a file that describes a vehicle, commented, that runs as it is."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from slipctl import registry
from slipctl.errors import BadInput, nearest
from slipctl.run import store
from slipctl.study.files import loop_files, trip_files

SCHEMA = "slipctl.schema.json"
"""File beside it that editors check and complete with."""


def answer(options: argparse.Namespace, command: str) -> int:
    """Write the file and its schema, and say what to type next."""
    folder = registry.folder("models") / "vehicle" / "files"
    known = {p.stem: p for p in sorted(folder.glob("*.toml"))}
    kind, file = options.kind, options.file
    if options.source:
        if file:
            raise BadInput(f"--from takes the loop; write one file after it, not {kind} {file}")
        stem = options.source.rpartition(":")[2].partition("@")[0] or "loop"
        out = Path(kind or f"{stem}.toml")
    elif kind not in known:
        said = f"there is no vehicle {kind!r}" if kind else "write which vehicle"
        raise BadInput(f"{said}{nearest(kind or '', known)}; or --from STUDY:LOOP")
    else:
        out = Path(file or f"{kind}.toml")
    if out.suffix != ".toml":
        raise BadInput(f"{out} is no TOML file; write {out}.toml")
    if out.exists():
        raise BadInput(f"{out} exists; name another file, or remove it")
    store.check_file(out)
    if options.source:
        text = loop_files.loop_file_text(options.source, str(out))
    else:
        text = known[kind].read_text(encoding="utf-8")
    store.write_text(out.with_name(SCHEMA), trip_files.schema_text())
    store.write_text(out, text)
    if options.json:
        print(json.dumps({"file": str(out), "schema": str(out.with_name(SCHEMA))}, indent=1))
        return 0
    print(f"{out}: edit it, then slipctl run {out}\n{out.with_name(SCHEMA)}: for your editor")
    return 0
