"""What may be typed: commands and their options."""

from __future__ import annotations

import argparse
from typing import Any, NoReturn

from slipctl import __version__
from slipctl.commands import examples
from slipctl.errors import BadInput, nearest

Argument = tuple[tuple[str, ...], dict[str, Any]]
"""What argparse is told of an argument: its names, and the rest by keyword."""


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

    for name, (help, arguments) in COMMANDS.items():
        command = commands.add_parser(
            name, help=help, description=help, parents=[volume], allow_abbrev=False,
            epilog=examples.OF_COMMAND[name], formatter_class=argparse.RawDescriptionHelpFormatter,
        )  # fmt: skip
        for names, more in arguments:
            command.add_argument(*names, **more)
    return top


def word(name: str, metavar: str, help: str, **more: Any) -> Argument:
    """Declare a word that has its place behind the command."""
    return (name,), {"metavar": metavar, "help": help, **more}


def option(usage: str, help: str | None = None, **more: Any) -> Argument:
    """Declare an option as the help shows it: ``--quick``, ``--out DIR``, ``--loop L ...``.

    Without a word behind its name it is a switch, unless it has ``choices``. With ``...`` it takes
    several values, also when it is given again. Two names are written ``--map|--column``.
    """
    name, _, metavar = usage.partition(" ")
    if metavar.endswith("..."):
        more |= {"nargs": "+", "action": "extend", "default": []}
    elif not metavar and "choices" not in more:
        more["action"] = "store_true"
    if metavar:
        more["metavar"] = metavar.removesuffix(" ...")
    return tuple(name.split("|")), {"help": help, **more}


AS_JSON = option("--json", "answer as JSON")
NO_COMPILE = option("--no-compile", "do not use a C compiler")
JOBS = option("--jobs N", "number of parallel runs (default: all cores)", type=int)
DECIMAL = option("--decimal", "decimal mark, where 1.234 may be read in two ways",
                 choices=(".", ","))  # fmt: skip
GAP = option("--gap T", "interval between samples that counts as a gap, 0.2s (default: 5 usual"
             " intervals)")  # fmt: skip
CLOCK = option("--clock 168MHz", "processor clock for which the load is reported (default: 25 MHz,"
               " that of the board)")  # fmt: skip
CHANGES = (
    option("--set BLOCK.PARAM=VALUE[UNIT] ...", "set a parameter or start value in every run",
           dest="settings"),
    option("--swap NAME=FILE:BLOCK ...", "replace a model of the study", dest="swaps"),
)  # fmt: skip

