"""The test that goes with a module: a C program that replays vectors, and the vectors."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from slipctl.ccode.comments import spelled
from slipctl.ccode.expected import Expected
from slipctl.ccode.expressions import number
from slipctl.ccode.header import CONTENT, head
from slipctl.ccode.layout import Member
from slipctl.ccode.plan import Plan, constant

_ROUNDED = """static void rounded(const double *from, real *to, int n)
{
    int k;
    for (k = 0; k < n; ++k) {
        to[k] = (real)from[k];
    }
}

"""

_MAIN = """#ifdef ON_BOARD
int main(void)
#else
int main(int argc, char **argv)
#endif"""

_COPY = """#ifndef ON_BOARD
    if (argc > 2) {
        FILE *copy = fopen(argv[2], "wb");
        return (copy == 0) ? 2 : in_binary(file, copy, ticks);
    }
#endif
"""

_STEP = """#ifdef ON_BOARD
        stack_paint();
        from = clock_now();
#endif
        status = {n}_step(&in, &param, &state, &out);
#ifdef ON_BOARD
        count = instructions(from, clock_now()) - empty;
        depth = stack_used();
        deepest = (depth > deepest) ? depth : deepest;
        slowest = (count > slowest) ? count : slowest;
        sum += (double)count;
#endif
"""

_PATH = """#ifdef ON_BOARD
    const char *path = "vectors.bin";
    unsigned long from = 0;
    unsigned long count = 0;
    unsigned long empty = 0; /* of reading the clock twice */
    unsigned long slowest = 0;
    unsigned long depth = 0;
    unsigned long deepest = 0;
    double sum = 0.0;
#else
    const char *path = (argc > 1) ? argv[1] : "vectors.txt";
#endif
"""

_EMPTY = """#ifdef ON_BOARD
    clock_start();
    from = clock_now();
    empty = instructions(from, clock_now());
#endif
"""

_COUNTED = """#ifdef ON_BOARD
    printf("instructions per step: mean %.1f, most %lu; bytes of stack: at most %lu\\n",
           sum / ((ticks > 0) ? ticks : 1), slowest, deepest);
#endif
"""


