"""A trip as a closed loop in a scenario, ready to run: what its parts are put together to.

    plant -> sensors -> ctl (an axle's slip control, as often as there are axles) -> plant
                demand ----^

Every number stands once: mass, radius, inertia, gravity, largest torque and lag, sample time, the
speed at the start. What controllers and sensors hold of them follows the vehicle.
"""

from __future__ import annotations

import bisect
from collections.abc import Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import cached_property, partial
from typing import Any

import numpy as np
from casadi import fabs, if_else

from slipctl import (
    Block,
    Case,
    End,
    Input,
    Known,
    Output,
    Param,
    Rail,
    Scenario,
    Section,
    State,
    argmax,
    connect,
    flip_sign,
    law,
    make_block,
    mirror,
    replicate,
    step,
)
from slipctl.block.units.unit_algebra import unit
from slipctl.errors import BadInput, Faults
from slipctl.models.common_form import ADDED, T_S
from slipctl.models.vehicle.adhesion import contaminated_law, rail_law
from slipctl.models.vehicle.books import known_of_trip
from slipctl.models.vehicle.contamination import best_under_axles, field_of_rail
from slipctl.models.vehicle.control import vehicle_control
from slipctl.models.vehicle.measurement.sensor_parts import (
    at_one_radius,
    vehicle_speed,
    wheel_speeds,
    with_faults,
)
from slipctl.models.vehicle.parts import (
    STANDSTILL,
    TICK,
    Air,
    Constant,
    Controller,
    Lag,
    Most,
    Profile,
    ToothWheel,
    Trip,
    number_with_unit,
)
from slipctl.models.vehicle.plant import plant
from slipctl.models.wheel_rail.rail_memory import EVERYWHERE
from slipctl.run.results import Loops

STOPPED, STANDS = 0.02, 0.5
"""Speed in m/s of a vehicle that stands, and how long in s it does before the run ends."""

# ---- rail ----------------------------------------------------------------------------------------


def rail(trip: Trip) -> Rail:
    """Rail of the trip: conditions and gradient, each from where it begins."""
    track = trip.rail
    if not track.placed:
        return Rail([Section(s.time or 0.0, s.condition) for s in track.sections])
    slopes = track.gradient if isinstance(track.gradient, tuple) else ()
    starts = sorted({s.place or 0.0 for s in track.sections} | {s.place for s in slopes})
    at = [s.place or 0.0 for s in track.sections]
    rises = [s.place for s in slopes]
    found = []
    for x in starts:
        condition = track.sections[bisect.bisect_right(at, x) - 1].condition
        values = {"slope": slopes[bisect.bisect_right(rises, x) - 1].gradient} if slopes else {}
        found.append(Section(x, condition, values))
    return Rail(found, by="plant.train.x")


# ---- demand --------------------------------------------------------------------------------------


def demand(trip: Trip) -> Block:
    """Make the demand: from time, speed and place to the torque of each axle.

    A deceleration a is the torque of a wheel that rolls, r m a + J a/r with the mass m per axle,
    on level track and without resistance.
    """
    part, axles = trip.demand, len(trip.vehicle.worked)
    if isinstance(part, Constant):
        part = part.as_table()
    clock = State("s", 0.0, "time since the start")
    v = Input("m/s", "measured vehicle speed")
    x = Input("m", "place of the first axle")
    T_max = Param("N m", trip.actuator.torque, "largest torque", ADDED, lo=1)
    T_ = Param("s", T_S, "sample period", ADDED, lo=1e-6, hi=0.1)
    r = Param("m", trip.vehicle.wheel_radius, "wheel radius", ADDED, lo=0.2, hi=1)
    J = Param("kg m^2", trip.vehicle.wheel_inertia, "inertia of a wheelset", ADDED, lo=0.1, hi=1e5)
    m = Param("kg", trip.vehicle.total, "vehicle", ADDED, lo=100, hi=1e8)
    torque = Output("N m", "torque that is demanded of each axle", positive="braking")
    if isinstance(part, Most):

        @law(T_demand=torque, name="demand")
        def most(v=v, x=x, T_max=T_max):
            """As much as the actuator gives: what is applied is up to slip control."""
            return T_max

        return most
    force = part.force is not None
    unit = "N" if force else "m/s^2"
    given = part.force if force else part.deceleration
    given = part.acceleration if given is None else given
    table = isinstance(part, Profile)
    k = len(given) if table else 1
    values = np.array(given if table else [given], dtype=float)
    at = np.array(part.at if table else [0.0], dtype=float)
    over = part.over if table else "time"
    on = {"time": "s", "speed": "m/s", "position": "m"}[over]

    @step(
        T_demand=torque, wanted=Output(unit, "what is demanded"), name="demand",
        choices={"over": over, "points": k},
    )  # fmt: skip
    def wanted(
        t=clock, v=v, x=x, m=m, r=r, J=J, T=T_,
        level=Param(unit, values if table else float(values[0]), "demand", "of the trip",
                    shape=(k,) if table else ()),
        at=Param(on, at if table else 0.0, "where each begins", "of the trip",
                 shape=(k,) if table else ()),
    ):  # fmt: skip
        """Demand at this time, speed or place, as torque of an axle."""
        now = level if not table else level[0]
        where = {"time": t, "speed": fabs(v), "position": x}[over]
        for j in range(1, k):
            if over == "speed":
                share = (where - at[j - 1]) / (at[j] - at[j - 1])
                line = level[j - 1] + share * (level[j] - level[j - 1])
                now = if_else(where >= at[j], level[j], if_else(where >= at[j - 1], line, now))
            else:
                now = if_else(where >= at[j], level[j], now)
        torque_ = r * now / axles if force else r * m / axles * now + J * now / r
        return dict(t=t + T), dict(T_demand=torque_, wanted=now)

    return wanted


