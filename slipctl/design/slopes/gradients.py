"""Exact slopes of a run's metrics by numbers of the loop: one sweep back along the run.

With x+ = n(x, u, p), y = g(x, u, p) at every tick and a metric M of the logged x and y,

    lambda_k = (dn/dx)' lambda_{k+1} + (dg/dx)' dM/dy_k + dM/dx_k
    dM/dp    = sum over k of (dn/dp)' lambda_{k+1} + (dg/dp)' dM/dy_k

from CasADi's derivatives of the loop, at the cost of a few runs however many numbers there are
(A. Griewank, A. Walther, Evaluating Derivatives, 2008, chapter 3). A loop is refused, with the
reason, where a free number reaches something that jumps along the run: a quantiser, a sign, a seed
that switches. There the slope is that of one step of a staircase. Beside predictive control any
part that may jump is refused, and the slope goes through its active set.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from slipctl.block.block import Block
from slipctl.block.shared_numbers import number_at
from slipctl.certify.arithmetic.enclosure import Interval, enclose
from slipctl.design.slopes.backward import Backward, edges
from slipctl.errors import BadInput
from slipctl.predict.sensitivity import by_numbers
from slipctl.run.metrics import Run
from slipctl.run.preparation import Whole
from slipctl.run.rail import Scenario
from slipctl.run.sweep.ensemble import Draw, World

JUMPS = {
    getattr(ca, f"OP_{n}"): said
    for n, said in (("SIGN", "a sign"), ("FLOOR", "a quantiser"), ("CEIL", "a quantiser"),
                    ("EQ", "an equality"), ("NE", "an equality"))
}  # fmt: skip
"""Operations that jump where they change; comparisons may be kinks: :func:`slope_error` tells."""

STEPS = (1e-2, 1e-3, 1e-4, 1e-5)
"""Steps of the central differences that guard a slope, as shares of each number."""

AGREES = 1e-6
"""Relative difference of a slope and the central difference that is taken for agreement."""

LONGEST = 400_000
"""Operations of a tick from which on no slopes are asked for."""

AT_ONCE = 1000
"""Ticks of which the jumps are looked at together."""

# ---- metrics -------------------------------------------------------------------------------------

Seeds = list[tuple[str, np.ndarray]]
"""What a metric changes by, for a change of a signal at each tick: role and slopes."""


def _rms(error: np.ndarray | None, role: str, wanted: str) -> Seeds:
    assert error is not None
    slope = error / (len(error) * float(np.sqrt(np.mean(np.square(error)))) or 1.0)
    return [(role, slope), (wanted, -slope)]


def _slip_error(run: Run) -> Seeds:
    wanted = "reference" if run.off("reference") is not None else "best_slip"
    return _rms(run.slip_error, "slip", wanted)


def _difference(role: str, wanted: str) -> Callable[[Run], Seeds]:
    def seeds(run: Run) -> Seeds:
        a, b = run.get(role), run.get(wanted)
        assert a is not None
        assert b is not None
        return _rms(a - b, role, wanted)

    return seeds


def _distance(run: Run) -> Seeds:
    """Of the end of :attr:`Run.travelled`."""
    v, x, many = run.get("speed"), run.get("position"), len(run.time)
    place, speed = np.zeros(many), np.zeros(many)
    place[0], place[-1] = -1.0, place[-1] + 1.0
    if v is not None and many > 1:
        speed[-1], speed[-2] = 1.5 * run.tick, -0.5 * run.tick
        if x is None:
            speed += run.tick
            speed[[0, -1]] -= run.tick / 2
    return [("position", place)] * (x is not None) + [("speed", speed)] * (v is not None)


SMOOTH: dict[str, Callable[[Run], Seeds]] = {
    "distance": _distance,
    "slip_error_rms": _slip_error,
    "speed_error_rms": _difference("speed", "wanted_speed"),
    "position_error_rms": _difference("position", "wanted_position"),
}
"""Metrics that have a slope; those of the worst tick, of swings and of counts have none."""


# ---- slopes --------------------------------------------------------------------------------------


class Slopes:
    """Slopes of metrics of a loop by some of its numbers.

    Args:
        world: loop and scenario. names: the numbers.

    Raises:
        BadInput: the loop is not smooth in these numbers; says why.
    """

    def __init__(self, world: World, names: Sequence[str]) -> None:
        self.world, self.loop = world, world.loop
        self.names = [number_at(self.loop, n) for n in names]
        scenario = world.scenario
        for short, name in zip(names, self.names, strict=True):
            if name not in self.loop.params:
                raise BadInput(f"{short} is no parameter of the loop")
        refuse_scenario(scenario)
        sizes = [(s.size, not s.derived) for s in self.loop.params.values()]
        self._settable = np.repeat([free for _, free in sizes], [many for many, _ in sizes])
        self._given = by_numbers(self.loop, self.names)
        prepared = world.measured.prepared
        whole = prepared.whole({})
        if any(b.composition.solves is not None for _, b in self.loop.leaves()):
            for path, b in self.loop.leaves():
                self._refuse_jump_of(path, b)
            self._back = Backward(whole.f, True, prepared.compile)
            return
        if operations(whole.f) > LONGEST:
            raise BadInput(f"its tick is longer than {LONGEST:.0e} operations")
        try:
            f = whole.f if whole.f.is_a("SXFunction") else whole.f.expand()
        except RuntimeError:
            raise BadInput("its equations cannot be written as scalar operations") from None
        self._back = Backward(f, False)
        self._refuse_jumps(f, whole)

    def of(
        self, numbers: Mapping[str, float], draw: Draw, metrics: Sequence[str]
    ) -> dict[str, np.ndarray]:
        """Slopes of metrics by the numbers, in the unit of the metric by that of the number.

        Args:
            numbers: as of :meth:`World.metrics`. draw: of its ensemble. metrics: of :data:`SMOOTH`.

        Raises:
            BadInput: a metric without slope, or a signal of several axles.
            RunFailed: a state became NaN or infinite.
        """
        measured, given = self.world.measured, {**draw.numbers, **numbers}
        log = measured.prepared(given, seed=draw.scenario.seed, rail=draw.scenario.rail)
        run = measured.seen(log, draw.scenario, draw.known)
        whole = measured.prepared.whole(given, seed=draw.scenario.seed, rail=draw.scenario.rail)
        found = {}
        for name in metrics:
            if name not in SMOOTH:
                raise BadInput(f"{name} has no slope; {', '.join(SMOOTH)} have one")
            found[name] = self._swept(whole, *self._laid(whole, run, SMOOTH[name](run)))
        return found

    def _laid(self, whole: Whole, run: Run, seeds: Seeds) -> tuple[np.ndarray, np.ndarray]:
        """Seeds at their places among all states and outputs, a row a tick."""
        at_x, at_y = np.zeros_like(whole.x), np.zeros_like(whole.y)
        for role, slope in seeds:
            name = run.signals.find(role, run.log)
            for signals, at in ((self.loop.outputs, at_y), (self.loop.states, at_x)):
                if name in signals:
                    if signals[name].size != 1:
                        raise BadInput(f"{name} is of several axles; of these there is no slope")
                    k = 0
                    for n, s in signals.items():
                        if n == name:
                            at[:, k] += slope
                        k += s.size
                    break  # what the rail or nobody computes has no slope
        return at_x, at_y

    def _swept(self, whole: Whole, at_x: np.ndarray, at_y: np.ndarray) -> np.ndarray:
        """Sweep back along a run."""
        adjoint = np.zeros(self._back.f.size1_in(0))
        total = np.zeros(len(self.names))
        for part in reversed(whole.parts):
            first, _, p = part
            adjoint, by_p = self._back.over(whole, part, adjoint, at_x, at_y)
            p_by, x_by = (np.array(j.full()) for j in self._given(p[self._settable]))
            total += p_by.T @ by_p
            if first == 0:
                total += x_by.T @ adjoint
        return total

    # ---- what jumps ------------------------------------------------------------------------------

    def _refuse_jump_of(self, path: str, part: Block) -> None:
        """Refuse a part beside one that solves a problem, if any of its operations may jump."""
        for op, said in JUMPS.items() if part.composition.solves is None else ():
            if _has(part, op):
                raise BadInput(f"{said} in it may change along the run ({path})")

    def _refuse_jumps(self, f: ca.Function, whole: Whole) -> None:
        """Refuse a loop in which a number reaches an operation that jumps along the run."""
        sizes = [f.size1_in(k) for k in range(3)]
        z = ca.SX.sym("z", sum(sizes))
        column = ca.Function("column", [z], [ca.vertcat(*f(*ca.vertsplit(z, edges(sizes))))])
        first_p = whole.parts[0][2]
        p_by, x_by = (np.array(j.full()) for j in self._given(first_p[self._settable]))
        reached = {int(k) for k in np.flatnonzero(np.abs(x_by).sum(axis=1))}
        params = {sizes[0] + sizes[1] + int(k) for k in np.flatnonzero(np.abs(p_by).sum(axis=1))}
        jumps = reached_jumps(column, reached, params, sizes[0])
        if not jumps:
            return
        least, most = dict.fromkeys(jumps, np.inf), dict.fromkeys(jumps, -np.inf)
        spans = [(k, min(k + AT_ONCE, last), p) for first, last, p in whole.parts
                 for k in range(first, last, AT_ONCE)]  # fmt: skip
        for first, last, p in spans:
            rows = [whole.x[first:last], whole.u[first:last], np.tile(p, (last - first, 1))]
            points = np.hstack(rows).T
            seen: dict[int, Interval] = {}
            enclose(column, points, points, seen)
            for k in jumps:
                least[k], most[k] = min(least[k], seen[k][1].min()), max(most[k], seen[k][0].max())
                if most[k] > least[k]:
                    said = JUMPS[column.instruction_id(k)]
                    raise BadInput(f"{said} in it changes along the run{self._where(k, column)}")

    def _where(self, k: int, column: ca.Function) -> str:
        """Part that has the operation, where only one kind of part has it."""
        op = column.instruction_id(k)
        parts = [path for path, b in _leaves(self.loop, "") if _has(b, op)]
        return f" ({', '.join(parts)})" if parts else ""


def refuse_scenario(scenario: Scenario) -> None:
    """Refuse a scenario in which a metric has no slope, whatever the loop is.

    Raises:
        BadInput: says why.
    """
    if scenario.end is not None:
        raise BadInput("the run ends by what it computes")
    if scenario.rail is not None and scenario.rail.by != "time":
        raise BadInput("the rail changes by the place of the vehicle")


def operations(f: ca.Function) -> int:
    """Operations of a Function written out, calls counted as what they call."""
    if f.is_a("SXFunction"):
        return int(f.n_instructions())
    if not f.is_a("MXFunction"):  # a map, whose columns say how many, or a switch
        inside = f.find_functions(0)
        if f.is_a("Map"):
            wide = [f.size2_in(k) // max(inside[0].size2_in(k), 1) for k in range(f.n_in())]
            return max(wide) * operations(inside[0])
        return sum(operations(g) for g in inside)
    calls = [k for k in range(f.n_instructions()) if f.instruction_id(k) == ca.OP_CALL]
    inner = sum(operations(f.instruction_MX(k).which_function()) for k in calls)
    return int(f.n_instructions()) - len(calls) + inner


def reached_jumps(column: ca.Function, states: set[int], params: set[int], many: int) -> list[int]:
    """Instructions that jump and that some of the inputs reach, through the states tick by tick.

    Args:
        column: of a column (x, u, p), with the results x+ and y. states: places that are reached
            at the start. params: places of what is free. many: states.
    """
    code = [(column.instruction_id(k), column.instruction_input(k), column.instruction_output(k))
            for k in range(column.n_instructions())]  # fmt: skip
    while True:
        known, new, found = dict[int, bool](), set(states), []
        for k, (op, args, to) in enumerate(code):
            if op == ca.OP_CONST:
                known[to[0]] = False
            elif op == ca.OP_INPUT:
                known[to[0]] = args[1] in states or args[1] in params
            elif op == ca.OP_OUTPUT:
                if to[1] < many and known[args[0]]:
                    new.add(to[1])
            else:
                hit = any(known[a] for a in args)
                known |= dict.fromkeys(to, hit)
                found += [k] if hit and op in JUMPS else []
        if new == states:
            return found
        states = new


def slope_error(
    value: Callable[[np.ndarray], float], at: np.ndarray, slope: np.ndarray, seed: int = 0
) -> float:
    """Relative difference of a slope and central differences along a random direction.

    Of each step and half of it, extrapolated; the nearest counts, for a long one is inexact and a
    short one loses digits. Where a kink or a jump lies near all of them disagree.
    """
    way = np.random.default_rng(seed).choice([-1.0, 1.0], at.size) * np.maximum(np.abs(at), 1e-12)

    def central(h: float) -> float:
        return (value(at + h * way) - value(at - h * way)) / (2 * h)

    wanted = [(4 * central(h / 2) - central(h)) / 3 for h in STEPS]
    return min(abs(float(slope @ way) - w) / max(abs(w), 1e-300) for w in wanted)


def _leaves(block: Block, path: str) -> list[tuple[str, Block]]:
    if not block.parts:
        return [(path.strip("."), block)]
    return [leaf for n, part in block.parts.items() for leaf in _leaves(part, f"{path}.{n}")]


def _has(block: Block, op: int) -> bool:
    try:
        f: Any = block.function().expand()
    except (RuntimeError, BadInput):
        return False
    return any(f.instruction_id(k) == op for k in range(f.n_instructions()))
