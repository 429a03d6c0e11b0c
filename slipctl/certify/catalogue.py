"""All systems that can be certified, by the name that the command line knows them by.

Every module of this room and of a registered package whose name ends in ``_kind`` is loaded, and
enters its systems. So a law's certificate stands beside the law, and the engine need not know it.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

from slipctl import registry
from slipctl.certify import systems
from slipctl.certify.registry import OF_LOOPS, PROVED_LAST, SYSTEMS
from slipctl.certify.systems import Report, System
from slipctl.errors import BadInput, nearest

__all__ = ["OF_LOOPS", "PROVED_LAST", "SYSTEMS", "certify", "system", "system_of_gains"]

for _kind in registry.modules_ending("_kind", (Path(__file__).parent, "slipctl.certify")):
    import_module(_kind)


def system(name: str) -> System:
    """System by its name.

    Raises:
        BadInput: there is none.
    """
    if name not in SYSTEMS:
        raise BadInput(f"cannot certify {name!r}{nearest(name, SYSTEMS)}")
    return SYSTEMS[name]


def system_of_gains(gains: Any, loop: Any) -> System:
    """System that gains are asked as: one by its name, or one made of their loop."""
    made = gains.made
    found: System = system(gains.system) if made is None else made(loop)
    return found


def certify(name: str, **numbers: Any) -> Report:
    """Verdict, margins and witness of a system: ``certify("reaching_law", g1=36, g2=12, T=1e-3)``.

    Raises:
        BadInput: an unknown system or number, or numbers that mean nothing.
    """
    return systems.report(system(name), numbers)
