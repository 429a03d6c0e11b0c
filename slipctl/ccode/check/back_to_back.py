"""The test that goes with a module: a C program that replays vectors, and the vectors."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from slipctl.ccode.check import guard_trial
from slipctl.ccode.check.vectors.expected_outputs import Expected, last_states
from slipctl.ccode.check.vectors.misuse import misuse
from slipctl.ccode.compile.state_numbers import numbers_of
from slipctl.ccode.module import rates
from slipctl.ccode.module.comments import ascii_text
from slipctl.ccode.module.header import CONTENT, STATUS, bit, head
from slipctl.ccode.module.layout import c_elements
from slipctl.ccode.module.plan import Plan

ENOUGH, AT_LEAST = 2e10, 1000
"""Instructions after which a board has replayed enough, some minutes of emulation, and ticks that
it replays anyhow. A windowed estimator in double takes 7e6 a tick on a Cortex-M4."""

_ROUNDED = """static void rounded(const double *from, real *to, int n)
{
    int k;
    for (k = 0; k < n; ++k) {
        to[k] = (real)from[k];
    }
}

"""

_SAME = """static bool same(const void *one, const void *other, size_t n)
{
    const unsigned char *a = (const unsigned char *)one;
    const unsigned char *b = (const unsigned char *)other;
    size_t differ = 0;
    size_t k;
    for (k = 0; k < n; ++k) {
        differ += (a[k] != b[k]) ? 1U : 0U;
    }
    return differ == 0U;
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
        return (copy == NULL) ? 2 : in_binary(file, copy, ticks, every);
    }
#endif
"""

_STEP = """#ifdef ON_BOARD
        stack_paint();
        from = clock_now();
#endif
        got_status = {n}_step(&in, &param, &state, &out);
#ifdef ON_BOARD
        count = instructions(from, clock_now()) - empty;
        depth = stack_used();
        deepest = (depth > deepest) ? depth : deepest;
        slowest = (count > slowest) ? count : slowest;
        sum += (double)count;
#endif
"""

_ENOUGH = """#ifdef ON_BOARD
        if ((sum > ENOUGH) && (tick >= (AT_LEAST - 1))) {
            ticks = tick + 1; /* the last one */
        }
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

_PIECES = """#ifndef ON_BOARD
{calls}        differently += ((got_pieces == got_status) && same(&out_pieces, &out, sizeof(out))
                        && same(&pieces.kept, &state.kept, sizeof(state.kept))) ? 0 : 1;
#endif
"""

_EMPTY = """#ifdef ON_BOARD
    clock_start();
    from = clock_now();
    empty = instructions(from, clock_now());
#endif
"""

_MISUSE = """#ifndef ON_BOARD
    misuses = misused(&param, &state);
    (void)printf("wrong parameters, states, calls and inputs: %d trials went wrong\\n", misuses);
#endif
"""

_COUNTED = """#ifdef ON_BOARD
    (void)printf("instructions per step: mean %.1f, most %lu; bytes of stack: at most %lu\\n",
           sum / (double)((ticks > 0) ? ticks : 1), slowest, deepest);
#endif
"""


_BEGUN = """#ifndef ON_BOARD
    static {n}_state pieces; /* stepped rate by rate */
    static {n}_out out_pieces;
    int got_pieces;
    int differently = 0;
#endif
"""

_COMPARED = """#ifndef ON_BOARD
    (void)printf("stepped rate by rate: %d ticks differ\\n", differently);
    wrong += differently;
#endif
"""

