"""Parameters of a law from its measured inputs and output, by least squares.

Any law ``m = f(u; p)`` will do: the regressor is its exact Jacobian. What is estimated is a vector
of coordinates, logarithms of what has to stay positive (``coordinates=("log(c)", "log(b - a)")``),
so that no step can leave the curves that make sense.

* :func:`rls`: the estimator, recursive or over a window.
* :func:`probe`: the reference that goes to the estimated peak, and past it while it is unsure.
* :func:`peak_bound`: how well given samples can tell a peak at all.
* :func:`opened`: the law with its parameters as inputs, to be fed with the estimate.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca

from slipctl.block.block import Block, Exprs, as_block, make_block
from slipctl.block.signals import Param, State
from slipctl.errors import BadInput, check_known, check_positive, check_whole
from slipctl.estimate.model import (
    Model,
    covariance_state,
    known_parameters,
    spread_param,
    theta_state,
    unknown_parameters,
)
from slipctl.estimate.peak import PeakBound, peak_bound, probe

__all__ = ["FORMS", "PeakBound", "opened", "peak_bound", "probe", "rls"]

FORMS = ("recursive", "window", "printed-16")


def rls(
    law: Block,
    measured: str | None = None,
    *,
    unknown: Sequence[str] | None = None,
    coordinates: Sequence[str] | None = None,
    start: Mapping[str, float] | None = None,
    form: str = "recursive",
    period: float = 0.016,
    window: int = 128,
    iterations: int = 6,
    iterations_per_tick: int | None = None,
    memory: int = 1,
    echo: float = 0.0,
    recall: int = 0,
    **numbers: float,
) -> Block:
    """Make an estimator of a law's parameters from measured inputs and a measured output.

    Args:
        law: from inputs and parameters to the measured output.
        measured: name of that output; may be left out if there is only one.
        unknown: parameters to estimate, by default all; the others stay parameters.
        coordinates: one expression per unknown, linear in the unknowns or the logarithm of such a
            one. By default what the law declares, else ``log(p)`` for a parameter that cannot be
            negative and ``p`` for any other.
        start: first guess of the unknowns, by default their values in the law.
        form: ``"recursive"``: one step of least squares with forgetting per sample.
            ``"window"``: Gauss-Newton over the samples since the last change
            (:mod:`slipctl.estimate.window`). ``"printed-16"``: eqs (15)-(19) of Huang 2020 as
            printed, which cannot work (docs/errata.md).
        period: sample period in s.
        window: samples kept, for ``form="window"``.
        iterations: Gauss-Newton iterations per sample, for ``form="window"``.
        iterations_per_tick: how many to do per tick, by default all. Fewer spread a fit over
            several ticks, which take no sample but the first; the last estimate is held meanwhile.
        memory: latest samples in which a change is looked for, for ``form="window"``: 1 takes the
            newest residual alone, more the generalised likelihood ratio of a shift in them.
        echo: share of the noise of a sample that comes back with the opposite sign in the next,
            0 to 1, for ``form="window"``. 1 for what is formed from increments of a noisy
            quantity, sample to sample; the noise is then that of one of the two.
        recall: samples in a row, for ``form="window"``, that have to agree with the estimate before
            the last change so that it is in force again; 0 forgets it. Then there is an output
            ``recalled``, 1 when that happens.
        **numbers: values of the block's parameters (``noise=1e-3``).

    Returns:
        A step block. Inputs: those of the law, and the measurement. Outputs: the unknowns by name,
        ``predicted`` and ``residual`` of the new sample before it was used, and ``covariance`` of
        the unknowns in their units. ``changed`` is 1 when the sample contradicts the estimate, so
        that it starts afresh.

    Raises:
        BadInput: not a law, an unknown name or form, coordinates that do not give the unknowns
            back, or a number that is no parameter.
    """
    as_block("rls: the law", law)
    check_known("rls has no form", form, FORMS)
    check_positive(f"rls({law.name}): period", period, "s")
    for word, count in (("window", window), ("iterations", iterations), ("memory", memory)):
        check_whole(f"rls({law.name}): {word}", count)
    _check_window(law.name, form, iterations, iterations_per_tick, echo, recall)
    if form == "printed-16" and not (coordinates is None and start is None):
        raise BadInput("rls(form='printed-16') starts at zero and has no other coordinates")
    model = Model.of(law, measured, unknown, coordinates, start, plain=form == "printed-16")
    if form == "window":
        from slipctl.estimate.window import windowed_estimator

        block = windowed_estimator(
            model, period, int(window), int(iterations), int(memory), float(echo), int(recall),
            iterations_per_tick,
        )  # fmt: skip
    else:
        block = (_recursive if form == "recursive" else _printed_16)(model, period)
    return block.with_params(**numbers) if numbers else block


def _check_window(
    name: str, form: str, iterations: int, iterations_per_tick: int | None, echo: float, recall: int
) -> None:
    """Refuse what only the fit over a window has, for another form, and what it cannot do."""
    if iterations_per_tick is not None:
        what = f"rls({name}): iterations_per_tick"
        check_whole(what, iterations_per_tick, 1, int(iterations))
        if form != "window":
            raise BadInput(f"{what}: form={form!r} has no iterations; leave it out")
        if iterations % iterations_per_tick:
            raise BadInput(
                f"{what} = {iterations_per_tick} must divide the {iterations} iterations of a fit"
            )
    if not (isinstance(echo, int | float) and 0 <= echo <= 1):
        raise BadInput(f"rls({name}): echo = {echo!r} must be from 0 to 1")
    if echo and form != "window":
        raise BadInput(f"rls({name}, form={form!r}) takes noise as white; echo needs 'window'")
    check_whole(f"rls({name}): recall", recall, least=0)
    if recall and (form != "window" or echo):
        raise BadInput(f"rls({name}): recall needs form='window' and echo=0")


def _recursive(model: Model, period: float) -> Block:
    n, unit = model.n, model.law.outputs[model.measured].unit

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        theta, lam, R = x["theta"], p["forgetting"], p["noise"] ** 2
        P_0 = ca.diag(p["spread"] ** 2)
        inputs, measurement = model.sample(u)
        predicted, h = model.predict(theta, inputs, model.constants(p))
        e = measurement - predicted
        changed = ca.fabs(e) > p["jump"]
        begins = ca.trace(x["P"]) == 0
        P = ca.if_else(ca.logic_or(changed, begins), P_0, x["P"])
        g = P @ h / (lam * R + h.T @ P @ h)
        theta = theta + g * e
        P = (P - g @ (h.T @ P)) / lam
        P = (P + P.T) / 2  # rounding errors would grow as lam^-k otherwise
        P = P * ca.fmin(1, p["cap"] * ca.trace(P_0) / ca.trace(P))
        return {"theta": theta, "P": P}, model.results(theta, P, predicted, e, changed)

    weight = Param("1", 0.98, "weight of the past, per sample", "chosen", lo=1e-3, hi=1)
    noise = Param(unit, 1e-2, "standard deviation of the measurement", "chosen", lo=1e-12, hi=1e12)
    return make_block(
        "rls", "step", body,
        states=[theta_state(model), covariance_state(n)], inputs=model.inputs(),
        params=[
            weight.named("forgetting"), noise.named("noise"), spread_param(n, 1.0),
            Param(unit, 0.02, "residual that re-opens P", "chosen", lo=0, hi=1e12).named("jump"),
            Param("1", 1.0, "largest trace of P over that of its start", lo=1e-3,
                  hi=1e12).named("cap"),
            *model.known(),
        ],
        outputs=model.outputs(), period=period, sx=False,
        choices=model.describe("recursive"), doc=_RECURSIVE,
    )  # fmt: skip


_RECURSIVE = """Recursive least squares on the exact Jacobian of the law.

