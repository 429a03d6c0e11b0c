"""Places of a Python file where a small change alters what it does, and the changed text."""

from __future__ import annotations

import ast
import copy
from collections.abc import Iterator, Sequence
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
EITHER_WAY = {"max", "min", "maximum", "minimum", "fmax", "fmin", "hypot", "logic_and", "logic_or"}
"""Calls that give the same with their first two arguments the other way round."""

REFUSING = ("check_", "_check", "refuse", "_refuse")
"""How the names of functions begin that refuse what they are given."""
WRITTEN = (ast.Store, ast.Del)


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
        if not _joins_text(new):
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


def dropped(node: ast.expr) -> Iterator[ast.expr]:
    """A sum, a product or a condition of several parts without one of them."""
    if isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
        yield from (node.left, node.right)
    elif isinstance(node, ast.BoolOp):
        for k in range(len(node.values)):
            rest = [v for j, v in enumerate(node.values) if j != k]
            yield rest[0] if len(rest) == 1 else ast.BoolOp(node.op, rest)


def altered(node: ast.expr) -> Iterator[tuple[str, ast.expr]]:
    """Kinds of change that leave the operation and take another part of what it is done to."""
    for one in dropped(node) if not _joins_text(node) else ():
        yield "operand", one
    if isinstance(node, ast.Call) and len(node.args) > 1:
        named = getattr(node.func, "attr", getattr(node.func, "id", ""))
        first, second = node.args[:2]
        same = named in WORDS or named in EITHER_WAY
        if not same and not any(isinstance(a, ast.Starred) for a in (first, second)):
            yield "swapped", ast.Call(node.func, [second, first, *node.args[2:]], node.keywords)
    elif isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Slice):
        for end in ("lower", "upper"):
            if getattr(node.slice, end) is not None:
                new = copy.deepcopy(node)
                setattr(new.slice, end, None)
                yield "slice", new
    elif isinstance(node, ast.Subscript) and (at := _index(node.slice)) is not None:
        yield "index", ast.Subscript(node.value, ast.Constant(1 if at == 0 else 0), node.ctx)
    elif isinstance(node, ast.Constant) and isinstance(node.value, float) and node.value:
        yield "tenth", ast.Constant(float(f"{1.1 * node.value:.12g}"))


def _index(node: ast.expr) -> int | None:
    """A whole number that something is taken by."""
    try:
        value = ast.literal_eval(node)
    except ValueError:
        return None
    return value if isinstance(value, int) and not isinstance(value, bool) else None


def _joins_text(node: ast.expr) -> bool:
    """Whether parts of a text are put together."""
    sides = (node.left, node.right) if isinstance(node, ast.BinOp) else ()
    return any(isinstance(k, ast.Constant | ast.JoinedStr) and not is_number(k) for k in sides)


def is_zero(node: ast.Call) -> bool:
    """Whether it is Decimal(0) or Fraction(0): the same without the 0."""
    called = getattr(node.func, "id", "")
    return called in ("Decimal", "Fraction") and [ast.unparse(a) for a in node.args] == ["0"]


def is_number(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, int | float)


def arguments_of(node: ast.FunctionDef) -> list[str]:
    """Names of the arguments of a function."""
    given = node.args
    return [a.arg for a in (*given.posonlyargs, *given.args, *given.kwonlyargs)]


def local_names(node: ast.FunctionDef) -> list[str]:
    """Names that a function gives values to, its arguments first, in their order."""
    found = [n for n in arguments_of(node) if n not in ("self", "cls")]
    for inner in ast.walk(node):
        if isinstance(inner, ast.Name) and isinstance(inner.ctx, ast.Store):
            found.append(inner.id)
    return list(dict.fromkeys(found))


