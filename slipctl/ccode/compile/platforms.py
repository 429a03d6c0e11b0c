"""Platforms that a library is built for: this one, and Windows by MinGW-w64."""

from __future__ import annotations

import platform
import shutil
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from slipctl.ccode.compile import compilers as cc
from slipctl.errors import BadInput, nearest

MINGW = "x86_64-w64-mingw32-gcc"


@dataclass(frozen=True)
class Platform:
    """Where a library runs, and what builds it.

    Attributes:
        name: as FMI 2.0 calls it, ``"linux64"``.
        compiler: path of a gcc or clang that builds for it.
        folders: folder of its binaries in an FMU, by version of FMI; one that has no name for the
            platform is left out.
        suffix: of a library.
        compile_flags, link_flags: beside the usual ones; the same source gives the same bytes.
    """

    name: str
    compiler: str
    folders: Mapping[int, str]
    suffix: str
    compile_flags: tuple[str, ...] = ()
    link_flags: tuple[str, ...] = ()


_ELF = ("-fPIC", "-fvisibility=hidden"), ("-Wl,--build-id=none", "-s")
_KNOWN = {
    "linux64": ({2: "linux64", 3: "x86_64-linux"}, ".so", *_ELF),
    "aarch64-linux": ({3: "aarch64-linux"}, ".so", *_ELF),
    "win64": ({2: "win64", 3: "x86_64-windows"}, ".dll", (),
              ("-static-libgcc", "-s", "-Wl,--no-insert-timestamp",
               "-Wl,--disable-auto-image-base")),
}  # fmt: skip


def this_platform() -> str | None:
    """Name of this machine's platform; None where no library is built for it."""
    machine = {"x86_64": "linux64", "amd64": "linux64", "aarch64": "aarch64-linux"}
    found = machine.get(platform.machine().lower())
    return found if sys.platform.startswith("linux") else None


def _compiler(name: str) -> str | None:
    """Path of a compiler that builds for a platform, or None."""
    if name == this_platform():
        return cc.first_compiler()
    return shutil.which(MINGW) if name == "win64" else None


def platforms(names: Sequence[str] | None = None) -> list[Platform]:
    """Platforms by name; by default each that a compiler is installed for.

    Raises:
        BadInput: an unknown platform, or one without a compiler.
    """
    wanted = [n for n in _KNOWN if _compiler(n)] if names is None else list(dict.fromkeys(names))
    found = []
    for name in wanted:
        if name not in _KNOWN:
            raise BadInput(f"there is no platform {name!r}{nearest(name, _KNOWN)}")
        compiler = _compiler(name)
        if compiler is None:
            how = (
                f"install MinGW-w64, whose gcc is {MINGW} (Debian: gcc-mingw-w64-x86-64)"
                if name == "win64"
                else "it is built on such a machine only, and this one is "
                f"{this_platform() or 'another'}"
            )
            raise BadInput(f"no compiler for {name}: {how}")
        found.append(Platform(name, compiler, *_KNOWN[name]))
    return found
