"""Steps that place the boxes of a diagram, one by one, on columns that are made up."""

from __future__ import annotations

from typing import Any

import pytest

from slipctl.draw.diagrams.diagram_svg import END, GAP, SLOT, Drawing, _pairs, _Place
from slipctl.draw.diagrams.levels import Level, Node


def place(name: str, y: float, height: float = 60.0, box: bool = True, wire: bool = False) -> Any:
    node = None if wire else Node(name, name, box=box)
    return _Place(node, [], [], 0, y=y, height=height)


class Bent(Drawing):
    """A drawing of which only the bends are told."""

    def __init__(self, behind: dict[int, list[float]], ahead: dict[int, list[float]]) -> None:
        self.out_of, self.into = behind, ahead  # type: ignore[assignment]

    @staticmethod
    def _bends(links: Any) -> list[float]:
        return list(links)


def settled(stack: list[Any], behind: list[Any], ahead: list[Any], both: bool) -> list[float]:
    made = Bent({id(p): b for p, b in zip(stack, behind, strict=True)},
                {id(p): a for p, a in zip(stack, ahead, strict=True)})  # fmt: skip
    made._settle(stack, both)
    return [p.y for p in stack]


def test_room_between_two_of_a_column_is_more_where_they_are_boxes() -> None:
    box, end, wire = place("a", 0), place("b", 0, box=False), place("c", 0, wire=True)
    gap = Drawing._gap
    assert [gap(box, box), gap(box, end), gap(wire, box), gap(end, wire)] == [
        GAP, 14.0, 14.0, SLOT - END]  # fmt: skip
    assert _pairs([1, 2, 3]) == [(1, 2), (2, 3), (3, None)]  # type: ignore[list-item, comparison-overlap]


def test_boxes_move_by_the_mean_of_what_their_wires_fall_or_by_the_least() -> None:
    """A box goes down by what a wire before it falls, and up by what one behind it does."""
    for both, moved in ((False, (30.0 - 6.0) / 2), (True, -6.0)):
        stack = [place("a", 100.0), place("b", 400.0), place("c", 700.0)]
        found = settled(stack, [[], [6.0], []], [[], [30.0], [5.0]], both)
        assert found == pytest.approx([100.0, 400.0 + moved, 705.0])


def test_boxes_that_would_overlap_stand_together_about_their_middle_wish() -> None:
    """a wants to 100, b to 110 and c far below; b may only stand 60 + 28 below a."""
    stack = [place("a", 100.0), place("b", 110.0), place("c", 500.0, 40.0), place("d", 530.0)]
    found = settled(stack, [[]] * 4, [[]] * 4, True)
    first = (100.0 + 110.0 - 88.0) / 2
    last = (500.0 + 530.0 - 68.0) / 2
    assert found == pytest.approx([first, first + 88, last, last + 68])
    stack = [place("a", 100.0), place("b", 110.0, 16.0, box=False), place("c", 120.0)]
    first = (100.0 + (110.0 - 74) + (120.0 - 104)) / 3  # an end stands nearer to what is next
    assert settled(stack, [[]] * 3, [[]] * 3, True) == pytest.approx(
        [first, first + 74, first + 104]
    )
    stack = [place("a", 0.0), place("b", 10.0), place("c", 20.0)]
    found = settled(stack, [[]] * 3, [[]] * 3, True)
    first = (0.0 + (10.0 - 88) + (20.0 - 176)) / 3
    assert found == pytest.approx([first, first + 88, first + 176])


@pytest.mark.parametrize(("ahead", "behind", "above", "below", "moved"), [
    ([7.0], [], 0.0, 500.0, 7.0), ([7.0, 7.2, -3.0], [], 0.0, 500.0, 7.0),
    ([], [9.0], 0.0, 500.0, -9.0), ([50.0], [], 0.0, 500.0, 0.0), ([7.0, 0.0], [], 0.0, 500.0, 0.0),
    ([-30.0], [], 190.0, 500.0, 0.0), ([30.0], [], 0.0, 380.0, 0.0),
    ([28.0], [], 0.0, 416.0, 28.0), ([7.0, -4.0, -4.1], [], 0.0, 500.0, -4.0),
])  # fmt: skip
def test_a_box_is_shifted_where_one_more_wire_runs_straight_and_there_is_room(
    ahead, behind, above, below, moved
) -> None:
    stack = [place("a", above), place("b", 300.0), place("c", below)]
    made = Bent({id(stack[1]): behind, id(stack[0]): [], id(stack[2]): []},
                {id(stack[1]): ahead, id(stack[0]): [], id(stack[2]): []})  # fmt: skip
    made._straighten(stack)
    assert [p.y for p in stack] == [above, pytest.approx(300.0 + moved), below]


