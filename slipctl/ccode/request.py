"""What is asked of a module in C: what its folder holds, and what is checked of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from slipctl.ccode.check import analysis, fuzz
from slipctl.ccode.check.proof import module_proof
from slipctl.ccode.compile import targets
from slipctl.ccode.compile.module import CModule
from slipctl.errors import BadInput


@dataclass(frozen=True)
class Content:
    """What the folder of a module holds.

    Attributes:
        real: type of every number in C, ``"double"`` or ``"float"``.
        rates: a step function for each rate of its parts, beside the one step.
        counter: a step that is told the number of its tick too, and sees calls that come twice or
            late.
        scaled: inputs and outputs that a bus has as integers, ``"v=uint16:0.01m/s"``: type,
            resolution and, if it is not 0, offset. Two files more translate them.
        const_section: section for the linker that the tables of the module lie in.
        calibration_section: section for an instance of the parameters, in two files more.
        with_xcp: an XCP slave, and a program for the emulated board that has it.
        with_autosar: a software component of AUTOSAR Classic around the module.
        fmus: FMUs for Co-Simulation by FMI 2.0 and 3.0, see docs/fmu.md.
        byte_order: of the processor, ``"little"`` or ``"big"``, for the description in A2L.
        asked: give those outputs alone that a wire leads out of the block; what its parts give
            each other is measured.
        platforms: what the FMUs hold binaries for, ``["linux64", "win64"]``; by default each that a
            compiler is installed for.
    """

    real: str = "double"
    rates: bool = False
    counter: bool = False
    scaled: Sequence[str] = ()
    const_section: str | None = None
    calibration_section: str | None = None
    with_xcp: bool = False
    with_autosar: bool = False
    fmus: bool = False
    platforms: Sequence[str] | None = None
    byte_order: str = "little"
    asked: bool = False

    def __post_init__(self) -> None:
        if self.platforms is not None and not self.fmus:
            raise BadInput("platforms are those of FMUs; ask for these too (--fmu)")


@dataclass(frozen=True)
class Checks:
    """What is checked of a module.

    Attributes:
        check: compile, replay, compare with the block.
        target: also compile it for this processor, ``"cortex-m4"`` or ``"cortex-m7"``, or for
            several, ``"cortex-m4,cortex-m7"``: bytes, stack, what of double is linked. With
            ``check`` the same replay on a board of QEMU, with the instructions of a step counted.
        misra: count the findings of cppcheck and of its MISRA C:2012 addon.
        fuzz_seconds: feed libFuzzer's bytes to it for so long, with sanitizers.
        clock: frequency of the processor in Hz, by which ``load`` is told of each target; a step
            that takes longer than a tick fails. Without it no load is told.
        prove: let Frama-C's Eva prove that nothing goes wrong at run time, and that every state
            and output stays in its range, for any inputs and any number of ticks.
        search_seconds: look so long for inputs that reach what the test does not, and go on with
            them behind the run (:mod:`slipctl.ccode.check.vectors.search`).
        closed_loop: with ``check`` and ``real="float"``, what runs the module in the loop that its
            block is of (:func:`slipctl.study.processor.closed_loop`).
    """

    check: bool = False
    target: str = "host"
    misra: bool = False
    fuzz_seconds: int = 0
    clock: float | None = None
    prove: bool = False
    search_seconds: int = 0
    closed_loop: Callable[[CModule, Mapping[str, Any]], dict[str, Any]] | None = None

    @property
    def boards(self) -> list[str]:
        """Processors beside the host."""
        return [t for t in dict.fromkeys(self.target.split(",")) if t != "host"]

    def need_tools(self) -> None:
        """Refuse at once what a tool is missing for.

        Raises:
            BadInput: no such target, or its tool, cppcheck, clang or Frama-C is not installed.
        """
        for t in self.boards:
            targets.tool(t)
            if self.check:
                targets.emulator(t)
        if self.misra:
            analysis.tool()
        if self.fuzz_seconds:
            fuzz.tool()
        if self.prove:
            module_proof.tool()
