"""Super-twisting in proper implicit steps, the form with the least error that sampling allows."""

from __future__ import annotations

import math
from collections.abc import Sequence

from slipctl.certify.promise import (
    EXACT,
    INPUT,
    SAMPLED,
    TARGET,
    Criterion,
    Number,
    Numbers,
    Side,
    System,
    Target,
    Witness,
    number_text,
)
from slipctl.certify.registry import register


def _slides(n: Numbers) -> Sequence[Side]:
    """Sliding goes on, within the band.

    Proof note: a tick takes x to y + T k1 root(y) + T^2 k2 xi = x, xi in Sgn(y). With w the
    integral and the matched disturbance x+ = y + T w - T^2 k2 xi, w+ = w - T k2 xi + T d. Where
    |x| <= T^2 k2, y = 0 and T^2 k2 xi = x: x+ = T w - x, and at the next such tick x++ = T w+ - x+
    = T^2 d. So |x| <= T^2 L from the second tick on, and L <= k2 keeps it so.
    """
    size = n["L"] * n["T"] ** 2
    sides = [Side("L <= k2", n["L"], n["k2"])]
    return [*sides, Side("L T^2 <= band", size, n["band"])] if "band" in n else sides


def _reached(n: Numbers) -> Sequence[Side]:
    return [Side("L T^2 <= band", n["L"] * n["T"] ** 2, n["band"])]


def _witness(n: Numbers) -> Witness:
    """Run of the form from rest against phi' = L."""
    T, k1, k2 = n["T"], n["k1"], n["k2"]
    x = v = phi = 0.0
    rows = [x]
    for _ in range(40):
        outside = max(0.0, abs(x) - T * T * k2)
        root = (math.sqrt((T * k1) ** 2 + 4 * outside) - T * k1) / 2
        xi = max(-1.0, min(1.0, x / (T * T * k2)))
        v -= T * k2 * xi
        x += T * (v - k1 * math.copysign(root, x) - T * k2 * xi + phi)
        phi += T * n["L"]
        rows.append(x)
    return Witness(
        "the constant phi' = L, from rest", {"|x1|_at_the_end": (abs(rows[-1]), "m/s")},
        {"t": ("s", [T * i for i in range(len(rows))]), "x1": ("m/s", rows)},
    )  # fmt: skip


IMPLICIT_TWISTING = register(System(
    "super_twisting_implicit",
    "x1' = u + phi, |phi'| <= L, u by super-twisting in proper implicit steps: how large is x1"
    " while it slides?",
    {
        "k1": Number("m^.5/s^1.5", "gain of the root", power=0.5),
        "k2": Number("m/s^3", "gain of the integral", power=1.0),
        "L": Number("m/s^3", "bound of the disturbance's slope", power=1.0, role=INPUT,
                    says="every |phi'| <= {}"),
        "T": Number("s", "sample period", role=INPUT, says="proper implicit steps of {}"),
        "band": Number("m/s", "wanted |x1| at every tick", optional=True, power=1.0, role=TARGET),
    },
    {
        "slides": Criterion("sliding goes on, and |x1| <= L T^2", _slides, proves=("ends", "band"),
                            covers=("L", "T")),
        "reached": Criterion("L T^2 is reached", _reached, EXACT, ("smallest_band", "largest_T"),
                             needs=("band",), proves=("band",), covers=(),
                             refuted_under=("L", "T"), refutes="the constant phi' = L"),
    },
    {
        "ends": Target(lambda n, entry: "|x1| stays below "
                       f"{number_text(n['L'] * n['T'] ** 2, 'm/s')} at every tick",
                       unless=("band",)),
        "band": Target("|x1| stays below {band} at every tick", ("band",)),
    },
    start="the third tick on, where |x1| <= k2 T^2 at two ticks in a row",
    never=("the way to these two ticks", "a lag of the actuator", "measurement noise",
           "a limit of the command"),
    witness=_witness,
    panel=({"k1": 1.5, "k2": 1.1, "L": 1.0, "T": 0.01, "band": 2e-4},),
    time=lambda n: SAMPLED,
))  # fmt: skip
