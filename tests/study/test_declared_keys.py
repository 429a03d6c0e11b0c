"""Each key of a vehicle's file: what it takes, and that all else is refused at that key."""

from __future__ import annotations

import math
from dataclasses import fields, is_dataclass
from typing import Any, Literal, get_args, get_origin

import pytest

from slipctl.errors import BadInput
from slipctl.models.vehicle.of_study import StudyTrip
from slipctl.models.vehicle.parts import Trip
from slipctl.models.vehicle.parts.declaration import Part
from slipctl.study import resolve
from slipctl.study.files import declared_parts, equation_files
from slipctl.study.files.declared_parts import hints, key_of, options


def parts_inside(kind: Any, found: dict[str, type]) -> dict[str, type]:
    """All parts that a file may have, by name, the outermost first."""
    if is_dataclass(kind):
        if kind.__name__ not in found:
            found[kind.__name__] = kind
            for f in fields(kind):
                parts_inside(hints(kind)[f.name], found)
    else:
        for inner in get_args(kind):
            parts_inside(inner, found)
    return found


PARTS = parts_inside(StudyTrip, parts_inside(Trip, {}))
NUMBERS = [(name, f) for name, kind in PARTS.items() for f in fields(kind)
           if "unit" in f.metadata and not f.metadata["unit"].startswith("by ")]  # fmt: skip


def faults_at(kind: type[Part], key: str, value: Any) -> list[str]:
    """What is told of a key with this value, when it stands alone."""
    _, faults = declared_parts.read(kind, {key: value})
    return [why for keys, why in faults if keys[:1] == (key,)]


def test_all_parts_are_tried():
    assert {"Vehicle", "SlipControl", "Predictive", "Contamination", "StudyLoop"} <= set(PARTS)
    assert len(NUMBERS) > 150


def test_each_key_is_told_in_whatever_order_they_stand():
    """All but those of the rest, and the kind where it says nothing."""
    for kind in PARTS.values():
        wanted = [f for f in fields(kind) if not f.metadata.get("rest")]
        told = [key.name for key in declared_parts.keys_of(kind)]
        assert [n for n in told if n != "kind"] == [key_of(f) for f in wanted if f.name != "kind"]


def test_the_schema_says_of_what_a_list_or_a_table_is():
    """Of parts by their names, of numbers and texts by what they are."""
    told = declared_parts.schema([Trip, StudyTrip], "trip")["$defs"]
    seen = 0
    for name, kind in PARTS.items():
        for f in fields(kind):
            for c in options(hints(kind)[f.name]):
                if get_origin(c) is not tuple or f.metadata.get("rest") or f.metadata.get("free"):
                    continue
                said = told[name]["properties"][key_of(f)]
                lists = [s for s in said.get("anyOf", [said]) if s.get("type") == "array"]
                parts = {p.__name__ for p in options(get_args(c)[0]) if is_dataclass(p)}
                items = [i for s in lists for i in s["items"].get("anyOf", [s["items"]])]
                assert parts <= {i.get("$ref", "").rpartition("/")[2] for i in items}, (name, f)
                seen += bool(parts)
    assert seen > 3


@pytest.mark.parametrize(("name", "f"), NUMBERS, ids=[f"{name}.{key_of(f)}" for name, f in NUMBERS])
def test_a_number_is_one_in_its_unit_and_range(name: str, f: Any) -> None:
    kind, key, meta = PARTS[name], key_of(f), f.metadata
    unit, lo, hi = meta["unit"], meta.get("lo", -math.inf), meta.get("hi", math.inf)
    types = options(hints(kind)[f.name])
    listed = [k for k in types if get_origin(k) is tuple]
    alone = [k for k in types if k not in listed]
    whole = int in (alone or [k for t in listed for k in get_args(t)])

    def told(value: Any) -> list[str]:
        return faults_at(kind, key, value if alone else [value])

    def text(value: float) -> Any:
        return value if unit == "1" else f"{value!r} {unit}"

    for end, beyond in ((lo, lo - max(1.0, abs(lo))), (hi, hi + max(1.0, abs(hi)))):
        if math.isfinite(end):
            limit = [k for k in told(text(end)) if "is outside" in k]
            assert limit == []
            assert any("is outside" in k for k in told(text(beyond))), (end, beyond)
    assert any("is outside" in k or "nan" in k for k in told(text(math.nan)))
    other = "1 kg K" if unit != "kg K" else "1 m"
    assert any(unit in k or "number" in k for k in told(other)), told(other)
    assert any("; write " in k for k in told(True))
    assert any("; write " in k for k in told({"a": 1}))
    inside = next((x for x in (lo, hi, 1.0) if math.isfinite(x)), 1.0)
    if unit != "1":
        for bare in (inside, repr(inside)):
            assert any("has no unit; write" in k for k in told(bare)), bare
    if whole and lo < hi:
        assert any("write a whole number" in k for k in told(text(math.floor(inside) + 0.5)))


@pytest.mark.parametrize("name", PARTS)
def test_a_key_of_another_kind_is_refused(name: str) -> None:
    kind = PARTS[name]
    for f in fields(kind):
        types = options(hints(kind)[f.name])
        key = key_of(f)
        if f.metadata.get("rest") or "unit" in f.metadata:
            continue
        tables = f.metadata.get("free") or any(
            is_dataclass(t) or "Mapping" in str(get_origin(t)) for t in types
        )
        lists = [t for t in types if get_origin(t) is tuple]
        if tables:
            assert any("write a table" in k for k in faults_at(kind, key, 3)), key
        elif lists and len(types) == len(lists):
            assert any("write a list" in k for k in faults_at(kind, key, "x")), key
        elif any(get_origin(t) is Literal for t in types):
            assert faults_at(kind, key, "no such word"), key
        elif types == [str]:
            assert any("write a text" in k for k in faults_at(kind, key, 3)), key
    _, faults = declared_parts.read(kind, {"no_such_key": 1})
    rest = any(f.metadata.get("rest") for f in fields(kind))
    assert rest or any(keys == ("no_such_key",) for keys, _ in faults)
    _, faults = declared_parts.read(kind, 3)
    assert faults == [((), "is 3; write a table")]


# ---- files of equations ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "name", "said"),
    [
        ("a = 1\n", "", r"own.toml has no block; write a table, \[law\]"),
        ("[law]\nmu = 'x'\ninputs = {x = '1'}\n", ":lwa", "has no block 'lwa'; did you mean 'law'"),
        ("[law\n", "", "own.toml: .*"),
        ("# " + 100_000 * "x", "", "has 100002 bytes; a file of equations has at most 100000"),
        ("[law]\nmu = 3\n", "", "line 2: law.mu: 'mu' is no text of an equation"),
        ("[law]\ninputs = 3\n", "", r"line 2: law.inputs: write a table, \[law.inputs\]"),
    ],
)
def test_a_file_of_equations_that_is_none(text, name, said, tmp_path) -> None:
    path = tmp_path / "own.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(BadInput, match=said):
        resolve.load_block(f"{path}{name}")


def test_a_text_that_is_too_long() -> None:
    with pytest.raises(
        BadInput, match=r"a.toml has 100001 letters; such a file has at most 100000"
    ):
        equation_files.content_of_text("a.toml", 100_001 * " ")
