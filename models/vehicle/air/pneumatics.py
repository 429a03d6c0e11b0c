"""Air brake of an axle: two magnet valves, a cylinder behind its chokes, the vehicle's reservoir.

Each bit is one magnet: ``hold`` shuts the supply of the cylinder off, ``vent`` opens it to the air.
Without both the cylinder follows the pressure that the demand asks for, as behind a relay valve.
So what fails without current brakes by the demand, and no controller brakes by more than that.

The air is isothermal, pressures are absolute. A choke of diameter d lets pass, towards a volume V,

    dp/dt = k p_0 psi(p/p_0),   k = C (pi d^2/4) s R sqrt(T)/V,   s = sqrt(1.4/R) 1.2^-3

from the pressure p_0 before it to p behind it. psi is 1 up to the critical ratio .528, where the
air has the speed of sound in the choke. It falls to 0 at 1 (St. Venant and Wantzel). The torque is
proportional to the gauge pressure.
"""

from __future__ import annotations

import math
from typing import Any

from casadi import floor, fmax, fmin, if_else, logic_and, logic_not, sqrt, sum1, vertcat

from slipctl import Block, Input, Output, Param, State, law, one, step
from slipctl.models.common_form import ADDED, T_S

ATMOSPHERE = 1.013e5
"""Pressure of the air outside in Pa, absolute."""

KAPPA, R_AIR = 1.4, 287.0
"""Ratio of the specific heats of air, and its gas constant in J/(kg K)."""

CRITICAL = (2 / (KAPPA + 1)) ** (KAPPA / (KAPPA - 1))
"""Ratio of pressures at which the flow through a choke has the speed of sound."""

_SONIC = math.sqrt(KAPPA / R_AIR) * (2 / (KAPPA + 1)) ** ((KAPPA + 1) / (2 * (KAPPA - 1)))
_SHAPE = ((KAPPA + 1) / 2) ** ((KAPPA + 1) / (2 * (KAPPA - 1)))

SUPPLY = 5e5
"""Usual gauge pressure in Pa behind the pressure regulator of a brake."""

# numbers that the cylinder and what a controller knows of it have alike
T_MAX = Param("N m", 8e3, "torque at the full pressure", ADDED, lo=1, hi=1e8)
P_FULL = Param("Pa", 3.8e5, "full pressure, gauge", ADDED, lo=1e3, hi=2e6)
P_SUPPLY = Param("Pa", SUPPLY, "pressure of the supply, gauge", ADDED, lo=1e3, hi=2e6)
K_FILL = Param("1/s", 0.44, "rate of the choke that fills", ADDED, lo=1e-3, hi=1e3)
K_VENT = Param("1/s", 1.75, "rate of the choke that vents", ADDED, lo=1e-3, hi=1e3)


def rate_of_choke(diameter: float, volume: float, C: float = 0.7, warm: float = 293.0) -> float:
    """Rate k in 1/s at which air from p_0 on changes a pressure, dp/dt = k p_0, through a choke.

    Args:
        diameter: of the choke in m. volume: behind or before it in m^3.
        C: discharge coefficient. warm: temperature of the air in K.
    """
    area = math.pi * diameter**2 / 4
    return C * area * _SONIC * R_AIR * math.sqrt(warm) / volume


def flow_factor(ratio: Any) -> Any:
    """Flow through a choke over that at the speed of sound, by the ratio of the pressures."""
    b = fmin(fmax(ratio, CRITICAL), 1)
    root = b ** (1 / KAPPA)  # falls = sqrt(b^(2/kappa) - b^(1 + 1/kappa))
    falls = sqrt(fmax(root * (root - b), 1e-16))
    return if_else(ratio <= CRITICAL, 1, _SHAPE * sqrt(2 / (KAPPA - 1)) * falls)


PACKED = 24
"""Ticks of two bits that a number of 53 bits holds exactly."""


