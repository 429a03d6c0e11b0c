"""Expressions read back as formulas: CasADi SX to a graph, and the graph to text or LaTeX.

The letters of intermediate results (``F_a = mu*m*g``) are those of the local variables of the
function that wrote the equations, see :func:`letters`.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from types import CodeType, FrameType
from typing import Any, NamedTuple

LONG = 60
"""Operations in one formula; what goes beyond is given a letter of its own."""

HIDDEN = re.compile(r"one\[(.*)\]")
"""Name of the symbol that stands for a hidden unit constant."""

_INFIX = {"lt": "<", "le": "<=", "eq": "==", "ne": "!="}
_OPPOSITE = {"<": ">", "<=": ">=", "==": "==", "!=": "!="}
_NEGATED = {"<": ">=", "<=": ">", "==": "!=", "!=": "=="}
_PRODUCT_OPS = ("mul", "div", "inv", "neg", "twice", "sq")

CASE, LOGIC, COMPARE, SUM, PRODUCT, POWER, ATOM = range(7)


class Node(NamedTuple):
    """One operation: CasADi's name for it, its arguments, and a number or a symbol's name."""

    op: str
    args: tuple[int, ...] = ()
    value: float = 0.0
    name: str = ""


@dataclass
class Graph:
    """Equations as one graph without repeated nodes; arguments come before their users.

    Attributes:
        nodes: all operations.
        roots: for each equation, the node of each of its elements, column by column.
        letters: names of intermediate results, by node.
    """

    nodes: list[Node] = field(default_factory=list)
    roots: dict[str, list[int]] = field(default_factory=dict)
    letters: dict[int, str] = field(default_factory=dict)

    def below(self, start: list[int]) -> list[int]:
        """Nodes that the given ones are made of, themselves included, in order of evaluation."""
        seen, waiting = set(start), list(start)
        while waiting:
            new = [a for a in self.nodes[waiting.pop()].args if a not in seen]
            seen.update(new)
            waiting += new
        return sorted(seen)


@contextmanager
def letters(code: CodeType) -> Iterator[dict[str, Any]]:
    """Collect the local SX variables of a function, and of those it calls directly.

    Args:
        code: code of the function which calls the page of equations, ``body.__code__``.

    Yields:
        A dict that is filled when the function returns, SX results by the name of the variable.
    """
    import casadi as ca

    found: dict[str, Any] = {}

    def watch(frame: FrameType, event: str, _: Any) -> None:
        if event != "return" or frame.f_globals.get("__name__", "").startswith("casadi"):
            return
        if frame.f_code is code or (frame.f_back is not None and frame.f_back.f_code is code):
            for name, value in frame.f_locals.items():
                if isinstance(value, ca.SX) and value.numel() and not name.startswith("_"):
                    found.setdefault(name, value)

    before = sys.getprofile()
    sys.setprofile(watch)
    try:
        yield found
    finally:
        sys.setprofile(before)


@lru_cache(maxsize=1)
def _operations() -> dict[int, str]:
    import casadi as ca

    return {getattr(ca, n): n[3:].lower() for n in dir(ca) if n.startswith("OP_")}


def graph(equations: Mapping[str, Any], names: Mapping[str, Any] | None = None) -> Graph:
    """Read expressions into one graph.

    Args:
        equations: SX expressions (or numbers) by name.
        names: SX intermediate results by letter, as :func:`letters` finds them.
    """
    import casadi as ca

    wanted = {k: ca.densify(ca.SX(v)) for k, v in equations.items()}
    extra = {k: ca.densify(v) for k, v in (names or {}).items()}
    outputs = [*wanted.values(), *extra.values()]
    symbols = ca.symvar(ca.veccat(*outputs)) if outputs else []
    f = ca.Function("f", symbols, outputs)
    operations = _operations()
    g = Graph()
    index: dict[Node, int] = {}
    register: dict[int, int] = {}
    results: list[list[int]] = [[0] * e.numel() for e in outputs]

    def add(node: Node) -> int:
        key = node if not math.isnan(node.value) else node._replace(value=0.0, name="nan")
        if key not in index:
            index[key] = len(g.nodes)
            g.nodes.append(node)
        return index[key]

    for k in range(f.n_instructions()):
        op = operations[f.instruction_id(k)]
        read, written = f.instruction_input(k), f.instruction_output(k)
        if op == "input":
            register[written[0]] = add(Node("symbol", name=symbols[read[0]].name()))
        elif op == "const":
            register[written[0]] = add(Node("const", value=f.instruction_constant(k)))
        elif op == "output":
            results[written[0]][written[1]] = register[read[0]]
        else:
            args = tuple(register[r] for r in read if r >= 0)
            for i, w in enumerate(written):
                if w >= 0:
                    register[w] = add(Node(op, args, float(i)))
    g.roots = dict(zip(wanted, results, strict=False))
    _name(g, dict(zip(extra, results[len(wanted) :], strict=True)))
    return g


def _name(g: Graph, found: Mapping[str, list[int]]) -> None:
    """Give letters to intermediate results, leaving out those that would mislead."""
    taken = {n.name for n in g.nodes if n.op == "symbol"}
    live = set(g.below([n for root in g.roots.values() for n in root]))
    own = {n: k for k, root in g.roots.items() if len(root) == 1 for n in root if k in found}
    for name, nodes in found.items():
        for i, n in enumerate(nodes):
            letter = name if len(nodes) == 1 else f"{name}[{i}]"
            leaf = g.nodes[n].op in ("symbol", "const") or not g.nodes[n].args
            if leaf or name in taken or n not in live or n in g.letters:
                continue
            if own.get(n, name) == name and (name not in g.roots or g.roots[name] == nodes):
                g.letters[n] = letter


def shorten(g: Graph, long: int = LONG) -> None:
    """Give letters ``a1, a2, ...`` to parts that would make a formula longer than ``long``."""
    roots = [n for root in g.roots.values() for n in root]
    live = g.below(roots)
    users = dict.fromkeys(live, 0)
    for n in live:
        for a in g.nodes[n].args:
            users[a] += 1
    names = {n.name for n in g.nodes} | set(g.letters.values()) | set(g.roots)
    prefix = next(
        p for p in (*"azqhw", "part") if not any(re.fullmatch(p + r"\d+", n) for n in names)
    )
    size: dict[int, int] = {}
    count = 0
    for n in live:
        node = g.nodes[n]
        size[n] = 1 + sum(1 if a in g.letters else size[a] for a in node.args)
        logic = node.op in (*_INFIX, "not", "if_else_zero")
        if n in g.letters or logic or n in roots:
            continue
        if size[n] > long or (users[n] > 1 and size[n] > long // 4):
            count += 1
            g.letters[n] = f"{prefix}{count}"


def defined(g: Graph) -> list[tuple[str, int]]:
    """Letters with their nodes, in order of evaluation; results named as an equation left out."""
    return [(g.letters[n], n) for n in sorted(g.letters) if g.letters[n] not in g.roots]


def equation(g: Graph, label: str, limit: int = 70) -> str:
    """One equation as text, ``omega' = (r*F_a - T_b)/J``, cut when it is long."""
    write = Text(g)
    nodes = g.roots[label]
    return cut(f"{label} = {write.root(nodes[0])}", limit) + (", ..." if len(nodes) > 1 else "")


