"""What a person declares is asked for its kind: each field of each class that does so."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import pkgutil
from typing import Any

import pytest

import slipctl
from slipctl import BadInput, Claim, Experiment, Figure, Gains, Known, Study
from slipctl.run.results import Case, Table
from slipctl.study.declaration import KINDS

ODD = object()


def _declaring() -> list[type]:
    """Dataclasses of the package that ask for the kinds of their fields as they are made."""
    found = []
    for name in ("run.results", "run.rail", "run.roles", "run.sweep.ensemble", "study.declaration"):
        module = importlib.import_module(f"slipctl.{name}")
        for _, cls in inspect.getmembers(module, inspect.isclass):
            own = cls.__module__ == module.__name__ and dataclasses.is_dataclass(cls)
            made = cls.__dict__.get("__post_init__")
            if own and made is not None and "check_kinds(" in inspect.getsource(made):
                found.append(cls)
    return found


CLASSES = _declaring()


def test_no_other_file_of_the_engine_declares_such_a_class() -> None:
    """One that does joins the list above."""
    where = {cls.__module__ for cls in CLASSES}
    for info in pkgutil.walk_packages(slipctl.__path__, "slipctl."):
        if info.name.split(".")[1] not in ("run", "study", "design", "estimate", "seek", "tables"):
            continue
        spec = importlib.util.find_spec(info.name)
        if spec and spec.origin and spec.origin.endswith(".py"):
            with open(spec.origin, encoding="utf-8") as file:
                asks = "check_kinds(" in file.read()
            assert not asks or info.name in where, info.name


@pytest.mark.parametrize("cls", CLASSES, ids=lambda c: c.__name__)
def test_what_is_no_value_at_all_is_refused_with_the_name_of_its_field(cls: type) -> None:
    every = [f.name for f in dataclasses.fields(cls) if f.init]
    with pytest.raises(BadInput, match=rf"{cls.__name__}: \w+ is ") as told:
        cls(**dict.fromkeys(every, ODD))
    assert "\n" not in str(told.value)


MADE: list[tuple[type, dict[str, Any]]] = [
    (Table, {"title": "t", "columns": {"a": ("1", [1])}}),
    (Claim, {"id": "c", "source": "Table 1", "claim": "it stops", "kind": KINDS[0], "paper": 1.0,
             "ours": lambda results: 1.0, "tolerance": 0.1, "tolerance_why": "read off"}),
    (Figure, {"caption": "what it shows", "draw": lambda results: None}),
]  # fmt: skip


@pytest.mark.parametrize(("cls", "given"), MADE, ids=[c.__name__ for c, _ in MADE])
def test_each_field_is_asked_where_all_others_are_right(cls: type, given: dict[str, Any]) -> None:
    cls(**given)
    for f in dataclasses.fields(cls):
        if f.init and "Any" not in str(f.type).replace("Callable[[Results], Any]", ""):
            with pytest.raises(BadInput, match=f"{cls.__name__}: {f.name} is "):
                cls(**(given | {f.name: ODD}))


def test_such_classes_are_those_that_a_person_writes() -> None:
    assert {Case, Claim, Experiment, Figure, Gains, Known, Study, Table} <= set(CLASSES)
