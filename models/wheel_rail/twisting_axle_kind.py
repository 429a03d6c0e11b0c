"""The stability condition of a wheelset that twists: a system that can be certified.

Two equal wheels J on an axle k of the damping ratio z, each loaded by N, mean slip speed s held:

    J p'' + 2 d p' + r N (f(s + r p'/2) - f(s - r p'/2)) + 2 k p = 0,    d = z sqrt(2 k J)

See :mod:`slipctl.models.wheel_rail.torsion`, whose block this is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from slipctl.certify.registry import register
from slipctl.certify.systems import (
    EXACT,
    TARGET,
    Criterion,
    Number,
    Numbers,
    Quantity,
    Side,
    System,
    Target,
    Witness,
)


def _damped(n: Numbers) -> Sequence[Side]:
    """Damping takes more than adhesion that falls can give.

    Proof note: V = J p'^2/2 + k p^2 changes at the rate -2 d p'^2 - r N p' (f(s + r p'/2) -
    f(s - r p'/2)). Adhesion falls by at most q per m/s. So for p' > 0 the difference of f is at
    least -q r p', and V' <= -(2 d - q N r^2) p'^2. The same holds for p' < 0. Where the bracket is
    above zero V falls but at p' = 0, where only p = 0 stays (LaSalle). Both sides of q N r^2 < 2 d
    are squared, so that no root is left. If it is false, take a curve that falls by q around s: a
    small twist there is linear, and does not die out. So the condition is exact.
    """
    drive = n["fall"] * n["N"] * n["r"] ** 2
    return [Side("(fall N r^2)^2 < 8 z^2 k J", drive**2, 8 * n["z"] ** 2 * n["k"] * n["J"])]


def _values(n: Numbers) -> dict[str, Quantity]:
    root = math.sqrt(2 * n["k"] * n["J"])
    return {
        "critical_fall": (2 * n["z"] * root / (n["N"] * n["r"] ** 2), "s/m"),
        "frequency": (math.sqrt(2 * n["k"] / n["J"]) / (2 * math.pi), "Hz"),
        "torque_for_each_m/s": (root / n["r"], "N s"),
    }


def _witness(n: Numbers) -> Witness:
    """Envelope of a small twist over a hundred turns, where the curve falls alike around s."""
    w = math.sqrt(2 * n["k"] / n["J"])
    grows = (n["fall"] * n["N"] * n["r"] ** 2 / n["J"] - 2 * n["z"] * w) / 2
    times = [2 * math.pi / w * k for k in range(101)]
    rows = [math.exp(min(grows * t, 600.0)) for t in times]
    return Witness(
        "none; a small twist at the start, where the curve falls alike around the slip",
        {"twist_over_that_at_the_start": (rows[-1], "1"), "run": (times[-1], "s")},
        {"t": ("s", times), "twist": ("1", rows)},
    )


TWISTING_AXLE = register(System(
    "twisting_axle",
    "J p'' + 2 d p' + r N (f(s + r p'/2) - f(s - r p'/2)) + 2 k p = 0: does the twist of a wheelset"
    " die out?",
    {
        "J": Number("kg m^2", "inertia of one wheel"),
        "k": Number("N m/rad", "stiffness of the axle between its wheels"),
        "z": Number("1", "damping ratio of the twist"),
        "N": Number("N", "load of a wheel"),
        "r": Number("m", "radius of the wheels"),
        "fall": Number("s/m", "most by which adhesion falls, over the slip speed", role=TARGET),
    },
    {
        "damped": Criterion(
            "damping takes more than falling adhesion gives (Lyapunov)", _damped, EXACT,
            ("smallest_z", "largest_fall", "largest_N"), proves=("dies_out",),
            refutes="none; a small twist at the start, where the curve falls alike around s",
        ),
    },
    {"dies_out": Target("the twist of the axle tends to zero on every curve whose adhesion falls by"
                        " at most {fall} at any slip", ("fall",))},
    never=("a mean slip that changes", "a rotor behind a shaft", "a controller in the loop"),
    values=_values,
    witness=_witness,
    panel=({"J": 150.0, "k": 7.526e6, "z": 0.005, "N": 105e3, "r": 0.625, "fall": 0.01},),
))  # fmt: skip
