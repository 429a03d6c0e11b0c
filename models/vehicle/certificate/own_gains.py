"""A slip law of one's own, asked as a reaching law: its slopes and its rest from its equations.

With T = u(v_s, v_best, v, F, D) the axle has s' = (r/J) u - D. In the tube about v_best that is

    s' = -g1 e + d,   e = v_s - v_best

where g1 is the mean of the slopes -(r/J) du/dv_s, which are enclosed over the tube. So d holds what
the slopes differ by, times the tube, what (r/J) u is off D at e = 0, and what no law knows. The
part that the law itself makes comes behind the lag of the actuator, which makes it no larger.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from slipctl import BadInput, Block, Input, Output, Param, connect, law
from slipctl.analysis.bounds import enclosure, largest_slope, slope_function
from slipctl.certify.arithmetic.enclosure import largest
from slipctl.models.common_form import ADDED
from slipctl.models.vehicle.control import slip_law, wheel
from slipctl.models.vehicle.parts import OwnLaw, Trip

COARSE = 0.01
"""Share by which a bound may be too large."""

LEAST = 1e-6
"""Share of d that the constant reaching of the system has; a law of one's own has none."""

Range = tuple[float, float]


@dataclass(frozen=True)
class Tube:
    """A rail condition, with the ranges of the ensemble.

    Attributes:
        goal: slips that a law goes to, in m/s. slips: that its axle may have. falls: D there.
    """

    goal: Range
    slips: Range
    falls: Range


@dataclass(frozen=True)
class Withstood:
    """What a slip law meets while each axle is in its tube, on rails that do not change.

    Attributes:
        steady, wrong: |d| in m/s^2, whatever the law knows, and what is wrong of its D.
        slope: |d'| over |s'|, in 1/s. drift: rest of |d'| in m/s^3.
        tube: farthest from the reference, in m/s. motion: acceleration of the vehicle in m/s^2.
        tubes: of each rail condition.
    """

    steady: float
    wrong: float
    slope: float
    drift: float
    tube: float
    motion: float
    tubes: tuple[Tube, ...]

    @property
    def largest(self) -> float:
        """|d| in m/s^2 of a law that asks for D as it is told."""
        return self.steady + self.wrong


@law(
    D_told=Output("m/s^2", "what the law is told of D", positive="braking"),
    F_told=Output("N", "adhesion force that it is told", positive="braking"),
)
def telling(
    D=Input("m/s^2", "what the slip falls by", positive="braking"),
    wrong=Input("m/s^2", "what is wrong of it"),
    J=Param("kg m^2", 110.0, "inertia at the wheel", ADDED, lo=0.1, hi=1e5),
    r=Param("m", 0.42, "wheel radius", ADDED, lo=0.2, hi=1),
    m=Param("kg", 10e3, "mass of the vehicle per wheel", ADDED, lo=100, hi=1e8),
):
    """D and F = D/(r^2/J + 1/m), as a law is told them."""
    return dict(D_told=D + wrong, F_told=(D + wrong) / (r**2 / J + 1 / m))


@law(rises=Output("m/s^2", "rate of the slip", positive="braking"))
def rising(
    T=Input("N m", "torque at the wheel", positive="braking"),
    D=Input("m/s^2", "what the slip falls by", positive="braking"),
    J=Param("kg m^2", 110.0, "inertia at the wheel", ADDED, lo=0.1, hi=1e5),
    r=Param("m", 0.42, "wheel radius", ADDED, lo=0.2, hi=1),
):
    """Rate of the slip, (r/J) T - D."""
    return r / J * T - D


def why_not(trip: Trip, part: OwnLaw) -> str:
    """Why a law of one's own has no certificate; empty where it has one."""
    block, _ = slip_law(trip, part, wheel(trip, part.reference))
    if block.states:
        return (
            f"it keeps {', '.join(block.states)} from tick to tick, and only a law without states"
            " is asked about by its slopes; declare its tick as a System, see docs/certify.md"
        )
    heard = [n for n in ("T", "T_top") if n in block.inputs]
    if heard:
        return f"it hears {' and '.join(heard)}, so its slope by v_s alone says nothing"
    if "v_s" not in block.inputs:
        return "it does not hear v_s"
    return ""


