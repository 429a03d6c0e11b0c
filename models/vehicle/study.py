"""A trip as a study: which signal is the speed or the slip, and the figures of its report."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

from slipctl.models.common_form import gains_of_law
from slipctl.models.vehicle.adhesion import without_unit
from slipctl.models.vehicle.contamination import patches_of_seed
from slipctl.models.vehicle.parts import (
    Air,
    Drawn,
    OwnLaw,
    Searched,
    SlideProtection,
    SlipLaw,
    Trip,
)
from slipctl.models.vehicle.parts.plausibility import unusual_numbers
from slipctl.models.vehicle.parts.without_effect import parts_without_effect
from slipctl.models.vehicle.trip import CLEAN, case, clean_case
from slipctl.run.roles import Signals
from slipctl.run.sweep.ensemble import Ensemble
from slipctl.study.declaration import Certificates, Figure, Study
from slipctl.study.files.declared_parts import Bare
from slipctl.study.resolve import load_block

SIGNALS = Signals(
    speed="plant.train.v", position="plant.train.x", slip="slip.y",
    reference="ctl.reference.v_best", best_slip="rail.best_slip",
    adhesion="plant.train.mu", best_adhesion="rail.best_adhesion", torque="plant.T",
    contact_power="plant.train.P_contact", wear_rate="contact.wear", flash="contact.flash",
    energy_error="books.error", mark="trip.mark",
)  # fmt: skip

LOG = (
    "plant.train.x", "plant.train.v", "plant.train.a", "plant.train.omega", "plant.train.mu",
    "slip.y", "plant.T", "plant.T_cmd", "demand.T_demand", "demand.wanted", "ctl.T_cmd",
    "ctl.watch.on", "ctl.probe.reference", "ctl.reference.v_best", "ctl.slip.v_s", "ctl.meter.mu_m",
    "ctl.curve.mu", "speed.y", "speed.v_m", "speed.error", "speed.sound", "radius.r_i",
    "radius.known", "wheel.y", "wheel.omega_m", "plant.field.recovered", "plant.field.height",
    "plant.field.W_seen", "plant.field.S_seen", "plant.field.sand", "plant.train.P_contact",
    "plant.train.E_kin", "plant.train.P_drive", "plant.train.P_brake",
    "plant.train.P_bearing", "plant.train.P_slip", "plant.train.P_d",
    "plant.pressure", "plant.act.hold", "plant.act.vent", "plant.act.switched", "plant.air.used",
    "plant.air.left", "ctl.hold", "ctl.vent",
)  # fmt: skip
"""Signals that a log keeps of every loop."""


BITS = "it acts by the bits of two valves; a certificate is made for a torque that follows a lag"
"""Why a controller of an air brake has no certificate."""


def _speeds(results: Any) -> Any:
    from slipctl.draw import plots

    return plots.speeds(results, "base", list(results.data["base"]))


def _slip(results: Any) -> Any:
    from slipctl.draw import plots

    braking = not results.study.signals.mirrored
    named = {"slip": "slip speed", "torque": f"{'brake' if braking else 'drive'} torque",
             "position": "distance"}  # fmt: skip
    return plots.traces(results, "base", signals=("slip", "torque", "position"), labels=named)


def signals_of_trip(trip: Trip) -> Signals:
    """Which signals of its logs play which role."""
    vehicle = trip.vehicle
    more: dict[str, Any] = {}
    if len(vehicle.worked) < vehicle.axles:
        more = {"axles": tuple(vehicle.worked)}
    if isinstance(trip.actuator, Air):
        more |= {"air_used": "plant.air.used", "valve_changes": "plant.act.switched",
                "pressure": "plant.act.pressure", "holding": "plant.act.valves.hold",
                "venting": "plant.act.valves.vent"}  # fmt: skip
        if trip.actuator.reservoir is not None:
            more["air_left"] = "plant.air.left"
    return replace(SIGNALS, mirrored=vehicle.mode == "drive", **more)


def numbers_without_unit(trip: Trip) -> Iterator[str]:
    """Parameters of laws whose unit the file leaves out, a line each: they are read in SI."""
    track, layer = trip.rail, trip.rail.contamination
    for name, values in track.conditions.items():
        yield from without_unit(load_block(track.law).params, values, f"rail.conditions.{name}")
    if layer is not None:
        curve = load_block(layer.law or track.law)
        yield from without_unit(curve.params, layer.numbers, "rail.contamination.numbers")
    for key in ("safe", "demand_lost"):
        if isinstance(value := getattr(trip.control, key), Bare):
            yield f"control.{key}: {value:g} has no unit; it is read as {value:g} N m"
    parts = {"": trip, **{f"controllers.{k}.": part for k, part in trip.controllers.items()}}
    for where, part in parts.items():
        sought = getattr(part, "reference", None)
        if isinstance(sought, Searched):
            curve = load_block(sought.law)
            yield from without_unit(curve.params, sought.start, f"{where}reference.start")
        if isinstance(part, SlipLaw | OwnLaw):
            given = gains_of_law(part.kind) if isinstance(part, SlipLaw) else (
                load_block(part.block).params.values())  # fmt: skip
            yield from without_unit({s.name: s for s in given}, part.gains, where[:-1])


MAGNETS = (
    "the vehicle has a track brake, and no certificate bounds what it does to the slip; leave out"
    " [vehicle.track_brake]"
)

MOTORS = (
    "motors brake beside the actuators, and no certificate bounds a torque of two brakes; leave out"
    " [vehicle.dynamic_brake]"
)

NO_LAYER = (
    "the rail is contaminated, and no certificate bounds an adhesion that wheels change; leave out"
    " [rail.contamination] and name the layer as a rail condition"
)


def certificates_of_trip(trip: Trip) -> Certificates:
    """Which controllers of a trip can be certified, and why the others cannot."""
    from slipctl.models.vehicle.certificate import axle_loops, gains

    unlike = [
        said for there, said in (
            (trip.vehicle.track_brake is not None, MAGNETS),
            (trip.vehicle.dynamic_brake is not None, MOTORS),
            (trip.rail.contamination is not None, NO_LAYER),
            (isinstance(trip.actuator, Air), BITS),
        ) if there
    ]  # fmt: skip
    if not unlike:
        return axle_loops.certificates(trip, gains.certificates(trip))
    valves = (SlideProtection,) if unlike[0] in (NO_LAYER, BITS) else ()
    none = Certificates((), dict.fromkeys(trip.controllers, unlike[0]))
    return axle_loops.certificates(trip, none, valves)


def _ensemble(trip: Trip, drawn: Drawn) -> Ensemble:
    """What differs from draw to draw."""
    told = {"patches": vars(drawn.patches)} if drawn.patches else {}
    patches = patches_of_seed(trip) if drawn.patches else None
    return Ensemble(drawn.draw, drawn.scale, drawn.seeds, patches, told)


def study(trip: Trip, name: str = "trip", source: str = "a vehicle of one's own") -> Study:
    """Make the study of a trip, which ``slipctl run`` runs.

    Args:
        trip: the trip.
        name: of its folder and files.
        source: where it is from, for the report.
    """

    def cases(models: Any, quick: bool) -> list[Any]:
        found = case(trip, "base")
        if quick:
            short = found.scenario.but(duration=min(found.scenario.duration, 0.5))
            found = replace(found, scenario=short)
        if trip.rail.contamination is None:
            return [replace(found, log=LOG)]
        found = replace(found, log=LOG, clean=CLEAN)
        return [found, replace(clean_case(trip, found), clean="")]

    drawn = trip.ensemble
    ensembles = {} if drawn is None else {"base": _ensemble(trip, drawn)}
    vehicle = trip.vehicle
    doc = (
        f"A {'braked' if vehicle.mode == 'brake' else 'driven'} vehicle of"
        f" {vehicle.total / 1e3:g} t on {vehicle.axles} axles, at the start at"
        f" {3.6 * vehicle.speed:.4g} km/h."
    )
    return Study(
        name=name, title=trip.title, source=source, doc=doc, cases=cases,
        signals=signals_of_trip(trip), plain=("base", CLEAN),
        limits={k: v for k, v in vars(trip.limits).items() if v is not None},
        ensembles=ensembles, gains=partial(certificates_of_trip, trip),
        without_effect=(*parts_without_effect(trip), *numbers_without_unit(trip),
                        *unusual_numbers(trip)),
        figures={
            "speeds": Figure("Speed of the vehicle and of a rim", _speeds),
            "slip": Figure("Slip and torque of one axle, and the distance", _slip),
        },
    )  # fmt: skip
