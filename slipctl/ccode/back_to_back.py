"""The test that goes with a module: a C program that replays vectors, and the vectors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from slipctl.ccode.comments import spelled
from slipctl.ccode.expressions import number
from slipctl.ccode.header import CONTENT, head
from slipctl.ccode.layout import Member
from slipctl.ccode.plan import Plan, constant

LIMIT = 1e-12
"""Largest allowed difference from Python, relative to the largest value of the signal."""


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
