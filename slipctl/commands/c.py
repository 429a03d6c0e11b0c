"""``slipctl c``: a controller as C."""

from __future__ import annotations

import argparse
import logging
from pathlib import Path

from slipctl.block.transforms.discretisation import runs_of_part
from slipctl.ccode import codegen
from slipctl.ccode.check.processor import load
from slipctl.ccode.check.vectors import search
from slipctl.ccode.check.vectors.vector_file import read_vectors
from slipctl.errors import BadInput, RunFailed
from slipctl.run import build, store
from slipctl.study import processor
from slipctl.study.files import trip_files
from slipctl.study.request import Request

log = logging.getLogger("slipctl")


def answer(options: argparse.Namespace, command: str) -> int:
    """Write the C, and check it if asked."""
    name, out = options.name, Path(options.out)
    if not options.out:
        raise BadInput("--out names no folder; write one, or . for the current folder")
    if options.fuzz is not None and options.fuzz < 1:
        raise BadInput(f"--fuzz {options.fuzz} gives it no time; write seconds, such as 15")
    store.check_folder(out)
    asked = Request.read(name, options.settings)
    if asked.home:
        asked.needs_loop()
    if asked.part and options.part:
        raise BadInput(f"{name} names a part, and --part {options.part} another; leave one out")
    seconds = search.effort(options.vectors) if options.vectors else None
    vectors = options.vectors if seconds is None else None
    if seconds and build.compiler() is None:
        raise BadInput("--vectors search needs a C compiler; install gcc or clang")
    block = None if asked.loop else asked.block
    if block is not None and asked.settings:
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
        "byte_order": options.byte_order,
        # of a vehicle's file the C gives commands; what its parts tell each other is measured
        "asked": trip_files.is_trip(asked.home),
    }  # fmt: skip
    if block is not None:
        inputs = read_vectors(vectors, block) if vectors else None
        report = codegen.export(block, out, options.module, inputs, **wanted)
    else:
        study, (loop, case) = asked.study, asked.chosen
        part = asked.part or options.part or study.controller
        words = [] if part == study.controller else part.split(".")
        try:
            runs = runs_of_part(loop, part)
        except BadInput as error:
            what = "part" if asked.part or options.part else "controller"
            raise BadInput(f"{name} has no {what} to write: {error}") from None
        if vectors:
            inputs = read_vectors(vectors, runs.block)
            _, params = codegen.record_part(loop, part, case.scenario, 1)
        else:
            log.info("running %s for its inputs", name)
            ticks = None if options.check else codegen.KEPT
            inputs, params = codegen.record_part(loop, part, case.scenario, ticks)
            if options.check and options.real == "float":
                wanted["closed_loop"] = processor.closed_loop(asked, part)
        report = codegen.export(
            runs.block, out,
            options.module or "_".join([study.name, asked.loop, *words]),
            inputs=inputs, params=params, period=runs.period, **wanted,
        )  # fmt: skip
    print(store.text_of(out / "report.json") if options.json else report)
    if len(report.data["name"]) > codegen.SIGNIFICANT:
        log.warning(
            "the functions of %s differ behind their 31st character only, which C99 need not tell"
            " apart (MISRA C:2012, 5.1); --name gives a shorter name", report.data["name"],
        )  # fmt: skip
    if report.failures:
        raise RunFailed(f"{name}: {'; '.join(report.failures)}; see {out / codegen.READABLE}")
    return 0
