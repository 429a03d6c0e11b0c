"""Files are written whole or not at all, strict JSON, under names that every system has."""

from __future__ import annotations

import errno
import json
import os
import stat
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipctl import BadInput
from slipctl.run import store
from slipctl.run.sweep import sweep_export, sweep_store

LEAVES = st.one_of(st.none(), st.booleans(), st.integers(-99, 99), st.text("aä\"\n", max_size=4),
                   st.floats(-1e9, 1e9))  # fmt: skip


def several(inner):
    return st.lists(inner, max_size=3) | st.dictionaries(
        st.text("abü", max_size=3), inner, max_size=3
    )


VALUES = st.recursive(LEAVES, several, max_leaves=12)


@given(VALUES)
def test_what_is_written_as_json_is_read_as_it_was(value):
    text = store.json_text(value)
    assert json.loads(text) == value
    assert text.endswith("\n")
    assert not any(line != line.rstrip() for line in text.split("\n"))


def test_numbers_of_numpy_and_no_numbers_are_plain():
    given_ = {"a": np.float64(1.5), "b": np.array([1.0, np.nan]), 3: (np.int64(2), np.inf)}
    assert store.plain(given_) == {"a": 1.5, "b": [1.0, None], "3": [2, None]}
    assert store.json_text({"x": float("nan")}) == '{\n  "x": null\n}\n'


def test_a_small_record_has_one_line_and_what_holds_others_has_more():
    text = store.json_text(
        {"v": {"value": 1.0, "unit": "m"}, "w": [1, 2], "x": [{"a": 1}], "y": {}}
    )
    assert text.split("\n")[1:] == [
        '  "v": {"value": 1.0, "unit": "m"},', '  "w": [1, 2],', '  "x": [', "    {",
        '      "a": 1', "    }", "  ],", '  "y": {}', "}", ""]  # fmt: skip


def test_a_file_that_fails_half_way_leaves_what_was_there(tmp_path: Path):
    path = tmp_path / "deep" / "a.json"
    store.write_json(path, {"n": 1})
    assert store.read_json(path)["n"] == 1
    assert store.text_of(path) == path.read_text().rstrip()

    def fails(scratch: Path) -> None:
        scratch.write_text("half")
        raise OSError(errno.ENOSPC, "No space left on device", str(scratch))

    with pytest.raises(OSError, match="No space left") as told:
        store.write_with(path, fails)
    assert told.value.filename == str(path)
    assert store.read_json(path)["n"] == 1
    store.write_with(path, lambda scratch: scratch.write_text('{"format": 1, "n": 2}'))
    assert store.read_json(path)["n"] == 2
    assert [p.name for p in path.parent.iterdir()] == ["a.json"]


def test_an_error_of_another_file_keeps_its_name(tmp_path: Path):
    for named, told_as in (
        (None, "mine"),
        (str(tmp_path / f"{store.PART}x"), "mine"),
        (str(tmp_path / "other"), "other"),
    ):
        with (
            pytest.raises(OSError, match="gone") as told,
            store.name_file_in_errors(tmp_path / "mine"),
        ):
            raise OSError(errno.ENOENT, "gone", named)
        assert Path(told.value.filename).name == told_as


@pytest.mark.skipif(os.name != "posix", reason="rights of POSIX")
def test_a_file_has_the_rights_that_others_have(tmp_path: Path):
    store.write_text(tmp_path / "ours", "a\nb\n")
    (tmp_path / "plain").write_text("a")
    ours, plain = (stat.S_IMODE((tmp_path / n).stat().st_mode) for n in ("ours", "plain"))
    assert ours == plain
    assert (tmp_path / "ours").read_bytes() == b"a\nb\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "is no JSON file of slipctl"), ("[1]", "is no JSON file of slipctl"),
        ("{}", "has no format number"), ('{"format": "1"}', "has no format number"),
        (f'{{"format": {store.FORMAT + 1}}}', "has format .*; update slipctl"), ("\udcff", "is no"),
    ],
)  # fmt: skip
def test_what_is_no_file_of_ours_is_refused(text, said, tmp_path: Path):
    path = tmp_path / "a.json"
    path.write_bytes(text.encode("utf-8", errors="surrogateescape"))
    with pytest.raises(BadInput, match=rf"a\.json {said}"):
        store.read_json(path)
    with pytest.raises(BadInput, match=r"cannot read .*none\.json"):
        store.read_json(tmp_path / "none.json")


def test_places_that_cannot_be_written_are_refused_without_a_trace(tmp_path: Path):
    file = tmp_path / "file"
    file.touch()
    for place, said in (
        (tmp_path / "nul.json", "nul.json is a device on Windows"),
        (tmp_path / "COM1" / "a", "COM1 is a device"), (tmp_path / "aux .txt", "is a device"),
        (tmp_path / ("a" * 256), "has at most 255 bytes"), (tmp_path / ("ä" * 128), "255 bytes"),
        (file / "below", "is not a folder"), (tmp_path / "\udcff" / "a", "it is no text"),
    ):  # fmt: skip
        with pytest.raises(BadInput, match=said):
            store.check_file(place)
    with pytest.raises(BadInput, match="it is a folder; --out names a file"):
        store.check_file(tmp_path)
    with pytest.raises(BadInput, match="file is not a folder; choose another --out"):
        store.check_folder(file)
    with pytest.raises(BadInput, match="file is not a folder"):
        store.check_folder(file / "new" / "deep")
    with pytest.raises(BadInput, match="file is not a folder"):
        sweep_store.begin(file / "new", {})
    for export, said in (
        ("nul.nc", "is a device"), ("file/below.nc", "is not a folder"),
        ("file/below.zarr", "is not a folder"), ("a.csv", "write a file that ends in"),
    ):  # fmt: skip
        with pytest.raises(BadInput, match=said):
            sweep_export.check(tmp_path / export)
    for good in ("new/deep/a.json", "a" * 255, "ä" * 127, "null.json", "com10"):
        store.check_file(tmp_path / good)
    store.check_folder(tmp_path / "new" / "deep")
    assert list(tmp_path.iterdir()) == [file]
