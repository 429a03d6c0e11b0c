"""An ensemble: the vehicles, rails and sensors that a loop has to do with, drawn by number."""

from __future__ import annotations

import hashlib
import json
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from slipctl.block.block import Block
from slipctl.block.shared_numbers import targets
from slipctl.block.units.unit_algebra import parse_quantity
from slipctl.errors import BadInput, check_kinds, check_known, nearest
from slipctl.run.metrics import Metric
from slipctl.run.rail import Rail, Scenario
from slipctl.run.results import Known
from slipctl.run.roles import Signals
from slipctl.run.scenario_inputs import loop_at_start, rail_values
from slipctl.run.sweep.sweep_plan import Axis, read_axis
from slipctl.run.sweep.sweep_runs import Measured

MANY = 100
"""Runs that the loop of an ensemble is compiled for: it is rolled again and again."""

KEYS = ("seeds", "draw", "scale")
FACTOR = re.compile(r"\s*([^:]+?)\s*:\s*([^:]+?)\s+of\s+(.+?)\s*")


@dataclass(frozen=True)
class Ensemble:
    """What differs from one draw to the next; each number is uniform in its range.

    Args:
        draw: range of each number that is drawn, ``{"plant.m": "7t:12t"}``.
        scale: factors, each with all that it multiplies: parameters that the rail sets or the loop
            has, and quantities that the study knows,
            ``{"peak": "0.8:1.2 of plant.adh.c, rail.best_adhesion"}``.
        seeds: whether the noise is drawn anew.
        also: numbers of the loop that are drawn together, by name, from the seed of a draw; what
            they are drawn from stands in ``also_told``.

    Raises:
        BadInput: it is empty.
    """

    draw: Mapping[str, str] = field(default_factory=dict)
    scale: Mapping[str, str] = field(default_factory=dict)
    seeds: bool = False
    also: Callable[[int], Mapping[str, Any]] | None = None
    also_told: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_kinds("Ensemble", Ensemble, {k: v for k, v in vars(self).items() if k != "also"})
        if not (self.draw or self.scale or self.seeds or self.also):
            raise BadInput(
                "the ensemble is empty; write what differs from draw to draw, such as"
                ' [draw] "plant.m" = "7t:12t"'
            )

    def told(self) -> dict[str, Any]:
        """Its entries, as a file holds them."""
        found = {"seeds": self.seeds, "draw": dict(self.draw), "scale": dict(self.scale)}
        return found | ({"also": dict(self.also_told)} if self.also_told else {})

    @property
    def hash(self) -> str:
        """SHA-256 of its entries."""
        return hashlib.sha256(json.dumps(self.told(), sort_keys=True).encode()).hexdigest()


def read_ensemble(where: str, given: Any) -> Ensemble:
    """Ensemble of a table: ``seeds = true``, and the tables ``[draw]`` and ``[scale]``.

    Raises:
        BadInput: another entry, or no texts in the tables.
    """
    if not isinstance(given, Mapping):
        raise BadInput(f"{where}: the ensemble is {given!r}; write a table with {', '.join(KEYS)}")
    for key in given:
        check_known(f"{where} has no entry", key, KEYS, " of an ensemble")
    for key in ("draw", "scale"):
        rows = given.get(key, {})
        if not isinstance(rows, Mapping):
            raise BadInput(f'{where}: {key} is {rows!r}; write [{key}] and lines name = "lo:hi"')
        for name, text in rows.items():
            if not isinstance(text, str):
                raise BadInput(f'{where}: {key}.{name} is {text!r}; write "lo:hi" with its unit')
    if not isinstance(given.get("seeds", False), bool):
        raise BadInput(f"{where}: seeds is {given['seeds']!r}; write true or false")
    try:
        return Ensemble(given.get("draw", {}), given.get("scale", {}), given.get("seeds", False))
    except BadInput as error:
        raise BadInput(f"{where}: {error}") from None


