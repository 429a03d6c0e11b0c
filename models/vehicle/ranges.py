"""What the numbers of a vehicle's slip control can be, so that its C knows a wrong sample.

Ends follow from the trip: its speed, wheels, largest torque and sensors. They are wide, because a
value beyond its range is not taken, and one that is further from the last than physics allows
neither. A law of the user's own keeps the ranges that it declares.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import log, pi

import numpy as np
from casadi import SX, Function, vertsplit

from slipctl import BadInput, Block
from slipctl.block.text.named_expressions import evaluate
from slipctl.certify.arithmetic.enclosure import enclose
from slipctl.models.common_form import T_S, Wheel
from slipctl.models.ranges import FLAG, of_those
from slipctl.models.vehicle.failure import BEHIND, MEASURED, TRIED
from slipctl.models.vehicle.measurement.axle_samples import (
    AGAIN,
    DOUBT,
    NEVER,
    SPEAKS,
    TEST,
    WORN,
)
from slipctl.models.vehicle.measurement.believed_speed import DRAG
from slipctl.models.vehicle.parts import (
    Air,
    Lag,
    NoisySpeed,
    NoisyWheel,
    ToothWheel,
    Trip,
    torque_of,
)

APART = 3.0
"""Logarithm of the factor by which an estimate may be from its first guess, in each unknown."""

FASTEST = 1e3
"""Slip in m/s that no wheel has."""

FAR_OFF = 1e6
"""End of a range that has none of its own."""

STEEP = 1e9
"""Largest height of a law: that of Huang 2020 comes to 4e6 half a metre per second below 0."""

SURE = 8.0
"""Standard deviations that a noise never leaves."""


def with_control_ranges(block: Block, trip: Trip, w: Wheel) -> Block:
    """Declare the ranges of what the control of a vehicle holds. It judges its inputs itself."""
    numbers = of_inputs(trip, w)
    fastest, spin = numbers["fastest"], numbers["most"]
    rim = 1.2 * w.r * spin  # a ratio of wheels is within a tenth of 1
    slip = fastest + rim
    slipping = (-slip, slip, "a wheel that spins, either way, and the vehicle's speed")
    axles = len(trip.vehicle.worked)
    tuned = "T_max" in block.params and "trust.T_b" in block.outputs  # then these ends follow
    full, all_, top = (
        f"{k!r} * T_max" if tuned else k * w.T_max for k in (1.0, float(axles), 1.25)
    )
    most = (f"-{top}" if tuned else -top, top, "a quarter more than the largest, either way")
    far = (-250 * w.T_max, 250 * w.T_max, "250 times the largest torque; it is limited")
    time = (0, NEVER, "longer is not counted")
    speed = (-2, fastest, "430 km/h, or half as much again as at the start")
    rows: dict[str, tuple] = {
        "slip.v_s": slipping,
        "slip.omega_s": (-5 * slip, 5 * slip, "that rim at the least radius"),
        "meter.omegas": (-5 * slip, 5 * slip, "that rim at the least radius"),
        "meter.torques": far,  # an end that is an expression is of the part's own numbers
        "meter.slips": slipping,
        "meter.mu_m": (-1e3, 1e3, "a wheel that stops within a tick has a hundred"),
        "meter.v_s_m": slipping,
        "sample.mu": (-MEASURED, MEASURED, "it is limited"),
        "sample.v_s": slipping,
        "estimator.kept": slipping,
        "watch.ruling": (0, 1, FLAG),
        "watch.on": (0, 1, FLAG),
        "watch.idle": (0, 1e9, "it counts on where slip control rules from the start"),
        "reference.v_best": (0, max(20.0, fastest), "no more than the speed"),
        "fill.v_best": (0, max(20.0, fastest), "no more than the speed"),
        "trust.omega_h": (-spin, spin, "a wheel that spins free"),
        "trust.mean": (-spin, spin, "a wheel that spins free"),
        "trust.rim": (-rim, rim, "a wheel that spins free"),  # which is faster than the vehicle
        "trust.torque": (0, full, "as commanded"),
        "trust.T_b": most,
        "trust.radius": (0.2 * (1 - WORN), 1 + WORN, "no wheel is worn by more"),
        "trust.doubt": (-AGAIN - 0.1, DOUBT + TEST + 0.1, "the test ends then"),
        "trust.ratio": (1 - 2 * WORN, 1 + 2 * WORN, "no wheel is worn by more"),
        "trust.bias": (-DRAG, DRAG, "it is limited"),
        "trust.v_h": speed,
        "trust.v": speed,
        "trust.demand_h": far,
        "trust.demand": far,
        **{f"trust.{n}": time
           for n in ("out", "good", "still", "freed", "odd", "off", "on", "back", "age",
                     "demand_out", "let_go")},
        "trust.ban": (0, 10, "it is set to that"),
        "trust.up": (0, SPEAKS, "it is set to that"),
        "trust.rest": (0, 10, "it is set to that"),
        "trust.tried": (0, 2 * TRIED, "longer is not counted"),
        "trust.given_h": speed,
        "trust.lead_h": (-rim, rim, "a wheel that spins free"),
        "trust.moved": (-NEVER, NEVER, "more is not counted"),
        "trust.total": (0, all_, "of all axles"),
        "trust.learnt": (0, 1, "it is limited"),
        "trust.seen": (0, 1, FLAG),
        "trust.kept_pace": (0, 1, FLAG),
        "trust.lost_v": (0, NEVER, "more is not counted"),
        "trust.lost_rim": (0, NEVER, "more is not counted"),
    }  # fmt: skip
    if "trust.v_h" not in block.states:  # nothing judges the demand
        rows["T_demand"] = far
    return of_those(block, rows)


def height_of(
    curve: Block, over: Mapping[str, tuple[float, float]], slips: tuple[float, float]
) -> tuple[float, float]:
    """Least and greatest value of a curve over all slips and parameters that an estimate may have.

    Interval arithmetic of one box; where that has no finite ends they are far off.

    Args:
        curve: law from ``v_s``.
        over: ends of each parameter. slips: ends of the slip in m/s.
    """
    names = list(over)
    x = SX.sym("x", len(names) + 1)
    at = dict(zip(["v_s", *names], vertsplit(x), strict=True))
    rest = {n: SX(s.value) for n, s in curve.params.items() if not s.derived}
    _, y = curve.expr({}, {"v_s": at.pop("v_s")}, rest | at)
    box = np.array([slips, *over.values()]).clip(-FAR_OFF, FAR_OFF)
    try:
        ends = enclose(Function("curve", [x], [y["mu"]]), box[:, :1], box[:, 1:])
    except BadInput:
        return -STEEP, STEEP
    least, most = (float(e[0, 0]) for e in ends)
    return max(min(least, -2.0), -STEEP), min(max(most, 2.0), STEEP)


def searched_ranges(
    parts: Mapping[str, Block], curve: Block, begin: Mapping[str, float]
) -> dict[str, Block]:
    """Estimator, search and curve with ranges that follow from one another.

    An estimate goes no further from its first guess than a factor of e^``APART``, and slips that an
    estimator takes are no less than ``-BEHIND``. So what it predicts has ends, and with them its
    residuals and the height of the peak that is searched.
    """
    estimator = parts["estimator"].with_params(farthest=APART)
    wide = float(np.exp(APART))
    free = {n: (v / wide, len(begin) * v * wide) if v > 0 else (-FAR_OFF, FAR_OFF)
            for n, v in begin.items()}  # fmt: skip
    low, high = height_of(curve, free, (-BEHIND, 120.0))
    most = max(-low, high)
    why = "the law, of all estimates there are"
    rows = {
        "predicted": (-most, most, why),
        "residual": (-most - MEASURED, most + MEASURED, why),
        "scatter": (0, (most + 2 * MEASURED) ** 2, why),
    }
    rows |= {f"held_{n}": row for n, row in rows.items()}
    rows |= {f"{n}_then": rows[n] for n in ("predicted", "residual")}
    window = estimator.states["kept"].shape[1]
    rows["squares"] = (0, window * (most + MEASURED) ** 2, "its window of the largest residuals")
    told = {n: (curve.params[n].lo, curve.params[n].hi) for n in begin}
    ends = (*height_of(curve, told, (0.0, 20.0)), why)
    force = max(map(abs, height_of(curve, told, (0.0, FASTEST))))
    return {
        "curve": of_those(parts["curve"], {"mu": (-force, force, why)}),
        "estimator": of_those(estimator, rows),
        "search": of_those(parts["search"], {"value": ends, "held_value": ends}),
    }


def of_inputs(trip: Trip, w: Wheel) -> dict[str, float]:
    """Numbers by which the inputs of a vehicle's control are judged; see ``failure.trust``.

    Those of :func:`derived_of_inputs` have the value of their expression for the file's wheel.
    """
    vehicle, of = trip.vehicle, trip.sensors.vehicle_speed
    found = {
        "fastest": max(120.0, 1.5 * vehicle.speed), "noise": _constant_noise(trip), "gate": 0.15,
        "noise_slow": 0.0, "slow": 0.0, "unseen": 0.1, "pace": NEVER, "lost": 0.0,
        "react": min(0.3 + trip.actuator.dead_time, 10.0),
        "limit": trip.control.release_train, "v_start": vehicle.speed,
    }  # fmt: skip
    if isinstance(of, NoisySpeed):
        found["unseen"] += of.step + _lost(of) * 3.0 * T_S
        found["gate"] = min(0.15 + (5 * of.deviation + found["unseen"] - 0.1), 50.0)
    if trip.control.demand_lost not in ("", "largest"):
        found["lost"] = float(torque_of(trip.control.demand_lost))
    known = {"r": w.r, "J": w.J, "g": w.g, "tau": w.tau, "T_max": w.T_max, "m_axle": w.W,
             "m": w.m, "v_error": found["gate"], **found}  # fmt: skip
    for name, (text, places) in derived_of_inputs(trip).items():
        known[name] = float(evaluate(text, known, name))
        if f"trust.{name}" in places:
            found[name] = known[name]
    if trip.sensors.of_wheels:
        found["gate"] = min(0.15 + w.r * found["noise"], 50.0)
    return found


def derived_of_inputs(trip: Trip) -> dict[str, tuple[str, list[str]]]:
    """Expressions of those numbers of :func:`of_inputs` that follow from others, and their places.

    So they follow where radius, inertia, load, lag or largest torque are tuned in C; each is behind
    those that it needs. A tooth wheel tells a speed at an edge, at the latest when the wheel has
    turned by a tooth. From rest it has sqrt(2 alpha 2 pi/N) by then. A speed that is found from the
    wheels is off by what theirs are. That is one number for radii that differ, so it is the file's
    and cannot be tuned.
    """
    vehicle, act = trip.vehicle, trip.actuator
    driven, part = vehicle.mode == "drive", trip.sensors.wheel_speed
    alpha = "2 * (T_max + m_axle * g * r) / J"
    turned = ["meter.omega_start"]
    found = {
        "omega_start": ("v_start / r", ["trust.omega_start", *turned * (not driven)]),
        "most": ("1.5 * fastest / r", ["trust.most"]),
    }
    if driven:
        found["omega_seen"] = ("-1 * v_start / r", turned)
    if isinstance(part, NoisyWheel) and part.dropout > 0:
        still = SURE * part.deviation + part.step
        more = f"{_lost(part) * T_S!r} * one('s') * {alpha}"
        found["noise"] = (f"(0.1 + {still!r}) * one('rad/s') + {more}", ["trust.noise"])
    if isinstance(part, ToothWheel):
        tooth, of_edge = 2 * pi / part.teeth, SURE * part.jitter + 2 * part.clock
        usual = "1.2 * max(v_start, one('m/s')) / r"
        found["noise"] = (f"0.1 * one('rad/s') + ({usual})**2 / {tooth!r} * {of_edge!r} * one('s')",
                          ["trust.noise"])  # fmt: skip
        found["noise_slow"] = (f"sqrt(2 * ({alpha}) * {tooth!r})", ["trust.noise_slow"])
        found["slow"] = ("2 * noise_slow", ["trust.slow"])
    if not isinstance(act, Air):  # of air the bits explain the torque
        lag, full = f"{1.2 * act.longest_lag / act.usual_lag!r} * tau", ""
        if isinstance(act, Lag) and act.rate:
            full = f" + T_max / ({act.rate!r} * one('N m/s'))"
        found["react"] = (f"min(0.3 * one('s') + {lag} + {act.dead_time!r} * one('s'){full},"
                          " 10 * one('s'))", ["trust.react"])  # fmt: skip
    fixed, with_one = vehicle.resistance.of(0.0), vehicle.resistance.of(1.0)  # of so many kg
    units = (("N", "m/s^2"), ("N s/m", "1/s"), ("N s^2/m^2", "1/m"))
    for k, (force, more, (unit, by_mass)) in enumerate(zip(fixed, with_one, units, strict=True)):
        text = (f"{more - force!r} * one('{by_mass}')"
                f" + {force!r} * one('{unit}') / ({len(vehicle.worked)} * m)")  # fmt: skip
        found[f"resist_{k}"] = (text, [f"trust.resist_{k}"])
    # of brakes that it is not told, and of a speed that is the wheels' own, it cannot know
    if not (vehicle.track_brake or vehicle.dynamic_brake or trip.sensors.of_wheels):
        found["pace"] = ("2 * v_error + 2 * r * noise + 0.5 * one('m/s')", ["trust.pace"])
    found["standstill"] = ("min(v_error - 0.1 * one('m/s'), 5 * one('m/s'))",
                           ["reference.standstill"])  # fmt: skip
    if trip.control.demand_lost == "largest" or (trip.control.demand_lost == "" and not driven):
        found["lost"] = ("1 * T_max", ["trust.lost"])
    return found


def _constant_noise(trip: Trip) -> float:
    """What a wheel's sensor may be off by in rad/s, where that follows from nothing else."""
    part = trip.sensors.wheel_speed
    return 0.1 + (SURE * part.deviation + part.step if isinstance(part, NoisyWheel) else 0.0)


def _lost(part: NoisyWheel | NoisySpeed) -> float:
    """Samples that are lost in a row, once in 1e9 of them."""
    return log(1e-9) / log(part.dropout) if part.dropout > 0 else 0.0
