"""Runs and drifts of one error inside bounds, as a file holds them: against rationals."""

from __future__ import annotations

import random
from dataclasses import replace
from decimal import Decimal
from fractions import Fraction

import pytest

from slipctl import BadInput
from slipctl.certify.arithmetic.decimal_intervals import precise
from slipctl.certify.entries import DoesNotHold
from slipctl.models.bounded_error.certificate import lagged_runs, scalar_runs
from slipctl.models.bounded_error.certificate.interval_systems import (
    find_drift,
    replay,
    replay_drift,
    replay_path,
)
from slipctl.models.bounded_error.certificate.lagged_maps import Lagged
from slipctl.models.bounded_error.certificate.lagged_runs import Path
from slipctl.models.bounded_error.certificate.scalar_maps import CubicPull, Interval, Tick

D, F = Decimal, Fraction

# ---- runs without a lag --------------------------------------------------------------------------

BELOW, ABOVE = ("0.03125", "2"), ("0.125", "1.25")
"""Gain and width of the pull on either side."""


def tick(i: int, **more) -> Tick:
    """A law whose bounds move a little in every second tick."""
    motion = {"q": D("1.125"), "r": D("1.0625"), "shift": D("0.03125")} if i % 2 else {}
    below, above = (CubicPull(D(g), D(w)) for g, w in (BELOW, ABOVE))
    return Tick(below, above, D("0.25"), D("0.125"), **(motion | more))


def cut(x: F) -> F:
    """Its first 60 digits: those of a cube of a cube have no end."""
    return F(round(x * 10**60), 10**60)


def pull(y: F) -> F:
    gain, width = map(F, ABOVE if y >= 0 else BELOW)
    return gain * y * (width * width - y * y)


def plain(z: F, shares, step: F = F(0)) -> int | None:
    """Tick in which the measured error is out, of shares of push and noise and of a step."""
    for i, (p, n, s) in enumerate(shares):
        q, r, shift = (F(9, 8), F(17, 16), F(1, 32)) if i % 2 else (F(1), F(1), F(0))
        z, noise = z + s * step, n / 8
        y = z + noise
        if y >= F(5, 4) or y <= -2:
            return i
        z = cut(q * y + shift - r * pull(y) - r * noise + p / 4)
    return None


STARTS = {"start": Interval(D("-0.5"), D("1")), "middle": Interval(D("-0.25"), D("0.5"))}
LAWS = dict.fromkeys(STARTS, tick)


def told(name, at, shares):
    return {"from": name, "at": str(at), "ticks": [[1, *map(str, row)] for row in shares]}


def test_a_run_of_shares_leaves_in_the_tick_in_which_rationals_do() -> None:
    rng, said = random.Random(3), []
    for _ in range(120):
        side = rng.choice((-1, 1))
        shares = [(side * F(rng.randint(0, 4), 4), F(rng.randint(-4, 4), 4), F(0))
                  for _ in range(rng.randint(3, 14))]  # fmt: skip
        at = F(rng.randint(-4, 4), 4)
        name, step = "start", rng.choice((F(0), F(1, 2)))
        if rng.random() < 0.5:
            name = "middle"
            k = rng.randrange(len(shares))
            shares[k] = (*shares[k][:2], F(rng.choice((-1, 1)) * rng.randint(1, 4), 4))
        begin = at * F(STARTS[name].high if at > 0 else -STARTS[name].low)
        wanted = plain(begin, shares, step)
        given = told(name, at, shares)
        exact = D(step.numerator) / step.denominator
        if wanted is None:
            with pytest.raises(DoesNotHold, match="the error does not leave"):
                replay(given, LAWS, STARTS, exact)
        else:
            assert replay(given, LAWS, STARTS, exact) == wanted
        said.append((name, wanted is None, (wanted or 0) > 2))
    assert len(set(said)) >= 5


def test_rows_of_equal_ticks_are_so_many_ticks() -> None:
    """Two rows of three and of two, one tick with a step: the same as tick by tick."""
    rows = [[3, "1", "-1/2", "0"], [1, "1/4", "0", "1"], [4, "1", "1", "0"]]
    shares = [tuple(map(F, row)) for count, *row in rows for _ in range(count)]
    wanted = plain(F(1, 8), shares, F(1, 8))
    given = {"from": "middle", "at": "1/4", "ticks": rows}
    assert replay(given, LAWS, STARTS, D("0.125")) == wanted == 5