# ---- wires that pass columns ---------------------------------------------------------------------


def passing() -> Drawing:
    """a -> b -> c -> d, and a to d past two columns; b and e side by side, crossed at first."""
    nodes = {n: Node(n, n, ins=["u"], outs=["y"]) for n in "abcde"}
    nodes["d"].ins, nodes["a"].outs = ["u", "v", "w"], ["y", "z", "x"]
    nets = {
        ("a", "y"): [("e", "u")], ("a", "z"): [("b", "u")], ("a", "x"): [("d", "w")],
        ("b", "y"): [("c", "u")], ("c", "y"): [("d", "u")], ("e", "y"): [("d", "v")],
    }  # fmt: skip
    nodes["a"].ins, nodes["d"].outs = [], []
    return Drawing(Level("x", nodes, nets, dict.fromkeys(nets, "")))


def test_a_wire_that_passes_columns_has_a_place_in_each_and_a_piece_across_each() -> None:
    d = passing()
    a, b, c, end = (d.places[n] for n in "abcd")
    assert d.columns == {"a": 0, "b": 1, "c": 2, "d": 3, "e": 1}
    assert set(d.passing) == {(("a", "x"), 1), (("a", "x"), 2), (("e", "y"), 2)}
    one, two = d.passing[("a", "x"), 1], d.passing[("a", "x"), 2]
    assert one in d.stacks[1]
    assert two in d.stacks[2]
    net = ("a", "x")
    pieces = [k for k in d.links if k[0] is one or k[2] in (one, two)
              or (k[0] is two and k[2] is end)]  # fmt: skip
    assert pieces == [(a, net, one, net), (one, net, two, net), (two, net, end, ("d", "w"))]
    assert (a, ("a", "z"), b, ("b", "u")) in d.links
    assert (c, ("c", "y"), end, ("d", "u")) in d.links
    assert len(d.links) == 6 + 2 + 1


def test_wires_of_boxes_side_by_side_do_not_cross() -> None:
    """Boxes of a column stand in the order of what they are wired to, outputs in that of boxes."""
    d = passing()
    for left, out, right, into in d.links:
        for left2, out2, right2, into2 in d.links:
            if left.column != left2.column or (left is left2 and right is right2):
                continue
            above = left.port_y(out, True) - left2.port_y(out2, True)
            behind = right.port_y(into, False) - right2.port_y(into2, False)
            assert above * behind >= 0
    outs = d.places["a"].outs
    assert outs == [("a", "z"), ("a", "y"), ("a", "x")]
    assert [p.node.key for p in d.stacks[1] if p.node] == ["b", "e"]


def test_a_wire_that_goes_back_first_goes_on_too() -> None:
    """Whichever of its ends is told first; the sheet has all that each wire is drawn of."""
    nodes = {
        "a": Node("a", "a", ins=["u"], outs=["y"]), "b": Node("b", "b", ins=["p"], outs=["z"]),
        "c": Node("c", "c", ins=["q"]),
    }  # fmt: skip
    for order in (0, 1):
        ends = [("a", "u"), ("c", "q")]
        nets = {("a", "y"): [("b", "p")], ("b", "z"): ends[::-1] if order else ends}
        d = Drawing(Level("x", nodes, nets, dict.fromkeys(nets, "m")))
        a, b, c = (d.places[n] for n in "abc")
        assert d.links == [(a, ("a", "y"), b, ("b", "p")), (b, ("b", "z"), c, ("c", "q"))]
        assert d.back == {("b", "z"): [("a", "u")]}
        assert a.x == 18 + 30  # the wire comes up at its left, in the middle of its track
        up = f"M23.5 {a.port_y(('a', 'u'), False):.1f}L48.0"
        assert up in " ".join(d._wire(("b", "z")))
        body = d.body()
        assert all(line in body for net in nets for line in d._wire(net))
