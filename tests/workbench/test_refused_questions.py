"""What the workbench cannot show is said in a line: of laws, draws, logs, files and windows."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from slipctl import (
    BadInput,
    End,
    Ensemble,
    Input,
    Known,
    Output,
    Param,
    Rail,
    Scenario,
    Section,
    Signals,
    State,
    connect,
    law,
    step,
)
from slipctl.workbench import curves, effects, findings, laws
from slipctl.workbench.desk import Desk
from slipctl.workbench.sources import openings


def refused(said: str, what, *given, **named) -> None:
    with pytest.raises(BadInput, match=said) as told:
        what(*given, **named)
    assert "\n" not in str(told.value)


@step(period=0.1, w=Output("m/s", "twice", lo=-1e3, hi=1e3), T=Output("N m", "of it"))
def falls(
    v=State("m/s", 5.0, "speed"),
    x=State("m", 0.0, "way"),
    m=Param("kg", 2.0, "mass", lo=1, hi=9),
    a=Param("m/s^2", 1.0, "deceleration", lo=0, hi=9),
):
    """A body that slows down."""
    return dict(v=v - 0.1 * a, x=x + 0.1 * v), dict(w=2 * v, T=4 * m)


LOOP = connect("loop", {"w": "car.w"}, car=falls)


def rig(duration=3.0, end=None, ensemble=None, limits=None) -> SimpleNamespace:
    scenario = Scenario("base", duration, Rail([Section(0.0)]), end=end)
    study = SimpleNamespace(
        name="own", ensembles={} if ensemble is None else {"base": ensemble},
        limits=limits or {}, models={},
        signals=Signals(speed="car.v", position="car.x"),
    )  # fmt: skip
    case = SimpleNamespace(scenario=scenario, known={}, loops={"loop": LOOP})
    return SimpleNamespace(loop=LOOP, case=case, study=study, compiled=False, compile=False)


@pytest.mark.parametrize(("time", "row"), [(0.0, 0), (0.05, 0), (0.1, 1), (1.27, 12), (2.99, 29)])
def test_signals_of_a_time_are_those_of_the_tick_that_contains_it(time: float, row: int) -> None:
    found = {s["name"]: s for s in findings.signals_at(rig(), {}, time)}
    assert found["car.v"]["values"] == [pytest.approx(5 - 0.1 * row)]
    assert (found["car.T"]["unit"], found["car.T"]["values"]) == ("kN m", [pytest.approx(0.008)])
    assert (found["car.v"]["role"], found["car.v"]["doc"]) == ("state", "speed")
    moved = {s["name"]: s for s in findings.signals_at(rig(), {"car.a": 2.0}, time)}
    assert moved["car.v"]["values"] == [pytest.approx(5 - 0.2 * row)]


@pytest.mark.parametrize("time", [-0.1, 3.0, 99.0])
def test_a_time_outside_of_the_run_is_refused(time: float) -> None:
    said = f"the run goes from 0 s to 3 s; {time:g} s is not in it"
    refused(said, findings.signals_at, rig(), {}, time)


def test_a_time_behind_the_end_of_a_run_is_refused() -> None:
    """It ends where the body is slow; up to there it is shown."""
    ended = rig(end=End("car.v", below=4.0))
    assert findings.signals_at(ended, {}, 0.5)
    refused("the run ended before 2.5 s", findings.signals_at, ended, {}, 2.5)


def test_draws_need_what_is_drawn_and_limits() -> None:
    drawn = Ensemble({"car.m": "1.5kg:3kg"})

    def rows(asked, numbers):
        return list(effects.ensemble_rows(asked, numbers, 2))

    refused("own declares no ensemble of base", rows, rig(), {})
    refused("own declares no limits", rows, rig(ensemble=drawn), {})
    whole = rig(ensemble=drawn, limits={"distance": 9.0})
    refused("car.m is drawn by the ensemble and moved; reset its slider", rows, whole,
            {"car.m": 2.0})  # fmt: skip


@law(mu=Output("1", positive="traction"))
def plain(u=Input("1", "no slip")):
    return u


def test_a_law_that_is_none_of_adhesion_is_refused() -> None:
    refused("plain has no slip among its inputs", laws.law_view, plain)
    refused("own has no adhesion law that stands alone", laws.law_of_desk,
            SimpleNamespace(text=None), rig())  # fmt: skip
    refused("no slip among its inputs: name it v_s", laws.law_of_text, "mu = 2*u where u [1]")


def test_numbers_of_numpy_are_plain_and_nothing_else_is() -> None:
    assert curves._plain(np.float64(0.5)) == 0.5
    assert curves._plain(np.arange(3)) == [0, 1, 2]
    for odd in (object(), {1}, 1j):
        with pytest.raises(TypeError, match="is no plain value"):
            curves._plain(odd)
    assert json.dumps({"a": np.int64(3)}, default=curves._plain) == '{"a": 3}'


def test_what_is_not_there_cannot_be_opened(tmp_path: Path) -> None:
    gone = str(tmp_path / "gone.toml")
    refused("gone.toml is no vehicle's file, study or loop; see", Desk, gone, tmp_path)
    refused("there is no file|is no vehicle's", openings.opening_of_name, gone, (), False)
    assert replace(openings.opening_of_name("subway_braking", (), False), name="x").name == "x"
    assert Known("1", [0.3])
