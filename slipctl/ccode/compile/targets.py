"""A module on a processor: how big it is, what of double is linked, and its test run by QEMU.

The test replays the vectors there, counts instructions and measures the stack.
"""

from __future__ import annotations

import re
import struct
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from slipctl.ccode.compile import compilers as cc
from slipctl.ccode.compile.board import (
    BOARD_FILES,
    BOARDS,
    COUNT,
    EMULATOR,
    LINK,
    RUN,
    TARGETS,
    TOOLS,
    machine,
)
from slipctl.ccode.compile.programs import (
    find_program,
    missing_program,
    run_program,
    scratch_folder,
)
from slipctl.ccode.compile.template import fill_template
from slipctl.ccode.module.plan import Plan
from slipctl.errors import BadInput, RunFailed, nearest

COMPILER = f"{TOOLS}gcc"
PACKAGES = "gcc-arm-none-eabi libnewlib-arm-none-eabi"

WAIT = 600.0
"""Longest time in s that a replay on the board may take."""


def tool(target: str) -> str:
    """Compiler for a target.

    Raises:
        BadInput: no such target, or its compiler is not installed.
    """
    if target not in TARGETS:
        known = TARGETS if target == "host" else ("host", *TARGETS)
        raise BadInput(f"target {target!r} is not known{nearest(target, known)}")
    option, what = f"--target {target}", f"{COMPILER} with newlib"
    found = find_program(COMPILER, option, PACKAGES, what)
    if not re.search(r"[/\\]", run_program([found, "-print-file-name=libm.a"]).stdout):
        raise missing_program(option, what, PACKAGES)
    return found


def emulator(target: str) -> str:
    """QEMU for a target.

    Raises:
        BadInput: it is not installed.
    """
    return find_program(EMULATOR, f"--target {target} with --check", EMULATOR)


def command(target: str, program: str) -> list[str]:
    """Command line that runs a program on the board; its files and output are this machine's."""
    return [emulator(target), "-M", BOARDS[target], *RUN, "-kernel", program]


def build(target: str, folder: Path, sources: list[str], program: str, real: str) -> None:
    """Compile and link sources of a folder that has the files of the board too.

    Args:
        target: the processor.
        folder: where the sources are.
        sources: their names.
        program: name of what is made.
        real: type of the numbers.

    Raises:
        BadInput: as :func:`tool`.
        RunFailed: the compiler or linker refuses.
    """
    compiler, flags = tool(target), machine(target, real)
    objects = []
    for name in (*sources, "cortex_m.c"):
        objects.append((folder / name).with_suffix(".m.o"))
        cc.compile_object(compiler, folder / name, objects[-1], *flags, "-DON_BOARD")
    cc.link(compiler, objects, folder / program, *flags, *LINK)


def in_binary(vectors: str) -> bytes:
    """Vectors as a board reads them: the first line, then numbers of eight bytes."""
    first, _, rest = vectors.partition("\n")
    words = rest.split()
    return first.replace(" text ", " binary ").encode() + b"\n" + struct.pack(
        f"<{len(words)}d", *map(float, words)
    )  # fmt: skip


_COUNTS = re.compile(
    r"instructions per step: mean ([\d.]+), most (\d+); bytes of stack: at most (\d+)$",
    re.MULTILINE,
)
_ROW = re.compile(r"^(\S+) +(\S+) +(\S+) +(\S+)(?: \(of least.*)?$", re.MULTILINE)


def replayed_on(target: str, plan: Plan, made: Mapping[str, str]) -> dict[str, Any]:
    """Run the module's own test on the board.

    Returns:
        Largest relative difference of each of ``signals``, ``own_test`` with the test's last line,
        ``ticks`` that were replayed, ``instructions`` per step (mean and most), ``stack_used`` in
        bytes by a step with all it calls, and whether the test ``passed``.

    Raises:
        BadInput: a tool is not installed.
        RunFailed: it does not compile, or comes to no end.
    """
    n = plan.name
    texts = {name: made[name] for name in (*plan.files, f"test_{n}.c", *BOARD_FILES)}
    with scratch_folder(texts) as folder:
        (folder / "vectors.bin").write_bytes(in_binary(made["vectors.txt"]))
        build(target, folder, [f"{n}.c", f"test_{n}.c"], "test.elf", plan.real)
        said = run([*command(target, "test.elf"), "-serial", "none", *COUNT], folder)
    counts = _COUNTS.search(said.stdout)
    if counts is None:
        last = (said.stdout.strip() or said.stderr.strip() or "nothing").splitlines()[-1]
        raise RunFailed(f"the test of {n} on {target} stopped: {last}")
    rows = _ROW.findall(said.stdout[: counts.start()])
    own_test = said.stdout[: counts.start()].strip().splitlines()[-1]
    return {
        "emulator": f"{EMULATOR} -M {BOARDS[target]} {' '.join(COUNT)}",
        "signals": {name: float(relative) for name, _, relative, _ in rows[1:]},
        "own_test": own_test,
        "ticks": int(own_test.partition(" ")[0]),
        "instructions": {"mean": float(counts[1]), "most": int(counts[2])},
        "stack_used": int(counts[3]),
        "passed": said.returncode == 0,
    }


def run(call: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a program on the board to its end."""
    try:
        return run_program(call, folder, timeout=WAIT, stdin=subprocess.DEVNULL)
    except subprocess.TimeoutExpired:
        raise RunFailed(f"{call[0]} came to no end within {WAIT:g} s") from None


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
    compiler, flags, n = tool(target), machine(target, plan.real), plan.name
    texts = {name: made[name] for name in plan.files} | {"calls.c": fill_template("calls.c", n=n)}
    with scratch_folder(texts) as folder:
        objects = [folder / f"{n}.o", folder / "calls.o"]
        for o in objects:
            cc.compile_object(compiler, o.with_suffix(".c"), o, cc.TOLD, *flags)
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
            "stack": cc.stack(objects[0]),
            "functions": cc.code(objects[0], TOOLS),
            "needed": (cc.symbols(objects[0], TOOLS) or {}).get("needed"),
            "double_helpers": helpers,
            "passed": plan.real == "double" or not helpers,
        }
