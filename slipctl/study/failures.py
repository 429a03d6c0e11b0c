"""What breaks, said in one line with its place, and noted, so that the rest goes on."""

from __future__ import annotations

import inspect
import logging
import os
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

from slipctl.errors import BadInput, RunFailed
from slipctl.run.results import LeftToFull, NotRun, Results

log = logging.getLogger("slipctl")


def blame(error: BaseException) -> NoReturn:
    """Raise what went wrong in somebody's equations as one line with file and line.

    Raises:
        BadInput: the error came from a model, a study or a user's file.
        Exception: the error itself, where it did not.
    """
    if isinstance(error, (BadInput, RunFailed)):
        raise error
    if isinstance(error, SyntaxError) and error.filename:
        raise BadInput(f"{short(error.filename)}, line {error.lineno}: {error.msg}") from error
    engine = str(Path(__file__).resolve().parents[1]) + os.sep
    for frame in reversed(traceback.extract_tb(error.__traceback__)):
        file = str(Path(frame.filename).resolve())
        if file.startswith(engine) or "site-packages" in file or frame.filename.startswith("<"):
            continue
        if file.startswith(str(Path(inspect.__file__).resolve().parent) + os.sep):
            continue
        text = str(error).strip().partition("\n")[0]
        where = f"{short(frame.filename)}, line {frame.lineno}"
        raise BadInput(f"{where}: {type(error).__name__}: {text}") from error
    raise error


def reason(error: BaseException) -> str:
    """Say an error in one line, with its place where it is in a model or a study."""
    try:
        blame(error)
    except (BadInput, RunFailed) as known:
        return str(known)
    except OSError as known:
        return f"cannot write {known.filename or ''}: {known.strerror or known}"
    except (Exception, SystemExit, GeneratorExit) as unknown:
        return f"{type(unknown).__name__}: {str(unknown).strip().partition(chr(10))[0]}"


def short(file: str) -> str:
    """A path from here, where it is below."""
    try:
        relative = os.path.relpath(file)
    except ValueError:  # another drive
        return file
    return file if relative.startswith("..") else relative


@contextmanager
def note_failure(results: Results, what: str, left: list[str] | None = None) -> Iterator[None]:
    """Note what breaks, so that the rest goes on and nothing computed is lost.

    What asks for what was not run is told, in ``left`` if that is given.
    """
    try:
        yield
    except LeftToFull:
        log.debug("%s is left to --full", what)
    except NotRun as missing:
        told = f"{what} is left out: {missing}"
        (log.info if left is None else left.append)(told)
    except Exception as error:
        results.failed[what] = reason(error)
        log.debug("%s", what, exc_info=True)
