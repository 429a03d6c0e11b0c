"""A plugin of pytest: which functions each passing test enters, and how long it takes.

Written to the file that ``ENTERED`` names, a line of JSON each as they end, so that a run that is
stopped is of use too; the mutation run reads it. A test that takes more CPU than ``LONGEST``
seconds fails, and so is not asked.
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
LONGEST = float(os.environ.get("LONGEST", "40"))
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
    signal.setitimer(signal.ITIMER_PROF, LONGEST)
    sys.settrace(note)  # no profiler: what names results of equations gives way to one
    try:
        result = yield
    finally:
        sys.settrace(None)
        signal.setitimer(signal.ITIMER_PROF, 0)
    own = [c for c in codes.values() if "slipctl" in c.co_filename]
    seen = sorted({f"{c.co_filename}:{c.co_qualname.replace('.<locals>', '')}" for c in own})
    tests.setdefault(item.nodeid, {}).update(entered=seen, seconds=time.process_time() - start)
    keep(item.nodeid)
    return result


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    if report.failed or report.skipped:
        tests.setdefault(report.nodeid, {})["out"] = True


def keep(name: str) -> None:
    """Write a test that passed, and forget it."""
    test = tests.pop(name)
    if "out" not in test:
        with Path(os.environ["ENTERED"]).open("a", encoding="utf-8") as file:
            file.write(json.dumps({name: test}) + "\n")
