"""A step that is told which tick it is for, so that a call which comes twice or late is seen."""

from __future__ import annotations

from slipctl.ccode.module import guard
from slipctl.ccode.module.comments import comment
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.tree.nodes import Node
from slipctl.ccode.tree.parser import define, if_
from slipctl.ccode.tree.printer import signature


def prototype(plan: Plan) -> str:
    """Declaration of the function."""
    n = plan.name
    given = f"const {n}_in *in", f"const {n}_param *param", f"{n}_state *state", f"{n}_out *out"
    return signature("int", f"{n}_step_counted", [*given, "unsigned int tick"])


def counter_doc(plan: Plan) -> str:
    """What the header says of it."""
    n, big = plan.name, plan.layout.big
    return (
        f"{n}_step for a tick of this number, which counts up by one from call to call and goes on"
        f" at 0 behind its largest. {big}_TIMING besides if it is not the one after the last. The"
        f" same number again is a call that came twice: {big}_REFUSED too, and nothing changes."
        " With any other the step is made, and inputs count as that much older."
    )


COUNTER = """struct {
        unsigned int last; /* number of the last tick */
        unsigned int begun; /* 0 before the first one */
    }"""
"""What the state has for it."""


def functions(plan: Plan, hold: str) -> list[Node]:
    """Definitions.

    Args:
        plan: the module.
        hold: statement that gives the outputs of a step that is refused.
    """
    n, big = plan.name, plan.layout.big
    refused = f"return (int){big}_TIMING | (int){big}_REFUSED;"
    late = [f"status = (unsigned int){big}_TIMING;"]
    remembers = bool(plan.n_in) or bool(plan.counters)
    late += ["missed(&state->guard, since - 1U);"] * remembers
    step = f"{n}_step(in, param, state, out)"
    lines: list[str | Node] = [
        "unsigned int status = 0U;",
        if_(f"state->guard.mark != {guard.MARK_NAME}", f"return {step};"),
        if_(
            "state->counter.begun != 0U",
            "const unsigned int since = tick - state->counter.last;"
            " /* wraps as the counter does */",
            if_("since == 0U", hold, refused),
            if_("since != 1U", *late),
        ),
        "state->counter.last = tick;", "state->counter.begun = 1U;",
        f"status |= (unsigned int){step};", "return (int)status;",
    ]  # fmt: skip
    made = [define(prototype(plan), lines)]
    if remembers:
        older = [
            f"for (int k = 0; k < {plan.n_in}; ++k) {{ guard->back[k] = 0U;"
            " if ((guard->age[k] >= 0) && (guard->age[k] < FORGOTTEN)) {"
            " const unsigned int left = (unsigned int)FORGOTTEN - (unsigned int)guard->age[k];"
            " guard->age[k] = (ticks < left) ? (guard->age[k] + (int)ticks) : FORGOTTEN; } }",
            "guard->fresh = 0U;",
        ]
        body = [*older * bool(plan.n_in), *["guard->missed += ticks;"] * bool(plan.counters)]
        what = comment("So many ticks went by without a call: inputs are that much older.")
        given = [f"struct {n}_guard *guard", "unsigned int ticks"]
        made.insert(0, define("static void missed", body, what, given))
    return made
