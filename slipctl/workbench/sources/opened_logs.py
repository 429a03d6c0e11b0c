"""A recorded log that is open: its columns as curves, and parts of loops replayed over it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from slipctl.errors import BadInput
from slipctl.run.logs.recorded_log import Recording, read_recording
from slipctl.workbench.answers import Answers, Head, Request
from slipctl.workbench.command_lines import word, words_of_replay
from slipctl.workbench.curves import Curves, Panel, Series, frame

MOST = 24
"""Columns that are drawn, the first ones."""


def curves_of_recording(log: Recording) -> tuple[Curves, list[str]]:
    """A panel for each column of a log, and lines on how it was read and what is left out."""
    panels: list[Panel] = []
    notes: list[str] = []
    for name in log.columns:
        if len(panels) == MOST:
            notes.append(f"of {len(log.columns)} columns the first {MOST} are drawn")
            break
        try:
            values = log.held(name)
        except BadInput as error:
            notes.append(f"{name} is not drawn: {error}")
            continue
        panels.append(Panel(name, log.units[name] or "1", [Series(name, 0, "main", values)]))
    if not panels:
        raise BadInput(f"{log.source} has no column of numbers")
    return Curves(log.time, panels, []), [*log.done, *notes]


class LogAnswers(Answers):
    """What answers a window in which a recorded log is open.

    Args:
        path: of the log. folder: it is in; files are written there alone.
    """

    kinds = ("run", "model", "doubts", "command")
    without = "a recorded log has no model; open a vehicle's file"
    stopped = "stopped"

    def __init__(self, path: str, folder: str) -> None:
        self.path, self.folder = Path(path), Path(folder).resolve()
        self.log = read_recording(path)

    def model(self, request: Request) -> Iterator[Head]:
        """Name of the log; it has no numbers that can be moved."""
        beside = sorted(self.folder.glob("*.toml"))  # the part to replay, to begin with, is of one
        part = f"{beside[0].name}:LOOP.ctl" if beside else "hst_braking:eppfc.ctl.filter"
        yield {
            "end": True, "home": self.path.name, "title": f"recorded log {self.path}",
            "doc": "", "text": None, "loops": [["log", ""]], "loop": "log", "scenario": "",
            "sliders": [], "limits": {}, "controller": "", "ensemble": False,
            "certificates": {"names": [], "why": "a recorded log has no gains"},
            "tick": self.log.spacing, "folder": str(self.folder), "log": self.path.name,
            "part": part,
        }  # fmt: skip

    def run(self, request: Request) -> Iterator[bytes | Head]:
        """Columns of the log over time."""
        curves, _ = curves_of_recording(self.log)
        who = {"kind": "run", "id": request.get("id", 0), "loop": "log"}
        yield frame({**who, "share": 1.0, "compiled": True, "seconds": 0.0}, curves)
        yield {"end": True, "metrics": [], "command": ""}

    def doubts(self, request: Request) -> Iterator[bytes | Head]:
        """How the log was read, and what had to be decided."""
        yield {"end": True, "warnings": curves_of_recording(self.log)[1]}

    def _words(self, asked: str, request: Request) -> tuple[list[str], Path]:
        if asked != "replay":
            raise BadInput(f"{asked[:40]} needs a loop; open a vehicle's file or a study")
        part = word(request, "part", "a part of a loop, such as metro.toml:pid.ctl")
        out = self.folder / "out" / f"{self.path.stem}_replay"
        return words_of_replay(self.path, part, out, request)
