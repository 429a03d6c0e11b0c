"""The stages of an optimal control problem: plant over one step, residuals, and their slopes.

Over a horizon of N stages of length h, with z = (x, v), v = u/scale,

    minimise  1/2 sum_k |W r(x_k, u_k)|^2 + 1/2 |W r(x_N)|^2 + sum_k w t_k + 1/2 sum_k |t_k|^2
              + sum_k W l(x_k, u_k)
    with      x_{k+1} = F(x_k, u_k),  lo <= u_k <= hi,  |u_k - u_{k-1}| <= rate h,
              t_k >= max(0, c(x_k, u_k))

r are the outputs of the cost law, l prices, W their weights, c the weighted excess of a limit, t
what is given up of it. The square is left out where a limit has no quadratic weight. A hard limit
has w so large (:data:`HARD`) that t is 0 wherever any control allows it: an exact penalty. One
stage gives, at a guess of its state and control, A, B, b of the linear step, and the Gauss-Newton
Hessian H = J'J with g = J'r + l'. The curvature of a price is left out: what it ends at is the
same, and H stays positive. It gives c with its slope C too. All are packed to one column of their
structural nonzeros.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import casadi as ca

from slipctl.block.block import Block
from slipctl.block.text.intermediates import elements, function
from slipctl.block.transforms.discretisation import sampled
from slipctl.errors import BadInput, check_known
from slipctl.predict.options.scenarios import Factors, own, ties
from slipctl.predict.stages.joint_flow import check_lag, join_flows
from slipctl.predict.stages.stage_lengths import STRETCH

if TYPE_CHECKING:
    from slipctl.predict.options.offset import Unknown

HARD = 1e6
"""Cost of giving up a hard limit by its own size."""


class Soft(NamedTuple):
    """Limits of one output or state of the plant.

    Attributes:
        lo, hi: the limits.
        weight: of the squared excess per unit, 0 for none; of a hard limit one over its size.
        linear: weight of the excess per unit.
        hard: given up only where nothing else is left.
    """

    lo: float
    hi: float
    weight: float
    linear: float = 0.0
    hard: bool = False


class Stage(NamedTuple):
    """Linear step, Hessian and slope of one stage, unpacked."""

    A: Any
    B: Any
    b: Any
    H: Any
    g: Any
    c: Any
    C: Any
    w: Any


@dataclass(frozen=True)
class Horizon:
    """An optimal control problem; made by :meth:`of`.

    Attributes:
        flow: plant and cost, connected; ``model``: discretised.
        controls: inputs of the model that are decided.
        held: its other inputs, which keep their present value over the horizon or are previewed.
        residuals: outputs that are squared; ``last`` those of the last stage, ``own`` those that
            count there alone.
        soft: outputs or states with limits; ``limits`` what they are.
        stages: N.
        scale: size of each control.
        tail: further residuals of the last stage, L x + M d + c.
        over: method and substeps of a stage.
        damped: whether the last constant is a curvature added for each step of a scaled control.
        unknown: held inputs that the controller estimates, if any.
        lengths: of the stages over the first one; none where they are all alike.
        factors: of each scenario; none where the plant is one.
        shared: stages after which each scenario has controls of its own; 0 where it has none.
        prices: outputs that are summed as they are.
        exact: whether Hessians are exact ones, made convex
            (:mod:`slipctl.predict.stages.exact_hessian`).
    """

    flow: Block
    model: Block
    controls: tuple[str, ...]
    held: tuple[str, ...]
    residuals: tuple[str, ...]
    last: tuple[str, ...]
    soft: tuple[str, ...]
    limits: tuple[Soft, ...]
    stages: int
    scale: tuple[float, ...]
    own: tuple[str, ...] = ()
    tail: tuple[Any, Any, Any] | None = None
    over: tuple[str, int] = ("", 1)
    damped: bool = False
    unknown: Unknown | None = None
    lengths: tuple[float, ...] = ()
    factors: Factors = ()
    prices: tuple[str, ...] = ()
    exact: bool = False
    shared: int = 0
    bounded: ClassVar[bool] = True
    """Whether controls have bounds."""

    @classmethod
    def of(
        cls, plant: Block, cost: Block, control: Sequence[str], terminal: Sequence[str] | None,
        soft: Mapping[str, Soft], stages: int, h: float, method: str, substeps: int,
        scale: Mapping[str, float], laws: Mapping[str, Block] | None = None,
        lengths: tuple[float, ...] = (), factors: Factors = (), shared: int = 0,
    ) -> Horizon:  # fmt: skip
        """Connect plant, cost and further laws by the names of their signals, and discretise.

        The names of ``soft`` begin with the part that they belong to: ``plant``, or a law.
        """
        where = f"nmpc({plant.name})"
        laws = dict(laws or {})
        full = {plant.find(c, "input"): scale[c] for c in control}
        branching = full if shared else None
        model, alias = join_flows(where, plant, {"cost": cost, **laws}, factors, branching)
        expressions(where, plant)
        many = len(factors) if shared else 1
        controls = tuple(own(alias[c], i) for i in range(many) for c in full)
        check_lag(where, plant, model, controls, (sum(lengths) or stages) * h)
        flow, model = model, sampled(model, h, method, substeps)
        residuals = tuple(f"cost.{n}" for n in cost.outputs)
        horizon = cls(
            flow, model, controls, tuple(n for n in model.inputs if n not in controls), residuals,
            (), tuple(soft), tuple(soft.values()), stages, tuple(full.values()) * many,
            tuple(f"last.{n}" for n in laws["last"].outputs) if "last" in laws else (),
            over=(method, substeps), lengths=lengths, factors=factors, shared=shared,
            prices=tuple(f"price.{n}" for n in laws["price"].outputs) if "price" in laws else (),
        )  # fmt: skip
        horizon._refuse_controls_at_the_end(where)
        return horizon._with_last(where, cost, terminal)

    def _refuse_controls_at_the_end(self, where: str) -> None:
        """Refuse a law of the last stage that reads a control, which that stage does not have."""
        x, u, d, p = self.symbols()
        y = self._outputs(x, u, d, p)
        for n in (*self.own, *(s for s in self.soft if s.startswith("final."))):
            if ca.depends_on(y[n], u):
                part, short = n.split(".", 1)
                raise BadInput(
                    f"{where}: {short} of the {part} law depends on the control, which the last"
                    " stage does not have; write it of states and references"
                )

    def _with_last(self, where: str, cost: Block, terminal: Sequence[str] | None) -> Horizon:
        """Choose the residuals of the last stage, which has no control."""
        x, u, d, p = self.symbols()
        y = self._outputs(x, u, d, p)
        free = [n for n in self.residuals if not ca.depends_on(y[n], u)]
        if terminal is None:
            last = [] if self.own else free
        else:
            last = []
            for n in terminal:
                check_known(f"{where}: the cost has no residual", n, cost.outputs)
                if f"cost.{n}" not in free:
                    raise BadInput(
                        f"{where}: {n} depends on the control, which the last stage does not have;"
                        " leave it out of terminal="
                    )
                last.append(f"cost.{n}")
        for n in self.residuals:
            if not ca.depends_on(y[n], ca.vertcat(x, u)):
                raise BadInput(f"{where}: the residual {n[5:]} depends on no state and no control")
        return replace(self, last=(*last, *self.own))

    # ---- sizes and symbols --------------------------------------------------------------------

    @property
    def nx(self) -> int:
        """Number of states."""
        return sum(s.size for s in self.model.states.values())

    @property
    def nu(self) -> int:
        """Number of controls."""
        return len(self.controls)

    @property
    def decided(self) -> tuple[str, ...]:
        """Controls of the plant; of a plan that branches those that all scenarios share."""
        return self.controls[: self.nu // len(self.factors)] if self.shared else self.controls

    @property
    def leaders(self) -> list[int]:
        """For each control the one of the first scenario, which all share in a shared stage."""
        return [*range(self.nu // len(self.factors))] * len(self.factors)

    @property
    def nd(self) -> int:
        """Number of held inputs."""
        return len(self.held)

    @property
    def nc(self) -> int:
        """Number of soft rows, an upper and a lower one for each limited signal."""
        return 2 * len(self.soft)

    @property
    def capped(self) -> tuple[int, ...]:
        """Rows whose multiplier has a largest value: hard ones and those with a linear weight."""
        return self._rows_where(lambda limit: limit.hard or limit.linear > 0)

    @property
    def square(self) -> tuple[bool, ...]:
        """Whether the excess of each capped row is squared too."""
        return tuple(self.limits[i // 2].weight > 0 and i not in self.hard for i in self.capped)

    @property
    def hard(self) -> tuple[int, ...]:
        """Capped rows that are hard."""
        return self._rows_where(lambda limit: limit.hard)

    def _rows_where(self, wanted: Callable[[Soft], bool]) -> tuple[int, ...]:
        return tuple(2 * k + i for k, s in enumerate(self.limits) if wanted(s) for i in (0, 1))

    @property
    def nq(self) -> int:
        """Number of constants: parameters, weights, four of each limit, and the damping."""
        return self.np_ + len(self.weighed) + 4 * len(self.soft) + self.damped

    @property
    def weighed(self) -> tuple[str, ...]:
        """Outputs with a weight: residuals of every stage, those of the last one alone, prices."""
        return (*self.residuals, *self.own, *self.prices)

    @property
    def np_(self) -> int:
        """Number of parameters of the model."""
        return sum(s.size for s in self.model.params.values())

    def symbols(self) -> tuple[Any, Any, Any, Any]:
        """Symbols of state, control, held inputs and parameters."""
        x, u = ca.SX.sym("point", self.nx), ca.SX.sym("control", self.nu)
        return x, u, ca.SX.sym("d", self.nd), ca.SX.sym("numbers", self.np_)

    def of_stage(self) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Symbols of state, scaled control, held inputs and constants, and the outputs of these."""
        x, v, d, _ = self.symbols()
        q = ca.SX.sym("q", self.nq)
        return x, v, d, q, self._outputs(x, v * ca.DM(self.scale), d, q[: self.np_])

    def step(self) -> ca.Function:
        """Function (x, u, d, p) -> (state after the step, outputs at its start)."""
        x, u, d, p = self.symbols()
        f = expressions("nmpc", self.model)
        n, y = f(x, self._inputs(u, d), p)
        return ca.Function(
            "stage_step", [x, u, d, p], [n, y], ["point", "control", "d", "numbers"],
            ["point_after", "y"], {"cse": True},
        )  # fmt: skip

    def _inputs(self, u: Any, d: Any) -> Any:
        known = {n: u[k] for k, n in enumerate(self.controls)}
        known |= {n: d[k] for k, n in enumerate(self.held)}
        return ca.vertcat(*[known[n] for n in self.model.inputs])

    def _outputs(self, x: Any, u: Any, d: Any, p: Any) -> dict[str, Any]:
        y = self.model.unpack("output", self.step()(x, u, d, p)[1])
        y = y | self.model.unpack("state", x)
        if self.factors:
            y |= {f"{n}.{i}": v[i] for n, v in y.items() for i in range(len(self.factors))}
        return y

    def _rows(self, y: Mapping[str, Any], names: Sequence[str], q: Any) -> Any:
        weights = q[self.np_ : self.np_ + len(self.weighed)]
        return ca.vertcat(*[weights[self.weighed.index(n)] * y[n] for n in names])

    def _stage_rows(self, y: Mapping[str, Any], d: Any, q: Any) -> Any:
        """Weighted residuals of a stage, whose squares count by its length."""
        r = self._rows(y, self.residuals, q)
        if self.shared:
            r = ca.vertcat(r, *[y[n] for n in ties(self.decided)])
        return r * ca.sqrt(d[self.held.index(STRETCH)]) if self.lengths else r

    def _priced(self, y: Mapping[str, Any], d: Any, q: Any) -> Any:
        """Weighted prices of a stage, by its length."""
        total = ca.sum1(self._rows(y, self.prices, q)) if self.prices else ca.SX(0)
        return total * d[self.held.index(STRETCH)] if self.lengths else total

    def _last_rows(self, y: Mapping[str, Any], x: Any, d: Any, q: Any) -> Any:
        """Weighted residuals of the last stage."""
        r = self._rows(y, self.last, q) if self.last else ca.SX(0, 1)
        if self.tail is not None:
            L, M, c = (ca.DM(m) for m in self.tail)
            r = ca.vertcat(r, ca.sparsify(L) @ x + ca.sparsify(M) @ d + c)
        return r

    def _soft_rows(self, y: Mapping[str, Any], q: Any) -> Any:
        at, rows = self.np_ + len(self.weighed), []
        for k, n in enumerate(self.soft):
            if n not in y:  # no row of this stage: far below its limit
                rows += [ca.SX(-1), ca.SX(-1)]
                continue
            lo, hi, weight, linear = ca.vertsplit(q[at + 4 * k : at + 4 * k + 4])
            per = weight if self.limits[k].weight > 0 else linear
            rows += [per * (y[n] - hi), per * (lo - y[n])]
        return ca.vertcat(*rows) if rows else ca.SX(0, 1)

    def _caps(self, q: Any) -> Any:
        """Largest multiplier of each capped row, without that of its square."""
        at, caps = self.np_ + len(self.weighed), []
        for i in self.capped:
            limit = self.limits[i // 2]
            weight, linear = q[at + 4 * (i // 2) + 2], q[at + 4 * (i // 2) + 3]
            both = linear / weight if limit.weight > 0 else ca.SX(1)
            caps.append(ca.SX(HARD) if limit.hard else both)
        return ca.densify(ca.vertcat(*caps)) if caps else ca.SX(0, 1)

    def costs(self) -> tuple[ca.Function, ca.Function]:
        """Functions (x, v, d, q) and (x, d, q) -> cost of a stage and of the last one."""
        x, u, d, q, y = self.of_stage()
        excess = ca.sumsqr(ca.fmax(0, self._soft_rows(on_the_way(y), q)))
        stage = (ca.sumsqr(self._stage_rows(y, d, q)) + excess) / 2 + self._priced(y, d, q)
        end, layout = self.end()
        _, _, c, _, _ = layout.unpack(end(x, d, q))
        last = (ca.sumsqr(self._last_rows(y, x, d, q)) + ca.sumsqr(ca.fmax(0, c))) / 2
        return (
            ca.Function("stage_cost", [x, u, d, q], [stage], {"cse": True}),
            ca.Function("end_cost", [x, d, q], [last], {"cse": True}),
        )

    def firm(self) -> tuple[ca.Function, ca.Function]:
        """Functions (x, v, d, q) and (x, d, q) -> excess of the hard limits, at most 0 if kept."""
        x, u, d, q, y = self.of_stage()
        still = {n: v for n, v in y.items() if not ca.depends_on(v, u)}
        rows, last = (self._soft_rows(v, q)[list(self.hard)] for v in (on_the_way(y), still))
        return (
            ca.Function("stage_limits", [x, u, d, q], [rows]),
            ca.Function("end_limits", [x, d, q], [last]),
        )

    # ---- one stage ------------------------------------------------------------------------------

    def rows(self) -> tuple[ca.Function, tuple[Any, ...]]:
        """Function (x, v, d, q) -> column of H, g, c, C and w of a stage, and their sparsities."""
        x, u, d, q, y = self.of_stage()
        z = ca.vertcat(x, u)
        r, c = self._stage_rows(y, d, q), self._soft_rows(on_the_way(y), q)
        J, C = ca.jacobian(r, z), ca.jacobian(c, z)
        H = ca.triu(J.T @ J)
        if self.damped:
            H = H + q[-1] * ca.diag(ca.vertcat(ca.SX(self.nx, 1), ca.SX.ones(self.nu)))
        g = J.T @ r + ca.gradient(self._priced(y, d, q), z)
        pieces = [H, ca.densify(g), c, C, self._caps(q)]
        layout = Layout.of(pieces)
        column = layout.pack(pieces)
        letters = {**_short(y), "r": r, "J": J, "c": c, "C": C}
        found = [e for n, v in letters.items() for e in elements(n, v)]
        names = ["point", "control", "d", "q"]
        return function(found, "rows", [x, u, d, q], [column], names, ["column"]), layout.sparsity

    def end(self) -> tuple[ca.Function, Layout]:
        """Function (x, d, q) -> column of the last stage: H, g, c and C over the state alone."""
        x, u, d, q, y = self.of_stage()
        r = self._last_rows(y, x, d, q)
        c = self._soft_rows({n: v for n, v in y.items() if not ca.depends_on(v, u)}, q)
        J, C = ca.jacobian(r, x), ca.jacobian(c, x)
        pieces = [ca.triu(J.T @ J), ca.densify(J.T @ r), c, C, self._caps(q)]
        layout = Layout.of(pieces)
        letters = {**_short(y), "r": r, "J": J, "c": c, "C": C}
        found = [e for n, v in letters.items() for e in elements(n, v)]
        column = layout.pack(pieces)
        return function(found, "end", [x, d, q], [column], ["point", "d", "q"], ["column"]), layout


def _short(y: Mapping[str, Any]) -> dict[str, Any]:
    """Signals by their names without those of their parts."""
    return {n.rpartition(".")[2]: v for n, v in y.items()}


def on_the_way(y: Mapping[str, Any]) -> dict[str, Any]:
    """Outputs of a stage that is not the last one."""
    return {n: v for n, v in y.items() if not n.startswith("final.")}


@dataclass(frozen=True)
class Layout:
    """Sparsity of the pieces of a packed column."""

    sparsity: tuple[Any, ...]

    @classmethod
    def of(cls, pieces: Sequence[Any]) -> Layout:
        """Layout of given pieces."""
        return cls(tuple(m.sparsity() for m in pieces))

    @property
    def size(self) -> int:
        """Number of nonzeros."""
        return sum(s.nnz() for s in self.sparsity)

    @property
    def gradient(self) -> tuple[int, int]:
        """Place and length of the gradient in a stage's column."""
        return sum(s.nnz() for s in self.sparsity[:4]), self.sparsity[4].nnz()

    def pack(self, pieces: Sequence[Any]) -> Any:
        """Stack the nonzeros to a column."""
        return ca.densify(ca.vertcat(*[ca.SX(ca.vertcat(*m.nonzeros())) for m in pieces]))

    def unpack(self, column: Any) -> list[Any]:
        """Give the pieces back."""
        at, pieces = 0, []
        for s in self.sparsity:
            pieces.append(ca.SX(s, column[at : at + s.nnz()]))
            at += s.nnz()
        return pieces


def expressions(where: str, block: Block) -> ca.Function:
    """The block's Function as scalar expressions, which have derivatives of every order.

    Raises:
        BadInput: something in it has none (an equation solved inside, foreign code).
    """
    if block.sx:
        return block.f
    try:
        f = block.f.expand()
        x, u, p = (ca.SX.sym("xup"[i], f.size1_in(i)) for i in range(3))
        ca.hessian(ca.sum1(f(x, u, p)[0]), ca.vertcat(x, u))
        return f
    except RuntimeError as error:
        reason = str(error).strip().split("\n")[-1].rpartition(": ")[2][:120]
        raise BadInput(
            f"{where}: {block.name} cannot be differentiated twice ({reason}); write it in"
            " expressions, an equation solved inside as a fixed number of its steps"
        ) from None
