"""Steps of proofs as terms: read here with rationals, at states that the system's own ticks give.

A small reader of terms stands below. Facts have to hold at what a tick does, and not beside it. The
claim has to be true exactly where the step is.
"""

from __future__ import annotations

import math
import operator
import random
import re
from fractions import Fraction
from functools import reduce
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from slipctl.certify import boundary, registry, smtlib
from slipctl.certify.arithmetic.decimal_intervals import Interval
from slipctl.certify.entries import DoesNotHold
from slipctl.certify.promise import (
    CERTIFIED,
    REFUTED,
    UNDECIDED,
    Criterion,
    Evidence,
)
from slipctl.certify.systems import Side
from slipctl.errors import BadInput
from slipctl.models.cheng_2022.certificate.ball import Ball
from slipctl.models.huang_2020.certificate import relay_proof, rls_kind
from slipctl.models.huang_2020.certificate.relay_sets import Absorbing, Relay
from slipctl.models.zhang_2021.certificate import filter_kind

F = Fraction


def parsed(text):
    """Terms of a text, as lists of words."""
    stack = [[]]
    for word in re.findall(r"[()]|[^()\s]+", text):
        if word == "(":
            stack.append([])
        elif word == ")":
            done = stack.pop()
            stack[-1].append(done)
        else:
            stack[-1].append(word)
    assert len(stack) == 1
    return stack[0]


CHAINED = {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge,
           "=": operator.eq}  # fmt: skip


def value(term, at):
    """Value of a term where its variables have values."""
    if isinstance(term, str):
        return at[term] if term in at else F(term)
    name, *parts = term
    parts = [value(p, at) for p in parts]
    if name in CHAINED:
        return all(CHAINED[name](a, b) for a, b in pairwise(parts))
    if name == "-":
        return -parts[0] if len(parts) == 1 else reduce(operator.sub, parts)
    whole = {"+": sum, "*": math.prod, "/": lambda p: reduce(operator.truediv, p), "and": all,
             "or": any, "not": lambda p: not p[0]}  # fmt: skip
    return whole[name](parts)


def read(text):
    """Logic, variables, facts and claims of a problem; each claim is asked by itself."""
    logic, names, facts, claims, deep = None, [], [], [], 0
    rows = parsed(text)
    for row, after in zip(rows, [*rows[1:], None], strict=True):
        match row:
            case ["set-logic", logic]:
                pass
            case ["declare-const", name, "Real"]:
                names.append(name)
            case ["assert", ["not", claim]] if after == ["check-sat"]:
                claims.append((claim, deep))
            case ["assert", fact]:
                assert not claims
                facts.append(fact)
            case ["push"]:
                deep += 1
            case ["pop"]:
                deep -= 1
            case ["check-sat"]:
                assert len(claims) > 0
            case _:
                raise AssertionError(row)
    assert deep == 0
    assert {d for _, d in claims} == ({1} if len(claims) > 1 else {0})
    assert text.count("(check-sat)") == len(claims)
    return logic, names, facts, [claim for claim, _ in claims]


def test_numbers_and_terms_are_read_as_they_were_written():
    for x in (F(0), F(3), F(-3), F(2, 7), F(-22, 7), 5):
        (term,) = parsed(smtlib.number(x))
        assert value(term, {}) == x
    at = {"a": F(2), "b": F(-3, 2)}
    for text, true in (
        (smtlib.term("<", "a", 3), True), (smtlib.term("<", 2, "a"), False),
        (smtlib.sum_term("a", "b", F(1, 2)), 1), (smtlib.sum_term("b"), F(-3, 2)),
        (smtlib.sum_term(F(1, 2)), F(1, 2)), (smtlib.times("a", "b", F(1, 3)), -1),
        (smtlib.term("-", "a", "b"), F(7, 2)),
    ):  # fmt: skip
        (term,) = parsed(text)
        assert value(term, at) == true
    for b, within in ((F(-2), True), (F(-3), False), (F(1), True), (F(2), False)):
        ends = [parsed(t)[0] for t in smtlib.interval_terms(F(-2), "b", F(1))]
        assert all(value(t, {"b": b}) for t in ends) == within


