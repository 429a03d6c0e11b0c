"""Sums and tubes whose every number is altered: refused, or still true of runs.

The loop is bent and is written here. What a file says after a change is held against plain runs
from the rest that it names, under pushes at their ends.
"""

from __future__ import annotations

import copy
import itertools
from fractions import Fraction

import casadi as ca
import numpy as np
import pytest

from slipctl.certify.entries import DoesNotHold
from slipctl.certify.smooth import sums, tube
from slipctl.certify.smooth.sampled_loop import Cell, SampledLoop
from slipctl.certify.smooth.sums import Bounds, NoProof, check_cell, find_cell
from slipctl.certify.smooth.tube import check_tube, find_tube
from slipctl.certify.ticks.tick_code import code_of_function
from slipctl.errors import BadInput

F = Fraction

TICKS = 4


def bent(a=0.5, bend=0.25):
    """e+ = a e + bend e^2 + y/8 + w/8 and y+ = y/4 - e/8 + p, whose rest moves with p."""
    e, y, w, p = (ca.SX.sym(k) for k in ("e", "y", "w", "p"))
    f = ca.Function("tick", [ca.vertcat(e, y, w, p)], [ca.vertcat(
        a * e + bend * e * e + (y - 4 * p / 3) / 8 + w / 8, y / 4 - e / 8 + p)])  # fmt: skip
    code = code_of_function(f, ["x_e", "x_y", "d_w", "p_p"], ["e", "y"])
    return SampledLoop(code, ("e", "y"), ("w",), ("p",))


LOOP = bent()
CELL = Cell(((F(1), F(2)),), (F(0), F(2)), ((F(0), F(4, 3)),))
BOUNDS = Bounds((F(1, 4),), (F(1, 20), F(0)))


def farthest(cell, ticks, loop=LOOP, bounds=BOUNDS):
    """Largest distance of each state from its rest in plain runs, at both ends of the cell."""
    run, far = loop.code.compiled(), np.zeros(2)
    rng = np.random.default_rng(1)
    W = float(bounds.push[0])
    rows = [np.full(ticks, s) for s in (-1, 1)] + [rng.choice([-1, 1], ticks) for _ in range(6)]
    for p, signs, start in itertools.product(cell.slow[0], rows, (-1, 1)):
        middle = sum(cell.slow[0]) / 2
        rest = [float(c + m * (p - middle)) for c, m in zip(cell.rest, cell.moves[0], strict=True)]
        x = [rest[0] + start * float(bounds.start[0]), rest[1]]
        for s in (0, *signs):
            far = np.maximum(far, np.abs(np.array(x) - rest))
            x = run(*x, W * s, float(p))
        far = np.maximum(far, np.abs(np.array(x) - rest))
    return far


def places(entry):
    """First and last number of each key of an entry."""
    for key in entry:
        found = [(key, *p) for p in leaves(entry[key])]
        yield from dict.fromkeys(found[:1] + found[-1:])


def leaves(entry, path=()):
    """Places of all numbers of an entry."""
    if isinstance(entry, dict):
        for k, v in entry.items():
            yield from leaves(v, (*path, k))
    elif isinstance(entry, list):
        for k, v in enumerate(entry):
            yield from leaves(v, (*path, k))
    else:
        yield path


def put(entry, path, change):
    found = copy.deepcopy(entry)
    at = found
    for key in path[:-1]:
        at = at[key]
    value = at[path[-1]]
    new = change(F(value))
    at[path[-1]] = int(new) if isinstance(value, int) else str(new)
    return found


CHANGES = {
    "less": lambda x: x * F(9, 10), "more": lambda x: x * F(11, 10), "none": lambda x: F(0),
    "turned": lambda x: -x, "one more": lambda x: x + 1, "half": lambda x: x / 2,
}  # fmt: skip


@pytest.fixture(scope="module")
def cell():
    return find_cell(LOOP, CELL, BOUNDS)


@pytest.fixture(scope="module")
def tubes():
    return find_tube(LOOP, CELL, BOUNDS, TICKS)


@pytest.mark.second
def test_the_box_of_a_bent_loop_holds_its_runs_and_is_hardly_larger(cell, tubes):
    # a sum adds what the start and the pushes do, which a run has one after the other
    for (entry, said), check, ticks, most in ((cell, check_cell, 60, 2.0),
                                              (tubes, check_tube, TICKS, 1.3)):  # fmt: skip
        found, far, *more = check(LOOP, BOUNDS, entry)
        assert found == CELL
        true = farthest(CELL, ticks)
        far = np.array([float(z) for z in far])
        assert (true <= far + 1e-12).all()
        assert far[0] < most * true[0]
        assert (far <= np.array(said) * (1 + 1e-6)).all()
        assert more in ([], [TICKS])


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("kind", ["sum", "tube"])
def test_a_proof_with_one_number_altered_is_refused_or_true(cell, tubes, kind, change):
    entry, check = (cell[0], check_cell) if kind == "sum" else (tubes[0], check_tube)
    refused = many = 0
    for path in places(entry):
        bad = put(entry, path, CHANGES[change])
        if bad == entry:
            continue
        many += 1
        try:
            found, far, *of_tube = check(LOOP, BOUNDS, bad)
        except (DoesNotHold, BadInput):
            refused += 1
            continue
        (ticks,) = of_tube or [30]
        assert kind == "sum" or ticks <= TICKS + 1
        assert (farthest(found, ticks) <= [float(z) + 1e-12 for z in far]).all(), path
    assert many >= 6
    assert refused >= many // 4


