"""Control without offset: what the model lacks is a constant, estimated tick by tick.

What is not known, w, is a held input of the plant or a constant rate of a state. With the state
x measured, F the step of the model and B = dF/dw exactly at the last tick, the tick missed
e = x - F(x_before, u_before, w), and

    w+ = w + share (B'WB + W_0)^-1 B'W e

with W the inverse squares of the states' sizes. So the error of w shrinks by 1 - share a tick
where B is what it was at the point ``at``. Where w is hardly seen it shrinks more slowly, for W_0
is a hundredth of the diagonal of B'WB at the point. At rest B'W e = 0: the model is right where w
acts.

The offset is zero then, if some steady state has all residuals zero whatever w is (U. Maeder,
F. Borrelli, M. Morari, Automatica 45, 2009). Both are ranks of the exact slopes. With the states
measured, w is told apart from them: rank (A - 1, B; 1, 0) = n + n_w. And the columns of w in A - 1,
B_u over X, U lead to residuals of zero. A state that no residual sees need not rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from slipctl.block.block import Block
from slipctl.block.signals import Input
from slipctl.errors import BadInput, nearest
from slipctl.predict.options.terminal import slopes_at
from slipctl.predict.stages.horizon import Horizon
from slipctl.predict.stages.joint_flow import with_inputs

SEEN = 1e-6
"""Smallest singular value, over the largest, of effects that are told apart."""

FLOOR = 0.01
"""Part of the effect at the point from which on an effect counts as weak."""

LEFT = 0.01
"""Part of an effect that rest may leave: slopes of a vehicle that goes on change slowly."""

SHARE = 0.2
"""Part of what a tick missed that is learnt from it."""


@dataclass(frozen=True)
class Unknown:
    """What is estimated.

    Attributes:
        names: held inputs of the problem. values: to begin with.
        weights: of the states, inverse squares of their sizes. floor: W_0, its diagonal.
    """

    names: tuple[str, ...]
    values: tuple[float, ...]
    weights: np.ndarray
    floor: np.ndarray

    def step(self, h: Horizon) -> ca.Function:
        """Function (x, v, d, q, share) -> state after the tick, and gain by column."""
        x, v, d, _ = h.symbols()
        q, share = ca.SX.sym("q", h.nq), ca.SX.sym("share")
        after, _ = h.step()(x, v * ca.DM(h.scale), d, q[: h.np_])
        B = ca.jacobian(after, d[[h.held.index(n) for n in self.names]])
        BW = ca.densify(B.T @ ca.diag(ca.DM(self.weights)))
        L = share * ca.solve(ca.densify(BW @ B) + ca.diag(ca.DM(self.floor)), BW)
        found = [ca.densify(after), ca.vec(ca.densify(L))]
        return ca.Function("unmodelled", [x, v, d, q, share], found, {"cse": True})


def with_constant_rates(
    where: str, plant: Block, given: Any, controls: Sequence[str]
) -> tuple[Block, list[str]]:
    """The plant with a constant rate for each state that is named, and its unknown inputs.

    Raises:
        BadInput: a name that is neither a state nor an input that is held.
    """
    names = [given] if isinstance(given, str) else given
    if not isinstance(names, (list, tuple)) or not names:
        raise BadInput(f"{where}: offset_free = {given!r}; give states or held inputs by name")
    known = [*plant.states, *(n for n in plant.inputs if n not in controls)]
    found, rates = [], {}
    for n in names:
        hits = [k for k in known if n in (k, k.rpartition(".")[2])]
        if len(hits) != 1:
            told = f" could be {' or '.join(hits)}" if hits else " is no state and no held input"
            raise BadInput(f"{where}: offset_free: {n!r}{told}{nearest(str(n), known)}")
        full = hits[0]
        if full in plant.inputs:
            found.append(full)
            continue
        s = plant.states[full]
        if s.shape != ():
            raise BadInput(f"{where}: offset_free: {full} is an array; name a scalar")
        unit = f"({s.unit})/s" if "/" in s.unit else f"{s.unit}/s"
        name = f"unmodelled_{full.replace('.', '_')}"
        rates[full] = Input(unit, f"rate of {full} beyond the model", value=0.0).named(name)
        found.append(name)
    if len(set(found)) < len(found):
        raise BadInput(f"{where}: offset_free names something twice; give each once")

    def change(n: dict[str, Any], u: Mapping[str, Any]) -> dict[str, Any]:
        return {k: v + u[rates[k].name] if k in rates else v for k, v in n.items()}

    return with_inputs(plant, list(rates.values()), change) if rates else plant, found


def with_unknown(
    where: str, h: Horizon, names: Sequence[str], weights: Mapping[str, float],
    at: Mapping[str, float],
) -> Horizon:  # fmt: skip
    """The problem with what is to be estimated, checked at a point.

    Raises:
        BadInput: an effect that is not seen there or not told apart from another one; residuals
            that cannot all be zero at rest.
    """
    forms = [(n, n.rpartition(".")[2], n.replace(".", "_")) for n in names]
    own = [next(n for n in form if n in h.held) for form in forms]
    at_rest = slopes_at(where, h, weights, at)
    which = [h.held.index(n) for n in own]
    x, d = at_rest.x, at_rest.d
    row = 1 / np.maximum(np.abs(x), 1.0)
    B = row[:, None] * at_rest.E[:, which]
    size = np.linalg.norm(B, axis=0)
    for n, s in zip(own, size, strict=True):
        if not s > 0:
            raise BadInput(
                f"{where}: offset_free: {n} changes no state at the point; give another at={{...}}"
            )
    w = np.linalg.svd(B / size, compute_uv=False)
    if len(own) > len(B) or w.min() < SEEN * w.max():
        raise BadInput(
            f"{where}: offset_free: {' and '.join(own)} cannot be distinguished with"
            f" {len(B)} measured states; leave one out"
        )
    left = at_rest.left(1 + np.array(which))
    if left > LEFT:
        raise BadInput(
            f"{where}: offset_free: with another {' or '.join(own)} no steady state has all"
            " residuals zero; weight command minus actuator state, such as F_cmd - F, not the"
            " command"
        )
    values = tuple(float(d[i]) for i in which)
    return replace(h, unknown=Unknown(tuple(own), values, row**2, FLOOR * size**2))
