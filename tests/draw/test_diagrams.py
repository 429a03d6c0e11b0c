"""Drawings of block diagrams: what a reader of wires and boxes takes for granted."""

import itertools
import random
import re

import pytest
from test_show import loop

from slipctl.draw.diagrams.diagram_svg import MARGIN, SLOT, Drawing, _text_width
from slipctl.draw.diagrams.levels import Level, Node, level


def random_level(seed):
    choose = random.Random(seed)
    names = [f"b{i}" for i in range(choose.randint(1, 8))]
    nodes, nets, units = {k: Node(k, k) for k in names}, {}, {}

    def targets(most):
        ends = []
        for _ in range(choose.randint(1, most)):
            t = choose.choice(names)
            nodes[t].ins.append(f"u{len(nodes[t].ins)}")
            ends.append((t, nodes[t].ins[-1]))
        return ends

    for k in names:
        for j in range(choose.randint(0, 3)):
            nodes[k].outs.append(f"y{j}")
            nets[k, f"y{j}"], units[k, f"y{j}"] = targets(3), "m/s"
            if choose.random() < 0.2:
                end = f"{k}y{j}"
                nodes[f"< {end}"] = Node(f"< {end}", end, ins=[end], box=False)
                nets[k, f"y{j}"].append((f"< {end}", end))
    for j in range(choose.randint(0, 4)):
        key = f"> w{j}"
        nodes[key] = Node(key, f"w{j}", outs=[f"w{j}"], box=False)
        nets[key, f"w{j}"], units[key, f"w{j}"] = targets(2), "N m"
    return Level("x", nodes, nets, units)


def strokes(drawing, net):
    path = re.search(r'd="([^"]*)" fill="none"', " ".join(drawing._wire(net)))[1]
    numbers = re.findall(r"M([-\d.]+) ([-\d.]+)L([-\d.]+) ([-\d.]+)", path)
    return [tuple(map(float, n)) for n in numbers]


def overlap(a, b, level, along):
    """Length on which two lines along one axis lie upon each other."""
    if max(abs(s[level] - s[level + 2]) for s in (a, b)) > 0.2 or abs(a[level] - b[level]) > 1.5:
        return 0.0
    low = max(min(s[along], s[along + 2]) for s in (a, b))
    high = min(max(s[along], s[along + 2]) for s in (a, b))
    return high - low


LEVELS = [random_level(seed) for seed in range(120)]


@pytest.mark.parametrize("part", range(4))
def test_drawings_have_no_wire_upon_another_and_none_through_a_box(part):
    for lv in [*LEVELS[part::4], level(loop())]:
        d = Drawing(lv)
        wires = {net: strokes(d, net) for net in lv.nets}
        for (_, one_), (_, two) in itertools.combinations(wires.items(), 2):
            for a, b in itertools.product(one_, two):
                assert overlap(a, b, 1, 0) <= 1.0
                assert overlap(a, b, 0, 1) <= 1.0
        boxes = [(p.x, p.y, p.x + p.width, p.y + p.height) for p in d.places.values()]
        for a, b in itertools.combinations(boxes, 2):
            apart = (
                a[2] <= b[0] + 0.1 or b[2] <= a[0] + 0.1 or a[3] <= b[1] + 0.1 or b[3] <= a[1] + 0.1
            )
            assert apart
        for x0, y0, x1, y1 in itertools.chain(*wires.values()):
            for left, top, right, bottom in boxes:
                beside = max(x0, x1) <= left + 1 or min(x0, x1) >= right - 1
                assert beside or max(y0, y1) <= top + 1 or min(y0, y1) >= bottom - 1
            assert min(x0, x1) >= 0
            assert max(x0, x1) <= d.width
            assert max(y0, y1) <= d.height


@pytest.mark.parametrize("part", range(4))
def test_every_wire_end_has_its_arrow(part):
    for lv in LEVELS[part::4]:
        d = Drawing(lv)
        for net, ends in lv.nets.items():
            tips = {
                (float(a), float(b))
                for a, b in re.findall(r'd="M([-\d.]+) ([-\d.]+)l-8', " ".join(d._wire(net)))
            }
            wanted = set()
            for end in ends:
                place = d.places[end[0]]
                wanted.add((round(place.x, 1), round(place.port_y(end, False), 1)))
            assert tips == wanted


NEAR = 1.0
"""A wire that steps aside by less than this looks level."""


def holds(line, point):
    """Whether a point lies on an upright or level line."""
    x0, y0, x1, y1 = line
    return (
        min(x0, x1) - NEAR <= point[0] <= max(x0, x1) + NEAR
        and min(y0, y1) - NEAR <= point[1] <= max(y0, y1) + NEAR
    )


def reached(lines, begin):
    """Lines that hang together with a point."""
    found, new, left = [], [begin], list(lines)
    while new:
        point = new.pop()
        touched = [k for k in left if holds(k, point)]
        for k in touched:
            new += [k[:2], k[2:]]
            new += [q for j in left for q in (j[:2], j[2:]) if holds(k, q)]
            left.remove(k)
        found += touched
    return found


