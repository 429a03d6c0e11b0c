"""Results of calls in CasADi's text lie where they are wanted: no copy, and the same bits."""

import ctypes
import subprocess

import casadi as ca
import numpy as np
import pytest

from slipctl.ccode.passes.direct_results import direct
from slipctl.ccode.tree.casadi_text import static_c
from slipctl.ccode.tree.nodes import function
from slipctl.ccode.tree.parser import code
from slipctl.ccode.tree.printer import file_text

INCLUDES = "#include <math.h>\n#include <stdbool.h>\n#include <stddef.h>\n"


def called(name, n, k):
    """Function (x[n], c) -> (x', sums) that stays a call."""
    x, c = ca.MX.sym("x", n), ca.MX.sym("c")
    y = ca.sin(x) * c + k
    return ca.Function(name, [x, c], [y, ca.cumsum(y)[: n - 1]], {"never_inline": True})


def chained():
    """Calls whose results are handed on, given out, given out twice, or read again."""
    f, g = called("f", 5, 0.3), called("g", 5, -1.7)
    x, c = ca.MX.sym("x", 5), ca.MX.sym("c")
    a, b = f(x, c)
    d, e = g(a, c)
    p, q = f(d, c)
    r, s = g(p, c + 1)
    results = [ca.horzcat(e, b), d, ca.vertcat(q, q), r, s, ca.sumsqr(s), ca.vertcat(a[1:3], p)]
    whole = ca.Function("chained", [x, c], results, {"cse": True})
    u, k = ca.MX.sym("u", 5), ca.MX.sym("k")
    outs = whole.call([u, k], False, True)
    return ca.Function("outer", [u, k], outs)


def run(text, f, given, folder):
    """Results of the C of a Function; of an output that is left out, none."""
    (folder / "c.c").write_text(
        INCLUDES + file_text(text.made)
        + f"\nint run(const double **a, double **r, double *w)\n"
          f"{{ return {text.entries[0]}(a, r, 0, w, 0); }}\n"
    )  # fmt: skip
    flags = ["-std=c99", "-O1", "-Wall", "-Werror", "-shared", "-fPIC", "-ffp-contract=off"]
    subprocess.run(["gcc", *flags, "c.c", "-o", "c.so", "-lm"], cwd=folder, check=True)
    unit = ctypes.CDLL(str(folder / "c.so"))
    P = ctypes.POINTER(ctypes.c_double)
    sizes = [f.numel_out(i) for i in range(f.n_out())]
    found = []
    for left_out in (None, *range(f.n_out())):
        rows = [np.full(n, np.nan) for n in sizes]
        arg = (P * text.work[0])(*[np.ascontiguousarray(v).ctypes.data_as(P) for v in given])
        res = (P * text.work[1])(
            *[None if k == left_out else v.ctypes.data_as(P) for k, v in enumerate(rows)]
        )
        work = np.full(text.work[3] + 1, np.nan)
        assert unit.run(arg, res, work.ctypes.data_as(P)) == 0
        found.append([None if k == left_out else v for k, v in enumerate(rows)])
    return found


def test_calls_write_where_results_are_wanted_and_every_bit_stays(tmp_path):
    """Also where a result is not asked for."""
    f, given = chained(), [np.linspace(-1.1, 2.3, 5), np.array([0.7])]
    text = static_c([f], {}, "test")
    assert "res1[0] = res[" in file_text(text.made)
    expected = [np.array(v).ravel(order="F") for v in f(*given)]
    for found in run(text, f, given, tmp_path):
        for value, true in zip(found, expected, strict=True):
            assert value is None or np.array_equal(value, true)


CALL = """static int f(const casadi_real** arg, casadi_real** res, casadi_real* w) {{
  casadi_real **res1=res+2, *w0=w+9, *w1=w+12;
  arg1[0]=arg[0];
  res1[0]=w0;
  if (casadi_f1(arg1, res1, iw, w, 0)) return 1;
{}
  return 0;
}}"""
COPY = "  casadi_copy(w0, 3, res[0]);"


@pytest.mark.parametrize(
    ("lines", "moved"),
    [
        (COPY, True),
        ("  if (res[1]) casadi_copy(w0, 3, res[1]+4);", True),
        (f"{COPY}\n  for (i=0, rr=w0, cs=w1; i<3; ++i) (*rr++)  = (w2 != 0 ? cs[i]:0);", True),
        (f"{COPY}\n  for (i=0, rr=w0, cs=w1; i<3; ++i) (*rr++) += (*cs++);", False),
        (f"{COPY}\n  for (cii=casadi_s0, rr=w0, ss=w1; cii!=e; ++cii) rr[*cii] = *ss++;", False),
        (f"{COPY}\n  w2 = casadi_dot(3, w0, w0);", False),
        (f"  w2 = w0[1];\n{COPY}", False),
        (f"{COPY}\n  casadi_copy(w0, 3, res[1]);", False),
    ],
)
def test_a_result_that_is_read_elsewhere_too_is_copied(lines, moved):
    (made,) = code(CALL.format(lines), {"casadi_real": "double"})
    head, body = made.parts
    text = file_text([function(made.head, head.head, head.parts, direct(body).parts)])
    assert ("res1[0] = w0;" not in text) == moved
    assert text.count("casadi_copy") == lines.count("casadi_copy") - moved
    assert ("*w0 = w + 9" in text) == ("w0" in text.replace("*w0 = w + 9", ""))
