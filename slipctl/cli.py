"""The command line: list, show, copy, run, fit, c, pil, certify and check.

Results go to stdout, progress and warnings to stderr. Exit codes: 0 finished, whatever the
verdicts; 1 a run failed; 2 bad input, told in one line; 130 stopped by Ctrl-C, with what had
finished whole. Nothing heavy is imported before a command needs it.
"""

from __future__ import annotations

import argparse
import errno
import logging
import os
import shutil
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, NoReturn

from slipctl import __version__
from slipctl.errors import BadInput, RunFailed, nearest

if TYPE_CHECKING:
    from slipctl.studying import Results, Verdict

log = logging.getLogger("slipctl")

EPILOG = """\
NAME is a study (subway_braking), a loop of it (subway_braking:sta, or sta@real for the form that
it has in scenario real), a model (double_exponential, subway_braking.wheelset), or a block in a
file (my_law.py:my_law).

  slipctl run subway_braking --set wheel.m=8.2t --loop sta --scenario base
  slipctl run subway_braking --swap adh=my_law.py:my_law --out out/mine
"""


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
        epilog=EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False,
    )  # fmt: skip
    top.add_argument("--version", action="version", version=f"slipctl {__version__}")
    volume = Parser(add_help=False)
    for p, default in ((top, False), (volume, argparse.SUPPRESS)):  # before or after the command
        p.add_argument("-v", "--verbose", action="store_true", default=default, help="tell more")
        p.add_argument("-q", "--quiet", action="store_true", default=default, help="errors only")
    commands = top.add_subparsers(dest="command", metavar="COMMAND", parser_class=Parser)

    def command(name: str, help: str) -> Parser:
        return commands.add_parser(
            name, help=help, description=help, parents=[volume], allow_abbrev=False
        )

    command("list", "List studies and models.")

    p = command("show", "Show equations, signals, units, sources and Jacobian of NAME.")
    p.add_argument("name", metavar="NAME")
    p.add_argument("--latex", action="store_true", help="equations as LaTeX")
    p.add_argument("--graph", action="store_true", help="block diagram as DOT")
    p.add_argument("--against", metavar="OTHER", help="what differs from another NAME")

    p = command("copy", "Copy the source of a model to a file of your own, to edit it.")
    p.add_argument("model", metavar="MODEL")
    p.add_argument("file", metavar="FILE")

    p = command("run", "Run a study: metrics, claims, logs, figures and a report.")
    p.add_argument("study", metavar="STUDY")
    p.add_argument("--out", metavar="DIR", help="folder of the results (out/STUDY)")
    p.add_argument(
        "--set", metavar="[LOOP:]BLOCK.PARAM=VALUE[UNIT]", nargs="+", action="extend", default=[],
        dest="settings", help="set a parameter or start value, car.m=8.2t; '*.m=8t' sets every m",
    )  # fmt: skip
    p.add_argument(
        "--swap", metavar="NAME=FILE:BLOCK", nargs="+", action="extend", default=[], dest="swaps",
        help="replace a model of the study, adh=my.py:my_law",
    )  # fmt: skip
    p.add_argument(
        "--loop", metavar="L", nargs="+", action="extend", default=[], dest="loops",
        help="run these loops only (and no experiments)",
    )  # fmt: skip
    p.add_argument(
        "--scenario", metavar="S", nargs="+", action="extend", default=[], dest="scenarios",
        help="run these scenarios only (and no experiments)",
    )  # fmt: skip
    p.add_argument("--quick", action="store_true", help="the same with fewer or shorter runs")
    p.add_argument("--no-compile", action="store_true", help="do not use a C compiler")

    p = command("fit", "Fit the parameters of a law to a measured curve.")
    p.add_argument("curve", metavar="CURVE.csv", help="a head and a row per point")
    p.add_argument("--law", metavar="NAME", required=True, help="a law of the models, or file:law")
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
        "--column", metavar="NAME=EXPRESSION", nargs="+", action="extend", default=[],
        dest="columns", help="how columns give a signal of the law, v_s='slip * v / 100'",
    )  # fmt: skip
    p.add_argument(
        "--ordered", action="store_true", help="keep the order that the law expects, k_A >= k_S"
    )
    p.add_argument("--out", metavar="DIR", required=True, help="folder of the results")

    p = command("c", "Write a controller, from sensor to actuator, as C.")
    p.add_argument("name", metavar="NAME")
    p.add_argument("--out", metavar="DIR", required=True, help="folder of the C files")
    p.add_argument("--check", action="store_true", help="compile it and compare it with Python")
    p.add_argument(
        "--real", choices=("double", "float"), default="double", help="type of every number in C"
    )
    p.add_argument(
        "--target", metavar="host|cortex-m4|cortex-m7", default="host",
        help="compile it for this processor too, and with --check run it there; two with a comma",
    )  # fmt: skip
    p.add_argument(
        "--misra", action="store_true", help="count findings of cppcheck and of MISRA C:2012"
    )

    p.add_argument(
        "--fuzz", metavar="SECONDS", type=int,
        help="feed it any bytes for so long, by libFuzzer with sanitizers",
    )  # fmt: skip
    p.add_argument("--fmu", action="store_true", help="write FMUs too, by FMI 2.0 and 3.0")
    p.add_argument(
        "--part", metavar="PART", help="another part of the loop than its controller, such as plant"
    )
    p.add_argument(
        "--name", metavar="MODULE", dest="module",
        help="what its files and functions are called; by default the loop or the block",
    )  # fmt: skip

    p = command("pil", "Run a loop with its controller on an emulated processor, tick by tick.")
    p.add_argument("name", metavar="STUDY:LOOP", help="or STUDY:LOOP@SCENARIO")
    p.add_argument("--target", metavar="cortex-m4|cortex-m7", default="cortex-m4")
    p.add_argument("--real", choices=("double", "float"), default="double")
    p.add_argument(
        "--fault", metavar="TICK=WHAT", nargs="+", action="extend", default=[], dest="faults",
        help="what happens to the frame of a tick on purpose: lost, late or broken",
    )  # fmt: skip
    p.add_argument(
        "--seconds", metavar="S", type=float, help="run only so long; by default the scenario"
    )
    p.add_argument("--out", metavar="FILE", help="write the comparison as JSON")

    p = command("certify", "Say how far gains reach: verdicts, margins and the worst disturbance.")
    p.add_argument(
        "system", metavar="SYSTEM|STUDY", nargs="?", help="super_twisting, or a study; none: a list"
    )
    p.add_argument(
        "--set", metavar="NAME=VALUE[UNIT]", nargs="+", action="extend", default=[],
        dest="settings", help="gains and bounds, k1=1.5 k2=1.1 L=1 in SI, or each with its unit",
    )  # fmt: skip
    p.add_argument("--json", action="store_true", help="answer as JSON")
    p.add_argument("--out", metavar="FILE", help="write a certificate for slipctl check")

    p = command("check", "Check a certificate again with rational arithmetic alone.")
    p.add_argument("file", metavar="FILE")
    return top


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command; gives the exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    verbose = "-v" in arguments or "--verbose" in arguments
    try:
        options = parser().parse_args(arguments)
        if options.command is None:
            raise BadInput(f"say what to do: {', '.join(COMMANDS)}; see slipctl --help")
        _talk(options)
        code = COMMANDS[options.command](options, _written(arguments))
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        _say("stopped; what had finished is written")
        return 130
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        return _explain(error, verbose)


