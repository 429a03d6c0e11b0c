"""Formulas written from a graph as plain text."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from slipctl.block.text.formula import HIDDEN, Graph, Node, is_tie

_INFIX = {"lt": "<", "le": "<=", "eq": "==", "ne": "!="}
_NEGATED = {"<": ">=", "<=": ">", "==": "!=", "!=": "=="}
_PRODUCT_OPS = ("mul", "div", "inv", "neg", "twice", "sq")

CASE, LOGIC, COMPARE, SUM, PRODUCT, POWER, ATOM = range(7)


def cut(text: str, limit: int) -> str:
    """Shorten a text in its middle."""
    if len(text) <= limit:
        return text
    tail = limit // 4
    return f"{text[: limit - tail - 5]} ... {text[-tail:]}"


LONG = 5
"""Elements of one signal in a row, from which a sum leaves out those in the middle."""


def _elements_in_row(terms: Sequence[tuple[bool, str, str]], at: int) -> int:
    """How many terms from there on are x[k], x[k+1], ... of one signal, with one sign."""
    name, _, index = terms[at][2].rstrip("]").partition("[")
    if not index.isdigit():
        return 1
    many = 1
    while at + many < len(terms):
        wanted = (terms[at][0], f"{name}[{int(index) + many}]")
        if (terms[at + many][0], terms[at + many][2]) != wanted:
            break
        many += 1
    return many


class Text:
    """Writes formulas as text, ``(r*F_a - T_b)/J``; LaTeX replaces single steps of it."""

    times, pi = "*", "pi"
    signs, dots = (" + ", " - "), "..."
    digits = 6

    def __init__(self, g: Graph) -> None:
        self.g = g

    def root(self, node: int) -> str:
        """Write a formula; its own letter, if it has one, is spelled out."""
        return self.expand(node)[0]

    def at(self, node: int) -> tuple[str, int]:
        """Write a part by its letter, if it has one."""
        if node in self.g.letters:
            return self.symbol(self.g.letters[node]), ATOM
        return self.expand(node)

    def wrap(self, node: int, least: int) -> str:
        """Write a part, in brackets where its rank is below ``least``."""
        text, rank = self.at(node)
        return text if rank >= least else self.bracket(text)

    def expand(self, node: int) -> tuple[str, int]:
        """Write a node without its letter, and tell the rank of its operation."""
        op, args, value, name = self.g.nodes[node]
        if op == "symbol":
            return self.symbol(name), ATOM
        if op == "const":
            text = self.number(value)
            return text, SUM if value < 0 else PRODUCT if self.times in text else ATOM
        if branches := self.branches(node, top=True):
            return self.cases(*branches)
        if op in ("add", "sub"):
            return self.sum(node), SUM
        if op in _PRODUCT_OPS:
            if self.is_log10(node):
                return self.call("log10", [self.at(self.g.nodes[args[1]].args[0])[0]])
            sign, text, rank = self.product(node)
            return (text, rank) if sign > 0 else (self.minus(text, rank), SUM)
        if op in _INFIX:
            return self.compare(_INFIX[op], *args), COMPARE
        if op == "not":
            inner = self.g.nodes[args[0]]
            if inner.op in _INFIX and args[0] not in self.g.letters:
                return self.compare(_NEGATED[_INFIX[inner.op]], *inner.args), COMPARE
            return self.logic("not", [self.wrap(args[0], ATOM)]), LOGIC
        if op in ("and", "or"):
            return self.logic(op, [self.wrap(a, COMPARE) for a in args]), LOGIC
        if op in ("constpow", "pow"):
            power = self.g.nodes[args[1]]
            exponent = self.number(power.value) if power.op == "const" else self.at(args[1])[0]
            simple = power.op in ("const", "symbol") and not exponent.startswith("-")
            return self.power(self.wrap(args[0], ATOM), exponent, simple), POWER
        return self.call(op, [self.at(a)[0] for a in args])

    # -- sums and products

    def terms(self, node: int, sign: int, top: bool = False) -> list[tuple[int, int]]:
        """Signs and nodes of the terms of a sum."""
        op, args, *_ = self.g.nodes[node]
        if (node not in self.g.letters or top) and not self.branches(node, top):
            if op in ("add", "sub"):
                return self.terms(args[0], sign) + self.terms(
                    args[1], sign if op == "add" else -sign
                )
            if op == "neg":
                return self.terms(args[0], -sign)
        return [(sign, node)]

    def sum(self, node: int) -> str:
        """Write a sum; of elements that follow each other the first two and the last."""
        terms = [self._term(sign, n) for sign, n in self.terms(node, 1, top=True)]
        out, at = "", 0
        while at < len(terms):
            plus, text, _ = terms[at]
            out += (self.signs[0 if plus else 1] if out else "" if plus else "-") + text
            run = _elements_in_row(terms, at)
            if run >= LONG and at + 1 < len(terms):
                sign = self.signs[0 if plus else 1]
                out += f"{sign}{terms[at + 1][1]}{sign}{self.dots}"
                at += run - 1
            else:
                at += 1
        return out

    def _term(self, sign: int, n: int) -> tuple[bool, str, str]:
        """Whether a term is added, its text, and its name where it is a signal."""
        op, _, value, name = self.g.nodes[n]
        own, text, rank = 1, "", ATOM
        if n in self.g.letters:
            text = self.symbol(self.g.letters[n])
        elif op == "const":
            own, text = (-1 if value < 0 else 1), self.number(abs(value))
        elif op in _PRODUCT_OPS and not self.is_log10(n):
            own, text, rank = self.product(n)
        else:
            text, rank = self.expand(n)
        text = self.bracket(text) if rank <= SUM else text
        return sign * own > 0, text, name if op == "symbol" else ""

    def factors(self, node: int, top: bool = False) -> tuple[int, list[tuple[int, float]]]:
        """Sign and factors, with exponents, of a product."""
        op, args, value, _ = self.g.nodes[node]
        if (node in self.g.letters and not top) or self.is_log10(node):
            return 1, [(node, 1)]
        if op == "const" and math.isfinite(value) and value < 0:
            return -1, [(node, 1)]
        if op == "neg":
            sign, parts = self.factors(args[0])
            return -sign, parts
        if op == "twice":
            sign, parts = self.factors(args[0])
            return sign, [(self.two(), 1), *parts]
        if op == "sq":
            return 1, self.squared(args[0], 2)
        if op == "inv":
            return self.below_line(args[0])
        if op in ("mul", "div"):
            s1, p1 = self.factors(args[0])
            s2, p2 = self.factors(args[1]) if op == "mul" else self.below_line(args[1])
            return s1 * s2, p1 + p2
        return 1, [(node, 1)]

    def two(self) -> int:
        """Node of the number 2, which CasADi hides in an operation."""
        node = Node("const", value=2.0)
        if node not in self.g.nodes:
            self.g.nodes.append(node)
        return self.g.nodes.index(node)

    def squared(self, node: int, exponent: float) -> list[tuple[int, float]]:
        """Base and exponent of repeated squares."""
        if self.g.nodes[node].op == "sq" and node not in self.g.letters:
            return self.squared(self.g.nodes[node].args[0], 2 * exponent)
        return [(node, exponent)]

    def below_line(self, node: int) -> tuple[int, list[tuple[int, float]]]:
        """Factors of a divisor, their exponents turned."""
        sign, parts = self.factors(node)
        if any(e < 0 for _, e in parts):
            return 1, [(node, -1)]
        return sign, [(n, -e) for n, e in parts]

    def product(self, node: int) -> tuple[int, str, int]:
        """Sign, text and rank of a product with its sign left out."""
        sign, parts = self.factors(node, top=True)
        merged: list[tuple[int, float]] = []
        for n, e in parts:
            if merged and merged[-1][0] == n and merged[-1][1] * e > 0:
                merged[-1] = (n, merged[-1][1] + e)
            else:
                merged.append((n, e))
        merged.sort(key=lambda f: self.g.nodes[f[0]].op != "const")
        above = [(n, e) for n, e in merged if e > 0]
        below = [(n, -e) for n, e in merged if e < 0 and not is_tie(self.g, n)]
        text, rank = self.fraction(above, below)
        return sign, text, rank

    def factor(self, node: int, exponent: float, alone: bool = False) -> str:
        """Write one factor of a product."""
        value = self.g.nodes[node].value
        if self.g.nodes[node].op == "const":
            base = self.number(abs(value))
            if self.times in base and exponent != 1:
                base = self.bracket(base)
        elif exponent != 1:
            base = self.wrap(node, ATOM)
        else:
            base = self.wrap(node, LOGIC if alone else POWER)
        return base if exponent == 1 else self.power(base, self.number(exponent), True)

    def fraction(
        self, above: list[tuple[int, float]], below: list[tuple[int, float]]
    ) -> tuple[str, int]:
        """Write a product from its factors above and below the line."""
        if len(above) == 1 and not below:
            n, e = above[0]
            if self.g.nodes[n].op == "const":
                return self.factor(n, e), ATOM
            return (self.factor(n, e), POWER) if e != 1 else self.at(n)
        top = [self.factor(n, e) for n, e in above]
        bottom = [self.factor(n, e) for n, e in below]
        text = self.times.join(top) or "1"
        if bottom:
            line = self.times.join(bottom)
            text += "/" + (self.bracket(line) if len(bottom) > 1 or line == "2*pi" else line)
        return text, PRODUCT

    def is_log10(self, node: int) -> bool:
        """Whether the node is what CasADi makes of log10."""
        op, args, *_ = self.g.nodes[node]
        if op != "mul" or args[1] in self.g.letters:
            return False
        first, second = self.g.nodes[args[0]], self.g.nodes[args[1]]
        return second.op == "log" and math.isclose(first.value, 1 / math.log(10), rel_tol=1e-15)

    # -- piecewise

    def branches(
        self, node: int, top: bool = False
    ) -> tuple[list[tuple[int, int]], int | None] | None:
        """Branches (condition, value) and the rest (None for 0) of an if."""
        if node in self.g.letters and not top:
            return None
        op, args, *_ = self.g.nodes[node]
        if op == "if_else_zero":
            return [(args[0], args[1])], None
        if op != "add":
            return None
        first, second = (self.g.nodes[a] for a in args)
        if first.op != "if_else_zero" or second.op != "if_else_zero":
            return None
        if self._negates(second.args[0], first.args[0]):
            condition, value, rest = first.args[0], first.args[1], second.args[1]
        elif self._negates(first.args[0], second.args[0]):
            condition, value, rest = second.args[0], second.args[1], first.args[1]
        else:
            return None
        more = self.branches(rest)
        mine = (condition, value)
        return ([mine, *more[0]], more[1]) if more else ([mine], rest)

    def _negates(self, node: int, other: int) -> bool:
        return self.g.nodes[node].op == "not" and self.g.nodes[node].args == (other,)

    # -- what LaTeX does otherwise

    def symbol(self, name: str) -> str:
        """Write a name."""
        hidden = HIDDEN.fullmatch(name)
        return f"1[{hidden[1]}]" if hidden else name

    def number(self, value: float) -> str:
        """Write a number, rounded to ``digits``."""
        for times in (1, 2):
            if value == times * math.pi:
                return self.times.join(["2"] * (times - 1) + [self.pi])
        if math.isfinite(value) and value == int(value) and abs(value) < 1e6:
            return str(int(value))
        return re.sub(
            r"e([+-])0*(\d)", lambda m: "e" + m[1].strip("+") + m[2], f"{value:.{self.digits}g}"
        )

    def bracket(self, text: str) -> str:
        """Put brackets around."""
        return f"({text})"

    def minus(self, text: str, rank: int) -> str:
        """Put a minus in front."""
        return "-" + (text if rank > SUM else self.bracket(text))

    def power(self, base: str, exponent: str, simple: bool) -> str:
        """Write a power."""
        return f"{base}^{exponent if simple else self.bracket(exponent)}"

    def call(self, op: str, args: list[str]) -> tuple[str, int]:
        """Write a function of arguments."""
        name = {"fabs": "abs", "fmin": "min", "fmax": "max"}.get(op, op)
        return f"{name}({', '.join(args)})", ATOM

    def logic(self, op: str, parts: list[str]) -> str:
        """Write not, and, or."""
        return f"not {parts[0]}" if op == "not" else f" {op} ".join(parts)

    def compare(self, op: str, left: int, right: int) -> str:
        """Write a comparison, a literal on its right."""
        if self.g.nodes[left].op == "const":
            op = {"<": ">", "<=": ">=", ">": "<", ">=": "<="}.get(op, op)
            left, right = right, left
        return f"{self.wrap(left, SUM)} {self.relation(op)} {self.wrap(right, SUM)}"

    def relation(self, op: str) -> str:
        """Write the sign of a comparison."""
        return op

    def cases(self, branches: list[tuple[int, int]], rest: int | None) -> tuple[str, int]:
        """Write a formula with branches."""
        text = "".join(
            f"{self.wrap(value, LOGIC)} if {self.at(condition)[0]} else "
            for condition, value in branches
        )
        return text + ("0" if rest is None else self.at(rest)[0]), CASE