def magnet_valves(ticks: int) -> Block:
    """Make the two magnet valves of an axle: dead time, then a smallest pulse.

    Args:
        ticks: dead time from a bit to the flow of air, in ticks; may be 0.
    """
    sizes = [min(PACKED, ticks - k) for k in range(0, ticks, PACKED)] or [1]

    @step(
        hold=Output("1", "1 while the supply is shut off", lo=0, hi=1),
        vent=Output("1", "1 while it is open to the air", lo=0, hi=1),
        switched=Output("1", "changes of both valves so far", lo=0),
        name="valves", choices={"ticks": ticks},
    )  # fmt: skip
    def valves(
        under_way=State("1", 0.0, "hold + 2 vent of each tick, base 4, the oldest least",
                        shape=(len(sizes),)),
        held=State("1", 0.0, "1 while the supply is shut off", lo=0, hi=1),
        vented=State("1", 0.0, "1 while it is open to the air", lo=0, hi=1),
        age=State("s", 1.0, "time since the last change", lo=0, hi=1),
        count=State("1", 0.0, "changes so far", lo=0, hi=1e9),
        hold=Input("1", "bit of the valve that shuts the supply off", lo=0, hi=1),
        vent=Input("1", "bit of the valve that vents", lo=0, hi=1),
        pulse=Param("s", 0.0, "shortest time that they stay where they are", ADDED, lo=0, hi=1),
        T=Param("s", T_S, "sample period", ADDED, lo=1e-6, hi=0.1),
    ):  # fmt: skip
        """The bits of a dead time ago, where the valves have stood long enough to move."""
        bits = if_else(hold > 0.5, 1, 0) + if_else(vent > 0.5, 2, 0)
        acts, waits = bits, []
        for k, size in reversed(list(enumerate(sizes))):  # a digit leaves, the next one comes
            last = under_way[k] - 4 * floor(under_way[k] / 4)
            waits.append((under_way[k] - last) / 4 + acts * 4 ** (size - 1))
            acts = last
        acts = acts if ticks else bits
        vents = if_else(acts > 1.5, 1, 0)
        asked = (acts - 2 * vents, vents)
        moves = age + 0.5 * T >= pulse
        a, b = (if_else(moves, x, y) for x, y in zip(asked, (held, vented), strict=True))
        changes = fmax(a - held, held - a) + fmax(b - vented, vented - b)
        nxt = dict(
            under_way=vertcat(*reversed(waits)),
            held=a, vented=b, age=if_else(changes > 0, T, fmin(age + T, 1)), count=count + changes,
        )  # fmt: skip
        return nxt, dict(hold=a, vent=b, switched=count + changes)

    return valves


@step(
    T_b=Output("N m", "brake torque", positive="braking"),
    pressure=Output("Pa", "cylinder pressure, gauge", lo=0, hi=1e7),
    drawn=Output("m^3", "free air that it takes from the supply in this tick", lo=0),
)
def cylinder(
    p=State("Pa", ATMOSPHERE, "cylinder pressure, absolute", lo=ATMOSPHERE, hi=1e7),
    hold=Input("1", "1 while the supply is shut off"),
    vent=Input("1", "1 while it is open to the air"),
    T_demand=Input("N m", "torque that is demanded of the axle", positive="braking"),
    supply=Input("Pa", "pressure of the supply, absolute", value=SUPPLY + ATMOSPHERE),
    k_f=K_FILL,
    k_v=K_VENT,
    V=Param("m^3", 4e-3, "volume of the cylinder", ADDED, lo=1e-5, hi=1),
    T_max=T_MAX,
    p_full=P_FULL,
    weighed=Param("1", 1.0, "mass by the load weighing over the true one", ADDED, lo=0.05, hi=20),
    T=Param("s", T_S, "sample period", ADDED, lo=1e-6, hi=0.1),
):  # fmt: skip
    """Fills towards the pressure of the demand, holds, or vents; midpoint rule.

    What is above the demand leaves by the exhaust of the relay valve, through a choke as wide as
    the one that vents.
    """
    top, open_ = ATMOSPHERE, logic_not(hold > 0.5)
    goal = top + fmin(fmax(weighed * T_demand, 0) / T_max, 1) * p_full
    fills = logic_and(open_, p < goal)
    leaves = logic_and(open_, p > goal)

    def rate(at: Any) -> Any:
        inward = k_f * supply * flow_factor(at / supply)
        outward = k_v * at * flow_factor(top / at)
        return if_else(fills, inward, 0), if_else(vent > 0.5, outward, if_else(leaves, outward, 0))

    def after(rates: Any, time: Any) -> Any:
        there = fmax(p + time * (rates[0] - rates[1]), top)
        there = if_else(fills, fmin(there, goal), there)
        return if_else(logic_and(leaves, vent <= 0.5), fmax(there, goal), there)

    middle = rate(after(rate(p), T / 2))
    nxt = after(middle, T)
    # what flows in is what the pressure rises by, and what the vent takes besides
    came = fmax(if_else(fills, nxt - p + T * middle[1], 0), 0)
    k_b = T_max / p_full
    drawn = V * came / (ATMOSPHERE * one("Pa"))
    return dict(p=nxt), dict(T_b=k_b * (p - top), pressure=p - top, drawn=drawn)


