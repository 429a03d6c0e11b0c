"""The table of wrong samples is that of the evidence."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"
TOOLS = DOCS / "tools"


def test_the_table_is_that_of_the_evidence():
    sys.path.insert(0, str(TOOLS))
    spec = importlib.util.spec_from_file_location("make_wrong", TOOLS / "make_wrong_samples.py")
    maker = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(maker)
    fresh = (DOCS / "c_interface.md").read_text(encoding="utf-8")
    assert fresh == maker.page(), "run: python docs/tools/make_wrong_samples.py"
    fault = dict(own=0.2, alike=None, allowed=0.1, missed=0, locks=False, ticks=10, told=10)
    found = {"faults": 9, "slow": [fault, fault | {"own": 0.1}, fault | {"alike": 0.05}]}
    assert maker.rows({"a:b": found}) == "| `a:b` | 9 | 6 | 2 | 0 | 1 | 0 | 1 |\n"


def test_the_tables_of_failures_are_those_of_model_and_evidence():
    sys.path.insert(0, str(TOOLS))
    spec = importlib.util.spec_from_file_location("make_failures", TOOLS / "make_failures.py")
    maker = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(maker)
    fresh = (DOCS / "failures.md").read_text(encoding="utf-8")
    assert fresh == maker.page(), "run: python docs/tools/make_failures.py"
