"""Which logged signal is the speed, the slip or the torque: what metrics and figures go by."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from slipctl.errors import check_kinds

Names = str | Sequence[str] | None
"""Name of a logged signal, or names of which the first that a loop has is meant."""

Bounded = tuple[Names, Names | float, Names | float]
"""A signal with its lower and upper bound, each a signal or a number."""


@dataclass(frozen=True)
class Signals:
    """Which logged signals the metrics speak of; what a study or a loop has not, it leaves out.

    Attributes:
        speed: vehicle speed.
        wheel_speed: angular speed of the wheel, or rim speed in m/s.
        position: position of the vehicle.
        slip: slip speed, or slip ratio.
        reference: slip that the controller follows.
        best_slip: slip of the adhesion peak, as the rail has it.
        adhesion: adhesion coefficient.
        best_adhesion: its peak, as the rail has it.
        torque: torque that reaches the wheel.
        deceleration: deceleration (or acceleration) of the vehicle.
        wanted_speed, wanted_position: what speed and position shall follow.
        funnel: error with its prescribed bounds, ``("ctl.e", "ctl.lower", "ctl.upper")``.
        barrier: error with the bounds that a barrier keeps.
        step_time: time that one tick took to compute.
        contact_power: power that the contact of each axle takes.
        wear_rate: wear of a wheel of each axle by the way, in kg/m.
        flash: flash temperature of each contact.
        energy_error: what the energy books lose or gain, by the energy at the start.
        air_used: free air in m^3 that the cylinders have taken so far.
        air_left: gauge pressure of their reservoir in Pa.
        valve_changes: changes of the valves of each axle so far.
        pressure: of each brake cylinder, in Pa.
        holding, venting: bits of its two valves, each 1 while energized.
        mark: place that the vehicle may not pass, in m.
        mirrored: whether the slip is that of driven wheels seen as braked ones.
        axles: of which slip and torque are told, counted from 0, where others only roll.
    """

    speed: Names = None
    wheel_speed: Names = None
    position: Names = None
    slip: Names = None
    reference: Names = None
    best_slip: Names = None
    adhesion: Names = None
    best_adhesion: Names = None
    torque: Names = None
    deceleration: Names = None
    wanted_speed: Names = None
    wanted_position: Names = None
    funnel: Bounded | None = None
    barrier: Bounded | None = None
    step_time: Names = None
    contact_power: Names = None
    wear_rate: Names = None
    flash: Names = None
    energy_error: Names = None
    air_used: Names = None
    air_left: Names = None
    valve_changes: Names = None
    pressure: Names = None
    holding: Names = None
    venting: Names = None
    mark: Names = None
    mirrored: bool = False
    axles: Sequence[int] | None = None

    def __post_init__(self) -> None:
        check_kinds("Signals", Signals, vars(self))

    def slip_sign(self, log: Mapping[Any, Any]) -> int:
        """1 for a slip that is vehicle minus rim, as in braking; -1 for one as in traction."""
        name = self.find("slip", log)
        traction = name is not None and log[name].attrs.get("positive") == "traction"
        return -1 if traction or self.mirrored else 1

    def find(self, role: str, log: Mapping[Any, Any]) -> str | None:
        """Name of the logged signal that plays ``role``, or None."""
        return first_of(getattr(self, role), log)


def axles_of_columns(worked: Sequence[int] | None, many: int) -> Sequence[int]:
    """Axle, from 0 on, of each of so many columns; as many as are worked are of these."""
    return worked if worked is not None and len(worked) == many else range(many)


def first_of(names: Names, log: Mapping[Any, Any]) -> str | None:
    """Return the first of the names that the log has, or None."""
    wanted = [names] if isinstance(names, str) else list(names or ())
    return next((n for n in wanted if n in log), None)
