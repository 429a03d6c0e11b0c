"""Write the frozen tables of the tests anew: ``python tests/tables.py [ROOM ...]``.

What changed is what ``git diff`` says; a number that changed on purpose stands in CHANGELOG. Who
moves code and means to change nothing runs ``pytest -m table`` instead.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent
DRAWN = {"certify": "slipctl/certify", "estimate": "slipctl/estimate"}
"""Rooms whose calls ``draw_calls.py`` computes anew."""


def commands(rooms: list[str]) -> list[list[str]]:
    """A command for each table of the rooms, or of all: the test that reads it, as a program."""
    found = []
    for path in sorted(HERE.glob("*/test_*.py")):
        text = path.read_text(encoding="utf-8")
        if (
            path.parent.name in (rooms or [path.parent.name])
            and 'if __name__ == "__main__"' in text
        ):
            found.append([str(path)])
    for room, folder in DRAWN.items():
        if room in (rooms or [room]):
            found.append([str(HERE / "draw_calls.py"), folder, "--again"])
    return found


def main(words: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rooms", nargs="*", metavar="ROOM", help="folders of tests; all of them")
    rooms = parser.parse_args(words).rooms
    known = sorted({Path(c[0]).parent.name for c in commands([])} - {"tests"})
    if wrong := [r for r in rooms if r not in known]:
        parser.error(f"there is no table of {', '.join(wrong)}; there are {', '.join(known)}")
    for command in commands(rooms):
        print("python", *command, flush=True)
        if code := subprocess.run([sys.executable, *command]).returncode:
            return code
    return 0


if __name__ == "__main__":
    sys.exit(main())
