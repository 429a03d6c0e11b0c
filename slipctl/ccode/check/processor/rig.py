"""A controller on a processor that QEMU emulates, its inputs and outputs on its serial line.

One frame goes to the board in each tick, and one comes back:

    to      0xA5, number of the tick, number of the tick now, inputs, checksum
    back    0x5A, number of the tick, status, instructions of the step, outputs, checksum

Numbers of ticks are bytes, modulo 256; inputs and outputs are the bytes of the structs. The status
and the checksum (Fletcher's) have two bytes, the instructions four, the low one first.
"""

from __future__ import annotations

import os
import select
import subprocess
import tempfile
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from slipctl.ccode.compile import targets
from slipctl.ccode.compile.template import fill_template
from slipctl.ccode.module.layout import c_elements
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.passes.precision import size
from slipctl.errors import RunFailed

LOST, LATE, BROKEN = 0x100, 0x200, 0x400
"""Bits of the status beside those of the step: ticks before this one never came; this one came
after its time; the frame was damaged and no step was done."""

WAIT = 20.0
"""Longest time in s to wait for an answer."""


def fletcher(data: bytes) -> bytes:
    """Fletcher's checksum of two bytes."""
    low = high = 0
    for byte in data:
        low = (low + byte) % 255
        high = (high + low) % 255
    return bytes((low, high))


class Rig:
    """The module of a block on a board, one call per tick; use it as a context.

    Args:
        plan: the module.
        made: its texts.
        target: ``"cortex-m4"`` or ``"cortex-m7"``.
        params: parameters of the run, by name; the others have their defaults.

    Attributes:
        instructions: of each step so far, 0 where none was made.

    Raises:
        BadInput: a tool is not installed.
        RunFailed: it does not compile, or parameters are refused.
    """

    def __init__(
        self, plan: Plan, made: dict[str, str], target: str, params: dict[str, Any]
    ) -> None:
        self._scratch = tempfile.TemporaryDirectory(prefix="slipctl_")
        folder, n = Path(self._scratch.name), plan.name
        for name in (*plan.files, *targets.BOARD_FILES):
            (folder / name).write_text(made[name], encoding="utf-8")
        firmware = fill_template("rig.c", n=n, lost=LOST, late=LATE, broken=BROKEN)
        (folder / "rig.c").write_text(firmware, encoding="utf-8")
        targets.build(target, folder, [f"{n}.c", "rig.c"], "rig.elf", plan.real)
        self._plan, self._kind = plan, np.float32 if plan.real == "float" else np.float64
        self.instructions: list[int] = []
        self._answer = 9 + size(plan.real) * max(sum(m.size for m in plan.layout.outputs), 1)
        self._got = b""
        call = [*targets.command(target, "rig.elf"), "-serial", "stdio", *targets.COUNT]
        self._process = subprocess.Popen(
            call, cwd=folder, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL, bufsize=0,
        )  # fmt: skip
        values = plan.block.param_values(**params)
        flat = [v for m in plan.layout.params for v in c_elements(m, values[m.name])]
        self._send(b"\xa4", self._bytes(np.array(flat or [0.0])))
        _, status, _ = self._receive()
        self.instructions.clear()
        if status:
            raise RunFailed(f"{n} on {target} refuses its parameters: status {status}")

    def step(
        self, tick: int, row: np.ndarray, now: int | None = None, damage: bool = False
    ) -> tuple[int, np.ndarray]:
        """Run one tick.

        Args:
            tick: its number.
            row: input elements.
            now: number of the tick at which it is sent, if that is a later one.
            damage: change a byte on the way.

        Returns:
            Status and output elements.
        """
        number = bytes((tick % 256, (tick if now is None else now) % 256))
        self._send(b"\xa5", number + self._bytes(row if row.size else np.zeros(1)), damage)
        _, status, out = self._receive()
        return status, out

    def _bytes(self, values: np.ndarray) -> bytes:
        return values.astype(self._kind).tobytes()

    def _send(self, kind: bytes, content: bytes, damage: bool = False) -> None:
        frame = kind + content + fletcher(content)
        if damage:
            frame = frame[:3] + bytes((frame[3] ^ 0x10,)) + frame[4:]
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(frame)
        except BrokenPipeError:
            raise RunFailed(f"{self._plan.name}: the board stopped") from None

    def _receive(self) -> tuple[int, int, np.ndarray]:
        assert self._process.stdout is not None
        line = self._process.stdout.fileno()
        while True:
            start = self._got.find(b"\x5a")
            frame = self._got[start + 1 : start + 1 + self._answer] if start >= 0 else b""
            if len(frame) == self._answer:
                self._got = self._got[start + 1 + self._answer :]
                break
            ready, _, _ = select.select([line], [], [], WAIT)
            more = os.read(line, 65536) if ready else b""
            if not more:
                raise RunFailed(f"{self._plan.name}: the board does not answer")
            self._got += more
        if fletcher(frame[:-2]) != frame[-2:]:
            raise RunFailed(f"{self._plan.name}: an answer of the board is damaged")
        out = np.frombuffer(frame[7:-2], self._kind).astype(float)
        self.instructions.append(int.from_bytes(frame[3:7], "little"))
        return frame[0], frame[1] | frame[2] << 8, out

    def close(self) -> None:
        """Switch the board off."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()
        self._scratch.cleanup()

    def __enter__(self) -> Rig:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self.close()
