"""A Block as C99 that a firmware engineer accepts, and as a module to call from Python.

``c_module(block, folder)`` writes the folder. ``check`` and ``export`` also compile it, replay
logged inputs through it with the state carried in C, and compare every output and state with the
block itself. What the folder holds is told in docs/c_interface.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from slipctl.block.block import Block
from slipctl.ccode.check import analysis, back_to_back, fuzz
from slipctl.ccode.check import float_error as float_error
from slipctl.ccode.check.comparison import Expected, compare, expected_run, made_up
from slipctl.ccode.check.processor import load
from slipctl.ccode.check.proof import module_proof
from slipctl.ccode.check.readability import equations, measure_source
from slipctl.ccode.check.vectors import expected_outputs, search
from slipctl.ccode.check.vectors.run_inputs import logged_inputs as logged_inputs
from slipctl.ccode.check.vectors.run_inputs import logged_params as logged_params
from slipctl.ccode.check.vectors.run_inputs import record_part as record_part
from slipctl.ccode.compile import compilers as cc
from slipctl.ccode.compile import files, targets
from slipctl.ccode.compile import folder as folders
from slipctl.ccode.compile.board import board_files
from slipctl.ccode.compile.module import CModule, input_rows
from slipctl.ccode.compile.platforms import platforms as chosen
from slipctl.ccode.compile.programs import scratch_folder
from slipctl.ccode.module.header import CONTENT, header, memory_bytes
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.module.source import sources
from slipctl.ccode.passes.precision import round_to_real
from slipctl.ccode.report import Report as Report
from slipctl.ccode.request import Checks, Content
from slipctl.ccode.ship import a2l, autosar, bus, fmu, manual, sections, xcp
from slipctl.ccode.ship.readable import readable
from slipctl.errors import BadInput, check_positive, split_options
from slipctl.run.numbers import check_guards

LIMIT = expected_outputs.LIMIT
"""Largest difference allowed between C in double and Python, relative to the largest value."""

KEPT = 20_000
"""Ticks at most that go into the vectors file; ``check`` itself replays all."""

SIGNIFICANT = 29
"""Letters of a module's name of which C99 promises four functions: it tells external names apart by
31 characters, and ``_default``, ``_init``, ``_step`` and ``_tune`` differ in their second."""

READABLE = "report.md"


def c_module(
    block: Block,
    folder: Path | str,
    name: str | None = None,
    *,
    period: float | None = None,
    real: str = "double",
) -> CModule:
    """Write a folder with the C of a block.

    Args:
        block: a step or a law; its parts are written with it.
        folder: made if it is not there; files in it that slipctl did not write are never touched.
        name: prefix of functions, structs and files, by default the block's name.
        period: tick in s for the comments, where the block has none of its own.
        real: type of every number in C, ``"double"`` or ``"float"``.

    Returns:
        The module: ``c_module(block, folder).compile().load()`` is called like the block.

    Raises:
        BadInput: a flow; a name that is no C identifier or clashes; a parameter without value; an
            operation that cannot be generated; a foreign file in the way.
    """
    return _produce(block, folder, name, period=period, content=Content(real)).module


def check(
    block: Block,
    inputs: Mapping[str, Any],
    folder: Path | str,
    params: Mapping[str, Any] | None = None,
    *,
    name: str | None = None,
    period: float | None = None,
    real: str = "double",
    target: str = "host",
) -> dict[str, Any]:
    """Write the C, compile it with every compiler found, replay inputs, compare with the block.

    Args:
        block: a step or a law.
        inputs: array over ticks by input, ``(ticks, *shape)``; one not given keeps its value.
        folder: as in :func:`c_module`.
        params: parameters of the run, by name; the others have their defaults.
        name, period, real: as in :func:`c_module`.
        target: as in :func:`export`.

    Returns:
        Content of ``report.json``: ``signals`` has the largest ``absolute`` and ``relative``
        difference per output and state, ``passed`` whether all stay within their ``limit``:
        1e-12 of the largest value in double. For float see
        :mod:`slipctl.ccode.check.vectors.expected_outputs`.

    Raises:
        BadInput: as :func:`c_module`; no compiler; inputs that do not fit.
        RunFailed: a compiler refuses, or the block itself gives NaN on these inputs.
    """
    return _produce(
        block, folder, name, inputs, params, period, Content(real), Checks(True, target)
    ).data


def export(
    block: Block,
    out: Path | str,
    name: str | None = None,
    inputs: Mapping[str, Any] | None = None,
    params: Mapping[str, Any] | None = None,
    period: float | None = None,
    **options: Any,
) -> Report:
    """Write the C of a block, and compare it with the block if asked.

    Args:
        block: a step or a law.
        out: folder to write.
        name: prefix of functions and files.
        inputs: logged inputs of a run (see :func:`logged_inputs`); without them, made-up ones.
        params: parameters of the run.
        period: tick in s for the comments.
        **options: fields of :class:`slipctl.ccode.request.Content`, what the folder holds, and of
            :class:`slipctl.ccode.request.Checks`, what is checked.

    Returns:
        What was written; printable.

    Raises:
        BadInput, RunFailed: as :func:`check`; an option that there is not.
    """
    return _produce(
        block, out, name, inputs, params, period, *split_options("C", options, Content, Checks)
    )


# ---- making -------------------------------------------------------------------------------------


def _produce(
    block: Block,
    folder: Path | str,
    name: str | None,
    inputs: Mapping[str, Any] | None = None,
    params: Mapping[str, Any] | None = None,
    period: float | None = None,
    content: Content = Content(),
    checks: Checks = Checks(),
) -> Report:
    if not isinstance(folder, (Path, str)):
        raise BadInput(f"C: the folder to write is {folder!r}; write its path, such as 'out'")
    folder, real, replay, boards = Path(folder), content.real, checks.check, checks.boards
    checks.need_tools()
    built_for = chosen(content.platforms) if content.fmus else []
    if period is not None:
        check_positive("c_module: period", period, "s")
        period = float(period)  # of another float type, which JSON does not know
    plan = Plan(block, name, period, real, content.rates, content.counter, content.byte_order,
                content.asked)  # fmt: skip
    check_guards(block)
    made = texts(plan, content)
    archives = [f"{plan.name}_fmi{v}.fmu" for v in fmu.VERSIONS if content.fmus]
    names = [*made, *archives, "vectors.txt", READABLE, folders.MANIFEST]
    folders.check_folder(folder, names)
    used = cc.compilers() if replay else ()
    if replay and (real == "float" or boards):
        float_error.compiler()
    values = block.param_values(**(params or {}))
    used_params = (
        dict(params or {}) if real == "double" else expected_outputs.float_params(plan, values)
    )
    run, width = _replayed(plan, inputs, used_params, replay)
    found: dict[str, Any] | None = None
    if checks.search_seconds:
        run, found = search.gone_on(plan, made, run, used_params, checks.search_seconds, KEPT)
    rows = run.rows
    if replay and not len(rows):
        raise BadInput(
            f"{block.name} gives NaN or infinity on made-up inputs; declare ranges within which it"
            " is finite, or give inputs of a run, --vectors FILE.csv, check(block, inputs, folder)"
        )
    # the written test is to pass where it is made: limits in float are those of trials
    tried_too = real == "float" and float_error.has_cpp_compiler() and len(rows) > 0
    trials = None
    if tried_too or (replay and boards):
        trials = _trials(plan, made, rows, used_params, hurry=not (replay or found))
    first, tried = expected_outputs.first_ticks(run, trials, KEPT)
    first, tried, every = expected_outputs.few_states(plan, first, tried)
    first = expected_outputs.with_limits(plan, first, used_params, tried)
    digest = folders.digest("".join(made[f] for f in plan.files))[:16]
    made = {n: text.replace(CONTENT, digest) for n, text in made.items()}
    made["vectors.txt"] = back_to_back.vectors(plan, digest, values, first, every)
    ticks = len(rows) if replay else len(first.rows)
    data = _facts(plan, digest, made, values, ticks) | {"made_up": width}
    data |= {"vectors": {"ticks": len(first.rows), "states_every": every}}
    data |= {"search": found} if found else {}
    with ThreadPoolExecutor() as pool:  # the boards are programs of their own
        on_boards = [pool.submit(_on_board, t, plan, made, replay) for t in boards]
        if replay:
            tried = trials if real == "float" else None
            run = expected_outputs.with_limits(plan, run, used_params, tried)
            data |= compare(plan, made, used, run, dict(params or {}), checks.closed_loop)
        data["targets"] = [f.result() for f in on_boards]
    for t in data["targets"]:
        if checks.clock is not None and "instructions" in t:
            count = t["instructions"]
            t["load"] = load.load(count["mean"], count["most"], plan.period, checks.clock)
    if checks.misra:
        data["analysis"] = analysis.cppcheck_findings(plan, made)
    if checks.fuzz_seconds:
        data["fuzz"] = fuzz.run_fuzzer(plan, made, checks.fuzz_seconds)
    if checks.prove:
        data["proof"] = module_proof.run_eva(plan, made)
    written: dict[str, str | bytes] = {**made, READABLE: readable(data, plan.layout)}
    if content.fmus:
        written |= fmu.fmus(plan, made, digest, built_for)
    data["files"] = {n: folders.digest(text) for n, text in sorted(written.items())}
    folders.publish(folder, written | {folders.MANIFEST: cc.as_json(data)})
    return Report(folder, data, CModule(folder, plan))


def _replayed(
    plan: Plan, inputs: Mapping[str, Any] | None, params: dict[str, Any], replay: bool
) -> tuple[Expected, Any]:
    """Run to replay, on these inputs or on made-up ones, and how wide those are."""
    if inputs is None:
        return made_up(plan, params)
    name, real = plan.block.name, plan.real
    rows = input_rows(plan.block, plan.layout.inputs, inputs)
    if not len(rows):
        raise BadInput(f"{name}: its inputs hold no ticks; replay at least one")
    if not np.isfinite(rows).all():
        raise BadInput(f"{name}: its inputs hold NaN or infinity; replay finite numbers")
    # all are replayed, few are written
    rows = round_to_real(rows if replay else rows[:KEPT], real)
    return expected_run(plan, rows, params), None


def _trials(
    plan: Plan, made: Mapping[str, str], rows: np.ndarray, params: Mapping[str, Any], hurry: bool
) -> float_error.Trials | None:
    """Runs of a module with other roundings; none are needed where every machine gives the same.

    In double they are for the boards alone, which replay no more than the first ticks.
    """
    if plan.real == "double":
        if not float_error.inexact("".join(made[f] for f in plan.files[1:])):
            return None
        rows = rows[:KEPT]
    with scratch_folder() as folder:
        return float_error.trials(plan, made, rows, params, folder, hurry)


def _on_board(target: str, plan: Plan, made: Mapping[str, str], replay: bool) -> dict[str, Any]:
    """What a module is on a target, and how its test went there."""
    found = targets.compiled_for(target, plan, made)
    if replay:
        ran = targets.replayed_on(target, plan, made)
        found |= ran | {"passed": found["passed"] and ran["passed"]}
    return found


def texts(plan: Plan, content: Content = Content()) -> dict[str, str]:
    """Text of each file of a module by its name; the hash of its content is not in them yet.

    Raises:
        BadInput: an integer of ``scaled`` that does not fit, or what names no section.
    """
    n = plan.name
    if (section := content.const_section) is not None:
        sections.check("--const-section", section)
    module, more = sources(plan, section), bus.bus_files(plan, content.scaled)
    if (section := content.calibration_section) is not None:
        sections.check("--calibration-section", section)
        more |= sections.calibration(plan, section)
    if content.with_xcp:
        more |= xcp.texts(plan)
    if content.with_autosar:
        more |= autosar.texts(plan)
    others = [name[:-2] for name in more if name.endswith(".c") and f"{name[:-2]}.h" in more]
    return {
        f"{n}.h": header(plan),
        **module,
        **more,
        f"{n}.a2l": a2l.a2l(plan),
        "example.c": files.example(plan),
        f"test_{n}.c": back_to_back.test_program(plan),
        "Makefile": files.makefile(plan, others),
        "CMakeLists.txt": files.cmake(plan, others),
        files.TOOLCHAIN: files.toolchain(),
        "README.md": manual.readme(plan),
        "LICENSE": files.licence(plan),
        **board_files(),
    }


def _facts(
    plan: Plan, content: str, made: Mapping[str, str], values: Mapping[str, Any], ticks: int
) -> dict[str, Any]:
    from slipctl import __version__

    b = plan.block
    work = dict(zip(("arg", "res", "iw", "w"), plan.equations.work, strict=True))
    return {
        "format": 1,
        "by": "slipctl",
        "slipctl_version": __version__,
        "casadi_version": ca.CasadiMeta.version(),
        "name": plan.name,
        "real": plan.real,
        "block": b.name,
        "kind": b.kind,
        "choices": {k: str(v) for k, v in b.choices.items()},
        "period_s": plan.period,
        "content": content,
        "memory_bytes": memory_bytes(plan),
        "work": work | {"in_state": plan.work_in_state},
        "reading": measure_source(plan, {f: made[f] for f in plan.files[1:]}),
        "equations": equations(plan, {f: made[f] for f in plan.files[1:]}),
        "lines": {n: text.count("\n") for n, text in made.items() if n != "vectors.txt"},
        "parameters": {
            n: {"value": np.asarray(v).tolist(), "unit": b.params[n].unit}
            for n, v in values.items()
        },
        "without_range": b.without_range(),
        "ticks": ticks,
        "compiled": [],
        "targets": [],
    }
