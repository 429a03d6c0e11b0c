"""README of a folder: how its module is built, tested and used, for who has nothing of slipctl."""

from __future__ import annotations

from slipctl.block.text.failures import FAILURE_HEAD, failures_of
from slipctl.ccode.compile.board import EMULATOR, TARGETS, TOOLS
from slipctl.ccode.compile.files import TOOLCHAIN
from slipctl.ccode.module.header import CONTENT, memory, statuses
from slipctl.ccode.module.layout import Member, c_elements
from slipctl.ccode.module.plan import Plan, first_sentence
from slipctl.ccode.module.rates import groups
from slipctl.ccode.ship.readable import table
from slipctl.ccode.tree.expressions import number


def _measured(plan: Plan) -> str:
    """What is said of measurements, where there are some."""
    if not plan.layout.measured:
        return ""
    return (
        " What the parts give each other\nis in the state, "
        f"`{plan.name}_state.measured`, of the last good step; `{plan.name}.a2l` has it for"
        "\ncalibration tools. It may be beyond its range, so take commands from `out` alone."
    )


def readme(plan: Plan) -> str:
    """Text of the README."""
    from slipctl import __version__

    n, lay, big = plan.name, plan.layout, plan.layout.big
    counts = ", ".join(
        f"{what} {sum(m.size for m in g)}"
        for g, what in (
            (lay.inputs, "inputs"), (lay.params, "parameters"), (lay.states, "states"),
            (lay.outputs, "outputs"),
        )
    )  # fmt: skip
    bits = "\n".join(f"| `{big}_{k}` | {v} | {what} |" for k, v, what in statuses(plan))
    tick = "once per tick"
    if plan.period:
        tick = (
            f"every {number(plan.period)} s: this tick is in the equations, so leave the\n  "
            " parameters that repeat it; for another tick change the model, write the module again"
        )
    return f"""# {n}

{first_sentence(plan.block.doc)}

{_parts(plan)}C99 in `{plan.real}`, written by slipctl {__version__}, content {CONTENT}. Numbers
carried: {counts}.

{_files_and_build(plan)}## Use

Call in this order:

1. `{n}_default`, then change the parameters that differ,
2. `{n}_init`; if it does not give 0, a parameter is out of range: do not run,
3. `{n}_step` {tick},{_pieces(plan)}
4. `{n}_tune` after changing parameters at run time: until then, and if it does not give 0, those
   before stay in force.

Units, ranges, signs and sources stand beside each member in `{n}.h`. Link with the C mathematics
library (`-lm`).{_measured(plan)}

| status | bit | meaning |
|---|---|---|
{bits}

Without `{big}_REFUSED` a step counts: state and outputs are new, made with the last good value of
an input that was bad, and an output that would have left its range stands at the end of it. With it
the state is untouched, but for what `{big}_RESET` tells, and the outputs are those of the last good
step{_safe(plan)}. Outputs are always finite and in their ranges.
No memory is allocated, nothing is global, and every instance has its own `{n}_state`.
{memory(plan)} Compile without `-ffast-math`.

{_parameters(plan)}{_failures(plan)}## Calibration

`{n}.a2l` (ASAP2 1.71) describes one instance, which the firmware owns and names
`{n}_param_instance`, `{n}_in_instance`,
`{n}_state_instance` and `{n}_out_instance`. A tool takes
their addresses from the firmware's ELF file. Call `{n}_tune` after it wrote a parameter.
"""


def _files_and_build(plan: Plan) -> str:
    """What each file is, and how they are built and tested."""
    n = plan.name
    return f"""| file | what it is |
|---|---|
| {_own(plan)} | the module; nothing else is needed in a firmware |
| `{n}_bus.h`, `{n}_bus.c` | if it was asked for: inputs and outputs as integers of a bus |
| `{n}_calibration.h`, `.c` | if it was asked for: an instance of the parameters in its section |
| `xcp.*`, `xcp_board.c` | if it was asked for: XCP slave, and a program for the board that has it |
| `{n}_swc.c`, `{n}.arxml` | if it was asked for: a software component of AUTOSAR Classic |
| `example.c` | smallest program that runs it |
| `test_{n}.c`, `vectors.txt` | back-to-back test against the recorded Python model |
| `Makefile` | builds and tests, see below |
| `CMakeLists.txt` | a static library `{n}`; built alone also example and test |
| `{TOOLCHAIN}` | CMake toolchain file for a Cortex-M4 or Cortex-M7 |
| `cortex_m.*` | start, timer and linker script for the test on an emulated board |
| `{n}_fmi*.fmu` | if it was asked for: the module for other simulation tools |
| `report.md`, `report.json` | sizes, stack, largest difference from Python per signal |
| `{n}.a2l` | parameters and measurements for a calibration tool |
| `LICENSE` | terms |

## Build and test

Nothing but these files, a C compiler and `make` (or CMake 3.20 or newer) is needed.

| command | what it does |
|---|---|
| `make test` | builds; replays the vectors; compares every output, state and status with Python |
| `make CC=clang test` | the same with another compiler |
| `make size` | bytes and symbols of the module |
| `make example && ./example` | runs ten ticks |
| `make cortex-m4` | runs the test on an emulated board and counts instructions; also `cortex-m7` |

The test prints the largest difference of each signal with its limit, tries NaN and numbers out of
range as inputs. It ends with exit code 0 if all is well. With CMake:

    cmake -B build
    cmake --build build
    ctest --test-dir build

and for a board, the test emulated again:

    cmake -B build-m4 -DCMAKE_TOOLCHAIN_FILE={TOOLCHAIN} -DTARGET={next(iter(TARGETS))}
    cmake --build build-m4
    ctest --test-dir build-m4

A board needs `{TOOLS}gcc` with newlib, its test `{EMULATOR}` too (Debian, Ubuntu:
`apt install gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm`).{_last_places(plan)}

In a CMake project of your own: `add_subdirectory(FOLDER)`, then
`target_link_libraries(PROGRAM {n})`.

"""


