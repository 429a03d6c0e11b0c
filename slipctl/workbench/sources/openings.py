"""What a person asks to open, checked before anything is shown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from slipctl import registry
from slipctl.errors import BadInput
from slipctl.run import store
from slipctl.study.request import Request

if TYPE_CHECKING:
    from slipctl.workbench.answers import Answers

EXAMPLE = "metro.toml"
"""What is opened when nothing is named."""


PATIENCE = 20.0
"""Seconds that a piece of work may take; the process is ended then, and a new one begins."""


@dataclass(frozen=True)
class Opening:
    """What is open, and how.

    Attributes:
        name: file, study or loop. folder: where files are written. files: Python files that may be
            imported. compile: compile loops. patience: seconds that a piece of work may take.
    """

    name: str
    folder: str
    files: tuple[str, ...] = ()
    compile: bool = True
    patience: float = PATIENCE


def opening_of_name(name: str = "", files: Sequence[str] = (), compile: bool = True) -> Opening:
    """What is open, by its name; the folder of a file is the one that is written into.

    Args:
        name: file, study, loop, folder of a sweep, recorded log; empty for the example of
            ``slipctl new``, which is written into this folder if it is not there.
        files: Python files that may be imported. compile: compile loops where there is a compiler.

    Raises:
        BadInput: no such file or study.
    """
    name = name or _example()
    if is_log(name):
        return Opening(name, str(Path(name).resolve().parent), tuple(files), compile)
    allowed = [*files, *([name] if name.endswith(".py") else [])]
    for file in allowed:
        if not Path(file).is_file():
            raise BadInput(f"there is no file {file}")
    if is_sweep(name):
        from slipctl.run.sweep.sweep_results import open_sweep
        from slipctl.workbench.sources.opened_sweeps import loop_of_sweep

        asked = Request.read(loop_of_sweep(open_sweep(name)))
    else:
        asked = Request.read(name)
    if not asked.home:
        asked.needs_loop()
    folder = Path(asked.home).parent if asked.home.endswith((".toml", ".py")) else Path()
    return Opening(name, str(folder.resolve()), tuple(allowed), compile)


def check_opening(opening: Opening) -> None:
    """Refuse a loop or a study that there is not; a file with faults is opened, to mend it.

    Raises:
        BadInput: there is none.
    """
    if is_sweep(opening.name):
        return  # its loop was found
    if is_log(opening.name):
        from slipctl.run.logs.recorded_log import read_recording

        read_recording(opening.name)
        return
    asked = Request.read(opening.name)
    if asked.home.endswith(".toml"):
        try:
            _ = asked.loop and asked.cases
        except BadInput:  # the page marks the faults at their lines
            return
    if asked.loop:
        _ = asked.declared
    elif not asked.home.endswith(".toml"):
        _ = asked.study


def is_sweep(name: str) -> bool:
    """Whether a name is a folder: of a sweep, or it is refused as one."""
    return Path(name).is_dir()


def is_log(name: str) -> bool:
    """Whether a name is a file that is neither a vehicle's nor Python: a recorded log."""
    return not name.endswith((".toml", ".py")) and Path(name).is_file()


def answers_of_opening(name: str, folder: str, compile: bool = True) -> Answers:
    """What answers a window, by what is open.

    Raises:
        BadInput: it is none.
    """
    if is_sweep(name):
        from slipctl.workbench.sources.opened_sweeps import SweepAnswers

        return SweepAnswers(name, folder, compile)
    if is_log(name):
        from slipctl.workbench.sources.opened_logs import LogAnswers

        return LogAnswers(name, folder)
    from slipctl.workbench.answers import Answers
    from slipctl.workbench.desk import Desk

    return Answers(Desk(name, folder, compile))


def _example() -> str:
    """The example of ``slipctl new``, in this folder; written if it is not there."""
    path = Path(EXAMPLE)
    if not path.exists():
        source = registry.folder("models") / "vehicle" / "files" / EXAMPLE
        store.check_file(path)
        store.write_text(path, source.read_text(encoding="utf-8"))
    return EXAMPLE
