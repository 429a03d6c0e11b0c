"""What ``slipctl certify metro.toml`` asks: the gains of a trip, and bounds from its own equations.

Every slip law makes s' = nu(e) + d out of s' = (r/J) T - D. There D = (r^2/J + n_w/M) F + a is
what the slip falls by, and d is what the law has wrong of it. So its gains are asked about with
bounds of d and of its rate, which are enclosures of D and of its slope over

    the rail conditions of the trip, each with the ranges of the ensemble
    the tube: slips within a share of the best one

Where the adhesion is fitted, d is a share of D. Where it is measured, over a window that ends now,
it is what D changes by inside the tube, and its rate at most twice the rate of D.

The bounds hold inside the tube. So what is asked of a law is a band no wider than the tube. The set
that proves it holds no error and no tick leaves it, and whatever comes into it meets no more than
the bounds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from slipctl import BadInput, Block, Gains, Input, Output, Param, connect, law
from slipctl.analysis.bounds import enclosure, largest_slope
from slipctl.block.units.unit_algebra import parse_quantity, read_range
from slipctl.models.common_form import ADDED
from slipctl.models.vehicle.adhesion import rail_law
from slipctl.models.vehicle.certificate.own_gains import (
    Range,
    Tube,
    Withstood,
    as_reaching,
    why_not,
)
from slipctl.models.vehicle.parts import (
    Lag,
    OwnLaw,
    Reference,
    Searched,
    SlipLaw,
    SlipRatio,
    SlipSpeed,
    Trip,
)
from slipctl.models.vehicle.parts.trip import DRAWN
from slipctl.models.vehicle.plant import on_train
from slipctl.models.vehicle.slip.own_law import sample_time
from slipctl.models.vehicle.trip import best
from slipctl.run.sweep.ensemble import FACTOR
from slipctl.study.declaration import Certificates

COARSE = 0.01
"""Share by which a bound may be too large."""


@law(D=Output("m/s^2", "what the slip falls by", positive="braking"))
def falling(
    mu=Input("1", "adhesion coefficient", positive="traction"),
    m=Param("kg", 40e3, "vehicle", ADDED, lo=100, hi=1e8),
    J=Param("kg m^2", 110.0, "inertia of a wheelset", ADDED, lo=0.1, hi=1e5),
    r=Param("m", 0.42, "wheel radius", ADDED, lo=0.2, hi=1),
    g=Param("m/s^2", 9.81, "gravity", ADDED),
    n=Param("1", 4.0, "axles", ADDED, lo=1, hi=32),
    n_w=Param("1", 4.0, "axles that are worked", ADDED, lo=1, hi=32),
):
    """D = (r^2/J + n_w/M) mu M g/n, without the resistance."""
    return (r**2 / J + n_w / m) * mu * m * g / n


@dataclass(frozen=True)
class Ranges:
    """Over what a bound is taken.

    Attributes:
        tube: share of the best slip. speed: of the vehicle in m/s.
        numbers: range of each number of the wheel that is drawn: m, J, r.
        scale: range of the factor on each parameter of the rail.
        together: parameters of the rail that have one factor, by draw.
        untold: whether the mass is drawn of the plant alone, so that the controller has another.
    """

    tube: float
    speed: float
    numbers: Mapping[str, Range]
    scale: Mapping[str, Range]
    untold: bool = False
    together: tuple[tuple[str, ...], ...] = ()

    def halved(self) -> dict[str, Ranges]:
        """The same with one range half as wide, by name, to see what each costs."""
        found = {"tube": replace(self, tube=self.tube / 2)}
        for name, ends in self.numbers.items():
            found[name] = replace(self, numbers={**self.numbers, name: _half(ends)})
        for names in self.together:
            halves = {name: _half(self.scale[name]) for name in names}
            found[" and ".join(names)] = replace(self, scale={**self.scale, **halves})
        return found


def _half(ends: Range) -> Range:
    lo, hi = ends
    return (3 * lo + hi) / 4, (lo + 3 * hi) / 4


def ranges(trip: Trip) -> tuple[Ranges, tuple[str, ...]]:
    """Ranges of a trip's ensemble, and the names of draws that no bound hears."""
    numbers: dict[str, Range] = {}
    scale: dict[str, Range] = {}
    together: list[tuple[str, ...]] = []
    left: list[str] = []
    drawn = trip.ensemble
    params = rail_law(trip).params
    for name, text in drawn.draw.items() if drawn else ():
        own = next((k for k, (_, names) in DRAWN.items() if name in names), None)
        if own is None:
            left.append(name)
            continue
        low, high = text.split(":")
        numbers[own] = read_range(low, high, DRAWN[own][0], f"ensemble.draw.{name}")
    for name, text in drawn.scale.items() if drawn else ():
        match = FACTOR.fullmatch(text)
        assert match is not None  # the parts have said so
        lo, hi = (parse_quantity(match[k], "1", f"ensemble.scale.{name}") for k in (1, 2))
        group: list[str] = []
        for place in (p.strip() for p in match[3].split(",")):
            head, _, own = place.rpartition(".")
            if head == "plant.train.adh" and own in params:
                group.append(own)
            elif not place.startswith("rail."):
                left.append(place)
        scale |= dict.fromkeys(group, (lo, hi))
        together += [tuple(group)] if group else []
    untold = drawn is not None and "m" in numbers and "m" not in drawn.draw
    speed = max(trip.vehicle.speed, 1.0)
    found = Ranges(trip.certify.tube, speed, numbers, scale, untold, tuple(together))
    return found, tuple(left)


