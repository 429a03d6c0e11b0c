"""Rail and scenario: sections by time and by position, and what cannot be one."""

import math

import numpy as np
import pytest
from conftest import BEST, closed_loop, three_rails
from hypothesis import given
from hypothesis import strategies as st

from slipctl import (
    BadInput,
    Block,
    Input,
    Noise,
    Output,
    Param,
    Rail,
    Scenario,
    Section,
    State,
    connect,
    every,
    law,
    prepare,
    simulate,
    step,
)
from slipctl.models.huang_2020 import subway_braking as subway

TICK = 0.125
"""Exact in binary, so that a clock that counts ticks and one that adds them agree."""


@step(y=Output("1"), period=TICK, name="probe")
def probe(
    x=State("m", 0.0, "a position that is the time, at 1 m/s"),
    k=Param("1", -1.0),
    twice=Param("1", "2 * k"),
    u=Input("1"),
):
    """Shows the rail's parameter, one derived from it, and the rail's input."""
    return dict(x=x + TICK), dict(y=k + 10 * twice + 100 * u)


@given(st.lists(st.integers(1, 160), min_size=0, max_size=5, unique=True), st.sampled_from([1, 16]))
def test_by_time_and_by_position_agree_at_any_border(starts, fraction):
    """Borders on ticks and between them, several in one tick; inputs, parameters, derived ones.

    Both change at the first tick at or after the border.
    """
    borders = [0.0, *(s * TICK * 8 / 16 / fraction for s in sorted(starts))]
    sections = [Section(b, None, {"k": k, "u": k + 0.5}) for k, b in enumerate(borders)]
    for block in (probe, connect("c", {}, p=probe), every(probe.renamed("p"), 1)):
        runs = [
            simulate(block, Scenario("s", 10.0, Rail(sections, by=by)), compile=False)
            for by in ("time", "position")
        ]
        name = next(n for n in runs[0] if n.split(".")[-1] == "y")
        expected = [Rail(sections).at(t).values["k"] for t in runs[0].time.values]
        expected = [k + 20 * k + 100 * (k + 0.5) for k in expected]
        for run in runs:
            assert run[name].values.tolist() == expected


@pytest.mark.parametrize("compile", [True, False])
@pytest.mark.parametrize("slow", [False, True], ids=["SX", "MX"])
def test_the_study_by_position_is_the_study_by_time(slow, compile):
    """Borders put where the vehicle was at the changes: the same run to the bit."""
    loop = closed_loop()
    if slow:  # a part that runs every second tick makes the loop an MX expression
        idle = step(name="idle")(lambda s=State("1", 0.0): (dict(s=s + 1), {}))
        loop = connect("outer", {}, loop=loop, idle=every(idle, 2))
    by_time = simulate(loop, three_rails(0.9), compile=compile)
    x = next(n for n in by_time if n.endswith("wheel.x"))
    places = by_time[x].values[[0, 300, 600]]
    names = ("dry", "wet", "ice")
    for by in ("position", x):
        rail = Rail(
            [Section(p, n, {"v_opt": BEST}) for p, n in zip(places, names, strict=True)], by=by
        )
        by_place = simulate(loop, Scenario("s", 0.9, rail), compile=compile)
        assert all((by_time[n].values == by_place[n].values).all() for n in by_time)


def test_conditions_set_the_parameters_of_the_law():
    """Height of the adhesion curve on each third of the run, and not before or after."""
    run = simulate(closed_loop(), three_rails(0.9))
    mu, v_s = run["plant.adh.mu"].values, run["plant.wheel.v_s"].values
    curve = np.exp(-0.54 * v_s) - np.exp(-1.2 * v_s)
    heights = np.repeat([1.0, 0.29, 0.1], 300)
    assert mu == pytest.approx(heights * curve, rel=1e-12, abs=1e-15)


@given(st.lists(st.floats(0.01, 100), min_size=1, max_size=6, unique=True), st.floats(-5, 105))
def test_the_section_in_force_is_the_last_that_has_begun(starts, where):
    rail = Rail([Section(s) for s in [0.0, *sorted(starts)]])
    begun = [s.start for s in rail.sections if s.start <= where]
    assert rail.at(where).start == (begun[-1] if begun else 0.0)


