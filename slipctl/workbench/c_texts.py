"""The C of what is open: its text, its size, and the time of a step."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from slipctl.block.transforms.discretisation import runs_of_part
from slipctl.ccode import codegen
from slipctl.run import build
from slipctl.workbench.desk import Rig

TICKS = 2000
"""Ticks that the C is replayed for, against Python."""

LETTERS = 200_000
"""Of a file of C that the page shows."""


def c_of_rig(
    rig: Rig, numbers: Mapping[str, float], part: str = "", target: str = "host"
) -> dict[str, Any]:
    """C of a loop's controller, compiled and replayed against Python if a compiler is there.

    Args:
        rig, numbers: loop and what was moved. part: another one than the controller.
        target: ``cortex-m4`` runs it on the emulated processor too, and counts a step's time.

    Returns:
        Text of each file by name, the report in words, bytes by compiler, bytes of state.

    Raises:
        BadInput, RunFailed: the controller cannot be written as C; says why.
    """
    part = part or rig.study.controller
    loop = rig.loop.with_params(**numbers) if numbers else rig.loop
    runs = runs_of_part(loop, part)
    check = build.compiler() is not None
    inputs, params = codegen.record_part(loop, part, rig.case.scenario, TICKS if check else 1)
    with tempfile.TemporaryDirectory() as folder:
        report = codegen.export(
            runs.block, folder, f"{rig.study.name}_{rig.name}".replace("-", "_"), inputs=inputs,
            params=params, period=runs.period, check=check, target=target,
        )  # fmt: skip
        texts = {
            p.name: p.read_text(encoding="utf-8")[:LETTERS]
            for p in sorted(Path(folder).iterdir()) if p.suffix in (".c", ".h")
        }  # fmt: skip
        said = str(report).replace(f" in {folder}", "")
    data = report.data
    return {
        "files": texts, "report": said, "checked": check, "passed": report.passed,
        "bytes": {c["compiler"]: c["bytes"] for c in data.get("compiled", [])},
        "state_bytes": (data.get("memory_bytes") or {}).get("state"),
        "targets": [
            {k: t.get(k) for k in ("target", "bytes", "instructions", "load")}
            for t in data.get("targets", [])
        ],
    }  # fmt: skip
