"""Nonlinear model predictive control: from any flow block to a step block."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import casadi as ca

from slipctl.block.block import Block, Exprs, about, as_block, make_block
from slipctl.block.signals import Bound, Input, Output, Param, Signal, State
from slipctl.errors import BadInput, check_positive
from slipctl.predict import telling
from slipctl.predict.active_set import SMALL, ActiveSet, Found
from slipctl.predict.asked import (
    Limit,
    bounds_of,
    by_name,
    check_numbers,
    previewed,
    rates_of,
    scale_of,
    tied_of,
    weights_of,
)  # fmt: skip
from slipctl.predict.horizon import Horizon, Soft
from slipctl.predict.limits import limits_of
from slipctl.predict.linearised import linearised
from slipctl.predict.reference import DEVIATION, QUADRATIC, Sparse, nonlinear
from slipctl.predict.repeating import apart
from slipctl.predict.terminal import with_lqr, with_matrix

STATUS = {0: "solved", 1: "not settled", 2: "broken", 3: "limits given up"}
"""What the output ``status`` says, in words."""


def nmpc(
    plant: Block,
    cost: Block,
    control: str | Sequence[str],
    *,
    h: float,
    horizon: int = 20,
    weights: Mapping[str, float] | None = None,
    terminal: Sequence[str] | str | Block | Any = None,
    at: Mapping[str, float] | None = None,
    preview: Sequence[str] = (),
    bounds: Mapping[str, tuple[Limit, Limit]] | None = None,
    rates: Mapping[str, float] | None = None,
    soft: Mapping[str, tuple[float | None, ...]] | None = None,
    hard: Mapping[str, tuple[float | None, float | None]] | None = None,
    path: Block | None = None,
    final: Block | None = None,
    moves: Sequence[int] | None = None,
    iterations: int = 1,
    damping: float = 0.0,
    passes: int = 20,
    rescue: int | None = None,
    method: str = "rk4",
    substeps: int = 1,
    solver: str = "riccati",
    name: str = "nmpc",
) -> Block:
    """Make a model predictive controller: each tick it solves an optimal control problem online.

    Multiple shooting with a Gauss-Newton Hessian, in real-time iterations (Diehl 2001). Each tick
    the last plan is shifted by a stage, the plant linearised along it, one quadratic program
    solved, and the first control applied. Inputs of the plant that are not controls, and the
    references of the cost, keep their present value over the horizon or are previewed. So an
    adhesion estimate that feeds one of them makes the controller free of offset.

    Args:
        plant: a flow. Its states are measured: they become inputs of the controller.
        cost: a law whose outputs are squared and summed. An input that has the name of a state,
            an output or an input of the plant reads it; any other is a reference, an input of the
            controller.
        control: inputs of the plant that are decided.
        h: length of a stage and period of the controller in s.
        horizon: number of stages.
        weights: weight of each output of the cost per its unit, by default 1.
        terminal: what counts in the last stage. Names of outputs of the cost, by default all that
            do not depend on the control; or a law of residuals of its own (their weights stand in
            ``weights`` too). Or ``"lqr"``, the cost to go of the linear quadratic regulator
            (:mod:`slipctl.predict.terminal`); or a matrix P, 1/2 (x - x_s)'P (x - x_s) with the
            best steady state x_s. The last two are of the plant linearised at ``at``, with the
            parameters and weights given here: what is set later does not change them. x_s follows
            the held inputs, linearly.
        at: the point for that: values of states, controls and held inputs, else the declared ones.
        preview: held inputs, and bounds with a name, that are known ahead: such an input of the
            controller is an array of horizon + 1 values, now and after each stage.
        bounds: (lo, hi) of a control, by default its declared range. A name instead of a number
            is an input of the controller (the limit of an anti-slip law, say).
        rates: largest rate of a control, in its unit per second.
        soft: (lo, hi, weight) of an output or state of the plant; None for a limit is the declared
            one. The weighted excess is squared and added to the cost. (lo, hi, weight, linear)
            adds the excess itself too, times ``linear``: an exact penalty, which keeps the limit
            as long as that is worth less; ``weight`` may be 0 there.
        hard: (lo, hi) of an output or state of the plant, None for a declared one. Kept at every
            stage where any control allows it. Where none does, the bounds and rates of the
            controls are kept. Then the sum of what the hard limits are exceeded by, each over its
            size, is made as small as can be, then the cost; ``status`` is 3.
        path: a law whose outputs are kept within their declared ``lo`` and ``hi`` at every stage;
            its inputs are read as those of the cost. They are hard, but for those that ``soft``
            names. final: the same at the end of the horizon alone.
        moves: number of stages over which each free control is held; their sum is the horizon.
        iterations: real-time iterations per tick.
        damping: Levenberg's: curvature added to the cost of each iteration's step of a control,
            over its size. The steps get shorter and what they end at stays; 0 leaves it out.
        passes: largest number of passes of the active set in each.
        rescue: largest number of steps of the interior point method where they have not sufficed
            or went in a circle. By default 30, and 60 where limits are hard or linear. 0 for none,
            where the time of a tick has to be short.
        method, substeps: integration over a stage, as of :func:`sampled`.
        solver: ``"riccati"`` (:mod:`slipctl.predict.active_set`; generated as C, float
            included). For comparison: the same iterations by ``"osqp"`` or ``"qrqp"``, and each
            tick solved to the end by ``"ipopt"`` or ``"fatrop"``; these run in Python only.
        name: name of the block.

    Returns:
        A step block with period h. Outputs: the controls, ``status``, ``passes`` made, and
        ``residual``, by how much the conditions of Karush, Kuhn and Tucker are left, over one and
        the size of the gradient. Status (in words: :data:`STATUS`) 0 is solved. 1 is not settled:
        the controls are feasible but not optimal. 2: the problem broke, the next control of the
        last good plan is applied and the next tick starts afresh. 3: the limits contradict each
        other and some were given up. That is a bound where a rate does not lead back to it, or a
        hard limit where no control keeps it.

    Raises:
        BadInput: unknown names, bounds that leave nothing, a weight that is not positive, a
            horizon shorter than the lag of the actuator, a solver that is not there.
    """
    where = f"nmpc({as_block('nmpc: the plant', plant).name})"
    as_block(f"{where}: the cost", cost)
    controls = [control] if isinstance(control, str) else list(control)
    check_numbers(where, h, horizon, iterations, passes, 30 if rescue is None else rescue, solver)
    if not controls:
        raise BadInput(f"{where}: give control=, one or more of {', '.join(plant.inputs)}")
    full = {c: plant.find(c, "input") for c in controls}
    limits = bounds_of(where, plant, full, by_name(where, "bounds", bounds))
    rate = rates_of(where, controls, by_name(where, "rates", rates))
    own = terminal if isinstance(terminal, Block) else None
    given = {"path": path, "final": final, "last": own}
    laws = {k: as_block(f"{where}: {k}", v) for k, v in given.items() if v is not None}
    softs = limits_of(
        where, plant, laws, by_name(where, "soft", soft), by_name(where, "hard", hard)
    )
    firm = any(s.hard or s.linear for s in softs.values())
    rescue = (60 if firm else 30) if rescue is None else int(rescue)
    if not rescue and firm:
        raise BadInput(f"{where}: hard and linear limits need rescue= of 1 or more steps")
    if any(s.linear for s in softs.values()) and solver in ("ipopt", "fatrop"):
        raise BadInput(f"{where}: {solver} takes no linear limits; use solver='osqp'")
    scale = {c: scale_of(*limits[c]) for c in controls}
    tied = tied_of(where, horizon, moves)
    weigh = weights_of(where, [cost, *([own] if own else [])], by_name(where, "weights", weights))
    names = terminal if isinstance(terminal, (list, tuple)) and _all_names(terminal) else None
    problem = Horizon.of(
        plant, cost, controls, names, softs, horizon, h, method, substeps, scale, laws
    )
    if damping != 0:
        check_positive(f"{where}: damping", damping)
        if solver in ("ipopt", "fatrop"):
            raise BadInput(f"{where}: {solver} makes no iterations of ours; leave damping= out")
        problem = replace(problem, damped=True)
    if terminal is not None and own is None and names is None:
        point = by_name(where, "at", at)
        if isinstance(terminal, str) and terminal == "lqr":
            problem = with_lqr(where, problem, weigh, point)
        else:
            problem = with_matrix(where, problem, weigh, point, terminal)
    elif at:
        raise BadInput(f"{where}: at= is the point of terminal='lqr' or of a matrix; leave it out")
    ahead = previewed(where, preview, [*problem.held, *(b for p in limits.values() for b in p)])
    if moves is not None and any(b in ahead for p in limits.values() for b in p):
        raise BadInput(f"{where}: moves= holds controls over stages; preview no bound with it")
    return _Controller(
        where, problem, controls, limits, rate, softs, weigh, tied, int(iterations),
        (int(passes), rescue), solver, ahead, float(damping),
    ).block(name, h, [plant, cost, *laws.values()], (method, substeps))  # fmt: skip


def _all_names(given: Sequence[Any]) -> bool:
    return all(isinstance(n, str) for n in given)


class _Controller:
    """What the body of the block needs."""

    def __init__(
        self, where: str, problem: Horizon, controls: list[str],
        limits: dict[str, tuple[Limit, Limit]], rate: dict[str, float], softs: dict[str, Soft],
        weights: dict[str, float], tied: list[bool], iterations: int, most: tuple[int, int],
        solver: str, ahead: tuple[str, ...] = (), damping: float = 0.0,
    ) -> None:  # fmt: skip
        self.ahead, self.damping = ahead, damping
        self.h, self.limits, self.rate, self.softs = problem, limits, rate, softs
        self.weights, self.iterations, self.solver = weights, iterations, solver
        self.short = dict(zip(controls, problem.controls, strict=True))
        self.once, self.stage, layout, self.step = linearised(where, problem)
        self.end, last = problem.end()
        layouts = (problem, layout, last, tied, bool(rate), *most)
        self.tied = tied
        self.qp = Sparse(solver, *layouts) if solver in QUADRATIC else ActiveSet(*layouts)
        self.whole = None
        if solver in ("ipopt", "fatrop"):
            self.whole = nonlinear(where, problem, solver, tied, bool(rate))
        self.scale = ca.DM(problem.scale)

    # ---- signals --------------------------------------------------------------------------------

    def measured(self) -> list[Signal]:
        """States of the plant, as inputs."""
        return [
            s.as_role("input", value=None).named(n.removeprefix("plant."))
            for n, s in self.h.model.states.items()
        ]

    def given(self) -> list[Signal]:
        """Held inputs, and bounds that are inputs."""
        held = [self.h.model.inputs[n] for n in self.h.held]
        limits = {
            b: self.h.model.inputs[self.short[c]]
            for c, pair in self.limits.items() for b in pair if isinstance(b, str)
        }  # fmt: skip
        signals = [*held, *(_named_limit(b, s) for b, s in limits.items())]
        return [
            replace(s, shape=(self.h.stages + 1,)) if s.name in self.ahead else s for s in signals
        ]

    def settings(self) -> list[Signal]:
        """Weights, bounds, rates and soft limits, as parameters."""
        found = []
        for n, w in self.weights.items():
            outputs = self.h.model.outputs
            unit = (outputs.get(f"cost.{n}") or outputs[f"last.{n}"]).unit
            weight = Param(_per(unit), w, f"weight of {n}", "chosen", lo=1e-12, hi=1e12)
            found.append(weight.named(f"weight_{n}"))
        for c, (lo, hi) in self.limits.items():
            s, short = self.h.model.inputs[self.short[c]], self.short[c]
            for word, value in (("lo", lo), ("hi", hi)):
                if not isinstance(value, str):
                    doc = f"{'smallest' if word == 'lo' else 'largest'} {s.doc}"
                    found.append(
                        Param(s.unit, value, doc, lo=-1e12, hi=1e12).named(f"{short}_{word}")
                    )
        for c, r in self.rate.items():
            s = self.h.model.inputs[self.short[c]]
            unit = f"({s.unit})/s" if "/" in s.unit else f"{s.unit}/s"
            rate = Param(unit, r, f"largest rate: {s.doc}", lo=0, hi=1e12)
            found.append(rate.named(f"{self.short[c]}_rate"))
        for n, limit in self.softs.items():
            short = _short(n)
            unit = self._signal(n).unit
            kind = "hard" if limit.hard else "soft"
            found += [
                Param(unit, value, f"{kind} limit {side}", lo=-1e12, hi=1e12).named(
                    f"{short}_{end}"
                )
                for end, side, value in (("min", "below", limit.lo), ("max", "above", limit.hi))
            ]
            for word, value in (("weight", limit.weight), ("linear", limit.linear)):
                if value > 0 and not limit.hard:
                    doc = "weight beyond" if word == "weight" else "weight of the excess itself"
                    found.append(
                        Param(_per(unit), value, doc, lo=1e-12, hi=1e12).named(f"{short}_{word}")
                    )
        if self.h.damped:
            doc = "curvature added for steps of controls"
            found.append(
                Param("1", self.damping, doc, "chosen", lo=1e-12, hi=1e12).named("damping")
            )
        return found

    def _signal(self, name: str) -> Signal:
        model = self.h.model
        return (model.outputs | model.states)[name]

    def _command(self, c: str) -> Signal:
        """Control as an output, in the range of the bounds that are parameters."""
        short = self.short[c]
        s = self.h.model.inputs[short].as_role("output", value=None).named(short)
        given = [
            (k, f"{short}_{k}")
            for k, v in zip(("lo", "hi"), self.limits[c], strict=True) if not isinstance(v, str)
        ]  # fmt: skip
        own = {k for k, _ in given}
        lo, hi = -math.inf if "lo" in own else s.lo, math.inf if "hi" in own else s.hi
        return replace(s, lo=lo, hi=hi, bounds=tuple(Bound(k, n) for k, n in given))

    # ---- the block ------------------------------------------------------------------------------

    def block(self, name: str, h: float, told: list[Block], over: tuple[str, int]) -> Block:
        """The controller as a step block; ``told``: plant, cost and laws; ``over``: a stage."""
        plant, cost = told[:2]
        model, N = self.h.model, self.h.stages
        states = [
            State("1", 0.0, "predicted states, stage by stage", shape=(self.h.nx * (N + 1),)
                  ).named("X"),
            State("1", 0.0, "planned controls, scaled", shape=(self.h.nu * N,)).named("U"),
            State("1", 0.0, "statuses of controls and soft limits", shape=(self.qp.statuses,)
                  ).named("S"),
            State("1", 0.0, "control applied last, scaled", shape=(self.h.nu,)).named("applied"),
            State("1", 0.0, "whether there is a plan").named("planned"),
        ]  # fmt: skip
        if self.solver != "riccati":
            doc = f"NaN where the answer of {self.solver} leaves the conditions of optimality"
            states.insert(0, State("1", 0.0, doc).named(f"answer_of_{self.solver}"))
        outputs = [self._command(c) for c in self.short]
        outputs += [
            Output("1", ", ".join(f"{k} {v}" for k, v in STATUS.items()), lo=0, hi=3).named(
                "status"
            ),
            Output("1", "passes of the active set and steps inside it", lo=0, hi=1e6).named(
                "passes"
            ),
            Output("1", "what is left of the conditions of optimality", lo=0, hi=1e30).named(
                "residual"
            ),
        ]
        return make_block(
            name, "step", apart("tick", self._body), states=states,
            inputs=[*self.measured(), *self.given()],
            params=[*model.params.values(), *self.settings()], outputs=outputs,
            period=h, sx=False, doc=about(nmpc),
            choices={
                "plant": plant.name, "cost": cost.name, "controls": ", ".join(self.h.controls),
                "horizon": N, "iterations": self.iterations, "solver": self.solver,
            },
            solves=(self.lines(plant.name, h, over), {b.name: b for b in told}),
        )  # fmt: skip

    def lines(self, plant: str, h: float, over: tuple[str, int]) -> list[tuple[str, str]]:
        """The problem in mathematics."""
        method, substeps = over
        steps = "a step" if substeps == 1 else f"{substeps} steps"
        return telling.controller(
            self.h, f"{plant} over {h:g} s, {steps} of {method}", self.short, self.limits,
            list(self.rate), self.ahead, self.tied,
            telling.solver(self.solver, self.iterations, self.qp.passes, self.qp.rescue),
        )  # fmt: skip

    def constants(self, p: Exprs) -> Any:
        """Parameters of the stages: those of the model, weights, soft limits."""
        model = self.h.model.pack("param", {n: p[n] for n in self.h.model.params})
        rows = [p[f"weight_{n}"] for n in self.weights]
        for n, limit in self.softs.items():
            short = _short(n)
            rows += [p[f"{short}_min"], p[f"{short}_max"]]
            rows += [p.get(f"{short}_weight", limit.weight), p.get(f"{short}_linear", limit.linear)]
        rows += [p["damping"]] if self.h.damped else []
        return ca.vertcat(model, *rows)

    def bounds(self, u: Exprs, p: Exprs) -> Any:
        """(lo, hi, rate per stage) of all controls, scaled: a column, or one per stage."""
        lows: list[Any] = []
        highs: list[Any] = []
        rates: list[Any] = []
        for c, (lo, hi) in self.limits.items():
            short = self.short[c]
            lows.append(self._bound(u, lo, p, f"{short}_lo"))
            highs.append(self._bound(u, hi, p, f"{short}_hi"))
            rates.append(
                p[f"{short}_rate"] * self.h.model.period if c in self.rate else ca.MX(1e30)
            )
        wide = max(v.shape[1] for v in (*lows, *highs))
        columns = [
            ca.vertcat(*[m if m.shape[1] == wide else ca.repmat(m, 1, wide) for m in v])
            / ca.repmat(self.scale, 1, wide)
            for v in (lows, highs, rates)
        ]
        return ca.vertcat(columns[0], ca.fmax(columns[0], columns[1]), columns[2])

    def _bound(self, u: Exprs, given: Limit, p: Exprs, name: str) -> Any:
        """A bound, or those of the stages in a row."""
        if not isinstance(given, str):
            return p[name]
        return u[given][: self.h.stages].T if given in self.ahead else u[given]

    def held(self, u: Exprs) -> tuple[Any, Any]:
        """Held inputs of the stages, one per column, and of the last one."""
        N = self.h.stages
        if not any(n in self.ahead for n in self.h.held):
            d = ca.vertcat(*[u[n] for n in self.h.held]) if self.h.held else ca.MX(0, 1)
            return ca.repmat(d, 1, N), d
        rows = [u[n].T if n in self.ahead else ca.repmat(u[n], 1, N + 1) for n in self.h.held]
        d = ca.vertcat(*rows)
        return d[:, :N], d[:, N]

    def _body(self, xs: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        nx, nu, N = self.h.nx, self.h.nu, self.h.stages
        x0 = ca.vertcat(*[u[s.name] for s in self.measured()])
        d, d_last = self.held(u)
        q, bounds = self.constants(p), self.bounds(u, p)
        lo, hi = bounds[:nu, 0], bounds[nu : 2 * nu, 0]
        begun = xs["planned"] > 0
        start = ca.fmin(hi, ca.fmax(lo, ca.vertcat(*[self._start(n) for n in self.h.controls])))
        before = ca.if_else(begun, xs["applied"], start)

        X, V = xs["X"], xs["U"]
        shared = self.once(q)
        following = self.step(X[-nx:], V[-nu:], d[:, -1], shared)
        X = ca.if_else(begun, ca.vertcat(X[nx:], following), ca.vec(ca.repmat(x0, 1, N + 1)))
        later = ca.vertcat(V[nu:], V[-nu:]) if N > 1 else V
        V = ca.if_else(begun, later, ca.vec(ca.repmat(start, 1, N)))
        S = ca.if_else(begun, self.qp.shifted(xs["S"]), self.qp.first())
        plan = V[:nu]
        bounds, contradict = self.reachable(bounds, before)
        open_, made, over = ca.MX(0), ca.MX(0), ca.MX(0)
        if self.whole is not None:
            X, V, residual = self.whole(x0, d, d_last, q, before, bounds, X, V)
        else:
            for _ in range(self.iterations):
                found = self.iterate(X, V, S, x0, (d, d_last), (q, shared), before, bounds)
                X, V, S, open_, over = X + found.X, V + found.U, found.S, found.open, found.over
                made, residual = made + found.passes, found.residual

        size = ca.sumsqr(X) + ca.sumsqr(V)
        sound = size < 1e30  # false for NaN as well
        first = ca.fmin(hi, ca.fmax(lo, ca.if_else(sound, V[:nu], plan)))
        if self.rate:
            rate = bounds[2 * nu :, 0]
            first = ca.fmin(before + rate, ca.fmax(before - rate, first))
        zero = ca.MX.zeros
        nxt = {
            "X": ca.if_else(sound, X, zero(X.shape[0])),
            "U": ca.if_else(sound, V, zero(V.shape[0])),
            "S": ca.if_else(sound, S, zero(S.shape[0])), "applied": first, "planned": sound,
        }  # fmt: skip
        given_up = ca.logic_or(contradict, over > SMALL)
        solved = ca.if_else(open_ != 0, 1, ca.if_else(given_up, 3, 0))
        status = ca.if_else(sound, solved, 2)
        if self.solver != "riccati":
            good = ca.if_else(ca.logic_and(sound, residual < DEVIATION), 1, math.nan)
            nxt[f"answer_of_{self.solver}"], first = good, first * good
        values = dict(zip(self.h.controls, ca.vertsplit(first * self.scale), strict=True))
        return nxt, values | {"status": status, "passes": made, "residual": residual}

    def reachable(self, bounds: Any, before: Any) -> tuple[Any, Any]:
        """Bounds of each stage, opened where the rate does not lead back to them; whether so."""
        nu, N = self.h.nu, self.h.stages
        constant = bounds.shape[1] == 1
        each = ca.repmat(bounds, 1, N) if constant else bounds
        if not self.rate:
            return each, ca.MX(0)
        rate = bounds[2 * nu :, 0]
        lows, highs, outside, changes = [], [], [], 0
        low = high = before
        for k in range(N):
            changes += not self.tied[k]
            lo, hi = each[:nu, k], each[nu : 2 * nu, k]
            if constant:
                low, high = before - changes * rate, before + changes * rate
            else:
                low, high = low - rate, high + rate
            outside += [low - hi, lo - high] if k == 0 or not constant else []
            lows.append(ca.fmin(lo, high))
            highs.append(ca.fmax(hi, low))
            if not constant:
                low, high = ca.fmax(low, lows[k]), ca.fmin(high, highs[k])
        if not constant:  # what lies beyond where the rate leads back in time is none
            for k in reversed(range(N - 1)):
                lows[k] = ca.fmax(lows[k], lows[k + 1] - rate)
                highs[k] = ca.fmin(highs[k], highs[k + 1] + rate)
        columns = [ca.vertcat(a, b, rate) for a, b in zip(lows, highs, strict=True)]
        return ca.horzcat(*columns), ca.mmax(ca.vertcat(*outside)) > SMALL

    def _start(self, name: str) -> float:
        """Control of the first guess: the value of the input, else 0."""
        s = self.h.model.inputs[name]
        value = 0.0 if s.value is None or isinstance(s.value, str) else float(s.value)
        return value / self.h.scale[self.h.controls.index(name)]

    def iterate(
        self, X: Any, V: Any, S: Any, x0: Any, held: tuple[Any, Any], constants: tuple[Any, Any],
        before: Any, bounds: Any,
    ) -> Found:  # fmt: skip
        """One real-time iteration on (X, V, S): linearise and solve the QP; its step."""
        nx, nu, N = self.h.nx, self.h.nu, self.h.stages
        q, shared = constants
        states, v = ca.reshape(X, nx, N + 1), ca.reshape(V, nu, N)
        D = self.stage.map(N)(states[:, :-1], v, held[0], ca.repmat(shared, 1, N), states[:, 1:])
        E = self.end(states[:, -1], held[1], q)
        return self.qp.solve(D, E, S, V, before, bounds, x0 - X[:nx])


def _per(unit: str) -> str:
    return "1" if unit == "1" else f"1/({unit})"


def _named_limit(name: str, s: Signal) -> Signal:
    return Input(s.unit, f"limit: {s.doc}", positive=s.positive).named(name)


def _short(name: str) -> str:
    """Name of a limited signal within its part, as a parameter has it."""
    return name.split(".", 1)[1].replace(".", "_")