def reservoir(axles: int) -> Block:
    """Make the air that a vehicle has: one reservoir for all cylinders, behind a regulator.

    Args:
        axles: how many cylinders draw from it.
    """

    @step(
        supply=Output("Pa", "pressure behind the regulator, absolute"),
        left=Output("Pa", "pressure of the reservoir, gauge"),
        used=Output("m^3", "free air that all cylinders have taken"),
        name="air", choices={"axles": axles},
    )  # fmt: skip
    def air(
        p_r=State("Pa", f"p_start + {ATMOSPHERE}", "pressure of it, absolute", lo=0, hi=1e8),
        taken=State("m^3", 0.0, "free air that all cylinders have taken", lo=0, hi=1e6),
        drawn=Input("m^3", "free air that each cylinder takes in a tick", shape=(axles,)),
        p_s=Param("Pa", SUPPLY, "pressure behind the regulator, gauge", ADDED, lo=1e3, hi=2e6),
        p_start=Param("Pa", SUPPLY, "pressure of the reservoir at the start, gauge", ADDED, lo=1e3,
                      hi=2e6),
        V_r=Param("m^3", 1e6, "volume of the reservoir", ADDED, lo=1e-3, hi=1e7),
        charge=Param("m^3/s", 0.0, "free air by the compressor", ADDED, lo=0, hi=1),
        T=Param("s", T_S, "sample period", ADDED, lo=1e-6, hi=0.1),
    ):  # fmt: skip
        """V_r dp_r/dt = p_0 (charge - drawn); the compressor stops at the pressure of the start."""
        all_ = sum1(drawn)
        full = p_start + ATMOSPHERE
        next_ = fmin(p_r + ATMOSPHERE * (T * charge - all_) / V_r, full)
        nxt = dict(p_r=fmax(next_, ATMOSPHERE), taken=taken + all_)
        supply = fmin(p_r, p_s + ATMOSPHERE)
        return nxt, dict(supply=supply, left=p_r - ATMOSPHERE, used=taken)

    return air


# ---- what a controller knows of it ---------------------------------------------------------------


