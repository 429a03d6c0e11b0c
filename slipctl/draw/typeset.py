"""Formulas written from a graph as LaTeX; as plain text by ``block.plain_text``."""

from __future__ import annotations

import math
import re

from slipctl.block.text.formula import HIDDEN
from slipctl.block.text.plain_text import ATOM, CASE, POWER, PRODUCT, SUM, Text

GREEK = frozenset(
    re.findall(
        r"\w+",
        "alpha beta gamma delta epsilon zeta eta theta iota kappa lambda mu nu xi pi rho sigma tau"
        " upsilon phi chi psi omega Gamma Delta Theta Lambda Xi Pi Sigma Upsilon Phi Psi Omega",
    )
)
_ACCENTS = {"hat": "hat", "bar": "bar", "tilde": "tilde", "dot": "dot"}


class Latex(Text):
    """Writes formulas as LaTeX."""

    times, pi, dots = r" \, ", r"\pi", r"\dots"

    def symbol(self, name: str) -> str:
        """Write a name."""
        hidden = HIDDEN.fullmatch(name)
        if hidden:
            return rf"(1\,{unit(hidden[1])})"
        return letter(name)

    def number(self, value: float) -> str:
        """Write a number, rounded to ``digits``."""
        for times in (1, 2):
            if value == times * math.pi:
                return self.times.join(["2"] * (times - 1) + [self.pi])
        if math.isinf(value):
            return r"\infty" if value > 0 else r"-\infty"
        text = super().number(value)
        mantissa, e, exponent = text.partition("e")
        if not e:
            return text
        ten = f"10^{{{exponent}}}"
        return ten if mantissa == "1" else rf"{mantissa} \cdot {ten}"

    def bracket(self, text: str) -> str:
        """Put brackets around."""
        return rf"\left({text}\right)"

    def power(self, base: str, exponent: str, simple: bool) -> str:
        """Write a power."""
        return f"{{{base}}}^{{{exponent}}}" if "^" in base else f"{base}^{{{exponent}}}"

    def fraction(
        self, above: list[tuple[int, float]], below: list[tuple[int, float]]
    ) -> tuple[str, int]:
        """Write a product as a fraction; a sum among its factors stands behind."""
        if not below:
            alone = len(above) == 1
            return super().fraction(above, below) if alone else (self.join(above), PRODUCT)
        sums = [(n, e) for n, e in above if e == 1 and self.at(n)[1] <= SUM]
        behind = [] if len(sums) == len(above) else sums
        inside = [f for f in above if f not in behind]
        top = self.factor(*inside[0], alone=True) if len(inside) == 1 else self.join(inside)
        bottom = self.factor(*below[0], alone=True) if len(below) == 1 else self.join(below)
        tail = "".join(self.times + self.factor(n, e) for n, e in behind)
        return rf"\frac{{{top or '1'}}}{{{bottom}}}{tail}", PRODUCT

    def join(self, parts: list[tuple[int, float]]) -> str:
        """Product; a number behind another factor gets a dot before it."""
        out = ""
        for n, e in parts:
            number = self.g.nodes[n].op == "const"
            out += ("" if not out else r" \cdot " if number else self.times) + self.factor(n, e)
        return out

    def call(self, op: str, args: list[str]) -> tuple[str, int]:
        """Write a function of arguments."""
        inside = ", ".join(args)
        if op == "exp":
            deep = any(c in inside for c in (r"\frac", r"\begin", r"\left"))
            return (rf"\exp{self.bracket(inside)}" if deep else f"e^{{{inside}}}"), POWER
        shapes = {
            "sqrt": r"\sqrt{%s}", "fabs": r"\left|%s\right|", "floor": r"\lfloor %s \rfloor",
            "ceil": r"\lceil %s \rceil", "log1p": r"\ln\left(1 + %s\right)",
            "expm1": r"\left(e^{%s} - 1\right)",
        }  # fmt: skip
        if op in shapes:
            return shapes[op] % inside, ATOM
        known = {
            "fmin": r"\min", "fmax": r"\max", "log": r"\ln", "log10": r"\log_{10}",
            "asin": r"\arcsin", "acos": r"\arccos", "atan": r"\arctan",
        }  # fmt: skip
        plain = ("sin", "cos", "tan", "sinh", "cosh", "tanh")
        name = known.get(op) or (f"\\{op}" if op in plain else rf"\operatorname{{{op}}}")
        return f"{name}{self.bracket(inside)}", ATOM

    def logic(self, op: str, parts: list[str]) -> str:
        """Write not, and, or."""
        sign = {"not": r"\neg ", "and": r" \land ", "or": r" \lor "}[op]
        return sign + parts[0] if op == "not" else sign.join(parts)

    def relation(self, op: str) -> str:
        """Write the sign of a comparison."""
        return {"<=": r"\le", ">=": r"\ge", "==": "=", "!=": r"\ne"}.get(op, op)

    def cases(self, branches: list[tuple[int, int]], rest: int | None) -> tuple[str, int]:
        """Write a formula with branches."""
        rows = [rf"{self.at(v)[0]} & {self.at(c)[0]}" for c, v in branches]
        rows.append(rf"{'0' if rest is None else self.at(rest)[0]} & \text{{otherwise}}")
        return r"\begin{cases} " + r" \\ ".join(rows) + r" \end{cases}", CASE


def unit(text: str) -> str:
    """Write a unit as LaTeX: upright, exponents raised."""
    raised = re.sub(r"\^([-\d./]+)", r"^{\1}", text).replace("%", r"\%")
    return rf"\mathrm{{{raised.replace(' ', chr(92) + ',')}}}"


def letter(name: str, accent: str = "") -> str:
    r"""Write a name as LaTeX: ``omega`` is \omega, ``v_s`` v_{s}, ``F_a_hat`` \hat{F}_{a}.

    Args:
        name: name in the equations; a part's name in front (``car.v``) is written above.
        accent: LaTeX accent to put on the letter, ``"dot"`` for a derivative.
    """
    part, _, own = name.rpartition(".")
    own, bracket, index = own.rstrip("_").partition("[")
    pieces = own.split("_")
    stem, below = pieces[0], pieces[1:]
    split = re.fullmatch(r"([A-Za-z]+?)(\d+)", stem)
    if split:
        stem, below = split[1], [split[2], *below]
    accents = [_ACCENTS[b] for b in below if b in _ACCENTS]
    below = [b for b in below if b not in _ACCENTS]
    if bracket:
        below.append(index.rstrip("]"))
    if stem in GREEK:
        base = "\\" + stem
    elif len(stem) == 1:
        base = stem
    else:
        base = rf"\mathrm{{{stem}}}"
    for a in [*accents, *([accent] if accent else [])]:
        base = rf"\{a}{{{base}}}"
    text = base + (f"_{{{','.join(_subscript(b) for b in below)}}}" if below else "")
    above = part.replace("_", r"\_")
    return rf"{text}^{{\mathrm{{{above}}}}}" if part else text


def _subscript(text: str) -> str:
    if text in GREEK:
        return "\\" + text
    if text == "inf":
        return r"\infty"
    return text if len(text) == 1 or text.isdigit() else rf"\mathrm{{{text}}}"
