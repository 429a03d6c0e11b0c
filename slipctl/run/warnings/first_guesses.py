"""How far off estimators begin, against the deviation that they state themselves."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from slipctl.block.block import Block
from slipctl.block.signals import Signal
from slipctl.block.text.named_expressions import evaluate, names_in
from slipctl.run.rail import Scenario
from slipctl.run.scenario_inputs import loop_at_start, rail_values
from slipctl.run.warnings.doubts import meant_signals

ROUNDING = 1e-9
"""Share of the stated deviation by which a start may lie beyond it: roundings of both."""


Known = Callable[[list[str]], Mapping[Any, Any]]
"""Called with names of outputs: their values over time, of those that are known."""


def warnings_of_starts(loop: Block, scenario: Scenario, known: Known) -> list[str]:
    """Estimators that begin further off than the deviation that they state, one line each.

    An estimator's state says with ``truth`` what it estimates, in names of the rest of the loop:
    those of its own block, and of other estimators, are not meant. What no name of that unit tells,
    or more than one, is not judged.

    Args:
        loop, scenario: the run.
        known: outputs of the first tick at least.

    Raises:
        BadInput: what the scenario's start or rail is refused for.
    """
    loop = loop_at_start(loop, scenario)
    judged = {n: s for n, s in loop.states.items() if s.deviation and s.truth}
    if not judged:
        return []
    own = {n.rpartition(".")[0] for n in judged}
    pairs = [(n, s, text) for n, s in judged.items() for text in s.truth]
    found = {(n, text): meant_signals(loop, s, text, own) for n, s, text in pairs}
    told = {key: names for key, names in found.items() if all(names.values())}
    full = {str(k) for names in told.values() for k in names.values()}
    values = _values(loop, scenario, full, known) if full else {}
    lines = []
    for (n, text), names in told.items():
        if all(names[k] in values for k in names):
            truth = evaluate(text, {k: values[str(full)] for k, full in names.items()}, n)
            lines += _line(loop, judged[n], text, names, np.asarray(truth, dtype=float))
    return lines


def _line(
    loop: Block, s: Signal, text: str, names: Mapping[str, str | None], truth: np.ndarray
) -> list[str]:
    """Line about one element of an estimate, if it begins too far off."""
    known = {**loop.param_values(), **loop.start()}
    at = {k: known[loop._sibling(s.name, k)] for k in names_in(s.deviation)}
    sure = np.asarray(evaluate(s.deviation, at, s.name), dtype=float)
    one = np.asarray(known[s.name], dtype=float)
    if len(s.truth) > 1 or (one.ndim and one.shape[0] == len(s.truth)):
        k = s.truth.index(text)
        one, sure = one[k], sure[k] if sure.ndim else sure
    off = np.abs(one - truth)
    beyond = off - sure * (1 + ROUNDING)
    if not (beyond > 0).any():
        return []
    worst = np.unravel_index(int(np.argmax(beyond)), beyond.shape)
    first, second, away, most = (
        float(np.broadcast_to(v, beyond.shape)[worst]) for v in (one, truth, off, sure)
    )
    unit = "" if s.unit == "1" else f" {s.unit}"
    bare = len(names) == 1 and text in names
    what = s.name if bare else f"{s.name} for {text}"
    other = names[text] if bare else "the plant"
    return [
        f"{what} begins at {first:.6g}{unit}, {other} at {second:.6g}{unit}: {away:.3g}{unit} away,"
        f" more than its own standard deviation of {most:.3g}{unit}"
    ]


def _values(loop: Block, scenario: Scenario, names: set[str], known: Known) -> dict[str, Any]:
    """Values at the start of the run, on the first section of its rail."""
    _, by_rail = rail_values(loop, scenario)
    values = loop.param_values() | loop.start() | {n: v[0] for n, v in by_rail.items()}
    found = {n: v for n, v in values.items() if n in names}
    outputs = sorted(names - set(found))
    log = known(outputs) if outputs else {}
    return found | {n: np.asarray(log[n])[0] for n in outputs if n in log}