def _explain(error: Exception, verbose: bool) -> int:
    """Say an error in one line (below where it came from, if asked); gives the exit code."""
    from slipctl.doors import blame

    origin = error.__cause__ if isinstance(error, (BadInput, RunFailed)) else error
    if verbose and origin is not None:
        import traceback

        traceback.print_exception(origin)
    try:
        blame(error)
    except BadInput as known:
        _say(str(known))
        return 2
    except RunFailed as known:
        _say(f"run failed: {known}")
        return 1
    except OSError as known:
        what = f" {known.filename}" if known.filename else ""
        _say(f"cannot read or write{what}: {known.strerror or known}")
        return 1 if known.errno in (errno.ENOSPC, errno.EIO) else 2
    except Exception as unknown:
        text = str(unknown).strip().partition("\n")[0]
        _say(f"a fault of slipctl, {type(unknown).__name__}: {text}; -v shows where")
        return 1


def _say(text: str) -> None:
    print("slipctl: " + " ".join(text.split()), file=sys.stderr)


def _talk(options: argparse.Namespace) -> None:
    """Send warnings and progress to stderr."""
    level = logging.ERROR if options.quiet else logging.DEBUG if options.verbose else logging.INFO
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("slipctl: %(message)s"))
    log.handlers[:] = [handler]
    log.setLevel(level)
    log.propagate = False