class Walk(ast.NodeVisitor):
    """Collects the sites of one file."""

    def __init__(self, file: str, text: str) -> None:
        self.file, self.function, self.found = file, ["<module>"], list[Site]()
        self.locals: list[Sequence[str]] = [[]]
        self.bound: list[set[str]] = [set()]
        self.raw, self.starts = text.encode(), [0]
        for line in self.raw.splitlines(keepends=True):
            self.starts.append(self.starts[-1] + len(line))
        self.visit(ast.parse(text))

    def put(self, kind: str, node: ast.expr | ast.stmt, after: str) -> None:
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
        if isinstance(node, ast.expr) and not isinstance(getattr(node, "ctx", None), WRITTEN):
            for kind, new in altered(node):
                self.put(kind, node, f"({ast.unparse(new)})")
        if isinstance(node, ast.comprehension):
            for test in node.ifs:
                self.put("always", test, "True")
        super().generic_visit(node)

    def visit_Name(self, node: ast.Name) -> None:
        """Another name of the same function: the one that stands before it there."""
        names = self.locals[-1]
        if isinstance(node.ctx, ast.Load) and node.id in names and len(names) > 1:
            self.put("name", node, names[names.index(node.id) - 1])

    def visit_Expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Call):
            named = getattr(node.value.func, "attr", getattr(node.value.func, "id", ""))
            if named not in WORDS:
                self.put("refusal" if named.startswith(REFUSING) else "skipped", node, "pass")
        if not isinstance(node.value, ast.Constant):
            self.generic_visit(node)

    def visit_Assign(self, node: ast.Assign) -> None:
        """Left out where something else stands there without it."""
        targets = [n for t in node.targets for n in getattr(t, "elts", [t])]
        if all(isinstance(t, ast.Attribute | ast.Subscript) or
               getattr(t, "id", "") in self.bound[-1] for t in targets):  # fmt: skip
            self.put("skipped", node, "pass")
        self.bound[-1] |= {t.id for t in targets if isinstance(t, ast.Name)}
        self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        self.put("skipped", node, "pass")
        self.generic_visit(node)

    def visit_Break(self, node: ast.Break) -> None:
        self.put("break", node, "continue")

    def visit_Continue(self, node: ast.Continue) -> None:
        self.put("break", node, "break")

    def inside(self, node: ast.FunctionDef | ast.ClassDef) -> None:
        """Go into a body under its name; types say nothing of what is computed."""
        for decorator in node.decorator_list:
            self.visit(decorator)
        function = isinstance(node, ast.FunctionDef)
        if function:
            for default in (*node.args.defaults, *filter(None, node.args.kw_defaults)):
                self.visit(default)
        self.function.append(node.name)
        self.locals.append(local_names(node) if function else [])
        self.bound.append(set(arguments_of(node)) if function else set())
        for statement in node.body:
            self.visit(statement)
        for stack in (self.function, self.locals, self.bound):
            stack.pop()

    visit_FunctionDef = visit_ClassDef = inside  # type: ignore[assignment]

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value:
            self.visit(node.value)

    def negated(self, node: ast.If | ast.IfExp | ast.While) -> None:
        test = node.test
        if not isinstance(test, ast.Name) or test.id != "TYPE_CHECKING":
            if not isinstance(test, ast.Compare):  # a comparison is turned as such
                self.put("condition", test, f"(not ({ast.unparse(test)}))")
            self.put("never", test, "False")
            if not isinstance(node, ast.While):
                self.put("always", test, "True")
            self.generic_visit(node)

    visit_If = visit_IfExp = visit_While = negated  # type: ignore[assignment]

    def visit_Return(self, node: ast.Return) -> None:
        if node.value and not (isinstance(node.value, ast.Constant) and node.value.value is None):
            self.put("return", node.value, "None")
            self.generic_visit(node)

    def visit_Raise(self, node: ast.Raise) -> None:
        """The words of an error are for people; that there is one is not."""
        self.put("refusal", node, "pass")

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        """Words are for people."""

    def visit_Assert(self, node: ast.Assert) -> None:
        """What is asserted holds."""


def sites(file: str, text: str) -> list[Site]:
    """All changes of a file, in the order in which they stand, each with a name of its own."""
    seen: dict[str, int] = {}
    found = []
    for site in Walk(file, text).found:
        seen[site.name] = seen.get(site.name, 0) + 1
        again = seen[site.name]
        found.append(site if again == 1 else replace(site, place=again))
    return found
