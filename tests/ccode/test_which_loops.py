"""Which Functions are loops: maps and their sums, accumulations, chains, stages."""

from __future__ import annotations

from typing import Any

import casadi as ca
import pytest

from slipctl.ccode.tree import loops, scans
from slipctl.ccode.tree.printer import lines_of
from slipctl.ccode.tree.while_loops import Again, again_lines

x, u, k = ca.MX.sym("x", 2), ca.MX.sym("u", 3), ca.MX.sym("k")
INNER = ca.Function(
    "inner", [x, u, k], [x * k + u[:2], ca.dot(u, u) + k], ["x", "u", "k"], ["n", "c"]
)
OTHER = ca.Function(
    "other", [x, u, k], [x - k * u[:2], ca.dot(u, u) - k], ["x", "u", "k"], ["n", "c"]
)
X, U, K = ca.MX.sym("X", 2, 4), ca.MX.sym("U", 3, 4), ca.MX.sym("K")
KS, Y = ca.MX.sym("KS", 1, 4), ca.MX.sym("Y", 2, 4)
MAP = INNER.map(4)


def told(found: Any) -> Any:
    """What was found with the name in the place of the Function."""
    return found and {
        n: v.name() if isinstance(v, ca.Function) else v for n, v in vars(found).items()
    }


def test_a_map_is_its_function_and_how_often() -> None:
    inner, many = loops.map_body(MAP)
    assert (inner.name(), many) == ("inner", 4)
    only = ca.Function("only", [ca.MX.sym("none", 0), u], [2 * u]).map(6)
    assert loops.map_body(only)[1] == 6


def test_a_map_whose_results_are_summed_is_a_sum_of_arguments_in_any_order() -> None:
    """All of its results, of whole arguments, each where it is; one number may stand for all."""
    n, c = MAP(X, U, ca.repmat(K, 1, 4))
    summed = [ca.repsum(n, 1, 4), ca.repsum(c, 1, 4)]
    found = loops.sums(ca.Function("f", [X, U, K], summed))
    assert told(found) == {"inner": "inner", "count": 4, "sources": (0, 1, 2)}
    turned = loops.sums(ca.Function("f", [K, X, U], summed))
    assert turned is not None
    assert turned.sources == (1, 2, 0)
    own = [ca.repsum(r, 1, 4) for r in MAP(X, U, KS)]
    found = loops.sums(ca.Function("f", [U, KS, X], own))
    assert found is not None
    assert found.sources == (2, 0, 1)
    moved = [ca.repsum(r, 1, 4) for r in MAP(2 * X, U, KS)]
    piece = [ca.repsum(r, 1, 4) for r in MAP(X, U, ca.horzcat(KS[:2], KS[:2]))]
    more = ca.MX.sym("more", 1, 8)
    half = [ca.repsum(r, 1, 4) for r in MAP(X, U, more[:4])]
    twice = [ca.repsum(n, 1, 4), ca.repsum(MAP(X, U, KS)[1], 1, 4)]
    pairs = [ca.repsum(n, 1, 2), ca.repsum(c, 1, 2)]
    given = [X, U, K, KS, more]
    for results in (summed[:1], summed[::-1], [n, summed[1]], [summed[0], c], moved, piece, half,
                    twice, pairs, [*summed, 2 * K], [summed[0], 2 * K]):  # fmt: skip
        assert loops.sums(ca.Function("f", given, results)) is None
    each = [INNER(X[:, 0], U[:, 0], K)[0], INNER(X[:, 0], U[:, 0], K)[1]]
    assert loops.sums(ca.Function("f", [X, U, K], each)) is None


