"""Where numbers come from: what every file and figure of a run says of itself."""

from __future__ import annotations

import json
from typing import Any

import casadi
import numpy as np

from slipctl import __version__
from slipctl.run import store
from slipctl.run.results import Results

EXPERIMENT_SEED = 1
"""Seed that experiments get."""

FROM_A_FILE = ", sha256 "
"""In the source of a number that was fitted to a file; it names the file and its hash."""


def provenance(results: Results, command: str) -> dict[str, Any]:
    """What every file says of where it comes from."""
    parameters: dict[str, Any] = {}
    for case in results.cases:
        for name, loop in case.loops.items():
            values = {
                n: {"value": np.asarray(v).tolist(), "unit": s.unit}
                | ({"source": s.source} if FROM_A_FILE in s.source else {})
                for n, v in loop.param_values().items()
                for s in [loop.params[n]]
            }
            first = parameters.setdefault(name, values)
            other = {n: v for n, v in values.items() if first.get(n) != v}
            if other:
                parameters[f"{name}@{case.scenario.name}"] = other
    seeds = {c.scenario.name: c.scenario.seed for c in results.cases}
    if results.tables:
        seeds["experiments"] = EXPERIMENT_SEED
    return {
        "slipctl_version": __version__,
        "casadi_version": casadi.__version__,  # type: ignore[attr-defined]
        "numpy_version": np.__version__,
        "command": command,
        "study": results.study.name,
        "quick": results.quick,
        "seed": seeds,
        "parameters": parameters,
    }


def stamp(results: Results, command: str) -> str:
    """Provenance on one line, for the metadata of a figure."""
    return json.dumps({"format": store.FORMAT, **store.plain(provenance(results, command))})
