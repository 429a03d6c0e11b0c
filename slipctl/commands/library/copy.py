"""``slipctl copy``: the source of a model as a file of one's own."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from slipctl.errors import BadInput
from slipctl.run import store
from slipctl.study import resolve


def answer(options: argparse.Namespace, command: str) -> int:
    """Write the copy."""
    module, block, source = resolve.model_source(options.model)
    target = Path(options.file)
    if target.is_dir():
        raise BadInput(f"{target} is a folder; write a file, {target / (module + '.py')}")
    if target.exists():
        raise BadInput(f"{target} exists already and is not overwritten; choose another name")
    if target.suffix != ".py":
        raise BadInput(f"{target} must end in .py to be used as {target}.py:block")
    if not target.parent.is_dir():
        raise BadInput(f"there is no folder {target.parent}; make it first")
    store.check_file(target)
    store.write_text(target, source)
    if options.json:
        print(json.dumps({"file": str(target), "module": module, "block": block}, indent=1))
        return 0
    print(f"{target}: the model {module}, yours to edit")
    print(f"  slipctl show {target}:{block}")
    if resolve.studies():
        print(f"  slipctl run STUDY --swap NAME={target}:{block}")
    return 0