# ---- the loop ------------------------------------------------------------------------------------


class Common:
    """What all loops of a trip have in common, each part made once."""

    def __init__(self, trip: Trip) -> None:
        self.trip = trip

    @cached_property
    def plant(self) -> Block:
        """Vehicle on its rail."""
        law = contaminated_law(self.trip, rail_law(self.trip))
        return plant(self.trip.vehicle, self.trip.actuator, law, field_of_rail(self.trip))

    @cached_property
    def demand(self) -> Block:
        """What is wanted."""
        return demand(self.trip)

    @cached_property
    def slip(self) -> Block:
        """True slip of each axle that has an actuator, seen as that of a braked one."""
        vehicle = self.trip.vehicle
        driven = vehicle.mode == "drive"
        seen = (
            mirror("m/s", "braking", "speed")
            if driven
            else flip_sign("m/s", "braking", "slip speed")
        )
        every = replicate(seen, vehicle.axles)
        return every if len(vehicle.worked) == vehicle.axles else of_some(every, vehicle.worked)


def of_some(every: Block, axles: Sequence[int]) -> Block:
    """Make a law whose output ``y`` is that of some axles only, counted from 0.

    Args:
        every: law from ``u`` to ``y`` of all axles.
        axles: which.
    """
    (y,) = every.outputs.values()

    def body(x: Any, u: Any, p: Any) -> Any:
        return {}, {"y": every.expr({}, u, p)[1]["y"][list(axles)]}

    return make_block(
        every.name, "law", body, inputs=list(every.inputs.values()),
        outputs=[replace(y, shape=(len(axles),))], sx=every.sx, choices={"axles": tuple(axles)},
        doc=f"Of the axles {', '.join(str(k + 1) for k in axles)}.",
    )  # fmt: skip


def loop(trip: Trip, controller: Controller | str, common: Common | None = None) -> Block:
    """Closed loop of a trip with one of its controllers.

    Args:
        trip: the trip.
        controller: a controller, or the name of one of the trip's.
        common: parts that other loops of this trip have too; None makes them.

    Returns:
        Step with the parts ``plant``, ``demand``, ``ctl``, ``slip`` and the sensors ``angle``,
        ``wheel``, ``speed``. ``slip`` is the true one of axles with actuators, seen as braked.
    """
    part = trip.controllers[controller] if isinstance(controller, str) else controller
    common = common or Common(trip)
    ctl = vehicle_control(trip, part)
    parts: dict[str, Block] = {
        "plant": common.plant,
        "demand": common.demand,
        "ctl": ctl,
        "slip": common.slip,
    }
    wires = {
        "demand.x": "plant.train.x",
        "ctl.T_demand": "demand.T_demand",
        "slip.u": "plant.train.v_s",
    }
    if isinstance(trip.actuator, Air):
        wires |= {"plant.hold": "ctl.hold", "plant.vent": "ctl.vent",
                  "plant.T_demand": "demand.T_demand"}  # fmt: skip
    else:
        wires["plant.T_cmd"] = "ctl.T_cmd"
    if "omega" in ctl.inputs:
        read = with_faults(trip, parts, wheel_speeds(trip, parts))
        measured = at_one_radius(trip, parts, read)
        wires |= {"ctl.T": "plant.T"} | measured
        v = vehicle_speed(trip, parts, wires)
        wires |= {"ctl.v": v}
    else:
        v = "plant.train.v"
    wires["demand.v"] = v
    return connect("loop", wires, share=_shares(trip, parts), **parts)


