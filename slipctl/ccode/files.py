"""The files beside header and source: example, test program, vectors, Makefile, README, LICENSE."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from slipctl.ccode.comments import spelled
from slipctl.ccode.expressions import number
from slipctl.ccode.header import CONTENT, STATUS, head, memory
from slipctl.ccode.layout import Member
from slipctl.ccode.plan import Plan, constant, first_sentence

WARNINGS = "-std=c99 -pedantic -Wall -Wextra -Wconversion -Wdouble-promotion -Wshadow"
OPTIMISE = "-O2 -ffp-contract=off"

LIMIT = 1e-12
"""Largest allowed difference from Python, relative to the largest value of the signal."""


def example(plan: Plan) -> str:
    """Text of a main program that runs a few ticks."""
    n = plan.name
    lines = []
    for m in plan.layout.inputs:
        value = m.signal.value
        if value is None:
            value = min(max(0.0, m.signal.lo), m.signal.hi)
        flat = constant(m.signal, value).ravel(order="F")
        lines += [f"    {m.at('in.', k)} = {number(float(v))};" for k, v in enumerate(flat)]
    shown = [
        f'        printf(" {spelled(m.name)} %g", {m.at("out.", 0)});'
        for m in plan.layout.outputs[:6]
    ]
    body = "\n".join(lines or ["    in.unused = 0.0;"])
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
        printf("%d: status %d", tick, status);
{chr(10).join(shown)}
        printf("\\n");
    }}
    return 0;
}}
"""


def test_program(plan: Plan) -> str:
    """Text of the program that replays the vectors and compares."""
    n, lay, big = plan.name, plan.layout, plan.layout.big
    compared = [*lay.outputs, *lay.states]
    names = ",\n".join(f'    {{"{spelled(m.name)}", {m.size}}}' for m in compared)
    n_in, n_param, n_out, n_state = (
        sum(m.size for m in g) for g in (lay.inputs, lay.params, lay.outputs, lay.states)
    )
    take_in = "        memcpy(&in, row, N_IN * sizeof(double));\n" if n_in else ""
    take_param = "    memcpy(&param, row, N_PARAM * sizeof(double));\n" if n_param else ""
    give_state = (
        "        memcpy(got + N_OUT, &state, N_STATE * sizeof(double));\n" if n_state else ""
    )
    sizes = "".join(
        f"typedef char {w}_has_no_gaps[(sizeof({n}_{w}) == {size} * sizeof(double)) ? 1 : -1];\n"
        for w, size in (("in", n_in), ("param", n_param), ("out", n_out))
        if size
    )
    guards = _guards(n, big) if n_in else "    refused = N_IN;\n"
    return f"""{head(plan, f"test_{n}.c")}

/* Back to back: replay recorded inputs, carry the state here, compare with the recorded outputs and
 * states of the Python model. Usage: test_{n} [vectors.txt]; exit code 0 when all agree.
 */

#include "{n}.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define N_IN {n_in}
#define N_PARAM {n_param}
#define N_OUT {n_out}
#define N_STATE {n_state}
#define N_SIGNALS {len(compared)}
#define N_ROW (N_IN + N_OUT + N_STATE + N_PARAM + 1)
#define LIMIT {number(LIMIT)} /* relative to the largest value of the signal */
#define CONTENT "{CONTENT}"

{sizes}
static const struct {{
    const char *name;
    int size;
}} signals[N_SIGNALS] = {{
{names}
}};

static int numbers(FILE *file, double *x, int n)
{{
    int k;
    for (k = 0; k < n; ++k) {{
        if (fscanf(file, "%lf", &x[k]) != 1) {{
            return 0;
        }}
    }}
    return 1;
}}

int main(int argc, char **argv)
{{
    static double row[N_ROW];
    static double got[N_OUT + N_STATE];
    static double worst[N_SIGNALS];
    static double largest[N_SIGNALS];
    static {n}_in in;
    static {n}_param param;
    static {n}_state state;
    static {n}_out out;
    const char *path = (argc > 1) ? argv[1] : "vectors.txt";
    FILE *file = fopen(path, "r");
    char word[64] = "";
    char content[64] = "";
    int count = 0;
    int ticks = 0;
    int tick;
    int faults = 0;
    int refused = 0;
    int k;
    double most = 0.0;

    if (file == 0) {{
        printf("cannot read %s\\n", path);
        return 2;
    }}
    if (fscanf(file, "slipctl-vectors 1 %63s %63s param %d", word, content, &count) != 3
        || strcmp(content, CONTENT) != 0 || count != N_PARAM || !numbers(file, row, N_PARAM)
        || fscanf(file, " ticks %d", &ticks) != 1) {{
        printf("%s does not belong to {n} " CONTENT "\\n", path);
        return 2;
    }}
    {n}_default(&param);
{take_param}    if ({n}_init(&param, &state) != {big}_OK) {{
        printf("init refuses the parameters\\n");
        return 1;
    }}
    for (tick = 0; tick < ticks; ++tick) {{
        int signal;
        int at = 0;
        if (!numbers(file, row, N_IN + N_OUT + N_STATE)) {{
            printf("%s ends at tick %d\\n", path, tick);
            return 2;
        }}
{take_in}        if ({n}_step(&in, &param, &state, &out) != {big}_OK) {{
            ++faults;
        }}
        memcpy(got, &out, N_OUT * sizeof(double));
{give_state}        for (signal = 0; signal < N_SIGNALS; ++signal) {{
            for (k = 0; k < signals[signal].size; ++k, ++at) {{
                const double wanted = row[N_IN + at];
                const double difference = fabs(got[at] - wanted);
                worst[signal] = (difference <= worst[signal]) ? worst[signal] : difference;
                largest[signal] = (fabs(wanted) > largest[signal]) ? fabs(wanted) : largest[signal];
            }}
        }}
    }}
    (void)fclose(file);
    printf("%-32s %12s %12s\\n", "signal", "difference", "relative");
    for (k = 0; k < N_SIGNALS; ++k) {{
        const double relative = (largest[k] > 0.0) ? worst[k] / largest[k] : worst[k];
        printf("%-32s %12.3g %12.3g\\n", signals[k].name, worst[k], relative);
        most = (relative <= most) ? most : relative;
    }}
{guards}    printf("%d ticks, %d faults, ", ticks, faults);
    printf("%d of %d inputs refuse NaN, largest relative difference %.3g\\n", refused, N_IN, most);
    return (most <= LIMIT && faults == 0 && refused == N_IN) ? 0 : 1;
}}
"""


