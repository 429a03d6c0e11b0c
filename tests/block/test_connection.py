"""Connecting blocks: what fits is computed in the right order, what does not fit is told."""

import math
import re
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipctl import (
    BadInput,
    Block,
    Input,
    Output,
    Param,
    Scenario,
    State,
    connect,
    every,
    flip_sign,
    law,
    make_block,
    mirror,
    ratio_to_speed,
    sampled,
    simulate,
    speed_to_ratio,
    step,
    unit_delay,
)
from slipctl.block.connection import _part, evaluation_order
from slipctl.models.brakes import brake
from slipctl.models.huang_2020 import subway_braking as subway


def source(unit="1", **options) -> Block:
    """Law with one output y of the given unit and convention."""
    return make_block("source", "law", lambda x, u, p: ({}, {"y": p["k"]}),
                      params=[Param(unit, 2.0).named("k")],
                      outputs=[Output(unit, **options).named("y")])  # fmt: skip


def sink(unit="1", value=None, **options) -> Block:
    """Law that takes u of the given unit and convention, and gives y = 3 u."""
    return make_block("sink", "law", lambda x, u, p: ({}, {"y": 3 * u["u"]}),
                      inputs=[Input(unit, value=value, **options).named("u")],
                      outputs=[Output(unit, **options).named("y")])  # fmt: skip


def tick(period=0.1) -> Block:
    """Step that only says how long a tick is."""
    return step(period=period, name="tick")(lambda: ({}, {}))


# ---- what a wire checks -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("a", "b", "words"),
    [
        (
            "rad/s",
            "m/s",
            r"c: s.y \[rad/s\] cannot feed k.u \[m/s\]; the units differ in dimension",
        ),
        ("kN", "N", r"s.y \[kN\] cannot feed k.u \[N\]; write both in N"),
        ("km/h", "m/s", "write both in m/s"),
        ("deg", "rad", "write both in rad"),
    ],
)
def test_units_must_be_one_unit(a, b, words):
    with pytest.raises(BadInput, match=words):
        connect("c", {"k.u": "s.y"}, s=source(a), k=sink(b))


@pytest.mark.parametrize(("a", "b"), [("N m", "J"), ("1/s", "rad/s"), ("kg m/s^2", "N")])
def test_one_unit_may_be_written_in_two_ways(a, b):
    assert connect("c", {"k.u": "s.y"}, s=source(a), k=sink(b))()["k.y"] == 6.0


@pytest.mark.parametrize("shared", [False, True], ids=["wired", "shared outer input"])
def test_sign_conventions_differ_and_the_adaptor_joins_them(shared):
    """The message names flip_sign; with it the connection works and turns the sign."""
    brakes, drives = {"positive": "braking"}, {"positive": "traction"}
    if shared:  # the part in the middle declares nothing and must not hide the two others
        wires = {"a.u": "T", "b.u": "T", "d.u": "T"}
        parts = {"a": sink("N m"), "b": sink("N m", **brakes), "d": sink("N m", **drives)}
    else:
        wires = {"k.u": "s.y"}
        parts = {"s": source("N m", **brakes), "k": sink("N m", **drives)}
    with pytest.raises(BadInput, match=r"braking, .* for traction; put flip_sign\('N m'\)"):
        connect("c", wires, **parts)
    both = connect("c", {"f.u": "s.y", "k.u": "f.y"}, s=source("N m", **brakes),
                   f=flip_sign("N m", to="traction"), k=sink("N m", **drives))  # fmt: skip
    assert both()["k.y"] == -6.0


