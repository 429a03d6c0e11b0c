"""Where a small diagram has its boxes, wires and words: worked by hand from sizes of its parts."""

from __future__ import annotations

import re
from types import SimpleNamespace
from typing import Any

import pytest

from slipctl import Input, Noise, Output, Param, State, connect, step
from slipctl.draw.diagrams.diagram_svg import Drawing, _Hop, _text_width
from slipctl.draw.diagrams.levels import Level, Node, level

NARROW, PLAIN, WIDE = 0.32, 0.58, 0.86
"""Shares of its size that a letter is wide."""


def loop_of_two() -> Level:
    """w -> a -> b -> o, and b back to a; of b a second output leads nowhere."""
    nodes = {
        "> w": Node("> w", "w", outs=["w"], box=False),
        "a": Node("a", "a", "5 ms", ins=["u", "v"], outs=["y"]),
        "b": Node("b", "bb", ins=["p"], outs=["z", "s"], deep=True),
        "< o": Node("< o", "o", ins=["o"], box=False),
    }
    nets = {("> w", "w"): [("a", "u")], ("a", "y"): [("b", "p")],
            ("b", "z"): [("< o", "o"), ("a", "v")]}  # fmt: skip
    return Level("A < B", nodes, nets, dict.fromkeys(nets, "m"))


def texts(svg: str) -> dict[str, tuple[float, float, float, str]]:
    """Words of a drawing: place, size and the end at which they stand."""
    found = re.findall(r'<text x="([-\d.]+)" y="([-\d.]+)" font-size="([\d.]+)" fill="[^"]*"'
                       r' text-anchor="(\w+)"[^>]*>([^<]*)<', svg)  # fmt: skip
    return {words: (float(x), float(y), float(size), at) for x, y, size, at, words in found}


def lines(drawing: Drawing, net: tuple[str, str]) -> list[tuple[float, ...]]:
    path = re.search(r'd="([^"]*)" fill="none"', " ".join(drawing._wire(net)))
    assert path is not None
    return [tuple(map(float, k)) for k in
            re.findall(r"M([-\d.]+) ([-\d.]+)L([-\d.]+) ([-\d.]+)", path[1])]  # fmt: skip


def test_boxes_are_as_large_as_their_words_and_stand_behind_their_wires() -> None:
    """Each channel has the words of its wires and a track for each upright line."""
    d = Drawing(loop_of_two())
    w, a, b, o = (d.places[k] for k in ("> w", "a", "b", "< o"))
    assert (a.width, a.height) == (b.width, b.height) == (84.0, 32 + 6 + 2 * 22)
    wide = 1.1 * 11 * (2 * WIDE + 3 * NARROW) + 8  # w [m]
    assert (w.width, w.height) == (pytest.approx(wide), 16)
    assert o.width == pytest.approx(1.1 * 11 * PLAIN + 8)
    label = 10.5 * (PLAIN + 3 * NARROW + WIDE) + 18  # y [m], z [m]
    assert w.x == 18
    assert a.x == pytest.approx(18 + wide + 8 + 11 + 12)  # one line comes up from below
    assert b.x == pytest.approx(a.x + 84 + label + 11 + 12)
    assert o.x == pytest.approx(b.x + 84 + label + 11 + 12)
    assert d.width == pytest.approx(o.x + o.width + 30 + 18)
    assert d.lanes == {("b", "z"): pytest.approx(max(a.y, b.y) + 82 + 18)}
    assert d.height == pytest.approx(max(a.y, b.y) + 82 + 18 + 18)
    assert a.port_y(("a", "u"), False) == a.y + 32 + 11
    assert a.port_y(("a", "v"), False) == a.y + 32 + 33
    assert a.port_y(("a", "y"), True) == a.y + 32 + 22  # in the middle of two
    assert b.port_y(("b", "p"), False) == b.y + 32 + 22
    assert (b.port_y(("b", "z"), True), b.port_y(("b", "s"), True)) == (b.y + 43, b.y + 65)
    assert w.port_y(("> w", "w"), True) == w.y + 8
    assert d.boxes() == {"a": (a.x, a.y, 84.0, 82), "b": (b.x, b.y, 84.0, 82)}


