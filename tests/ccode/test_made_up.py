"""Made-up inputs of test vectors: a block that breaks on most of its ranges has vectors too."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from slipctl import Input, Output, law
from slipctl.ccode import codegen
from slipctl.ccode.check import comparison
from slipctl.ccode.module.plan import Plan


@law(y=Output("1"))
def narrow(u=Input("1", value=0.5, lo=-1e6, hi=1e6)):
    """A root that is real from -1 to 2."""
    return ca.sqrt((u + 1) * (2 - u))


@law(y=Output("1"))
def never(u=Input("1", lo=0, hi=1)):
    """No number for any input in range."""
    return ca.log(-1 - u)


@law(y=Output("1"))
def wide(u=Input("1", lo=-1e6, hi=1e6)):
    """A number for any input."""
    return 2 * u


def test_the_share_of_the_ranges_is_told(tmp_path: Path) -> None:
    """1e-6 of the range about 0.5 is where the root is real: it has ticks, and says so."""
    report = codegen.export(narrow, tmp_path / "narrow")
    assert report.data["made_up"] == 1e-6
    assert report.data["ticks"] > 0
    assert "Made-up inputs fill 0.0001 % of their ranges" in str(report)
    assert "Made-up inputs fill 0.0001 %" in (tmp_path / "narrow" / "report.md").read_text()


def test_no_vectors_are_told(tmp_path: Path) -> None:
    report = codegen.export(never, tmp_path / "never")
    assert report.data["ticks"] == 0
    for text in (str(report), (tmp_path / "never" / "report.md").read_text()):
        assert "No test vectors" in text


def test_what_does_not_break_is_told_nothing(tmp_path: Path) -> None:
    report = codegen.export(wide, tmp_path / "wide")
    assert (report.data["made_up"], report.data["ticks"]) == (1.0, comparison.TRIAL)
    assert "ade-up" not in str(report)
    inputs = {"u": np.zeros(3)}
    assert codegen.export(wide, tmp_path / "run", inputs=inputs).data["made_up"] is None


@pytest.mark.parametrize("width", comparison.WIDTHS)
def test_made_up_inputs_stay_in_their_share(width: float) -> None:
    rows = comparison.trial_rows(Plan(narrow), width)
    assert (np.abs(rows - 0.5) <= width * (1e6 + 0.5)).all()
    assert np.ptp(rows) > 0.9 * width * 2e6
