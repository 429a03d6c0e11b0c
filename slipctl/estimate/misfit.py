"""Parts of :mod:`slipctl.estimate.identification`: a law's slopes, columns of data, R and z."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from slipctl.block.block import Block, Exprs, make_block
from slipctl.block.signals import Input, Output
from slipctl.errors import BadInput, check_known
from slipctl.estimate.model import measured_output, output_function, unknown_parameters
from slipctl.estimate.samples import samples_of

SURE = 1.96
"""Standard deviations within which 95 of 100 normal numbers lie."""


class Rows(NamedTuple):
    """Function (inputs, known) -> (output at zero unknowns, slopes); called on columns of data."""

    function: ca.Function

    def __call__(self, inputs: np.ndarray, constants: Any) -> tuple[np.ndarray, np.ndarray]:
        """Slopes, a row per sample, and output at zero unknowns, of inputs with a column each."""
        N = inputs.shape[1]
        _, slopes, offset = self.function.map(N)(inputs, ca.repmat(constants, 1, N))
        h = np.array(ca.DM(slopes).full()).reshape(-1)
        return h.reshape(N, -1), np.array(ca.DM(offset).full()).ravel()


def regressor(
    law: Block, measured: str | None, unknown: Sequence[str] | None
) -> tuple[str, tuple[str, ...], Rows]:
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
    return measured, names, Rows(ca.Function("rows", [inputs, known], [inputs, slopes, offset]))


def columns(
    where: str, law: Block, data: Mapping[Any, Any], measured: str
) -> tuple[np.ndarray, np.ndarray]:
    """Inputs (one row each) and the measurement, after a look at them."""
    wanted = [*law.inputs, measured]
    found: dict[str, np.ndarray] = {}
    for name in ("time", *wanted):
        if name in data:
            found[name] = samples_of(f"{where}: column {name}", data[name])
        elif name in law.inputs and law.inputs[name].value is not None:
            continue
        elif name != "time":
            check_known(f"{where}: no column", name, [str(k) for k in data])
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


def advice_for(
    law: Block, rows: Rows, constants: Any, inputs: np.ndarray, noise: float,
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


def information(law: Block, measured: str, names: Sequence[str]) -> list[Any]:
    """Inputs R and z; a column of R times its unknown has the unit measured."""
    y, n = law.outputs[measured].unit, len(names)
    per = [f"({y}) / ({law.params[k].unit})" for k in names]
    R = [Input(per[j], "data: R").named(f"R{i + 1}{j + 1}") for i in range(n) for j in range(i, n)]
    return [*R, *(Input(y, "data: z").named(f"z{i + 1}") for i in range(n))]


def information_numbers(R: np.ndarray, z: np.ndarray) -> dict[str, float]:
    """R and z by the names of :func:`information`."""
    n = len(z)
    found = {f"R{i + 1}{j + 1}": float(R[i, j]) for i in range(n) for j in range(i, n)}
    return found | {f"z{i + 1}": float(z[i]) for i in range(n)}


def misfit(law: Block, measured: str, names: Sequence[str]) -> Block:
    """Law (a; R, z) -> J - 1/2 q^2, half the sum of squares above that of least squares."""
    n, y = len(names), law.outputs[measured].unit

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        off = [sum(u[f"R{i + 1}{j + 1}"] * u[names[j]] for j in range(i, n)) - u[f"z{i + 1}"]
               for i in range(n)]  # fmt: skip
        return {}, {"J": sum((e**2 for e in off), start=ca.SX(0)) / 2}

    return make_block(
        f"{law.name}misfit", "law", body,
        inputs=[*(law.params[k].as_role("input", value=None) for k in names),
                *information(law, measured, names)],
        outputs=[Output(f"({y})^2", "half the sum of squares, above the least").named("J")],
        doc="J - 1/2 q^2 = 1/2 |R a - z|^2.",
    )  # fmt: skip


def rotation(n: int) -> ca.Function:
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


def solution(n: int) -> ca.Function:
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
