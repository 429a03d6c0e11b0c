"""Files: written under a temporary name and renamed, so that nobody ever sees half a file.

JSON is strict: no NaN, a number that does not exist is null. Every file says its ``format``, and a
reader refuses a newer one.
"""

from __future__ import annotations

import json
import math
import os
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from slipctl.errors import BadInput
from slipctl.run.interrupts import hold_interrupts

try:
    import fcntl
except ImportError:  # Windows: a folder cannot be locked there
    fcntl = None  # type: ignore[assignment]

FORMAT = 1
"""Format that this version writes, and the newest that it reads."""

PART = ".slipctl."
"""How the name of a file begins that is not whole yet."""

DEVICES = {"con", "prn", "aux", "nul", *(f"{k}{n}" for k in ("com", "lpt") for n in range(1, 10))}
"""Names that Windows keeps for devices, also with an ending: ``nul.json`` is no file there."""

LONGEST_NAME = 255
"""Bytes of a name in a folder, on Linux, macOS and Windows."""


def check_names(path: Path) -> None:
    """Refuse a path that a colleague's Windows cannot read, on every system.

    Raises:
        BadInput: a part of it is the name of a device, or longer than a name of a file can be.
    """
    for name in path.parts:
        if len(name.encode(errors="replace")) > LONGEST_NAME:
            raise BadInput(
                f"cannot write {name[:30]}...: a name of a file has at most {LONGEST_NAME} bytes"
            )
        if name.partition(".")[0].rstrip(" ").lower() in DEVICES:
            raise BadInput(
                f"cannot write {path}: {name} is a device on Windows; choose another name"
            )


def check_folder(folder: Path) -> None:
    """Refuse a folder that cannot be written, without making it.

    Raises:
        BadInput: it is a file, lies below a file, has a name that cannot be, or may not be written.
    """
    check_names(folder)
    try:
        str(folder).encode()
    except UnicodeEncodeError:
        raise BadInput(
            f"cannot write to {str(folder)!a}: it is no text; choose another --out"
        ) from None
    for place in (folder, *folder.absolute().parents):
        if not os.path.lexists(place):
            continue
        if not place.is_dir():
            raise BadInput(
                f"cannot write to {folder}: {place} is not a folder; choose another --out"
            )
        if not os.access(place, os.W_OK | os.X_OK):
            raise BadInput(
                f"cannot write to {folder}: no permission in {place}; choose another --out"
            )
        try:  # a read-only or special file system says no only when asked
            _try_names(place, folder.absolute().relative_to(place.absolute()).parts)
        except OSError as error:
            why = error.strerror or str(error)
            raise BadInput(
                f"cannot write to {folder}: {why} in {place}; choose another --out"
            ) from None
        return


def _try_names(place: Path, names: tuple[str, ...]) -> None:
    """Make folders of these names in a scratch folder of ``place``, and remove them."""
    scratch = Path(tempfile.mkdtemp(prefix=PART, dir=place))
    try:
        for name in names:
            (scratch / name).mkdir()
            (scratch / name).rmdir()
    finally:
        scratch.rmdir()


def check_file(file: Path) -> None:
    """Refuse a file that cannot be written, without making it.

    Raises:
        BadInput: it is a folder, or its folder cannot be written.
    """
    check_names(file)
    if file.is_dir():
        raise BadInput(f"cannot write {file}: it is a folder; --out names a file")
    check_folder(file.parent)


@contextmanager
def name_file_in_errors(path: Path) -> Iterator[None]:
    """Let an error of the disk name the file that was to be written, not the temporary one."""
    try:
        yield
    except OSError as error:
        if error.filename is None or Path(os.fsdecode(error.filename)).name.startswith(PART):
            error.filename = str(path)
        raise


@contextmanager
def temporary_for(path: Path) -> Iterator[Path]:
    """Give a temporary name beside ``path``; it becomes ``path`` if all goes well."""
    with hold_interrupts(), name_file_in_errors(path):
        scratch = part(path)
        try:
            yield scratch
            publish(scratch, path)
        finally:
            scratch.unlink(missing_ok=True)