def as_reaching(
    trip: Trip, part: OwnLaw, loop: Block, met: Withstood, speed: float
) -> dict[str, float]:
    """Numbers of ``reaching_law`` that hold for a law of one's own in its tubes.

    Args:
        trip, part: the trip and its controller. loop: its loop, whose numbers count.
        met: what every law meets. speed: of the vehicle in m/s.

    Raises:
        BadInput: the law jumps in a tube, or has an operation that cannot be enclosed.
    """
    block, _ = slip_law(trip, part, wheel(trip, part.reference))
    now = loop.values_by_place()
    own = {n: float(np.max(now[f"ctl.law.{n}"])) for n, s in block.params.items()
           if f"ctl.law.{n}" in now and not s.derived}  # fmt: skip
    numbers = {k: float(np.max(now[f"ctl.fall.{k}"])) for k in ("J", "r", "m")}
    whole = _closed(block.with_params(**own), numbers)
    slopes, rest = [], 0.0
    for tube in met.tubes:
        at = {"v_s": tube.goal, "v_best": tube.goal, "v": (speed, speed)}
        box = {"D": tube.falls, "wrong": (-met.wrong, met.wrong)}
        for goal in {*tube.goal}:
            given = {k: speed if k == "v" else goal for k in at if k in whole.inputs}
            low, high = enclosure(whole, "rises", _wide(box), COARSE, **given)
            rest = max(rest, -low, high)
            steep = {"v_s": tube.slips, **_wide(box)}
            given.pop("v_s")
            largest_slope(whole, "rises", "v_s", steep, coarse=1.0, **given)  # refuses a jump
            slopes += _slopes(whole, steep, given)
    least, most = -max(slopes), -min(slopes)
    g1 = max((least + most) / 2, 0.0)
    bend = max(most - g1, g1 - least) * met.tube
    d = met.steady + rest + bend
    return {"g1": g1, "g2": LEAST * d, "D": d * (1 + LEAST), "T": loop.period, "band": met.tube}


def _closed(block: Block, numbers: dict[str, float]) -> Block:
    """Rate of the slip of an axle under the law, from slip, D and what is wrong of D."""
    ports = {"D": "told.D_told", "F": "told.F_told"}
    wires = {"told.D": "D", "told.wrong": "wrong", "rising.T": "law.T_wanted", "rising.D": "D",
             "rises": "rising.rises"}  # fmt: skip
    wires |= {f"law.{n}": ports.get(n, n) for n in block.inputs}
    here = {k: v for k, v in numbers.items() if k != "m"}
    return connect("axle", wires, told=telling.with_params(**numbers), law=block,
                   rising=rising.with_params(**here))  # fmt: skip


def _wide(box: dict[str, Range]) -> dict[str, Range]:
    """The same box, its ranges not empty."""
    return {k: (a, b) if a < b else (a - 1e-9, b + 1e-9) for k, (a, b) in box.items()}


def _slopes(whole: Block, box: dict[str, Range], at: dict[str, float]) -> list[float]:
    """Least and largest slope of s' by the slip over a box."""
    f = slope_function(whole, "rises", "v_s", list(box), at)
    low, high = (np.array([r[k] for r in box.values()]) for k in (0, 1))
    x = ca.SX.sym("x", len(box))
    gap = COARSE * max(float(np.abs(np.array(f((low + high) / 2))).max()), 1e-9)
    bounds = [largest(ca.Function("signed", [x], [sign * f(x)]), low, high, gap).bound
              for sign in (-1, 1)]  # fmt: skip
    if not np.isfinite(bounds).all():
        raise BadInput(f"{whole.name}: nothing bounds the slope of the law in the tube")
    return [-bounds[0], bounds[1]]
