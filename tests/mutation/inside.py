"""A small change of a function in this process, while a block runs."""

from __future__ import annotations

import functools
import gc
import sys
import types
from collections import defaultdict
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from recorded_calls import ROOT, bare, named, within
from sites import Site, sites


@lru_cache
def changes(room: str) -> list[Site]:
    """All changes of a room."""
    return [s for path in sorted((ROOT / room).rglob("*.py"))
            for s in sites(path.relative_to(ROOT).as_posix(), path.read_text("utf-8"))]  # fmt: skip


def by_place(every: Iterable[Site], known: Iterable[str]) -> dict[str, list[Site]]:
    """Changes by the function of the table that holds them; by their own where none does."""
    top = {place.partition(".<locals>")[0] for place in known}
    of: dict[str, list[Site]] = defaultdict(list)
    for site in every:
        module = site.file.removesuffix(".py").replace("/", ".").removesuffix(".__init__")
        names = site.function.split(".")
        places = [f"{module}:{'.'.join(names[: k + 1])}" for k in range(len(names))]
        of[next((p for p in reversed(places) if p in top), places[-1])].append(site)
    return of


@contextmanager
def changed(place: str, site: Site) -> Iterator[bool]:
    """Whether there is such a function and its code was changed: then it has that code inside."""
    function = bare(named(place))
    own = function.__code__
    text = Path(own.co_filename).read_text(encoding="utf-8")
    new = within(compile(site.applied(text), own.co_filename, "exec"), place.partition(":")[2])
    fits = len(new) > 0 and new[0].co_freevars == own.co_freevars
    try:
        if fits:
            function.__code__ = new[0]
        yield fits
    finally:
        function.__code__ = own


def remembered() -> list[functools._lru_cache_wrapper[object]]:
    """All that remembers results of calls."""
    return [c for c in gc.get_objects() if isinstance(c, functools._lru_cache_wrapper)
            and c.__module__.startswith("slipctl.")]  # fmt: skip


def is_function(place: str) -> bool:
    try:
        return isinstance(bare(named(place)), types.FunctionType)
    except Exception:  # a class, a name of a module that is gone
        return False
