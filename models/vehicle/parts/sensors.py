"""What is measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from slipctl.models.vehicle.parts.declaration import Part, number, text_field


@dataclass(frozen=True, kw_only=True)
class Exact(Part):
    """The true value."""

    kind: Literal["exact"] = "exact"


@dataclass(frozen=True, kw_only=True)
class ToothWheel(Part):
    """Wheel speed from the time between the edges of a tooth wheel."""

    kind: Literal["tooth_wheel"] = "tooth_wheel"
    teeth: int = number("1", 100, "teeth", lo=1, hi=1000)
    clock: float = number("s", 1e-6, "resolution of the timer", lo=1e-9, hi=1e-3)
    jitter: float = number("s", 2e-6, "of an edge, standard deviation", lo=0, hi=1e-3)


@dataclass(frozen=True, kw_only=True)
class NoisyWheel(Part):
    """Wheel speed with noise, steps and lost samples."""

    kind: Literal["noisy"] = "noisy"
    deviation: float = number("rad/s", 0.0, "of the noise", lo=0, hi=100)
    step: float = number("rad/s", 0.0, "of the quantisation; 0 has none", lo=0, hi=100)
    dropout: float = number("1", 0.0, "share of lost samples; the last one is held", lo=0, hi=0.99)


@dataclass(frozen=True, kw_only=True)
class NoisySpeed(Part):
    """Vehicle speed with noise, steps and lost samples, as of a radar."""

    kind: Literal["noisy"] = "noisy"
    deviation: float = number("m/s", 0.0, "of the noise", lo=0, hi=10)
    step: float = number("m/s", 0.0, "of the quantisation; 0 has none", lo=0, hi=10)
    dropout: float = number("1", 0.0, "share of lost samples; the last one is held", lo=0, hi=0.99)


@dataclass(frozen=True, kw_only=True)
class WheelsOnly(Part):
    """Vehicle speed from the wheels alone: the axle that slips least, within a largest rate."""

    kind: Literal["wheels"] = "wheels"
    rate: float = number("m/s^2", 1.5, "most that the vehicle can change its speed", lo=0.01, hi=10)
    margin: float = number("1", 0.15, "share by which the torques may be wrong", lo=0, hi=1)
    beside: float = number(
        "m/s^2", 0.15, "what gradient and resistance may do beside the torques", lo=0, hi=5
    )


@dataclass(frozen=True, kw_only=True)
class Sensors(Part):
    """What the controllers measure."""

    wheel_speed: Exact | ToothWheel | NoisyWheel = text_field(ToothWheel(), "speed of each axle")
    vehicle_speed: Exact | NoisySpeed | WheelsOnly = text_field(Exact(), "speed of the vehicle")