def test_columns_and_what_is_the_same_in_each_of_them() -> None:
    f = ca.Function("f", [X, U, K], MAP(X, U, ca.repmat(K, 1, 4)))
    wanted = {"inner": "inner", "count": 4, "goes_on": False, "arguments": frozenset({2})}
    assert told(loops.shared_columns(f)) == wanted
    one = ca.MX.sym("one", 3)
    f = ca.Function("f", [X, one, KS], MAP(X, ca.repmat(one, 1, 4), KS))
    assert told(loops.shared_columns(f)) == wanted | {"arguments": frozenset({1})}
    begin, columns = ca.MX.sym("begin", 2), ca.MX.sym("V", 3, 12)
    made = INNER.mapaccum(12)(begin, columns, ca.repmat(K, 1, 12))
    f = ca.Function("f", [begin, columns, K], made)
    assert told(loops.shared_columns(f)) == wanted | {"count": 12, "goes_on": True}
    single = ca.Function("single", [x, k], [x * k]).map(4)
    found = loops.shared_columns(ca.Function("f", [X, K], [single(X, ca.repmat(K, 1, 4))]))
    assert told(found) == wanted | {"inner": "single", "arguments": frozenset({1})}
    for arguments, results in (
        ([X, U, KS], MAP(X, U, KS)),  # nothing is the same
        ([U, X, K], MAP(X, U, ca.repmat(K, 1, 4))),
        ([X, U, K], MAP(X, U, ca.repmat(K, 1, 4))[::-1]),
        ([X, U, K], MAP(2 * X, U, ca.repmat(K, 1, 4))),
        ([X, U, K], [MAP(X, U, ca.repmat(K, 1, 4))[0]]),
        ([X, U, K, Y], MAP(X, U, ca.repmat(K, 1, 4))),
    ):  # fmt: skip
        assert loops.shared_columns(ca.Function("f", arguments, list(results))) is None


p, q, r = ca.MX.sym("p", 2), ca.MX.sym("q"), ca.MX.sym("r", 3)
STEP = ca.Function("step", [x, k], [x * k + 1])
BACK = ca.Function("back", [x, k], [x * k - 1])


def chain(*functions: ca.Function, begin: Any = p, by: Any = q) -> Any:
    for f in functions:
        begin = f(begin, by)
    return begin


def test_calls_one_after_the_other_are_a_chain_with_its_number() -> None:
    def found(result: Any, arguments: Any = (p, q)) -> Any:
        chained = loops.call_chain(ca.Function("f", list(arguments), [result]))
        return chained and (chained[0].name(), chained[1])

    assert found(chain(*[STEP] * 3)) == ("step", 3)
    assert found(chain(*[STEP] * 5)) == ("step", 5)
    for result in (chain(STEP, STEP), chain(STEP, BACK, STEP), chain(*[STEP] * 3) + 1,
                   chain(*[STEP] * 3, begin=2 * p), chain(*[STEP] * 3, by=2 * q),
                   chain(*[STEP] * 3, by=p[0]), STEP(chain(STEP, STEP), 3.0)):  # fmt: skip
        assert found(result) is None
    three = chain(STEP, STEP, STEP)
    assert found(three, (q, p)) is None
    assert found(three, (p, q, r)) is None
    assert found(three[0]) is None
    beside = ca.vertcat(chain(STEP, STEP)[0], STEP(p, q)[1])
    assert found(beside) is None


def test_a_function_that_hands_all_on_is_what_it_calls() -> None:
    def found(arguments: list[Any], results: Any) -> Any:
        f = loops.passed_on(ca.Function("f", arguments, list(results)))
        return f and f.name()

    assert found([p, r, q], INNER(p, r, q)) == "inner"
    for arguments, results in (
        ([r, p, q], INNER(p, r, q)), ([p, r, q], INNER(p, r, q)[::-1]),
        ([p, r, q], INNER(p, r, q)[:1]),
        ([p, r, q, u], INNER(p, r, q)), ([p, r, q], INNER(p, r, 2 * q)),
        ([p, r, q], [*INNER(p, r, q), q]), ([p, r, q], [INNER(p, r, q)[0], OTHER(p, r, q)[1]]),
        ([p, r, q], [2 * p, q]),
    ):  # fmt: skip
        assert found(arguments, results) is None


def test_sums_of_the_first_elements_are_those_of_an_addition_alone() -> None:
    z, w = ca.SX.sym("z"), ca.SX.sym("w")
    for result, wanted in ((z + w, True), (w + z, True), (z - w, False), (z + 2 * w, False)):
        f = ca.Function("f", [z, w], [result])
        assert loops.is_running_sum(f.mapaccum(7)) == wanted
        assert not loops.is_running_sum(f)
        assert not loops.is_running_sum(f.fold(7))  # the last one alone


def test_an_accumulation_is_believed_where_all_its_columns_go_on() -> None:
    """Of several numbers in a column, with what all have in common as a column for each."""
    for many in (3, 12, 25):
        inner, count = loops.accumulation_body(INNER.mapaccum(many))
        assert (inner.name(), count) == ("inner", many)
    for f in (INNER.mapaccum(2), INNER, MAP, ca.Function("f", [p, r, q], INNER(p, r, q)),
              ca.Function("f", [p, q], [chain(*[STEP] * 4)])):  # fmt: skip
        assert loops.accumulation_body(f) is None