def test_program(plan: Plan) -> str:
    """Text of the program that replays the vectors and compares."""
    n, lay, big = plan.name, plan.layout, plan.layout.big
    compared = [*lay.outputs, *lay.states]
    names = ",\n".join(f'    {{"{spelled(m.name)}", {m.size}}}' for m in compared)
    n_in, n_param, n_out, n_state = (
        sum(m.size for m in g) for g in (lay.inputs, lay.params, lay.outputs, lay.states)
    )
    take_in = take_param = ""
    if n_in:
        take_in = "        rounded(row, raw, N_IN);\n        memcpy(&in, raw, sizeof(in));\n"
    if n_param:
        take_param = "    rounded(row, raw, N_PARAM);\n    memcpy(&param, raw, sizeof(param));\n"
    give_state = "        memcpy(raw + N_OUT, &state, N_STATE * sizeof(real));\n" if n_state else ""
    sizes = "".join(
        f"typedef char {w}_has_no_gaps[(sizeof({n}_{w}) == {size} * sizeof(real)) ? 1 : -1];\n"
        for w, size in (("in", n_in), ("param", n_param), ("out", n_out))
        if size
    )
    ends = [plan.limits(m) for m in lay.inputs for _ in range(m.size)]
    beyond = sum(math.isfinite(v) for pair in ends for v in pair)
    guards, table = (_guards(n, big), _table(ends)) if n_in else ("", "")
    mask = "~0" if plan.real == "double" else f"~(int){big}_LIMITED"
    return f"""{head(plan, f"test_{n}.c")}

/* Back to back: replay recorded inputs, carry the state here, compare with the recorded outputs,
 * states and status of the Python model. Exit code 0 when all agree.
 *
 * test_{n} [vectors.txt]               replay
 * test_{n} vectors.txt vectors.bin     write the numbers in binary, for a board that reads slowly
 */

#include "{n}.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#ifdef ON_BOARD
#include "cortex_m.h"
#endif

#define N_IN {n_in}
#define N_PARAM {n_param}
#define N_OUT {n_out}
#define N_STATE {n_state}
#define N_SIGNALS {len(compared)}
#define N_ENDS {beyond} /* finite ends of the ranges of inputs */
#define N_TICK (N_IN + N_OUT + N_STATE + 1) /* the last one is the status */
#define N_ROW (N_TICK + N_PARAM)
#define COMPARED ({mask}) /* bits of the status */
#define CONTENT "{CONTENT}"

typedef {plan.real} real;

{sizes}
static const struct {{
    const char *name;
    int size;
}} signals[N_SIGNALS] = {{
{names}
}};

{table}static int binary; /* whether the numbers of the file are those of this machine */

static int numbers(FILE *file, double *x, int n)
{{
    int k;
    if (binary) {{
        return fread(x, sizeof(double), (size_t)n, file) == (size_t)n;
    }}
    for (k = 0; k < n; ++k) {{
        if (fscanf(file, "%lf", &x[k]) != 1) {{
            return 0;
        }}
    }}
    return 1;
}}

#ifndef ON_BOARD
static int in_binary(FILE *file, FILE *copy, int ticks)
{{
    long left = N_PARAM + 2L * N_SIGNALS + (long)ticks * N_TICK;
    double x = 0.0;
    fprintf(copy, "slipctl-vectors 3 {n} " CONTENT " binary %d %d %d\\n", N_PARAM, N_SIGNALS,
            ticks);
    for (; left > 0; --left) {{
        if (!numbers(file, &x, 1) || fwrite(&x, sizeof(double), 1, copy) != 1) {{
            return 2;
        }}
    }}
    return (fclose(copy) == 0) ? 0 : 2;
}}
#endif

{_ROUNDED if n_in or n_param else ""}{_MAIN}
{{
    static double row[N_ROW];
    static real raw[N_ROW];
    static double limits[2 * N_SIGNALS]; /* largest difference; 1 if only of the envelope */
    static double worst[N_SIGNALS];
    static double largest[N_SIGNALS];
    static double ends[N_OUT + N_STATE][4]; /* least wanted and got, greatest wanted and got */
    static {n}_in in;
    static {n}_param param;
    static {n}_state state;
    static {n}_out out;
{_PATH}    FILE *file = fopen(path, "rb");
    char line[200] = "";
    char content[64] = "";
    char form[64] = "";
    int params = 0;
    int compared = 0;
    int ticks = 0;
    int tick;
    int faults = 0;
    int refused = 0;
    int held = 0;
    int wrong = 0;
    int at = 0;
    int k;
    int j;
    double most = 0.0;

    if (file == 0) {{
        printf("cannot read %s\\n", path);
        return 2;
    }}
    if (fgets(line, (int)sizeof(line), file) == 0
        || sscanf(line, "slipctl-vectors 3 {n} %63s %63s %d %d %d", content, form, &params,
                  &compared, &ticks) != 5
        || strcmp(content, CONTENT) != 0 || params != N_PARAM || compared != N_SIGNALS) {{
        printf("%s does not belong to {n} " CONTENT "\\n", path);
        return 2;
    }}
    binary = (strcmp(form, "binary") == 0);
{_COPY}    if (!numbers(file, row, N_PARAM) || !numbers(file, limits, 2 * N_SIGNALS)) {{
        printf("%s has no parameters and limits\\n", path);
        return 2;
    }}
    {n}_default(&param);
{take_param}    if ({n}_init(&param, &state) != {big}_OK) {{
        printf("init refuses the parameters\\n");
        return 1;
    }}
{_EMPTY}    for (tick = 0; tick < ticks; ++tick) {{
        int signal;
        int status;
        if (!numbers(file, row, N_TICK)) {{
            printf("%s ends at tick %d\\n", path, tick);
            return 2;
        }}
{take_in}        k = (int)row[N_IN + N_OUT + N_STATE];
{_STEP.format(n=n)}        if ((status & COMPARED) != (k & COMPARED)) {{
            ++faults;
        }}
        memcpy(raw, &out, N_OUT * sizeof(real));
{give_state}        at = 0;
        for (signal = 0; signal < N_SIGNALS; ++signal) {{
            for (k = 0; k < signals[signal].size; ++k, ++at) {{
                const double wanted = row[N_IN + at];
                const double got = (double)raw[at];
                const double difference = fabs(got - wanted);
                worst[signal] = (difference <= worst[signal]) ? worst[signal] : difference;
                largest[signal] = (fabs(wanted) > largest[signal]) ? fabs(wanted) : largest[signal];
                ends[at][0] = (tick > 0 && ends[at][0] < wanted) ? ends[at][0] : wanted;
                ends[at][1] = (tick > 0 && ends[at][1] < got) ? ends[at][1] : got;
                ends[at][2] = (tick > 0 && ends[at][2] > wanted) ? ends[at][2] : wanted;
                ends[at][3] = (tick > 0 && ends[at][3] > got) ? ends[at][3] : got;
            }}
        }}
    }}
    (void)fclose(file);
    printf("%-32s %12s %12s %12s\\n", "signal", "difference", "relative", "limit");
    at = 0;
    for (k = 0; k < N_SIGNALS; ++k) {{
        const double relative = (largest[k] > 0.0) ? worst[k] / largest[k] : worst[k];
        const int envelope = (limits[2 * k + 1] > 0.0);
        double counted = envelope ? 0.0 : worst[k];
        for (j = 0; j < signals[k].size; ++j, ++at) {{
            const double low = fabs(ends[at][0] - ends[at][1]);
            const double high = fabs(ends[at][2] - ends[at][3]);
            counted = (envelope && !(low <= counted)) ? low : counted;
            counted = (envelope && !(high <= counted)) ? high : counted;
        }}
        printf("%-32s %12.3g %12.3g %12.3g%s\\n", signals[k].name, worst[k], relative,
               limits[2 * k], envelope ? " (of least and greatest value)" : "");
        most = (relative <= most) ? most : relative;
        wrong += !(counted <= limits[2 * k]);
    }}
{guards}    printf("%d ticks, %d faults, ", ticks, faults);
    printf("%d of %d inputs refuse NaN, %d of %d ends of ranges hold, ", refused, N_IN, held,
           N_ENDS);
    printf("largest relative difference %.3g\\n", most);
{_COUNTED}    wrong += faults + (ticks > 0 && (refused != N_IN || held != N_ENDS));
    return (wrong == 0) ? 0 : 1;
}}
"""


