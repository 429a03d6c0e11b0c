"""Run the code of a page of the docs in the current folder: ``python pages.py PAGE``.

``python`` blocks are executed one after the other in one namespace; one whose first line is a file
name (``# my_law.py``) is written to that file, and so is a ``toml`` block. What a ``python`` block
prints is compared with the ``text`` block that follows it. In ``console`` blocks each line after
``$`` is run by the shell, and its output is compared with the lines below it; output that starts
with ``slipctl:`` is an error and must exit with 2. ``...`` stands for anything. Other blocks are
not run. A ``{picture}`` block is run by itself: it needs nothing from the page.

The first ``slipctl`` of a page is started by the shell, as a person does. The others are the same
``main`` in a process forked from this one, which has imported what they need: to import it again
for each takes longer than most of them.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import os
import re
import shlex
import subprocess
import sys
import tempfile
import traceback
from functools import cache
from pathlib import Path
from typing import Any

FENCE = re.compile(r"^```(\w*|\{\w+\})(?: [^\n]*)?\n(.*?)^```$", re.M | re.S)


FAILED = "the block fails: "


def blocks(text: str) -> list[tuple[str, str]]:
    """Language and code of each fenced block."""
    return [(m[1], m[2]) for m in FENCE.finditer(text)]


def run_page(text: str) -> list[str]:
    """Run the code of a page; gives what went wrong."""
    sys.path.insert(0, os.getcwd())
    names: dict[str, Any] = {"__name__": "__main__"}
    code = blocks(text)
    following = [*code[1:], ("", "")]
    wrong: list[str] = []
    started: list[str] = []
    for (language, body), (next_language, expected) in zip(code, following, strict=True):
        if language == "{picture}":
            printed = run_python(body, {"__name__": "__main__"})
            if FAILED in printed:
                return [*wrong, f"{body}\nends with\n{printed}"]
        elif language == "python":
            file = re.match(r"# (\w+\.py)\n", body)
            if file:
                Path(file[1]).write_text(body, encoding="utf-8")
                continue
            printed = run_python(body, names)
            if FAILED in printed:
                return [*wrong, f"{body}\nends with\n{printed}"]
            if next_language == "text" and not matches(expected, printed):
                wrong.append(f"{body}\nprints\n{printed}\nnot\n{expected}")
        elif language == "toml":
            file = re.match(r"# (\w+\.toml)\n", body)
            if file:
                Path(file[1]).write_text(body, encoding="utf-8")
        elif language == "console":
            wrong += run_console(body, started)
    return wrong


def run_python(body: str, names: dict[str, Any]) -> str:
    """Execute a block; gives what it prints, and the traceback if it fails."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        try:
            exec(compile(body, "page", "exec"), names)
        except Exception:
            out.write(f"\n{FAILED}" + traceback.format_exc())
    return out.getvalue()


def run_console(body: str, started: list[str]) -> list[str]:
    """Run the commands of a block; gives what went wrong. ``started`` is what was run before."""
    wrong = []
    for piece in re.split(r"^\$ ", body, flags=re.M)[1:]:
        command, _, expected = piece.partition("\n")
        plain = command.startswith("slipctl ") and not set("|&;<>()$`*?~") & set(command)
        if plain and started and hasattr(os, "fork"):
            done = forked(command)
        else:
            done = subprocess.run(command, shell=True, capture_output=True, text=True)
        started += [command] if plain else []
        fails = expected.startswith("slipctl:")
        seen = done.stderr if fails else done.stdout
        if done.returncode != (2 if fails else 0):
            wrong.append(f"$ {command}\nexits with {done.returncode}\n{done.stderr}")
        elif expected.strip() and not matches(expected, seen):
            wrong.append(f"$ {command}\nprints\n{seen}\nnot\n{expected}")
    return wrong


@cache
def warm() -> None:
    """Import what nearly every command imports; nothing of it starts a thread."""
    for name in ("slipctl.commands.cli", "slipctl.study.execution", "slipctl.draw.plots",
                 "scipy.optimize", "xarray", "netCDF4", "matplotlib.figure",
                 "matplotlib.backends.backend_svg"):  # fmt: skip
        importlib.import_module(name)


def forked(command: str) -> subprocess.CompletedProcess[str]:
    """``slipctl WORDS`` in a child: exit code and what it prints, as of a process of its own."""
    warm()
    sys.stdout.flush()
    sys.stderr.flush()
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        child = os.fork()
        if not child:
            code = 70
            try:
                os.dup2(out.fileno(), 1)
                os.dup2(err.fileno(), 2)
                code = in_child(shlex.split(command))
            except BaseException:
                traceback.print_exc()
            finally:
                sys.stdout.flush()
                sys.stderr.flush()
                os._exit(code)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        said = []
        for file in (out, err):
            file.seek(0)
            said.append(file.read().decode())
    return subprocess.CompletedProcess(command, code, *said)


def in_child(words: list[str]) -> int:
    """What the console script does; a page's own modules are read again, as a new process would."""
    for name, module in list(sys.modules.items()):
        if str(getattr(module, "__file__", None) or "").startswith(os.getcwd() + os.sep):
            del sys.modules[name]
    sys.path.remove(os.getcwd())  # a console script does not look there
    sys.argv = words
    main = importlib.import_module("slipctl.commands.cli").main
    try:
        return int(main() or 0)
    except SystemExit as ended:
        return ended.code if isinstance(ended.code, int) else int(ended.code is not None)


def matches(expected: str, seen: str) -> bool:
    """Whether the output is the expected one; white space does not count, ``...`` is anything."""
    pieces = [re.escape(" ".join(piece.split())) for piece in expected.split("...")]
    return re.fullmatch(".*".join(pieces), " ".join(seen.split()), re.S) is not None


if __name__ == "__main__":
    problems = run_page(Path(sys.argv[1]).read_text(encoding="utf-8"))
    print("\n\n".join(problems), file=sys.stderr)
    sys.exit(bool(problems))
