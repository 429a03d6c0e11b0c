"""Pads and blocks of a brake: what they are made of, and how much their friction changes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from slipctl.models.brake_pads import MOST, friction
from slipctl.models.vehicle.parts.declaration import Fault, Part, number, text_field


@dataclass(frozen=True, kw_only=True)
class Pads(Part):
    """Pads of discs or blocks on the tread; the actuator's torque is at their nominal friction."""

    material: Literal["cast_iron", "composite", "cosid", "disc"] = text_field(
        "disc",
        "friction pair: cast iron, composite or Cosid blocks on the tread, or pads on discs",
    )
    nominal: float | None = number(
        "1",
        None,
        (
            "friction for which the torque of the actuator is given; none given: that at"
            " 60 km/h and 5 kN"
        ),
        lo=0.01,
        hi=1,
    )
    blocks: int = number("1", 8, "blocks of a wheelset", lo=1, hi=64)
    radius: float | None = number(
        "m", None, "radius at which the pads act; none given: the wheel radius", lo=0.05, hi=1
    )
    spread: float = number("1", 1.0, "factor on the friction", lo=0.1, hi=3)
    heat_capacity: float | None = number(
        "J/K",
        None,
        "heat capacity of a wheelset's discs, or of its wheels; none given: they stay cold",
        lo=1,
        hi=1e9,
    )
    cooling: float = number(
        "W/K", 0.0, "heat that the air takes, per kelvin", lo=0, hi=1e6, needs=("heat_capacity",)
    )
    fade: float = number(
        "1/K", 0.0, "share of the friction lost per kelvin above fade_from", lo=0, hi=0.1
    )
    fade_from: float = number(
        "K",
        250.0,
        "temperature above the air from which the pads fade",
        lo=0,
        hi=3000,
        needs=("fade",),
    )

    def misfits(self) -> Iterator[Fault]:
        """A fade without a temperature."""
        if self.fade and self.heat_capacity is None:
            yield "fade", "pads without heat_capacity stay cold and do not fade; write both"

    @property
    def friction(self) -> float:
        """Nominal friction."""
        return self.nominal if self.nominal is not None else friction(self.material, 5e3, 60 / 3.6)

    def too_strong(self, torque: float, radius: float) -> str:
        """What is wrong where the force of a block is beyond its formula; empty if nothing.

        Args:
            torque: largest of an axle, at the nominal friction, in N m.
            radius: of the wheel in m.
        """
        force = torque / (self.friction * (self.radius or radius) * self.blocks)
        most = MOST.get(self.material, force)
        if force <= most:
            return ""
        return (
            f"{torque:g} N m are {force / 1e3:.3g} kN on each of {self.blocks} pads, and the"
            f" friction of {self.material} is known to {most / 1e3:g} kN; write more of them"
        )