_PROGRAM = """{head}

/* Back to back: replay recorded inputs, carry the state here, compare with the recorded outputs,
 * states and status of the Python model. Exit code 0 when all agree.
 *
 * test_{n} [vectors.txt]               replay
 * test_{n} vectors.txt vectors.bin     write the numbers in binary, for a board that reads slowly
 */

#include "{n}.h"

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>

#ifdef ON_BOARD
#include "cortex_m.h"
#endif

#define N_IN {n_in}
#define N_PARAM {n_param}
#define N_OUT {n_out}
#define N_STATE {n_state}
#define N_SIGNALS {n_signals}
#define N_LIMITS {n_limits}
#define N_ENDS {n_ends} /* finite ends of the ranges of inputs */
{guarded}#define N_TICK {n_tick} /* numbers of a tick behind its status */
#define N_ROW {n_row}
#define STALE {stale} /* ticks that {first_held} is held */
#define COMPARED {mask} /* bits of the status */
#ifdef ON_BOARD
#define ENOUGH {enough} /* instructions of all steps after which a board stops, */
#define AT_LEAST {at_least} /* but not before so many ticks */
#endif
#define CONTENT "{content}"

typedef {real} real;

{sizes}
static const struct {{
    const char *name;
    int size;
}} signals[N_SIGNALS] = {{
{names}
}};

{table}static bool binary; /* whether the numbers of the file are those of this machine */

static bool numbers(FILE *file, double *x, int n)
{{
    int k;
    if (binary) {{
        return fread(x, sizeof(double), (size_t)n, file) == (size_t)n;
    }}
    for (k = 0; k < n; ++k) {{
        if (fscanf(file, "%lf", &x[k]) != 1) {{
            return false;
        }}
    }}
    return true;
}}

static void copied(void *to, const void *from, size_t n)
{{
    (void)memcpy(to, from, n);
}}

/* Numbers of a tick: the file has the states of every so many ticks, and of the last one. */
static int width(int tick, int ticks, int every)
{{
    return (((tick % every) == 0) || (tick == (ticks - 1))) ? N_TICK : (N_TICK - N_STATE);
}}

#ifndef ON_BOARD
static int in_binary(FILE *file, FILE *copy, int ticks, int every)
{{
    long left = {n_first}L + ticks;
    double x = 0.0;
    int tick;
    for (tick = 0; tick < ticks; ++tick) {{
        left += width(tick, ticks, every);
    }}
    (void)fprintf(copy, "slipctl-vectors 4 {n} " CONTENT " binary %d %d %d %d\\n", N_PARAM,
            N_SIGNALS, ticks, every);
    for (; left > 0; --left) {{
        if (!numbers(file, &x, 1) || (fwrite(&x, sizeof(double), 1, copy) != 1U)) {{
            return 2;
        }}
    }}
    return (fclose(copy) == 0) ? 0 : 2;
}}
#endif

{same}{rounded}{numbers}{misuse}{main}
{{
    static double row[N_ROW];
    static real raw[N_ROW];
    static real given[{n_answers}]; /* outputs and states as they were last looked at */
    static double limits[N_LIMITS]; /* largest difference; 1 if only of the envelope */
    static double worst[N_SIGNALS];
    static double largest[N_SIGNALS];
    static double ends[{n_answers}][4]; /* least wanted and got, greatest wanted and got */
    static {n}_in in;
    static {n}_param param;
    static {n}_state state;
    static {n}_out out;
{begun}{path}    FILE *file = fopen(path, "rb");
    char line[200] = {{0}};
    char content[64] = {{0}};
    char form[64] = {{0}};
    int params = 0;
    int compared = 0;
    bool ours = false;
    int ticks = 0;
    int every = 0;
    int tick;
    double wanted_status = 0.0;
    int faults = 0;
    int refused = 0;
    int held = 0;
    bool still = (N_IN == 0); /* a stale input refuses the tick */
    int wrong = 0;
    int misuses = 0;
    const int first = N_IN;
    int at = 0;
    int got_status;
    int k;
    int j;
    unsigned int differing;
    bool guarded;
    double most = 0.0;

    if (file == NULL) {{
        (void)printf("cannot read %s\\n", path);
        return 2;
    }}
    if (fgets(line, (int)sizeof(line), file) != NULL) {{
        ours = (sscanf(line, "slipctl-vectors 4 {n} %63s %63s %d %d %d %d", content, form, &params,
                       &compared, &ticks, &every) == 6);
    }}
    if (!ours || (strcmp(content, CONTENT) != 0) || (params != N_PARAM)
        || (compared != N_SIGNALS) || (every < 1)) {{
        (void)printf("%s does not belong to {n} " CONTENT "\\n", path);
        return 2;
    }}
    binary = (strcmp(form, "binary") == 0);
{in_binary}    if (!numbers(file, row, N_PARAM) || !numbers(file, limits, N_LIMITS)) {{
        (void)printf("%s has no parameters and limits\\n", path);
        return 2;
    }}
    {n}_default(&param);
{take_param}    if ({n}_init(&param, &state) != {big}_OK) {{
        (void)printf("init refuses the parameters\\n");
        return 1;
    }}
{copy}{empty}    for (tick = 0; tick < ticks; ++tick) {{
        int signal;
        const int now = width(tick, ticks, every);
        if (!numbers(file, &wanted_status, 1) || !numbers(file, row, now)) {{
            (void)printf("%s ends at tick %d\\n", path, tick);
            return 2;
        }}
{take_in}        k = (int)wanted_status;
{stepped}        differing = ((unsigned int)got_status ^ (unsigned int)k) & COMPARED;
        faults += ((k < 0) || (differing == 0U)) ? 0 : 1; /* -1: roundings decide */
        copied(given, &out, (size_t)N_OUT * sizeof(real));
{give_state}        at = 0;
        for (signal = 0; signal < N_SIGNALS; ++signal) {{
            for (k = 0; k < signals[signal].size; ++k) {{
                const double wanted = row[first + at];
                const double got = (double)given[at];
                const double difference = fabs(got - wanted);
                worst[signal] = (difference <= worst[signal]) ? worst[signal] : difference;
                largest[signal] = (fabs(wanted) > largest[signal]) ? fabs(wanted) : largest[signal];
                ends[at][0] = ((tick > 0) && (ends[at][0] < wanted)) ? ends[at][0] : wanted;
                ends[at][1] = ((tick > 0) && (ends[at][1] < got)) ? ends[at][1] : got;
                ends[at][2] = ((tick > 0) && (ends[at][2] > wanted)) ? ends[at][2] : wanted;
                ends[at][3] = ((tick > 0) && (ends[at][3] > got)) ? ends[at][3] : got;
                ++at;
            }}
        }}
{enough_of_it}    }}
    (void)fclose(file);
    (void)printf("%-32s %12s %12s %12s\\n", "signal", "difference", "relative", "limit");
    at = 0;
    for (k = 0; k < N_SIGNALS; ++k) {{
        const double relative = (largest[k] > 0.0) ? worst[k] / largest[k] : worst[k];
        const bool envelope = (limits[(2 * k) + 1] > 0.0);
        double most_of = envelope ? 0.0 : worst[k];
        for (j = 0; j < signals[k].size; ++j) {{
            const double low = fabs(ends[at][0] - ends[at][1]);
            const double high = fabs(ends[at][2] - ends[at][3]);
            most_of = (envelope && !(low <= most_of)) ? low : most_of;
            most_of = (envelope && !(high <= most_of)) ? high : most_of;
            ++at;
        }}
        (void)printf("%-32s %12.3g %12.3g %12.3g%s\\n", signals[k].name, worst[k], relative,
               limits[2 * k], envelope ? " (of least and greatest value)" : "");
        most = (envelope || (relative <= most)) ? most : relative;
        wrong += (most_of <= limits[2 * k]) ? 0 : 1;
    }}
{guards}{misuses}{compared_so}    (void)printf("%d ticks, %d faults, ", ticks, faults);
    (void)printf("%d of %d inputs are held when NaN, %d of %d beyond their ends, ", refused, {held},
           held, N_ENDS);
    (void)printf("largest relative difference %.3g\\n", most);
{counted}    guarded = (ticks == 0) || (still && (refused == {held}) && (held == N_ENDS));
    return ((wrong == 0) && (faults == 0) && (misuses == 0) && guarded) ? 0 : 1;
}}
"""


