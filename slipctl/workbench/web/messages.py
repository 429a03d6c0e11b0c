"""Questions as a page sends them."""

from __future__ import annotations

import json
from typing import Any

from slipctl.workbench.questions import KINDS


def question_of_text(text: str) -> dict[str, Any] | None:
    """Question of a message; None where it is none."""
    try:
        found = json.loads(text)
    except (ValueError, RecursionError):
        return None
    plain = isinstance(found, dict) and found.get("kind") in KINDS
    return found if plain else None
