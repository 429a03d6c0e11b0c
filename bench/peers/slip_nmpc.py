"""The slip problem of the study ``predictive``, solved by peers: IPOPT, FATROP, OSQP, do-mpc."""

from __future__ import annotations

import contextlib
from typing import Any

import casadi as ca
import numpy as np

from slipctl.predict.trials import Driver
from slipctl.run import build
from slipctl.studies.predictive.slip_problem import axle, cost, make, recorded


def bench(pairs: int = 9) -> dict[str, Any]:
    """One real-time iteration in generated C against IPOPT, FATROP, OSQP and do-mpc.

    All get the inputs of the same closed loop of 250 steps; times are per step.
    """
    from bench.speed import ratio

    block = make()
    inputs = recorded(block)
    roller = build.compile_roller(block.f)
    assert roller is not None
    driver = Driver(block)
    x_log, y_log = np.empty((len(inputs), driver.x.size)), np.empty((len(inputs), 4))

    def ours() -> None:
        roller.roll(driver.x.copy(), inputs, driver.p, x_log, y_log)

    def interpreted(solver: str) -> Any:
        other = make(solver=solver)
        start, f = Driver(other, compile=False), other.f

        def run() -> None:
            x = ca.DM(start.x)
            for u in inputs:
                x, _ = f(x, u, start.p)

        return run

    peers = {"ipopt": interpreted("ipopt"), "fatrop": interpreted("fatrop"), "osqp": osqp(inputs)}
    with contextlib.suppress(ImportError):  # an extra
        peers["do_mpc"] = do_mpc_controller(inputs)
    found: dict[str, Any] = {}
    for name, peer in peers.items():
        row = ratio(ours, peer, pairs if name == "osqp" else 3)
        found[f"{name}_vs_ours"] = {
            "ratio": 1 / row["ratio"], "ratio_min": 1 / row["ratio_max"],
            "ratio_max": 1 / row["ratio_min"], "ours_s": row["ours_s"] / len(inputs),
            "peer_s": row["peer_s"] / len(inputs),
        }  # fmt: skip
    return found


def osqp(inputs: np.ndarray) -> Any:
    """Call that does the same real-time iterations with OSQP on sparse matrices.

    Linearisation and matrices are generated C, OSQP is set up once, its numbers are updated and it
    starts from the last solution; tolerance 1e-5.
    """
    import osqp as solver
    from scipy import sparse

    from slipctl.predict.reference import Sparse
    from slipctl.predict.stages.horizon import Horizon
    from slipctl.predict.stages.linear_stage import stage_functions

    problem = Horizon.of(axle, cost, ["u"], None, {}, 20, 0.02, "rk4", 4, {"u": 8.0})
    of_stage = stage_functions("bench", problem)
    end, last = problem.end()
    matrices = Sparse("osqp", problem, of_stage.layout, last, [False] * 20, False, 1)._matrices()
    X, V, x0 = ca.MX.sym("X", 4, 21), ca.MX.sym("V", 1, 20), ca.MX.sym("x0", 4)
    d, q = ca.MX.sym("d", problem.nd), ca.MX.sym("q", problem.nq)
    shared = of_stage.once(q)
    following = of_stage.step(X[:, -1], V[:, -1], d, shared)
    Xs, Vs = ca.horzcat(X[:, 1:], following), ca.horzcat(V[:, 1:], V[:, -1])
    held, shared = ca.repmat(d, 1, 20), ca.repmat(shared, 1, 20)
    D = of_stage.stage.map(20)(Xs[:, :-1], Vs, held, shared, Xs[:, 1:])
    H, g, A, lba, uba, lbx, ubx = matrices(
        D, end(Xs[:, -1], d, q), ca.vec(Vs), 0, ca.repmat(ca.DM([0, 1, 1e9]), 1, 20), x0 - Xs[:, 0]
    )
    upper = ca.triu(H)
    whole = ca.vertcat(A, ca.MX.eye(g.numel()))
    columns = ca.vertcat(
        upper.nz[:], g, whole.nz[:], lba, lbx, uba, ubx, ca.vec(Xs),
        ca.vec(Vs),
    )  # fmt: skip
    sizes = [upper.nnz(), g.numel(), whole.nnz(), *[lba.numel() + lbx.numel()] * 2, 84, 20]
    edges = np.cumsum([0, *sizes])
    packed = ca.Function(
        "linearised", [ca.vertcat(ca.vec(X), ca.vec(V)), ca.vertcat(x0, d), q],
        [ca.DM(0, 1), columns], ["x", "u", "p"], ["n", "y"],
    )  # fmt: skip
    fast = _called(packed)
    constants = np.array([0.45, 120.0, 5000.0, 0.05, 9.81, 100.0, 5.0, 0.05])
    pattern_H = sparse.csc_matrix(_csc(upper))
    pattern_A = sparse.csc_matrix(_csc(whole))

    def run() -> None:
        plan = np.concatenate([np.tile(inputs[0, :4], 21), np.full(20, 1 / 8)])
        program = None
        for row in inputs:
            pieces = np.split(fast(plan, row, constants), edges[1:-1])
            Hx, g_now, Ax, low, high, x_now, v_now = pieces
            if program is None:
                pattern_H.data, pattern_A.data = Hx.copy(), Ax.copy()
                program = solver.OSQP()
                program.setup(
                    pattern_H, g_now, pattern_A, low, high, verbose=False, eps_abs=1e-5,
                    eps_rel=1e-5, max_iter=4000, check_termination=10,
                )  # fmt: skip
            else:
                program.update(q=g_now, l=low, u=high, Px=Hx, Ax=Ax)
            z = program.solve().x
            plan = np.concatenate([x_now + z[:84], v_now + z[84:104]])

    return run


