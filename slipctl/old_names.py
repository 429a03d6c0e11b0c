"""Modules under the names that users' files import them by: those of models, and some that moved.

``slipctl.models.NAME`` is a model whatever folder of ``models`` it is in, and
``slipctl.certify.NAME`` a module of proofs, whether it is general or stands beside the law of a
paper. Loaded by ``slipctl``.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec, spec_from_loader
from pathlib import Path
from types import ModuleType

MOVED = {
    "slipctl.analysis.bounding": "slipctl.analysis.bounds",
    "slipctl.certify.switched_loop": "slipctl.certify.ticks.tick_sets",
    "slipctl.models.rolling": "slipctl.models.wheel_rail.axles",
    "slipctl.models.shared": "slipctl.models.shared_names",
    "slipctl.study.doors": "slipctl.study.resolve",
    "slipctl.study.preparing": "slipctl.study.case_setup",
    "slipctl.study.running": "slipctl.study.execution",
}
"""What pages told users to import, and where it is now."""


class _Moved(MetaPathFinder, Loader):
    """Gives the module itself, so that there is one of it under both names."""

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        new = MOVED.get(name)
        parent, _, stem = name.rpartition(".")
        if parent == "slipctl.models":
            files = [f for p in path or () for f in Path(p).glob(f"*/{stem}.py")]
            homes = [f.parent.name for f in files if f.parent.name != "vehicle"]
            new = new or next((f"{parent}.{home}.{stem}" for home in homes), None)
        elif parent == "slipctl.certify":
            new = new or _proof(stem, path or ())
        return spec_from_loader(name, self, origin=new) if new else None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        module = import_module(str(spec.origin))
        spec.loader_state = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        if module.__spec__ is not None:
            module.__spec__ = module.__spec__.loader_state


def _proof(stem: str, path: Sequence[str]) -> str | None:
    """Module of proofs by its stem: in a folder of certify, or beside the law of a paper."""
    general = [f for p in path for f in Path(p).glob(f"*/{stem}.py")]
    if general:
        return f"slipctl.certify.{general[0].parent.name}.{stem}"
    models = find_spec("slipctl.models")
    places = models.submodule_search_locations if models else None
    papers = [f for p in places or () for f in Path(p).glob(f"*/certificate/{stem}.py")]
    homes = [f.parent.parent.name for f in papers if f.parent.parent.name != "vehicle"]
    return f"slipctl.models.{homes[0]}.certificate.{stem}" if homes else None


sys.meta_path.append(_Moved())