@pytest.mark.parametrize(
    ("a", "b", "adaptor", "factor"),
    [("speed", "ratio", speed_to_ratio, 1 / 20), ("ratio", "speed", ratio_to_speed, 20)],
)
def test_slip_conventions_differ_and_the_adaptor_joins_them(a, b, adaptor, factor):
    """Units differ as well, as a rule; two pure numbers are told apart by the convention."""
    unit = {"speed": "m/s", "ratio": "1"}
    with pytest.raises(BadInput, match=f"put {adaptor.__name__}\\(\\) between"):
        connect("c", {"k.u": "s.y"}, s=source("1", per=a), k=sink("1", per=b))
    joined = connect("c", {"f.u": "s.y", "k.u": "f.y"}, s=source(unit[a], per=a), f=adaptor(),
                     k=sink(unit[b], per=b))  # fmt: skip
    assert joined(**{"f.v": 20.0})["k.y"] == pytest.approx(6 * factor, rel=1e-15)


def test_a_shared_outer_input_serves_all_its_parts():
    """It is in every range, and one default is enough."""
    c = connect(
        "c", {"a.u": "T", "b.u": "T"}, a=sink("N", lo=-5, hi=9), b=sink("N", lo=0, value=4.0)
    )
    assert (c.inputs["T"].lo, c.inputs["T"].hi) == (0, 9)
    assert c() == {"a.y": 12.0, "b.y": 12.0}
    assert list(c.inputs) == ["T"]


def test_wires_may_stand_in_any_order():
    """An output of its own, an input of its own, a wire inside: k gives 3 (3 (4 + 2))."""
    wires = {"out": "k.y", "a.u": "T", "k.u": "a.y", "b.u": "T", "made": "s.y"}
    names = list(wires)
    for order in [turned[k:] + turned[:k] for turned in (names, names[::-1]) for k in range(5)]:
        parts = dict(a=sink(), b=sink(), k=sink(), s=source())
        c = connect("c", {n: wires[n] for n in order}, **parts)
        assert list(c.inputs) == ["T"]
        _, inner, free = evaluation_order(c)
        assert (inner, free) == ({("k", "u"): ("a", "y")}, {("a", "u"): "T", ("b", "u"): "T"})
        assert c(T=4.0) == {"a.y": 12.0, "b.y": 12.0, "k.y": 36.0, "s.y": 2.0,
                            "out": 36.0, "made": 2.0}  # fmt: skip


@pytest.mark.parametrize(
    ("wires", "words"),
    [
        ({"k.v": "s.y"}, "c: k has no input 'v'; it has u"),
        ({"k.u": "s.z"}, "c: s has no output 'z'; it has y"),
        ({"q.u": "s.y"}, "c: 'q.u' names no part; it has s, k"),
        ({"k.u": "sk.y"}, "c: 'sk.y' names no part; did you mean"),
        ({"k.u": "s."}, "s has no output ''"),
        ({"T": "y"}, "c: 'y' names no part"),
    ],
)
def test_unknown_ends_of_a_wire_are_named(wires, words):
    with pytest.raises(BadInput, match=words):
        connect("c", wires, s=source(), k=sink())


def test_a_missing_wire_is_an_input_that_must_be_fed():
    """It stays open, the call asks for it, and simulate says what to write."""
    loop = connect("c", {}, a=sink("N"), d=unit_delay("N"), t=tick())
    assert list(loop.inputs) == ["a.u", "d.u"]
    with pytest.raises(BadInput, match=r"c needs the input a.u \[N\]"):
        loop()
    with pytest.raises(BadInput, match=r"c.d.u \[N\] is not fed: .* Scenario\(inputs=\{'d.u'"):
        simulate(loop, Scenario("s", 1.0, inputs={"a.u": 1.0}))


def test_kinds_and_periods_that_do_not_go_together_are_told():
    wheel = subway.wheelset()
    slow = tick(0.3)
    with pytest.raises(BadInput, match=r"a is continuous and b is sampled; .* sampled\(a, h"):
        connect("c", {}, a=wheel, b=tick())
    with pytest.raises(BadInput, match=r"every\(b, 3\)"):
        connect("c", {}, a=tick(), b=slow)
    assert connect("c", {}, a=tick(), b=every(slow, 3)).period == pytest.approx(0.1)
    with pytest.raises(BadInput, match="at least one block"):
        connect("c", {})


