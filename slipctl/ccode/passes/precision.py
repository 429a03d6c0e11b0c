"""Double or float: the C is written in double, and turned into float node by node.

Nothing of double is left: types, literals, limits of <float.h> and calls of <math.h>. Comments and
strings stay as they are.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.expressions import number
from slipctl.ccode.tree.nodes import Node
from slipctl.errors import BadInput, nearest

REALS = ("double", "float")
"""What a number can be in C."""

_MATH = """
acos acosh asin asinh atan atan2 atanh cbrt ceil copysign cos cosh erf erfc exp exp2 expm1
fabs fdim floor fma fmax fmin fmod frexp hypot ldexp lgamma log log10 log1p log2 logb modf
nearbyint nextafter pow remainder rint round scalbn sin sinh sqrt tan tanh tgamma trunc
"""
MATH = frozenset(_MATH.split())
"""Functions of <math.h> in double; with an f at the end they are those in float."""

_WORDS = {
    "double": "float", "DBL_MAX": "FLT_MAX", "DBL_MIN": "FLT_MIN", "DBL_EPSILON": "FLT_EPSILON",
}  # fmt: skip


def check_real(real: str) -> str:
    """The type, if it is one.

    Raises:
        BadInput: neither double nor float.
    """
    if real not in REALS:
        raise BadInput(f"real = {real!r} is no C type for numbers{nearest(real, REALS)}")
    return real


def round_to_real(value: object, real: str) -> np.ndarray:
    """Numbers as C has them, in double again; what is too large for float becomes infinite."""
    array = np.asarray(value, dtype=float)
    if real == "double":
        return array
    with np.errstate(over="ignore", under="ignore"):
        return array.astype(np.float32).astype(float)


def neighbour_float(value: np.ndarray, draws: np.ndarray) -> np.ndarray:
    """One of the two floats beside each finite number; draws from [0, 1) make it the mean."""
    near = round_to_real(value, "float")
    with np.errstate(over="ignore", invalid="ignore"):  # what is too large stays infinite
        side = np.where(near < value, np.inf, -np.inf).astype(np.float32)
        other = np.nextafter(near.astype(np.float32), side).astype(float)
        return np.where(draws * np.abs(other - near) < np.abs(value - near), other, near)


def epsilon(real: str) -> float:
    """Spacing of numbers at 1."""
    return float(np.finfo(np.float32 if real == "float" else np.float64).eps)


def tolerant(n: Node) -> Node:
    """CasADi's solvers in float: tolerances that float can reach, where theirs are of double."""
    named = {"constr_viol_tol": "1e-5", "dual_inf_tol": "1e-3"}

    def number_of(x: Node) -> Node | None:
        small = {"1e-12": "1e-6", "1e-14": "1e-7"}.get(x.head) if x.kind == "number" else None
        return Node("number", small) if small else None

    def rule(x: Node) -> Node | None:
        to = x.parts[0] if x.kind == "op" and x.head == "=" else None
        if to is None or to.kind != "member":
            return None
        tolerance = named.get(to.head.lstrip("->."))
        return c.op(
            to, "=", Node("number", tolerance) if tolerance else x.parts[1].change(number_of)
        )

    library = n.kind == "function" and n.parts[0].head.startswith("casadi_")
    return n.change(rule).change(number_of) if library else n.change(rule)


def size(real: str) -> int:
    """Bytes of a number."""
    return 4 if real == "float" else 8


def in_precision(node: Node, real: str, where: str) -> Node:
    """C that was written in double, in the precision asked for.

    Raises:
        BadInput: a constant that is too large for float.
    """
    if real == "double":
        return node

    def rule(n: Node) -> Node | None:
        if n.kind == "number":
            whole = n.head.isdecimal() or n.head[-1] in "uU"
            return n if whole else Node("number", literal(float(n.head), real, where))
        head = n.head
        if n.kind == "call" and head in MATH:
            head += "f"
        elif n.kind in ("name", "declare", "cast", "function"):
            head = " ".join(_WORDS.get(w, w) for w in head.split(" "))
        if head != n.head:
            return replace(n, head=head, parts=tuple(in_precision(p, real, where) for p in n.parts))
        return None

    return node.change(rule)


def literal(value: float, real: str, where: str) -> str:
    """A number as C has it. In float it is the float nearest to the double that the model has.

    What is not 0 stays that, and what is below 1 stays so.

    Raises:
        BadInput: it is too large for float.
    """
    if real == "double" or not np.isfinite(value):
        return number(value)
    if value < 0:
        return f"-{literal(-value, real, where)}"
    single = np.float32(value) if abs(value) < 3.5e38 else np.float32(np.inf)
    if np.isinf(single):
        said = number(value)
        raise BadInput(f"{where}: the number {said} is too large for float; write it with double")
    tiny = np.finfo(np.float32).tiny
    if value and single < tiny:  # what keeps a divisor from zero shall go on doing so
        single = tiny
    if value < 1 <= single:  # what keeps a number from 1 too: behind it may be a pole
        single = np.nextafter(np.float32(1), np.float32(0))
    said = str(single)
    return (said if any(c in said for c in ".e") else said + ".0") + "f"
