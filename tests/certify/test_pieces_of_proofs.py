"""Pieces of proofs whose fault would be unsound: what leaves a range, and a function that falls."""

from __future__ import annotations

import math
from decimal import Decimal, localcontext
from fractions import Fraction
from itertools import permutations
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipctl.certify import margins, proofs, smtlib
from slipctl.certify.arithmetic.interval_arrays import Boxes
from slipctl.certify.arithmetic.whole_boxes import ONE, WholeBoxes
from slipctl.certify.bounds import linear_kind
from slipctl.certify.cells import mode_cells, mode_proofs, mode_runs
from slipctl.certify.cells.mode_cells import ModeLoop
from slipctl.certify.entries import DoesNotHold
from slipctl.certify.promise import INPUT, TARGET, Number, System, exact_numbers
from slipctl.certify.smooth import linear_runs, tube
from slipctl.certify.smooth.sampled_loop import Nominal, boxes, remainders
from slipctl.certify.smooth.sums import Bounds
from slipctl.certify.ticks.tick_code import TickCode, code_of_function
from slipctl.certify.ticks.tick_sets import Loop
from slipctl.errors import BadInput
from slipctl.models.cheng_2022.certificate import dither, dither_push, dither_search, dithering_kind
from slipctl.models.vehicle.certificate import own_gains

F = Fraction


@pytest.mark.parametrize("kind", [Boxes, WholeBoxes])
@pytest.mark.parametrize("order", [("any", "b", "c"), ("c", "any", "b"), ("b", "c", "any")])
def test_a_further_output_that_leaves_its_range_is_found_whatever_stands_before(kind, order):
    """One without a range never does; ends belong to the range."""
    ranges = {"any": None, "b": (F(0), F(1)), "c": (F(-2), F(2))}
    loop = SimpleNamespace(kept={n: ranges[n] for n in order})

    def left(**ends):
        boxes = {n: (-9.0, 9.0) if n == "any" else ends.get(n, (0.0, 1.0)) for n in order}
        kept = {n: [kind.of_ends(np.array([0.5, a]), np.array([0.5, b]))]
                for n, (a, b) in boxes.items()}  # fmt: skip
        return ModeLoop.left(loop, SimpleNamespace(kept=kept))

    assert left() == ""
    assert left(c=(-2.0, 2.0)) == ""
    assert left(b=(0.0, 1.25)) == "b"
    assert left(b=(-0.25, 1.0)) == "b"
    assert left(c=(-2.0, 2.5)) == "c"
    assert left(c=(-3.0, 3.0)) == "c"


@given(st.floats(0.05, 0.9), st.floats(0.2, 4))
def test_the_quadratic_function_behind_a_lag_falls(share, lags):
    """At both ends of what exp(-T/lag) may be: A'PA - P is negative, with P as it is written."""
    T, lag = F("0.01"), F(f"{0.01 * lags:.4f}")
    K = F(f"{share * 2 / (0.01 + 2 * float(lag)):.3f}")
    told = []

    def noted(A, P, strict, ends):
        told.append((A, P, ends))
        return ""

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(smtlib, "shrinks", noted)
        patch.setattr(smtlib, "times", lambda a, b: (b if isinstance(b, tuple) else ("E",), a))
        patch.setattr(smtlib, "sum_term", lambda a, b: ("sum", a, b))
        linear_kind._lag_step({"K": K, "T": T, "lag": lag}, {})
    (_, P, (low, high)) = told[0]
    with localcontext(prec=40):  # to more digits than the ends have
        ratio = -T / lag
        assert low <= Fraction((Decimal(ratio.numerator) / ratio.denominator).exp()) <= high
    assert 0 < high - low < F(1, 10**14)
    P = np.array([[P[0], P[1]], [P[1], P[2]]], float)
    E = math.exp(-T / lag)
    k, t, g = float(K), float(T), float(lag)
    A = np.array([[1 - k * (t - g * (1 - E)), g / t * (1 - E)], [-k * t * (1 - E), E]])
    assert (np.linalg.eigvalsh(P) > 0).all()
    assert (np.linalg.eigvalsh(A.T @ P @ A - P) < 0).all()
    assert (np.linalg.eigvalsh(A.T @ P @ A - P) < -0.99).all()  # minus one by construction