# ---- algebraic loops ----------------------------------------------------------------------------


def test_an_algebraic_loop_is_told_by_its_path_and_broken_by_a_delay():
    wires = {"a.u": "b.y", "b.u": "d.y", "d.u": "a.y", "e.u": "a.y"}
    parts = {n: sink() for n in "abde"}
    with pytest.raises(BadInput, match="algebraic loop") as error:
        connect("c", wires, **parts)
    assert hops(str(error.value)) == {("b.y", "a.y"), ("a.y", "d.y"), ("d.y", "b.y")}
    assert "unit_delay()" in str(error.value)
    broken = connect("c", wires | {"d.u": "z.y", "z.u": "a.y"}, z=unit_delay(value=1.0), **parts)
    n, y = broken()
    assert (y["b.y"], y["a.y"], n["z.last"]) == (9.0, 27.0, 27.0)


def test_a_loop_that_closes_through_nested_blocks_is_seen():
    inner = connect("inner", {"a.u": "in", "out": "a.y"}, a=sink(), b=sink())
    with pytest.raises(BadInput, match=r"algebraic loop .*i\.out"):
        connect("c", {"i.in": "k.y", "k.u": "i.out"}, i=inner, k=sink())
    # through the other half of the same block there is no loop
    assert connect("c", {"i.b.u": "k.y", "k.u": "i.out"}, i=inner, k=sink())(**{"i.in": 1.0}) == {
        "i.a.y": 3.0, "i.b.y": 27.0, "i.out": 3.0, "k.y": 9.0,
    }  # fmt: skip


def hops(message: str) -> set[tuple[str, str]]:
    """Pairs of neighbours on the path that a message shows."""
    path = re.findall(r"[\w.]+\.\w+", message.split("algebraic loop ")[1].split(";")[0])
    return set(pairwise(path))


# ---- order of evaluation: random graphs against a reference -------------------------------------


def part(k: int, kind: str, needs: list[list[int]], inputs: int) -> Block:
    """Part whose output i needs the inputs ``needs[i]`` only; its next state needs all of them."""

    def body(x, u, p):
        s = x["s"] if kind == "step" else 0.0
        y = {f"y{i}": output(k, i, s, [u[f"u{j}"] for j in n], ca.sin) for i, n in enumerate(needs)}
        return {n: following(k, [*u.values()], ca.sin) for n in x}, y

    return make_block(
        f"part{k}", kind, body, states=[State("1", 0.1 * k).named("s")] if kind == "step" else [],
        inputs=[Input("1").named(f"u{j}") for j in range(inputs)],
        outputs=[Output("1").named(f"y{i}") for i in range(len(needs))], sx=k % 3 != 2,
    )  # fmt: skip


def output(k, i, s, u, sin):
    return sum((sin(v + j) * (j + 1) for j, v in enumerate(u)), s + 0.3 * k - 0.2 * i)


def following(k, u, sin):
    return sum((sin(v) for v in u), 0.5 * k)


@st.composite
def graphs(draw):
    """Parts with partial feedthrough, wired at random; unwired inputs stay open."""
    parts, wires = [], {}
    for _ in range(draw(st.integers(2, 6))):
        inputs, outputs = draw(st.integers(0, 3)), draw(st.integers(1, 3))
        subset = st.lists(st.integers(0, inputs - 1), unique=True) if inputs else st.just([])
        parts.append(
            (draw(st.sampled_from(["law", "step"])), draw(st.tuples(*[subset] * outputs)), inputs)
        )
    for k, (_, _, inputs) in enumerate(parts):
        for j in range(inputs):
            other = draw(st.none() | st.integers(0, len(parts) - 1))
            if other is not None:
                wires[k, j] = (other, draw(st.integers(0, len(parts[other][1]) - 1)))
    return parts, wires


