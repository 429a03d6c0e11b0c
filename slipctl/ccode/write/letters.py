"""The letters of a page of equations: names of the local variables that hold intermediate results.

They are read from the frames of the Python functions that make the expressions, as
:mod:`slipctl.block.formula` does for ``slipctl show``, for arrays too.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import Any

import casadi as ca

MOST = 400
"""Local variables that are looked at."""

_NOT_OURS = (
    "casadi",
    "numpy",
    "slipctl.block.",
    "slipctl.ccode.",
    "contextlib",
    "functools",
    "abc",
)


@contextmanager
def letters(
    groups: Sequence[Mapping[str, Any]],
) -> Iterator[Callable[[Sequence[Any]], tuple[dict[int, str], list[Any]]]]:
    """Collect local variables while a block makes its expressions.

    Args:
        groups: its symbols.

    Yields:
        A function that takes the results and gives names by number of result, and the further
        results that have them.
    """
    found: list[tuple[int, str, Any]] = []
    own = {name for g in groups for name in g}

    def watch(frame: FrameType, event: str, _: Any) -> None:
        if event != "return" or len(found) > MOST:
            return
        module = frame.f_globals.get("__name__", "")
        if module.startswith(_NOT_OURS):
            return
        depth, outer = 0, frame.f_back
        while outer is not None:
            depth, outer = depth + 1, outer.f_back
        for name, value in frame.f_locals.items():
            if not isinstance(value, (ca.SX, ca.MX)) or name.startswith("_") or name in own:
                continue
            if value.numel() and value.is_dense() and not value.is_symbolic():
                found.append((depth, name, value))

    def told(results: Sequence[Any]) -> tuple[dict[int, str], list[Any]]:
        kind = ca.SX if all(isinstance(r, (ca.SX, ca.DM)) for r in results) else ca.MX
        symbols: Any = [v for g in groups for v in g.values()]
        names: dict[int, str] = {}
        hidden: list[Any] = []
        for _, name, value in sorted(found, key=lambda x: x[0]):
            if type(value) is not kind or value.is_constant():
                continue
            expression: Any = value
            try:
                ca.Function("free", symbols, [expression])
            except RuntimeError:  # of symbols that are not the block's
                continue
            names[len(results) + len(hidden)] = name
            hidden.append(value)
        return names, hidden

    before = sys.getprofile()
    if before is None:  # a profiler at work goes first
        sys.setprofile(watch)
    try:
        yield told
    finally:
        if before is None:
            sys.setprofile(None)
