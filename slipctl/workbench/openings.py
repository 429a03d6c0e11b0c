"""What a person asks to open, checked before anything is shown."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from slipctl import registry
from slipctl.errors import BadInput
from slipctl.run import store
from slipctl.study.request import Request
from slipctl.workbench.web.windows import Opening

EXAMPLE = "metro.toml"
"""What is opened when nothing is named."""


def opening_of_name(name: str = "", files: Sequence[str] = (), compile: bool = True) -> Opening:
    """What is open, by its name; the folder of a file is the one that is written into.

    Args:
        name: file, study, loop; empty for the example of ``slipctl new``, which is written into
            this folder if it is not there. files: Python files that may be imported.
        compile: compile loops where there is a compiler.

    Raises:
        BadInput: no such file or study.
    """
    name = name or _example()
    allowed = [*files, *([name] if name.endswith(".py") else [])]
    for file in allowed:
        if not Path(file).is_file():
            raise BadInput(f"there is no file {file}")
    asked = Request.read(name)
    if not asked.home:
        asked.needs_loop()
    if asked.home.endswith(".toml") and not Path(asked.home).is_file():
        raise BadInput(f"there is no file {asked.home}; slipctl new metro {asked.home} writes one")
    folder = Path(asked.home).parent if asked.home.endswith((".toml", ".py")) else Path()
    return Opening(name, str(folder.resolve()), tuple(allowed), compile)


def check_opening(opening: Opening) -> None:
    """Refuse a loop or a study that there is not; a file with faults is opened, to mend it.

    Raises:
        BadInput: there is none.
    """
    asked = Request.read(opening.name)
    if asked.loop:
        _ = asked.declared
    elif not asked.home.endswith(".toml"):
        _ = asked.study


def _example() -> str:
    """The example of ``slipctl new``, in this folder; written if it is not there."""
    path = Path(EXAMPLE)
    if not path.exists():
        source = registry.folder("models") / "vehicle" / "files" / EXAMPLE
        store.check_file(path)
        store.write_text(path, source.read_text(encoding="utf-8"))
    return EXAMPLE
