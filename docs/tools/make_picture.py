"""The picture that README opens with: ``slipctl run metro.toml``, two of its loops.

``python docs/tools/make_picture.py`` runs the file that ``slipctl new metro`` writes, as it is, and
keeps the figure of the speeds as ``docs/metro.svg``; ``--check`` only compares. Takes 20 s.
"""

from __future__ import annotations

import contextlib
import sys
import tempfile
from pathlib import Path

from made import made

from slipctl.commands.cli import main

PICTURE = Path(__file__).resolve().parents[1] / "metro.svg"
LOOPS = ("none", "super_twisting")


def picture() -> str:
    """The figure, as the run writes it."""
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        for words in (["new", "metro"], ["run", "metro.toml", "--loop", *LOOPS]):
            if main(words):
                raise SystemExit(f"slipctl {' '.join(words)} failed")
        return Path("out", "metro", "figures", "speeds.svg").read_text(encoding="utf-8")


if __name__ == "__main__":
    sys.exit(made(PICTURE, picture()))