def compared_bits(real: str) -> int:
    """Bits of the status that are compared: in float, a limit may be met in another tick."""
    return sum(v for _, v, _ in STATUS) - (bit("LIMITED") if real == "float" else 0)


def test_program(plan: Plan) -> str:
    """Text of the program that replays the vectors and compares."""
    return _PROGRAM.format(**_counts(plan), **_declarations(plan), **_statements(plan))


def _counts(plan: Plan) -> dict[str, Any]:
    """Numbers and names in the program: of the members of each struct, of a row of the vectors."""
    lay = plan.layout
    n_in, n_param, n_out, n_state = (
        sum(m.size for m in g) for g in (lay.inputs, lay.params, lay.outputs, lay.states)
    )
    n_signals = len(lay.outputs) + len(lay.states)
    ends = _ends(plan)
    return {
        "n": plan.name, "big": lay.big, "real": plan.real, "content": CONTENT,
        "enough": repr(ENOUGH), "at_least": AT_LEAST, "mask": f"{compared_bits(plan.real)}U",
        "stale": guard_trial.stale_ticks(plan), "n_in": n_in, "n_param": n_param,
        "n_out": n_out, "n_state": n_state, "n_signals": n_signals, "n_limits": 2 * n_signals,
        "n_ends": sum(math.isfinite(v) for pair in ends for v in pair),
        "n_tick": n_in + n_out + n_state, "n_row": n_in + n_out + n_state + n_param + 1,
        "n_answers": n_out + n_state, "n_first": n_param + 2 * n_signals,
    }  # fmt: skip


def _ends(plan: Plan) -> list[Any]:
    """Ends of the range of each number that the module is given."""
    return [plan.limits(m) for m in plan.layout.inputs for _ in range(m.size)]


