"""Linear models and operating points, and any block as a system of python-control.

Around an operating point (x0, u0) of x' = f(x, u), y = h(x, u) the exact Jacobians give

    dx' = A dx + B du,   dy = C dx + D du                (a step: dx+ on the left)

python-control allows no dot in the name of a signal: ``plant.wheel.v`` becomes ``plant_wheel_v``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from slipctl.block.block import Block
from slipctl.errors import BadInput, RunFailed

if TYPE_CHECKING:
    import control

NEWTON_STEPS = 60
"""Newton steps after which an operating point counts as not found."""

CLOSE = 1e-10
"""Newton correction, relative to 1 + |unknown|, at which an operating point counts as found."""


@dataclass(frozen=True)
class OperatingPoint:
    """Where a block is, for instance in equilibrium or in steady slip.

    Attributes:
        states, inputs, params, outputs: values by name.
        rates: x' of a flow, x+ - x of a step; zero where it was asked to be.
        steps: Newton steps that it took.
    """

    states: Mapping[str, Any]
    inputs: Mapping[str, Any]
    params: Mapping[str, Any]
    outputs: Mapping[str, Any] = field(default_factory=dict)
    rates: Mapping[str, Any] = field(default_factory=dict)
    steps: int = 0


At = OperatingPoint | Mapping[str, Any] | None


def linear(
    block: Block,
    at: At = None,
    inputs: Iterable[str] | None = None,
    outputs: Iterable[str] | None = None,
) -> control.StateSpace:
    """Linearise a block exactly; the result says what small deviations do.

    Args:
        block: a flow (continuous result), a step (sampled with the block's period) or a law
            (gains only).
        at: values of states, inputs and parameters by full or last name, or what
            ``operating_point`` found; the rest has its declared value.
        inputs: inputs of the result, in this order; parameters are allowed too, for what a small
            change of them does. By default all inputs.
        outputs: outputs of the result, in this order; states are allowed too. By default all
            outputs, or all states where there are none.

    Returns:
        State space with named states, inputs and outputs.

    Raises:
        BadInput: unknown name, an input without value, or a slope that is infinite or NaN there.
    """
    import control

    A, B, C, D, columns, rows = matrices(block, at, inputs, outputs)
    if not columns or not rows:
        raise BadInput(
            f"linear({block.name}): python-control needs an input and an output; a parameter may be"
            f" one, inputs=[{next(iter(block.params), 'name')!r}]"
        )
    return control.StateSpace(
        A, B, C, D, _sampling(block), name=block.name,
        states=_plain(_elements(block, "state").values()),
        inputs=_plain(columns), outputs=_plain(rows),
    )  # fmt: skip


def matrices(
    block: Block,
    at: At = None,
    inputs: Iterable[str] | None = None,
    outputs: Iterable[str] | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, list[str], list[str]]:
    """A, B, C and D of a block, as :func:`linear` gives them, with names of inputs and outputs.

    python-control, which takes most of a second to load, is not needed.
    """
    columns = _chosen(block, inputs or block.inputs, "input", "param")
    rows = _chosen(block, outputs or block.outputs or block.states, "output", "state")
    slopes: Any = _slopes(block)(*_packed(block, at))
    A, B, C, D = (np.array(ca.DM(m).full()) for m in slopes)
    C, D = np.vstack([C, np.eye(len(A))]), np.vstack([D, np.zeros((len(A), D.shape[1]))])
    states = _elements(block, "state")
    B, C, D = B[:, list(columns)], C[list(rows)], D[np.ix_(list(rows), list(columns))]
    _refuse_kinks(
        block,
        np.block([[A, B], [C, D]]),
        [n + ("'" if block.kind == "flow" else "+") for n in states.values()] + [*rows.values()],
        [*states.values(), *columns.values()],
    )
    return A, B, C, D, [*columns.values()], [*rows.values()]


def _slopes(block: Block) -> ca.Function:
    """Function of (x, u, p) that gives A, B, C, D, with the parameters beside the inputs."""
    f = block.f
    x, u, p = (ca.MX.sym("xup"[i], f.size1_in(i)) for i in range(3))
    free = {n: v for n, v in block.unpack("param", p).items() if not block.params[n].derived}
    results: Any = f(x, u, block.pack("param", block.derive(free)))
    by = ca.vertcat(u, p)
    J = [ca.jacobian(r, w) for r in results for w in (x, by)]
    return ca.Function(f"{f.name()}_slopes", [x, u, p], J)


def nonlinear(block: Block) -> control.NonlinearIOSystem:
    """Give a block to python-control, which can then simulate, interconnect and trim it.

    Its start is ``X0=block.pack("state", block.start()).full().ravel()``. Parameters are changed
    by name, ``control.input_output_response(..., params={"wheel.m": 9000})``: the block's own name
    for it, alone or after the block's name and a dot. Other names are left to other systems,
    because python-control hands the same ones to all.
    """
    import control

    f = block.f
    cache: dict[tuple[tuple[str, float], ...], Any] = {}

    def evaluate(x: np.ndarray, u: np.ndarray, params: Mapping[str, float], which: int) -> Any:
        key = tuple(params.items())
        if key not in cache:
            cache.clear()
            own = {k.removeprefix(f"{block.name}."): v for k, v in key}
            values = block.param_values(**{k: v for k, v in own.items() if k in block.params})
            cache[key] = block.pack("param", values)
        results: Any = f(x, u, cache[key])
        return np.array(results[which].full()).ravel()

    return control.NonlinearIOSystem(
        (lambda t, x, u, params: evaluate(x, u, params, 0)) if block.states else None,
        lambda t, x, u, params: evaluate(x, u, params, 1),
        name=block.name, dt=_sampling(block),
        states=_plain(_elements(block, "state").values()) or None,
        inputs=_plain(_elements(block, "input").values()),
        outputs=_plain(_elements(block, "output").values()),
    )  # fmt: skip


def operating_point(
    block: Block,
    fixed: Mapping[str, Any] | None = None,
    free: Iterable[str] | Mapping[str, Any] | None = None,
    steady: Iterable[str] | None = None,
) -> OperatingPoint:
    """Find where chosen signals stand still: an equilibrium, or a steady slip while braking.

    A steady slip of a wheel that slows down is an output that stands still, its states do not::

        operating_point(plant, {"v": 20, "v_s": 1.2}, free=["omega", "T_cmd"], steady=["v_s"])

    Args:
        block: a flow or a step.
        fixed: values of states, inputs, parameters and outputs; each output is an equation.
        free: states and inputs to find, by default all states that are not fixed; as a mapping,
            with the values to start from (otherwise the declared ones). Where there are several
            solutions, the start chooses.
        steady: states and outputs that stand still, by default the free states.

    Returns:
        The point, with inputs, parameters, outputs and rates.

    Raises:
        BadInput: unknown name, or not as many equations as unknowns.
        RunFailed: no solution found; says what is left over.
    """
    if block.kind == "law":
        raise BadInput(f"{block.name} is a law: it has no state that could stand still")
    values = {block.find(k, "state", "input", "param", "output"): v
              for k, v in (fixed or {}).items()}  # fmt: skip
    targets = {k: v for k, v in values.items() if k in block.outputs and k not in block.states}
    given = {k: v for k, v in values.items() if k not in targets}
    if free is None:
        free = [n for n in block.states if n not in given]
    guess = dict(free) if isinstance(free, Mapping) else dict.fromkeys(free)
    unknown = {block.find(k, "state", "input"): v for k, v in guess.items()}
    for name, value in unknown.items():
        if name in given:
            raise BadInput(f"operating_point({block.name}): {name} is both fixed and free")
        if value is None and name in block.inputs and block.inputs[name].value is None:
            unknown[name] = 0.0
    if steady is None:
        steady = [n for n in block.states if n in unknown]
    still = [block.find(k, "output", "state") for k in steady]
    search = _Search(block, list(unknown), still, targets)
    x, u, p = _packed(block, given | {k: v for k, v in unknown.items() if v is not None})
    z = np.concatenate([np.array(ca.DM(v).full()).ravel() for v in (x, u)])
    steps = search.run(z, p)
    state, held = ca.DM(z[: search.nx]), ca.DM(z[search.nx :])
    result: Any = block.f(state, held, p)
    rates = result[0] if block.kind == "flow" else result[0] - state
    of = block._numbers
    return OperatingPoint(
        of("state", state), of("input", held), of("param", ca.DM(p)), of("output", result[1]),
        of("state", rates), steps,
    )  # fmt: skip


class _Search:
    """Damped Newton iteration on the equations of an operating point, inside the ranges.

    Steps are judged by Newton corrections and not by residuals (the natural monotonicity test),
    so units do not matter. Source: Deuflhard, Newton Methods for Nonlinear Problems, section 3.3.
    """

    def __init__(
        self, block: Block, unknown: list[str], still: list[str], targets: Mapping[str, Any]
    ) -> None:
        self.block, self.nx = block, block.f.size1_in(0)
        found = _chosen(block, unknown, "state", "input")
        self.where, self.names = list(found), list(found.values())
        signals = [*block.states.values(), *block.inputs.values()]
        self.lo, self.hi = (
            np.array([getattr(s, side) for s in signals for _ in range(s.size)])[self.where]
            for side in ("lo", "hi")
        )
        f = block.f
        x, u, p = (ca.MX.sym("xup"[i], f.size1_in(i)) for i in range(3))
        now: Any = f(x, u, p)
        if block.kind == "flow":
            rates, drift = now[0], ca.jtimes(now[1], x, now[0])
        else:
            later: Any = f(now[0], u, p)
            rates, drift = now[0] - x, later[1] - now[1]
        moves = {**block.unpack("state", rates), **block.unpack("output", drift)}
        outputs = block.unpack("output", now[1])
        self.labels = [f"rate of {n}" for n in _chosen(block, still, "output", "state").values()]
        rows = [ca.vec(moves[n]) for n in still]
        for n, value in targets.items():
            wanted = np.broadcast_to(np.asarray(value, dtype=float), block.outputs[n].shape)
            rows.append(ca.vec(outputs[n]) - ca.DM(wanted.ravel(order="F")))
            self.labels += [f"{e} - {value}" for e in _chosen(block, [n], "output").values()]
        if len(self.names) != len(self.labels):
            raise BadInput(
                f"operating_point({block.name}): {len(self.names)} unknowns"
                f" ({', '.join(self.names) or 'none'}) and {len(self.labels)} equations"
                f" ({', '.join(f'{e} = 0' for e in self.labels) or 'none'}); name as many in free="
                f" as in steady= and outputs in fixed="
            )
        r = ca.vertcat(*rows) if rows else ca.MX(0, 1)
        self.equations = ca.Function("equations", [x, u, p], [r, ca.jacobian(r, ca.vertcat(x, u))])

    def at(self, z: np.ndarray, p: Any) -> tuple[np.ndarray, np.ndarray]:
        """Residual and its slopes by the unknowns."""
        result: Any = self.equations(z[: self.nx], z[self.nx :], p)
        r, J = (np.array(ca.DM(v).full()) for v in result)
        return r.ravel(), J[:, self.where]

    def run(self, z: np.ndarray, p: Any) -> int:
        """Move the unknowns in ``z`` to the solution; returns the number of steps."""
        if not self.where:
            return 0
        z[self.where] = np.clip(z[self.where], self.lo, self.hi)
        for step in range(1, NEWTON_STEPS + 1):
            r, J = self.at(z, p)
            if not (np.isfinite(r).all() and np.isfinite(J).all()):
                raise self.failed(z, p, "an equation or its slope is not finite")
            for slopes, label in zip(J, self.labels, strict=True):
                if not slopes.any():
                    raise self.failed(z, p, f"{label} does not depend on what is free")
            scale = 1 + np.abs(z[self.where])
            weight = np.abs(J * scale).max(axis=1)
            M = J * scale / weight[:, None]
            if np.linalg.cond(M) > 1e13:
                raise self.failed(z, p, "the equations do not tell the unknowns apart")
            correction = -np.linalg.solve(M, r / weight)
            left = self._shorten(z, p, scale * correction, lambda r, M=M, w=weight:
                                 float(np.abs(np.linalg.solve(M, r / w)).max()))  # fmt: skip
            if left <= CLOSE:  # and once more, to rounding
                r, J = self.at(z, p)
                z[self.where] = np.clip(z[self.where] - np.linalg.solve(J, r), self.lo, self.hi)
                return step + 1
        raise self.failed(z, p, f"not found in {NEWTON_STEPS} steps")

    def _shorten(self, z: np.ndarray, p: Any, move: np.ndarray, distance: Any) -> float:
        """Go along ``move``, halved until the next correction is smaller; returns its size."""
        before = distance(self.at(z, p)[0])
        damping = 1.0
        while damping > 1e-8:
            trial = z.copy()
            trial[self.where] = np.clip(z[self.where] + damping * move, self.lo, self.hi)
            r, _ = self.at(trial, p)
            after = distance(r) if np.isfinite(r).all() else np.inf
            if after <= max((1 - damping / 4) * before, CLOSE):
                z[:] = trial
                return after
            damping /= 2
        raise self.failed(z, p, "no step gets closer")

    def failed(self, z: np.ndarray, p: Any, why: str) -> RunFailed:
        """Failure that says how far it got and what is left over."""
        values = zip(self.names, z[self.where], self.lo, self.hi, strict=True)
        point = ", ".join(
            f"{n} = {v:.6g}" + (" (end of its range)" if v in (lo, hi) else "")
            for n, v, lo, hi in values
        )
        left = zip(self.labels, self.at(z, p)[0], strict=True)
        return RunFailed(
            f"operating_point({self.block.name}): {why}; at {point} there remains"
            f" {', '.join(f'{e} = {v:.3g}' for e, v in left)};"
            f" start elsewhere, free={{{self.names[0]!r}: value}}"
        )


def _packed(block: Block, at: At) -> tuple[Any, Any, Any]:
    """Packed states, inputs and parameters of a point."""
    if isinstance(at, OperatingPoint):
        settable = {k: v for k, v in at.params.items() if not block.params[k].derived}
        at = {**at.states, **at.inputs, **settable}
    numbers = {block.find(k, "state", "input", "param"): v for k, v in (at or {}).items()}
    x, u, p = block.point(**numbers)
    return block.pack("state", x), block.pack("input", u), block.pack("param", p)


def _places(block: Block, *roles: str) -> dict[str, dict[int, str]]:
    """Elements of each signal of the roles, one after the other: place and name, ``x[1]``."""
    places: dict[str, dict[int, str]] = {}
    at = 0
    for role in roles:
        for n, s in block._signals[role].items():
            # column by column, as the block packs a matrix
            index = [k[::-1] for k in np.ndindex(*s.shape[::-1])]
            text = [n + (f"[{','.join(map(str, k))}]" if k else "") for k in index]
            places.setdefault(n, dict(enumerate(text, start=at)))
            at += s.size
    return places


def _elements(block: Block, *roles: str) -> dict[int, str]:
    return {k: e for elements in _places(block, *roles).values() for k, e in elements.items()}


def _chosen(block: Block, names: Iterable[str], *roles: str) -> dict[int, str]:
    """Place and name of the elements of the chosen signals."""
    places = _places(block, *roles)
    return {k: e for n in names for k, e in places[block.find(n, *roles)].items()}


def _plain(names: Iterable[str]) -> list[str]:
    """Names without dots, as python-control wants them, all different."""
    plain: list[str] = []
    for n in names:
        name = n.replace(".", "_")
        while name in plain:
            name += "_"
        plain.append(name)
    return plain


def _sampling(block: Block) -> float | bool | None:
    """Time base of python-control: 0 continuous, a period, True if it is open, None for a law."""
    if block.kind == "law":
        return None
    return 0 if block.kind == "flow" else block.period or True


def _refuse_kinks(block: Block, slopes: np.ndarray, of: list[str], by: list[str]) -> None:
    bad = np.argwhere(~np.isfinite(slopes))
    if len(bad):
        i, j = bad[0]
        raise BadInput(
            f"linear({block.name}): the slope of {of[i]} by {by[j]} is {slopes[i, j]} there;"
            f" give another point in at="
        )
