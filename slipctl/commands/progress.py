"""How far a run is, told on stderr."""

from __future__ import annotations

import logging
import time
from typing import IO

from slipctl.commands.environment import progress_interval

log = logging.getLogger("slipctl")

FIRST = 0.05
"""Share up to which the first news of a run may come late because it was built before."""


class Progress:
    """Tells how far a run is: lines that move on a terminal, otherwise a line when one begins.

    What goes on has a line with the share done and the time left, as many as there are at once.
    """

    def __init__(self, total: int, stream: IO[str], quiet: bool) -> None:
        self.total, self.stream, self.begun_count = total, stream, 0
        self.moving = stream.isatty() and not quiet
        self.shares: dict[str, float] = {}
        self.began: dict[str, tuple[float, float]] = {}
        self.told: dict[str, float] = {}
        self.lines, self.last = 0, 0.0
        self.every = progress_interval()

    def __call__(self, what: str, share: float) -> None:
        """Show the share done of what is running."""
        now = time.monotonic()
        if what not in self.shares:
            self.begun_count += 1
            self.began[what], self.told[what] = (now, 0.0), now
            if not self.moving:
                log.info("%d/%d %s", self.begun_count, self.total, what)
        if not self.began[what][1] and share <= FIRST:  # until it moves, it is built and compiled
            self.began[what] = now, share
        self.shares[what] = share
        if self.moving:
            if share >= 1.0 or now - self.last > 0.1:
                self.last = now
                self._draw()
        elif now - self.told[what] > self.every and 0.0 < share < 1.0:
            self.told[what] = now
            log.info("%s", self._line(what))

    def _line(self, what: str) -> str:
        """One that goes on: share done and time left."""
        share = self.shares[what]
        began, before = self.began[what]
        spent, done = time.monotonic() - began, share - before
        left = f", {clock(spent * (1 - share) / done)} left" if done > 0.02 else ""
        return f"{what}: {100 * share:.0f} %{left}"

    def _draw(self) -> None:
        """Write the lines over the ones before."""
        over = sum(self.shares.values())
        filled = round(24 * over / max(self.total, 1))
        bar = "#" * filled + "." * (24 - filled)
        ended = sum(share >= 1.0 for share in self.shares.values())
        rows = [f"[{bar}] {ended}/{self.total}"]
        rows += ["  " + self._line(n) for n, share in self.shares.items() if share < 1.0]
        self._erase()
        self.stream.write("\n".join(rows))
        self.stream.flush()
        self.lines = len(rows)

    def _erase(self) -> None:
        up = f"\033[{self.lines - 1}A" if self.lines > 1 else ""
        self.stream.write(f"\r{up}\033[J")

    def end(self) -> None:
        """Leave a clean line."""
        if self.moving:
            self._erase()
            self.stream.flush()
            self.lines = 0


def clock(seconds: float) -> str:
    """Write a time as 45 s, 3 min or 2.5 h."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
