"""What the command line does for the page: report, tune, sweep and replay, told while they run.

Each runs as a process of its own, as a person would run it in the folder, and goes on if the page
is closed. It writes into its folder below ``out/``, and the same line takes up what is there.
"""

from __future__ import annotations

import csv
import os
import re
import shlex
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from slipctl.block.units.unit_algebra import parse_quantity
from slipctl.errors import BadInput
from slipctl.study.case_setup import Setting, open_gain_files
from slipctl.tables.table import named_columns
from slipctl.workbench.curves import Curves, Panel, Series
from slipctl.workbench.desk import Desk, Rig, numbers_in_words, words_of_run
from slipctl.workbench.sliders import Slider

LINES = 12
"""Texts of a question at most: ranges, columns."""

MOST_DRAWS = 100_000
"""Draws of a search or a sweep at most."""

NAMED = re.compile(r"[A-Za-z_][\w.]*=\S[^\n]*")
"""``name=something``, which no option of the command line is."""

PATIENCE = 15.0
"""Seconds that a command has to keep what it found, when it is stopped."""


def command_words(
    kind: str, desk: Desk, rig: Rig, numbers: Mapping[str, float], request: Mapping[str, Any]
) -> tuple[list[str], Path]:
    """Words of a command behind ``slipctl``, and the folder that it writes.

    Args:
        kind: ``report``, ``tune``, ``sweep``, ``replay``. desk, rig: what is open.
        numbers: that were moved. request: ``ranges`` (``name=lo:hi``), ``metric``, ``draws`` of a
            search or sweep; ``log``, ``part``, ``columns`` (``input=column``) and ``beside``
            (``output=column``) of a replay.

    Raises:
        BadInput: something is missing, or is none.
    """
    where = f"@{desk.scenario}" if desk.scenario else ""
    plain = re.sub(r"\W", "_", f"{rig.study.name}_{rig.name}")
    out = desk.within(f"out/{plain}_{kind}", "")
    moved = numbers_in_words(numbers, rig.sliders)
    if kind == "report":
        return [*words_of_run(desk, rig.name, moved), "--out", str(out)], out
    if kind == "replay":
        log = desk.within(word(request, "log", "the name of a log in the folder"), "")
        part = word(request, "part", "a part of the loop, such as ctl")
        return words_of_replay(log, f"{desk.home}:{rig.name}.{part}", out, request)
    ranges = _texts(request, "ranges")
    if not ranges and kind == "tune":
        raise BadInput("a search needs a number with its range, such as ctl.law.K=5:50")
    words = [kind, f"{desk.home}:{rig.name}{where}", "--samples", str(_draws(request))]
    words += [{"tune": "--free", "sweep": "--vary"}[kind], *ranges] if ranges else []
    if kind == "sweep":  # a slider of what is varied says nothing
        varied = {r.partition("=")[0].strip() for r in ranges}
        moved = [n for n in moved if n.partition("=")[0] not in varied]
    if kind == "tune":
        words += ["--minimise", word(request, "metric", "a metric")]
    return [*words, *(["--set", *moved] if moved else []), "--out", str(out)], out


def words_of_replay(
    log: Path, part: str, out: Path, request: Mapping[str, Any]
) -> tuple[list[str], Path]:
    """Words of a replay, ``STUDY:LOOP.PART`` over a log, and the folder that it writes."""
    words = ["replay", str(log), "--with", part]
    for option, key in (("--map", "columns"), ("--beside", "beside")):
        given = _texts(request, key)
        words += [option, *given] if given else []
    return [*words, "--out", str(out)], out


def word(request: Mapping[str, Any], key: str, what: str) -> str:
    """A text of a question that is no option of the command line.

    Raises:
        BadInput: it is none.
    """
    found = request.get(key)
    if not isinstance(found, str) or not found.strip() or len(found) > 200 or found[0] == "-":
        raise BadInput(f"{key} must be {what}")
    return found.strip()


