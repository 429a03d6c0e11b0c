"""All laws on one form: what an adaptor keeps, what a loop does, and that a study resumes."""

import numpy as np
import pytest

from slipctl import Context, Scenario, connect, sampled, simulate
from slipctl.models import common_form as form
from slipctl.models.huang_2020.subway_braking import double_exponential
from slipctl.models.predictive.predictive_slip import predictive, slip_model
from slipctl.models.predictive.predictive_speed import body, predictive_speed
from slipctl.models.zhang_2021.hst_braking_control import feedback_linearisation
from slipctl.studies.all_rails import loops, runs, tracking

pytestmark = pytest.mark.second

DRY = {"c": 1.0, "a": 0.54, "b": 1.2}


@pytest.mark.parametrize("vehicle", loops.VEHICLES)
def test_the_common_form_is_the_plant_of_each_paper(vehicle):
    """s' = (r/J) T - D, with D from the true adhesion force, is what the plant itself does."""
    v = loops.VEHICLES[vehicle]
    plant, w = v.plant(), v.wheel
    slip, speed, torque = 0.8, w.v, 0.4 * w.T_max
    known = dict.fromkeys(plant.states, 0.0)
    if vehicle == "freight":
        known |= {"train.v_t": speed, "train.omega_m": (speed + slip) / w.r * loops.GEAR,
                  "motor.T_m": torque / loops.GEAR}  # fmt: skip
    else:
        known |= {"wheel.v": speed, "wheel.omega": (speed - slip) / w.r}
        known |= {"brake.T_b": torque} if vehicle == "subway" else {
            "brake.P_c": torque / 33.56e-3
        }  # fmt: skip
    rates, y = plant(**known, T_cmd=0.0)
    if vehicle == "freight":
        s_rate = w.r / loops.GEAR * rates["train.omega_m"] - rates["train.v_t"]
        F, a_R = y["train.F_a"], -y["res.F_Z"] / 6e6
    else:
        s_rate = rates["wheel.v"] - w.r * rates["wheel.omega"]
        F, a_R = abs(y["wheel.F_a"]), (y["air.f"] / w.m if vehicle == "subway" else 0.0)
    D = loops.falling(w)(F=F, a_R=a_R)["D"]
    assert s_rate == pytest.approx(w.r / w.J * torque - D, rel=1e-9)


def test_a_law_of_ratios_wants_the_torque_of_the_common_form():
    """efc on the subway wheel: T = (J/r)(D + v nu + s v'/v), the slip a ratio, forces turned."""
    w = loops.SUBWAY
    law = form.of_zhang(feedback_linearisation())(w)
    v, s, F = 20.0, 1.0, 20e3
    _, y = law(v=v, v_s=s, v_best=s, F=F)
    lam, lam_ref = s / v, law.param_values()["lam_ref_start"]
    rate = y["reference.rate"]
    D = (w.r**2 / w.J + 1 / w.m) * F
    nu = v * (-100 * (lam - lam_ref) + rate) - lam * F / w.m
    assert y["T_wanted"] == pytest.approx(w.J / w.r * (D + nu), rel=1e-9)


def test_a_law_of_ratios_shapes_its_reference_with_the_wheel_that_it_drives():
    for w in (loops.SUBWAY, loops.SUBWAY._replace(J=300.0, r=0.6)):
        values = form.of_zhang(feedback_linearisation())(w).param_values()
        assert float(values["J"]) == w.J
        assert float(values["r"]) == w.r


def test_predictive_model_is_the_common_form_behind_a_lag():
    w = loops.SUBWAY
    model = slip_model(double_exponential, w)
    mu = double_exponential(v_s=0.7)["mu"]
    rates, _ = model(**{"axle.v_s": 0.7, "axle.T": 9e3}, T_cmd=12e3, v_ref=1.2, d=0.3, **DRY)
    F = mu * w.W * w.g
    D = (w.r**2 / w.J + 1 / w.m) * F
    assert rates["axle.v_s"] == pytest.approx(w.r / w.J * 9e3 - D + 0.3)
    assert rates["axle.T"] == pytest.approx(3e3 / w.tau)