def reference(parts, wires):
    """Outputs and next states by recursion over wires; raises RecursionError in a loop."""
    opened = {(k, j): 0.1 + 0.01 * (3 * k + j) for k, p in enumerate(parts) for j in range(p[2])}

    def input_(k, j, trail):
        return value(*wires[k, j], trail) if (k, j) in wires else opened[k, j]

    def value(k, i, trail=()):
        if (k, i) in trail:
            raise RecursionError
        kind, needs, _ = parts[k]
        s = 0.1 * k if kind == "step" else 0.0
        return output(k, i, s, [input_(k, j, (*trail, (k, i))) for j in needs[i]], math.sin)

    y = {f"p{k}.y{i}": value(k, i) for k, p in enumerate(parts) for i in range(len(p[1]))}
    n = {f"p{k}.s": following(k, [input_(k, j, ()) for j in range(p[2])], math.sin)
         for k, p in enumerate(parts) if p[0] == "step"}  # fmt: skip
    return n, y, {f"p{k}.u{j}": v for (k, j), v in opened.items() if (k, j) not in wires}


def connected(parts, wires, name="c"):
    blocks = {f"p{k}": part(k, *p) for k, p in enumerate(parts)}
    return connect(name, {f"p{k}.u{j}": f"p{o}.y{i}" for (k, j), (o, i) in wires.items()}, **blocks)


@given(graphs())
def test_random_graphs_are_evaluated_in_the_right_order(graph):
    """Acyclic ones equal the reference; cyclic ones are refused by a path that is really there."""
    parts, wires = graph
    try:
        n, y, opened = reference(parts, wires)
    except RecursionError:
        with pytest.raises(BadInput, match="algebraic loop") as error:
            connected(parts, wires)
        real = {(f"p{o}.y{i}", f"p{k}.y{m}") for (k, j), (o, i) in wires.items()
                for m, needs in enumerate(parts[k][1]) if j in needs}  # fmt: skip
        assert hops(str(error.value)) <= real
        assert hops(str(error.value))
        return
    block = connected(parts, wires)
    assert set(block.inputs) == set(opened)
    result = block(**opened)
    got_n, got_y = ({}, result) if block.kind == "law" else result
    assert got_y == pytest.approx(y, rel=1e-12)  # a few sines of each other
    assert got_n == pytest.approx(n, rel=1e-12)
    np.testing.assert_array_equal(block.dependence(), pattern_of_function(block))


def pattern_of_function(block):
    """Which inputs each output depends on, by CasADi on the function of the whole."""
    return ca.DM(block.f.jac_sparsity(1, 1), 1).full() != 0


@given(graphs(), st.data())
@pytest.mark.second
def test_nesting_changes_nothing(graph, data):
    """Parts put into composites at random, with wires crossing their borders: the same numbers."""
    parts, wires = graph
    try:
        n, y, opened = reference(parts, wires)
    except RecursionError:
        return
    group = [data.draw(st.integers(0, 2)) for _ in parts]
    path = {k: f"g{g}.p{k}" for k, g in enumerate(group)}
    groups = {}
    for g in sorted(set(group)):
        inside = {f"p{k}.u{j}": f"p{o}.y{i}" for (k, j), (o, i) in wires.items()
                  if group[k] == g == group[o]}  # fmt: skip
        members = {f"p{k}": part(k, *p) for k, p in enumerate(parts) if group[k] == g}
        groups[f"g{g}"] = connect(f"g{g}", inside, **members)
    across = {f"{path[k]}.u{j}": f"{path[o]}.y{i}" for (k, j), (o, i) in wires.items()
              if group[k] != group[o]}  # fmt: skip
    block = connect("c", across, **groups)
    full = {f"p{k}": p for k, p in path.items()}
    long = lambda d: {f"{full[m.split('.')[0]]}.{m.split('.')[1]}": v for m, v in d.items()}  # noqa: E731
    result = block(**long(opened))
    got_n, got_y = ({}, result) if block.kind == "law" else result
    assert got_y == pytest.approx(long(y), rel=1e-12)
    assert got_n == pytest.approx(long(n), rel=1e-12)


