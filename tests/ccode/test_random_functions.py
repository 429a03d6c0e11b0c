"""Random Functions of CasADi in C, of any shapes, with calls, maps, folds and choices: every bit.

All of them are one file of C, which is compiled once.
"""

from __future__ import annotations

import ctypes
import random
import subprocess
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from random_models import random_function

from slipctl.ccode.tree.expressions import Unsupported
from slipctl.ccode.tree.functions import Functions, returns_number
from slipctl.ccode.tree.helpers import helpers
from slipctl.ccode.tree.printer import file_text

HEAD = "#include <math.h>\n#include <stdbool.h>\n#include <stddef.h>\n"


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
