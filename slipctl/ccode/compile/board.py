"""Processors that a module is compiled for, and the boards of QEMU that run it."""

from __future__ import annotations

import re
from collections.abc import Mapping

from slipctl.ccode.compile.template import fill_template

TARGETS: Mapping[str, tuple[str, ...]] = {
    "cortex-m4": ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"),
    "cortex-m7": ("-mcpu=cortex-m7", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv5-d16"),
}
"""Processors and the flags that choose them; the first has no double in hardware."""


def machine(target: str, real: str) -> tuple[str, ...]:
    """Flags that choose a processor; in float it has single precision alone.

    So nothing of double can be done unseen, in the C library neither: its ``sinf`` and ``expf`` for
    a unit of double precision work in double.
    """
    flags = TARGETS[target]
    return flags if real == "double" else tuple(re.sub("v5-d16", "v5-sp-d16", f) for f in flags)


BOARDS: Mapping[str, str] = {"cortex-m4": "mps2-an386", "cortex-m7": "mps2-an500"}
"""Boards that QEMU has with them."""

CLOCK = 25e6
"""Clock in Hz of the processor on both boards."""

TOOLS = "arm-none-eabi-"
EMULATOR = "qemu-system-arm"

LINK = ("--specs=nosys.specs", "-nostartfiles", "-T", "cortex_m.ld", "-Wl,--gc-sections")
"""How a program for the board is linked, in a folder with the files of the board."""

RUN = ("-nographic", "-monitor", "none", "-semihosting-config", "enable=on,target=native")
"""How a program runs: its files and what it prints are those of this machine."""

COUNT = ("-icount", "shift=7")
"""An instruction takes 128 ns, 3.2 ticks of the board's timer: counts are exact."""

BOARD_FILES = ("cortex_m.c", "cortex_m.h", "cortex_m.ld")
"""Start, timer, serial line and linker script of the boards."""


def board_files() -> dict[str, str]:
    """Texts of the files of the board by name."""
    return {name: fill_template(name) for name in BOARD_FILES}