def _csc(m: Any) -> Any:
    from scipy import sparse

    s = m.sparsity()
    return sparse.csc_matrix((np.ones(s.nnz()), s.row(), s.colind()), shape=s.shape)


def _called(f: ca.Function) -> Any:
    """Function (x, u, p) -> y as generated C, called with arrays."""
    roller = build.compile_roller(f)
    assert roller is not None
    n = f.size1_out(1)

    def call(x: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
        x_log, y = np.empty((1, x.size)), np.empty((1, n))
        roller.roll(x.copy(), u[None], p, x_log, y)
        return y[0]

    return call


def do_mpc_controller(inputs: np.ndarray) -> Any:
    """Call that solves the same problem with do-mpc as a user writes it: collocation, IPOPT."""
    import do_mpc

    model = do_mpc.model.Model("continuous")
    x = [model.set_variable("_x", n) for n in ("v", "q", "T", "xi")]
    u = model.set_variable("_u", "u")
    peak = model.set_variable("_tvp", "mu_p")
    p = axle.pack("param", axle.param_values())
    rates, slip = axle.f(ca.vertcat(*x), ca.vertcat(u, peak, 0.02), p)
    for k, n in enumerate(("v", "q", "T", "xi")):
        model.set_rhs(n, rates[k])
    model.setup()
    x, u = [model.x[n] for n in ("v", "q", "T", "xi")], model.u["u"]  # those of the model's own
    slip = axle.f(ca.vertcat(*x), ca.vertcat(u, model.tvp["mu_p"], 0.02), p)[1]
    controller = do_mpc.controller.MPC(model)
    controller.settings.n_horizon = 20
    controller.settings.t_step = 0.02
    controller.settings.store_full_solution = False
    controller.settings.supress_ipopt_output()
    ends = (100 * (slip - 0.02)) ** 2 / 2 + (5 * x[3]) ** 2 / 2
    controller.set_objective(mterm=ends, lterm=ends + (0.05 * (u - x[2])) ** 2 / 2)
    controller.bounds["lower", "_u", "u"], controller.bounds["upper", "_u", "u"] = 0, 8
    template = controller.get_tvp_template()
    controller.set_tvp_fun(lambda t: template)
    controller.setup()

    def run() -> None:
        controller.reset_history()
        controller.x0 = inputs[0, :4]
        controller.set_initial_guess()
        for row in inputs:
            template["_tvp", :, "mu_p"] = row[4]
            controller.make_step(row[:4, None])

    return run
