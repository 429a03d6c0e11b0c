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
    short="Locked wheels stop about as short as a slide protection or shorter, but their"
    " contacts are hot enough to harden steel. Where a joule cleans well, one large slip"
    " for all axles beats the best slip of each, because the first axles rub off the layer"
    " on which the others would slide. The optimum of the whole train is shorter than any"
    " slide protection: leading axles at their slip limit, the last ones near their own"
    " best slip.",
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
