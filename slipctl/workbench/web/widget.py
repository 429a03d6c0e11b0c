"""``slipctl.open(...)``: the workbench in a cell of a notebook, Jupyter's or marimo's."""

from __future__ import annotations

import weakref
from collections import deque
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from typing import Any

from slipctl.errors import BadInput
from slipctl.workbench.questions import question_of_text
from slipctl.workbench.sources.openings import opening_of_name
from slipctl.workbench.web.guard import LONGEST
from slipctl.workbench.web.notebook_page import page_text
from slipctl.workbench.web.windows import Window

HEIGHT = 720
"""Pixels of the frame in a cell."""

MOST = 64
"""Frames that go to a cell at once."""


@cache
def _widget_class() -> Any:
    try:
        import anywidget
        import traitlets
    except ImportError as error:
        raise BadInput(f"a widget needs {error.name}; pip install 'slipctl[notebook]'") from None

    class Workbench(anywidget.AnyWidget):
        """The page of ``slipctl open`` in a cell; its runs go on in processes beside the kernel."""

        _esm = (files("slipctl.workbench.web") / "notebook_cell.js").read_text(encoding="utf-8")
        page = traitlets.Unicode("").tag(sync=True)
        height = traitlets.Int(HEIGHT).tag(sync=True)

        def __init__(self, window: CellWindow, **given: Any) -> None:
            super().__init__(**given)
            self.window = window
            self.on_msg(self._hear)
            weakref.finalize(self, window.close)

        def _hear(self, _: Any, said: Any, buffers: Any) -> None:
            if not isinstance(said, dict):
                return
            if isinstance(said.get("ask"), str):
                self.window.ask(said["ask"])
            if said.get("look"):
                frames, ended = self.window.take()
                self.send({"view": said.get("view"), "ended": ended}, buffers=frames)

        def close(self) -> None:
            """End it and its processes."""
            self.window.close()
            super().close()

    return Workbench


class CellWindow:
    """What answers a cell: the processes of a window, and the frames that wait to be fetched.

    Args:
        opening: what is open.
    """

    def __init__(self, opening: Any) -> None:
        waiting: deque[tuple[str, bytes]] = deque()
        self._waiting = waiting
        self._window = Window(opening, lambda kind, data: waiting.append((kind, data))).warm()

    def ask(self, text: str) -> None:
        """Hand on a question of the page; what is none is left."""
        question = question_of_text(text) if len(text) <= LONGEST else None
        if question is not None:
            self._window.ask(question)

    def take(self) -> tuple[list[bytes], list[str]]:
        """Frames that wait, and kinds of the questions that ended."""
        frames: list[bytes] = []
        ended: list[str] = []
        while self._waiting and len(frames) < MOST:
            kind, data = self._waiting.popleft()
            frames.append(data)
            long = int.from_bytes(data[:4], "little")
            if b'"end": true' in data[4 : 4 + long]:
                ended.append(kind)
        return frames, ended

    def close(self) -> None:
        """End its processes."""
        self._window.close()


def open(
    name: str = "", files: Sequence[str] = (), compile: bool = True, height: int = HEIGHT
) -> Any:
    """Open the workbench in a cell: a vehicle's file, a study or loop, a sweep's folder, a log.

    The widget is what ``slipctl open`` shows in the browser, with the same plots and sliders. It
    writes into the folder of the file alone, and only when *save* is pressed.

    Args:
        name: as ``slipctl open`` takes it; empty for the example, which is written into this folder
            if it is not there. files: Python files that may be imported. compile: compile loops
            where there is a compiler. height: of the cell, in pixels.

    Returns:
        A widget (anywidget) that ends a cell.

    Raises:
        BadInput: there is no such thing; the extra ``notebook`` is not installed.
    """
    made = _widget_class()
    return made(CellWindow(opening_of_name(name, files, compile)), page=page_text(), height=height)
