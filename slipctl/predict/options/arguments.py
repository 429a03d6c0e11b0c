"""What a predictive controller is asked for: bounds, rates, weights and moves, checked."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from slipctl.block.block import Block
from slipctl.errors import BadInput, check_known, check_number, check_positive, check_whole
from slipctl.predict.options.limits import entries_of
from slipctl.predict.reference import available

SOLVERS = ("riccati", "osqp", "qrqp", "ipopt", "fatrop")

Limit = float | str
"""A bound of a control: a number, or the name of the input that it is."""


@dataclass(frozen=True)
class Problem:
    """What a predictive controller minimises over which stages.

    Attributes:
        weights: weight of each output of the cost per its unit, by default 1.
        terminal: what counts in the last stage. Names of outputs of the cost, by default all that
            do not depend on the control; or a law of residuals of its own (their weights stand in
            ``weights`` too). Or ``"lqr"``, the cost to go of the linear quadratic regulator
            (:mod:`slipctl.predict.options.terminal`); or a matrix P, 1/2 (x - x_s)'P (x - x_s) with
            the best steady state x_s. The last two are of the plant linearised at ``at``, with the
            parameters and weights given here: what is set later does not change them. x_s follows
            the held inputs, linearly.
        offset_free: what is not known and constant, so that no offset stays: held inputs of the
            plant (a load, an adhesion), or states whose rate lacks something. Each tick estimates
            it from what the last one missed (:mod:`slipctl.predict.options.offset`);
            ``offset_share`` of that is learnt. It is no input of the controller then.
        at: the point for these two: values of states, controls and held inputs, else declared ones.
        preview: held inputs, and bounds with a name, that are known ahead: such an input of the
            controller is an array of horizon + 1 values, now and after each stage.
        economic: a law whose outputs, times their weights, are added to the cost as they are: air,
            energy, distance with a minus. The residuals of ``cost`` are what makes the problem
            convex. They are prices of every stage but the last.
        path: a law whose outputs are kept within their declared ``lo`` and ``hi`` at every stage;
            its inputs are read as those of the cost. They are hard, but for those that ``soft``
            names. final: the same at the end of the horizon alone.
        moves: number of stages over which each free control is held; their sum is the horizon.
        grow: length of each stage over the one before; the first is h. The cost of a stage counts
            by its length, a rate from the middle of one to that of the next.
        scenarios: factors of held inputs and parameters of the plant, ``[{"mu_p": 0.8}, {}]``. One
            plan is made for all of them, at equal shares of the cost and within the limits of each
            (:mod:`slipctl.predict.options.scenarios`).
        shared: stages whose controls the scenarios share; behind them each has its own, because by
            then it is known which one is true. By default they share all. Rates hold along each
            branch.
        method, substeps: integration over a stage, as of :func:`sampled`.
    """

    weights: Mapping[str, float] | None = None
    terminal: Sequence[str] | str | Block | Any = None
    offset_free: str | Sequence[str] = ()
    at: Mapping[str, float] | None = None
    preview: Sequence[str] = ()
    economic: Block | None = None
    path: Block | None = None
    final: Block | None = None
    moves: Sequence[int] | None = None
    grow: float = 1.0
    scenarios: Sequence[Mapping[str, float]] = ()
    shared: int | None = None
    method: str = "rk4"
    substeps: int = 1

    @property
    def own_end(self) -> Block | None:
        """Residuals of its own that count in the last stage."""
        return self.terminal if isinstance(self.terminal, Block) else None

    @property
    def end_names(self) -> Sequence[str] | None:
        """Outputs of the cost that count in the last stage, where they are named."""
        given = self.terminal
        if isinstance(given, (list, tuple)) and all(isinstance(n, str) for n in given):
            return given
        return None

    @property
    def ends_in_a_matrix(self) -> bool:
        """Whether the last stage counts by a matrix, given or of the regulator."""
        return not (self.terminal is None or self.own_end or self.end_names is not None)


@dataclass(frozen=True)
class Limits:
    """What a predictive controller keeps within.

    Attributes:
        bounds: (lo, hi) of a control, by default its declared range. A name instead of a number
            is an input of the controller (the limit of an anti-slip law, say).
        rates: largest rate of a control, in its unit per second.
        soft: (lo, hi, weight) of an output or state of the plant; None for a limit is the declared
            one. The weighted excess is squared and added to the cost. (lo, hi, weight, linear)
            adds the excess itself too, times ``linear``: an exact penalty, which keeps the limit
            as long as that is worth less; ``weight`` may be 0 there.
        hard: (lo, hi) of an output or state of the plant, None for a declared one. Kept at every
            stage where any control allows it. Where none does, the bounds and rates of the
            controls are kept. Then the sum of what the hard limits are exceeded by, each over its
            size, is made as small as can be, then the cost; ``status`` is 3.
    """

    bounds: Mapping[str, tuple[Limit, Limit]] | None = None
    rates: Mapping[str, float] | None = None
    soft: Mapping[str, tuple[float | None, ...]] | None = None
    hard: Mapping[str, tuple[float | None, float | None]] | None = None


@dataclass(frozen=True)
class Solver:
    """How a predictive controller solves its problem in a tick.

    Attributes:
        iterations: real-time iterations per tick.
        hessian: ``"gauss_newton"``, or ``"exact"`` with the curvature of residuals, prices and
            equations, made convex (:mod:`slipctl.predict.stages.exact_hessian`). It is for large
            residuals and for prices; limits are soft ones with squares then.
        damping: Levenberg's: curvature added to the cost of each iteration's step of a control,
            over its size. The steps get shorter and what they end at stays; 0 leaves it out.
        search: shorten the step of an iteration where cost and misses of the stages do not fall
            (:mod:`slipctl.predict.qp.line_search`).
        passes: largest number of passes of the active set in each.
        rescue: largest number of steps of the interior point method where they have not sufficed
            or went in a circle. 0 for none, where the time of a tick has to be short.
        deadline: make all passes in every tick and no step of the interior point method, so that
            each takes the same time. Where the passes do not suffice, ``status`` is 1.
        split: the tick may be made in two: what can be done before the measurement, and the rest.
            In C those are ``<n>_prepare`` and ``<n>_feedback``. The held inputs count as they were
            when it was prepared; bounds with a name count as they are. The state is larger then.
        solver: ``"riccati"`` (:mod:`slipctl.predict.qp.active_set`; generated as C, float
            included). For comparison: the same iterations by ``"osqp"`` or ``"qrqp"``, and each
            tick solved to the end by ``"ipopt"`` or ``"fatrop"``; these run in Python only.
    """

    iterations: int = 1
    hessian: str = "gauss_newton"
    damping: float = 0.0
    search: bool = False
    passes: int = 20
    rescue: int = 60
    deadline: bool = False
    split: bool = False
    solver: str = "riccati"

    @property
    def steps(self) -> int:
        """Largest number of steps of the interior point method."""
        return 0 if self.deadline else self.rescue

    def check(self, where: str) -> None:
        """Refuse settings that are no numbers of their kind, and what does not go together.

        Raises:
            BadInput: says what to write.
        """
        check_whole(f"{where}: rescue", self.rescue, 0)
        for word in ("iterations", "passes"):
            check_whole(f"{where}: {word}", getattr(self, word))
        if self.solver not in SOLVERS:
            raise BadInput(f"{where} has no solver {self.solver!r}; it has {', '.join(SOLVERS)}")
        if self.solver != "riccati":
            available(where, self.solver)
        if self.hessian not in ("gauss_newton", "exact"):
            raise BadInput(f"{where}: hessian = {self.hessian!r}; give 'gauss_newton' or 'exact'")
        if self.split and self.solver != "riccati":
            raise BadInput(f"{where}: {self.solver} solves a tick as a whole; leave split= out")
        if self.damping != 0:
            check_positive(f"{where}: damping", self.damping)
        if self.solver in ("ipopt", "fatrop"):
            for word, left in (("search", False), ("damping", 0), ("hessian", "gauss_newton")):
                if getattr(self, word) != left:
                    raise BadInput(
                        f"{where}: {self.solver} makes no iterations of ours; leave {word}= out"
                    )


def check_numbers(where: str, h: float, horizon: int, solver: Solver) -> None:
    """Refuse settings that are no numbers of their kind, and a solver that is not there."""
    check_positive(f"{where}: h", h, "s")
    check_whole(f"{where}: horizon", horizon)
    solver.check(where)


def bounds_of(
    where: str, plant: Block, full: Mapping[str, str], given: Mapping[str, tuple[Limit, Limit]]
) -> dict[str, tuple[Limit, Limit]]:
    """(lo, hi) of each control, as given or declared."""
    for n in given:
        check_known(f"{where}: bounds of", n, full, ", which is no control")
    found = {}
    for c, n in full.items():
        s = plant.inputs[n]
        lo, hi = entries_of(f"{where}: bounds of {c}", given.get(c, (s.lo, s.hi)), "(lo, hi)")
        for b in (lo, hi):
            if not isinstance(b, str):
                check_number(f"{where}: bounds of {c}: an end", b, s.unit)
        if not isinstance(lo, str) and not isinstance(hi, str) and not lo < hi:
            raise BadInput(
                f"{where}: {c} from {lo:g} to {hi:g} {s.unit} leaves nothing; give lo < hi"
            )
        for b in (lo, hi):
            if isinstance(b, str) and not b.isidentifier():
                raise BadInput(f"{where}: {b!r} is no name for the input that bounds {c}")
            if not isinstance(b, str) and not math.isfinite(b):
                raise BadInput(
                    f"{where}: {c} is unbounded; give bounds={{{c!r}: (lo, hi)}} in {s.unit}"
                )
        found[c] = (lo, hi)
    return found


def by_name(where: str, what: str, given: Any) -> dict[str, Any]:
    """Settings by name, none where they are left out."""
    if not isinstance(given, Mapping | None):
        raise BadInput(f"{where}: {what} = {given!r}; give {what}={{name: ...}}")
    return dict(given or {})


def scale_of(lo: Limit, hi: Limit) -> float:
    """Size of a control: its largest bound that is a number."""
    numbers = [abs(b) for b in (lo, hi) if not isinstance(b, str)]
    return max(numbers, default=1.0) or 1.0


def rates_of(where: str, controls: Sequence[str], rates: Mapping[str, float]) -> dict[str, float]:
    """Largest rates by control."""
    for c, r in rates.items():
        check_known(f"{where}: rate of", c, controls, ", which is no control")
        check_positive(f"{where}: rate of {c}", r)
    return dict(rates)


def weights_of(where: str, laws: Sequence[Block], weights: Mapping[str, float]) -> dict[str, float]:
    """Weights of the residuals of all laws, by default 1."""
    names = [n for block in laws for n in block.outputs]
    for n in names:
        if names.count(n) > 1:
            raise BadInput(f"{where}: two laws have a residual {n!r}; rename one")
    for n, w in weights.items():
        check_known(f"{where}: the cost has no residual", n, names)
        check_positive(f"{where}: weight of {n}", w)
    return {n: float(weights.get(n, 1.0)) for n in names}


def tied_of(where: str, horizon: int, moves: Sequence[int] | None) -> list[bool]:
    """Whether the controls of each stage are those of the stage before."""
    if moves is None:
        return [False] * horizon
    if not isinstance(moves, Sequence):
        raise BadInput(f"{where}: moves = {moves!r} is no list of whole numbers")
    for m in moves:
        check_whole(f"{where}: moves: a length", m)
    if sum(moves) != horizon:
        raise BadInput(f"{where}: moves = {list(moves)} must have the sum {horizon}")
    return [k > 0 for m in moves for k in range(int(m))]


def preview_names(where: str, preview: Sequence[str], known: Sequence[Limit]) -> tuple[str, ...]:
    """Names of inputs that are known ahead."""
    if isinstance(preview, str) or not isinstance(preview, Sequence):
        raise BadInput(f"{where}: preview = {preview!r}; give a list of names of inputs")
    names = [n for n in known if isinstance(n, str)]
    for n in preview:
        check_known(f"{where}: preview of", n, names, ", which is no held input or named bound")
    return tuple(preview)
