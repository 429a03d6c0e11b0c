"""Systems by name: each kind enters its own when it is loaded, so a new kind is one new file."""

from __future__ import annotations

from slipctl.certify.promise import System

SYSTEMS: dict[str, System] = {}
"""Every system that was entered, by name."""


def register(system: System) -> System:
    """Enter a system; gives it back.

    Raises:
        ValueError: another one has its name.
    """
    if SYSTEMS.setdefault(system.name, system) is not system:
        raise ValueError(f"two systems are called {system.name}")
    return system
