"""What ``slipctl run`` prints below its tables: doubts, their numbers, warnings."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from slipctl.commands import run
from slipctl.study.report.remarks import Remark

REMARKS = [
    Remark("base", "rls", "the estimate " + "is far off " * 20, ("c = 1, true 2", "b = 3"), True),
    Remark("real", "ekf", "a warning has it", ("d = 4",), False),
]


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setattr(run, "estimator_remarks", lambda results: REMARKS)
    monkeypatch.setattr(run, "warnings_of_runs", lambda results: [("it slid", "base/rls")])
    monkeypatch.setattr(run, "claim_table", lambda verdicts, width: f"{len(verdicts)} claims")
    monkeypatch.setattr(run, "metric_table", lambda results, scenario, width: f"of {scenario}")
    monkeypatch.setattr(run, "left_to_full", lambda results: results.left)

    def of(verbose: bool = False, left: str = "", metrics: Any = ("base", "real")) -> Any:
        results = SimpleNamespace(metrics=dict.fromkeys(metrics), left=left)
        own = SimpleNamespace(results=results, options=SimpleNamespace(verbose=verbose))
        own._remarks = lambda: run._Run._remarks(own)
        own._summary = lambda verdicts: run._Run._summary(own, verdicts)
        return own

    return of


@pytest.mark.parametrize("verbose", [False, True])
def test_a_doubt_is_told_once_and_its_numbers_where_they_are_asked_for(made, verbose):
    lines = made(verbose)._remarks().splitlines()
    assert lines[0].startswith("base/rls: the estimate is far off")
    assert all(len(line) <= 132 for line in lines)
    assert lines[1].startswith("  ")
    assert not any("real/ekf" in line for line in lines)
    numbers = [line.strip() for line in lines if " = " in line]
    assert numbers == (["c = 1, true 2", "b = 3", "d = 4"] if verbose else [])


def test_what_is_printed_has_warnings_first_and_doubts_last(made):
    parts = made(left="left: more")._summary([1, 2]).split("\n\n")
    assert parts[0] == "warning: it slid (base/rls)"
    assert parts[1:4] == ["2 claims", "of base", "of real"]
    assert parts[4].startswith("base/rls: ")
    assert parts[5] == "left: more"
    assert len(parts) == 6
    few = made(metrics=())._summary([]).split("\n\n")
    assert [p[:8] for p in few] == ["warning:", "base/rls"]
