"""How far a run is, told on stderr."""

from __future__ import annotations

import logging
from typing import IO

log = logging.getLogger("slipctl")


class Progress:
    """Tells how far a run is: a line that moves on a terminal, otherwise a line per run."""

    def __init__(self, total: int, stream: IO[str], quiet: bool) -> None:
        self.total, self.stream, self.done = total, stream, 0
        self.moving = stream.isatty() and not quiet
        self.current = ""

    def __call__(self, what: str, share: float) -> None:
        """Show the share done of what is running."""
        if what != self.current:
            self.done += bool(self.current)
            self.current = what
            if not self.moving:
                log.info("%d/%d %s", self.done + 1, self.total, what)
        if self.moving:
            filled = round(24 * (self.done + share) / max(self.total, 1))
            bar = "#" * filled + "." * (24 - filled)
            self.stream.write(f"\r\033[K[{bar}] {self.done + 1}/{self.total} {what}")
            self.stream.flush()

    def end(self) -> None:
        """Leave a clean line."""
        if self.moving:
            self.stream.write("\r\033[K")
            self.stream.flush()
