"""Poles of observers: what is refused."""

from __future__ import annotations

from collections.abc import Iterable

from slipctl.errors import BadInput


def check_poles(
    where: str, poles: Iterable[complex], slowest: float = 1.0, what: str = "poles"
) -> None:  # fmt: skip
    """Refuse an observer whose error grows, or dies out too slowly.

    Args:
        where: name for the message. poles: eigenvalues of A - L C in 1/s.
        slowest: least decay in 1/s that they must have. what: what was given, for the message.

    Raises:
        BadInput: with the worst pole and the one that would pass.
    """
    worst = max((complex(z) for z in poles), key=lambda z: z.real)
    if worst.real >= 0:
        raise BadInput(
            f"{where}: these {what} give the pole {pole_text(worst)} 1/s, which is unstable;"
            f" poles at {-max(slowest, 1.0):g} 1/s or to the left would pass"
        )
    if -worst.real < slowest * (1 - 1e-9):
        raise BadInput(
            f"{where}: these {what} give the pole {pole_text(worst)} 1/s, slower than"
            f" slowest={slowest:g} 1/s; poles at {-slowest:g} 1/s or to the left would pass"
        )


def pole_text(z: complex) -> str:
    """Pole in four digits, real where it is."""
    z = complex(z)
    size = max(abs(z), 1e-300)
    return f"{z.real:.4g}" if abs(z.imag) < 1e-6 * size else f"{z.real:.4g}{z.imag:+.4g}j"
