"""Trials of limits and slopes of runs: on loops whose answers are formulas."""

from __future__ import annotations

from itertools import pairwise, permutations
from types import SimpleNamespace

import casadi as ca
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slipctl import (
    BadInput,
    Input,
    Output,
    Param,
    Rail,
    Scenario,
    Section,
    State,
    connect,
    feasibility,
    flow,
    run_slopes,
    step,
)
from slipctl.predict import trials
from slipctl.predict.controller import Controller
from slipctl.predict.stages.horizon import Horizon

# ---- trials --------------------------------------------------------------------------------------


@flow(w=Output("m/s"))
def cart(v=State("m/s", 0.0), F=Input("N"), drag=Input("N", "drag", value=0.0), m=Param("kg", 2.0)):
    """A cart."""
    return dict(v=(F - drag) / m), dict(w=v)


def controller(over=0.0, fast=0.0, status=lambda v: 0.0, period=0.1):
    """A control between its limits; it may pass them by some."""

    @step(period=period, F=Output("N"), status=Output("1"))
    def ctl(
        last=State("N", 0.0),
        v=Input("m/s", "speed"),
        v_ref=Input("m/s", "wanted"),
        drag=Input("N", "drag", value=0.5),
        F_lo=Param("N", -3.0), F_hi=Param("N", 2.0), F_rate=Param("N/s", 10.0),
    ):  # fmt: skip
        """Proportional, between limits of size and rate."""
        wanted = ca.fmin(ca.fmax(4 * (v_ref - v) + drag, F_lo - over), F_hi + over)
        most = 0.1 * F_rate + fast
        F = last + ca.fmin(ca.fmax(wanted - last, -most), most)
        return dict(last=F), dict(F=F, status=status(v))

    return ctl


RANGES = {"v": (-5.0, 5.0), "v_ref": (-5.0, 5.0)}


def tried(*given, **more):
    return feasibility(controller(*given), cart, RANGES, starts=6, ticks=25, **more)


def test_limits_that_are_kept_are_told_to_be() -> None:
    found = tried()
    assert found.kept
    assert found.largest_excess[0] <= 1e-12
    assert (found.starts, found.ticks, found.settled, found.broken) == (6, 25, 1.0, 0)
    assert not found.witness
    assert found == tried()


@pytest.mark.parametrize("given", [(0.25, 0.0), (0.0, 0.25)])
def test_what_passes_a_bound_or_a_rate_is_told_by_how_much(given) -> None:
    """With the start from which it does; the same one again shows it."""
    found = tried(*given)
    assert not found.kept
    assert found.largest_excess == (pytest.approx(0.25), "F")
    assert set(found.witness) == {"v", "v_ref", "drag"}
    assert found.witness["drag"] == 0.5
    if given[0]:  # where it passes a bound, it does so from the first tick on
        fixed = {n: (x, x) for n, x in found.witness.items()}
        again = feasibility(controller(*given), cart, fixed, starts=1, ticks=9)
        assert again.largest_excess[0] > 0


def test_ticks_that_do_not_settle_are_counted_by_their_status() -> None:
    """1 is one that did not come to its end, 2 one that gives nothing; both are no 0."""
    every = feasibility(controller(status=lambda v: 1.0 + 0 * v), cart, RANGES, starts=2, ticks=5)
    assert (every.settled, every.broken) == (0.0, 0)
    broken = feasibility(controller(status=lambda v: 2.0 + 0 * v), cart, RANGES, starts=2, ticks=5)
    assert (broken.settled, broken.broken) == (0.0, 10)
    assert broken.witness
    some = feasibility(controller(status=lambda v: v > 0), cart, {"v": (1, 1), "v_ref": (-9, -9)},
                       starts=1, ticks=20)  # fmt: skip
    assert 0 < some.settled < 1


