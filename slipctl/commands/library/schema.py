"""``slipctl schema``: what a file that describes a vehicle may hold, as JSON schema."""

from __future__ import annotations

import argparse

from slipctl.study.files import trip_files


def answer(options: argparse.Namespace, command: str) -> int:
    """Print the schema."""
    print(trip_files.schema_text().rstrip())
    return 0
