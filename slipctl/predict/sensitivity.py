"""Slopes of a predictive controller and of its closed loop, exact through the active set.

The last pass of the active set solves the linear system of Karush, Kuhn and Tucker with its
limits as equations, and those before only say which they are. CasADi makes the derivative of a
tick of that pass. It is that of the solution as long as the statuses stay: no limit that holds has
a multiplier of zero (strict complementarity). Along a run

    dx+ = (dn/dx) dx + (dn/dp) dp,  dy = (dg/dx) dx + (dg/dp) dp

from tick to tick. Each number is moved by a millionth to both sides as well. Where a status differs
then, strict complementarity is in doubt and said to be; where the difference is another slope,
something jumps, and there is none. A staircase of longer steps has the slope of a step, zero.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from slipctl.block.block import Block, as_block
from slipctl.block.shared_numbers import number_at
from slipctl.errors import BadInput, nearest
from slipctl.run.preparation import Prepared
from slipctl.run.rail import Scenario

NEAR = 1e-6
"""Part of a number by which it is moved to both sides."""

AGREES = 1e-3
"""Largest distance of a slope from the difference, over the largest slope of the run: rounding of
a difference is a thousand times less; a jump is a thousand times more."""

SMALLEST = 1e-3
"""Slope, in sizes of signal and number, below which rounding counts in a difference."""


class Slopes(NamedTuple):
    """Slopes by numbers.

    Attributes:
        of: by signal, then by number, in the unit of the one by that of the other; of a run over
            its ticks.
        doubtful: numbers at which some limit is about to begin or to end: where the multiplier of
            one that holds is zero, the slope is one of two.
        apart: largest difference of slope and central difference, over the largest slope of the
            signal, by number.
    """

    of: dict[str, dict[str, Any]]
    doubtful: tuple[str, ...]
    apart: dict[str, float]


def control_slopes(controller: Block, by: str | Sequence[str], **numbers: Any) -> Slopes:
    """Slopes of what a controller computes in one tick, by its inputs and parameters.

    It is the tick that is differentiated, with the plan that it begins with. With ``iterations``
    enough to end at the optimum, the slope is that of the optimum.

    Args:
        controller: a step block, as of :func:`nmpc`.
        by: scalar inputs or parameters.
        **numbers: states, inputs and parameters of the tick, as a call of the block takes them.

    Raises:
        BadInput: a name that is none of these, a tick of another status than 0, a slope that
            differences do not have.
    """
    block = as_block("control_slopes: the controller", controller)
    where = f"control_slopes({block.name})"
    names = [by] if isinstance(by, str) else list(by)
    for n in names:
        s = block.inputs.get(n) or block.params.get(n)
        if s is None or s.shape != () or s.derived:
            known = [*block.inputs, *(k for k, v in block.params.items() if not v.derived)]
            raise BadInput(f"{where}: {n!r} is no scalar input or parameter{nearest(n, known)}")

    def tick(**moved: float) -> tuple[Any, ...]:
        point = block.point(**(numbers | moved))
        roles = ("state", "input", "param")
        columns = [ca.DM(block.pack(r, v)) for r, v in zip(roles, point, strict=True)]
        return *columns, *block.f(*columns)

    x, u, p, after, y = tick()
    told = {n: float(v) for n, v in block.unpack("output", y).items() if v.numel() == 1}
    if told.get("status", 0.0) != 0:
        raise BadInput(f"{where}: the tick ends with status {told['status']:g}; only 0 has slopes")
    at = block.point(**numbers)
    values = {n: float({**at[1], **at[2]}[n]) for n in names}
    free = [n for n in names if n in block.params]
    dp = np.zeros((p.numel(), len(names)))
    dp[:, [names.index(n) for n in free]] = _at(by_numbers(block, free), block, p.full().ravel())[0]
    du = np.array([[float(k == n) for n in names] for k, s in block.inputs.items()
                   for _ in range(s.size)])  # fmt: skip
    none = np.zeros((x.numel(), len(names)))
    exact = np.array(block.f.forward(len(names))(x, u, p, after, y, none, du, dp)[1])
    rows, marks = _places(block, "output"), _marks(block)
    doubtful, differences = [], np.zeros((len(rows), len(names)))
    for k, n in enumerate(names):
        step = NEAR * max(abs(values[n]), 1.0)
        plus, minus = (tick(**{n: values[n] + e})[3:] for e in (step, -step))
        if any((np.array(v[0])[marks] != np.array(after)[marks]).any() for v in (plus, minus)):
            doubtful.append(n)
        differences[:, k] = (plus[1] - minus[1]).full().ravel()[list(rows.values())] / (2 * step)
    exact = exact[list(rows.values())]
    level = np.abs(y.full().ravel()[list(rows.values())]).max(initial=0)
    apart = {n: _apart(exact[:, k], differences[:, k], level / max(abs(values[n]), 1.0))
             for k, n in enumerate(names)}  # fmt: skip
    _refuse(where, doubtful, apart)
    of = {s: {n: float(exact[i, k]) for k, n in enumerate(names)} for i, s in enumerate(rows)}
    return Slopes(of, tuple(doubtful), apart)


def run_slopes(loop: Block, scenario: Scenario, by: str | Sequence[str]) -> Slopes:
    """Slopes of the scalar signals of a run by numbers of its loop, tick by tick.

    Args:
        loop: a step block, with predictive controllers or without.
        scenario: what happens.
        by: parameters of the loop; a shared number counts at all its places.

    Raises:
        BadInput: a name that is no parameter; a slope that differences do not have.
        RunFailed: a state became NaN or infinite.
    """
    block = as_block("run_slopes: the loop", loop)
    where = f"run_slopes({block.name})"
    given = [by] if isinstance(by, str) else list(by)
    names = [number_at(block, n) for n in given]
    for short, n in zip(given, names, strict=True):
        if n not in block.params or block.params[n].shape != () or block.params[n].derived:
            raise BadInput(f"{where}: {short!r} is no scalar parameter{nearest(n, block.params)}")
    prepared = Prepared(block, scenario)
    run = prepared.whole({})
    slopes, m = by_numbers(block, names), len(names)
    dx = _at(slopes, block, run.parts[0][2])[1]
    ahead, rows = run.f.forward(m), {r: _places(block, r) for r in ("state", "output")}
    exact: dict[str, list[np.ndarray]] = {"state": [], "output": []}
    for first, last, p in run.parts:
        dp = _at(slopes, block, p)[0]
        for k in range(first, last):
            after = run.x[k + 1] if k + 1 < len(run.x) else np.zeros(run.x.shape[1])
            exact["state"].append(dx)
            du = np.zeros((run.u.shape[1], m))
            found = ahead(run.x[k], run.u[k], p, after, run.y[k], dx, du, dp)
            dx, dy = (np.array(v) for v in found)
            exact["output"].append(dy)
    whole = {r: np.array(v)[:, list(rows[r].values())] for r, v in exact.items()}
    marks, doubtful, apart = _marks(block), [], {}
    for k, n in enumerate(names):
        value = float(block.param_values()[n])
        step = NEAR * max(abs(value), 1e-3)
        plus, minus = (prepared.whole({n: value + e}) for e in (step, -step))
        if any((v.x[:, marks] != run.x[:, marks]).any() for v in (plus, minus)):
            doubtful.append(n)
        apart[n] = 0.0
        for r, a, b in (("state", plus.x, minus.x), ("output", plus.y, minus.y)):
            for i, at in enumerate(rows[r].values()):
                level = np.abs(a[:, at]).max() * NEAR / step
                gap = _apart(whole[r][:, i, k], (a - b)[:, at] / (2 * step), level)
                apart[n] = max(apart[n], gap)
    _refuse(where, doubtful, apart)
    of = {s: {n: whole[r][:, i, k] for k, n in enumerate(names)}
          for r in ("state", "output") for i, s in enumerate(rows[r])}  # fmt: skip
    return Slopes(of, tuple(doubtful), apart)


def by_numbers(loop: Block, names: Sequence[str]) -> ca.Function:
    """Function of the parameters that are not derived -> slopes of all, and of the start values.

    Raises:
        BadInput: parameters that take no symbols.
    """
    free = {n: s for n, s in loop.params.items() if not s.derived}
    symbols = {n: ca.SX.sym(f"q{k}", s.size) for k, (n, s) in enumerate(free.items())}
    try:
        params = loop.derive(symbols)
        packed = loop.pack("param", params), loop.pack("state", loop.symbolic_start(params))
    except (TypeError, NotImplementedError, RuntimeError):
        raise BadInput("its parameters cannot be written as symbols") from None
    wrt = ca.vertcat(*(symbols[n] for n in names)) if names else ca.SX(0, 1)
    slopes = [ca.densify(ca.jacobian(ca.SX(v), wrt)) for v in packed]
    return ca.Function("by_numbers", [ca.vertcat(*symbols.values())], slopes)


def _at(slopes: ca.Function, loop: Block, p: np.ndarray) -> list[np.ndarray]:
    """Slopes of :func:`by_numbers` at packed parameters."""
    free = [not s.derived for s in loop.params.values() for _ in range(s.size)]
    return [np.array(j) for j in slopes(np.asarray(p)[free])]


def _places(block: Block, role: str) -> dict[str, int]:
    """Place of each scalar signal that has slopes in the packed column."""
    places, at = {}, 0
    for n, s in block._signals[role].items():
        if s.shape == () and n.rpartition(".")[2] not in ("status", "passes", "residual"):
            places[n] = at
        at += s.size
    return places


def _marks(block: Block) -> np.ndarray:
    """Places of the statuses of predictive controllers among the states."""
    solvers = [path for path, b in block.leaves() if b.composition.solves is not None]
    paths = [f"{path}.S".lstrip(".") for path in solvers]
    places = [n in paths for n, s in block.states.items() for _ in range(s.size)]
    return np.flatnonzero(places)


def _apart(slope: np.ndarray, difference: np.ndarray, level: float) -> float:
    """Largest distance over the largest slope; level: of the signal over the number."""
    size = max(np.abs(slope).max(initial=0), np.abs(difference).max(initial=0), SMALLEST * level)
    return float(np.abs(slope - difference).max(initial=0) / max(size, 1e-300))


def _refuse(where: str, doubtful: Sequence[str], apart: Mapping[str, float]) -> None:
    """Refuse slopes that differences do not have, but where a limit begins or ends."""
    for n, distance in apart.items():
        if distance > AGREES and n not in doubtful:
            raise BadInput(
                f"{where}: by {n} slopes and differences are {distance:.1g} apart: something jumps"
                " (a sign, a quantiser); there is no slope"
            )
