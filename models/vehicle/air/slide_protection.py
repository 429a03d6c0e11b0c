"""Wheel slide protection as brake suppliers build it: a state machine over slip and deceleration.

    v, omega -> slip, rim acceleration -> fill, hold or vent -> refill -> two valve bits

Each axle has its own machine. A wheel that falls behind the vehicle, or that slows down faster than
a vehicle can, is vented until it runs up. The pressure is held until the slip is small, and filled
again in steps, so that the deceleration rises no faster than a ramp. In ``fill`` without a ramp the
cylinder follows the demand.

The threshold of the slip has a part that does not fall with the speed. So it needs no division by
a small speed. Numbers of thresholds and ramp: those that are told of Decelostat E-5, read at a
source of low reliability; the rest are a proposal, to be tuned.
"""

from __future__ import annotations

from casadi import fmax, fmin, if_else, logic_and, logic_or

from slipctl import Block, Input, Output, Param, State, law, state_machine, step
from slipctl.models.common_form import ADDED, T_S
from slipctl.models.vehicle.air.pneumatics import (
    K_FILL,
    K_VENT,
    P_FULL,
    P_SUPPLY,
    T_MAX,
    changes_by_valves,
)
from slipctl.models.vehicle.measurement.axle_samples import NEVER

STATES = ("fill", "hold", "vent")
"""States of the machine; its output is the place of one in this list."""

TOLD = "Decelostat E-5, of a source of low reliability"
PROPOSED = "a proposal; slipctl tune finds better ones"


@step(a_w=Output("m/s^2", "acceleration of the rim, filtered", lo=-1e5, hi=1e5))
def rim_acceleration(
    w_f=State("m/s", "v_start", "rim speed, filtered", lo=-1e3, hi=1e3),
    rim=Input("m/s", "believed speed of the rim"),
    T_f=Param("s", 0.04, "time constant of the filter", PROPOSED, lo=1e-3, hi=1),
    T=Param("s", T_S, "sample period", ADDED, lo=1e-6, hi=0.1),
    v_start=Param("m/s", 20.0, "vehicle speed at the start", ADDED, lo=0, hi=200),
):
    """Derivative of the rim speed behind a filter of first order."""
    moved = (rim - w_f) * fmin(T / T_f, 1)
    return dict(w_f=w_f + moved), dict(a_w=moved / T)


def slide_machine() -> Block:
    """Make the machine of one axle: from slip and rim acceleration to fill, hold or vent.

    Where no condition holds the state stays. It vents until the wheel runs up, whatever the slip
    is then, and does not vent a wheel that runs up. A wheel that rolls with a vehicle which slows
    down does not run up: it is filled again, or one wrong sample would release it for good.
    """
    slides = "(a_w < -a_vent or v_s > dv_0 + dv_v*v)"
    return state_machine(
        "machine", STATES,
        [
            ("*", "fill", "off > .5"),
            ("fill", "vent", slides),
            ("vent", "hold", "a_w > 0*a_vent"),
            ("vent", "fill", "v_s < s_fill*(dv_0 + dv_v*v) and a_w > -a_vent/2"),
            ("hold", "vent", f"{slides} and a_w <= 0*a_vent"),
            ("fill", "hold", "v_s > s_hold*(dv_0 + dv_v*v) and a_w < -a_hold"),
            ("hold", "fill", "v_s < s_fill*(dv_0 + dv_v*v) and a_w <= a_fill"),
        ],
        doc="Slide protection of one axle by thresholds of slip and rim deceleration.",
        v=Input("m/s", "vehicle speed that is believed"),
        v_s=Input("m/s", "slip speed", positive="braking", per="speed"),
        a_w=Input("m/s^2", "acceleration of the rim, filtered"),
        off=Input("1", "1 where slide protection cannot be relied on, or is off"),
        dv_0=Param("m/s", 1.341, "slip from which it vents, at standstill", TOLD, lo=0.05, hi=20),
        dv_v=Param("1", 0.09167, "share of the speed by which that is more", TOLD, lo=0, hi=0.5),
        a_vent=Param("m/s^2", 3.58, "rim deceleration from which it vents", TOLD, lo=0.5, hi=50),
        s_hold=Param("1", 0.5, "share of that slip from which it holds", PROPOSED, lo=0, hi=1),
        a_hold=Param("m/s^2", 1.0, "rim deceleration from which it holds", PROPOSED, lo=0, hi=50),
        s_fill=Param("1", 0.3, "share of that slip below which it fills", PROPOSED, lo=0, hi=1),
        a_fill=Param("m/s^2", 0.5, "rim acceleration up to which it does", PROPOSED, lo=-10, hi=50),
    )  # fmt: skip


