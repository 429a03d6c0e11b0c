"""Parameters in which a law is linear, from samples: least squares and a particle swarm.

With h the law's slopes by its n unknowns a, the samples m = h a + noise are known through the
triangular R, the column z and the number q of

    J(a) = 1/2 sum (m - h a)^2 = 1/2 |R a - z|^2 + 1/2 q^2

found by plane rotations (Givens). No sample has to be kept, and no square has to be subtracted from
another, so that it works in single precision too. Least squares solves R a = z; a swarm minimises
J - 1/2 q^2, which has its minimum at the same place and is not rounded off beside the noise. How
well the data determine a is cov a = (q^2/(N - n)) (R'R)^-1.

* :func:`identify`: from recorded samples to the parameters, and whether they tell them.
* :func:`linear_fit`: the same, recursive, as a block.
* :func:`misfit_search`: the swarm over J, a block; :func:`swarm_fit`: both in one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from slipctl import wichmann_hill as wh
from slipctl.block import Block, Exprs, make_block
from slipctl.connection import connect
from slipctl.errors import BadInput, nearest
from slipctl.estimate_model import (
    known_parameters,
    measured_output,
    output_function,
    stacked,
    unknown_parameters,
)
from slipctl.signals import Input, Output, Param, State
from slipctl.swarm import particle_swarm
from slipctl.timing import every

SURE = 1.96
"""Standard deviations within which 95 of 100 normal numbers lie."""


class Identified(NamedTuple):
    """What samples tell of a law's parameters.

    Attributes:
        values: estimates by name, in the units of the law.
        deviation: standard deviation of each, from the residual of least squares, for white noise.
        condition: condition number of the regressor, columns as they are.
        noise: root of the mean square residual of least squares, in the unit measured.
        identified: whether every parameter is known to ``accuracy`` in 95 of 100 cases.
        advice: if not, what would do.
    """

    values: dict[str, float]
    deviation: dict[str, float]
    condition: float
    noise: float
    identified: bool
    advice: str


def identify(
    law: Block,
    data: Mapping[Any, Any],
    measured: str | None = None,
    *,
    unknown: Sequence[str] | None = None,
    search: Block | None = None,
    seed: int = 1,
    accuracy: float = 0.05,
    largest_condition: float = 1e4,
) -> Identified:
    """Identify parameters of a law from samples of its inputs and its output.

    Args:
        law: linear in the unknowns.
        data: columns by name: the law's inputs, the measured output, and if there is a ``time`` it
            is checked. A mapping, a log of :func:`slipctl.simulate` or a data frame.
        measured: name of the output; may be left out if there is only one.
        unknown: parameters to identify, by default all.
        search: a :func:`misfit_search` of the same law; None is least squares.
        seed: of the search.
        accuracy: share of its value to which each parameter is wanted.
        largest_condition: of the regressor; beyond it the data are refused.

    Raises:
        BadInput: columns missing, unequal, not finite, or out of order; fewer samples than needed;
            data without excitation, with the excitation that would pass.
    """
    measured, names, rows = _regressor(law, measured, unknown)
    where = f"identify({law.name})"
    n = len(names)
    inputs, m = _columns(where, law, data, measured)
    N = len(m)
    if n >= N:
        raise BadInput(f"{where}: {N} samples for {n} parameters; give {n + 1} or more")
    fixed = law.param_values()
    constants = stacked(ca.DM(fixed[s.name]) for s in known_parameters(law, names))
    H, offset = rows(inputs, constants)
    m = m - offset
    R_z: Any = np.linalg.qr(np.column_stack([H, m]), mode="r")
    R, z, q = R_z[:n, :n], R_z[:n, n], abs(float(R_z[n, n]))
    condition, noise = float(np.linalg.cond(R)), q / math.sqrt(N - n)

    def advice(values: np.ndarray) -> str:
        return _advice(law, rows, constants, inputs, noise, values, accuracy, largest_condition)

    if not condition <= largest_condition:
        values = np.array([law.params[k].value for k in names], dtype=float)
        raise BadInput(
            f"{where}: data without excitation, condition number {condition:.3g}, above"
            f" {largest_condition:g}; {advice(values)}"
        )
    best = np.linalg.solve(R, z)
    deviation = noise * np.linalg.norm(np.linalg.inv(R), axis=1)
    sure = bool((SURE * deviation <= accuracy * np.abs(best)).all())
    values = best
    if search is not None:
        if list(search.outputs) != [*names, "value"]:
            raise BadInput(f"{where}: search has to be misfit_search of {', '.join(names)}")
        found = search(rng=np.array(wh.seeded(seed)), **_numbers(R, z))[1]
        values = np.array([found[k] for k in names])
    return Identified(
        dict(zip(names, values.tolist(), strict=True)),
        dict(zip(names, deviation.tolist(), strict=True)),
        condition, noise, sure, "" if sure else advice(best),
    )  # fmt: skip


def misfit_search(
    law: Block,
    over: Mapping[str, tuple[float, float]],
    measured: str | None = None,
    **settings: Any,
) -> Block:
    """Make the swarm that minimises J over the parameters of a law, given R and z.

    Args:
        law: linear in the unknowns.
        over: the unknowns, each with (lowest, highest).
        measured: name of the output; may be left out if there is only one.
        **settings: of :func:`slipctl.particle_swarm`.

    Returns:
        A step block. Inputs: ``R11``, ``R12``, ..., ``z1``, ... Outputs: the unknowns and
        ``value``, by how much J is above that of least squares.

    Raises:
        BadInput: a law that is not linear in the unknowns, unknown names, settings.
    """
    measured, names, _ = _regressor(law, measured, list(over))
    for k, (low, high) in over.items():
        for limit in (low, high):
            law.params[k].check(f"misfit_search({law.name}): range of {k}", limit)
    return particle_swarm(_misfit(law, measured, names), over, "J", **settings)


def linear_fit(
    law: Block,
    measured: str | None = None,
    *,
    unknown: Sequence[str] | None = None,
    spread: Sequence[float] | None = None,
    period: float | None = None,
    **numbers: Any,
) -> Block:
    """Make the recursive least squares of the parameters in which a law is linear.

    What is known besides is the law's own value of each unknown with the deviation ``spread``.
    With ``forgetting`` < 1 that knowledge returns as the samples fade, so that the estimate goes
    home, and does not run away, where nothing excites it.

    Args:
        law: linear in the unknowns.
        measured: name of the measured output; may be left out if there is only one.
        unknown: parameters to estimate, by default all; the others stay parameters.
        spread: standard deviation of each unknown before any sample, by default its value.
        period: sample period in s, if the block insists on one.
        **numbers: values of the block's parameters (``forgetting=0.999``, ``noise=0.02``).

    Returns:
        A step block. Inputs: those of the law, and the measurement. Outputs: the unknowns by name;
        ``residual`` of the new sample before it was used; ``deviation``, one per unknown;
        ``identified``, 1 when each is known to ``accuracy`` in 95 of 100 cases, for white noise;
        and ``R11`` ..., ``z1`` ..., ``q`` for a :func:`misfit_search`.

    Raises:
        BadInput: a law that is not linear in the unknowns, unknown names, no value to start from.
    """
    measured, names, rows = _regressor(law, measured, unknown)
    n, where = len(names), f"linear_fit({law.name})"
    centre = [law.params[k].value for k in names]
    if any(c is None for c in centre):
        raise BadInput(f"{where}: give {names[centre.index(None)]} a value in {law.name} to start")
    about = [abs(c) for c in centre] if spread is None else list(spread)
    if len(about) != n or not all(s > 0 and math.isfinite(s) for s in about):
        raise BadInput(f"{where}: spread needs {n} positive numbers, of {', '.join(names)}")
    known, y = known_parameters(law, names), law.outputs[measured]
    rotate, solve = _rotation(n), _solution(n)

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        inputs = law.pack("input", {k: u[k] for k in law.inputs})
        _, slopes, offset = rows.function(inputs, stacked(p[s.name] for s in known))
        prior = ca.diag(p["noise"] / p["spread"])
        before = ca.horzcat(prior, prior @ p["centre"])
        lam, begins = p["forgetting"], x["count"] == 0
        keep, back = ca.sqrt(lam), ca.sqrt(1 - lam)
        Rz, q = keep * ca.if_else(begins, before, x["Rz"]), keep * x["q"]
        residual = u[measured] - offset - slopes @ solve(Rz, 0, 1)[0]
        for k in range(n):  # nothing where lam = 1
            Rz, q = rotate(Rz, q, back * before[k, :])
        Rz, q = rotate(Rz, q, ca.horzcat(slopes, u[measured] - offset))
        count = lam * x["count"] + 1
        a, deviation = solve(Rz, q, count)
        sure = SURE * deviation <= p["accuracy"] * ca.fabs(a)
        results = {k: a[i] for i, k in enumerate(names)} | {
            "residual": residual, "deviation": deviation,
            "identified": ca.logic_and(count > 2 * n, ca.mmin(sure) > 0),
        }  # fmt: skip
        results |= {f"R{i + 1}{j + 1}": Rz[i, j] for i in range(n) for j in range(i, n)}
        results |= {f"z{i + 1}": Rz[i, n] for i in range(n)} | {"q": q}
        return {"Rz": Rz, "q": q, "count": count}, results

    block = make_block(
        "linear_fit", "step", body,
        states=[
            State("1", 0.0, "R and z, each in its units", shape=(n, n + 1)).named("Rz"),
            State(y.unit, 0.0, "root of the sum of squares that no parameter explains").named("q"),
            State("1", 0.0, "samples, faded ones by their weight").named("count"),
        ],
        inputs=[*law.inputs.values(), y.as_role("input", value=None, doc=f"measured {y.doc}")],
        params=[
            Param("1", 1.0, "weight of the past, per sample", lo=1e-3, hi=1).named("forgetting"),
            Param(y.unit, 1e-2, "standard deviation of a sample, for the weight of what is known"
                  " besides", lo=1e-12).named("noise"),
            Param("1", np.array(about), "deviation of the unknowns before any sample",
                  lo=1e-12, shape=(n,)).named("spread"),
            Param("1", np.array(centre, dtype=float), "the unknowns before any sample",
                  shape=(n,)).named("centre"),
            Param("1", 0.05, "share of its value to which each unknown is wanted",
                  lo=1e-9).named("accuracy"),
            *known,
        ],
        outputs=[
            *(Output(law.params[k].unit, f"estimate: {law.params[k].doc}").named(k) for k in names),
            Output(y.unit, "measurement minus prediction").named("residual"),
            Output("1", "standard deviations of the unknowns", shape=(n,)).named("deviation"),
            Output("1", "1 when the data tell all unknowns").named("identified"),
            *(s.as_role("output", value=None) for s in _information(law, measured, names)),
            Output(y.unit, "data: what no parameter explains").named("q"),
        ],
        period=period, sx=False, doc=_DOC,
        choices={"law": law.name, "unknown": ", ".join(names)},
    )  # fmt: skip
    return block.with_params(**numbers) if numbers else block


_DOC = """Recursive least squares by plane rotations, for a law linear in its unknowns.

