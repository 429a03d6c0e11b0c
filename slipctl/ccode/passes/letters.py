"""The letters of a page of equations: names of the local variables that hold intermediate results.

They are read from the frames of the Python functions that make the expressions, as
:mod:`slipctl.block.text.formula` does for ``slipctl show``, for arrays too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import CodeType, FrameType
from typing import Any

import casadi as ca

from slipctl.block.text.intermediates import watch_calls
from slipctl.ccode.module.origins import of_local, of_result

MOST = 4000
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


@dataclass
class Told:
    """Letters of a page.

    Attributes:
        names: by number of result.
        hidden: the further results that have them.
        origins: where each letter got its value, by number of result.
        codes: the functions of the page, outermost first.
        doc: docstring of the page.
    """

    names: dict[int, str] = field(default_factory=dict)
    hidden: list[Any] = field(default_factory=list)
    origins: dict[int, str] = field(default_factory=dict)
    codes: list[CodeType] = field(default_factory=list)
    doc: str = ""

    def of_result(self, name: str) -> str:
        """Where a next state or an output was written; empty if that is not known."""
        return of_result(self.codes, name, self.doc)


@contextmanager
def letters(
    groups: Sequence[Mapping[str, Any]],
    doc: str = "",
) -> Iterator[Callable[[Sequence[Any]], Told]]:
    """Collect local variables while a block makes its expressions.

    Args:
        groups: its symbols.
        doc: its docstring; numbers of equations that it has are not told again.

    Yields:
        A function that takes the results and tells the letters.
    """
    found: list[tuple[int, str, Any, CodeType]] = []
    codes: list[tuple[int, CodeType]] = []
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
        codes.append((depth, frame.f_code))
        for name, value in _expressions(frame.f_locals):
            if name.startswith("_") or name in own:
                continue
            if value.numel() and value.is_dense() and not value.is_symbolic():
                found.append((depth, name, value, frame.f_code))

    def told(results: Sequence[Any]) -> Told:
        kind = ca.SX if all(isinstance(r, (ca.SX, ca.DM)) for r in results) else ca.MX
        symbols: Any = [v for g in groups for v in g.values()]
        made = Told(codes=[code for _, code in sorted(codes, key=lambda x: x[0])], doc=doc)
        for _, name, value, code in sorted(found, key=lambda x: x[0]):
            if type(value) is not kind or value.is_constant():
                continue
            expression: Any = value
            try:
                ca.Function("free", symbols, [expression])
            except RuntimeError:  # of symbols that are not the block's
                continue
            number = len(results) + len(made.hidden)
            made.names[number] = name
            made.origins[number] = of_local(code, name, doc)
            made.hidden.append(value)
        return made

    with watch_calls(watch):
        yield told


def _expressions(found: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Expressions among local variables, and among what the object of a method keeps."""
    for name, value in found.items():
        if isinstance(value, (ca.SX, ca.MX)):
            yield name, value
        elif name == "self" and type(value).__module__.startswith("slipctl.models."):
            yield from ((k, v) for k, v in vars(value).items() if isinstance(v, (ca.SX, ca.MX)))