def test_a_problem_asks_each_claim_by_itself():
    logic, names, facts, claims = read(smtlib.problem(("x", "y"), ["(< x 1.0)", "(< 0.0 y)"], "c"))
    assert (logic, names, claims) == ("QF_NRA", ["x", "y"], ["c"])
    assert facts == [["<", "x", "1.0"], ["<", "0.0", "y"]]
    logic, names, facts, claims = read(smtlib.problem(("x",), ["f"], ["c", "d", "e"], "QF_LRA"))
    assert (logic, names, facts, claims) == ("QF_LRA", ["x"], ["f"], ["c", "d", "e"])
    assert read(smtlib.problem(("x",), [], ["c"]))[2:] == ([], ["c"])


def test_a_script_asks_every_problem_from_an_empty_state():
    problems = {"one": smtlib.problem(("x",), [], "c"), "two": smtlib.problem(("y",), [], "d")}
    text = smtlib.script(problems)
    pieces = text.split("(reset)")
    assert len(pieces) == 3
    for piece, own in zip(pieces[1:], problems.values(), strict=True):
        assert own in piece
    assert "one" in next(r for r in text.splitlines() if r.startswith(";"))


@pytest.mark.parametrize("sampled", [False, True])
def test_a_quadratic_function_falls_where_the_term_says_so(sampled):
    """V = x'P x on one point of each line, against plain products; with E in the rows."""
    rng = random.Random(3)
    said = set()
    for _ in range(60):
        A = [[F(rng.randint(-9, 3), 8) for _ in range(2)] for _ in range(2)]
        P = F(rng.randint(1, 9)), F(rng.randint(-2, 2)), F(rng.randint(1, 9))
        ends = (F(1, 4), F(1, 2)) if rng.random() < 0.5 else None
        rows = [["E", A[0][1]], A[1]] if ends else A
        logic, names, facts, (claim,) = read(smtlib.shrinks(rows, P, sampled, ends))
        assert logic == "QF_NRA"
        assert names == (["x", "y", "E"] if ends else ["x", "y"])
        E = F(rng.randint(1, 9), 16) if ends else A[0][0]
        x, y = rng.choice([(F(1), F(rng.randint(-9, 9), 4)), (F(0), F(1)), (F(0), F(2)),
                           (F(2), F(1))])  # fmt: skip
        at = {"x": x, "y": y, "E": E}
        held = (x == 1 or (x, y) == (0, 1)) and (not ends or F(1, 4) <= E <= F(1, 2))
        assert all(value(f, at) for f in facts) == held
        moved = E * x + A[0][1] * y, A[1][0] * x + A[1][1] * y

        def form(u, v, P=P):
            return u[0] * (P[0] * v[0] + P[1] * v[1]) + u[1] * (P[1] * v[0] + P[2] * v[1])

        now = form((x, y), (x, y))
        fall = form(moved, moved) - now if sampled else form(moved, (x, y))
        assert value(claim, at) == (now > 0 and fall < 0)
        said.add((held, fall < 0))
    assert len(said) == 4


# ---- the filter ----------------------------------------------------------------------------------

FILTER = {"gamma": F(23, 100), "R": F(1, 10000), "H": F(7, 1000), "dt": F(1, 1000), "P": F(1, 2)}


def kalman(n, P, e):
    """Error and variance after a sample of a constant force: by the equations of the filter.

    The sample is H dt times the force, with a noise of variance R dt; P grows by gamma P before.
    """
    h, noise = n["H"] * n["dt"], n["R"] * n["dt"]
    before = P * (1 + n["gamma"])
    K = before * h / (h * h * before + noise)
    return (1 - K * h) * e, (1 - K * h) * before


