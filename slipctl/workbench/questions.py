"""Questions of a page, as it sends them, and which process answers each."""

from __future__ import annotations

import json
from typing import Any

KINDS = (
    "text", "complete", "edit", "run", "model", "law", "block", "save", "verdict", "worst",
    "doubts", "signals", "region", "effects", "draws", "c", "command",
)  # fmt: skip
"""Questions, the more urgent ones first; each is a method of ``answers.Answers``."""

COMMANDS = ("report", "tune", "sweep", "replay")
"""What the command line does for the page."""

LANES = dict.fromkeys(
    ("verdict", "worst", "doubts", "signals", "region", "effects", "draws", "c"), "slow"
)
LANES["command"] = "command"
"""Which process answers a question, the first one where it is not named: a run waits for none of
them, and none of them for a command that goes on for minutes."""


def question_of_text(text: str) -> dict[str, Any] | None:
    """Question of a message; None where it is none."""
    try:
        found = json.loads(text)
    except (ValueError, RecursionError):
        return None
    plain = isinstance(found, dict) and found.get("kind") in KINDS
    return found if plain else None