def slip_law_bounds(trip: Trip, loop: Block, over: Ranges, reference: Reference) -> Withstood:
    """Bounds of what a slip law meets, by interval arithmetic on the trip's own equations.

    Args:
        trip: the trip. loop: one of its loops, whose numbers count. over: the ranges.
        reference: slip that the law goes to.

    Raises:
        BadInput: the controller was told another wheel, or the adhesion law jumps in the tube.
    """
    rail, numbers, part = rail_law(trip), _wheel(loop), trip.vehicle
    fitted = isinstance(reference, Searched)
    falls = connect(
        "falls", {"adh.v_s": "v_s", "adh.v": "v", "fall.mu": "adh.mu", "D": "fall.D"},
        adh=on_train(rail), fall=falling.with_params(n=part.axles, n_w=len(part.worked)),
    )  # fmt: skip
    wheel = {f"fall.{k}": v for k, v in over.numbers.items()}
    fixed = {f"fall.{k}": v for k, v in numbers.items() if f"fall.{k}" not in wheel}
    found, tubes = [], []
    for condition, values in rail.conditions.items():
        own = {k: float(p.value) for k, p in rail.params.items() if not p.derived}
        own |= {k: float(v) for k, v in values.items()}
        ends = [{k: v * over.scale[k][e] if k in over.scale else v for k, v in own.items()}
                for e in (0, 1)]  # fmt: skip
        slips = [_goal(rail, condition, at, over.speed, reference) for at in ends]
        box = {"v_s": (min(slips) * (1 - over.tube), max(slips) * (1 + over.tube)), **wheel}
        box |= {f"adh.{k}": tuple(sorted(e[k] for e in ends)) for k in over.scale}
        given = {f"adh.{k}": v for k, v in own.items() if k not in over.scale}
        given |= {**fixed, "v": over.speed}
        low, high = enclosure(falls, "D", box, COARSE, **given)
        slope = largest_slope(falls, "D", "v_s", box, coarse=COARSE, **given).value
        found.append((low, high, slope, box["v_s"][1] - box["v_s"][0]))
        tubes.append(Tube((min(slips), max(slips)), box["v_s"], (low, high)))
    lowest, highest = min(f[0] for f in found), max(f[1] for f in found)
    slope, span = max(f[2] for f in found), max(f[2] * f[3] for f in found)
    mass = over.numbers.get("m", (numbers["m"],))[0]
    share = len(part.worked) / mass
    other = share / (numbers["r"] ** 2 / numbers["J"] + share)  # of D, what moves the vehicle
    steady, drift = _resistance(trip, over.speed, mass, other * highest)
    steady += other * (highest - lowest if len(found) > 1 else span)  # the other axles
    if over.untold:
        steady += other * highest * max(abs(m / numbers["m"] - 1) for m in over.numbers["m"])
    error = trip.certify.error
    return Withstood(
        steady=steady, wrong=error * highest if fitted else span,
        slope=slope * (error + 2 * other if fitted else 2.0),
        drift=drift, tube=max(f[3] for f in found) / 2, motion=other * highest,
        tubes=tuple(tubes),
    )  # fmt: skip


def _goal(
    rail: Block, condition: str, at: Mapping[str, float], v: float, reference: Reference
) -> float:
    """Slip in m/s that a law goes to on a rail."""
    if isinstance(reference, SlipSpeed):
        return reference.slip
    if isinstance(reference, SlipRatio):
        if len(reference.each) > 1:
            raise BadInput(
                "reference.slip: a certificate is of one slip for all axles; write one number"
            )
        return reference.at(v)
    slip, _ = best(rail.with_conditions(**{condition: at}), condition)
    return slip * v if "lam" in rail.inputs else slip


