"""What the study hst_traction says: target, loops, and the ice with and without the limit."""

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from slipctl import BadInput, Rail, Scenario, Section, c_module, prepare, simulate
from slipctl.models.wang_2025 import hst_traction_control as control
from slipctl.models.wang_2025.hst_traction import GROUPED, tractive_effort
from slipctl.studies.hst_traction import experiments
from slipctl.studies.hst_traction.loops import (
    BAND,
    MODELS,
    NAMES,
    ROW,
    H,
    cases,
    loop,
    rail_by_time,
    shaped_target,
    target,
    worst,
)
from slipctl.studies.hst_traction.study import CLAIMS, FIGURES, study

pytestmark = pytest.mark.second


@pytest.mark.parametrize(("kappa", "v_115", "top"), [(0.85, 39.8, 50.8), (0.5, 28.7, 38.3)])
def test_target_keeps_to_the_tractive_effort(kappa, v_115, top):
    t, x, v, a = target(kappa)
    assert np.interp(115.0, t, v) == pytest.approx(v_115, abs=0.8)
    assert v.max() == pytest.approx(top, abs=0.8)
    assert v[-1] < 1.0
    assert np.abs(np.gradient(x, t) - v).max() < 0.02  # a target that moves as it says
    assert np.abs(np.gradient(v, t) - a).max() < 1e-9
    # what it asks for, resistance included, but for the means of 4 s at the corner
    need = 515.15e3 * a + 500.0 * (6.796 + 0.062 * 3.6 * v + 0.00143 * (3.6 * v) ** 2)
    able = np.array([float(tractive_effort(float(s))) for s in v])
    assert (need[t < 190] <= 1.01 * able[t < 190]).all()


def test_shaped_target():
    t, x, v, a = shaped_target(30.0, ((0.0, 0.2), (14.0, -0.6)), 40.0)
    assert v[0] == 30.0
    assert a.max() == pytest.approx(0.2)
    assert a.min() == pytest.approx(-0.6)
    inner = slice(1, -1)  # differences to one side are of first order only
    assert np.abs(np.gradient(v, t) - a)[inner].max() < 2e-3
    assert np.abs(np.gradient(x, t) - v)[inner].max() < 1e-4


def test_extremes_between_rows_are_kept():
    rng = np.random.default_rng(1)
    ticks = 7 * ROW + 1
    hi, lo = rng.normal(1, 1, ticks), rng.normal(-1, 1, ticks)
    block, x, rows = worst, worst.start(), []
    for k in range(ticks):
        x, y = block(**x, v_s_max=hi[k], v_s_min=lo[k])
        if k % ROW == 0:
            rows.append((y["highest"], y["lowest"], y["creep"]))
    for j in range(1, 8):
        span = slice((j - 1) * ROW + 1, j * ROW + 1)
        assert rows[j][0] == max(hi[span].max(), hi[(j - 1) * ROW])
        assert rows[j][1] == min(lo[span].min(), lo[(j - 1) * ROW])
        assert abs(rows[j][2]) == max(rows[j][0], -rows[j][1])


def test_every_loop_that_was_asked_for_is_there():
    whole = {c.scenario.name: set(c.loops) for c in cases(MODELS, False)}
    assert set(whole) == {"base", "stress", "position", "real"}
    every = {n + ending for n in NAMES for ending in ("", "_limited")}
    assert every <= whole["base"] <= whole["stress"]
    assert {"hosm_limited_uncompensated", "hosm_limited_printed"} <= whole["stress"]
    assert {f"{n}_limited" for n in NAMES} == whole["real"]


@cache
def on_ice(name: str, limited: bool):
    start, wanted = 114.0, target(0.85)
    scenario = Scenario(
        "ice", 3.0, rail_by_time(start), inputs=wanted.feeds(start), start=wanted.at(start)
    )
    block = loop(MODELS, MODELS[name], limited)
    has = {s.name for s in block.signals}
    names = ("plant.train.v_s_max", "plant.train.v_s_min", "ctl.F_contr", "ctl.limit.F_hi")
    return simulate(block, scenario, log=[n for n in names if n in has])


