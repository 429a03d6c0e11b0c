"""What a run knows of the machine that it runs on."""

import os

from slipctl.run import machine


def test_cores_are_those_that_the_process_may_use(monkeypatch):
    """One of many where it is bound to one; all where the system cannot say; one at least."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {3}, raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 64)
    assert machine.cores() == 1
    monkeypatch.delattr(os, "sched_getaffinity")
    assert machine.cores() == 64
    monkeypatch.setattr(os, "cpu_count", lambda: None)
    assert machine.cores() == 1
