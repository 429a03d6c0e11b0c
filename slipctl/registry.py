"""What the engine has to find, and does not know by name: models, studies, kinds of files, views.

Whoever has something to be found registers it as an entry point of slipctl in ``pyproject.toml``.
So no module of the engine names one of the floors above it:

``slipctl.packages``
    packages of models and of studies;
``slipctl.files``
    readings of a kind of file that describes a study;
``slipctl.views``
    what a notebook shows of a thing, by format.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, PackageNotFoundError, distribution
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

from slipctl.errors import BadInput

PACKAGES, FILES, VIEWS = "slipctl.packages", "slipctl.files", "slipctl.views"


@cache
def entries(group: str) -> dict[str, EntryPoint]:
    """Entry points of a group by name, as the installed slipctl has them.

    Raises:
        BadInput: slipctl is not installed, or its installation is older than its sources.
    """
    try:
        found = {e.name: e for e in distribution("slipctl").entry_points.select(group=group)}
    except PackageNotFoundError:
        found = {}
    if not found:
        raise BadInput(f"{group} are not registered; install slipctl again, pip install -e .")
    return found


def load(group: str, name: str) -> Any:
    """What is registered by this name."""
    return entries(group)[name].load()


def package_name(package: str) -> str:
    """Name by which the package of ``models`` or ``studies`` is imported."""
    return entries(PACKAGES)[package].value


def folder(package: str) -> Path:
    """Folder of the package of ``models`` or ``studies``, wherever it is installed.

    Raises:
        BadInput: it is not installed.
    """
    spec = find_spec(package_name(package))
    if spec is None or not spec.submodule_search_locations:
        raise BadInput(f"{package_name(package)} is not installed; install slipctl again")
    return Path(next(iter(spec.submodule_search_locations)))


def module(package: str, name: str) -> ModuleType:
    """Module of the package of ``models`` or ``studies``."""
    return import_module(f"{package_name(package)}.{name}")


def modules_ending(end: str, *more: tuple[Path, str]) -> list[str]:
    """Names of all modules with such an ending, in registered packages and in ``more``, by stem.

    Args:
        end: how their names end.
        more: folders, each with the name of its package.
    """
    homes = [(folder(package), package_name(package)) for package in entries(PACKAGES)]
    found = {}
    for home, name in (*more, *homes):
        for path in home.rglob(f"*{end}.py"):
            found[path.stem] = ".".join((name, *path.relative_to(home).with_suffix("").parts))
    return [found[stem] for stem in sorted(found)]


def view(thing: Any, format: str) -> str:
    """What a notebook shows of a thing: ``"html"`` or ``"latex"``."""
    return str(load(VIEWS, format)(thing))


def check_one_tree() -> None:
    """Refuse an engine and models of two clones: their numbers would be those of neither.

    Raises:
        BadInput: a package of models or studies is not from where slipctl is.
    """
    import slipctl

    # not of this file: one that a tree lacks comes from the other, installed one
    engine = Path(str(slipctl.__file__)).resolve().parent
    for package in entries(PACKAGES):
        there = folder(package).resolve()
        if there not in (engine / package, engine.parent / package):
            raise BadInput(
                f"slipctl is that of {engine.parent} and {package_name(package)} that of"
                f" {there.parent}; install one tree: pip install -e {engine.parent}"
            )