def arms(lines, point):
    """In how many directions lines go on from a point."""
    x, y = point
    here = [k for k in lines if holds(k, point)]
    ends = [q for k in here for q in (k[:2], k[2:])]
    level_ = [a - x for a, b in ends if abs(b - y) <= NEAR]
    upright = [b - y for a, b in ends if abs(a - x) <= NEAR]
    return sum(max(s * d for d in far) > NEAR for far in (level_, upright) for s in (1, -1))


@pytest.mark.parametrize("part", range(4))
def test_a_wire_is_one_piece_from_its_source_to_all_that_it_feeds(part):
    for lv in LEVELS[part::4]:
        d = Drawing(lv)
        for net, ends in lv.nets.items():
            lines, source = strokes(d, net), d.places[net[0]]
            assert all(abs(k[0] - k[2]) < NEAR or abs(k[1] - k[3]) < NEAR for k in lines)
            begin = source.x + source.width, source.port_y(net, True)
            assert sorted(reached(lines, begin)) == sorted(lines)
            for end in ends:
                place = d.places[end[0]]
                assert any(holds(k, (place.x, place.port_y(end, False))) for k in lines)


@pytest.mark.parametrize("part", range(4))
def test_a_dot_stands_where_a_wire_parts_and_nowhere_else(part):
    for lv in LEVELS[part::4]:
        d = Drawing(lv)
        for net in lv.nets:
            lines, text = strokes(d, net), " ".join(d._wire(net))
            dots = [
                tuple(map(float, k)) for k in re.findall(r'cx="([-\d.]+)" cy="([-\d.]+)"', text)
            ]
            points = {q for k in lines for q in (k[:2], k[2:])}
            parted = {q for q in points if arms(lines, q) > 2}
            for q in parted:
                assert any(abs(q[0] - x) + abs(q[1] - y) < 2 for x, y in dots), (net, q)
            for x, y in dots:
                assert any(abs(q[0] - x) + abs(q[1] - y) < 2 for q in parted), (net, x, y)


def series(many):
    """Boxes in a row, each fed by the one before."""
    nodes = {f"b{k}": Node(f"b{k}", f"b{k}", outs=["y"], ins=["u"]) for k in range(many)}
    nodes["b0"].ins, nodes[f"b{many - 1}"].outs = [], []
    nets = {(f"b{k}", "y"): [(f"b{k + 1}", "u")] for k in range(many - 1)}
    return Level("row", nodes, nets, dict.fromkeys(nets, "m/s"))


@pytest.mark.parametrize("many", [2, 3, 7])
def test_boxes_in_a_row_are_joined_by_one_straight_line(many):
    d = Drawing(series(many))
    assert max(map(abs, rises([d]))) < 1e-9
    assert len({p.y for p in d.places.values()}) == 1
    assert sorted(d.places, key=lambda k: d.places[k].x) == [f"b{k}" for k in range(many)]


class Stacked(Drawing):
    """Every column as it is stacked, from the top."""

    def _settle(self, stack, both):
        pass

    def _straighten(self, stack):
        pass


def rises(drawings):
    """Of each piece of a wire with the stream, how far it rises or falls."""
    return [k[0].port_y(k[1], True) - k[2].port_y(k[3], False) for d in drawings for k in d.links]


@pytest.mark.second
def test_nodes_are_moved_to_where_their_wires_run_straight():
    """Beside columns that are only stacked: four times as many are straight, and none is longer."""
    moved, stacked = (rises(map(kind, LEVELS[::3])) for kind in (Drawing, Stacked))
    straight = [sum(abs(d) < NEAR for d in of) for of in (moved, stacked)]
    assert len(moved) == len(stacked)
    assert straight[0] > 4 * straight[1]
    assert sum(map(abs, moved)) < 0.85 * sum(map(abs, stacked))


@pytest.mark.parametrize("part", range(4))
def test_a_sheet_has_no_more_room_than_it_needs(part):
    """The first column is at the left edge, the first node below the title, lanes at the foot."""
    for lv in LEVELS[part::4]:
        d = Drawing(lv)
        lines = [k for net in lv.nets for k in strokes(d, net)]
        boxes = list(d.places.values())
        everything = [p.y for s in d.stacks for p in s]
        assert min(everything) == pytest.approx(MARGIN + 26, abs=0.1)
        lowest = max([p.y + p.height for p in boxes] + [k[3] for k in lines])
        assert d.height == pytest.approx(lowest + MARGIN, abs=SLOT)
        left = min([p.x for p in boxes] + [k[0] for k in lines])
        assert left == pytest.approx(MARGIN, abs=60)


def test_words_at_wires_end_before_the_next_box():
    for lv in LEVELS[::6]:
        d = Drawing(lv)
        found = re.findall(
            r'<text x="([-\d.]+)" y="([-\d.]+)" font-size="10.5"[^>]*>([^<]*)<', d.body()
        )
        assert len(found) == sum(lv.nodes[net[0]].box for net in lv.nets)
        for x, y, words in found:
            end = float(x) + _text_width(words, 10.5)
            for p in d.places.values():
                beside = end <= p.x + 1 or float(x) >= p.x + p.width
                assert beside or not p.y < float(y) - 5 < p.y + p.height, (words, p.node.key)
