"""Nonlinear model predictive control: from any flow block to a step block."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from slipctl.block.block import Block, as_block, doc_of_maker
from slipctl.errors import BadInput, check_positive, check_whole
from slipctl.predict.controller import Controller
from slipctl.predict.options.arguments import (  # fmt: skip
    Limit,
    bounds_of,
    by_name,
    check_numbers,
    preview_names,
    rates_of,
    scale_of,
    tied_of,
    weights_of,
)
from slipctl.predict.options.limits import limits_of
from slipctl.predict.options.offset import with_constant_rates, with_unknown
from slipctl.predict.options.scenarios import TOGETHER, Factors, factors_of
from slipctl.predict.options.terminal import with_lqr, with_matrix
from slipctl.predict.stages.horizon import Horizon
from slipctl.predict.stages.stage_lengths import STRETCH, lengths, with_time_scale


def nmpc(
    plant: Block,
    cost: Block,
    control: str | Sequence[str],
    *,
    h: float,
    horizon: int = 20,
    weights: Mapping[str, float] | None = None,
    terminal: Sequence[str] | str | Block | Any = None,
    offset_free: str | Sequence[str] = (),
    at: Mapping[str, float] | None = None,
    preview: Sequence[str] = (),
    bounds: Mapping[str, tuple[Limit, Limit]] | None = None,
    rates: Mapping[str, float] | None = None,
    soft: Mapping[str, tuple[float | None, ...]] | None = None,
    hard: Mapping[str, tuple[float | None, float | None]] | None = None,
    economic: Block | None = None,
    path: Block | None = None,
    final: Block | None = None,
    moves: Sequence[int] | None = None,
    grow: float = 1.0,
    iterations: int = 1,
    hessian: str = "gauss_newton",
    damping: float = 0.0,
    search: bool = False,
    passes: int = 20,
    rescue: int = 60,
    deadline: bool = False,
    scenarios: Sequence[Mapping[str, float]] = (),
    shared: int | None = None,
    method: str = "rk4",
    substeps: int = 1,
    split: bool = False,
    solver: str = "riccati",
    name: str = "nmpc",
) -> Block:
    """Make a model predictive controller: each tick it solves an optimal control problem online.

    Multiple shooting with a Gauss-Newton Hessian, in real-time iterations (Diehl 2001). Each tick
    the last plan is shifted by a stage, the plant linearised along it, one quadratic program
    solved, and the first control applied. Inputs of the plant that are not controls, and the
    references of the cost, keep their present value over the horizon or are previewed.

    Args:
        plant: a flow. Its states are measured: they become inputs of the controller.
        cost: a law whose outputs are squared and summed. An input that has the name of a state,
            an output or an input of the plant reads it; any other is a reference, an input of the
            controller.
        control: inputs of the plant that are decided.
        h: length of a stage and period of the controller in s.
        horizon: number of stages.
        weights: weight of each output of the cost per its unit, by default 1.
        terminal: what counts in the last stage. Names of outputs of the cost, by default all that
            do not depend on the control; or a law of residuals of its own (their weights stand in
            ``weights`` too). Or ``"lqr"``, the cost to go of the linear quadratic regulator
            (:mod:`slipctl.predict.options.terminal`); or a matrix P, 1/2 (x - x_s)'P (x - x_s) with the
            best steady state x_s. The last two are of the plant linearised at ``at``, with the
            parameters and weights given here: what is set later does not change them. x_s follows
            the held inputs, linearly.
        offset_free: what is not known and constant, so that no offset stays: held inputs of the
            plant (a load, an adhesion), or states whose rate lacks something. Each tick estimates
            it from what the last one missed (:mod:`slipctl.predict.options.offset`); ``offset_share`` of
            that is learnt. It is no input of the controller then.
        at: the point for these two: values of states, controls and held inputs, else declared ones.
        preview: held inputs, and bounds with a name, that are known ahead: such an input of the
            controller is an array of horizon + 1 values, now and after each stage.
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
        economic: a law whose outputs, times their weights, are added to the cost as they are: air,
            energy, distance with a minus. The residuals of ``cost`` are what makes the problem
            convex. They are prices of every stage but the last.
        path: a law whose outputs are kept within their declared ``lo`` and ``hi`` at every stage;
            its inputs are read as those of the cost. They are hard, but for those that ``soft``
            names. final: the same at the end of the horizon alone.
        moves: number of stages over which each free control is held; their sum is the horizon.
        grow: length of each stage over the one before; the first is h. The cost of a stage counts
            by its length, a rate from the middle of one to that of the next.
        iterations: real-time iterations per tick.
        hessian: ``"gauss_newton"``, or ``"exact"`` with the curvature of residuals, prices and
            equations, made convex (:mod:`slipctl.predict.stages.exact_hessian`). It is for large residuals and
            for prices; limits are soft ones with squares then.
        damping: Levenberg's: curvature added to the cost of each iteration's step of a control,
            over its size. The steps get shorter and what they end at stays; 0 leaves it out.
        search: shorten the step of an iteration where cost and misses of the stages do not fall
            (:mod:`slipctl.predict.qp.line_search`).
        passes: largest number of passes of the active set in each.
        rescue: largest number of steps of the interior point method where they have not sufficed
            or went in a circle. 0 for none, where the time of a tick has to be short.
        deadline: make all passes in every tick and no step of the interior point method, so that
            each takes the same time. Where the passes do not suffice, ``status`` is 1.
        scenarios: factors of held inputs and parameters of the plant, ``[{"mu_p": 0.8}, {}]``. One
            plan is made for all of them, at equal shares of the cost and within the limits of each
            (:mod:`slipctl.predict.options.scenarios`).
        shared: stages whose controls the scenarios share; behind them each has its own, because by
            then it is known which one is true. By default they share all. Rates hold along each
            branch.
        method, substeps: integration over a stage, as of :func:`sampled`.
        split: the tick may be made in two: what can be done before the measurement, and the rest.
            In C those are ``<n>_prepare`` and ``<n>_feedback``. The held inputs count as they were
            when it was prepared; bounds with a name count as they are. The state is larger then.
        solver: ``"riccati"`` (:mod:`slipctl.predict.qp.active_set`; generated as C, float
            included). For comparison: the same iterations by ``"osqp"`` or ``"qrqp"``, and each
            tick solved to the end by ``"ipopt"`` or ``"fatrop"``; these run in Python only.
        name: name of the block.

    Returns:
        A step block with period h. Outputs: the controls, ``status``, ``passes`` made, and
        ``residual``, by how much the conditions of Karush, Kuhn and Tucker are left, over one and
        the size of the gradient. Status (:data:`slipctl.predict.controller.STATUS`) 0 is solved. 1
        is not settled: the controls are feasible but not optimal. 2: the problem broke, the next
        control of the last good plan is applied and the next tick starts afresh. 3: the limits
        contradict each other and some were given up. That is a bound where a rate does not lead
        back to it, or a hard limit where no control keeps it.

    Raises:
        BadInput: unknown names, bounds that leave nothing, a weight that is not positive, a
            horizon shorter than the lag of the actuator, a solver that is not there.
    """
    where = f"nmpc({as_block('nmpc: the plant', plant).name})"
    as_block(f"{where}: the cost", cost)
    controls = [control] if isinstance(control, str) else list(control)
    check_numbers(where, h, horizon, iterations, passes, rescue, solver)
    if not controls:
        raise BadInput(f"{where}: give control=, one or more of {', '.join(plant.inputs)}")
    full = {c: plant.find(c, "input") for c in controls}
    limits = bounds_of(where, plant, full, by_name(where, "bounds", bounds))
    rate = rates_of(where, controls, by_name(where, "rates", rates))
    own = terminal if isinstance(terminal, Block) else None
    given = {"path": path, "final": final, "last": own, "price": economic}
    laws = {k: as_block(f"{where}: {k}", v) for k, v in given.items() if v is not None}
    softs = limits_of(
        where, plant, laws, by_name(where, "soft", soft), by_name(where, "hard", hard)
    )
    firm = any(s.hard or s.linear for s in softs.values())
    rescue = 0 if deadline else rescue
    if not rescue and firm:
        raise BadInput(
            f"{where}: hard and linear limits need rescue= of 1 or more steps and no deadline="
        )
    if any(s.linear for s in softs.values()) and solver in ("ipopt", "fatrop"):
        raise BadInput(f"{where}: {solver} takes no linear limits; use solver='osqp'")
    scale = {c: scale_of(*limits[c]) for c in controls}
    tied = tied_of(where, horizon, moves)
    weighed = [cost, *(b for b in (own, economic) if b is not None)]
    weigh = weights_of(where, weighed, by_name(where, "weights", weights))
    names = terminal if isinstance(terminal, (list, tuple)) and _all_names(terminal) else None
    driven = plant
    if offset_free != ():
        plant, unknown = with_constant_rates(where, plant, offset_free, list(full.values()))
    factors: Factors = ()
    if len(scenarios):
        if offset_free != () or not (terminal is None or own or names is not None):
            raise BadInput(f"{where}: scenarios= goes without offset_free=, 'lqr' and a matrix")
        factors = factors_of(where, plant, scenarios, list(full.values()))
        softs = {f"{n}.{i}": s for n, s in softs.items() for i in range(len(factors))}
    if shared is not None:
        check_whole(f"{where}: shared", shared, 1)
        if not factors:
            raise BadInput(f"{where}: shared= is of scenarios=; give two or more")
        if shared >= horizon:
            raise BadInput(
                f"{where}: shared = {shared} stages of {horizon} leave none; leave it out"
            )
    if economic is not None and not (terminal is None or own or names is not None):
        raise BadInput(f"{where}: economic= goes without 'lqr' and a matrix, which know no prices")
    long = lengths(where, grow, int(horizon))
    if long:
        plant = with_time_scale(plant)
    problem = Horizon.of(
        plant,
        cost,
        controls,
        names,
        softs,
        horizon,
        h,
        method,
        substeps,
        scale,
        laws,
        long,
        factors,
        shared or 0,
    )
    if split and solver != "riccati":
        raise BadInput(f"{where}: {solver} solves a tick as a whole; leave split= out")
    if search and solver in ("ipopt", "fatrop"):
        raise BadInput(f"{where}: {solver} makes no iterations of ours; leave search= out")
    if damping != 0:
        check_positive(f"{where}: damping", damping)
        if solver in ("ipopt", "fatrop"):
            raise BadInput(f"{where}: {solver} makes no iterations of ours; leave damping= out")
        problem = replace(problem, damped=True)
    if hessian not in ("gauss_newton", "exact"):
        raise BadInput(f"{where}: hessian = {hessian!r}; give 'gauss_newton' or 'exact'")
    if hessian == "exact":
        if solver in ("ipopt", "fatrop"):
            raise BadInput(f"{where}: {solver} makes no iterations of ours; leave hessian= out")
        problem = replace(problem, exact=True)
    point = by_name(where, "at", at)
    if offset_free != ():
        problem = with_unknown(where, problem, unknown, weigh, point)
    if terminal is not None and own is None and names is None:
        if isinstance(terminal, str) and terminal == "lqr":
            problem = with_lqr(where, problem, weigh, point)
        else:
            problem = with_matrix(where, problem, weigh, point, terminal)
    elif at and offset_free == ():
        raise BadInput(
            f"{where}: at= is the point of terminal='lqr', a matrix or offset_free=; leave it out"
        )
    own_ones = (STRETCH, TOGETHER, *(problem.unknown.names if problem.unknown else ()))
    held = [n for n in problem.held if n not in own_ones]
    ahead = preview_names(where, preview, [*held, *(b for p in limits.values() for b in p)])
    if moves is not None and any(b in ahead for p in limits.values() for b in p):
        raise BadInput(f"{where}: moves= holds controls over stages; preview no bound with it")
    return Controller(
        where, problem, controls, limits, rate, softs, weigh, tied, int(iterations),
        (int(passes), int(rescue), bool(deadline)), solver, ahead, float(damping), bool(split),
        bool(search),
    ).block(name, h, [driven, cost, *laws.values()], (method, substeps), doc_of_maker(nmpc))  # fmt: skip


def _all_names(given: Sequence[Any]) -> bool:
    return all(isinstance(n, str) for n in given)