def test_wires_go_from_port_to_port_and_back_below_the_boxes() -> None:
    d = Drawing(loop_of_two())
    w, a, b, o = (d.places[k] for k in ("> w", "a", "b", "< o"))
    label = 10.5 * (PLAIN + 3 * NARROW + WIDE) + 18

    def near(*rows: tuple[float, ...]) -> list[Any]:
        return [pytest.approx(r, abs=0.051) for r in rows]

    at, up = w.y + 8, w.x + w.width + 8
    assert lines(d, ("> w", "w")) == near((w.x + w.width, at, up, at), (up, at, a.x, at))
    y, p, x = a.y + 54, b.y + 54, a.x + 84 + label + 5.5
    assert abs(y - p) > 0.6
    assert lines(d, ("a", "y")) == near(
        (a.x + 84, y, x, y), (x, min(y, p), x, max(y, p)), (x, p, b.x, p)
    )
    z, v, down, lane = b.y + 43, a.y + 65, b.x + 84 + label + 5.5, d.lanes["b", "z"]
    up += 5.5
    assert lines(d, ("b", "z")) == near(
        (b.x + 84, z, down, z), (down, z, down, lane), (down, z, o.x, z), (up, v, a.x, v),
        (up, v, up, lane), (up, lane, down, lane),
    )  # fmt: skip
    svg = " ".join(d._wire(("b", "z")))
    dots = re.findall(r'cx="([-\d.]+)" cy="([-\d.]+)" r="2.6"', svg)
    assert [tuple(map(float, k)) for k in dots] == near((down, z))
    tips = re.findall(r'd="M([-\d.]+) ([-\d.]+)l-8 -3.6v7.2z"', svg)
    assert [tuple(map(float, k)) for k in tips] == near((o.x, z), (a.x, v))


def test_words_stand_in_boxes_at_ports_and_on_wires() -> None:
    d = Drawing(loop_of_two())
    w, a, b, o = (d.places[k] for k in ("> w", "a", "b", "< o"))
    svg = d.body(3, -4)
    assert svg.startswith('<g transform="translate(3,-4)">')
    found = texts(svg)

    def near(x: float, y: float, *rest: Any) -> tuple[Any, ...]:
        return pytest.approx(x, abs=0.051), pytest.approx(y, abs=0.051), *rest

    assert found == {
        "A &lt; B": (18, 20, 14, "start"),
        "w [m]": near(w.x + w.width - 4, w.y + 12, 11, "end"),
        "a": near(a.x + 42, a.y + 17, 13.5, "middle"),
        "5 ms": near(a.x + 42, a.y + 29, 10, "middle"),
        "u": near(a.x + 7, a.y + 46.5, 10, "start"), "v": near(a.x + 7, a.y + 68.5, 10, "start"),
        "bb": near(b.x + 42, b.y + 17, 13.5, "middle"),
        "p": near(b.x + 7, b.y + 57.5, 10, "start"), "o": near(o.x + 2, o.y + 12, 11, "start"),
        "y [m]": near(a.x + 90, a.y + 49, 10.5, "start"),
        "z [m]": near(b.x + 94, b.y + 38, 10.5, "start"),  # beside the sheet below a deep box
    }  # fmt: skip
    boxes = re.findall(r'<rect x="([-\d.]+)" y="([-\d.]+)" width="84" height="82"', svg)
    assert [tuple(map(float, k)) for k in boxes] == [
        near(a.x, a.y), near(b.x + 4, b.y - 4), near(b.x, b.y)]  # fmt: skip


def test_letters_are_wide_or_narrow() -> None:
    assert _text_width("m", 10) == pytest.approx(8.6)
    assert _text_width("Wil.x", 2) == pytest.approx(2 * (WIDE + 3 * NARROW + PLAIN))
    assert _text_width("", 10) == 0


def named(order: list[tuple[_Hop, bool]]) -> list[tuple[str, bool]]:
    return [(h.net[0], second) for h, second in order]


def hop(name: str, start: float, *ends: float, up: bool = False) -> _Hop:
    return _Hop((name, "y"), start, list(ends), up=up)


def test_a_line_stands_right_of_those_whose_starts_it_ends_at() -> None:
    """What falls comes first, from the lowest on; then what rises; what comes up is the last."""
    order = Drawing._track_order
    assert named(order([hop("A", 10, 50), hop("B", 50, 90), hop("C", 90, 20)])) == [
        ("C", False), ("B", False), ("A", False)]  # fmt: skip
    assert named(order([hop("U", 0, 70, up=True), hop("R", 60, 20), hop("F", 5, 33),
                        hop("G", 12, 42), hop("S", 80, 26, 50)])) == [
        ("G", False), ("F", False), ("R", False), ("S", False), ("U", False)]  # fmt: skip
    assert named(order([hop("A", 10, 53.9), hop("B", 50, 90)])) == [("B", False), ("A", False)]
    assert named(order([hop("A", 10, 54.1), hop("B", 5, 50)])) == [("A", False), ("B", False)]
    ring = [hop("A", 10, 50), hop("B", 50, 10)]
    assert named(order(ring)) == [("A", False), ("B", False), ("A", True)]
    assert ring[0].level == 10 + 11 - 3
    later = [hop("X", 200, 260), hop("Y", 205, 270), *(hop(n, a, b) for n, a, b in
             (("A", 10, 50), ("B", 50, 10)))]  # fmt: skip
    assert named(order(later)) == [("Y", False), ("X", False), ("A", False), ("B", False),
                                   ("A", True)]  # fmt: skip
    assert later[2].level == 10 + 11 + 3


