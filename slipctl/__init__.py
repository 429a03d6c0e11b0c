"""slipctl: design wheel-slip and adhesion control of railway vehicles.

One definition of a model serves simulation, exact derivatives, stability conditions and C code.
"""

from __future__ import annotations

from importlib import import_module
from types import FunctionType
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_WHERE = {
    "errors": ["BadInput", "RunFailed"],
    "block.signals": ["Signal", "State", "Input", "Param", "Noise", "Output"],
    "block.block": ["Block", "make_block"],
    "block.declare": ["law", "flow", "step"],
    "block.written": ["from_text"],
    "block.state_machine": ["state_machine"],
    "block.connection": ["connect"],
    "block.timing": ["sampled", "every", "gated", "unit_delay"],
    "block.replication": ["replicate"],
    "block.ranges": ["ranged"],
    "block.distance": ["over_distance"],
    "block.adaptors": ["flip_sign", "mirror", "speed_to_ratio", "ratio_to_speed"],
    "block.expression": ["interpolated"],
    "block.units": ["one"],
    "run.rail": ["Section", "Rail", "Scenario", "End"],
    "run.simulation": ["simulate"],
    "run.prepared": ["prepare", "Prepared"],
    "run.ensemble": ["Ensemble"],
    "run.sweeping": ["sweep", "open_sweep", "Sweep"],
    "estimate.least_squares": ["rls", "probe", "peak_bound", "opened"],
    "estimate.kalman.filters": ["ctukf", "ekf", "observability", "lipschitz"],
    "seek.evolution": ["differential_evolution"],
    "seek.extremum": ["sliding_seek", "perturbation_seek", "seek_limits", "SeekLimits"],
    "seek.lock": ["locking_seek"],
    "analysis.observing": ["luenberger"],
    "estimate.fitting": ["fit", "Fitted"],
    "estimate.over_time": ["fit_over_time"],
    "estimate.record": ["FittedOverTime"],
    "seek.swarm": ["particle_swarm", "least_squares", "Fit"],
    "estimate.identification": [
        "identify",
        "Identified",
        "linear_fit",
        "misfit_search",
        "swarm_fit",
    ],
    "analysis.optimum": ["argmax", "argmax_block"],
    "analysis.lookup": ["argmax_table"],
    "predict.mhe": ["mhe"],
    "predict.nmpc": ["nmpc"],
    "predict.region": ["Region", "terminal_region"],
    "predict.sensitivity": ["Slopes", "control_slopes", "run_slopes"],
    "predict.tightening": ["tightening"],
    "predict.trials": ["feasibility", "Feasibility"],
    "predict.trajectory": ["trajectory", "Trajectory"],
    "analysis.linearise": ["linear", "nonlinear", "operating_point"],
    "run.roles": ["Signals"],
    "run.results": ["Case", "Known", "Results", "Table"],
    "study.declaration": ["Study", "Claim", "Context", "Experiment", "Figure", "Gains"],
    "ccode.codegen": ["c_module", "CModule"],
    "ccode.check.timing": ["step_times"],
    "design.tune": ["tune", "Tuned"],
}
_HOME = {name: module for module, names in _WHERE.items() for name in names}
__all__ = ["__version__", *_HOME]

if TYPE_CHECKING:
    from slipctl.analysis.linearise import linear, nonlinear, operating_point
    from slipctl.analysis.lookup import argmax_table
    from slipctl.analysis.optimum import argmax, argmax_block
    from slipctl.block.adaptors import flip_sign, mirror, ratio_to_speed, speed_to_ratio
    from slipctl.block.block import Block, make_block
    from slipctl.block.connection import connect
    from slipctl.block.declare import flow, law, step
    from slipctl.block.distance import over_distance
    from slipctl.block.expression import interpolated
    from slipctl.block.ranges import ranged
    from slipctl.block.replication import replicate
    from slipctl.block.signals import Input, Noise, Output, Param, Signal, State
    from slipctl.block.timing import every, gated, sampled, unit_delay
    from slipctl.block.units import one
    from slipctl.block.written import from_text
    from slipctl.ccode.check.timing import step_times
    from slipctl.ccode.codegen import CModule, c_module
    from slipctl.design.tune import Tuned, tune
    from slipctl.errors import BadInput, RunFailed
    from slipctl.estimate.fitting import Fitted, fit
    from slipctl.estimate.kalman.filters import ctukf, ekf, lipschitz, observability
    from slipctl.estimate.least_squares import opened, peak_bound, probe, rls
    from slipctl.estimate.over_time import fit_over_time
    from slipctl.estimate.record import FittedOverTime
    from slipctl.predict.mhe import mhe
    from slipctl.predict.nmpc import nmpc
    from slipctl.predict.region import Region, terminal_region
    from slipctl.predict.sensitivity import Slopes, control_slopes, run_slopes
    from slipctl.predict.tightening import tightening
    from slipctl.predict.trajectory import Trajectory, trajectory
    from slipctl.predict.trials import Feasibility, feasibility
    from slipctl.run.ensemble import Ensemble
    from slipctl.run.prepared import Prepared, prepare
    from slipctl.run.rail import End, Rail, Scenario, Section
    from slipctl.run.results import Case, Known, Results, Table
    from slipctl.run.roles import Signals
    from slipctl.run.simulation import simulate
    from slipctl.run.sweeping import Sweep, open_sweep, sweep
    from slipctl.seek.evolution import differential_evolution
    from slipctl.study.declaration import Claim, Context, Experiment, Figure, Gains, Study


def __getattr__(name: str) -> Any:
    """Import on first use, so that ``slipctl --help`` answers at once."""
    if name in _HOME:
        found = getattr(import_module(f"slipctl.{_HOME[name]}"), name)
        if isinstance(found, FunctionType):
            from slipctl.errors import door

            found = door(found, name)
        globals()[name] = found
        return found
    raise AttributeError(f"module 'slipctl' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
