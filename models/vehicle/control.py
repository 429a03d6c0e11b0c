"""Slip control of one axle, from what it measures to the command of its actuator.

    slip -> meter -> [estimator, search, probe] -> best slip -> law -> watch, apply -> T_cmd

A slip law of models/common_form asks for the slip, the slip to go to, the adhesion force and what
the slip falls by. What comes before it is the same for all. The demand rules until an axle slips:
then its law begins anew, and it gives back when the demand has ruled for a while. So no integral
winds up while there is nothing to control.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from slipctl import (
    BadInput,
    Block,
    Output,
    Param,
    argmax,
    connect,
    every,
    gated,
    make_block,
    opened,
    replicate,
)
from slipctl.estimate.model import unknown_parameters
from slipctl.models import best_slip, sensors
from slipctl.models import common_form as form
from slipctl.models.common_form import Wheel
from slipctl.models.predictive.predictive_slip import predictive
from slipctl.models.vehicle.adhesion import numbers_of, odd_law
from slipctl.models.vehicle.air.valve_control import (
    gives_bits,
    own_slide_protection,
    refuse_misfits,
    slide_protection,
    torque_to_bits,
    valves_at_rest,
)
from slipctl.models.vehicle.failure import trust
from slipctl.models.vehicle.parts import (
    TICK,
    Air,
    Controller,
    DemandAlone,
    OwnLaw,
    Predictive,
    Reference,
    ScheduledPI,
    Searched,
    SlideProtection,
    SlipControl,
    SlipLaw,
    SlipRatio,
    SlipSpeed,
    TrainSlip,
    Trip,
    torque_of,
)
from slipctl.models.vehicle.parts.file_keys import with_keys
from slipctl.models.vehicle.plant import on_train
from slipctl.models.vehicle.ranges import of_inputs, searched_ranges, with_control_ranges
from slipctl.models.vehicle.safe_output import (
    begun_at_torque,
    carried_torque,
    contained_block,
    reference_with_floor,
    safe_command,
    sample,
)
from slipctl.models.vehicle.slip.common_numbers import (
    common_numbers,
    is_period,
    numbers_of_each_wheel,
    numbers_of_wheel,
)
from slipctl.models.vehicle.slip.fixed_reference import fixed_reference
from slipctl.models.vehicle.slip.own_law import own_block, own_slip_law
from slipctl.models.vehicle.slip.scheduled_pi import scheduled_pi
from slipctl.models.vehicle.slip.takeover import (
    applied,
    demand_alone,
    released_torque,
    released_valves,
    slip_from_speeds,
    turns,
    wake,
    watch,
)
from slipctl.models.vehicle.slip.train_reference import (
    axles_behind,
    parts_of_train,
    parts_of_train_slip,
)
from slipctl.study.resolve import load_block

BEHIND = "reference.behind"
"""How many axles follow; see models/vehicle/slip/train_slip.py."""


def numbers_of_each_axle(trip: Trip, part: Controller) -> dict[str, np.ndarray]:
    """Numbers of a controller of which each axle has its own, by name."""
    reference = getattr(part, "reference", None) or trip.reference
    if isinstance(reference, TrainSlip):
        return {} if reference.plan else {BEHIND: axles_behind(trip)}
    if isinstance(reference, SlipRatio) and len(reference.each) > 1:
        return {"reference.slip": np.array(reference.each)}
    return {}


WINDOW = 0.016
"""Time in s over which the adhesion is measured, and from one search for the best slip on."""


def ticks_of(time: float, trip: Trip) -> int:
    """Whole periods of the controllers, one at least, that are nearest to a time in s."""
    return max(round(time / trip.control.period), 1)


def at_period(block: Block, trip: Trip) -> Block:
    """Control of a vehicle at the period of the trip, its sample times set to that."""
    n = round(trip.control.period / TICK)
    if n == 1:
        return block
    own = {k: trip.control.period for k in block.params if is_period(k, block)}
    return every(block.with_params(**own), n)


def wheel(trip: Trip, reference: Reference | None = None) -> Wheel:
    """Wheel of the vehicle, as a controller knows it."""
    vehicle, act = trip.vehicle, trip.actuator
    share = len(vehicle.worked)
    return Wheel(
        J=vehicle.wheel_inertia, r=trip.one_radius, W=vehicle.total / vehicle.axles,
        m=vehicle.total / share, g=vehicle.gravity, T_max=act.torque, tau=act.usual_lag,
        v_best=typical_slip(reference or trip.reference, vehicle.speed), v=max(vehicle.speed, 1.0),
    )  # fmt: skip


def typical_slip(reference: Reference, speed: float) -> float:
    """Best slip in m/s for which a law is scaled: of the fitted curve, or the fixed one."""
    if isinstance(reference, Searched):
        curve, begin = law_and_guess(reference)
        return argmax(curve, "v_s", "mu", lo=0.01, hi=10.0, at=begin).location
    if isinstance(reference, SlipSpeed):
        return reference.slip
    if isinstance(reference, TrainSlip):
        return max(reference.slip / 2 * max(speed, 1.0), reference.least)
    return reference.at(max(speed, 1.0))


def law_and_guess(part: Searched) -> tuple[Block, dict[str, float]]:
    """Law that a search fits, and the first guess of its parameters.

    Samples that it is fitted to, and slips that are searched, are not below 0 by more than noise.
    Where a slip may be any, in a plan and for the adhesion force, it is :func:`odd_law`.

    Raises:
        BadInput: no such law, or one that does not go from ``v_s`` alone or is none of adhesion; an
            unknown parameter.
    """
    curve = load_block(part.law)
    if set(curve.inputs) != {"v_s"} or curve.inputs["v_s"].positive == "traction":
        raise BadInput(
            f"{part.law} cannot be searched: it has the inputs {', '.join(curve.inputs)}; such a"
            " law has v_s alone, positive in braking, as double_exponential"
        )
    on_train(curve)  # says what is wrong with it
    names = unknown_parameters(curve, None)
    if part.start:
        begin = numbers_of(curve, part.start, "start")
    elif set(best_slip.START) == set(names):
        begin = dict(best_slip.START)
    else:
        begin = {n: float(curve.params[n].value) for n in names}
    return curve, {n: begin.get(n, float(curve.params[n].value)) for n in names}


# ---- all of one axle -----------------------------------------------------------------------------


INTEGRALS = {"pid": ("law.integral", -1.0)}
"""Laws that are not told the adhesion force: their integral, and its sign where braking is +."""


def block_of_bits(trip: Trip, part: Controller) -> Block | None:
    """Block of one's own that gives the bits of two valves; None where a controller is none.

    Raises:
        BadInput: no such block, an unknown number of it, one that does not fit the trip.
    """
    block = own_block(trip, part) if isinstance(part, OwnLaw) else None
    if block is None or not gives_bits(block):
        return None
    assert isinstance(part, OwnLaw)
    refuse_misfits(trip, block)
    return block.with_params(**numbers_of(block, part.gains, "gains"))


def slip_law(trip: Trip, part: Controller, w: Wheel) -> tuple[Block, bool]:
    """Slip law of a controller, and whether it is gated inside (else it has to be outside).

    Raises:
        BadInput: an unknown gain or block, or a block that is no slip law.
    """
    driven = trip.vehicle.mode == "drive"
    if isinstance(part, Predictive):
        reference = part.reference or trip.reference
        searching = reference if isinstance(reference, Searched) else Searched()
        names = ("ticks", "horizon", "slip", "change", "beyond", "rate", "pole", "smooth")
        settings = {n: getattr(part, n) for n in names}
        settings |= {n: int(settings[n]) for n in ("ticks", "horizon")}
        return predictive(
            odd_law(law_and_guess(searching)[0]), **settings, tick=trip.control.period, gate=True
        )(w), True
    if isinstance(part, ScheduledPI):
        block = scheduled_pi.with_params(
            K=part.K, T_i=part.integral, T_t=part.follow, v_n=part.full, least=part.least, J=w.J,
            r=w.r,
        )  # fmt: skip
        return block, False
    if isinstance(part, SlipLaw):
        block = form.laws(driven, trip.control.period)[part.kind](w)
    else:
        assert isinstance(part, OwnLaw)
        block = own_slip_law(trip, part, w)
    return block.with_params(**numbers_of(block, part.gains, "gains")), False


def vehicle_control(trip: Trip, part: Controller) -> Block:
    """Slip control of all axles that have an actuator.

    Args:
        trip: the trip.
        part: the controller.

    Returns:
        Step from ``omega`` and ``T`` (torque of the actuator) of each axle, ``v`` and ``T_demand``
        to ``T_cmd`` of each; of an air brake to its bits ``hold`` and ``vent`` too. Its inputs may
        be anything; see :mod:`slipctl.models.vehicle.failure`. It runs every period of the trip.
    """
    w, axles = wheel(trip, getattr(part, "reference", None)), len(trip.vehicle.worked)
    if isinstance(part, DemandAlone):
        wires = {"apply.T_demand": "T_demand", "T_cmd": "apply.T_cmd"}
        own: dict[str, Block] = {"apply": demand_alone.with_params(T_max=w.T_max)}
        if isinstance(trip.actuator, Air):
            own["valves"] = valves_at_rest
            wires |= {"valves.T_cmd": "apply.T_cmd", "hold": "valves.hold", "vent": "valves.vent"}
        alone = with_control_ranges(connect("ctl", wires, **own), trip, w)
        return at_period(replicate(alone, axles, ["T_demand"]), trip)
    parts, wires = _controlled_axle(trip, part, w)
    driven = trip.vehicle.mode == "drive"
    _let_go(trip, parts, wires)
    reference = getattr(part, "reference", None) or trip.reference
    of_train: dict[str, Block] = {}
    if isinstance(reference, TrainSlip) and "reference" in parts:
        of_train, more = parts_of_train(trip, reference)
        wires |= more
    one = ("trust.v", "trust.demand", "trust.retry", "rail.factor", "plan.rate")
    common = {k for k, source in wires.items() if source in one} | {"fall.a_R", "probe.limit"}
    each = numbers_of_each_axle(trip, part)
    copies = {
        name: replicate(block, axles, [n for n in block.inputs if f"{name}.{n}" in common],
                        [*(n for n in block.params if f"{name}.{n}" in each),
                         *numbers_of_each_wheel(block)],
                        spread=trip.control.spread)
        for name, block in parts.items()
    }  # fmt: skip
    judge = trust(axles, driven).with_params(**of_inputs(trip, w))
    wires |= {
        "trust.v": "v", "trust.omega": "omega", "trust.T_b": "T", "trust.T_demand": "T_demand",
    }  # fmt: skip
    copies |= of_train
    if trip.control.let_go is not None:
        copies["turn"] = turns(axles).with_params(
            T_max=w.T_max, time=trip.control.let_go, every_=trip.control.let_go_every
        )
    copies = {"trust": judge, **copies}
    shares = common_numbers(trip, copies)
    block = with_control_ranges(connect("ctl", wires, share=shares, **copies), trip, w)
    own: dict[str, Any] = dict(numbers_of_wheel(block, trip, w))
    own |= {n: value for n, value in each.items() if n in block.params}
    return at_period(with_keys(block.with_params(**own), getattr(part, "gains", {})), trip)


def safe_output(trip: Trip) -> str | float:
    """What an axle gets on which slip control cannot be relied on."""
    given = trip.control.safe
    if given == "":
        return "demand" if trip.vehicle.mode == "brake" else 0.0
    return given if given in ("demand", "hold") else float(torque_of(given))


def _controlled_axle(
    trip: Trip, part: Controller, w: Wheel
) -> tuple[dict[str, Block], dict[str, str]]:
    """Parts of one axle up to its command, a torque or the bits of its valves, and their wires."""
    if isinstance(part, SlideProtection):
        return slide_protection(trip, part, w)
    bits = block_of_bits(trip, part)
    if bits is not None:
        return own_slide_protection(trip, bits, w)
    parts, wires = _axle(trip, part, w)
    parts["sample"], parts["safe"] = sample, safe_command(
        safe_output(trip), trip.vehicle.mode == "drive"
    ).with_params(
        v_off=trip.control.off, limit=trip.control.release,
        limit_still=trip.control.release_still,
    )  # fmt: skip
    wires |= {
        "sample.mu_m": "meter.mu_m", "sample.v_s_m": "meter.v_s_m", "sample.ready": "trust.ready",
        "safe.T_slip": "apply.T_cmd", "safe.T_demand": "trust.demand", "safe.on": "wake.on",
        "safe.ready": "trust.ready", "safe.sound": "law.sound", "safe.stands": "trust.stands",
        "safe.v": "trust.v", "safe.retry": "trust.retry", "safe.test": "trust.test",
        "T_cmd": "safe.T_cmd", "trust.T_cmd": "safe.T_h",
    }  # fmt: skip
    if isinstance(trip.actuator, Air):
        more, others = torque_to_bits(trip)
        parts, wires = parts | more, wires | others
    return parts, wires


def _let_go(trip: Trip, parts: dict[str, Block], wires: dict[str, str]) -> None:
    """Add what lets an axle go in turn: ``release`` behind all that makes its command."""
    if trip.control.let_go is None:
        return
    wires |= {"turn.v": "trust.v", "turn.T_b": "trust.T_b", "turn.T_demand": "trust.demand",
              "release.free": "turn.free"}  # fmt: skip
    if isinstance(trip.actuator, Air):
        parts["release"] = released_valves
        for bit in ("hold", "vent"):
            wires |= {f"release.{bit}_by": wires[bit], bit: f"release.{bit}",
                      f"model.{bit}": f"release.{bit}"}  # fmt: skip
    else:
        parts["release"] = released_torque.with_params(T_max=trip.actuator.torque)
        wires |= {"release.T_slip": wires["T_cmd"], "T_cmd": "release.T_cmd"}


WIRES = {
    "slip.v": "trust.v",
    "slip.rim": "trust.rim",
    "meter.omega": "slip.omega_s",
    "meter.v_s": "slip.v_s",
    "meter.T_b": "trust.T_b",
    "fall.F": "force.F",
    "wake.v": "trust.v",
    "wake.v_s": "slip.v_s",
    "wake.ready": "trust.ready",
    "wake.ruling": "watch.ruling",
    "watch.rules": "wake.on",
    "watch.slips": "wake.slips",
    "watch.T_demand": "trust.demand",
    "watch.T_wanted": "law.T_wanted",
    "law.on": "wake.on",
    "apply.on": "wake.on",
    "apply.T_wanted": "law.T_wanted",
    "apply.T_demand": "trust.demand",
    "apply.T": "trust.T_b",
}
"""Wires of the slip control of an axle, whatever its law and its reference."""


def _axle(trip: Trip, part: Controller, w: Wheel) -> tuple[dict[str, Block], dict[str, str]]:
    """Parts of the slip control of one axle, and their wires."""
    reference = part.reference or trip.reference
    settings: SlipControl = trip.control
    law_block, gated_inside = slip_law(trip, part, w)
    if isinstance(part, SlipLaw) and part.kind in INTEGRALS:
        law_block = begun_at_torque(law_block, *INTEGRALS[part.kind])
    always = type(trip.demand).__name__ == "Most"
    parts: dict[str, Block] = {
        "slip": slip_from_speeds(trip.vehicle.mode == "drive"),
        "meter": sensors.adhesion_meter(ticks_of(WINDOW, trip), "sampled", noise=False),
        "force": form.force,
        "fall": form.fall,
        "law": contained_block(
            law_block if gated_inside else gated(law_block),
            "the demand" if trip.vehicle.mode == "brake" else "the safe output",
        ),
        "wake": wake(always).with_params(
            share=settings.wake, least=settings.least, v_off=settings.off
        ),
        "watch": watch(always).with_params(rest=settings.rest),
        "apply": applied.with_params(lead=getattr(part, "lead", 1.0)),
    }
    wires = dict(WIRES)
    ports = {"v": "trust.v", "v_s": "slip.v_s", "F": "force.F", "D": "fall.D", "T": "trust.T_b",
             "T_top": "trust.demand"}  # fmt: skip
    if "T_begin" in law_block.inputs:
        parts["carried"] = carried_torque
        wires |= {"carried.mu": "sample.mu", "carried.T_demand": "trust.demand"}
        ports["T_begin"] = "carried.T"
    if isinstance(reference, Searched):
        curve, begin = law_and_guess(reference)
        found, given = _searched(
            curve,
            tuple(begin.items()),
            reference.noise,
            ticks_of(WINDOW, trip),
            trip.control.period,
            4 if trip.control.spread else 1,
        )
        inner = dict(given)
        peak = typical_slip(reference, trip.vehicle.speed)
        parts["reference"] = reference_with_floor(peak, of_inputs(trip, w)["gate"] - 0.1)
        wires |= {"reference.searched": inner.pop("v_best"), "reference.v": "trust.v"}
        ports["v_best"] = "reference.v_best"
        ports |= {n: inner.pop(n) for n in unknown_parameters(curve, None)}
        parts |= dict(found)
        wires |= inner | {
            "estimator.mu": "sample.mu",
            "estimator.v_s": "sample.v_s",
            "curve.v_s": "slip.v_s",
            "force.mu": "curve.mu",
        }
    else:
        wires["force.mu"] = "meter.mu_m"
        if isinstance(reference, TrainSlip):
            own, inner, ports["v_best"] = parts_of_train_slip(trip, reference)
            parts |= own
            wires |= inner
        else:
            parts["reference"] = fixed_reference(reference)
            wires["reference.v"], ports["v_best"] = "trust.v", "reference.v_best"
        if isinstance(part, Predictive):
            parts["curve"], ports_of_curve = known_curve()
            ports |= ports_of_curve
    wires["wake.v_best"] = ports["v_best"]
    wires |= {f"law.{n}": ports[n] for n in law_block.inputs if n in ports}
    wires |= {f"law.{n}": ports[n.rpartition(".")[2]] for n in law_block.inputs
              if n not in ports and n.rpartition(".")[2] == "T_top"}  # fmt: skip
    return parts, wires


@lru_cache(maxsize=8)
def _searched(
    curve: Block,
    begin: tuple[tuple[str, float], ...],
    noise: float,
    ticks: int,
    tick: float,
    runs: int,
) -> tuple[Mapping[str, Block], Mapping[str, str]]:
    """Parts that find the best slip, and their wires; made once for all controllers of a trip."""
    parts, wires = best_slip.search_parts(curve, dict(begin), noise, ticks, tick, runs)
    parts["curve"] = opened(odd_law(curve))
    return parts | searched_ranges(parts, curve, dict(begin)), wires


def known_curve() -> tuple[Block, dict[str, str]]:
    """Curve of a law that nobody estimates, for a predictive controller: its own numbers."""
    curve, begin = law_and_guess(Searched())
    own = {n: curve.params[n] for n in begin}
    ends = {n: {"lo": max(s.lo, -1e6), "hi": min(s.hi, 1e6)} for n, s in own.items()}
    block = make_block(
        "curve", "law", lambda x, u, p: ({}, {n: p[f"{n}_0"] for n in begin}),
        params=[Param(own[n].unit, v, own[n].doc, "assumed", **ends[n]).named(f"{n}_0")
                for n, v in begin.items()],
        outputs=[Output(s.unit, s.doc, "as assumed", **ends[n]).named(n) for n, s in own.items()],
        doc="Adhesion curve that the controller assumes.",
    )  # fmt: skip
    return block, {n: f"curve.{n}" for n in begin}