@pytest.mark.parametrize("noise", ["0.0002355", "0.00004", "0.0000001"])
def test_a_run_under_the_worst_noise_lies_between_both_bounds(noise):
    """The seeker's own equations, without dimensions: from its orbit to the last push."""
    n = {"k": F("0.941"), "w": F("1.385"), "w_l": F("0.1262"), "w_h": F("0.148"),
         "a": F("0.2151"), "curvature": F("-0.6474"), "T": F("0.1815"), "noise": F(noise),
         "start": F("0.04556")}  # fmt: skip
    loop = dithering_kind._plain(n)
    found = dither_search.find(dithering_kind._loop(n), 0.05)
    quiet = dither.check_proof(dithering_kind._loop({**n, "noise": F(0)}), found.proof)
    push = dither_push.find(loop, found)
    least, most = dither_push.at_least(loop, found, quiet, push), dither_push.at_most(loop, found)
    x = z = e = 0.0
    far = []
    for k in range(4000 + len(push.signs)):
        i = k - 4000
        up = push.signs[i] if i >= 0 else k % 2 == 0
        strength = loop.noise if i >= 0 else 0.0
        s = math.sin(push.angle + i * loop.W)
        H = (x + s) ** 2 / 2 - x * x / 2 - e + (strength if up else -strength)
        x, z, e = (x - loop.W * loop.q * z, z + loop.W * loop.l * (s * H - z),
                   e + loop.W * (loop.h * H + loop.q * x * z
                                 - loop.q**2 * loop.W * z * z / 2))  # fmt: skip
        far.append(abs(x))
    assert least <= far[-1] * (1 + 1e-6)
    assert max(far[3000:]) <= most
    assert most < 2 * max(far[3000:])
    if noise == "0.0000001":  # hardly any: both are what the orbit itself swings by
        assert most < 1.5 * max(far[3000:4000])
    if least > 0:
        assert least > 0.8 * far[-1]


@given(st.lists(st.integers(-40, 40), min_size=1, max_size=30))
def test_distinct_numbers_are_in_order_and_each_finds_its_own(values):
    given_ = np.array(values)
    found, of = mode_cells._distinct(given_)
    assert list(found) == sorted(set(values))
    assert list(found[of]) == values


def test_what_a_law_is_told_moves_the_slip_as_it_is_told():
    """D and F say the same: the force slows the rim less and the vehicle by F/m."""
    numbers = {"J": 110.0, "r": 0.42, "m": 9000.0}
    for D, wrong in ((1.5, 0.0), (1.5, 0.25), (-2.0, 0.5)):
        told = {n: float(v) for n, v in own_gains.telling(D=D, wrong=wrong, **numbers).items()}
        assert told["D_told"] == D + wrong
        F = told["F_told"]
        assert F * numbers["r"] ** 2 / numbers["J"] + F / numbers["m"] == pytest.approx(D + wrong)
        still = (D + wrong) * numbers["J"] / numbers["r"]  # the torque that holds the slip
        rises = own_gains.rising(T=still, D=D + wrong, J=numbers["J"], r=numbers["r"])["rises"]
        assert float(rises) == pytest.approx(0, abs=1e-12)
        more = own_gains.rising(T=still + 100, D=D + wrong, J=numbers["J"], r=numbers["r"])
        assert float(more["rises"]) == pytest.approx(100 * numbers["r"] / numbers["J"])


@given(st.floats(-25, 25))
def test_a_logarithm_in_whole_numbers_is_that_of_decimals(x):
    value = F(math.exp(x))
    found = WholeBoxes.of_ends(np.array([float(value)]), np.array([float(value)])).ln()
    with localcontext() as context:
        context.prec = 60
        true = (Decimal(value.numerator) / Decimal(value.denominator)).ln() * ONE
    low, high = int(found.low[0]), int(found.high[0])
    assert low <= true <= high
    assert high - low <= ONE // 10**9


# ---- searches ------------------------------------------------------------------------------------


