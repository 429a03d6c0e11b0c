"""What the names of a written block mean: units, values, ranges, tables, rail conditions."""

from __future__ import annotations

import keyword
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from slipctl.block.signals import Param, Signal
from slipctl.block.text import expression
from slipctl.block.text.expression import interpolated
from slipctl.block.units.unit_algebra import one, parse_quantity, si_text, split_quantity, unit
from slipctl.errors import BadInput, Faults, nearest

LONGEST = 10_000
"""Characters of a text; more is a model, written in Python."""

MOST = 400
"""Most equations, most names, and most points of a table."""

KEYS = ("value", "start", "unit", "range", "doc", "source", "positive", "per")
"""Words of a table that says what a name means."""

Item = str | float | int | Mapping[str, Any]
"""What a name means: a unit, a quantity, or a table of :data:`KEYS`."""

EQUATION = re.compile(r"\s*([^\W\d]\w*)\s*(['+]?)\s*=(?!=)")
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_DECLARED = re.compile(r"\s*([^\s\[=]+)\s*(?:\[([^\]]*)\])?\s*(?:=\s*(.*?))?\s*", re.DOTALL)


def is_equation(text: str) -> bool:
    """Whether a text is an equation, not a name: it has ``name =``, ``name' =`` or ``name+ =``."""
    return EQUATION.match(text) is not None


@dataclass
class Meaning:
    """What a name was said to mean, and where."""

    role: str
    keys: tuple[str, ...]
    unit: str | None = None
    value: Any = None
    lo: float | None = None
    hi: float | None = None
    doc: str = ""
    source: str = ""
    positive: str | None = None
    per: str | None = None


class Table:
    """A function by points, called on numbers or symbols."""

    def __init__(self, over: str, unit: str, points: Sequence[tuple[float, float]]) -> None:
        self.over, self.unit, self.points = over, unit, points

    def __call__(self, x: Any) -> Any:
        """Straight lines between the points, the ends held."""
        a, b = one(self.over), one(self.unit)
        return interpolated(x, [p * a for p, _ in self.points], [q * b for _, q in self.points])

    def params(self, name: str) -> list[Signal]:
        """Its places and heights as parameters, ``F_at`` and ``F_there`` of ``F``."""
        places, heights = zip(*self.points, strict=True)
        shape = (len(places),)
        return [
            Param(self.over, places, f"places of {name}", shape=shape, rising=True).named(
                f"{name}_at"
            ),
            Param(self.unit, heights, f"{name} there", shape=shape, over=f"{name}_at").named(
                f"{name}_there"
            ),
        ]


