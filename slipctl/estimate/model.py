"""A law as a function of coordinates of its unknown parameters, with its exact Jacobian."""

from __future__ import annotations

import ast
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from slipctl.analysis.objective import settled_by
from slipctl.block.block import Block, Exprs
from slipctl.block.signals import Output, Param, Signal, State
from slipctl.block.text.intermediates import collect_locals, with_locals
from slipctl.block.text.named_expressions import evaluate, names_in
from slipctl.errors import BadInput, check_all_known, check_known, nearest


@dataclass(frozen=True)
class Model:
    """A law as a function of coordinates theta of its unknown parameters.

    Attributes:
        law: the law.
        measured: name of the measured output.
        unknown: names of the unknown parameters.
        coordinates: their coordinates, as expressions.
        guess: first guess of the coordinates.
        parameters: Function (theta) -> (unknown parameters, their Jacobian).
        output: Function (unknown parameters, inputs, known parameters) -> (output, Jacobian with
            respect to the unknown parameters).
    """

    law: Block
    measured: str
    unknown: tuple[str, ...]
    coordinates: tuple[str, ...]
    guess: np.ndarray
    parameters: ca.Function
    output: ca.Function

    @classmethod
    def of(
        cls, law: Block, measured: str | None, unknown: Sequence[str] | None,
        coordinates: Sequence[str] | None, start: Mapping[str, float] | None, plain: bool = False,
    ) -> Model:  # fmt: skip
        """Check what the user asked for and build the functions."""
        measured, unknown = measured_output(law, measured), unknown_parameters(law, unknown)
        told = {n for c in law.law_data.coordinates for n in names_in(c)}
        if coordinates is None and not plain and told == set(unknown):
            coordinates = law.law_data.coordinates
        if coordinates is None:
            coordinates = [n if plain or law.params[n].lo < 0 else f"log({n})" for n in unknown]
        values = {n: law.params[n].value for n in unknown}
        if not isinstance(start, Mapping | None):
            raise BadInput(f"rls({law.name}): start = {start!r} is not {{{unknown[0]!r}: ...}}")
        for n, v in (start or {}).items():
            check_known(f"rls({law.name}): start has", n, unknown)
            values[n] = float(law.params[n].check(f"rls({law.name}): start of {n}", v))
        for n, v in values.items():
            if v is None:
                unit = law.params[n].unit
                raise BadInput(f"rls({law.name}): give start={{{n!r}: ...}} in {unit}")
        parameters, guess = _coordinate_map(law.name, unknown, tuple(coordinates), values)
        output = output_function(law, measured, unknown, settled=True)
        return cls(law, measured, unknown, tuple(coordinates), guess, parameters, output)

    @property
    def n(self) -> int:
        """Number of unknowns."""
        return len(self.unknown)

    def ends(self) -> tuple[float, float]:
        """Least and largest coordinate of a single unknown, by its range; infinite for several.

        Several may come back on a way beyond what each can be. One alone has none, and beyond its
        range the law may be flat, so that no step leads back.
        """
        if self.n > 1:
            return -math.inf, math.inf
        (name,), found = self.unknown, []
        for end in (self.law.params[name].lo, self.law.params[name].hi):
            try:
                _, at = _coordinate_map(self.law.name, self.unknown, self.coordinates, {name: end})
            except BadInput:  # a logarithm of 0
                at = np.array([-math.inf])
            found.append(float(at[0]))
        return min(found), max(found)

    def inputs(self) -> list[Signal]:
        """Inputs of an estimator: those of the law and the measurement."""
        if self.measured in self.law.inputs:
            raise BadInput(f"rls({self.law.name}): {self.measured!r} is an input of the law too")
        y = self.law.outputs[self.measured]
        return [*self.law.inputs.values(), y.as_role("input", doc=f"measured {y.doc}")]

    def known(self) -> list[Signal]:
        """Parameters of the law that an estimator takes as known, and what follows from them."""
        return settled_by(self.law, [s.name for s in known_parameters(self.law, self.unknown)])

    def outputs(self) -> list[Signal]:
        """Outputs of an estimator."""
        unit, n = self.law.outputs[self.measured].unit, self.n
        p = self.law.params
        covariance = Output("1", "covariance of the unknowns, in their units", shape=(n, n))
        return [
            *(Output(p[k].unit, f"estimate: {p[k].doc}").named(k) for k in self.unknown),
            Output(unit, "prediction of the new sample").named("predicted"),
            Output(unit, "measurement minus prediction").named("residual"),
            Output("1", "1 when the sample contradicts the estimate").named("changed"),
            covariance.named("covariance"),
        ]

    def sample(self, u: Exprs) -> tuple[Any, Any]:
        """Inputs of the law as one column, and the measurement."""
        return self.law.pack("input", {k: u[k] for k in self.law.inputs}), u[self.measured]

    def constants(self, p: Exprs) -> Any:
        """Known parameters as one column."""
        return stack_column(p[s.name] for s in self.known())

    def predict(self, theta: Any, inputs: Any, constants: Any) -> tuple[Any, Any]:
        """Output at theta and its regressor h, the exact Jacobian as a column."""
        values, slopes = self.parameters(theta)
        y, row = self.output(values, inputs, constants)
        return y, (row @ slopes).T

    def results(self, theta: Any, P: Any, predicted: Any, e: Any, changed: Any) -> Exprs:
        """Outputs from what an estimator found; P is the covariance of theta."""
        values, slopes = self.parameters(theta)
        found = {n: values[i] for i, n in enumerate(self.unknown)}
        return found | {
            "predicted": predicted, "residual": e, "changed": changed,
            "covariance": slopes @ P @ slopes.T,
        }  # fmt: skip

    def describe(self, form: str) -> dict[str, Any]:
        """Structural choices for the block."""
        return {"form": form, "law": self.law.name, "coordinates": ", ".join(self.coordinates)}


