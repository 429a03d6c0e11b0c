"""Inputs that reach what a module's own test does not: a search that grows one run.

The module is compiled so that each way from one block of code to the next is seen. Its recorded
inputs and its misuse come first. Then pieces of what was run so far are changed at random, in the
declared ranges and no faster than is declared. A piece that takes a new way is kept up to there,
as short as it still does, and the run goes on behind it. So what is found is one run, which Python
can make too, and each of its pieces has a reason.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from slipctl.ccode.check.comparison import expected_run
from slipctl.ccode.check.vectors.expected_outputs import Expected
from slipctl.ccode.check.vectors.misuse import input_travel
from slipctl.ccode.compile import compilers as cc
from slipctl.ccode.compile.programs import first_error, run_program, scratch_folder
from slipctl.ccode.compile.template import fill_template
from slipctl.ccode.module.layout import c_elements
from slipctl.ccode.module.plan import Plan
from slipctl.errors import BadInput, RunFailed

WATCHED = ("-O0", "-fsanitize-coverage=trace-pc", "-finstrument-functions")
"""What gcc and clang understand: a call in each block of code, and at each end of a function."""

MOST = 2000
"""Ticks that a search finds at most."""

LONGEST = 1024
"""Ticks of the longest piece that is tried."""

RATE = 100_000_000
"""Ways taken that count as one second, so that the same search finds the same on any machine."""

SECONDS = 10
"""How long is searched where nobody says it."""


def effort(text: str) -> int | None:
    """Seconds of ``search`` or ``search:SECONDS``; None where the text is something else.

    Raises:
        BadInput: no whole number of at least 1 behind the colon.
    """
    word, colon, seconds = text.partition(":")
    if word != "search":
        return None
    if not colon:
        return SECONDS
    if not seconds.isdecimal() or int(seconds) < 1:
        raise BadInput(f"--vectors {text} gives the search no time; write seconds, such as 15")
    return int(seconds)


def gone_on(
    plan: Plan,
    made: Mapping[str, str],
    run: Expected,
    params: Mapping[str, Any],
    seconds: int,
    most: int,
) -> tuple[Expected, dict[str, Any]]:
    """A run with what is found behind it, as Python makes it too.

    Args:
        plan, made, params, seconds: as of :func:`find_vectors`.
        run: recorded, with what the block gives.
        most: ticks that all may have together; the last ones recorded make room.

    Returns:
        The longer run, up to where the block itself gives NaN or leaves its ranges, and what to
        tell as :func:`find_vectors`.
    """
    rows = run.rows[: max(most - MOST, 1)]
    found, told = find_vectors(plan, made, rows, params, seconds)
    longer = expected_run(plan, np.vstack([rows, found]), params, whole=False)
    return longer, told | {"ticks": len(longer.rows) - len(rows)}


def find_vectors(
    plan: Plan,
    made: Mapping[str, str],
    rows: np.ndarray,
    params: Mapping[str, Any],
    seconds: int,
    seed: int = 1,
) -> tuple[np.ndarray, dict[str, Any]]:
    """Look for inputs that take ways through a module which its own test does not.

    Args:
        plan: the module.
        made: its texts.
        rows: recorded input elements, one row per tick; at least one.
        params: parameters of the run, by name.
        seconds: how long, about: :data:`RATE` ways each.
        seed: of the random numbers.

    Returns:
        Rows that go on behind those recorded, and what to tell: ``pieces`` tried, ``ticks`` found,
        ``ways`` that the own test takes, and ``new`` ones.

    Raises:
        BadInput: no inputs, or no tick to begin with.
        RunFailed: no compiler here knows how to watch a module.
    """
    n = plan.name
    if not plan.n_in:
        raise BadInput(f"{plan.block.name} has no inputs to search; leave --vectors search out")
    if not len(rows):
        raise BadInput(
            f"{plan.block.name} gives NaN or infinity on made-up inputs; search from those of a run"
        )
    values = plan.block.param_values(**params)
    given = [float(v) for m in plan.layout.params for v in c_elements(m, values[m.name])]
    whole = [str(m.signal.whole).lower() for m in plan.layout.inputs for _ in range(m.size)]
    text = fill_template(
        "search.c", n=n, big=plan.layout.big, most=MOST, longest=LONGEST,
        bits=LONGEST.bit_length() - 1,
        ranges=", ".join(input_travel(plan, 1.0)), whole=", ".join(whole),
        params=", ".join(map(repr, given or [0.0])),
    )  # fmt: skip
    texts = {name: made[name] for name in (*plan.files, f"test_{n}.c")} | {"search.c": text}
    with scratch_folder(texts) as folder:
        (folder / "rows.bin").write_bytes(np.ascontiguousarray(rows, dtype=float).tobytes())
        compiler = _built(folder, n)
        numbers = map(str, (len(rows), seconds * RATE, seed))
        ran = run_program([folder / "search", "rows.bin", *numbers, "found.bin"], folder)
        if ran.returncode:
            raise RunFailed(f"{n}: the search for vectors ends with code {ran.returncode}")
        pieces, own, new = map(int, ran.stdout.split()[-3:])
        found = np.frombuffer((folder / "found.bin").read_bytes()).reshape(-1, plan.n_in)
    return found, {
        "by": cc.version(compiler), "seconds": seconds, "seed": seed, "pieces": pieces,
        "ticks": len(found), "ways": own, "new": new,
    }  # fmt: skip


def _built(folder: Path, n: str) -> str:
    """Compile the search with the first compiler that can."""
    said = ""
    for compiler in cc.compilers():
        watched = [compiler, "-std=c99", "-w", "-ffp-contract=off", *WATCHED, "-c", f"{n}.c"]
        driver = [compiler, "-std=c99", "-w", "-ffp-contract=off", "-O1", "search.c", f"{n}.o"]
        for command in (watched, [*driver, "-o", "search", "-lm"]):
            done = run_program(command, folder)
            if done.returncode:
                said = first_error(done.stderr)
                break
        else:
            return compiler
    raise RunFailed(
        f"--vectors search needs gcc or clang, which see the ways through a module: {said}"
    )


def summary(found: Mapping[str, Any]) -> str:
    """What was found, in one line."""
    return (
        f"search: {found['pieces']} pieces tried, {found['new']} ways through the code besides"
        f" {found['ways']}, in {found['ticks']} ticks behind those recorded"
    )