class Meanings:
    """Collects what is said of names, and all that is wrong with it."""

    def __init__(self, where: Callable[[tuple[str, ...]], str] | None) -> None:
        self.where = where or (lambda keys: ".".join(keys[1:]) if keys[0] == "" else ".".join(keys))
        self.faults: list[str] = []
        self.meanings: dict[str, Meaning] = {}
        self.tables: dict[str, Table] = {}
        self.conditions: dict[str, dict[str, Item]] = {}
        self.lost: set[str] = set()

    def wrong(self, keys: tuple[str, ...], said: str) -> None:
        """Take down a fault of what the keys lead to."""
        front = self.where(keys) if keys else ""
        self.faults.append(f"{front}: {said}" if front else said)

    def sizes(self, text: str) -> None:
        """Refuse what is no text, or too long a one."""
        if not isinstance(text, str):
            raise BadInput(f"equations are a text such as 'mu = c*v_s', not {text!r}")
        if len(text) > LONGEST:
            raise Faults([f"the text has {len(text)} characters, at most {LONGEST} are read"])

    # ---- the sentence -------------------------------------------------------------------------

    def sentence(self, text: str) -> str:
        """Read what stands behind ``where`` and ``on``; gives what stands before."""
        head, *rest = _split(text, ("where", "on"))
        for word, part in rest:
            if word == "where":
                for piece in _pieces(part, ","):
                    self.declared(piece)
            else:
                condition, colon, values = part.partition(":")
                if not colon or not _NAME.fullmatch(condition.strip()):
                    self.wrong((), f"'on {part.strip()[:30]}': write on wet: c = 0.3, a = 1 s/m")
                    continue
                pairs = [p.partition("=") for p in _pieces(values, ",")]
                self.conditions[condition.strip()] = {k.strip(): v.strip() for k, _, v in pairs}
        return head[1]

    def declared(self, piece: str) -> None:
        """Take down one piece behind ``where``."""
        match = _DECLARED.fullmatch(piece)
        if match is None or (match[2] is None and match[3] is None):
            self.wrong((), f"where: {piece.strip()[:40]!r}: write v_s [m/s] for an input, a = 0.54"
                       " s/m for a parameter")  # fmt: skip
            return
        name, given, value = match[1], match[2], match[3]
        if value is None:
            spec: Item = {"unit": given}
        else:
            value, lo, hi = self.ranged((name,), value)
            spec = {"value": value, **({"unit": given} if given is not None else {}),
                    **({"range": [lo, hi]} if lo or hi else {})}  # fmt: skip
        self.one_name("", name, spec)

    def ranged(self, keys: tuple[str, ...], text: str) -> tuple[str, str, str]:
        """Split ``"0.54 s/m in 0.1 .. 2"``."""
        value, word, ends = (part.strip() for part in _word(text, "in"))
        if not word:
            return value, "", ""
        lo, dots, hi = (part.strip() for part in ends.partition(".."))
        if not dots or not lo or not hi:
            self.wrong(keys, f"'in {ends[:30]}' is no range; write in 0.1 .. 2")
            return value, "", ""
        return value, lo, hi

    # ---- names --------------------------------------------------------------------------------

    def declare(self, kind: str, given: Mapping[str, Item]) -> None:
        """Take down a table of names."""
        if not isinstance(given, Mapping):
            self.wrong((kind,), "write a table, a name and what it means each")
            return
        for name, spec in given.items():
            self.one_name(kind, str(name), spec)

    def one_name(self, kind: str, name: str, spec: Item) -> None:
        """Take down what a name means."""
        keys = (kind, name)
        if len(self.meanings) >= MOST:
            raise Faults([*self.faults, f"there are more than {MOST} names"])
        if name in self.meanings:
            self.wrong(keys, f"{name} is declared twice")
            return
        if not self.good_name(keys, name):
            return
        if isinstance(spec, bool) or not isinstance(spec, (str, int, float, Mapping)):
            self.wrong(keys, f"{spec!r:.40} is no unit, quantity or table")
            return
        table: dict[str, Any]
        if isinstance(spec, Mapping):
            table = dict(spec)
        elif isinstance(spec, str):
            value, lo, hi = self.ranged(keys, spec)
            table = {"unit" if kind in ("inputs", "outputs") else "value": value}
            if lo or hi:
                table["range"] = [lo, hi]
        else:
            table = {"value": spec}
        for key in table:
            if key not in KEYS:
                self.wrong((*keys, str(key)), f"{name} takes no {key!r:.30}{nearest(key, KEYS)}")
        meaning = Meaning(kind, keys)
        for key in ("doc", "source"):
            if isinstance(table.get(key, ""), str):
                setattr(meaning, key, table.get(key, ""))
            else:
                self.wrong((*keys, key), f"{key} is a text")
        for key, choices in (("positive", ("braking", "traction")), ("per", ("speed", "ratio"))):
            if key in table and table[key] not in choices:
                self.wrong((*keys, key), f"{key} is {' or '.join(choices)}, not {table[key]!r:.30}")
            elif key in table:
                setattr(meaning, key, table[key])
        self.numbers(meaning, name, table)
        self.meanings[name] = meaning

    def good_name(self, keys: tuple[str, ...], name: str) -> bool:
        """Whether a name can be one; what it cannot be is told."""
        short = name if len(name) <= 40 else name[:37] + "..."
        if not _NAME.fullmatch(name):
            self.wrong(keys, f"{short!a} is no name; begin with a letter, then a..z, 0..9 and _")
        elif keyword.iskeyword(name):
            self.wrong(keys, f"{name} is a word of the grammar; write {name}_")
        elif name in expression.FUNCTIONS or name in expression.CONSTANTS:
            self.wrong(keys, f"{name} is a function or constant; write {name}_")
        else:
            return True
        return False

    def numbers(self, m: Meaning, name: str, table: Mapping[str, Any]) -> None:
        """Unit, value and range of a name, in SI where a value brings its unit."""
        told = table.get("unit")
        if told is not None and not isinstance(told, str):
            self.wrong((*m.keys, "unit"), f"unit {told!r:.30} is no text such as 'm/s'")
            return
        if "value" in table and "start" in table:
            self.wrong(m.keys, "value and start are the same; write one of them")
        value = table.get("value", table.get("start"))
        try:
            if told is not None:
                unit(told)
            written = told
            if isinstance(value, str) and told is None:
                written = _unit_of(name, value)
            m.unit = None if written is None and value is None else si_text(written or "1")
            if value is None:
                m.unit = told
            elif isinstance(value, str):
                m.value = self.quantity(m, value, told)
            elif isinstance(value, bool) or not isinstance(value, (int, float)):
                raise BadInput(f"value {value!r:.40} is no number with a unit")
            else:
                m.value = parse_quantity(_in(repr(float(value)), told), m.unit or "1")
            ends = table.get("range")
            if ends is not None:
                if not isinstance(ends, (list, tuple)) or len(ends) != 2:
                    raise BadInput(f"{ends!r:.40} is no range; write ['0.1 s/m', '2 s/m']")
                last = ends[1] if isinstance(ends[1], str) else ""
                both = (split_quantity(last)[1] if last else None) or written or "1"
                lo, hi = (self.end(e, both, m.unit or "1") for e in ends)
                if not lo < hi:
                    raise BadInput(f"its range begins at {lo:g}, above its end {hi:g}")
                m.lo, m.hi = lo, hi
        except BadInput as error:
            self.lost.add(name)
            self.wrong(m.keys, bare(error))

    def quantity(self, m: Meaning, value: str, told: str | None) -> Any:
        """A quantity in the unit of the name, or an expression of other names as it is."""
        if told is not None:
            try:
                return parse_quantity(_in(value, told), m.unit or "1")
            except BadInput:
                try:
                    if expression.read(value).names:
                        return value
                except Faults as error:
                    raise BadInput(f"{value!r:.40}: {error.lines[0]}") from None
                raise
        return parse_quantity(value, m.unit or "1")

    def end(self, end: Any, written: str, si: str) -> float:
        """Read a number, in the unit ``written`` if it has none of its own."""
        if isinstance(end, bool) or not isinstance(end, (str, int, float)):
            raise BadInput(f"an end of its range is {end!r:.30}; give a number")
        text = end if isinstance(end, str) else repr(float(end))
        return parse_quantity(_in(text, written), si)

    def table(self, name: str, spec: Any) -> None:
        """Take down a function by points."""
        keys = ("tables", name)
        if not self.good_name(keys, name):
            return
        if not isinstance(spec, Mapping):
            self.wrong(keys, "write { over = 'm/s', unit = 'kN', points = [[0, 10], [20, 8]] }")
            return
        for key in spec:
            if key not in ("over", "unit", "points", "doc"):
                close = nearest(str(key), ("over", "unit", "points", "doc"))
                self.wrong((*keys, str(key)), f"a table takes no {key!r:.30}{close}")
        over, of, points = spec.get("over", "1"), spec.get("unit", "1"), spec.get("points")
        rows = points if isinstance(points, (list, tuple)) else []
        if not 2 <= len(rows) <= MOST or any(
            not isinstance(r, (list, tuple)) or len(r) != 2 for r in rows
        ):
            self.wrong(keys, f"points are 2 to {MOST} pairs, [[0, 10], [20, 8]]")
            return
        try:
            a, b = si_text(str(over)), si_text(str(of))
            found = [(self.end(x, str(over), a), self.end(y, str(of), b)) for x, y in rows]
        except BadInput as error:
            self.wrong(keys, bare(error))
            return
        if any(q[0] <= p[0] for p, q in pairwise(found)):
            self.wrong(keys, "the places of its points must increase")
            return
        self.tables[name] = Table(a, b, found)


