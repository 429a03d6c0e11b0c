"""do-mpc on the problems of the study, where it is installed: ``pip install slipctl[bench]``."""

from __future__ import annotations

import contextlib
import io
import warnings
from typing import Any

import casadi as ca
import numpy as np

from slipctl.predict.reference import DEVIATION, remains
from slipctl.studies.predictive.problems import Problem, rolled, slip


def do_mpc(p: Problem) -> dict[str, Any]:
    """Closed loop under do-mpc's controller: collocation of its own, IPOPT, 20 stages.

    What an answer leaves of the conditions of Karush, Kuhn and Tucker of its own problem is worked
    out here, before it is used; see :func:`slipctl.studies.predictive.problems.run`.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of features that are not asked for
        controller, template = as_user_writes(p)
    left: list[float] = []

    def command(*given: float) -> tuple[float, ...]:
        x, known = np.array(given[: len(p.plant.states)]), given[len(p.plant.states) :]
        if not left:
            controller.x0 = x
            controller.set_initial_guess()
        for n, value in zip(list(p.plant.inputs)[1:], known, strict=True):
            template["_tvp", :, n] = value
        with contextlib.redirect_stdout(io.StringIO()):
            u = float(controller.make_step(x[:, None])[0, 0])
        left.append(_left(controller))
        return u, float(left[-1] > DEVIATION), 0.0, left[-1]

    found = rolled(p, command)
    if max(left) > DEVIATION:
        return dict.fromkeys(("cost", "residual", "unsettled", "passes", "slip"))
    return dict(cost=found.cost, residual=max(left), unsettled=0, passes=0.0,
                slip=max(slip(x) for x in found.x[1:]))  # fmt: skip


def as_user_writes(p: Problem) -> tuple[Any, Any]:
    """The problem as a user of do-mpc writes it, and the template of what is known."""
    import do_mpc

    model = do_mpc.model.Model("continuous")
    x = [model.set_variable("_x", n) for n in p.plant.states]
    control, *known = p.plant.inputs
    u = model.set_variable("_u", control)
    told = [model.set_variable("_tvp", n) for n in known]
    rates, _ = p.plant.f(
        ca.vertcat(*x), ca.vertcat(u, *told), p.plant.pack("param", p.plant.param_values())
    )
    for k, n in enumerate(p.plant.states):
        model.set_rhs(n, rates[k])
    model.setup()
    x = ca.vertcat(*[model.x[n] for n in p.plant.states])
    stage, last = _costs(p, x, ca.vertcat(model.u[control], *[model.tvp[n] for n in known]))
    controller = do_mpc.controller.MPC(model)
    s = controller.settings
    s.n_horizon, s.t_step, s.store_full_solution = 20, p.h, False
    s.supress_ipopt_output()
    s.nlpsol_opts |= {"ipopt.tol": 1e-9, "ipopt.bound_relax_factor": 0.0}
    controller.set_objective(mterm=last, lterm=stage)
    limit = p.plant.inputs[control]
    controller.bounds["lower", "_u", control] = limit.lo
    controller.bounds["upper", "_u", control] = limit.hi
    template = controller.get_tvp_template()
    controller.set_tvp_fun(lambda t: template)
    controller.setup()
    return controller, template


def _costs(p: Problem, x: Any, u: Any) -> tuple[Any, Any]:
    """Cost of a stage, and of the last one, which has no control."""
    numbers = p.plant.pack("param", p.plant.param_values())
    named = dict(zip(p.plant.states, ca.vertsplit(x), strict=True))
    named |= dict(zip(p.plant.inputs, ca.vertsplit(u), strict=True))
    named |= p.plant.unpack("output", p.plant.f(x, u, numbers)[1])
    _, y = p.cost.f([], ca.vertcat(*[named[n] for n in p.cost.inputs]), [])
    errors = p.cost.unpack("output", y)
    rows = {n: (p.weights[n] * e) ** 2 / 2 for n, e in errors.items()}
    last = [r for r in rows.values() if not ca.depends_on(r, u[0])]
    return sum(rows.values()), sum(last)


def _left(controller: Any) -> float:
    """What the last answer leaves of the conditions of optimality."""
    nlp = controller.nlp
    x, f, g, lam = nlp["x"], nlp["f"], nlp["g"], ca.SX.sym("lam", nlp["g"].shape[0])
    down, back = ca.gradient(f, x), ca.jtimes(g, x, lam, True)
    slopes = ca.Function("slopes", [x, nlp["p"], lam], [down, down + back, g])
    at, l_g, l_x = controller.opt_x_num.master, controller.lam_g_num, controller.lam_x_num
    gradient, slope, held = slopes(at, controller.opt_p_num.master, l_g)
    lo = ca.vertcat(controller.nlp_cons_lb, controller._lb_opt_x.master)
    hi = ca.vertcat(controller.nlp_cons_ub, controller._ub_opt_x.master)
    return float(remains(slope + l_x, gradient, ca.vertcat(held, at), lo, hi,
                         ca.vertcat(l_g, l_x)))  # fmt: skip
