r"""Equations for a page without scripts: the LaTeX of ``show`` as MathML, which browsers know.

The subset is what ``slipctl.draw.show.latex`` writes: fractions, roots, powers, indices, accents,
brackets, functions, relations and ``cases``; anything else is shown as its own text.
"""

from __future__ import annotations

import re
from html import escape, unescape

SIGNS = {
    "cdot": "·", "dots": "…", "times": "×", "le": "≤", "ge": "≥", "ne": "≠", "neg": "¬",
    "land": "∧", "lor": "∨", "infty": "∞", "partial": "∂", "lfloor": "⌊", "rfloor": "⌋",
    "lceil": "⌈", "rceil": "⌉", "pm": "±", "top": "⊤", "odot": "⊙",
}  # fmt: skip
ACCENTS = {"dot": "˙", "ddot": "¨", "hat": "^", "bar": "¯", "tilde": "~", "vec": "→"}
SPACES = {",": "0.17em", ";": "0.28em", " ": "0.25em", "quad": "1em", "!": "0em", ":": "0.22em"}
FUNCTIONS = ("min", "max", "ln", "log", "exp", "sin", "cos", "tan", "sinh", "cosh", "tanh",
             "arcsin", "arccos", "arctan")  # fmt: skip

_TOKEN = re.compile(r"\\[A-Za-z]+|\\.|[{}^_&]|\d+\.?\d*|\s+|.", re.DOTALL)


def page(latex: str) -> list[tuple[str, str]]:
    r"""Rows of an ``aligned`` display: left and right side as MathML (right empty for a title)."""
    body = latex.strip().strip("$").strip()
    body = body.removeprefix(r"\begin{aligned}").removesuffix(r"\end{aligned}").strip()
    rows = []
    for row in _split_rows(body):
        left, amp, right = row.partition("&")
        if not amp:
            left, right = row, ""
        rows.append((render(left), render(right)) if left.strip() else (render(right), ""))
    return rows


def _split_rows(body: str) -> list[str]:
    r"""Split at ``\\`` outside of ``cases``."""
    rows, depth = [""], 0
    for piece in re.split(r"(\\\\|\\begin\{cases\}|\\end\{cases\})", body):
        depth += {r"\begin{cases}": 1, r"\end{cases}": -1}.get(piece, 0)
        if piece == r"\\" and depth == 0:
            rows.append("")
        else:
            rows[-1] += piece
    return [r for r in rows if r.strip()]


def render(latex: str) -> str:
    """Write one formula as MathML, without the ``<math>`` around it."""
    return _Reader(_TOKEN.findall(latex)).row()


class _Reader:
    def __init__(self, tokens: list[str]) -> None:
        self.tokens, self.at = tokens, 0

    def peek(self) -> str:
        while self.at < len(self.tokens) and self.tokens[self.at].isspace():
            self.at += 1
        return self.tokens[self.at] if self.at < len(self.tokens) else ""

    def take(self) -> str:
        token = self.peek()
        self.at += 1
        return token

    def row(self, *ends: str) -> str:
        """Everything up to one of the ends, which is taken."""
        out = []
        while token := self.peek():
            if token in ends:
                self.take()
                break
            out.append(self.scripts())
        return f"<mrow>{''.join(out)}</mrow>"

    def scripts(self) -> str:
        base = self.item()
        below = above = ""
        while self.peek() in ("_", "^"):
            sign, part = self.take(), ""
            part = self.item()
            below, above = (part, above) if sign == "_" else (below, part)
        if below and above:
            return f"<msubsup>{base}{below}{above}</msubsup>"
        if below:
            return f"<msub>{base}{below}</msub>"
        return f"<msup>{base}{above}</msup>" if above else base

    def item(self) -> str:
        token = self.take()
        if token == "{":
            return self.row("}")
        if not token.startswith("\\"):
            if token[:1].isdigit():
                return f"<mn>{token}</mn>"
            if token.isalpha():
                return f"<mi>{escape(token)}</mi>"
            return f"<mo>{escape({'-': '−', '*': '·'}.get(token, token))}</mo>"
        return self.command(token[1:])

    def command(self, name: str) -> str:
        letter = unescape(f"&{name};")
        if len(letter) == 1 and letter.isalpha():
            return f"<mi>{letter}</mi>"
        if name in SIGNS:
            tag = "mi" if name in ("infty", "partial") else "mo"
            return f"<{tag}>{SIGNS[name]}</{tag}>"
        if name in FUNCTIONS:
            return f"<mi>{name}</mi><mo>&#x2061;</mo>"
        if name in SPACES:
            return f'<mspace width="{SPACES[name]}"/>'
        if name == "frac":
            above = self.item()
            return f"<mfrac>{above}{self.item()}</mfrac>"
        if name == "sqrt":
            return f"<msqrt>{self.item()}</msqrt>"
        if name in ACCENTS:
            return f'<mover accent="true">{self.item()}<mo>{ACCENTS[name]}</mo></mover>'
        if name in ("mathrm", "operatorname", "text", "textbf", "mathbf"):
            return self.words(name)
        if name == "left":
            return self.fence()
        if name == "begin" and self.raw_group() == "cases":
            return self.cases()
        return f"<mtext>{escape(name)}</mtext>"

    def words(self, name: str) -> str:
        """Upright text up to the closing brace."""
        text = self.raw_group().replace("\\_", "_").replace("\\,", " ").replace("\\", "")
        if name in ("text", "textbf"):
            style = ' style="font-weight:bold"' if name == "textbf" else ""
            return f"<mtext{style}>{escape(text)}</mtext>"
        return f'<mi mathvariant="normal">{escape(text)}</mi>'

    def raw_group(self) -> str:
        if self.take() != "{":
            return ""
        depth, out = 1, ""
        while self.at < len(self.tokens):
            token = self.tokens[self.at]
            self.at += 1
            depth += {"{": 1, "}": -1}.get(token, 0)
            if depth == 0:
                break
            out += token
        return out

    def fence(self) -> str:
        opening = self.take()
        inside = self.row("\\right")
        closing = self.take()
        marks = [{".": "", "\\{": "{", "\\}": "}"}.get(m, m) for m in (opening, closing)]
        left, right = (f'<mo stretchy="true">{escape(m)}</mo>' if m else "" for m in marks)
        return f"<mrow>{left}{inside}{right}</mrow>"

    def cases(self) -> str:
        rows: list[list[str]] = [[]]
        cell: list[str] = []
        while token := self.peek():
            if token in ("&", "\\\\", "\\end"):
                self.take()
                rows[-1].append(f"<mtd>{''.join(cell)}</mtd>")
                cell = []
                if token == "\\\\":
                    rows.append([])
                if token == "\\end":
                    self.raw_group()
                    break
            else:
                cell.append(self.scripts())
        body = "".join(f"<mtr>{''.join(r)}</mtr>" for r in rows)
        table = f'<mtable columnalign="left">{body}</mtable>'
        return f'<mrow><mo stretchy="true">{{</mo>{table}</mrow>'
