"""``tune``: from free numbers, an objective and an ensemble to gains, proved and judged."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from slipctl import __version__
from slipctl.block.block import Block, as_block
from slipctl.certify.promise import CERTIFIED
from slipctl.design import judgement, statement
from slipctl.design.fronts import FrontSearch
from slipctl.design.gain_search import HELD_OUT, RUNS, TRAINING, Candidate, Search, goals_of_loop
from slipctl.design.goals import Limit, Objective
from slipctl.design.judgement import Judged, Slice
from slipctl.design.promises import Promises, is_last
from slipctl.design.ranges import Free, read_frees
from slipctl.design.rolls import FILE, Rolls
from slipctl.design.slopes.polish import Polished, polish
from slipctl.errors import BadInput, RunFailed, check_whole
from slipctl.run import interrupts, machine
from slipctl.run.rail import Scenario
from slipctl.run.results import Known
from slipctl.run.roles import Signals
from slipctl.run.sweep import sweep_store
from slipctl.run.sweep.ensemble import Ensemble, World
from slipctl.study.declaration import Gains


@dataclass(frozen=True)
class Tuned:
    """Gains that were found, and what they are worth.

    Attributes:
        loop: with its hand-set numbers. name: as a command takes it. frees: what was free.
        gains: tuned numbers by name. search: how they were found.
        judged: both on held-out draws; None where the search was stopped.
        slices: the objective along each number.
        margins: by certificate, the factor on its bounds up to which it is proved, tuned and
            hand-set; 0 where it is not proved.
        statement: what fresh draws prove, as a certificate holds it; None where not asked for.
        polished: what came of exact slopes.
    """

    loop: Block
    name: str
    frees: tuple[Free, ...]
    gains: Mapping[str, float]
    search: Search
    judged: Judged | None
    slices: tuple[Slice, ...]
    margins: Mapping[str, tuple[float, float]]
    statement: Mapping[str, Any] | None = None
    polished: Polished | None = None

    @property
    def promises(self) -> Promises:
        """Certificates of the loop."""
        return self.search.promises

    @property
    def front(self) -> tuple[Candidate, ...]:
        """Candidates of the front, where there are several objectives."""
        return tuple(self.search.front) if isinstance(self.search, FrontSearch) else ()

    def tuned_loop(self) -> Block:
        """The loop with the tuned numbers."""
        return self.loop.with_params(**self.gains)


class Stopped(KeyboardInterrupt):
    """The search was stopped; it has the best so far.

    Attributes:
        best: what was found.
    """

    def __init__(self, best: Tuned) -> None:
        super().__init__()
        self.best = best


def tune(
    loop: Block,
    free: Sequence[str] | Mapping[str, Any],
    objective: str | Sequence[str],
    ensemble: Ensemble,
    subject_to: Sequence[str] = (),
    *,
    scenario: Scenario,
    signals: Signals | None = None,
    known: Mapping[str, Known] | None = None,
    gains: Sequence[Gains] = (),
    out: str | Path | None = None,
    samples: int = 20,
    seed: int = 1,
    held_out: int = 200,
    runs: int | None = None,
    prove: bool = False,
    controller: str = "ctl",
    jobs: int | None = None,
    compile: bool = True,
    tell: Callable[[str], None] | None = None,
    progress: Callable[[str, float], None] | None = None,
    about: Mapping[str, Any] | None = None,
) -> Tuned:
    """Find numbers of a loop that make an objective small on an ensemble.

    A candidate is first asked for its certificates, then run on the draws, the same for all. What
    takes long to prove is asked of those that would be the best. The hand-set numbers are a
    candidate. The best is run on draws of its own, beside the hand-set ones.

    Args:
        loop: the loop, with its hand-set numbers.
        free: what is searched, ``{"ctl.law.k1": (1, 60)}`` or ``["k1=1:60"]``.
        objective: a metric, or a weighted sum, ``"distance + 0.001*torque_ripple"``. Several give
            a front, ``["distance", "torque_ripple"]``, and the gains are those of its knee.
        ensemble: what differs from draw to draw.
        subject_to: ``["torque_ripple<=8kN m", "slip_max@0.95<=2m/s", "margin>=1.2"]``.
        scenario: what happens.
        signals, known: what the metrics speak of, as of a :class:`Case`.
        gains: certificates of the loop, as a study declares them. What the hand-set numbers have
            proved has to stay so.
        out: folder in which what was run is kept; the same call goes on there. None keeps nothing.
        samples: draws of the search.
        seed: of draws and search.
        held_out: draws on which both sets of numbers are judged.
        runs: most runs of the search; by default 250 for each free number and each objective.
        prove: state what 1375 fresh draws prove: kept in 99 % of all draws, confidence 1 - 1e-6.
        controller: part of the loop that a bare name is looked for in.
        jobs: runs at once; by default one for each core. The result is the same.
        compile: compile the loop when a C compiler is there.
        tell: told a line from time to time.
        progress: told what goes on (search, judgement, statement) and the share that has ended.
        about: what else kept runs have to agree in.

    Returns:
        The gains and what they are worth.

    Raises:
        BadInput: a number without a range, a metric that the loop has not, a constraint that
            nothing meets.
        Stopped: Ctrl-C; has the best so far.
    """
    _check(loop, samples, seed, held_out, jobs)
    name, note = str((about or {}).get("loop", loop.name)), tell or (lambda text: None)
    frees = read_frees(free, loop, scenario, controller)
    world = World(loop, scenario, ensemble, signals=signals, known=known, seed=seed,
                  free=[f.name for f in frees], compile=compile)  # fmt: skip
    _apart(frees, world, note)
    proofs = Promises(tuple(gains), tell=note)
    goals, limits, proofs = _wanted(world, frees, name, objective, subject_to, proofs, samples)
    runs = RUNS * len(frees) * len(goals) if runs is None else runs
    check_whole("--runs", runs, 1)
    told = _identity(loop, world, frees, goals, subject_to, samples, runs) | dict(about or {})
    with _begun(out, told) as store:
        rolls = Rolls(world, jobs or machine.cores(), store)
        rolls.progress = progress or rolls.progress
        kind = FrontSearch if goals[1:] else Search
        search = kind(loop, frees, rolls, goals[0], limits, proofs, samples, runs, seed, note,
                      tuple(goals[1:]))  # fmt: skip
        return _found(search, name, held_out, prove)


def _check(loop: Block, samples: int, seed: int, held_out: int, jobs: int | None) -> None:
    as_block("tune: the loop", loop)
    check_whole("--samples", samples, 4, 10_000)
    check_whole("--seed", seed, 0, 2**62)
    check_whole("the held-out draws", held_out, 2, 100_000)
    check_whole("--jobs", jobs or 1, 1)


def _wanted(
    world: World, frees: Sequence[Free], name: str, objective: str | Sequence[str],
    subject_to: Sequence[str], promises: Promises, samples: int,
) -> tuple[Sequence[Objective], Sequence[Limit], Promises]:  # fmt: skip
    """Objectives, limits and certificates; nothing else will be measured."""
    there = _metrics_of_first(world, {f.name: f.now for f in frees}, samples)
    names = [g.name for g in promises.gains]
    goals, limits, proved = goals_of_loop(objective, subject_to, there, name, names)
    measured = [m for goal in goals for m in goal.metrics]
    world.wanted = tuple(dict.fromkeys((*measured, *(limit.metric for limit in limits))))
    for g in filter(is_last, promises.gains):
        promises.tell(f"{g.name}: proof of the hand-set numbers, which takes up to minutes")
    kept = [g.name for g in promises.gains if promises.verdict(g, world.loop) == CERTIFIED]
    return goals, limits, replace(promises, wanted=tuple(proved), kept=tuple(kept))


def _begun(out: str | Path | None, told: Mapping[str, Any]) -> AbstractContextManager[Any]:
    """The folder in which what was run is kept, while it is open; None without one."""
    if out is None:
        return nullcontext()
    return sweep_store.begin(Path(out), dict(told), FILE, "search")


def _identity(
    loop: Block, world: World, frees: Sequence[Free], goals: Sequence[Objective],
    subject_to: Sequence[str], samples: int, runs: int,
) -> dict[str, Any]:  # fmt: skip
    """What kept runs of a search have to agree in."""
    return {
        "scenario": world.scenario.name, "free": [[f.name, f.lo, f.hi, f.unit] for f in frees],
        "objective": ", ".join(goal.text for goal in goals),
        "constraints": list(subject_to), "ensemble": world.ensemble.hash,
        "draws": samples, "runs": runs, "seed": world.seed, "slipctl": __version__,
        "casadi": ca.CasadiMeta.version(), "numpy": np.__version__, "machine": platform.machine(),
        "equations": hashlib.sha256(loop.f.serialize().encode()).hexdigest(),
        "numbers": world.measured.fingerprint(), "samples": 0,
    }  # fmt: skip


def _found(search: Search, name: str, held_out: int, prove: bool) -> Tuned:
    """What a search finds, and what that is worth.

    Raises:
        Stopped: Ctrl-C; has the best so far.
    """
    rolls, numbers = search.rolls, {f.name: f.now for f in search.frees}
    found = Tuned(search.loop, name, tuple(search.frees), numbers, search, None, (), {})
    polished = Polished("a front has none")
    try:
        rolls.begin("search", search.runs)
        best = search.run()
        if len(search.objectives) == 1:
            polished = polish(search)
            best = search.best
        rolls.end()
        rolls.begin(f"{held_out} held-out draws", 2 * held_out)
        judged = judgement.judge(search, held_out)
        rolls.end()
        rolls.begin("one number at a time", judgement.runs_of_slices(search))
        along = tuple(judgement.slices(search))
        rolls.end()
        rolls.begin("margins of the certificates", 2 * len(found.promises.gains))
        margins = _margins(found, best)
        rolls.end()
        stated = statement.prove(search) if prove else None
        rolls.end()
    except KeyboardInterrupt:
        interrupts.note_interrupt()
        raise Stopped(replace(found, gains=search.best_proved.numbers)) from None
    return replace(found, gains=best.numbers, judged=judged, slices=along, margins=margins,
                   statement=stated, polished=polished)  # fmt: skip


def _margins(found: Tuned, best: Candidate) -> dict[str, tuple[float, float]]:
    """Margins of each certificate: tuned, and by hand."""
    margins = {}
    for g in found.promises.gains:
        both = []
        for loop in (found.loop.with_params(**best.numbers), found.loop):
            both.append(found.promises.margin(g, loop))
            found.search.rolls.advance()
        margins[g.name] = (both[0], both[1])
    return margins


def _metrics_of_first(world: World, numbers: Mapping[str, float], samples: int) -> Any:
    """Metrics of the first draw on which the hand-set numbers run at all.

    Raises:
        BadInput, RunFailed: they run on none.
    """
    for k in range(samples):
        try:
            return world.metrics(numbers, world.draw(TRAINING, k))
        except (BadInput, RunFailed):
            if k == samples - 1:
                raise
    return {}


def _apart(frees: Sequence[Free], world: World, note: Callable[[str], None]) -> None:
    """Tell what is drawn without effect; refuse a number that is both free and drawn."""
    for text in world.notes:
        note(text)
    drawn = {a.name for a in world.axes} | {n for f in world.factors for n in f.numbers}
    for f in frees:
        if f.name in drawn:
            raise BadInput(f"{f.name} is free, and the ensemble draws it; choose one")


__all__ = ["HELD_OUT", "Stopped", "Tuned", "tune"]
