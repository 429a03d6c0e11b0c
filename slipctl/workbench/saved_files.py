"""What is moved on the page, written into its file: comments kept, each number checked after."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slipctl.block.block import Block
from slipctl.errors import BadInput
from slipctl.run import store
from slipctl.study.files import loop_files, trip_files
from slipctl.study.request import Request
from slipctl.workbench.desk import Desk
from slipctl.workbench.sliders import Slider
from slipctl.workbench.texts import keys_with_number, with_value


def text_with_numbers(
    path: str, text: str, loop: str, numbers: Mapping[str, float], sliders: Sequence[Slider]
) -> tuple[str, list[str]]:
    """Text of a file whose loop has these numbers, all else left letter by letter.

    Which key a number comes from is found by trying: the loop of the new text must have that
    number. A file may derive others from it that ``--set`` leaves alone, as the limits that a
    controller checks its sensors by; they are told.

    Args:
        path: of the file. text: of it. loop: whose numbers are meant, ``pid`` or ``pid@base``.
        numbers: in SI. sliders: of the loop.

    Returns:
        The text, and a line for each number that sets others too.

    Raises:
        BadInput: no key of the text sets a number.
    """
    known = {s.name: s for s in sliders}
    notes = []
    for name, value in numbers.items():
        before = _loop(path, text, loop)
        unit = known[name].unit
        now = float(np.asarray(before.param_values()[name]))
        if now == value:
            continue
        wanted = _values(before.with_params(**{name: value}))
        plain = repr(float(value)).removesuffix(".0")
        word = plain if unit == "1" else json.dumps(f"{plain} {unit}")
        found: list[tuple[int, str, list[str]]] = []
        for keys in keys_with_number(text, name, now, unit):
            try:
                made = with_value(text, keys, word)
                others = _different(_values(_loop(path, made, loop)), wanted)
            except BadInput:
                continue
            if name not in others:
                found.append((len(others), made, others))
            if not others:
                break
        if not found:
            raise BadInput(f"no key of {path} sets {name}; write it into the text by hand,"
                           f" it shall be {value:g} {unit}")  # fmt: skip
        _, text, others = min(found, key=lambda f: f[0])
        if others:
            notes.append(f"{name} in the file sets {', '.join(others)} too")
    return text, notes


def _loop(path: str, text: str, loop: str) -> Block:
    return Request.of(trip_files.study_of_text(path, text), loop).declared[0]


def _values(loop: Block) -> dict[str, np.ndarray]:
    return {n: np.asarray(v, dtype=float) for n, v in loop.param_values().items()}


def _different(one: Mapping[str, np.ndarray], other: Mapping[str, np.ndarray]) -> list[str]:
    """Names of numbers in which they differ by more than the rounding of units."""
    return [
        n for n in {**one, **other}
        if n not in one or n not in other or one[n].shape != other[n].shape
        or not np.allclose(one[n], other[n], rtol=1e-9, atol=1e-30)
    ]  # fmt: skip


def save_desk(
    desk: Desk, name: str, text: str | None, numbers: Mapping[str, float]
) -> dict[str, Any]:
    """Write what is open with its numbers into a file of the folder.

    Args:
        desk: what is open. name: of the file; empty for the one that is open.
        text: as it is edited; of a study of the library its loop is written out.
        numbers: that were moved.

    Returns:
        Name of the file, its text, and notes, as :func:`text_with_numbers`.

    Raises:
        BadInput: a name outside of the folder, a file that is there and is another one, faults.
    """
    own = str(Path(desk.home).resolve()) if desk.text is not None else ""
    path = desk.within(name or own or f"{desk.loop}.toml")
    is_own = bool(own) and path == desk.within(own)
    if path.exists() and not is_own:
        raise BadInput(f"{path.name} exists; write another name")
    rig = desk.rig(text)
    loop = f"{desk.loop}@{desk.scenario}" if desk.scenario else desk.loop
    if text is None:
        text = loop_files.loop_file_text(f"{desk.home}:{loop}", path.name)
        loop = desk.loop
    made, notes = text_with_numbers(path.name, text, loop, numbers, rig.sliders)
    store.check_file(path)
    store.write_text(path, made)
    return {"file": path.name, "text": made, "notes": notes}