@law(off=Output("1", "1 where slide protection cannot be relied on, or is off", lo=0, hi=1))
def protection_off(
    v=Input("m/s", "vehicle speed that is believed"),
    ready=Input("1", "1 where slip control can go by the samples"),
    v_off=Param("m/s", 5 / 3.6, "speed below which it is off", ADDED, lo=0, hi=200),
):
    """Off below the cut-off speed, and where an axle's own samples are not believed."""
    return logic_or(v < v_off, ready < 0.5)


@step(
    hold=Output("1", "bit of the valve that shuts the supply off", lo=0, hi=1),
    vent=Output("1", "bit of the valve that vents", lo=0, hi=1),
)
def refill(
    top=State("N m", "T_max", "torque up to which it fills", positive="braking", lo=0, hi="T_max"),
    state=Input("1", "state of the machine: 0 fill, 1 hold, 2 vent"),
    T_b=Input("N m", "torque, from the pressure sensor", positive="braking"),
    under_way=Input("N m", "change by the bits within the dead time", positive="braking"),
    T_demand=Input("N m", "torque that is demanded", positive="braking"),
    ramp=Param("m/s^3", 0.67, "largest rise of the deceleration", TOLD, lo=0.01, hi=1e3),
    m_axle=Param("kg", 8000.0, "load on the rail", ADDED, lo=100, hi=1e8),
    r=Param("m", 0.42, "wheel radius", ADDED, lo=0.2, hi=1),
    T_max=T_MAX,
    p_full=P_FULL,
    p_s=P_SUPPLY,
    k_f=K_FILL,
    k_v=K_VENT,
    pulse=Param("s", 0.0, "shortest time that the valves stay", ADDED, lo=0, hi=1),
    T=Param("s", T_S, "sample period", ADDED, lo=1e-6, hi=0.1),
):  # fmt: skip
    """Bits by the state. Filling begins at the torque that is there, and pulses along the ramp."""
    fills, vents = state < 0.5, state > 1.5
    now = fmin(fmax(T_b + under_way, 0), T_max)
    demand = fmin(fmax(T_demand, 0), T_max)
    rises = top + ramp * m_axle * r * T
    along = if_else(fills, fmin(rises, T_max), fmin(now, T_max))
    up, _ = changes_by_valves(now, T_max, p_full, p_s, k_f, k_v, fmax(pulse, T))
    waits = logic_and(along < demand, along - now < up / 2)
    hold = if_else(fills, if_else(waits, 1, 0), 1)
    return dict(top=along), dict(hold=hold, vent=if_else(vents, 1, 0))


@step(
    hold=Output("1", "bit of the valve that shuts the supply off", lo=0, hi=1),
    vent=Output("1", "bit of the valve that vents", lo=0, hi=1),
    released=Output("1", "1 while the limit of a release gives the demand", lo=0, hi=1),
)
def watchdog(
    let_go=State("s", 0.0, "time of release without a break", lo=0, hi="limit"),
    back=State("s", 0.0, "time for which the demand is given after it", lo=0, hi=10),
    hold_by=Input("1", "bit of the valve that shuts the supply off, by slide protection"),
    vent_by=Input("1", "bit of the valve that vents, by slide protection"),
    off=Input("1", "1 where slide protection cannot be relied on, or is off"),
    stands=Input("1", "1 where a wheel that is let go does not run up"),
    retry=Input("1", "1 while the train gets the demand after a long release"),
    T_b=Input("N m", "torque, from the pressure sensor", positive="braking"),
    T_demand=Input("N m", "torque that is demanded", positive="braking"),
    T_max=T_MAX,
    limit=Param("s", 10.0, "longest release", ADDED, lo=0.1, hi=900),
    limit_still=Param("s", 3.0, "longest release of a wheel that does not run up", ADDED,
                      lo=0.1, hi=900),
    again=Param("s", 1.0, "time of the demand after it", ADDED, lo=0.01, hi=10),
    T=Param("s", T_S, "sample period", ADDED, lo=1e-6, hi=0.1),
):  # fmt: skip
    """Without current, and so by the demand, where an axle is released for too long; then again.

    A release is a vent, or a hold with less than a tenth of the demand.
    """
    top = fmin(fmax(T_demand, 0), T_max)
    given = logic_or(back > 0, retry > 0.5)
    rests = logic_or(off > 0.5, given)
    hold, vent = if_else(rests, 0, hold_by), if_else(rests, 0, vent_by)
    lets = logic_or(vent > 0.5, logic_and(hold > 0.5, T_b < 0.1 * top))
    time = if_else(lets, fmin(let_go + T, NEVER), 0)
    over = time >= if_else(stands > 0.5, fmin(limit, limit_still), limit)
    left = if_else(over, again, fmax(back - T, 0))
    return dict(let_go=if_else(over, 0, fmin(time, limit)), back=left), dict(
        hold=hold, vent=vent, released=given
    )
