"""The command line: each command is a module of its own, named in ``arguments.COMMANDS``.

Results go to stdout, progress and warnings to stderr. Exit codes: 0 finished, whatever the
verdicts; 1 a run failed; 2 bad input, told in one line; 130 stopped by Ctrl-C or SIGTERM,
with what had finished whole. Nothing heavy is imported before a command needs it.
"""

from __future__ import annotations

import argparse
import errno
import gc
import io
import logging
import os
import shlex
import signal
import sys
import traceback
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module

from slipctl.commands.arguments import COMMANDS, parser
from slipctl.commands.environment import check_environment, tell_threads
from slipctl.errors import BadInput, RunFailed
from slipctl.registry import check_one_tree
from slipctl.run import interrupts

log = logging.getLogger("slipctl")

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)
"""Errors of a disk that only who writes meets."""

RARELY = (100_000, 50, 100)
"""When garbage is collected: most objects of a command live to its end, and looking through them
at Python's own pace takes a fifth of the time of a run."""

_PLACES = {
    "list": "library.contents", "show": "library.show", "new": "library.new",
    "open": "library.open", "schema": "library.schema", "copy": "library.copy",
    "docs": "library.docs",
    "certify": "certificates.certify", "check": "certificates.check",
}  # fmt: skip
ANSWERS = {name: f"slipctl.commands.{_PLACES.get(name, name)}" for name in COMMANDS}
"""Module that answers each command by its ``answer(options, command)``; loaded when asked."""


def _complete() -> None:
    """Answer a shell that asks what can be typed next, where argcomplete is installed."""
    with suppress(ImportError):
        import argcomplete

        argcomplete.autocomplete(parser())


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command; gives the exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    verbose = "-v" in arguments or "--verbose" in arguments
    gc.set_threshold(*RARELY)
    # matrices here are small: a second thread of numpy's would only wait; and so no sum depends on
    # how many cores there are
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if "matplotlib" not in sys.modules and "MPLBACKEND" in os.environ:
        os.environ["MPLBACKEND"] = "agg"  # a notebook's, which may not be installed here
    closed = sys.stdout is None
    if closed:  # started with >&-
        sys.stdout = io.StringIO()
    if isinstance(sys.stdout, io.TextIOWrapper):  # a letter that it lacks is no reason to stop
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        if "_ARGCOMPLETE" in os.environ:
            _complete()
        if any("\0" in word for word in arguments):  # no shell gives such; a script may
            raise BadInput(f"a null character stands in {arguments!r:.200}; leave it out")
        options = parser().parse_args(arguments)
    except SystemExit as told:  # --help, --version
        return int(told.code or 0)
    except BadInput as error:
        return _explain(error, verbose)
    try:
        with interrupts.raise_interrupts():
            if options.command is None:
                raise BadInput(f"say what to do: {', '.join(ANSWERS)}; see slipctl --help")
            check_one_tree()
            check_environment()
            _talk(options)
            for line in tell_threads():
                _say(line)
            home = import_module(ANSWERS[options.command])
            code: int = home.answer(options, shlex.join(["slipctl", *arguments]))
            sys.stdout.flush()
            if closed:
                _say("standard output is closed; nothing was printed")
            return code or int(closed)
    except KeyboardInterrupt as stopped:
        # an interrupt in text that Python ran (a dataclass that is made) is kept as unheard, and
        # the process would end by the signal: running text, even none, makes Python forget it
        exec("")
        _say("; ".join(["stopped", *map(str, stopped.args)]))
        return 130
    except BrokenPipeError:
        _silence()
        return 0
    except (Exception, SystemExit, GeneratorExit) as error:  # sys.exit() in somebody's file
        return _explain(error, verbose)


def program() -> int:
    """Run the command of this process; from its answer on an interrupt changes nothing any more.

    Python ends threads and modules after that, and an interrupt there would be a traceback.
    """
    code = main()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    return code


def _explain(error: BaseException, verbose: bool) -> int:
    """Say an error in one line (below where it came from, if asked); gives the exit code."""
    from slipctl.study.failures import blame

    origin = error.__cause__ if isinstance(error, (BadInput, RunFailed)) else error
    if verbose and origin is not None:
        traceback.print_exception(origin)
    try:
        blame(error)
    except BadInput as known:
        for line in getattr(known, "lines", [str(known)]):
            _say(line)
        return 2
    except RunFailed as known:
        _say(f"run failed: {known}")
        return 1
    except OSError as known:
        full = known.errno in (errno.ENOSPC, errno.EIO, errno.EBADF)
        if sys.stdout is not None and full:
            _silence()
        verb = "write" if known.errno in FULL else "read or write"
        what = f"{verb} {known.filename}" if known.filename else verb
        if full and not known.filename:  # files say their name
            what = "write to standard output"
        _say(f"cannot {what}: {known.strerror or known}")
        return 1 if known.errno in (errno.ENOSPC, errno.EIO) else 2
    except (Exception, SystemExit, GeneratorExit) as unknown:
        text = str(unknown).strip().partition("\n")[0]
        _say(f"a fault of slipctl, {type(unknown).__name__}: {text}; -v shows where")
        return 1


def _silence() -> None:
    """Send what is left of stdout nowhere, so that its end is quiet."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


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


if __name__ == "__main__":
    sys.exit(program())
