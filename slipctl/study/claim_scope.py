"""Does a claim still speak of what ran? What was set and swapped beside what its answer read."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from slipctl.block.block import Block
from slipctl.block.shared_numbers import targets
from slipctl.run.results import Results
from slipctl.study.case_setup import Setting
from slipctl.study.declaration import Claim


def changes(
    results: Results, settings: Sequence[str], swaps: Sequence[str], models: Mapping[str, Any]
) -> Callable[[Claim, set[str]], str] | None:
    """What of a claim was changed, as :func:`~slipctl.study.verdicts.judge` wants it.

    A printed number speaks of the paper's numbers: whatever was changed in a loop that its answer
    read, it is another. An order, a yes or no and a bound speak of a law. They still hold or fail
    with another vehicle, but not with another controller, other gains or another start.

    Args:
        results: what ran.
        settings, swaps: as they were typed.
        models: of the study, with the swaps done.

    Returns:
        The function, or None where nothing was changed.
    """
    if not settings and not swaps:
        return None
    read = [Setting.read(text) for text in settings]
    swapped = {t.partition("=")[0].strip() for t in swaps}
    names = {n: _names(models[n]) for n in swapped}
    prefix = f"{results.study.controller}."
    seen: dict[str, list[tuple[str, bool]]] = {}

    def of_loop(scenario: str, name: str) -> list[tuple[str, bool]]:
        """What was changed in a loop, and whether it is what an order speaks of."""
        key = f"{scenario}/{name}"
        case = next((c for c in results.cases if c.scenario.name == scenario), None)
        if key in seen or case is None or name not in case.loops:
            return seen.get(key, [])
        loop, found = case.loops[name], []
        for s in read:
            if s.loop in ("", name):
                meant = targets(loop, s.name)
                found += [(n, n in loop.states or n.startswith(prefix)) for n in meant]
        for model, parts in names.items():
            where = [path for path, leaf in loop.leaves() if not parts or leaf.name in parts]
            if where:
                inside = not parts or any(f"{path}.".startswith(prefix) for path in where)
                found.append((model, inside))
        seen[key] = found
        return found

    def changed(claim: Claim, asked: set[str]) -> str:
        exact = claim.kind == "number" and not claim.bound
        told = {f"{claim.scenario}/{claim.loop}"} if claim.scenario and claim.loop else set()
        for key in sorted(asked | told):
            scenario, slash, loop = key.partition("/")
            if not slash:
                return f"experiment {key} is of the study as it stands"
            for what, central in of_loop(scenario, loop):
                if exact or central:
                    return f"{what} of {key} was changed"
        return ""

    return changed


def _names(model: Any) -> set[str]:
    """Names of the blocks that a model is made of; empty where it is a function that makes one."""
    if not isinstance(model, Block):
        return set()
    return {leaf.name for _, leaf in model.leaves()}
