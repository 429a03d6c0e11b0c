"""What a predictive controller claims, tried from many starts in closed loop."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from slipctl.block.block import Block
from slipctl.block.transforms.discretisation import sampled
from slipctl.errors import BadInput, RunFailed, check_known
from slipctl.run import build

ROUNDING = 1e-9
"""Part of a limit by which a control may pass it: the controls are planned as shares of their
size."""


class Feasibility(NamedTuple):
    """What was seen in closed loop.

    Attributes:
        starts, ticks: how much was tried.
        kept: whether every control of every tick kept its bounds and rates.
        largest_excess: by which a bound or a rate was passed, in its unit, and of which control.
        settled: share of the ticks with status 0.
        broken: ticks with status 2.
        witness: start and held inputs of the largest excess, or of the first broken tick.
    """

    starts: int
    ticks: int
    kept: bool
    largest_excess: tuple[float, str]
    settled: float
    broken: int
    witness: dict[str, float]


class Driver:
    """A step block tick by tick: call it with its inputs in order, it returns its outputs.

    Attributes:
        x: packed states, advanced by each call. p: packed parameters.
    """

    def __init__(self, block: Block, compile: bool = True) -> None:
        self.block = block
        self.x = build.column(block.pack("state", block.start()))
        self.p = build.column(block.pack("param", block.param_values()))
        self._roll = build.make_roller(block.f, compile)

    def prepare(self, *inputs: Any) -> None:
        """Prepare the next tick of a block made with ``split=True``; measured inputs are not read.

        Raises:
            BadInput: the block is not in two parts.
        """
        if self.block.composition.split is None:
            raise BadInput(f"{self.block.name} prepares nothing; make it with split=True")
        only = list(self.block.states).index(self.block.composition.split.only)
        self.x[sum(s.size for s in list(self.block.states.values())[:only])] = 1.0
        self(*inputs)

    def __call__(self, *inputs: Any) -> np.ndarray:
        """Outputs of the next tick; an input that is previewed may be one number for all stages."""
        signals = zip(self.block.inputs.values(), inputs, strict=True)
        u = np.concatenate([np.broadcast_to(v, s.shape).ravel() for s, v in signals])[None]
        u = np.ascontiguousarray(u, dtype=float)
        x_log, y = np.empty((1, self.x.size)), np.empty((1, self.block.f.size1_out(1)))
        if self._roll(self.x, u, self.p, x_log, y) < 1:
            lost = [n for n, v in self.block.unpack("state", ca.DM(self.x)).items()
                    if not np.isfinite(np.array(v, dtype=float)).all()]  # fmt: skip
            raise RunFailed(f"{self.block.name}: {lost[0]} became NaN")
        return y[0]


def feasibility(
    controller: Block,
    plant: Block,
    ranges: Mapping[str, tuple[float, float]],
    *,
    starts: int = 100,
    ticks: int = 50,
    seed: int = 1,
    substeps: int = 4,
) -> Feasibility:
    """Try whether a predictive controller keeps its hard limits, tick after tick.

    From random starts, with random values of the inputs it does not decide, the controller drives
    the plant. Bounds and rates have to be kept in every tick, whether the active set has settled
    or not: that is what recursive feasibility means for limits on controls. It is a trial, no
    proof, and it says so by its numbers.

    Args:
        controller: of :func:`slipctl.nmpc`.
        plant: the flow it was made for.
        ranges: (lo, hi) of the states of the plant, and of the inputs of the controller that are
            drawn anew every tenth tick; the others keep their declared value.
        starts, ticks, seed: how many starts, how long each, and of which random numbers.
        substeps: of the plant over a tick, backward Euler.

    Raises:
        BadInput: a name that is no input of the controller, or an input without value and range.
    """
    where = f"feasibility({controller.name})"
    for n in ranges:
        check_known(f"{where}:", n, controller.inputs, " is no input")
    missing = [n for n, s in controller.inputs.items() if n not in ranges and s.value is None]
    if missing:
        raise BadInput(f"{where}: give ranges={{{missing[0]!r}: (lo, hi)}}")
    if controller.period is None:
        raise BadInput(f"{where}: {controller.name} has no period; give the block of nmpc(...)")
    h = float(controller.period)
    step = sampled(plant, h, "implicit_euler", substeps, check=False).f
    tick = Driver(controller)
    rest = tick.x.copy()
    plant_p = build.column(plant.pack("param", plant.param_values()))
    names = [n for n in controller.outputs if n not in ("status", "passes", "residual")]
    short = {n: n.rpartition(".")[2] for n in plant.inputs}
    rng = np.random.default_rng(seed)
    excess: tuple[float, str] = (0.0, "")
    witness: dict[str, float] = {}
    settled = broken = 0
    for _ in range(starts):
        given = {n: s.value for n, s in controller.inputs.items()}
        given |= {n: float(rng.uniform(*pair)) for n, pair in ranges.items()}
        first = dict(given)
        tick.x = rest.copy()
        before: dict[str, float] | None = None
        for k in range(ticks):
            if k % 10 == 0 and k:
                drawn = {n: r for n, r in ranges.items() if n not in plant.states}
                given |= {n: float(rng.uniform(*r)) for n, r in drawn.items()}
            y = tick(*(given[n] for n in controller.inputs))
            out = dict(zip(controller.outputs, y, strict=True))
            settled += out["status"] == 0
            if out["status"] == 2:
                broken += 1
                witness = witness or first
            worst = _excess(controller, names, out, before, given, h)
            if worst[0] > excess[0]:
                excess, witness = worst, first
            before = {n: out[n] for n in names}
            known = {n: s.value for n, s in plant.inputs.items()} | given | out
            u: Any = [known.get(short[n], known[n]) for n in plant.inputs]
            x = ca.DM([given[n] for n in plant.states])
            following = build.column(step(x, ca.DM(u), plant_p)[0])
            given |= dict(zip(plant.states, map(float, following), strict=True))
    sizes = [abs(s.value) for n, s in controller.params.items() if n.endswith(("_lo", "_hi"))]
    allowed = ROUNDING * max([*sizes, 1.0])
    return Feasibility(
        starts, ticks, excess[0] <= allowed, excess, settled / (starts * ticks), broken, witness
    )


def _excess(
    controller: Block, names: list[str], out: Mapping[str, float],
    before: Mapping[str, float] | None, given: Mapping[str, Any], h: float,
) -> tuple[float, str]:  # fmt: skip
    """By how much a control passes a bound or a rate, and which."""
    values = {n: s.value for n, s in controller.params.items()}
    found = (0.0, "")
    for n in names:
        moved = abs(out[n] - before[n]) if before is not None else 0.0
        gaps = [
            values.get(f"{n}_lo", -np.inf) - out[n], out[n] - values.get(f"{n}_hi", np.inf),
            moved - values.get(f"{n}_rate", np.inf) * h,
        ]  # fmt: skip
        found = max([found, *((float(g), n) for g in gaps)])
    return found
