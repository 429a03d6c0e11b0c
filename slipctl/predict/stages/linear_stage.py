"""The linear step, Hessian and limits of one stage, in few operations and little code.

An explicit method is differentiated as it goes. Of x' = f(x, u), with F = df/dx and G = df/du, a
substep carries the slopes of its x by S' = F S + (0, G), begun at the identity. Those of the
substeps are multiplied. So one small function is called for each of them. What depends on
parameters and weights alone is computed once for all stages.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from slipctl.block.block import Block
from slipctl.block.text.intermediates import collect_locals, elements, function
from slipctl.errors import BadInput
from slipctl.predict.qp.common_factors import split_by_inputs
from slipctl.predict.stages.horizon import Horizon, Layout, expressions

UNROLL = 200_000
"""Instructions of one stage above which the problem is refused: the C code would not compile."""

EXPLICIT = {"euler": ((), (1.0,)), "rk4": ((1 / 2, 1 / 2, 1.0), (1.0, 2.0, 2.0, 1.0))}
"""Methods: how far each rate leads to the next one, and the weights of the rates."""


def stage_functions(
    where: str, problem: Horizon
) -> tuple[ca.Function, ca.Function, Layout, ca.Function]:
    """Functions of a stage of a problem.

    Returns:
        Function q -> column of what all stages share; Function (x, v, d, that column, next x) ->
        column of a stage, and how it is packed; Function (x, v, d, that column) -> next x.

    Raises:
        BadInput: the plant cannot be differentiated, or the stage is too large.
    """
    motion, repeats = motion_of(where, problem)
    rows, pieces = problem.rows()
    A, B = slope_sparsity(motion.sparsity_out(1), motion.sparsity_out(2), repeats)
    layout = Layout((A, B, ca.Sparsity.dense(problem.nx, 1), *pieces))
    once_motion, motion = split_by_inputs(motion, (3,))
    once_rows, rows = split_by_inputs(rows, (3,))
    count = motion.n_instructions() * repeats + rows.n_instructions()
    if count > UNROLL:
        raise BadInput(
            f"{where}: one stage takes {count} instructions; use fewer substeps, or a smaller plant"
        )
    q = ca.MX.sym("q", problem.nq)
    whole = ca.vertcat(once_motion(q), once_rows(q))
    once = ca.Function("shared", [q], [whole], ["q"], ["column"])
    ends = [0, once_motion.size1_out(0), once.size1_out(0)]
    sizes = {"point": problem.nx, "control": problem.nu, "d": problem.nd, "fixed": ends[-1]}
    sizes |= {"after": problem.nx}
    x, u, d, c, following = (ca.MX.sym(n, k) for n, k in sizes.items())
    of_motion, of_rows = ca.vertsplit(c, ends)
    after, S, Su = motion(x, u, d, of_motion)
    S, Su = ca.project(S, A), ca.project(Su, B)
    product = substep_slopes(motion, A, B)
    for _ in range(repeats - 1):
        after, F, G = motion(after, u, d, of_motion)
        S, Su = product(F, G, S, Su)
    packed = ca.vec(S).nz[:], ca.vec(Su).nz[:], after - following, rows(x, u, d, of_rows)
    names = ["point", "control", "d", "fixed"]
    stage = ca.Function("stage", [x, u, d, c, following], [ca.vertcat(*packed)],
                        [*names, "point_after"], ["column"])  # fmt: skip
    step = ca.Function("stage_step", [x, u, d, c], [after], names, ["point_next"])
    return once, stage, layout, step


def motion_of(where: str, problem: Horizon) -> tuple[ca.Function, int]:
    """Function (x, v, d, q) -> (x, A, B) of a substep, and how many of them make a stage."""
    explicit = problem.over[0] in EXPLICIT
    motion = (_substep if explicit else _whole)(where, problem)
    return motion, problem.over[1] if explicit else 1


def slope_sparsity(F: Any, G: Any, repeats: int) -> tuple[Any, Any]:
    """Sparsity of the slopes after a stage of so many substeps with those of one."""
    A, B = ca.DM(F, 1), ca.DM(G, 1)
    S, Su = A, B
    for _ in range(repeats - 1):
        S, Su = ca.sparsify(A @ S), ca.sparsify(A @ Su + B)
        S, Su = ca.DM(S.sparsity() + F, 1), ca.DM(Su.sparsity() + G, 1)
    return S.sparsity(), Su.sparsity()


def substep_slopes(motion: ca.Function, A: Any, B: Any) -> ca.Function:
    """Function (F, G, S, Su) -> slopes after one more substep."""
    F, G = (ca.SX.sym("FG"[i], motion.sparsity_out(1 + i)) for i in (0, 1))
    S, Su = ca.SX.sym("S", A), ca.SX.sym("Su", B)
    found = [ca.project(F @ S, A), ca.project(F @ Su + G, B)]
    names = ["F", "G", "S", "Su"], ["S_next", "Su_next"]
    return ca.Function("slopes", [F, G, S, Su], found, *names, {"cse": True})


def _whole(_: str, problem: Horizon) -> ca.Function:
    """Function (x, v, d, q) -> (next x, A, B) of a stage."""
    x, u, d, _p = problem.symbols()
    q = ca.SX.sym("q", problem.nq)
    n, _y = problem.step()(x, u * ca.DM(problem.scale), d, q[: problem.np_])
    n, slopes = ca.densify(n), [ca.jacobian(n, x), ca.jacobian(n, u)]
    names = ["point", "control", "d", "q"], ["point_next", "S", "Su"]
    return ca.Function("motion", [x, u, d, q], [n, *slopes], *names, {"cse": True})


def _substep(where: str, problem: Horizon) -> ca.Function:
    """Function (x, v, d, q) -> (x, S, slope by v) after a substep."""
    method, substeps = problem.over
    dt = (problem.model.period or 0.0) / substeps
    nodes, weights = EXPLICIT[method]
    x, u, d, p = problem.symbols()
    q = ca.SX.sym("q", problem.nq)
    inputs = problem._inputs(u * ca.DM(problem.scale), d)
    rate = expressions(where, problem.flow)(x, inputs, p)[0]
    sloped = ca.Function("rate", [x, u, d, p], [rate, ca.jacobian(rate, x), ca.jacobian(rate, u)])
    named = _named(problem.flow, x, inputs, p)
    inside = ca.Function("inside", [x, u, d, p], [v for _, v in named])
    found: list[tuple[str, Any]] = []

    def after(begin: tuple[Any, Any, Any], way: float, k: tuple[Any, Any, Any]) -> Any:
        return tuple(a + way * dt * b for a, b in zip(begin, k, strict=True))

    start = (x, ca.SX.eye(problem.nx), ca.SX(problem.nx, problem.nu))
    at, rates = start, []
    for k, way in enumerate((*nodes, 0.0), start=1):
        given = at[0], u, d, q[: problem.np_]
        f, F, G = sloped(*given)
        rates.append((f, F @ at[1], F @ at[2] + G))
        found += [(f"{n}_{k}", v) for (n, _), v in zip(named, inside.call(given), strict=True)]
        letters = {"at": at[0], "S": at[1], "Su": at[2], "rate": f, "F": F, "G": G,
                   "dS": rates[-1][1], "dSu": rates[-1][2]}  # fmt: skip
        found += [x for n, v in letters.items() for x in elements(f"{n}_{k}", v)]
        at = after(start, way, rates[-1])
    total = tuple(sum(w * k[i] for w, k in zip(weights, rates, strict=True)) for i in range(3))
    n, S, Su = after(start, 1 / sum(weights), total)  # type: ignore[arg-type]
    names = ["point", "control", "d", "q"], ["point_next", "S", "Su"]
    return function(found, "motion", [x, u, d, q], [ca.densify(n), S, Su], *names)


def _named(flow: Block, x: Any, u: Any, p: Any) -> list[tuple[str, Any]]:
    """What a plant calls its outputs and intermediate results, and what they are of x, u, p."""
    if not flow.sx:
        return []
    outputs = flow.unpack("output", flow.f(x, u, p)[1])
    own_outputs = [e for n, v in outputs.items() for e in elements(n.rpartition(".")[2], v)]
    with collect_locals() as found:
        groups = zip(("state", "input", "param"), (x, u, p), strict=True)
        flow.expr(*(flow.unpack(role, v) for role, v in groups))
    own = {s.element_hash() for v in (x, u, p) for s in ca.symvar(ca.SX(v))}
    return own_outputs + [
        (n, v) for n, v in found
        if isinstance(v, ca.SX) and {s.element_hash() for s in ca.symvar(v)} <= own
    ]  # fmt: skip