def theta_state(model: Model) -> Signal:
    """State: the coordinates."""
    names = ", ".join(model.coordinates)
    return State(
        "1", model.guess, f"coordinates {names}", shape=(model.n,), deviation="spread",
        truth=model.coordinates,
    ).named("theta")  # fmt: skip


def covariance_state(n: int) -> Signal:
    """State: covariance of the coordinates; all zero means not begun yet."""
    return State("1", 0.0, "covariance of theta", shape=(n, n)).named("P")


def spread_param(n: int, value: float) -> Signal:
    """Parameter: what is known of the coordinates without any sample."""
    return Param(
        "1", value, "standard deviation of theta before the first sample and after a change",
        "chosen; 1 is a factor e on what is logarithmic", lo=1e-6, shape=(n,), hi=1e12
    ).named("spread")  # fmt: skip


def measured_output(law: Block, measured: str | None) -> str:
    """Name of the measured output of a law; the only one if none is given."""
    if law.kind != "law":
        raise BadInput(f"{law.name} is a {law.kind}; only the parameters of a law can be estimated")
    if measured is None:
        if len(law.outputs) != 1:
            raise BadInput(f"{law.name}: say which output is measured{nearest('', law.outputs)}")
        return next(iter(law.outputs))
    check_known(f"{law.name} has no output", measured, law.outputs)
    return measured


def unknown_parameters(law: Block, unknown: Sequence[str] | None) -> tuple[str, ...]:
    """Names of the parameters to estimate, scalars that are no expression of others."""
    if unknown is None:
        unknown = [n for n, s in law.params.items() if not s.derived and s.shape == ()]
    for n in unknown:
        check_known(f"{law.name} has no parameter", n, law.params)
        if law.params[n].derived or law.params[n].shape != ():
            raise BadInput(f"{law.name}.{n} is derived or no scalar and cannot be estimated")
    if not unknown:
        raise BadInput(f"{law.name} has no parameter to estimate")
    if len(set(unknown)) < len(unknown):
        raise BadInput(f"{law.name}: an unknown parameter is named twice")
    return tuple(unknown)


def known_parameters(law: Block, unknown: Sequence[str]) -> list[Signal]:
    """Free parameters of a law that are not estimated."""
    return [s for n, s in law.params.items() if n not in unknown and not s.derived]


