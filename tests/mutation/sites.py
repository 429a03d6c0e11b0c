"""Places of a Python file where a small change alters what it does, and the changed text."""

from __future__ import annotations

import ast
import copy
from collections.abc import Iterator
from dataclasses import dataclass, replace

OPERATORS: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult,
    ast.MatMult: ast.Mult, ast.FloorDiv: ast.Mult, ast.Mod: ast.Add,
}  # fmt: skip
COMPARISONS: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.In: ast.NotIn, ast.NotIn: ast.In, ast.Is: ast.IsNot, ast.IsNot: ast.Is,
}  # fmt: skip
CHANGED = (ast.BinOp, ast.Compare, ast.BoolOp, ast.UnaryOp, ast.Constant, ast.Call)
WORDS = {"print", "warning", "info", "debug", "warn", "step"}
"""Calls whose arguments a person reads: another word there is no other behaviour."""


@dataclass(frozen=True)
class Site:
    """One change: where it is, what stands there and what is put instead."""

    file: str
    line: int
    function: str
    kind: str
    before: str
    after: str
    start: int
    stop: int
    place: int = 1

    @property
    def name(self) -> str:
        """What it is called in the evidence; without the line, which moves."""
        again = f" ({self.place})" if self.place > 1 else ""
        return f"{self.file}:{self.function}: {self.before} -> {self.after}{again}"

    def applied(self, text: str) -> str:
        """The file with the change."""
        raw = text.encode()
        return (raw[: self.start] + self.after.encode() + raw[self.stop :]).decode()


def changed(node: ast.AST) -> Iterator[tuple[str, ast.expr]]:
    """Kinds of change of a node, each with the new expression."""
    if not isinstance(node, CHANGED):
        return
    new = copy.deepcopy(node)
    if isinstance(new, ast.BinOp) and type(new.op) in OPERATORS:
        if not any(isinstance(k, ast.Constant | ast.JoinedStr) and not is_number(k)
                   for k in (new.left, new.right)):  # fmt: skip
            new.op = OPERATORS[type(new.op)]()
            yield "operator", new
    elif isinstance(new, ast.Compare) and len(new.ops) == 1:
        new.ops = [COMPARISONS[type(new.ops[0])]()]
        yield "comparison", new
    elif isinstance(new, ast.BoolOp):
        new.op = ast.Or() if isinstance(new.op, ast.And) else ast.And()
        yield "and, or", new
    elif isinstance(new, ast.UnaryOp) and isinstance(new.op, ast.USub):
        yield "sign", new.operand
    elif isinstance(new, ast.Constant) and is_number(new):
        value = new.value
        other = not value if isinstance(value, bool) else (2 * value if value else 1)
        yield "constant", ast.Constant(other)
    elif isinstance(new, ast.Call) and (new.args or new.keywords):
        named = new.func.attr if isinstance(new.func, ast.Attribute) else ""
        if (named or getattr(new.func, "id", "")) not in WORDS and not is_zero(new):
            (new.keywords or new.args).pop()
            yield "argument", new


def is_zero(node: ast.Call) -> bool:
    """Whether it is Decimal(0) or Fraction(0): the same without the 0."""
    called = getattr(node.func, "id", "")
    return called in ("Decimal", "Fraction") and [ast.unparse(a) for a in node.args] == ["0"]


def is_number(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, int | float)


class Walk(ast.NodeVisitor):
    """Collects the sites of one file."""

    def __init__(self, file: str, text: str) -> None:
        self.file, self.function, self.found = file, ["<module>"], list[Site]()
        self.raw, self.starts = text.encode(), [0]
        for line in self.raw.splitlines(keepends=True):
            self.starts.append(self.starts[-1] + len(line))
        self.visit(ast.parse(text))

    def put(self, kind: str, node: ast.expr, after: str) -> None:
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        start = self.starts[node.lineno - 1] + node.col_offset
        stop = self.starts[node.end_lineno - 1] + node.end_col_offset
        before = self.raw[start:stop].decode()
        where = ".".join(self.function[1:]) or self.function[0]
        self.found.append(Site(self.file, node.lineno, where, kind, before, after, start, stop))

    def generic_visit(self, node: ast.AST) -> None:
        for kind, new in changed(node):
            assert isinstance(node, ast.expr)
            self.put(kind, node, f"({ast.unparse(new)})")
        super().generic_visit(node)

    def inside(self, node: ast.FunctionDef | ast.ClassDef) -> None:
        """Go into a body under its name; types say nothing of what is computed."""
        for decorator in node.decorator_list:
            self.visit(decorator)
        self.function.append(node.name)
        if isinstance(node, ast.FunctionDef):
            for default in (*node.args.defaults, *filter(None, node.args.kw_defaults)):
                self.visit(default)
        for statement in node.body:
            self.visit(statement)
        self.function.pop()

    visit_FunctionDef = visit_ClassDef = inside  # type: ignore[assignment]

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value:
            self.visit(node.value)

    def negated(self, node: ast.If | ast.IfExp | ast.While) -> None:
        test = node.test
        if not isinstance(test, ast.Name) or test.id != "TYPE_CHECKING":
            if not isinstance(test, ast.Compare):  # a comparison is turned as such
                self.put("condition", test, f"(not ({ast.unparse(test)}))")
            self.generic_visit(node)

    visit_If = visit_IfExp = visit_While = negated  # type: ignore[assignment]

    def visit_Return(self, node: ast.Return) -> None:
        if node.value and not (isinstance(node.value, ast.Constant) and node.value.value is None):
            self.put("return", node.value, "None")
            self.generic_visit(node)

    def visit_Raise(self, node: ast.Raise) -> None:
        """The words of an error are for people."""

    visit_JoinedStr = visit_Assert = visit_Raise  # type: ignore[assignment]


def sites(file: str, text: str) -> list[Site]:
    """All changes of a file, in the order in which they stand, each with a name of its own."""
    seen: dict[str, int] = {}
    found = []
    for site in Walk(file, text).found:
        seen[site.name] = seen.get(site.name, 0) + 1
        again = seen[site.name]
        found.append(site if again == 1 else replace(site, place=again))
    return found
