"""Slide protection behind the two valves of an air brake and a short axle, for a proof by cells.

The machine is the person's block as it is. Two coordinates make its holding visible to cells: f,
the slip of the filtered rim, and a, the acceleration that the machine sees. The slip is s = f - K a
with the filter's K, and a tick T later

    f+ = f - T a,    a+ = (1 - T/K) a - (s+ - s)/K.

While the rim runs up (a > 0, which lets the machine hold), f falls whatever the adhesion does.
While it does not, the machine vents and the pressure falls. A cell needs its edge at
a = 0 for that, and cells of pressure that are smaller than what a tick of venting takes.

Beyond the slip ``s_1`` adhesion takes from ``least`` to ``most`` in m/s^2, anew in each tick, and
less or nothing below it. The pressure is that which stands when all bits under way have acted; the
wheel feels one of those of the dead time before, whichever is worst. What the ramp of the refill
does is any opening of the supply.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from typing import Any

import casadi as ca

from slipctl import Block
from slipctl.certify.cells.mode_cells import ModeLoop, dyadic
from slipctl.certify.smooth.sums import NoProof
from slipctl.certify.ticks.tick_code import code_of_function
from slipctl.models.vehicle.air.pneumatics import ATMOSPHERE, CRITICAL, flow_factor
from slipctl.models.vehicle.certificate.slide_kind import ANY, HEIGHT, PUSH, SLIP, push_ranges
from slipctl.models.vehicle.parts import Air

STATES, MODES = ("f", "a", "p"), ("machine", "valves", "stays")
"""Filtered slip, acceleration and pressure; state of the machine, of the valves, and for how many
ticks they stay there."""

CELL_OF_SLIP, CELL_OF_ACCELERATION = 0.1, 1.0
"""Sizes of cells in m/s and m/s^2."""

UP, UP_TIMES, DOWN, DOWN_TIMES = 4.0, 16.0, 8.0, 2.0
"""Acceleration in m/s^2 from which the rim runs up, or slows down, in cells so many times wider.