GOOD = {"from": "start", "at": "1", "ticks": [[9, "1", "1", "0"]]}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"from": "end"}, "from must be one of start, middle"),
        ({"from": ["start"]}, "from must be one of start, middle"),
        ({"ticks": [[1, "0", "0", "0"], [9, "9/8", "1", "0"]]}, "a share is above 1"),
        ({"ticks": [[9, "1", "-9/8", "0"]]}, "a share is above 1"),
        ({"ticks": [[1, "1", "1", "-9/8"]], "from": "middle"}, "a share is above 1"),
        ({"ticks": [[2, "1", "1", "1/2"]], "from": "middle"}, "ticks: 2 must be"),
        ({"ticks": [[0, "1", "1", "0"]]}, "ticks: 0 must be"),
        ({"ticks": [[31, "0", "0", "0"]]}, "ticks: 31 must be"),
        ({"ticks": [[30, "0", "0", "0"], [1, "1", "1", "0"]]}, "has more than 30 ticks"),
        ({"ticks": [[1, "1", "1"]]}, "must have 4 entries"),
        ({"at": "9/8"}, "a start or a step that is not allowed"),
        ({"at": "-9/8"}, "a start or a step that is not allowed"),
        ({"ticks": [[1, "1", "1", "1/2"], [9, "1", "1", "0"]]}, "a start or a step that is not"),
        ({"from": "middle", "ticks": [[1, "1", "1", "1/2"], [1, "1", "1", "-1/2"]]},
         "a start or a step that is not"),
    ],
)  # fmt: skip
def test_a_run_that_asks_for_more_than_is_allowed_is_refused(change, said, monkeypatch) -> None:
    monkeypatch.setattr(scalar_runs, "MOST", 30)
    assert replay(GOOD, LAWS, STARTS, D("0.125")) == plain(F(1), [(F(1), F(1), F(0))] * 9)
    with pytest.raises((DoesNotHold, BadInput), match=said):
        replay(GOOD | change, LAWS, STARTS, D("0.125"))


# ---- a push that no pull stops -------------------------------------------------------------------


def pushed(push, noise="0", above=("1", "1"), below=("1", "1")) -> Tick:
    (g, w), (h, v) = above, below
    return Tick(CubicPull(D(h), D(v)), CubicPull(D(g), D(w)), D(push), D(noise))


PEAK = 2 / 27**0.5
"""Largest value of y (1 - y^2), at 1/root 3."""


@pytest.mark.parametrize("side", [1, -1])
def test_a_drift_is_one_where_the_push_is_above_the_peak(side) -> None:
    """On the weaker side, twice as wide and with an eighth of its gain: as high, elsewhere."""
    weak, strong = ("0.125", "2"), ("0.25", "2")
    sides = {"above": weak, "below": strong} if side > 0 else {"above": strong, "below": weak}
    for push, drifts in ((PEAK * 1.001, True), (PEAK * 0.999, False)):
        found = find_drift(floats(pushed(str(push), **sides)))
        assert (found is not None) == drifts
        entry = {"side": side, "place": str(F(1154700538, 10**9))}
        if drifts:
            assert found["side"] == side
            assert float(F(found["place"])) == pytest.approx(2 / 3**0.5)
            replay_drift(found, pushed(str(push), **sides))
            replay_drift(entry, pushed(str(push), **sides))
        else:
            with pytest.raises(DoesNotHold, match="the pull stops the error"):
                replay_drift(entry, pushed(str(push), **sides))
        with pytest.raises(DoesNotHold, match="the pull stops the error"):
            replay_drift(entry | {"side": -side}, pushed(str(push), **sides))


def floats(made: Tick) -> Tick:
    def of(p):
        return CubicPull(float(p.gain), float(p.width))

    return Tick(of(made.below), of(made.above), float(made.push), float(made.noise))


def test_a_drift_about_a_wrong_place_is_none() -> None:
    """Without noise the tangent there bounds the pull; with noise the peak lies about the place."""
    strong = pushed("0.5")
    replay_drift({"side": 1, "place": "29/50"}, strong)
    for place in ("2/5", "7/10"):  # the tangent there rises by its slope: 0.52, and 0.47
        slope = abs(1 - 3 * F(place) ** 2)
        top = F(place) * (1 - F(place) ** 2) + slope
        with pytest.raises(DoesNotHold, match="the pull stops the error"):
            replay_drift({"side": 1, "place": place}, pushed(str(float(top) * 0.999)))
        replay_drift({"side": 1, "place": place}, pushed(str(float(top) * 1.001)))
    noisy = pushed("0.5", "0.1")
    for place, flat in (("1/2", True), ("2/3", True), ("2/5", False), ("7/10", False)):
        if flat:
            replay_drift({"side": 1, "place": place}, noisy)
        else:
            with pytest.raises(DoesNotHold, match="does not have its peak about the place"):
                replay_drift({"side": 1, "place": place}, noisy)
    most = max(y * (1 - y * y) for y in (0.45, 0.65))
    for push, drifts in ((most * 1.001, True), (most * 0.999, False)):
        if drifts:
            replay_drift({"side": 1, "place": "11/20"}, pushed(str(push), "0.1"))
        else:
            with pytest.raises(DoesNotHold, match="the pull stops the error"):
                replay_drift({"side": 1, "place": "11/20"}, pushed(str(push), "0.1"))


