"""What every property test runs on: a tuple of methods; and a compile cache of the tests' own."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import NamedTuple

import pytest
from hypothesis import settings

from slipctl import build

settings.register_profile("quick", deadline=None, derandomize=True, max_examples=25, database=None)
settings.register_profile("hunt", deadline=None, max_examples=2000, database=None)
settings.load_profile("quick")  # pytest --hypothesis-profile=hunt looks for new failures


class Integrator(NamedTuple):
    """A method of ``sampled``: its name, its order, and whether it is for stiff wheels."""

    method: str
    order: int
    implicit: bool


INTEGRATORS = (
    Integrator("euler", 1, False),
    Integrator("rk4", 4, False),
    Integrator("implicit_euler", 1, True),
    Integrator("sdirk2", 2, True),
)
"""A new method joins here (a test fails until it does), and every property test runs on it."""


@pytest.fixture(params=INTEGRATORS, ids=lambda i: i.method)
def integrator(request: pytest.FixtureRequest) -> Integrator:
    return request.param


@pytest.fixture(params=[i for i in INTEGRATORS if i.implicit], ids=lambda i: i.method)
def implicit(request: pytest.FixtureRequest) -> Integrator:
    return request.param


@pytest.fixture(params=[i for i in INTEGRATORS if not i.implicit], ids=lambda i: i.method)
def explicit(request: pytest.FixtureRequest) -> Integrator:
    return request.param


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Compiled loops of the tests do not fill the user's cache."""
    before = os.environ.get("SLIPCTL_CACHE")
    if before is None:
        os.environ["SLIPCTL_CACHE"] = str(tmp_path_factory.mktemp("cache"))
    yield
    if before is None:
        del os.environ["SLIPCTL_CACHE"]


@pytest.fixture
def no_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run as on a machine without a C compiler."""
    monkeypatch.setattr(build, "compiler", lambda: None)


@pytest.fixture
def needs_compiler() -> None:
    if build.compiler() is None:
        pytest.skip("no C compiler here")
