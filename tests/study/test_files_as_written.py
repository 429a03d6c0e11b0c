"""A person's file is read as it is written now."""

import os
import sys
from pathlib import Path

import pytest

from slipctl import BadInput
from slipctl.study import resolve


def test_a_file_that_is_written_again_in_the_same_second_is_read_anew(tmp_path: Path, monkeypatch):
    """Python would take bytecode of the old text: same size, same second. None is left either."""
    monkeypatch.setattr("sys.dont_write_bytecode", False)
    monkeypatch.setattr("sys.path", [*sys.path])
    file = tmp_path / "mine.py"
    for text in ("gain = 1\n", "gain = 2\n"):
        file.write_text(text)
        os.utime(file, (1e9, 1e9))
        module = resolve.load_file(str(file))
        assert f"gain = {module.gain}\n" == text
        del sys.modules[module.__name__]
    assert [p.name for p in tmp_path.iterdir()] == ["mine.py"]


@pytest.mark.parametrize(
    ("written", "said"),
    [
        (b"x = 1\n\xed\xb2\x80 = 2\n", "line 2: the byte 0xed is no utf-8 text"),
        # the compiler of Python 3.11 raises another error here, without file and line
        (b"from casadi import exp\nfrom sli\xed\xb2\x80Input, Output\n", "line 2: the byte 0xed"),
        ("x = 1\n".encode("utf-16"), "invalid or missing encoding declaration"),
    ],
)
def test_bytes_that_are_no_text_are_told_with_their_line(tmp_path: Path, written, said):
    file = tmp_path / "mine.py"
    file.write_bytes(written)
    with pytest.raises(BadInput, match=said) as error:
        resolve.load_file(str(file))
    assert "\n" not in str(error.value)


def test_a_file_may_name_its_encoding(tmp_path: Path):
    file = tmp_path / "mine.py"
    file.write_bytes('# -*- coding: latin-1 -*-\nname = "é"\n'.encode("latin-1"))
    assert resolve.load_file(str(file)).name == "é"
