"""Show a block: equations in the paper's letters, signals, Jacobian, and what differs between two.

Diagrams are in :mod:`slipctl.draw.diagrams.diagram`; ``graph`` and ``svg`` are offered here too.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, Any

from slipctl.block.reach import reach_text
from slipctl.block.shared_numbers import differences, places_of
from slipctl.block.signals import Signal
from slipctl.block.text import formula
from slipctl.block.text.plain_text import Text, cut
from slipctl.draw import repeats
from slipctl.draw.diagrams.diagram import graph, svg
from slipctl.draw.diagrams.levels import inner
from slipctl.draw.typeset import Latex, letter

if TYPE_CHECKING:
    from slipctl.block.block import Block

__all__ = ["difference", "graph", "hidden_units", "latex", "svg", "text"]

LINES = 60
"""Equations of one block that are shown; a loop that was written out has thousands."""

LARGE = 2000
"""Operations of a block beyond which its Jacobian is not written."""

WIDTH = 140
"""Letters of one equation, beyond which its middle is cut."""


# ---- reading a block --------------------------------------------------------------------------


def page(block: Block, jacobian: bool = False) -> formula.Graph | None:
    """Read the equations of a block without parts; None if they are no scalar formulas.

    Args:
        block: any block whose ``sx`` is true gives a graph.
        jacobian: give the derivatives towards states and inputs in place of the equations.
    """
    if not block.sx:
        return None
    import casadi as ca

    groups = [_symbols(block, role) for role in ("state", "input", "param")]
    with formula.letters(_code(block)) as names:
        n, y = block.expr(*groups)
    prime = "'" if block.kind == "flow" else "+"
    equations: dict[str, Any] = {}
    for role, values, mark in (("state", n, prime), ("output", y, "")):
        for k, s in block._signals[role].items():
            column = ca.vec(ca.densify(ca.SX(values[k])))
            equations |= {
                e + mark: column[i] if column.numel() > 1 else column
                for i, e in enumerate(_elements(k, s))
            }
    if not jacobian:
        return formula.graph(equations, names)
    towards = ca.veccat(*groups[0].values(), *groups[1].values())
    J = ca.jacobian(ca.vertcat(*equations.values()), towards)
    rows, columns = J.sparsity().get_triplet()
    left, below = list(equations), [v.name() for v in ca.vertsplit(towards)]
    entries = {
        f"d {left[r]} / d {below[c]}": J[r, c]
        for r, c in zip(rows, columns, strict=True)
        if not J[r, c].is_zero()
    }
    return formula.graph(entries, names)


def _code(block: Block) -> Any:
    return getattr(block._body, "__code__", (lambda: None).__code__)


def _elements(name: str, s: Signal) -> list[str]:
    """Names of the elements of a signal, column by column."""
    if len(s.shape) == 2:
        return [f"{name}[{i},{j}]" for j in range(s.shape[1]) for i in range(s.shape[0])]
    return [f"{name}[{i}]" for i in range(s.size)] if s.shape else [name]


def _symbols(block: Block, role: str) -> dict[str, Any]:
    import casadi as ca

    out = {}
    for n, s in block._signals[role].items():
        column = ca.vertcat(*[ca.SX.sym(e) for e in _elements(n, s)])
        out[n] = ca.reshape(column, *s.shape) if len(s.shape) == 2 else column
    return out


def hidden_units(block: Block) -> dict[str, str]:
    """Unit constants that the formulas of a block hide: meaning by unit."""
    from slipctl.block.units import unit_algebra

    found: dict[str, str] = {}
    for _, leaf in block.leaves():
        if leaf.sx:
            with unit_algebra.checking_units() as ones:
                leaf.expr(*(leaf.symbols(role) for role in ("state", "input", "param")))
            found |= {k: doc for k, (_, doc) in ones.items()}
    return found


def _leaves(block: Block) -> Iterator[tuple[str, Block]]:
    for path, leaf in block.leaves():
        yield path or leaf.name, leaf


def _lines(g: formula.Graph, write: Text) -> Iterator[tuple[str, str]]:
    """Left and right side of definitions and equations, as text."""
    for name, n in formula.named_nodes(g):
        yield name, write.root(n)
    for label, (n,) in g.roots.items():
        own = g.letters.get(n, label) == label
        yield label, write.root(n) if own else write.at(n)[0]


# ---- text -------------------------------------------------------------------------------------


def text(block: Block, jacobian: bool = True) -> str:
    """Describe a block in plain text.

    Args:
        block: any block; a connected one is shown part by part.
        jacobian: show the derivatives towards states and inputs as well.

    Returns:
        Name, meaning, structural choices, equations, wires, a table of signals, unit constants
        that formulas hide, and the Jacobian.
    """
    out = [_headline(block), *_indent(block.doc.splitlines()), ""]
    if block.parts:
        out += ["Parts", *_indent(_parts(block)), ""]
    top = inner(block)
    if top.wires:
        wires = [(source, "->", target) for target, source in top.wires.items()]
        out += ["Wires", *_indent(_columns(wires)), ""]
    for path, leaf in _leaves(block):
        if block.parts:
            out.append(f"{path}: {_first_line(leaf)}".rstrip(": "))
            if not leaf.sx:
                out += _indent(leaf.doc.splitlines()[1:])
        else:
            out.append("Equations")
        out += [*_indent(_equations(leaf)), ""]
    out += ["Signals", *_indent(_table(block)), ""]
    if not block.parts and (wrong := block.check_units()):
        out += ["Units that do not fit", *_indent(wrong), ""]
    if block.conditions:
        sets = [
            (k, ", ".join(f"{n} = {v:.6g}" for n, v in values.items()))
            for k, values in block.conditions.items()
        ]
        out += ["Rail conditions", *_indent(_columns(sets)), ""]
    if reach := reach_text(block):
        out += ["Reach", *_indent([reach]), ""]
    shared = [(n, ", ".join(places_of(block, n))) for n in block.params if places_of(block, n)]
    if shared:
        shared += [(p, f"differs from {n}") for p, n in differences(block).items()]
        out += ["Shared numbers", *_indent(_columns(shared)), ""]
    if ones := hidden_units(block):
        rows = [(f"1 {unit}", doc) for unit, doc in ones.items()]
        out += ["Unit constants that the formulas hide", *_indent(_columns(rows)), ""]
    if jacobian:
        derivatives: list[str] = []
        for path, leaf in _leaves(block):
            lines = _jacobian(leaf)
            if lines and block.parts:
                lines = [path, *_indent(lines)]
            derivatives += lines
        if derivatives:
            out += ["Jacobian", *_indent(derivatives), ""]
    return "\n".join(line.rstrip() for line in out).rstrip() + "\n"


def _headline(block: Block) -> str:
    kind = {"law": "law", "flow": "flow, x' = f", "step": "step, x+ = f"}[block.kind]
    if block.period is not None:
        kind += f", every {block.period:g} s"
    units = "; units as printed, not consistent" if block.units == "printed" else ""
    return f"{block.name}: {kind}{_choices(block)}{units}"


def _choices(block: Block) -> str:
    if not block.choices:
        return ""
    return " (" + ", ".join(f"{k} = {_value(v)}" for k, v in block.choices.items()) + ")"


def _first_line(block: Block) -> str:
    return block.doc.splitlines()[0] if block.doc else ""


def _parts(block: Block, depth: int = 0) -> list[str]:
    rows = []
    for name, part in inner(block).parts.items():
        alias = f" {part.name}" if part.name != name else ""
        kind = "" if part.parts and not part.transparent else f" {part.kind}"
        rows.append(f"{'  ' * depth}{name}:{alias}{kind}{_choices(part)}")
        rows += _parts(part, depth + 1)
    return rows


def _equations(leaf: Block) -> list[str]:
    return leaf.of_equations("text", partial(_text_rows, leaf))


def _text_rows(leaf: Block) -> list[str]:
    """Equations of a block without parts as aligned lines."""
    g = page(leaf)
    if g is None and leaf.composition.solves is not None:
        lines, blocks = leaf.composition.solves
        told = _columns(lines)
        for name, block in blocks.items():
            told += ["", f"{name}: {_first_line(block)}", *_indent(_equations(block))]
        return told
    if g is None:
        return [f"in matrices and loops, {leaf.f.n_instructions()} operations; see its text"]
    formula.shorten(g)
    plain = list(islice(_lines(g, Text(g)), 10 * LINES))
    if (waits := repeats.dead_time(plain)) is not None:
        left, right, ticks = waits
        return [f"{left} = {right}, {ticks} ticks before"]
    rows = repeats.fold_repeats(plain)
    shown = _aligned(rows[:LINES])
    if len(rows) > LINES:
        shown.append(f"... and more, {leaf.f.n_instructions()} operations in all")
    return shown or ["none"]


def _jacobian(leaf: Block) -> list[str]:
    if leaf.sx and leaf.f.n_instructions() > LARGE:
        return []
    g = page(leaf, jacobian=True)
    if g is None or not g.roots:
        return []
    known = set(g.letters.values())
    formula.shorten(g, prefixes="zqhw")
    rows = [line for line in _lines(g, Text(g)) if line[0] not in known]
    if len(rows) > LINES:
        return [f"{len(g.roots)} derivatives that are not zero"]
    return _aligned(rows)


def _aligned(rows: list[tuple[str, str]]) -> list[str]:
    wide = max((len(left) for left, _ in rows), default=0)
    return [f"{left:<{wide}} = {cut(right, WIDTH)}" for left, right in rows]


_HEADER = ("", "name", "unit", "value", "range", "sign", "meaning", "source")


def _table(block: Block) -> list[str]:
    rows = [
        (s.role, s.name + _shape(s), s.unit, _shown(s), _range(s), _sign(s), s.doc, s.source)
        for s in block.signals
    ]
    if not rows:
        return ["none"]
    keep = [i for i, h in enumerate(_HEADER) if not h or any(r[i] for r in rows)]
    return _columns([tuple(r[i] for i in keep) for r in (_HEADER, *rows)])


def _shape(s: Signal) -> str:
    return f"[{','.join(map(str, s.shape))}]" if s.shape else ""


def _shown(s: Signal) -> str:
    return "noise" if s.noise else "" if s.value is None else _value(s.value)


def _value(value: Any) -> str:
    if isinstance(value, bool | str):
        return str(value)
    if isinstance(value, int | float):
        short = f"{value:.6g}"
        return short if float(short) == value else repr(float(value))
    if hasattr(value, "tolist"):
        value = value.tolist()
        if not isinstance(value, list):
            return _value(value)
    if isinstance(value, list | tuple):
        every = _flat(value)
        if len(every) > 1 and len(set(map(str, every))) == 1:
            return f"{_value(every[0])} each"
        if any(isinstance(v, list | tuple) for v in value) and len(every) > 9:
            return f"{len(every)} numbers"
        shown = ", ".join(_value(v) for v in list(value)[:6])
        return f"[{shown}{', ...' if len(value) > 6 else ''}]"
    return getattr(value, "name", None) or str(value)


def _flat(value: Any) -> list[Any]:
    """All numbers of a nested list."""
    if not isinstance(value, list | tuple):
        return [value]
    return [v for part in value for v in _flat(part)]


def _range(s: Signal) -> str:
    low, high = math.isfinite(s.lo), math.isfinite(s.hi)
    text = f">= {s.lo:g}" if low else f"<= {s.hi:g}" if high else ""
    text = f"{s.lo:g} .. {s.hi:g}" if low and high else text
    text = s.meanings or text
    return text if s.safe is None else f"{text}, safe {s.safe:g}".removeprefix(", ")


def _sign(s: Signal) -> str:
    return ", ".join(p for p in (s.positive or "", f"per {s.per}" if s.per else "") if p)


def _columns(rows: Iterable[tuple[str, ...]]) -> list[str]:
    """Rows as text with columns under one another."""
    rows = list(rows)
    wide = [max(len(r[i]) for r in rows) for i in range(len(rows[0]))]
    return ["  ".join(f"{c:<{w}}" for c, w in zip(r, wide, strict=True)).rstrip() for r in rows]


def _indent(lines: Iterable[str]) -> list[str]:
    return [f"  {line}" for line in lines]


# ---- LaTeX ------------------------------------------------------------------------------------


def latex(block: Block, jacobian: bool = False) -> str:
    """Write the equations of a block as LaTeX, a display ready for a notebook or a page.

    Args:
        block: any block; a connected one is written part by part.
        jacobian: write the derivatives towards states and inputs instead.
    """
    rows = []
    for path, leaf in _leaves(block):
        if block.parts:
            title = path.replace("_", r"\_")
            rows.append(rf"&\textbf{{{title}}}")
        rows += leaf.of_equations(("latex", jacobian), partial(_rows, leaf, jacobian))
    body = " \\\\\n".join(rows)
    return f"$$\n\\begin{{aligned}}\n{body}\n\\end{{aligned}}\n$$"


def _rows(leaf: Block, jacobian: bool) -> list[str]:
    """Equations of a block without parts as rows of LaTeX."""
    g = page(leaf, jacobian)
    if g is None:
        return [r"&\text{in matrices and loops; see its text}"]
    formula.shorten(g)
    some = list(islice(_lines(g, Latex(g)), 10 * LINES))
    if any("[" in left for left, _ in some):  # only what has an index repeats
        plain = list(islice(_lines(g, Text(g)), 10 * LINES))
        if (waits := repeats.dead_time(plain)) is not None:
            left, _, ticks = waits
            return [f"{_left(left)}(k) &= {some[-2][1]}(k - {ticks})"]
        some = repeats.written_once(plain, some)
    rows = [f"{_left(left)} &= {right}" if left else rf"&\text{{{right}}}"
            for left, right in some[:LINES]]  # fmt: skip
    if len(some) > LINES:
        rows.append(rf"&\text{{and more, {leaf.f.n_instructions()} operations in all}}")
    return rows


def _left(label: str) -> str:
    """Left-hand side: ``v'`` is a dotted v, ``v+`` a raised plus, a derivative a fraction."""
    if label.startswith("d "):
        above, below = label[2:].split(" / d ")
        return rf"\frac{{\partial {_left(above)}}}{{\partial {_left(below)}}}"
    if label.endswith("'"):
        return letter(label[:-1], "dot")
    if label.endswith("+"):
        return f"{letter(label[:-1])}^{{+}}"
    return letter(label)


