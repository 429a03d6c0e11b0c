"""The files beside header and source: example, Makefile, CMakeLists.txt, toolchain, LICENSE."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from slipctl.ccode.compile.board import BOARDS, COUNT, EMULATOR, LINK, RUN, TARGETS, TOOLS, machine
from slipctl.ccode.compile.template import fill_template
from slipctl.ccode.module.comments import ascii_text
from slipctl.ccode.module.header import CONTENT, head
from slipctl.ccode.module.layout import Member, constant
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.passes.precision import literal

WARNINGS = (
    "-std=c99 -pedantic -Wall -Wextra -Wconversion -Wdouble-promotion -Wfloat-conversion -Wshadow"
)
OPTIMISE = "-O2 -ffp-contract=off"
TOOLCHAIN = "arm-none-eabi.cmake"


def example(plan: Plan) -> str:
    """Text of a main program that runs a few ticks."""
    shown = "\n".join(
        f'        (void)printf(" {ascii_text(m.name)}{"" if m.scalar else "[0]"} %g",'
        f" (double){m.at('out.', 0)});"
        for m in sorted(plan.layout.outputs, key=lambda m: "." in m.name)[:6]
    )
    given = input_values(plan, "in.") or "    in.unused = 0;"
    return fill_template(
        "example.c", n=plan.name, big=plan.layout.big, head=head(plan, "example.c"), body=given,
        shown=shown,
    )  # fmt: skip


def input_values(plan: Plan, pointer: str) -> str:
    """Statements that give each input its value before it is set."""
    return "\n".join(
        f"    {m.at(pointer, k)} = {c_number(v, plan)};"
        for m in plan.layout.inputs for k, v in enumerate(start_elements(m))
    )  # fmt: skip


def start_elements(m: Member) -> list[float]:
    """Elements of an input before it is set: its value, or the number in its range next to 0."""
    value = m.signal.value
    if value is None:
        value = min(max(0.0, m.signal.lo), m.signal.hi)
    return [float(v) for v in constant(m.signal, value).ravel(order="F")]


def makefile(plan: Plan, more: Sequence[str] = ()) -> str:
    """Text of the Makefile; ``more`` are the names of other sources of the module."""
    n, own, xcp = plan.name, " ".join((plan.files[-1], *plan.files[:-1])), "xcp" in more
    rules = "".join(
        f"{s}.o: {s}.c {s}.h {n}.h built_with\n\t$(CC) $(CFLAGS) -c {s}.c -o $@\n\n" for s in more
    )
    others = "".join(f" {s}.o" for s in more)
    left = [f"{n}.o{others}", "example", f"test_{n}", "built_with", "vectors.bin"]
    left += [f"{p}_{t}.elf" for p in ("test", *["xcp"] * xcp) for t in TARGETS]
    boards = [
        fill_template(
            "board.mk", n=n, t=t, xcp=xcp, headers=" ".join(plan.files[:-1]), board=BOARDS[t],
            machine=" ".join(machine(t, plan.real)), link=" ".join(LINK), run=" ".join(RUN),
            count=" ".join(COUNT),
        ) for t in TARGETS
    ]  # fmt: skip
    return fill_template(
        "Makefile", n=n, content=CONTENT, flags=f"{WARNINGS} {OPTIMISE}", own=own, others=others,
        rules=rules, cross=TOOLS, emulator=EMULATOR, boards="\n".join(boards), left=" ".join(left),
        targets=" ".join(TARGETS),
    )  # fmt: skip


def c_number(value: float, plan: Plan) -> str:
    """A number in C of the module's precision."""
    return literal(float(value), plan.real, plan.block.name)


def cmake(plan: Plan, more: Sequence[str] = ()) -> str:
    """Text of CMakeLists.txt: a static library that others can link, the example, the test."""
    linked = " ".join(LINK).replace("-T cortex_m.ld", "-T${CMAKE_CURRENT_SOURCE_DIR}/cortex_m.ld")
    return fill_template(
        "CMakeLists.txt", n=plan.name, content=CONTENT, others="".join(f" {s}.c" for s in more),
        flags=OPTIMISE.replace("-O2 ", ""), warnings=WARNINGS.replace("-std=c99 ", ""),
        toolchain=TOOLCHAIN, linked=linked, files=" ".join(plan.files), emulator=EMULATOR,
    )  # fmt: skip


def toolchain() -> str:
    """Text of the CMake toolchain file for the processors; the same for every module."""
    chosen = "".join(
        f'''{"else" * bool(k)}if("${{TARGET}}" STREQUAL "{t}")
  set(CMAKE_C_FLAGS_INIT "{" ".join(flags)}")
  set(BOARD {BOARDS[t]})
''' for k, (t, flags) in enumerate(TARGETS.items())
    )  # fmt: skip
    return fill_template(
        TOOLCHAIN, toolchain=TOOLCHAIN, first=next(iter(TARGETS)), targets=" or ".join(TARGETS),
        tools=TOOLS, chosen=chosen, emulator=EMULATOR,
        run=" ".join([*RUN, "-serial", "none", *COUNT]),
    )  # fmt: skip


def licence(plan: Plan) -> str:
    """Text of the licence note."""
    version = ca.CasadiMeta.version()
    return fill_template("LICENSE", n=plan.name, copied=plan.equations.copied, casadi=version)