def test_predictive_law_is_free_of_offset_with_a_wrong_curve_and_mass():
    """Plant with a third less adhesion than told: the slip rests on its reference."""
    w = loops.SUBWAY
    plant = sampled(slip_model(double_exponential, w._replace(W=8800.0)), form.T_S, "rk4", 4)
    wires = {"law.v_s": "plant.axle.v_s", "law.T": "plant.axle.T", "law.v_best": "v_best",
             "plant.T_cmd": "law.T_wanted", "plant.v_ref": "v_best"}  # fmt: skip
    loop = connect("loop", wires, plant=plant, law=predictive(double_exponential)(w))
    inputs = {f"law.{n}": x for n, x in DRY.items()} | {"v_best": 1.0}
    inputs |= {f"plant.{n}": x for n, x in (DRY | {"c": 0.66}).items()}
    log = simulate(loop, Scenario("wrong", 1.5, inputs=inputs), log=["plant.axle.v_s"])
    assert log["plant.axle.v_s"].values[-1] == pytest.approx(1.0, abs=2e-3)


def test_draws_are_the_same_for_every_loop_and_differ_between_seeds():
    assert loops.drawn("hst", "rising", 3) == loops.drawn("hst", "rising", 3)
    assert loops.drawn("hst", "rising", 3) != loops.drawn("hst", "rising", 4)
    draw = loops.drawn("hst", "rising", 3)
    assert 0.9 <= draw.mass <= 1.1
    assert all(0.8 <= h <= 1.1 for h in draw.heights)


def test_a_run_is_kept_and_read_again_with_the_same_bits(tmp_path, monkeypatch):
    v = loops.VEHICLES["hst"]
    block = loops.loop(v.world(), v.wheel, form.laws()["efc"])
    context = Context(True, {}, [], folder=tmp_path)
    arguments = ("hst", "section_5", "efc", block, 1, loops.drawn("hst", "section_5", 1))
    first = runs.run(context, *arguments)
    with monkeypatch.context() as patch:
        patch.setattr(runs, "simulate", None)  # a second run would fail
        assert runs.run(context, *arguments) == first
    assert runs.run(Context(True, {}, []), *arguments) == first
    faster = block.with_params(**{"law.law.K": 120.0})
    assert runs.run(context, *arguments[:3], faster, *arguments[4:]) != first
    log = simulate(block, loops.scenario("hst", "section_5", 1, arguments[5]), log=runs.LOG)
    assert first["distance"] == pytest.approx(float(log["world.x_true"][-1]), rel=1e-3)
    assert first["slide"] == 0.0
    assert len(list(tmp_path.iterdir())) == 2


def test_longest_run_of_true_values():
    assert runs.longest(np.array([0, 1, 1, 0, 1, 1, 1, 0, 1], dtype=bool)) == 3
    assert runs.longest(np.zeros(4, dtype=bool)) == 0


def test_speed_law_is_free_of_offset_with_a_wrong_mass_and_keeps_its_limits():
    """10 % more mass than told and 0.05 m/s^2 unknown: both errors go to zero, F within limits."""
    plant = sampled(body.with_params(m=550e3), 5e-3, "rk4")
    wires = {"law.e1": "plant.e1", "law.e2": "plant.e2", "plant.F": "law.F_contr",
             "law.a_ff": "a_ff", "plant.a_ff": "a_ff", "plant.d": "gust"}  # fmt: skip
    loop = connect("loop", wires, plant=plant, law=predictive_speed())
    given = {"a_ff": 0.2, "gust": -0.05, "law.F_hi": 200e3, "law.F_lo": -200e3}
    wanted = Scenario("off", 60.0, inputs=given, start={"plant.e1": -3.0, "plant.e2": -0.5})
    log = simulate(loop, wanted, log=["plant.e1", "plant.e2", "law.F_contr"])
    assert abs(log["plant.e2"].values[-1]) < 1e-3
    assert abs(log["plant.e1"].values[-1]) < 0.05
    assert np.abs(log["law.F_contr"].values).max() <= 200e3
    assert (log["law.F_contr"].values == 200e3).any()  # the limit was met


def test_the_relaxed_bound_of_tracking_grows_with_demand_and_poor_rail():
    sure = tracking.Draw(1.0, (1.1,) * 5, 1.0)
    poor = sure._replace(heights=(1.1, 0.8, 1.1, 1.1, 1.1))
    assert tracking.relaxed("half", sure) < tracking.relaxed("half", poor)
    assert tracking.relaxed("half", sure) < tracking.relaxed("stress", sure)
