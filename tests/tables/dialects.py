"""One true coasting log, written in many dialects; shares no line with the reader.

A car of 38 t, rho = 6 %, c0 = 1200 N, c1 = 12 N s/m, c2 = 4.5 N s^2/m^2 coasts from 22 m/s.
"""

from __future__ import annotations

import random
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from functools import cache
from pathlib import Path

M, C = 38e3 * 1.06, (1200.0, 12.0, 4.5)
STEP = 0.1


@cache
def speeds(first: float = 22.0, seconds: float = 120.0, seed: int = 1) -> tuple[float, ...]:
    """Measured speed in m/s every 0.1 s; Heun's method, 10 ms; noise of 0.02 m/s."""
    draw, v, found = random.Random(seed), first, []

    def fall(v: float) -> float:
        return -(C[0] + C[1] * v + C[2] * v * v) / M

    for k in range(round(seconds / 0.01)):
        if k % 10 == 0:
            found.append(v + draw.gauss(0, 0.02))
        a = fall(v)
        v += 0.005 * (a + fall(v + 0.01 * a))
    return tuple(found)


@dataclass
class Dialect:
    """How a log is written.

    Attributes:
        rows: lines before, head and rows, as cells.
        mark: between cells.
        name: of the column of speeds, as a person types it.
        coding, end, begin: of the text.
        said: what was chosen, for a message.
        quoted: whether all cells are.
    """

    rows: list[list[str]] = field(default_factory=list)
    mark: str = ";"
    name: str = "Speed"
    coding: str = "utf-8"
    end: str = "\n"
    begin: str = ""
    said: list[str] = field(default_factory=list)
    quoted: bool = False

    def write(self, file: Path) -> None:
        """Write it as text."""
        lines = []
        for row in self.rows:
            cells = [f'"{c}"' if (self.quoted or self.mark in c) and c else c for c in row]
            lines.append(self.mark.join(cells))
        file.write_bytes((self.begin + self.end.join(lines) + self.end).encode(self.coding))


def number(x: float, digits: int, decimal: str, group: str = "", bare: bool = False) -> str:
    """A number as it is written; ``bare`` leaves out zeros at its end."""
    text = f"{abs(x):.{digits}f}"
    if bare and "." in text:
        text = text.rstrip("0").rstrip(".")
    whole, _, rest = text.partition(".")
    if group:
        parts = []
        while len(whole) > 3:
            whole, parts = whole[:-3], [whole[-3:], *parts]
        whole = group.join([whole, *parts])
    return ("-" if x < 0 and float(text) else "") + whole + (decimal + rest if rest else "")


def stamp(seconds: float, how: str, decimal: str, start: datetime) -> str:
    """A clock time or a date, to the millisecond."""
    at = start + timedelta(milliseconds=round(1000 * seconds))
    ms = f"{decimal}{at.microsecond // 1000:03d}"
    clock = f"{at:%H:%M:%S}{ms}"
    return {
        "clock": clock,
        "am": f"{at:%I:%M:%S}{ms} {at:%p}",
        "minutes": f"{at.minute:02d}:{at.second:02d}{decimal}{at.microsecond // 100000}",
        "iso": f"{at:%Y-%m-%d}T{clock}",
        "blank": f"{at:%Y-%m-%d} {clock}",
        "zone": f"{at:%Y-%m-%d}T{clock}+02:00",
        "z": f"{at:%Y-%m-%d}T{clock}Z",
        "german": f"{at:%d.%m.%Y} {clock}",
        "short": f"{at.day}.{at.month}.{at:%y} {clock}",
        "us": f"{at.month}/{at.day}/{at.year} {clock}",
        "us am": f"{at.month}/{at.day}/{at.year} {at:%I:%M:%S}{ms} {at:%p}",
        "british": f"{at:%d/%m/%Y} {clock}",
        "matlab": f"{at:%d-%b-%Y} {clock}",
        "slash": f"{at:%Y/%m/%d} {clock}",
    }[how]


STAMPS = ("clock", "am", "minutes", "iso", "blank", "zone", "z", "german", "short", "us", "us am",
          "british", "matlab", "slash")  # fmt: skip

UNITS = {"km/h": 3.6, "m/s": 1.0, "kph": 3.6, "mph": 1 / 0.44704, "Km/h": 3.6, "kmh": 3.6,
         "KM/H": 3.6, "km/std": 3.6, "mm/s": 1000.0, "cm/s": 100.0}  # fmt: skip

EPOCH = datetime(1970, 1, 1)


