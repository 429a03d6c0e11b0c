"""What the command line set, swapped and chose, made into cases that are ready to run."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from slipctl.block.block import Block
from slipctl.block.shared_numbers import number_at, targets, warnings_of_places
from slipctl.block.transforms.discretisation import check_sample_times
from slipctl.block.units import unit_algebra
from slipctl.errors import BadInput, RunFailed, check_known, nearest
from slipctl.run import store
from slipctl.run.logs.run_log import Log
from slipctl.run.preparation import Prepared, first_tick
from slipctl.run.rail import Scenario
from slipctl.run.results import Case
from slipctl.run.scenario_inputs import loop_at_start, rail_values
from slipctl.run.warnings.doubts import warnings_of_loop
from slipctl.run.warnings.first_guesses import warnings_of_starts
from slipctl.study.declaration import Study
from slipctl.study.failures import blame
from slipctl.study.files import equation_files
from slipctl.study.resolve import find_block, is_written, load_block, load_file, load_written

log = logging.getLogger("slipctl")


@dataclass(frozen=True)
class Setting:
    """One ``--set [loop:]block.param=VALUE[unit]``; ``*.m`` sets every parameter of that ending."""

    loop: str
    name: str
    value: str

    @classmethod
    def read(cls, text: str) -> Setting:
        """Split the text of a setting.

        Raises:
            BadInput: it is not of that form.
        """
        target, equals, value = text.partition("=")
        loop, _, name = target.strip().rpartition(":")
        if not equals or not name or not value.strip():
            raise BadInput(
                f"--set {text!r}: write [loop:]block.param=VALUE[unit], such as car.m=8.2t"
            )
        return cls(loop.strip(), name.strip(), value.strip())


def open_gain_files(settings: Sequence[str]) -> list[str]:
    """Settings with each file of gains in place of its name.

    Raises:
        BadInput: no such file, or it holds no gains.
    """
    found: list[str] = []
    for text in settings:
        if "=" in text or not text.strip().endswith(".toml"):
            found.append(text)
            continue
        path = text.strip()
        _, content = equation_files.read(path)
        gains, loop = content.get("gains"), content.get("loop")
        if not isinstance(gains, Mapping) or not gains or not isinstance(loop, str):
            raise BadInput(f"--set {path} holds no gains; slipctl tune ... --out DIR writes some")
        store.check_format(path, content.get("format"))
        name = loop.rpartition(":")[2].partition("@")[0]
        found += [f"{name}:{n}={v}" for n, v in gains.items()]
    return found


def read_swaps(study: Study, texts: Sequence[str]) -> dict[str, Any]:
    """Models of a study with each ``name=file.py:block`` (or ``name=model``) in place.

    Raises:
        BadInput: no such model in the study, no such file or block.
    """
    swapped = dict(study.models)
    for text in texts:
        name, equals, source = (part.strip() for part in text.partition("="))
        if not equals or not source:
            raise BadInput(f"--swap {text!r}: write name=file.py:block, such as adh=my.py:my_law")
        if not study.models:
            raise BadInput(
                f"{study.name} has no models that --swap replaces; a study of your own may swap any"
                " part of its loops, see docs/all_rails.md, 'Rails of your own'"
            )
        check_known(f"{study.name} has no model", name, study.models, " to swap")
        if is_written(source):
            swapped[name] = load_written(source)
            continue
        file, colon, block = source.rpartition(":")
        swapped[name] = find_block(load_file(file), block, file) if colon else load_block(source)
    return swapped


def in_words(swaps: Sequence[str], settings: Sequence[str]) -> str:
    """What was swapped and set, ``"adh swapped for my.py:law, car.m=8.2t set"``."""
    swapped = [" swapped for ".join(s.strip() for s in t.split("=", 1)) for t in swaps]
    return ", ".join([*swapped, *(f"{t.strip()} set" for t in settings)])


def prepare(
    study: Study,
    *,
    quick: bool = False,
    settings: Sequence[str] = (),
    swaps: Sequence[str] = (),
    loops: Sequence[str] = (),
    scenarios: Sequence[str] = (),
    plain: Mapping[str, Sequence[str]] | None = None,
    left: list[str] | None = None,
    built: tuple[Sequence[Case], Mapping[str, Any]] | None = None,
) -> tuple[list[Case], Mapping[str, Any]]:
    """Build the cases of a study as asked for, and check each of them by a run of one tick.

    Args:
        study: the study.
        quick: its quick form.
        settings: ``[loop:]block.param=VALUE[unit]``.
        swaps: ``name=file.py:block``.
        loops, scenarios: the only ones to keep; none given keeps all.
        plain: keep the scenarios of a plain run only, and these loops of these other scenarios.
        left: gets the names of the scenarios that ``plain`` leaves out.
        built: cases and models with the swaps done, where they are built already.

    Returns:
        The cases, and the models they are made of.

    Raises:
        BadInput: anything that a person can put right; nothing was computed yet.
    """
    models = read_swaps(study, swaps) if built is None else built[1]
    read = [Setting.read(text) for text in settings]
    for k, setting in enumerate(read):
        if any((s.loop, s.name) == (setting.loop, setting.name) for s in read[:k]):
            raise BadInput(f"--set names {setting.name} twice; write it once")
    try:
        cases = list(study.cases(models, quick) if built is None else built[0])
        cases = _select(study, cases, loops, scenarios)
        if plain is not None:
            named = [c.scenario.name for c in cases]
            cases = _plain(study, cases, plain)
            run = {c.scenario.name for c in cases}
            (left if left is not None else []).extend(n for n in named if n not in run)
        cases = _set(study, cases, read)
        said: dict[str, None] = dict.fromkeys(study.without_effect)
        for case in cases:
            for name, loop in case.loops.items():
                store.check_names(Path(case.scenario.name, name))
                started = loop_at_start(loop, case.scenario)  # once: it makes the loop again
                check_sample_times(started)
                rest = case.scenario.but(params={}, start={})
                first = _try(replace(case, scenario=rest), name, started)
                said |= dict.fromkeys(warnings_of_run(started, rest, first))
                study.check(name, loop, case.scenario)
        for line in said:
            log.warning("%s", line)
    except Exception as error:
        blame(error)
    return cases, models


def warnings_of_run(
    loop: Block, scenario: Scenario, log: Mapping[Any, Any] | None = None
) -> list[str]:
    """What a run says of its numbers: places set apart, noise, wires, first guesses far off.

    Args:
        loop, scenario: the run.
        log: its log by name, or the beginning of it, if there is one.
    """

    def known(names: list[str]) -> Mapping[Any, Any]:
        if log is not None and all(n in log for n in names):
            return log
        return first_tick(loop, scenario, names)

    return [*warnings_before_run(loop, scenario), *warnings_of_starts(loop, scenario, known)]


def warnings_before_run(loop: Block, scenario: Scenario) -> list[str]:
    """What a loop says before it runs."""
    started = loop_at_start(loop, scenario)
    return [
        *warnings_of_places(started),
        *warnings_of_loop(started, scenario.but(params={}, start={})),
    ]


def _select(
    study: Study, cases: list[Case], loops: Sequence[str], scenarios: Sequence[str]
) -> list[Case]:
    known = [c.scenario.name for c in cases]
    for s in scenarios:
        check_known(f"{study.name} has no scenario", s, known)
    names = list(dict.fromkeys(n for c in cases for n in c.loops))
    for name in loops:
        check_known(f"{study.name} has no loop", name, names)
    kept = [c for c in cases if not scenarios or c.scenario.name in scenarios]
    if loops:
        kept = [replace(c, loops={n: c.loops[n] for n in c.loops if n in loops}) for c in kept]
    kept = [c for c in kept if c.loops]
    if not kept:
        raise BadInput(f"{study.name} has no loop {' or '.join(loops)} in {' or '.join(scenarios)}")
    return kept


def _plain(study: Study, cases: list[Case], also: Mapping[str, Sequence[str]]) -> list[Case]:
    """Keep the scenarios of a plain run, where there are any, and what else is wanted."""
    if not any(c.scenario.name in study.plain for c in cases):
        return cases
    kept = []
    for case in cases:
        name = case.scenario.name
        few = {n: case.loops[n] for n in case.loops if n in also.get(name, ())}
        if name in study.plain or few:
            kept.append(case if name in study.plain else replace(case, loops=few))
    return kept


def _set(study: Study, cases: list[Case], settings: Sequence[Setting]) -> list[Case]:
    """Apply the settings; each must reach at least one loop that runs."""
    for s in settings:
        names = list(dict.fromkeys(n for c in cases for n in c.loops))
        if s.loop and s.loop not in names:
            raise BadInput(
                f"--set {s.loop}:{s.name}: no loop {s.loop!r} runs{nearest(s.loop, names)}"
            )
        reached, overruled, changed = 0, "", []
        for case in (_freed(case, s) for case in cases):
            loops = dict(case.loops)
            for name, loop in case.loops.items():
                if s.loop not in ("", name):
                    continue
                meant = targets(loop, s.name)
                by_rail = {n for group in rail_values(loop, case.scenario) for n in group}
                free = [t for t in meant if t not in by_rail]
                if len(free) < len(meant) and not overruled:
                    first = next(t for t in meant if t in by_rail)
                    overruled = f"{name}'s {first} in scenario {case.scenario.name}"
                if free:
                    loops[name] = _with(loop, free, s)
                    reached += 1
            changed.append(replace(case, loops=loops))
        if not reached and overruled:
            raise BadInput(
                f"--set {s.name}: the rail sets {overruled}, so a constant has no effect;"
                f" --swap the law, or edit its rail conditions"
            )
        if not reached:
            loop_names = (n for c in cases for k, b in c.loops.items() if s.loop in ("", k)
                          for n in [*b.params, *b.states])  # fmt: skip
            endings = dict.fromkeys(e for n in loop_names for e in _endings(n))
            where = f"loop {s.loop}" if s.loop else f"no loop of {study.name}"
            has = "has no" if s.loop else "has a"
            last = s.name.rpartition(".")[2].lower()
            shared = [n for n in endings if n.lower() == last]
            hint = f"; did you mean {shared[0]!r}, which blocks share?" if shared else ""
            raise BadInput(f"{where} {has} parameter {s.name!r}{hint or nearest(s.name, endings)}")
        if overruled:
            log.warning("--set %s has no effect where the rail sets it: %s", s.name, overruled)
        cases = changed
    return cases


def _endings(name: str) -> list[str]:
    """Endings of a dotted name with at least two parts, shortest first: what a person writes."""
    parts = name.split(".")
    return [".".join(parts[k:]) for k in range(max(len(parts) - 2, 0), -1, -1)]


def _freed(case: Case, s: Setting) -> Case:
    """Hand what the scenario gives, where a setting changes it, to the loops: the setting wins."""
    scenario, loops = case.scenario, dict(case.loops)
    for role, field in (("param", "params"), ("state", "start")):
        kept = dict(getattr(scenario, field))
        for key, value in list(kept.items()):
            chosen = {n: b for n, b in case.loops.items() if s.loop in ("", n)}
            if any(_meant(b, key, role) & _meant(b, s.name) for b in chosen.values()):
                del kept[key]
                log.warning("--set %s replaces %s of scenario %s", s.name, key, scenario.name)
                loops = {
                    n: b.with_params(**dict.fromkeys(_meant(b, key, role), value))
                    for n, b in loops.items()
                }
        scenario = scenario.but(**{field: kept})
    return replace(case, scenario=scenario, loops=loops)


def _meant(loop: Block, name: str, *roles: str) -> set[str]:
    """Numbers of a loop that a name sets."""
    return {number_at(loop, n) for n in targets(loop, name, roles or ("param", "state"))}


def _with(loop: Block, names: Sequence[str], s: Setting) -> Block:
    values: dict[str, Any] = {}
    for t in names:
        signal = loop.declared(t)
        text = s.value.strip()
        if signal.values and not text[:1].isdigit():
            values[t] = float(signal.code(t, text))
        elif text[:1] == "[" and text[-1:] == "]":
            elements = text[1:-1].split(",")
            values[t] = [unit_algebra.parse_quantity(e, signal.unit, t) for e in elements]
        else:
            values[t] = unit_algebra.parse_quantity(s.value, signal.unit, t)
    return loop.with_params(**values)


def _try(case: Case, name: str, loop: Block) -> Log | None:
    """Run one tick: whatever is missing, unknown or out of range shows; None where it breaks."""
    scenario = case.scenario
    if loop.period is not None and round(scenario.duration / loop.period) > 1:
        scenario = scenario.but(duration=loop.period)
    try:
        first = Prepared(loop, scenario, compile=False)()
    except BadInput as error:
        raise BadInput(f"{case.scenario.name}/{name}: {error}") from None
    except RunFailed:
        return None  # the run itself will say so, with what else there is to see
    sections = 1 if case.scenario.rail is None else len(case.scenario.rail.sections)
    for key, known in case.known.items():
        if isinstance(known.values, Sequence) and len(known.values) != sections:
            raise BadInput(
                f"{case.scenario.name}: {key} has {len(known.values)} values for {sections}"
                f" rail sections"
            )
    return first
