"""A window that is used for long holds no more than one that was opened a while ago."""

from __future__ import annotations

from pathlib import Path

import pytest
from workbench_frames import answered

from slipctl import registry
from slipctl.workbench.answers import Answers
from slipctl.workbench.desk import Desk

METRO = registry.folder("models") / "vehicle" / "files" / "metro.toml"
STATM = Path("/proc/self/statm")
PAGE = 4096

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(not STATM.exists(), reason="the system does not tell what a process holds"),
]


def held() -> float:
    """Memory that this process holds, in MB."""
    return int(STATM.read_text().split()[1]) * PAGE / 1e6


def test_a_thousand_moved_numbers_hold_no_more_memory():
    answers = Answers(Desk("subway_braking:sta", compile=False))
    marks = []
    for k in range(1000):
        answered(answers, kind="run", numbers={"ctl.law.k1": 20.0 + 0.01 * k})
        if k in (200, 600, 999):
            marks.append(held())
    print("MB after 200, 600 and 1000 moved numbers:", marks)
    assert marks[-1] - marks[0] < 8  # what is kept of each would be 2 kB at the most


def test_edited_equations_hold_no_more_memory(tmp_path, monkeypatch):
    text = METRO.read_text(encoding="utf-8").replace('duration = "17 s"', 'duration = "0.2 s"')
    (tmp_path / "metro.toml").write_text(text)
    monkeypatch.chdir(tmp_path)
    answers = Answers(Desk("metro.toml:pid", tmp_path, compile=False))
    marks = []
    for k in range(60):
        edited = text.replace('mass = "38 t"', f'mass = "{38 + 0.01 * k:.2f} t"')
        head = answered(answers, kind="run", text=edited)[-1][0]
        assert head["metrics"]
        marks.append(held())
    print("MB after each edit:", [round(m) for m in marks[::10]])
    first, last = marks[19], marks[-1]
    assert last - first < 40  # a loop is 30 MB: the last four stay, the others go
