"""The Study: a question, its loops and scenarios, the paper's answers beside ours.

A study module lies in ``slipctl.studies`` and has one name that matters, ``study``::

    study = Study(
        name="subway_braking",
        title="Super-twisting slip control of a subway wheelset",
        source="Huang et al., Energies 2020",
        doc="Does super-twisting end the chattering, and what does the online optimum cost?",
        models={"adh": double_exponential},       # what --swap adh=my.py:my_law replaces
        cases=cases,                              # cases(models, quick) -> [Case(...), ...]
        signals=Signals(speed="plant.wheel.v", slip="plant.wheel.v_s", ...),
        controller="ctl",                         # what `slipctl c subway_braking:sta` exports
        experiments={"seeds": Experiment("Many seeds", seeds)},
        claims=(Claim("ripple", "section 5", "...", kind="number", ours=lambda r: ...), ...),
        figures={"fig05": Figure("Slip, as Fig. 5", fig05), ...},
    )

Everything in it is declared before the run, the tolerances of the claims too; functions get what
was run. This module imports nothing heavy.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from slipctl import registry
from slipctl.errors import BadInput, check_kinds, check_known
from slipctl.run.metrics import METRICS
from slipctl.run.results import Case, NotRun, Results, Table
from slipctl.run.roles import Signals
from slipctl.run.store import plain, read_json, write_json
from slipctl.study.jobs import Cores, run_jobs

if TYPE_CHECKING:
    from slipctl.block.block import Block
    from slipctl.run.rail import Scenario
    from slipctl.run.sweep.ensemble import Ensemble

Item = TypeVar("Item")


@dataclass(frozen=True)
class Experiment:
    """A computation that is no loop in a scenario: many seeds, a sweep, a comparison of solvers.

    Args:
        title: what it is.
        run: function of the :class:`Context`, giving one or more tables by name.
        doc: the question in a sentence.
    """

    title: str
    run: Callable[[Context], Table | Mapping[str, Table]]
    doc: str = ""

    def __post_init__(self) -> None:
        check_kinds("Experiment", Experiment, vars(self))


@dataclass(frozen=True)
class Context:
    """What an experiment gets.

    Attributes:
        quick: run fewer or shorter ones.
        models: the study's models, swapped ones in place.
        cases: the study's cases, ``--set`` applied.
        seed: of the experiment; draw from ``numpy.random.default_rng([seed, ...])`` only.
        compile: whether loops may be compiled; pass it to ``simulate``.
        progress: call it with the share done, 0 to 1.
        folder: where :meth:`kept` keeps what is finished; None keeps nothing.
        cores: cores that :meth:`each` shares with all that runs; None is one.
        key: hash of everything that the whole run depends on; part of what :meth:`each` keeps.
    """

    quick: bool
    models: Mapping[str, Any]
    cases: Sequence[Case]
    seed: int = 1
    compile: bool = True
    progress: Callable[[float], None] = lambda share: None
    folder: Path | None = None
    cores: Cores | None = None
    key: str = ""

    def each(
        self,
        name: str,
        items: Sequence[Item],
        work: Callable[[Item], Any],
        share: tuple[float, float] = (0.0, 1.0),
    ) -> list[Any]:
        """Do the same with each item, on all cores; what is finished is kept for the next start.

        Args:
            name: of this work, unique in the experiment.
            items: plain values (seeds, names, numbers), the only thing in which the parts differ.
            work: gives plain values (numbers, texts, lists, dicts) for an item. It runs in a
                process of its own, so that nothing it changes is seen by the others.
            share: of the experiment that is done before and after it, for the progress.

        Returns:
            What ``work`` gave for each item, in their order, as JSON has it (NaN is None).
        """

        def job(item: Item) -> Callable[[Any], Any]:
            what = {"part": name, "item": item, "key": self.key}
            quiet = replace(self, folder=self.folder if self.key else None)
            return lambda tell: quiet.kept(what, lambda: {"value": work(item)})["value"]

        found: dict[str, Any] = {}
        begun: dict[str, float] = dict.fromkeys(map(str, range(len(items))), 0.0)
        first, last = share

        def tell(which: str, part: float) -> None:
            begun[which] = part
            self.progress(first + (last - first) * sum(begun.values()) / max(len(items), 1))

        jobs = {str(k): job(item) for k, item in enumerate(items)}
        with closing(run_jobs(jobs, self.cores or Cores(1), tell)) as outcomes:
            for which, outcome in outcomes:
                found[which] = outcome.get()
                tell(which, 1.0)
        return [found[which] for which in jobs]

    def kept(
        self, what: Mapping[str, Any], compute: Callable[[], Mapping[str, Any]]
    ) -> dict[str, Any]:
        """Result of ``compute``, or the one that an interrupted or earlier run kept.

        Args:
            what: everything that the result depends on, as plain values; the file is named by its
                hash, so that a changed parameter computes anew.
            compute: gives plain values.

        Returns:
            The result as JSON has it (NaN is None), the same bits from the file as computed.
        """
        wanted = plain(what)
        if self.folder is None:
            return dict(plain(compute()))
        key = hashlib.sha256(json.dumps(wanted, sort_keys=True).encode()).hexdigest()
        path = self.folder / f"{key[:32]}.json"
        if path.exists():
            try:
                payload = read_json(path)
                if payload["what"] == wanted:
                    return dict(payload["found"])
            except (BadInput, KeyError):
                pass  # damaged or of another version: computed anew
        found = plain(compute())
        write_json(path, {"what": wanted, "found": found})
        return dict(found)

    def loop(self, scenario: str, loop: str) -> tuple[Block, Scenario]:
        """Loop of a case and its scenario.

        Raises:
            NotRun: the case is not among those that run.
        """
        for case in self.cases:
            if case.scenario.name == scenario and loop in case.loops:
                return case.loops[loop], case.scenario
        raise NotRun(f"{scenario}/{loop} was not run")


Reason = str | Callable[[Results], str]
"""Words, or a function that reads them off what was run."""


REPRODUCED, FAILED, OPEN = "reproduced", "not reproduced", "not checkable"
KINDS = ("number", "order", "yes/no")


@dataclass(frozen=True)
class Claim:
    """A claim of the paper and how it is checked; the verdict is computed, never typed.

    Kinds:
        number: ``paper`` is a number, best written as printed (``"254.0479"``); it holds if ours
            is within the tolerance, or, with ``bound``, at most or at least that number.
        order: ``paper`` is ``"dry > wet > ice"``, ours a dict of numbers by these names; it holds
            if each step goes the right way by more than the tolerance.
        yes/no: ``paper`` is True or False, and so is ours.

    Args:
        id: short name, unique in the study.
        source: where it stands, ``"section 5, Fig. 7"``.
        claim: in a sentence.
        kind: see above.
        paper: the paper's answer.
        ours: function of the :class:`Results` that gives our answer; None as an answer means that
            there is none (it never settles), which does not reproduce the claim.
        unit: of both answers.
        tolerance: ``"last digit"`` (half a unit of the last printed digit, where the paper gives
            all data), ``"5 %"`` of the paper's number, or an absolute number in ``unit``.
        tolerance_why: why this one, unless it is one of the two usual ones.
        bound: ``"at most"`` or ``"at least"`` for a number that is a limit; the tolerance, if any
            is given as a number, is slack on top.
        assumption: what we had to assume, because the paper does not say it.
        scenario, loop: where it was checked.
        why: what explains the outcome, added to the computed reason. A text holds for any numbers
            of the loop; what a run decides is a function of the :class:`Results` that gives it.
        why_not: the same, only if it is not reproduced.
        not_checkable: why it cannot be checked; the verdict is then "not checkable".
    """

    id: str
    source: str
    claim: str
    kind: str
    paper: Any
    ours: Callable[[Results], Any] | None = None
    unit: str = "1"
    tolerance: float | str | None = None
    tolerance_why: str = ""
    bound: str = ""
    assumption: str = ""
    scenario: str = ""
    loop: str = ""
    why: Reason = ""
    why_not: Reason = ""
    not_checkable: str = ""

    def __post_init__(self) -> None:
        check_kinds("Claim", Claim, vars(self))
        if self.kind not in KINDS:
            raise BadInput(f"claim {self.id}: kind {self.kind!r} is none of {', '.join(KINDS)}")
        if self.bound not in ("", "at most", "at least"):
            raise BadInput(f"claim {self.id}: bound {self.bound!r} is neither at most nor at least")
        if self.ours is None and not self.not_checkable:
            raise BadInput(f"claim {self.id}: say what ours is, or why it is not checkable")
        if self.kind == "number" and not self.not_checkable:
            self.allowed()

    def allowed(self) -> float:
        """Tolerance as an absolute number in the claim's unit (``number``), or a share (``order``).

        Raises:
            BadInput: no number in ``paper``, or no such tolerance.
        """
        t = self.tolerance
        if t is None:
            if self.kind == "number" and not self.bound:
                raise BadInput(f"claim {self.id} needs a tolerance, 'last digit' or '5 %'")
            return 0.0
        if isinstance(t, (int, float)):
            return float(t)
        percent = re.fullmatch(r"\s*([\d.]+)\s*%\s*", t)
        if percent:
            share = float(percent[1]) / 100
            return share if self.kind == "order" else share * abs(float(self.paper))
        if t == "last digit" and isinstance(self.paper, str):
            return half_last_digit(self.paper)
        raise BadInput(
            f"claim {self.id}: tolerance {t!r} is no number, percentage or 'last digit' of a"
            " number written as printed"
        )


def half_last_digit(printed: str) -> float:
    """Half a unit of the last digit of a number as printed: 0.00005 for ``"254.0479"``."""
    mantissa, _, exponent = printed.lower().partition("e")
    decimals = len(mantissa.partition(".")[2])
    return 0.5 * 10.0 ** (int(exponent or 0) - decimals)


@dataclass(frozen=True)
class Figure:
    """A figure of the study.

    Args:
        caption: what it shows, one or two sentences.
        draw: function of the :class:`Results` that gives a figure made with ``slipctl.draw.plots``.
        source: the paper's figure it answers, ``"Fig. 5"``.
    """

    caption: str
    draw: Callable[[Results], Any]
    source: str = ""

    def __post_init__(self) -> None:
        check_kinds("Figure", Figure, vars(self))


@dataclass(frozen=True)
class Gains:
    """A controller or estimator of the study, and what ``slipctl certify STUDY`` asks about it.

    Args:
        name: short name, unique in the study.
        loop: loop in whose first case it runs; its parameters are what is asked about.
        system: what it is certified as, ``"super_twisting"``; see ``slipctl certify``.
        numbers: function of the loop that gives the system's numbers: gains as they are, bounds
            from the model.
        bounds: where the bounds come from, in words.
        condition: criterion that the paper itself states for its gains, ``"printed_48"``.
        source: of the gains.
        costs: function of the loop to the share of a bound left with half of a range, by its name.
        made: function of the loop that makes the system where it is one of this loop alone.
    """

    name: str
    loop: str
    system: str
    numbers: Callable[[Block], Mapping[str, float]]
    bounds: str = ""
    condition: str = ""
    source: str = ""
    costs: Callable[[Block], Mapping[str, float]] | None = None
    made: Callable[[Block], Any] | None = None

    def __post_init__(self) -> None:
        check_kinds("Gains", Gains, vars(self))


class Certificates(NamedTuple):
    """Gains of a study to certify, and why its other loops have none, by their name."""

    gains: Sequence[Gains]
    uncertified: Mapping[str, str]


@dataclass(frozen=True)
class Study:
    """A question, its loops and scenarios, the paper's answers beside ours; see the module text.

    Args:
        name: name of its module.
        title: what it is, a line.
        source: the paper.
        doc: the question, in a few sentences.
        models: blocks, or functions that make them, by the name under which ``--swap`` replaces
            them; ``cases`` gets them swapped.
        cases: ``cases(models, quick)``; the first one is ``base``.
        signals: what the metrics speak of.
        controller: part of a loop that ``slipctl c`` exports.
        check: ``check(name, loop, scenario)``, called for each loop before anything runs; it
            refuses (:class:`~slipctl.BadInput`) what cannot work.
        experiments: further computations by name.
        claims: the paper's claims.
        figures: figures by file stem.
        gains: what ``slipctl certify STUDY`` asks about; or a function that finds it and
            ``uncertified``, called where a certificate is asked for.
        plain: scenarios and experiments that run without ``--full``; of a study that has none of
            these scenarios, all do.
        ensembles: what ``slipctl tune`` draws, by scenario; the first that has the loop is taken.
        limits: largest accepted value of a metric, in its own unit; a run above one is marked.
        uncertified: why a loop has no gains to certify, by its name.
        short: the answer in a few sentences, as "In short" of its page has it.
        headline: id of the claim that it stands or falls with.
        without_effect: what of it has no effect, or is unusual, a line each; each run tells them.
    """

    name: str
    title: str
    source: str
    doc: str
    cases: Callable[[Mapping[str, Any], bool], Sequence[Case]]
    signals: Signals
    models: Mapping[str, Any] = field(default_factory=dict)
    controller: str = "ctl"
    check: Callable[[str, Block, Scenario], None] = lambda name, loop, scenario: None
    experiments: Mapping[str, Experiment] = field(default_factory=dict)
    claims: Sequence[Claim] = ()
    figures: Mapping[str, Figure] = field(default_factory=dict)
    gains: Sequence[Gains] | Callable[[], Certificates] = ()
    plain: Sequence[str] = ("base", "real")
    ensembles: Mapping[str, Ensemble] = field(default_factory=dict)
    limits: Mapping[str, float] = field(default_factory=dict)
    uncertified: Mapping[str, str] = field(default_factory=dict)
    short: str = ""
    headline: str = ""
    without_effect: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_kinds("Study", Study, vars(self))
        for name in self.limits:
            check_known(f"study {self.name}: a limit of", name, METRICS)
        seen: set[str] = set()
        for c in self.claims:
            if c.id in seen:
                raise BadInput(f"study {self.name} has two claims {c.id!r}")
            seen.add(c.id)
        if self.headline and self.headline not in seen:
            raise BadInput(f"study {self.name} has no claim {self.headline!r}")

    @cached_property
    def certificates(self) -> Certificates:
        """What can be asked of its loops, and why nothing of the others."""
        if callable(self.gains):
            return self.gains()
        return Certificates(self.gains, self.uncertified)

    def _repr_html_(self) -> str:
        return registry.view(self, "html")