def largest(n):
    """The start, or the variance that no sample changes."""
    h, noise = n["H"] * n["dt"], n["R"] * n["dt"]
    steady = n["gamma"] * noise / ((1 + n["gamma"]) * h * h)
    assert kalman(n, steady, F(1))[1] == steady
    return max(n["P"], steady)


@pytest.mark.parametrize("P_0", [F(1, 2), F(10**7)])
def test_the_step_of_a_filter_is_that_of_its_equations(P_0):
    n = {**FILTER, "P": P_0}
    logic, names, facts, (claim,) = read(filter_kind._pole_step(n, {}))
    assert logic == "QF_NRA"
    assert names == ["e", "P", "later", "Q"]
    most = largest(n)
    for P in (most, most / 3, most / 10**6):
        for e in (F(5), F(-2)):
            later, Q = kalman(n, P, e)
            at = {"e": e, "P": P, "later": later, "Q": Q}
            assert all(value(f, at) for f in facts)
            assert value(claim, at)
            assert abs(later) / Q < abs(e) / P
            for name, wrong in (("later", later * 2), ("Q", Q * F(9, 10)), ("P", -P),
                                ("e", F(0))):  # fmt: skip
                assert not all(value(f, {**at, name: wrong}) for f in facts)
            assert not value(claim, {**at, "later": e * Q / P})  # as large as before
            assert not value(claim, {**at, "later": -e * Q / P})
            assert not value(claim, {**at, "Q": most * F(11, 10)})
            assert value(claim, {**at, "Q": most})
    over = most * F(11, 10)
    later, Q = kalman(n, over, F(1))
    assert not all(value(f, {"e": F(1), "P": over, "later": later, "Q": Q}) for f in facts)
    assert filter_kind._pole_step({**n, "dt": F(0)}, {}) is None


def test_a_solver_answers_unsat_to_a_filter_and_sat_to_one_that_grows():
    z3 = pytest.importorskip("z3")

    def answer(text):
        asked = f"(reset)\n(set-option :timeout 20000)\n{text}"
        return z3.Z3_eval_smtlib2_string(z3.main_ctx().ref(), asked).split()

    text = filter_kind._pole_step(FILTER, {})
    assert answer(text) == ["unsat"]
    assert answer(text.replace("(< (* later later P P)", "(< (* 2.0 later later P P)")) == ["sat"]


def test_a_filter_settles_when_its_error_is_that_share_of_the_start():
    """Both sides are logarithms; the share at that time follows from the filter's own steps."""
    for dt in (F(1, 1000), F(0)):
        for share in (F(1, 2), F(1, 100)):
            n = {**FILTER, "dt": dt, "share": share, "P": F(400)}
            lasts = {}
            for time in (F(1, 100), F(1, 10), F(10), F(100)):
                (side,) = filter_kind._settles({**n, "time": time})
                lasts[time] = side.holds()
            steady = n["gamma"] * n["R"] / n["H"] ** 2
            if dt:
                steady /= (1 + n["gamma"]) * dt
                P, e = n["P"], F(1)
                for k in range(1, 101):
                    e, P = kalman(n, P, e)
                    P = F(round(P * 10**15), 10**15)
                    e = F(round(e * 10**15), 10**15)
                    (side,) = filter_kind._settles({**n, "time": k * dt})
                    assert side.holds() == (e <= share), k
                (side,) = filter_kind._settles({**n, "time": F(2, 3) * dt})
                assert not side.holds()  # of no whole sample
            else:  # e/P falls by exp(-gamma t), 1/P comes to 1/steady
                for time, holds in lasts.items():
                    gone = math.exp(-float(n["gamma"] * time))
                    P = 1 / (gone / 400 + (1 - gone) / float(steady))
                    assert holds == (gone * P / 400 <= share)
                assert lasts[F(10)]
                assert lasts[F(1, 100)] == (share == F(1, 2))
    (side,) = filter_kind._settles({**FILTER, "share": F(1), "time": F(0)})
    assert side.holds()


