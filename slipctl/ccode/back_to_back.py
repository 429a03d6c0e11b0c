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
 * states and status of the Python model. Usage: test_{n} [vectors.txt]; exit code 0 when all agree.
 */

#include "{n}.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#define N_IN {n_in}
#define N_PARAM {n_param}
#define N_OUT {n_out}
#define N_STATE {n_state}
#define N_SIGNALS {len(compared)}
#define N_ENDS {beyond} /* finite ends of the ranges of inputs */
#define N_ROW (N_IN + N_OUT + N_STATE + N_PARAM + 1)
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

{table}static int numbers(FILE *file, double *x, int n)
{{
    int k;
    for (k = 0; k < n; ++k) {{
        if (fscanf(file, "%lf", &x[k]) != 1) {{
            return 0;
        }}
    }}
    return 1;
}}

{_ROUNDED if n_in or n_param else ""}int main(int argc, char **argv)
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
    const char *path = (argc > 1) ? argv[1] : "vectors.txt";
    FILE *file = fopen(path, "r");
    char word[64] = "";
    char content[64] = "";
    int count = 0;
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
    if (fscanf(file, "slipctl-vectors 2 %63s %63s param %d", word, content, &count) != 3
        || strcmp(content, CONTENT) != 0 || count != N_PARAM || !numbers(file, row, N_PARAM)
        || fscanf(file, " limits %d", &count) != 1 || count != N_SIGNALS) {{
        printf("%s does not belong to {n} " CONTENT "\\n", path);
        return 2;
    }}
    {n}_default(&param);
{take_param}    if ({n}_init(&param, &state) != {big}_OK) {{
        printf("init refuses the parameters\\n");
        return 1;
    }}
    if (!numbers(file, limits, 2 * N_SIGNALS) || fscanf(file, " ticks %d", &ticks) != 1) {{
        printf("%s has no limits\\n", path);
        return 2;
    }}
    for (tick = 0; tick < ticks; ++tick) {{
        int signal;
        if (!numbers(file, row, N_IN + N_OUT + N_STATE + 1)) {{
            printf("%s ends at tick %d\\n", path, tick);
            return 2;
        }}
{take_in}        k = (int)row[N_IN + N_OUT + N_STATE];
        if (({n}_step(&in, &param, &state, &out) & COMPARED) != (k & COMPARED)) {{
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
    return (wrong == 0 && faults == 0 && (ticks == 0 || (refused == N_IN && held == N_ENDS))) ? 0
                                                                                             : 1;
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
    lines = [f"slipctl-vectors 2 {plan.name} {content}", f"param {len(flat)}"]
    lines += [repr(float(v)) for v in flat]
    members = [*plan.layout.outputs, *plan.layout.states]  # an output and a state may share a name
    lines.append(f"limits {len(members)}")
    lines += [f"{float(run.limits[m.name])!r} {int(m.name in run.envelope)}" for m in members]
    lines.append(f"ticks {len(run.rows)}")
    rows = np.hstack([run.rows, run.outputs, run.states]).tolist()
    lines += [
        " ".join([*map(repr, row), str(status)])
        for row, status in zip(rows, run.status.tolist(), strict=True)
    ]
    return "\n".join(lines) + "\n"


def packed(m: Member, value: Any) -> np.ndarray:
    """Elements of one value in the order of C: column by column."""
    return constant(m.signal, value).ravel(order="F")
