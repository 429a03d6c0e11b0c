"""Blocks as bytes, for another process: what a person's own file defines travels with them."""

from __future__ import annotations

import io
import pickle
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import RLock
from types import ModuleType
from typing import Any

FILE = "slipctl_file_"
"""How the name of a module begins that is a person's file."""

_lock = RLock()


def dumps(value: Any) -> bytes:
    """Bytes of a block, a loop, or of what holds some.

    A function of the library goes by its name, one of a person's file with its code. So the bytes
    are for the same version of Python and of slipctl.
    """
    import casadi as ca
    import cloudpickle

    class Pickler(cloudpickle.Pickler):
        def reducer_override(self, found: Any) -> Any:
            if type(found).__reduce__ is reduce_block:  # a block: all of them in one go
                return object.__new__, (type(found),), state(found)
            return super().reducer_override(found)

    raw = io.BytesIO()
    with _lock, _travelling(cloudpickle), ca.global_pickle_context():
        Pickler(raw).dump(value)
    return raw.getvalue()


def loads(raw: bytes) -> Any:
    """What :func:`dumps` made bytes of."""
    import casadi as ca

    with _lock, ca.global_unpickle_context():
        return pickle.loads(raw)


def reduce_block(block: Any) -> tuple[Any, ...]:
    """A block as ``pickle`` wants it."""
    return loads, (dumps(block),)


def state(block: Any) -> dict[str, Any]:
    """What makes a block, and its Function, so that it gives the same bits.

    What else was worked out of its equations is worked out again.
    """
    return vars(block) | {"_made": {k: v for k, v in block._made.items() if k == "f"}}


def own_modules() -> list[ModuleType]:
    """A person's files that were loaded, and the modules beside them."""
    there = {n: (m, Path(m.__file__ or "").resolve()) for n, m in list(sys.modules.items())
             if (getattr(m, "__file__", None) or "").endswith(".py")}  # fmt: skip
    folders = {p.parent for n, (_, p) in there.items() if n.startswith(FILE)}
    return [m for m, p in there.values() if p.parent in folders]


@contextmanager
def _travelling(cloudpickle: Any) -> Iterator[None]:
    """Let what a person's files define go with its code."""
    before = cloudpickle.list_registry_pickle_by_value()
    new = [m for m in own_modules() if m.__name__ not in before]
    for m in new:
        cloudpickle.register_pickle_by_value(m)
    try:
        yield
    finally:
        for m in new:
            cloudpickle.unregister_pickle_by_value(m)