def test_what_a_filter_is_asked_belongs_together():
    good = {**FILTER, "band_samples": F(10)}
    filter_kind._filter_guard(good)
    filter_kind._filter_guard({**good, "share": F(1, 2), "time": F(1)})
    filter_kind._filter_guard({**good, "q": F(1)})
    filter_kind._filter_guard({**good, "band_samples": F(1), "dt": F(0)})
    wrong = [{"band_samples": F(k, 2)} for k in (0, 1, 3)]
    for bad in ({"share": F(1, 2)}, {"time": F(1)}, {"q": F(1), "dt": F(0)}, *wrong):
        with pytest.raises(BadInput):
            filter_kind._filter_guard({**good, **bad})


# ---- a relay behind a lag ------------------------------------------------------------------------

RELAY = {"g1": F(36), "g2": F(12), "T": F(1, 1000), "lag": F(42, 10000), "D": F(5)}


@pytest.fixture(scope="module")
def polygon():
    """Corners into which every run comes."""
    from slipctl.models.huang_2020.certificate import relay_sets

    found = relay_sets.find(relay_proof.law(RELAY))
    assert found is not None
    assert found.holds()
    return found.corners


def size_of(corners, point):
    """How many times the polygon has to be blown up to hold a point: by its triangles from 0."""
    s, a = point
    found = []
    for (x, y), (u, v) in zip(corners, [*corners[1:], corners[0]], strict=True):
        whole = x * v - y * u
        found.append(((s * v - a * u) + (x * a - y * s)) / whole)
    return found


def test_the_step_of_a_relay_behind_a_lag_is_that_of_its_tick(polygon):
    entry = {"evidence": {"corners": [[str(s), str(a)] for s, a in polygon]}}
    problems = relay_proof.polygon_step(RELAY, entry)
    assert problems == list(relay_proof.smt_steps(Absorbing(relay_proof.law(RELAY), polygon)))
    assert len(problems) == 2
    T, lag, g1, g2, D = (RELAY[k] for k in ("T", "lag", "g1", "g2", "D"))
    E = math.exp(-float(T / lag))
    rng = random.Random(7)
    ways, ends = set(), []
    for text in problems:
        logic, names, facts, claims = read(text)
        assert logic == "QF_LRA"
        assert names == ["s", "a", "e", "lam"]
        assert len(claims) == len(polygon)
        moved = [[value(c[1], {"s": s, "a": a, "e": F(0)}) for c in claims]
                 for s, a in ((F(0), F(0)), (F(0), F(1)))]  # fmt: skip
        # by a alone a face moves as n (lag (1 - E)) + m E: an equation for E
        n, m = ((size_of(polygon, p)[0]) for p in ((F(1), F(0)), (F(0), F(1))))
        left = ((moved[1][0] - moved[0][0]) - n * lag) / (m - n * lag)
        assert float(left) == pytest.approx(E, abs=1e-14)
        ends.append(left)
        for _ in range(4):
            corner = rng.choice([p for p in polygon if p[0] > 0])
            lam = F(rng.randint(8, 16), 8)
            share = F(rng.randint(0, 9), 8)
            s, a = (lam * share * x for x in corner)
            e = T * D * F(rng.randint(-9, 9), 8)
            at = {"s": s, "a": a, "e": e, "lam": lam}
            held = lam >= 1 and share <= 1 and abs(e) <= T * D
            assert all(value(f, at) for f in facts) == held
            u = -g1 * s - g2
            after = (s + T * u + lag * (1 - left) * (a - u) + e, u + left * (a - u))
            for claim, far in zip(claims, size_of(polygon, after), strict=True):
                assert value(claim[1], at) == far
                assert value(claim, at) == (far < lam)
                ways.add(far < lam)
                assert far < lam or not held
        at = {"s": F(1, 10**6), "a": F(0), "e": F(0)}
        for wrong in ({"lam": F(7, 8)}, {"lam": F(1), "s": F(-1, 10**6)}):
            assert not all(value(f, {**at, **wrong}) for f in facts)
    low, high = Relay(*(RELAY[k] for k in ("g1", "g2", "T", "lag", "D"))).left
    assert ends[0] <= low <= high <= ends[1]
    assert ends[1] - ends[0] <= F(2, 10**15)


