"""Torsion of the driven wheelsets of a vehicle."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import MISSING, dataclass

from slipctl.models.vehicle.parts.declaration import Fault, Part, number

WHEELS = 1.0
"""Least inertia in kg m^2 of two wheels on their axle."""


@dataclass(frozen=True, kw_only=True)
class Torsion(Part):
    """Axles that twist between their wheels, and between wheels and rotor."""

    stiffness: float = number(
        "N m/rad",
        MISSING,
        "stiffness of an axle between its wheels, G pi d^4/(32 L)",
        lo=1e4,
        hi=1e9,
    )
    rotor: float | None = number(
        "kg m^2",
        None,
        "rotor and gear as the axle sees them, a part of the inertia; none given: two wheels alone",
        lo=0.1,
        hi=5e3,
    )
    shaft: float | None = number(
        "N m/rad", None, "stiffness between rotor and axle, as the axle sees it", lo=1e4, hi=1e9
    )
    damping: float = number("1", 0.005, "damping ratio of each mode", lo=1e-4, hi=0.3)

    def misfits(self) -> Iterator[Fault]:
        """A rotor without its shaft, or a shaft without rotor."""
        if (self.rotor is None) != (self.shaft is None):
            has = "rotor" if self.shaft is None else "shaft"
            yield has, "rotor and shaft belong together; write both or none"

    def faults_of_vehicle(
        self, driven: bool, inertias: Sequence[float], radii: Sequence[float]
    ) -> Iterator[Fault]:
        """What does not fit the driven wheelsets, whose inertias and radii are given."""
        if not driven:
            yield (
                "torsion",
                "is of a driven vehicle: on a braked trailer adhesion does not fall fast enough",
            )
        elif len(set(inertias)) > 1 or len(set(radii)) > 1:
            yield "torsion", "is one for all driven wheelsets, and these differ from each other"
        elif self.rotor is not None and self.rotor > inertias[0] - WHEELS:
            yield (
                "torsion.rotor",
                f"is {self.rotor:g} kg m^2, the wheelset with it {inertias[0]:g} kg m^2;"
                f" the wheels alone have at least {WHEELS:g} kg m^2",
            )