def _wheel(loop: Block) -> dict[str, float]:
    """Mass, inertia, radius and gravity of the plant; the controller must know the last three.

    Raises:
        BadInput: it was told another inertia or radius.
    """
    now = loop.values_by_place()
    found = {k: float(np.max(now[f"plant.train.{k}"])) for k in ("m", "J", "r", "g")}
    for k in ("J", "r"):
        told = now.get(f"ctl.fall.{k}", now.get(f"ctl.law.{k}", found[k]))
        if abs(float(np.max(told)) - found[k]) > 0.01 * found[k]:
            raise BadInput(
                f"the controller has {k} = {float(np.max(told)):g} and the vehicle"
                f" {k} = {found[k]:g}; certificates need them within 1 %"
            )
    return found


def _resistance(trip: Trip, v: float, mass: float, a: float) -> Range:
    """Resistance and gradient over the mass, and their rate while the vehicle changes speed."""
    part, gradient = trip.vehicle.resistance, trip.rail.gradient
    slopes = [s.gradient for s in gradient] if isinstance(gradient, tuple) else [gradient or 0.0]
    steepest = max((abs(s) for s in slopes), default=0.0)
    a_R, b_R, c_R = part.of(trip.vehicle.total)
    force = a_R + b_R * v + c_R * v * v
    steady = force / mass + trip.vehicle.gravity * steepest
    return steady, (b_R + 2 * c_R * v) / mass * (a + steady)


# ---- from a law to a system ----------------------------------------------------------------------


def _number(loop: Block, name: str) -> float:
    return float(np.max(loop.values_by_place()[f"ctl.law.{name}"]))


def _twisting(loop: Block, met: Withstood) -> dict[str, float]:
    """In the tube x2 is no larger than what k1 balances at its edge, so |s'| <= 2 k1 sqrt(tube)."""
    k1 = _number(loop, "law.k1")
    fastest = 2 * k1 * met.tube**0.5
    return {"k1": k1, "k2": _number(loop, "law.k2"), "L": met.slope * fastest + met.drift,
            "T": loop.period, "band": met.tube}  # fmt: skip


def _reaching(loop: Block, met: Withstood) -> dict[str, float]:
    return {"g1": _number(loop, "law.g1"), "g2": _number(loop, "law.g2"), "T": loop.period,
            "D": met.largest, "band": met.tube}  # fmt: skip


def _linear(loop: Block, met: Withstood) -> dict[str, float]:
    return {"K": _number(loop, "law.K"), "T": loop.period}


def _funnel(loop: Block, met: Withstood, v: float, driven: bool) -> dict[str, float]:
    """In slip ratio; of a driven wheel the law leaves out what the vehicle's motion does to it."""
    found = {k: _number(loop, f"law.{k}") for k in ("K1", "eta_inf", "delta_l", "delta_u")}
    found |= {"T": loop.period, "W": met.largest / v}
    return found | ({"a": met.motion, "v": v} if driven else {})


def _higher(loop: Block, met: Withstood) -> dict[str, float]:
    """As fast in the tube as e2 of the law's own root, k4 phi1, lets it be."""
    k4 = _number(loop, "law.k_4")
    fastest = 2 * k4 * (met.tube**0.5 + met.tube)
    return {"k4": k4, "alpha": _number(loop, "law.alpha"), "beta": _number(loop, "law.beta"),
            "eta": met.slope * fastest + met.drift}  # fmt: skip


Asked = Callable[[Block, Withstood], Mapping[str, float]]

SYSTEMS: dict[str, tuple[str, str, tuple[str, str]]] = {
    "sta": ("super_twisting", "L", ("lag", "dead")),
    "smc": ("reaching_law", "D", ("lag", "")),
    "file": ("reaching_law", "D", ("lag", "")),
    "efc": ("lagged_loop", "", ("lag", "")),
    "eppfc": ("prescribed_performance", "W", ("lag", "dead")),
    "hosm": ("higher_order", "eta", ("", "")),
}
"""By law the system that it is certified as, its bound, and its names of lag and dead time."""

NUMBERS: dict[str, Asked] = {"sta": _twisting, "smc": _reaching, "efc": _linear, "hosm": _higher}

NONE = {
    "eppfc_barrier": "its barrier is not that of a system here",
    "barrier": "its robust form is not that of a system here",
    "nmpc": "what it does is the solution of a program at each"
    " tick; its terminal weight knows no limits and no other adhesion",
    "none": "it has no gains",
}
"""Why a controller has no certificate."""


