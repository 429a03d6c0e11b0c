"""Random Functions of CasADi in C, of any shapes, with calls, maps, folds and choices: every bit.

All of them are one file of C, which is compiled once.
"""

from __future__ import annotations

import ctypes
import random
import subprocess
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from slipctl.ccode.tree.expressions import Unsupported
from slipctl.ccode.tree.functions import Functions, returns_number
from slipctl.ccode.tree.helpers import helpers
from slipctl.ccode.tree.printer import file_text

HEAD = "#include <math.h>\n#include <stdbool.h>\n#include <stddef.h>\n"
SHAPES = ((1, 1), (1, 1), (3, 1), (4, 1), (2, 2), (1, 3), (0, 1))
ONE = (
    ca.sin, ca.tanh, ca.fabs, ca.floor, ca.sign, ca.atan, lambda x: -x, lambda x: x * x,
    lambda x: ca.sqrt(x * x + 1), lambda x: ca.exp(-ca.fabs(x)), lambda x: 1 / (x * x + 0.5),
    lambda x: ca.log(x * x + 2), lambda x: 2 * x - 1, ca.ceil, lambda x: ca.if_else(x > 0.5, 1, x),
    lambda x: ca.logic_not(x > 0), lambda x: x**3, ca.cosh, lambda x: ca.asin(ca.sin(x)), ca.erf,
    lambda x: ca.fmod(x, 0.75), lambda x: ca.if_else(x, 0.3, 0.2),
    lambda x: ca.fmin(ca.fmax(x, -1), 1),
)  # fmt: skip
TWO = (
    lambda x, y: x + y, lambda x, y: x - y, lambda x, y: x * y, lambda x, y: x / (y * y + 1),
    ca.fmin, ca.fmax, lambda x, y: ca.if_else(x < y, x, 2 * y), lambda x, y: ca.atan2(x, y * y + 1),
    lambda x, y: ca.if_else(ca.logic_and(x > 0, ca.logic_not(y > 0)), y, x - y),
    lambda x, y: ca.if_else(ca.logic_or(x <= 0, y == 0), x + 0.25, y),
)  # fmt: skip


