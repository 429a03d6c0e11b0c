"""slipctl: design wheel-slip and adhesion control of railway vehicles.

One definition of a model serves simulation, exact derivatives, stability conditions and C code.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_WHERE = {
    "errors": ["BadInput", "RunFailed"],
    "signals": ["Signal", "State", "Input", "Param", "Noise", "Output"],
    "block": ["Block", "law", "flow", "step", "make_block"],
    "connection": ["connect"],
    "timing": ["sampled", "every", "unit_delay"],
    "replication": ["replicate"],
    "adaptors": ["flip_sign", "mirror", "speed_to_ratio", "ratio_to_speed"],
    "units": ["one"],
    "rail": ["Section", "Rail", "Scenario"],
    "simulation": ["simulate"],
    "estimate": ["rls", "probe", "peak_bound", "opened"],
    "filtering": ["ctukf", "ekf", "observability", "lipschitz"],
    "seek": ["differential_evolution"],
    "extremum": ["sliding_seek", "perturbation_seek", "seek_limits", "SeekLimits"],
    "extremum_lock": ["locking_seek"],
    "observing": ["luenberger"],
    "fitting": ["fit", "Fitted"],
    "swarm": ["particle_swarm", "least_squares", "Fit"],
    "identification": ["identify", "Identified", "linear_fit", "misfit_search", "swarm_fit"],
    "optimum": ["argmax", "argmax_block"],
    "lookup": ["argmax_table"],
    "predictive": ["nmpc"],
    "trials": ["feasibility", "Feasibility"],
    "clairvoyant": ["trajectory", "Trajectory"],
    "linearise": ["linear", "nonlinear", "operating_point"],
    "studying": [
        "Study",
        "Case",
        "Claim",
        "Context",
        "Experiment",
        "Figure",
        "Gains",
        "Known",
        "Results",
        "Signals",
        "Table",
    ],
    "codegen": ["c_module", "CModule"],
}
_HOME = {name: module for module, names in _WHERE.items() for name in names}
__all__ = ["__version__", *_HOME]

if TYPE_CHECKING:
    from slipctl.adaptors import flip_sign, mirror, ratio_to_speed, speed_to_ratio
    from slipctl.block import Block, flow, law, make_block, step
    from slipctl.clairvoyant import Trajectory, trajectory
    from slipctl.codegen import CModule, c_module
    from slipctl.connection import connect
    from slipctl.errors import BadInput, RunFailed
    from slipctl.estimate import opened, peak_bound, probe, rls
    from slipctl.filtering import ctukf, ekf, lipschitz, observability
    from slipctl.fitting import Fitted, fit
    from slipctl.linearise import linear, nonlinear, operating_point
    from slipctl.lookup import argmax_table
    from slipctl.optimum import argmax, argmax_block
    from slipctl.predictive import nmpc
    from slipctl.rail import Rail, Scenario, Section
    from slipctl.replication import replicate
    from slipctl.seek import differential_evolution
    from slipctl.signals import Input, Noise, Output, Param, Signal, State
    from slipctl.simulation import simulate
    from slipctl.studying import (
        Case,
        Claim,
        Context,
        Experiment,
        Figure,
        Gains,
        Known,
        Results,
        Signals,
        Study,
        Table,
    )
    from slipctl.timing import every, sampled, unit_delay
    from slipctl.trials import Feasibility, feasibility
    from slipctl.units import one


def __getattr__(name: str) -> Any:
    """Import on first use, so that ``slipctl --help`` answers at once."""
    if name in _HOME:
        return getattr(import_module(f"slipctl.{_HOME[name]}"), name)
    raise AttributeError(f"module 'slipctl' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
