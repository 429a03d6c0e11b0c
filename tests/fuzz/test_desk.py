"""Altered vehicle files, expressions and logs end in an answer or in one line a fault.

A short run by seed; ``tests/fuzz/run.py --only desk`` makes longer ones. Nothing of a text is ever
run: each text may hold a call that would leave a file behind, and there is none.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import json
import os
import random
import sys
import tempfile
import time
import warnings
from pathlib import Path

import pytest
from test_commands import TOKENS, altered

from slipctl import from_text
from slipctl.commands.cli import main
from slipctl.errors import BadInput
from slipctl.models import vehicle
from slipctl.models.vehicle.trip import case
from slipctl.study.files import trip_files

METRO = (Path(vehicle.__file__).parent / "files" / "metro.toml").read_text(encoding="utf-8")

LONGEST = 2.0
"""CPU seconds that a file, an expression or a log may take; a vehicle that stands is built too."""

VALUES = (
    '"0"', '"-1 t"', '"1e9 t"', "true", "[]", "{}", '""', "nan", "inf", '"9e999 m"', "[1, 2]",
    '"38 furlong"', '"nan kg"', '"1 t 2"', "0x10", "1979-05-27", '"__import__(\'os\')"', "32", "1",
    '"60 km/h"', '"1 1/s"', '"mu = c*v_s where v_s [m/s], c = 1 s/m"', '"drive"', '"valve"',
)  # fmt: skip
EXPRESSIONS = (
    "mu = 2*mu_0*(v_s/v_0)/(1 + (v_s/v_0)**2) where v_s [m/s], mu_0 = 0.3, v_0 = 0.8 m/s",
    "mu = c*(exp(-a*v_s) - exp(-b*v_s)) where v_s [m/s], c = 1, a = 0.54 s/m, b = 1.2 s/m",
    "x' = -x/tau + u, y = x where u [N m], x [N m], tau = 0.05 s",
    "y = clip(k*u, lo, hi) if u > lo else max(lo, u) where u, k = 2, lo = -1, hi = 1",
    "mu = interp(v_s/one('m/s'), [0, 0.8, 2, 5], [0, 0.3, 0.22, 0.12]) where v_s [m/s]",
    "y = open('left_behind', 'w') where u",
    "y = __import__('os').system('touch left_behind') where u",
    "y = (lambda: u)() where u",
    "y = [u for u in (1, 2)] where u",
    "y = u.__class__.__mro__ where u",
)
PIECES = (
    "exp(", ")", "(", "**", "if", "else", "where", ",", "'", "x'", "x+", "one('m/s')", "v_s", "[",
    "]", "1e400", "lambda", "__import__('os').system('touch left_behind')",
    "open('left_behind','w')", "9" * 40, "(" * 200, "-" * 200, "not ", "and", "==", "1/0",
    "sqrt(-1)", "log(0)", ";", "\n",
)  # fmt: skip
LOG = "time [s];speed [km/h];torque\n0;60,0;1000\n0,01;59,9;1010\n0,02;59,8;\n0,03;59,7;990\n"
CELLS = (
    "",
    "-",
    "nan",
    "1e999",
    "x",
    "1.2.3",
    "1,2,3",
    '"',
    "2024-05-01 12:00:00",
    "-5",
    "0",
    "\x00",
)


def vehicle(rng: random.Random) -> str:
    """The file of ``slipctl new`` with lines left out, doubled, moved, or another value or key."""
    lines = METRO.split("\n")
    for _ in range(rng.randint(1, 4)):
        k = rng.randrange(len(lines))
        name, equals, value = lines[k].partition("=")
        how = rng.randrange(6)
        if how == 0:
            del lines[k]
        elif how == 1:
            lines.insert(rng.randrange(len(lines)), lines[k])
        elif how == 2 and equals:
            lines[k] = f"{name}= {rng.choice(VALUES)}"
        elif how == 3 and equals:
            lines[k] = f"{altered(name, rng)}={value}"
        elif how == 4 and equals:
            lines[k] = f"{name}={altered(value, rng)}"
        else:
            lines[k] = altered(lines[k], rng)
    return "\n".join(lines)


def expression(rng: random.Random) -> str:
    """An expression with pieces put in, cut or doubled."""
    text = rng.choice(EXPRESSIONS)
    for _ in range(rng.randint(0, 3)):
        i = rng.randrange(len(text) + 1)
        text = text[:i] + rng.choice((*PIECES, *TOKENS)) + text[i + rng.randint(0, 3) :]
    return text


def log(rng: random.Random) -> str:
    """A log with other cells, rows or separators."""
    rows = [row.split(";") for row in LOG.split("\n")]
    for _ in range(rng.randint(1, 4)):
        row = rng.choice(rows)
        row[rng.randrange(len(row))] = rng.choice(CELLS)
        if rng.random() < 0.2:
            rows.insert(rng.randrange(len(rows)), row)
    text = "\n".join(rng.choice(";;;;,|\t").join(r) for r in rows)
    return altered(text, rng) if rng.random() < 0.5 else text


def read_vehicle(text: str) -> None:
    """Read a file, and put its loops together where it is right."""
    Path("my.toml").write_bytes(text.encode("utf-8", "surrogatepass"))
    loops = case(trip_files.load_trip("my.toml")).loops
    for name in list(loops)[:1]:
        loops[name]


def read_expression(text: str) -> None:
    """Read an expression, and look at what it is."""
    from_text(text).function()


def read_log(text: str) -> None:
    """Replay a filter over a log and fit a flow to it, by the command line."""
    Path("log.csv").write_bytes(text.encode("utf-8", "surrogatepass"))
    out, err = io.StringIO(), io.StringIO()
    model = "y = k*v where v [m/s], k = 2"
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(["replay", "log.csv", "--with", model, "--map", "v=speed", "--out", "o"])
        if code in (0, 2):
            law = "v' = -k*v where v = 1 m/s, k = 1 1/s in 0 .. 100"
            code = main(["fit", "log.csv", "--law", law, "--map", "v=speed", "--out", "o"])
    said = err.getvalue().strip()
    if code == 130:  # whoever runs this was told to stop
        raise KeyboardInterrupt
    if code not in (0, 2) or "Traceback" in said or (code == 2 and not said):
        raise AssertionError(f"exit code {code}: {said}")


KINDS = {"vehicle": (vehicle, read_vehicle), "expression": (expression, read_expression),
         "log": (log, read_log)}  # fmt: skip


def attack(cases: int, seed: int) -> list[tuple[list[str], str]]:
    """Texts that end badly, of so many, in an empty folder of their own."""
    rng, found = random.Random(seed), []
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        os.chdir(folder)
        try:
            read_log(LOG)  # imports are no time of a case
            for k in range(cases):
                kind = rng.choice(list(KINDS))
                make, read = KINDS[kind]
                text = make(rng)
                start, wrong = time.process_time(), ""
                try:
                    read(text)
                except BadInput as error:
                    lines = getattr(error, "lines", None) or str(error).splitlines()
                    if not lines or any("\n" in line for line in lines):
                        wrong = f"not a line a fault: {error}"
                except KeyboardInterrupt:
                    raise
                except BaseException as error:
                    wrong = f"{type(error).__name__}: {error}"
                spent = time.process_time() - start
                if spent > LONGEST:
                    wrong = f"takes {spent:.1f} s"
                if Path("left_behind").exists():
                    wrong = "was run as a program"
                    Path("left_behind").unlink()
                if wrong:
                    found.append(([kind, text], f"case {k}: {wrong}"))
        finally:
            os.chdir(before)
    return found


def test_altered_vehicles_expressions_and_logs_are_answered():
    """A few; the fuzz job makes more, each with a seed."""
    assert [found for found in attack(60, seed=1) if "takes" not in found[1]] == []


def test_a_long_run_goes_on_where_it_was_stopped(tmp_path, monkeypatch, capsys):
    spec = importlib.util.spec_from_file_location("long_run", Path(__file__).parent / "run.py")
    long_run = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(long_run)
    monkeypatch.setattr(long_run, "KINDS", {"desk": lambda n, seed: [(f"seed {seed}", "bad")]})

    def run(out, cases, seed=100):
        line = f"run.py --only desk --cases {cases} --seed {seed} --out {tmp_path / out}"
        monkeypatch.setattr(sys, "argv", line.split())
        return long_run.main()

    monkeypatch.setattr(long_run.signal, "signal", lambda *_: None)
    assert [run("parts", 100), run("parts", 200), run("whole", 200)] == [1, 1, 1]
    found = [json.loads((tmp_path / n).read_text(encoding="utf-8")) for n in ("parts", "whole")]
    assert found[0] == found[1]
    assert [what for what, _ in found[0]["wrong"]] == ["seed 1", "seed 2", "seed 100", "seed 101"]
    with pytest.raises(SystemExit, match="is of another run"):
        run("parts", 300, seed=7)
