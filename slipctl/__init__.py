"""slipctl: design wheel-slip and adhesion control of railway vehicles.

One definition of a model serves simulation, exact derivatives, stability conditions and C code.
"""

from __future__ import annotations

from importlib import import_module
from types import FunctionType
from typing import TYPE_CHECKING, Any

from slipctl import old_names

__version__ = "0.1.0"

_WHERE = {
    "errors": ["BadInput", "RunFailed"],
    "block.signals": ["Signal", "State", "Input", "Param", "Noise", "Output"],
    "block.block": ["Block", "make_block"],
    "block.declare": ["law", "flow", "step"],
    "block.text.equations": ["from_text"],
    "block.state_machine": ["state_machine"],
    "block.connection": ["connect"],
    "block.transforms.discretisation": ["sampled", "every", "gated", "unit_delay"],
    "block.transforms.replication": ["replicate"],
    "block.transforms.ranges": ["ranged"],
    "block.transforms.distance": ["over_distance"],
    "block.transforms.adaptors": ["flip_sign", "mirror", "speed_to_ratio", "ratio_to_speed"],
    "block.text.expression": ["interpolated"],
    "block.units.unit_algebra": ["one"],
    "run.rail": ["Section", "Rail", "Scenario", "End"],
    "run.simulation": ["simulate"],
    "run.preparation": ["prepare", "Prepared"],
    "run.sweep.ensemble": ["Ensemble"],
    "run.sweep.sweep_runs": ["sweep", "open_sweep", "Sweep"],
    "estimate.least_squares": ["rls", "probe", "peak_bound", "opened"],
    "estimate.kalman.filters": ["ctukf", "ekf", "observability", "lipschitz"],
    "seek.evolution": ["differential_evolution"],
    "seek.extremum": ["sliding_seek", "perturbation_seek", "seek_limits", "SeekLimits"],
    "seek.lock": ["locking_seek"],
    "analysis.observers": ["luenberger"],
    "estimate.curve_fit": ["fit", "Fitted"],
    "estimate.log_fit.flow_fit": ["fit_over_time"],
    "estimate.log_fit.record": ["FittedOverTime"],
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
    "predict.options.region": ["Region", "terminal_region"],
    "predict.sensitivity": ["Slopes", "control_slopes", "run_slopes"],
    "predict.options.chance_constraints": ["tightening"],
    "predict.trials": ["feasibility", "Feasibility"],
    "predict.trajectory": ["trajectory", "Trajectory"],
    "analysis.linearise": ["linear", "nonlinear", "operating_point"],
    "run.roles": ["Signals"],
    "run.results": ["Case", "Known", "Results", "Table"],
    "study.declaration": ["Study", "Claim", "Context", "Experiment", "Figure", "Gains"],
    "ccode.codegen": ["c_module", "CModule"],
    "ccode.check.processor.tick_times": ["step_times"],
    "design.tune": ["tune", "Tuned"],
}
_HOME = {name: module for module, names in _WHERE.items() for name in names}
__all__ = ["__version__", *_HOME]
_ASIDE = {"open": "workbench.web.widget"}  # a star must not take Python's own open away

if TYPE_CHECKING:
    from slipctl.analysis.linearise import linear, nonlinear, operating_point
    from slipctl.analysis.lookup import argmax_table
    from slipctl.analysis.optimum import argmax, argmax_block
    from slipctl.block.block import Block, make_block
    from slipctl.block.connection import connect
    from slipctl.block.declare import flow, law, step
    from slipctl.block.signals import Input, Noise, Output, Param, Signal, State
    from slipctl.block.text.equations import from_text
    from slipctl.block.text.expression import interpolated
    from slipctl.block.transforms.adaptors import flip_sign, mirror, ratio_to_speed, speed_to_ratio
    from slipctl.block.transforms.discretisation import every, gated, sampled, unit_delay
    from slipctl.block.transforms.distance import over_distance
    from slipctl.block.transforms.ranges import ranged
    from slipctl.block.transforms.replication import replicate
    from slipctl.block.units.unit_algebra import one
    from slipctl.ccode.check.processor.tick_times import step_times
    from slipctl.ccode.codegen import CModule, c_module
    from slipctl.design.tune import Tuned, tune
    from slipctl.errors import BadInput, RunFailed
    from slipctl.estimate.curve_fit import Fitted, fit
    from slipctl.estimate.kalman.filters import ctukf, ekf, lipschitz, observability
    from slipctl.estimate.least_squares import opened, peak_bound, probe, rls
    from slipctl.estimate.log_fit.flow_fit import fit_over_time
    from slipctl.estimate.log_fit.record import FittedOverTime
    from slipctl.predict.mhe import mhe
    from slipctl.predict.nmpc import nmpc
    from slipctl.predict.options.chance_constraints import tightening
    from slipctl.predict.options.region import Region, terminal_region
    from slipctl.predict.sensitivity import Slopes, control_slopes, run_slopes
    from slipctl.predict.trajectory import Trajectory, trajectory
    from slipctl.predict.trials import Feasibility, feasibility
    from slipctl.run.preparation import Prepared, prepare
    from slipctl.run.rail import End, Rail, Scenario, Section
    from slipctl.run.results import Case, Known, Results, Table
    from slipctl.run.roles import Signals
    from slipctl.run.simulation import simulate
    from slipctl.run.sweep.ensemble import Ensemble
    from slipctl.run.sweep.sweep_runs import Sweep, open_sweep, sweep
    from slipctl.seek.evolution import differential_evolution
    from slipctl.study.declaration import Claim, Context, Experiment, Figure, Gains, Study


def __getattr__(name: str) -> Any:
    """Import on first use, so that ``slipctl --help`` answers at once."""
    if name in _HOME or name in _ASIDE:
        found = getattr(import_module(f"slipctl.{(_HOME | _ASIDE)[name]}"), name)
        if isinstance(found, FunctionType):
            from slipctl.errors import door

            found = door(found, name)
        globals()[name] = found
        return found
    raise AttributeError(f"module 'slipctl' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*__all__, *_ASIDE])
