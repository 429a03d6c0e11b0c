"""Drawing of a block diagram: layered from left to right, with orthogonal wires.

As few wires as possible run against the stream; those go below the boxes. Wires carry the name and
unit of their signal, inputs of a box are named inside it.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from html import escape

from slipctl.draw.diagrams.layers import layers_of
from slipctl.draw.diagrams.levels import Level, Node, Port

# ---- drawing ----------------------------------------------------------------------------------

SLOT, HEAD, GAP, TRACK, LANE, MARGIN, END = 22, 32, 28, 11, 15, 18, 16
FONT = "Helvetica, Arial, 'DejaVu Sans', sans-serif"
INK, WIRE, FILL, FAINT = "#1d2733", "#35608c", "#f4f7fb", "#66727f"


@dataclass(eq=False)
class _Place:
    """A node, or a wire passing a column, with its place on the sheet."""

    node: Node | None
    ins: list[Port]
    outs: list[Port]
    column: int
    x: float = 0.0
    y: float = 0.0
    width: float = 0.0
    height: float = 0.0

    def port_y(self, port: Port, out: bool) -> float:
        """Height of a port above the top of the sheet."""
        ports = self.outs if out else self.ins
        if self.node is None or not self.node.box:
            return self.y + self.height / 2
        spare = max(len(self.ins), len(self.outs)) - len(ports)
        return self.y + HEAD + SLOT * (ports.index(port) + 0.5 + spare / 2)


_Link = tuple[_Place, Port, _Place, Port]
"""Piece of a wire across one channel, from a port of a place to one of the next column."""


@dataclass
class _Hop:
    """A wire across one channel: from a port (or passing place) to others."""

    net: Port
    start: float
    ends: list[float] = field(default_factory=list)
    down: bool = False
    up: bool = False
    x: float = 0.0
    again: float | None = None  # second vertical line, where two wires change places
    level: float = 0.0  # height between the two lines


def _text_width(text: str, size: float) -> float:
    """Width of a text in the drawing's font, near enough for boxes that hold it."""
    wide = [0.32 if c in "iljt.,'[]() /|I1" else 0.86 if c in "mwMW" else 0.58 for c in text]
    return sum(wide) * size


