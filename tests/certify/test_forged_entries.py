"""What a forged file may hold where a proof is read: each is refused in words of its own."""

from __future__ import annotations

import base64
import copy
import zlib
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_sums import pi, told

from slipctl.certify.arithmetic.interval_arrays import Boxes
from slipctl.certify.arithmetic.operations import exact
from slipctl.certify.arithmetic.whole_boxes import WholeBoxes
from slipctl.certify.cells import mode_cells
from slipctl.certify.cells.mode_cells import Cells, Grid, dyadic, read_cells, read_grid
from slipctl.certify.entries import DoesNotHold
from slipctl.certify.smooth.sums import NoProof, check_cell, find_cell
from slipctl.certify.smooth.tube import MOST_TICKS, check_tube, find_tube
from slipctl.certify.ticks.tick_code import MOST_STEPS, CodeWriter, read_code
from slipctl.errors import BadInput

F = Fraction
REFUSED = (DoesNotHold, BadInput)

# ---- sums and tubes ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def asked():
    system = pi(1)
    return system.loop.sampled(told(system, bend=2, slope=1))


@pytest.fixture(scope="module")
def cell(asked):
    return find_cell(*asked)[0]


@pytest.fixture(scope="module")
def tube(asked):
    return find_tube(*asked, 12)[0]


FORGED = [
    ("slow", [["0", "1"]], "evidence.slow"),
    ("rest", ["0"] * 3, "evidence.rest"),
    ("moves", [["0"] * 4], "evidence.moves"),
    ("sizes", [0, 0, 0, 201], "evidence.sizes"),
    ("sizes", [0, 0, 0], "evidence.sizes"),
    ("A", "1", r"a matrix has entries \[row, column, number\]"),
    ("A", [[0, 0]], r"a matrix has entries \[row, column, number\]"),
    ("A", [[0, 4, "1"]], "an entry of a matrix is out of place"),
    ("A", [[-1, 0, "1"]], "an entry of a matrix is out of place"),
    ("A", [[True, 0, "1"]], "an entry of a matrix is out of place"),
    ("A", [[0, 0, "1"], [0, 0, "1"]], "an entry of a matrix is out of place"),
    ("A", [[0, 0, "9" * 60]], "an entry of a matrix is out of place"),
    ("A", [[0, 0, "1/2"]], "an entry of a matrix is no whole number"),
    ("B", [[0, 1, "1"]], "an entry of a matrix is out of place"),
    ("bends", [[0, 5]], "evidence.bends"), ("bends", [[4, 0]], "evidence.bends"),
    ("bends", [[0]], "evidence.bends"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "value", "said"), FORGED)
def test_an_entry_that_is_none_is_refused(name, value, said, asked, cell, tube) -> None:
    """Of the proof over a cell and of a tube alike."""
    loop, _, bounds = asked
    for check, good in ((check_cell, cell), (check_tube, tube)):
        bad = copy.deepcopy(good) | {name: value}
        with pytest.raises(REFUSED, match=said):
            check(loop, bounds, bad)


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("box", lambda z: [f"-{z[0]}", *z[1:]], "a half-width is negative"),
        ("box", lambda z: [str(F(k) / 3) for k in z], "what the ticks add leaves the box"),
        ("P", lambda P: [["1/2"], *P[1:]], "its entries are whole numbers"),
        ("P", lambda P: P[1:], "evidence.P"),
        ("P", lambda P: [*P[:-1], P[-1][:-1]], "evidence.P"),
        ("ticks", lambda t: 0, "evidence.ticks"),
        ("decay", lambda d: "x", "evidence.decay"),
    ],
)  # fmt: skip
def test_a_proof_over_a_cell_that_is_altered_is_refused(name, change, said, asked, cell) -> None:
    loop, _, bounds = asked
    check_cell(loop, bounds, cell)
    with pytest.raises(REFUSED, match=said):
        check_cell(loop, bounds, copy.deepcopy(cell) | {name: change(cell[name])})
    with pytest.raises(REFUSED, match=name):
        check_cell(loop, bounds, {k: v for k, v in cell.items() if k != name})


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("boxes", lambda z: [[f"-{z[0][0]}", *z[0][1:]], *z[1:]], "a half-width is negative"),
        ("boxes", lambda z: [[str(F(k) / 3) for k in b] for b in z], "leaves a box"),
        ("boxes", lambda z: z[1:], "evidence.boxes"),
        ("ends", lambda e: [1, *e[1:]], "stretches follow each other from 0 on"),
        ("ends", lambda e: [0], "stretches follow each other from 0 on"),
        ("ends", lambda e: [*e[:-1], e[-2]], "stretches follow each other from 0 on"),
        ("ends", lambda e: [*e[:-1], MOST_TICKS + 1], "evidence.ends"),
        ("A", lambda A: [[i, i, str(2**66)] for i in range(4)], "grows too fast|leaves a box"),
    ],
)  # fmt: skip
def test_a_tube_that_is_altered_is_refused(name, change, said, asked, tube) -> None:
    loop, _, bounds = asked
    assert check_tube(loop, bounds, tube)[2] == 12
    with pytest.raises(REFUSED, match=said):
        check_tube(loop, bounds, copy.deepcopy(tube) | {name: change(tube[name])})