def _written(arguments: Sequence[str]) -> str:
    """Return the command line as it may be typed again."""
    import shlex

    return shlex.join(["slipctl", *arguments])


# ---- list, show, copy ---------------------------------------------------------------------------


def _list(options: argparse.Namespace, command: str) -> int:
    from slipctl import doors

    print("studies")
    for name, doc in doors.studies().items():
        print(f"  {name:<24} {doc}")
    print("\nmodels")
    for name, (doc, blocks) in doors.models().items():
        print(f"  {name:<24} {doc}")
        for block, text in blocks.items():
            print(f"    {block:<22} {text}")
    return 0


def _show(options: argparse.Namespace, command: str) -> int:
    from slipctl import doors

    name = options.name
    whole = name in doors.studies() or (name.endswith(".py") and ":" not in name)
    if whole and not (options.latex or options.graph or options.against):
        print(_study_text(name))
        return 0
    if whole:
        study = doors.load_study(name)
        loops = doors.loop_names(study)
        raise BadInput(f"{name} is a study; write which loop: " + ", ".join(
            f"{name}:{loop}" for loop in loops))  # fmt: skip
    from slipctl import show

    block = doors.load_block(name)
    if options.against:
        print(show.difference(block, doors.load_block(options.against)).rstrip())
        return 0
    if options.latex:
        print(show.latex(block).rstrip())
    if options.graph:
        print(show.graph(block).rstrip())
    if not (options.latex or options.graph):
        print(show.text(block).rstrip())
    return 0


def _study_text(name: str) -> str:
    from slipctl import doors

    study = doors.load_study(name)
    cases = doors.build_cases(study)
    rows = [f"{study.name}: {study.title}", f"  {study.source}", "", *_wrapped(study.doc, "  ", 96)]
    rows += ["", "scenarios and loops"]
    for case in cases:
        s = case.scenario
        rows.append(f"  {s.name:<20} {s.duration:g} s, seed {s.seed}: {', '.join(case.loops)}")
        rows += _wrapped(s.doc, " " * 23, 96) if s.doc else []
    models = {k: getattr(m, "name", getattr(m, "__name__", "")) for k, m in study.models.items()}
    for title, pairs in (
        ("models that --swap replaces", list(models.items())),
        ("experiments", [(k, e.title) for k, e in study.experiments.items()]),
        ("claims", [(c.id, f"{c.claim} ({c.source})") for c in study.claims]),
        ("figures", [(k, f.caption) for k, f in study.figures.items()]),
    ):  # fmt: skip
        if pairs:
            wide = max(len(key) for key, _ in pairs)
            rows += ["", title, *(f"  {key:<{wide}}  {text}" for key, text in pairs)]
    loop = next(iter(cases[0].loops))
    rows += ["", f"See slipctl show {name}:{loop}, slipctl run {name}"]
    return "\n".join(rows)


def _wrapped(text: str, indent: str, width: int) -> list[str]:
    import textwrap

    return textwrap.wrap(" ".join(text.split()), width, initial_indent=indent,
                         subsequent_indent=indent)  # fmt: skip


def _copy(options: argparse.Namespace, command: str) -> int:
    from slipctl import doors, store

    module, block, source = doors.model_source(options.model)
    target = Path(options.file)
    if target.is_dir():
        raise BadInput(f"{target} is a folder; write a file, {target / (module + '.py')}")
    if target.exists():
        raise BadInput(f"{target} exists already and is not overwritten; choose another name")
    if target.suffix != ".py":
        raise BadInput(f"{target} must end in .py to be used as {target}.py:block")
    if not target.parent.is_dir():
        raise BadInput(f"there is no folder {target.parent}; make it first")
    store.check_folder(target.parent)
    store.write_text(target, source)
    print(f"{target}: the model {module}, yours to edit")
    print(f"  slipctl show {target}:{block}")
    if doors.studies():
        print(f"  slipctl run STUDY --swap NAME={target}:{block}")
    return 0