def _own(plan: Plan) -> str:
    """Files of the module."""
    return ", ".join(f"`{f}`" for f in plan.files)


def _parts(plan: Plan) -> str:
    """Table of the parts, with the equation that each is made from."""
    rows = [(f"`{path}`", _cell(first_sentence(leaf.doc))) for path, leaf in plan.part_docs()]
    return table(["part", "what it does"], rows) + "\n\n" if rows else ""


def _failures(plan: Plan) -> str:
    """What the module does when something around it fails, as its model declares it."""
    rows = failures_of(plan.block)
    if not rows:
        return ""
    return "\n\n".join([
        "## When something fails",
        "What the model declares of itself; the names are outputs. No standard is claimed.",
        table(FAILURE_HEAD, rows), "",
    ])  # fmt: skip


def _cell(text: str) -> str:
    """Text for a table, where a bar would end it."""
    return text.replace("|", r"\|")


def _parameters(plan: Plan) -> str:
    """What a caller has to know of the parameters: which go together, which do nothing."""
    said = []
    if shared := _shared(plan):
        said += [
            "Several parts have a parameter of one name, unit and default, most likely one"
            " quantity: change\nthem together.",
            table(["quantity", "default", "members of the struct"], map(_group, shared)),
        ]
    if idle := _idle(plan):
        said.append(f"Without effect in this form of the law: {', '.join(f'`{c}`' for c in idle)}.")
    return "\n\n".join(["## Parameters", *said, ""]) if said else ""


def _group(members: list[Member]) -> tuple[str, str, str]:
    """Row of parameters that go together: what they are, default and members."""
    first = members[0]
    s = first.signal
    unit = "" if s.unit == "1" else f", in {s.unit}"
    value = number(float(s.value)) if first.scalar else "an array"
    return _cell(f"{s.doc or s.name}{unit}"), value, ", ".join(f"`{m.c}`" for m in members)


def _shared(plan: Plan) -> list[list[Member]]:
    """Parameters of different parts with one name, unit and default, other than the tick."""
    groups: dict[object, list[Member]] = {}
    for m in plan.layout.params:
        s, values = m.signal, c_elements(m, m.signal.value).tolist()
        if s.unit == "s" and values == [plan.period]:
            continue
        groups.setdefault((m.name.rpartition(".")[2], s.unit, s.shape, *values), []).append(m)
    return [g for g in groups.values() if len(g) > 1]


def _idle(plan: Plan) -> list[str]:
    """Parameters that no equation and no start value reads, as far as the equations are ours."""
    lay, made = plan.layout, plan.equations
    if made.entry:
        return []
    nodes = [*made.lines, *made.results.values(), *made.functions.values()]
    nodes += plan.start_lines(lay.derived, 0, "now.")
    nodes += plan.start_lines(lay.states, len(lay.derived), "state->")
    members = (n for node in nodes for n in node.walk() if n.kind == "member")
    read = {n.head[2:] for n in members if n.parts[0].head == "param"}
    return [m.c for m in lay.params if m.c not in read]


def _last_places(plan: Plan) -> str:
    """Say when a test on the board may differ."""
    if plan.real == "float":
        return ""
    return (
        " If the module\ncalls `exp`, `log` or the like, last places differ there; the limits allow"
        " for that if the folder\nwas written with `--target`."
    )


def _pieces(plan: Plan) -> str:
    """What may be called in the place of the step, where there is a function for each rate."""
    if not plan.rates:
        return ""
    row = groups(plan)
    named = ", ".join(
        f"`{plan.name}_{g.name}`" + (f" (every {g.ticks}th tick)" if g.ticks > 1 else "")
        for g in row
    )
    return f"\n   or in its place, with the same arguments and in this order, {named},"


def _safe(plan: Plan) -> str:
    """Outputs that give something else while a step is refused, to go on a sentence."""
    units = {m.c: m.signal.unit for m in plan.layout.outputs}
    said = [f"`{c}` {number(v)} {units[c]}" for c, v in plan.safe.items()]
    return f", but {', '.join(said)}" if said else ""