def test_matrices_and_vectors_cross_wires_and_partial_calls():
    """Elements keep their places; the two blocks need each other's outputs in pieces."""
    whole = Input("1", shape=(2, 3)).named("U")
    box = make_block(
        "box", "step", lambda x, u, p: ({"X": u["U"]}, {"Y": 10 * x["X"], "Z": u["U"].T}),
        states=[State("1", [[1, 2, 3], [4, 5, 6]], shape=(2, 3)).named("X")], inputs=[whole],
        outputs=[Output("1", shape=(2, 3)).named("Y"), Output("1", shape=(3, 2)).named("Z")],
    )  # fmt: skip
    more = make_block("more", "law", lambda x, u, p: ({}, {"Y": u["U"] + 1}), inputs=[whole],
                      outputs=[Output("1", shape=(2, 3)).named("Y")])  # fmt: skip
    both = connect("c", {"box.U": "more.Y", "more.U": "box.Y"}, box=box, more=more)
    fed = connect("c", {"box.U": "more.Y"}, box=box, more=more)
    np.testing.assert_array_equal(fed.dependence(), pattern_of_function(fed))
    assert fed.dependence().any()
    wanted = [[11, 21, 31], [41, 51, 61]]
    for block in (both, every(both, 3)):
        n, y = block()
        assert n["box.X"].tolist() == wanted
        assert y["box.Z"].T.tolist() == wanted
    with pytest.raises(BadInput, match=r"has shape \(3, 2\), more.U takes \(2, 3\)"):
        connect("c", {"more.U": "box.Z"}, box=box, more=more)


# ---- paths: parts, values, swaps ----------------------------------------------------------------


def braked() -> Block:
    """A sampled plant below a slow part below a loop: paths look through sampled and every."""
    plant = sampled(subway.plant(brake=brake(lag=True)), 1e-3)
    slow = every(
        connect("slow", {"k.u": "in", "z.u": "k.y"}, k=sink("m/s"), z=unit_delay("m/s")), 4
    )
    return connect("loop", {"est.in": "plant.wheel.v", "plant.T_cmd": "T"}, plant=plant, est=slow)


@law(mu=Output("1", positive="braking"))
def linear_adhesion(v_s=Input("m/s", positive="braking", per="speed"), k=Param("s/m", 0.1)):
    """mu = k v_s."""
    return k * v_s


def test_swap_by_path_changes_that_part_only():
    """Numbers of the other parts stay, set ones too; the old block is as it was."""
    loop = braked().with_params(
        **{"plant.m": 9000.0, "plant.wheel.v": 11.0, "plant.brake.tau": 0.2}
    )
    other = loop.swap("plant.adh", linear_adhesion).swap("est.k", sink("m/s", value=1.0))
    assert other["plant.adh"].params["k"].value == 0.1
    assert other.param_values()["plant.m"] == 9000.0
    assert other.param_values()["plant.tau"] == 0.2
    assert other.start()["plant.wheel.omega"] == pytest.approx(22.0)
    assert {"plant.adh.c", "plant.adh.k"} & set(loop.params) == {"plant.adh.c"}
    assert other.period == loop.period
    assert dict(other.leaves()).keys() == dict(loop.leaves()).keys()
    assert other["est.k"].inputs["u"].value == 1.0


