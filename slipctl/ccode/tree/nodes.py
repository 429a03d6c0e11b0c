"""What C is made of: one kind of node, for expressions and for statements.

Expressions: name, number, string, op (binary), unary, post, cast, paren, call, member, index,
choice, list, field. Statements: do, declare, return, break, continue, if, for, while, switch, case,
block, comment, text, blank. A function has its parameters and a block. Parentheses are nodes, so a
node is printed as it was made.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property


@dataclass(frozen=True)
class Node:
    """A piece of C.

    Attributes:
        kind: which.
        head: its name, sign, number, type, or text.
        parts: nodes in it.
        told: comment behind a statement, with the spaces before it; before a function, its text.
    """

    kind: str
    head: str = ""
    parts: tuple[Node, ...] = ()
    told: str = ""

    @cached_property
    def text(self) -> str:
        """C of an expression, or of a simple statement, on one line."""
        write = _TEXTS.get(self.kind)
        return write(self, [p.text for p in self.parts]) if write else self.head

    def __str__(self) -> str:
        return self.text

    @cached_property
    def words(self) -> frozenset[str]:
        """All names in it: of variables, members, functions."""
        own = {self.head.removeprefix("->").removeprefix(".")} if self.kind in _NAMED else set()
        return frozenset(own.union(*(p.words for p in self.parts)))

    @cached_property
    def constant(self) -> str:
        """Constant that a statement declares with its value, or ""."""
        if self.kind != "declare" or self.head not in ("const double", "const bool"):
            return ""
        to = target(self)
        return to.head if to is not None and to.kind == "name" else ""

    def walk(self) -> Iterator[Node]:
        """Itself and all nodes in it."""
        yield self
        for p in self.parts:
            yield from p.walk()

    def change(self, rule: Callable[[Node], Node | None]) -> Node:
        """It with what a rule gives in the place of nodes; None leaves one, and looks into it."""
        new = rule(self)
        if new is not None:
            return new
        parts = tuple(p.change(rule) for p in self.parts)
        same = all(a is b for a, b in zip(parts, self.parts, strict=True))
        return self if same else replace(self, parts=parts)

    def put(self, old: Node, new: Node) -> Node:
        """It with another node in the place of one."""
        return self.change(lambda n: new if n == old else None)

    def swap(self, names: dict[str, Node]) -> Node:
        """It with other nodes in the place of variables of these names."""
        if names.keys().isdisjoint(self.words):
            return self
        return self.change(lambda n: names.get(n.head) if n.kind == "name" else None)

    def calls(self) -> set[str]:
        """Functions that are called in it."""
        return {n.head for n in self.walk() if n.kind == "call"}

    def uses(self, name: str) -> int:
        """How often a variable of this name stands in it."""
        if name not in self.words:
            return 0
        return sum(n.kind == "name" and n.head == name for n in self.walk())

    @property
    def base(self) -> Node:
        """What an element is of, or itself."""
        return self.parts[0].base if self.kind == "index" else self


_NAMED = {"name", "call", "member", "field"}
_TEXTS: dict[str, Callable[[Node, list[str]], str]] = {
    "op": lambda n, p: f"{p[0]}{'' if n.head == ',' else ' '}{n.head} {p[1]}",
    "unary": lambda n, p: n.head + p[0],
    "post": lambda n, p: p[0] + n.head,
    "cast": lambda n, p: f"({n.head}){p[0]}",
    "paren": lambda n, p: f"({p[0]})",
    "call": lambda n, p: f"{n.head}({', '.join(p)})",
    "member": lambda n, p: p[0] + n.head,
    "index": lambda n, p: f"{p[0]}[{', '.join(p[1:])}]",
    "choice": lambda n, p: f"{p[0]} ? {p[1]} : {p[2]}",
    "list": lambda n, p: f"{{{', '.join(p)}}}",
    "field": lambda n, p: f".{n.head}",
    "do": lambda n, p: f"{p[0]};",
    "declare": lambda n, p: f"{n.head} {', '.join(p)};" if p else f"{n.head};",
    "return": lambda n, p: f"return {p[0]};" if p else "return;",
    "break": lambda n, p: "break;",
    "continue": lambda n, p: "continue;",
}


# ---- expressions --------------------------------------------------------------------------------


def name(word: str) -> Node:
    """A variable."""
    return Node("name", word)


def integer(value: int) -> Node:
    """A whole number."""
    return Node("number", str(value)) if value >= 0 else Node("unary", "-", (integer(-value),))


def op(left: Node, sign: str, right: Node) -> Node:
    """Two values and a sign between them."""
    return Node("op", sign, (left, right))


def call(function: str, arguments: Iterable[Node]) -> Node:
    """A call."""
    return Node("call", function, tuple(arguments))


def paren(inside: Node) -> Node:
    """A value in parentheses."""
    return Node("paren", "", (inside,))


def index(base: Node, at: Node | int) -> Node:
    """Element of an array."""
    return Node("index", "", (base, integer(at) if isinstance(at, int) else at))


def address(of: Node) -> Node:
    """Address of a variable or an element; of the first one it is the array."""
    if of.kind == "index" and of.parts[1] == ZERO:
        return of.parts[0]
    return Node("unary", "&", (of,))


def pointer(to: Node) -> Node:
    """Address of a value that is given; an address is one."""
    return to if to.kind == "unary" and to.head == "&" else address(to)


def value_at(by: Node) -> Node:
    """What an address is of."""
    return Node("unary", "*", (by,))


def mark_unused(argument: str) -> Node:
    """A statement that says that an argument is not used."""
    return do(Node("cast", "void", (name(argument),)))


ZERO = integer(0)


# ---- statements ---------------------------------------------------------------------------------


def do(expression: Node, told: str = "") -> Node:
    """A statement of an expression."""
    return Node("do", "", (expression,), told)


def assign(to: Node, value: Node, sign: str = "=", told: str = "") -> Node:
    """A statement that gives a value."""
    return do(op(to, sign, value), told)


def declare(kind: str, item: Node | str, value: Node | None = None, size: int = 1) -> Node:
    """Declaration of a variable, of an array where there are several numbers."""
    item = name(item) if isinstance(item, str) else item
    item = index(item, size) if size > 1 else item
    return Node("declare", kind, (item if value is None else op(item, "=", value),))


def give(value: Node | None = None) -> Node:
    """The end of a function."""
    return Node("return", "", () if value is None else (value,))


def block(statements: Iterable[Node]) -> Node:
    """Statements in braces."""
    return Node("block", "", tuple(statements))


def branch(
    condition: Node, yes: Iterable[Node], no: Iterable[Node] = (), *, told: str = ""
) -> Node:
    """An if, with what is done otherwise."""
    other = tuple(no)
    return Node("if", "", (condition, block(yes), *[block(other)] * bool(other)), told)


def loop(count: int, body: Iterable[Node], begin: int = 0, by: str = "i") -> Node:
    """A loop that counts up."""
    i = name(by)
    first = declare("int", by, integer(begin))
    ends = op(i, "<", integer(count + begin))
    return Node("for", "", (first, ends, Node("unary", "++", (i,)), block(body)))


def raw(text: str) -> Node:
    """Lines as they are: those of the preprocessor, a comment of several lines."""
    return Node("text", text)


def remark(text: str) -> Node:
    """A comment between statements."""
    return Node("comment", text)


def function(kind: str, called: str, given: Iterable[Node], body: Iterable[Node], told: str = ""
             ) -> Node:  # fmt: skip
    """A function: type, name, parameters, statements, what is told before it."""
    return Node("function", kind, (call(called, given), block(body)), told)


def target(statement: Node) -> Node | None:
    """What a statement gives a value to, or declares with one."""
    e = statement.parts[0] if statement.kind in ("do", "declare") and statement.parts else None
    return e.parts[0] if e is not None and e.kind == "op" and e.head.endswith("=") else None


def value(statement: Node) -> Node:
    """What a statement gives to its target."""
    return statement.parts[0].parts[1]


def with_calls(node: Node, names: Mapping[str, str]) -> Node:
    """C with other names of functions that it calls, or defines."""

    def rule(x: Node) -> Node | None:
        new = names.get(x.head) if x.kind == "call" else None
        return None if new is None else call(new, (p.change(rule) for p in x.parts))

    return node.change(rule)


def words(nodes: Iterable[Node]) -> set[str]:
    """All names in some nodes."""
    return set().union(*(n.words for n in nodes))


def called_functions(nodes: Iterable[Node]) -> set[str]:
    """Functions that some nodes call."""
    return set().union(*(n.calls() for n in nodes))


def variables(nodes: Iterable[Node]) -> set[str]:
    """Names of variables and functions in some nodes; a member may have the name of an argument."""
    return {n.head for node in nodes for n in node.walk() if n.kind == "name"}


def swap_all(nodes: Iterable[Node], names: dict[str, Node]) -> list[Node]:
    """Nodes with other nodes in the place of variables."""
    return [n.swap(names) for n in nodes]


def drop_unused(lines: Sequence[Node], rest: Sequence[Node]) -> list[Node]:
    """Leave out constants that nothing uses after them."""
    used = words(rest)
    kept: list[Node] = []
    for line in reversed(lines):
        made = target(line) if line.kind == "declare" and line.head.startswith("const ") else None
        if made is None or made.base.head in used:
            used |= line.words
            kept.append(line)
    return kept[::-1]