def searched(monkeypatch, found, bounds, sizes=4, work=900):
    """Grids that a search tries, of such as cost 1 each; what it says."""
    loop = SimpleNamespace(reals=("e",), watched=("e",), sizes=())
    runs = SimpleNamespace(low=np.zeros(1), high=np.ones(1))
    tried = []

    def grown(loop, bounds, runs, sizes, left):
        tried.append(len(tried))
        one = found[tried[-1]]
        if isinstance(one, Exception):
            raise one
        reach, price = one
        left.left -= price
        return SimpleNamespace(reach=SimpleNamespace(high={"e": reach}), runs=runs)

    monkeypatch.setattr(mode_proofs, "CELLS", {1: tuple(range(1, sizes + 1))})
    monkeypatch.setattr(mode_proofs, "_spans", lambda *given: [np.ones(1)])
    monkeypatch.setattr(mode_proofs, "_grown", grown)
    try:
        return tried, mode_proofs.find_cells(loop, bounds, runs, work).reach.high["e"]
    except mode_proofs.NoProof as error:
        return tried, str(error)


def test_a_grid_that_fails_ends_no_search_and_the_first_reason_is_told(monkeypatch):
    bound = {"e": (None, F(5))}
    fails = [mode_proofs.NoProof("first"), ArithmeticError("second")]
    assert searched(monkeypatch, [*fails, (4.0, 1)], bound) == ([0, 1, 2], 4.0)
    assert searched(monkeypatch, [*fails, *fails], bound) == ([0, 1, 2, 3], "first")


def test_finer_grids_are_tried_as_long_as_they_are_worth_it(monkeypatch):
    """Where nothing is bounded: while they gain, and while there is work left for three more."""
    free = {"e": (None, None)}
    assert searched(monkeypatch, [(4.0, 1)] * 4, {"e": (F(-9), F(9))}) == ([0], 4.0)
    gains = [(4.0, 1), (3.0, 1), (2.0, 1), (1.5, 1)]
    assert searched(monkeypatch, gains, free) == ([0, 1, 2, 3], 1.5)
    assert searched(monkeypatch, [(4.0, 1), (3.99, 1), (2.0, 1)], free) == ([0, 1], 3.99)
    assert searched(monkeypatch, [(4.0, 300), (3.0, 1)], free) == ([0], 4.0)


@pytest.mark.parametrize("names", [("beside", "e"), ("e", "beside")])
def test_what_a_run_leaves_is_not_looked_for_whatever_else_is_bounded(monkeypatch, names):
    """A further output is bounded too, before or behind it."""
    bounds = {n: (None, F(1, 2)) for n in names}
    assert searched(monkeypatch, [(4.0, 1)], bounds) == ([], "a run comes to e = 1")


def test_a_run_that_is_over_does_not_come_back():
    """1/0 is infinite, and 1/infinity would be a number again."""
    steps = (("const", F(1)), ("div", 1, 0), ("const", F(5)), ("sub", 2, 3))
    code = TickCode(("x_e",), steps, {"e": 4})
    loop = ModeLoop(code, ("e",), (), ((F(0), F(0)),), (), {}, ("e",))
    found = mode_runs.worst_runs(loop, 6)
    assert (found.low[0], found.high[0]) == (0.0, 0.0)
    assert not found.visited


@pytest.mark.parametrize("back", [0.0, 3.0])
def test_a_run_through_infinity_leaves_no_bound(back):
    """Of a loop that is linear at rest, and far off it no number, and then one again."""

    def step(x, d):
        value = 0.9 * x[0] + d[0]
        if abs(value) > 1:
            value = math.inf if math.isfinite(x[0]) and x[0] < 5 else back
        return [back if math.isinf(x[0]) else value]

    sizes = ([0.0], [0.5])
    assert linear_runs.summed_run(step, [0.0], sizes, 0, 2.0, [40]) is None
    first, pushes = linear_runs.summed_run(step, [0.0], sizes, 0, 0.9, [40, 10])
    x = [0.0]
    for sign in pushes:
        x = step(x, [float(0.5 * s) for s in sign])
    assert 0.9 < abs(x[0]) <= 1
    assert len(first) == 1


@pytest.mark.parametrize("order", list(permutations(["none", "fails", "leaves", "of another"])))
def test_a_search_that_finds_no_run_ends_no_search_for_a_counterexample(monkeypatch, order):
    """The first run that leaves is told, whatever was searched before it."""

    def replay(numbers, found):
        if found["by"] == "fails":
            raise DoesNotHold("no")
        return f"shown by {found['by']}"

    def refuter(name):
        target = "other" if name == "of another" else "stays"
        found = None if name == "none" else {"by": name}
        return SimpleNamespace(target=target, replay=replay, quick=None, find=lambda n: found)

    monkeypatch.setattr(proofs, "trusted_criteria", lambda system, numbers: {})
    monkeypatch.setattr(proofs, "refuters", lambda system: {n: refuter(n) for n in order})
    system = SimpleNamespace(inputs=lambda n: set(), clauses=lambda n: {"stays": 1, "other": 2})
    found, shows = proofs.counterexample(system, {}, ["stays"])
    assert (found["by"], found["clause"], shows) == ("leaves", "stays", "shown by leaves")
    assert proofs.counterexample(system, {}, ["stays"], quick=True) == (None, "")


