"""Nonlinear model predictive control: from any flow block to a step block."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from slipctl.block.block import Block, as_block, doc_of_maker
from slipctl.errors import BadInput, check_whole, split_options
from slipctl.predict.controller import Controller
from slipctl.predict.options import arguments
from slipctl.predict.options.arguments import Limit, Limits, Problem, Solver, by_name
from slipctl.predict.options.limits import Soft, limits_of
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
    name: str = "nmpc",
    **options: Any,
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
        name: name of the block.
        **options: fields of ``Problem`` (``weights``, ``terminal``, ``preview``, ``path``, ...),
            what is minimised; of ``Limits`` (``bounds``, ``rates``, ``soft``, ``hard``), within
            what; of ``Solver`` (``iterations``, ``solver``, ...), how. They stand in
            :mod:`slipctl.predict.options.arguments`.

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
    wish, limits, solver = split_options(where, options, Problem, Limits, Solver)
    controls = [control] if isinstance(control, str) else list(control)
    arguments.check_numbers(where, h, horizon, solver)
    if not controls:
        raise BadInput(f"{where}: give control=, one or more of {', '.join(plant.inputs)}")
    full = {c: plant.find(c, "input") for c in controls}
    ends = arguments.bounds_of(where, plant, full, by_name(where, "bounds", limits.bounds))
    rate = arguments.rates_of(where, controls, by_name(where, "rates", limits.rates))
    laws = _laws(where, wish)
    softs = limits_of(
        where, plant, laws, by_name(where, "soft", limits.soft), by_name(where, "hard", limits.hard)
    )
    _check_firm(where, softs.values(), solver)
    tied = arguments.tied_of(where, horizon, wish.moves)
    weighed = [cost, *(b for b in (wish.own_end, wish.economic) if b is not None)]
    weigh = arguments.weights_of(where, weighed, by_name(where, "weights", wish.weights))
    driven, unknown = plant, None
    if wish.offset_free != ():
        plant, unknown = with_constant_rates(where, plant, wish.offset_free, list(full.values()))
    factors = _factors(where, plant, wish, list(full.values()), horizon)
    if factors:
        softs = {f"{n}.{i}": s for n, s in softs.items() for i in range(len(factors))}
    long = lengths(where, wish.grow, int(horizon))
    scale = {c: arguments.scale_of(*ends[c]) for c in controls}
    problem = Horizon.of(
        with_time_scale(plant) if long else plant, cost, controls, wish.end_names, softs, horizon,
        h, wish.method, wish.substeps, scale, laws, long, factors, wish.shared or 0,
    )  # fmt: skip
    problem = replace(problem, damped=solver.damping != 0, exact=solver.hessian == "exact")
    problem = _with_end(where, problem, wish, weigh, unknown)
    ahead = _ahead(where, problem, wish, ends)
    made = Controller(where, problem, controls, ends, rate, softs, weigh, tied, solver, ahead)
    parts, how = [driven, cost, *laws.values()], (wish.method, wish.substeps)
    return made.block(name, h, parts, how, doc_of_maker(nmpc))


def _laws(where: str, wish: Problem) -> dict[str, Block]:
    """Further laws by the part that they are of the problem."""
    given = {
        "path": wish.path, "final": wish.final, "last": wish.own_end, "price": wish.economic,
    }  # fmt: skip
    laws = {k: as_block(f"{where}: {k}", v) for k, v in given.items() if v is not None}
    if wish.economic is not None and wish.ends_in_a_matrix:
        raise BadInput(f"{where}: economic= goes without 'lqr' and a matrix, which know no prices")
    return laws


def _check_firm(where: str, softs: Iterable[Soft], solver: Solver) -> None:
    """Refuse hard and linear limits that the solver cannot keep."""
    every = list(softs)
    if not solver.steps and any(s.hard or s.linear for s in every):
        raise BadInput(
            f"{where}: hard and linear limits need rescue= of 1 or more steps and no deadline="
        )
    if any(s.linear for s in every) and solver.solver in ("ipopt", "fatrop"):
        raise BadInput(f"{where}: {solver.solver} takes no linear limits; use solver='osqp'")


def _factors(where: str, plant: Block, wish: Problem, full: list[str], horizon: int) -> Factors:
    """Factors of the scenarios, none where there are none."""
    factors: Factors = ()
    if len(wish.scenarios):
        if wish.offset_free != () or wish.ends_in_a_matrix:
            raise BadInput(f"{where}: scenarios= goes without offset_free=, 'lqr' and a matrix")
        factors = factors_of(where, plant, wish.scenarios, full)
    if wish.shared is not None:
        check_whole(f"{where}: shared", wish.shared, 1)
        if not factors:
            raise BadInput(f"{where}: shared= is of scenarios=; give two or more")
        if wish.shared >= horizon:
            raise BadInput(
                f"{where}: shared = {wish.shared} stages of {horizon} leave none; leave it out"
            )
    return factors


def _with_end(
    where: str, problem: Horizon, wish: Problem, weigh: Mapping[str, float], unknown: Any
) -> Horizon:
    """The problem with what is not known, and with the matrix of its last stage."""
    point = by_name(where, "at", wish.at)
    if wish.offset_free != ():
        problem = with_unknown(where, problem, unknown, weigh, point)
    if wish.ends_in_a_matrix:
        if isinstance(wish.terminal, str) and wish.terminal == "lqr":
            return with_lqr(where, problem, weigh, point)
        return with_matrix(where, problem, weigh, point, wish.terminal)
    if wish.at and wish.offset_free == ():
        raise BadInput(
            f"{where}: at= is the point of terminal='lqr', a matrix or offset_free=; leave it out"
        )
    return problem


def _ahead(
    where: str, problem: Horizon, wish: Problem, ends: Mapping[str, tuple[Limit, Limit]]
) -> tuple[str, ...]:
    """Inputs of the controller that are known ahead."""
    own = (STRETCH, TOGETHER, *(problem.unknown.names if problem.unknown else ()))
    held = [n for n in problem.held if n not in own]
    named = [b for pair in ends.values() for b in pair]
    ahead = arguments.preview_names(where, wish.preview, [*held, *named])
    if wish.moves is not None and any(b in ahead for b in named):
        raise BadInput(f"{where}: moves= holds controls over stages; preview no bound with it")
    return ahead