[R z; 0 q] is rotated so that the row (h, m) of the new sample becomes zero; R a = z gives the
unknowns, q^2/(N - n) (R'R)^-1 their covariance. With forgetting lam < 1 the rows of what is known
besides come back with weight 1 - lam."""


def swarm_fit(
    law: Block,
    over: Mapping[str, tuple[float, float]],
    measured: str | None = None,
    *,
    ticks: int = 1,
    period: float | None = None,
    fit: Mapping[str, Any] | None = None,
    **settings: Any,
) -> Block:
    """Make the identification by swarm as a block: sums of every sample, a search now and then.

    Args:
        law: linear in the unknowns.
        over: the unknowns, each with (lowest, highest).
        measured: name of the measured output; may be left out if there is only one.
        ticks: from one search to the next.
        period: sample period in s, if the block insists on one.
        fit: values of parameters of the :func:`linear_fit`.
        **settings: of :func:`slipctl.particle_swarm`.

    Returns:
        A step block with parts ``fit`` (:func:`linear_fit`) and ``search``
        (:func:`misfit_search`); the estimates of the swarm are ``search.<unknown>``.

    Raises:
        BadInput: as the two.
    """
    spread = [hi - lo for lo, hi in over.values()]
    samples = linear_fit(
        law, measured, unknown=list(over), spread=spread, period=period, **(fit or {})
    )
    search = misfit_search(law, over, measured, **settings)
    wires = {f"search.{k}": f"fit.{k}" for k in search.inputs}
    wires |= {f"fit.{k}": k for k in samples.inputs}
    return connect("swarm_fit", wires, fit=samples, search=every(search, ticks))


# ---- parts ---------------------------------------------------------------------------------------


class _Rows(NamedTuple):
    """Function (inputs, known) -> (output at zero unknowns, slopes); called on columns of data."""

    function: ca.Function

    def __call__(self, inputs: np.ndarray, constants: Any) -> tuple[np.ndarray, np.ndarray]:
        N = inputs.shape[1]
        _, slopes, offset = self.function.map(N)(inputs, ca.repmat(constants, 1, N))
        h = np.array(ca.DM(slopes).full()).reshape(-1)
        return h.reshape(N, -1), np.array(ca.DM(offset).full()).ravel()


def _regressor(
    law: Block, measured: str | None, unknown: Sequence[str] | None
) -> tuple[str, tuple[str, ...], _Rows]:
    """Measured output, names of the unknowns, and their slopes; refuses what is not linear."""
    measured, names = measured_output(law, measured), unknown_parameters(law, unknown)
    if not 1 <= len(names) <= 9:
        raise BadInput(f"{law.name}: {len(names)} unknowns; give 1 to 9")
    f = output_function(law, measured, names)
    if f.jac_sparsity(1, 0).nnz():
        raise BadInput(
            f"{law.name}: {measured} is not linear in {', '.join(names)}; rls(...) takes it"
        )
    inputs, known = ca.MX.sym("inputs", f.size1_in(1)), ca.MX.sym("known", f.size1_in(2))
    offset, slopes = f(ca.MX.zeros(len(names)), inputs, known)
    return measured, names, _Rows(ca.Function("rows", [inputs, known], [inputs, slopes, offset]))


def _columns(
    where: str, law: Block, data: Mapping[Any, Any], measured: str
) -> tuple[np.ndarray, np.ndarray]:
    """Inputs (one row each) and the measurement, after a look at them."""
    wanted = [*law.inputs, measured]
    found: dict[str, np.ndarray] = {}
    for name in ("time", *wanted):
        if name in data:
            found[name] = np.asarray(getattr(data[name], "values", data[name]), dtype=float)
        elif name in law.inputs and law.inputs[name].value is not None:
            continue
        elif name != "time":
            raise BadInput(f"{where}: no column {name!r}{nearest(name, [str(k) for k in data])}")
    N = found[measured].size
    for name, column in found.items():
        if column.shape != (N,):
            raise BadInput(
                f"{where}: column {name} has shape {column.shape}, {measured} {(N,)}; give one"
                " number per sample in each"
            )
        bad = np.flatnonzero(~np.isfinite(column))
        if bad.size:
            raise BadInput(f"{where}: {name} is {column[bad[0]]} in row {bad[0]}; leave it out")
    if "time" in found and (late := np.flatnonzero(np.diff(found["time"]) <= 0)).size:
        k = int(late[0]) + 1
        raise BadInput(
            f"{where}: time goes from {found['time'][k - 1]:g} to {found['time'][k]:g} s in row"
            f" {k}; sort the rows by time and leave out doubles"
        )
    rows = [found.get(k, np.full(N, law.inputs[k].value, dtype=float)) for k in law.inputs]
    return np.vstack(rows), found[measured]


def _advice(
    law: Block, rows: _Rows, constants: Any, inputs: np.ndarray, noise: float,
    values: np.ndarray, accuracy: float, largest_condition: float,
) -> str:  # fmt: skip
    """What data would pass: a wider range of the input, if there is one input; or more samples."""
    N = inputs.shape[1]

    def off(x: np.ndarray) -> tuple[float, float]:
        """Condition, and the worst uncertainty over the one that is wanted."""
        H, _ = rows(x, constants)
        condition = float(np.linalg.cond(H))
        if not condition < 1e12:
            return condition, math.inf
        scale = noise * math.sqrt(x.shape[1] / N)
        spread = scale * np.linalg.norm(np.linalg.pinv(H), axis=1)
        return condition, float(np.max(SURE * spread / (accuracy * np.abs(values))))

    said = []
    if len(inputs) == 1:
        (signal,) = law.inputs.values()
        low, top = float(inputs.min()), float(inputs.max())
        wide, short = max(top - low, 0.01 * abs(top), 1e-3), 0.0

        def passes(span: float) -> bool:
            condition, worst = off(np.linspace(low, low + span, 200).reshape(1, -1))
            return condition <= largest_condition and worst <= 1

        while not passes(wide) and wide < 1e4 * max(abs(top), 1.0):
            wide, short = 1.5 * wide, wide
        for _ in range(12 if passes(wide) else 0):
            middle = (wide + short) / 2
            wide, short = (middle, short) if passes(middle) else (wide, middle)
        if passes(wide):
            said.append(
                f"{N} samples spread evenly over {signal.name} = {low:.3g} to"
                f" {1.005 * (low + wide):.3g} {signal.unit} would pass"
            )
    condition, worst = off(inputs)
    if condition <= largest_condition and math.isfinite(worst) and worst > 1:
        said.append(f"{math.ceil(N * worst**2)} samples like these would pass")
    return "; or ".join(said) or "vary the inputs more"


def _information(law: Block, measured: str, names: Sequence[str]) -> list[Any]:
    """Inputs R and z; a column of R times its unknown has the unit measured."""
    y, n = law.outputs[measured].unit, len(names)
    per = [f"({y}) / ({law.params[k].unit})" for k in names]
    return [
        *(
            Input(per[j], "data: R").named(f"R{i + 1}{j + 1}")
            for i in range(n)
            for j in range(i, n)
        ),
        *(Input(y, "data: z").named(f"z{i + 1}") for i in range(n)),
    ]


def _numbers(R: np.ndarray, z: np.ndarray) -> dict[str, float]:
    n = len(z)
    found = {f"R{i + 1}{j + 1}": float(R[i, j]) for i in range(n) for j in range(i, n)}
    return found | {f"z{i + 1}": float(z[i]) for i in range(n)}


def _misfit(law: Block, measured: str, names: Sequence[str]) -> Block:
    """Law (a; R, z) -> J - 1/2 q^2, half the sum of squares above that of least squares."""
    n, y = len(names), law.outputs[measured].unit

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        off = [sum(u[f"R{i + 1}{j + 1}"] * u[names[j]] for j in range(i, n)) - u[f"z{i + 1}"]
               for i in range(n)]  # fmt: skip
        return {}, {"J": sum((e**2 for e in off), start=ca.SX(0)) / 2}

    return make_block(
        f"{law.name}_misfit", "law", body,
        inputs=[*(law.params[k].as_role("input", value=None) for k in names),
                *_information(law, measured, names)],
        outputs=[Output(f"({y})^2", "half the sum of squares, above the least").named("J")],
        doc="J - 1/2 q^2 = 1/2 |R a - z|^2.",
    )  # fmt: skip


def _rotation(n: int) -> ca.Function:
    """Function (Rz, q, row) -> (Rz, q): the row is rotated into the triangle."""
    Rz, q, row = ca.SX.sym("Rz", n, n + 1), ca.SX.sym("q"), ca.SX.sym("row", 1, n + 1)
    A, h = ca.SX(Rz), ca.SX(row)
    for k in range(n):
        length = ca.sqrt(A[k, k] ** 2 + h[k] ** 2)
        none = length == 0
        c = ca.if_else(none, 1, A[k, k] / ca.if_else(none, 1, length))
        s = ca.if_else(none, 0, h[k] / ca.if_else(none, 1, length))
        for j in range(k, n + 1):
            A[k, j], h[j] = c * A[k, j] + s * h[j], c * h[j] - s * A[k, j]
    return ca.Function("rotate", [Rz, q, row], [A, ca.sqrt(q**2 + h[n] ** 2)], {"cse": True})


def _solution(n: int) -> ca.Function:
    """Function (Rz, q, count) -> (a, standard deviations), by back substitution."""
    Rz, q, count = ca.SX.sym("Rz", n, n + 1), ca.SX.sym("q"), ca.SX.sym("count")
    inverse = ca.SX.zeros(n, n)
    for j in range(n):
        for i in range(j, -1, -1):
            rest = sum((Rz[i, k] * inverse[k, j] for k in range(i + 1, j + 1)), start=ca.SX(0))
            inverse[i, j] = (float(i == j) - rest) / Rz[i, i]
    a = ca.SX.zeros(n)
    for i in range(n - 1, -1, -1):
        done = sum((Rz[i, k] * a[k] for k in range(i + 1, n)), start=ca.SX(0))
        a[i] = (Rz[i, n] - done) / Rz[i, i]
    noise = q / ca.sqrt(ca.fmax(count - n, 1))
    deviation = noise * ca.sqrt(ca.sum2(inverse**2))
    return ca.Function("solve", [Rz, q, count], [a, deviation], {"cse": True})
