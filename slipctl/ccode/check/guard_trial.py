"""The part of a module's own test that spoils each input in turn, and looks what comes of it."""

from __future__ import annotations

import numpy as np

from slipctl.ccode.module.header import number
from slipctl.ccode.module.plan import Plan


def input_ranges(ends: list[tuple[float, float]], judged: np.ndarray) -> str:
    """Ranges of the inputs, infinite where there is no end; and which the model judges itself."""
    rows = ",\n".join(f"    {{{number(lo)}, {number(hi)}}}" for lo, hi in ends)
    text = f"""static const double range_of[N_IN][2] = {{
{rows}
}};

"""
    if judged.any():
        flags = ", ".join(str(int(j)) for j in judged)
        text += f"static const int judged_of[N_IN] = {{{flags}}};\n\n"
    return text


def guarded_count(plan: Plan) -> str:
    """Line that counts the inputs which the guard holds, where the model judges others itself."""
    if not len(plan.judged) or not plan.judged.any():
        return ""
    return (
        f"#define N_GUARDED {int((~plan.judged).sum())} /* inputs that the guard holds; the model"
        " judges the others */\n"
    )


def _judged_inputs(plan: Plan) -> str:
    """Statements that give the model a NaN for an input which it judges itself.

    No tick is refused for it, and every output is finite.
    """
    if not plan.judged.any():
        return ""
    n, big = plan.name, plan.layout.big
    return f"""        if (judged_of[k] != 0) {{
            static {n}_state unspoilt;
            {n}_in spoilt = state.guard.last;
            unspoilt = state;
            copied(raw, &spoilt, sizeof(spoilt));
            raw[k] = (real)NAN;
            copied(&spoilt, raw, sizeof(spoilt));
            got_status = {n}_step(&spoilt, &param, &state, &out);
            faults += ((got_status & {big}_REFUSED) == 0) ? 0 : 1;
            copied(raw, &out, (size_t)N_OUT * sizeof(real));
            for (j = 0; j < N_OUT; ++j) {{
                faults += isfinite(raw[j]) ? 0 : 1;
            }}
            state = unspoilt;
            continue;
        }}
"""


def spoilt_inputs(plan: Plan) -> str:
    """Statements that spoil each input in turn and look that its last good value is taken."""
    n, big = plan.name, plan.layout.big
    safe = "".join(
        f"        {m.at('good.', k)} = (real){number(plan.safe[m.c])};\n"
        for m in plan.layout.outputs if m.c in plan.safe for k in range(m.size)
    )  # fmt: skip
    guarded = np.flatnonzero(~plan.judged)
    stale = f"""    for (k = 0; (k <= STALE) && (ticks > 0); ++k) {{
        static {n}_state before;
        static {n}_out good;
        {n}_in last = state.guard.last;
        copied(raw, &last, sizeof(last));
        raw[{guarded[0] if guarded.size else 0}] = (real)NAN;
        copied(&last, raw, sizeof(last));
        before = state;
        got_status = {n}_step(&last, &param, &state, &out);
        good = state.held;
{safe}        still = (got_status == ({big}_BAD_INPUT | {big}_REFUSED))
            && {_same_kept(plan, "before")}
            && same(&good, &out, sizeof(out));
    }}
"""
    if not guarded.size:
        stale = "    still = true; /* the model judges all of them */\n"
    return f"""    for (k = 0; (k < N_IN) && (ticks > 0); ++k) {{
{_judged_inputs(plan)}        for (j = -1; j < 2; ++j) {{
            static {n}_state before;
            static {n}_state plain;
            static {n}_out good;
            const double end = (j < 0) ? (double)NAN : range_of[k][j];
            const double far = ((j > 0) ? 1.0 : -1.0) * (1.0 + (0.001 * fabs(end)));
            const double beyond = end + far;
            const int wanted = (j < 0) ? {big}_BAD_INPUT : {big}_OFF_RANGE;
            {n}_in last = state.guard.last;
            int as_last;
            if ((j >= 0) && (fabs(end) > DBL_MAX)) {{
                continue;
            }}
            before = state;
            as_last = {n}_step(&last, &param, &state, &good);
            plain = state;
            state = before;
            copied(raw, &last, sizeof(last));
            raw[k] = (real)beyond;
            copied(&last, raw, sizeof(last));
            got_status = {n}_step(&last, &param, &state, &out);
            if ((got_status == (as_last | wanted))
                && {_same_kept(plan, "plain")}
                && same(&good, &out, sizeof(out))) {{
                refused += (j < 0) ? 1 : 0;
                held += (j >= 0) ? 1 : 0;
            }}
            state = before;
        }}
    }}
{stale}"""


def _same_kept(plan: Plan, other: str) -> str:
    """Condition: another instance keeps the same."""
    kept = f"same(&{other}.kept, &state.kept, sizeof(state.kept))"
    return kept if plan.layout.states else f"same(&{other}, &state, 0U)"


def stale_ticks(plan: Plan) -> int:
    """Ticks for which the first input of the guard is held; 0 where the model judges all."""
    guarded = np.flatnonzero(~plan.judged) if len(plan.judged) else np.array([], int)
    return int(plan.stale[guarded[0]]) if guarded.size else 0
