"""How far limits have to be drawn in, so that they hold with a stated probability.

Near a point the plant is dx+ = A dx + B dv + w, with w normal and independent from tick to tick.
What later ticks measure is answered, here by the regulator's law dv = -K dx of the same cost. So
the state is off its plan by e+ = (A - B K) e + w. In the first stage it is e+ = A e + w, because
that control is fixed already. From stage to stage the covariance S goes as

    S+ = (A - B K) S (A - B K)' + Q

A value y of the plant is then off by a normal number of variance c'S c, c = dy/dx - K' dy/dv. It
keeps a limit with the probability p where the plan stays sqrt(c'S c) z(p) away from it, each limit
at each stage by itself. This is the back-off of stochastic predictive control (Mesbah, Stochastic
model predictive control, IEEE Control Systems 36(6), 2016).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np

from slipctl.block.block import Block, as_block
from slipctl.errors import BadInput, check_known, check_number, check_positive, check_whole
from slipctl.predict.options.arguments import bounds_of, by_name, scale_of, weights_of
from slipctl.predict.options.terminal import slopes_at
from slipctl.predict.stages.horizon import Horizon


def tightening(
    plant: Block,
    cost: Block,
    control: str | Sequence[str],
    limited: str | Sequence[str],
    *,
    h: float,
    noise: Mapping[str, float],
    chance: float = 0.99,
    horizon: int = 20,
    start: Mapping[str, float] | None = None,
    answered: bool = True,
    weights: Mapping[str, float] | None = None,
    at: Mapping[str, float] | None = None,
    method: str = "rk4",
    substeps: int = 1,
) -> dict[str, np.ndarray]:
    """Compute how far a plan has to stay away from limits, stage by stage.

    Give each as a previewed input to a law of ``nmpc(path=...)`` that adds it to what is limited.

    Args:
        plant, cost, control, h, horizon, weights, at, method, substeps: as of :func:`nmpc`, with
            a weight on every control.
        limited: states or outputs of the plant that have limits.
        noise: by state the variance that it gains per second, in its unit squared per second.
        chance: probability with which one limit holds at one stage, above a half.
        start: by state the variance of what is measured, 0 where it is left out.
        answered: what later ticks measure is answered by the regulator. False: by nothing.

    Returns:
        Arrays of horizon + 1 values by name: now, and after each stage. They are exact for a
        linear plant whose later controls are the regulator's, with normal noise.

    Raises:
        BadInput: unknown names, a variance below 0, a chance that is none, no regulator there.
    """
    from scipy.stats import norm

    where = f"tightening({as_block('tightening: the plant', plant).name})"
    as_block(f"{where}: the cost", cost)
    check_positive(f"{where}: h", h, "s")
    check_whole(f"{where}: horizon", horizon, 1)
    check_number(f"{where}: chance", chance)
    if not 0.5 < chance < 1:
        raise BadInput(f"{where}: chance = {chance:g}; give a probability between 0.5 and 1")
    controls = [control] if isinstance(control, str) else list(control)
    full = {c: plant.find(c, "input") for c in controls}
    names = [limited] if isinstance(limited, str) else list(limited)
    known = {n: f"plant.{plant.find(n, 'state', 'output')}" for n in names}
    ends = bounds_of(where, plant, full, {})
    scale = {c: scale_of(*ends[c]) for c in controls}
    weigh = weights_of(where, [cost], by_name(where, "weights", weights))
    problem = Horizon.of(plant, cost, controls, None, {}, 1_000_000, h, method, substeps, scale)
    slopes = slopes_at(where, problem, weigh, by_name(where, "at", at))
    K = slopes.gain(slopes.regulator(where)) @ slopes.T
    A, B, rows = _whole(problem, list(known.values()), slopes.x, slopes.v, slopes.d)
    K = K if answered else 0 * K
    Q, S = (_variances(where, what, plant, given or {})
            for what, given in (("noise", noise), ("start", start)))  # fmt: skip
    found = np.empty((horizon + 1, len(names)))
    for k in range(horizon + 1):
        answer = K if k else 0 * K  # this tick's control is fixed by what is measured now
        C, M = rows[0] - rows[1] @ answer, A - B @ answer
        found[k] = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", C, S, C), 0))
        S = M @ S @ M.T + Q * h
    return dict(zip(names, float(norm.ppf(chance)) * found.T, strict=True))


def _whole(
    h: Horizon, names: list[str], x0: np.ndarray, v0: np.ndarray, d0: np.ndarray
) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """A, B of all states, and slopes of the named values by states and by scaled controls."""
    x, v, d, _ = h.symbols()
    p = ca.DM(h.model.pack("param", h.model.param_values()))
    u = v * ca.DM(h.scale)
    step, _ = h.step()(x, u, d, p)
    y = h._outputs(x, u, d, p)
    values = ca.vertcat(*[y[n] for n in names])
    parts = [ca.densify(ca.jacobian(of, by)) for of in (step, values) for by in (x, v)]
    A, B, Cx, Cv = (ca.DM(m).full() for m in ca.Function("whole", [x, v, d], parts)(x0, v0, d0))
    return A, B, (Cx, Cv)


def _variances(where: str, what: str, plant: Block, given: Mapping[str, float]) -> np.ndarray:
    """Diagonal matrix of variances by state."""
    sizes = {n: s.size for n, s in plant.states.items()}
    found = dict.fromkeys(sizes, 0.0)
    for n, value in by_name(where, what, given).items():
        check_known(f"{where}: {what} has", n, sizes, ", which is no state")
        check_number(f"{where}: {what} of {n}", value)
        if not 0 <= value < math.inf:
            raise BadInput(f"{where}: {what} of {n} = {value:g} is a variance; give 0 or more")
        found[n] = float(value)
    return np.diag([found[n] for n, size in sizes.items() for _ in range(size)])
