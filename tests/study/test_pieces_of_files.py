"""Paragraphs of a page, columns of a table of a log, and what an ensemble tells of itself."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipctl import BadInput, Ensemble
from slipctl.run.sweep.ensemble import read_ensemble
from slipctl.study.files.results_folder import _cells
from slipctl.study.report.report_page import _paragraphs


@pytest.mark.parametrize("gap", ["\n\n", "\n\n\n\n", "\n\n  \n\n"])
def test_each_paragraph_is_there_once_however_many_lines_are_empty(gap: str) -> None:
    text = gap.join(["one <&> two", "    y = a*x\n    z = b", "names ``v_s`` here", "  indented"])
    assert _paragraphs(text) == (
        "<p>one &lt;&amp;&gt; two</p><pre>    y = a*x\n    z = b</pre>"
        "<p>names <code>v_s</code> here</p><p>  indented</p>"
    )
    assert _paragraphs("") == _paragraphs(gap) == ""


NUMBERS = st.sampled_from([0.0, -0.0, 1.5, 1 / 3, 1e-300, -7.25, 1e12, float("nan"), float("inf")])


@given(st.lists(st.tuples(NUMBERS, st.integers(1, 9)), min_size=1, max_size=9))
def test_a_column_is_written_the_same_whether_it_stands_still_or_not(pieces) -> None:
    """To ten digits, row by row; minus zero is not zero, and one that is missing is written."""
    column = np.concatenate([np.full(n, v) for v, n in pieces])
    form, values = _cells(column)
    assert [form % v for v in values] == [f"{v:.10g}" for v in column]


@given(st.lists(st.integers(-5, 5), min_size=1, max_size=9))
def test_whole_numbers_are_written_whole(values) -> None:
    for kind in (np.int64, np.int8, np.float32):
        form, found = _cells(np.array(values, kind))
        assert [form % v for v in found] == [str(v) for v in values]


def test_what_an_ensemble_tells_is_all_that_differs_from_draw_to_draw() -> None:
    """Two that tell the same are one; what is drawn together belongs to it."""
    plain = Ensemble({"car.m": "7t:9t"}, {"peak": "0.8:1.2 of car.c"}, True)
    assert plain.told() == {"seeds": True, "draw": {"car.m": "7t:9t"},
                            "scale": {"peak": "0.8:1.2 of car.c"}}  # fmt: skip
    assert read_ensemble("here", plain.told()).hash == plain.hash
    others = [
        Ensemble({"car.m": "7t:9t"}, {"peak": "0.8:1.2 of car.c"}),
        Ensemble({"car.m": "7t:8t"}, {"peak": "0.8:1.2 of car.c"}, True),
        Ensemble({"car.m": "7t:9t"}, {}, True),
        Ensemble({"car.m": "7t:9t"}, {"peak": "0.8:1.2 of car.c"}, True, lambda k: {}, {"many": 3}),
        Ensemble({"car.m": "7t:9t"}, {"peak": "0.8:1.2 of car.c"}, True, lambda k: {}, {"many": 4}),
    ]
    assert len({plain.hash, *(e.hash for e in others)}) == 6
    assert others[3].told()["also"] == {"many": 3}
    for wrong in (3, "draw", {"draw": 3}, {"draw": {"m": 3}}, {"more": {}}, {}):
        with pytest.raises(BadInput):
            read_ensemble("here", wrong)
