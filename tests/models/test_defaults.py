"""Units, defaults, ranges and signs of shipped models change on purpose only: files rely on them.

``python tests/models/test_defaults.py`` writes the table anew; a changed number then belongs into
CHANGELOG. What is new is free until it is in the table.
"""

from __future__ import annotations

import csv
from pathlib import Path

from slipctl import BadInput
from slipctl.study import doors

TABLE = Path(__file__).parent / "defaults.csv"
HEAD = ["block", "signal", "role", "unit", "value", "lo", "hi", "positive", "per"]
MODELS = [f"{m}.{b}" for m, (_, blocks) in doors.models().items() for b in blocks]


def rows(name: str) -> list[list[str]]:
    """Signals of a model as it comes; a connected one has those of its parts."""
    try:
        block = doors.load_block(name)
    except BadInput as error:
        if "is a function that needs" in str(error):
            return []
        raise
    if block.parts:
        return []
    return [
        [
            name,
            n,
            s.role,
            s.unit,
            said(s.value),
            said(s.lo),
            said(s.hi),
            s.positive or "",
            s.per or "",
        ]
        for signals in (block.states, block.inputs, block.params, block.outputs)
        for n, s in signals.items()
    ]


def said(number: object) -> str:
    """Numbers to twelve digits: the last ones are those of a system's ``exp``."""
    return f"{number:.12g}" if isinstance(number, int | float) else str(number)


def test_defaults_and_ranges_are_those_of_the_table() -> None:
    with TABLE.open(newline="", encoding="utf-8") as file:
        wanted = list(csv.reader(file))[1:]
    have = {tuple(row[:3]): row for name in MODELS for row in rows(name)}
    assert [row for row in wanted if have.get(tuple(row[:3])) != row] == []
    assert len(wanted) > 400
    for row in have.values():
        assert float(row[5]) < float(row[6]), row  # no range is empty


if __name__ == "__main__":
    with TABLE.open("w", newline="", encoding="utf-8") as out:
        csv.writer(out, lineterminator="\n").writerows(
            [HEAD, *(row for name in MODELS for row in rows(name))]
        )
