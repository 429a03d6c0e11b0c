"""Simulate a loop in a scenario: one Function for the whole loop, rolled over time."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from slipctl.block.block import Block
from slipctl.run.preparation import prepare
from slipctl.run.rail import Scenario

if TYPE_CHECKING:
    import xarray


def simulate(
    loop: Block,
    scenario: Scenario,
    *,
    compile: bool = True,
    progress: Callable[[float], None] | None = None,
    log: Iterable[str] | None = None,
    every: int = 1,
) -> xarray.Dataset:
    """Run ``loop`` in ``scenario``.

    Args:
        loop: a step block with a period; every input must be fed by a wire, the scenario, noise
            or its own default value.
        scenario: what happens.
        compile: compile the loop when a C compiler is there; the numbers are the same.
        progress: called with the share done, 0 to 1.
        log: names to keep; by default every number, and every number per axle, that is no held
            copy.
        every: ticks from one row of the log to the next; 1 keeps each.

    Returns:
        Dataset with dimension ``time`` [s], and ``axle`` or another of ``replicate`` where there
        are copies, and one variable per signal (``"plant.v"``), attributes
        ``units``, ``long_name``, ``positive``. The tick's start value for states. Its attributes
        hold version, scenario, seed and parameters with units. ``told`` is there where the run is
        to be doubted: an estimate begins or stays off, a limit is active for most of it.

    Raises:
        BadInput: unfed inputs, unknown names, a rail condition that the loop does not know, every
            not a whole number.
        RunFailed: a state became NaN or infinite; says block, signal and time.
    """
    run = prepare(loop, scenario, compile=compile, log=log, every=every)
    return run(progress=progress, doubt=True).dataset()