@pytest.mark.parametrize("every", [False, True])
def test_a_clause_is_proved_by_the_first_criterion_that_does_unless_all_are_asked(
    monkeypatch, every
):
    """A criterion without a proof ends nothing; each is tried once."""
    tried = []
    criteria = {n: SimpleNamespace(proves=["a", "b"], covers=["w"], name=n) for n in "xyz"}
    monkeypatch.setattr(proofs, "trusted_criteria", lambda system, numbers: criteria)
    monkeypatch.setattr(proofs, "counterexample", lambda *given, **named: (None, ""))
    monkeypatch.setattr(proofs, "promise_of_system", lambda system, numbers, by: sorted(by))
    monkeypatch.setattr(
        proofs, "_try",
        lambda c, numbers: tried.append(c.name) or (None if c.name == "x" else {"by": c.name}),
    )  # fmt: skip
    system = SimpleNamespace(inputs=lambda n: {"w"}, clauses=lambda n: {"a": 1, "b": 2})
    found = proofs.decide(system, {}, every)
    assert (found.verdict, found.promise) == ("CERTIFIED", ["a", "b"])
    assert list(found.proofs) == tried[1:] == (["y", "z"] if every else ["y"])


def test_the_run_of_an_unstable_loop_behind_a_lag_ends_where_it_is_far():
    n = {"K": 300.0, "lag": 0.01, "T": 0.01}
    witness = linear_kind._lag_witness(n)
    e = np.abs(witness.trajectory["e"][1])
    assert e[-1] > 1e6 >= e[:-1].max()
    steady = linear_kind._lag_witness(n | {"K": 1.0})
    assert len(steady.trajectory["e"][1]) > 1000


@pytest.mark.parametrize("bounded", [False, True])
def test_a_run_beyond_its_bound_ends_the_search_for_a_farther_one(bounded):
    """e adds up what pushes: the first runs are far beyond 1."""
    code = TickCode(("x_e", "d_w"), (("add", 0, 1),), {"e": 2})
    loop = ModeLoop(code, ("e",), (), ((F(0), F(0)),), (), {"w": (F(-1), F(1))}, ("e",))
    bounds = {"e": (F(-1), F(1))} if bounded else None
    found = mode_runs.worst_runs(loop, 5, bounds=bounds)
    assert found.ended is bounded
    generations = 1 + 1 if bounded else mode_runs.GENERATIONS + 2
    assert len(found.visited) == 5 * generations
    assert all(found.worst["e", side][0] * side > 1 for side in (-1, 1))


OPTIONAL = [("told", F(1, 2)), ("optional", None), ("default", 0.25)]


@pytest.mark.parametrize("order", list(permutations(OPTIONAL)))
def test_a_number_that_is_not_told_hides_none_behind_it(monkeypatch, order):
    """One that may be left out, wherever it stands, in a file and in what is asked."""
    kinds = {"told": Number("1", ""), "optional": Number("1", "", optional=True),
             "default": Number("m", "", 0.25)}  # fmt: skip
    system = SimpleNamespace(name="own", numbers={n: kinds[n] for n, _ in order},
                             guard=lambda numbers: None)  # fmt: skip
    wanted = {"told": F(1, 2), "default": F(1, 4)}
    assert exact_numbers(system, {"told": F(1, 2)}) == wanted
    entries = {"told": {"value": "1/2", "unit": "1"}, "default": {"value": "1/4", "unit": "m"}}
    assert proofs._numbers(system, {n: entries[n] for n, _ in order if n in entries}) == wanted
    with pytest.raises(BadInput, match=r"asked\.default is missing"):
        proofs._numbers(system, {"told": entries["told"]})