# ---- what differs -----------------------------------------------------------------------------


def difference(a: Block, b: Block) -> str:
    """Tell what differs between two blocks: structure, equations, wires, signals, values, ranges.

    Returns:
        Lines with ``-`` for the first and ``+`` for the second; one line if nothing differs.
    """
    out: list[str] = []
    for what in ("kind", "period", "units"):
        if getattr(a, what) != getattr(b, what):
            out += [f"- {what}: {getattr(a, what)}", f"+ {what}: {getattr(b, what)}"]
    out += _changes({k: f"{k} = {_value(v)}" for k, v in a.choices.items()},
                    {k: f"{k} = {_value(v)}" for k, v in b.choices.items()})  # fmt: skip
    out = _section("Structure", out)
    first, second = dict(_leaves(a)), dict(_leaves(b))
    if not a.parts and not b.parts:
        first, second = {"": a}, {"": b}
    both = [p for p in first if p in second]
    for path in both:
        lines = _equation_changes(first[path], second[path])
        out += _section(f"Equations of {path}" if path else "Equations", lines)
    parts = [f"- {p}: {_first_line(first[p])}" for p in first if p not in second]
    parts += [f"+ {p}: {_first_line(second[p])}" for p in second if p not in first]
    out += _section("Parts", parts)
    wires = [{d: f"{s} -> {d}" for d, s in inner(x).wires.items()} for x in (a, b)]
    out += _section("Wires", _changes(*wires))
    tables = [{(s.role, s.name): s for s in x.signals} for x in (a, b)]
    signals = []
    for key in dict.fromkeys([*tables[0], *tables[1]]):
        s, t = tables[0].get(key), tables[1].get(key)
        if s is None or t is None:
            mark, one = ("-", s) if t is None else ("+", t)
            assert one is not None
            value = f" = {_shown(one)}" if _shown(one) else ""
            signals.append(f"{mark} {one.role} {one.name} [{one.unit}]{value}")
            continue
        for field, show in _FIELDS.items():
            if show(s) != show(t):
                signals.append(f"  {s.role} {s.name}, {field}: {show(s)!s} -> {show(t)!s}")
    out += _section("Signals", signals)
    title = f"- {_headline(a)}\n+ {_headline(b)}\n"
    return title + ("\n".join(out) if out else "\nno difference") + "\n"


