"""Columns of a Parquet file: numbers, times from the first one on, texts; what is missing."""

from __future__ import annotations

import numpy as np
import pytest

from slipctl.run.logs.binary_logs import _numbers

pyarrow = pytest.importorskip("pyarrow")


def read(values, kind):
    return _numbers(pyarrow, pyarrow.chunked_array([pyarrow.array(values, kind)]))


def test_texts_are_texts_and_what_is_missing_is_empty() -> None:
    for kind in (pyarrow.string(), pyarrow.dictionary(pyarrow.int8(), pyarrow.string())):
        found, unit = read(["dry", None, "wet"], kind)
        assert (list(found), unit) == (["dry", "", "wet"], "")
    found, _ = read(["1.5", None, "2"], pyarrow.string())
    assert found[0] == 1.5
    assert np.isnan(found[1])


@pytest.mark.parametrize(("unit", "scale"), [("s", 1), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)])
def test_times_are_seconds_from_the_first_one_that_is_there(unit, scale) -> None:
    """So no digit is lost of times since 1970."""
    begin = int(1.7e9 / scale)
    for kind in (pyarrow.timestamp(unit), pyarrow.duration(unit)):
        found, told = read([None, begin, None, begin + 3], kind)
        assert told == "s"
        assert np.isnan(found[[0, 2]]).all()
        assert list(found[[1, 3]]) == [0, 3 * scale]
        none, told = read([None, None], kind)
        assert np.isnan(none).all()


def test_whole_numbers_stay_whole_where_none_is_missing() -> None:
    found, unit = read([2**60 + 1, 3], pyarrow.int64())
    assert (list(found), found.dtype, unit) == ([2**60 + 1, 3], np.int64, "")
    found, _ = read([2, None], pyarrow.int64())
    assert found.dtype == float
    assert np.isnan(found[1])
    found, _ = read([2**52 + 1], pyarrow.uint64())
    assert found.dtype == float
    assert found[0] == 2**52 + 1
    found, _ = read([0.5, 1.5], pyarrow.float32())
    assert list(found) == [0.5, 1.5]
    found, _ = read([True, False], pyarrow.bool_())
    assert list(found) == [1, 0]