@given(st.floats(-6, 6), st.floats(-4, 4), st.booleans())
def test_the_end_of_what_holds_is_found_from_either_side(edge, off, up):
    """The edge itself holds; a value is on its side or up to 1e4 beyond it."""
    edge, value = 10.0**edge, 10.0 ** (edge + off)
    holds = (lambda x: x <= edge) if up else (lambda x: x >= edge)
    assert margins.end(holds, value, up) == edge
    assert margins.end(lambda x: holds(-x), -value, not up) == -edge
    assert margins.end(lambda x: False, value, up) is None
    assert margins.end(lambda x: True, value, up) == (math.inf if up else 0.0)


@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_a_verdict_that_goes_by_the_unit_is_found_on_any_panel(order):
    """One whose numbers are not all there says nothing."""
    panel = [{"a": 1.0}, {"a": 1e9, "b": 1.0}, {"a": 1.0, "b": 1.0}]
    criterion = SimpleNamespace(sides=1, needs=("a", "b"), holds=lambda n: n["a"] < 10 * n["b"])
    number = {"a": SimpleNamespace(value=None, power=1), "b": SimpleNamespace(value=None, power=0)}
    system = SimpleNamespace(criteria={"c": criterion}, numbers=number,
                             panel=[panel[k] for k in order])  # fmt: skip
    assert margins.unit_dependent(system, "c")
    number["b"].power = 1
    assert not margins.unit_dependent(system, "c")


@pytest.mark.parametrize("order", [("a", "e"), ("e", "a")])
def test_what_a_tick_adds_is_that_of_every_state_that_may_move(order):
    """One that stands still hides none behind it: row by row, against the tick at the ends."""

    def tick(n, x, d):
        return {"a": x["a"] / 2, "e": x["e"] / 2 + x["e"] * x["e"] / 4 + d["w"]}

    numbers = {"e0": Number("1", "", 0.5), "none": Number("1", "", 0.0, "not negative"),
               "W": Number("1", "", 0.25, role=INPUT, says="{}"),
               "band": Number("1", "", optional=True, role=TARGET)}  # fmt: skip
    start = {"a": "none", "e": "e0"}
    loop = Loop(tick, {s: start[s] for s in order}, {"w": "W"}, {"e": "band"})
    made = System("own", "", numbers, {}, loop.targets(), loop.says_start(), loop=loop)
    sampled, cell, _ = made.loop.sampled(exact_numbers(made, {}))
    box, w = [F(1, 2) if s == "e" else F(0) for s in sampled.states], F(1, 4)
    found = remainders(sampled, cell, Nominal({}, {}), box, [w], boxes)
    by_name = dict(zip(sampled.states, found, strict=True))
    assert by_name["a"] == (0, 0)
    low, high = by_name["e"]
    assert low <= -F(1, 4) - w
    assert high >= F(1, 4) + F(1, 16) + w
    assert -2 < low < high < 2


@pytest.mark.parametrize("still", [(), (0,), (1,), (0, 1)])
def test_a_tube_is_as_wide_as_what_is_added_to_any_of_its_states(still):
    """Of a loop that forgets at once: in each tick what that tick adds."""
    added = [[(F(0), F(0)) if k in still else (F(-1), F(3)) for k in range(3)]] * 2
    bounds, unit = Bounds((), (F(0),) * 3), [F(1)] * 3
    half, middle, bits = tube._paths({}, {}, 3, [0, 2, 5], added, bounds, unit)
    for k in range(3):
        wide, at = ((0.0, 0.0), (2.0, 1.0))[k not in still]
        found = [F(int(h), 1 << bits) for h in half[1:, k]]
        assert min(found) >= wide
        assert [float(h) for h in found] == pytest.approx([wide] * 5, abs=1e-3)
        assert [float(F(int(m), 1 << bits)) for m in middle[1:, k]] == pytest.approx([at] * 5)


def test_every_output_of_a_function_is_read():
    """A column of several, whatever stands between them."""
    x = ca.SX.sym("x", 2)
    f = ca.Function("f", [x], [ca.vertcat(x[0] + x[1], 7, x[0] * x[1], x[1] - x[0])])
    code = code_of_function(f, ("a", "b"), ("sum", "seven", "product", "difference"))
    assert list(code.outputs) == ["sum", "seven", "product", "difference"]
    assert code.compiled()(2.0, 5.0) == (7.0, 7.0, 10.0, 3.0)
