"""Brakes beside the actuators of the axles: magnets on the rails, motors of the axles."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import MISSING, dataclass

from slipctl.models.vehicle.parts.declaration import Fault, Part, faults_off_ticks, number


@dataclass(frozen=True, kw_only=True)
class TrackBrake(Part):
    """Magnets that are lowered on the rails and rub along: they need no adhesion of the wheels."""

    attraction: float = number(
        "N", MISSING, "attraction of all magnets to both rails", lo=1, hi=1e7
    )
    friction: float = number(
        "1", 0.2, "friction of a magnet on the rail at low speed", lo=1e-3, hi=1
    )
    fall: float = number(
        "s/m", 0.03, "fall of the friction with speed, mu = friction/(1 + fall v)", lo=0, hi=1
    )
    delay: float = number(
        "s", 1.0, "time from the start until the magnets lie on the rails", lo=0, hi=60
    )
    above: float = number("m/s", 20 / 3.6, "speed below which they are lifted", lo=0.5, hi=50)

    def misfits(self) -> Iterator[Fault]:
        """A delay that would be rounded."""
        yield from faults_off_ticks("delay", self.delay)


@dataclass(frozen=True, kw_only=True)
class DynamicBrake(Part):
    """Motors that brake their axles first; the actuator of an axle gives what they leave."""

    torque: float = number("N m", MISSING, "largest torque of one axle", lo=1, hi=1e6)
    power: float | None = number(
        "W", None, "largest power of one axle; none given: no limit", lo=1, hi=1e8
    )
    axles: tuple[int, ...] | None = number(
        "1", None, "numbers of the axles that have it, 1 the first; none given: all", lo=1, hi=32
    )
    lag: float = number("s", 0.1, "time constant", lo=1e-3, hi=5)
    fades_from: float = number(
        "m/s", 10 / 3.6, "rim speed below which the motors' brake fades", lo=0, hi=50
    )
    fades_to: float = number(
        "m/s", 3 / 3.6, "rim speed at which the motors' brake is gone", lo=0, hi=50
    )
    pause: float = number(
        "s", 3.0, "time for which it stays off an axle whose valves held or vented", lo=0, hi=600
    )
    lost: float | None = number(
        "s", None, "time of the run at which it fails; none given: it does not", lo=0, hi=1e5
    )

    def misfits(self) -> Iterator[Fault]:
        """A fade that rises, an axle named twice, times off the tick."""
        if self.fades_to >= self.fades_from:
            yield "fades_to", f"must be below fades_from, {self.fades_from:g} m/s"
        if self.axles is not None and (not self.axles or len(set(self.axles)) < len(self.axles)):
            yield "axles", "must name each axle with a motor once"
        for name in ("pause", "lost"):
            yield from faults_off_ticks(name, getattr(self, name) or 0.0)