def _declarations(plan: Plan) -> dict[str, str]:
    """What stands before ``main``: tables of names and ranges, and what compares and spoils."""
    n, lay = plan.name, plan.layout
    structs = {"in": lay.inputs, "param": lay.params, "out": lay.outputs}
    widths = {w: sum(m.size for m in members) for w, members in structs.items()}
    given = bool(lay.inputs)
    return {
        "head": head(plan, f"test_{n}.c"),
        "names": ",\n".join(
            f'    {{"{ascii_text(m.name)}", {m.size}}}' for m in (*lay.outputs, *lay.states)
        ),
        "sizes": "".join(
            f"typedef char {w}_has_no_gaps[(sizeof({n}_{w}) == {size} * sizeof(real)) ? 1 : -1];\n"
            for w, size in widths.items() if size
        ),
        "table": guard_trial.input_ranges(_ends(plan), plan.judged) if given else "",
        "guarded": guard_trial.guarded_count(plan),
        "same": _SAME if given else f"#ifndef ON_BOARD\n{_SAME.rstrip()}\n#endif\n\n",
        "numbers": numbers_of(lay, plan.real) if lay.states else "",
        "rounded": _ROUNDED if given or lay.params else "", "misuse": misuse(plan), "main": _MAIN,
    }  # fmt: skip


def _statements(plan: Plan) -> dict[str, str]:
    """What ``main`` does only where the module has inputs, numbers, states, guards or rates."""
    n, lay, guarded = plan.name, plan.layout, guard_trial.guarded_count(plan)
    of_state = (
        "        if (now == N_TICK) {\n"
        "            numbers_of(&state.kept, &given[N_OUT]);\n        }\n"
    )
    return {
        "take_in": _taken("in", 8) if lay.inputs else "",
        "take_param": _taken("param", 4) if lay.params else "",
        "give_state": of_state if lay.states else "",
        "begun": _BEGUN.format(n=n) if plan.rates else "",
        "copy": "#ifndef ON_BOARD\n    pieces = state;\n#endif\n" if plan.rates else "",
        "compared_so": _COMPARED if plan.rates else "",
        "stepped": _STEP.format(n=n) + _pieces(plan),
        "guards": guard_trial.spoilt_inputs(plan) if lay.inputs else "",
        "held": "N_GUARDED" if guarded else "N_IN",
        "first_held": "the first input" + (" of the guard" if guarded else ""),
        "path": _PATH, "in_binary": _COPY, "empty": _EMPTY, "enough_of_it": _ENOUGH,
        "misuses": _MISUSE, "counted": _COUNTED,
    }  # fmt: skip


def _taken(struct: str, deep: int) -> str:
    """Statements that take the numbers of a row into a struct."""
    rows = (f"rounded(row, raw, N_{struct.upper()});", f"copied(&{struct}, raw, sizeof({struct}));")
    return "".join(f"{' ' * deep}{row}\n" for row in rows)


def _pieces(plan: Plan) -> str:
    """Statements that make the tick by the steps of its rates, and compare."""
    if not plan.rates:
        return ""
    calls = ""
    for g in rates.groups(plan):
        call = f"got_pieces = {plan.name}_{g.name}(&in, &param, &pieces, &out_pieces);"
        if g.ticks == 1:
            calls += f"        {call}\n"
        else:
            calls += f"        if ((tick % {g.ticks}) == 0) {{\n            {call}\n        }}\n"
    return _PIECES.format(calls=calls)


def vectors(
    plan: Plan, content: str, params: Mapping[str, np.ndarray], run: Expected, every: int = 1
) -> str:
    """Text of the vectors: parameters, limits, then status, inputs, outputs, states per tick.

    Args:
        plan, params, run: the module, its parameters, what it is to give.
        content: hash of its texts.
        every: ticks from one that has states to the next; the last tick has them too.
    """
    flat = [v for m in plan.layout.params for v in c_elements(m, params[m.name])]
    members = [*plan.layout.outputs, *plan.layout.states]  # an output and a state may share a name
    sizes = f"{len(flat)} {len(members)} {len(run.rows)} {every}"
    lines = [f"slipctl-vectors 4 {plan.name} {content} text {sizes}"]
    lines += [repr(float(v)) for v in flat]
    lines += [f"{float(run.limits[m.name])!r} {int(m.name in run.envelope)}" for m in members]
    whole = last_states(len(run.rows), every) == np.arange(len(run.rows))
    for k, status in enumerate(run.status.tolist()):  # as objects all take five times the memory
        row = np.hstack([run.rows[k], run.outputs[k], *([run.states[k]] if whole[k] else ())])
        lines.append(" ".join(map(repr, [status, *row.tolist()])))
    return "\n".join(lines) + "\n"