def _loop_of(trip: Trip, name: str, common: Common) -> Block:
    """Closed loop with a controller of the trip; what is refused says which it is.

    Raises:
        BadInput: a number that no part of the loop takes.
    """
    try:
        return loop(trip, name, common)
    except Faults:
        raise
    except BadInput as error:
        raise BadInput(f"controllers.{name}: {error}") from None


def _shares(trip: Trip, parts: Mapping[str, Block]) -> dict[str, Any]:
    """Numbers that the parts have in common; those of one wheel follow the vehicle."""
    names = [
        f"{b}.{n}" for b, block in parts.items() for n, s in block.params.items() if not s.derived
    ]
    axles, worked = trip.vehicle.axles, len(trip.vehicle.worked)

    def places(*patterns: str) -> list[str]:
        hits = [n for p in patterns for n in names if fnmatchcase(n, p)]
        return [n for n in dict.fromkeys(hits) if not n.startswith("ctl.estimator.")]

    air = isinstance(trip.actuator, Air)
    apart = "r" in parts["plant"].params or len(set(trip.vehicle.radii)) > 1
    held = ["speed.filter.held_v"] if "accel" in parts else []
    tooth = ["wheel.T"] * isinstance(trip.sensors.wheel_speed, ToothWheel)
    late = trip.control.period != TICK
    slow = places(*tooth) if late else []
    same_J = len(set(trip.vehicle.inertias)) == 1
    shared: dict[str, list[str]] = {
        "m": places("plant.m", "demand.m", "speed.m"),
        f"m_axle = m / {axles}": places("plant.train.m_axle", "*.m_axle"),
        f"m_wheel = m / {worked}": places("ctl.m"),
        "J": [n for n in places("plant.train.J", "*.J") if same_J or n != "plant.train.J"],
        **_radii(trip, apart, places),
        "g": places("plant.g", "*.g"),
        "T": [n for n in places("*.T", "*.T_s") if n not in slow],
        "T_ctl": slow,
        "slope": places("plant.grade.slope", "accel.slope"),
    }
    if isinstance(trip.actuator, Lag):
        shared["T_max"] = places("plant.act.T_max", "*.T_max")
        shared["tau"] = places("plant.act.tau", "*.tau")
    else:
        shared["T_max"] = places("*.T_max")
        for n in ("p_full", "k_f", "k_v"):  # what the controllers know of the brake follows it
            shared[n] = places(f"plant.act.cylinder.{n}", f"ctl.*.{n}")
        shared["pulse"] = places("plant.act.valves.pulse", "ctl.*.pulse")
        shared["p_s"] = places("plant.air.p_s", "ctl.*.p_s")
        shared["tau"] = [n for n in places("*.tau") if n != "ctl.trust.tau" or not air]
    shared["v_start"] = ["plant.train.v", *places("*.v_start", "speed.u_start"), *held]
    turn = "-1 * " if trip.vehicle.mode == "drive" else ""
    begins = places(
        "angle.omega_start", "wheel.omega_start", "wheel.u_start", "ctl.trust.omega_start"
    )
    shared["omega_start = v_start / r"] = [n for n in begins if not _shaped(parts, n)]
    shared[f"omega_seen = {turn}v_start / r"] = places("ctl.meter.omega_start")

    def alike(hits: list[str]) -> list[str]:
        """Places in the unit of the first one: another one is a number of a law of one's own."""
        heads = [n.partition(".") for n in hits]
        units = [{**parts[b].states, **parts[b].params}[n].unit for b, _, n in heads]
        return [n for n, u in zip(hits, units, strict=True) if unit(u).same(unit(units[0]))]

    found: dict[str, Any] = {k: alike(v) for k, v in shared.items() if v}
    if "r" not in found:
        found = {k.replace("v_start / r", f"v_start / {trip.vehicle.wheel_radius!r}"): v
                 for k, v in found.items()}  # fmt: skip
    return found