COMMANDS: dict[str, tuple[str, tuple[Argument, ...]]] = {
    "list": ("List studies, models, and the kinds of parts of a vehicle file.", (
        word("word", "TOPIC|WORD", "studies, models or kinds; or a word to look for in their names"
             " and meanings", nargs="?"),
        AS_JSON,
    )),
    "show": ("Show equations, signals, units, sources and Jacobian of NAME.", (
        word("name", "NAME", "study, STUDY:LOOP[.PART], FILE.toml:LOOP, model, FILE:BLOCK, or an"
             " equation in quotes"),
        option("--latex", "equations as LaTeX"),
        option("--graph", "block diagram as DOT"),
        option("--against OTHER", "show the differences from another NAME"),
        AS_JSON,
    )),
    "new": ("Write a vehicle file, to be edited and run.", (
        word("kind", "KIND", "metro: a metro car of 38 t that brakes into leaves; emu: eight axles"
             " with air brakes", nargs="?"),
        word("file", "FILE", "file to write (default: KIND.toml)", nargs="?"),
        AS_JSON,
        option("--from STUDY:LOOP[@SCENARIO]", "write this loop of a study instead, with all of its"
               " numbers, to KIND or LOOP.toml", dest="source"),
    )),
    "open": ("Open the workbench: run, region of gains and C follow each edit.", (
        word("name", "FILE.toml|STUDY[:LOOP]", "vehicle file, study, folder of a sweep, or"
             " recorded log to open (default: metro.toml, which is written if it does not exist)",
             nargs="?"),
        option("--port N", "port on this machine (default: a free one)", type=int),
        option("--no-browser", "only print the address"),
        option("--python FILE.py ...", "Python files that the vehicle file may use; slipctl imports"
               " no others", dest="files"),
        NO_COMPILE,
    )),
    "schema": ("Print the JSON schema of the files that describe a vehicle.", ()),
    "copy": ("Copy the source of a model to a file of your own, to edit it.", (
        word("model", "MODEL", "model to copy, by its name in slipctl list"),
        word("file", "FILE", "file to write, such as my_law.py"),
        AS_JSON,
    )),
    "run": ("Run a study: metrics, claims, logs, figures and a report.", (
        option("--json", "print metrics and claims as JSON"),
        word("study", "STUDY", "a study, or the file of a vehicle"),
        option("--out DIR", "folder of the results (default: out/STUDY)"),
        option("--set [LOOP:]BLOCK.PARAM=VALUE[UNIT] ...", "set a parameter or start value,"
               " car.m=8.2t; '*.m=8t' sets every m", dest="settings"),
        option("--swap NAME=FILE:BLOCK ...", "replace a model of the study, adh=my.py:my_law or"
               " adh=my.toml:law", dest="swaps"),
        option("--loop L ...", "run only these loops", dest="loops"),
        option("--scenario S ...", "run only these scenarios (default: base and real)",
               dest="scenarios"),
        option("--full", "run all scenarios and experiments, on all cores; results that an"
               " interrupted run has finished are kept"),
        option("--jobs N", "number of parallel processes (default: all cores)", type=int),
        option("--quick", "shorter and fewer runs, for tests of a study"),
        NO_COMPILE,
    )),
    "sweep": ("Run a loop with many sets of numbers, on all cores; resume and extend the sweep.", (
        word("name", "STUDY:LOOP", "or STUDY:LOOP@SCENARIO, FILE.toml:LOOP; STUDY or FILE.toml"
             " alone takes all loops on the same draws", nargs="?"),
        option("--vary P=LO:HI[:N] ...", "P=lo:hi:n is a grid axis of n values, P=lo:hi a uniform"
               " draw; ends may have units", dest="varied"),
        option("--samples N", "number of draws, at each point of a grid where there is one"
               " (default: 1)", type=int, default=1),
        option("--seed S", "seed of the draws (default: 1)", type=int, default=1),
        option("--design", "sampling method; a Latin hypercube (lhs) cannot be extended",
               choices=("random", "sobol", "lhs"), default="random"),
        option("--out DIR", "folder of the sweep", required=True),
        option("--export FILE.nc", "also write metrics and logs of all runs as one netCDF file, or"
               " DIR.zarr"),
        option("--scheduler tcp://HOST:PORT", "compute on the workers of this Dask scheduler (extra"
               " dask); results are the same to the bit"),
        option("--mixed", "also use machines with another processor or mathematics library"),
        AS_JSON,
        *CHANGES,
        option("--log SIGNAL ...", "store these signals over time, for every run", dest="logs"),
        JOBS,
        NO_COMPILE,
    )),
    "tune": ("Find gains on an ensemble: proof first, then simulation, then fresh draws.", (
        word("name", "STUDY:LOOP", "or STUDY:LOOP@SCENARIO, FILE.toml:LOOP", nargs="?"),
        option("--free P=LO:HI ...", "parameters to search, each in its range; the limits may have"
               " units"),
        option("--minimise METRIC ...", "a metric, or a weighted sum: 'distance +"
               " 0.001*torque_ripple'; several give a front", dest="objective"),
        option("--subject-to LIMIT ...", "'torque_ripple<=8kN m' in every draw,"
               " 'slip_max@0.95<=2m/s' in 95 %% of them, 'margin>=1.2' of the certificates,"
               " certified", dest="limits"),
        option("--samples N", "draws on which the search judges gains (default: 20)",
               type=int, default=20),
        option("--seed S", "seed of draws and search (default: 1)", type=int, default=1),
        option("--ensemble FILE.toml", "file that says what varies from draw to draw (default: the"
               " study's declaration)"),
        option("--held-out N", "fresh draws on which the result is judged (default: 200)",
               type=int, default=200),
        option("--runs N", "largest number of runs of the search (default: 250 per parameter and"
               " metric)", type=int),
        option("--prove", "state what 1375 fresh draws prove of 99 %% of all draws, with confidence"
               " 1 - 1e-6"),
        option("--out DIR", "folder of the results", required=True),
        AS_JSON,
        *CHANGES,
        JOBS,
        NO_COMPILE,
    )),
    "replay": ("Run an estimator or a controller over a recorded log.", (
        word("log", "LOG.csv", "log with a header and one row per sample; or LOG.parquet, LOG.mf4"),
        option("--with STUDY:LOOP.PART", "block to run over the log: a part of a loop, a model,"
               " FILE:BLOCK or an equation", required=True, dest="block"),
        option("--map INPUT=COLUMN[UNIT] ...", "column of each input; with arithmetic,"
               " omega='Speed[km/h] / r'", dest="mapped"),
        option("--beside OUTPUT=COLUMN[UNIT] ...", "recorded column that an output is compared"
               " with"),
        option("--set NAME=VALUE[UNIT] ...", "inputs without a column, parameters and start values",
               dest="settings"),
        option("--time COLUMN[UNIT]", "column of the time (default: the column with such a name)"),
        DECIMAL,
        option("--period T", "sample time, 10ms (default: that of the block, else of the log)"),
        option("--resample", "resampling to ticks (default: hold, the last sample before the tick)",
               choices=("hold", "linear"), default="hold"),
        GAP,
        option("--out DIR", "folder of the results", required=True),
        AS_JSON,
        NO_COMPILE,
    )),
    "compare": ("Compare runs and sweeps: first what was changed, then their metrics.", (
        word("folders", "DIR", "folder of a run, of a sweep, or of several sweeps", nargs="+"),
        AS_JSON,
    )),
    "fit": ("Fit a law to a measured curve, or a flow (coasting, brake_step) to logs.", (
        word("curve", "CURVE.csv", "curve with a header and one row per point; for a flow, logs as"
             " for replay", nargs="+"),
        option("--law NAME", "a law or a flow of the models, or file:law", required=True),
        option("--set NAME=VALUE[UNIT] ...", "known parameters, and inputs that do not vary,"
               " Q=106.7kN v=10m/s", dest="settings"),
        option("--unknown NAME,NAME", "parameters to fit (default: those that rail conditions"
               " set)"),
        option("--start NAME=VALUE[UNIT] ...", "start values of the search (default: the law's own"
               " values)", dest="starts"),
        option("--ordered", "keep the order of parameters that the law expects, k_A >= k_S"),
        option("--map|--column NAME=COLUMN[UNIT] ...", "column of each signal, v=Speed[km/h]; with"
               " arithmetic, v_s='slip * v / 100'", dest="mapped"),
        DECIMAL,
        option("--time COLUMN[UNIT]", "column of the time, as for replay"),
        GAP,
        option("--between FROM:TO", "use only this time span after the first sample, 12s:95s"),
        option("--resample", "interpolation of inputs between samples (default: hold)",
               choices=("hold", "linear")),
        option("--delay INPUT", "also fit the dead time of this input"),
        option("--out DIR", "folder of the results", required=True),
        AS_JSON,
    )),
    "c": ("Write a controller, from sensor to actuator, as C.", (
        word("name", "NAME", "STUDY:LOOP, FILE.toml:LOOP, or a block's name"),
        option("--out DIR", "folder of the C files", required=True),
        AS_JSON,
        option("--check", "compile it and compare it with Python"),
        option("--real", "type of every number in C", choices=("double", "float"),
               default="double"),
        option("--target host|cortex-m4|cortex-m7", "also compile it for this processor, and with"
               " --check run it there; separate two by a comma", default="host"),
        CLOCK,
        option("--misra", "count the findings of cppcheck and MISRA C:2012"),
        option("--vectors FILE.csv|search[:SECONDS]", "test it with these inputs, one row per tick,"
               " instead of those of a run; or search for inputs that reach the branches which the"
               " test leaves out"),
        option("--fuzz SECONDS", "fuzz it for this time, by libFuzzer with sanitizers", type=int),
        option("--prove", "let Frama-C prove that no run-time error occurs and that values stay in"
               " their ranges"),
        option("--fmu", "also write FMUs, by FMI 2.0 and 3.0"),
        option("--platforms linux64,win64", "platforms of the binaries in the FMUs (default: all"
               " for which a compiler is installed)"),
        option("--scaled NAME=uint16:0.01m/s[:OFFSET] ...", "inputs and outputs that the bus"
               " carries as integers of this type, resolution and offset"),
        option("--rates", "also write one step function for each rate of its parts, such as"
               " step_5ms"),
        option("--counter", "also write a step that takes the tick number, and detects repeated and"
               " late calls"),
        option("--const-section SECTION", "linker section of the tables"),
        option("--calibration-section SECTION", "also write an instance of the parameters, in this"
               " linker section"),
        option("--byte-order", "byte order of the processor, for the A2L (default: little, as ARM"
               " and x86)", choices=("little", "big"), default="little"),
        option("--xcp", "also write an XCP slave, and a program with it for the emulated board"),
        option("--autosar", "also write a software component of AUTOSAR Classic around it, as C and"
               " ARXML"),
        option("--set BLOCK.PARAM=VALUE[UNIT] ...", "set parameters of the loop, or FILE.toml with"
               " gains", dest="settings"),
        option("--part PART", "part of the loop to write instead of the controller, such as plant"),
        option("--name MODULE", "name of its files and functions (default: that of the loop or"
               " block)", dest="module"),
    )),
    "pil": ("Run a loop with its controller on an emulated processor, tick by tick.", (
        word("name", "STUDY:LOOP", "or STUDY:LOOP@SCENARIO, FILE.toml:LOOP"),
        option("--target cortex-m4|cortex-m7", default="cortex-m4"),
        option("--real", choices=("double", "float"), default="double"),
        CLOCK,
        option("--fault TICK=WHAT ...", "fault to inject into the frame of a tick: lost, late or"
               " broken", dest="faults"),
        option("--seconds S", "duration of the run (default: that of the scenario)", type=float),
        option("--out FILE", "write the comparison as JSON"),
        AS_JSON,
    )),
    "certify": ("Prove or refute what gains withstand: verdicts, margins and the worst"
                " disturbance.", (
        word("system", "SYSTEM|STUDY[:LOOP]", "system such as super_twisting, or a study or one of"
             " its loops; none: list the systems", nargs="?"),
        option("--set NAME=VALUE[UNIT] ...", "gains and bounds of a system, k1=1.5 k2=1.1 L=1 in SI"
               " or in units; parameters of a loop, as slipctl run has them, or FILE.toml with"
               " gains", dest="settings"),
        AS_JSON,
        option("--out FILE", "write the certificate, a file for slipctl check"),
        option("--map X[=LO:HI],Y[=LO:HI]", "map where two parameters are certified, refuted or"
               " undecided; --out is then a folder"),
        option("--points N", "points of the map along each axis (default: 25)", type=int,
               default=25),
        option("--metric NAME", "metric whose level lines are drawn into the map of a loop"),
        option("--largest NAME", "find the largest certified and the smallest refuted value of a"
               " parameter, such as lag; --out is then a folder"),
        option("--smallest NAME", "find the smallest certified and the largest refuted value of a"
               " parameter"),
    )),
    "check": ("Check a certificate by rational arithmetic alone, without the code that found it.", (
        word("file", "FILE", "certificate that certify or tune wrote"),
        AS_JSON,
        option("--rerun N", "run N draws of a statement again, from the study or file that the"
               " statement names", type=int),
    )),
    "docs": ("Open the pages of slipctl in a browser; they need no network.", (
        word("page", "PAGE", "glossary, sweeps, ...", nargs="?", default="index"),
        option("--where", "print the path of the page, and open nothing"),
        option("--json", "print the path of the page as JSON, and open nothing"),
    )),
}  # fmt: skip
"""Commands in the order of the help, each with its line there and its arguments."""
