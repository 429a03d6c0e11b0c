"""Statements of a module around its equations: inputs, starts, ends, places in memory."""

from __future__ import annotations

import re
from types import SimpleNamespace

import pytest
from test_asked_outputs import pair

from slipctl import BadInput, Input, Output, Param, State, connect, replicate, step
from slipctl.ccode.module import guard_functions, header, rates, source
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.ship import a2l
from slipctl.ccode.tree.printer import lines_of


@step(period=0.01, y=Output("1", "sum", lo=-99, hi=99))
def listens(
    a=Input("1", lo=-1, hi=2, change=0.5, noise=0.25, stale=3),
    b=Input("1", "the block judges it", judged=True),
    c=Input("1", "and these", shape=(3,), judged=True),
    d=Input("1", shape=(2,), lo=-3, hi="2 * k", change="k"),
    e=Input("1", lo="-k", hi=8, change=0.5, noise="k", stale=7),
    f=Input("1", shape=(2,), lo=0, hi=1, stale=0),
    k=Param("1", 2.0, lo=0, hi=5),
):  # fmt: skip
    """Inputs of each kind."""
    return {}, dict(y=a + b + c[1] + d[0] + e * k + f[1])


def test_each_input_is_taken_by_its_own_ends_with_its_own_ages() -> None:
    """Ages are counted over all elements: a 0, b 1, c 2 to 4, d 5 and 6, e 7, f 8 and 9."""
    (made,) = guard_functions.check_inputs(Plan(listens))
    text = re.sub(r"\s+", " ", " ".join(lines_of([made])))
    taken = re.findall(r"told \|= (.*?);", text)
    last = "&guard->last."
    assert taken == [
        f"accept(in->a, -1.0, 2.0, 0.5, 0.25, 3, {last}a, &guard->age[0], &guard->back[0])",
        f"hand_over(in->b, {last}b)", "hand_over_all(in->c, 3, guard->last.c)",
        "accept_all(in->d, 2, -3.0, at_least(a1, -3.0), param->k, 0.0, 200, guard->last.d,"
        " &guard->age[5], &guard->back[5])",
        "accept(in->e, at_most(-param->k, 8.0), 8.0, 0.5, param->k, 7,"
        f" {last}e, &guard->age[7], &guard->back[7])",
        "accept_all(in->f, 2, 0.0, 1.0, DBL_MAX, 0.0, 0, guard->last.f, &guard->age[8],"
        " &guard->back[8])",
    ]  # fmt: skip
    asked = text.partition("if ((guard->fresh != 0U) && ")[2].partition(") { guard->last = *in;")[0]
    assert asked.split(" && ") == [
        "within(in->a, -1.0, 2.0)", "can_follow(in->a, guard->last.a, 0.25 + 0.5)",
        "within(in->b, -DBL_MAX, DBL_MAX)", "all_within(in->c, 3, -DBL_MAX, DBL_MAX)",
        "all_within(in->d, 2, -3.0, at_least(a1, -3.0))",
        "all_can_follow(in->d, 2, guard->last.d, param->k)",
        "within(in->e, at_most(-param->k, 8.0), 8.0)",
        "can_follow(in->e, guard->last.e, param->k + 0.5)", "all_within(in->f, 2, 0.0, 1.0)",
    ]  # fmt: skip
    assert "const double a1 = 2.0 * param->k;" in text
    assert not Plan(listens).coupled


@step(period=0.01, y=Output("1", "sum", lo=-99, hi=99))
def compares(
    v=Input("1", lo=-9, hi=9),
    w=Input("1", lo="-v", hi="v + k", change="2 * v", noise="k"),
    x=Input("1", shape=(2,), lo="v - k", hi=7, change=1.5),
    k=Param("1", 2.0, lo=0, hi=5),
):
    """Ends of inputs that follow another one."""
    return {}, dict(y=v + w + x[0] + x[1] + k)


def test_ends_that_follow_inputs_are_counted_where_their_last_values_are_known() -> None:
    plan = Plan(compares)
    assert plan.coupled
    lines, ends = plan.ends_text(plan.layout.inputs)
    top = {"lo": "-DBL_MAX", "hi": "DBL_MAX", "change": "DBL_MAX", "noise": "0.0"}
    known = {("v", 0): {"lo": "-9.0", "hi": "9.0"}, ("w", 0): {"noise": "param->k"}}
    known |= {("x", k): {"hi": "7.0", "change": "1.5"} for k in range(2)}
    assert lines == []
    assert ends == {(*m, what): v for m, own in known.items() for what, v in (top | own).items()}
    lines, ends = plan.ends_text(plan.layout.inputs, last=True)
    known["w", 0] |= {"lo": "-guard->last.v", "hi": "guard->last.v + param->k",
                      "change": "2.0 * guard->last.v"}  # fmt: skip
    known |= {("x", k): known["x", k] | {"lo": "at_most(a1, 7.0)"} for k in range(2)}
    assert lines_of(lines) == ["const double a1 = guard->last.v - param->k;"]
    assert ends == {(*m, what): v for m, own in known.items() for what, v in (top | own).items()}


