"""Flows rolled over logs, by hand and by scipy; slopes by differences; what a fit is worth."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from slipctl import BadInput, Input, Output, Param, State, flow
from slipctl.estimate.log_fit.fit_search import Search
from slipctl.estimate.log_fit.record import Record
from slipctl.estimate.log_fit.rollout import Rolled, Stretch, free_state, stretches


@flow(y=Output("1", "seen", lo=-2, hi=3))
def pair(
    a=State("1", 0.3, "first"), b=State("1", -0.2, "second"), u=Input("1/s", "acts late"),
    w=Input("1/s", "acts at once"), p=Param("1/s", 0.8, "rate", lo=0.1, hi=4),
    q=Param("1", 0.5, "share", lo=-2, hi=2), r=Param("1/s", 0.3, "known"),
    s=Param("1", 1.7, "known too"),
):  # fmt: skip
    """Two states, of which the second turns the first."""
    return dict(a=-p * a + q * b**2 + u, b=r * a - b * p + w), dict(y=s * a + q * b - 0.1 * w)


NAMES = ("p", "q")
TIME = np.array([1.0, 1.5, 1.75, 2.5, 3.0, 4.0])
U = np.array([0.0, 1.0, 1.0, -0.5, 2.0, 2.0])
W = np.array([0.4, -0.3, 0.6, 0.1, -0.2, 0.7])
Y = np.array([0.1, np.nan, 0.4, 0.3, np.nan, 0.6])
EARLY = np.array([0.25, 0.5, 0.75]), np.array([0.7, 0.7, -0.9])
PIECE = Stretch(TIME, {"u": U, "w": W}, Y, EARLY)


def rolled(free="b", delayed="u", rule="hold"):
    return Rolled(pair, "y", NAMES, free, delayed, rule, {"a": 0.3, "b": -0.2})


def test_intervals_of_a_delayed_input_end_where_it_changes():
    """0.4 s late: changes at 0.75, 1, 1.5, 2.5 and 3 come at 1.15, 1.4, 1.9, 2.9 and 3.4."""
    h, dh, rows, samples = rolled()._grid(PIECE, 0.4)
    times = [1.0, 1.15, 1.4, 1.5, 1.75, 1.9, 2.5, 2.9, 3.0, 3.4, 4.0]
    moves = [0, 1, 1, 0, 0, 1, 0, 1, 0, 1, 0]
    assert samples.tolist() == [0, 3, 4, 6, 8, 10]
    assert h == pytest.approx(np.diff(times))
    assert dh.tolist() == np.diff(moves).tolist()
    assert rows[0].tolist() == [0.7, -0.9, 0, 0, 0, 1, 1, -0.5, -0.5, 2]
    assert rows[1].tolist() == [0.4, 0.4, 0.4, -0.3, 0.6, 0.6, 0.1, 0.1, -0.2, -0.2]
    linear = rolled(rule="linear")._grid(PIECE, 0.4)[2]
    middles = (W[1:] + W[:-1]) / 2
    assert linear[1] == pytest.approx(middles[[0, 0, 0, 1, 2, 2, 3, 3, 4, 4]])
    assert linear[0].tolist() == rows[0].tolist()
    # a change that comes at the first sample or before, or behind the last one, moves nothing
    h, dh, rows, samples = rolled()._grid(PIECE, 1.75)
    assert h.sum() == pytest.approx(3.0)
    late = [1.0, 1.5, 1.75, 2.5, 2.5, 2.75, 3.0, 3.25, 4.0, 4.0, 4.0]
    assert np.r_[1.0, 1.0 + np.cumsum(h)] == pytest.approx(late)
    assert dh.tolist() == np.diff([0, 0, 0, 0, 1, 1, 0, 1, 0, 0, 0]).tolist()
    assert rows[0][:3].tolist() == [0.7, 0.7, 0.7]


def test_without_a_delay_an_interval_goes_from_sample_to_sample():
    for rule, held in (("hold", W[:-1]), ("linear", (W[1:] + W[:-1]) / 2)):
        h, dh, rows, samples = rolled(delayed="", rule=rule)._grid(PIECE, 0.0)
        assert h == pytest.approx(np.diff(TIME))
        assert dh.tolist() == [0] * 5
        assert rows[1] == pytest.approx(held)
        assert samples.tolist() == list(range(6))


def by_scipy(p, q, b_0, dead):
    """Output at the samples."""
    at, values = np.r_[EARLY[0], TIME], np.r_[EARLY[1], U]

    def rates(t, x):
        u = values[max(np.searchsorted(at + dead, t, side="right") - 1, 0)]
        w = W[np.searchsorted(TIME, t, side="right") - 1]
        a, b = x
        return [-p * a + q * b**2 + u, 0.3 * a - b * p + w]

    x, rows = np.array([0.3, b_0]), []
    edges = np.unique(np.r_[TIME, (at + dead)[(at + dead > 1) & (at + dead < 4)]])
    for t, following in zip(edges, [*edges[1:], None], strict=True):
        if t in TIME:
            k = int(np.searchsorted(TIME, t))
            rows.append(1.7 * x[0] + q * x[1] - 0.1 * W[k])
        if following is not None:
            inside = following - 1e-9 * (following - t)
            x = solve_ivp(rates, (t, inside), x, rtol=1e-11, atol=1e-12).y[:, -1]
    return np.array(rows)


@pytest.mark.parametrize("dead", [0.4, 0.13])
def test_a_flow_is_rolled_as_scipy_does_it_with_slopes(dead):
    """Slopes by both unknowns, the start of the second state and the dead time: differences."""
    q = np.array([0.9, 0.6])
    of = rolled()
    y, J = of.over(PIECE, q, 0.25, dead, parts=6)
    assert y == pytest.approx(by_scipy(*q, 0.25, dead), abs=1e-5)  # of Runge and Kutta
    e = 1e-6
    steps = [(np.array([e, 0]), 0, 0), (np.array([0, e]), 0, 0), (0 * q, e, 0), (0 * q, 0, e)]
    assert J.shape == (6, 4)
    for k, (dq, ds, dd) in enumerate(steps):
        plus = of.over(PIECE, q + dq, 0.25 + ds, dead + dd, parts=6)[0]
        minus = of.over(PIECE, q - dq, 0.25 - ds, dead - dd, parts=6)[0]
        assert J[:, k] == pytest.approx((plus - minus) / (2 * e), abs=1e-7)
    alone, slopes = rolled(free="", delayed="").over(PIECE, q, None, 0.0)
    assert slopes.shape == (6, 2)
    assert alone[0] == pytest.approx(1.7 * 0.3 + 0.6 * -0.2 - 0.1 * 0.4)


def test_a_log_is_cut_at_its_gaps_and_keeps_what_acts_late():
    """Gaps before rows 3 and 5 and 8; a stretch of one sample, or without any measured, is none."""
    time = np.array([0.0, 1, 2, 4, 5, 7, 8, 9, 20])
    measured = np.array([1.0, np.nan, 3, 4, 5, np.nan, np.nan, np.nan, 9])
    inputs = {"u": 10 + time, "w": 20 + time}
    found = stretches(time, inputs, measured, [3, 5, 8], "u")
    assert [f.time.tolist() for f in found] == [[0, 1, 2], [4, 5]]
    assert found[1].inputs["u"].tolist() == [14, 15]
    assert found[1].inputs["w"].tolist() == [24, 25]
    assert found[1].measured.tolist() == [4, 5]
    assert [v.tolist() for v in found[1].before] == [[2.0], [12.0]]  # those of three seconds
    assert found[0].before[0].size == 0
    early = stretches(time, inputs, measured, [5, 8], "")[0]
    assert (early.time.size, early.before[0].size) == (5, 0)
    thin = PIECE.thinned(3)
    assert thin.time.tolist() == [1.0, 1.75, 3.0]
    assert thin.inputs["w"].tolist() == [0.4, 0.6, -0.2]
    assert thin.measured[:2].tolist() == [0.1, 0.4]
    assert thin.before is EARLY
    assert PIECE.thinned(4).time.size == 3
    assert PIECE.thinned(6).time.size == 6


def test_the_state_whose_start_is_sought():
    @flow()
    def one(x=State("1", 0.0, "level"), k=Param("1/s", 1.0, "rate")):
        """One."""
        return dict(x=-k * x), {}

    assert (free_state(one, "x"), free_state(pair, "b"), free_state(pair, "y")) == ("x", "b", "")


# ---- the least squares ---------------------------------------------------------------------------

LATER = Stretch(TIME[:4] + 9, {"u": U[2:], "w": W[1:5]}, np.array([np.nan, 0.5, 0.2, 0.7]), EARLY)


def search(free="b", delayed="u"):
    record = Record("a.csv", np.r_[TIME, LATER.time], {"u": np.r_[U, U[2:]], "w": np.r_[W, W[1:5]]},
                    np.r_[Y, LATER.measured])  # fmt: skip
    return Search(rolled(free, delayed), [PIECE, LATER], [record], set())


def test_unknowns_dead_time_and_starts_stand_in_this_order():
    found = search()
    assert found.names == ["p", "q", "dead_time"]
    assert found.lo.tolist() == [0.1, -2, 0]
    assert found.hi.tolist() == [4, 2, 2]
    assert found.first.tolist() == [0.8, 0.5, 0.05]
    assert (found.many, found.size) == (7, 0.7)
    assert found._begin([PIECE, LATER]).tolist() == [0.1, 0.5]  # y has the unit of b
    assert search(free="")._begin([PIECE]).size == 0
    theta = np.array([0.9, 0.6, 0.4, 0.25, -0.35])
    outputs, J = found.rows(theta, found.pieces, 4)
    for y, piece, start in zip(outputs, found.pieces, (0.25, -0.35), strict=True):
        wanted, slopes = rolled().over(piece, theta[:2], start, 0.4, 4)
        assert y == pytest.approx(wanted)
        rows, J = np.split(J, [np.isfinite(piece.measured).sum()])
        there = slopes[np.isfinite(piece.measured)]
        assert rows[:, :2] == pytest.approx(there[:, :2])
        assert rows[:, 2] == pytest.approx(there[:, 3])
        own = 3 + (start == -0.35)
        assert rows[:, own] == pytest.approx(there[:, 2])
        assert not rows[:, 7 - own].any()
    misfit = found._misfit(outputs, found.pieces)
    assert misfit == pytest.approx(np.r_[(outputs[0] - Y)[[0, 2, 3, 5]],
                                         (outputs[1] - LATER.measured)[1:]])  # fmt: skip


def test_a_fit_of_too_few_samples_is_refused():
    enough = Stretch(TIME, {"u": U, "w": W}, np.r_[Y[:4], np.nan, np.nan])
    assert Search(rolled("", ""), [enough], [], set()).many == 3
    few = Stretch(TIME, {"u": U, "w": W}, np.r_[Y[:3], [np.nan] * 3])
    record = Record("b.csv", TIME, {"u": U, "w": W}, few.measured)
    with pytest.raises(BadInput, match=r"b\.csv has 2 samples for 2 unknowns; give 3 or more"):
        Search(rolled("", ""), [few], [record], set())
    with pytest.raises(BadInput, match=r"b\.csv has 4 samples for 4 unknowns; give 5 or more"):
        Search(rolled(), [PIECE], [record], set())


def test_the_dead_time_is_known_to_a_sample_over_the_changes():
    """A uniform error over a spacing, by the root of the number of changes: 3 and 2 of them."""
    found = search()
    spacing = np.median(np.diff(np.r_[TIME, LATER.time]))
    changes = np.count_nonzero(np.diff(np.r_[U, U[2:]]))
    assert found._when() == pytest.approx(spacing / np.sqrt(12 * changes))


def test_samples_that_count_as_one_are_those_of_the_correlations():
    """1 + 2 sum of the correlations up to five times itself; gaps and stretches in between."""
    found, rng = search(), np.random.default_rng(4)
    noise = np.convolve(rng.normal(size=260), [0.4, 0.9, 0.7, 0.5], "valid")
    pieces, outputs, sums, many = [], [], 0.0, 0
    for e in (noise[:150], noise[150:]):
        e = e.copy()
        e[[20, 21, 60]] = np.nan
        pieces.append(Stretch(np.arange(e.size) * 0.1, {}, 1.0 + e))
        outputs.append(np.ones(e.size))
        filled, many = np.nan_to_num(e), many + np.isfinite(e).sum()
        own = np.correlate(filled, filled, "full")[filled.size - 1 :]
        sums = sums + own[:60]
    found.pieces, found.many, found.size = pieces, int(many), 1.0
    total = 1.0
    for k in range(1, 60):
        total += 2 * sums[k] / sums[0]
        if k >= 5 * total:
            break
    assert 2 < total < 12
    assert found._alike(outputs) == pytest.approx(total)
    assert found._alike([p.measured for p in pieces]) == 1.0  # nothing is left
    white = [p.measured - np.where(np.arange(p.time.size) % 2, 0.3, -0.3) for p in pieces]
    assert found._alike(white) == 1.0  # at least one


def test_the_effect_is_how_far_the_outputs_go():
    found = search()
    outputs = [np.array([1.0, 9, 3, 0, 9, 2]), np.array([2.0, 5, 2, 4])]
    assert found._effect(outputs) == pytest.approx(np.sqrt(2**2 + 1 + 1 + 3**2 + 0 + 2**2))


def test_an_end_of_a_range_is_a_millionth_of_the_size_away():
    found = search()
    for name, value, at in (
        ("p", 0.1 + 7e-7, True), ("p", 0.1 + 9e-7, False), ("q", 2 - 1.9e-6, True),
        ("q", 2 - 2.1e-6, False), ("dead_time", 4e-8, True), ("dead_time", 6e-8, False),
    ):  # fmt: skip
        assert found._at_an_end(name, value) == at


def test_the_inverse_has_the_units_of_the_unknowns():
    found, rng = search(), np.random.default_rng(2)
    J = rng.normal(size=(9, 5)) * [1.0, 1e4, 1e-5, 10, 3]
    values = dict(zip(found.names, [1.0, 2.0, 3.0], strict=True))
    inverse = found._inverse(J, np.linalg.norm(J, axis=0), values)
    assert inverse == pytest.approx(np.linalg.inv(J.T @ J), rel=1e-6)
    J[:, 1] = 0.0
    with pytest.raises(BadInput, match=r"a\.csv does not determine q: it shows none of their effe"):
        found._inverse(J, np.linalg.norm(J, axis=0), values)
    J[:, 1] = 1e8 * J[:, 0]
    with pytest.raises(BadInput, match=r"not determine p, q: other values fit as well in 4.5"):
        found._inverse(J, np.linalg.norm(J, axis=0), values)


def test_intervals_are_cut_at_the_ranges():
    """Student's 2.571 of five degrees."""
    values, std = {"p": 0.5, "q": 1.0, "dead_time": 0.2}, {"p": 0.1, "q": 0.5, "dead_time": 0.1}
    found = search()._intervals(values, std, 5.0)
    assert found["p"] == pytest.approx((0.5 - 0.2571, 0.5 + 0.2571), abs=1e-4)
    assert found["q"] == pytest.approx((1 - 1.2853, 2.0), abs=1e-4)
    assert found["dead_time"] == pytest.approx((0.0, 0.4571), abs=1e-4)
