"""The files beside header and source: example, Makefile, CMakeLists.txt, toolchain, LICENSE."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from slipctl.ccode.compile.board import BOARDS, COUNT, EMULATOR, LINK, RUN, TARGETS, TOOLS, machine
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
    n = plan.name
    lines = []
    for m in plan.layout.inputs:
        values = enumerate(start_elements(m))
        lines += [f"    {m.at('in.', k)} = {c_number(v, plan)};" for k, v in values]
    shown = [
        f'        (void)printf(" {ascii_text(m.name)}{"" if m.scalar else "[0]"} %g",'
        f" (double){m.at('out.', 0)});"
        for m in sorted(plan.layout.outputs, key=lambda m: "." in m.name)[:6]
    ]
    body = "\n".join(lines or ["    in.unused = 0;"])
    return f"""{head(plan, "example.c")}

#include "{n}.h"

#include <stdio.h>

int main(void)
{{
    {n}_in in;
    {n}_param param;
    {n}_state state;
    {n}_out out;
    int tick;

    {n}_default(&param); /* then change what differs, for example from a calibration */
    if ({n}_init(&param, &state) != {plan.layout.big}_OK) {{
        return 1;
    }}
{body}
    for (tick = 0; tick < 10; ++tick) {{
        const int status = {n}_step(&in, &param, &state, &out);
        (void)printf("%d: status %d", tick, status);
{chr(10).join(shown)}
        (void)printf("\\n");
    }}
    return 0;
}}
"""


def start_elements(m: Member) -> list[float]:
    """Elements of an input before it is set: its value, or the number in its range next to 0."""
    value = m.signal.value
    if value is None:
        value = min(max(0.0, m.signal.lo), m.signal.hi)
    return [float(v) for v in constant(m.signal, value).ravel(order="F")]


def makefile(plan: Plan, more: Sequence[str] = ()) -> str:
    """Text of the Makefile; ``more`` are the names of other sources of the module."""
    n, own = plan.name, " ".join((plan.files[-1], *plan.files[:-1]))
    rules = "".join(
        f"{s}.o: {s}.c {s}.h {n}.h built_with\n\t$(CC) $(CFLAGS) -c {s}.c -o $@\n\n" for s in more
    )
    others = "".join(f" {s}.o" for s in more)
    left = [f"{n}.o{others}", "example", f"test_{n}", "built_with", "vectors.bin"]
    left += [f"{p}_{t}.elf" for p in ("test", *["xcp"] * ("xcp" in more)) for t in TARGETS]
    return f"""# Written by slipctl, content {CONTENT}. make test: build, compare with the vectors.
CFLAGS ?= {WARNINGS} {OPTIMISE}

all: {n}.o{others} example test_{n}

# what was built by another compiler, or with other flags, is built again
built_with: FORCE
\t@echo '$(CC) $(CFLAGS)' | cmp -s - $@ || echo '$(CC) $(CFLAGS)' > $@

{n}.o: {own} built_with
\t$(CC) $(CFLAGS) -c {n}.c -o $@

{rules}example: example.c {n}.o built_with
\t$(CC) $(CFLAGS) example.c {n}.o -o $@ -lm

test_{n}: test_{n}.c {n}.o built_with
\t$(CC) $(CFLAGS) test_{n}.c {n}.o -o $@ -lm

test: test_{n}
\t./test_{n} vectors.txt

vectors.bin: test_{n} vectors.txt
\t./test_{n} vectors.txt vectors.bin

{_boards(plan, "xcp" in more)}
size: {n}.o
\tsize {n}.o
\tnm -g {n}.o

clean:
\trm -f {" ".join(left)}

.PHONY: FORCE all test size clean {" ".join(TARGETS)}
"""


def _boards(plan: Plan, xcp: bool) -> str:
    """Rules that build the test for each processor and run it on a board of QEMU."""
    n, real, headers = plan.name, plan.real, " ".join(plan.files[:-1])
    sources, rules = f"{n}.c test_{n}.c cortex_m.c", [f"CROSS ?= {TOOLS}\nQEMU ?= {EMULATOR}\n"]
    for t in TARGETS:
        rules.append(f"""test_{t}.elf: {sources} {headers} cortex_m.h cortex_m.ld built_with
\t$(CROSS)gcc $(CFLAGS) -DON_BOARD {" ".join(machine(t, real))} \\
\t  {sources} -o $@ \\
\t  {" ".join(LINK)} -lm

{t}: test_{t}.elf vectors.bin
\t$(QEMU) -M {BOARDS[t]} {" ".join([*RUN, "-serial", "none", *COUNT])} -kernel $<
""")
        if xcp:
            program = f"{n}.c xcp.c xcp_board.c cortex_m.c"
            needs = f"{program} {headers} xcp.h cortex_m.h cortex_m.ld"
            rules.append(f"""xcp_{t}.elf: {needs} built_with
\t$(CROSS)gcc $(CFLAGS) {" ".join(machine(t, real))} {program} -o $@ \\
\t  {" ".join(LINK)} -lm

xcp_{t}: xcp_{t}.elf # its serial line is a terminal of this machine, which QEMU names
\t$(QEMU) -M {BOARDS[t]} {" ".join(RUN)} -serial pty -kernel $<
""")
    return "\n".join(rules)


def c_number(value: float, plan: Plan) -> str:
    """A number in C of the module's precision."""
    return literal(float(value), plan.real, plan.block.name)


