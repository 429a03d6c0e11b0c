"""The body of a predictive controller: signals, and what one tick computes."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import reduce
from typing import Any

import casadi as ca

from slipctl.block.block import Block, Exprs, make_block
from slipctl.block.signals import Bound, Input, Param, Signal, Split, State
from slipctl.predict import description
from slipctl.predict.options.arguments import Limit, Solver
from slipctl.predict.options.limits import limit_params
from slipctl.predict.options.offset import SHARE
from slipctl.predict.options.scenarios import TOGETHER
from slipctl.predict.qp.active_set import ActiveSet
from slipctl.predict.qp.line_search import Search
from slipctl.predict.qp.split_tick import split_results
from slipctl.predict.qp.stage_loops import as_one_call
from slipctl.predict.qp.status import SMALL, status_outputs
from slipctl.predict.reference import DEVIATION, QUADRATIC, Sparse, nonlinear
from slipctl.predict.stages.exact_hessian import Curved
from slipctl.predict.stages.horizon import Horizon, Soft
from slipctl.predict.stages.linear_stage import stage_functions
from slipctl.predict.stages.stage_lengths import STRETCH, plan_shift
from slipctl.predict.vector_names import vector_names

STATUS = {0: "solved", 1: "not settled", 2: "broken", 3: "limits given up"}
"""What the output ``status`` says, in words."""

PREPARE = "prepare_only"
"""State of a controller in two parts: 1 where its next tick is to prepare, and no more."""

LEARNT = ("unknown", "expected", "gain")
"""States of an estimate of what is not known."""

AHEAD = ("stages", "last_stage")
"""States that preparing makes."""


class Controller:
    """What the body of the block needs."""

    def __init__(
        self, where: str, problem: Horizon, controls: list[str],
        limits: dict[str, tuple[Limit, Limit]], rate: dict[str, float], softs: dict[str, Soft],
        weights: dict[str, float], tied: list[bool], wanted: Solver, ahead: tuple[str, ...] = (),
    ) -> None:  # fmt: skip
        solver = wanted.solver
        self.ahead, self.damping, self.split = ahead, float(wanted.damping), bool(wanted.split)
        self.h, self.limits, self.rate, self.softs = problem, limits, rate, softs
        self.weights, self.iterations, self.solver = weights, int(wanted.iterations), solver
        self.short = dict(zip(controls, problem.decided, strict=True))
        self.once, self.stage, layout, self.step = stage_functions(where, problem)
        self.end, last = problem.end()
        self.curved = Curved(where, problem, layout, last) if problem.exact else None
        if self.curved:
            layout, last = self.curved.stage, self.curved.end
        self.layout, self.last = layout, last
        most = int(wanted.passes), int(wanted.steps), bool(wanted.deadline)
        layouts = (problem, layout, last, tied, bool(rate), *most)
        self.tied = tied
        self.qp = Sparse(solver, *layouts) if solver in QUADRATIC else ActiveSet(*layouts)
        self.search = Search(problem, self.step) if wanted.search else None
        self.whole = None
        if solver in ("ipopt", "fatrop"):
            self.whole = nonlinear(where, problem, solver, tied, bool(rate))
        self.scale = ca.DM(problem.scale)
        self.unknown = problem.unknown.names if problem.unknown else ()
        self.fixed = {STRETCH: [*problem.lengths, 1.0]} if problem.lengths else {}
        if problem.shared:
            both = problem.shared, problem.stages + 1 - problem.shared
            self.fixed[TOGETHER] = [1.0] * both[0] + [0.0] * both[1]

    # ---- signals --------------------------------------------------------------------------------

    def measured(self) -> list[Signal]:
        """States of the plant, as inputs."""
        return [
            s.as_role("input", value=None, shape=()).named(n.removeprefix("plant."))
            for n, s in self.h.model.states.items()
        ]

    def given(self) -> list[Signal]:
        """Held inputs, and bounds that are inputs."""
        known = (*self.unknown, *self.fixed)
        held = [self.h.model.inputs[n] for n in self.h.held if n not in known]
        limits = {
            b: self.h.model.inputs[self.short[c]]
            for c, pair in self.limits.items() for b in pair if isinstance(b, str)
        }  # fmt: skip
        signals = [*held, *(Input(s.unit, f"limit: {s.doc}", positive=s.positive).named(b)
                            for b, s in limits.items())]  # fmt: skip
        many = (self.h.stages + 1,)
        return [replace(s, shape=many) if s.name in self.ahead else s for s in signals]

    def settings(self) -> list[Signal]:
        """Weights, bounds, rates and soft limits, as parameters."""
        found = []
        for n, w in self.weights.items():
            outputs = self.h.model.outputs
            parts = (f"{part}.{n}" for part in ("cost", "last", "price"))
            unit = next(outputs[m] for m in parts if m in outputs).unit
            weight = Param(_per(unit), w, f"weight of {n}", "chosen", lo=1e-12, hi=1e12)
            found.append(weight.named(f"weight_{n}"))
        for c, pair in self.limits.items():
            s, short = self.h.model.inputs[self.short[c]], self.short[c]
            for word, most, value in zip(("lo", "hi"), ("smallest", "largest"), pair, strict=True):
                if not isinstance(value, str):
                    end = Param(s.unit, value, f"{most} {s.doc}", lo=-1e12, hi=1e12)
                    found.append(end.named(f"{short}_{word}"))
        for c, r in self.rate.items():
            s = self.h.model.inputs[self.short[c]]
            unit = f"({s.unit})/s" if "/" in s.unit else f"{s.unit}/s"
            rate = Param(unit, r, f"largest rate: {s.doc}", lo=0, hi=1e12)
            found.append(rate.named(f"{self.short[c]}_rate"))
        for n, limit in self.softs.items():
            if self.h.factors and int(n.rpartition(".")[2]) > 0:
                continue  # scenarios share their numbers
            n = self._limited(n)
            short = _short(n)
            unit = (self.h.model.outputs | self.h.model.states)[n].unit
            found += limit_params(unit, short, limit)
            for word, value, doc in (
                ("weight", limit.weight, "weight beyond"),
                ("linear", limit.linear, "weight of the excess itself"),
            ):
                if value > 0 and not limit.hard:
                    weight = Param(_per(unit), value, doc, lo=1e-12, hi=1e12)
                    found.append(weight.named(f"{short}_{word}"))
        if self.h.damped:
            doc = "curvature added for steps of controls"
            damping = Param("1", self.damping, doc, "chosen", lo=1e-12, hi=1e12)
            found.append(damping.named("damping"))
        if self.unknown:
            doc = "part of what a tick missed that is learnt from it"
            found.append(Param("1", SHARE, doc, "chosen", lo=1e-6, hi=1).named("offset_share"))
        return found

    def _limited(self, name: str) -> str:
        """Name of the limited signal without its scenario."""
        return name.rpartition(".")[0] if self.h.factors else name

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

    def block(
        self, name: str, h: float, told: list[Block], over: tuple[str, int], doc: str
    ) -> Block:
        """The controller as a step block; ``told``: plant, cost and laws; ``over``: a stage."""
        plant, cost = told[:2]
        model, N = self.h.model, self.h.stages
        nx, nu = self.h.nx, self.h.nu
        states = [
            State("1", 0.0, doc, shape=shape).named(n)
            for n, doc, shape in (
                ("X", "predicted states, stage by stage", (nx * (N + 1),)),
                ("U", "planned controls, scaled", (nu * N,)),
                ("S", "statuses of controls and soft limits", (self.qp.statuses,)),
                ("applied", "control applied last, scaled", (nu,)),
                ("planned", "whether there is a plan", ()),
            )
        ]
        if self.split:
            sizes = zip(AHEAD, (self.layout.size * N, self.last.size), strict=True)
            states += [
                State("1", 0.0, "prepared stages, linearised", shape=(size,)).named(n)
                for n, size in sizes
            ]
            states += [
                State("1", 0.0, "whether the next tick is prepared").named("prepared"),
                State("1", 0.0, "whether to prepare, and no more").named(PREPARE),
            ]
        if self.h.unknown:
            values, many = list(self.h.unknown.values), (len(self.unknown),)
            gain = State("1", 0.0, "gain of the estimate", shape=(many[0] * nx,))
            states += [
                State("1", values, "what is not known, estimated", shape=many).named("unknown"),
                State("1", 0.0, "state expected at the next tick", shape=(nx,)).named("expected"),
                gain.named("gain"),
            ]
        if self.solver != "riccati":
            text = f"NaN where the answer of {self.solver} leaves the conditions of optimality"
            states.insert(0, State("1", 0.0, text).named(f"answer_of_{self.solver}"))
        outputs = [self._command(c) for c in self.short]
        outputs += status_outputs(STATUS)
        outputs += [
            self.h.model.inputs[n].as_role("output", value=None).named(f"estimated_{n}")
            for n in self.unknown
        ]
        return make_block(
            name, "step", as_one_call("tick", self._body), states=states,
            inputs=[*self.measured(), *self.given()],
            params=[*model.params.values(), *self.settings()], outputs=outputs,
            period=h, sx=False, doc=doc,
            choices={
                "plant": plant.name, "cost": cost.name, "controls": ", ".join(self.h.decided),
                "horizon": N, "iterations": self.iterations, "solver": self.solver,
            },
            solves=(self.lines(plant.name, h, over), {b.name: b for b in told}),
            vector_names=vector_names(self.h, self.qp),
            split=Split(PREPARE, "prepared", tuple(s.name for s in self.given()), AHEAD)
            if self.split else None,
        )  # fmt: skip

    def lines(self, plant: str, h: float, over: tuple[str, int]) -> list[tuple[str, str]]:
        """The problem in mathematics."""
        method, substeps = over
        steps = "a step" if substeps == 1 else f"{substeps} steps"
        return description.controller(
            self.h, f"{plant} over {h:g} s, {steps} of {method}", self.short, self.limits,
            list(self.rate), self.ahead, self.tied,
            description.solver(
                self.solver, self.iterations, self.qp.passes, self.qp.rescue, self.qp.exactly,
                self.h.exact,
            ),
        )  # fmt: skip

    def constants(self, p: Exprs) -> Any:
        """Parameters of the stages: those of the model, weights, soft limits."""
        model = self.h.model.pack("param", {n: p[n] for n in self.h.model.params})
        rows = [p[f"weight_{n}"] for n in self.weights]
        for n, limit in self.softs.items():
            short = _short(self._limited(n))
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
        many = self.h.nu // len(lows)  # those of the scenarios have the same
        lows, highs, rates = lows * many, highs * many, rates * many
        wide = max(v.shape[1] for v in (*lows, *highs))
        if self.rate and self.h.lengths:  # from the middle of a stage to that of the next one
            s = ca.DM([1.0, *self.h.lengths])
            rates, wide = [r @ ((s[:-1] + s[1:]) / 2).T for r in rates], self.h.stages
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
        """Held inputs of the stages, one per column, and of the last one; u: all by name."""
        N = self.h.stages
        if not self.fixed and not any(n in self.ahead for n in self.h.held):
            d = ca.vertcat(*[u[n] for n in self.h.held]) if self.h.held else ca.MX(0, 1)
            return ca.repmat(d, 1, N), d
        rows = {n: u[n].T if n in self.ahead else ca.repmat(u[n], 1, N + 1)
                for n in self.h.held if n not in self.fixed}  # fmt: skip
        rows |= {n: ca.MX(ca.DM(v)).T for n, v in self.fixed.items()}
        d = ca.vertcat(*[rows[n] for n in self.h.held])
        return d[:, :N], d[:, N]

    def _body(self, xs: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        nu = self.h.nu
        copies = max(len(self.h.factors), 1)
        x0 = ca.vertcat(*[ca.repmat(u[s.name], copies, 1) for s in self.measured()])
        if self.unknown:
            u = u | dict(zip(self.unknown, ca.vertsplit(xs["unknown"]), strict=True))
        d, d_last = self.held(u)
        q, bounds = self.constants(p), self.bounds(u, p)
        lo, hi = bounds[:nu, 0], bounds[nu : 2 * nu, 0]
        start = ca.fmin(hi, ca.fmax(lo, ca.vertcat(*[self._start(n) for n in self.h.controls])))
        plan = (xs["X"], xs["U"], xs["S"])
        given = (xs["planned"], start, x0, d, d_last, q)
        measured: tuple[Any, ...] = (xs["applied"], *given, bounds)
        learn = (x0, d[:, 0], q, p["offset_share"]) if self.unknown else ()
        if not self.split:
            nxt, out = self._named(*self._feedback(*self._prepare(*plan, *given), *measured))
            return self._learnt(xs, nxt, out, *learn)
        only, kept = xs[PREPARE] > 0, tuple(xs[n] for n in AHEAD)
        still = (xs["applied"], xs["planned"], xs["applied"] * self.scale, *[ca.MX(0)] * 3)
        parts = (plan, kept, given, measured, still)
        rest, ahead = split_results(self._prepare, self._feedback, only, xs["prepared"], *parts)
        nxt, out = self._learnt(xs, *self._named(*rest), *learn)
        nxt |= {n: ca.if_else(only, xs[n], nxt[n]) for n in LEARNT if self.unknown}
        ready = ca.logic_and(only, xs["planned"] > 0)
        return nxt | {
            **dict(zip(AHEAD, ahead, strict=True)), "prepared": ready, PREPARE: ca.MX(0)
        }, out  # fmt: skip

    def _learnt(self, xs: Exprs, nxt: Exprs, out: Exprs, *given: Any) -> tuple[Exprs, Exprs]:
        """States and outputs with what is not known, as this tick tells it for the next one."""
        if self.h.unknown is None:
            return nxt, out
        x0, d, q, share = given
        gain = ca.reshape(xs["gain"], len(self.unknown), self.h.nx)
        signals = [self.h.model.inputs[n] for n in self.unknown]
        w = xs["unknown"] + gain @ (x0 - xs["expected"])
        w = ca.fmin([s.hi for s in signals], ca.fmax([s.lo for s in signals], w))
        sound = nxt["planned"]
        w = ca.if_else(ca.logic_and(xs["planned"] > 0, sound), w, xs["unknown"])
        for n, value in zip(self.unknown, ca.vertsplit(w), strict=True):
            d[self.h.held.index(n)] = value
        expected, gain = self.h.unknown.step(self.h)(x0, nxt["applied"], d, q, share)
        found = (ca.if_else(sound, m, 0) for m in (expected, gain))
        nxt |= dict(zip(LEARNT, (w, *found), strict=True))
        values = zip(self.unknown, ca.vertsplit(w), strict=True)
        return nxt, out | {f"estimated_{n}": v for n, v in values}

    def _named(self, *results: Any) -> tuple[Exprs, Exprs]:
        """Results of :meth:`_feedback` by name."""
        X, V, S, applied, planned, controls, status, passes, residual = results
        nxt = {"X": X, "U": V, "S": S, "applied": applied, "planned": planned}
        if self.solver != "riccati":
            good = ca.if_else(ca.logic_and(planned, residual < DEVIATION), 1, math.nan)
            nxt[f"answer_of_{self.solver}"], controls = good, controls * good
        values = zip(self.h.decided, ca.vertsplit(controls), strict=False)
        return nxt, dict(values) | {"status": status, "passes": passes, "residual": residual}

    def _prepare(
        self, X: Any, V: Any, S: Any, begun: Any, start: Any, x0: Any, d: Any, d_last: Any, q: Any,
        shift: Any = None,
    ) -> tuple[Any, ...]:  # fmt: skip
        """What can be done before the measurement: (X, V, S) shifted, (D, E) linearised."""
        N = self.h.stages
        shared = self.once(q)
        shifted = self._shifted(X, V, S, d, d_last, shared)
        if shift is not None:
            shifted = [ca.if_else(shift, a, b) for a, b in zip(shifted, (X, V, S), strict=True)]
        first = [ca.vec(ca.repmat(x0, 1, N + 1)), ca.vec(ca.repmat(start, 1, N)), self.qp.first()]
        goes_on = begun > 0
        X, V, S = (ca.if_else(goes_on, a, b) for a, b in zip(shifted, first, strict=True))
        if self.whole is not None:
            return X, V, S, ca.MX(0, 1), ca.MX(0, 1)
        D, E = self.linearise(X, V, (d, d_last), (q, shared))
        return X, V, S, ca.vec(D), E

    def _shifted(self, X: Any, V: Any, S: Any, d: Any, d_last: Any, shared: Any) -> list[Any]:
        """The plan a first stage later."""
        nx, nu, N = self.h.nx, self.h.nu, self.h.stages
        if not self.h.lengths:
            following = self.step(X[-nx:], V[-nu:], d[:, -1], shared)
            after = ca.vertcat(V[nu:], V[-nu:]) if N > 1 else V
            return [ca.vertcat(X[nx:], following), after, self.qp.shifted(S)]
        places, stages = plan_shift(self.h.lengths)
        following = self.step(X[-nx:], V[-nu:], d_last, shared)
        states = ca.horzcat(ca.reshape(X, nx, N + 1), following) @ places
        controls: Any = ca.reshape(V, nu, N)
        return [ca.vec(states), ca.vec(controls[:, stages]), self.qp.shifted(S, stages)]

    def _feedback(
        self, X: Any, V: Any, S: Any, D: Any, E: Any, applied: Any, begun: Any, start: Any, x0: Any,
        d: Any, d_last: Any, q: Any, bounds: Any,
    ) -> tuple[Any, ...]:  # fmt: skip
        """The rest: (X, V, S, applied, planned, controls, status, passes, residual)."""
        nx, nu, N = self.h.nx, self.h.nu, self.h.stages
        lo, hi = bounds[:nu, 0], bounds[nu : 2 * nu, 0]
        before = ca.if_else(begun > 0, applied, start)
        before = before[self.h.leaders] if self.h.shared else before
        plan = V[:nu]
        bounds, contradict = self.reachable(bounds, before)
        open_, made, over = ca.MX(0), ca.MX(0), ca.MX(0)
        if self.whole is not None:
            X, V, residual = self.whole(x0, d, d_last, q, before, bounds, X, V)
        else:
            D = ca.reshape(D, self.layout.size, N)
            for k in range(self.iterations):
                if k:
                    D, E = self.linearise(X, V, (d, d_last), (q, self.once(q)))
                found = self.qp.solve(D, E, S, V, before, bounds, x0 - X[:nx])
                S, open_, over = found.S, found.open, found.over
                if self.search is None:
                    X, V = X + found.X, V + found.U
                else:
                    held, shared = (d, d_last), self.once(q)
                    X, V = self.search(X, V, found.X, found.U, held, q, shared)
                made, residual = made + found.passes, found.residual

        size_of_states, size_of_controls = ca.sumsqr(X), ca.sumsqr(V)
        size = size_of_states + size_of_controls
        sound = size < 1e30  # false for NaN as well
        first = ca.fmin(hi, ca.fmax(lo, ca.if_else(sound, V[:nu], plan)))
        if self.rate:
            rate = bounds[2 * nu :, 0]
            first = ca.fmin(before + rate, ca.fmax(before - rate, first))
        X, V, S = (ca.if_else(sound, m, ca.MX.zeros(m.shape[0])) for m in (X, V, S))
        given_up = [contradict] * bool(self.rate) + [over > SMALL] * bool(self.h.capped)
        solved = ca.if_else(reduce(ca.logic_or, given_up), 3, 0) if given_up else 0
        solved = ca.if_else(open_ != 0, 1, solved)
        status = ca.if_else(sound, solved, 2)
        return X, V, S, first, sound, first * self.scale, status, made, residual

    def reachable(self, bounds: Any, before: Any) -> tuple[Any, Any]:
        """Bounds of each stage, opened where the rate does not lead back to them; whether so."""
        nu, N = self.h.nu, self.h.stages
        constant = bounds.shape[1] == 1
        each = ca.repmat(bounds, 1, N) if constant else bounds
        if not self.rate:
            return each, ca.MX(0)
        rates = each[2 * nu :, :]
        lows, highs, outside, changes = [], [], [], 0
        low = high = before
        for k in range(N):
            changes += not self.tied[k]
            lo, hi, rate = each[:nu, k], each[nu : 2 * nu, k], rates[:, k]
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
                lows[k] = ca.fmax(lows[k], lows[k + 1] - rates[:, k + 1])
                highs[k] = ca.fmin(highs[k], highs[k + 1] + rates[:, k + 1])
        ends = zip(lows, highs, strict=True)
        columns = [ca.vertcat(a, b, rates[:, k]) for k, (a, b) in enumerate(ends)]
        return ca.horzcat(*columns), ca.mmax(ca.vertcat(*outside)) > SMALL

    def _start(self, name: str) -> float:
        """Control of the first guess: the value of the input, else 0."""
        s = self.h.model.inputs[name]
        value = 0.0 if s.value is None or isinstance(s.value, str) else float(s.value)
        return value / self.h.scale[self.h.controls.index(name)]

    def linearise(
        self, X: Any, V: Any, held: tuple[Any, Any], constants: tuple[Any, Any]
    ) -> tuple[Any, Any]:
        """Columns of the stages along a plan, and that of the last one."""
        nx, nu, N = self.h.nx, self.h.nu, self.h.stages
        q, shared = constants
        states, v = ca.reshape(X, nx, N + 1), ca.reshape(V, nu, N)
        D = self.stage.map(N)(states[:, :-1], v, held[0], ca.repmat(shared, 1, N), states[:, 1:])
        E = self.end(states[:, -1], held[1], q)
        return self.curved(D, E, states, v, held, q) if self.curved else (D, E)


def _per(unit: str) -> str:
    return "1" if unit == "1" else f"1/({unit})"


def _short(name: str) -> str:
    """Name of a limited signal within its part, as a parameter has it."""
    return name.split(".", 1)[1].replace(".", "_")