def test_changes_are_those_within_the_run():
    rail = Rail([Section(0), Section(2), Section(4)])
    assert Scenario("s", 3.0, rail).changes == [2.0]
    assert Scenario("s", 4.0, rail).changes == [2.0]
    assert Scenario("s", 9.0, Rail(rail.sections, by="position")).changes == []


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Rail([]), "needs at least one Section"),
        (lambda: Rail([Section(1.0)]), "first rail section starts at 1 s, not 0"),
        (lambda: Rail([Section(1.0)], by="position"), "starts at 1 m, not 0"),
        (lambda: Rail([Section(0), Section(2), Section(2)]),
         "section 1 is empty: section 2 starts at 2 s too"),
        (lambda: Rail([Section(0), Section(3), Section(2)]),
         "overlap: section 2 starts at 2 s, before section 1 at 3 s; sort them"),
        (lambda: Rail([Section(0, length=3), Section(2)]),
         "overlap: section 0 ends at 3 s, section 1 starts at 2 s"),
        (lambda: Rail([Section(0, length=0)]), "section 0 is 0 s long; it must be positive"),
        (lambda: Rail([Section(0, length=-1)], by="position"), "is -1 m long"),
        (lambda: Rail([Section(0), Section(math.nan)]), "give a finite number"),
        (lambda: Rail([Section(0), Section(math.inf)]), "give a finite number"),
        (lambda: Rail(5), "a Rail takes a list of sections, not 5"),
        (lambda: Scenario("s", 0.0), "scenario s: duration 0 s must be positive"),
        (lambda: Scenario("s", -1.0), "duration -1 s must be positive"),
        (lambda: Scenario("s", math.inf), "duration inf s must be positive"),
        (lambda: Scenario("s", math.nan), "duration nan s must be positive"),
        (lambda: Scenario("s", 1.0, noise=-1), "noise -1 must be 0 or positive"),
        (lambda: Scenario("s", 1.0, seed=-1), "seed = -1 must be a whole number >= 0"),
        (lambda: Scenario("s", 1.0, seed=math.nan), "seed = nan must be a whole number"),
        (lambda: Scenario("s", 1.0, seed=0.5), "seed = 0.5 must be a whole number"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused(make, words):
    with pytest.raises(BadInput, match=words):
        make()


def two_parts() -> Block:
    """Loop with a parameter k in two parts, one without value, and an input that is wired."""
    other = law(y=Output("1"), name="other")(lambda k=Param("1", 1.0), m=Param("1"): k * m)
    return connect("c", {}, p=probe.with_params(k=2.0), q=other)


@pytest.mark.parametrize(
    ("block", "sections", "by", "words"),
    [
        (probe, [Section(0, "dry"), Section(1, "wet")], "time",
         r"probe knows no rail condition 'dry': the rail names dry, wet, the adhesion law has one"),
        (closed_loop(), [Section(0, "moist")], "time",
         "loop knows no rail condition 'moist'; it has dry, wet, ice"),
        (probe, [Section(0, None, {"v": 1.0})], "time", "rail value 'v' is unknown"),
        (two_parts(), [Section(0, None, {"k": 1.0})], "time", "'k' could be p.k or q.k"),
        (two_parts(), [Section(0, None, {"m": 1.0}), Section(1)], "time",
         "every rail section must set 'q.m'"),
        (probe, [Section(0, None, {"k": math.nan})], "time", "probe.k is NaN"),
        (probe, [Section(0, None, {"twice": 1.0})], "time", "is derived, 2 \\* k; set k"),
        (probe, [Section(0, None, {"twice": 1.0})], "position", "is derived, 2 \\* k; set k"),
        (probe, [Section(0)], "place", "probe has no state 'place'; it has x"),
        (closed_loop(), [Section(0, "dry", {"plant.m": -1.0})], "time", "= -1 kg is out of range"),
        (closed_loop(), [Section(0, "dry", {"plant.m": -1.0})], "position", "out of range"),
    ],
)  # fmt: skip
def test_rails_that_do_not_fit_the_loop_are_refused(block, sections, by, words):
    inputs = {n: 1.0 for n in block.inputs if not any(n in s.values for s in sections)}
    with pytest.raises(BadInput, match=words):
        simulate(block, Scenario("s", 1.0, Rail(sections, by=by), inputs))


def test_an_input_is_given_once():
    """By the rail or by inputs=, not by both."""
    rail = Rail([Section(0, None, {"u": 1.0})])
    with pytest.raises(BadInput, match="both the rail and inputs= give 'u'; give it once"):
        simulate(probe, Scenario("s", 1.0, rail, {"u": 2.0}))


def test_noise_does_not_depend_on_the_rail():
    """The same draws whatever the sections are and however they are told."""
    noisy = step(y=Output("1"), period=TICK, name="b")(
        lambda x=State("m"), n=Noise(), k=Param("1", 0.0): (dict(x=x + 1), dict(y=n + 0 * k))
    )
    rail = [Section(0), Section(3, None, {"k": 4.0})]
    runs = [
        simulate(noisy, Scenario("s", 9.0, r)) for r in (None, Rail(rail), Rail(rail, "position"))
    ]
    for run in runs[1:]:
        assert (run["n"].values == runs[0]["n"].values).all()


def test_a_law_with_new_numbers_is_not_overwritten_by_the_conditions_of_the_old_one():
    """As ``slipctl fit`` makes it: where the rail has one condition, its own numbers hold."""
    fitted = subway.double_exponential.with_params(c=0.5, a=0.4)
    assert not fitted.conditions
    assert (
        subway.double_exponential.with_params().conditions == subway.double_exponential.conditions
    )
    loop = closed_loop().swap("plant.adh", fitted)
    one = Scenario("s", 0.2, Rail([Section(0, "dry", {"v_opt": 1.2})]))
    log = simulate(loop, one, compile=False)
    v_s, mu = log["plant.wheel.v_s"].values, log["plant.adh.mu"].values
    assert mu == pytest.approx(0.5 * (np.exp(-0.4 * v_s) - np.exp(-1.2 * v_s)), rel=1e-12)
    three = Scenario("s", 0.2, Rail([Section(0, "dry"), Section(0.1, "wet")]))
    with pytest.raises(BadInput, match=r"with_conditions\(dry=\{...\}, wet=\{...\}\)"):
        simulate(loop, three, compile=False)
    named = fitted.with_conditions(dry={"c": 0.5}, wet={"c": 0.1})
    loop = closed_loop().swap("plant.adh", named)
    log = simulate(loop, three.but(inputs={"v_opt": 1.2}), compile=False)
    v_s, mu = log["plant.wheel.v_s"].values[-1], log["plant.adh.mu"].values[-1]
    assert mu == pytest.approx(0.1 * (np.exp(-0.4 * v_s) - np.exp(-1.2 * v_s)), rel=1e-12)
    with pytest.raises(BadInput, match="has no parameter 'k'"):
        fitted.with_conditions(dry={"k": 0.5})


def test_what_follows_a_number_of_the_rail_follows_it_in_each_section():
    @law(y=Output("1", "out"))
    def follower(
        c=Param("1", 1.0, "the rail sets it", lo=0),
        k=Param("1", 3.0, "fixed"),
        more=Param("1", "twice + k", "derived of a derived one that stands behind it"),
        twice=Param("1", "2 * c", "derived"),
        other=Param("1", "k + 1", "derived of a fixed one"),
    ):
        """Nothing to do with a train."""
        return more + other

    @step(period=0.1)
    def count(n=State("1", 0.0), y=Input("1", "in")):
        """What it was fed last."""
        return dict(n=y), {}

    loop = connect("loop", {"count.y": "law.y"}, law=follower, count=count)
    rail = Rail([Section(t, values={"law.c": c}) for t, c in ((0, 1.0), (0.2, 5.0), (0.4, 2.0))])
    y = prepare(loop, Scenario("s", 0.6, rail), compile=False)({"law.k": 4.0})["law.y"]
    np.testing.assert_array_equal(y, 2 * np.repeat([1.0, 5.0, 2.0], 2) + 4 + 5)
