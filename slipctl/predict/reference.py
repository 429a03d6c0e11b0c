"""The same optimal control problems by general solvers: OSQP, qrqp, IPOPT, FATROP.

They validate :mod:`slipctl.predict.qp.active_set` and are what its speed is measured against. They
keep memory of their own or want libraries that a target does not have, so they run in Python only.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import accumulate
from typing import Any

import casadi as ca

from slipctl.errors import BadInput
from slipctl.predict.program import Program
from slipctl.predict.qp.active_set import LEAST, ActiveSet, Found
from slipctl.predict.stages.horizon import Horizon

OSQP: dict[str, Any] = {
    "osqp": {"verbose": False, "eps_abs": 1e-9, "eps_rel": 1e-9, "max_iter": 20000, "polish": True},
    "error_on_fail": False,
}
STEADY: dict[str, Any] = OSQP | {"osqp": OSQP["osqp"] | {"alpha": 1.0}}
"""Without over-relaxation, by which OSQP may stand still where a bound and a rate meet."""

DEVIATION = 1e-6
"""Residual of the conditions of optimality at which an answer is refused."""

QRQP = dict.fromkeys(("print_iter", "print_header", "print_info", "error_on_fail"), False)
QUADRATIC = {"osqp": (OSQP, STEADY), "qrqp": (QRQP,)}
"""Solvers of one quadratic program per iteration, with options to be tried in turn."""

QUIET: dict[str, Any] = {"print_time": False, "error_on_fail": False}
COMPILED: dict[str, Any] = {
    "jit": True,
    "compiler": "shell",
    "jit_temp_suffix": True,
    "jit_options": {"flags": ["-O2", "-ffp-contract=off"], "verbose": False},
}
"""Cost, rows and slopes of IPOPT and FATROP as compiled C: the same bits in less time."""


@contextmanager
def compile_callbacks() -> Iterator[None]:
    """Compile what IPOPT and FATROP call, in blocks that are made meanwhile.

    It takes some 10 s for each, so it is for measuring times. A C compiler is needed: without one
    the block is refused by CasADi (RuntimeError).
    """
    QUIET.update(COMPILED)
    try:
        yield
    finally:
        for n in COMPILED:
            del QUIET[n]


def available(where: str, solver: str) -> None:
    """Refuse a solver that this CasADi does not bring.

    Raises:
        BadInput: with what to use instead.
    """
    has = ca.has_nlpsol if solver in ("ipopt", "fatrop") else ca.has_conic
    if not has(solver):
        raise BadInput(f"{where}: CasADi has no {solver} here; use solver='riccati'")


class Sparse(ActiveSet):
    """The quadratic program of a real-time iteration, by a general solver with sparse matrices."""

    def __init__(self, solver: str, *args: Any) -> None:
        super().__init__(*args)
        self.solver = solver

    def solve(self, D: Any, E: Any, S: Any, U: Any, before: Any, bounds: Any, dx: Any) -> Found:
        """As of :class:`ActiveSet`; the statuses are left as they are."""
        data = (D, E, U, before, bounds, dx)
        z, left = self._solved(data, True, QUADRATIC[self.solver][0])
        tries = [(True, o) for o in QUADRATIC[self.solver][1:]]
        if self.h.hard:  # no control keeps the limits, or it has not found one
            tries += [(False, o) for o in QUADRATIC[self.solver]]
        for firm, options in tries:
            other, rest = self._solved(data, firm, options)
            z = ca.if_else(left < DEVIATION, z, other)
            left = ca.if_else(left < DEVIATION, left, rest)
        edge = self.h.nx * (self.h.stages + 1)
        X, V = z[:edge], z[edge : edge + self.h.nu * self.h.stages]
        return Found(X, V, S, S, ca.MX(0), left, ca.MX(0), ca.MX(1))

    def _solved(self, data: Any, firm: bool, options: dict[str, Any]) -> tuple[Any, Any]:
        """Answer of the solver, and what it leaves of the conditions of optimality.

        Hard limits are rows that have to be kept, or have a price: a million in the cost is more
        than the digits of a first-order method bear.
        """
        nx, nu, N = self.h.nx, self.h.nu, self.h.stages
        build = self._matrices(firm)
        H, g, A, lba, uba, lbx, ubx = build(*data)
        qp = ca.conic(
            "qp", self.solver, {"h": build.sparsity_out(0), "a": build.sparsity_out(2)}, options
        )
        done = qp(h=H, g=g, a=A, lba=lba, uba=uba, lbx=lbx, ubx=ubx)
        z = done["x"]
        slope = H @ z + g + A.T @ done["lam_a"] + done["lam_x"]
        held = ca.vertcat(A @ z, z)
        left = remains(
            slope, g[: nx * (N + 1) + nu * N], held, ca.vertcat(lba, lbx), ca.vertcat(uba, ubx),
            ca.vertcat(done["lam_a"], done["lam_x"]),
        )  # fmt: skip
        return z, left

    def _matrices(self, firm: bool = False) -> ca.Function:
        """Function (D, E, U, before, bounds, dx) -> (H, g, A, lba, uba, lbx, ubx).

        With ``firm`` hard limits have no excess, and no price; but where only the measured state
        decides, they are what they are.
        """
        nx, nu, N, nc = self.h.nx, self.h.nu, self.h.stages, self.h.nc
        D, E = ca.SX.sym("D", self.stage.size, N), ca.SX.sym("E", self.end.size)
        U, before = ca.SX.sym("U", nu * N), ca.SX.sym("before", nu)
        bounds, dx = ca.SX.sym("bounds", 3 * nu, N), ca.SX.sym("dx", nx)
        n = nx * (N + 1) + nu * N + nc * (N + 1)
        x = [range(nx * k, nx * (k + 1)) for k in range(N + 1)]
        v = [range(nx * (N + 1) + nu * k, nx * (N + 1) + nu * (k + 1)) for k in range(N)]
        first = nx * (N + 1) + nu * N
        t = [range(first + nc * k, first + nc * (k + 1)) for k in range(N + 1)]
        H, g = ca.SX(n, n), ca.SX.zeros(n)
        rows: list[tuple[Any, Any, Any]] = [(_at(n, x[0], ca.SX.eye(nx)), dx, dx)]
        inf = ca.SX.ones(nc) * ca.inf
        for k in range(N):
            stage = self._unpack(D[:, k])
            z = [*x[k], *v[k]]
            H[z, z] = stage.H + ca.diag(ca.vertcat(ca.SX(nx, 1), ca.SX.ones(nu) * LEAST))
            g[z] = stage.g
            A = _at(n, x[k + 1], -ca.SX.eye(nx)) + _at(n, z, ca.horzcat(stage.A, stage.B))
            rows.append((A, -stage.b, -stage.b))
            if nc:
                kept = [i for i in self.h.hard if firm and (k or stage.C[i, nx:].nnz())]
                rows.append((_at(n, z, stage.C) + _at(n, t[k], _excess(nc, kept)), -inf, -stage.c))
            lead = self.h.leaders if 0 < k <= self.h.shared else [*range(nu)]
            earlier = U[nu * (k - 1) : nu * k][lead] if k else before
            now, rate = U[nu * k : nu * (k + 1)], bounds[2 * nu :, k]
            if self.rates or self.tied[k]:
                A = _at(n, v[k], ca.SX.eye(nu))
                A += _at(n, v[k - 1], -ca.SX.eye(nu)[lead, :]) if k else 0
                room = ca.SX.zeros(nu) if self.tied[k] else rate
                rows.append((A, earlier - now - room, earlier - now + room))
        Hx, gx, c, C, w = self.end.unpack(E)
        H[x[N], x[N]] = ca.triu2symm(Hx)
        g[x[N]] = gx
        if nc:
            kept = list(self.h.hard) if firm else []
            rows.append((_at(n, x[N], C) + _at(n, t[N], _excess(nc, kept)), -inf, -c))
            every = [i for r in t for i in r]
            square = [1.0] * nc
            for i, q in zip(self.h.capped, self.h.square, strict=True):
                square[i] = float(q or (firm and i in self.h.hard))
            H[every, every] = ca.diag(ca.DM(square * (N + 1)))
            for k in range(N + 1):
                caps = self._unpack(D[:, k]).w if k < N else w
                for j, i in enumerate(self.h.capped):
                    g[t[k][i]] = 0 if firm and i in self.h.hard else caps[j]
        low, high = -ca.SX.ones(n) * ca.inf, ca.SX.ones(n) * ca.inf
        for k in range(N + 1):
            low[[t[k][i] for i in self.h.capped]] = 0
        low[first - nu * N : first] = ca.vec(bounds[:nu, :]) - U
        high[first - nu * N : first] = ca.vec(bounds[nu : 2 * nu, :]) - U
        A, lba, uba = (ca.vertcat(*[r[i] for r in rows]) for i in range(3))
        return ca.Function(
            "matrices", [D, E, U, before, bounds, dx],
            [H, g, ca.sparsify(A), ca.densify(lba), ca.densify(uba), low, high], {"cse": True},
        )  # fmt: skip


def _at(n: int, columns: Any, block: Any) -> Any:
    """Block spread to the given ones of n columns."""
    wide = ca.SX(block.shape[0], n)
    wide[:, list(columns)] = block
    return wide


def _excess(nc: int, kept: list[int]) -> Any:
    """Slope of the rows by what they are exceeded by, 0 where they are kept."""
    return -ca.diag(ca.SX([0.0 if i in kept else 1.0 for i in range(nc)]))


def nonlinear(where: str, problem: Horizon, solver: str, tied: list[bool], rates: bool) -> Any:
    """Function (x0, d, d last, q, before, bounds, guess X, guess V) -> (X, V, residual).

    Raises:
        BadInput: FATROP with rate limits or tied moves, which couple controls of two stages.
    """
    if solver == "fatrop" and (rates or any(tied)):
        raise BadInput(f"{where}: FATROP takes no rates and no moves; use solver='ipopt'")
    nx, nu, N = problem.nx, problem.nu, problem.stages
    scale = ca.DM(problem.scale)
    x0, q = ca.MX.sym("x0", nx), ca.MX.sym("q", problem.nq)
    d, d_last = ca.MX.sym("d", problem.nd, N), ca.MX.sym("d_last", problem.nd)
    before, bounds = ca.MX.sym("before", nu), ca.MX.sym("bounds", 3 * nu, N)
    X = [ca.MX.sym(f"X{k}", nx) for k in range(N + 1)]
    V = [ca.MX.sym(f"V{k}", nu) for k in range(N)]
    guess_x, guess_v = ca.MX.sym("GX", nx * (N + 1)), ca.MX.sym("GV", nu * N)
    step, cost, last = problem.step(), *problem.costs()
    firm, firm_end = problem.firm()
    count, unlimited = len(problem.hard), ca.MX.ones(nx) * ca.inf
    beyond, none = ca.MX.ones(count) * -ca.inf, ca.MX.zeros(count)
    program, f, still = Program(), ca.MX(0), ca.MX.zeros(nx)
    for k in range(N):
        program.vary(X[k], guess_x[nx * k : nx * (k + 1)], -unlimited, unlimited)
        ends = bounds[:nu, k], bounds[nu : 2 * nu, k]
        program.vary(V[k], guess_v[nu * k : nu * (k + 1)], *ends)
        f += cost(X[k], V[k], d[:, k], q)
        after = step(X[k], V[k] * scale, d[:, k], q[: problem.np_])[0]
        program.keep(X[k + 1] - after, -still, still, equation=True)
        if k == 0:
            program.keep(X[0] - x0, -still, still, equation=True)
        if rates or tied[k]:
            lead = problem.leaders if 0 < k <= problem.shared else [*range(nu)]
            most = ca.MX.zeros(nu) if tied[k] else bounds[2 * nu :, k]
            program.keep(V[k] - (V[k - 1][lead] if k else before), -most, most)
        if problem.hard and k:  # what is measured is what it is
            program.keep(firm(X[k], V[k], d[:, k], q), beyond, none)
    program.vary(X[N], guess_x[-nx:], -unlimited, unlimited)
    if problem.hard:
        program.keep(firm_end(X[N], d_last, q), beyond, none)
    f += last(X[N], d_last, q)
    every = ca.vertcat(x0, ca.vec(d), d_last, q, before, ca.vec(bounds))
    variables, rows, given = program.x, program.g, program.given
    nlp = ca.nlpsol(
        "nlp", solver, {"x": variables, "f": f, "g": rows, "p": every},
        _nlp_options(solver, program.equations),
    )  # fmt: skip
    lam = ca.MX.sym("lam", rows.numel())
    slopes = ca.Function(
        "slopes", [variables, every, lam],
        [ca.gradient(f, variables), ca.jtimes(rows, variables, lam, True), rows],
    )  # fmt: skip
    done = nlp(p=every, **given)
    pieces = ca.vertsplit(done["x"], [0, *accumulate([*[nx, nu] * N, nx])])
    down, back, held = slopes(done["x"], every, done["lam_g"])
    left = remains(
        down + back + done["lam_x"], down, ca.vertcat(held, done["x"]),
        ca.vertcat(given["lbg"], given["lbx"]), ca.vertcat(given["ubg"], given["ubx"]),
        ca.vertcat(done["lam_g"], done["lam_x"]),
    )  # fmt: skip
    return ca.Function(
        "to_the_end", [x0, d, d_last, q, before, bounds, guess_x, guess_v],
        [ca.vertcat(*pieces[0::2]), ca.vertcat(*pieces[1::2]), left],
    )  # fmt: skip


def _nlp_options(solver: str, equations: list[bool]) -> dict[str, Any]:
    if solver == "fatrop":
        own = {"structure_detection": "auto", "equality": equations, "fatrop.print_level": 0}
    else:
        own = {"ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-8, "ipopt.mu_init": 1e-4}
    return QUIET | own


def remains(slope: Any, gradient: Any, held: Any, lo: Any, hi: Any, multipliers: Any) -> Any:
    """What is left of the conditions of Karush, Kuhn and Tucker at an answer.

    Args:
        slope: of the Lagrangian. gradient: of the cost.
        held: what is limited, between lo and hi. multipliers: of it, positive at hi.

    Returns:
        The largest of slope and multiplier times room, over one and the size of the gradient, and
        of the excess of a limit.
    """
    size = 1 + ca.mmax(ca.fabs(gradient))
    above = ca.fmax(multipliers, 0) * ca.fmin(ca.fabs(hi - held), 1)
    below = ca.fmax(-multipliers, 0) * ca.fmin(ca.fabs(held - lo), 1)
    steep = ca.mmax(ca.fabs(slope)) / size
    idle = ca.mmax(ca.vertcat(above, below)) / size
    return ca.fmax(ca.fmax(steep, idle), ca.mmax(ca.vertcat(held - hi, lo - held, 0)))
