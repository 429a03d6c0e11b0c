"""What ``slipctl certify metro.toml:pid`` asks: controllers as they run, behind lag and dead time.

A controller that cancels no adhesion, a PID, is asked about with its own block and a short axle
(``axle_tick``). One certificate for each rail on which slip control rules: where the adhesion at
the goal carries less than what the actuator gives and the demand asks for. Over the mass and the
height of the curve that the ensemble draws; what it draws beside is named.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np

from slipctl import BadInput, Block, Gains
from slipctl.analysis.bounds import enclosure
from slipctl.certify.cells.mode_cells import ModeLoop
from slipctl.certify.systems import System
from slipctl.models.vehicle.adhesion import layer_law, peak_of_layer, rail_law
from slipctl.models.vehicle.air.valve_control import slide_protection
from slipctl.models.vehicle.certificate import gains as bounds
from slipctl.models.vehicle.certificate.air_tick import AirAxle, air_loop
from slipctl.models.vehicle.certificate.axle_kind import axle_system
from slipctl.models.vehicle.certificate.axle_tick import AxleTick, gain_of, loop_law, short_curve
from slipctl.models.vehicle.certificate.own_gains import why_not
from slipctl.models.vehicle.certificate.slide_kind import slide_system
from slipctl.models.vehicle.certificate.slide_tick import SlideTick
from slipctl.models.vehicle.control import slip_law, wheel
from slipctl.models.vehicle.parts import (
    Air,
    Constant,
    Controller,
    Lag,
    OwnLaw,
    SlideProtection,
    SlipLaw,
    Trip,
)
from slipctl.models.vehicle.slip.own_law import sample_time
from slipctl.study.declaration import Certificates

NO_RAIL = (
    "on every rail of the file the demand or the actuator gives less than the adhesion carries, so"
    " slip control never rules at rest"
)

NONE = Certificates((), {})

KINDS = ("pid",)
"""Slip laws that are asked as they run."""


def is_asked(trip: Trip, part: Controller) -> bool:
    """Whether a controller is asked as it runs: a PID, or a law of one's own with states."""
    if isinstance(part, SlideProtection):
        return isinstance(trip.actuator, Air)
    if isinstance(part, OwnLaw) and isinstance(trip.actuator, Air):
        return False
    if isinstance(part, OwnLaw):
        block, _ = slip_law(trip, part, wheel(trip, part.reference))
        return bool(block.states) and bool(why_not(trip, part))
    return isinstance(part, SlipLaw) and part.kind in KINDS


def has_modes(trip: Trip, part: SlipLaw | OwnLaw) -> bool:
    """Whether a controller jumps: it has states that are whole numbers, or goes to no set slip.

    A slide protection asks where the slip is, and has no rest that a smooth loop has.
    """
    if not isinstance(part, OwnLaw):
        return False
    block, _ = slip_law(trip, part, wheel(trip, part.reference))
    if any(s.unit == "enum" for s in block.states.values()):
        return True
    return bool(block.states) and not {"v_best", "D", "F"} & {
        n.rpartition(".")[2] for n in block.inputs
    }


def certificates(
    trip: Trip, otherwise: Certificates = NONE, of: tuple[type, ...] = (SlipLaw, OwnLaw)
) -> Certificates:
    """Certificates of a trip, with those of the controllers that are asked as they run.

    Args:
        trip: the trip.
        otherwise: certificates of the other controllers.
        of: kinds of controllers.
    """
    found, why = list(otherwise.gains), dict(otherwise.uncertified)
    for name, part in trip.controllers.items():
        if not isinstance(part, of) or not is_asked(trip, part):
            continue
        some, why[name] = _on_rails(trip, part)  # type: ignore[arg-type]
        if some:
            del why[name]
        for one in some:
            own = name if len(some) == 1 else f"{name}_{one.rail}"
            found.append(Gains(own, name, one.asked_as, one.numbers, one.words(), "",
                               trip.title, made=one.system))  # fmt: skip
    return Certificates(tuple(found), why)


