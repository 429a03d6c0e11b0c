"""An error in somebody's equations is told with the line of theirs that led to it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from slipctl import BadInput
from slipctl.block.units.unit_algebra import unit
from slipctl.draw.diagrams.levels import level
from slipctl.errors import RunFailed
from slipctl.study.failures import blame, reason


def raised(text: str, path: Path, **known) -> Exception:
    """What a user's file raises as it runs."""
    path.write_text(text, encoding="utf-8")
    try:
        exec(compile(text, str(path), "exec"), dict(known))
    except Exception as error:
        return error
    raise AssertionError("it raises nothing")


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("x = 1\ny = 1 / 0\n", 2, "ZeroDivisionError: division by zero"),
        # the engine raises, and the standard library: it is the line that called them
        ("x = 1\n\ndef f():\n    return level(3)\n\nf()\n", 4, "AttributeError"),
        ("import json\njson.loads('{')\n", 2, "JSONDecodeError"),
        ("import json\n\n\njson.dumps({}, default=3, cls=4)\n", 4, "TypeError"),
        ("raise ValueError('first\\nsecond')\n", 1, "ValueError: first"),
        ("def f():\n    raise KeyError('k')\ndef g():\n    f()\ng()\n", 2, "KeyError"),
    ],
)  # fmt: skip
def test_the_innermost_line_of_a_file_of_theirs_is_told(text, line, said, tmp_path: Path) -> None:
    error = raised(text, tmp_path / "law.py", level=level)
    with pytest.raises(BadInput, match=rf"law\.py, line {line}: {said}") as told:
        blame(error)
    assert "\n" not in str(told.value)
    assert told.value.__cause__ is error
    assert reason(error) == str(told.value)


def test_a_file_that_is_no_python_is_told_with_its_line(tmp_path: Path) -> None:
    error = raised("x = 1\ny = (\n", tmp_path / "law.py")
    with pytest.raises(BadInput, match=r"law\.py, line 2: "):
        blame(error)


def test_what_nobody_else_wrote_is_the_error_itself() -> None:
    """Of the engine alone, and what is told in a line already."""
    try:
        level(3)  # type: ignore[arg-type]
    except AttributeError as error:
        inner = error.with_traceback(error.__traceback__.tb_next)
    with pytest.raises(AttributeError):
        blame(inner)
    for known in (BadInput("so"), RunFailed("so")):
        with pytest.raises(type(known), match="so"):
            blame(known)
        assert reason(known) == "so"
    with pytest.raises(BadInput):
        unit("apples per")
    lost = OSError(28, "No space left on device", "there.csv")
    assert reason(lost) == "cannot write there.csv: No space left on device"
    assert json.loads("{}") == {}