@pytest.mark.parametrize(
    ("place", "noise"), [("-1/100", "0"), ("1", "0"), ("9/10", "0.1"), ("95/100", "0.1")]
)
def test_a_drift_outside_the_bounds_is_none(place, noise) -> None:
    with pytest.raises(DoesNotHold, match="place lies outside the bounds"):
        replay_drift({"side": 1, "place": place}, pushed("3", noise))


def test_a_push_beyond_what_is_computed_is_no_drift() -> None:
    replay_drift({"side": 1, "place": "1/2"}, pushed("1000000000000"))
    with pytest.raises(DoesNotHold, match="the pull stops the error"):
        replay_drift({"side": 1, "place": "1/2"}, pushed("1000000000001"))
    wide = pushed("100000", above=("0.000000000000000000000000000001", "1000000000001"))
    with pytest.raises(DoesNotHold, match="the pull stops the error"):
        replay_drift({"side": 1, "place": "500000000000"}, wide)


# ---- runs behind an actuator ---------------------------------------------------------------------

DEAD = 2


def lagged(i: int, push="0.125", dead=DEAD) -> Lagged:
    """A law whose bounds shrink by a tenth in the first three ticks."""
    r = D("1.0625") if i < 3 else D(1)
    below, above = (CubicPull(D(g), D(w)) for g, w in (BELOW, ABOVE))
    return Lagged(below, above, D(push), D("0.03125"), dead, D("0.5"), D("0.75"), D("0.25"), D(1),
                  r, D("0.25"), D("0.125"))  # fmt: skip


def driven(z: F, pushes, noise, stepped=-1, step: F = F(0), dead=DEAD):
    """Errors of a run, of its pushes and of the signs of its noise, up to where it is out."""
    errors, alpha, laws = [], F(0), [F(17, 16) if i < 3 else F(1) for i in range(len(noise))]
    for i, r in enumerate(laws):
        errors.append(z)
        if z + F(1, 32) >= F(5, 4) or z - F(1, 32) <= -2:
            return errors
        j, U = i - dead, F(0)
        if j >= 0:
            y = errors[j] + F(noise[j], 32)
            U = -pull(y) - F(1, 4) * (1 - 1 / laws[j]) * (y + F(1, 8))
            for k in range(j, i):
                U *= laws[k]
        z = r * (z + F(1, 8) + F(3, 4) * alpha + F(1, 4) * U) - F(1, 8) + pushes[i]
        z = cut(z + (step if i + 1 == stepped else 0))
        alpha = cut(r * (F(1, 2) * alpha + F(1, 2) * U))
    return None


def decimals(values):
    with precise(60):
        return [D(v.numerator) / D(v.denominator) for v in values]


MOVING = [lagged(i) for i in range(4)]


def law_of(i: int) -> Lagged:
    return MOVING[min(i, 3)]