_FIELDS: dict[str, Any] = {
    "unit": lambda s: s.unit,
    "value": lambda s: _shown(s) or "none",
    "range": lambda s: _range(s) or "none",
    "sign": lambda s: _sign(s) or "none",
    "shape": lambda s: s.shape,
    "source": lambda s: s.source or "none",
}


def _section(title: str, lines: list[str]) -> list[str]:
    return ["", title, *_indent(lines)] if lines else []


def _changes(a: dict[str, str], b: dict[str, str]) -> list[str]:
    out = []
    for k in dict.fromkeys([*a, *b]):
        if a.get(k) != b.get(k):
            out += [f"{mark} {x[k]}" for mark, x in (("-", a), ("+", b)) if k in x]
    return out


def _equation_changes(a: Block, b: Block) -> list[str]:
    pages = [page(x) for x in (a, b)]
    if pages[0] is None or pages[1] is None:
        alike = (pages[0] is None) == (pages[1] is None)
        sizes = [x.f.n_instructions() for x in (a, b)]
        if alike and sizes[0] == sizes[1]:
            return []
        return [
            f"{m} built by a transform, {n} operations" for m, n in zip("-+", sizes, strict=True)
        ]
    known: dict[Any, int] = {}
    texts: list[dict[str, str]] = []
    keys: list[dict[str, int]] = []
    for g in (pages[0], pages[1]):
        ids: list[int] = []
        for node in g.nodes:
            key = (node.op, tuple(ids[i] for i in node.args), repr(node.value), node.name)
            ids.append(known.setdefault(key, len(known)))
        keys.append({k: ids[root[0]] for k, root in g.roots.items()})
        keys[-1] |= {k: ids[n] for k, n in ((name, n) for name, n in formula.named_nodes(g))}
        formula.shorten(g)
        texts.append(dict(_lines(g, Text(g))))
    out = []
    for label in dict.fromkeys([*texts[0], *texts[1]]):
        one, two = (k.get(label) for k in keys)
        same_text = texts[0].get(label) == texts[1].get(label)
        if one == two and (one is not None or same_text):
            continue
        if label not in pages[0].roots and label not in pages[1].roots and None in (one, two):
            continue  # a letter of one form alone; the equation that uses it is told
        for mark, some in zip("-+", texts, strict=True):
            if label in some:
                out.append(f"{mark} {label} = {cut(some[label], WIDTH)}")
    return out
