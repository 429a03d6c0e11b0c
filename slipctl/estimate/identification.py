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
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from slipctl.block.block import Block, Exprs, make_block
from slipctl.block.connection import connect
from slipctl.block.signals import Output, Param, Signal, State
from slipctl.block.transforms.discretisation import every
from slipctl.errors import BadInput, check_positive
from slipctl.estimate import misfit
from slipctl.estimate.misfit import SURE, advice_for, information_numbers
from slipctl.estimate.model import known_parameters, stack_column
from slipctl.seek import random as wh
from slipctl.seek.swarm import particle_swarm


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
    measured, names, rows = misfit.regressor(law, measured, unknown)
    where = f"identify({law.name})"
    check_positive(f"{where}: accuracy", accuracy)
    check_positive(f"{where}: largest_condition", largest_condition)
    n = len(names)
    inputs, m = misfit.columns(where, law, data, measured)
    N = len(m)
    if n >= N:
        raise BadInput(f"{where}: {N} samples for {n} parameters; give {n + 1} or more")
    fixed = law.param_values()
    constants = stack_column(ca.DM(fixed[s.name]) for s in known_parameters(law, names))
    H, offset = rows(inputs, constants)
    m = m - offset
    R_z: Any = np.linalg.qr(np.column_stack([H, m]), mode="r")
    R, z, q = R_z[:n, :n], R_z[:n, n], abs(float(R_z[n, n]))
    condition, noise = float(np.linalg.cond(R)), q / math.sqrt(N - n)

    def advice(values: np.ndarray) -> str:
        return advice_for(law, rows, constants, inputs, noise, values, accuracy, largest_condition)

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
        found = search(rng=np.array(wh.state_from_seed(seed)), **information_numbers(R, z))[1]
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
    measured, names, _ = misfit.regressor(law, measured, list(over))
    for k, (low, high) in over.items():
        for limit in (low, high):
            law.params[k].check(f"misfit_search({law.name}): range of {k}", limit)
    return particle_swarm(misfit.misfit(law, measured, names), over, "J", **settings)


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
        ``residual`` of the new sample before it was used; ``deviation``, one per unknown.
        ``identified``, 1 when each is known to ``accuracy`` in 95 of 100 cases, for white noise;
        and ``R11`` ..., ``z1`` ..., ``q`` for a :func:`misfit_search`.

    Raises:
        BadInput: a law that is not linear in the unknowns, unknown names, no value to start from.
    """
    measured, names, rows = misfit.regressor(law, measured, unknown)
    n, where = len(names), f"linear_fit({law.name})"
    centre = [law.params[k].value for k in names]
    if any(c is None for c in centre):
        raise BadInput(f"{where}: give {names[centre.index(None)]} a value in {law.name} to start")
    about = [abs(c) for c in centre] if spread is None else list(spread)
    if len(about) != n or not all(s > 0 and math.isfinite(s) for s in about):
        raise BadInput(f"{where}: spread needs {n} positive numbers, of {', '.join(names)}")
    known, y = known_parameters(law, names), law.outputs[measured]
    block = make_block(
        "linear_fit", "step", _rotations(law, measured, names, rows.function, known),
        states=[
            State("1", 0.0, "R and z, each in its units", shape=(n, n + 1)).named("Rz"),
            State(y.unit, 0.0, "root of the sum of squares that no parameter explains").named("q"),
            State("1", 0.0, "samples, faded ones by their weight").named("count"),
        ],
        inputs=[*law.inputs.values(), y.as_role("input", value=None, doc=f"measured {y.doc}")],
        params=[*_weights(y.unit, about, centre), *known],
        outputs=[
            *(Output(law.params[k].unit, f"estimate: {law.params[k].doc}").named(k) for k in names),
            Output(y.unit, "measurement minus prediction").named("residual"),
            Output("1", "standard deviations of the unknowns", shape=(n,)).named("deviation"),
            Output("1", "1 when the data tell all unknowns").named("identified"),
            *(s.as_role("output", value=None) for s in misfit.information(law, measured, names)),
            Output(y.unit, "data: what no parameter explains").named("q"),
        ],
        period=period, sx=False, doc=_DOC,
        choices={"law": law.name, "unknown": ", ".join(names)},
    )  # fmt: skip
    return block.with_params(**numbers) if numbers else block


def _weights(unit: str, about: Sequence[float], centre: Sequence[Any]) -> list[Signal]:
    """Parameters of recursive least squares: what counts how much, and what is known besides."""
    n = len(centre)
    return [
        Param("1", 1.0, "weight of the past, per sample", lo=1e-3, hi=1).named("forgetting"),
        Param(unit, 1e-2, "standard deviation of a sample, for the weight of what is known"
              " besides", lo=1e-12).named("noise"),
        Param("1", np.array(about), "deviation of the unknowns before any sample",
              lo=1e-12, shape=(n,)).named("spread"),
        Param("1", np.array(centre, dtype=float), "the unknowns before any sample",
              shape=(n,)).named("centre"),
        Param("1", 0.05, "share of its value to which each unknown is wanted",
              lo=1e-9).named("accuracy"),
    ]  # fmt: skip


def _rotations(
    law: Block, measured: str, names: Sequence[str], row: ca.Function, known: Sequence[Signal]
) -> Callable[..., Any]:
    """Body of recursive least squares: the row of a new sample is rotated into R, z and q."""
    n = len(names)
    rotate, solve = misfit.rotation(n), misfit.solution(n)

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        inputs = law.pack("input", {k: u[k] for k in law.inputs})
        _, slopes, offset = row(inputs, stack_column(p[s.name] for s in known))
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

    return body


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
    given = dict(unknown=list(over), spread=spread, period=period, **(fit or {}))
    samples = linear_fit(law, measured, **given)
    search = misfit_search(law, over, measured, **settings)
    wires = {f"search.{k}": f"fit.{k}" for k in search.inputs}
    wires |= {f"fit.{k}": k for k in samples.inputs}
    return connect("swarm_fit", wires, fit=samples, search=every(search, ticks))
