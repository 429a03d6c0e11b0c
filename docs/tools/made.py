"""A page that a script makes: written, or with ``--check`` only compared."""

from __future__ import annotations

import sys
from pathlib import Path


def made(page: Path, text: str) -> int:
    """Write the page, or say whether it is up to date; the exit code."""
    if "--check" in sys.argv[1:]:
        fresh = page.exists() and page.read_text(encoding="utf-8") == text
        print(
            f"docs/{page.name} is up to date"
            if fresh
            else f"run: python docs/tools/{Path(sys.argv[0]).name}"
        )
        return 0 if fresh else 1
    page.write_text(text, encoding="utf-8", newline="\n")
    return 0
