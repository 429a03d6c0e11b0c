"""What slipctl reads of a file that describes a vehicle, registered in ``pyproject.toml``."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from slipctl.block.block import Block
from slipctl.block.signals import Signal
from slipctl.errors import BadInput, Faults
from slipctl.models import common_form
from slipctl.models.vehicle import control, of_study, study
from slipctl.models.vehicle.adhesion import rail_law
from slipctl.models.vehicle.contamination import field_of_rail
from slipctl.models.vehicle.of_study import StudyTrip
from slipctl.models.vehicle.parts import TrainSlip, Trip
from slipctl.models.vehicle.slip.train_reference import believed_curves
from slipctl.study.declaration import Study

Fault = tuple[tuple[str | int, ...], str]
"""Keys down to where it stands, and what is wrong there."""


class VehicleFiles:
    """A vehicle of one's own, or loops of a study with other numbers."""

    roots = (Trip, StudyTrip)

    def root(self, content: Mapping[str, Any]) -> type:
        """Part that a file's content is read as."""
        vehicle = content.get("vehicle")
        return self.roots[isinstance(vehicle, Mapping) and vehicle.get("kind") == "study"]

    def faults(self, part: Trip | StudyTrip) -> list[Fault]:
        """What is wrong in a file that is declared right: numbers that only the blocks know."""
        if isinstance(part, Trip):
            return _faults_of_laws(part)
        try:
            return of_study.Reading(part).check()
        except BadInput as error:
            return [(("vehicle",), str(error))]

    def law_of_kind(self, kind: str) -> tuple[str, list[Signal]] | None:
        """What a slip law does, in a sentence, and the gains that a file may set; None for others.

        Args:
            kind: of a controller.
        """
        if kind not in common_form.MEANINGS:
            return None
        return common_form.MEANINGS[kind], common_form.gains_of_law(kind)

    def adhesion_law(self, part: Trip | StudyTrip) -> tuple[Block, str] | None:
        """Adhesion law of a file with its rail conditions, and what the file names it by.

        Returns:
            None where the law is that of a study.
        """
        return (rail_law(part), part.rail.law) if isinstance(part, Trip) else None

    def study(self, part: Trip | StudyTrip, name: str, doc: str) -> Study:
        """Study of a file."""
        if isinstance(part, Trip):
            return study.study(part, name, doc)
        return of_study.study(part, name, doc)


VEHICLE_FILES = VehicleFiles()


def _faults_of_laws(trip: Trip) -> list[Fault]:
    """What is wrong with laws, conditions and gains, which the blocks themselves know."""
    faults: list[Fault] = []

    def tried(keys: tuple[str | int, ...], check: Any) -> None:
        try:
            check()
        except BadInput as error:
            lines = error.lines if isinstance(error, Faults) else (str(error),)
            faults.extend(_placed(keys, line) for line in lines)

    tried(("rail",), lambda: rail_law(trip))
    if trip.rail.contamination is not None:
        tried(("rail",), lambda: field_of_rail(trip))
    if hasattr(trip.reference, "noise"):
        tried(("reference",), lambda: control.law_and_guess(trip.reference))
    elif isinstance(trip.reference, TrainSlip) and not faults:
        tried(("reference",), lambda: believed_curves(trip, trip.reference))
    if faults:
        return faults
    for name, part in trip.controllers.items():
        own = getattr(part, "reference", None)
        if isinstance(own, TrainSlip):
            tried(("controllers", name, "reference"), lambda own=own: believed_curves(trip, own))
        if hasattr(part, "gains"):
            tried(
                ("controllers", name),
                lambda part=part: (
                    control.block_of_bits(trip, part)
                    or control.slip_law(trip, part, control.wheel(trip))
                ),
            )
    return faults


def _placed(keys: tuple[str | int, ...], line: str) -> Fault:
    """A fault where its line says, below these keys."""
    found = re.match(r"((?:rail|start|gains|layer|clean|condition)(?:\.\w+)*):? (.+)", line)
    if not found:
        return keys, line
    path, rest = found[1].split("."), found[2]
    inner = tuple(int(k) if k.isdigit() else k for k in path)
    inner = inner[1:] if path[0] == "gains" or keys[:1] == ("rail",) else inner
    return (*keys, *inner), rest.removeprefix("= ")
