"""Leaves on the rail: what a train can make of them by its valves, and what is possible at all."""

from __future__ import annotations

from slipctl import Study
from slipctl.studies.leaf_fall.claims import CLAIMS
from slipctl.studies.leaf_fall.experiments import EXPERIMENTS
from slipctl.studies.leaf_fall.figures import FIGURES
from slipctl.studies.leaf_fall.loops import ENSEMBLE, SIGNALS, cases
from slipctl.studies.leaf_fall.trains import RIVALS

BITS = "it acts by the bits of two valves; a certificate is made for a torque that follows a lag"

study = Study(
    name="leaf_fall",
    title="A train that brakes into leaves, and cleans the rail for itself",
    source="this study",
    doc="A train of eight axles brakes by air from 90 km/h into 300 m of leaves. Who stops it"
    " shortest by the valves of its cylinders, at what price, and how much is left to gain?",
    short="Where a joule cleans well, leading axles at their slip limit and last ones near their"
    " peak stop a train shortest: the first rub off what hinders the rest. A law that adds to the"
    " search of the peak how many axles follow gets most of that behind valves there, and less than"
    " half where cleaning is weak. Locked wheels stop about as short as a slide protection, but"
    " their contacts are hot enough to harden steel.",
    headline="bound",
    cases=cases,
    signals=SIGNALS,
    claims=CLAIMS,
    figures=FIGURES,
    experiments=EXPERIMENTS,
    ensembles={"base": ENSEMBLE},
    plain=("base", "medium", "clean", "bound", "energy"),
    uncertified=dict.fromkeys(RIVALS, BITS),
)
