"""The signed square root of the super-twisting law, on numbers and CasADi expressions."""

from __future__ import annotations

from typing import Any

import casadi as ca


def root(x: Any) -> Any:
    """Signed square root |x|^(1/2) sign x, as the super-twisting law has it.

    It is 0 at 0, where the slope is infinite and CasADi's derivative is NaN.
    """
    return ca.sqrt(ca.fabs(x)) * ca.sign(x)
