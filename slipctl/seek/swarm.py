"""Particle swarms: minimise a law over several of its inputs; least squares as the reference."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from slipctl.analysis import objective
from slipctl.block.block import Block, Exprs, as_block, doc_of_maker, make_block
from slipctl.block.signals import Output, Param, Signal, real_array
from slipctl.errors import BadInput, check_number, check_positive, check_ranges, check_whole
from slipctl.seek import random as wh
from slipctl.seek.evolution import BLOCK, repeat_step


def particle_swarm(
    law: Block,
    over: Mapping[str, tuple[float, float]],
    minimise: str | None = None,
    *,
    particles: int = 40,
    iterations: int = 100,
    inertia: float | Callable[[Any], Any] = 0.73,
    c1: float = 1.5,
    c2: float = 1.5,
    clamp: float | Sequence[float] = 0.5,
    seed: int = 1,
) -> Block:
    """Search the minimum of a law over some of its inputs by a particle swarm.

    Each iteration v+ = w v + c1 r1 (own best - x) + c2 r2 (best of all - x), limited to ``clamp``
    of the range, and x+ = x + v+, stopped at the range. Particles move one after the other and see
    the best of all of the iteration before. Each tick is a whole search, drawn afresh.

    Args:
        law: from the variables and further inputs and parameters to the objective.
        over: inputs that are varied, with (lowest, highest).
        minimise: output that is minimised; may be left out if there is only one.
        particles, iterations: of one search.
        inertia: w, a number, or a function of the share of the iterations that are done, 1/G to 1.
        c1, c2: pull to the own best and to the best of all.
        clamp: largest step as share of the range, one number or one per variable.
        seed: of the random numbers, which are block state.

    Returns:
        A step block. Inputs: the law's other inputs and its parameters. Outputs: one per variable,
        and ``value``.

    Raises:
        BadInput: unknown names, an empty range, or settings that make no search.
    """
    where = f"particle_swarm({as_block('particle_swarm: the law', law).name})"
    check_ranges(where, over)
    names = list(over)
    for name in names:
        minimise = objective.objective(where, law, name, minimise)
    check_whole(f"{where}: particles", particles, 2, 1000)
    check_whole(f"{where}: iterations", iterations)
    settings = _settings(where, inertia, c1, c2, clamp, len(names))
    assert minimise is not None
    given, value_of = objective.open_law(law, names, minimise)
    n, d, m = int(particles), len(names), value_of.size1_in(1)
    low_hi = np.array([over[k] for k in names])
    lo, span = ca.DM(low_hi[:, 0]), ca.DM(low_hi[:, 1] - low_hi[:, 0])
    objective.refuse_names(where, law, ["rng", *(s.name for s in settings)])
    first = _first(value_of, d, m, lo, span).mapaccum("particles", n)
    weight = inertia if callable(inertia) else None
    iteration = _iteration(value_of, n, d, m, lo, span, weight, int(iterations))
    search, best_of = repeat_step(iteration, int(iterations)), _best(n, d)

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        at = objective.column(given, u, p)
        rngs, places, values = first(x["rng"], ca.repmat(at, 1, n))
        start = ca.vertcat(
            1, rngs[:, -1], ca.vec(places), ca.MX.zeros(n * d), ca.vec(places), values.T
        )
        steps = p["clamp"] * span
        constants = ca.vertcat(at, p.get("inertia", 0), p["c1"], p["c2"], steps)
        _, rng, _, _, best, value = _parts(
            search(start, constants, wh.rounder()(x["rng"])), n, d
        )  # fmt: skip
        place, least = best_of(best, value)
        return {"rng": rng}, {k: place[i] for i, k in enumerate(names)} | {"value": least}

    return make_block(
        "particle_swarm", "step", body,
        states=[wh.random_state(seed)], inputs=objective.of_role("input", given),
        params=[*settings, *objective.of_role("param", given)],
        outputs=[*(Output(law.inputs[k].unit, f"best {law.inputs[k].doc}").named(k)
                   for k in names), objective.value_there(law, minimise)],
        sx=False, doc=doc_of_maker(particle_swarm),
        choices={"law": law.name, "particles": n, "iterations": int(iterations),
                 "over": ", ".join(f"{k} {a:g}..{b:g}" for k, (a, b) in over.items()),
                 "seed": int(seed)} | ({"inertia": "a function"} if callable(inertia) else {}),
    )  # fmt: skip


def _settings(
    where: str, inertia: float | Callable[[Any], Any], c1: float, c2: float,
    clamp: float | Sequence[float], variables: int,
) -> list[Signal]:  # fmt: skip
    """Parameters of a swarm; an inertia that is a function is none."""
    clamps = np.ravel(np.asarray(clamp, dtype=object))
    numbers = [("c1", c1), ("c2", c2), *(("clamp", c) for c in clamps)]
    for what, number in numbers if callable(inertia) else [("inertia", inertia), *numbers]:
        check_number(f"{where}: {what}", number)
    clamps = clamps.astype(float)
    if clamps.size not in (1, variables):
        raise BadInput(f"{where}: clamp has {clamps.size} numbers; give one, or {variables}")
    one = clamps.size == 1
    settings = [
        Param("1", float(c1), "pull to the own best", lo=0, hi=4).named("c1"),
        Param("1", float(c2), "pull to the best of all", lo=0, hi=4).named("c2"),
        Param("1", float(clamps[0]) if one else clamps, "largest step, of the range",
              lo=1e-9, hi=1, shape=() if one else (variables,)).named("clamp"),
    ]  # fmt: skip
    if not callable(inertia):
        settings.insert(0, Param("1", float(inertia), "inertia", lo=0, hi=2).named("inertia"))
    return settings


def _parts(z: Any, n: int, d: int) -> tuple[Any, Any, Any, Any, Any, Any]:
    """Iteration, rng, places, steps, own bests (d by n each) and their values of a state."""
    edges = [0, 1, 4, *(4 + k * n * d for k in (1, 2, 3)), 4 + n * (3 * d + 1)]
    i, rng, x, v, own, values = ca.vertsplit(z, edges)
    return i, rng, *(ca.reshape(k, d, n) for k in (x, v, own)), values


def _first(value_of: ca.Function, d: int, m: int, lo: ca.DM, span: ca.DM) -> ca.Function:
    """Function (rng, given) -> (rng, place, value) of a particle drawn over the ranges."""
    rng, at = ca.SX.sym("rng", 3), ca.SX.sym("at", m)
    state, drawn = rng, []
    for _ in range(d):
        state = wh.advance(state)
        drawn.append(wh.uniform(state))
    place = lo + span * ca.vertcat(*drawn)
    return ca.Function("first", [rng, at], [state, place, value_of(place, at)], {"cse": True})


def _iteration(
    value_of: ca.Function, n: int, d: int, m: int, lo: ca.DM, span: ca.DM,
    schedule: Callable[[Any], Any] | None, iterations: int,
) -> ca.Function:  # fmt: skip
    """Function (state, constants, K) -> state of one iteration; see :func:`_parts`.

    The random numbers are the three parts of the generator, one after the other. A number of K is
    for :func:`wichmann_hill.quick_floor`. Several particles make one piece of straight-line code.
    """
    rng, x, v, own = (ca.SX.sym(k, size) for k, size in (("r", 3), ("x", d), ("v", d), ("b", d)))
    least, best, K = ca.SX.sym("least"), ca.SX.sym("best", d), ca.SX.sym("K", 2)
    c, whole = ca.SX.sym("c", m + 3 + d), wh.quick_floor(K)
    w, c1, c2, most = ca.vertsplit(c[m:], [0, 1, 2, 3, 3 + d])
    state, drawn, steps = rng, [], []
    for k in range(2 * d):
        state = wh.advance(state, whole) if k % 3 == 0 else state
        drawn.append(state[k % 3] * (1 / wh.MODULI[k % 3]))
    for i in range(d):
        r1, r2 = drawn[2 * i : 2 * i + 2]
        step = w * v[i] + c1 * r1 * (own[i] - x[i]) + c2 * r2 * (best[i] - x[i])
        steps.append(ca.fmin(most[i], ca.fmax(-most[i], step)))
    moved = ca.vertcat(*steps)
    place = ca.fmin(lo + span, ca.fmax(lo, x + moved))
    value = value_of(place, c[:m])
    better = value < least
    one = ca.Function(
        "particle", [rng, x, v, own, least, best, c, K],
        [state, place, moved, ca.if_else(better, place, own), ca.if_else(better, value, least)],
        {"cse": True},
    )  # fmt: skip
    size = max(k for k in range(1, BLOCK + 1) if n % k == 0)
    several = _several(one, size)
    z, constants = ca.MX.sym("z", 4 + n * (3 * d + 1)), ca.MX.sym("constants", m + 3 + d)
    KK = ca.MX.sym("K", 2)
    i, r, X, V, B, values = _parts(z, n, d)
    place_of_all, _ = _best(n, d)(B, values)
    used = constants
    if schedule is not None:
        used = ca.vertcat(constants[:m], schedule(i / iterations), constants[m + 1 :])
    columns = [ca.reshape(k, -1, n // size) for k in (X, V, B, values)]
    same = (ca.repmat(k, 1, n // size) for k in (place_of_all, used, KK))
    rs, *moved_on = several.mapaccum("swarm", n // size)(r, *columns, *same)
    after = ca.vertcat(i + 1, rs[:, -1], *(ca.vec(k) for k in moved_on))
    return ca.Function("iteration", [z, constants, KK], [after])


def _several(one: ca.Function, size: int) -> ca.Function:
    """Function of one particle, made for ``size`` of them, one after the other."""
    rng, *shared = (ca.SX.sym(f"s{k}", one.size1_in(k)) for k in (0, 5, 6, 7))
    flat = [ca.SX.sym(f"p{k}", one.size1_in(k) * size) for k in (1, 2, 3, 4)]
    own = [ca.reshape(k, -1, size) for k in flat]
    state: Any = rng
    found = []
    for j in range(size):
        state, *after = one(state, *(k[:, j] for k in own), *shared)
        found.append(after)
    results = [ca.vertcat(*k) for k in zip(*found, strict=True)]
    return ca.Function("particles", [rng, *flat, *shared], [state, *results], {"cse": True})


def _best(n: int, d: int) -> ca.Function:
    """Function (places, values) -> (place, value) of the first smallest one."""
    x, v = ca.SX.sym("x", d, n), ca.SX.sym("v", n)
    place, value = x[:, 0], v[0]
    for i in range(1, n):
        better = v[i] < value
        place, value = ca.if_else(better, x[:, i], place), ca.if_else(better, v[i], value)
    return ca.Function("best_of", [x, v], [place, value])


class Fit(NamedTuple):
    """What least squares finds.

    Attributes:
        values: coefficients. condition: condition number of the regressor, columns as they are.
        deviation: standard deviation of each coefficient, from the residual.
    """

    values: np.ndarray
    condition: float
    deviation: np.ndarray


def least_squares(
    regressor: Sequence[Sequence[float]] | np.ndarray,
    measured: Sequence[float] | np.ndarray,
    largest_condition: float = 1e4,
) -> Fit:
    """Fit a linear model, and say how well the data determine it.

    Args:
        regressor: one row per sample, one column per coefficient.
        measured: one number per sample.
        largest_condition: of the regressor; beyond it the data are refused.

    Raises:
        BadInput: fewer samples than coefficients plus one, or data without excitation.
    """
    try:
        Phi, y = real_array(regressor), real_array(measured)
    except (TypeError, ValueError) as error:
        raise BadInput(f"least_squares: regressor and measured are no numbers: {error}") from None
    if Phi.ndim != 2 or not (np.isfinite(Phi).all() and np.isfinite(y).all()):
        raise BadInput("least_squares: regressor and measured must be rows of finite numbers")
    check_positive("least_squares: largest_condition", largest_condition)
    N, n = Phi.shape
    if n >= N or y.shape != (N,):
        raise BadInput(f"least_squares: {y.size} measured and {N} rows for {n} coefficients;"
                       f" give {n + 1} or more of each")  # fmt: skip
    condition = float(np.linalg.cond(Phi))
    if not condition <= largest_condition:
        raise BadInput(
            f"least_squares: data without excitation, condition number {condition:.3g}; data that"
            f" vary more, up to {largest_condition:g}, would pass"
        )
    values = np.linalg.lstsq(Phi, y, rcond=None)[0]
    variance = float(np.sum((y - Phi @ values) ** 2)) / (N - n)
    spread = np.sqrt(variance * np.diag(np.linalg.inv(Phi.T @ Phi)))
    return Fit(values, condition, spread)
