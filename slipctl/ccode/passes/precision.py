"""Double or float: the C is written in double, and turned into float token by token.

Nothing of double is left: types, literals, limits of <float.h> and calls of <math.h>. Comments and
strings stay as they are.
"""

from __future__ import annotations

import re

import numpy as np

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
_TOKEN = re.compile(
    r"""/\*.*?\*/ | "(?:\\.|[^"\\])*" | '(?:\\.|[^'\\])*' | ^[ \t]*\#\s*include[^\n]*
        | (?P<number>(?<![\w.])(?:\d+\.\d*|\.\d+|\d+(?=[eE]))(?:[eE][+-]?\d+)?)
        | (?P<word>[A-Za-z_]\w*)(?P<call>(?=\s*\())?""",
    re.VERBOSE | re.DOTALL | re.MULTILINE,
)


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


def tolerant(text: str) -> str:
    """CasADi's solvers in float: tolerances that float can reach, where theirs are of double."""
    text = re.sub(r"(constr_viol_tol = )1e-0?8\b", r"\g<1>1e-5", text)
    text = re.sub(r"(dual_inf_tol = )1e-0?8\b", r"\g<1>1e-3", text)
    text = re.sub(r"(?<=[<>=,] )(-?)1e-12\b|(?<=[<>])(-?)1e-12\b", r"\g<1>\g<2>1e-6", text)
    return re.sub(r"(?<=[<> ])1e-14\b|(?<=<)1e-14\b", "1e-7", text)


def size(real: str) -> int:
    """Bytes of a number."""
    return 4 if real == "float" else 8


def in_precision(text: str, real: str, where: str) -> str:
    """C text that was written in double, in the precision asked for.

    Raises:
        BadInput: a constant that is too large for float.
    """
    if real == "double":
        return text

    def turned(m: re.Match[str]) -> str:
        if m["number"]:
            return _literal(m["number"], where)
        if m["word"]:
            return m["word"] + "f" if m["call"] is not None and m["word"] in MATH else (
                _WORDS.get(m["word"], m["word"])
            )  # fmt: skip
        return m[0]

    return _TOKEN.sub(turned, text)


def _literal(text: str, where: str) -> str:
    """A literal of float: the float nearest to the double that the model has.

    What is not 0 stays that, and what is below 1 stays so.
    """
    value = float(text)
    single = np.float32(value) if abs(value) < 3.5e38 else np.float32(np.inf)
    if np.isinf(single):
        raise BadInput(f"{where}: the number {text} is too large for float; write it with double")
    tiny = np.finfo(np.float32).tiny
    if value and single < tiny:  # what keeps a divisor from zero shall go on doing so
        single = tiny
    if value < 1 <= single:  # what keeps a number from 1 too: behind it may be a pole
        single = np.nextafter(np.float32(1), np.float32(0))
    said = str(single)
    return (said if any(c in said for c in ".e") else said + ".0") + "f"
