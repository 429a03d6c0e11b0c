"""A plugin of pytest: which functions each passing test enters, and how long it takes.

Written to the file that ``ENTERED`` names; the mutation run reads it.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import pytest

tests: dict[str, Any] = {}
LONG = 40
"""s of CPU: a longer test is not asked. (Twice what it takes unobserved, or more.)"""


def too_long(number: int, frame: FrameType | None) -> None:
    pytest.fail("too long to be asked of each change")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[Any]:
    codes: dict[int, CodeType] = {}  # by identity: a hash of a code is slow
    start = time.process_time()

    def note(frame: FrameType, event: str, arg: object) -> None:
        if event == "call":
            codes[id(frame.f_code)] = frame.f_code

    signal.signal(signal.SIGPROF, too_long)
    signal.setitimer(signal.ITIMER_PROF, LONG)
    sys.settrace(note)  # no profiler: what names results of equations gives way to one
    try:
        result = yield
    finally:
        sys.settrace(None)
        signal.setitimer(signal.ITIMER_PROF, 0)
    own = [c for c in codes.values() if "slipctl" in c.co_filename]
    seen = sorted({f"{c.co_filename}:{c.co_qualname.replace('.<locals>', '')}" for c in own})
    tests.setdefault(item.nodeid, {}).update(entered=seen, seconds=time.process_time() - start)
    return result


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    if report.failed or report.skipped:
        tests.setdefault(report.nodeid, {})["out"] = True


def pytest_sessionfinish() -> None:
    kept = {n: t for n, t in tests.items() if "out" not in t and "entered" in t}
    Path(os.environ["ENTERED"]).write_text(json.dumps(kept), encoding="utf-8")