def test_the_limit_keeps_the_creep_in_the_band_on_ice():
    """The law with the largest commands; the others are in the study."""
    log = on_ice("smc", True)
    assert BAND[0] < log["plant.train.v_s_min"].values.min()
    assert log["plant.train.v_s_max"].values.max() < 2.0 / 3.6 < BAND[1]
    k = round(1.0 / H)  # the ice
    limit = log["ctl.limit.F_hi"].values
    assert limit[k] > 130e3
    changed = np.flatnonzero(limit[k:] < 90e3)
    assert changed[0] <= 6  # ms


def test_without_the_limit_the_wheel_slips_away():
    log = on_ice("hosm", False)
    assert log["plant.train.v_s_max"].values[-1] > 10
    assert np.diff(log["plant.train.v_s_max"].values[-500:]).min() > 0


def test_gains_and_observer_tables():
    from slipctl import Context

    context = Context(quick=True, models=MODELS, cases=())
    found = experiments.gains(context)
    assert found.where("eta by (49)", gains="printed, Table 5") == pytest.approx(
        0.00936143, abs=5e-9
    )
    tests = experiments.observer(context)["tests"]
    assert list(tests["accepts our K1"]) == [True, True, True, False]
    assert sorted(tests["smallest K1"]) == list(tests["smallest K1"])


def test_declarations():
    ids = [c.id for c in CLAIMS]
    assert len(set(ids)) == len(ids)
    assert {f"fig{k:02d}" for k in (2, 3, 4, 7, 8, 9, 10)} <= set(FIGURES)
    assert study.signals.slip == "worst.creep"


def test_controller_needs_no_more_than_the_rig_measures():
    ctl = control.controller(control.higher_order(), len(GROUPED.motors))
    assert set(ctl.inputs) == {"x", "v", "x_d", "v_d", "a_d", "omega", "T"}


def test_page_names_every_loop():
    page = (Path(__file__).parents[2] / "docs" / "hst_traction.md").read_text(encoding="utf-8")
    for loop_name in ("hosm_limited_uncompensated", "hosm_limited_printed", "smc_motor_printed"):
        assert f"`{loop_name}`" in page
    assert "<!-- table claims -->" in page


@pytest.mark.parametrize(
    ("numbers", "where"),
    [({"m": 550e3}, "at 8.422e+04 N"), ({"r": 0.4}, "at 7.656e+04 N and r = 0.4 m")],
)
def test_a_patch_of_another_load_or_radius_is_refused(numbers, where, tmp_path):
    """Hertz: the semi-axes grow with the cube root of the load. What is told to write is taken.

    At every door: where a loop is made ready, given other numbers, or written as C.
    """
    from slipctl.studies.hst_traction import loops as made

    given = {"a_d": 0.0, "v_d": 1.0, "x_d": 0.0}
    scenario = Scenario("s", 1e-3, Rail([Section(0, "dry")]), given, start={"plant.train.v": 1.0})
    whole = made.loop(made.MODELS, made.MODELS["pid"], False)
    ready = prepare(whole, scenario, compile=False)
    for door in (
        lambda: prepare(whole.with_params(**numbers), scenario, compile=False),
        lambda: ready(numbers),
        lambda: c_module(whole.with_params(**numbers)["plant.train"], tmp_path),
    ):
        with pytest.raises(BadInput, match="train: a, b and c11 are of a wheel with") as refused:
            door()
    told = {n: float(v) for n, v in re.findall(r"(\ba|\bb|c11)=([\d.]+)", str(refused.value))}
    if "m" in numbers:
        a = float(made.polach.params["a"].value) * 1.1 ** (1 / 3)
        assert told["a"] == pytest.approx(a, rel=1e-3)  # four digits are written
    assert where in str(refused.value)
    ready(numbers | told)
    assert list(tmp_path.iterdir()) == []
