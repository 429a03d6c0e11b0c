"""What may be typed: commands and their options."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any, NoReturn

from slipctl import __version__
from slipctl.commands import examples
from slipctl.errors import BadInput, nearest

AS_JSON = "answer as JSON"


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


def _list_options(p: Parser) -> None:
    p.add_argument(
        "word", metavar="TOPIC|WORD", nargs="?",
        help="studies, models or kinds; or a word in their names or meanings",
    )  # fmt: skip
    p.add_argument("--json", action="store_true", help=AS_JSON)


def _show_options(p: Parser) -> None:
    p.add_argument("name", metavar="NAME")
    p.add_argument("--latex", action="store_true", help="equations as LaTeX")
    p.add_argument("--graph", action="store_true", help="block diagram as DOT")
    p.add_argument("--against", metavar="OTHER", help="what differs from another NAME")
    p.add_argument("--json", action="store_true", help=AS_JSON)


def _new_options(p: Parser) -> None:
    p.add_argument(
        "kind", metavar="KIND", nargs="?", help="metro: a metro car of 38 t and a patch of leaves"
    )
    p.add_argument("file", metavar="FILE", nargs="?", help="of the vehicle (KIND.toml)")
    p.add_argument("--json", action="store_true", help=AS_JSON)
    p.add_argument(
        "--from", metavar="STUDY:LOOP[@SCENARIO]", dest="source",
        help="write this loop of a study instead, with all of its numbers, to KIND or LOOP.toml",
    )  # fmt: skip


def _open_options(p: Parser) -> None:
    p.add_argument(
        "name", metavar="FILE.toml|STUDY[:LOOP]", nargs="?",
        help="what to open; without it metro.toml, written here if it is not there",
    )  # fmt: skip
    p.add_argument("--port", metavar="N", type=int, help="of this machine (one that is free)")
    p.add_argument("--no-browser", action="store_true", help="only print the address")
    p.add_argument(
        "--python", metavar="FILE.py", nargs="+", action="extend", default=[], dest="files",
        help="Python files that the file may name; no others are ever imported",
    )  # fmt: skip
    p.add_argument("--no-compile", action="store_true", help="do not use a C compiler")


def _copy_options(p: Parser) -> None:
    p.add_argument("model", metavar="MODEL")
    p.add_argument("file", metavar="FILE")
    p.add_argument("--json", action="store_true", help=AS_JSON)


def _run_options(p: Parser) -> None:
    p.add_argument("--json", action="store_true", help="print metrics and claims as JSON")
    p.add_argument("study", metavar="STUDY")
    p.add_argument("--out", metavar="DIR", help="folder of the results (out/STUDY)")
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
        help="run these loops only",
    )  # fmt: skip
    p.add_argument(
        "--scenario", metavar="S", nargs="+", action="extend", default=[], dest="scenarios",
        help="run these scenarios only; without it base and real run",
    )  # fmt: skip
    p.add_argument(
        "--full", action="store_true",
        help="run all scenarios and experiments, on all cores; what an interrupted run has finished"
        " is not done again",
    )  # fmt: skip
    p.add_argument("--jobs", metavar="N", type=int, help="run so many things at once (all cores)")
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
        help="runs of each point of the grid, where something is drawn (1)",
    )  # fmt: skip
    p.add_argument("--seed", metavar="S", type=int, default=1, help="of the draws (1)")
    p.add_argument(
        "--design", choices=("random", "sobol", "lhs"), default="random",
        help="how numbers are drawn; lhs cannot be extended",
    )  # fmt: skip
    p.add_argument("--out", metavar="DIR", required=True, help="folder of the sweep")
    p.add_argument(
        "--export", metavar="FILE.nc",
        help="write metrics and logs of all runs as one labelled netCDF file, or DIR.zarr",
    )  # fmt: skip
    p.add_argument(
        "--scheduler", metavar="tcp://HOST:PORT",
        help="roll on the workers of this Dask scheduler (extra dask), with the same bits",
    )  # fmt: skip
    p.add_argument(
        "--mixed", action="store_true",
        help="let machines with another processor or library of mathematics compute too",
    )  # fmt: skip
    p.add_argument("--json", action="store_true", help=AS_JSON)
    p.add_argument(
        "--set", metavar="BLOCK.PARAM=VALUE[UNIT]", nargs="+", action="extend", default=[],
        dest="settings", help="set a parameter or start value in every run",
    )  # fmt: skip
    p.add_argument(
        "--swap", metavar="NAME=FILE:BLOCK", nargs="+", action="extend", default=[], dest="swaps",
        help="replace a model of the study",
    )  # fmt: skip
    p.add_argument(
        "--log", metavar="SIGNAL", nargs="+", action="extend", default=[], dest="logs",
        help="keep these signals over time, of every run",
    )  # fmt: skip
    p.add_argument("--jobs", metavar="N", type=int, help="runs at once (all cores)")
    p.add_argument("--no-compile", action="store_true", help="do not use a C compiler")


def _tune_options(p: Parser) -> None:
    p.add_argument(
        "name", metavar="STUDY:LOOP", nargs="?", help="or STUDY:LOOP@SCENARIO, FILE.toml:LOOP"
    )
    p.add_argument(
        "--free", metavar="P=LO:HI", nargs="+", action="extend", default=[], dest="free",
        help="numbers that are searched, each in its range; ends may have units",
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
    p.add_argument("--samples", metavar="N", type=int, default=20, help="draws of the search (20)")
    p.add_argument("--seed", metavar="S", type=int, default=1, help="of draws and search (1)")
    p.add_argument(
        "--ensemble", metavar="FILE.toml", help="what differs from draw to draw (as declared)"
    )
    p.add_argument(
        "--held-out", metavar="N", type=int, default=200, help="draws of the judgement (200)"
    )
    p.add_argument(
        "--runs", metavar="N", type=int, help="most runs of the search (250 a number and metric)"
    )
    p.add_argument(
        "--prove", action="store_true",
        help="state what 1375 fresh draws prove: 99 %% of all draws, confidence 1 - 1e-6",
    )  # fmt: skip
    p.add_argument("--out", metavar="DIR", required=True, help="folder of the results")
    p.add_argument("--json", action="store_true", help=AS_JSON)
    p.add_argument(
        "--set", metavar="BLOCK.PARAM=VALUE[UNIT]", nargs="+", action="extend", default=[],
        dest="settings", help="set a parameter or start value in every run",
    )  # fmt: skip
    p.add_argument(
        "--swap", metavar="NAME=FILE:BLOCK", nargs="+", action="extend", default=[], dest="swaps",
        help="replace a model of the study",
    )  # fmt: skip
    p.add_argument("--jobs", metavar="N", type=int, help="runs at once (all cores)")
    p.add_argument("--no-compile", action="store_true", help="do not use a C compiler")


def _replay_options(p: Parser) -> None:
    p.add_argument(
        "log", metavar="LOG.csv", help="a head and a row per sample; or LOG.parquet, LOG.mf4"
    )
    p.add_argument(
        "--with", metavar="STUDY:LOOP.PART", required=True, dest="block",
        help="what runs over it: a part of a loop, a model, FILE:BLOCK or an equation",
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
        "--time", metavar="COLUMN[UNIT]", help="column of the times (the one that is called so)"
    )
    p.add_argument(
        "--decimal", choices=(".", ","), help="decimal mark, where 1.234 could be either"
    )
    p.add_argument("--period", metavar="T", help="tick, 10ms (that of the block, else of the log)")
    p.add_argument(
        "--resample", choices=("hold", "linear"), default="hold",
        help="how samples become values of ticks (hold: the last one before)",
    )  # fmt: skip
    p.add_argument("--gap", metavar="T", help="from when on there is a gap, 0.2s (5 samples)")
    p.add_argument("--out", metavar="DIR", required=True, help="folder of the results")
    p.add_argument("--json", action="store_true", help=AS_JSON)
    p.add_argument("--no-compile", action="store_true", help="do not use a C compiler")


def _compare_options(p: Parser) -> None:
    p.add_argument(
        "folders",
        metavar="DIR",
        nargs="+",
        help="folder of a run, of a sweep, or of several sweeps",
    )
    p.add_argument("--json", action="store_true", help=AS_JSON)


def _fit_options(p: Parser) -> None:
    p.add_argument(
        "curve", metavar="CURVE.csv", nargs="+",
        help="a head and a row per point; for a flow logs, as of replay",
    )  # fmt: skip
    p.add_argument(
        "--law", metavar="NAME", required=True, help="a law or a flow of the models, or file:law"
    )
    p.add_argument(
        "--set", metavar="NAME=VALUE[UNIT]", nargs="+", action="extend", default=[],
        dest="settings", help="known parameters, and inputs that do not vary, Q=106.7kN v=10m/s",
    )  # fmt: skip
    p.add_argument(
        "--unknown", metavar="NAME,NAME", help="parameters to find (those of the rail conditions)"
    )
    p.add_argument(
        "--start", metavar="NAME=VALUE[UNIT]", nargs="+", action="extend", default=[],
        dest="starts", help="where the search starts (the law's own values)",
    )  # fmt: skip
    p.add_argument(
        "--ordered", action="store_true", help="keep the order that the law expects, k_A >= k_S"
    )
    p.add_argument(
        "--map", "--column", metavar="NAME=COLUMN[UNIT]", nargs="+", action="extend", default=[],
        dest="mapped",
        help="column of each signal, v=Speed[km/h]; with arithmetic, v_s='slip * v / 100'",
    )  # fmt: skip
    p.add_argument(
        "--decimal", choices=(".", ","), help="decimal mark, where 1.234 could be either"
    )
    p.add_argument("--time", metavar="COLUMN[UNIT]", help="column of the times, as of replay")
    p.add_argument("--gap", metavar="T", help="from when on there is a gap, 0.2s (5 samples)")
    p.add_argument(
        "--between", metavar="FROM:TO", help="only this part, behind the first sample, 12s:95s"
    )
    p.add_argument(
        "--resample", choices=("hold", "linear"),
        help="how an input goes from sample to sample (hold)",
    )  # fmt: skip
    p.add_argument("--delay", metavar="INPUT", help="seek the dead time of this input too")
    p.add_argument("--out", metavar="DIR", required=True, help="folder of the results")
    p.add_argument("--json", action="store_true", help=AS_JSON)


def _c_options(p: Parser) -> None:
    p.add_argument("name", metavar="NAME")
    p.add_argument("--out", metavar="DIR", required=True, help="folder of the C files")
    p.add_argument("--json", action="store_true", help=AS_JSON)
    p.add_argument("--check", action="store_true", help="compile it and compare it with Python")
    p.add_argument(
        "--real", choices=("double", "float"), default="double", help="type of every number in C"
    )
    p.add_argument(
        "--target", metavar="host|cortex-m4|cortex-m7", default="host",
        help="compile it for this processor too, and with --check run it there; two with a comma",
    )  # fmt: skip
    p.add_argument(
        "--clock", metavar="168MHz",
        help="clock of the processor that its load is told for; by default 25 MHz, the board's",
    )  # fmt: skip
    p.add_argument(
        "--misra", action="store_true", help="count findings of cppcheck and of MISRA C:2012"
    )

    p.add_argument(
        "--vectors", metavar="FILE.csv|search[:SECONDS]",
        help="test it with these inputs, a row for each tick, in the place of those of a run; or"
        " search for what else reaches branches that its test does not",
    )  # fmt: skip
    p.add_argument(
        "--fuzz", metavar="SECONDS", type=int,
        help="feed it any bytes for so long, by libFuzzer with sanitizers",
    )  # fmt: skip
    p.add_argument(
        "--prove", action="store_true",
        help="let Frama-C prove that nothing goes wrong at run time and that ranges are kept",
    )  # fmt: skip
    p.add_argument("--fmu", action="store_true", help="write FMUs too, by FMI 2.0 and 3.0")
    p.add_argument(
        "--platforms", metavar="linux64,win64",
        help="what the FMUs hold binaries for; by default each that a compiler is installed for",
    )  # fmt: skip
    p.add_argument(
        "--scaled", metavar="NAME=uint16:0.01m/s[:OFFSET]", nargs="+", action="extend", default=[],
        help="inputs and outputs that a bus has as integers of this type, resolution and offset",
    )  # fmt: skip
    p.add_argument(
        "--rates", action="store_true",
        help="write a step function for each rate of its parts too, such as step_5ms",
    )  # fmt: skip
    p.add_argument(
        "--counter", action="store_true",
        help="write a step too that is told the number of its tick: it sees a call twice or late",
    )  # fmt: skip
    p.add_argument(
        "--const-section", metavar="SECTION", help="section for the linker that tables lie in"
    )
    p.add_argument(
        "--calibration-section", metavar="SECTION",
        help="write an instance of the parameters, too, in this section",
    )  # fmt: skip
    p.add_argument(
        "--byte-order", choices=("little", "big"), default="little",
        help="of the processor, for the A2L (little, as ARM and x86)",
    )  # fmt: skip
    p.add_argument(
        "--xcp", action="store_true",
        help="write an XCP slave too, and a program for the emulated board that has it",
    )  # fmt: skip
    p.add_argument(
        "--autosar", action="store_true",
        help="write a software component of AUTOSAR Classic around it, C and ARXML",
    )  # fmt: skip
    p.add_argument(
        "--set", metavar="BLOCK.PARAM=VALUE[UNIT]", nargs="+", action="extend", default=[],
        dest="settings", help="set parameters of the loop, or FILE.toml with gains",
    )  # fmt: skip
    p.add_argument(
        "--part", metavar="PART", help="another part of the loop than its controller, such as plant"
    )
    p.add_argument(
        "--name", metavar="MODULE", dest="module",
        help="what its files and functions are called; by default the loop or the block",
    )  # fmt: skip


def _pil_options(p: Parser) -> None:
    p.add_argument("name", metavar="STUDY:LOOP", help="or STUDY:LOOP@SCENARIO")
    p.add_argument("--target", metavar="cortex-m4|cortex-m7", default="cortex-m4")
    p.add_argument("--real", choices=("double", "float"), default="double")
    p.add_argument(
        "--clock", metavar="168MHz",
        help="clock of the processor that its load is told for; by default 25 MHz, the board's",
    )  # fmt: skip
    p.add_argument(
        "--fault", metavar="TICK=WHAT", nargs="+", action="extend", default=[], dest="faults",
        help="what happens to the frame of a tick on purpose: lost, late or broken",
    )  # fmt: skip
    p.add_argument(
        "--seconds", metavar="S", type=float, help="run only so long; by default the scenario"
    )
    p.add_argument("--out", metavar="FILE", help="write the comparison as JSON")
    p.add_argument("--json", action="store_true", help=AS_JSON)


def _certify_options(p: Parser) -> None:
    p.add_argument(
        "system",
        metavar="SYSTEM|STUDY[:LOOP]",
        nargs="?",
        help="super_twisting, a study or a loop of it; none: a list",
    )
    p.add_argument(
        "--set", metavar="NAME=VALUE[UNIT]", nargs="+", action="extend", default=[],
        dest="settings", help="gains and bounds of a system, k1=1.5 k2=1.1 L=1 in SI or in units;"
        " parameters of a loop, as slipctl run has them, or FILE.toml with gains",
    )  # fmt: skip
    p.add_argument("--json", action="store_true", help=AS_JSON)
    p.add_argument("--out", metavar="FILE", help="write a certificate for slipctl check")
    p.add_argument(
        "--map", metavar="X[=LO:HI],Y[=LO:HI]",
        help="draw where two numbers are certified, refuted or neither; --out is a folder then",
    )  # fmt: skip
    p.add_argument("--points", metavar="N", type=int, default=25, help="of a map, each way (25)")
    p.add_argument("--metric", metavar="NAME", help="draw its level lines into the map of a loop")
    p.add_argument(
        "--largest", metavar="NAME",
        help="how large a number may be, lag: proved up to here, refuted from there; --out is a"
        " folder then",
    )  # fmt: skip
    p.add_argument("--smallest", metavar="NAME", help="how small it may be")


def _check_options(p: Parser) -> None:
    p.add_argument("file", metavar="FILE")
    p.add_argument("--json", action="store_true", help=AS_JSON)
    p.add_argument(
        "--rerun", metavar="N", type=int,
        help="run N draws of a statement again, from the study or file that it names",
    )  # fmt: skip


def _docs_options(p: Parser) -> None:
    p.add_argument("page", metavar="PAGE", nargs="?", default="index", help="glossary, sweeps, ...")
    p.add_argument("--where", action="store_true", help="only print the file")
    p.add_argument("--json", action="store_true", help="only print the file, as JSON")


COMMANDS: dict[str, tuple[str, Callable[[Parser], None]]] = {
    "list": ("List studies, models, and the kinds of parts of a vehicle's file.", _list_options),
    "show": ("Show equations, signals, units, sources and Jacobian of NAME.", _show_options),
    "new": ("Write a file that describes a vehicle, to edit it and run it.", _new_options),
    "open": ("Open the workbench: edit, see run, region and C at once.", _open_options),
    "schema": ("Print the JSON schema of the files that describe a vehicle.", _no_options),
    "copy": ("Copy the source of a model to a file of your own, to edit it.", _copy_options),
    "run": ("Run a study: metrics, claims, logs, figures and a report.", _run_options),
    "sweep": (
        "Run a loop with many sets of numbers, on all cores; resume and extend.",
        _sweep_options,
    ),
    "tune": ("Find gains on an ensemble: proved first, then run, then judged.", _tune_options),
    "replay": ("Run an estimator or a controller over a recorded log.", _replay_options),
    "compare": ("Compare runs and sweeps: what was changed, then their metrics.", _compare_options),
    "fit": (
        "Fit a law to a measured curve, or a flow (coasting, brake_step) to logs.",
        _fit_options,
    ),
    "c": ("Write a controller, from sensor to actuator, as C.", _c_options),
    "pil": ("Run a loop with its controller on an emulated processor, tick by tick.", _pil_options),
    "certify": (
        "Say how far gains reach: verdicts, margins and the worst disturbance.",
        _certify_options,
    ),
    "check": ("Check a certificate again with rational arithmetic alone.", _check_options),
    "docs": ("Open the pages of slipctl in a browser; they need no network.", _docs_options),
}
"""Commands in the order of the help, each with its line there and its options."""
