"""Programs of this machine beside slipctl: found, run, and the folders that they work in."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from slipctl.errors import BadInput


def missing_program(option: str, what: str, package: str) -> BadInput:
    """What to say where a program that an option needs is not installed."""
    return BadInput(f"{option} needs {what}; install it (Debian, Ubuntu: apt install {package})")


def find_program(name: str, option: str, package: str, what: str = "") -> str:
    """Path of a program.

    Raises:
        BadInput: it is not installed.
    """
    found = shutil.which(name)
    if found is None:
        raise missing_program(option, what or name, package)
    return found


def run_program(
    command: Sequence[object], folder: Path | None = None, **more: Any
) -> subprocess.CompletedProcess[str]:
    """Run a program to its end, in a folder, and take what it says."""
    return subprocess.run(
        list(map(str, command)), cwd=folder, capture_output=True, text=True, check=False, **more
    )


def first_error(said: str) -> str:
    """The first line that a compiler calls an error."""
    return next((line for line in said.splitlines() if "error" in line), "no message")


@contextmanager
def scratch_folder(texts: Mapping[str, str] | None = None) -> Iterator[Path]:
    """A folder with these texts, which is gone behind the work in it."""
    with tempfile.TemporaryDirectory(prefix="slipctl_") as folder:
        for name, text in (texts or {}).items():
            (Path(folder) / name).write_text(text, encoding="utf-8")
        yield Path(folder)
