"""Forms, methods and surfaces by name: one that a model does not have is refused."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from collections.abc import Callable, Iterator
from typing import Any

import pytest

import slipctl.models
from slipctl import BadInput


def makers() -> Iterator[tuple[str, Callable[..., Any], str]]:
    """Public functions of models that can be called as they are, and a choice that each has."""
    for info in pkgutil.walk_packages(slipctl.models.__path__, "slipctl.models."):
        if ".certificate" in info.name:
            continue
        module = importlib.import_module(info.name)
        for name, made in vars(module).items():
            own = inspect.isfunction(made) and made.__module__ == info.name
            if not own or name.startswith("_"):
                continue
            arguments = inspect.signature(made).parameters.values()
            if any(a.default is a.empty and a.kind not in (a.VAR_KEYWORD, a.VAR_POSITIONAL)
                   for a in arguments):  # fmt: skip
                continue
            for a in arguments:
                if isinstance(a.default, str) and a.default:
                    yield f"{info.name}.{name}", made, a.name


MAKERS = list(makers())


@pytest.mark.parametrize(("made", "choice"), [row[1:] for row in MAKERS],
                         ids=[f"{name}-{choice}" for name, _, choice in MAKERS])  # fmt: skip
def test_a_choice_that_there_is_not_is_refused_where_it_is_asked_for(made, choice) -> None:
    with pytest.raises(BadInput, match="no such"):
        made(**{choice: "no such"})


def test_there_are_choices() -> None:
    assert len(MAKERS) > 20