e = m - f(u; theta),  h = df/dtheta at the last theta,  g = P h/(lam R + h'P h),
theta+ = theta + g e,  P+ = (P - g h'P)/lam, scaled down where its trace passes the cap. Before
that, P starts afresh where |e| > jump, because the rail has changed."""


def _printed_16(model: Model, period: float) -> Block:
    n = model.n
    if len(model.law.inputs) != 1:
        raise BadInput(f"rls({model.law.name}, form='printed-16') needs a law with one input")

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        beta, lam = x["theta"], p["forgetting"]
        P = ca.if_else(ca.trace(x["P"]) == 0, ca.DM.eye(n), x["P"])  # P_0 = I
        v_s, measurement = model.sample(u)
        predicted, _ = model.predict(beta, v_s, model.constants(p))
        e = measurement - predicted
        h = ca.repmat(v_s, n, 1)  # the printed regressor: the slip itself, for every component
        pi = P @ h  # (16)
        g = pi / (lam + h.T @ pi)  # (17)
        xi = ca.fmax(e, 0)  # (18)
        beta = beta + g * xi  # (19)
        P = (P - g @ (h.T @ P)) / lam  # (15)
        return {"theta": beta, "P": P}, model.results(beta, P, predicted, e, 0)

    beta_0 = State(
        "1", 0.0, "beta, started at 0 as printed", shape=(n,), deviation="1",
        truth=model.coordinates,
    )  # fmt: skip
    weight = Param("1", 0.98, "lambda; no value is printed", "guess", lo=1e-3, hi=1)
    return make_block(
        "rls", "step", body, states=[beta_0.named("theta"), covariance_state(n)],
        inputs=model.inputs(),
        params=[weight.named("forgetting"), *model.known()],
        outputs=model.outputs(), period=period, sx=False, units="printed",
        choices=model.describe("printed-16"),
        doc="Huang 2020 eqs (15)-(19) as printed, with sigma = 1: regressor v_s, beta_0 = 0,"
        " negative errors cut to 0. Every component stays the same number (docs/errata.md).",
    )  # fmt: skip


def opened(law: Block, *names: str) -> Block:
    """Return the law with parameters as inputs, so that an estimator can feed them.

    Args:
        law: a law.
        *names: the parameters; all if none is named.

    Raises:
        BadInput: unknown or derived parameter.
    """
    names = unknown_parameters(law, names or None)
    kept = known_parameters(law, names)

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        free = {n: u[n] for n in names} | {s.name: p[s.name] for s in kept}
        return {}, law.expr({}, {n: u[n] for n in law.inputs}, law.derive(free))[1]

    return make_block(
        law.name, "law", body,
        inputs=[*law.inputs.values(), *(law.params[n].as_role("input", value=None) for n in names)],
        params=kept, outputs=law.outputs.values(), sx=law.sx, units=law.units,
        choices=law.choices | {"opened": ", ".join(names)}, doc=law.doc,
    )  # fmt: skip
