"""Options of the commands that show, write and open models, files and pages."""

from __future__ import annotations

from argparse import ArgumentParser

AS_JSON = "answer as JSON"


def list_options(p: ArgumentParser) -> None:
    """Declare the options of ``slipctl list``."""
    p.add_argument(
        "word", metavar="TOPIC|WORD", nargs="?",
        help="studies, models or kinds; or a word to look for in their names and meanings",
    )  # fmt: skip
    p.add_argument("--json", action="store_true", help=AS_JSON)


def show_options(p: ArgumentParser) -> None:
    """Declare the options of ``slipctl show``."""
    p.add_argument(
        "name", metavar="NAME",
        help="study, STUDY:LOOP[.PART], FILE.toml:LOOP, model, FILE:BLOCK, or an equation in"
        " quotes",
    )  # fmt: skip
    p.add_argument("--latex", action="store_true", help="equations as LaTeX")
    p.add_argument("--graph", action="store_true", help="block diagram as DOT")
    p.add_argument("--against", metavar="OTHER", help="show the differences from another NAME")
    p.add_argument("--json", action="store_true", help=AS_JSON)


def new_options(p: ArgumentParser) -> None:
    """Declare the options of ``slipctl new``."""
    p.add_argument(
        "kind", metavar="KIND", nargs="?",
        help="metro: a metro car of 38 t that brakes into leaves; emu: eight axles with air brakes",
    )  # fmt: skip
    p.add_argument("file", metavar="FILE", nargs="?", help="file to write (default: KIND.toml)")
    p.add_argument("--json", action="store_true", help=AS_JSON)
    p.add_argument(
        "--from", metavar="STUDY:LOOP[@SCENARIO]", dest="source",
        help="write this loop of a study instead, with all of its numbers, to KIND or LOOP.toml",
    )  # fmt: skip


def open_options(p: ArgumentParser) -> None:
    """Declare the options of ``slipctl open``."""
    p.add_argument(
        "name", metavar="FILE.toml|STUDY[:LOOP]", nargs="?",
        help="vehicle file, study, folder of a sweep, or recorded log to open (default: metro.toml,"
        " which is written if it does not exist)",
    )  # fmt: skip
    p.add_argument(
        "--port", metavar="N", type=int, help="port on this machine (default: a free one)"
    )
    p.add_argument("--no-browser", action="store_true", help="only print the address")
    p.add_argument(
        "--python", metavar="FILE.py", nargs="+", action="extend", default=[], dest="files",
        help="Python files that the vehicle file may use; slipctl imports no others",
    )  # fmt: skip
    p.add_argument("--no-compile", action="store_true", help="do not use a C compiler")


def copy_options(p: ArgumentParser) -> None:
    """Declare the options of ``slipctl copy``."""
    p.add_argument("model", metavar="MODEL", help="model to copy, by its name in slipctl list")
    p.add_argument("file", metavar="FILE", help="file to write, such as my_law.py")
    p.add_argument("--json", action="store_true", help=AS_JSON)


def docs_options(p: ArgumentParser) -> None:
    """Declare the options of ``slipctl docs``."""
    p.add_argument("page", metavar="PAGE", nargs="?", default="index", help="glossary, sweeps, ...")
    p.add_argument(
        "--where", action="store_true", help="print the path of the page, and open nothing"
    )
    p.add_argument(
        "--json", action="store_true", help="print the path of the page as JSON, and open nothing"
    )
