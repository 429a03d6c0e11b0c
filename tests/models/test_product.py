"""Every slip law on every kind of vehicle: it is built, and its first ticks run, within limits.

The suite takes a part in which every two choices meet; ``PRODUCT=all`` takes all of them.
"""

import itertools
import os

import numpy as np
import pytest

from slipctl import simulate
from slipctl.models.vehicle import (
    Constant,
    Lag,
    Most,
    Predictive,
    Searched,
    SlipLaw,
    SlipSpeed,
    Stretch,
    Track,
    Trip,
    Vehicle,
    case,
)
from slipctl.models.vehicle.parts import SLIP_LAWS

LAWS = (*SLIP_LAWS, "nmpc")
CHOICES = {
    "law": LAWS, "mode": ("brake", "drive"), "axles": (1, 4, 32),
    "demand": ("demand", "slip"), "reference": ("fixed", "searched"),
}  # fmt: skip
TORQUE, TICKS = 8e3, 20


def pairwise_cover(lists):
    """Rows in which every two values of different lists meet; greedy, so always the same."""
    names = list(lists)
    pairs = list(itertools.combinations(range(len(names)), 2))
    rows = list(itertools.product(*lists.values()))
    left = {(i, j, r[i], r[j]) for r in rows for i, j in pairs}
    while left:
        best = max(rows, key=lambda r: sum((i, j, r[i], r[j]) in left for i, j in pairs))
        left -= {(i, j, best[i], best[j]) for i, j in pairs}
        yield dict(zip(names, best, strict=True))


ALL = [dict(zip(CHOICES, row, strict=True)) for row in itertools.product(*CHOICES.values())]
TAKEN = ALL if os.environ.get("PRODUCT") == "all" else list(pairwise_cover(CHOICES))


def made(law, mode, axles, demand, reference):
    """Trip on ice at 15 m/s; wanted is more than the rail bears."""
    wanted = "deceleration" if mode == "brake" else "acceleration"
    return Trip(
        duration=TICKS * 1e-3,
        vehicle=Vehicle(mode=mode, mass=9.5e3 * axles, axles=axles, inertia=110.0, speed=15.0),
        actuator=Lag(torque=TORQUE),
        rail=Track(sections=(Stretch(place=0.0, condition="ice"),)),
        demand=Most() if demand == "slip" else Constant(**{wanted: 1.0}),
        reference=SlipSpeed(slip=1.2) if reference == "fixed" else Searched(),
        controllers={"law": Predictive() if law == "nmpc" else SlipLaw(kind=law)},
    )  # fmt: skip


@pytest.mark.parametrize(
    "choice",
    [
        pytest.param(c, marks=[pytest.mark.second] if c["axles"] > 4 or c["law"] == "nmpc" else [])
        for c in TAKEN
    ],
    ids=lambda c: "-".join(map(str, c.values())),
)
def test_every_law_runs_on_every_vehicle(choice):
    found = case(made(**choice))
    log = simulate(found.loops["law"], found.scenario, compile=False)
    assert log.sizes["time"] == TICKS
    assert log["ctl.T_cmd"].shape == (TICKS, choice["axles"])
    for name, values in log.data_vars.items():
        assert np.isfinite(values).all(), name
    for name in ("ctl.T_cmd", "plant.T"):
        assert log[name].min() >= 0, name
        assert log[name].max() <= TORQUE * (1 + 1e-12), name
    v = log["plant.train.v"].values
    assert (np.diff(v) <= 0).all() if choice["mode"] == "brake" else v[-1] > v[0] - 1e-3


def test_every_two_choices_meet():
    for a, b in itertools.combinations(CHOICES, 2):
        met = {(c[a], c[b]) for c in TAKEN}
        assert met == set(itertools.product(CHOICES[a], CHOICES[b]))
