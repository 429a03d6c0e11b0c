"""A person's file is read as it is written now."""

import os
import sys
from pathlib import Path

from slipctl.study import doors


def test_a_file_that_is_written_again_in_the_same_second_is_read_anew(tmp_path: Path, monkeypatch):
    """Python would take bytecode of the old text: same size, same second. None is left either."""
    monkeypatch.setattr("sys.dont_write_bytecode", False)
    monkeypatch.setattr("sys.path", [*sys.path])
    file = tmp_path / "mine.py"
    for text in ("gain = 1\n", "gain = 2\n"):
        file.write_text(text)
        os.utime(file, (1e9, 1e9))
        module = doors.load_file(str(file))
        assert f"gain = {module.gain}\n" == text
        del sys.modules[module.__name__]
    assert [p.name for p in tmp_path.iterdir()] == ["mine.py"]