def cut(text: str, limit: int) -> str:
    """Shorten a text in its middle."""
    if len(text) <= limit:
        return text
    tail = limit // 4
    return f"{text[: limit - tail - 5]} ... {text[-tail:]}"


# ---- writing ----------------------------------------------------------------------------------


class Text:
    """Writes formulas as text, ``(r*F_a - T_b)/J``; LaTeX replaces single steps of it."""

    times = "*"
    signs = (" + ", " - ")

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
            return self.number(value), ATOM if value >= 0 else SUM
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
        """Write a sum."""
        out = ""
        for sign, n in self.terms(node, 1, top=True):
            op, _, value, _ = self.g.nodes[n]
            own, text, rank = 1, "", ATOM
            if n in self.g.letters:
                text = self.symbol(self.g.letters[n])
            elif op == "const":
                own, text = (-1 if value < 0 else 1), self.number(abs(value))
            elif op in _PRODUCT_OPS and not self.is_log10(n):
                own, text, rank = self.product(n)
            else:
                text, rank = self.expand(n)
            if rank <= SUM:
                text = self.bracket(text)
            if out:
                out += self.signs[0 if sign * own > 0 else 1] + text
            else:
                out = text if sign * own > 0 else "-" + text
        return out

    def factors(self, node: int, top: bool = False) -> tuple[int, list[tuple[int, float]], float]:
        """Sign, factors with exponents, and numerical coefficient of a product."""
        op, args, value, _ = self.g.nodes[node]
        if (node in self.g.letters and not top) or self.is_log10(node):
            return 1, [(node, 1)], 1.0
        if op == "const" and not top and math.isfinite(value) and value < 0:
            return -1, [(node, 1)], 1.0
        if op == "neg":
            sign, parts, c = self.factors(args[0])
            return -sign, parts, c
        if op == "twice":
            sign, parts, c = self.factors(args[0])
            return sign, parts, 2 * c
        if op == "sq":
            return 1, self.squared(args[0], 2), 1.0
        if op == "inv":
            sign, parts, c = self.below_line(args[0])
            return sign, parts, c
        if op in ("mul", "div"):
            s1, p1, c1 = self.factors(args[0])
            s2, p2, c2 = self.factors(args[1]) if op == "mul" else self.below_line(args[1])
            return s1 * s2, p1 + p2, c1 * c2
        return 1, [(node, 1)], 1.0

    def squared(self, node: int, exponent: float) -> list[tuple[int, float]]:
        """Base and exponent of repeated squares."""
        if self.g.nodes[node].op == "sq" and node not in self.g.letters:
            return self.squared(self.g.nodes[node].args[0], 2 * exponent)
        return [(node, exponent)]

    def below_line(self, node: int) -> tuple[int, list[tuple[int, float]], float]:
        """Factors of a divisor, their exponents turned."""
        sign, parts, c = self.factors(node)
        if any(e < 0 for _, e in parts) or c != 1.0:
            return 1, [(node, -1)], 1.0
        return sign, [(n, -e) for n, e in parts], 1.0

    def product(self, node: int) -> tuple[int, str, int]:
        """Sign, text and rank of a product with its sign left out."""
        sign, parts, coefficient = self.factors(node, top=True)
        merged: list[tuple[int, float]] = []
        for n, e in parts:
            if merged and merged[-1][0] == n and merged[-1][1] * e > 0:
                merged[-1] = (n, merged[-1][1] + e)
            else:
                merged.append((n, e))
        above = [(n, e) for n, e in merged if e > 0]
        below = [(n, -e) for n, e in merged if e < 0]
        below.sort(key=lambda f: self.g.nodes[f[0]].op != "const")
        text, rank = self.fraction(coefficient, above, below)
        return sign, text, rank

    def factor(self, node: int, exponent: float, alone: bool = False) -> str:
        """Write one factor of a product."""
        value = self.g.nodes[node].value
        if self.g.nodes[node].op == "const":
            base = self.number(abs(value))
        elif exponent != 1:
            base = self.wrap(node, ATOM)
        else:
            base = self.wrap(node, LOGIC if alone else POWER)
        return base if exponent == 1 else self.power(base, self.number(exponent), True)

    def fraction(
        self, coefficient: float, above: list[tuple[int, float]], below: list[tuple[int, float]]
    ) -> tuple[str, int]:
        """Write a product from its factors above and below the line."""
        if coefficient == 1.0 and len(above) == 1 and not below:
            n, e = above[0]
            return (self.factor(n, e), POWER) if e != 1 else self.at(n)
        top = [self.number(coefficient)] if coefficient != 1.0 else []
        top += [self.factor(n, e) for n, e in above]
        bottom = [self.factor(n, e) for n, e in below]
        text = self.times.join(top) or "1"
        if bottom:
            text += "/" + (bottom[0] if len(bottom) == 1 else self.bracket(self.times.join(bottom)))
        return text, PRODUCT

    def is_log10(self, node: int) -> bool:
        """Whether the node is what CasADi makes of log10."""
        op, args, *_ = self.g.nodes[node]
        if op != "mul" or args[1] in self.g.letters:
            return False
        first, second = self.g.nodes[args[0]], self.g.nodes[args[1]]
        return (
            first.op == "const" and second.op == "log"
            and math.isclose(first.value, 1 / math.log(10), rel_tol=1e-15)
        )  # fmt: skip

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
        """Write a number with up to six digits."""
        if math.isfinite(value) and value == int(value) and abs(value) < 1e6:
            return str(int(value))
        return re.sub(r"e([+-])0*(\d)", lambda m: "e" + m[1].strip("+") + m[2], f"{value:.6g}")

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

    times = r" \, "

    def symbol(self, name: str) -> str:
        """Write a name."""
        hidden = HIDDEN.fullmatch(name)
        if hidden:
            return rf"(1\,{unit(hidden[1])})"
        return letter(name)

    def number(self, value: float) -> str:
        """Write a number with up to six digits."""
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
        self, coefficient: float, above: list[tuple[int, float]], below: list[tuple[int, float]]
    ) -> tuple[str, int]:
        """Write a product from its factors above and below the line."""
        if not below:
            if coefficient == 1.0 and len(above) == 1:
                return super().fraction(coefficient, above, below)
            numbers = [self.number(coefficient)] if coefficient != 1.0 else []
            return self.join(numbers, above), PRODUCT
        numbers = [self.number(coefficient)] if coefficient != 1.0 else []
        sums = [(n, e) for n, e in above if self.at(n)[1] <= SUM and e == 1]
        rest = [] if len(sums) == len(above) and not numbers else sums
        inside = [f for f in above if f not in rest]
        if len(inside) == 1 and not numbers:
            top = self.factor(*inside[0], alone=True)
        else:
            top = self.join(numbers, inside) or "1"
        bottom = self.factor(*below[0], alone=True) if len(below) == 1 else self.join([], below)
        tail = "".join(self.times + self.factor(n, e) for n, e in rest)
        return rf"\frac{{{top}}}{{{bottom}}}{tail}", PRODUCT

    def join(self, numbers: list[str], parts: list[tuple[int, float]]) -> str:
        """Product; two numbers side by side get a dot between."""
        out = ""
        texts = [(t, True) for t in numbers]
        texts += [(self.factor(n, e), self.g.nodes[n].op == "const") for n, e in parts]
        for text, is_number in texts:
            if out:
                out += r" \cdot " if is_number else self.times
            out += text
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
