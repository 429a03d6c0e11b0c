"""``slipctl check``: a certificate again."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from slipctl.certify import safe_json
from slipctl.commands.certificates import certify
from slipctl.design import statement
from slipctl.design.gain_search import FIRST_PROOF
from slipctl.design.goals import read_objective, single
from slipctl.errors import BadInput, RunFailed, check_whole
from slipctl.run.sweep.ensemble import World, read_ensemble
from slipctl.study.request import Request


def answer(options: argparse.Namespace, command: str) -> int:
    """Print what the certificate proves, and what runs again."""
    said = [certify.check(options.file)]
    if options.rerun is not None:
        check_whole("--rerun", options.rerun, 1)
        said.append(rerun(options.file, options.rerun))
    if options.json:
        print(json.dumps({"file": options.file, "holds": True, "says": said}, indent=1))
    else:
        print("\n".join(said))
    return 0


def rerun(file: str, many: int) -> str:
    """Run draws of a statement again, and compare them bit for bit.

    Raises:
        BadInput: the file holds no statement, or what it names is not there.
        RunFailed: a draw gives other bits.
    """
    payload = safe_json.read(Path(file))
    said: Mapping[str, Any] | None = payload.get("statistical")
    if said is None:
        raise BadInput(f"{file} holds no statement of draws; slipctl tune ... --prove writes one")
    asked = Request.read(
        str(payload.get("loop")), _texts(file, said, "set"), _texts(file, said, "swapped")
    )
    if not (asked.loop and asked.scenario):
        raise BadInput(f"{file}: loop is {payload.get('loop')!r}; it must be STUDY:LOOP@SCENARIO")
    study, case, loop, gains = asked.study, asked.case, asked.loop, _gains(file, payload)
    ensemble = read_ensemble(file, said["ensemble"])
    world = World(
        case.loops[loop], case.scenario, ensemble, signals=study.signals, known=case.known,
        seed=int(said["seed"]), free=list(gains),
    )  # fmt: skip
    goal, claims = read_objective(str(said["objective"])), said["claims"]
    chosen = statement.repeated_draws(payload, many, int(said["draws"]))
    for k in chosen:
        draw = world.draw(FIRST_PROOF + int(said["attempt"]) - 1, k)
        try:
            metrics = world.metrics(gains, draw)
        except RunFailed:
            metrics = {}
        found = [(goal.text, goal.value(metrics) if metrics else math.inf, said["values"][k])]
        for c in claims:
            worst = math.inf if c["upper"] else -math.inf
            value = single(metrics[c["metric"]], c["upper"]) if metrics else worst
            found.append((c["metric"], value, c["values"][k]))
        for name, now, before in found:
            if now.hex() != before:
                was = float.fromhex(before)
                raise RunFailed(
                    f"{file} does not hold: draw {k} gives {name} = {now!r}, it says {was!r};"
                    f" it was written by slipctl {payload.get('slipctl')}"
                )
    return f"{len(chosen)} draws run again, bit for bit: {', '.join(map(str, chosen))}"


def _texts(file: str, said: Mapping[str, Any], key: str) -> list[str]:
    found = said.get(key, [])
    if not isinstance(found, list) or not all(isinstance(t, str) for t in found):
        raise BadInput(f"{file}: {key} must be a list of texts")
    return found


def _gains(file: str, payload: Mapping[str, Any]) -> dict[str, float]:
    try:
        return {str(n): float(g["value"]) for n, g in payload["gains"].items()}
    except (KeyError, TypeError, ValueError, AttributeError):
        raise BadInput(f"{file}: its gains are no numbers by name") from None
