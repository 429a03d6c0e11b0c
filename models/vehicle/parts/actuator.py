"""What turns or brakes an axle."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import MISSING, dataclass
from typing import Literal

from slipctl.models.vehicle.air.pneumatics import ATMOSPHERE, rate_of_choke
from slipctl.models.vehicle.parts.declaration import Fault, Part, faults_off_ticks, number


@dataclass(frozen=True, kw_only=True)
class Lag(Part):
    """Actuator of an axle: limits and a first-order lag, behind a dead time."""

    kind: Literal["lag"] = "lag"
    torque: float = number("N m", MISSING, "largest torque of one axle", lo=1, hi=1e6)
    lag: float = number("s", 0.05, "time constant", lo=1e-3, hi=5)
    gain: float = number("1", 1.0, "delivered torque over commanded torque", lo=0.1, hi=10)
    rate: float | None = number("N m/s", None, "largest rate of the torque", lo=1, hi=1e9)
    dead_time: float = number(
        "s", 0.0, "delay from the command until the torque begins to change", lo=0, hi=2
    )
    power: float | None = number(
        "W",
        None,
        "largest power of one axle; it limits the torque to the power over the wheel speed",
        lo=1,
        hi=1e8,
    )
    top: float | None = number(
        "m/s", None, "rim speed above which it gives no torque", lo=0.1, hi=200
    )

    def misfits(self) -> Iterator[Fault]:
        """A dead time that is no whole number of ticks."""
        yield from faults_off_ticks("dead_time", self.dead_time)

    @property
    def usual_lag(self) -> float:
        """Time constant in s that a law is made for."""
        return self.lag

    @property
    def longest_lag(self) -> float:
        """Largest time constant in s."""
        return self.lag


@dataclass(frozen=True, kw_only=True)
class Valve(Part):
    """Air brake of an axle: a valve fills, holds or vents the cylinder, behind a dead time."""

    kind: Literal["valve"] = "valve"
    torque: float = number("N m", MISSING, "torque of one axle at full pressure", lo=1, hi=6e5)
    fill: float = number("s", 0.15, "time constant of filling", lo=1e-3, hi=5)
    vent: float = number("s", 0.10, "time constant of venting", lo=1e-3, hi=5)
    band: float = number(
        "1",
        0.005,
        "pressure error below which the valve holds, as a share of the full pressure",
        lo=0,
        hi=0.5,
    )
    dead_time: float = number(
        "s", 0.0, "delay from the command until the torque begins to change", lo=0, hi=2
    )

    def misfits(self) -> Iterator[Fault]:
        """A dead time that is no whole number of ticks."""
        yield from faults_off_ticks("dead_time", self.dead_time)

    @property
    def usual_lag(self) -> float:
        """Time constant in s that a law is made for."""
        return (self.fill + self.vent) / 2

    @property
    def longest_lag(self) -> float:
        """Largest time constant in s."""
        return max(self.fill, self.vent)


@dataclass(frozen=True, kw_only=True)
class Air(Part):
    """Air brake of an axle: a cylinder behind chokes, filled, held or vented by two valve bits."""

    kind: Literal["air"] = "air"
    torque: float = number("N m", MISSING, "torque of one axle at the full pressure", lo=1, hi=1e6)
    pressure: float = number("Pa", 3.8e5, "full pressure of the cylinder, gauge", lo=1e4, hi=2e6)
    supply: float = number("Pa", 5e5, "supply pressure behind the regulator, gauge", lo=1e4, hi=2e6)
    volume: float = number("m^3", 4e-3, "volume of the cylinder", lo=1e-5, hi=0.1)
    fill: float = number("m", 4e-3, "diameter of the choke that fills", lo=2e-4, hi=0.05)
    vent: float = number("m", 8e-3, "diameter of the choke that vents", lo=2e-4, hi=0.05)
    discharge: float = number("1", 0.7, "discharge coefficient of both chokes", lo=0.1, hi=1)
    air: float = number("K", 293.0, "temperature of the air", lo=200, hi=350)
    fill_rate: float | None = number(
        "1/s",
        None,
        (
            "rate constant of filling: dp/dt over the pressure upstream of the choke,"
            " instead of its diameter"
        ),
        lo=1e-3,
        hi=200,
    )
    vent_rate: float | None = number(
        "1/s",
        None,
        "rate constant of venting, instead of the diameter of the choke",
        lo=1e-3,
        hi=200,
    )
    dead_time: float = number(
        "s", 0.0, "delay of the valves, from the bit to the flow", lo=0, hi=0.5
    )
    pulse: float = number(
        "s", 0.0, "shortest time for which a valve keeps its position", lo=0, hi=0.5
    )
    reaction: float = number("s", 0.0, "delay from the demand to the first flow", lo=0, hi=2)
    band: float = number(
        "Pa", 5e3, "pressure error below which a commanded torque is held", lo=0, hi=1e5
    )
    weighed: float | None = number(
        "kg",
        None,
        (
            "mass that the load weighing reports and the brake pressure follows; none"
            " given: the true mass"
        ),
        lo=100,
        hi=1e8,
    )
    reservoir: float | None = number(
        "m^3",
        None,
        "volume of the air reservoir for all cylinders of the vehicle; none given: unlimited air",
        lo=1e-3,
        hi=10,
    )
    reserve: float | None = number(
        "Pa",
        None,
        "pressure of the reservoir at the start, gauge; none given: the supply pressure",
        lo=1e4,
        hi=2e6,
    )
    charge: float = number("m^3/s", 0.0, "free air that the compressor delivers", lo=0, hi=1)

    def misfits(self) -> Iterator[Fault]:
        """Times off the tick, pressures that cannot be, a reservoir that is none."""
        for name in ("dead_time", "pulse", "reaction"):
            yield from faults_off_ticks(name, getattr(self, name))
        if self.band >= self.pressure:
            yield (
                "band",
                f"is {1e-5 * self.band:g} bar, the full pressure {1e-5 * self.pressure:g} bar; the"
                " brake would hold all the time, write less",
            )
        if self.supply <= self.pressure:
            yield (
                "supply",
                (
                    f"{1e-5 * self.supply:g} bar cannot fill a cylinder to"
                    f" {1e-5 * self.pressure:g} bar; write a pressure above that"
                ),
            )
        if self.reserve is not None and self.reserve < self.supply:
            yield (
                "reserve",
                "is below the supply pressure, which the reservoir feeds; write a larger one",
            )
        for name in ("reserve", "charge"):
            if getattr(self, name) and self.reservoir is None:
                yield name, "needs the volume of the reservoir; write reservoir = '100 l'"

    @property
    def rates(self) -> tuple[float, float]:
        """Rates in 1/s of the chokes that fill and vent."""
        chokes = ((self.fill_rate, self.fill), (self.vent_rate, self.vent))
        by = (self.volume, self.discharge, self.air)
        fill, vent = (rate_of_choke(d, *by) if k is None else k for k, d in chokes)
        return fill, vent

    @property
    def usual_lag(self) -> float:
        """Time in s to change the torque by a tenth at half of the pressure: what a law feels."""
        fill, vent = self.rates
        step = 0.1 * self.pressure
        up, down = fill * (self.supply + ATMOSPHERE), vent * (self.pressure / 2 + ATMOSPHERE)
        return min(max((step / up + step / down) / 2, 1e-3), 5.0)

    @property
    def longest_lag(self) -> float:
        """Time in s to fill from nothing, or to vent to a twentieth, whichever is longer."""
        fill, vent = self.rates
        up = self.pressure / (fill * (self.supply + ATMOSPHERE))
        return max(1.2 * up, 3 / vent)


Actuator = Lag | Valve | Air
"""Kinds of actuators that a file may name."""
