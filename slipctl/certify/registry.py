"""Systems by name: each kind enters its own when it is loaded, so a new kind is one new file."""

from __future__ import annotations

import sys

from slipctl import registry
from slipctl.certify.promise import System

SYSTEMS: dict[str, System] = {}
"""Every system that was entered, by name."""

OF_LOOPS: dict[str, System] = {}
"""Systems that are made of a loop; a certificate of one holds the tick of that loop."""

PROVED_LAST: list[str] = []
"""Those whose proof takes longer than many runs of a loop; a search asks it of the best alone."""

_OF_THE_HOUSE: list[System] = []


def register(system: System) -> System:
    """Enter a system; gives it back.

    Raises:
        ValueError: another one has its name.
    """
    if SYSTEMS.setdefault(system.name, system) is not system:
        raise ValueError(f"two systems are called {system.name}")
    homes = ("slipctl.certify", *(e.value for e in registry.entries(registry.PACKAGES).values()))
    if sys._getframe(1).f_globals["__name__"].startswith(tuple(f"{h}." for h in homes)):
        _OF_THE_HOUSE.append(system)
    return system


def register_of_loop(system: System, proved_last: bool = False) -> None:
    """Enter a system that is made of a loop, as one that only checks a file.

    Args:
        system: the system, without a loop. proved_last: whether its proof takes long.
    """
    OF_LOOPS[system.name] = system
    if proved_last and system.name not in PROVED_LAST:
        PROVED_LAST.append(system.name)


def of_the_house(system: System) -> bool:
    """Whether what its criteria prove is proved here or beside a model, with an adversary.

    Of any other system the words of its declaration count for nothing; see ``tick_sets``.
    """
    return any(system is own for own in _OF_THE_HOUSE)