def test_ends_are_rounded_outwards_to_short_ones():
    for low, high in ((F(1, 3), F(2, 3)), (F(-2, 3), F(-1, 3)), (F(1, 8), F(1, 8))):
        for digits in (1, 3, 15):
            a, b = relay_proof._outward((low, high), digits)
            assert a <= low <= high <= b
            assert a > low - F(1, 10**digits)
            assert b < high + F(1, 10**digits)
            assert 10**digits % a.denominator == 10**digits % b.denominator == 0
    a, b = relay_proof._outward((F(1, 3), F(2, 3)))
    assert (a, b) == (F(333333333333333, 10**15), F(666666666666667, 10**15))


def test_polygons_of_a_relay_with_one_entry_altered_are_refused(polygon):
    entry = {"corners": [[str(s), str(a)] for s, a in polygon], "ticks": 1, "bound": "1000000"}
    relay_proof._check(RELAY, entry)
    relay_proof._check({**RELAY, "band": F(10**6)}, entry)
    corners = entry["corners"]
    for bad in (
        {"bound": "0"}, {"bound": "1/100000"}, {"ticks": 0}, {"ticks": 10**7}, {"ticks": "1"},
        {"corners": corners[1:]}, {"corners": corners[::-1]}, {"corners": []},
        {"corners": [[s, a] for a, s in corners]}, {"corners": [[s] for s, _ in corners]},
        {"corners": [["1/10000000", corners[0][1]], *corners[1:]]}, {"more": 1},
    ):  # fmt: skip
        with pytest.raises((DoesNotHold, BadInput)):
            relay_proof._check(RELAY, {**entry, **bad})
    for numbers in ({"lag": F(0)}, {"band": F(10**6 - 1)}, {"D": F(12)}, {"g2": F(5)}):
        with pytest.raises((DoesNotHold, BadInput)):
            relay_proof._check({**RELAY, **numbers}, entry)
    for key in entry:
        with pytest.raises(BadInput):
            relay_proof._check(RELAY, {k: v for k, v in entry.items() if k != key})


# ---- registers, ends of a number, balls ----------------------------------------------------------


def test_two_systems_have_two_names(monkeypatch):
    """The same one may be entered again; one that is made here is not of the house."""
    monkeypatch.setattr(registry, "SYSTEMS", {})
    house = list(registry._OF_THE_HOUSE)
    one, two = SimpleNamespace(name="one"), SimpleNamespace(name="one")
    assert registry.register(one) is one
    assert registry.register(one) is one
    assert {"one": one} == registry.SYSTEMS
    with pytest.raises(ValueError, match="one"):
        registry.register(two)
    assert {"one": one} == registry.SYSTEMS
    assert house == registry._OF_THE_HOUSE
    assert not registry.of_the_house(one)


def test_systems_of_the_house_are_those_of_this_package(monkeypatch):
    monkeypatch.setattr(registry, "SYSTEMS", {})
    monkeypatch.setattr(registry, "_OF_THE_HOUSE", [])
    monkeypatch.setattr(registry.registry, "entries",
                        lambda kind: {"a": SimpleNamespace(value="mine.models")})  # fmt: skip
    for k, (home, own) in enumerate((("slipctl.certify.cells", True), ("mine.models.x", True),
                                     ("slipctl.certify", False), ("mine.modelsx.y", False),
                                     ("other.slipctl.certify.x", False))):  # fmt: skip
        made = SimpleNamespace(name=str(k))
        exec("register(made)", {"__name__": home, "register": registry.register, "made": made})
        assert registry.of_the_house(made) == own, home


