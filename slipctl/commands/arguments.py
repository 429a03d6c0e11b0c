"""What may be typed: commands and their options."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any, NoReturn

from slipctl import __version__
from slipctl.commands import examples
from slipctl.commands.library import arguments as library
from slipctl.commands.library.arguments import AS_JSON, option
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
    option(p, "--set BLOCK.PARAM=VALUE[UNIT] ...", "set a parameter or start value in every run",
           dest="settings")  # fmt: skip
    option(p, "--swap NAME=FILE:BLOCK ...", "replace a model of the study", dest="swaps")


def _add_effort(p: Parser) -> None:
    """Options of many runs that say what may compute them."""
    option(p, "--jobs N", "number of parallel runs (default: all cores)", type=int)
    option(p, "--no-compile", "do not use a C compiler")


def _run_options(p: Parser) -> None:
    option(p, "--json", "print metrics and claims as JSON")
    p.add_argument("study", metavar="STUDY", help="a study, or the file of a vehicle")
    option(p, "--out DIR", "folder of the results (default: out/STUDY)")
    option(p, "--set [LOOP:]BLOCK.PARAM=VALUE[UNIT] ...", "set a parameter or start value,"
           " car.m=8.2t; '*.m=8t' sets every m", dest="settings")  # fmt: skip
    option(p, "--swap NAME=FILE:BLOCK ...", "replace a model of the study, adh=my.py:my_law or"
           " adh=my.toml:law", dest="swaps")  # fmt: skip
    option(p, "--loop L ...", "run only these loops", dest="loops")
    option(p, "--scenario S ...", "run only these scenarios (default: base and real)",
           dest="scenarios")  # fmt: skip
    option(p, "--full", "run all scenarios and experiments, on all cores; results that an"
           " interrupted run has finished are kept")  # fmt: skip
    option(p, "--jobs N", "number of parallel processes (default: all cores)", type=int)
    option(p, "--quick", "shorter and fewer runs, for tests of a study")
    option(p, "--no-compile", "do not use a C compiler")


def _sweep_options(p: Parser) -> None:
    p.add_argument(
        "name", metavar="STUDY:LOOP", nargs="?",
        help="or STUDY:LOOP@SCENARIO, FILE.toml:LOOP; STUDY or FILE.toml alone takes all loops on"
        " the same draws",
    )  # fmt: skip
    option(p, "--vary P=LO:HI[:N] ...", "P=lo:hi:n is a grid axis of n values, P=lo:hi a uniform"
           " draw; ends may have units", dest="varied")  # fmt: skip
    option(p, "--samples N", "number of draws, at each point of a grid where there is one"
           " (default: 1)", type=int, default=1)  # fmt: skip
    option(p, "--seed S", "seed of the draws (default: 1)", type=int, default=1)
    option(p, "--design", "sampling method; a Latin hypercube (lhs) cannot be extended",
           choices=("random", "sobol", "lhs"), default="random")  # fmt: skip
    option(p, "--out DIR", "folder of the sweep", required=True)
    option(p, "--export FILE.nc", "also write metrics and logs of all runs as one netCDF file, or"
           " DIR.zarr")  # fmt: skip
    option(p, "--scheduler tcp://HOST:PORT", "compute on the workers of this Dask scheduler (extra"
           " dask); results are the same to the bit")  # fmt: skip
    option(p, "--mixed", "also use machines with another processor or mathematics library")
    option(p, "--json", AS_JSON)
    _add_changes(p)
    option(p, "--log SIGNAL ...", "store these signals over time, for every run", dest="logs")
    _add_effort(p)


def _tune_options(p: Parser) -> None:
    p.add_argument(
        "name", metavar="STUDY:LOOP", nargs="?", help="or STUDY:LOOP@SCENARIO, FILE.toml:LOOP"
    )
    option(p, "--free P=LO:HI ...", "parameters to search, each in its range; the limits may have"
           " units")  # fmt: skip
    option(p, "--minimise METRIC ...", "a metric, or a weighted sum: 'distance +"
           " 0.001*torque_ripple'; several give a front", dest="objective")  # fmt: skip
    option(p, "--subject-to LIMIT ...", "'torque_ripple<=8kN m' in every draw,"
           " 'slip_max@0.95<=2m/s' in 95 %% of them, 'margin>=1.2' of the certificates, certified",
           dest="limits")  # fmt: skip
    option(p, "--samples N", "draws on which the search judges gains (default: 20)",
           type=int, default=20)  # fmt: skip
    option(p, "--seed S", "seed of draws and search (default: 1)", type=int, default=1)
    option(p, "--ensemble FILE.toml", "file that says what varies from draw to draw (default: the"
           " study's declaration)")  # fmt: skip
    option(p, "--held-out N", "fresh draws on which the result is judged (default: 200)",
           type=int, default=200)  # fmt: skip
    option(p, "--runs N", "largest number of runs of the search (default: 250 per parameter and"
           " metric)", type=int)  # fmt: skip
    option(p, "--prove", "state what 1375 fresh draws prove of 99 %% of all draws, with confidence"
           " 1 - 1e-6")  # fmt: skip
    option(p, "--out DIR", "folder of the results", required=True)
    option(p, "--json", AS_JSON)
    _add_changes(p)
    _add_effort(p)


def _replay_options(p: Parser) -> None:
    p.add_argument(
        "log", metavar="LOG.csv",
        help="log with a header and one row per sample; or LOG.parquet, LOG.mf4",
    )  # fmt: skip
    option(p, "--with STUDY:LOOP.PART", "block to run over the log: a part of a loop, a model,"
           " FILE:BLOCK or an equation", required=True, dest="block")  # fmt: skip
    option(p, "--map INPUT=COLUMN[UNIT] ...", "column of each input; with arithmetic,"
           " omega='Speed[km/h] / r'", dest="mapped")  # fmt: skip
    option(p, "--beside OUTPUT=COLUMN[UNIT] ...", "recorded column that an output is compared with")
    option(p, "--set NAME=VALUE[UNIT] ...", "inputs without a column, parameters and start values",
           dest="settings")  # fmt: skip
    option(p, "--time COLUMN[UNIT]", "column of the time (default: the column with such a name)")
    option(p, "--decimal", "decimal mark, where 1.234 may be read in two ways", choices=(".", ","))
    option(p, "--period T", "sample time, 10ms (default: that of the block, else of the log)")
    option(p, "--resample", "resampling to ticks (default: hold, the last sample before the tick)",
           choices=("hold", "linear"), default="hold")  # fmt: skip
    option(p, "--gap T", "interval between samples that counts as a gap, 0.2s (default: 5 usual"
           " intervals)")  # fmt: skip
    option(p, "--out DIR", "folder of the results", required=True)
    option(p, "--json", AS_JSON)
    option(p, "--no-compile", "do not use a C compiler")


def _compare_options(p: Parser) -> None:
    p.add_argument(
        "folders", metavar="DIR", nargs="+",
        help="folder of a run, of a sweep, or of several sweeps",
    )  # fmt: skip
    option(p, "--json", AS_JSON)


def _fit_options(p: Parser) -> None:
    p.add_argument(
        "curve", metavar="CURVE.csv", nargs="+",
        help="curve with a header and one row per point; for a flow, logs as for replay",
    )  # fmt: skip
    option(p, "--law NAME", "a law or a flow of the models, or file:law", required=True)
    option(p, "--set NAME=VALUE[UNIT] ...", "known parameters, and inputs that do not vary,"
           " Q=106.7kN v=10m/s", dest="settings")  # fmt: skip
    option(p, "--unknown NAME,NAME", "parameters to fit (default: those that rail conditions set)")
    option(p, "--start NAME=VALUE[UNIT] ...", "start values of the search (default: the law's own"
           " values)", dest="starts")  # fmt: skip
    option(p, "--ordered", "keep the order of parameters that the law expects, k_A >= k_S")
    option(p, "--map|--column NAME=COLUMN[UNIT] ...", "column of each signal, v=Speed[km/h]; with"
           " arithmetic, v_s='slip * v / 100'", dest="mapped")  # fmt: skip
    option(p, "--decimal", "decimal mark, where 1.234 may be read in two ways", choices=(".", ","))
    option(p, "--time COLUMN[UNIT]", "column of the time, as for replay")
    option(p, "--gap T", "interval between samples that counts as a gap, 0.2s (default: 5 usual"
           " intervals)")  # fmt: skip
    option(p, "--between FROM:TO", "use only this time span after the first sample, 12s:95s")
    option(p, "--resample", "interpolation of inputs between samples (default: hold)",
           choices=("hold", "linear"))  # fmt: skip
    option(p, "--delay INPUT", "also fit the dead time of this input")
    option(p, "--out DIR", "folder of the results", required=True)
    option(p, "--json", AS_JSON)


def _c_options(p: Parser) -> None:
    p.add_argument("name", metavar="NAME", help="STUDY:LOOP, FILE.toml:LOOP, or a block's name")
    option(p, "--out DIR", "folder of the C files", required=True)
    option(p, "--json", AS_JSON)
    option(p, "--check", "compile it and compare it with Python")
    option(p, "--real", "type of every number in C", choices=("double", "float"), default="double")
    option(p, "--target host|cortex-m4|cortex-m7", "also compile it for this processor, and with"
           " --check run it there; separate two by a comma", default="host")  # fmt: skip
    option(p, "--clock 168MHz", "processor clock for which the load is reported (default: 25 MHz,"
           " that of the board)")  # fmt: skip
    option(p, "--misra", "count the findings of cppcheck and MISRA C:2012")
    option(p, "--vectors FILE.csv|search[:SECONDS]", "test it with these inputs, one row per tick,"
           " instead of those of a run; or search for inputs that reach the branches which the"
           " test leaves out")  # fmt: skip
    option(p, "--fuzz SECONDS", "fuzz it for this time, by libFuzzer with sanitizers", type=int)
    option(p, "--prove", "let Frama-C prove that no run-time error occurs and that values stay in"
           " their ranges")  # fmt: skip
    _written_beside(p)
    option(p, "--set BLOCK.PARAM=VALUE[UNIT] ...", "set parameters of the loop, or FILE.toml with"
           " gains", dest="settings")  # fmt: skip
    option(p, "--part PART", "part of the loop to write instead of the controller, such as plant")
    option(p, "--name MODULE", "name of its files and functions (default: that of the loop or"
           " block)", dest="module")  # fmt: skip


def _written_beside(p: Parser) -> None:
    option(p, "--fmu", "also write FMUs, by FMI 2.0 and 3.0")
    option(p, "--platforms linux64,win64", "platforms of the binaries in the FMUs (default: all"
           " for which a compiler is installed)")  # fmt: skip
    option(p, "--scaled NAME=uint16:0.01m/s[:OFFSET] ...", "inputs and outputs that the bus"
           " carries as integers of this type, resolution and offset")  # fmt: skip
    option(p, "--rates", "also write one step function for each rate of its parts, such as"
           " step_5ms")  # fmt: skip
    option(p, "--counter", "also write a step that takes the tick number, and detects repeated and"
           " late calls")  # fmt: skip
    option(p, "--const-section SECTION", "linker section of the tables")
    option(p, "--calibration-section SECTION", "also write an instance of the parameters, in this"
           " linker section")  # fmt: skip
    option(p, "--byte-order", "byte order of the processor, for the A2L (default: little, as ARM"
           " and x86)", choices=("little", "big"), default="little")  # fmt: skip
    option(p, "--xcp", "also write an XCP slave, and a program with it for the emulated board")
    option(p, "--autosar", "also write a software component of AUTOSAR Classic around it, as C and"
           " ARXML")  # fmt: skip


def _pil_options(p: Parser) -> None:
    p.add_argument("name", metavar="STUDY:LOOP", help="or STUDY:LOOP@SCENARIO, FILE.toml:LOOP")
    option(p, "--target cortex-m4|cortex-m7", default="cortex-m4")
    option(p, "--real", choices=("double", "float"), default="double")
    option(p, "--clock 168MHz", "processor clock for which the load is reported (default: 25 MHz,"
           " that of the board)")  # fmt: skip
    option(p, "--fault TICK=WHAT ...", "fault to inject into the frame of a tick: lost, late or"
           " broken", dest="faults")  # fmt: skip
    option(p, "--seconds S", "duration of the run (default: that of the scenario)", type=float)
    option(p, "--out FILE", "write the comparison as JSON")
    option(p, "--json", AS_JSON)


def _certify_options(p: Parser) -> None:
    p.add_argument(
        "system", metavar="SYSTEM|STUDY[:LOOP]", nargs="?",
        help="system such as super_twisting, or a study or one of its loops; none: list the "
        "systems",
    )  # fmt: skip
    option(p, "--set NAME=VALUE[UNIT] ...", "gains and bounds of a system, k1=1.5 k2=1.1 L=1 in SI"
           " or in units; parameters of a loop, as slipctl run has them, or FILE.toml with gains",
           dest="settings")  # fmt: skip
    option(p, "--json", AS_JSON)
    option(p, "--out FILE", "write the certificate, a file for slipctl check")
    option(p, "--map X[=LO:HI],Y[=LO:HI]", "map where two parameters are certified, refuted or"
           " undecided; --out is then a folder")  # fmt: skip
    option(p, "--points N", "points of the map along each axis (default: 25)", type=int, default=25)
    option(p, "--metric NAME", "metric whose level lines are drawn into the map of a loop")
    option(p, "--largest NAME", "find the largest certified and the smallest refuted value of a"
           " parameter, such as lag; --out is then a folder")  # fmt: skip
    option(p, "--smallest NAME", "find the smallest certified and the largest refuted value of a"
           " parameter")  # fmt: skip


def _check_options(p: Parser) -> None:
    p.add_argument("file", metavar="FILE", help="certificate that certify or tune wrote")
    option(p, "--json", AS_JSON)
    option(p, "--rerun N", "run N draws of a statement again, from the study or file that the"
           " statement names", type=int)  # fmt: skip


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
