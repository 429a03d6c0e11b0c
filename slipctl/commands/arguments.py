"""What may be typed: commands and their options."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any, NoReturn

from slipctl import __version__
from slipctl.commands import examples
from slipctl.commands.library import arguments as library
from slipctl.commands.library.arguments import AS_JSON
from slipctl.errors import BadInput, nearest


class Parser(argparse.ArgumentParser):
    """Argument parser that says what is wrong in one line."""

    def error(self, message: str) -> NoReturn:
        """Raise what argparse would print with its usage."""
        raise BadInput(f"{message}; see {self.prog} --help")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            known = [str(c) for c in action.choices]
            what = "/".join(action.option_strings) or "command"
            self.error(f"there is no {what} {value!r}{nearest(str(value), known)}")


def parser() -> Parser:
    """Make the parser of the command line."""
    top = Parser(
        prog="slipctl", description="Design wheel-slip and adhesion control of railway vehicles.",
        epilog=examples.EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )  # fmt: skip
    top.add_argument("--version", action="version", version=f"slipctl {__version__}")
    volume = Parser(add_help=False)
    for p, default in ((top, False), (volume, argparse.SUPPRESS)):  # before or after the command
        p.add_argument("-v", "--verbose", action="store_true", default=default, help="tell more")
        p.add_argument("-q", "--quiet", action="store_true", default=default, help="errors only")
    commands = top.add_subparsers(dest="command", metavar="COMMAND", parser_class=Parser)

    for name, (help, options) in COMMANDS.items():
        options(commands.add_parser(
            name, help=help, description=help, parents=[volume], allow_abbrev=False,
            epilog=examples.OF_COMMAND[name], formatter_class=argparse.RawDescriptionHelpFormatter,
        ))  # fmt: skip
    return top


# ---- options of each command ---------------------------------------------------------------------


def _no_options(p: Parser) -> None:
    """A command without options."""


def _add_changes(p: Parser) -> None:
    """Options of many runs that change each of them."""
    p.add_argument(
        "--set", metavar="BLOCK.PARAM=VALUE[UNIT]", nargs="+", action="extend", default=[],
        dest="settings", help="set a parameter or start value in every run",
    )  # fmt: skip
    p.add_argument(
        "--swap", metavar="NAME=FILE:BLOCK", nargs="+", action="extend", default=[], dest="swaps",
        help="replace a model of the study",
    )  # fmt: skip


def _add_effort(p: Parser) -> None:
    """Options of many runs that say what may compute them."""
    p.add_argument(
        "--jobs", metavar="N", type=int, help="number of parallel runs (default: all cores)"
    )
    p.add_argument("--no-compile", action="store_true", help="do not use a C compiler")


def _run_options(p: Parser) -> None:
    p.add_argument("--json", action="store_true", help="print metrics and claims as JSON")
    p.add_argument("study", metavar="STUDY", help="a study, or the file of a vehicle")
    p.add_argument("--out", metavar="DIR", help="folder of the results (default: out/STUDY)")
    p.add_argument(
        "--set", metavar="[LOOP:]BLOCK.PARAM=VALUE[UNIT]", nargs="+", action="extend", default=[],
        dest="settings", help="set a parameter or start value, car.m=8.2t; '*.m=8t' sets every m",
    )  # fmt: skip
    p.add_argument(
        "--swap", metavar="NAME=FILE:BLOCK", nargs="+", action="extend", default=[], dest="swaps",
        help="replace a model of the study, adh=my.py:my_law or adh=my.toml:law",
    )  # fmt: skip
    p.add_argument(
        "--loop", metavar="L", nargs="+", action="extend", default=[], dest="loops",
        help="run only these loops",
    )  # fmt: skip
    p.add_argument(
        "--scenario", metavar="S", nargs="+", action="extend", default=[], dest="scenarios",
        help="run only these scenarios (default: base and real)",
    )  # fmt: skip
    p.add_argument(
        "--full", action="store_true",
        help="run all scenarios and experiments, on all cores; results that an interrupted run "
        "has finished are kept",
    )  # fmt: skip
    p.add_argument(
        "--jobs", metavar="N", type=int, help="number of parallel processes (default: all cores)"
    )
    p.add_argument(
        "--quick", action="store_true", help="shorter and fewer runs, for tests of a study"
    )
    p.add_argument("--no-compile", action="store_true", help="do not use a C compiler")


def _sweep_options(p: Parser) -> None:
    p.add_argument(
        "name", metavar="STUDY:LOOP", nargs="?",
        help="or STUDY:LOOP@SCENARIO, FILE.toml:LOOP; STUDY or FILE.toml alone takes all loops on"
        " the same draws",
    )  # fmt: skip
    p.add_argument(
        "--vary", metavar="P=LO:HI[:N]", nargs="+", action="extend", default=[], dest="varied",
        help="P=lo:hi:n is a grid axis of n values, P=lo:hi a uniform draw; ends may have units",
    )  # fmt: skip
    p.add_argument(
        "--samples", metavar="N", type=int, default=1,
        help="number of draws, at each point of a grid where there is one (default: 1)",
    )  # fmt: skip
    p.add_argument(
        "--seed", metavar="S", type=int, default=1, help="seed of the draws (default: 1)"
    )
    p.add_argument(
        "--design", choices=("random", "sobol", "lhs"), default="random",
        help="sampling method; a Latin hypercube (lhs) cannot be extended",
    )  # fmt: skip
    p.add_argument("--out", metavar="DIR", required=True, help="folder of the sweep")
    p.add_argument(
        "--export", metavar="FILE.nc",
        help="also write metrics and logs of all runs as one netCDF file, or DIR.zarr",
    )  # fmt: skip
    p.add_argument(
        "--scheduler", metavar="tcp://HOST:PORT",
        help="compute on the workers of this Dask scheduler (extra dask); results are the same to"
        " the bit",
    )  # fmt: skip
    p.add_argument(
        "--mixed", action="store_true",
        help="also use machines with another processor or mathematics library",
    )  # fmt: skip
    p.add_argument("--json", action="store_true", help=AS_JSON)
    _add_changes(p)
    p.add_argument(
        "--log", metavar="SIGNAL", nargs="+", action="extend", default=[], dest="logs",
        help="store these signals over time, for every run",
    )  # fmt: skip
    _add_effort(p)


def _tune_options(p: Parser) -> None:
    p.add_argument(
        "name", metavar="STUDY:LOOP", nargs="?", help="or STUDY:LOOP@SCENARIO, FILE.toml:LOOP"
    )
    p.add_argument(
        "--free", metavar="P=LO:HI", nargs="+", action="extend", default=[], dest="free",
        help="parameters to search, each in its range; the limits may have units",
    )  # fmt: skip
    p.add_argument(
        "--minimise", metavar="METRIC", nargs="+", action="extend", default=[], dest="objective",
        help="a metric, or a weighted sum: 'distance + 0.001*torque_ripple'; several give a front",
    )  # fmt: skip
    p.add_argument(
        "--subject-to", metavar="LIMIT", nargs="+", action="extend", default=[], dest="limits",
        help="'torque_ripple<=8kN m' in every draw, 'slip_max@0.95<=2m/s' in 95 %% of them,"
        " 'margin>=1.2' of the certificates, certified",
    )  # fmt: skip
    p.add_argument(
        "--samples", metavar="N", type=int, default=20,
        help="draws on which the search judges gains (default: 20)",
    )  # fmt: skip
    p.add_argument(
        "--seed", metavar="S", type=int, default=1, help="seed of draws and search (default: 1)"
    )
    p.add_argument(
        "--ensemble", metavar="FILE.toml",
        help="file that says what varies from draw to draw (default: the study's declaration)",
    )  # fmt: skip
    p.add_argument(
        "--held-out", metavar="N", type=int, default=200,
        help="fresh draws on which the result is judged (default: 200)",
    )  # fmt: skip
    p.add_argument(
        "--runs", metavar="N", type=int,
        help="largest number of runs of the search (default: 250 per parameter and metric)",
    )  # fmt: skip
    p.add_argument(
        "--prove", action="store_true",
        help="state what 1375 fresh draws prove of 99 %% of all draws, with confidence 1 - 1e-6",
    )  # fmt: skip
    p.add_argument("--out", metavar="DIR", required=True, help="folder of the results")
    p.add_argument("--json", action="store_true", help=AS_JSON)
    _add_changes(p)
    _add_effort(p)


def _replay_options(p: Parser) -> None:
    p.add_argument(
        "log", metavar="LOG.csv",
        help="log with a header and one row per sample; or LOG.parquet, LOG.mf4",
    )  # fmt: skip
    p.add_argument(
        "--with", metavar="STUDY:LOOP.PART", required=True, dest="block",
        help="block to run over the log: a part of a loop, a model, FILE:BLOCK or an equation",
    )  # fmt: skip
    p.add_argument(
        "--map", metavar="INPUT=COLUMN[UNIT]", nargs="+", action="extend", default=[],
        dest="mapped", help="column of each input; with arithmetic, omega='Speed[km/h] / r'",
    )  # fmt: skip
    p.add_argument(
        "--beside", metavar="OUTPUT=COLUMN[UNIT]", nargs="+", action="extend", default=[],
        help="recorded column that an output is compared with",
    )  # fmt: skip
    p.add_argument(
        "--set", metavar="NAME=VALUE[UNIT]", nargs="+", action="extend", default=[],
        dest="settings", help="inputs without a column, parameters and start values",
    )  # fmt: skip
    p.add_argument(
        "--time", metavar="COLUMN[UNIT]",
        help="column of the time (default: the column with such a name)",
    )  # fmt: skip
    p.add_argument(
        "--decimal", choices=(".", ","), help="decimal mark, where 1.234 may be read in two ways"
    )
    p.add_argument(
        "--period", metavar="T",
        help="sample time, 10ms (default: that of the block, else of the log)",
    )  # fmt: skip
    p.add_argument(
        "--resample", choices=("hold", "linear"), default="hold",
        help="resampling to ticks (default: hold, the last sample before the tick)",
    )  # fmt: skip
    p.add_argument(
        "--gap", metavar="T",
        help="interval between samples that counts as a gap, 0.2s (default: 5 usual intervals)",
    )  # fmt: skip
    p.add_argument("--out", metavar="DIR", required=True, help="folder of the results")
    p.add_argument("--json", action="store_true", help=AS_JSON)
    p.add_argument("--no-compile", action="store_true", help="do not use a C compiler")


def _compare_options(p: Parser) -> None:
    p.add_argument(
        "folders", metavar="DIR", nargs="+",
        help="folder of a run, of a sweep, or of several sweeps",
    )  # fmt: skip
    p.add_argument("--json", action="store_true", help=AS_JSON)


def _fit_options(p: Parser) -> None:
    p.add_argument(
        "curve", metavar="CURVE.csv", nargs="+",
        help="curve with a header and one row per point; for a flow, logs as for replay",
    )  # fmt: skip
    p.add_argument(
        "--law", metavar="NAME", required=True, help="a law or a flow of the models, or file:law"
    )
    p.add_argument(
        "--set", metavar="NAME=VALUE[UNIT]", nargs="+", action="extend", default=[],
        dest="settings", help="known parameters, and inputs that do not vary, Q=106.7kN v=10m/s",
    )  # fmt: skip
    p.add_argument(
        "--unknown", metavar="NAME,NAME",
        help="parameters to fit (default: those that rail conditions set)",
    )  # fmt: skip
    p.add_argument(
        "--start", metavar="NAME=VALUE[UNIT]", nargs="+", action="extend", default=[],
        dest="starts", help="start values of the search (default: the law's own values)",
    )  # fmt: skip
    p.add_argument(
        "--ordered", action="store_true",
        help="keep the order of parameters that the law expects, k_A >= k_S",
    )  # fmt: skip
    p.add_argument(
        "--map", "--column", metavar="NAME=COLUMN[UNIT]", nargs="+", action="extend", default=[],
        dest="mapped",
        help="column of each signal, v=Speed[km/h]; with arithmetic, v_s='slip * v / 100'",
    )  # fmt: skip
    p.add_argument(
        "--decimal", choices=(".", ","), help="decimal mark, where 1.234 may be read in two ways"
    )
    p.add_argument("--time", metavar="COLUMN[UNIT]", help="column of the time, as for replay")
    p.add_argument(
        "--gap", metavar="T",
        help="interval between samples that counts as a gap, 0.2s (default: 5 usual intervals)",
    )  # fmt: skip
    p.add_argument(
        "--between", metavar="FROM:TO",
        help="use only this time span after the first sample, 12s:95s",
    )  # fmt: skip
    p.add_argument(
        "--resample", choices=("hold", "linear"),
        help="interpolation of inputs between samples (default: hold)",
    )  # fmt: skip
    p.add_argument("--delay", metavar="INPUT", help="also fit the dead time of this input")
    p.add_argument("--out", metavar="DIR", required=True, help="folder of the results")
    p.add_argument("--json", action="store_true", help=AS_JSON)


def _c_options(p: Parser) -> None:
    p.add_argument("name", metavar="NAME", help="STUDY:LOOP, FILE.toml:LOOP, or a block's name")
    p.add_argument("--out", metavar="DIR", required=True, help="folder of the C files")
    p.add_argument("--json", action="store_true", help=AS_JSON)
    p.add_argument("--check", action="store_true", help="compile it and compare it with Python")
    p.add_argument(
        "--real", choices=("double", "float"), default="double", help="type of every number in C"
    )
    p.add_argument(
        "--target", metavar="host|cortex-m4|cortex-m7", default="host",
        help="also compile it for this processor, and with --check run it there; separate two by "
        "a comma",
    )  # fmt: skip
    p.add_argument(
        "--clock", metavar="168MHz",
        help="processor clock for which the load is reported (default: 25 MHz, that of the board)",
    )  # fmt: skip
    p.add_argument(
        "--misra", action="store_true", help="count the findings of cppcheck and MISRA C:2012"
    )
    p.add_argument(
        "--vectors", metavar="FILE.csv|search[:SECONDS]",
        help="test it with these inputs, one row per tick, instead of those of a run; or search "
        "for inputs that reach the branches which the test leaves out",
    )  # fmt: skip
    p.add_argument(
        "--fuzz", metavar="SECONDS", type=int,
        help="fuzz it for this time, by libFuzzer with sanitizers",
    )  # fmt: skip
    p.add_argument(
        "--prove", action="store_true",
        help="let Frama-C prove that no run-time error occurs and that values stay in their ranges",
    )  # fmt: skip
    _written_beside(p)
    p.add_argument(
        "--set", metavar="BLOCK.PARAM=VALUE[UNIT]", nargs="+", action="extend", default=[],
        dest="settings", help="set parameters of the loop, or FILE.toml with gains",
    )  # fmt: skip
    p.add_argument(
        "--part", metavar="PART",
        help="part of the loop to write instead of the controller, such as plant",
    )  # fmt: skip
    p.add_argument(
        "--name", metavar="MODULE", dest="module",
        help="name of its files and functions (default: that of the loop or block)",
    )  # fmt: skip


def _written_beside(p: Parser) -> None:
    p.add_argument("--fmu", action="store_true", help="also write FMUs, by FMI 2.0 and 3.0")
    p.add_argument(
        "--platforms", metavar="linux64,win64",
        help="platforms of the binaries in the FMUs (default: all for which a compiler is "
        "installed)",
    )  # fmt: skip
    p.add_argument(
        "--scaled", metavar="NAME=uint16:0.01m/s[:OFFSET]", nargs="+", action="extend", default=[],
        help="inputs and outputs that the bus carries as integers of this type, resolution and "
        "offset",
    )  # fmt: skip
    p.add_argument(
        "--rates", action="store_true",
        help="also write one step function for each rate of its parts, such as step_5ms",
    )  # fmt: skip
    p.add_argument(
        "--counter", action="store_true",
        help="also write a step that takes the tick number, and detects repeated and late calls",
    )  # fmt: skip
    p.add_argument("--const-section", metavar="SECTION", help="linker section of the tables")
    p.add_argument(
        "--calibration-section", metavar="SECTION",
        help="also write an instance of the parameters, in this linker section",
    )  # fmt: skip
    p.add_argument(
        "--byte-order", choices=("little", "big"), default="little",
        help="byte order of the processor, for the A2L (default: little, as ARM and x86)",
    )  # fmt: skip
    p.add_argument(
        "--xcp", action="store_true",
        help="also write an XCP slave, and a program with it for the emulated board",
    )  # fmt: skip
    p.add_argument(
        "--autosar", action="store_true",
        help="also write a software component of AUTOSAR Classic around it, as C and ARXML",
    )  # fmt: skip


def _pil_options(p: Parser) -> None:
    p.add_argument("name", metavar="STUDY:LOOP", help="or STUDY:LOOP@SCENARIO, FILE.toml:LOOP")
    p.add_argument("--target", metavar="cortex-m4|cortex-m7", default="cortex-m4")
    p.add_argument("--real", choices=("double", "float"), default="double")
    p.add_argument(
        "--clock", metavar="168MHz",
        help="processor clock for which the load is reported (default: 25 MHz, that of the board)",
    )  # fmt: skip
    p.add_argument(
        "--fault", metavar="TICK=WHAT", nargs="+", action="extend", default=[], dest="faults",
        help="fault to inject into the frame of a tick: lost, late or broken",
    )  # fmt: skip
    p.add_argument(
        "--seconds", metavar="S", type=float,
        help="duration of the run (default: that of the scenario)",
    )  # fmt: skip
    p.add_argument("--out", metavar="FILE", help="write the comparison as JSON")
    p.add_argument("--json", action="store_true", help=AS_JSON)


def _certify_options(p: Parser) -> None:
    p.add_argument(
        "system", metavar="SYSTEM|STUDY[:LOOP]", nargs="?",
        help="system such as super_twisting, or a study or one of its loops; none: list the "
        "systems",
    )  # fmt: skip
    p.add_argument(
        "--set", metavar="NAME=VALUE[UNIT]", nargs="+", action="extend", default=[],
        dest="settings", help="gains and bounds of a system, k1=1.5 k2=1.1 L=1 in SI or in units;"
        " parameters of a loop, as slipctl run has them, or FILE.toml with gains",
    )  # fmt: skip
    p.add_argument("--json", action="store_true", help=AS_JSON)
    p.add_argument("--out", metavar="FILE", help="write the certificate, a file for slipctl check")
    p.add_argument(
        "--map", metavar="X[=LO:HI],Y[=LO:HI]",
        help="map where two parameters are certified, refuted or undecided; --out is then a folder",
    )  # fmt: skip
    p.add_argument(
        "--points", metavar="N", type=int, default=25,
        help="points of the map along each axis (default: 25)",
    )  # fmt: skip
    p.add_argument(
        "--metric", metavar="NAME", help="metric whose level lines are drawn into the map of a loop"
    )
    p.add_argument(
        "--largest", metavar="NAME",
        help="find the largest certified and the smallest refuted value of a parameter, such as "
        "lag; --out is then a folder",
    )  # fmt: skip
    p.add_argument(
        "--smallest", metavar="NAME",
        help="find the smallest certified and the largest refuted value of a parameter",
    )  # fmt: skip


def _check_options(p: Parser) -> None:
    p.add_argument("file", metavar="FILE", help="certificate that certify or tune wrote")
    p.add_argument("--json", action="store_true", help=AS_JSON)
    p.add_argument(
        "--rerun", metavar="N", type=int,
        help="run N draws of a statement again, from the study or file that the statement names",
    )  # fmt: skip


COMMANDS: dict[str, tuple[str, Callable[[Parser], None]]] = {
    "list": (
        "List studies, models, and the kinds of parts of a vehicle file.",
        library.list_options,
    ),
    "show": ("Show equations, signals, units, sources and Jacobian of NAME.", library.show_options),
    "new": ("Write a vehicle file, to be edited and run.", library.new_options),
    "open": (
        "Open the workbench: run, region of gains and C follow each edit.",
        library.open_options,
    ),
    "schema": ("Print the JSON schema of the files that describe a vehicle.", _no_options),
    "copy": ("Copy the source of a model to a file of your own, to edit it.", library.copy_options),
    "run": ("Run a study: metrics, claims, logs, figures and a report.", _run_options),
    "sweep": (
        "Run a loop with many sets of numbers, on all cores; resume and extend the sweep.",
        _sweep_options,
    ),
    "tune": (
        "Find gains on an ensemble: proof first, then simulation, then fresh draws.",
        _tune_options,
    ),
    "replay": ("Run an estimator or a controller over a recorded log.", _replay_options),
    "compare": (
        "Compare runs and sweeps: first what was changed, then their metrics.",
        _compare_options,
    ),
    "fit": (
        "Fit a law to a measured curve, or a flow (coasting, brake_step) to logs.",
        _fit_options,
    ),
    "c": ("Write a controller, from sensor to actuator, as C.", _c_options),
    "pil": ("Run a loop with its controller on an emulated processor, tick by tick.", _pil_options),
    "certify": (
        "Prove or refute what gains withstand: verdicts, margins and the worst disturbance.",
        _certify_options,
    ),
    "check": (
        ("Check a certificate by rational arithmetic alone, without the code that found it."),
        _check_options,
    ),
    "docs": ("Open the pages of slipctl in a browser; they need no network.", library.docs_options),
}
"""Commands in the order of the help, each with its line there and its options."""