V = ca.MX.sym("V", 3, 5)
CUT = ca.horzsplit(V)


def stages(columns: list[Any], f: ca.Function = INNER, begin: Any = p, by: Any = q) -> Any:
    """What the last stage gives, and what each gives besides, in the order of the columns."""
    given = []
    for column in columns:
        begin, cost = f(begin, column, by)
        given.append(cost)
    return begin, given


@pytest.mark.parametrize("backward", [False, True])
def test_stages_are_a_loop_in_the_order_of_their_columns(backward: bool) -> None:
    end, costs = stages(CUT[::-1] if backward else CUT)
    costs = costs[::-1] if backward else costs
    found = scans.find_scan(ca.Function("f", [p, q, V], [ca.horzcat(*costs), end]))
    assert found is not None
    assert (found.inner.name(), found.count, found.sources) == ("inner", 5, (0, 2, 1))
    assert (found.carried, found.columns, found.backward) == ({0: 0}, {1}, backward)
    assert (found.last, found.every) == ({0: 1}, {1: 0})
    lines = lines_of(scans.scan_lines(found, "inner", ["p", "q", "V"], ["c", "end"], {"to"}, False))
    order = "int i = 4; i >= 0; --i" if backward else "int i = 0; i < 5; ++i"
    assert lines == [
        "const double *p_now = p;", "double p_other[2];",
        "double *const p_by_turns[2] = {end, p_other};", f"for ({order}) {{",
        "    double *const p_next = p_by_turns[i % 2];",
        "    inner(p_now, &V[3 * i], q, p_next, &c[i]);", "    p_now = p_next;", "}",
    ]  # fmt: skip


def test_of_an_even_number_the_other_array_is_the_first() -> None:
    """So that the last stage writes where its result is wanted; nobody wants the costs."""
    W = ca.MX.sym("W", 3, 4)
    end, _ = stages(ca.horzsplit(W))
    found = scans.find_scan(ca.Function("f", [p, W, q], [end]))
    assert found is not None
    lines = lines_of(scans.scan_lines(found, "f", ["i", "W", "j"], ["to"], {"i_now"}, False))
    assert lines == [
        "const double *i_now_2 = i;", "double i_other[2], c_now;",
        "double *const i_by_turns[2] = {i_other, to};",
        "for (int k = 0; k < 4; ++k) {", "    double *const i_next = i_by_turns[k % 2];",
        "    f(i_now_2, &W[3 * k], j, i_next, &c_now);", "    i_now_2 = i_next;", "}",
    ]  # fmt: skip


def test_what_all_stages_give_is_handed_on_from_its_columns() -> None:
    """The last column besides, which is copied; a number by its address."""
    states, now = [], p
    for column in CUT:
        now, cost = INNER(now, column, q)
        states.append(now)
    results = [now, ca.horzcat(*states), cost]
    found = scans.find_scan(ca.Function("f", [p, V, q], results))
    assert found is not None
    assert (found.last, found.every) == ({0: 0, 1: 2}, {0: 1})
    lines = lines_of(
        scans.scan_lines(found, "f", ["p", "V", "q"], ["end", "all", "c"], set(), False)
    )
    assert lines == [
        "const double *p_now = p;", "for (int i = 0; i < 5; ++i) {",
        "    f(p_now, &V[3 * i], q, &all[2 * i], c);", "    p_now = &all[2 * i];", "}",
        "copy(end, &all[8], 2);",
    ]  # fmt: skip


def test_a_number_that_is_carried_goes_by_value() -> None:
    a, b = ca.MX.sym("a"), ca.MX.sym("b")
    f = ca.Function("f", [a, b], [a * b, a - b], ["a", "b"], ["n", "d"])
    R = ca.MX.sym("R", 1, 6)
    now, each = q, []
    for column in ca.horzsplit(R):
        now, d = f(now, column)
        each.append(d)
    found = scans.find_scan(ca.Function("g", [q, R], [now, ca.horzcat(*each), each[-1]]))
    assert found is not None
    assert lines_of(scans.scan_lines(found, "f", ["q", "R"], ["n", "d", "l"], set(), False)) == [
        "double q_now = q;", "for (int i = 0; i < 6; ++i) {", "    double q_next;",
        "    f(q_now, R[i], &q_next, &d[i]);", "    q_now = q_next;", "}", "*n = q_now;",
        "*l = d[5];",
    ]  # fmt: skip