def _on_rails(
    trip: Trip, part: SlipLaw | OwnLaw | SlideProtection
) -> tuple[Sequence[_Asked | _AskedValves], str]:
    """A controller on each rail on which slip control rules at its goal; else why on none.

    What an ensemble draws may leave the range of a law. That is the draw's, which is refused when
    it is run; no run is refused for a certificate that nobody asked for.
    """
    if isinstance(part, SlideProtection):
        why = _beside_valves(trip)
        return ([], why) if why else ([_AskedValves(trip, part)], "")
    kind = _AskedModes if has_modes(trip, part) else _Asked
    try:
        law = rail_law(trip)
        some = [one for rail in law.conditions if (one := kind(trip, part, rail, law)).rules()]
    except BadInput as error:
        if trip.ensemble is None:
            raise
        return [], f"[ensemble] draws what the rail's law does not know: {error}"
    return some, NO_RAIL


class _Asked:
    """One certificate: a controller on one rail."""

    asked_as = "axle_loop"

    def __init__(self, trip: Trip, part: SlipLaw | OwnLaw, rail: str, law: Block) -> None:
        self.trip, self.part, self.rail, self.law = trip, part, rail, law
        own = {k: float(p.value) for k, p in self.law.params.items() if not p.derived}
        self.curve = own | {k: float(v) for k, v in self.law.conditions[rail].items()}
        self.over, self.left = bounds.ranges(trip)
        self.reference = part.reference or trip.reference
        self.goal = bounds._goal(self.law, rail, self.curve, self.over.speed, self.reference)
        vehicle = trip.vehicle
        falls = bounds.falling.with_params(n=vehicle.axles, n_w=len(vehicle.worked))
        self.falls = short_curve(falls, self.law)

    def _given(self, m: float, J: float, r: float, g: float) -> dict[str, float]:
        """Numbers of the curve and of the wheel."""
        wheel_ = {"fall.m": m, "fall.J": J, "fall.r": r, "fall.g": g}
        return {f"adh.{k}": v for k, v in self.curve.items()} | wheel_

    def _at_goal(self, **numbers: float) -> float:
        """What the slip falls by at the goal, in m/s^2."""
        inputs = {"v_s": self.goal, "v": self.over.speed}
        given = {k: v for k, v in inputs.items() if k in self.falls.inputs}
        return float(self.falls(**given, **self._given(**numbers))["D"])

    def _nominal(self) -> dict[str, float]:
        w = wheel(self.trip, self.part.reference)
        return {"m": self.trip.vehicle.total, "J": w.J, "r": w.r, "g": w.g}

    def _heights(self, numbers: Mapping[str, float]) -> tuple[float, float]:
        """Least and largest height of the curve over that of the numbers, by mass and peak."""
        masses = self.over.numbers.get("m", (numbers["m"],) * 2)
        ends = [self.over.scale[names[0]] for names in self._height_draws]
        peaks = [float(np.prod([e[k] for e in ends])) for k in (0, 1)]
        now = self._at_goal(**numbers)
        if not now:  # no adhesion at the goal: none of its height
            return 1.0, 1.0
        by_mass = [self._at_goal(**{**numbers, "m": m}) / now for m in masses]
        return min(by_mass) * min(peaks), max(by_mass) * max(peaks)

    @cached_property
    def _height_draws(self) -> list[tuple[str, ...]]:
        """Parameters that are drawn together and multiply the whole curve."""
        slips = self.goal * np.linspace(0.25, 4.0, 16)

        def curve(values: Mapping[str, float]) -> np.ndarray:
            given = {f"adh.{k}": v for k, v in values.items()}
            rest = {k: x for k, x in self._given(**self._nominal()).items() if k not in given}
            u = {"v": self.over.speed} if "v" in self.falls.inputs else {}
            return np.array([float(self.falls(v_s=s, **u, **given, **rest)["D"]) for s in slips])

        def multiplies(names: tuple[str, ...]) -> bool:
            for by in self.over.scale[names[0]]:
                scaled = curve({k: v * by if k in names else v for k, v in self.curve.items()})
                if not np.allclose(scaled, by * now, rtol=1e-9, atol=0):
                    return False
            return True

        now = curve(self.curve)
        return [names for names in self.over.together if multiplies(names)]

    def rules(self) -> bool:
        """Whether the adhesion at the goal carries less than actuator and demand give."""
        n = self._nominal()
        torque = self._at_goal(**n) * self._heights(n)[1] * n["J"] / n["r"]
        return torque < min(self.trip.actuator.torque, _demand(self.trip, n))

    def numbers(self, loop: Block) -> dict[str, float]:
        """Numbers of an ``axle_loop``."""
        now = loop.values_by_place()
        n = bounds._wheel(loop)
        least, most = self._heights(n)
        assumed, act = self.trip.certify, self.trip.actuator
        lag = float(np.max(now["tau"])) if isinstance(act, Lag) else act.longest_lag
        law = loop_law(self.trip, self.part, loop)
        gain = gain_of(law)
        force = self._at_goal(**n) * most / (n["r"] ** 2 / n["J"] + len(
            self.trip.vehicle.worked) / n["m"])  # fmt: skip
        found = {
            "W": assumed.push + self._others(n) * most, "noise": assumed.noise,
            "force": assumed.error * force if hears_force(law) else 0.0,
            "lag": lag, "dead": act.dead_time, "T": sample_time(self.trip, self.part),
            "v": self.over.speed, "least": least, "most": most, "goal": self.goal,
            "band": assumed.tube * self.goal, "off": assumed.off,
        }  # fmt: skip
        found |= {"time": assumed.time} if assumed.time is not None else {}
        return found | ({"K": float(np.max(law.param_values()[gain]))} if gain else {})

    def _others(self, n: Mapping[str, float]) -> float:
        """What the other axles push, anywhere in their tubes, at height 1."""
        share = len(self.trip.vehicle.worked) / n["m"]
        share /= n["r"] ** 2 / n["J"] + share
        tube = (self.goal * (1 - self.over.tube), self.goal * (1 + self.over.tube))
        given = {**self._given(**n), "v": self.over.speed}
        low, high = enclosure(self.falls, "D", {"v_s": tube}, bounds.COARSE, **given)
        return share * (high - low)

    def system(self, loop: Block) -> System:
        """System of the loop."""
        n = bounds._wheel(loop)
        steady, _ = bounds._resistance(self.trip, self.over.speed, n["m"], 0.0)
        tick = AxleTick(self.trip, self.part, loop, self.falls, self._given(**n), self.goal, steady)
        return axle_system(tick.build)

    def words(self) -> str:
        """Where the bounds are from."""
        rows = [f"rail {self.rail}, at {3.6 * self.over.speed:.4g} km/h; a push of"
                f" {self.trip.certify.push:g} m/s^2 ([certify] push), and what the other axles do"
                f" within {self.over.tube:.0%} of the goal"]  # fmt: skip
        if not isinstance(self.trip.actuator, Lag):
            rows.append("a valve taken as the slower of its lags")
        drawn = [k for k in ("m",) if k in self.over.numbers]
        drawn += [k for names in self._height_draws for k in names]
        if drawn:
            rows.append(f"over the ensemble's {', '.join(drawn)}")
        other = [*self.left, *(k for k in (*self.over.numbers, *self.over.scale) if k not in drawn)]
        if other:
            rows.append(f"not over its {', '.join(other)}")
        return "; ".join(rows)