@pytest.mark.second
def test_each_half_width_of_a_proof_is_needed(asked, cell, tube) -> None:
    """One state alone whose box is a third: what the ticks add does not stay in it."""
    loop, _, bounds = asked
    for k in range(len(loop.states)):
        box = [str(F(z) / (3 if i == k else 1)) for i, z in enumerate(cell["box"])]
        with pytest.raises(DoesNotHold):
            check_cell(loop, bounds, cell | {"box": box})
        boxes = [[str(F(z) / (3 if i == k else 1)) for i, z in enumerate(b)] for b in tube["boxes"]]
        with pytest.raises(DoesNotHold):
            check_tube(loop, bounds, tube | {"boxes": boxes})


@pytest.mark.parametrize("ticks", [0, -1, MOST_TICKS + 1])
def test_a_tube_has_so_many_ticks(ticks, asked) -> None:
    with pytest.raises(NoProof, match="a tube has 1 to"):
        find_tube(*asked, ticks)


# ---- ticks ---------------------------------------------------------------------------------------

GOOD = {"inputs": ["x", "a"], "steps": [["const", "1/2"], ["mul", 0, 2], ["add", 3, 1]],
        "outputs": {"x": 4}}  # fmt: skip


def test_a_tick_of_a_file_is_what_its_operations_say() -> None:
    code = read_code(GOOD)
    assert code.payload() == GOOD
    assert code.inputs == ("x", "a")
    assert code.outputs == {"x": 4}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"more": 1}, "a tick has inputs, steps and outputs"),
        ({"inputs": []}, "must be names"), ({"inputs": ["x", "1"]}, "must be names"),
        ({"inputs": ["x", 1]}, "must be names"), ({"inputs": ["x", "x"]}, "holds a name twice"),
        ({"inputs": "xa"}, "must be a list"), ({"steps": [[]]}, r"tick.steps\[0\] is no operation"),
        ({"steps": [["const", "1"], "mul"]}, r"tick.steps\[1\] is no operation"),
        ({"steps": [["root", 0]]}, "is no operation"), ({"steps": [["mul", 0]]}, "is no operation"),
        ({"steps": [["const", "1", "2"]]}, "is no operation"),
        ({"steps": [["mul", 0, 2]]}, "tick.steps"),  # of what comes later
        ({"steps": [["mul", 0, -1]]}, "tick.steps"),
        ({"steps": [["const", 0.5]]}, "a constant is a rational"),
        ({"steps": [["const", "1/0"]]}, "a constant is a rational"),
        ({"steps": [["const", "nan"]]}, "a constant is a rational"),
        ({"steps": [["const", "1" * 801]]}, "a constant is a rational"),
        ({"outputs": {}}, "must hold the number of a value by name"),
        ({"outputs": [4]}, "must hold the number of a value by name"),
        ({"outputs": {"x": 5}}, "tick.outputs"), ({"outputs": {"x": -1}}, "tick.outputs"),
    ],
)  # fmt: skip
def test_what_is_no_tick_is_refused(change, said) -> None:
    with pytest.raises(BadInput, match=said):
        read_code(GOOD | change)
    for none in (None, [], {k: v for k, v in GOOD.items() if k != "steps"}):
        with pytest.raises(BadInput, match="a tick has inputs, steps and outputs"):
            read_code(none)