@pytest.mark.parametrize(
    "results",
    [
        [stages([CUT[0], CUT[2], CUT[1], *CUT[3:]])[0]], [stages(CUT[:4])[0]],
        [stages([*CUT[:4], CUT[3]])[0]], [stages(CUT, by=2 * q)[0]], [stages(CUT, begin=2 * p)[0]],
        [stages(CUT[1:], begin=OTHER(p, CUT[0], q)[0])[0]], [stages(CUT)[0] + 1],
        [stages(CUT)[0], stages(CUT)[1][2]], [ca.horzcat(*stages(CUT)[1][::-1])],
        [p, stages(CUT)[0]],
        [stages([CUT[0]])[0]],
    ],
    ids=["order", "too few", "one twice", "not given", "begin", "another", "more", "in the middle",
         "turned", "given back", "once"],
)  # fmt: skip
def test_what_is_not_stage_by_stage_is_no_loop(results: list[Any]) -> None:
    assert scans.find_scan(ca.Function("f", [p, V, q], results)) is None


@pytest.mark.parametrize("begun", [False, True])
def test_what_is_done_again_ends_where_its_number_says_so(begun: bool) -> None:
    """It is asked before each call, or before each but the first."""
    found = Again(INNER, 7, 1, begun)
    lines = lines_of(again_lines(found, "more", ["z", "", "k"], "out", {"latest", "to_2"}))
    over = "(i > 0) && !(latest_2[1] > 0.0)" if begun else "!(latest_2[1] > 0.0)"
    assert [line.strip() for line in " ".join(lines).replace("{ break; }", "").split(";")] == [
        "double other[2]", "double *const by_turns[2] = {out, other}", "const double *latest_2 = z",
        "for (int i = 0", "i < 7",
        f"++i) {{     if ({over})      double *const to = by_turns[i % 2]",
        "more(latest_2, k, to)", "latest_2 = to",
        "} if (latest_2 != out) { copy(out, latest_2, 2)", "}",
    ]  # fmt: skip


def test_what_is_repeated_is_not_looked_into_and_may_give_its_last_result_alone() -> None:
    around = ca.Function("around", [p, r, q], INNER(p, r, q))
    for many in (4, 13):
        inner, count = loops.accumulation_body(around.mapaccum(many))
        assert (inner.name(), count) == ("around", many)
        inner, count = loops.accumulation_body(STEP.fold(many))
        assert (inner.name(), count) == ("step", many)


LATE = ca.Function("late", [k, ca.MX.sym("none", 0), u, x], [ca.dot(u, u) - k, x * k + u[1:]])


def test_arguments_and_results_of_a_stage_may_stand_in_any_order() -> None:
    """One without numbers besides; the second result is the fourth argument of the next stage."""
    now, costs = p, []
    for column in CUT:
        cost, now = LATE(q, ca.MX(0, 1), column, now)
        costs.append(cost)
    found = scans.find_scan(ca.Function("f", [V, p, q], [now, ca.horzcat(*costs)]))
    assert found is not None
    assert (found.sources, found.carried, found.columns) == ((2, -1, 0, 1), {3: 1}, {2})
    assert (found.last, found.every) == ({1: 0}, {0: 1})
    lines = lines_of(scans.scan_lines(found, "f", ["V", "p", "q"], ["end", "c"], set(), False))
    assert lines[4:6] == [
        "    double *const p_next = p_by_turns[i % 2];",
        "    f(q, &V[3 * i], p_now, &c[i], p_next);",
    ]


def test_stages_in_functions_of_some_of_them_are_one_loop() -> None:
    """Three calls of a Function of two stages, whose arguments stand in another order."""
    pair = ca.MX.sym("pair", 3, 2)
    end, costs = stages(ca.horzsplit(pair), begin=x, by=k)
    two = ca.Function("two", [k, pair, x], [ca.horzcat(*costs), end])
    W = ca.MX.sym("W", 3, 6)
    now, each = p, []
    for columns in ca.horzsplit(W, 2):
        cost, now = two(q, columns, now)
        each.append(cost)
    found = scans.find_scan(ca.Function("f", [q, W, p], [now, ca.horzcat(*each)]))
    assert found is not None
    assert (found.inner.name(), found.count, found.backward) == ("inner", 6, False)
    assert (found.sources, found.carried, found.columns) == ((2, 1, 0), {0: 0}, {1})
    assert (found.last, found.every) == ({0: 0}, {1: 1})
    mixed = ca.Function("g", [q, W, p], [now, ca.horzcat(each[1], each[0], each[2])])
    assert scans.find_scan(mixed) is None