# ---- run ----------------------------------------------------------------------------------------


class Progress:
    """Tells how far a run is: a line that moves on a terminal, otherwise a line per run."""

    def __init__(self, total: int, stream: IO[str], quiet: bool) -> None:
        self.total, self.stream, self.done = total, stream, 0
        self.moving = stream.isatty() and not quiet
        self.current = ""

    def __call__(self, what: str, share: float) -> None:
        """Show the share done of what is running."""
        if what != self.current:
            self.done += bool(self.current)
            self.current = what
            if not self.moving:
                log.info("%d/%d %s", self.done + 1, self.total, what)
        if self.moving:
            filled = round(24 * (self.done + share) / max(self.total, 1))
            bar = "#" * filled + "." * (24 - filled)
            self.stream.write(f"\r\033[K[{bar}] {self.done + 1}/{self.total} {what}")
            self.stream.flush()

    def end(self) -> None:
        """Leave a clean line."""
        if self.moving:
            self.stream.write("\r\033[K")
            self.stream.flush()


def _run(options: argparse.Namespace, command: str) -> int:
    from slipctl import doors, store

    study = doors.load_study(options.study)
    out = Path(options.out or Path("out") / study.name)
    store.check_folder(out)

    from slipctl import running

    cases, models = running.prepare(
        study, quick=options.quick, settings=options.settings, swaps=options.swaps,
        loops=options.loops, scenarios=options.scenarios,
    )  # fmt: skip
    changed = running.in_words(options.swaps, options.settings)
    results = running.new_results(study, cases, options.quick, changed)
    everything = not (options.loops or options.scenarios)
    if study.experiments and not everything:
        log.info("experiments are left out; they run without --loop and --scenario")
    if study.experiments and everything and options.settings:
        log.info("--set reaches the loops of the scenarios, not those that an experiment builds")
    total = sum(len(c.loops) for c in cases) + (len(study.experiments) if everything else 0)
    progress = Progress(total, sys.stderr, options.quiet)

    def save(what: str, write: Callable[[], Any]) -> None:
        with running.noted(results, what):
            write()

    def save_log(found: Results, scenario: str, loop: str) -> None:
        where = f"log of {scenario}/{loop}"
        save(where, lambda: running.save_log(found, scenario, loop, out, command))

    def save_numbers() -> None:
        progress.end()
        save("metrics.json", lambda: running.save_metrics(results, out, command))
        save("tables.json", lambda: running.save_tables(results, out, command))

    try:
        running.run(
            study, cases, models, quick=options.quick, compile=not options.no_compile,
            experiments=everything, report=progress, results=results, finished=save_log,
            folder=out / "parts",
        )  # fmt: skip
    except KeyboardInterrupt:
        save_numbers()
        raise
    save_numbers()
    verdicts = running.judge_all(results)
    save("claims.json", lambda: running.save_claims(results, verdicts, out, command))
    print(_summary(results, verdicts))
    sys.stdout.flush()
    save("report.html", lambda: running.save_pages(results, verdicts, out, command))
    if "report.html" not in results.failed:
        print(f"\n{out / 'report.html'}")
    for where, why in results.failed.items():
        _say(f"{where} failed: {why}")
    return 1 if results.failed else 0


def _summary(results: Results, verdicts: Sequence[Verdict]) -> str:
    """Claims and metrics as text tables."""
    from slipctl.texts import changes, claim_table, metric_table

    width = shutil.get_terminal_size((132, 50)).columns if sys.stdout.isatty() else 132
    title = f"{results.study.name}: {results.study.title}" + (" (quick)" if results.quick else "")
    parts = ["\n".join(filter(None, [title, changes(results)]))]
    if verdicts:
        parts.append(claim_table(verdicts, width))
    parts += [metric_table(results, scenario) for scenario in results.metrics]
    return "\n\n".join(parts)


