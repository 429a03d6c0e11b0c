"""Search for the best operating point of a law: differential evolution as a block."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence, Set
from typing import Any

import casadi as ca

from slipctl.analysis import objective
from slipctl.block.block import Block, Exprs, as_block, doc_of_maker, make_block
from slipctl.block.signals import Param, Signal, State
from slipctl.block.text.intermediates import remember_locals
from slipctl.errors import BadInput, check_number, check_range, check_whole, refuse_unknown_choice
from slipctl.seek import random as wh

FORMS = ("consistent", "printed-alg1")
BLOCK = 10
"""Members that are drawn and evaluated as straight-line code; more do not fit the caches."""

LOWEST = -1e30
"""Value of a member drawn where the law is NaN, so that any trial replaces it."""


def differential_evolution(
    law: Block,
    over: str,
    maximise: str | None = None,
    *,
    lo: float,
    hi: float,
    population: int = 50,
    crossover: float = 0.6,
    generations: int = 300,
    generations_per_tick: int | None = None,
    seed: int = 1,
    form: str = "consistent",
) -> Block:
    """Search the argument of a law's peak by differential evolution, DE/rand/1.

    Each generation, every member x_i meets a trial x_a + F (x_b - x_c), a, b, c distinct and other
    than i, with probability ``crossover`` (with one variable, crossover is just that). The trial is
    reflected into the range at its bounds. The member is replaced if the trial is at least as good.
    All trials of a generation are made from the one before. The factor falls from 2 F0 to F0,
    F = F0 2^exp(1 - Gm/(Gm + 1 - G)); Huang 2020 eq (22) with its index put right. The population
    is drawn afresh for each search.

    Args:
        law: from the variable and further inputs and parameters to the objective.
        over: name of the input that is varied.
        maximise: output that is maximised; may be left out if there is only one.
        lo, hi: range of the variable, in its unit.
        population: number of members.
        crossover: probability of a trial.
        generations: of one search.
        generations_per_tick: how many to do per tick; by default all, so that each tick gives the
            optimum for the parameters it reads. Fewer spread a search over several ticks: it
            works on the parameters read at its start, and the last optimum is held meanwhile.
        seed: of the random numbers, which are block state.
        form: ``"consistent"``, or ``"printed-alg1"``: Algorithm 1 of Huang 2020 keeps the smaller
            value, and so finds the worst point (docs/errata.md).

    Returns:
        A step block. Inputs: the law's parameters and its other inputs. Outputs: ``best`` (place)
        and ``value`` (objective there).

    Raises:
        BadInput: unknown names, an empty range, or settings that make no search.
    """
    where = f"differential_evolution({as_block('differential_evolution: the law', law).name})"
    maximise = objective.objective(where, law, over, maximise)
    _check(where, lo, hi, population, crossover, generations, form)
    per_tick = generations if generations_per_tick is None else generations_per_tick
    check_whole(f"{where}: generations_per_tick", per_tick, 1, int(generations))
    n = int(population)
    given, value_of = objective.open_law(law, [over], maximise)
    worse = -1.0 if form == "printed-alg1" else 1.0
    many = per_tick < generations
    unit, states = law.inputs[over].unit, [wh.random_state(seed)]
    if many:
        states += _memory(unit, law.outputs[maximise].unit, n, value_of.size1_in(1))
    numbers = _numbers(unit, float(lo), float(hi), float(crossover))
    objective.refuse_names(where, law, [s.name for s in (*states, *numbers)])
    whole, spread = _bodies(given, value_of, n, worse, generations, int(per_tick))
    return make_block(
        "differential_evolution", "step", spread if many else whole,
        states=states, inputs=objective.of_role("input", given),
        params=[*numbers, *objective.of_role("param", given)],
        outputs=objective.best_outputs(law, over, maximise), sx=False,
        doc=doc_of_maker(differential_evolution),
        choices={
            "form": form, "law": law.name, "over": over, "population": n,
            "generations": int(generations), "per tick": int(per_tick), "seed": int(seed),
        },
    )  # fmt: skip


def _bodies(
    given: Sequence[Signal], value_of: ca.Function, n: int, worse: float, generations: int,
    per_tick: int,
) -> tuple[Callable[..., Any], Callable[..., Any]]:  # fmt: skip
    """Bodies of the block: of a whole search in each tick, and of one over several ticks."""
    start, best_of = _first(value_of, n, worse), _best_of(n)
    of_one_tick = repeat_step(_generation(value_of, n, worse), per_tick)

    def run(G: Any, rng: Any, pop: Any, val: Any, at: Any, p: Exprs) -> Any:
        """The generations of one tick, from generation G on."""
        constants = ca.vertcat(at, p["lo"], p["hi"], p["crossover"], p["F0"], float(generations))
        state = of_one_tick(ca.vertcat(G, rng, pop, val), constants, wh.rounder()(rng))
        return state[0], state[1:4], state[4 : 4 + n], state[4 + n :]

    def whole(xs: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        at = objective.column(given, u, p)
        rng, pop, val = start(xs["rng"], at, p["lo"], p["hi"])
        _, rng, pop, val = run(1.0, rng, pop, val, at, p)
        place, value = best_of(pop, val)
        return {"rng": rng}, {"best": place, "value": worse * value}

    def spread(xs: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        now = objective.column(given, u, p)
        first = xs["G"] <= 1
        at = ca.if_else(first, now, xs["at"])
        fresh = start(xs["rng"], at, p["lo"], p["hi"])
        rng, pop, val = (
            ca.if_else(first, new, xs[k])
            for new, k in zip(fresh, ("rng", "pop", "val"), strict=True)
        )
        G, rng, pop, val = run(ca.fmax(xs["G"], 1), rng, pop, val, at, p)
        done = generations < G
        place, value = best_of(pop, val)
        known = ca.logic_or(done, xs["searches"] < 1)
        best = ca.if_else(known, place, xs["place"])
        height = ca.if_else(known, worse * value, xs["height"])
        nxt = {
            "rng": rng, "pop": pop, "val": val, "at": at, "G": ca.if_else(done, 1, G),
            "place": best, "height": height, "searches": ca.fmin(xs["searches"] + done, 1e6),
        }  # fmt: skip
        return nxt, {"best": best, "value": height}

    return whole, spread


def _numbers(unit: str, lo: float, hi: float, crossover: float) -> list[Signal]:
    """Parameters of a search."""
    told = "factor in the last generation", "guess, not in the paper"
    return [
        Param(unit, lo, "lowest", lo=-1e12, hi=1e12).named("lo"),
        Param(unit, hi, "highest", lo=-1e12, hi=1e12).named("hi"),
        Param("1", crossover, "probability of a trial", lo=0, hi=1).named("crossover"),
        Param("1", 0.5, *told, lo=0.01, hi=2).named("F0"),
    ]


def _memory(place: str, value: str, n: int, known: int) -> list[Signal]:
    """States of a search that takes several ticks, of places and values in these units."""
    return [
        State(place, 0.0, "members", shape=(n,)).named("pop"),
        State(value, 0.0, "their values", shape=(n,)).named("val"),
        State("1", 0.0, "parameters of this search", shape=(known,)).named("at"),
        State("1", 1.0, "generation").named("G"),
        State(place, 0.0, "best of the last search").named("place"),
        State(value, 0.0, "value of the last search").named("height"),
        State("1", 0.0, "searches done").named("searches"),
    ]


def schedule(G: Any, generations: Any, F0: Any) -> Any:
    """Factor F of generation G = 1..Gm: F0 2^exp(1 - Gm/(Gm + 1 - G)), from 2 F0 to F0."""
    return F0 * ca.exp(math.log(2) * ca.exp(1 - generations / (generations + 1 - G)))


def _check(
    where: str, lo: float, hi: float, n: int, crossover: float, generations: int, form: str
) -> None:
    check_range(where, lo, hi)
    check_whole(f"{where}: population", n, 4, 500)
    check_number(f"{where}: crossover", crossover)
    if not 0 <= crossover <= 1:
        raise BadInput(f"{where}: crossover = {crossover:g} must lie in 0..1")
    check_whole(f"{where}: generations", generations)
    refuse_unknown_choice(where, "form", form, FORMS)


def _first(value_of: ca.Function, n: int, worse: float) -> Callable[..., tuple[Any, Any, Any]]:
    """Gives (rng, members drawn over the range, their values) of (rng, given, lo, hi)."""
    many = _each("members", _one_member(value_of, worse), n, {1, 2, 3}, True)

    def drawn(rng: Any, given: Any, lo: Any, hi: Any) -> tuple[Any, Any, Any]:
        states, places, values = many(rng, given, lo, hi)
        return states[:, -1], places.T, values.T

    return drawn


def _each(name: str, f: ca.Function, n: int, shared: Set[int], goes_on: bool) -> ca.Function:
    """Function that evaluates ``f`` n times, with columns of its arguments, or ``shared`` ones.

    Args:
        name: of the Function.
        f: what is evaluated.
        n: how often.
        shared: arguments that are the same each time.
        goes_on: whether the first result is the first argument of the next time.
    """
    one = f if n == 1 else f.mapaccum(n) if goes_on else f.map(n)
    given = [
        ca.MX.sym(f.name_in(k), f.size1_in(k), 1 if k in shared or (goes_on and not k) else n)
        for k in range(f.n_in())
    ]
    columns = [ca.repmat(v, 1, n) if k in shared else v for k, v in enumerate(given)]
    return ca.Function(name, given, one.call(columns), f.name_in(), f.name_out())


@remember_locals
def _one_member(value_of: ca.Function, worse: float) -> ca.Function:
    """Function (rng, given, lo, hi) -> (rng, place, value) of a member."""
    rng, lo, hi = ca.SX.sym("rng", 3), ca.SX.sym("lo"), ca.SX.sym("hi")
    given = ca.SX.sym("given", value_of.size1_in(1))
    after = wh.advance(rng)
    place = lo + (hi - lo) * wh.uniform(after)
    height = worse * value_of(place, given)
    value = ca.if_else(height >= LOWEST, height, LOWEST)
    return ca.Function(
        "one_member", [rng, given, lo, hi], [after, place, value],
        ["rng", "given", "lo", "hi"], ["after", "place", "value"],
    )  # fmt: skip


def repeat_step(step: ca.Function, count: int) -> ca.Function:
    """Function that does ``count`` steps (state, constants, K) -> state, by nested calls.

    CasADi's ``fold`` would store every state on the way.
    """
    if count == 1:
        return step
    z, constants, K = (ca.MX.sym("zcK"[i], step.size1_in(i)) for i in range(3))
    inner, rest = divmod(count, min(count, 10))
    many, after = repeat_step(step, inner), z
    for _ in range(min(count, 10)):
        after = many(after, constants, K)
    if rest:
        after = repeat_step(step, rest)(after, constants, K)
    return ca.Function(
        f"{step.name()}s_{count}", [z, constants, K], [after], ["s", "constants", "K"], ["after"]
    )


def _generation(value_of: ca.Function, n: int, worse: float) -> ca.Function:
    """Function (state, constants, K) -> state; state is generation, rng, members, values.

    A number of K is for :func:`wichmann_hill.quick_floor`.
    """
    m = value_of.size1_in(1)
    s, constants, K = ca.MX.sym("s", 4 + 2 * n), ca.MX.sym("constants", m + 5), ca.MX.sym("K", 2)
    G, rng, pop, val = ca.vertsplit(s, [0, 1, 4, 4 + n, 4 + 2 * n])
    given, lo, hi, probability, F0, Gm = ca.vertsplit(constants, [0, *range(m, m + 6)])
    F = schedule(ca.fmin(G, Gm), Gm, F0)
    ring = ca.vertcat(pop, pop)  # a partner's distance never has to be wrapped

    size = max(1, min(BLOCK, 2000 // max(value_of.n_instructions(), 1)))
    places, values, first = [], [], 0
    for blocks, k in ((n // size, size), (1, n % size)):
        if not k * blocks:
            continue
        firsts = ca.DM(range(first, first + k * blocks, k)).T
        draws = _each(f"draws_{k}", _draw(n, k), blocks, {2, 3}, True)
        rngs, partners, trials = draws(rng, firsts, probability * wh.MODULI[0], K)
        rng = rngs[:, -1]
        x, v = (w[first : first + k * blocks].reshape((k, blocks)) for w in (pop, val))
        mates = ring[partners].reshape(partners.shape)
        choose = _each(f"choices_{k}", _choose(value_of, k, worse), blocks, {4, 5, 6, 7}, False)
        chosen = choose(mates, trials, x, v, F, given, lo, hi)
        places.append(ca.vec(chosen[0]))
        values.append(ca.vec(chosen[1]))
        first += k * blocks
    return ca.Function(
        "generation", [s, constants, K], [ca.vertcat(G + 1, rng, *places, *values)],
        ["s", "constants", "K"], ["after"],
    )  # fmt: skip


@remember_locals
def _draw(n: int, size: int) -> ca.Function:
    """Function (rng, first, share, K) -> (partners, trial, rng) of ``size`` members of ``n``.

    One step of the generator per member. Part 1 gives the first partner and, by what is left of it,
    whether there is a trial (``size``, or 0); parts 2 and 3 the other two. The partners are drawn
    as ranks among the members not taken yet, so that they differ and none is the member itself.
    Rank o counts from the member's successor and steps over the ranks before it. The last partner
    keeps its fraction, which indexing cuts off.
    """
    rng, K = ca.SX.sym("rng", 3), ca.SX.sym("K", 2)
    first, share = ca.SX.sym("first"), ca.SX.sym("share")
    whole = wh.quick_floor(K)

    def drawn(state: Any, i: int) -> tuple[Any, list[Any], Any]:
        after = wh.advance(state, whole)
        scaled = after[0] * (n - 1)
        rank_a = whole(scaled * (1 / wh.MODULI[0]))
        trial = ca.if_else(scaled - wh.MODULI[0] * rank_a < share, size, 0)
        drawn_b = wh.whole_below(after, 1, n - 2, whole)
        drawn_c = wh.whole_below(after, 2, n - 3, lambda t: t)
        beyond_b = drawn_c + ca.if_else(drawn_c >= drawn_b, 1, 0)
        rank_c = beyond_b + ca.if_else(beyond_b >= rank_a, 1, 0)
        rank_b = drawn_b + ca.if_else(drawn_b >= rank_a, 1, 0)
        return after, [o + (first + (i + 1)) for o in (rank_a, rank_b, rank_c)], trial

    state, partners, trials = rng, [], []
    for i in range(size):
        state, three, trial = drawn(state, i)
        partners += three
        trials.append(trial)
    return ca.Function(
        f"draw_{size}", [rng, first, share, K],
        [state, ca.vertcat(*partners), ca.vertcat(*trials)],
        ["rng", "first", "share", "K"], ["after", "partners", "trials"], {"cse": True},
    )  # fmt: skip


def _choose(value_of: ca.Function, size: int, worse: float) -> ca.Function:
    """Function (mates, trial, members, values, ...) -> (members, values) of the next generation."""
    select = _select(value_of, size, worse)
    given = [ca.MX.sym(select.name_in(k), select.size1_in(k)) for k in range(select.n_in())]
    places, heights, which = select(*given)
    return ca.Function(
        f"choose_{size}", given, [places[which], heights[which]],
        select.name_in(), ["place", "height"],
    )  # fmt: skip


@remember_locals
def _select(value_of: ca.Function, size: int, worse: float) -> ca.Function:
    """Function -> (places, values, which): members, then trials; and which of them go on.

    To be indexed with ``which``, because a choice by ``if_else`` becomes a branch that nobody can
    foresee. A value that is NaN is never better.
    """
    m = value_of.size1_in(1)
    mates, trial = ca.SX.sym("mates", 3 * size), ca.SX.sym("trial", size)
    x, v = ca.SX.sym("x", size), ca.SX.sym("v", size)
    F, given = ca.SX.sym("F"), ca.SX.sym("given", m)
    lo, hi = ca.SX.sym("lo"), ca.SX.sym("hi")

    def reflected(a: Any, b: Any, c: Any) -> Any:
        aimed = a + F * (b - c)
        from_lo = ca.if_else(aimed < lo, 2 * lo - aimed, aimed)
        from_hi = ca.if_else(from_lo > hi, 2 * hi - from_lo, from_lo)
        return ca.if_else(from_hi < lo, lo, from_hi)  # 2 F may reach further than a reflection

    places = [reflected(*ca.vertsplit(mates[3 * i : 3 * i + 3])) for i in range(size)]
    values = [worse * value_of(place, given) for place in places]
    which = [ca.if_else(values[i] >= v[i], trial[i], 0) + i for i in range(size)]
    return ca.Function(
        f"select_{size}", [mates, trial, x, v, F, given, lo, hi],
        [ca.vertcat(x, *places), ca.vertcat(v, *values), ca.vertcat(*which)],
        ["mates", "trial", "x", "v", "F", "given", "lo", "hi"], ["places", "heights", "which"],
        {"cse": True},
    )  # fmt: skip


@remember_locals
def _best_of(n: int) -> ca.Function:
    """Function (members, values) -> (place, value) of the first best one."""
    x, v = ca.SX.sym("x", n), ca.SX.sym("v", n)

    def compared(place: Any, value: Any, i: int) -> tuple[Any, Any]:
        better = v[i] > value
        return ca.if_else(better, x[i], place), ca.if_else(better, v[i], value)

    place, value = x[0], v[0]
    for i in range(1, n):
        place, value = compared(place, value, i)
    return ca.Function("best_of", [x, v], [place, value], ["x", "v"], ["place", "value"])
