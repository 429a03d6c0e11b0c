"""Functions over stages, and what is done again while it is wanted, are loops; every bit stays."""

from __future__ import annotations

import ctypes
import re
import subprocess
from itertools import pairwise
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from slipctl.block.text.intermediates import remember_locals
from slipctl.ccode.passes import scratch
from slipctl.ccode.tree.functions import Functions, returns_number
from slipctl.ccode.tree.helpers import helpers
from slipctl.ccode.tree.nodes import Node
from slipctl.ccode.tree.parser import code, define
from slipctl.ccode.tree.printer import file_text, lines_of
from slipctl.ccode.tree.scans import find_scan
from slipctl.ccode.tree.while_loops import find_while_loop
from slipctl.predict.qp.stage_loops import Repeated, scan

HEAD = "#include <math.h>\n#include <stdbool.h>\n#include <stddef.h>\n"


def written(f: ca.Function) -> tuple[Functions, str]:
    """Functions of C, and the name of that of a Function."""
    made = Functions({})
    return made, made.name(f)


def run(f: ca.Function, given: list[Any], folder: Path, functions: dict[str, Node], name: str,
        structs: str = "") -> list[np.ndarray]:  # fmt: skip
    """Results of the C of a Function, arguments by address."""
    made = list(functions.values())
    text = structs + file_text([*helpers(made), *made])
    places = [f"*a{i}" if f.nnz_in(i) == 1 else f"a{i}" for i in range(f.n_in())]
    if returns_number(f):
        name = f"*r0 = {name}"
    else:
        places += [f"r{i}" for i in range(f.n_out())]
    declared = [f"const double *a{i}" for i in range(f.n_in())]
    declared += [f"double *r{i}" for i in range(f.n_out())]
    call = f"void run({', '.join(declared)})\n{{ {name}({', '.join(places)}); }}\n"
    unit_name = f"c{len(list(folder.iterdir()))}"
    (folder / f"{unit_name}.c").write_text(f"{HEAD}{text}\n{call}")
    flags = ["-std=c99", "-O1", "-Wall", "-Wshadow", "-Werror", "-shared", "-fPIC"]
    command = ["gcc", *flags, "-ffp-contract=off", f"{unit_name}.c", "-o", f"{unit_name}.so", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    unit = ctypes.CDLL(str(folder / f"{unit_name}.so"))
    P = ctypes.POINTER(ctypes.c_double)
    columns = [np.array(v, float).ravel(order="F") for v in given]
    found = [np.full(f.nnz_out(i), np.nan) for i in range(f.n_out())]
    unit.run(*(v.ctypes.data_as(P) for v in (*columns, *found)))
    return found


def same(f: ca.Function, folder: Path, given: list[Any]) -> str:
    """Compare C and CasADi bit by bit; the text of C."""
    made, name = written(f)
    found = run(f, given, folder, made.made, name)
    for value, true in zip(found, f.call(given), strict=True):
        expected = np.array(ca.densify(true)).ravel(order="F")
        np.testing.assert_array_equal(value, expected)
    return file_text([made.made[name]])


def numbers(f: ca.Function) -> list[Any]:
    """Numbers for the arguments of a Function."""
    rng = np.random.default_rng(3)
    return [rng.uniform(-1, 2, f.size_in(i)) for i in range(f.n_in())]


def stage() -> ca.Function:
    """A stage: a carried vector and number, columns, what all stages share, three results."""
    x, n, u, w, c = (ca.SX.sym(k, s) for k, s in (("x", 3), ("n", 1), ("u", 2), ("w", 1), ("c", 2)))
    after = ca.vertcat(ca.sin(x[1]) + u[0], x[2] * c[0] - n, x[0] + w)
    return ca.Function(
        "stage", [x, n, u, w, c], [after, n * 0.5 + u[1], x * n, n + w],
        ["x", "n", "u", "w", "c"], ["x_after", "n_after", "row", "mark"],
    )  # fmt: skip


@pytest.mark.parametrize("backward", [False, True])
@pytest.mark.parametrize("count", [3, 7, 20])
def test_stages_are_a_loop_and_every_bit_stays(tmp_path, count, backward):
    f = scan(stage(), count, 2, 1, backward)
    found = find_scan(f)
    assert found is not None
    assert (found.inner.name(), found.count, found.backward) == ("stage", count, backward)
    assert found.carried == {0: 0, 1: 1}
    assert found.columns == {2, 3}
    text = same(f, tmp_path, numbers(f))
    assert text.count("stage(") == 1
    assert f"i = {count - 1 if backward else 0};" in text


@pytest.mark.parametrize("count", [4, 5])
def test_a_state_that_every_stage_gives_is_no_copy(tmp_path, count):
    """Also what is the argument of the next call then, and a fold, which gives the last alone."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    one = ca.Function("one", [x, u], [ca.vertcat(x[1] * u, x[0] - u)], ["x", "u"], ["y"])
    z, v = ca.MX.sym("z", 2), ca.MX.sym("v", 1, count)
    states = [z]
    for k in range(count):
        states.append(one(states[-1], v[k]))
    f = ca.Function("all", [z, v], [ca.horzcat(*states[1:]), states[-1]], ["z", "v"], ["Z", "e"])
    assert find_scan(f) is not None
    assert "copy(e, &Z[" in same(f, tmp_path, numbers(f))
    fold = one.fold(count)
    text = same(fold, tmp_path, numbers(fold))
    assert "by_turns" in text


def test_what_is_not_the_next_column_is_no_loop(tmp_path):
    """A column left out, two in turns, an argument that is something else once."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    one = ca.Function("one", [x, u], [x * u + 1], ["x", "u"], ["y"])
    z, v = ca.MX.sym("z"), ca.MX.sym("v", 1, 6)
    for places in ([0, 1, 2, 3, 4], [0, 1, 2, 3, 5, 4], [0, 0, 1, 2, 3, 4]):
        y = z
        for k in places:
            y = one(y, v[k])
        f = ca.Function("f", [z, v], [y], ["z", "v"], ["y"])
        assert find_scan(f) is None
        same(f, tmp_path, numbers(f))
    y = one(one(one(z, v[0]) * 2, v[1]), v[2])
    f = ca.Function("f", [z, v], [y], ["z", "v"], ["y"])
    assert find_scan(f) is None
    same(f, tmp_path, numbers(f))


def test_one_column_for_all_stages_is_not_copied_for_each(tmp_path):
    """Neither for those of a loop, nor for those of a map."""
    f = scan(stage(), 6, 2, 1)
    symbols = [ca.MX.sym(n, *s) for n, s in (("x", (3, 1)), ("n", (1, 1)), ("u", (2, 1)),
                                             ("w", (1, 6)), ("c", (2, 1)))]  # fmt: skip
    x, n, u, w, c = symbols
    results = f.call([x, n, ca.repmat(u, 1, 6), w, c], False, True)
    y, a = ca.SX.sym("y", 2), ca.SX.sym("a")
    each = ca.Function("each", [y, a], [y * a], ["y", "a"], ["product"]).map(6)
    results.append(each(ca.repmat(u, 1, 6), w))
    g = ca.Function("outer", symbols, results, ["x", "n", "u", "w", "c"], list("pqrst"))
    text = same(g, tmp_path, numbers(g))
    assert "%" not in text
    assert "[12]" not in text.partition("{")[2]


def halved() -> ca.Function:
    """Halve a number until it is below 1; ``going`` says whether to go on."""
    z, k = ca.SX.sym("z", 3), ca.SX.sym("k")
    value = z[0] / 2 + k
    return ca.Function(
        "halve", [z, k], [ca.vertcat(value, value > 1, z[2] + 1)], ["z", "k"], ["z_next"]
    )  # fmt: skip


@pytest.mark.parametrize("begun", [False, True])
@pytest.mark.parametrize("most", [2, 3, 8, 21])
def test_again_and_again_is_a_loop_that_ends(tmp_path, most, begun):
    """As often as CasADi does it: powers of two, each where something is left to do."""
    z, k = ca.MX.sym("z", 3), ca.MX.sym("k")
    repeated = Repeated(halved(), 1)
    f = ca.Function(
        "whole", [z, k], [repeated(most, z, k, begun=begun)], ["z", "k"], ["z_next"]
    )  # fmt: skip
    made = Functions({})
    if not begun:
        found = made._again(f)
        assert found is not None
        assert (found.once.name(), found.most, found.going) == ("halve", most, 1)
    for start, going in ((3.0, 1.0), (1e6, 1.0), (1e12, 0.5), (5.0, 0.0), (5.0, np.nan)):
        text = same(f, tmp_path, [[start, going, 0.0], 1e-3])
    assert begun or text.count("halve(") == 1


def test_what_goes_on_otherwise_is_no_such_loop():
    """Another number asked, other constants, two Functions, or nothing asked at all."""
    z, k = ca.MX.sym("z", 3), ca.MX.sym("k")
    once = halved()
    stay = ca.Function("stay", [z, k], [z])
    maybe = ca.Function.if_else("maybe", once, stay)

    def found(first: Any, second: Any) -> Any:
        y = maybe(first, z, k)
        y = maybe(second(y), y, k)
        f = ca.Function("f", [z, k], [y], ["z", "k"], ["z_next"])
        return Functions({})._again(f)

    assert found(z[1] > 0, lambda y: y[1] > 0).most == 2
    assert found(z[1] > 0, lambda y: y[2] > 0) is None
    assert found(z[1] > 0, lambda y: y[1] > 1) is None
    y = maybe(z[1] > 0, z, k)
    f = ca.Function("f", [z, k], [maybe(y[1] > 0, y, k + 1)], ["z", "k"], ["z_next"])
    assert find_while_loop(f, lambda g: None) is None
    f = ca.Function("f", [z, k], [once(once(z, k), k)], ["z", "k"], ["z_next"])
    assert find_while_loop(f, lambda g: None) is None


def test_names_of_the_python_that_wrote_it(tmp_path):
    @remember_locals
    def made() -> Any:
        x, k = ca.MX.sym("x", 5), ca.MX.sym("k")
        slope = x * k
        both = ca.vertcat(slope, x)
        largest = ca.mmax(both)
        return "f", [x, k], [both / largest, largest], ["x", "k"], ["y", "most"]

    f = made()
    text = same(f, tmp_path, numbers(f))
    assert "double both[10];" in text
    assert "double largest = " in text
    assert not re.search(r"\ba\d", text)


def test_large_arrays_lie_in_the_state_where_they_are_much(tmp_path, monkeypatch):
    """The same bits from there; no array of another function is touched."""
    x, k = ca.MX.sym("x", 30), ca.MX.sym("k")
    inner = ca.Function("inner", [x, k], [ca.cumsum(ca.sin(x) * k) / ca.mmax(x)], ["x", "k"], ["y"])
    y = inner(inner(x + 1, k), 2 * k)
    f = ca.Function("f", [x, k], [y, ca.sumsqr(y)], ["x", "k"], ["y", "size"])
    made, _ = written(f)
    called = code("f(in->x, in->k, now->y, &now->size);")
    (work,) = code("struct W *work;")
    few = scratch.off_stack(made.made, called, work)
    assert few.made == made.made
    assert not few.arrays
    monkeypatch.setattr(scratch, "DEEPEST", 30)
    moved = scratch.off_stack(made.made, called, work)
    assert lines_of(moved.lines) == ["f(in->x, in->k, now->y, &now->size, work);"]
    assert sum(n for rows in moved.arrays.values() for _, n in rows) > 30
    for function, node in moved.made.items():
        text = file_text([node])
        assert set(re.findall(r"work->(\w+)", text)) <= {function}
        assert not re.search(r"double \w+\[30\];", text)
    structs = "\n".join(scratch.structs(moved.arrays, "W", "double", []))
    declared = ", ".join(["const double *x", "double k", "double *y", "double *size"])
    body = ["static struct W w;", "f(x, k, y, size, &w);"]
    functions = {**moved.made, "outer": define(f"static void outer({declared})", body)}
    given = numbers(f)
    found = run(f, given, tmp_path, functions, "outer", structs)
    for value, true in zip(found, f.call(given), strict=True):
        np.testing.assert_array_equal(value, np.array(true).ravel(order="F"))
    assert all(a < b for a, b in pairwise([0, len(moved.arrays)]))