def test_systems_of_loops_are_known_and_some_are_proved_last(monkeypatch):
    monkeypatch.setattr(registry, "OF_LOOPS", {})
    monkeypatch.setattr(registry, "PROVED_LAST", [])
    one, two = SimpleNamespace(name="one"), SimpleNamespace(name="two")
    registry.register_of_loop(one)
    registry.register_of_loop(two, proved_last=True)
    registry.register_of_loop(two, proved_last=True)
    assert {"one": one, "two": two} == registry.OF_LOOPS
    assert registry.PROVED_LAST == ["two"]
    other = SimpleNamespace(name="one")
    registry.register_of_loop(other)
    assert registry.OF_LOOPS["one"] is other


def test_a_criterion_without_inequalities_holds_where_its_evidence_is_found():
    made = lambda found: Criterion("t", evidence=Evidence(lambda n: found, None))  # noqa: E731
    assert made({"a": 1}).holds({})
    assert made({}).holds({})
    assert not made(None).holds({})
    assert not Criterion("t").holds({})
    sides = lambda n: [Side("a", 0, n["a"]), Side("b", 0, n["b"])]  # noqa: E731
    for a, b in ((1, 1), (1, -1), (-1, 1)):
        assert Criterion("t", sides).holds({"a": F(a), "b": F(b)}) == (a > 0 and b > 0)


@pytest.fixture
def scale(monkeypatch):
    """A system that is certified up to a number, refuted from another on, refused from a third."""
    limits = {"good": 3.0, "bad": 5.0, "no": 1e9, "fails": None}
    asked = []
    units = {"W": SimpleNamespace(unit="m", low="positive"),
             "T": SimpleNamespace(unit="s", low="positive"),
             "x": SimpleNamespace(unit="1", low="any")}  # fmt: skip
    system = SimpleNamespace(numbers=units, name="own")

    def at(point):
        return system, {"W": F(1), "T": F(1, 100), **point}

    def exact(there, given):
        value = float(given.get("W", 1))
        if value > limits["no"]:
            raise BadInput("no")
        return {k: F(str(v)) if not isinstance(v, F) else v for k, v in given.items()}

    def decide(there, asked_):
        value = float(asked_["W"])
        asked.append(value)
        if limits["fails"] and value > limits["fails"]:
            raise ArithmeticError
        up = limits["good"] < limits["bad"]
        verdict = UNDECIDED
        if (value <= limits["good"]) if up else (value >= limits["good"]):
            verdict = CERTIFIED
        elif (value >= limits["bad"]) if up else (value <= limits["bad"]):
            verdict = REFUTED
        return SimpleNamespace(verdict=verdict)

    monkeypatch.setattr(boundary, "exact_numbers", exact)
    monkeypatch.setattr(boundary.proofs, "decide", decide)
    return SimpleNamespace(at=at, limits=limits, asked=asked)


@pytest.mark.parametrize(("good", "bad"), [(3.0, 5.0), (40.0, 41.0), (0.01, 0.02), (0.3, 900.0)])
def test_the_largest_number_is_found_on_both_sides(scale, good, bad):
    """Within the share; what is certified is, and what is refuted is."""
    scale.limits |= {"good": good, "bad": bad}
    found = boundary.farthest(scale.at, "W", True, 0.02)
    assert good / 1.0201 <= found.certified <= good
    assert bad <= found.refuted <= bad * 1.0201
    assert (found.name, found.unit, found.up) == ("W", "m", True)
    tried = [v for v, _ in found.tried]
    assert tried == sorted(set(tried))
    assert sorted(scale.asked) == tried  # each once
    for value, verdict in found.tried:
        assert verdict == (CERTIFIED if value <= good else REFUTED if value >= bad else UNDECIDED)


def test_the_smallest_number_is_found_on_both_sides(scale):
    scale.limits |= {"good": 0.5, "bad": 0.25}
    found = boundary.farthest(scale.at, "W", False, 0.02)
    assert 0.5 <= found.certified <= 0.5 * 1.0201
    assert 0.25 / 1.0201 <= found.refuted <= 0.25
    assert found.up is False