class _AskedModes(_Asked):
    """One certificate of a controller with modes, on one rail."""

    asked_as = "slide_loop"

    def numbers(self, loop: Block) -> dict[str, float]:
        """Numbers of a ``slide_loop``."""
        n, assumed = bounds._wheel(loop), self.trip.certify
        least, most = self._heights(n)
        now = loop.values_by_place()
        top = float(np.max(now.get("ctl.apply.T_max", self.trip.actuator.torque)))
        return {
            "W": assumed.push + self._others(n) * most, "noise": assumed.noise,
            "dead": self.trip.actuator.dead_time, "T": sample_time(self.trip, self.part),
            "least": least, "most": most, "v": self.over.speed,
            "demand": min(_demand(self.trip, n), top),
            "band": self.over.speed if assumed.slip is None else assumed.slip,
        }  # fmt: skip

    def system(self, loop: Block) -> System:
        """System of the loop."""
        n = bounds._wheel(loop)
        steady, _ = bounds._resistance(self.trip, self.over.speed, n["m"], 0.0)
        given = self._given(**n)
        tick = SlideTick(self.trip, self.part, loop, self.falls, given, self.goal, steady)
        made: dict[tuple[object, ...], object] = {}

        def build(numbers: Mapping[str, object]) -> ModeLoop:
            key = tuple(numbers.get(k) for k in ("T", "dead", "v", "demand", "W", "noise", "least",
                                                 "most"))  # fmt: skip
            if key not in made:
                made[key] = tick.loop(numbers)
            return made[key]  # type: ignore[return-value]

        return slide_system(build)

    def words(self) -> str:
        """Where the bounds are from."""
        asked = (
            ""
            if self.trip.certify.slip is not None
            else ("; asked is that no wheel locks, [certify] slip asks for less")
        )
        return super().words().replace("; a valve taken as the slower of its lags", "") + asked


