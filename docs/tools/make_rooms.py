"""Draw docs/rooms.svg from the imports: ``python docs/tools/make_rooms.py [--check]``.

A box is a folder (room) of the engine, ``models`` or ``studies``, with the question it answers; it
stands on the floor that the table of docs/architecture.md gives it. An arc goes down to what a room
imports, thick where it does so on ten or fifty lines. Imports inside functions count too, and
modules that are looked up by a string.
"""

from __future__ import annotations

import ast
import re
import sys
from collections import Counter
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path

from made import made

HERE = Path(__file__).parents[1]
ROOT = HERE.parent
PICTURE = HERE / "rooms.svg"
ROW = re.compile(r"^\| (\d+) \| `(\w+)` \| ([^|]+?) \|", re.M)

WIDE, HIGH, RISE, LEFT, BEND = 650, 50, 66, 60, 30
INK, SHADE, GREY = "#1a1a1a", "#EEF4F9", "#6b6b6b"
HUES = ("#0072B2", "#D55E00", "#009E73", "#7F7F7F", "#CC79A7", "#56B4E9", "#E69F00")


def table() -> list[tuple[int, str, str]]:
    """Floor, name and question of each room, as docs/architecture.md has them."""
    text = (HERE / "architecture.md").read_text(encoding="utf-8")
    return [(int(floor), room, asked) for floor, room, asked in ROW.findall(text)]


def floors() -> dict[str, int]:
    """Floor of each room."""
    return {room: floor for floor, room, _ in table()}


def room_of(module: str) -> str:
    """Room of a module, ``slipctl.block.units.unit_algebra`` -> ``block``."""
    return module.split(".")[1]


def imports() -> Counter[tuple[str, str]]:
    """How many import lines lead from one room to another."""
    found: Counter[tuple[str, str]] = Counter()
    for package, folder in (("slipctl", "slipctl"), ("slipctl.models", "models"),
                            ("slipctl.studies", "studies")):  # fmt: skip
        for path in sorted((ROOT / folder).rglob("*.py")):
            inside = path.relative_to(ROOT / folder).with_suffix("").parts
            module = ".".join((package, *inside))
            if package == "slipctl" and inside[0] in ("__init__", "__main__"):
                continue
            for target in imported(ast.parse(path.read_text(encoding="utf-8"))):
                pair = room_of(module), room_of(target)
                found[pair] += pair[0] != pair[1]
    return Counter({pair: n for pair, n in found.items() if n})


def imported(tree: ast.Module) -> Iterator[str]:
    """Modules of slipctl that a line imports or looks up; what ``slipctl`` exports, by its room."""
    where = exported()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (a.name for a in node.names if a.name.startswith("slipctl."))
        elif isinstance(node, ast.Call) and (name := looked_up(node)):
            yield name
        if not isinstance(node, ast.ImportFrom) or not node.module:
            continue
        if node.module == "slipctl":
            for name in sorted({a.name for a in node.names}):
                if name in where:
                    yield f"slipctl.{where[name]}"
        elif node.module.startswith("slipctl."):
            yield node.module


LOOK_UPS = ("import_module", "__import__", "_import")


def looked_up(call: ast.Call) -> str:
    """Module of slipctl that a call looks up by a string; of an f-string what is fixed of it."""
    function = call.func.attr if isinstance(call.func, ast.Attribute) else ast.unparse(call.func)
    if not call.args or not function.endswith(LOOK_UPS):  # under another name too
        return ""
    text: ast.AST = call.args[0]
    if isinstance(text, ast.JoinedStr):
        text = text.values[0]
    name = str(text.value) if isinstance(text, ast.Constant) else ""
    return name.rstrip(".") if name.startswith("slipctl.") and name != "slipctl." else ""


SHOWN = "slipctl.study.notebook"
"""What a cell of a notebook shows: every object looks it up there, and it knows them all."""


