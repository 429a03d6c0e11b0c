"""Random numbers that are the same in Python and C, in double and in float.

Wichmann and Hill, Algorithm AS 183, Applied Statistics 31 (1982): three congruential generators
whose products stay below 2^24, so that every step is exact in single precision too. The state is
three numbers, kept as block state.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca

from slipctl.block.signals import Signal, State
from slipctl.errors import check_whole

FACTORS = (171, 172, 170)
MODULI = (30269, 30307, 30323)


def state_from_seed(seed: int) -> list[float]:
    """State from a seed, each part in 1..modulus-1.

    Raises:
        BadInput: a seed that is no whole number >= 0.
    """
    check_whole("seed", seed, 0)
    state, rest = [], int(seed)
    for modulus in MODULI:
        state.append(float(1 + rest % (modulus - 1)))
        rest = rest // (modulus - 1) + 7919 * (rest + 1)
    return state


def random_state(seed: int) -> Signal:
    """The generator as a state of a block, ``rng``."""
    start = state_from_seed(seed)
    return State("1", start, "random numbers, Wichmann-Hill", shape=(3,)).named("rng")


def advance(state: Any, whole: Callable[[Any], Any] = ca.floor) -> Any:
    """Next state of a 3 x 1 expression: each part times its factor, modulo its modulus.

    Multiplying by 1/modulus floors as dividing does. No product is a multiple of its modulus, which
    is prime, so the quotient is 1/30323 or more away from a whole number, beyond its rounding.

    Args:
        state: three numbers or expressions.
        whole: how to floor; see :func:`quick_floor`.
    """
    parts = []
    for k in range(3):
        product = FACTORS[k] * state[k]
        parts.append(product - MODULI[k] * whole(product * (1 / MODULI[k])))
    return ca.vertcat(*parts)


def uniform(state: Any) -> Any:
    """Number in [0, 1) of a state: the sum of its parts over their moduli, modulo 1."""
    total = sum(state[k] * (1 / MODULI[k]) for k in range(3))
    return total - ca.floor(total)


def whole_below(state: Any, k: int, n: int, whole: Callable[[Any], Any] = ca.floor) -> Any:
    """Whole number in 0..n-1 from part ``k`` of a state; n times the modulus is below 2^24."""
    return whole(state[k] * n * (1 / MODULI[k]))


def epsilon(one: Any) -> Any:
    """Spacing of floating-point numbers at 1, of double or of float, whichever computes it.

    The machine finds it by its own arithmetic, |3 (4/3 - 1) - 1|. ``one`` is a value that is 1 but
    that nobody knows beforehand, or the expression would be folded in double.
    """
    return ca.fabs(3 * (4 * one / 3 - one) - one)


def rounder() -> ca.Function:
    """Function (state) -> (K, K) for :func:`quick_floor`, with K = 1.5/eps, 1.5 times 2^52 or 2^23.

    Whole numbers are the spacing of floating-point numbers near K.
    """
    state = ca.SX.sym("state", 3)
    eps = epsilon(ca.fmin(state[0], 1))  # a part of a state is 1 or more
    return ca.Function("rounder", [state], [ca.vertcat(1.5 / eps, 3 / (eps + eps))])


def quick_floor(K: Any) -> Callable[[Any], Any]:
    """Floor of a number of size below 1/(4 eps) that is no whole number: (t - 1/2 + K) - K.

    Adding K rounds to a whole number. Compilers turn ``floor`` into a dozen instructions or a call
    where the processor has none of its own. Both elements of ``K`` have the same value; they must
    be two symbols, because CasADi would cancel one against itself.
    """
    return lambda t: ((t - 0.5) + K[0]) - K[1]
