"""``slipctl pil``: a loop with its controller on an emulated processor."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from slipctl.commands.progress import Progress
from slipctl.errors import RunFailed
from slipctl.run import store
from slipctl.study import processor


def answer(options: argparse.Namespace, command: str) -> int:
    """Run the loop and print the comparison."""
    out = Path(options.out) if options.out else None
    if out is not None:
        store.check_file(out)
    floats = len(processor.ROUNDINGS) if options.real == "float" and not options.faults else 0
    progress = Progress(2 + floats, sys.stderr, options.quiet)
    try:
        found = processor.compare(
            options.name, options.target, options.real, options.faults, out, options.seconds,
            progress, options.clock,
        )  # fmt: skip
    finally:
        progress.end()
    print(store.json_text(found.data).rstrip() if options.json else found)
    if found.data["failed"] == ["load"]:
        raise RunFailed(f"{options.name}: a step takes longer than its tick on {options.target}")
    if not found.passed:
        raise RunFailed(f"{options.name}: the loop differs with its controller on {options.target}")
    return 0