def shaped(rng: random.Random, x: Any) -> Any:
    """A part of a matrix, or its numbers in another order."""
    rows, columns = x.shape
    kind = rng.randrange(15)
    if kind == 7:
        return ca.cumsum(x) if columns == 1 else ca.sum2(x)
    if kind == 8:
        return rng.choice((ca.mmax, ca.mmin, ca.norm_inf, ca.norm_1, ca.norm_fro))(x)
    if kind == 9 and rows > 2:
        return x[::2, :]
    if kind == 10 and columns > 1:
        return ca.horzsplit(x)[rng.randrange(columns)]
    if kind == 11 and columns == 1:
        return ca.diag(x)
    if kind == 12 and rows > 1:
        y = type(x)(x)
        y[rng.randrange(rows), 0] = rng.choice((0.5, x[0, 0] * 2))
        return y
    if kind == 13 and columns == 1:
        return ca.mtimes(ca.DM(np.arange(2 * rows).reshape(2, rows) % 3), x)
    if kind == 14 and columns == 1:
        return ca.mtimes(ca.sparsify(ca.DM(np.arange(2 * rows).reshape(2, rows) % 3)), x)
    if kind == 0 and rows > 1:
        return x[1:, :]
    if kind == 1 and rows > 1:
        return x[::-1, :]
    if kind == 2:
        return x.T
    if kind == 3:
        return ca.vec(x)[rng.randrange(rows * columns)]
    if kind == 4 and columns == 1 and rows % 2 == 0:
        return ca.reshape(x, 2, rows // 2)
    if kind == 5:
        return ca.sum1(ca.vec(x))
    return ca.vertcat(x, x[-1, :])


def joined(rng: random.Random, pool: list[Any]) -> Any:
    """One more expression of those that there are."""
    x, y = rng.choice(pool), rng.choice(pool)
    kind = rng.randrange(8)
    if kind < 2:
        return rng.choice(ONE)(x)
    if kind < 5:
        y = y if y.shape == x.shape or y.is_scalar() else ca.vec(y)[0]
        return rng.choice(TWO)(x, y)
    if kind == 5 and x.shape[1] == y.shape[0]:
        return ca.mtimes(x, y)
    if kind == 6 and x.shape == y.shape:
        return rng.choice((ca.dot, lambda a, b: ca.norm_2(ca.vec(a - b))))(x, y)
    return shaped(rng, x)


def called(rng: random.Random, f: ca.Function, pool: list[Any]) -> list[Any]:
    """What a Function gives, of arguments that there are; some of them are zero, or the same."""
    given = []
    for i in range(f.n_in()):
        fitting = [x for x in pool if x.shape == f.size_in(i)]
        zero = not fitting or rng.random() < 0.1
        given.append(ca.MX(*f.size_in(i)) if zero else rng.choice(fitting))
    made = f.call(given, False, True)
    return [r for r in made if not r.is_empty() and rng.random() < 0.7]


def repeated(rng: random.Random, f: ca.Function, pool: list[Any]) -> list[Any]:
    """What a Function gives for each column, or of what it gave before."""
    many = rng.randrange(2, 6)
    first = [x for x in pool if x.shape == f.size_in(0)]
    if f.size_in(0) == f.size_out(0) and first and rng.random() < 0.6:
        whole = rng.choice((f.fold, f.mapaccum))(many)
    else:
        whole = f.map(many)
    given = []
    for i in range(whole.n_in()):
        rows, columns = whole.size_in(i)
        fitting = [x for x in pool if x.shape == (rows, columns)]
        fitting += [ca.repmat(x, 1, many) for x in pool if x.shape == (rows, columns / many)]
        fitting += [ca.horzcat(*(x * (k + 0.5) for k in range(many)))
                    for x in pool if x.shape == (rows, columns / many)]  # fmt: skip
        given.append(rng.choice(fitting) if fitting else ca.MX.ones(rows, columns))
    return [r for r in whole.call(given, False, True) if not r.is_empty()]


def random_function(rng: random.Random, name: str, known: list[ca.Function]) -> ca.Function:
    """A Function of random shapes, that calls others."""
    kind = ca.SX if not known or rng.random() < 0.3 else ca.MX
    letters = rng.sample("xyzuvw", rng.randrange(1, 5))
    symbols = [kind.sym(n, *rng.choice(SHAPES)) for n in letters]
    if all(s.is_empty() for s in symbols):
        symbols[0] = kind.sym(letters[0], 3)
    pool = [s for s in symbols if not s.is_empty()]
    for _ in range(rng.randrange(3, 9)):
        new: list[Any] = []
        if kind is ca.MX and rng.random() < 0.35:
            f = rng.choice(known)
            new = (repeated if rng.random() < 0.4 else called)(rng, f, pool)
        new = new or [joined(rng, pool)]
        pool += [x for x in new if x.numel() <= 24]
    results = [rng.choice(pool[len(symbols) // 2 :]) for _ in range(rng.randrange(1, 4))]
    results = [ca.densify(r) for r in results]
    if rng.random() < 0.3:
        results.insert(rng.randrange(len(results) + 1), kind(0, 1))
    names = [f"r{k}" for k in range(len(results))]
    return ca.Function(name, symbols, results, [str(s) for s in letters], names)


def wrapper(f: ca.Function, name: str, k: int) -> str:
    """C that calls a function with all arguments and results by address."""
    places = [f"*a[{i}]" if f.nnz_in(i) == 1 else f"a[{i}]" for i in range(f.n_in()) if f.nnz_in(i)]
    outputs = [i for i in range(f.n_out()) if f.nnz_out(i)]
    if returns_number(f):
        call = f"*r[{outputs[0]}] = {name}({', '.join(places)});"
    else:
        call = f"{name}({', '.join([*places, *(f'r[{i}]' for i in outputs)])});"
    return f"void run{k}(const double **a, double **r) {{ (void)a; (void)r; {call} }}\n"


@pytest.mark.parametrize("seed", [1, 2])
def test_every_bit_is_that_of_casadi(tmp_path: Path, seed: int) -> None:
    rng = random.Random(seed)
    known: list[ca.Function] = []
    made, texts, asked, left = Functions({}), "", [], 0
    for k in range(60):
        f = random_function(rng, f"f{k}", known)
        try:
            name = made.name(f)
        except Unsupported:
            left += 1
            continue
        known.append(f)
        texts += wrapper(f, name, k)
        asked.append((k, f))
    assert left < 20
    functions = list(made.made.values())
    whole = HEAD + file_text([*helpers(functions), *functions]) + "\n" + texts
    (tmp_path / "all.c").write_text(whole, encoding="utf-8")
    flags = ["-std=c99", "-O1", "-Wall", "-Wshadow", "-shared", "-fPIC", "-ffp-contract=off"]
    subprocess.run(["gcc", *flags, "all.c", "-o", "all.so", "-lm"], cwd=tmp_path, check=True)
    unit = ctypes.CDLL(str(tmp_path / "all.so"))
    P, numbers = ctypes.POINTER(ctypes.c_double), np.random.default_rng(seed)
    for k, f in asked:
        given = [numbers.uniform(-2, 2, f.size_in(i)) for i in range(f.n_in())]
        columns = [v.ravel(order="F") for v in given]
        found = [np.full(f.nnz_out(i), np.nan) for i in range(f.n_out())]
        pointers = [(P * len(rows))(*(v.ctypes.data_as(P) for v in rows))
                    for rows in (columns, found)]  # fmt: skip
        getattr(unit, f"run{k}")(*pointers)
        for value, true in zip(found, f.call(given), strict=True):
            expected = np.array(ca.densify(true)).ravel(order="F")
            np.testing.assert_array_equal(value, expected, err_msg=f"{f}")