def times(draw: random.Random, t: list[float], decimal: str, group: str, d: Dialect) -> tuple[
    list[str], str, str
]:  # fmt: skip
    """Cells of the times, name of their column and its unit, empty where it has none."""
    kind = draw.choice(["s", "ms", "us", "min", "named", "epoch", "stamp", "stamp", "stamp",
                        "bare s", "days", "bare ms"])  # fmt: skip
    name = draw.choice(["Zeit", "time", "t", "Time", "timestamp", "Timestamp", "TIME"])
    bare = draw.random() < 0.3
    start = datetime(2024, draw.choice([5, 11]), draw.choice([1, 4, 25, 30]), draw.choice([8, 23]),
                     draw.choice([2, 57, 59]), 58)  # fmt: skip
    d.said += [f"time {kind} {name}", f"bare={bare}"]
    if kind == "stamp":
        how = draw.choice(STAMPS)
        d.said.append(how)
        return [stamp(x, how, draw.choice([decimal]), start) for x in t], name, ""
    if kind == "epoch":
        unit, scale = draw.choice([("s", 1), ("ms", 1000), ("us", 10**6), ("ns", 10**9)])
        base = round((start - EPOCH).total_seconds())
        d.said.append(unit)
        digits = 3 if unit == "s" else 0
        if digits:
            return [number(base + x, 3, decimal) for x in t], name, draw.choice(["", unit])
        return (
            [str(base * scale + round(x * 1000) * (scale // 1000)) for x in t],
            name,
            draw.choice(["", unit]),
        )
    if kind == "named":
        unit, factor = draw.choice([("ms", 1e3), ("us", 1e6), ("s", 1.0), ("ns", 1e9)])
        head = draw.choice(["time_{}", "t_{}", "Time{}", "Zeit_{}", "time {}", "TIME_{}"])
        said = unit.upper() if head in ("Time{}", "TIME_{}") else unit
        cells = [number(factor * x, 2 if unit == "s" else 0, decimal, group, bare) for x in t]
        d.said.append(head.format(said))
        return cells, head.format(said), ""
    unit, factor, digits = {
        "s": ("s", 1.0, draw.choice([1, 2, 3])), "ms": ("ms", 1e3, draw.choice([0, 0, 3])),
        "us": (draw.choice(["us", "µs"]), 1e6, 0), "min": ("min", 1 / 60, 7),
        "bare s": ("", 1.0, 2), "days": ("", 1 / 86400, 9), "bare ms": ("", 1e3, 0),
    }[kind]  # fmt: skip
    shift = 45413.375 if kind == "days" else draw.choice([0.0, 0.0, 12.0, 1234.5])
    return [number(factor * x + (shift if kind == "days" else factor * shift), digits, decimal,
                   group, bare) for x in t], name, unit  # fmt: skip


def clock_fault(draw: random.Random, t: list[float], d: Dialect) -> list[float]:
    """Times as a logger with a faulty clock writes them."""
    kind = draw.choice(["back", "anew", "late", "twice", "lost", "wild", "none", "none", "none",
                        "swapped"])  # fmt: skip
    d.said.append(kind)
    n = len(t)
    if kind == "back":
        k, by = draw.randrange(300, n - 300), draw.choice([0.25, 2.05, 3.0, 77.7, 0.2])
        return [x - by * (j >= k) for j, x in enumerate(t)]
    if kind == "anew":
        k = draw.randrange(400, n - 400)
        return [x - t[k] * (j >= k) for j, x in enumerate(t)]
    if kind == "wild":
        k = draw.randrange(50, n - 50)
        t[k] += draw.choice([500.0, -3.0, 0.15])
    return t


def order_fault(draw: random.Random, rows: list[list[str]], d: Dialect) -> list[list[str]]:
    """Rows in another order, twice, or lost."""
    n, kind = len(rows), d.said[-1]
    if kind == "late":
        for _ in range(draw.randint(1, 4)):
            k = draw.randrange(10, n - 10)
            rows.insert(k + draw.randint(1, 4), rows.pop(k))
    if kind == "twice":
        for _ in range(draw.randint(1, 4)):
            k = draw.randrange(10, n - 10)
            rows.insert(k + 1, list(rows[k]))
    if kind == "lost":
        k = draw.randrange(100, n - 300)
        del rows[k : k + draw.randint(1, 200)]
    if kind == "swapped":
        draw.shuffle(rows)
    return rows


def dialect_of(seed: int) -> Dialect:
    """The log in the dialect of a seed."""
    draw = random.Random(seed)
    d = Dialect()
    d.mark = draw.choice([";", ",", "\t", "|", ";"])
    decimal = draw.choice([".", ","])
    d.quoted = draw.random() < 0.2
    careless = d.mark == "," and decimal == "," and draw.random() < 0.5
    group = draw.choice(["", "", "", {".": ",", ",": "."}[decimal], " ", "'"])
    unit = draw.choice(list(UNITS))
    digits = draw.choice([2, 3, 3, 4, 1] if UNITS[unit] > 3 else [2, 3, 4])
    bare = draw.random() < 0.3
    v = [UNITS[unit] * x for x in speeds()]
    d.said = [f"mark={d.mark!r}", f"decimal={decimal}", f"group={group!r}", f"unit={unit}",
              f"digits={digits}", f"careless={careless}"]  # fmt: skip
    t = [STEP * k for k in range(len(v))]
    t = clock_fault(draw, t, d)
    fault = d.said[-1]
    base = min(t)
    cells, time, time_unit = times(draw, [x - base for x in t], decimal, group, d)
    written = [number(x, digits, decimal, group, bare) for x in v]
    door = [draw.choice(["0", "1"]) if draw.random() < 0.01 else "0" for _ in v]
    extra = draw.choice(["none", "door", "temperature", "text", "rpm"])
    others = {
        "none": None, "door": ("door", "-", door), "text": ("State", "", ["coast"] * len(v)),
        "temperature": ("Temp", "°C", [number(20 + k / 1000, 1, decimal) for k in range(len(v))]),
        "rpm": ("n", "U/min", [number(1000 + x * 20, 0, decimal, group) for x in v]),
    }[extra]  # fmt: skip
    heads, row_units, rows = _heads(draw, d, (time, time_unit), unit, others), [], []
    columns = [cells, written, *([others[2]] if others else [])]
    if draw.random() < 0.3:
        order = draw.sample(range(len(columns)), len(columns))
        columns, heads = [columns[k] for k in order], [heads[k] for k in order]
    rows = [list(r) for r in zip(*columns, strict=True)]
    d.said.append(fault)
    rows = order_fault(draw, rows, d)
    row_units = [u for _, u in heads]
    if draw.random() < 0.1 and fault != "swapped":
        names = [n for n, _ in heads]
        place = names.index(d.name) if d.name in names else 0
        for _ in range(5):
            rows[draw.randrange(len(rows))][place] = draw.choice(["", "NaN", "#N/A", "-"])
        d.said.append("empty cells")
    style = draw.choice(["[]", "()", "row", " in "]) if any(row_units) else "[]"
    head = [n if not u or style == "row" else {"[]": f"{n} [{u}]", "()": f"{n} ({u})", " in ":
            f"{n} in {u}"}[style] for n, u in heads]  # fmt: skip
    d.said.append(f"head={head} {row_units if style == 'row' else ''}")
    body = [head, *([row_units] if style == "row" else []), *rows]
    d.rows = _before(draw, d, len(head)) + body + draw.choice([[], [], [["End of file"]]])
    d.coding = draw.choice(["utf-8", "utf-8-sig", "utf-16", "cp1252", "utf-8"])
    d.end = draw.choice(["\n", "\r\n"])
    if careless:
        d.mark, d.quoted = "\0", False
        d.rows = [[c for cell in row for c in cell.split(",")] for row in d.rows]
        d.mark = ","
    d.said.append(f"{d.coding} quoted={d.quoted}")
    return d


def _heads(
    draw: random.Random, d: Dialect, time: tuple[str, str], unit: str,
    others: tuple[str, str, list[str]] | None,
) -> list[tuple[str, str]]:  # fmt: skip
    """Name and unit of each column; what a person types for the speed."""
    d.name = draw.choice(["Speed", "v_train", "V Ref", "Geschw.", "speed(filtered)"])
    kind = draw.choice(["head", "head", "head", "name", "told"])
    if kind == "name" and unit in ("km/h", "kmh", "mph", "m/s"):
        d.name = "speed_" + {"km/h": "kmh", "m/s": "mps"}.get(unit, unit)
        said = (d.name, "")
    elif kind == "told":
        said, d.name = (d.name, ""), f"{d.name}[{unit}]"
    else:
        said = (d.name, unit)
    return [time, said, *([others[:2]] if others else [])]


def _before(draw: random.Random, d: Dialect, width: int) -> list[list[str]]:
    """Lines before the head."""
    kind = draw.choice(["none", "none", "plain", "padded", "sep", "pairs", "comment"])
    d.said.append(f"before={kind}")
    if kind == "sep" and d.mark in ";,\t|":
        d.begin = f"sep={d.mark}" + "\n"
        return []
    if kind == "plain":
        return [["Logger 7"], ["Wagen 12 on line 3"], [""]]
    if kind == "padded":
        pad = [""] * (width - 2)
        return [["Fahrzeug", "Wagen 7", *pad], ["Datum", "01.05.2024", *pad],
                ["Masse in t", "38", *pad]]  # fmt: skip
    if kind == "pairs":
        return [["Fahrer", "Meier"], ["Wagen", "7"], ["Radsatz 1", "0"], [""]]
    if kind == "comment":
        return [["# made by logger 3"], ["# set nothing"]]
    return []
