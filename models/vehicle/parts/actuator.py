"""What turns or brakes an axle."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import MISSING, dataclass
from typing import Literal

from slipctl.models.vehicle.parts.declaration import Fault, Part, faults_off_ticks, number


@dataclass(frozen=True, kw_only=True)
class Lag(Part):
    """Actuator of an axle: limits and a first-order lag, behind a dead time."""

    kind: Literal["lag"] = "lag"
    torque: float = number("N m", MISSING, "largest torque of one axle", lo=1, hi=1e6)
    lag: float = number("s", 0.05, "time constant", lo=1e-3, hi=5)
    gain: float = number("1", 1.0, "delivered by commanded torque", lo=0.1, hi=10)
    rate: float | None = number("N m/s", None, "largest rate of the torque", lo=1, hi=1e9)
    dead_time: float = number("s", 0.0, "from command to action", lo=0, hi=2)
    power: float | None = number(
        "W", None, "largest of one axle: its torque is at most that over the wheel speed",
        lo=1, hi=1e8,
    )  # fmt: skip
    top: float | None = number(
        "m/s", None, "rim speed above which it gives no torque", lo=0.1, hi=200
    )

    def misfits(self) -> Iterator[Fault]:
        """A dead time that is no whole number of ticks."""
        yield from faults_off_ticks("dead_time", self.dead_time)


@dataclass(frozen=True, kw_only=True)
class Valve(Part):
    """Air brake of an axle: a valve fills, holds or vents the cylinder, behind a dead time."""

    kind: Literal["valve"] = "valve"
    torque: float = number("N m", MISSING, "torque of one axle at full pressure", lo=1, hi=6e5)
    fill: float = number("s", 0.15, "time constant towards the supply", lo=1e-3, hi=5)
    vent: float = number("s", 0.10, "time constant towards the air", lo=1e-3, hi=5)
    band: float = number("1", 0.005, "pressure error that it holds at, of the full pressure",
                         lo=0, hi=0.5)  # fmt: skip
    dead_time: float = number("s", 0.0, "from command to action", lo=0, hi=2)

    def misfits(self) -> Iterator[Fault]:
        """A dead time that is no whole number of ticks."""
        yield from faults_off_ticks("dead_time", self.dead_time)


Actuator = Lag | Valve
"""Kinds of actuators that a file may name."""
