"""What a run keeps in its folder, by the content of what it depends on, and what it finds there.

A run, ``scenario/loop`` or experiment, depends on the source of slipctl, of models and studies, and
on what was set and swapped. It depends on the versions of CasADi and numpy. Their hash is its key.
What has the key is what the run would give, and is taken; what has another key belongs to another
run, and is removed before anything new is written.
"""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import casadi
import numpy as np

from slipctl import __version__
from slipctl.block import portable
from slipctl.errors import BadInput
from slipctl.run import store
from slipctl.run.results import Table
from slipctl.study.files import equation_files

if TYPE_CHECKING:
    import xarray

ROOMS = ("analysis", "block", "certify", "estimate", "predict", "run", "seek", "models", "studies")
"""Folders of slipctl on whose source numbers depend; ``study`` and above only tell them."""

PARTS = "parts"
"""Folder of what is finished of experiments."""


@dataclass(frozen=True)
class Keep:
    """Folder of a run, and the key of what may stand in it.

    Args:
        out: folder of the results.
        key: from :func:`key_of`.
    """

    out: Path
    key: str

    def of(self, *names: str) -> str:
        """Key of a run or experiment."""
        return hashlib.sha256("\n".join((self.key, *names)).encode()).hexdigest()[:32]

    @property
    def parts(self) -> Path:
        """Folder of what is finished of experiments."""
        return self.out / PARTS

    def log(self, scenario: str, loop: str) -> xarray.Dataset | None:
        """Log of an earlier run of the same, or None."""
        import xarray

        path = self.out / "logs" / scenario / f"{loop}.nc"
        own = _attribute(path, "key") == self.of(scenario, loop)
        if not own or not path.with_suffix(".csv").exists():
            return None
        try:
            found = xarray.load_dataset(path, engine="netcdf4")
        except (OSError, ValueError, KeyError, RuntimeError):
            return None  # damaged: it runs again
        changes = np.atleast_1d(found.attrs.get("rail_changes_s", []))
        return found.assign_attrs(rail_changes_s=[float(t) for t in changes])

    def logs(self) -> dict[str, list[str]]:
        """Loops by scenario whose logs stand in the folder under this key."""
        found: dict[str, list[str]] = {}
        for path in sorted((self.out / "logs").glob("*/*.nc")):
            if _attribute(path, "key") == self.of(path.parent.name, path.stem):
                found.setdefault(path.parent.name, []).append(path.stem)
        return found

    def tables(self, experiment: str) -> dict[str, Table] | None:
        """Tables of an experiment that an earlier run finished, or None."""
        try:
            payload = store.read_json(self._table_file(experiment))
            return {
                n: Table(t["title"], {c: (u, v) for c, (u, v) in t["columns"].items()}, t["doc"])
                for n, t in payload["tables"].items()
            }
        except (BadInput, KeyError, TypeError, ValueError, AttributeError):
            return None

    def keep_tables(self, experiment: str, tables: Mapping[str, Table]) -> None:
        """Keep the tables of a finished experiment."""
        rows = {
            n: {"title": t.title, "doc": t.doc,
                "columns": {c: [u, list(v)] for c, (u, v) in t.columns.items()}}
            for n, t in tables.items()
        }  # fmt: skip
        store.write_json(self._table_file(experiment), {"experiment": experiment, "tables": rows})

    def _table_file(self, experiment: str) -> Path:
        return self.parts / f"{experiment}.{self.of(experiment)}.json"

    def clear(self, wanted: Mapping[str, Iterable[str]]) -> None:
        """Remove what belongs to another run, and what a killed one left half written.

        Only a folder that holds a run of ours is touched, and there only what a run writes.

        Args:
            wanted: loops by scenario whose logs may stay.
        """
        self.clear_parts()
        try:
            if "study" not in store.read_json(self.out / "metrics.json"):
                return
        except BadInput:
            return
        stay = self.logs()
        for path in (self.out / "logs").glob("*/*"):
            kept, asked = (names.get(path.parent.name, ()) for names in (stay, wanted))
            if path.suffix in (".nc", ".csv") and not (path.stem in kept and path.stem in asked):
                path.unlink(missing_ok=True)
        for folder in (self.out / "logs").glob("*/"):
            if not any(folder.iterdir()):
                folder.rmdir()
        pages = [self.out / n for n in ("report.html", "claims.json", "tables.json")]
        figures = (p for p in (self.out / "figures").glob("*") if p.suffix in (".svg", ".png"))
        for path in (*pages, *figures):
            path.unlink(missing_ok=True)

    def clear_parts(self) -> None:
        """Remove files that a killed process has left half written."""
        for path in self.out.rglob(f"{store.PART}*"):
            if path.is_file():
                path.unlink(missing_ok=True)


def _attribute(path: Path, name: str) -> Any:
    """Attribute of a log, without reading the log."""
    import netCDF4

    try:
        with netCDF4.Dataset(str(path)) as data:
            return getattr(data, name, None)
    except (OSError, RuntimeError):
        return None


def key_of(study: Any, *, quick: bool, settings: Sequence[str], swaps: Sequence[str]) -> str:
    """Hash of everything that the results of a study depend on, but their own names."""
    what = {
        "study": study.name, "quick": quick, "settings": list(settings), "swaps": list(swaps),
        "slipctl": __version__, "casadi": casadi.CasadiMeta.version(), "numpy": np.__version__,
        "machine": platform.machine(), "source": _source(), "own": _own_files(),
    }  # fmt: skip
    return hashlib.sha256(json.dumps(what, sort_keys=True).encode()).hexdigest()


def _digest(files: Iterable[Path]) -> str:
    digest = hashlib.sha256()
    for file in files:
        content = file.read_bytes()
        digest.update(f"{file.name} {len(content)}\n".encode() + content)
    return digest.hexdigest()


@lru_cache(maxsize=1)
def _source() -> str:
    """Hash of the source of the engine, models and studies."""
    folders = []
    for room in ROOMS:
        spec = find_spec(f"slipctl.{room}")
        folders += [Path(p) for p in (spec.submodule_search_locations or [])] if spec else []
    kinds = (".py", ".csv", ".toml", ".json")
    return _digest(p for f in folders for p in sorted(f.rglob("*")) if p.suffix in kinds)


def _own_files() -> str:
    """Hash of a person's files that were loaded, and of modules beside them that they import."""
    own = {Path(m.__file__ or "").resolve() for m in portable.own_modules()}
    own = {p for p in own if p.exists()}
    return _digest(sorted(own | {p for p in equation_files.READ if p.exists()}))
