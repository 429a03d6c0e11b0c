"""State observers of linear blocks: poles are placed, printed gains are checked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np

from slipctl.analysis.linearise import matrices
from slipctl.block.block import Block, Exprs, make_block
from slipctl.block.signals import Input, Output, Param, State
from slipctl.block.units.unit_algebra import unit
from slipctl.certify.bounds.observers import check_poles, pole_text
from slipctl.errors import BadInput, check_all_known


def luenberger(
    block: Block,
    poles: Sequence[complex] | None = None,
    *,
    measured: str | Sequence[str] | None = None,
    gains: Mapping[str, float] | None = None,
    slowest: float = 1.0,
    check: bool = True,
) -> Block:
    """Make the observer x^' = A x^ + B u + L (y - C x^ - D u) of a linear flow.

    The gains are numbers, parameters ``L_<state>`` (``L_<state>_<measured>`` if several signals
    are measured), placed for the block's own parameter values. A and B stay the block's equations.

    Args:
        block: a linear flow.
        poles: wanted eigenvalues of A - L C in 1/s, one per state.
        measured: outputs or states that are measured; by default all outputs.
        gains: printed gains in place of poles, by the names above.
        slowest: least decay in 1/s that the poles must have.
        check: False lets a slow or unstable observer through, to show that it fails.

    Returns:
        A flow. Inputs: those of the block, and ``<signal>_measured`` for each measured signal.
        Outputs: ``<state>_hat`` for each state. ``choices["poles"]`` holds the poles.

    Raises:
        BadInput: not a linear flow, unknown names, a state that the measurement cannot show, poles
            that are not one per state or no conjugate pairs, slow or unstable poles. The message
            gives the pole.
    """
    where = f"luenberger({block.name})"
    seen = _signals_seen(where, block, measured)
    _refuse_nonlinear(where, block, seen)
    A, C = _matrices(block, seen)
    names = [[f"L_{x}_{y}" if seen[1:] else f"L_{x}" for y in seen] for x in block.states]
    if (poles is None) == (gains is None):
        raise BadInput(f"{where}: give either poles= or gains=")
    if poles is not None:
        L = _placed(where, block, A, C, list(poles))
        found = np.array(poles, dtype=complex)  # computed again, a double pole splits by rounding
    else:
        L = _given(where, names, gains or {})
        found = np.linalg.eigvals(A - L @ C)
    if check:
        check_poles(where, found, slowest, "poles" if gains is None else "gains")

    signal = {n: block.states.get(n) or block.outputs[n] for n in seen}
    states = list(block.states)
    params = [
        Param(_ratio(block.states[x].unit, signal[y].unit), float(L[i, j]), f"gain of {y} on {x}'",
              lo=-1e12, hi=1e12)
        .named(names[i][j]) for i, x in enumerate(states) for j, y in enumerate(seen)
    ]  # fmt: skip

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        own = {k: u[k] for k in block.inputs}
        rates, y = block.expr(x, own, {k: p[k] for k in block.params})
        error = {n: u[f"{n}_measured"] - (x[n] if n in x else y[n]) for n in seen}
        for i, s in enumerate(states):
            rates[s] = rates[s] + sum(p[names[i][j]] * error[n] for j, n in enumerate(seen))
        return rates, {f"{s}_hat": x[s] for s in states}

    poles_text = ", ".join(pole_text(z) for z in sorted(found, key=lambda z: (-z.real, z.imag)))
    return make_block(
        f"{block.name}_observer", "flow", body,
        states=[State(s.unit, s.value, f"estimate: {s.doc}", positive=s.positive).named(n)
                for n, s in block.states.items()],
        inputs=[*block.inputs.values(),
                *(Input(s.unit, f"measured: {s.doc}", positive=s.positive, per=s.per)
                  .named(f"{n}_measured") for n, s in signal.items())],
        params=[*block.params.values(), *params],
        outputs=[Output(s.unit, f"estimate: {s.doc}", positive=s.positive).named(f"{n}_hat")
                 for n, s in block.states.items()],
        sx=block.sx, doc=f"Luenberger observer of {block.name}, poles {poles_text} 1/s.",
        choices={"poles": poles_text, "measured": ", ".join(seen)},
    )  # fmt: skip


def _signals_seen(where: str, block: Block, measured: str | Sequence[str] | None) -> list[str]:
    """Signals that an observer of a flow measures."""
    if block.kind != "flow" or not block.states:
        raise BadInput(f"{where}: only a flow with states has an observer")
    if any(s.shape != () for s in block.signals):
        raise BadInput(f"{where}: states, inputs and outputs must be scalars")
    seen = [measured] if isinstance(measured, str) else list(measured or block.outputs)
    check_all_known(f"{where} has no signal", seen, [*block.outputs, *block.states])
    if len(set(seen)) < len(seen):
        raise BadInput(f"{where}: measured names a signal twice; leave out one")
    if not seen:
        raise BadInput(f"{where}: give measured=, states or outputs of {block.name}")
    return seen


def _ratio(of: str, per: str) -> str:
    return str(unit(f"({of}) / (({per}) s)"))


def _refuse_nonlinear(where: str, block: Block, seen: list[str]) -> None:
    """Refuse a block one of whose slopes in states and inputs depends on states or inputs."""
    x, u, p = (block.symbols(role) for role in ("state", "input", "param"))
    n, y = block.expr(x, u, p)
    sym = ca.vertcat(*x.values(), *u.values())
    for name, value in (*n.items(), *((k, y[k]) for k in seen if k in y)):
        slopes = ca.jacobian(value, sym)
        if slopes.nnz() and any(ca.which_depends(slopes, sym, 1, True)):
            raise BadInput(
                f"{where}: the equation of {name} is not linear; an extended filter,"
                " ekf(...), takes it"
            )


def _matrices(block: Block, seen: list[str]) -> tuple[np.ndarray, np.ndarray]:
    zero = dict.fromkeys((*block.states, *block.inputs), 0.0)
    A, _, C, *_ = matrices(block, zero, None, seen)
    return A, C


def _placed(
    where: str, block: Block, A: np.ndarray, C: np.ndarray, poles: list[complex]
) -> np.ndarray:  # fmt: skip
    """Gains for the poles: Ackermann's formula for one measured signal, else ``control.place``."""
    if len(poles) != len(A):
        raise BadInput(
            f"{where}: {len(poles)} poles for {len(A)} states ({', '.join(block.states)});"
            " give one each"
        )
    wanted = np.array(poles, dtype=complex)
    if not np.allclose(np.sort_complex(wanted), np.sort_complex(wanted.conj())):
        raise BadInput(f"{where}: complex poles must come in conjugate pairs")
    seen = _observability(A, C)
    if np.linalg.matrix_rank(seen) < len(A):
        raise BadInput(
            f"{where}: the measured signals do not show all of {', '.join(block.states)}"
        )
    real = wanted.real if not wanted.imag.any() else wanted
    if len(C) == 1:
        return _ackermann(A, seen, real)
    import control

    try:
        found = control.place(A.T, C.T, real)
    except ValueError as error:
        raise BadInput(
            f"{where}: these poles cannot be placed ({error}); make them differ"
        ) from None
    return np.atleast_2d(np.asarray(found)).T


def _observability(A: np.ndarray, C: np.ndarray) -> np.ndarray:
    """C, C A, C A^2 and so on, one below the other."""
    rows = [C]
    for _ in range(1, len(A)):
        rows.append(rows[-1] @ A)
    return np.vstack(rows)


def _ackermann(A: np.ndarray, seen: np.ndarray, poles: np.ndarray) -> np.ndarray:
    """Gains by Ackermann's formula, p(A) times the last column of the inverse of ``seen``.

    The operations are those of ``control.acker``, which takes most of a second to load.
    """
    p = np.real(np.poly(poles))
    wanted = sum(c * np.linalg.matrix_power(A.T, k) for k, c in enumerate(p[::-1]))
    return np.linalg.solve(seen.T, wanted)[-1:, :].T


def _given(where: str, names: list[list[str]], gains: Mapping[str, float]) -> np.ndarray:
    wanted = [n for row in names for n in row]
    check_all_known(f"{where} has no gain", gains, wanted)
    missing = [n for n in wanted if n not in gains]
    if missing:
        raise BadInput(f"{where}: give the gain {missing[0]} too")
    return np.array([[float(gains[n]) for n in row] for row in names])
