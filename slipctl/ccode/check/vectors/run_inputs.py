"""Inputs and parameters of a part of a loop, as they were in a run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from slipctl.block.block import Block
from slipctl.block.transforms.discretisation import runs_of_part
from slipctl.errors import BadInput

if TYPE_CHECKING:
    import xarray

    from slipctl.run.rail import Scenario


def logged_inputs(loop: Block, part: str, dataset: xarray.Dataset) -> dict[str, np.ndarray]:
    """Inputs of a part of a loop as they were in a run.

    Args:
        loop: the loop that was simulated.
        part: path of the part, ``"ctl"`` or ``"vehicle.ctl"``.
        dataset: what ``simulate(loop, ...)`` gave.

    Returns:
        Array over ticks for each input of ``loop[part]``; an input that was fed by nothing and
        logged as nothing keeps its declared value and is left out.

    Raises:
        BadInput: no such part, or an input whose source was not logged.
    """
    found: dict[str, np.ndarray] = {}
    for n, s in loop[part].inputs.items():
        source_name = _source(loop, part, n)
        if source_name in dataset:
            found[n] = np.asarray(dataset[source_name].values, dtype=float)
        elif s.value is None or source_name in loop.inputs or source_name in loop.outputs:
            raise BadInput(
                f"{loop.name}: {part}.{n} is fed by {source_name}, which was not logged; simulate"
                f" with log=[..., {source_name!r}]"
            )
    return found


def record_part(
    loop: Block, part: str, scenario: Scenario, ticks: int | None = None
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Run a loop for the inputs of each run of a part of it, and the parameters that it has there.

    Args:
        loop, part: as in :func:`logged_inputs`.
        scenario: as of :func:`slipctl.simulate`.
        ticks: how many runs of the part are wanted, where the first ones are enough.
    """
    from slipctl.run.simulation import simulate

    runs = runs_of_part(loop, part)
    if ticks is not None and loop.period is not None:
        scenario = _first(scenario, runs.first + ticks * runs.ticks, loop.period)
    sources = {_source(loop, part, n) for n in loop[part].inputs}
    known = {**loop.inputs, **loop.outputs, **loop.states}
    data = simulate(loop, scenario, log=[n for n in known if n in sources])
    inputs = {n: v[runs.first :: runs.ticks] for n, v in logged_inputs(loop, part, data).items()}
    return inputs, logged_params(loop, part, data)


def _first(scenario: Scenario, ticks: int, period: float) -> Scenario:
    """First ticks of a scenario; a feed with a value for each tick is cut there too."""
    whole = round(scenario.duration / period)
    if whole <= ticks:
        return scenario
    feeds = {
        n: feed[:ticks] if isinstance(feed, np.ndarray) and len(np.atleast_1d(feed)) == whole
        else feed
        for n, feed in scenario.inputs.items()
    }  # fmt: skip
    return scenario.but(duration=ticks * period, inputs=feeds)


def logged_params(loop: Block, part: str, dataset: xarray.Dataset) -> dict[str, np.ndarray]:
    """Parameters of a part of a loop as the run began with them.

    Args:
        loop, part, dataset: as in :func:`logged_inputs`.

    Returns:
        Value of each parameter of ``loop[part]`` that is not derived; of one that the loop shares,
        the shared number, unless the run set this place apart.
    """
    import json

    logged = json.loads(dataset.attrs["parameters"])
    found = {}
    for n, s in loop[part].params.items():
        place = f"{part}.{n}"
        place = place if place in logged else loop.sharing.name(place)
        if not s.derived and place in logged:
            found[n] = np.asarray(logged[place]["value"], dtype=float)
    return found


def _source(loop: Block, part: str, port: str) -> str:
    """Name, in the loop, of what feeds an input of a part."""
    while loop.transparent:
        loop = next(iter(loop.parts.values()))
    head, _, rest = part.partition(".")
    inner = _source(loop[head], rest, port) if rest else port
    if inner not in loop[head].inputs:
        return f"{head}.{inner}"  # fed inside the part
    return loop.wires.get(f"{head}.{inner}", f"{head}.{inner}")