def brake_model(ticks: int) -> Block:
    """Make what a controller expects of its brake: the torque by the bits that it has given.

    Args:
        ticks: dead time of the valves, in ticks of the controller, rounded up; may be 0.
    """
    size = max(ticks, 1)

    @step(
        expected=Output(
            "N m", "torque that the bits explain", positive="braking", lo=0, hi="T_max"
        ),
        name="model", choices={"ticks": ticks},
    )  # fmt: skip
    def model(
        T_h=State("N m", 0.0, "torque that the bits explain", positive="braking", lo=0, hi="T_max"),
        changes=State("N m", 0.0, "changes under way, oldest first", shape=(size,),
                      lo="-T_max", hi="T_max"),
        under_way=State("N m", 0.0, "their sum", lo="-T_max", hi="T_max"),
        hold=Input("1", "bit of the valve that shuts the supply off"),
        vent=Input("1", "bit of the valve that vents"),
        T_b=Input("N m", "torque, from the pressure sensor", positive="braking"),
        T_demand=Input("N m", "torque that is demanded", positive="braking"),
        T_max=T_MAX,
        p_full=P_FULL,
        p_s=P_SUPPLY,
        k_f=K_FILL,
        k_v=K_VENT,
        corrects=Param("1/s", 2.0, "rate at which it follows the sensor", ADDED, lo=0, hi=100),
        T=Param("s", T_S, "sample period", ADDED, lo=1e-6, hi=0.1),
    ):  # fmt: skip
        """The cylinder's equations, held to the sensor slowly enough that a stuck valve shows."""
        now = fmin(fmax(T_b + under_way, 0), T_max)
        up, down = changes_by_valves(now, T_max, p_full, p_s, k_f, k_v, T)
        top = fmin(fmax(T_demand, 0), T_max)
        open_ = if_else(now < top, fmin(up, top - now), -fmin(down, now - top))
        change = if_else(hold > 0.5, 0, open_)
        change = if_else(vent > 0.5, -fmin(down, now), change)
        acts = changes[0] if ticks else change
        there = T_h + acts + fmin(corrects * T, 1) * (T_b - T_h)
        waiting = vertcat(changes[1:], change) if size > 1 else change
        if not ticks:
            waiting = 0 * change
        nxt = dict(T_h=fmin(fmax(there, 0), T_max), changes=waiting,
                   under_way=fmin(fmax(sum1(waiting), -T_max), T_max))  # fmt: skip
        return nxt, dict(expected=T_h)

    return model


def changes_by_valves(
    now: Any, T_max: Any, p_full: Any, p_s: Any, k_f: Any, k_v: Any, T: Any
) -> tuple[Any, Any]:
    """What a tick of filling adds to a torque, and what a tick of venting takes from it."""
    k_b = T_max / p_full
    p, supply = ATMOSPHERE + now / k_b, p_s + ATMOSPHERE
    up = k_b * T * k_f * supply * flow_factor(p / supply)
    return up, k_b * T * k_v * p * flow_factor(ATMOSPHERE / p)


@law(
    hold=Output("1", "bit of the valve that shuts the supply off", lo=0, hi=1),
    vent=Output("1", "bit of the valve that vents", lo=0, hi=1),
)
def valve_bits(
    T_cmd=Input("N m", "commanded torque, at most the demand", positive="braking"),
    T_demand=Input("N m", "torque that is demanded", positive="braking"),
    T_b=Input("N m", "torque, from the pressure sensor", positive="braking"),
    under_way=Input("N m", "change by the bits within the dead time", positive="braking"),
    T_max=T_MAX,
    p_full=P_FULL,
    p_s=P_SUPPLY,
    k_f=K_FILL,
    k_v=K_VENT,
    band=Param("Pa", 5e3, "error of the pressure that it holds at", ADDED, lo=0, hi=1e5),
    pulse=Param("s", 0.0, "shortest time that the valves stay", ADDED, lo=0, hi=1),
    T=Param("s", T_S, "sample period", ADDED, lo=1e-6, hi=0.1),
):  # fmt: skip
    """Bits that lead to a torque: the one that is there once all bits under way have acted.

    It fills or vents where the torque is off by more than half of what the shortest pulse changes.
    """
    now = T_b + under_way
    up, down = changes_by_valves(
        fmin(fmax(now, 0), T_max), T_max, p_full, p_s, k_f, k_v, fmax(pulse, T)
    )
    least = band * T_max / p_full
    all_ = T_cmd >= fmin(T_demand, T_max) - 1e-3 * T_max
    vents = now - T_cmd > fmax(down / 2, least)
    fills = T_cmd - now > fmax(up / 2, least)
    vent = if_else(all_, 0, if_else(vents, 1, 0))
    return dict(hold=fmax(vent, if_else(all_, 0, if_else(fills, 0, 1))), vent=vent)
