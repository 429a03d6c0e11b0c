"""Modules under the names that users' files import them by: those of models, and some that moved.

``slipctl.models.NAME`` is a model whatever folder of ``models`` it is in. Loaded by ``slipctl``.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import spec_from_loader
from pathlib import Path
from types import ModuleType

MOVED = {
    "slipctl.analysis.bounding": "slipctl.analysis.bounds",
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
        return spec_from_loader(name, self, origin=new) if new else None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        module = import_module(str(spec.origin))
        spec.loader_state = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        if module.__spec__ is not None:
            module.__spec__ = module.__spec__.loader_state


sys.meta_path.append(_Moved())
