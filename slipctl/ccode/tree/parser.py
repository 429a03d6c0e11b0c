"""The one reader of C: text that a person or CasADi has written, as nodes."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

from slipctl.ccode.tree.nodes import Node, block, branch

_TOKEN = re.compile(
    r"""(?P<gap>\s*)(?:(?P<comment>/\*.*?\*/)|(?P<directive>\#(?:\\\n|[^\n])*)
    |(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?[uUfFlL]*)|(?P<word>[A-Za-z_]\w*)
    |(?P<string>"(?:\\.|[^"\\])*"|'(?:\\.|[^'\\])')
    |(?P<sign>->|\+\+|--|[-+*/%|&<>=!]=|&&|\|\||<<|>>|[-+*/%<>=!&|^~?:;,.(){}\[\]])|(?P<end>\Z))""",
    re.VERBOSE | re.DOTALL,
)
_LEVELS = {
    **dict.fromkeys(("=", "+=", "-=", "*=", "/=", "|=", "&=", "%="), 1), "?": 2, "||": 3, "&&": 4,
    "|": 5, "^": 6, "&": 7, "==": 8, "!=": 8, "<": 9, ">": 9, "<=": 9, ">=": 9, "<<": 10,
    ">>": 10, "+": 11, "-": 11, "*": 12, "/": 12, "%": 12,
}  # fmt: skip
_KEYWORDS = {"return", "case", "do", "typedef"}
_QUALIFIERS = {"static", "const", "extern", "inline", "volatile"}
_TYPES = {"void", "int", "double", "float", "bool", "unsigned", "char", "long", "size_t"}


class _Token(NamedTuple):
    kind: str
    text: str
    gap: str


class _Reader:
    """Reads tokens one after the other."""

    def __init__(self, text: str, types: Mapping[str, str]) -> None:
        self.tokens: list[_Token] = []
        read = 0
        for m in _TOKEN.finditer(text):
            kind = m.lastgroup or "end"
            if m.start() != read:
                break
            self.tokens.append(_Token(kind, types.get(m[kind], m[kind]), m["gap"]))
            read = m.end()
        if read != len(text):
            raise ValueError(f"no C: {text[read : read + 40]!r}")
        self.at, self.types = 0, _TYPES | set(types.values())

    def peek(self, ahead: int = 0) -> str:
        return self.tokens[min(self.at + ahead, len(self.tokens) - 1)].text

    def kind(self, ahead: int = 0) -> str:
        return self.tokens[min(self.at + ahead, len(self.tokens) - 1)].kind

    def next(self, wanted: str = "") -> str:
        found = self.tokens[self.at].text
        if wanted and found != wanted:
            near = " ".join(t.text for t in self.tokens[max(self.at - 8, 0) : self.at + 8])
            raise ValueError(f"no C that this reader knows: {wanted} expected in {near!r}")
        self.at += 1
        return found

    def took(self, text: str) -> bool:
        found = self.peek() == text and self.kind() != "end"
        self.at += found
        return found

    # ---- expressions ------------------------------------------------------------------------

    def expression(self, least: int = 1) -> Node:
        left = self.unary()
        while (level := _LEVELS.get(self.peek(), 0)) >= least:
            sign = self.next()
            if sign == "?":
                yes = self.expression()
                self.next(":")
                left = Node("choice", "", (left, yes, self.expression(2)))
            else:
                right = self.expression(1 if level == 1 else level + 1)
                left = Node("op", sign, (left, right))
        return left

    def elements(self, end: str) -> tuple[Node, ...]:
        found: list[Node] = []
        while not self.took(end):
            found.append(self.expression())
            if not self.took(","):
                self.next(end)
                break
        return tuple(found)

    def comma(self) -> Node:
        left = self.expression()
        while self.took(","):
            left = Node("op", ",", (left, self.expression()))
        return left

    def unary(self) -> Node:
        if self.peek() in ("-", "!", "&", "*", "~", "+", "++", "--") and self.kind() == "sign":
            return Node("unary", self.next(), (self.unary(),))
        if self.peek() == "." and self.kind(1) == "word":
            self.next()
            return Node("field", self.next())
        if self.peek() == "(" and self.is_type(1):
            return Node("cast", self.type_name(), (self.unary(),))
        if self.took("sizeof"):
            return Node("name", f"sizeof({self.type_name()})")
        return self.postfix()

    def type_name(self) -> str:
        self.next("(")
        words = self.type()
        while self.took("*"):
            words += "*" if words.endswith("*") else " *"
        self.next(")")
        return words

    def postfix(self) -> Node:
        kind, text = self.kind(), self.next()
        if text == "(":
            found = Node("paren", "", (self.comma(),))
            self.next(")")
        elif text == "{":
            found = Node("list", "", self.elements("}"))
        elif kind == "word" and self.took("("):
            found = Node("call", text, self.elements(")"))
        elif kind in ("word", "number", "string"):
            found = Node("name" if kind == "word" else kind, text)
        else:
            self.at -= 1
            self.next("a value")
        while True:
            if self.took("["):
                found = Node("index", "", (found, self.expression()))
                self.next("]")
            elif self.took("("):  # a function by its address
                found = Node("call", found.text, self.elements(")"))
            elif self.peek() in ("->", "."):
                found = Node("member", self.next() + self.next(), (found,))
            elif self.peek() in ("++", "--"):
                found = Node("post", self.next(), (found,))
            else:
                return found

    # ---- types and declarations -------------------------------------------------------------

    def is_type(self, ahead: int = 0) -> bool:
        word = self.peek(ahead)
        compound = self.peek(ahead + 1) == ")" and self.peek(ahead + 2) == "{"
        return word in self.types or word in _QUALIFIERS or word == "struct" or (
            self.kind(ahead) == "word" and compound
        )  # fmt: skip

    def type(self) -> str:
        words: list[str] = []
        known = False
        while self.kind() == "word":
            if self.peek() == "struct":
                words += [self.next(), self.next()]
                known = True
            elif self.peek() in _QUALIFIERS or self.peek() in self.types or not known:
                known = known or self.peek() not in _QUALIFIERS
                words.append(self.next())
            else:
                break
        return " ".join(words)

    def declarator(self) -> Node:
        if self.took("*"):
            sign = "*const " if self.took("const") else "*"
            return Node("unary", sign, (self.declarator(),))
        found = Node("name", self.next())
        while self.took("["):
            size = (self.expression(),) if self.peek() != "]" else ()
            found = Node("index", "", (found, *size))
            self.next("]")
        return found

    def declaration(self) -> Node:
        kind, items = self.type(), list[Node]()
        while not items or self.took(","):
            item = self.declarator()
            items.append(Node("op", "=", (item, self.expression())) if self.took("=") else item)
        return Node("declare", kind, tuple(items))

    def parameters(self) -> tuple[Node, ...]:
        self.next("(")
        found: list[Node] = []
        while not self.took(")"):
            kind = self.type()
            found.append(Node("declare", kind, (self.declarator(),) if self.peek() not in ",)"
                              else ()))  # fmt: skip
            self.took(",")
        return tuple(found)

    # ---- statements -------------------------------------------------------------------------

    def behind(self) -> str:
        """Comment on the same line."""
        token = self.tokens[self.at]
        if token.kind != "comment" or "\n" in token.gap:
            return ""
        self.at += 1
        return token.gap + token.text

    def ended(self, node: Node) -> Node:
        self.next(";")
        return Node(node.kind, node.head, node.parts, self.behind())

    def statement(self) -> Node:
        token, kind = self.tokens[self.at], self.kind()
        if kind in ("comment", "directive"):
            self.at += 1
            if kind == "comment" and "\n" not in token.text:
                return Node("comment", token.text[2:-2].strip())
            define = token.text.replace("(", " ").split()
            named = define[1] if define[0] == "#define" else ""
            return Node("text", token.text, told=named)
        word = self.peek()
        if word == "{":
            return self.block()
        if self.took(";"):
            return Node("text")
        if word in ("if", "while", "switch"):
            return self.branch(self.next())
        if word == "for":
            return self.loop()
        if word == "do":
            return self.ended(self.until())
        if word == "typedef" or (word == "struct" and self.peek(2) == "{"):
            return self.type_definition()
        if word in ("break", "continue", "return"):
            self.next()
            has = word == "return" and self.peek() != ";"
            return self.ended(Node(word, "", (self.expression(),) if has else ()))
        if word in ("case", "default"):
            self.next()
            label = (self.expression(),) if word == "case" else ()
            self.next(":")
            return Node("case", "", label)
        if self.declares():
            return self.ended(self.declaration())
        return self.ended(Node("do", "", (self.comma(),)))

    def declares(self) -> bool:
        if self.is_type() or self.peek() in _KEYWORDS:
            return self.peek() not in _KEYWORDS
        star = self.peek(1) == "*" and self.kind(2) == "word" and self.peek(3) in (";", "=", ",")
        return self.kind() == "word" and (self.kind(1) == "word" or star)

    def branch(self, word: str) -> Node:
        self.next("(")
        condition = self.expression()
        self.next(")")
        body, told = self.body()
        parts = [condition, body]
        if word == "if" and self.took("else"):
            parts.append(self.statement() if self.peek() == "if" else self.body()[0])
        return Node(word, "", tuple(parts), told)

    def loop(self) -> Node:
        self.next("for")
        self.next("(")
        first = Node("blank")
        if self.peek() != ";":
            first = self.declaration() if self.declares() else Node("do", "", (self.comma(),))
        self.next(";")
        ends = self.expression() if self.peek() != ";" else Node("blank")
        self.next(";")
        step = self.comma() if self.peek() != ")" else Node("blank")
        self.next(")")
        body, told = self.body()
        return Node("for", "", (first, ends, step, body), told)

    def until(self) -> Node:
        self.next("do")
        body, _ = self.body()
        self.next("while")
        self.next("(")
        condition = self.expression()
        self.next(")")
        return Node("until", "", (condition, body))

    def type_definition(self) -> Node:
        begin = self.at
        with suppress(ValueError):  # a member that is the address of a function
            if self.took("struct"):
                named = self.next()
                body = self.block()
                self.next(";")
                return Node("struct", f"struct {named}", body.parts)
        self.at, depth = begin, 0
        while depth or self.peek() != ";":
            depth += {"{": 1, "}": -1}.get(self.next(), 0)
        self.next(";")
        text = "".join(t.gap + t.text for t in self.tokens[begin : self.at])
        return Node("text", text.lstrip(), told=self.tokens[self.at - 2].text)

    def body(self) -> tuple[Node, str]:
        if self.peek() != "{":
            return block([self.statement()]), ""
        return self.block(), self._opened

    def block(self) -> Node:
        self.next("{")
        opened = self.behind()
        found: list[Node] = []
        while self.peek() != "}":
            if "\n\n" in self.tokens[self.at].gap and found:
                found.append(Node("blank"))
            found.append(self.statement())
        self.next("}")
        self._opened = opened or self.behind()
        return block(found)

    def whole(self) -> list[Node]:
        """Statements, or what stands in a file."""
        found: list[Node] = []
        while self.kind() != "end":
            if found and "\n\n" in self.tokens[self.at].gap:
                found.append(Node("blank"))
            begin = self.at
            if self.declares():
                kind = self.type()
                while self.took("*"):
                    kind += " *"
                if self.kind() == "word" and self.peek(1) == "(":
                    called = self.next()
                    head = Node("call", called, self.parameters())
                    above = bool(found) and found[-1].kind == "comment"
                    told = f"/* {found.pop().head} */" if above else ""
                    found.append(self.function(kind, head, told))
                    continue
                self.at = begin
            found.append(self.statement())
        return found

    def function(self, kind: str, head: Node, told: str = "") -> Node:
        if self.peek() == ";":
            return self.ended(Node("declare", kind, (head,)))
        body = self.block()
        if self._opened and len(body.parts) == 1:  # a function of one line
            body = block([replace(body.parts[0], told=self._opened)])
        return Node("function", kind, (head, body), told)


def code(text: str, types: Mapping[str, str] | None = None) -> list[Node]:
    """Statements, or the functions of a file.

    Args:
        text: C.
        types: words that are types, beside those of C, and what they are.

    Raises:
        ValueError: it is no C that is known here.
    """
    return list(_code(text)) if not types else _Reader(text, types).whole()


@lru_cache(maxsize=4096)
def _code(text: str) -> tuple[Node, ...]:
    return tuple(_Reader(text, {}).whole())


def statements(pieces: Iterable[str | Node]) -> list[Node]:
    """Statements, of which some are text and some are nodes."""
    found: list[Node] = []
    for piece in pieces:
        found += code(piece) if isinstance(piece, str) else [piece]
    return found


def define(
    head: str, pieces: Iterable[str | Node], told: str = "", given: Iterable[str] = ()
) -> Node:
    """A function: its declaration, its statements, and what is told before it.

    Args:
        head: the whole declaration, or what stands before its parameters.
        pieces: statements.
        told: text of a comment.
        given: declarations of its parameters, where the head has none.
    """
    parameters = ", ".join(given)
    (empty,) = code(f"{head}({parameters}) {{ }}" if parameters else f"{head} {{ }}")
    return replace(empty, parts=(empty.parts[0], block(statements(pieces))), told=told)


def if_(condition: str, *pieces: str | Node) -> Node:
    """A branch, which may hold others."""
    return branch(expression(condition), statements(pieces))


@lru_cache(maxsize=4096)
def expression(text: str) -> Node:
    """An expression, of text.

    Raises:
        ValueError: it is none.
    """
    reader = _Reader(text, {})
    found = reader.expression()
    if reader.kind() != "end":
        raise ValueError(f"more than an expression: {text!r}")
    return found