@pytest.mark.parametrize("kind", ["sum", "tube"])
def test_an_entry_that_is_missing_or_of_another_form_is_refused(cell, tubes, kind):
    entry, check = (cell[0], check_cell) if kind == "sum" else (tubes[0], check_tube)
    check(LOOP, BOUNDS, entry)
    for key in entry:
        for bad in ({k: v for k, v in entry.items() if k != key}, {**entry, key: "x"},
                    {**entry, key: [["1"]]}, {**entry, "more": 1}):  # fmt: skip
            with pytest.raises((DoesNotHold, BadInput)):
                check(LOOP, BOUNDS, bad)
    for key, value in (("slow", [["2", "1"]]), ("slow", [["1", "2"]] * 2), ("rest", ["0"]),
                       ("moves", [["0"]]), ("sizes", [0]), ("sizes", [201, 0])):  # fmt: skip
        with pytest.raises((DoesNotHold, BadInput)):
            check(LOOP, BOUNDS, {**entry, key: value})


def test_boxes_of_a_tube_have_a_stretch_each(tubes):
    entry, _ = tubes
    ends, boxes_ = entry["ends"], entry["boxes"]
    assert ends[0] == 0
    assert ends[-1] == TICKS
    assert len(boxes_) == len(ends) - 1
    negative = [[str(-F(z)) for z in boxes_[0]], *boxes_[1:]]
    for bad in ({"ends": ends[:-1]}, {"ends": [1, *ends[1:]]}, {"ends": [0]}, {"ends": []},
                {"ends": [*ends[:-2], ends[-1], ends[-1]]}, {"ends": ends[::-1]},
                {"boxes": boxes_[:-1]}, {"boxes": negative},
                {"boxes": [b[:1] for b in boxes_]}):  # fmt: skip
        with pytest.raises((DoesNotHold, BadInput)):
            check_tube(LOOP, BOUNDS, {**entry, **bad})


def test_larger_pushes_or_starts_than_were_asked_are_not_proved(cell, tubes):
    for entry, check in ((cell[0], check_cell), (tubes[0], check_tube)):
        for bounds in (Bounds((F(3, 10),), BOUNDS.start), Bounds(BOUNDS.push, (F(1, 4), F(0))),
                       Bounds(BOUNDS.push, (F(1, 20), F(1)))):  # fmt: skip
            with pytest.raises(DoesNotHold):
                check(LOOP, bounds, entry)
    steeper = bent(bend=0.75)
    with pytest.raises(DoesNotHold):
        check_cell(steeper, BOUNDS, cell[0])
    with pytest.raises(DoesNotHold):
        check_tube(steeper, BOUNDS, tubes[0])


def test_what_has_no_proof_says_so():
    with pytest.raises(NoProof, match="unstable"):
        find_cell(bent(a=1.25), CELL, BOUNDS)
    with pytest.raises(NoProof):  # it leaves every box: e^2 wins
        find_cell(bent(bend=40.0), CELL, BOUNDS)
    with pytest.raises(NoProof):
        find_tube(bent(bend=400.0), CELL, BOUNDS, 40)
    with pytest.raises(NoProof):
        find_tube(bent(a=30.0), CELL, BOUNDS, 20)
    for ticks in (0, -1, tube.MOST_TICKS + 1):
        with pytest.raises(NoProof):
            find_tube(LOOP, CELL, BOUNDS, ticks)


def test_a_slow_loop_is_given_up(monkeypatch):
    """Near the edge of stability a sum has more ticks than a proof may have."""
    edge = 1 - 2e-4
    slow = bent(a=edge + 1 / 64 / (edge - 1 / 4), bend=0.0)  # one eigenvalue is at the edge
    monkeypatch.setattr(sums, "MOST_TICKS", 2000)
    with pytest.raises(NoProof, match="too slow"):
        find_cell(slow, CELL, BOUNDS)


def test_one_tick_and_one_stretch_are_a_tube():
    entry, far = find_tube(LOOP, CELL, BOUNDS, 1)
    assert entry["ends"] == [0, 1]
    found, most, ticks = check_tube(LOOP, BOUNDS, entry)
    assert ticks == 1
    assert float(most[0]) == pytest.approx(max(1 / 20, far[0]), rel=1e-6)
    assert (farthest(found, 1) <= [float(z) + 1e-12 for z in most]).all()
    assert tube.stretches(1) == [0, 1]
    assert tube.stretches(24) == list(range(0, 25, 2))
    many = tube.stretches(1000)
    assert (many[0], many[-1], len(many)) == (0, 1000, tube.STRETCHES + 1)
