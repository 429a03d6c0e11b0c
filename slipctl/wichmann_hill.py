"""Random numbers that are the same in Python and C, in double and in float.

Wichmann and Hill, Algorithm AS 183, Applied Statistics 31 (1982): three congruential generators
whose products stay below 2^24, so that every step is exact in single precision too. The state is
three numbers, kept as block state.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from slipctl.errors import BadInput

FACTORS = (171, 172, 170)
MODULI = (30269, 30307, 30323)


def seeded(seed: int) -> list[float]:
    """State from a seed, each part in 1..modulus-1.

    Raises:
        BadInput: a seed that is no whole number >= 0.
    """
    if seed != int(seed) or seed < 0:
        raise BadInput(f"seed = {seed} must be a whole number >= 0")
    state, rest = [], int(seed)
    for modulus in MODULI:
        state.append(float(1 + rest % (modulus - 1)))
        rest = rest // (modulus - 1) + 7919 * (rest + 1)
    return state


def advance(state: Any) -> Any:
    """Next state of a 3 x 1 expression: each part times its factor, modulo its modulus.

    Multiplying by 1/modulus floors as dividing does: no product is a multiple of its modulus, which
    is prime, so the quotient is 1/30323 or more away from a whole number, beyond its rounding.
    """
    parts = []
    for k in range(3):
        product = FACTORS[k] * state[k]
        parts.append(product - MODULI[k] * ca.floor(product * (1 / MODULI[k])))
    return ca.vertcat(*parts)


def uniform(state: Any) -> Any:
    """Number in [0, 1) of a state: the sum of its parts over their moduli, modulo 1."""
    total = sum(state[k] * (1 / MODULI[k]) for k in range(3))
    return total - ca.floor(total)


def below(state: Any, k: int, n: int) -> Any:
    """Whole number in 0..n-1 from part ``k`` of a state; n times the modulus is below 2^24."""
    return ca.floor(state[k] * n * (1 / MODULI[k]))
