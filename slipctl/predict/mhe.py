"""Moving-horizon estimation: unknowns of a flow within their limits, from a window of samples."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import casadi as ca

from slipctl.block.block import Block, Exprs, as_block, doc_of_maker, make_block
from slipctl.block.signals import Input, Output, Param, Signal, State
from slipctl.errors import BadInput, check_known, check_positive, check_whole, nearest
from slipctl.estimate.kalman.model import Numbers, Problem, by_name, start_value, unit_squared
from slipctl.predict import description
from slipctl.predict.options.limits import ends_of, entries_of, firm, limit_params
from slipctl.predict.qp.stage_loops import as_one_call
from slipctl.predict.qp.status import SMALL, status_outputs
from slipctl.predict.stages.horizon import Soft
from slipctl.predict.window import TINY, Window

STATUS = {0: "solved", 1: "not settled", 2: "broken, begins afresh", 3: "limits given up"}
"""What the output ``status`` says, in words."""


def mhe(
    plant: Block,
    measurements: str | Sequence[str],
    noise: Numbers,
    arrival: Mapping[str, float],
    *,
    drift: Numbers,
    start: Numbers | None = None,
    limits: Mapping[str, tuple[float | None, ...]] | None = None,
    late: str | Sequence[str] = (),
    samples: int = 30,
    period: float = 1e-3,
    substeps: int = 1,
    iterations: int = 1,
    passes: int = 10,
    rescue: int = 60,
    name: str = "mhe",
) -> Block:
    """Make a moving-horizon estimator: a step block that runs once per period.

    Each tick it looks for the motion over the last ``samples`` samples that fits them and the
    equations best, within the limits (:mod:`slipctl.predict.window`). It uses real-time iterations
    of the solver of :func:`nmpc`. What lies before the window counts by a step of a Kalman filter
    per tick. Without limits and in a linear problem it gives the estimate of :func:`ekf`.

    Args:
        plant: a flow.
        measurements: names of measured outputs, and of measured states, which have to be estimated.
        noise: variance of a sample of each, in its unit squared.
        arrival: what is estimated, states, inputs and parameters, and the variance of each before
            the first sample, in its unit squared.
        drift: of each unknown in unit^2/s: of a state the noise of its equation; an input or a
            parameter is a random walk.
        start: first estimates; by default the declared values, or the number next to zero.
        limits: of an unknown or an output of the plant. (lo, hi), None for the declared one, is
            hard; (lo, hi, weight) adds the square of the weighted excess to the sum of squares.
            Where no motion keeps the hard ones, soft ones have given way already. Then the sum of
            the excesses of hard ones over their sizes is the least, and ``status`` is 3. So it is
            where to keep one would cost more than a million by its size. An unknown is told within
            its own hard limits even then.
        late: measurements whose samples may come late, or out of order. Each has the input
            ``age_<measurement>``: the ticks since the sample was taken, 0 for now.
        samples: length of the window. A sample that is older counts as missing.
        period: from sample to sample in s.
        substeps: steps of Runge and Kutta in it.
        iterations: linearisations per tick.
        passes, rescue: as of :func:`nmpc`.
        name: name of the block.

    Returns:
        A step block. Inputs: the measurements under their names, ``seen_<measurement>`` (1, or 0
        where a sample is missing; its value is not looked at then), the ages, and what else the
        equations need. Outputs: each unknown under its name; ``misfit``, the sum of squares over
        the number of samples seen, 1 on average where noise and drift are true. ``status`` (in
        words: ``STATUS``), ``passes`` and ``residual`` as of :func:`nmpc`. The estimate is that of
        the newest sample; it uses the other inputs of the ticks before, so a controller may use it
        at once. Variances, start and limits are parameters.

    Raises:
        BadInput: unknown names, a variance that is not positive, limits that leave nothing, an
            unknown that no measurement tells.
    """
    block = as_block("mhe: the plant", plant)
    who = f"mhe({block.name})"
    _check_arrival(who, arrival)
    limited = [n for n in limits if n in block.outputs] if isinstance(limits, Mapping) else []
    problem = Problem.of("mhe", block, measurements, list(arrival), limited)
    _check_signals(who, problem)
    check_positive(f"{who}: period", period, "s")
    for word, count, least in (
        ("samples", samples, 2), ("substeps", substeps, 1), ("iterations", iterations, 1),
        ("passes", passes, 1), ("rescue", rescue, 0),
    ):  # fmt: skip
        check_whole(f"{who}: {word}", count, least)
    numbers = _numbers(who, problem, arrival, drift, noise, start)
    kept, names = _limits(who, problem, limits), _late(who, problem, late)
    if not rescue and any(s.hard for s in kept.values()):
        raise BadInput(f"{who}: hard limits need rescue= of 1 or more steps")
    window = Window(problem, int(samples), float(period), int(substeps), kept)
    return _Estimator(window, numbers, int(iterations), int(passes), int(rescue), names).block(name)


def _check_arrival(who: str, arrival: Mapping[str, float]) -> None:
    if not isinstance(arrival, Mapping) or not arrival:
        told = " ".join(repr(arrival).split())
        raise BadInput(f"{who}: arrival = {told}; give {{name of an unknown: variance, ...}}")


def _check_signals(who: str, problem: Problem) -> None:
    """Refuse what is measured and not estimated, and arrays."""
    for s in problem.increments:
        raise BadInput(
            f"{who}: {s.name} is measured and not estimated; give arrival={{{s.name!r}: ...}} too"
        )
    for s in (*problem.measured, *problem.known, *problem.params):
        if s.shape != ():
            raise BadInput(f"{who}: {s.name} is an array; an estimator takes scalars")


def _numbers(
    who: str, problem: Problem, arrival: Numbers, drift: Numbers, noise: Numbers,
    start: Numbers | None,
) -> dict[str, dict[str, float]]:  # fmt: skip
    """Variances and first estimates by what they are of, and by name."""
    unknown = {s.name: unit_squared(s.unit) for s in problem.unknown}
    rates = {n: f"{u}/s" for n, u in unknown.items()}
    seen = {s.name: unit_squared(s.unit) for s in problem.measured}
    units = {s.name: s.unit for s in problem.unknown}
    first = {} if start is None else start
    return {
        "prior": by_name(who, "arrival", arrival, unknown, "positive"),
        "drift": by_name(who, "drift", drift, rates, "not negative"),
        "noise": by_name(who, "noise", noise, seen, "positive"),
        "start": by_name(who, "start", first, units, "finite", partial=True),
    }


def _late(who: str, problem: Problem, late: str | Sequence[str]) -> list[str]:
    """Measurements whose samples may come late."""
    names = [late] if isinstance(late, str) or not isinstance(late, Iterable) else list(late)
    seen = [s.name for s in problem.measured]
    for n in names:
        check_known(f"{who}: late =", n, seen, ", which is not measured")
    return names


def _limits(
    who: str, problem: Problem, limits: Mapping[str, tuple[float | None, ...]] | None
) -> dict[str, Soft]:
    if not isinstance(limits, Mapping | None):
        raise BadInput(f"{who}: limits = {limits!r}; give limits={{name: (lo, hi)}}")
    known = {s.name: s for s in problem.unknown} | dict(problem.block.outputs)
    found = {}
    for n, entries in (limits or {}).items():
        full = n if n in known else problem.block.find(n, "state", "input", "param", "output")
        if full not in known:
            raise BadInput(f"{who}: limits of {n!r}, which is not estimated{nearest(n, known)}")
        soft = isinstance(entries, (tuple, list)) and len(entries) == 3
        form = "(lo, hi, weight)" if soft else "(lo, hi)"
        lo, hi, *rest = entries_of(f"{who}: limits of {n}", entries, form)
        advice = f"give limits={{{n!r}: (lo, hi)}}"
        ends = ends_of(who, "limits", n, known[full], (lo, hi), advice)
        for weight in rest:
            check_positive(f"{who}: weight of {n}", weight)
        found[full] = Soft(*ends, float(rest[0])) if soft else firm(*ends)
    return found


class _Estimator:
    """What the body of the block needs."""

    def __init__(
        self, window: Window, numbers: dict[str, dict[str, float]], iterations: int, passes: int,
        rescue: int, late: Sequence[str] = (),
    ) -> None:  # fmt: skip
        self.w, self.numbers, self.iterations, self.late = window, numbers, iterations, late
        self.stage, stage = window.stage()
        self.end, end = window.end()
        self.front, self.misfit = window.front(stage), window.misfit()
        self.arrived, self.factor = window.arrived(), window.factor()
        self.move = window.equations()
        self.qp = window.solver(stage, end, passes, rescue)

    def params(self) -> list[Signal]:
        """Variances, first estimates, limits, and the parameters of the plant."""
        problem, found = self.w.problem, []
        for s in problem.unknown:
            u, n, short = unit_squared(s.unit), s.name, _short(s.name)
            first = self.numbers["start"].get(n, float(start_value(problem.block, s)))
            prior, drift = (self.numbers[word][n] for word in ("prior", "drift"))
            variance = Param(u, prior, f"variance of {n} at the start", lo=TINY, hi=1e30)
            walk = Param(f"{u}/s", drift, f"drift of {n}", lo=0, hi=1e30)
            begin = Param(s.unit, first, f"first estimate of {n}", lo=-1e12, hi=1e12)
            found += [variance.named(f"prior_{short}"), walk.named(f"drift_{short}")]
            found.append(begin.named(f"start_{short}"))
        for s in problem.measured:
            u, noise = unit_squared(s.unit), self.numbers["noise"][s.name]
            variance = Param(u, noise, f"variance of measured {s.name}", lo=TINY, hi=1e30)
            found.append(variance.named(f"noise_{_short(s.name)}"))
        known = {s.name: s for s in problem.unknown} | dict(problem.block.outputs)
        for n, limit in self.w.limits.items():
            found += limit_params(known[n].unit, _short(n), limit)
        return [*found, *problem.params]

    def block(self, name: str) -> Block:
        """The estimator as a step block."""
        w, problem = self.w, self.w.problem
        M, n, ny, nk = w.stages, w.nx, w.ny, len(problem.known)
        sizes = {
            "Y": (2 * ny * M, "measurements of the window, and whether they are there"),
            "K": (nk * M, "what else was known"), "live": (M, "whether a sample has come"),
            "X": (n * M, "estimates of the window"),
            "S": (self.qp.statuses if w.nc else 0, "statuses of the limits"),
            "a": (n, "arrival: what the samples before the window tell"),
            "P": (n * (n + 1) // 2, "its covariance"),
        }  # fmt: skip
        states = [State("1", 0.0, doc, shape=(k,)).named(s) for s, (k, doc) in sizes.items() if k]
        there = [
            Input("1", f"1, or 0 where the sample of {s.name} is missing", value=1.0, lo=0,
                  hi=1).named(f"seen_{_short(s.name)}")
            for s in problem.measured
        ]  # fmt: skip
        there += [
            Input("1", f"ticks since the sample of {n} was taken", value=0.0, lo=0, hi=1e6).named(
                f"age_{_short(n)}")
            for n in self.late
        ]  # fmt: skip
        outputs = [
            *problem.estimates(),
            Output("1", "sum of squares over the number of samples", lo=0, hi=1e30).named("misfit"),
            *status_outputs(STATUS),
        ]
        return make_block(
            name, "step", as_one_call("estimate", self._body), states=states,
            inputs=[*problem.samples(), *there, *problem.known],
            params=self.params(), outputs=outputs, period=w.period, sx=False, doc=doc_of_maker(mhe),
            choices={
                "flow": problem.block.name, "samples": M, "iterations": self.iterations,
                "measured": ", ".join(s.name for s in problem.measured),
                "estimate": ", ".join(s.name for s in problem.unknown),
            },
            solves=(self.lines(), {problem.block.name: problem.block}),
        )  # fmt: skip

    def lines(self) -> list[tuple[str, str]]:
        """The problem in mathematics."""
        w, problem = self.w, self.w.problem
        return description.estimator(
            f"{problem.block.name} over {w.period:g} s",
            [s.name for s in problem.unknown], [s.name for s in problem.measured], w.limits,
            w.stages,
            description.solver("riccati", self.iterations, self.qp.passes, self.qp.rescue),
        )  # fmt: skip

    def shared(self, p: Exprs) -> tuple[Any, Any]:
        """Parameters of the equations, and deviations and limits of all samples."""
        problem, w = self.w.problem, self.w
        rows: list[Any] = [ca.sqrt(p[f"noise_{_short(s.name)}"]) for s in problem.measured]
        rows += [ca.sqrt(p[f"drift_{_short(s.name)}"] * w.period) for s in problem.unknown]
        for n, limit in w.limits.items():
            rows += [p[f"{_short(n)}_min"], p[f"{_short(n)}_max"], ca.MX(limit.weight)]
        return _column([p[s.name] for s in problem.params]), ca.vertcat(*rows)

    def _body(self, xs: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        w, problem = self.w, self.w.problem
        M, n, ny, nk = w.stages, w.nx, w.ny, len(problem.known)
        params, s = self.shared(p)
        names = [_short(m.name) for m in problem.measured]
        seen = [u[f"seen_{k}"] > 0.5 for k in names]
        y = [ca.if_else(t, u[m.name], 0) for t, m in zip(seen, problem.measured, strict=True)]
        late = [m.name in self.late for m in problem.measured]
        newest = [0 if k else t for t, k in zip(seen, late, strict=True)]
        sample = ca.vertcat(*y, *newest)
        known = _column([u[k.name] for k in problem.known])

        # the window moves on: its oldest sample goes into the arrival
        Y, live, X = xs["Y"], xs["live"], xs["X"]
        K: Any = xs["K"] if nk else ca.MX(0, 1)
        begun = live[M - 1] > 0
        first = ca.vertcat(*[p[f"start_{_short(k.name)}"] for k in problem.unknown])
        prior = ca.diag(ca.vertcat(*[p[f"prior_{_short(k.name)}"] for k in problem.unknown]))
        a, P = self.arrived(X[:n], K[:nk], Y[: 2 * ny], params, s, xs["a"], xs["P"])
        full = live[0] > 0
        a = ca.if_else(begun, ca.if_else(full, a, xs["a"]), first)
        lower = ca.vertcat(*[prior[i, j] for i in range(n) for j in range(i + 1)])
        P = ca.if_else(begun, ca.if_else(full, P, xs["P"]), lower)
        newest, _, _ = self.move(X[n * (M - 1) :], K[nk * (M - 1) :], params)
        X = ca.if_else(begun, ca.vertcat(X[n:], newest), ca.vec(ca.repmat(first, 1, M)))
        Y = ca.vertcat(ca.if_else(begun, Y[2 * ny :], 0), sample)
        K = ca.vertcat(ca.if_else(begun, K[nk:], ca.vec(ca.repmat(known, 1, M - 1))), known)
        live = ca.vertcat(ca.if_else(begun, live[1:], 0), 1)
        S = ca.if_else(begun, self.qp.shifted(xs["S"]), self.qp.first()) if w.nc else ca.MX(0)
        predicted = ca.if_else(begun, newest, first)

        Y = self._placed(Y, live, y, seen, u)
        y_: Any = ca.reshape(Y, 2 * ny, M)
        k_: Any = ca.reshape(K, nk, M) if nk else ca.MX(0, M)
        many: Any = ca.repmat(params, 1, M)
        spread: Any = ca.repmat(s, 1, M)
        L, made, V = self.factor(P), ca.MX(0), ca.MX(0)
        for _ in range(self.iterations):
            x_: Any = ca.reshape(X, n, M)
            rest = self.stage.map(M - 1)(
                x_[:, :-1], k_[:, :-1], y_[:, :-1], many[:, 1:], spread[:, 1:],
                live[:-1].T, x_[:, 1:],
            )  # fmt: skip
            D = ca.horzcat(self.front(a, L, x_[:, 0]), rest)
            E = self.end(x_[:, -1], k_[:, -1], y_[:, -1], params, s)
            found = w.solve(self.qp, D, E, S if w.nc else self.qp.first())
            X, S, V = X + found.X[n:], found.S, found.U
            made += found.passes
        sound = ca.sumsqr(X) < 1e30  # false for NaN as well
        x_ = ca.reshape(X, n, M)
        squares = ca.sum2(self.misfit.map(M)(x_, k_, y_, many, spread, live.T)) + ca.sumsqr(V)
        count = ca.sum1(ca.vec(y_[ny:, :]))
        given_up = ca.if_else(found.over > SMALL, 3, 0)
        status = ca.if_else(sound, ca.if_else(found.open != 0, 1, given_up), 2)
        nxt = {"Y": Y, "live": live, "X": X, "a": a, "P": P}
        nxt |= ({"K": K} if nk else {}) | ({"S": S} if w.nc else {})
        nxt = {k: ca.if_else(sound, v, ca.MX.zeros(v.shape[0])) for k, v in nxt.items()}
        values = {}
        for i, k in enumerate(problem.unknown):
            value = ca.if_else(sound, x_[i, M - 1], predicted[i])
            if k.name in w.limits and w.limits[k.name].hard:
                low, high = (p[f"{_short(k.name)}_{e}"] for e in ("min", "max"))
                value = ca.fmin(high, ca.fmax(low, value))
            values[k.name] = value
        return nxt, values | {
            "misfit": ca.if_else(sound, squares / ca.fmax(1, count), 0), "status": status,
            "passes": made, "residual": ca.if_else(sound, found.residual, 1),
        }  # fmt: skip

    def _placed(self, Y: Any, live: Any, y: list[Any], seen: list[Any], u: Exprs) -> Any:
        """Samples of the window, with those that may come late at the tick when they were taken."""
        M, ny = self.w.stages, self.w.ny
        rows = ca.vertsplit(ca.reshape(Y, 2 * ny, M))
        ages = ca.DM(range(M - 1, -1, -1)).T
        for i, m in enumerate(self.w.problem.measured):
            if m.name in self.late:
                now = ca.floor(u[f"age_{_short(m.name)}"] + 0.5)
                here = ca.logic_and(ca.logic_and(ages == now, live.T > 0), seen[i])
                rows[i] = ca.if_else(here, y[i], rows[i])
                rows[ny + i] = ca.fmax(here, rows[ny + i])
        return ca.vec(ca.vertcat(*rows))


def _short(name: str) -> str:
    return name.replace(".", "_")


def _column(parts: list[Any]) -> Any:
    return ca.vertcat(*parts) if parts else ca.MX(0, 1)
