"""Parts of a vehicle made in Python: what is of another kind than declared is refused."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from importlib import resources

import pytest

from slipctl import BadInput
from slipctl.study.files import trip_files

FILES = resources.files("slipctl.models.vehicle") / "files"
WRONG = (None, "abc", 3, [], {}, object(), float("nan"), (1,))


def parts_of(part, whole):
    """Each part in a part, with what makes the whole of another one in its place."""
    yield part, whole
    for f in fields(part):
        value = getattr(part, f.name)
        items = value.items() if isinstance(value, dict) else [(None, value)]
        for key, inner in items:
            if is_dataclass(inner):
                yield from parts_of(inner, lambda new, f=f, key=key, value=value: whole(replace(
                    part, **{f.name: new if key is None else {**value, key: new}})))  # fmt: skip


@pytest.mark.parametrize("name", ["metro", "emu"])
def test_a_value_of_another_kind_is_refused_or_fits(name):
    trip = trip_files.load_trip(str(FILES / f"{name}.toml"))
    refused = 0
    for part, whole in parts_of(trip, lambda new: new):
        for f in fields(part):
            for wrong in WRONG:
                try:
                    whole(replace(part, **{f.name: wrong}))
                except BadInput:
                    refused += 1
    assert refused > 500


def test_choices_are_named():
    part = trip_files.load_trip(str(FILES / "metro.toml")).demand
    with pytest.raises(BadInput, match=r"Constant: kind is 'ramp', which is no 'constant'"):
        replace(part, kind="ramp")