@step(period=0.01, y=Output("1", "sum", lo=-99, hi=99))
def begins(
    x=State("1", "2 + 3", lo=-99, hi=99), z=State("1", 4.0, lo=-9, hi=9),
    u=Input("1", lo=-1, hi=1),
):  # fmt: skip
    """A start that is computed, of no parameter."""
    return dict(x=x + u, z=z), dict(y=x)


@step(period=0.01, y=Output("1", "sum", lo=-99, hi=99))
def begins_by(
    x=State("1", "2 * k", lo=-99, hi=99), u=Input("1", lo=-1, hi=1),
    k=Param("1", 2.0, lo=0, hi=5),
):  # fmt: skip
    """A start that is computed of a parameter."""
    return dict(x=x + u), dict(y=x)


@pytest.mark.parametrize(
    ("block", "own", "given"),
    [
        (begins, ["begins_param safe", "begins_default(&safe)"], "&safe"),
        (begins_by, [], "&defaults"),
    ],
    ids=["without parameters", "of a parameter"],
)
def test_a_start_that_cannot_be_is_that_of_the_defaults(block, own, given) -> None:
    """Without parameters nobody else needs the defaults, so they are made where they are used."""
    plan = Plan(block)
    n, big = block.name, block.name.upper()
    made = " ".join(" ".join(lines_of(source._init(plan))).split())
    tuned = "".join(f"{line}; " for line in [*own, f"(void){n}_tune({given}, state)"])
    assert (
        f"int status = {n}_tune(param, state); bool good = (status == {big}_OK);"
        " if (good) { good = start(&state->in_force, &state->kept, 0); }"
        f" if (!good) {{ {tuned}(void)start(&state->in_force, &state->kept, 0);"
        f" status = {big}_BAD_PARAM; }}"
    ) in made
    reset = " ".join(" ".join(lines_of(guard_functions.recover(plan))).split())
    made = "".join(f"{line}; " for line in [*own, f"(void)start({given}, &state->kept, part)"])
    assert f"if (!start(param, &state->kept, part)) {{ {made}}} return (unsigned int)" in reset
    assert "state->guard.refused = (turn < 3U) ? refused : 0U;" in reset
    assert "int part = (turn <= 2U) ? ((int)turn - 1) : 0;" in reset


@pytest.mark.parametrize(("real", "width"), [("double", 8), ("float", 4)])
def test_measurements_lie_behind_what_is_kept_in_force_and_held(real: str, width: int) -> None:
    """One number each, of which a truth is one byte and leaves a gap behind it."""
    plan = Plan(pair(), real=real, asked=True)
    rows = {(r.struct, f"{r.within}{r.member.c}"): r.offset for r in a2l._rows(plan)}
    measured = ["mean_level", "scaled_y", "scaled_low", "scaled_z", "scaled_share"]
    wanted = {("in", "u"): 0, ("state", "kept.mean_x"): 0, ("out", "y"): 0}
    for k, name in enumerate(measured, start=1):  # behind y, which is among what a tick gives
        wanted["state", f"measured.{name}"] = (3 + k) * width
    assert rows == wanted
    assert header.place_in_state(plan, "measured") == 3 * width
    assert plan.layout.offsets(real) == [k * width for k in range(7)]
    assert plan.layout.kind(plan.layout.signals[3], real) == "bool"


@pytest.mark.parametrize(
    ("real", "most"), [("double", "1.7976931348623157e+308"), ("float", "3.4028234663852886e+38")]
)
def test_without_a_range_a_tool_may_set_any_number_of_the_type(real: str, most: str) -> None:
    @step(period=0.01, y=Output("1", lo=-2, hi=3))
    def some(a=Input("1"), b=Input("1", lo=-7), c=Input("1", hi=5.5), d=Input("1", lo=1, hi=1e300)):
        """Ends of all kinds."""
        return {}, dict(y=a + b + c + d)

    plan = Plan(some, real=real)
    ends = [tuple(a2l._limits(plan, m).split()) for m in plan.layout.inputs]
    largest = "1e300" if real == "double" else most
    assert [(float(lo), float(hi)) for lo, hi in ends] == [
        (-float(most), float(most)), (-7, float(most)), (-float(most), 5.5), (1, float(largest)),
    ]  # fmt: skip


@step(period=0.01, y=Output("1", lo=-99, hi=99))
def kept(
    x=State("1", 0.25, lo=-99, hi=99),
    a=State("1", (1.0, 2.0) * 3, shape=(6,), lo=-9, hi=9),
    b=State("1", (0.0,) * 4, shape=(4,), lo=-9, hi=9), c=State("1", 0.0, lo=0, hi=1),
    d=State("1", (4.0, 5.0), shape=(2,), lo=-9, hi=9),
    e=State("1", "k * 2", lo=0, hi=10), f=State("1", "k * 2 + at", shape=(4,), lo=0, hi=19),
    g=State("1", (7.0,) * 3, shape=(3,), lo=-9, hi=9),
    u=Input("1", lo=-1, hi=1), k=Param("1", 2.0, lo=0, hi=5),
    at=Param("1", (1.0, 2.0, 3.0, 4.0), shape=(4,), lo=0, hi=9),
):  # fmt: skip
    """Starts of all kinds."""
    return dict(x=x + u, a=a * 2, b=b, c=c, d=d, e=e, f=f, g=g), dict(y=x + a[0] + b[1])


