"""Slopes of a run's metrics through predictive control, against differences of whole runs."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

from slipctl import (
    BadInput,
    Block,
    Ensemble,
    Input,
    Output,
    Scenario,
    Signals,
    connect,
    law,
    sampled,
    simulate,
)
from slipctl.design.slopes import gradients
from slipctl.design.slopes.gradients import Slopes
from slipctl.design.tune import tune
from slipctl.run import build
from slipctl.run.sweep.ensemble import World
from slipctl.studies.predictive.slip_problem import axle, make

pytestmark = pytest.mark.second

SIGNALS = Signals(speed="plant.v", slip="plant.s", reference="s_ref")
SCENARIO = Scenario("go", 0.8, inputs={"mu_p": 0.2, "s_ref": 0.02})
NOW = {"ctl.weight_e_u": 0.3, "ctl.weight_e_xi": 5.0, "ctl.plant.tau": 0.06, "plant.m_q": 5200.0}


def loop(extra: dict[str, Any] | None = None, **options: Any) -> Block:
    """Controller and axle; the torque may go through one more part."""
    wires = {f"ctl.{n}": f"plant.{n}" for n in ("v", "q", "T", "xi")}
    wires |= {f"{part}.{n}": n for part in ("ctl", "plant") for n in ("mu_p", "s_ref")}
    wires |= {"plant.u": "after.y", "after.x": "ctl.u"} if extra else {"plant.u": "ctl.u"}
    parts = {"ctl": make(horizon=6, **options), "plant": sampled(axle, 0.02, "rk4", 4)}
    return connect("loop", wires, **parts, **(extra or {}))


def world(of: Block, compile: bool = False) -> World:
    """A run of it."""
    return World(of, SCENARIO, Ensemble({"plant.J": "100:140"}), signals=SIGNALS,
                 free=list(NOW), compile=compile)  # fmt: skip


def slip_error(block: Block, inertia: float, **numbers: float) -> float:
    """By hand, of a run that nothing of the module had a part in."""
    log = simulate(block.with_params(**numbers, **{"plant.J": inertia}), SCENARIO, compile=False)
    s = log["plant.s"].values
    return float(np.sqrt(np.mean((s - 0.02) ** 2)))


FORMS = [
    {},
    {"rates": {"u": 20.0}},
    {"iterations": 2},
    {"split": True, "soft": {"s": (-0.1, 0.018, 300.0)}},
]


@pytest.mark.parametrize("options", FORMS, ids=str)
@pytest.mark.others("long")
def test_every_slope_is_that_of_differences(options: dict[str, Any]) -> None:
    """To 1e-5, by weights, by what the plan believes and by the plant; limits hold in each form."""
    block = loop(**options)
    own = world(block)
    draw = own.draw(0, 3)
    inertia = draw.numbers["plant.J"]
    found = Slopes(own, list(NOW)).of(NOW, draw, ["slip_error_rms"])["slip_error_rms"]
    assert abs(found).min() > 0
    for k, name in enumerate(NOW):
        near = []
        for h in (1e-4 * NOW[name], 1e-5 * NOW[name]):
            d = {
                by: slip_error(block, inertia, **{**NOW, name: NOW[name] + by * h})
                for by in (-2, -1, 1, 2)
            }
            near.append((8 * (d[1] - d[-1]) - (d[2] - d[-2])) / (12 * h))
        assert min(abs(found[k] - d) for d in near) < 1e-5 * abs(found[k]), name


@pytest.mark.long
@pytest.mark.usefixtures("needs_compiler")
def test_a_sweep_that_is_compiled_gives_the_slopes_of_one_that_is_not() -> None:
    assert build.compiler() is not None
    block, found = loop(), []
    for compile in (False, True):
        own = world(block, compile)
        found.append(Slopes(own, list(NOW)).of(NOW, own.draw(0, 0), ["slip_error_rms", "distance"]))
    for metric, slopes in found[0].items():
        assert found[1][metric] == pytest.approx(slopes, rel=1e-12)


def test_a_part_beside_it_that_may_jump_is_refused() -> None:
    """A quantiser behind the controller; what is smooth there is not."""

    def part(change: Any) -> dict[str, Block]:
        @law(y=Output("kN m"))
        def after(x=Input("kN m")):
            return change(x)

        return {"after": after}

    assert Slopes(world(loop(part(lambda x: 0.9 * x))), list(NOW))
    with pytest.raises(BadInput, match=r"a quantiser in it may change along the run \(after\)"):
        Slopes(world(loop(part(lambda x: ca.floor(x * 10) / 10))), list(NOW))


@pytest.mark.long
def test_tuning_ends_along_it() -> None:
    """And not behind a hard limit that holds: the slope is that of an interior point's steps,
    0.4 % off, and the differences say so."""
    given = dict(scenario=SCENARIO, signals=SIGNALS, samples=4, held_out=2, runs=40, jobs=1,
                 compile=False)  # fmt: skip
    free = {"ctl.weight_e_u": (0.01, 10.0), "ctl.weight_e_xi": (0.5, 50.0)}
    found = tune(loop(), free, "slip_error_rms", Ensemble({"plant.J": "100:140"}), **given)
    assert found.polished is not None
    assert found.polished.apart <= gradients.AGREES
    assert found.polished.gained > 0
    hard = loop(hard={"s": (-0.1, 0.018)}, iterations=2)
    found = tune(hard, free, "slip_error_rms", Ensemble({"plant.J": "100:140"}), **given)
    assert found.polished is not None
    assert "not used" in found.polished.text()