def test_a_tick_is_as_long_as_can_be_checked() -> None:
    writer = CodeWriter(["x"])
    assert writer.add("neg", 0) == writer.add("neg", 0) == 1  # the same operation is one
    for value in (float("inf"), float("nan"), "1"):
        with pytest.raises(BadInput, match="the tick: "):
            writer.const(value)
    writer.steps = [("neg", 0)] * MOST_STEPS
    with pytest.raises(BadInput, match=f"more than {MOST_STEPS} operations"):
        writer.add("neg", 1)


# ---- cells ---------------------------------------------------------------------------------------

GRID = {"origin": [-2, 0], "size": ["1/4", "3"], "count": [5, 2]}


def test_a_grid_of_a_file_is_read() -> None:
    grid = read_grid(GRID, 2)
    assert grid.payload() == GRID
    assert grid.places == 10


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"origin": [0]}, "evidence.grid"), ({"origin": [0, 2**24 + 1]}, "evidence.grid"),
        ({"count": [0, 1]}, "evidence.grid"), ({"count": [1.0, 1]}, "evidence.grid"),
        ({"count": [2**24, 2**24]}, "has more than"),
        ({"size": ["0", "1"]}, "no size that a float holds"),
        ({"size": ["-1/4", "1"]}, "no size that a float holds"),
        ({"size": ["1/3", "1"]}, "no size that a float holds"),
        ({"size": ["1", str(F(1, 2**61))]}, "no size that a float holds"),
        ({"size": ["1", str(2**61)]}, "no size that a float holds"),
        ({"size": ["1"]}, "evidence.grid"),
    ],
)  # fmt: skip
def test_what_is_no_grid_is_refused(change, said) -> None:
    with pytest.raises(REFUSED, match=said):
        read_grid(GRID | change, 2)


@given(st.floats(1e-6, 1e6))
def test_a_size_is_near_to_the_one_asked_and_short(size) -> None:
    found = dyadic(size)
    assert abs(found / F(size) - 1) <= F(1, 64)
    assert dyadic(float(found)) == found


def packed(places, many=10) -> str:
    held = np.zeros(many, bool)
    held[list(places)] = True
    return base64.b64encode(zlib.compress(np.packbits(held).tobytes())).decode()


def test_cells_of_a_file_are_those_that_were_written() -> None:
    grid = read_grid(GRID, 2)
    cells = Cells(grid)
    for modes, places in (((0, 1), [0, 3]), ((2, 1), [9])):
        fresh = cells.add(cells.number(modes), np.array([*places, *places]))
        assert sorted(fresh) == places
        assert not cells.add(cells.number(modes), np.array(places)).size
    found = read_cells(cells.packed(), grid, 2)
    assert (found.modes, found.many) == (cells.modes, 3)
    assert all((a == b).all() for a, b in zip(found.held, cells.held, strict=True))
    rows = np.array([[0, 1], [2, 1], [5, 5], [0, 1]])
    assert list(found.mode_numbers(rows, enter=False)) == [0, 1, -1, 0]
    assert list(found.mode_numbers(rows, enter=True)) == [0, 1, 2, 0]
    assert list(found.mode_numbers(np.zeros((0, 2), int), enter=True)) == []
    plain = Cells(grid)
    assert list(plain.mode_numbers(np.zeros((3, 0), int), enter=False)) == [-1] * 3
    assert list(plain.mode_numbers(np.zeros((3, 0), int), enter=True)) == [0] * 3


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ([{"modes": [0, 0], "cells": packed([1])}] * 2, "a mode stands there twice"),
        ([{"modes": [0], "cells": packed([1])}], "evidence.cells"),
        ([{"modes": [0, 0], "cells": "*"}], "they cannot be read"),
        ([{"modes": [0, 0], "cells": 3}], "they cannot be read"),
        ([{"modes": [0, 0], "cells": base64.b64encode(b"abc").decode()}], "they cannot be read"),
        ([{"modes": [0, 0], "cells": packed([1], 30)}], "do not belong to the grid"),
        ([{"modes": [0, 0], "cells": packed([1], 3)}], "do not belong to the grid"),
        ([{"modes": [0, 0]}], "evidence.cells"), ("x", "must be a list"),
    ],
)  # fmt: skip
def test_what_are_no_cells_is_refused(rows, said) -> None:
    with pytest.raises(REFUSED, match=said):
        read_cells(rows, read_grid(GRID, 2), 2)