def output_function(
    law: Block, measured: str, unknown: Sequence[str], *, settled: bool = False
) -> ca.Function:
    """Function (unknown, inputs, known) -> (output, its exact Jacobian by the unknown).

    Args:
        law, measured, unknown: as of :func:`slipctl.rls`.
        settled: what is derived of the known parameters alone is among them, worked out already.
    """
    sym: Any = ca.SX.sym if law.sx else ca.MX.sym
    values = sym("values", len(unknown))
    inputs = sym("inputs", sum(s.size for s in law.inputs.values()))
    known = known_parameters(law, unknown)
    if settled:
        known = settled_by(law, [s.name for s in known])
    constants = sym("constants", sum(s.size for s in known))
    given = {n: values[i] for i, n in enumerate(unknown)}
    at = 0
    for s in known:
        piece = constants[at : at + s.size]
        given[s.name] = ca.reshape(piece, *s.shape) if len(s.shape) == 2 else piece
        at += s.size
    with collect_locals() as found:
        y = law.expr({}, law.unpack("input", inputs), law.derive(given))[1][measured]
    results = [y, ca.densify(ca.jacobian(y, values))]
    made = ca.Function(
        f"{law.name}_of", [values, inputs, constants], results,
        ["values", "inputs", "constants"], ["output", "row"], {"cse": True},
    )  # fmt: skip
    return with_locals(made, found) if law.sx else made


def stack_column(columns: Iterable[Any]) -> Any:
    """Stack expressions to one column; an empty one if there are none."""
    found = [ca.reshape(c, c.shape[0] * c.shape[1], 1) for c in columns]
    return ca.vertcat(*found) if found else ca.DM(0, 1)


def _coordinate_map(
    where: str, unknown: tuple[str, ...], coordinates: tuple[str, ...], values: Mapping[str, float]
) -> tuple[ca.Function, np.ndarray]:
    """Function theta -> (unknown parameters, Jacobian), and theta of the given values.

    Each coordinate is q_i or log q_i with q = M p + k; so p = M^-1 (exp(theta) or theta - k).
    """
    where = f"rls({where}): coordinates"
    if len(coordinates) != len(unknown):
        raise BadInput(f"{where} must be {len(unknown)}, one for each of {', '.join(unknown)}")
    inner = [_inside_log(c) for c in coordinates]
    p = ca.SX.sym("p", len(unknown))
    symbols = {n: p[i] for i, n in enumerate(unknown)}
    q = []
    texts = [inside or whole for inside, whole in zip(inner, coordinates, strict=True)]
    for text in texts:
        check_all_known(f"{where} use", names_in(text), symbols)
        q.append(ca.SX(evaluate(text, symbols, where)))
    M = ca.jacobian(ca.vertcat(*q), p)
    if ca.depends_on(M, p):
        raise BadInput(f"{where} must be linear in {', '.join(unknown)}, or log of what is linear")
    matrix = np.array(ca.DM(ca.evalf(M)).full())
    if np.linalg.matrix_rank(matrix) < len(unknown):
        raise BadInput(f"{where} {', '.join(coordinates)} do not give {', '.join(unknown)} back")
    constant = np.array(ca.DM(ca.evalf(ca.substitute(ca.vertcat(*q), p, 0 * p))).full()).ravel()
    first = matrix @ np.array([float(values[n]) for n in unknown]) + constant
    theta = ca.SX.sym("theta", len(unknown))
    found = [ca.exp(theta[i]) if inner[i] else theta[i] for i in range(len(unknown))]
    full = ca.DM(np.linalg.inv(matrix)) @ (ca.vertcat(*found) - ca.DM(constant))
    for inside, at in zip(inner, first, strict=True):
        if inside and not at > 0:
            raise BadInput(f"{where}: {inside} = {at:g} at the start; it must be positive")
    guess = np.array([math.log(a) if i else a for a, i in zip(first, inner, strict=True)])
    slopes = ca.densify(ca.jacobian(full, theta))
    found_at = ca.Function(
        "parameters", [theta], [full, slopes], ["theta"], ["values", "slopes"], {"cse": True}
    )
    return found_at, guess


def _inside_log(expression: str) -> str | None:
    """Argument of ``log(...)`` if that is all of the expression."""
    try:
        node = ast.parse(expression, mode="eval").body
    except SyntaxError:
        raise BadInput(f"coordinates: {expression!r} is not an expression") from None
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "log":
        return ast.unparse(node.args[0]) if len(node.args) == 1 else None
    return None