def _guards(n: str, big: str) -> str:
    """Statements that give each input NaN and look at what happens."""
    return f"""    for (k = 0; k < N_IN && ticks > 0; ++k) {{
        static {n}_state before;
        static {n}_out good;
        const double bad = (double)NAN;
        {n}_in broken = in;
        memcpy((char *)&broken + (size_t)k * sizeof(double), &bad, sizeof(double));
        memcpy(&before, &state, sizeof(state));
        memcpy(&good, &out, sizeof(out));
        if ({n}_step(&broken, &param, &state, &out) == {big}_BAD_INPUT
            && memcmp(&before, &state, sizeof(state)) == 0
            && memcmp(&good, &out, sizeof(out)) == 0) {{
            ++refused;
        }}
    }}
"""


def vectors(plan: Plan, content: str, params: Mapping[str, np.ndarray], rows: np.ndarray) -> str:
    """Text of the vectors: parameters, then a line of inputs, outputs and states for each tick."""
    flat = [v for m in plan.layout.params for v in packed(m, params[m.name])]
    lines = [f"slipctl-vectors 1 {plan.name} {content}", f"param {len(flat)}"]
    lines += [repr(float(v)) for v in flat]
    lines.append(f"ticks {len(rows)}")
    lines += [" ".join(map(repr, row)) for row in rows.tolist()]
    return "\n".join(lines) + "\n"


def packed(m: Member, value: Any) -> np.ndarray:
    """Elements of one value in the order of C: column by column."""
    return constant(m.signal, value).ravel(order="F")


def makefile(plan: Plan) -> str:
    """Text of the Makefile."""
    n = plan.name
    return f"""# Written by slipctl, content {CONTENT}. make test: build, compare with the vectors.
CFLAGS ?= {WARNINGS} {OPTIMISE}

all: {n}.o example test_{n}

{n}.o: {n}.c {n}.h
\t$(CC) $(CFLAGS) -c {n}.c -o $@

example: example.c {n}.o
\t$(CC) $(CFLAGS) example.c {n}.o -o $@ -lm

test_{n}: test_{n}.c {n}.o
\t$(CC) $(CFLAGS) test_{n}.c {n}.o -o $@ -lm

test: test_{n}
\t./test_{n} vectors.txt

size: {n}.o
\tsize {n}.o
\tnm -g {n}.o

clean:
\trm -f {n}.o example test_{n}

.PHONY: all test size clean
"""


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
    bits = "\n".join(f"| `{big}_{k}` | {v} | {what} |" for k, v, what in STATUS)
    tick = f"every {number(plan.period)} s" if plan.period else "once per tick"
    return f"""# {n}

{first_sentence(plan.block.doc)}

C99, written by slipctl {__version__}, content {CONTENT}. Numbers carried: {counts}.

| file | what it is |
|---|---|
| `{n}.h`, `{n}.c` | the module; nothing else is needed in a firmware |
| `example.c` | smallest program that runs it |
| `test_{n}.c`, `vectors.txt` | back-to-back test against the recorded Python model |
| `Makefile` | `make test`, `make size`, `make example`; take another compiler with `make CC=...` |
| `report.json` | sizes, symbols, compilers, largest difference from Python per signal |
| `LICENSE` | terms |

Call in this order:

1. `{n}_default`, then change the parameters that differ,
2. `{n}_init`,
3. `{n}_step` {tick},
4. `{n}_tune` after changing a parameter at run time.

Units, ranges, signs and sources stand beside each member in `{n}.h`. Link with the C mathematics
library (`-lm`).

| status | bit | meaning |
|---|---|---|
{bits}

With a status other than 0 a step leaves the state untouched and gives the outputs of the last good
step. No memory is allocated, nothing is global, and every instance has its own `{n}_state`.
{memory(plan)} Compile without `-ffast-math`.
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
