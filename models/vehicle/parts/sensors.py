"""What is measured."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import MISSING, dataclass
from typing import Literal

from slipctl.models.vehicle.parts.declaration import Fault, Part, number, text_field


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
    jitter: float = number("s", 2e-6, "jitter of an edge, standard deviation", lo=0, hi=1e-3)


@dataclass(frozen=True, kw_only=True)
class NoisyWheel(Part):
    """Wheel speed with noise, steps and lost samples."""

    kind: Literal["noisy"] = "noisy"
    deviation: float = number("rad/s", 0.0, "standard deviation of the noise", lo=0, hi=100)
    step: float = number("rad/s", 0.0, "step of the quantisation; 0: none", lo=0, hi=100)
    dropout: float = number("1", 0.0, "share of lost samples; the last one is held", lo=0, hi=0.99)


@dataclass(frozen=True, kw_only=True)
class NoisySpeed(Part):
    """Vehicle speed with noise, steps and lost samples, as of a radar."""

    kind: Literal["noisy"] = "noisy"
    deviation: float = number("m/s", 0.0, "standard deviation of the noise", lo=0, hi=10)
    step: float = number("m/s", 0.0, "step of the quantisation; 0: none", lo=0, hi=10)
    dropout: float = number("1", 0.0, "share of lost samples; the last one is held", lo=0, hi=0.99)


FOLLOWS = "; none given: 1.2 times what demand, brakes and gradient give, at least 1.5"
"""Where the largest change of the vehicle's speed comes from."""


@dataclass(frozen=True, kw_only=True)
class WheelsOnly(Part):
    """Vehicle speed from the wheels alone: the axle that slips least, within a largest rate."""

    kind: Literal["wheels"] = "wheels"
    rate: float | None = number(
        "m/s^2",
        None,
        f"largest rate at which the vehicle can change its speed{FOLLOWS}",
        lo=0.01,
        hi=10,
    )
    margin: float = number("1", 0.15, "relative error of the torques", lo=0, hi=1)
    beside: float | None = number(
        "m/s^2",
        None,
        "largest acceleration by gradient and resistance, beside the torques; none given: that of"
        " the track and of the vehicle at its first speed, at least 0.15",
        lo=0,
        hi=5,
    )


@dataclass(frozen=True, kw_only=True)
class LargestWheel(Part):
    """Vehicle speed of classical slide protection: the fastest wheel, a largest deceleration."""

    kind: Literal["largest_wheel"] = "largest_wheel"
    rate: float | None = number(
        "m/s^2", None, f"largest deceleration of the vehicle{FOLLOWS}", lo=0.01, hi=10
    )


@dataclass(frozen=True, kw_only=True)
class Fused(Part):
    """Vehicle speed from all wheels and the accelerometer, by a Kalman filter."""

    kind: Literal["fused"] = "fused"
    spread: float = number(
        "m/s^2",
        0.05,
        "standard deviation of the accelerometer's bias and the slope together",
        lo=1e-4,
        hi=2,
    )
    wander: float = number(
        "m/s^2", 1e-3, "change of that sum within a second, standard deviation", lo=0, hi=2
    )


@dataclass(frozen=True, kw_only=True)
class Accelerometer(Part):
    """Acceleration along the track, as an accelerometer on the vehicle reads it."""

    bias: float = number("m/s^2", 0.0, "constant error", lo=-5, hi=5)
    deviation: float = number("m/s^2", 0.0, "standard deviation of the noise", lo=0, hi=10)
    gradient: bool = text_field(True, "whether it measures the gradient of the track too")


@dataclass(frozen=True, kw_only=True)
class SensorFault(Part):
    """A wheel sensor that fails from a time on."""

    axle: int = number("1", MISSING, "number of the axle, 1 the first", lo=1, hi=32)
    kind: Literal["frozen", "missing", "jumps"] = text_field(
        "frozen",
        (
            "'frozen' at its last value, 'missing' pulses (it reads 0), or 'jumps' by a"
            " share of the speed"
        ),
    )
    time: float = number("s", 0.0, "time from which the sensor fails", lo=0, hi=1e5)
    share: float = number(
        "1", 0.5, "share by which a sensor that jumps reads too much", lo=-1, hi=10
    )


@dataclass(frozen=True, kw_only=True)
class Sensors(Part):
    """What the controllers measure."""

    wheel_speed: Exact | ToothWheel | NoisyWheel = text_field(ToothWheel(), "speed of each axle")
    vehicle_speed: Exact | NoisySpeed | WheelsOnly | LargestWheel | Fused = text_field(
        Exact(), "speed of the vehicle"
    )
    accelerometer: Accelerometer | None = text_field(None, "accelerometer; none: there is none")
    faults: tuple[SensorFault, ...] = text_field((), "wheel sensors that fail")

    @property
    def of_wheels(self) -> bool:
        """Whether the speed of the vehicle is made of its wheels."""
        return isinstance(self.vehicle_speed, WheelsOnly | LargestWheel | Fused)

    def misfits(self) -> Iterator[Fault]:
        """A filter without its accelerometer, and the other way round."""
        fused = isinstance(self.vehicle_speed, Fused)
        if fused and self.accelerometer is None:
            yield "vehicle_speed", "kind = 'fused' needs an accelerometer; write accelerometer = {}"
        if self.accelerometer is not None and not fused:
            yield (
                "accelerometer",
                "no estimator uses it; write vehicle_speed = { kind = 'fused' }",
            )
