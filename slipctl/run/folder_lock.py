"""One writer of a folder: who comes second while the first writes is refused."""

from __future__ import annotations

import os
from pathlib import Path

from slipctl.errors import BadInput

try:
    import fcntl
except ImportError:  # Windows: a folder cannot be locked there
    fcntl = None  # type: ignore[assignment]


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