def cmake(plan: Plan, more: Sequence[str] = ()) -> str:
    """Text of CMakeLists.txt: a static library that others can link, the example, the test."""
    others = "".join(f" {s}.c" for s in more)
    n = plan.name
    flags = OPTIMISE.replace("-O2 ", "")
    return f"""# Written by slipctl, content {CONTENT}. A static library {n}, its example, its test.
cmake_minimum_required(VERSION 3.10)
project({n} C)

set(CMAKE_C_STANDARD 99)
set(CMAKE_C_STANDARD_REQUIRED ON)
set(CMAKE_C_EXTENSIONS OFF)
if(NOT CMAKE_BUILD_TYPE AND NOT CMAKE_CONFIGURATION_TYPES)
  set(CMAKE_BUILD_TYPE Release)
endif()

add_library({n} STATIC {n}.c{others})
target_include_directories({n} PUBLIC ${{CMAKE_CURRENT_SOURCE_DIR}})
if(CMAKE_C_COMPILER_ID MATCHES "GNU|Clang")
  target_compile_options({n} PRIVATE {flags} {WARNINGS.replace("-std=c99 ", "")})
endif()
if(NOT MSVC)
  target_link_libraries({n} PUBLIC m)
endif()

if(CMAKE_SOURCE_DIR STREQUAL CMAKE_CURRENT_SOURCE_DIR)
  enable_testing()
  if(CMAKE_SYSTEM_NAME STREQUAL "Generic") # {TOOLCHAIN}: the test runs on a board of QEMU
    add_executable(test_{n} test_{n}.c cortex_m.c)
    target_compile_definitions(test_{n} PRIVATE ON_BOARD)
    set_target_properties(test_{n} PROPERTIES SUFFIX .elf LINK_DEPENDS
      ${{CMAKE_CURRENT_SOURCE_DIR}}/cortex_m.ld)
    target_link_libraries(test_{n} {n} {_linked()})
    find_program(HOST_CC NAMES cc gcc clang)
    if(CMAKE_CROSSCOMPILING_EMULATOR AND HOST_CC) # the board reads binary: the host writes it
      add_custom_command(
        OUTPUT vectors.bin
        COMMAND ${{HOST_CC}} -std=c99 -O1 {n}.c test_{n}.c -lm -o
          ${{CMAKE_CURRENT_BINARY_DIR}}/test_{n}_host
        COMMAND ${{CMAKE_CURRENT_BINARY_DIR}}/test_{n}_host vectors.txt
          ${{CMAKE_CURRENT_BINARY_DIR}}/vectors.bin
        DEPENDS {" ".join(plan.files)} test_{n}.c vectors.txt
        WORKING_DIRECTORY ${{CMAKE_CURRENT_SOURCE_DIR}} VERBATIM)
      add_custom_target({n}_vectors ALL DEPENDS vectors.bin)
      add_test(NAME {n} COMMAND test_{n} WORKING_DIRECTORY ${{CMAKE_CURRENT_BINARY_DIR}})
    else()
      message(STATUS "no test on the board: it needs {EMULATOR} and a compiler for this machine")
    endif()
  else()
    add_executable({n}_example example.c)
    target_link_libraries({n}_example {n})
    add_executable(test_{n} test_{n}.c)
    target_link_libraries(test_{n} {n})
    add_test(NAME {n} COMMAND test_{n} ${{CMAKE_CURRENT_SOURCE_DIR}}/vectors.txt)
  endif()
endif()
"""


def _linked() -> str:
    """How CMake links a program for the board."""
    return " ".join(LINK).replace("-T cortex_m.ld", "-T${CMAKE_CURRENT_SOURCE_DIR}/cortex_m.ld")


def toolchain() -> str:
    """Text of the CMake toolchain file for the processors; the same for every module."""
    first, *_ = TARGETS
    chosen = "".join(
        f'''{"else" * bool(k)}if("${{TARGET}}" STREQUAL "{t}")
  set(CMAKE_C_FLAGS_INIT "{" ".join(flags)}")
  set(BOARD {BOARDS[t]})
''' for k, (t, flags) in enumerate(TARGETS.items())
    )  # fmt: skip
    return f"""# Written by slipctl. Compiles for a Cortex-M; the test runs on a board of QEMU:
#   cmake -B build -DCMAKE_TOOLCHAIN_FILE={TOOLCHAIN} -DTARGET={first}
#   cmake --build build
#   ctest --test-dir build
set(CMAKE_SYSTEM_NAME Generic)
set(CMAKE_SYSTEM_PROCESSOR arm)
set(TARGET "{first}" CACHE STRING "{" or ".join(TARGETS)}")
list(APPEND CMAKE_TRY_COMPILE_PLATFORM_VARIABLES TARGET)
set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY) # a program needs the linker script

set(CMAKE_C_COMPILER {TOOLS}gcc)
{chosen}else()
  message(FATAL_ERROR "TARGET ${{TARGET}} is not known; give {" or ".join(TARGETS)}")
endif()

find_program(QEMU {EMULATOR})
if(QEMU)
  set(CMAKE_CROSSCOMPILING_EMULATOR
    ${{QEMU}} -M ${{BOARD}} {" ".join([*RUN, "-serial", "none", *COUNT])} -kernel)
endif()
"""


def licence(plan: Plan) -> str:
    """Text of the licence note."""
    copied = (
        f"\nThe functions casadi_... in {plan.name}.c are template code copied from the source of"
        f" CasADi\n{ca.CasadiMeta.version()}, which states it to be under MIT-0.\n"
        if plan.equations.copied
        else ""
    )
    return f"""The text that slipctl adds to these files (structs, guards, tests, README) is
licensed under the Apache License, Version 2.0; you may obtain a copy at
https://www.apache.org/licenses/LICENSE-2.0. Without warranties or conditions of any kind.

The equations belong to whoever wrote the model that they were made from; content generated from
them by CasADi is not copyrighted by CasADi.
{copied}"""
