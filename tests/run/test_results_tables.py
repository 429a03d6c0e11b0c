"""Tables of what experiments found: columns of one length, asked by name and by row."""

from __future__ import annotations

import pytest

from slipctl import BadInput
from slipctl.run.results import Table

GOOD = {"peak": ("m/s", [1.2, 1.8]), "rail": ("1", ["dry", "wet"])}


def test_a_value_is_that_of_the_first_row_that_fits() -> None:
    table = Table("peaks", GOOD)
    assert list(table["peak"]) == [1.2, 1.8]
    assert table.where("peak", rail="wet") == 1.8
    assert table.where("peak", rail="ice") is None
    assert table.where("rail", peak=1.2) == "dry"
    assert Table("same", {"a": ("1", [1, 2]), "b": ("1", [3, 3])}).where("a", b=3) == 1


@pytest.mark.parametrize(
    ("title", "columns", "doc", "said"),
    [
        (3, GOOD, "", "title"), ("t", [1], "", "columns"), ("t", GOOD, 3, "doc"),
        ("t", GOOD | {"x": ("1", [1])}, "", "columns of unequal length.*'x': 1"),
    ],
)  # fmt: skip
def test_what_is_no_table_is_refused(title, columns, doc, said) -> None:
    with pytest.raises(BadInput, match=said):
        Table(title, columns, doc)


def test_a_column_that_there_is_not_is_told_with_the_nearest() -> None:
    with pytest.raises(BadInput, match="table 'peaks' has no column 'peek'; did you mean 'peak'"):
        Table("peaks", GOOD)["peek"]