class Drawing:
    """Places nodes, routes wires, and writes the SVG of one level."""

    def __init__(self, lv: Level) -> None:
        self.lv = lv
        self.columns = layers_of(lv)
        self.count = max(self.columns.values(), default=0) + 1
        self.places: dict[str, _Place] = {}
        self.passing: dict[tuple[Port, int], _Place] = {}
        self.stacks: list[list[_Place]] = [[] for _ in range(self.count)]
        for key, node in lv.nodes.items():
            self._add(key, node)
        for net, ends in lv.nets.items():
            start = self.columns[net[0]]
            far = max([self.columns[b] for b, _ in ends if self.columns[b] > start], default=start)
            for c in range(start + 1, far):
                place = _Place(None, [net], [net], c, height=END)
                self.passing[net, c] = place
                self.stacks[c].append(place)
        self.links = self._links()
        self.into: dict[int, list[_Link]] = defaultdict(list)  # links by the place they touch
        self.out_of: dict[int, list[_Link]] = defaultdict(list)
        for link in self.links:
            self.out_of[id(link[0])].append(link)
            self.into[id(link[2])].append(link)
        self._sort()
        self._set_heights()
        self._route()

    def boxes(self) -> dict[str, tuple[float, float, float, float]]:
        """Left, top, width and height of each box, by its name."""
        return {
            k: (p.x, p.y, p.width, p.height)
            for k, p in self.places.items() if p.node is not None and p.node.box
        }  # fmt: skip

    def _add(self, key: str, node: Node) -> None:
        ins, outs = [(key, i) for i in node.ins], [(key, o) for o in node.outs]
        place = _Place(node, ins, outs, self.columns[key])
        if node.box:
            place.height = HEAD + 6 + SLOT * max(len(ins), len(outs), 1)
            labels = max([_text_width(i, 10) for i in node.ins], default=0.0)
            title = max(_text_width(node.title, 13.5), _text_width(node.note, 10))
            place.width = max(84.0, title + 24, labels + 40)
        else:
            place.height = END
            place.width = 1.1 * _text_width(self._label(key, node), 11) + 8
        self.places[key] = place
        self.stacks[place.column].append(place)

    def _label(self, key: str, node: Node) -> str:
        port = (key, node.title)
        if port in self.lv.units:
            return f"{node.title} [{self.lv.units[port]}]"
        return node.title

    # -- places

    @staticmethod
    def _gap(above: _Place, below: _Place) -> float:
        """Room between two nodes of one column; ends stand as close as ports."""
        boxes = sum(p.node is not None and p.node.box for p in (above, below))
        return (SLOT - END, 14.0, GAP)[boxes]

    def _links(self) -> list[_Link]:
        """Pieces of wires with the stream, each across one channel and once."""
        out: dict[_Link, None] = {}
        for net, ends in self.lv.nets.items():
            source = self.places[net[0]]
            for end in ends:
                target = self.places[end[0]]
                if target.column <= source.column:
                    continue
                before, port = source, net
                for c in range(source.column + 1, target.column):
                    here = self.passing[net, c]
                    out[before, port, here, net] = None
                    before, port = here, net
                out[before, port, target, end] = None
        return list(out)

    def _sort(self) -> None:
        """Order each column by the middle of what its nodes are wired to."""
        rank = {id(p): float(i) for stack in self.stacks for i, p in enumerate(stack)}

        def middle(place: _Place, left: bool) -> float:
            if left:
                links = self.into[id(place)]
                near = [rank[id(a)] + 0.9 * _share(a, pa, True) for a, pa, _, _ in links]
            else:
                links = self.out_of[id(place)]
                near = [rank[id(b)] + 0.9 * _share(b, pb, False) for _, _, b, pb in links]
            return sum(near) / len(near) if near else rank[id(place)]

        for sweep in range(8):
            stacks = self.stacks if sweep % 2 == 0 else self.stacks[::-1]
            for stack in stacks:
                stack.sort(key=lambda p: (middle(p, sweep % 2 == 0), rank[id(p)]))
                for i, p in enumerate(stack):
                    rank[id(p)] = float(i)
        for place in self.places.values():  # outputs in the order of what they feed
            goal: dict[Port, list[float]] = defaultdict(list)
            for _, pa, b, pb in self.out_of[id(place)]:
                goal[pa].append(rank[id(b)] + 0.9 * _share(b, pb, False))
            place.outs.sort(key=lambda o: sum(goal[o]) / len(goal[o]) if goal[o] else 1e9)

    def _set_heights(self) -> None:
        """Move nodes so that wires run straight where there is room."""
        for stack in self.stacks:
            y = 0.0
            for p, below in _pairs(stack):
                p.y, y = y, y + p.height + (self._gap(p, below) if below else 0.0)
        for sweep in range(12):
            order = range(self.count) if sweep % 2 == 0 else range(self.count - 1, -1, -1)
            for c in order:
                self._settle(self.stacks[c], both=sweep > 5)
        for _ in range(4):
            for stack in self.stacks:
                self._straighten(stack)
        top = min((p.y for stack in self.stacks for p in stack), default=0.0)
        for stack in self.stacks:
            for p in stack:
                p.y = round(p.y - top + MARGIN + 26, 1)

    def _settle(self, stack: list[_Place], both: bool) -> None:
        wish = []
        for p in stack:
            moves = [-shift for shift in self._bends(self.out_of[id(p)])]
            moves += self._bends(self.into[id(p)])
            moves.sort(key=abs)
            best = moves[0] if moves and both else sum(moves) / len(moves) if moves else 0.0
            wish.append(p.y + best)
        blocks: list[tuple[float, float, list[_Place]]] = []  # (top, height, places)
        for p, y in zip(stack, wish, strict=True):
            blocks.append((y, p.height, [p]))
            while len(blocks) > 1:
                (y1, h1, first), (y2, h2, second) = blocks[-2:]
                gap = self._gap(first[-1], second[0])
                if y1 + h1 + gap <= y2:
                    break
                n1, n2 = len(first), len(second)
                together = (y1 * n1 + (y2 - h1 - gap) * n2) / (n1 + n2)
                blocks[-2:] = [(together, h1 + gap + h2, first + second)]
        for y, _, group in blocks:
            for p, below in _pairs(group):
                p.y, y = y, y + p.height + (self._gap(p, below) if below else 0.0)

    @staticmethod
    def _bends(links: list[_Link]) -> list[float]:
        """How far each wire falls on its way."""
        return [a.port_y(pa, True) - b.port_y(pb, False) for a, pa, b, pb in links]

    def _straighten(self, stack: list[_Place]) -> None:
        """Shift nodes a little where that makes one wire more run straight."""
        for i, p in enumerate(stack):
            bends = [-shift for shift in self._bends(self.out_of[id(p)])]
            bends += self._bends(self.into[id(p)])
            low, high = -1e9, 1e9
            if i:
                low = stack[i - 1].y + stack[i - 1].height + self._gap(stack[i - 1], p)
            if i + 1 < len(stack):
                high = stack[i + 1].y - self._gap(p, stack[i + 1]) - p.height

            def straight(shift: float, bends: list[float] = bends) -> int:
                return sum(abs(d - shift) < 0.6 for d in bends)

            free = [d for d in bends if low - 1e-9 <= p.y + d <= high + 1e-9 and abs(d) < 2 * SLOT]
            best = max(free, key=lambda d: (straight(d), -abs(d)), default=0.0)
            if straight(best) > straight(0.0):
                p.y += best

    # -- wires

    def _route(self) -> None:
        """Give every wire its vertical line in each channel and its lane below."""
        self.hops: list[list[_Hop]] = [[] for _ in range(self.count + 1)]
        self.back: dict[Port, list[Port]] = {}
        for net, ends in self.lv.nets.items():
            source = self.places[net[0]]
            back = [e for e in ends if self.places[e[0]].column <= source.column]
            if back:
                self.back[net] = back
                self.hops[source.column].append(_Hop(net, source.port_y(net, True), down=True))
                for end in back:
                    target = self.places[end[0]]
                    arriving = self._hop(target.column - 1, net, 0.0, up=True)
                    arriving.ends.append(target.port_y(end, False))
        for a, pa, b, pb in self.links:
            self._hop(a.column, pa, a.port_y(pa, True)).ends.append(b.port_y(pb, False))
        x = float(MARGIN)
        if any(h.up for h in self.hops[-1]):
            x += self._tracks(self.hops[-1], x, 0.0)
        for c, stack in enumerate(self.stacks):
            width = max((p.width for p in stack), default=0.0)
            for p in stack:
                p.x = x if p.node is None or p.node.box else x + width - p.width
                if p.node is not None and not p.node.box and p.node.ins:
                    p.x = x
                if p.node is None or p.node.box:
                    p.width = width
            x += width
            labels = [
                _text_width(self.lv.label(h.net), 10.5) + 18
                for h in self.hops[c]
                if not h.up and self.places[h.net[0]].column == c and self._labelled(h.net)
            ]
            x += self._tracks(self.hops[c], x, max(labels, default=8.0))
        self.width = x + MARGIN
        deepest = max((p.y + p.height for s in self.stacks for p in s), default=0.0)
        spans = sorted(self.back, key=lambda n: (self._span(n), list(self.lv.nets).index(n)))
        self.lanes = {net: deepest + 18 + LANE * i for i, net in enumerate(spans)}
        self.height = max([deepest, *self.lanes.values()], default=0.0) + MARGIN

    def _hop(self, channel: int, net: Port, start: float, up: bool = False) -> _Hop:
        """The wire across a channel, with the stream or ``up`` from below; made where it is not."""
        for hop in self.hops[channel]:
            if hop.net == net and hop.up == up:
                return hop
        self.hops[channel].append(_Hop(net, start, up=up))
        return self.hops[channel][-1]

    def _span(self, net: Port) -> int:
        return self.columns[net[0]] - min(self.columns[b] for b, _ in self.back[net])

    def _labelled(self, net: Port) -> bool:
        return self.lv.nodes[net[0]].box

    def _tracks(self, hops: list[_Hop], x: float, labels: float) -> float:
        """Place the vertical lines of a channel; returns the channel's width."""
        bent = [h for h in hops if h.up or h.down or any(abs(e - h.start) > 0.6 for e in h.ends)]
        order = self._track_order(bent)
        for i, (hop, second) in enumerate(order):
            line = x + labels + TRACK * (i + 0.5)
            if second:
                hop.again = line
            else:
                hop.x = line
        for hop in hops:
            if hop not in bent:
                hop.x = x + labels
        return max(labels + TRACK * len(order) + 12, 30.0) if hops else 30.0

    @staticmethod
    def _track_order(hops: list[_Hop]) -> list[tuple[_Hop, bool]]:
        """Order of the vertical lines; the flag marks the second line of a wire that has two.

        A line to an end level with another wire's start stands right of that wire's line. Where
        wires change places in a ring, one of them steps aside first.
        """

        def reach(h: _Hop) -> tuple[int, float]:
            ends = h.ends or [h.start]
            rising = (sum(ends) / len(ends)) < h.start
            return (1 if h.up else 0, h.start if rising else -h.start)

        waiting = [(h, False) for h in sorted(hops, key=reach)]
        out: list[tuple[_Hop, bool]] = []
        while waiting:
            starts = [(h, h.start) for h, second in waiting if not (second or h.up)]
            free = [
                (h, second)
                for h, second in waiting
                if not any(o is not h and abs(e - y) < 4 for o, y in starts for e in h.ends)
            ]
            if free:
                out.append(free[0])
                waiting.remove(free[0])
                continue
            aside = next(h for h, second in waiting if not (second or h.up))
            aside.level = aside.start + SLOT / 2 + 3 * (len(out) % 3 - 1)
            out.append((aside, False))
            waiting[[h for h, _ in waiting].index(aside)] = (aside, True)
        return out

    # -- writing

    def body(self, dx: float = 0.0, dy: float = 0.0) -> str:
        """SVG elements of the level, moved by (dx, dy)."""
        out = [f'<g transform="translate({dx:g},{dy:g})">']
        out.append(_words(MARGIN, MARGIN + 2, self.lv.title, 14, INK, "start", bold=True))
        for net in self.lv.nets:
            out += self._wire(net)
        for key, place in self.places.items():
            out += self._node(key, place)
        for net in self.lv.nets:
            if self._labelled(net):
                place = self.places[net[0]]
                shift = 10 if self.lv.nodes[net[0]].deep else 6
                x, y = place.x + place.width + shift, place.port_y(net, True) - 5
                out.append(_words(x, y, self.lv.label(net), 10.5, WIRE, "start"))
        return "\n".join([*out, "</g>"])

    def _node(self, key: str, p: _Place) -> list[str]:
        node = p.node
        assert node is not None
        if not node.box:
            text = self._label(key, node)
            x, anchor = (p.x + 2, "start") if node.ins else (p.x + p.width - 4, "end")
            return [_words(x, p.y + p.height / 2 + 4, text, 11, WIRE, anchor, bold=True)]
        out = []
        for shift in (4, 0) if node.deep else (0,):
            out.append(
                f'<rect x="{p.x + shift:g}" y="{p.y - shift:g}" width="{p.width:g}"'
                f' height="{p.height:g}" rx="5" fill="{FILL}" stroke="{INK}" stroke-width="1.3"/>'
            )
        middle = p.x + p.width / 2
        out.append(_words(middle, p.y + 17, node.title, 13.5, INK, "middle", bold=True))
        if node.note:
            out.append(_words(middle, p.y + 29, node.note, 10, FAINT, "middle"))
        for port in () if node.state else p.ins:
            y = p.port_y(port, False) + 3.5
            out.append(_words(p.x + 7, y, port[1], 10, FAINT, "start"))
        return out

    def _wire(self, net: Port) -> list[str]:
        ink = _Ink()
        for c, hops in enumerate(self.hops):
            for hop in hops:
                if hop.net == net and not hop.up:
                    self._stream(ink, net, c, hop)
        if net in self.back:
            self._return(ink, net)
        return ink.svg()

    def _stream(self, ink: _Ink, net: Port, column: int, hop: _Hop) -> None:
        """Draw a wire across one channel."""
        source = self.places[net[0]]
        here = source if column == source.column else self.passing[net, column]
        left = here.x if here.node is None else here.x + here.width
        ink.lines.append((left, hop.start, hop.x, hop.start))
        x, start = hop.x, hop.start
        if hop.again is not None:
            ink.lines.append((x, start, x, hop.level))
            ink.lines.append((x, hop.level, hop.again, hop.level))
            x, start = hop.again, hop.level
        ys = sorted({round(y, 1) for y in [*hop.ends, start]})
        if hop.down:
            ys.append(self.lanes[net])
        if ys[-1] - ys[0] > 0.6:
            ink.lines.append((x, ys[0], x, ys[-1]))
        if len(hop.ends) + hop.down > 1:
            straight = any(abs(e - start) < 0.6 for e in hop.ends)
            ink.dots += [(x, y) for y in ys[1:-1]] + ([(x, start)] if straight else [])
        for a, pa, b, pb in self.links:
            if pa == net and a is here:
                y = b.port_y(pb, False)
                ink.lines.append((x, y, b.x, y))
                if b.node is not None:
                    ink.tips.append((b.x, y))

    def _return(self, ink: _Ink, net: Port) -> None:
        """Draw the part of a wire that runs below the boxes, against the stream."""
        lane, source = self.lanes[net], self.places[net[0]]
        down = next(h for h in self.hops[source.column] if h.net == net and h.down)
        xs = [down.x if down.again is None else down.again]
        for end in self.back[net]:
            target = self.places[end[0]]
            hop = next(h for h in self.hops[target.column - 1] if h.net == net and h.up)
            y = target.port_y(end, False)
            ink.lines.append((hop.x, y, target.x, y))
            ink.tips.append((target.x, y))
            if hop.x not in xs:
                xs.append(hop.x)
                ink.lines.append((hop.x, min(hop.ends), hop.x, lane))
                ink.dots += [(hop.x, y) for y in sorted(hop.ends)[1:]]
        ink.dots += [(x, lane) for x in sorted(xs)[1:-1]]
        ink.lines.append((min(xs), lane, max(xs), lane))