Of the second the filter has to forget more than a cell in a tick, or none is ever left.
"""


CHORDS = (0.0, 0.3, 0.45, -math.log(CRITICAL))
"""Logarithms of pressures over that of the air, between which a flow is taken as a chord."""

SHARE = 0.88
"""Cell of the logarithm over what a tick of venting takes from it at the speed of sound."""


@dataclass(frozen=True)
class AirAxle:
    """Numbers of an axle behind an air brake.

    Attributes:
        lever: r/J in 1/(kg m). torque: at the full pressure, N m. T_f: filter of the rim, s.
        s_1: slip in m/s from which adhesion is at least ``least``. peak: what the slip falls by at
            the height 1 of the curve, m/s^2.
    """

    lever: float
    T_f: float
    s_1: float
    peak: float
    brake: Air


def air_loop(machine: Block, axle: AirAxle, n: Mapping[str, Any]) -> ModeLoop:
    """Loop of a machine behind its valves, of the numbers of a ``slide_loop``.

    Args:
        machine: from ``v``, ``v_s``, ``a_w`` and ``off`` to ``state``: 0 fill, 1 hold, 2 vent.
        axle: its numbers. n: numbers of the system.

    Raises:
        NoProof: what this tick does not take: noise, a filter faster than a tick.
    """
    T, K = float(n["T"]), axle.T_f
    if n["noise"]:
        raise NoProof("the noise of a wheel moves the rim's acceleration across 0 in each tick, and"
                      " a machine that holds by its sign is not asked with it")  # fmt: skip
    if K <= T:
        raise NoProof(f"the filter of the rim, {K:g} s, is no longer than a tick")
    f, x, p, at, valves, stays = states = [ca.SX.sym(k) for k in (*STATES, *MODES)]
    names = (HEIGHT, PUSH, *ANY)
    height, w, late, open_, rises, vents, less = pushes = [ca.SX.sym(k) for k in names]
    a = ca.fmax(ca.fmin(x, -DOWN + (x + DOWN) * DOWN_TIMES), UP + (x - UP) * UP_TIMES)
    slip = f - K * a
    then = _after(machine, at, {"v": float(n["v"]), "v_s": slip, "a_w": a, "off": 0.0})
    bits = ca.if_else(then > 1.5, 2, ca.if_else((then < 0.5) * open_ > 0.5, 0, 1))
    stand = ca.if_else(stays > 0.5, valves, bits)
    pulse = max(math.ceil(axle.brake.pulse / T - 1e-9) - 1, 0)
    wait = ca.if_else(stays > 0.5, stays - 1, ca.if_else(ca.eq(stand, valves), 0, pulse))
    p_next, torque = _pressure(axle.brake, n, p, stand, (late, rises, vents))
    fastest = float(n["most"]) * axle.peak + float(n["W"])
    full = ca.if_else(slip < axle.s_1 + T * fastest, less, 1)  # it may come below s_1 in the tick
    rate = axle.lever * torque + w - axle.peak * height * full
    a_next = ca.fmin(ca.fmin((1 - T / K) * a, (f - T * a) / K) - T / K * rate,
                     (f - T * a + axle.s_1) / K)  # fmt: skip
    x_next = ca.fmin(ca.fmax(a_next, -DOWN + (a_next + DOWN) / DOWN_TIMES),
                     UP + (a_next - UP) / UP_TIMES)  # fmt: skip
    y = ca.vertcat(f - T * a, x_next, p_next, then, stand, wait, slip)
    tick = ca.Function("tick", [ca.vertcat(*states, *pushes)], [y], {"cse": True})
    inputs = [*(f"x_{k}" for k in (*STATES, *MODES)), *(f"d_{k}" for k in names)]
    code = code_of_function(tick, inputs, (*STATES, *MODES, SLIP))
    up, down = _changes(axle.brake, T)
    sizes = tuple(map(dyadic, (CELL_OF_SLIP, CELL_OF_ACCELERATION, SHARE * down)))
    still, waits = (Fraction(0), Fraction(0)), up * math.ceil(float(n["dead"]) / T - 1e-9)
    begins = (
        still,
        still,
        (Fraction(0), Fraction(math.log1p(waits))),
    )  # valves at rest have filled
    ranges = {k: v for k, v in push_ranges(n).items() if k in names}
    return ModeLoop(code, STATES, MODES, begins, (0, 0, 0), ranges, STATES[:1],
                    kept={SLIP: None}, sizes=sizes)  # fmt: skip


def _after(machine: Block, at: Any, given: Mapping[str, Any]) -> Any:
    """Next state of the machine."""
    inputs = machine.pack("input", {k: ca.SX(x) for k, x in given.items() if k in machine.inputs})
    numbers = {k: ca.SX(float(x)) for k, x in machine.param_values().items()}
    y = machine.f.expand()(at, inputs, machine.pack("param", numbers))[1]
    return machine.unpack("output", y)["state"]


def _changes(brake: Air, T: float) -> tuple[float, float]:
    """What a tick adds at most to a pressure over that of the air, and takes from its logarithm."""
    fills, vents = brake.rates
    return T * fills * (brake.supply / ATMOSPHERE + 1), T * vents


def _pressure(
    brake: Air, n: Mapping[str, Any], p: Any, stand: Any, any_: tuple[Any, Any, Any]
) -> tuple[Any, Any]:
    """Logarithm of the pressure over that of the air a tick later, and a torque in the dead time.

    The flow to the air has the speed of sound above the critical ratio. Below it is concave in the
    logarithm, so it is at least what chords say.

    Args:
        brake: the brake. n: numbers. p: the logarithm. stand: of the valves, 0 fill to 2 vent.
        any_: from 0 to 1, where within its ends the torque, a fill and a vent are.
    """
    T = float(n["T"])
    late, rises, vents = any_
    up, down = _changes(brake, T)
    full = brake.pressure / ATMOSPHERE
    most = 1 + full * min(float(n["demand"]) / brake.torque, 1.0)
    pressure = ca.exp(p)
    filled = ca.fmax(ca.fmin(p + rises * up / pressure, math.log(most)), 0)
    later, slowest = p - down, ca.SX(1)
    for begin, end in pairwise(CHORDS):
        flows = [float(flow_factor(math.exp(-x))) if x else 0.0 for x in (begin, end)]
        slope = (flows[1] - flows[0]) / (end - begin)
        slowest = ca.fmin(slowest, flows[0] + slope * (later - begin))
    slowest = ca.fmax(slowest, 0)
    vented = ca.fmax(p - down * (slowest + (1 - slowest) * vents), 0)
    ticks = math.ceil(float(n["dead"]) / T - 1e-9) + 1
    high = ca.fmin(pressure * math.exp(down * ticks), most)
    low = ca.fmax(pressure - ticks * up, 1)
    torque = brake.torque / full * (low + late * (high - low) - 1)
    return ca.if_else(stand > 1.5, vented, ca.if_else(stand < 0.5, filled, p)), torque
