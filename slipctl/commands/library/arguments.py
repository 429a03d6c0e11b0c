"""Options of the commands that show, write and open models, files and pages."""

from __future__ import annotations

from argparse import ArgumentParser
from typing import Any

AS_JSON = "answer as JSON"


def option(p: ArgumentParser, usage: str, help: str | None = None, **more: Any) -> None:
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
    p.add_argument(*name.split("|"), help=help, **more)


def list_options(p: ArgumentParser) -> None:
    """Declare the options of ``slipctl list``."""
    p.add_argument(
        "word", metavar="TOPIC|WORD", nargs="?",
        help="studies, models or kinds; or a word to look for in their names and meanings",
    )  # fmt: skip
    option(p, "--json", AS_JSON)


def show_options(p: ArgumentParser) -> None:
    """Declare the options of ``slipctl show``."""
    p.add_argument(
        "name", metavar="NAME",
        help="study, STUDY:LOOP[.PART], FILE.toml:LOOP, model, FILE:BLOCK, or an equation in"
        " quotes",
    )  # fmt: skip
    option(p, "--latex", "equations as LaTeX")
    option(p, "--graph", "block diagram as DOT")
    option(p, "--against OTHER", "show the differences from another NAME")
    option(p, "--json", AS_JSON)


def new_options(p: ArgumentParser) -> None:
    """Declare the options of ``slipctl new``."""
    p.add_argument(
        "kind", metavar="KIND", nargs="?",
        help="metro: a metro car of 38 t that brakes into leaves; emu: eight axles with air brakes",
    )  # fmt: skip
    p.add_argument("file", metavar="FILE", nargs="?", help="file to write (default: KIND.toml)")
    option(p, "--json", AS_JSON)
    option(p, "--from STUDY:LOOP[@SCENARIO]", "write this loop of a study instead, with all of its"
           " numbers, to KIND or LOOP.toml", dest="source")  # fmt: skip


def open_options(p: ArgumentParser) -> None:
    """Declare the options of ``slipctl open``."""
    p.add_argument(
        "name", metavar="FILE.toml|STUDY[:LOOP]", nargs="?",
        help="vehicle file, study, folder of a sweep, or recorded log to open (default: metro.toml,"
        " which is written if it does not exist)",
    )  # fmt: skip
    option(p, "--port N", "port on this machine (default: a free one)", type=int)
    option(p, "--no-browser", "only print the address")
    option(p, "--python FILE.py ...", "Python files that the vehicle file may use; slipctl imports"
           " no others", dest="files")  # fmt: skip
    option(p, "--no-compile", "do not use a C compiler")


def copy_options(p: ArgumentParser) -> None:
    """Declare the options of ``slipctl copy``."""
    p.add_argument("model", metavar="MODEL", help="model to copy, by its name in slipctl list")
    p.add_argument("file", metavar="FILE", help="file to write, such as my_law.py")
    option(p, "--json", AS_JSON)


def docs_options(p: ArgumentParser) -> None:
    """Declare the options of ``slipctl docs``."""
    p.add_argument("page", metavar="PAGE", nargs="?", default="index", help="glossary, sweeps, ...")
    option(p, "--where", "print the path of the page, and open nothing")
    option(p, "--json", "print the path of the page as JSON, and open nothing")