@dataclass
class _Ink:
    """Lines, branching points and arrow heads of one wire."""

    lines: list[tuple[float, float, float, float]] = field(default_factory=list)
    dots: list[tuple[float, float]] = field(default_factory=list)
    tips: list[tuple[float, float]] = field(default_factory=list)

    def svg(self) -> list[str]:
        path = " ".join(f"M{a:.1f} {b:.1f}L{c:.1f} {d:.1f}" for a, b, c, d in self.lines)
        out = [
            f'<path d="{path}" fill="none" stroke="{WIRE}" stroke-width="1.4"'
            ' stroke-linecap="square"/>'
        ]
        dots = dict.fromkeys((f"{x:.1f}", f"{y:.1f}") for x, y in self.dots)
        out += [f'<circle cx="{x}" cy="{y}" r="2.6" fill="{WIRE}"/>' for x, y in dots]
        out += [f'<path d="M{x:.1f} {y:.1f}l-8 -3.6v7.2z" fill="{WIRE}"/>' for x, y in self.tips]
        return out


def _pairs(stack: list[_Place]) -> list[tuple[_Place, _Place | None]]:
    return list(zip(stack, [*stack[1:], None], strict=True))


def _share(place: _Place, port: Port, out: bool) -> float:
    ports = place.outs if out else place.ins
    return ports.index(port) / len(ports) if port in ports else 0.0


def _words(
    x: float, y: float, text: str, size: float, colour: str, anchor: str, bold: bool = False
) -> str:
    weight = ' font-weight="600"' if bold else ""
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size:g}" fill="{colour}"'
        f' text-anchor="{anchor}"{weight}>{escape(text)}</text>'
    )