@pytest.mark.parametrize(
    ("path", "block", "words"),
    [
        ("plant.wheels", linear_adhesion, "plant has no part 'wheels'; did you mean 'wheel'?"),
        ("plant.adh.c", linear_adhesion, "has no part 'c'"),
        ("plnt.adh", linear_adhesion, "loop has no part 'plnt'; did you mean 'plant'?"),
        ("plant.adh", sink("m/s"), "plant: adh has no input 'v_s'"),
        ("plant.adh", law(mu=Output("N"), name="b")(lambda v_s=Input("m/s"): v_s), "cannot feed"),
        ("est.z", sink("N"), r"\[m/s\] cannot feed z.u \[N\]"),
    ],
)  # fmt: skip
def test_swaps_that_do_not_fit_are_refused(path, block, words):
    with pytest.raises(BadInput, match=words):
        braked().swap(path, block)


def test_rail_conditions_come_through_by_full_name():
    assert braked().conditions["wet"] == {
        "plant.adh.c": 0.29,
        "plant.adh.a": 0.54,
        "plant.adh.b": 1.2,
    }


def test_a_part_called_in_pieces_is_not_computed_twice():
    """What is known early costs its own equations only: here one step of a thousand."""

    def body(x, u, p):
        big = ca.Function("big", [a := ca.SX.sym("a")], [ca.sin(a)]).fold(1000)
        return {"s": big(x["s"]) + u["F"]}, {"early": 2 * x["s"], "late": big(x["s"]) + u["F"]}

    slow = make_block(
        "slow", "step", body, states=[State("1").named("s")], inputs=[Input("1").named("F")],
        outputs=[Output("1").named("early"), Output("1").named("late")], sx=False, period=1.0,
    )  # fmt: skip

    early = _part(slow, ["early"])
    assert float(early(3.0, 0.0, [])[1]) == 6
    assert not [k for k in range(early.n_instructions()) if early.instruction_MX(k).is_call()]


def test_a_piece_is_what_the_circle_needs():
    """What only others read, the dear output here, waits for the whole call and is made once."""
    plant = make_block(
        "plant", "step",
        lambda x, u, p: ({"s": x["s"] + u["F"]}, {"early": 2 * x["s"], "dear": ca.sin(x["s"])}),
        states=[State("1", 1.0).named("s")], inputs=[Input("1").named("F")],
        outputs=[Output("1").named("early"), Output("1").named("dear")], sx=False, period=1.0,
    )  # fmt: skip
    ctl = make_block(
        "ctl", "law", lambda x, u, p: ({}, {"F": -u["e"]}),
        inputs=[Input("1").named("e")], outputs=[Output("1").named("F")],
    )  # fmt: skip
    seen = make_block(
        "seen", "law", lambda x, u, p: ({}, {"y": 3 * u["d"]}),
        inputs=[Input("1").named("d")], outputs=[Output("1").named("y")],
    )  # fmt: skip
    wires = {"seen.d": "plant.dear", "ctl.e": "plant.early", "plant.F": "ctl.F"}
    loop = connect("loop", wires, seen=seen, plant=plant, ctl=ctl)
    calls = [loop.f.instruction_MX(k) for k in range(loop.f.n_instructions())]
    called = [c.which_function() for c in calls if c.is_call()]
    assert [f.size1_out(1) for f in called if "part" in f.name()] == [1]
    following, found = loop()
    assert found["seen.y"] == pytest.approx(3 * math.sin(1.0), rel=1e-15)  # sine of two libraries
    assert (found["plant.early"], following["plant.s"]) == (2.0, -1.0)


def test_a_mirror_keeps_the_number_and_changes_the_convention():
    """A driven wheel as a braked one: creep 0.3 m/s is slip 0.3 m/s, where flip_sign says -0.3."""
    seen = mirror("m/s", "braking", "speed")
    turned = flip_sign("m/s", "braking")
    assert seen(u=0.3)["y"] == 0.3
    assert turned(u=0.3)["y"] == -0.3
    assert (seen.inputs["u"].positive, seen.outputs["y"].positive) == ("traction", "braking")
    assert seen.outputs["y"].per == "speed"