def test_what_is_refused_or_breaks_is_neither(scale):
    scale.limits |= {"good": 3.0, "bad": 8.0, "no": 4.0}
    found = boundary.farthest(scale.at, "W", True, 0.02)
    assert found.refuted is None
    assert 3 / 1.0201 <= found.certified <= 3
    assert max(v for v, _ in found.tried) <= 4
    scale.limits |= {"no": 1e9, "fails": 6.0}
    found = boundary.farthest(scale.at, "W", True, 0.02)
    assert found.refuted is None
    assert dict(found.tried)[8.0] == UNDECIDED
    scale.limits |= {"no": 0.5}
    with pytest.raises(BadInput):
        boundary.farthest(scale.at, "W", True, 0.02)
    scale.limits |= {"no": 1e9}
    for name in ("never", "x"):  # a number of any sign has no end that is doubled
        with pytest.raises(BadInput):
            boundary.farthest(scale.at, name, True, 0.02)


def test_balls_around_zero_divide_nothing_and_others_hold_their_quotient():
    one, two = (Ball(np.array(m), np.array(r)) for m, r in (([2.0, -3.0], [0.5, 0.25]),
                                                          ([4.0, -8.0], [1.0, 0.5])))  # fmt: skip
    found = one.over(two)
    for k in range(2):
        for s, t in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
            value = (one.mid[k] + s * one.rad[k]) / (two.mid[k] + t * two.rad[k])
            assert found.low()[k] <= value <= found.high()[k]
    for mid, rad in (([1.0, 0.5], [0.0, 0.5]), ([0.0, 1.0], [0.0, 0.0]), ([1.0, -1.0], [0.1, 2.0])):
        with pytest.raises(ZeroDivisionError):
            one.over(Ball(np.array(mid), np.array(rad)))
    rest = 5.0 - one
    assert (rest.low() <= 5 - one.mid - one.rad).all()
    assert (rest.high() >= 5 - one.mid + one.rad).all()
    assert rest.mid.tolist() == [3.0, 8.0]


# ---- quiet samples of a window -------------------------------------------------------------------


def grown(**run):
    """Replay of windows and quiet samples, of a covariance that grows by half in each."""
    n = {"samples": F(4), "forgetting": F(1, 2), "limit": F(100), "P": F(1), "least": F(1)}
    n |= {k: v for k, v in run.items() if k in n}
    told = {"windows": 1, "quiet": 3} | {k: v for k, v in run.items() if k in ("windows", "quiet")}
    return rls_kind._replay_growth(n, told)


@pytest.fixture
def covariance(monkeypatch):
    asked = []
    monkeypatch.setattr(rls_kind, "without_checksum", lambda n, run, names, where: run)
    monkeypatch.setattr(rls_kind, "_allowed_quiet", lambda n: 6)
    monkeypatch.setattr(rls_kind.rls_covariance, "covariance_after", lambda n, windows, still: (
        asked.append((windows, still)) or Interval.of(2 * windows + still, 60)))  # fmt: skip
    return asked


def test_quiet_samples_are_no_more_than_are_allowed(covariance):
    """The last window counts three of its four itself; its excitation has to be known."""
    assert "3 samples" in grown(quiet=3)  # ln 100 = 4.6 < 2 + 3
    assert covariance == [(1, 3)]
    for wrong in ({"quiet": 4}, {"quiet": 2}, {"quiet": -1}, {"windows": -1}, {"windows": 1.5},
                  {"least": F(0)}, {"windows": 0, "quiet": 7},
                  {"windows": 0, "quiet": 4}):  # fmt: skip
        with pytest.raises((DoesNotHold, BadInput)):
            grown(**wrong)
    assert "window" not in grown(windows=0, quiet=6)
    assert "window" not in grown(windows=0, quiet=6, least=F(0))


def test_without_forgetting_only_the_start_exceeds_a_limit(covariance):
    good = {"forgetting": F(1), "windows": 0, "quiet": 0, "P": F(101)}
    assert grown(**good)
    assert covariance == []
    for wrong in ({"P": F(100)}, {"windows": 1}, {"quiet": 1}):
        with pytest.raises(DoesNotHold):
            grown(**{**good, **wrong})