def test_the_plant_moves_by_what_the_controller_gives(monkeypatch) -> None:
    """With the drag that both are told; what is asked for changes in each tenth tick."""
    seen = []
    call = trials.Driver.__call__

    def noted(self, *inputs):
        out = call(self, *inputs)
        seen.append((*map(float, inputs), float(out[0])))
        return out

    monkeypatch.setattr(trials.Driver, "__call__", noted)
    feasibility(controller(), cart, RANGES, starts=2, ticks=25)
    assert len(seen) == 50
    for begin in (0, 25):
        run = seen[begin : begin + 25]
        for (v, _, drag, F), (after, *_) in pairwise(run):
            assert after == pytest.approx(v + 0.1 * (F - drag) / 2, abs=1e-9)
        asked = [r[1] for r in run]
        assert [k for k in range(1, 25) if asked[k] != asked[k - 1]] == [10, 20]
        assert abs(run[0][3]) <= 1 + 1e-12  # from rest: one step of the rate
    assert seen[0] != seen[25]


@pytest.mark.parametrize(
    ("ranges", "made", "said"),
    [
        ({"w": (0, 1)}, {}, "w' is no input"), ({"v": (0, 1)}, {}, "give ranges={'v_ref'"),
        (RANGES, {"period": None}, "ctl has no period; give the block of nmpc"),
    ],
)  # fmt: skip
def test_what_cannot_be_tried_is_refused(ranges, made, said) -> None:
    with pytest.raises(BadInput, match=said):
        feasibility(controller(**made), cart, ranges, starts=1, ticks=1)


# ---- slopes of a run -----------------------------------------------------------------------------


@step(period=0.1, y=Output("1", "square"))
def decay(
    x=State("1", "2*x0", "from its parameter"),
    u=Input("1", "push", value=0.0),
    a=Param("1", 0.9, "factor"),
    b=Param("1", 0.5, "gain"),
    x0=Param("1", 1.5, "half of the start"),
    twice=Param("1", "2*b", "derived"),
):
    """A line."""
    return dict(x=a * x + b + twice * u), dict(y=x**2)


def by_formula(n, a, b, x0):
    """x after n ticks and its slopes: x = 2 x0 a^n + b (1 - a^n)/(1 - a)."""
    geometric = (1 - a**n) / (1 - a)
    by_a = 2 * x0 * n * a ** (n - 1) + b * (
        (1 - a**n) / (1 - a) ** 2 - n * a ** (n - 1) / (1 - a)
    ) if n else 0.0  # fmt: skip
    return 2 * x0 * a**n + b * geometric, by_a, geometric, 2 * a**n


@settings(max_examples=8)
@given(st.floats(0.3, 0.95), st.floats(-2, 2), st.floats(0.2, 3))
def test_slopes_along_a_run_are_those_of_its_formula(a, b, x0) -> None:
    loop = decay.with_params(a=a, b=b, x0=x0)
    found = run_slopes(loop, Scenario("base", duration=1.0), ["a", "b", "x0"])
    assert not found.doubtful
    many = len(found.of["x"]["a"])
    assert many == 10
    for n in range(many):
        x, *slopes = by_formula(n, a, b, x0)
        for name, wanted in zip(("a", "b", "x0"), slopes, strict=True):
            assert found.of["x"][name][n] == pytest.approx(wanted, rel=1e-9, abs=1e-12)
            assert found.of["y"][name][n] == pytest.approx(2 * x * wanted, rel=1e-9, abs=1e-12)
    assert set(found.apart) == {"a", "b", "x0"}
    assert max(found.apart.values()) < 1e-6


def test_one_number_may_be_asked_alone_and_a_rail_may_set_others() -> None:
    """From a section on, b is another; the slope by a goes on with it."""
    rail = Rail([Section(0.0, ""), Section(0.5, "", {"b": -1.0})])
    found = run_slopes(decay, Scenario("base", duration=1.0, rail=rail), "a")
    x, slope = 3.0, 0.0
    for n in range(10):
        assert found.of["x"]["a"][n] == pytest.approx(slope, rel=1e-9, abs=1e-12)
        b = 0.5 if n < 5 else -1.0
        x, slope = 0.9 * x + b, 0.9 * slope + x


@pytest.mark.parametrize(
    ("name", "said"),
    [("x", "'x' is no scalar parameter|no parameter"), ("twice", "is no scalar parameter|derived"),
     ("c", "no parameter|no scalar|has no")],
)  # fmt: skip
def test_what_has_no_slope_is_refused(name, said) -> None:
    with pytest.raises(BadInput, match=said):
        run_slopes(decay, Scenario("base", duration=0.5), name)