def _shaped(parts: Mapping[str, Block], place: str) -> bool:
    """Whether each axle has its own number at a place."""
    part, _, name = place.partition(".")
    return bool(parts[part].params[name].shape)


def _radii(trip: Trip, apart: bool, places: Any) -> dict[str, list[str]]:
    """Radii that are one number: those of the rail and the demand, and those that are believed."""
    known = places("ctl*.r", "speed.r", "radius.r")
    if trip.control.radius is None:
        return {"r": [*known, *places("demand.r")] if apart else places("plant.train.r", "*.r")}
    return {
        "r_known": known,
        "r": places("demand.r") if apart else places("plant.train.r", "demand.r"),
    }


# ---- scenario and case ---------------------------------------------------------------------------


def scenario(trip: Trip, name: str = "trip") -> Scenario:
    """Scenario of a trip."""
    gradient = trip.rail.gradient
    level = isinstance(gradient, tuple) or not gradient
    unbraked = {"plant.train.T_b": 0.0} if trip.vehicle.mode == "drive" else {}
    return Scenario(
        name, trip.duration, rail(trip), seed=trip.seed, noise=trip.noise, doc=trip.title,
        params={} if level else {"slope": gradient}, end=end(trip), inputs=unbraked,
    )  # fmt: skip


def end(trip: Trip) -> End | None:
    """What ends the run before its duration."""
    if trip.end == STANDSTILL:
        return End("plant.train.v", below=STOPPED, hold=STANDS, returns=True)
    found = number_with_unit(trip.end, "m") if trip.end else None
    return End("plant.train.x", above=found[0]) if isinstance(found, tuple) else None


def best(block: Block, condition: str) -> tuple[float, float]:
    """Best slip of a rail condition, speed or ratio as the law has it, and adhesion there."""
    slip, height = "lam" if "lam" in block.inputs else "v_s", "mu"
    at = dict(block.conditions[condition])
    if "v" in block.inputs:
        at["v"] = 10.0
    if block.inputs[slip].positive != block.outputs["mu"].positive:
        from slipctl.models.zhang_2021.hst_braking import grip

        block, height = grip(block), "grip"
    found = argmax(block, slip, height, lo=1e-3, hi=0.9 if slip == "lam" else 10.0, at=at)
    return found.location, abs(found.value)


def best_of_rail(trip: Trip) -> dict[str, Known]:
    """Best slip and adhesion of the rail under each axle, for the log; slip where it works."""
    block = rail_law(trip)
    if trip.rail.contamination is not None or "v" in block.inputs:
        return best_under_axles(trip, block, rail(trip))
    found = [best(block, s.condition or "") for s in rail(trip).sections]
    behind = trip.vehicle.behind
    worked = tuple(behind[k] for k in trip.vehicle.worked)
    peak = Known("1", [b for _, b in found], "peak of the rail", behind)
    if "lam" in block.inputs:
        return {"rail.best_adhesion": peak}
    place = Known("m/s", [a for a, _ in found], "best slip, as the rail has it", worked)
    return {"rail.best_slip": place, "rail.best_adhesion": peak}


CLEAN = "clean"
"""Scenario in which a contaminated rail is clean, which the extension of a stop is told by."""


def clean_case(trip: Trip, contaminated: Case) -> Case:
    """The same loops where the rail has no layer: their places are beyond every train.

    Args:
        trip: the trip. contaminated: its case, whose loops are taken as they are.
    """
    field = field_of_rail(trip)
    assert field is not None  # only a contaminated rail has a clean one beside it
    nowhere = np.full(field.params["start"].shape, EVERYWHERE)
    old = contaminated.scenario
    params = {**old.params, "plant.field.start": nowhere}
    clean = old.but(name=CLEAN, params=params, doc=f"{trip.title}: without its layer")
    return replace(contaminated, scenario=clean)


def case(trip: Trip, name: str = "trip") -> Case:
    """The trip with each of its controllers."""
    common = Common(trip)
    loops = Loops({k: partial(_loop_of, trip, k, common) for k in trip.controllers})
    return Case(scenario(trip, name), loops, best_of_rail(trip) | known_of_trip(trip))
