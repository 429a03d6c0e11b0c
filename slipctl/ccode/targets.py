"""A module compiled for a processor: how big it is, and what of double would be linked."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from slipctl.ccode import compilers as cc
from slipctl.ccode.plan import Plan
from slipctl.errors import BadInput, nearest

TARGETS: Mapping[str, tuple[str, ...]] = {
    "cortex-m4": ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"),
    "cortex-m7": ("-mcpu=cortex-m7", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv5-d16"),
}
"""Processors and the flags that choose them; the first has no double in hardware."""

TOOLS = "arm-none-eabi-"
COMPILER = f"{TOOLS}gcc"

_MAIN = """#include "{n}.h"

static {n}_in in;
static {n}_param param;
static {n}_state state;
static {n}_out out;

int main(void);

int main(void)
{{
    {n}_default(&param);
    return {n}_init(&param, &state) | {n}_tune(&param, &state)
           | {n}_step(&in, &param, &state, &out);
}}
"""


def tool(target: str) -> str:
    """Compiler for a target.

    Raises:
        BadInput: no such target, or its compiler is not installed.
    """
    if target not in TARGETS:
        raise BadInput(f"target {target!r} is not known{nearest(target, ('host', *TARGETS))}")
    found = shutil.which(COMPILER)
    if found is None or not _has_library(found):
        raise BadInput(
            f"--target {target} needs {COMPILER} with newlib; install it (Debian, Ubuntu: apt"
            " install gcc-arm-none-eabi libnewlib-arm-none-eabi)"
        )
    return found


def compiled_for(target: str, plan: Plan, made: Mapping[str, str]) -> dict[str, Any]:
    """Compile a module for a target and link it with a program that only calls it.

    Returns:
        ``bytes`` of the object file, ``linked_bytes`` with what it needs of the libraries,
        ``stack`` per function, ``double_helpers``: functions of double that are linked, of the
        compiler (``__aeabi_dmul``) or of the mathematics library. ``passed`` is false where a
        float module has any.

    Raises:
        BadInput: as :func:`tool`.
        RunFailed: the compiler or linker refuses.
    """
    compiler, flags, n = tool(target), TARGETS[target], plan.name
    with tempfile.TemporaryDirectory(prefix="slipctl_") as scratch:
        folder = Path(scratch)
        for name in (f"{n}.h", f"{n}.c"):
            (folder / name).write_text(made[name], encoding="utf-8")
        (folder / "calls.c").write_text(_MAIN.format(n=n), encoding="utf-8")
        objects = [folder / f"{n}.o", folder / "calls.o"]
        for o in objects:
            cc.compile_object(compiler, o.with_suffix(".c"), o, *flags)
        program = folder / "calls.elf"
        # the C library's start code is left out: it is no part of the module
        cc.link(
            compiler, objects, program, *flags, "--specs=nosys.specs", "-nostartfiles",
            "-Wl,-e,main", "-Wl,--gc-sections",
        )  # fmt: skip
        linked = cc.symbols(program, TOOLS)
        helpers = [] if linked is None else cc.in_double(sorted({*linked["defined"]}))

        return {
            "target": target,
            "compiler": cc.version(compiler),
            "flags": " ".join([*cc.FLAGS, *flags]),
            "bytes": cc.sizes(objects[0], TOOLS),
            "linked_bytes": cc.sizes(program, TOOLS),
            "stack": cc.stack(compiler, folder / f"{n}.c", *flags),
            "needed": (cc.symbols(objects[0], TOOLS) or {}).get("needed"),
            "double_helpers": helpers,
            "passed": plan.real == "double" or not helpers,
        }


def _has_library(compiler: str) -> bool:
    said = subprocess.run(
        [compiler, "-print-file-name=libm.a"], capture_output=True, text=True, check=False
    )
    return re.search(r"[/\\]", said.stdout) is not None
