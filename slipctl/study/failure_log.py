"""What breaks in a run is noted, so that the rest goes on."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager

from slipctl.run.results import LeftToFull, NotRun, Results
from slipctl.study.failures import reason

log = logging.getLogger("slipctl")


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
