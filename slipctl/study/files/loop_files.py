"""A loop of a study written out as a file: its rail, its scenario and every number it has."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from slipctl.block.block import Block
from slipctl.block.shared_numbers import targets
from slipctl.block.signals import Signal
from slipctl.errors import BadInput
from slipctl.run.rail import Scenario
from slipctl.run.scenario_inputs import loop_at_start
from slipctl.study.request import Request

BOUND = "ideal"
"""Loop that the others of a study are measured against; a file takes it along."""

WIDTH, LONGEST = 44, 110
"""Column at which a comment begins, and the length of a line from which it is cut."""

Row = tuple[str, Any, "Signal"]


def loop_file_text(name: str, file: str) -> str:
    """File of a loop, which runs to the numbers of the study's own run.

    Args:
        name: ``study:loop`` or ``study:loop@scenario``.
        file: what it will be called, for its head.

    Raises:
        BadInput: no such loop; a study of a file.
    """
    asked = Request.read(name).needs_loop()
    if asked.home.endswith(".toml"):
        raise BadInput(
            f"{asked.home} is such a file already; copy it, and leave the other loops out"
        )
    study, (loop, case) = asked.study, asked.declared
    short, scenario = asked.loop, case.scenario
    loops = {short: loop}
    if BOUND in case.loops and short != BOUND:
        loops[BOUND] = case.loops[BOUND]
    own = f"{study.controller}."
    lines = [
        "#:schema ./slipctl.schema.json",
        "#",
        f"# The loop {short} of the study {study.name} in its scenario {scenario.name}, with all",
        "# of its numbers. As it stands it runs to the numbers of the study itself:",
        "#",
        f"#     slipctl run {file}",
        "#",
        "# Edit any number; what is left out stays as the study has it. A second controller is a",
        f"# copy of [controllers.{short}] under another name.",
        "",
        f"title = {_text(f'{short} of {study.name}, {scenario.name}')}",
        f"duration = {_number(float(scenario.duration), 's')}",
        f"seed = {scenario.seed}",
        f"noise = {_number(float(scenario.noise), '1')}",
        "",
        "[vehicle]",
        'kind = "study"                           # its equations and wires',
        f"study = {_text(asked.home)}",
        f"scenario = {_text(scenario.name)}",
        "",
        *_rail(loop, scenario),
        *_inputs(loop, scenario),
    ]
    made = {n: loop_at_start(block, scenario) for n, block in loops.items()}
    numbers = {}
    for n, block in loops.items():  # those that stand for themselves, and the rail leaves alone
        ruled = ruled_numbers(block, scenario)
        every = _plain_of(made[n].params, made[n].param_values())
        numbers[n] = [row for row in every if row[0] not in ruled]
    all_have = {n for n, _, _ in numbers[short] if not n.startswith(own)}
    lines += _table("numbers", [row for row in numbers[short] if row[0] in all_have])
    lines += _table("start", [
        (n, v, s) for n, v, s in _plain_of(made[short].states, made[short].start())
        if not n.startswith(own)
    ])  # fmt: skip
    for called, rows in numbers.items():
        lines += ["", f"[controllers.{called}]", 'kind = "study"', f"loop = {_text(called)}"]
        rows = [row for row in rows if row[0] not in all_have]
        lines += _table(f"controllers.{called}.numbers", rows)
    return "\n".join(lines) + "\n"


def _plain_of(signals: Mapping[str, Signal], values: Mapping[str, Any]) -> Iterator[Row]:
    for n, s in signals.items():
        free = not (s.derived or isinstance(s.value, str) or s.value is None)
        if free and n in values and np.isfinite(values[n]).all():
            yield n, values[n], s


def ruled_numbers(loop: Block, scenario: Scenario) -> set[str]:
    """Numbers that the rail sets, section by section or by its conditions."""
    found = {n for values in loop.conditions.values() for n in values}
    for section in scenario.rail.sections if scenario.rail else ():
        for name in section.values:
            found.update(targets(loop, name, ("input", "param")))
    return found


def _rail(loop: Block, scenario: Scenario) -> Iterator[str]:
    rail = scenario.rail
    if rail is None:
        return
    named = {s.condition for s in rail.sections if s.condition}
    if named:
        yield "[rail.conditions]"
        for name, values in loop.conditions.items():
            if name in named:
                for n, v in values.items():
                    yield _entry(f"{name}.{n}", v, loop.declared(n), told=False)
        yield ""
    key, unit = ("time", "s") if rail.by == "time" else ("place", "m")
    for section in rail.sections:
        yield "[[rail.sections]]"
        yield f"{key} = {_number(float(section.start), unit)}"
        if section.condition:
            yield f"condition = {_text(section.condition)}"
        for name, value in section.values.items():
            full = targets(loop, name, ("input", "param"))[0]
            signal = loop.inputs.get(full) or loop.declared(full)
            yield _entry(f"values.{name}", value, signal)
        yield ""


def _inputs(loop: Block, scenario: Scenario) -> Iterator[str]:
    if not scenario.inputs:
        return
    yield "[inputs]"
    for name, feed in scenario.inputs.items():
        full = loop.find(name, "input")
        if isinstance(feed, (int, float)):
            yield _entry(name, float(feed), loop.inputs[full])
        else:
            yield f"# {name} changes over time, as the study has it"
    yield ""


def _table(title: str, rows: Sequence[Row]) -> Iterator[str]:
    if not rows:
        return
    yield from ("", f"[{title}]")
    names = {n for n, _, _ in rows}
    for n, value, signal in rows:
        whole = any(other.startswith(f"{n}.") for other in names)
        inside = any(n.startswith(f"{other}.") for other in names)
        yield _entry(n, value, signal, quoted=whole or inside)


def _entry(name: str, value: Any, signal: Signal, quoted: bool = False, told: bool = True) -> str:
    """Line of a number: name, number with its unit, meaning."""
    keys = [_text(name)] if quoted else [
        k if re.fullmatch(r"[A-Za-z0-9_-]+", k) else _text(k) for k in name.split(".")
    ]  # fmt: skip
    said = f"{'.'.join(keys)} = {_number(np.asarray(value, dtype=float).tolist(), signal.unit)}"
    doc = " ".join(signal.doc.split())
    source = f" ({signal.source})" if signal.source and told else ""
    for text in (f"{doc}{source}", doc, doc.partition("(")[0].partition(",")[0].strip()):
        line = f"{said.ljust(WIDTH)} # {text}"
        if len(line) <= LONGEST:
            break
    return line if doc else said


def _number(value: Any, unit: str) -> str:
    if isinstance(value, list):
        return "[" + ", ".join(_number(v, unit) for v in value) + "]"
    assert math.isfinite(value)
    plain = repr(value).removesuffix(".0")
    return plain if unit == "1" else _text(f"{plain} {unit}")


def _text(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)