def circles() -> list[list[str]]:
    """Modules that import or look up each other, over others too; those for types alone left out.

    The look-up of :data:`SHOWN` is left out: it is told in docs/architecture.md.
    """
    paths = {}
    for path in sorted((ROOT / "slipctl").rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        paths[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    graph = {m: {t for t in named(path) if t in paths and t != m} for m, path in paths.items()}
    for targets in graph.values():
        targets.discard("slipctl")  # exports lazily
    while ends := {m for m, targets in graph.items() if not targets & graph.keys()}:
        graph = {m: targets for m, targets in graph.items() if m not in ends}
    return sorted([m, *sorted(targets & graph.keys())] for m, targets in graph.items())


@cache
def named(path: Path) -> frozenset[str]:
    """What a file imports where it runs, each also as a module of that name."""
    nodes: list[list[ast.AST]] = [[*ast.parse(path.read_text(encoding="utf-8")).body]]
    found: set[str] = set()
    while nodes:
        for node in nodes.pop():
            if isinstance(node, ast.ImportFrom) and node.module:
                found |= {node.module, *(f"{node.module}.{a.name}" for a in node.names)}
            elif isinstance(node, ast.Import):
                found |= {a.name for a in node.names}
            elif isinstance(node, ast.Call) and (name := looked_up(node)) and name != SHOWN:
                found.add(name)
                nodes.append(list(ast.iter_child_nodes(node)))
            elif not (isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)):
                nodes.append(list(ast.iter_child_nodes(node)))
    return frozenset(found)


def exported() -> Mapping[str, str]:
    """Module of each public name, and each room by its own name."""
    import slipctl

    rooms = {path.name: path.name for path in (ROOT / "slipctl").iterdir() if path.is_dir()}
    return rooms | {"models": "models", "studies": "studies"} | slipctl._HOME


def picture(rooms: list[tuple[int, str, str]], arrows: Mapping[tuple[str, str], int]) -> str:
    """SVG of the rooms, the ground floor below, and an arc to each room that one imports.

    Arcs to ``errors`` are left out: every room imports it.
    """
    top = {room: 20 + k * RISE for k, (_, room, _) in enumerate(rooms)}
    widest = max(abs(top[a] - top[b]) for a, b in arrows) / RISE * BEND
    size = LEFT + WIDE + round(0.75 * widest) + 40, 20 + len(rooms) * RISE
    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size[0]} {size[1]}"'
        ' font-family="sans-serif">',
        "<title>Rooms of slipctl on their floors, and what each imports</title>",
        '<rect width="100%" height="100%" fill="white"/>',
    ]
    for (a, b), n in sorted(arrows.items()):
        if b == "errors":
            continue
        thick = 1 if n < 10 else 3 if n < 50 else 6
        hue = HUES[list(top).index(a) % len(HUES)]
        y1, y2 = top[a] + HIGH * 0.6, top[b] + HIGH * 0.4
        x, out_to = LEFT + WIDE, LEFT + WIDE + abs(top[b] - top[a]) / RISE * BEND
        dash = "" if y2 > y1 else ' stroke-dasharray="5 4"'
        out.append(
            f'<path d="M{x} {y1:.0f} C{out_to:.0f} {y1:.0f} {out_to:.0f} {y2:.0f} {x + 9} {y2:.0f}"'
            f' fill="none" stroke="{hue}" stroke-opacity="0.75" stroke-width="{thick}"'
            f"{dash}><title>{a} imports {b}</title></path>"
            f'<path d="M{x} {y2:.0f} l9 -4 v8 z" fill="{hue}"/>'
        )
    for floor, room, asked in rooms:
        y, said = top[room], asked.replace("`", "").replace("&", "&amp;").replace("<", "&lt;")
        out.append(
            f'<text x="{LEFT - 14}" y="{y + 31}" text-anchor="end" font-size="14" fill="{GREY}">'
            f'{floor}</text><rect x="{LEFT}" y="{y}" width="{WIDE}" height="{HIGH}" rx="6"'
            f' fill="{SHADE}" stroke="{INK}"/><text x="{LEFT + 14}" y="{y + 20}" font-size="15"'
            f' font-weight="bold" fill="{INK}">{room}</text><text x="{LEFT + 14}" y="{y + 39}"'
            f' font-size="13" fill="{INK}">{said}</text>'
        )
    return "\n".join([*out, "</svg>", ""])


if __name__ == "__main__":
    sys.exit(made(PICTURE, picture(table(), imports())))