def load_ensemble(path: str) -> Ensemble:
    """Ensemble of a TOML file.

    Raises:
        BadInput: no such file, no TOML, another entry.
    """
    try:
        content = tomllib.loads(Path(path).read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise BadInput(f"cannot read {path}: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, ValueError) as error:
        raise BadInput(f"{path} is no TOML file: {error}") from None
    return read_ensemble(path, content)


@dataclass(frozen=True)
class Factor:
    """A factor that is drawn, and what it multiplies.

    Attributes:
        name: of the factor. lo, hi: its range. numbers: parameters. known: quantities known beside.
    """

    name: str
    lo: float
    hi: float
    numbers: tuple[str, ...]
    known: tuple[str, ...]


@dataclass(frozen=True)
class Draw:
    """One draw.

    Attributes:
        numbers: what the loop is given. scenario: with the drawn rail and seed.
        known: quantities known beside the loop. factors: drawn, by name.
    """

    numbers: Mapping[str, float]
    scenario: Scenario
    known: Mapping[str, Known]
    factors: Mapping[str, float]


class World:
    """A loop in a scenario, built once, that is run on draws of an ensemble; threads may share it.

    Args:
        loop, scenario: what runs.
        ensemble: what differs.
        signals, known: what the metrics speak of, as of a :class:`Case`.
        seed: of all draws.
        free: other numbers that will be given to :meth:`metrics`.
        compile: compile the loop when a C compiler is there.

    Attributes:
        wanted: the only metrics that are measured; None measures all.
        notes: what of the ensemble has no effect on this loop, a line each.

    Raises:
        BadInput: an unknown name, a range that is none, seeds alone where nothing is noisy.
    """

    def __init__(
        self, loop: Block, scenario: Scenario, ensemble: Ensemble, *,
        signals: Signals | None = None, known: Mapping[str, Known] | None = None, seed: int = 1,
        free: Sequence[str] = (), compile: bool = True,
    ) -> None:  # fmt: skip
        self.scenario, self.ensemble, self.seed = scenario, ensemble, seed
        self.wanted: tuple[str, ...] | None = None
        self.known = dict(known or {})
        self.axes = tuple(
            read_axis(f"{n}={text}", loop, scenario, "the ensemble: draw")
            for n, text in ensemble.draw.items()
        )
        for a in self.axes:
            if a.points is not None:
                raise BadInput(f"the ensemble: draw {a.name}: write lo:hi, no number of values")
        groups = rail_values(loop_at_start(loop, scenario), scenario)
        by_rail = {n for group in groups for n in group}
        self.factors = tuple(self._factor(loop, n, t, by_rail) for n, t in ensemble.scale.items())
        self.notes: tuple[str, ...] = ()
        if ensemble.seeds and not (scenario.noise and any(s.noise for s in loop.inputs.values())):
            why = f"{loop.name} has no noise in scenario {scenario.name}"
            if not (self.axes or self.factors or ensemble.also):
                raise BadInput(f"the ensemble draws seeds alone, and {why}; draw a number too")
            self.notes = (f"{why}: seeds have no effect there",)
        # numbers that leave a share are set apart once, so that a draw changes values alone
        drawn = [a.name for a in self.axes] + [n for f in self.factors for n in f.numbers]
        now = loop.values_by_place()
        own = {n: now[n] for n in (*drawn, *free) if n in now and n not in by_rail}
        self.loop = loop = loop.with_params(**own) if own else loop
        roles = signals or Signals()
        self.measured = Measured(loop, scenario, roles, self.known, (), compile, runs=MANY)

    def _factor(self, loop: Block, name: str, text: str, by_rail: set[str]) -> Factor:
        where = f"the ensemble: scale {name}"
        match = FACTOR.fullmatch(text)
        if not match:
            raise BadInput(f'{where}: {text!r}; write "0.8:1.2 of NAME, NAME"')
        lo, hi = (parse_quantity(match[k], "1", where) for k in (1, 2))
        if not lo < hi:
            raise BadInput(f"{where}: {lo:g} to {hi:g} is no range; write lo < hi")
        numbers, known = [], []
        for n in (p.strip() for p in match[3].split(",")):
            if n in self.known:
                if callable(self.known[n].values):
                    raise BadInput(f"{where}: {n} follows from the log; it is not scaled")
                known.append(n)
                continue
            hits = targets(loop, n)
            if len(hits) != 1:
                candidates = [*loop.params, *self.known]
                raise BadInput(f"{where}: {loop.name} has no {n!r}{nearest(n, candidates)}")
            signal = loop.declared(hits[0])
            if signal.shape and hits[0] not in by_rail:
                raise BadInput(f"{where}: {n} has several numbers, shape {signal.shape}")
            numbers.append(hits[0])
        return Factor(name, lo, hi, tuple(numbers), tuple(known))

    @property
    def ranges(self) -> tuple[Axis, ...]:
        """Ranges of what is drawn: numbers, then factors."""
        return (*self.axes, *(Axis(f.name, f.lo, f.hi, None, "1") for f in self.factors))

    def draw(self, stream: int, k: int) -> Draw:
        """Draw number k of a stream, by seed, stream and number alone."""
        rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([self.seed, stream, k])))
        shares = rng.random(len(self.axes) + len(self.factors))
        drawn = {a.name: a.at(s) for a, s in zip(self.ranges, shares, strict=True)}
        return self.at(drawn, int(rng.integers(2**31)))

    def at(self, drawn: Mapping[str, float], noise: int) -> Draw:
        """Draw with these numbers and factors, all of :attr:`ranges`, and this seed."""
        factors = {f.name: drawn[f.name] for f in self.factors}
        numbers: dict[str, Any] = {n: v for n, v in drawn.items() if n not in factors}
        if self.ensemble.also is not None:
            numbers |= self.ensemble.also(noise)
        scenario = self.scenario.but(seed=noise) if self.ensemble.seeds else self.scenario
        known = dict(self.known)
        for f in self.factors:
            by = factors[f.name]
            for n in f.known:
                known[n] = replace(known[n], values=_times(known[n].values, by))
            for n in f.numbers:
                rail, own = self._scaled(scenario, n, by)
                scenario = scenario.but(rail=rail)
                numbers |= own
        return Draw(numbers, scenario, known, factors)

    def run(self, numbers: Mapping[str, float], run: int) -> tuple[Mapping[str, float], Draw]:
        """What run number ``run`` of a sweep is given; its noise is that of its number."""
        names = {a.name for a in self.ranges}
        state = np.random.SeedSequence([self.seed, run]).generate_state(1)
        draw = self.at({n: v for n, v in numbers.items() if n in names}, int(state[0] >> 1))
        return {**draw.numbers, **{n: v for n, v in numbers.items() if n not in names}}, draw

    def _scaled(
        self, scenario: Scenario, name: str, by: float
    ) -> tuple[Rail | None, dict[str, float]]:
        """Rail whose sections set a number times a factor; or the loop's own number."""
        loop = loop_at_start(self.loop, scenario)
        for group in rail_values(loop, scenario):
            if name in group and scenario.rail is not None:
                pairs = zip(scenario.rail.sections, group[name], strict=True)
                last = {n for s in scenario.rail.sections for n in s.values
                        if targets(loop, n, ("input", "param")) == [name]}  # fmt: skip
                sections = [
                    replace(s, values={k: v for k, v in s.values.items() if k not in last}
                            | {name: by * float(v)})
                    for s, v in pairs
                ]  # fmt: skip
                return Rail(sections, scenario.rail.by), {}
        value = {**loop.param_values(), **loop.start()}[name]
        return scenario.rail, {name: by * float(np.asarray(value))}

    def metrics(self, numbers: Mapping[str, float], draw: Draw) -> dict[str, Metric]:
        """Metrics of the loop with these numbers on a draw.

        Raises:
            BadInput: numbers that the loop refuses.
            RunFailed: a state became NaN or infinite.
        """
        given = {**draw.numbers, **numbers}
        scenario = draw.scenario
        log = self.measured.prepared(given, seed=scenario.seed, rail=scenario.rail)
        return self.measured.metrics(log, scenario, draw.known, self.wanted)


def _times(values: Any, by: float) -> float | Sequence[float]:
    return [by * v for v in values] if isinstance(values, Sequence) else by * float(values)