def test_sets_have_an_end(monkeypatch) -> None:
    """Of modes, of their grids together, and of the cells of a file."""
    small = Grid((0,), (F(1),), (3,))
    monkeypatch.setattr(mode_cells, "MOST_MODES", 2)
    cells = Cells(small)
    assert [cells.number((k,)) for k in (4, 7, 4)] == [0, 1, 0]
    with pytest.raises(NoProof, match="more than 2 combinations"):
        cells.number((1,))
    monkeypatch.setattr(mode_cells, "MOST_PLACES", 5)
    cells = Cells(small)
    cells.number((0,))
    with pytest.raises(NoProof, match="are too large"):
        cells.number((1,))
    monkeypatch.setattr(mode_cells, "MOST_CELLS", 1)
    with pytest.raises(DoesNotHold, match="checks at most 1"):
        read_cells([{"modes": [], "cells": packed([0, 1], 3)}], small, 0)


# ---- boxes ---------------------------------------------------------------------------------------


def box(kind, low, high):
    return kind.of_ends(np.array([low]), np.array([high]))


@pytest.mark.parametrize("kind", [Boxes, WholeBoxes])
def test_what_has_no_value_somewhere_in_a_box_is_refused(kind) -> None:
    for divisor in ((-1.0, 1.0), (0.0, 1.0), (-1.0, 0.0), (0.0, 0.0)):
        with pytest.raises(ZeroDivisionError):
            _ = box(kind, 1.0, 2.0) / box(kind, *divisor)
    assert (box(kind, 1.0, 2.0) / box(kind, -2.0, -1.0)).high[0] < 0
    for lost in (lambda: box(kind, -2.0, -1.0).sqrt(), lambda: box(kind, 0.0, 1.0).ln(),
                 lambda: box(kind, -1.0, 1.0).ln()):  # fmt: skip
        with pytest.raises(ArithmeticError):  # at once, or as soon as its cells are asked for
            lost().cells(F(1))
    assert box(kind, 0.0, 4.0).sqrt().low[0] == 0
    assert WholeBoxes.of_ends(np.array([-2.0]), np.array([4.0])).sqrt().low[0] == 0
    for low, high in ((0.25, 0.75), (0.9, 1.3), (0.7, 1.1), (0.0, 1.0)):
        with pytest.raises(ArithmeticError, match="no whole number"):
            kind.of_ends(np.array([3.0, low]), np.array([3.0, high])).whole()
    found = kind.of_ends(np.array([2.9, -4.0, 0.2]), np.array([3.2, -4.0, 0.2])).whole()
    assert list(found) == [3, -4, 0]
    with pytest.raises(ArithmeticError, match="nothing bounds it"):
        box(kind, -(2.0**50), 0.0).cells(F(1))
    with pytest.raises(ArithmeticError, match="nothing bounds it"):
        box(kind, 0.0, 2.0**50).cells(F(1))


def test_numbers_beyond_all_bounds_are_refused_in_whole_numbers() -> None:
    far = box(WholeBoxes, 2.0**150, 2.0**150)
    for product in (lambda: far * far, lambda: (far * -1) * far, lambda: far / F(1, 2**70)):
        with pytest.raises(ArithmeticError, match="nothing bounds it"):
            product()
    with pytest.raises(ArithmeticError, match="an exponential of more than 128"):
        box(WholeBoxes, 1.0, 129.0).exp()


def test_what_is_no_number_is_not_taken_for_one() -> None:
    assert (exact(0.5), exact(3), exact(F(1, 3))) == (F(1, 2), 3, F(1, 3))
    for wrong in ("1", None, [1], 1j):
        with pytest.raises(TypeError, match="is no number that can be taken as it is"):
            exact(wrong)
    for wrong in (float("nan"), float("inf")):
        with pytest.raises(TypeError, match="no finite number"):
            exact(wrong)
