"""Files that end the program, closed outputs, letters that a terminal lacks: told in one line."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from slipctl import BadInput
from slipctl.block.units.unit_algebra import parse_quantity, unit
from slipctl.commands.cli import main
from slipctl.run import interrupts
from slipctl.tables.table import read_table

LAW = "from slipctl import law, Output, Input\n@law(mu=Output('1'))\ndef g(v=Input('1')):\n    "


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("import sys\nsys.exit()\n", "own.py, line 2: SystemExit"),
        ("raise GeneratorExit\n", "own.py, line 1: GeneratorExit"),
        (LAW + "import sys\n    sys.exit()\n", "own.py, line 5: SystemExit"),
        ("def g(): pass\ng.__signature__ = 3\n", "own.py:g has arguments that cannot be read"),
        ("x = " + "-" * 100_000 + "1\n", "nested too deeply"),
    ],
)
def test_a_file_cannot_end_slipctl(text, said, tmp_path, monkeypatch, capsys):
    """What a user's file raises is told with its line and is never taken for success."""
    monkeypatch.chdir(tmp_path)
    Path("own.py").write_text(text)
    assert main(["show", "own.py:g"]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("lag", ["1e9", "1e30"])
def test_a_lag_far_above_the_tick_is_no_word_of_a_library(lag, capsys):
    assert main(["certify", "lagged_loop", "--set", "K=1", "T=1", f"lag={lag}"]) == 0
    assert capsys.readouterr().err == ""


def test_an_interrupt_behind_the_answer_changes_nothing():
    """While Python ends, where nobody could answer it, an interrupt is no traceback."""
    late = (
        "import atexit, os, signal, sys; sys.argv[1:] = ['--version'];"
        "atexit.register(os.kill, os.getpid(), signal.SIGINT);"
        "from slipctl.commands.cli import program; sys.exit(program())"
    )
    ended = subprocess.run([sys.executable, "-c", late], capture_output=True, text=True)
    assert (ended.returncode, ended.stderr) == (0, "")


def test_what_an_interrupt_left_half_made_is_not_told(capfd):
    """A library's object whose end fails, because it was never whole, is no traceback."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's "&" ignores it

    class Half:
        def __init__(self):
            signal.raise_signal(signal.SIGINT)
            self.name = "whole"

        def __del__(self):
            print(self.name)

    with interrupts.raise_interrupts():
        try:
            Half()
        except KeyboardInterrupt:
            interrupts.note_interrupt()
    signal.signal(signal.SIGINT, before)
    assert capfd.readouterr() == ("", "")


def command(*words: str, **options) -> subprocess.CompletedProcess:
    line = [sys.executable, "-m", "slipctl", *words]
    return subprocess.run(line, capture_output=True, text=True, **options)


def test_a_closed_output_is_told():
    """``slipctl list >&-``: nothing was printed, so the exit code is not that of success."""
    script = f"{sys.executable} -m slipctl list >&-"
    done = subprocess.run(["sh", "-c", script], capture_output=True, text=True)
    assert done.returncode == 1
    assert "standard output is closed" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_a_full_output_is_told():
    done = subprocess.run(["sh", "-c", f"{sys.executable} -m slipctl list > /dev/full"],
                          capture_output=True, text=True)  # fmt: skip
    assert done.returncode == 1
    assert done.stderr == ("slipctl: cannot write to standard output: No space left on device\n")
    assert "Traceback" not in done.stderr


def test_a_terminal_without_a_letter_gets_its_number(monkeypatch):
    """A dash or a Greek letter that ASCII lacks is written another way, and nothing is lost."""
    monkeypatch.setenv("PYTHONIOENCODING", "ascii")
    done = command("show", "hst_braking")
    assert done.returncode == 0
    assert "scenarios and loops" in done.stdout


@pytest.mark.parametrize("written", ["1 nm^-99", "1 Gm^99", "1 km^99"])
def test_a_unit_beyond_every_number_is_refused(written):
    with pytest.raises(BadInput, match=r"beyond what a number can hold|another dimension"):
        parse_quantity(written, "kg", "wheel.m")
    with pytest.raises(BadInput, match="beyond what a number can hold"):
        unit("nm^-99")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("v [m/s],mu\n0.1,0.1\n12. Mai,0.3\n", "'12. Mai' in line 3 is no number"),
        ("v [m/s],mu\n0.1,0.1\n0.2,-1e308\n", "'-1e308' in line 3 is beyond what can be squared"),
        ("v [m/s],mu\n" + "1" * 140_000 + ",0.1\n", "line 2 has 140004 letters"),
    ],
)
def test_a_table_that_a_spreadsheet_spoilt_is_refused(text, said, tmp_path):
    file = tmp_path / "curve.csv"
    file.write_text(text)
    with pytest.raises(BadInput) as error:
        [read_table(file).numbers(n) for n in ("v", "mu")]
    assert said in str(error.value)


@pytest.mark.parametrize("error", ["#N/A", "#DIV/0!", "#NV"])
def test_an_error_of_a_spreadsheet_is_an_empty_cell_and_no_comment(error, tmp_path):
    file = tmp_path / "curve.csv"
    file.write_text(f"v [m/s],mu\n0.1,0.1\n{error},0.3\n0.3,0.2\n")
    assert str(read_table(file).numbers("v").tolist()) == "[0.1, nan, 0.3]"
    assert read_table(file).numbers("mu").tolist() == [0.1, 0.3, 0.2]


def test_a_compiler_that_says_nothing_is_named(tmp_path, monkeypatch):
    from slipctl import RunFailed
    from slipctl.ccode.compile import compilers

    with pytest.raises(RunFailed, match=r"false .* ended with code 1 and said nothing"):
        compilers.link("false", [], tmp_path / "x")


def test_the_backend_of_a_notebook_is_not_asked_for():
    """A cell with ``!slipctl`` hands its own matplotlib backend on, which may be missing here."""
    line = "from slipctl.commands.cli import main; main(['--version']); import matplotlib.pyplot"
    done = subprocess.run(
        [sys.executable, "-c", line], env=os.environ | {"MPLBACKEND": "module://nowhere"},
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