def part(path: Path) -> Path:
    """Make an empty file beside ``path`` to be filled, then given to :func:`publish`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=PART, suffix=path.suffix, dir=path.parent)
    os.close(handle)
    return Path(name)


def publish(scratch: Path, path: Path) -> None:
    """Give a file that is whole its name."""
    mask = os.umask(0)
    os.umask(mask)
    os.chmod(scratch, 0o666 & ~mask)
    os.replace(scratch, path)


def write_text(path: Path, text: str) -> None:
    """Write a text file, whole or not at all."""
    with temporary_for(path) as scratch:
        scratch.write_text(text, encoding="utf-8", newline="\n")


def write_with(path: Path, write: Callable[[Path], Any]) -> None:
    """Let ``write`` fill a file under a temporary name, then rename it."""
    with temporary_for(path) as scratch:
        write(scratch)


def plain(value: Any) -> Any:
    """Value as strict JSON has it: plain numbers, lists and dicts; NaN and infinity become None."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


def json_text(value: Any) -> str:
    """Strict JSON, one line per entry, lists of plain values on one line."""
    return _lines(plain(value), 0) + "\n"


def _lines(value: Any, depth: int) -> str:
    inner, outer = "  " * (depth + 1), "  " * depth
    leaf = not isinstance(value, (dict, list)) or not value
    if isinstance(value, dict):  # a small record such as {"value": 1.0, "unit": "m"}
        leaf |= len(value) <= 2 and "unit" in value
    elif not leaf:
        leaf = not any(isinstance(v, (dict, list)) for v in value)
    if leaf:
        return json.dumps(value, ensure_ascii=False, allow_nan=False)
    if isinstance(value, dict):
        rows = [f"{inner}{json.dumps(k)}: {_lines(v, depth + 1)}" for k, v in value.items()]
        return "{\n" + ",\n".join(rows) + f"\n{outer}}}"
    rows = [inner + _lines(v, depth + 1) for v in value]
    return "[\n" + ",\n".join(rows) + f"\n{outer}]"


def write_json(path: Path, payload: Mapping[str, Any]) -> None:
    """Write strict JSON with the ``format`` in front."""
    write_text(path, json_text({"format": FORMAT, **payload}))


def text_of(path: Path) -> str:
    """Text of a file that was just written, as a command prints it."""
    return Path(path).read_text(encoding="utf-8").rstrip()


def read_json(path: Path) -> dict[str, Any]:
    """Read a JSON file of ours.

    Raises:
        BadInput: no such file, no JSON, or a newer format.
    """
    try:
        payload = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInput(f"cannot read {path}: {error.strerror}") from None
    except (ValueError, RecursionError):
        raise BadInput(f"{path} is no JSON file of slipctl") from None
    if not isinstance(payload, dict):
        raise BadInput(f"{path} is no JSON file of slipctl")
    check_format(str(path), payload.get("format"))
    return payload


def check_format(what: str, found: Any) -> None:
    """Refuse a format that this version does not know.

    Raises:
        BadInput: none, or a newer one.
    """
    if not isinstance(found, int) and not (hasattr(found, "item") and float(found).is_integer()):
        raise BadInput(f"{what} has no format number; it is no file of slipctl")
    if int(found) > FORMAT:
        raise BadInput(
            f"{what} has format {int(found)}, this slipctl reads up to {FORMAT}; update slipctl"
        )


# ---- one writer of a folder ----------------------------------------------------------------------

_HELD: set[int] = set()
"""Handles of this process. A process that is forked of it gives them up: a worker that outlives its
parent keeps nobody out."""


def _give_up() -> None:
    for handle in _HELD:
        os.close(handle)
    _HELD.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_give_up)


class FolderLock:
    """Lock of a folder, until it is closed or the process ends, whatever ends it.

    It is the system's own lock of the folder: no file is left, and no process that was killed holds
    it. Where the system has none (Windows, some network drives) nobody is refused.

    Args:
        folder: that there is.

    Raises:
        BadInput: another process writes there, or another part of this one.
    """

    def __init__(self, folder: Path) -> None:
        self._handle: int | None = None
        if fcntl is None:
            return
        handle = os.open(folder, os.O_RDONLY)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(handle)
            raise BadInput(
                f"another slipctl writes to {folder}; wait until it has ended, or choose another"
                " --out"
            ) from None
        except OSError:  # a drive without locks
            os.close(handle)
        else:
            self._handle = handle
            _HELD.add(handle)

    def close(self) -> None:
        """Let others write."""
        if self._handle in _HELD:
            _HELD.remove(self._handle)
            os.close(self._handle)
        self._handle = None

    def __enter__(self) -> FolderLock:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