def test_states_begin_as_a_struct_of_what_is_not_0_and_then_their_arrays() -> None:
    """In the whole of two each is a struct of its own; alone there is none."""
    two = connect("two", {"p.u": "u", "q.u": "p.y"}, p=kept, q=kept)
    plan = Plan(two, "two")
    assert [name for name, _ in plan.layout.kept] == ["p", "q"]
    for part, own in plan.layout.kept:
        made = lines_of(source._begun(plan, own))
        letter = made[0].split()[2]
        assert made == [
            f"const double {letter} = 2.0 * param->{part}_k;",
            f"state->{part} = (struct two_kept_{part}){{.x = 0.25, .d = {{4.0, 5.0}},"
            f" .e = {letter}}};",
            f"state->{part}_a[0] = 1.0;", f"state->{part}_a[1] = 2.0;",
            f"for (int k = 2; k < 6; ++k) {{ state->{part}_a[k] = state->{part}_a[k - 2]; }}",
            "for (int i = 0; i < 4; ++i) {"
            f" state->{part}_f[i] = {letter} + param->{part}_at[i]; }}",
            f"fill(state->{part}_g, 3, 7.0);",
        ]  # fmt: skip
    alone = Plan(kept)
    assert lines_of(source._begun(alone, alone.layout.states)) == [
        "state->x = 0.25;", "state->a[0] = 1.0;", "state->a[1] = 2.0;",
        "for (int k = 2; k < 6; ++k) { state->a[k] = state->a[k - 2]; }", "fill(state->b, 4, 0.0);",
        "state->c = 0.0;", "state->d[0] = 4.0;", "state->d[1] = 5.0;", "fill(state->g, 3, 7.0);",
        "const double a1 = 2.0 * param->k;", "state->e = a1;",
        "for (int i = 0; i < 4; ++i) { state->f[i] = a1 + param->at[i]; }",
    ]  # fmt: skip


@step(period=0.01, y=Output("1", lo=-99, hi=99))
def of_each(
    x=State("1", "2 * k", lo=-99, hi=99), w=State("1", "k + 1", shape=(3,), lo=-9, hi=9),
    u=Input("1", lo=-1, hi=1), k=Param("1", 2.0, lo=0, hi=5),
):  # fmt: skip
    """A number, and three of which each begins as the first."""
    return dict(x=x + u, w=w * 2), dict(y=x + w[0])


def test_copies_begin_by_their_own_numbers_or_all_by_one() -> None:
    plan = Plan(replicate(of_each, 4, distinct=("k",)), "ctl")
    x, w = ([line for n in plan.start_lines((m,), k, "state->") for line in lines_of([n])]
            for k, m in enumerate(plan.layout.states))  # fmt: skip
    assert x == ["for (int i = 0; i < 4; ++i) { state->x[i] = 2.0 * param->k[i]; }"]
    assert " ".join(" ".join(w).split()) == (
        "for (int i = 0; i < 4; ++i) { const double a1 = param->k[i] + 1.0;"
        " state->w[3 * i] = a1; } for (int k = 1; k < 12; ++k) {"
        " if ((k % 3) != 0) { state->w[k] = state->w[k - 1]; } }"
    )
    plan = Plan(replicate(of_each, 4), "ctl")
    x, w = (lines_of(plan.start_lines((m,), k, "state->"))
            for k, m in enumerate(plan.layout.states))  # fmt: skip
    assert x == ["const double a1 = 2.0 * param->k;", "fill(state->x, 4, a1);"]
    assert w == ["const double a2 = param->k + 1.0;", "fill(state->w, 12, a2);"]


@pytest.mark.parametrize(
    ("period", "ticks", "name"),
    [
        (0.005, 1, "5ms"), (0.001, 5, "5ms"), (2e-4, 1, "200us"), (2e-4, 5, "1ms"),
        (1.1e-3, 1, "1100us"), (0.0125, 1, "12500us"), (3e-7, 1, "every_1"), (None, 7, "every_7"),
        (1e-3 / 3, 3, "1ms"), (1e-3 / 3, 1, "every_1"), (4e-7, 3, "every_3"), (7e-6, 3, "21us"),
    ],
)  # fmt: skip
def test_a_step_for_a_rate_is_called_by_its_whole_time(period, ticks, name) -> None:
    assert rates._rate(SimpleNamespace(period=period), ticks) == name


def test_a_solver_of_casadi_has_no_step_for_each_rate() -> None:
    plan = SimpleNamespace(equations=SimpleNamespace(static=["f"]), block=kept)
    with pytest.raises(BadInput, match="kept has a solver of CasADi, which may fail; leave it out"):
        rates.groups(plan)
