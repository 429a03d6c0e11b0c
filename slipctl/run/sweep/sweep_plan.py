"""What a sweep varies: axes of a grid, draws, and the numbers of each run by its number alone."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from slipctl.block.block import Block
from slipctl.block.shared_numbers import targets
from slipctl.block.units.unit_algebra import read_range
from slipctl.errors import BadInput, check_whole, nearest, refuse_unknown_choice
from slipctl.run.rail import Scenario
from slipctl.run.scenario_inputs import loop_at_start, rail_values

DESIGNS = ("random", "sobol", "lhs")
"""Ways to draw: independent, a Sobol sequence, a Latin hypercube."""

BATCH = 1024
"""Points of a Sobol sequence that are made at once; a power of two keeps it balanced."""

MOST = 100_000_000
"""Most runs of a sweep."""


@dataclass(frozen=True)
class Axis:
    """A number that varies.

    Attributes:
        name: as the person wrote it.
        lo, hi: its range, in ``unit``.
        points: values of a grid axis, ends included; None for a uniform draw.
        unit: of the number.
    """

    name: str
    lo: float
    hi: float
    points: int | None
    unit: str

    def at(self, share: float) -> float:
        """Number at a share of the range."""
        return float(self.lo + (self.hi - self.lo) * share)

    def told(self) -> list[Any]:
        """The axis as a store keeps it."""
        return [self.name, self.lo, self.hi, self.points, self.unit]


def read_axis(text: str, loop: Block, scenario: Scenario, door: str = "--vary") -> Axis:
    """Read ``P=lo:hi:n`` (a grid axis of n values) or ``P=lo:hi`` (a uniform draw).

    Args:
        text: what a person wrote. loop, scenario: what runs. door: where it stands, for refusals.

    Raises:
        BadInput: another form, an unknown name, a range that is none or lies off that of the
            number, a number that the rail or the scenario sets.
    """
    name, equals, values = (part.strip() for part in text.partition("="))
    parts = [p.strip() for p in values.split(":")]
    if not equals or not name or len(parts) not in (2, 3) or not all(parts):
        raise BadInput(
            f"{door} {text!r}: write P=lo:hi:n for n values, P=lo:hi for a draw, such as"
            " ctl.k1=5:50:10"
        )
    points = None
    if len(parts) == 3:
        if not parts[2].isdigit() or not 2 <= int(parts[2]) <= MOST:
            raise BadInput(f"{door} {text!r}: {parts[2]!r} is no number of values; write 2 or more")
        points = int(parts[2])
    ends = []
    for n in _meant(name, loop, scenario, door):
        signal = loop.declared(n)
        if signal.shape:
            raise BadInput(f"{door} {name}: {n} has several numbers, shape {signal.shape}")
        ends.append((signal, read_range(parts[0], parts[1], signal.unit, name)))
    signal, (lo, hi) = ends[0]
    if not lo < hi:
        raise BadInput(f"{door} {text!r}: {lo:g} to {hi:g} is no range; write lo < hi")
    for other, values_ in ends:
        for v in values_:
            other.check(f"{door} {name}", v)
    return Axis(name, lo, hi, points, signal.unit)


def _meant(name: str, loop: Block, scenario: Scenario, door: str) -> list[str]:
    """Parameters and start values that a name sets; refuses what has no effect."""
    found = targets(loop, name, ("param", "state"))
    if not found:
        names = dict.fromkeys(".".join(n.split(".")[k:]) for n in (*loop.params, *loop.states)
                              for k in range(n.count("."), -1, -1))  # fmt: skip
        raise BadInput(f"{loop.name} has no parameter {name!r}{nearest(name, names)}")
    by_rail = {n for group in rail_values(loop_at_start(loop, scenario), scenario) for n in group}
    if ruled := [n for n in found if n in by_rail]:
        raise BadInput(
            f"{door} {name}: the rail sets {ruled[0]} in scenario {scenario.name}, so it has no"
            " effect; vary what the rail does not set"
        )
    for given in (*scenario.params, *scenario.start):
        if set(targets(loop, given, ("param", "state"))) & set(found):
            raise BadInput(
                f"{door} {name}: scenario {scenario.name} sets {given}; it has no effect"
            )
    return found


@dataclass(frozen=True)
class Plan:
    """All runs of a sweep: the grid, times the samples where something is drawn.

    Attributes:
        axes: what varies.
        samples: how often each point of the grid is run; 1 where nothing is drawn.
        seed: of the draws.
        design: how they are drawn, one of :data:`DESIGNS`.
    """

    axes: tuple[Axis, ...]
    samples: int = 1
    seed: int = 1
    design: str = "random"

    def __post_init__(self) -> None:
        if not self.axes:
            raise BadInput("a sweep needs something to vary; write --vary P=lo:hi:n or P=lo:hi")
        refuse_unknown_choice("a sweep", "design", self.design, DESIGNS)
        check_whole("--samples", self.samples, 1, MOST)
        check_whole("--seed", self.seed, 0, 2**63)
        names = [a.name for a in self.axes]
        for k, name in enumerate(names):
            if name in names[:k]:
                raise BadInput(f"--vary names {name} twice; write it once")
        if self.size > MOST:
            raise BadInput(f"the sweep has {self.size:.3g} runs; at most {MOST:.0e} are made")

    @property
    def grid(self) -> tuple[Axis, ...]:
        """Axes of the grid."""
        return tuple(a for a in self.axes if a.points is not None)

    @property
    def drawn(self) -> tuple[Axis, ...]:
        """What is drawn."""
        return tuple(a for a in self.axes if a.points is None)

    @property
    def shape(self) -> tuple[int, ...]:
        """Values along each axis of the grid."""
        return tuple(int(a.points or 1) for a in self.grid)

    @property
    def repeats(self) -> int:
        """Runs of each point of the grid."""
        return self.samples if self.drawn else 1

    @property
    def size(self) -> int:
        """Number of runs."""
        return math.prod(self.shape) * self.repeats

    def place(self, run: int) -> tuple[int, ...]:
        """Place of a run along the axes of the grid, and its sample behind them."""
        sample, point = divmod(run, math.prod(self.shape))
        return (*(int(k) for k in np.unravel_index(point, self.shape)), sample)

    def numbers(self, run: int) -> dict[str, float]:
        """Numbers of a run, by its number alone: they do not depend on what else runs."""
        where = self.place(run)
        found = {
            a.name: float(np.linspace(a.lo, a.hi, int(a.points or 1))[k])
            for a, k in zip(self.grid, where, strict=False)
        }
        if self.drawn:
            pairs = zip(self.drawn, self._shares(run), strict=True)
            found |= {a.name: a.at(s) for a, s in pairs}
        return {a.name: found[a.name] for a in self.axes}

    def _shares(self, run: int) -> np.ndarray:
        many = len(self.drawn)
        if self.design == "sobol":
            return _sobol(many, self.seed, run // BATCH)[run % BATCH]
        if self.design == "lhs":
            return _latin(many, self.seed, self.size)[run]
        rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([self.seed, run])))
        return rng.random(many)


@lru_cache(maxsize=4)
def _sobol(many: int, seed: int, batch: int) -> np.ndarray:
    from scipy.stats import qmc

    if many > qmc.Sobol.MAXDIM:
        raise BadInput(f"--design sobol draws at most {qmc.Sobol.MAXDIM} numbers")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        engine = qmc.Sobol(many, scramble=True, **_seeded(qmc.Sobol, seed))
        if batch:
            engine.fast_forward(batch * BATCH)
        return engine.random(BATCH)


@lru_cache(maxsize=2)
def _latin(many: int, seed: int, size: int) -> np.ndarray:
    from scipy.stats import qmc

    return qmc.LatinHypercube(many, **_seeded(qmc.LatinHypercube, seed)).random(size)


def _seeded(engine: Any, seed: int) -> dict[str, Any]:
    """Seed by the name that this version of scipy has for it."""
    import inspect

    name = "rng" if "rng" in inspect.signature(engine).parameters else "seed"
    return {name: np.random.default_rng(seed)}


def plan_of(
    loop: Block, scenario: Scenario, vary: Sequence[str] | Mapping[str, Sequence[float]],
    samples: int = 1, seed: int = 1, design: str = "random", more: Sequence[Axis] = (),
) -> Plan:  # fmt: skip
    """Plan of a sweep.

    Args:
        loop, scenario: what runs.
        vary: ``["ctl.k1=5:50:10", "m=28t:42t"]``, or ranges by name, ``{"ctl.k1": (5, 50, 10)}``.
        samples, seed, design: as of :class:`Plan`. more: what varies too, as it is.

    Raises:
        BadInput: as of :func:`read_axis`.
    """
    if isinstance(vary, Mapping):
        texts = []
        for name, ends in vary.items():
            if not isinstance(ends, (tuple, list)) or len(ends) not in (2, 3):
                raise BadInput(f"vary: {name!r} is {ends!r}; give (lo, hi) or (lo, hi, n)")
            texts.append(f"{name}=" + ":".join(str(e) for e in ends))
    else:
        texts = list(vary)
    axes = (*(read_axis(t, loop, scenario) for t in texts), *more)
    return Plan(axes, samples, seed, design)
