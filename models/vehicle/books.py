"""What follows from the log of a trip: its energy books, wear and heat of its wheels."""

from __future__ import annotations

from typing import Any

import numpy as np

from slipctl import Known
from slipctl.models.common_form import T_S
from slipctl.models.vehicle.parts import Trip
from slipctl.models.wheel_damage import flash_temperature, wear_rate

TAKEN = ("P_brake", "P_bearing", "P_slip", "P_d")
"""Powers that take energy from vehicle and wheels."""

SLOW = 0.1
"""Speed in m/s below which energy is not divided by the way."""


def energy_error(log: Any) -> np.ndarray:
    """What the books of vehicle and wheels lose since the start, by the energy then, or the work.

    A row a tick, at its start.
    """
    energy = np.asarray(log["plant.train.E_kin"], dtype=float)
    power = sum(np.asarray(log[f"plant.train.{n}"], dtype=float) for n in TAKEN)
    driven = np.asarray(log["plant.train.P_drive"], dtype=float)
    done = np.concatenate([[0.0], np.cumsum(driven - power)[:-1]]) * T_S
    size = max(float(energy.max()), 1.0)
    return np.asarray((energy - energy[0] - done) / size)


def known_of_trip(trip: Trip) -> dict[str, Known]:
    """Quantities of a trip's log that no block computes: its books, and wear and heat of contacts.

    Wear and heat need the heat of each contact, which a train gives whose rail remembers.
    """
    reads = tuple(f"plant.train.{n}" for n in ("E_kin", "P_drive", *TAKEN))
    found = {"books.error": Known("1", energy_error, "what the energy books lose", (), reads)}
    if trip.mark is not None:
        found["trip.mark"] = Known("m", trip.mark, "place that the first axle shall not pass")
    vehicle = trip.vehicle
    if trip.rail.contamination is None:
        return found
    radii, patch = np.array(vehicle.radii), vehicle.patch

    def wear(log: Any) -> np.ndarray:
        v = np.abs(np.asarray(log["plant.train.v"], dtype=float))[:, None]
        power = np.abs(np.asarray(log["plant.train.P_contact"], dtype=float)) / 2
        return np.asarray(wear_rate(power / np.maximum(v, SLOW), patch))

    def flash(log: Any) -> np.ndarray:
        v = np.abs(np.asarray(log["plant.train.v"], dtype=float))[:, None]
        rim = np.abs(np.asarray(log["plant.train.omega"], dtype=float)) * radii
        power = np.asarray(log["plant.train.P_contact"], dtype=float) / 2
        return np.asarray(flash_temperature(power, np.maximum(v, SLOW), rim, patch,
                                            vehicle.patch_half_length))  # fmt: skip

    motion = ("plant.train.v", "plant.train.P_contact")
    return found | {
        "contact.wear": Known("kg/m", wear, "wear of a wheel by its way", vehicle.behind, motion),
        "contact.flash": Known("K", flash, "flash temperature of a contact", vehicle.behind,
                               (*motion, "plant.train.omega")),
    }  # fmt: skip