def _texts(request: Mapping[str, Any], key: str) -> list[str]:
    """Texts of a question, none of them an option of the command line."""
    found = request.get(key) or []
    plain = isinstance(found, list) and len(found) <= LINES
    if not plain or not all(isinstance(t, str) and len(t) <= 200 for t in found):
        raise BadInput(f"{key} must be at most {LINES} texts, name=...")
    for text in found:
        if not NAMED.fullmatch(text.strip()):
            raise BadInput(f"{text!r}: write name=lo:hi, or input=column")
    return [t.strip() for t in found]


def _draws(request: Mapping[str, Any]) -> int:
    found = request.get("draws", 20)
    if not isinstance(found, int) or not 1 <= found <= MOST_DRAWS:
        raise BadInput(f"draws must be a whole number from 1 to {MOST_DRAWS}")
    return found


def run_command(words: Sequence[str]) -> Iterator[dict[str, Any]]:
    """Run a command; ending the iterator stops it and keeps its results.

    Args:
        words: behind ``slipctl``.

    Yields:
        ``progress``, the last line that it told, when that is a new one; nothing meanwhile; at last
        ``said``, what it printed, and ``code``, what it ended with.

    Raises:
        BadInput: it was refused.
    """
    environment = os.environ | {"SLIPCTL_PROGRESS": "1"}
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as scratch:
        printed, told = Path(scratch) / "printed", Path(scratch) / "told"
        with printed.open("wb") as out, told.open("wb") as err:
            going = subprocess.Popen(
                [sys.executable, "-m", "slipctl", *words], stdin=subprocess.DEVNULL, stdout=out,
                stderr=err, env=environment,
            )  # fmt: skip
        try:
            last = ""
            while going.poll() is None:
                time.sleep(0.05)
                line = _last_line(told)
                yield {"progress": line} if line != last else {}
                last = line
        finally:
            if going.poll() is None:
                going.terminate()
                with suppress(subprocess.TimeoutExpired):
                    going.wait(PATIENCE)
                going.kill()
        if going.returncode == 2:
            raise BadInput(_last_line(told) or "it was refused")
        said = _text_of(printed) or _text_of(told)
        yield {"said": said[-20_000:], "code": going.returncode,
               "command": shlex.join(["slipctl", *words])}  # fmt: skip


def _text_of(file: Path) -> str:
    return file.read_text(encoding="utf-8", errors="replace")


def _last_line(file: Path) -> str:
    return _text_of(file).rstrip().rpartition("\n")[2].removeprefix("slipctl: ")


def found_gains(out: Path, sliders: Sequence[Slider]) -> dict[str, float]:
    """Numbers of ``gains.toml`` in SI, as sliders have them."""
    units = {s.name: s.unit for s in sliders}
    found = [Setting.read(text) for text in open_gain_files([str(out / "gains.toml")])]
    return {s.name: parse_quantity(s.value, units.get(s.name, "1")) for s in found}


def replayed_curves(out: Path) -> Curves:
    """Curves of ``replay.csv``: a panel for each signal, its recording beside it."""
    with (out / "replay.csv").open(newline="", encoding="utf-8") as file:
        rows = csv.reader(file)
        names, units = named_columns(next(rows))
        table = np.array([[float(cell) for cell in row] for row in rows])
    panels: dict[str, Panel] = {}
    for name, unit, values in zip(names[1:], units[1:], table.T[1:], strict=True):
        signal_name = name.removesuffix(" recorded").removesuffix(" residual")
        panel = panels.setdefault(signal_name, Panel(signal_name, unit))
        if not name.endswith(" residual"):
            recorded = name.endswith(" recorded")
            panel.series.append(Series("recorded" if recorded else "computed", 0,
                                       "best" if recorded else "main", values))  # fmt: skip
    compared = sorted(panels.values(), key=lambda p: -len(p.series))
    return Curves(table[:, 0], compared, [])