def test_a_jump_along_a_run_has_no_slope() -> None:
    @step(period=0.1, y=Output("1"))
    def jumps(x=State("1", 0.0), k=Param("1", 1.0)):
        """A step of a stair: its slope is 0 nearly everywhere, and differences see the jump."""
        return dict(x=x + 1), dict(y=ca.if_else(k >= 1.0, x, 0) + k)

    with pytest.raises(BadInput, match="apart: something jumps"):
        run_slopes(jumps, Scenario("base", duration=0.5), "k")


def test_a_status_has_no_slope() -> None:
    """Of whatever part it is, and alone; nor have the passes and the residual of a solver."""

    @step(period=0.1, y=Output("1"), status=Output("1"), passes=Output("1"))
    def told(x=State("1", 1.0), residual=State("1", 0.0), k=Param("1", 0.5)):
        return dict(x=k * x, residual=x), dict(y=x, status=k, passes=k)

    found = run_slopes(told, Scenario("base", duration=0.5), "k")
    assert set(found.of) == {"x", "y"}
    inside = connect("whole", {"z": "part.y"}, part=told)
    found = run_slopes(inside, Scenario("base", duration=0.5), "part.k")
    assert {n.rpartition(".")[2] for n in found.of} == {"x", "y", "z"}


def test_a_soft_limit_that_a_stage_has_not_lies_far_below_and_hides_no_other() -> None:
    """Two rows for each limit, above and below, times its weight; the linear one without."""
    limits = [SimpleNamespace(weight=w) for w in (2.0, 0.0, 3.0)]
    stub = SimpleNamespace(np_=1, weighed=["r"], soft=["a", "b", "c"], limits=limits)
    q = ca.DM([9, 8, -1, 1, 2, 7, -2, 2, 5, 4, -3, 3, 3, 6])

    def rows(**y):
        found = Horizon._soft_rows(stub, {n: ca.SX(v) for n, v in y.items()}, ca.SX(q))
        return list(ca.DM(found).full().ravel())

    assert rows(a=0.5, b=0.0, c=4.0) == [-1.0, -3.0, -8.0, -8.0, 3.0, -21.0]
    assert rows(b=0.0, c=4.0) == [-1.0, -1.0, -8.0, -8.0, 3.0, -21.0]
    assert rows(a=0.5, c=4.0) == [-1.0, -3.0, -1.0, -1.0, 3.0, -21.0]
    assert rows() == [-1.0] * 6
    stub.soft = []
    assert rows() == []


@pytest.mark.parametrize("order", list(permutations(["a.0", "a.1", "b.0", "b.1"])))
def test_every_limit_has_its_numbers_once_for_all_scenarios(order) -> None:
    """Whatever order limits and scenarios stand in: ends, and the weights that a soft one has."""
    limit = SimpleNamespace(lo=-1.0, hi=2.0, weight=3.0, linear=4.0, hard=False)
    stub = SimpleNamespace(
        weights={}, limits={}, rate={}, softs=dict.fromkeys(order, limit),
        _limited=lambda n: f"path.{n[0]}", unknown=(), h=SimpleNamespace(
            damped=False, factors=("s",), model=SimpleNamespace(
                outputs=dict.fromkeys(("path.a", "path.b"), SimpleNamespace(unit="m")), states={})),
    )  # fmt: skip
    found = [s.name for s in Controller.settings(stub)]
    assert len(set(found)) == len(found)
    kinds = [{n.partition("_")[2] for n in found if n.startswith(f"{a}_")} for a in "ab"]
    assert kinds[0] == kinds[1] > {"min", "max"}
    assert len(found) == 2 * len(kinds[0])


@pytest.mark.parametrize(
    ("ranges", "end"),
    [({"v": (3, 5), "v_ref": (-5, -4)}, "F_lo"), ({"v": (-5, -3), "v_ref": (4, 5)}, "F_hi")],
)  # fmt: skip
def test_either_bound_is_looked_at(ranges, end) -> None:
    found = feasibility(controller(0.5), cart, ranges, starts=2, ticks=9)
    assert found.largest_excess == (pytest.approx(0.5), "F")
    good = feasibility(controller(), cart, ranges, starts=2, ticks=9)
    assert good.kept, end
