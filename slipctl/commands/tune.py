"""``slipctl tune``: gains found on an ensemble, with certificate, judgement and report."""

from __future__ import annotations

import argparse
import logging
import sys
from pathlib import Path

from slipctl.commands.progress import Progress
from slipctl.design import gain_files, page
from slipctl.design.promises import promises_of_loop
from slipctl.design.tune import Stopped, tune
from slipctl.draw import plots
from slipctl.errors import BadInput
from slipctl.run import interrupts, store
from slipctl.run.sweep.ensemble import Ensemble, load_ensemble
from slipctl.study.request import Request

log = logging.getLogger("slipctl")


def answer(options: argparse.Namespace, command: str) -> int:
    """Search what is missing, write gains, certificate and report, and print what was found."""
    if options.name is None:
        raise BadInput("say what to tune: slipctl tune STUDY:LOOP --free k1=1:60 --minimise METRIC")
    if not options.objective:
        raise BadInput("--minimise names no metric; write one, such as --minimise distance")
    if not options.out:
        raise BadInput("--out names no folder; write one")
    out = Path(options.out)
    store.check_folder(out)
    asked, ensemble = _world_of(options)
    study, case, loop = asked.study, asked.case, asked.loop
    name = f"{asked.home}:{loop}@{case.scenario.name}"
    progress = Progress(5 if options.prove else 4, sys.stderr, options.quiet)

    def tell(line: str) -> None:
        progress.end()
        log.info("%s", line)

    try:
        found = tune(
            case.loops[loop], options.free, options.objective, ensemble, options.limits,
            scenario=case.scenario, signals=study.signals, known=case.known,
            gains=promises_of_loop(study.certificates.gains, loop, case.scenario.name), out=out,
            samples=options.samples, seed=options.seed, runs=options.runs,
            held_out=options.held_out, prove=options.prove,
            controller=study.controller, jobs=options.jobs, compile=not options.no_compile,
            tell=tell, progress=progress,
            about={"loop": name, "set": list(asked.settings),
                   "swapped": list(asked.swaps), "command": command},
        )  # fmt: skip
    except Stopped as stopped:
        store.write_text(out / "gains.toml", gain_files.gains_text(stopped.best, command))
        raise KeyboardInterrupt(
            f"{out / 'gains.toml'} has the best so far; the same line goes on; {interrupts.KEPT}"
        ) from None
    finally:
        progress.end()
    store.write_text(out / "gains.toml", gain_files.gains_text(found, command))
    certified = bool(found.promises.gains) or found.statement is not None
    if certified:
        said = gain_files.certificate_of(found, command, asked.settings, asked.swaps)
        store.write_text(out / "certificate.json", store.json_text(said))
    if found.front:
        store.write_json(out / "front.json", gain_files.front_of(found, command))
        plots.save(page.front_picture(found), out, "front", command)
    store.write_text(out / "report.html", page.page(found, command))
    if options.json:
        print(store.json_text(gain_files.found_of(found, command) | {"folder": str(out)}).rstrip())
        return 0
    print(page.text(found))
    names = ["gains.toml", *(["certificate.json"] if certified else []),
             *(["front.json", "front.svg"] if found.front else []), "report.html"]  # fmt: skip
    print("\n" + "\n".join(str(out / n) for n in names))
    return 0


def _world_of(options: argparse.Namespace) -> tuple[Request, Ensemble]:
    """Loop to tune, in the scenario whose ensemble is meant, and that ensemble."""
    asked = Request.read(options.name, options.settings, options.swaps).needs_loop()
    given = load_ensemble(options.ensemble) if options.ensemble else None
    if not asked.scenario:
        having = [c.scenario.name for c in asked.cases if asked.loop in c.loops]
        if having:
            declared = [s for s in asked.study.ensembles if s in having]
            asked = asked.at(asked.loop, (declared or having)[0])
    scenario = asked.scenario or asked.declared[1].scenario.name  # says what there is
    ensemble = given or asked.study.ensembles.get(scenario)
    if ensemble is None:
        raise BadInput(
            f"{asked.study.name} declares no ensemble for {asked.loop} in scenario {scenario};"
            " write one in a file, --ensemble FILE.toml, see slipctl docs tune"
        )
    return asked, ensemble
