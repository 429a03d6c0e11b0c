"""Every equation of the models has one unit on both sides, whatever its numbers are.

A term that is left out of a product, a force that is added to a torque, a time constant that is
multiplied where it divides: each of them has another unit than the equation that it stands in.
"""

from __future__ import annotations

from importlib import resources

import pytest
from test_defaults import EXAMPLES, MODELS, model

from slipctl.models.vehicle.trip import case
from slipctl.study.files import trip_files

BARE = "give the number its unit"
"""What is told of a bound that is a plain number: the largest time that is counted, say."""
LEFT = ("brake_pads.pad", "vehicle.air.pneumatics.reservoir", "wheel_rail.torsion.twisting_axle",
        "vehicle.failure.trust(False)", "vehicle.failure.trust(True)")  # fmt: skip
"""Regressions over km/h and kN, the pressure of the air, and bounds in m/s that are numbers."""
SLOW = ("contact.peak_table", "hst_traction_adhesion.usable_adhesion", "hst_traction.plant",
        "predictive_speed.predictive_speed")  # fmt: skip
FILES = resources.files("slipctl.models.vehicle") / "files"


def misfits(block):
    """What does not fit of a block's units, beside plain numbers."""
    return [line for line in block.check_units() if BARE not in line]


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=[pytest.mark.second] if n in SLOW else [])
     for n in dict.fromkeys([*MODELS, *EXAMPLES]) if n not in LEFT],
)  # fmt: skip
def test_units_of_every_model_fit(name):
    block = model(name)
    if block is not None:
        assert misfits(block) == []


@pytest.mark.second
@pytest.mark.parametrize(("file", "loop"), [("metro.toml", "super_twisting"), ("metro.toml", "pid"),
                                            ("emu.toml", "wsp"), ("emu.toml", "pi")])  # fmt: skip
@pytest.mark.others("long")
def test_units_of_every_part_of_a_vehicle_fit(file, loop):
    found = case(trip_files.load_trip(str(FILES / file))).loops[loop]
    leaves = {id(leaf._made): (path, leaf) for path, leaf in found.leaves()}
    left = [n.rpartition(".")[2].partition("(")[0] for n in LEFT]
    lost = {
        path: lines
        for path, leaf in leaves.values()
        if path.rpartition(".")[2] not in (*left, "pads", "air") and (lines := misfits(leaf))
    }
    assert lost == {}
