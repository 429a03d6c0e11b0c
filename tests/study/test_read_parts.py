"""Tables that are read as declared parts: each number, each range, and every fault at its place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from typing import Literal

import pytest

from slipctl import BadInput
from slipctl.models.vehicle.parts.declaration import Part, number, off_range, text_field
from slipctl.study.files import declared_parts
from slipctl.study.files.declared_parts import Bare, Each, read


@dataclass(frozen=True, kw_only=True)
class Leaf(Part):
    """One kind of what grows."""

    kind: Literal["leaf", "needle"] = text_field("leaf", "which")
    size: float = number("m", 0.5, "size", lo=0.0, hi=2.0)


@dataclass(frozen=True, kw_only=True)
class Stone(Part):
    """Another kind."""

    kind: Literal["stone"] = text_field("stone", "which")
    count: int = number("1", 3, "how many", lo=1, hi=9)


@dataclass(frozen=True, kw_only=True)
class Ground(Part):
    """What is on the ground."""

    width: float = number("m", MISSING, "width", lo=0.1, hi=10.0)
    load: float | None = number("N", None, "load", lo=0.0, hi=1e6, by="kg")
    share: float = number("1", 0.25, "share", lo=0.0, hi=1.0)
    begin: float = number("m", 0.0, "first place", lo=0.0, hi=1e3, key="from")
    ends: tuple[float, ...] = number("s", (1.0, 2.0), "times", lo=0.0, hi=9.0)
    over: Literal["time", "speed"] = text_field("time", "over what")
    at: float = number("by over", 1.0, "place along it", lo=0.0, hi=100.0)
    name: str = text_field("", "name")
    wet: bool = text_field(False, "whether it is wet")
    cover: Leaf | Stone | None = text_field(None, "what lies on it")  # noqa: RUF009
    many: tuple[Stone, ...] = text_field((), "stones")
    numbers: Mapping[str, float] = text_field({}, "numbers of one's own")
    long: float = number("m", 1.0, "length", lo=0.0, hi=9.0, instead_of=("width",))


def made(**table):
    """The part of a table, and its faults as a mapping from path to words."""
    part, faults = read(Ground, {"width": "2 m"} | table)
    assert (part is None) == bool(faults)
    return part, {".".join(map(str, keys)): text for keys, text in faults}


def test_a_table_of_nothing_but_what_it_needs_has_all_its_defaults():
    part, faults = made()
    assert faults == {}
    assert part == Ground(width=2.0)
    assert (part.load, part.share, part.begin, part.ends) == (None, 0.25, 0.0, (1.0, 2.0))
    assert part.numbers == {}
    _, faults = read(Ground, {})
    ((keys, text),) = faults
    assert keys == ()
    assert "width" in text


@pytest.mark.parametrize(
    ("key", "given", "name", "value"),
    [
        ("width", "30 cm", "width", 0.3), ("width", "10 m", "width", 10.0),
        ("load", "2 kN", "load", 2e3), ("load", "3 N/kg", "load", Each(3.0)),
        ("load", "3000 N/t", "load", Each(3.0)), ("share", 1, "share", 1.0),
        ("share", "25 %", "share", 0.25), ("from", "1 km", "begin", 1e3),
        ("ends", ["100 ms", "2 s", "9 s"], "ends", (0.1, 2.0, 9.0)), ("ends", [], "ends", ()),
        ("at", "5 s", "at", 5.0), ("name", "a b", "name", "a b"), ("wet", True, "wet", True),
        ("cover", {"size": "1 m"}, "cover", None), ("many", [{"count": 2}, {}], "many",
                                                    (Stone(count=2), Stone())),
        ("cover", {"kind": "needle", "size": "1 m"}, "cover", Leaf(kind="needle", size=1.0)),
        ("cover", {"kind": "stone", "count": 9}, "cover", Stone(count=9)),
        ("numbers", {"a": 2, "b": 0.5}, "numbers", {"a": Bare(2), "b": Bare(0.5)}),
    ],
)  # fmt: skip
def test_a_key_is_read_with_its_unit_and_type(key, given, name, value):
    part, faults = made(**{key: given})
    if given == {"size": "1 m"}:  # of two kinds one has to be named
        assert list(faults) == ["cover"]
        return
    assert faults == {}
    found = getattr(part, name)
    assert found == pytest.approx(value) if isinstance(value, float) else found == value
    assert type(found) is type(value)


def test_a_place_is_in_the_unit_of_what_it_is_over():
    part, faults = made(over="speed", at="36 km/h")
    assert (part.at, faults) == (pytest.approx(10.0), {})
    assert list(made(over="speed", at="5 s")[1]) == ["at"]
    assert list(made(at="36 km/h")[1]) == ["at"]


@pytest.mark.parametrize(
    ("key", "given"),
    [
        ("width", 2), ("width", "2"), ("width", "2 s"), ("width", True), ("width", None),
        ("width", ["2 m"]), ("width", "5 cm"), ("width", "11 m"), ("width", "many"),
        ("width", "nan m"), ("width", "inf m"), ("width", "1e400 m"), ("load", "-1 N"),
        ("load", "-3 N/kg"), ("load", "3 N/m"), ("share", 1.01), ("share", -0.01),
        ("share", "2 m"), ("share", float("nan")), ("share", 10**400), ("ends", "1 s"),
        ("ends", {"a": 1}), ("name", 3), ("name", True), ("wet", 1), ("wet", "true"),
        ("over", "place"), ("cover", 3), ("cover", []), ("many", {}), ("many", "x"),
        ("numbers", 3), ("numbers", [1.0]), ("more", 1), ("begin", "1 m"),
    ],
)  # fmt: skip
def test_what_a_key_cannot_be_is_told_at_its_place(key, given):
    part, faults = made(**{key: given})
    assert part is None
    assert list(faults) == [key]


@pytest.mark.parametrize(
    ("table", "places"),
    [
        ({"ends": ["1 s", 2, "10 s"]}, {"ends.1", "ends.2"}),
        ({"many": [{}, {"count": 10}, {"count": 2.5}, 4]},
         {"many.1.count", "many.2.count", "many.3"}),
        ({"cover": {"kind": "rock"}}, {"cover.kind"}), ({"cover": {"kind": 3}}, {"cover.kind"}),
        ({"cover": {"kind": "stone", "size": "1 m"}}, {"cover.size"}),
        ({"cover": {"kind": "leaf", "size": "3 m"}, "share": 7}, {"cover.size", "share"}),
        ({"numbers": {"a": "x", "b": [1]}}, {"numbers.a", "numbers.b"}),
        ({"long": "1 m"}, {"width"}),
    ],
)  # fmt: skip
def test_every_fault_of_a_table_has_its_own_place(table, places):
    assert set(made(**table)[1]) == places


def test_what_is_no_table_is_no_part():
    for given in (3, "x", [], None):
        part, faults = read(Ground, given)
        assert part is None
        assert [keys for keys, _ in faults] == [()]


def test_kinds_are_found_by_what_they_are_called():
    assert declared_parts.kinds([Leaf, Stone]) == {"leaf": Leaf, "needle": Leaf, "stone": Stone}
    assert declared_parts.kinds([Ground]) == {}
    assert declared_parts.options(Leaf | Stone | None) == [Leaf, Stone]
    assert declared_parts.options(float) == [float]
    keys = {f.name: declared_parts.key_of(f) for f in fields(Ground)}
    assert keys["begin"] == "from"
    assert {n for n, k in keys.items() if n != k} == {"begin"}


# ---- declarations --------------------------------------------------------------------------------


def test_a_number_is_declared_with_all_that_it_says():
    @dataclass
    class One:
        """A number."""

        plain: float = number("m", 1.0, "words")
        full: float = number("N", 2.0, "more", lo=1, hi=3, by="kg", key="from",
                             instead_of=("a",), needs=("b", "c"))  # fmt: skip

    plain, full = fields(One)
    assert dict(plain.metadata) == {"unit": "m", "doc": "words", "lo": -float("inf"),
                                    "hi": float("inf")}  # fmt: skip
    more = {"by": "kg", "key": "from", "instead_of": ("a",), "needs": ("b", "c")}
    assert dict(full.metadata) == {"unit": "N", "doc": "more", "lo": 1, "hi": 3} | more
    assert (One().plain, One().full) == (1.0, 2.0)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: number("m", 1.0, lo=2, hi=1), lambda: number("m", 1.0, lo=1, hi=1),
        lambda: number("m", 1.0, lo=True), lambda: number("m", 1.0, lo="0"),
        lambda: number("m", 1.0, hi=None), lambda: number(1.0, "m"), lambda: number("m", "1"),
        lambda: number("m", 1.0, 3), lambda: number("m", 5.0, lo=0, hi=4),
        lambda: number("m", (1.0, 5.0), lo=0, hi=4), lambda: number("m", [-1.0], lo=0, hi=4),
        lambda: number("m", True), lambda: number("m", float("nan")),
        lambda: number("m", float("inf")),
    ],
)  # fmt: skip
def test_a_number_that_contradicts_itself_is_refused(wrong):
    with pytest.raises(BadInput):
        wrong()


def test_a_number_may_have_no_value_or_be_at_the_ends_of_its_range():
    for value in (MISSING, None, 0.0, 4.0, (0.0, 4.0), [0.0, None], ()):
        assert number("m", value, lo=0, hi=4).metadata["hi"] == 4


def test_what_is_no_number_is_declared_with_its_meaning():
    @dataclass
    class Two:
        """Words."""

        a: str = text_field("x", "which", ("b",), ("c",))
        d: dict = text_field({"k": 1}, "table")  # noqa: RUF009
        e: list = text_field([1], "list")  # noqa: RUF009

    a, d, e = fields(Two)
    assert dict(a.metadata) == {"doc": "which", "instead_of": ("b",), "needs": ("c",)}
    assert dict(d.metadata) == {"doc": "table"}
    one, two = Two(), Two()
    assert (one.a, one.d, one.e) == ("x", {"k": 1}, [1])
    one.d["k"], one.e[0] = 2, 3
    assert (two.d, two.e) == ({"k": 1}, [1])  # each has its own
    assert e.default is MISSING


def test_numbers_off_their_range_are_told_with_their_unit():
    meta = {"unit": "m", "lo": 0.0, "hi": 2.0}
    for value in (0, 2, 1.5):
        assert off_range(value, meta) == ""
    for value in (-0.1, 2.1, float("inf"), float("nan"), -float("inf")):
        assert " m" in off_range(value, meta)
        assert " m" not in off_range(value, meta | {"unit": "1"})
    for value in (True, "1", None, [1.0]):
        assert "no number in m" in off_range(value, meta)
