"""What every property test runs on: a tuple of methods; and a compile cache of the tests' own."""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy; tests run beside each other

import gc
import logging
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
from hypothesis import settings

from slipctl.errors import BadInput
from slipctl.registry import check_one_tree

try:
    check_one_tree()
except BadInput as two_trees:
    pytest.exit(str(two_trees), 4)

from slipctl import Block, Rail, Scenario, Section, connect, sampled
from slipctl.models.brakes import brake
from slipctl.models.huang_2020 import subway_braking as subway
from slipctl.models.huang_2020 import subway_braking_control as control
from slipctl.run import build

sys.path.append(str(Path(__file__).parents[1]))  # bench, which is not installed
settings.register_profile("quick", deadline=None, derandomize=True, max_examples=25, database=None)
settings.register_profile("hunt", deadline=None, max_examples=2000, database=None)
gc.set_threshold(50_000, 20, 20)  # as in a command: a fifth of the CPU time of some tests otherwise
settings.load_profile("quick")  # pytest --hypothesis-profile=hunt looks for new failures


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Of a test of several cases that is marked ``others(TIER)`` all but the first are of TIER."""
    begun = set()
    for item in items:
        if mark := item.get_closest_marker("others"):
            name = item.nodeid.partition("[")[0]
            if name in begun:
                item.add_marker(mark.args[0])
            begun.add(name)


def pytest_collection_finish() -> None:
    """What is imported stays: no collection looks at it again."""
    gc.freeze()


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


BEST = float(subway.peak_slip(1.0, 0.54, 1.2))
"""Best slip speed of every rail of Table 1, m/s."""


def closed_loop(slip_law: Block | None = None, lag: bool = False, method: str = "rk4") -> Block:
    """Braked wheelset under slip control, perfect sensors, 1 ms; by default super-twisting."""
    wires = {
        "ctl.v": "plant.wheel.v",
        "ctl.v_s": "plant.wheel.v_s",
        "ctl.mu_hat": "plant.adh.mu",
        "ctl.f_hat": "plant.air.f",
        "ctl.W_hat": "plant.curve.W",
        "ctl.v_opt": "v_opt",
        "ctl.a_demand": "a_demand",
        "plant.T_cmd": "ctl.T_b",
    }
    plant = sampled(subway.plant(brake=brake(lag)), 1e-3, method)
    law = slip_law or control.super_twisting()
    return connect("loop", wires, plant=plant, ctl=control.controller(law))


def three_rails(seconds: float, **changes) -> Scenario:
    """Dry, wet and ice for a third of the time each, braking at the best slip."""
    names = ("dry", "wet", "ice")
    rail = Rail([Section(k * seconds / 3, n, {"v_opt": BEST}) for k, n in enumerate(names)])
    return Scenario("three_rails", seconds, rail).but(**changes)


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
    """Compiled loops of the tests do not fill the user's cache; the workers of a run share one."""
    before = os.environ.get("SLIPCTL_CACHE")
    if before is None:
        base = tmp_path_factory.getbasetemp()
        shared = base.parent if os.environ.get("PYTEST_XDIST_WORKER") else base
        os.environ["SLIPCTL_CACHE"] = str(shared / "cache")
    yield
    if before is None:
        del os.environ["SLIPCTL_CACHE"]


@pytest.fixture(autouse=True)
def _own_messages() -> None:
    """A command that ran in this process before has sent messages elsewhere."""
    log = logging.getLogger("slipctl")
    log.setLevel(logging.NOTSET)
    log.propagate, log.handlers[:] = True, []


@pytest.fixture
def no_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run as on a machine without a C compiler."""
    monkeypatch.setattr(build, "compiler", lambda: None)


@pytest.fixture
def needs_compiler() -> None:
    if build.compiler() is None:
        pytest.skip("no C compiler here")