def _unit_of(name: str, value: str) -> str | None:
    """Unit that a quantity brings."""
    try:
        return split_quantity(value)[1]
    except BadInput:
        if not re.search("[A-Za-z]", value):
            raise
        raise BadInput(
            f"{value!r:.40} is no number with a unit; an expression needs a unit:"
            f" {name} [unit] = {value:.40}"
        ) from None


def _in(text: str, unit: str | None) -> str:
    """Text of a quantity, in the unit if it has none of its own."""
    return f"{text} {unit}" if split_quantity(text)[1] is None and unit not in (None, "1") else text


def bare(error: BadInput) -> str:
    """What was wrong, without the unit in front that the reader of quantities puts there."""
    return re.sub(r"^\[[^\]]*\]:? ", "", str(error).removeprefix(": "))


# ---- pieces of text -----------------------------------------------------------------------------


def _word(text: str, word: str) -> tuple[str, str, str]:
    """Split at a word that stands alone."""
    match = re.search(rf"(?<![\w.]){word}(?![\w.])", text)
    return (text, "", "") if match is None else (text[: match.start()], word, text[match.end() :])


def _split(text: str, words: Sequence[str]) -> list[tuple[str, str]]:
    """Split at words that stand alone; the first piece has none."""
    pattern = re.compile(rf"(?<![\w.'+])({'|'.join(words)})(?![\w.'+])(?!\s*=)")
    found, at, word = [], 0, ""
    for match in pattern.finditer(text):
        found.append((word, text[at : match.start()]))
        at, word = match.end(), match[1]
    return [*found, (word, text[at:])]


def _pieces(text: str, mark: str) -> list[str]:
    """Split at a mark outside brackets."""
    found, depth, at = [], 0, 0
    for k, c in enumerate(text):
        depth += (c in "([") - (c in ")]")
        if c == mark and depth <= 0:
            found.append(text[at:k])
            at = k + 1
    return [p for p in [*found, text[at:]] if p.strip()]
