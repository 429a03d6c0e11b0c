"""Write the files of a module: all of them or none, and never over what somebody else wrote."""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path

from slipctl.errors import BadInput
from slipctl.run import store

MANIFEST = "report.json"


def digest(content: str | bytes) -> str:
    """Hash of a file's content, as the manifest keeps it."""
    raw = content.encode() if isinstance(content, str) else content
    return hashlib.sha256(raw).hexdigest()[:32]


def check_folder(folder: Path, names: Iterable[str]) -> None:
    """Refuse a folder where one of the names is a file that we did not write.

    Raises:
        BadInput: not a folder, no right to write, a foreign file in the way, or a device's name.
    """
    names = list(names)
    for name in ("", *names):
        store.check_names(folder / name)
    if folder.exists() and not folder.is_dir():
        raise BadInput(f"{folder} is a file; give a folder")
    parent = folder
    while not parent.exists():
        parent = parent.parent
    if not os.access(parent, os.W_OK | os.X_OK):
        raise BadInput(f"{folder} cannot be written; give a folder of your own")
    ours = _ours(folder)
    for name in names:
        path = folder / name
        if path.exists() and name not in ours:
            raise BadInput(
                f"{path} was not written by slipctl, or was changed since; move it away or give"
                " another folder"
            )


def publish(folder: Path, files: Mapping[str, str | bytes]) -> None:
    """Put the files in place: written beside it first, then renamed one by one, manifest last.

    Files that an earlier call wrote, that nobody changed and that are not among the new ones, are
    removed.

    Raises:
        BadInput: as :func:`check_folder`.
    """
    check_folder(folder, files)
    old = _ours(folder) - set(files)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".slipctl_", dir=folder) as scratch:
            for name, content in files.items():
                raw = content.encode() if isinstance(content, str) else content
                (Path(scratch) / name).write_bytes(raw)
            for name in sorted(files, key=lambda n: n == MANIFEST):
                os.replace(Path(scratch) / name, folder / name)
    except OSError as error:
        raise BadInput(f"{folder} cannot be written: {error.strerror}") from None
    for name in old:
        (folder / name).unlink(missing_ok=True)


def _ours(folder: Path) -> set[str]:
    """Names of files in a folder that a manifest lists and that are as they were written."""
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        listed = dict(manifest["files"]) if manifest["by"] == "slipctl" else {}
    except (OSError, ValueError, KeyError, TypeError):
        return set()
    found = {MANIFEST}
    for name, wanted in listed.items():
        path = folder / name
        own = Path(name).name == name and path.is_file()
        if own and digest(path.read_bytes()) == wanted:
            found.add(name)
    return found
