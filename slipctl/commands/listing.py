"""``slipctl list``: studies and models."""

from __future__ import annotations

import argparse

from slipctl.study import doors


def answer(options: argparse.Namespace, command: str) -> int:
    """Print studies and models."""
    print("studies")
    for name, doc in doors.studies().items():
        print(f"  {name:<24} {doc}")
    print("\nmodels")
    for name, (doc, blocks) in doors.models().items():
        print(f"  {name:<24} {doc}")
        for block, text in blocks.items():
            print(f"    {block:<22} {text}")
    return 0