def test_tracks_of_a_channel_stand_behind_its_words() -> None:
    d: Any = SimpleNamespace(_track_order=Drawing._track_order)
    straight, bent = hop("S", 30, 30.5), hop("A", 10, 50)
    hops = [straight, bent, hop("B", 50, 10), hop("U", 0, 0, up=True)]
    assert Drawing._tracks(d, hops, 100.0, 20.0) == 20 + 4 * 11 + 12
    assert (straight.x, bent.x, bent.again) == (120.0, 136.5, 158.5)
    assert (hops[2].x, hops[3].x) == (147.5, 125.5)
    assert Drawing._tracks(d, [], 100.0, 50.0) == 30.0
    assert Drawing._tracks(d, [hop("S", 1, 1)], 100.0, 5.0) == 30.0
    assert Drawing._tracks(d, [hop("S", 1, 1.59)], 100.0, 50.0) == 62.0
    assert Drawing._tracks(d, [hop("S", 1, 1.62)], 100.0, 50.0) == 73.0


# ---- levels --------------------------------------------------------------------------------------


@step(period=0.1, y=Output("m"), z=Output("s"))
def first(x=State("kg", 0.0), u=Input("m"), e=Noise("1"), free=Input("s"),
          still=Input("s", value=2.0), k=Param("1", 2.0)):  # fmt: skip
    return dict(x=x), dict(y=k * x, z=free)


@step(period=0.1, w=Output("m"))
def last(p=Input("kg"), q=Input("m")):
    return dict(), dict(w=q)


def test_a_level_has_what_its_wires_say_and_what_is_left_open() -> None:
    """Ports stand as they are declared; a declared value and noise are no ends."""
    block = connect("both", {"b.q": "a.y", "b.p": "a.x", "a.u": "d", "o": "b.w", "t": "a.x"},
                    a=first, b=last)  # fmt: skip
    lv = level(block)
    assert lv.title == "both"
    assert {k: (n.title, n.note, n.ins, n.outs, n.box, n.deep) for k, n in lv.nodes.items()} == {
        "a": ("a", "first", ["u", "free"], ["y", "x"], True, False),
        "b": ("b", "last", ["p", "q"], ["w"], True, False),
        "> d": ("d", "", [], ["d"], False, False), "< o": ("o", "", ["o"], [], False, False),
        "< t": ("t", "", ["t"], [], False, False),
        "> a.free": ("a.free", "", [], ["a.free"], False, False),
    }  # fmt: skip
    assert lv.nets == {
        ("a", "y"): [("b", "q")], ("a", "x"): [("b", "p"), ("< t", "t")],
        ("> d", "d"): [("a", "u")], ("b", "w"): [("< o", "o")],
        ("> a.free", "a.free"): [("a", "free")],
    }  # fmt: skip
    assert lv.units == {("a", "y"): "m", ("a", "x"): "kg", ("> d", "d"): "m", ("b", "w"): "m",
                        ("> a.free", "a.free"): "s"}  # fmt: skip
    assert lv.label(("a", "x")) == "x [kg]"


def test_a_block_alone_has_all_of_its_ends() -> None:
    lv = level(first)
    assert {k: (n.ins, n.outs) for k, n in lv.nodes.items()} == {
        "first": (["u", "e", "free", "still"], ["y", "z"]), "> u": ([], ["u"]), "> e": ([], ["e"]),
        "> free": ([], ["free"]), "> still": ([], ["still"]), "< y": (["y"], []),
        "< z": (["z"], []),
    }  # fmt: skip
    assert lv.nets[("first", "z")] == [("< z", "z")]
    assert lv.nets[("> free", "free")] == [("first", "free")]
    assert lv.units[("first", "z")] == "s"
    assert lv.units[("> u", "u")] == "m"