def _table(ends: list[tuple[float, float]]) -> str:
    """Ranges of the inputs; infinite where there is no end."""
    rows = ",\n".join(f"    {{{number(lo)}, {number(hi)}}}" for lo, hi in ends)
    return f"static const double range_of[N_IN][2] = {{\n{rows}\n}};\n\n"


def _guards(n: str, big: str) -> str:
    """Statements that spoil each input in turn and look that nothing of it is taken."""
    return f"""    for (k = 0; k < N_IN && ticks > 0; ++k) {{
        for (j = -1; j < 2; ++j) {{
            static {n}_state before;
            static {n}_out good;
            const double end = (j < 0) ? (double)NAN : range_of[k][j];
            const real bad = (real)(end + ((j > 0) ? 1.0 : -1.0) * (1.0 + 0.001 * fabs(end)));
            const int wanted = (j < 0) ? {big}_BAD_INPUT : {big}_OFF_RANGE;
            {n}_in broken = in;
            if (j >= 0 && fabs(end) > DBL_MAX) {{
                continue;
            }}
            memcpy((char *)&broken + (size_t)k * sizeof(real), &bad, sizeof(real));
            memcpy(&before, &state, sizeof(state));
            memcpy(&good, &out, sizeof(out));
            if ({n}_step(&broken, &param, &state, &out) == wanted
                && memcmp(&before, &state, sizeof(state)) == 0
                && memcmp(&good, &out, sizeof(out)) == 0) {{
                refused += (j < 0);
                held += (j >= 0);
            }}
        }}
    }}
"""


def vectors(plan: Plan, content: str, params: Mapping[str, np.ndarray], run: Expected) -> str:
    """Text of the vectors: parameters, limits, then inputs, outputs, states, status per tick."""
    flat = [v for m in plan.layout.params for v in packed(m, params[m.name])]
    members = [*plan.layout.outputs, *plan.layout.states]  # an output and a state may share a name
    sizes = f"{len(flat)} {len(members)} {len(run.rows)}"
    lines = [f"slipctl-vectors 3 {plan.name} {content} text {sizes}"]
    lines += [repr(float(v)) for v in flat]
    lines += [f"{float(run.limits[m.name])!r} {int(m.name in run.envelope)}" for m in members]
    rows = np.hstack([run.rows, run.outputs, run.states]).tolist()
    lines += [
        " ".join([*map(repr, row), str(status)])
        for row, status in zip(rows, run.status.tolist(), strict=True)
    ]
    return "\n".join(lines) + "\n"


def packed(m: Member, value: Any) -> np.ndarray:
    """Elements of one value in the order of C: column by column."""
    return constant(m.signal, value).ravel(order="F")