def _demand(trip: Trip, n: Mapping[str, float]) -> float:
    """Torque of an axle that a constant demand asks for; of any other one no limit."""
    part, many = trip.demand, len(trip.vehicle.worked)
    if not isinstance(part, Constant):
        return float("inf")
    if part.force is not None:
        return part.force * n["r"] / many
    level = part.deceleration if part.acceleration is None else part.acceleration
    assert level is not None
    return n["r"] * n["m"] * level / many + n["J"] * level / n["r"]


def _beside_valves(trip: Trip) -> str:
    """What a vehicle has that the proof behind two valves does not take; empty if nothing."""
    vehicle = trip.vehicle
    if any(vehicle.each_pads):
        return (
            "the friction of its pads changes, and the proof takes a torque by the pressure alone"
        )
    if any(vehicle.moved):
        return "load moves between its axles; leave out height to ask without that"
    return ""


S_1 = 0.1
"""Slip in m/s from which a slide protection is asked with the least adhesion of the rail."""


class _AskedValves:
    """One certificate of a slide protection behind the valves of an air brake, on all rails.

    The adhesion is anywhere between the least and the largest one that any rail, layer and load has
    at any slip beyond ``S_1``.
    """

    asked_as, rail = "slide_loop", "any"

    def __init__(self, trip: Trip, part: SlideProtection) -> None:
        self.trip, self.part = trip, part
        self.over, self.left = bounds.ranges(trip)
        self._seen: dict[tuple[tuple[str, float], ...], tuple[float, float]] = {}

    def _masses(self, n: Mapping[str, float]) -> tuple[float, float]:
        return self.over.numbers.get("m", (n["m"],) * 2)

    def _falls(self, n: Mapping[str, float]) -> tuple[float, float]:
        """What the slip falls by, least and most in m/s^2; it does not depend on the machine."""
        key = tuple(sorted(n.items()))
        if key not in self._seen:
            self._seen[key] = self._enclosed(n)
        return self._seen[key]

    def _enclosed(self, n: Mapping[str, float]) -> tuple[float, float]:
        trip, ends = self.trip, []
        vehicle, layer, law = trip.vehicle, trip.rail.contamination, rail_law(trip)
        curves = [(law.with_params(**{k: float(v) for k, v in values.items()}), 1.0)
                  for values in law.conditions.values()]  # fmt: skip
        if layer is not None:
            own = layer_law(trip, layer)
            peak = peak_of_layer(own, vehicle.speed)
            told = [layer.peak if p.peak is None else p.peak for p in layer.places] or [layer.peak]
            drawn = trip.ensemble.patches if trip.ensemble else None
            told += list(drawn.peak) if drawn else []
            curves += [(own, 1.0 if x is None else x / peak) for x in told]
        base = bounds.falling.with_params(n=vehicle.axles, n_w=len(vehicle.worked))
        for curve, height in curves:
            block = short_curve(base, curve)
            at = {"v": self.over.speed} if "v" in block.inputs else {}
            for m in self._masses(n):
                given = {f"fall.{k}": {**n, "m": m}[k] for k in ("m", "J", "r", "g")}
                slips = (S_1, self.over.speed)
                low, high = enclosure(block, "D", {"v_s": slips}, bounds.COARSE, **at, **given)
                alone = (n["r"] ** 2 / n["J"] + 1 / m) / (n["r"] ** 2 / n["J"] + vehicle.axles / m)
                ends.append((low * height * alone, high * height))
        scales = np.prod([[*self.over.scale[k[0]]] for k in self.over.together], axis=0)
        low, high = min(a for a, _ in ends), max(b for _, b in ends)
        loads = np.array(vehicle.carried) / np.mean(vehicle.carried)
        return float(low * np.min(scales) * loads.min()), float(high * np.max(scales) * loads.max())

    def numbers(self, loop: Block) -> dict[str, float]:
        """Numbers of a ``slide_loop``; the curve of height 1 carries the most at every slip."""
        n, trip = bounds._wheel(loop), self.trip
        assumed, act = trip.certify, trip.actuator
        assert isinstance(act, Air)
        least, most = self._falls(n)
        lightest, heaviest = self._masses(n)
        steady = bounds._resistance(trip, self.over.speed, lightest, 0.0)[0]
        weighed = max(1.0, (act.weighed or 0.0) / lightest)
        return {
            "W": assumed.push + steady, "noise": assumed.noise, "dead": act.dead_time,
            "T": trip.control.period, "least": least / most, "most": 1.0, "v": self.over.speed,
            "demand": min(_demand(trip, {**n, "m": heaviest}) * weighed, act.torque),
            "band": self.over.speed if assumed.slip is None else assumed.slip,
        }  # fmt: skip

    def system(self, loop: Block) -> System:
        """System of the loop."""
        n, trip, act = bounds._wheel(loop), self.trip, self.trip.actuator
        assert isinstance(act, Air)
        now = loop.values_by_place()
        machine = slide_protection(trip, self.part, wheel(trip))[0]["machine"]
        own = {k: float(np.max(now.get(f"ctl.machine.{k}", machine.param_values()[k])))
               for k in machine.params}  # fmt: skip
        machine = machine.with_params(**own)
        T_f = float(np.max(now.get("ctl.rim.T_f", self.part.filter)))
        axle = AirAxle(n["r"] / n["J"], T_f, S_1, self._falls(n)[1], act)
        made: dict[tuple[object, ...], ModeLoop] = {}

        def build(numbers: Mapping[str, object]) -> ModeLoop:
            key = tuple(sorted((k, v) for k, v in numbers.items() if k != "band"))
            if key not in made:
                made[key] = air_loop(machine, axle, numbers)
            return made[key]

        return slide_system(build)

    def words(self) -> str:
        """Where the bounds are from."""
        said = (f"at {3.6 * self.over.speed:.4g} km/h; a curve of height 1 is the largest adhesion"
                f" of any rail of the file. From a slip of {S_1:g} m/s on it carries at least"
                " what the worst rail, layer and load do. Beside that: resistance, gradient and"
                f" a push of {self.trip.certify.push:g} m/s^2 ([certify] push)")  # fmt: skip
        asked = "" if self.trip.certify.slip is not None else (
            "; asked is that no wheel locks, [certify] slip asks for less")  # fmt: skip
        return said + asked


def hears_force(law: Block) -> bool:
    """Whether a law hears the adhesion force that it is told."""
    return any(n.rpartition(".")[2] in ("F", "D") for n in law.inputs)