def _fit(options: argparse.Namespace, command: str) -> int:
    from slipctl import fitfiles

    print(fitfiles.run(
        options.curve, options.law, options.settings, options.starts, options.columns,
        options.unknown, options.ordered, options.out, command,
    ))  # fmt: skip
    return 0


# ---- c ------------------------------------------------------------------------------------------


def _c(options: argparse.Namespace, command: str) -> int:
    from slipctl import doors, store

    name, out = options.name, Path(options.out)
    if not options.out:
        raise BadInput("--out names no folder; write one, or . for this one")
    if options.fuzz is not None and options.fuzz < 1:
        raise BadInput(f"--fuzz {options.fuzz} gives it no time; write seconds, such as 15")
    store.check_folder(out)
    left, colon, loop_name = name.rpartition(":")
    if name in doors.studies():
        raise doors.no_loop(name, doors.load_study(name))
    is_loop = colon and (not left.endswith(".py") or doors.has_study(left))
    block = None if is_loop else doors.load_block(name)
    if block is not None and options.part:
        raise BadInput(f"{name} is no loop and has no --part {options.part}; leave it out")

    from slipctl import codegen
    from slipctl.build import compiler

    if options.check and compiler() is None:
        raise BadInput("--check needs a C compiler; install gcc or clang, or set CC to one")
    wanted = {
        "check": options.check, "real": options.real, "target": options.target,
        "misra": options.misra, "fmus": options.fmu, "fuzz_seconds": options.fuzz or 0,
    }  # fmt: skip
    if block is not None:
        report = codegen.export(block, out, options.module, **wanted)
    else:
        study = doors.load_study(left)
        loop, case = doors.find_loop(study, loop_name)
        part = options.part or study.controller
        words = [] if part == study.controller else part.split(".")
        try:
            control = loop[part]
        except BadInput as error:
            what = "part" if options.part else "controller"
            raise BadInput(f"{name} has no {what} to write: {error}") from None
        log.info("running %s for its inputs", name)
        inputs, params = codegen.recorded(loop, part, case.scenario)
        report = codegen.export(
            control, out,
            options.module or "_".join([study.name, loop_name.partition("@")[0], *words]),
            inputs=inputs, params=params, period=loop.period, **wanted,
        )  # fmt: skip
    print(report)
    if len(report.data["name"]) > codegen.SIGNIFICANT:
        log.warning(
            "the functions of %s differ behind their 31st character only, which C99 need not tell"
            " apart (MISRA C:2012, 5.1); --name gives a shorter name", report.data["name"],
        )  # fmt: skip
    if not report.passed:
        raise RunFailed(f"{name}: the C differs from Python; see {out / 'report.json'}")
    return 0


def _pil(options: argparse.Namespace, command: str) -> int:
    from slipctl import processor, store

    out = Path(options.out) if options.out else None
    if out is not None:
        store.check_folder(out.parent)
    floats = len(processor.ROUNDINGS) if options.real == "float" and not options.faults else 0
    progress = Progress(2 + floats, sys.stderr, options.quiet)
    try:
        found = processor.compare(
            options.name, options.target, options.real, options.faults, out, options.seconds,
            progress,
        )  # fmt: skip
    finally:
        progress.end()
    print(found)
    if not found.passed:
        raise RunFailed(f"{options.name}: the loop differs with its controller on {options.target}")
    return 0


# ---- certify, check -----------------------------------------------------------------------------


def _certify(options: argparse.Namespace, command: str) -> int:
    from slipctl import certifying

    if options.system is None:
        print(certifying.listed())
        return 0
    print(certifying.certify(options.system, options.settings, options.json, options.out, command))
    return 0


def _check(options: argparse.Namespace, command: str) -> int:
    from slipctl import certifying

    print(certifying.check(options.file))
    return 0


COMMANDS = {
    "list": _list, "show": _show, "copy": _copy, "run": _run, "fit": _fit, "c": _c,
    "pil": _pil, "certify": _certify, "check": _check,
}  # fmt: skip

if __name__ == "__main__":
    sys.exit(main())
