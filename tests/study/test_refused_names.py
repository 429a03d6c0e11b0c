"""Names and files that mean no block, study, loop or table: one line that says what to write."""

from __future__ import annotations

import pytest

from slipctl import BadInput
from slipctl.run.results import NotRun
from slipctl.study import resolve
from slipctl.study.declaration import Context
from slipctl.study.files import equation_files
from slipctl.study.request import Request

PYTHON = """
from slipctl import Input, Output, law

@law(y=Output("1", "out"))
def line(a=Input("1", "in")):
    return 2 * a

def made(gain=2.0):
    return line

def needs(gain, *more):
    return line

def breaks():
    raise KeyError("missing")

def gives_none():
    return None

number = 3
pair = [line, line]
"""


@pytest.fixture
def mine(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(PYTHON, encoding="utf-8")
    (tmp_path / "text.txt").write_text("x = 1", encoding="utf-8")
    (tmp_path / "broken.py").write_text("x = = 1", encoding="utf-8")
    (tmp_path / "no_text.py").write_bytes(b"x = '\xff'")
    (tmp_path / "breaks.py").write_text("x = 1\ny = 1 / 0", encoding="utf-8")
    (tmp_path / "bytes.toml").write_bytes(b"x = '\xff'")
    (tmp_path / "deep.toml").write_text("x = " + "[" * 5000 + "]" * 5000, encoding="utf-8")
    (tmp_path / "long.toml").write_text("#" * (equation_files.LARGEST + 1), encoding="utf-8")
    return tmp_path


BLOCKS = [
    ("mine.py:lime", "has no block 'lime'; did you mean 'line'"),
    ("mine.py:number", "mine.py:number is no block; decorate it with @law, @flow or @step"),
    ("mine.py:pair", "mine.py:pair is no block; decorate it with @law, @flow or @step"),
    ("mine.py:gives_none", "mine.py:gives_none is no block; decorate it"),
    ("mine.py:needs", "needs is a function that needs gain; write a file with"),
    ("mine.py", "mine.py: write which block of it, mine.py:block"),
    ("deep.toml", "deep.toml"),
    ("no.py:line", "there is no file no.py"),
    ("= 3", "is no equation; write name = expression where"),
    ("subway_braking.no", "subway_braking"),
    ("no_model_at_all", "no_model_at_all"),
]


@pytest.mark.parametrize(("name", "said"), BLOCKS)
def test_a_name_of_no_block_is_refused(name, said, mine):
    with pytest.raises(BadInput) as refused:
        resolve.load_block(name)
    assert said in " ".join(refused.value.args[0].split()), refused.value
    assert resolve.load_block("mine.py:line")(a=1.0)["y"] == 2
    assert resolve.load_block("mine.py:made") is resolve.load_block("mine.py:line")


@pytest.mark.parametrize(
    ("file", "said"),
    [("no.py", "there is no file no.py"), ("text.txt", "text.txt is no Python file; it must end"),
     ("broken.py", "line 1"), ("breaks.py", "line 2"), ("no_text.py", "no_text.py")],
)  # fmt: skip
def test_what_cannot_be_run_is_refused(file, said, mine):
    with pytest.raises(BadInput) as refused:
        resolve.load_file(file)
    assert said in str(refused.value)
    assert resolve.load_file("mine.py") is resolve.load_file(str(mine / "mine.py"))


def test_a_file_that_was_edited_is_read_again(mine):
    """In a notebook the next run is with the law as it stands."""
    place, text = (
        mine / "edited.py",
        "from slipctl import from_text\nl = from_text('y = @*a where a [1]')",
    )
    for factor in (2, 30):
        place.write_text(text.replace("@", str(factor)), encoding="utf-8")
        assert resolve.load_block("edited.py:l")(a=1.0)["y"] == factor
    assert resolve.load_file("edited.py") is resolve.load_file("edited.py")


def test_python_that_was_not_named_at_the_start_does_not_run(mine, monkeypatch):
    (mine / "other.py").write_text("x = 1", encoding="utf-8")
    monkeypatch.setattr(resolve, "ONLY", [{(mine / "mine.py").resolve()}])
    with pytest.raises(BadInput, match=r"other\.py is Python and was not named at the start"):
        resolve.load_file("other.py")
    assert resolve.load_file("mine.py").number == 3


@pytest.mark.parametrize(
    ("file", "said"),
    [("bytes.toml", "bytes.toml is no UTF-8 text: byte 5"), ("no.toml", "cannot read no.toml"),
     ("deep.toml", "deep.toml: it is nested too deeply"), ("long.toml", "has at most")],
)  # fmt: skip
def test_a_file_of_equations_that_cannot_be_read_is_refused(file, said, mine):
    with pytest.raises(BadInput, match=said):
        equation_files.read(file)


def test_a_text_that_is_too_long_is_refused():
    text = "#" * (equation_files.LARGEST + 1)
    with pytest.raises(BadInput, match=f"has {len(text)} letters; such a file has at most"):
        equation_files.content_of_text("a.toml", text)
    assert equation_files.content_of_text("a.toml", text[1:]) == {}


def test_what_names_no_loop_is_refused(mine):
    with pytest.raises(BadInput, match=r"mine\.py:line is no loop; write STUDY:LOOP"):
        Request.read("mine.py:line", []).needs_loop()
    with pytest.raises(BadInput, match="gain_bounds"):
        Request.read("gain_bounds", []).needs_loop()
    asked = Request.read("gain_bounds:sta", [])
    assert asked.needs_loop() is asked
    context = Context.__new__(Context)
    object.__setattr__(context, "cases", asked.cases)
    name = asked.cases[0].scenario.name
    assert context.loop(name, "sta")[1].name == name
    for scenario, loop in ((name, "none"), ("none", "sta")):
        with pytest.raises(NotRun, match=f"{scenario}/{loop} was not run"):
            context.loop(scenario, loop)