def certificates(trip: Trip) -> Certificates:
    """What ``slipctl certify`` asks about the controllers of a trip that cancel adhesion.

    Where the actuator is late, each law is asked about twice: with lag and dead time, and without.
    """
    found: list[Gains] = []
    seen: dict[str, Withstood] = {}
    for name, part in trip.controllers.items():
        own = isinstance(part, OwnLaw) and not why_not(trip, part)
        if own or (isinstance(part, SlipLaw) and part.kind in SYSTEMS):
            found += _of(trip, name, part, seen)
    return Certificates(tuple(found), _reasons(trip))


def _of(trip: Trip, name: str, part: SlipLaw | OwnLaw, seen: dict[str, Withstood]) -> list[Gains]:
    system, bound, (lag, dead) = SYSTEMS[part.kind]
    reference = part.reference or trip.reference
    over, left = ranges(trip)

    def met_by(loop: Block, over: Ranges) -> Withstood:
        key = repr((over, reference, _wheel(loop)))
        if key not in seen:
            seen[key] = slip_law_bounds(trip, loop, over, reference)
        return seen[key]

    def numbers(loop: Block, late: bool, over: Ranges = over) -> dict[str, float]:
        met = met_by(loop, over)
        if part.kind == "eppfc":  # its funnel is its tube
            width = max(_number(loop, f"law.{k}") for k in ("delta_l", "delta_u"))
            width *= _number(loop, "law.eta_inf") * over.speed
            own = replace(over, tube=over.tube * width / met.tube)
            met = met_by(loop, own)
            found = _funnel(loop, met, over.speed, trip.vehicle.mode == "drive")
        elif isinstance(part, OwnLaw):
            found = as_reaching(trip, part, loop, met, over.speed)
        else:
            found = dict(NUMBERS[part.kind](loop, met))
        if "T" in found:  # the plant has a shorter tick
            found["T"] = sample_time(trip, part)
        if late:
            found |= {k: v for k, v in ((lag, lags(loop)), (dead, waits)) if k and v}
        return found

    def costs(loop: Block, late: bool) -> dict[str, float]:
        whole = numbers(loop, late)[bound]
        halves = over.halved()
        if part.kind == "eppfc":
            halves.pop("tube")
        return {k: numbers(loop, late, half)[bound] / whole for k, half in halves.items()}

    def lags(loop: Block) -> float:
        if isinstance(trip.actuator, Lag):
            return float(np.max(loop.values_by_place()["tau"])) / part.lead
        return trip.actuator.longest_lag / part.lead

    waits = trip.actuator.dead_time
    why = _words(trip, over, left, reference, part.kind) if bound else "no disturbance"
    delay = "lag and dead time of the actuator" if dead else "lag of the actuator"
    if waits and lag and not dead:
        delay += ", its dead time left out"
    if not isinstance(trip.actuator, Lag):
        delay += ", a valve taken as the slower of its lags"
    rows = [("", True, f"{why}; {delay}")] if lag else []
    rows.append(("_prompt" if lag else "", False, f"{why}; an actuator that is never late"))
    return [
        Gains(name + end, name, system, partial(numbers, late=late), said, "",
              f"{trip.title}", partial(costs, late=late) if bound else None)
        for end, late, said in rows
    ]  # fmt: skip


def _words(trip: Trip, over: Ranges, left: tuple[str, ...], reference: Reference, kind: str) -> str:
    goal = "best one of each rail condition" if isinstance(reference, Searched) else "reference"
    where = f"within {over.tube:.0%} of the {goal}"
    if kind == "eppfc":
        where = f"in the steady funnel about the {goal}"
    rows = [
        f"slips {where}, at {3.6 * over.speed:.4g} km/h, by interval arithmetic on the equations"
        " of the vehicle",
        f"the fitted adhesion is wrong by {trip.certify.error:.0%} at most"
        if isinstance(reference, Searched) else "the adhesion is measured over a window",
        "a reference and rails that do not change",
    ]  # fmt: skip
    drawn = [*over.numbers, *over.scale]
    if kind == "file":
        rows.append(
            "the law taken as linear, with the mean of its slopes by v_s in the tube. What else it"
            " does there counts as disturbance. The limits of the torque are left out"
        )
    if drawn:
        rows.append(f"over the ensemble's {', '.join(drawn)}")
    if left:
        rows.append(f"not over its {', '.join(left)}")
    return "; ".join(rows)


def _reasons(trip: Trip) -> dict[str, str]:
    """Why a controller has no certificate, by its name."""
    kinds = {n: getattr(part, "kind", "") for n, part in trip.controllers.items()}
    own = {n: why_not(trip, part) for n, part in trip.controllers.items()
           if isinstance(part, OwnLaw)}  # fmt: skip
    return {n: NONE[k] for n, k in kinds.items() if k in NONE} | {n: w for n, w in own.items() if w}
