"""``slipctl c``: a controller as C."""

from __future__ import annotations

import argparse
import logging
from pathlib import Path

from slipctl.ccode import codegen
from slipctl.ccode.check.processor import load
from slipctl.ccode.check.vectors import search
from slipctl.ccode.check.vectors.vector_file import read_vectors
from slipctl.errors import BadInput, RunFailed
from slipctl.run import build, store
from slipctl.study import case_setup, resolve

log = logging.getLogger("slipctl")


def answer(options: argparse.Namespace, command: str) -> int:
    """Write the C, and check it if asked."""
    name, out = options.name, Path(options.out)
    options.settings = case_setup.open_gain_files(options.settings)
    if not options.out:
        raise BadInput("--out names no folder; write one, or . for this one")
    if options.fuzz is not None and options.fuzz < 1:
        raise BadInput(f"--fuzz {options.fuzz} gives it no time; write seconds, such as 15")
    store.check_folder(out)
    left, colon, loop_name = name.rpartition(":")
    if name in resolve.studies():
        raise resolve.no_loop(name, resolve.load_study(name))
    if colon and "." in loop_name and not resolve.is_written(name):
        name, loop_name, options.part = _with_part(name, loop_name, options.part)
    is_loop = (
        colon
        and not resolve.is_written(name)
        and (not left.endswith(".py") or resolve.has_study(left))
    )
    seconds = search.effort(options.vectors) if options.vectors else None
    vectors = options.vectors if seconds is None else None
    if seconds and build.compiler() is None:
        raise BadInput("--vectors search needs a C compiler; install gcc or clang")
    block = None if is_loop else resolve.load_block(name)
    if block is not None and options.settings:
        raise BadInput(f"{name} is no loop and has no --set; write its numbers into the file")
    if block is not None and options.part:
        raise BadInput(f"{name} is no loop and has no --part {options.part}; leave it out")

    if options.check and build.compiler() is None:
        raise BadInput("--check needs a C compiler; install gcc or clang, or set CC to one")
    if options.clock is not None and not (options.check and options.target != "host"):
        raise BadInput(
            f"--clock {options.clock} is that of a processor that the C runs on; write --check and"
            " --target cortex-m4"
        )
    platforms = options.platforms.split(",") if options.platforms is not None else None
    wanted = {
        "platforms": platforms,
        "check": options.check, "real": options.real, "target": options.target,
        "clock": load.clock(options.clock), "misra": options.misra, "fmus": options.fmu,
        "fuzz_seconds": options.fuzz or 0, "prove": options.prove, "scaled": options.scaled,
        "const_section": options.const_section, "calibration_section": options.calibration_section,
        "with_xcp": options.xcp, "with_autosar": options.autosar,
        "rates": options.rates, "counter": options.counter, "search_seconds": seconds or 0,
    }  # fmt: skip
    if block is not None:
        inputs = read_vectors(vectors, block) if vectors else None
        report = codegen.export(block, out, options.module, inputs, **wanted)
    else:
        study = resolve.load_study(left)
        loop, case = case_setup.resolve_loop(study, loop_name, options.settings)
        part = options.part or study.controller
        words = [] if part == study.controller else part.split(".")
        try:
            control = loop[part]
        except BadInput as error:
            what = "part" if options.part else "controller"
            raise BadInput(f"{name} has no {what} to write: {error}") from None
        if vectors:
            inputs = read_vectors(vectors, control)
            _, params = codegen.record_part(loop, part, case.scenario, 1)
        else:
            log.info("running %s for its inputs", name)
            ticks = None if options.check else codegen.KEPT
            inputs, params = codegen.record_part(loop, part, case.scenario, ticks)
        report = codegen.export(
            control, out,
            options.module or "_".join([study.name, loop_name.partition("@")[0], *words]),
            inputs=inputs, params=params, period=loop.period, **wanted,
        )  # fmt: skip
    print(store.text_of(out / "report.json") if options.json else report)
    if len(report.data["name"]) > codegen.SIGNIFICANT:
        log.warning(
            "the functions of %s differ behind their 31st character only, which C99 need not tell"
            " apart (MISRA C:2012, 5.1); --name gives a shorter name", report.data["name"],
        )  # fmt: skip
    if report.only_load:
        raise RunFailed(f"{name}: a step takes longer than its tick; see {out / 'report.json'}")
    if report.only_unproven:
        raise RunFailed(f"{name}: not all of it is proven; see {out / 'report.md'}")
    if not report.passed:
        raise RunFailed(f"{name}: the C differs from Python; see {out / 'report.json'}")
    return 0


def _with_part(name: str, loop: str, part: str | None) -> tuple[str, str, str]:
    """``STUDY:LOOP.PART`` as the loop and its part."""
    if part:
        raise BadInput(f"{name} names a part, and --part {part} another; leave one out")
    found, _, path = loop.partition(".")
    return name.removesuffix(f".{path}"), found, path