@pytest.mark.parametrize("stepped", [-1, 2, 5])
@pytest.mark.parametrize("side", [1, -1])
def test_a_run_behind_a_lag_is_one_as_long_as_its_pushes_are_allowed(side, stepped) -> None:
    """Pushes up to the largest, each other than the last; one that is too large ends it."""
    rng = random.Random(side + stepped)
    step = F(side, 16)
    noise = [rng.choice((-1, 0, 1)) for _ in range(200)]
    pushes = [side * F(1, 8) * (1 - F(rng.randint(1, 9), 10**5)) for _ in noise]
    errors = driven(F(side, 4), pushes, noise, stepped, step)
    assert errors is not None
    assert 6 < len(errors) < 60
    exact, shown = decimals(errors), [*noise[: len(errors) - 1], side]
    path = Path(exact, shown, stepped, decimals([step])[0])
    assert lagged_runs.leaves(law_of, path)
    assert not lagged_runs.leaves(law_of, replace(path, errors=exact[:-1], noise=shown[:-1]))
    more = replace(path, errors=[*exact, exact[-1]], noise=[*shown, 0])
    assert not lagged_runs.leaves(law_of, more)
    if stepped < 0:
        assert not lagged_runs.leaves(law_of, replace(path, stepped=1, step=-path.step))
    else:  # without it the push would have to be larger
        for wrong in ({"stepped": stepped + 1}, {"stepped": -1}, {"step": path.step * D("0.99")}):
            assert not lagged_runs.leaves(law_of, replace(path, **wrong))
    assert not lagged_runs.leaves(law_of, replace(path, errors=exact[:1]))  # the push is not told
    for k in (0, 1, len(errors) // 2, len(errors) - 2):
        for share in (F(1001, 1000), F(-1001, 1000)):
            own = list(pushes)
            own[k] = side * F(1, 8) * share
            wrong = driven(F(side, 4), own, noise, stepped, step)
            forged = Path(decimals(wrong), [*noise[: len(wrong) - 1], side], stepped, path.step)
            assert not lagged_runs.leaves(law_of, forged), k


def test_a_run_that_nothing_pushes_follows_from_its_start_and_its_noise() -> None:
    """Six ticks of dead time swing it out; told tick by tick it is the same run."""
    still = replace(lagged(9, "0", 6), g=D(0), above=CubicPull(D("1"), D("1.25")),
                    below=CubicPull(D("1"), D("1.25")))  # fmt: skip

    def at(i: int) -> Lagged:
        return still

    noise = [(-1, 1, 0, 1)[i % 4] for i in range(300)]
    z, alpha, errors = F(1, 4), F(0), []
    for i in range(300):
        errors.append(z)
        if abs(z) + F(1, 32) >= F(5, 4):
            break
        U = F(0)
        if i >= 6:
            y = errors[i - 6] + F(noise[i - 6], 32)
            U = -y * (F(25, 16) - y * y)
        z, alpha = cut(z + F(3, 4) * alpha + F(1, 4) * U), cut((alpha + U) / 2)
    assert 8 < len(errors) < 100
    shown = [*noise[: len(errors) - 1], 1 if errors[-1] > 0 else -1]
    start = decimals(errors[:1])
    assert lagged_runs.leaves(at, Path(start, shown, -1, D(0)))
    assert not lagged_runs.leaves(at, Path(start, shown[:-1], -1, D(0)))
    assert not lagged_runs.leaves(at, Path(start, [*shown, 0], -1, D(0)))
    assert not lagged_runs.leaves(at, Path(decimals([F(0)]), shown, -1, D(0)))
    assert not lagged_runs.leaves(at, Path(start, [], -1, D(0)))


def path_entry(errors, noise, stepped=-1, forward=1, name="start"):
    return {"from": name, "errors": [str(e) for e in errors], "noise": list(noise),
            "stepped": stepped, "forward": forward}  # fmt: skip


MOST = F(1, 8) - F(1, 10**9)
NOISE = [(-1, 1, 0)[i % 3] for i in range(80)]
ERRORS = driven(F(3, 4), [MOST] * 80, NOISE)
SHOWN = [*NOISE[: len(ERRORS) - 1], 1]
BEGINS = {"start": Interval(D("-0.5"), D("0.75")), "middle": Interval(D("-0.25"), D("0.5"))}
OF_NAMES = {"start": law_of, "middle": law_of}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"from": "end"}, "from must be one of start, middle"),
        ({"from": 3}, "from must be one of start, middle"),
        ({"stepped": 2}, "a start or a step that is not allowed"),
        ({"stepped": 0}, "a start or a step that is not allowed"),
        ({"errors": []}, "a start or a step that is not allowed"),
        ({"errors": [str(e) for e in ERRORS[:2]]}, "a start or a step that is not allowed"),
        ({"errors": ["750001/1000000", *map(str, ERRORS[1:])]}, "a start or a step that is not"),
        ({"errors": ["-500001/1000000", *map(str, ERRORS[1:])]}, "a start or a step that is not"),
        ({"errors": ["11/16", *map(str, ERRORS[1:])]}, "more than is allowed drives it"),
        ({"noise": [*SHOWN[:-1], 2]}, "noise: 2 must be"),
        ({"noise": [-2, *SHOWN[1:]]}, "noise: -2 must be"),
        ({"stepped": -2}, "stepped: -2 must be"), ({"stepped": 6001}, "stepped: 6001 must be"),
        ({"forward": 2}, "forward: 2 must be"),
    ],
)  # fmt: skip
def test_a_run_behind_a_lag_that_is_altered_is_refused(change, said) -> None:
    good = path_entry(ERRORS, SHOWN)
    assert replay_path(good, OF_NAMES, BEGINS, D("0.0625")) == len(ERRORS) - 1
    with pytest.raises((DoesNotHold, BadInput), match=said):
        replay_path(good | change, OF_NAMES, BEGINS, D("0.0625"))


def test_a_step_of_a_run_has_its_side_and_its_tick() -> None:
    for forward in (1, -1):
        errors = driven(F(forward, 4), [forward * MOST] * 80, NOISE, 2, F(forward, 16))
        assert errors is not None
        good = path_entry(errors, [*NOISE[: len(errors) - 1], 1], 2, forward, "middle")
        assert replay_path(good, OF_NAMES, BEGINS, D("0.0625")) == len(errors) - 1
        for wrong in ({"forward": -forward}, {"forward": 0}, {"stepped": 3}, {"stepped": -1}):
            with pytest.raises(DoesNotHold, match="more than is allowed drives it"):
                replay_path(good | wrong, OF_NAMES, BEGINS, D("0.0625"))
