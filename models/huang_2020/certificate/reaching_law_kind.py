"""The reaching law, sampled, behind a lag."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from slipctl.certify.arithmetic.decimal_intervals import Interval
from slipctl.certify.registry import register
from slipctl.certify.systems import (
    EXACT,
    INPUT,
    SAMPLED,
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
from slipctl.models.huang_2020.certificate import reaching_law, relay_proof


def _drives(n: Numbers) -> Sequence[Side]:
    return [Side("D < g2", n["D"], n["g2"])]


def _sampled(n: Numbers) -> Sequence[Side]:
    if n["lag"] == 0:
        return [Side("T g1 < 2", n["T"] * n["g1"], 2)]
    entries: Any
    if isinstance(n["T"], Fraction):
        left = Interval.of(-n["T"] / n["lag"], 60).exp()
        taken = 1 - left
        reach = taken * n["lag"]
        held = n["T"] - reach
        entries = 1 - held * n["g1"], reach, -(taken * n["g1"]), left
    else:
        entries, _, _ = reaching_law.tick(*(float(n[k]) for k in ("g1", "g2", "T", "lag")))
    a, b, c, d = entries
    det, trace = a * d - b * c, a + d
    ends = [Side("det M < 1", det, 1), Side("0 < 1 + trace M + det M", 0, trace + det + 1)]
    return ends if n["g1"] else ends[1:]


def _band(n: Numbers) -> Sequence[Side]:
    """Without a lag."""
    T, g1 = n["T"], n["g1"]
    sides = [Side("T g1 < 2", T * g1, 2)]
    if g1 == 0:
        sides.append(Side("D < g2", n["D"], n["g2"]))
    if n["lag"]:
        return [Side("lag <= 0", n["lag"], 0)]
    if "band" in n and all(s.holds() for s in sides):
        largest = relay_proof.no_lag_band(g1, n["g2"], T, n["D"])
        sides.append(Side("largest |s| in the end <= band", largest, n["band"]))
    return sides


def _orbit(n: Numbers) -> tuple[int, float]:
    return reaching_law.orbit(float(n["g1"]), float(n["g2"]), float(n["T"]), float(n["lag"]))


def _reaching_values(n: Numbers) -> dict[str, Quantity]:
    ticks, swing = _orbit(n)
    found = {"symmetric_orbit": (swing, "m/s"), "its_half_period": (ticks * n["T"], "s")}
    command = 2 * (n["g1"] * swing + n["g2"])
    return found | {"command_peak_to_peak": (command, "m/s^2")}


def _reaching_witness(n: Numbers) -> Witness:
    """Run of the sampled law against a constant d = D from s = 1 m/s."""
    (a, b, c, d), b1, b2 = reaching_law.tick(n["g1"], n["g2"], n["T"], n["lag"])
    s, x, rows = 1.0, 0.0, [1.0]
    for _ in range(400):
        side = math.copysign(1.0, s)
        s, x = a * s + b * x - b1 * side + n["T"] * n["D"], c * s + d * x - b2 * side
        rows.append(s)
        if abs(s) > 1e6:
            break
    t = [n["T"] * k for k in range(len(rows))]
    last = max(abs(v) for v in rows[-20:])
    return Witness(
        f"s' disturbed by the constant D = {n['D']:g} m/s^2, from s = 1 m/s, a = 0",
        {"|s|_after_the_run": (last, "m/s"), "run": (t[-1], "s")},
        {"t": ("s", t), "s": ("m/s", rows)},
    )


REACHING_LAW = register(System(
    "reaching_law",
    "Huang 2020 (23), sampled: s' = u + d, u = -g1 s - g2 sgn s held over T, behind a lag; is s ->"
    " band?",
    {
        "g1": Number("1/s", "proportional reaching", low="not negative"),
        "g2": Number("m/s^2", "constant reaching", power=1.0),
        "T": Number("s", "sample period", role=INPUT, says="a command held over T = {}"),
        "lag": Number("s", "time constant of the actuator", 0.0, "not negative", role=INPUT,
                      says="a lag of {}", absent="a lag of the actuator"),
        "D": Number("m/s^2", "largest |d|", 0.0, "not negative", 1.0, role=INPUT,
                    says="every |d| <= {}", absent="a disturbance d"),
        "band": Number("m/s", "wanted |s| in the end", power=1.0, optional=True, role=TARGET),
    },
    {
        "drives": Criterion("continuous: s = 0 is reached against every |d| <= D", _drives, EXACT,
                            ("largest_D", "smallest_g2")),
        "sampled": Criterion("sampled: large errors die out", _sampled, EXACT,
                             ("largest_g1", "largest_T"), proves=("ends", "band"),
                             refuted_under=("T", "lag", "D"), refutes="none; a large s"),
        "band": Criterion("sampled, no lag: the largest |s| that any d leads to in the end", _band,
                          EXACT, ("largest_T", "largest_D", "smallest_band"),
                          proves=("ends", "band"), covers=("T", "D"),
                          refutes="d = D or -D at every tick, see reaching_law.no_lag_band"),
        "polygon": Criterion("sampled, lag: a polygon that every run enters, then tick by tick",
                             proves=("ends", "band"), covers=("T", "D", "lag"),
                             evidence=relay_proof.POLYGON, step=relay_proof.polygon_step),
    },
    {
        "ends": Target(relay_proof.claim, unless=("band",)),
        "band": Target("|s| stays below {band} at every tick in the end", ("band",)),
    },
    refuters={"orbit": relay_proof.ORBIT},
    never=("measurement noise", "a limit of the command"),
    values=_reaching_values,
    witness=_reaching_witness,
    panel=({"g1": 36.0, "g2": 12.0, "T": 1e-3, "D": 5.0, "band": 0.01},
     {"g1": 5.0, "g2": 1.0, "T": 0.5, "D": 2.0, "band": 0.3}),
    time=lambda n: SAMPLED,
))  # fmt: skip
