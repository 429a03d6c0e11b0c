"""Metrics on signals whose values are worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
import xarray

from slipctl import Rail, Scenario, Section
from slipctl.run.metrics import (
    METRICS,
    Metric,
    Run,
    measure,
    rail_changes,
    rail_names,
    settling_time,
)
from slipctl.run.roles import Signals

H = 0.01
T = np.arange(600) * H  # 6 s
UNITS = {"v": "m/s", "x": "m", "s": "m/s", "ref": "m/s", "T": "N m", "a": "m/s^2"}


def log(**signals: np.ndarray) -> xarray.Dataset:
    variables = {
        n: (
            "time",
            np.broadcast_to(np.asarray(v, dtype=float), T.shape),
            {"units": UNITS.get(n, "1")},
        )
        for n, v in signals.items()
    }
    return xarray.Dataset(variables, coords={"time": T}, attrs={"period_s": H})


def metric(name: str, signals: Signals, changes=(2.0, 4.0), ideal=None, **values):
    found = measure(Run(log(**values), signals, changes, ideal or {}))
    return found[name].value if name in found else "absent"


def test_worst_axle_counts_and_the_mean_does_not():
    """Three axles: one rolls, one slips to 2 m/s, one locks for 1 s."""
    v, rolls = 10 + 0 * T, 0 * T
    slips = np.where((T >= 1) & (T < 2), -2.0, 0.0)
    locks = np.where((T >= 3) & (T < 4), 10.0, 0.0)
    jumps = np.where(T > 5.8, 5.0, 0.0)
    data = log(v=v, ref=0 * T)
    data["s"] = (("time", "axle"), np.stack([rolls, slips, locks], 1), {"units": "m/s"})
    data["T"] = (("time", "driven"), np.stack([rolls, jumps], 1), {"units": "N m"})
    roles = Signals(speed="v", slip="s", reference="ref", torque="T", barrier=("s", -1, 20))
    found = {k: m.value for k, m in measure(Run(data, roles, (2.0, 4.0))).items()}
    assert (found["slip_max"], found["slip_min"]) == (10, -2)
    assert found["slip_error_rms"] == pytest.approx(np.sqrt((100 + 4) / 6))
    assert found["tracking_time"] == [None, None, 0.0]
    assert found["torque_ripple"] == 5
    assert found["torque_variation"] == pytest.approx(5 / 6)
    assert found["lock_time"] == pytest.approx(1.0)
    assert found["barrier_exits"] == 1


# ---- distance -----------------------------------------------------------------------------------


def test_distance_of_constant_deceleration_counts_the_last_tick() -> None:
    v, x = 20 - 2 * T, 20 * T - T**2
    at_six = 20 * 6 - 36
    assert metric("distance", Signals(speed="v", position="x"), v=v, x=x) == pytest.approx(at_six)
    assert metric("distance", Signals(speed="v"), v=v) == pytest.approx(at_six)
    # without a speed the last tick is not known: 5.99 s
    assert metric("distance", Signals(position="x"), x=x) == pytest.approx(20 * 5.99 - 5.99**2)


def test_distance_is_counted_from_the_start_of_the_run() -> None:
    got = metric("distance", Signals(speed="v", position="x"), v=10 + 0 * T, x=100 + 10 * T)
    assert got == pytest.approx(60)


def test_ideal_distance_is_that_of_the_ideal_loop_or_absent() -> None:
    s = Signals(speed="v")
    assert metric("ideal_distance", s, v=20 - T, ideal={"distance": Metric(90.0, "m")}) == 90.0
    assert metric("ideal_distance", s, v=20 - T) == "absent"


def test_stopping_distance_ends_at_a_tenth_of_a_metre_per_second() -> None:
    v = np.maximum(10 - 2 * T, 0)
    x = np.where(T < 5, 10 * T - T**2, 25.0)
    got = metric("stopping_distance", Signals(speed="v", position="x"), v=v, x=x)
    assert got == pytest.approx(25 - 0.1**2 / 4, abs=1e-9)  # v = 0.1 m/s at 4.95 s
    assert metric("stopping_distance", Signals(speed="v"), v=20 - T) is None, "it never stops"
    assert metric("stopping_distance", Signals(speed="v"), v=0 * T) == "absent", "it stands"


# ---- slip ---------------------------------------------------------------------------------------


def test_settling_time_per_rail_and_null_where_never() -> None:
    error = np.zeros_like(T)
    error[T < 0.1 - 1e-9] = -0.3
    error[(T >= 2 - 1e-9) & (T < 2.3 - 1e-9)] = 0.2
    error[T >= 4 - 1e-9] = 0.06
    got = metric("settling_time", Signals(slip="s", best_slip="ref"), s=1 + error, ref=1.0)
    assert got == [pytest.approx(0.1), pytest.approx(0.3), None]


def test_settled_is_said_of_the_best_slip_and_tracked_of_the_own_reference() -> None:
    """A loop that holds its own reference exactly has not settled where that is wrong."""
    s = Signals(slip="s", reference="ref", best_slip="best")
    right = np.where(T < 4, 1.0, 1.0 + 0.2 * np.exp(4 - T))  # comes back: 0.05 after ln 4 s
    values = dict(s=right, ref=right, best=1.0)
    assert metric("tracking_time", s, **values) == [0.0, 0.0, 0.0]
    settled = metric("settling_time", s, **values)
    assert settled == [0.0, 0.0, pytest.approx(np.log(4), abs=H)]
    assert metric("settling_time", Signals(slip="s", reference="ref"), s=T, ref=T) == "absent"


def test_a_standing_vehicle_is_not_unsettled() -> None:
    """Below 1 m/s no slip of 1.2 m/s exists: those ticks do not count."""
    v = np.maximum(5 - T, 0)
    slip = np.where(v > 1, 1.2, v)
    s = Signals(speed="v", slip="s", best_slip="best")
    assert metric("settling_time", s, (), v=v, s=slip, best=1.2) == [0.0]


def test_rows_name_their_rail() -> None:
    sections = [Section(0, "dry"), Section(2, "leaves"), Section(4, "dry")]
    changes = rail_changes(log(), where := Scenario("s", 6.0, Rail(sections)), Signals())
    rails = rail_names(where, changes)
    assert rails == ["dry from 0 s", "leaves", "dry from 4 s"]
    run = Run(log(s=1.0, best=1.0, a=T), Signals(slip="s", best_slip="best", deceleration="a"))
    assert measure(run)["settling_time"].rows == ()
    named = measure(Run(run.log, run.signals, changes, {}, rails))
    assert named["settling_time"].rows == named["acceleration_variance"].rows == tuple(rails)
    assert rail_names(Scenario("s", 6.0, Rail([Section(0)])), []) == []
    assert rail_names(Scenario("s", 6.0), []) == []


def test_settling_time_counts_until_the_last_excursion() -> None:
    error = np.zeros_like(T)
    error[210], error[250] = 1, -1
    assert settling_time(T, error, 2.0, 4.0, 0.05) == pytest.approx(0.51)
    assert settling_time(T, np.zeros_like(T), 2.0, 4.0, 0.05) == 0.0


def test_settling_time_of_a_slip_ratio_has_the_band_of_one_percent() -> None:
    UNITS["k"] = "1"
    error = np.where((T >= 2) & (T < 2.5), 0.02, 0.009)
    s = Signals(slip="k", best_slip="r")
    assert metric("settling_time", s, k=0.1 + error, r=0.1) == [0.0, pytest.approx(0.5), 0.0]


def test_settling_time_is_absent_without_a_best_slip() -> None:
    assert metric("settling_time", Signals(slip="s"), s=T) == "absent"
    assert metric("tracking_time", Signals(slip="s", best_slip="r"), s=T, r=T) == "absent"


def test_slip_error_uses_the_reference_else_the_best_slip() -> None:
    both = Signals(slip="s", reference="ref", best_slip="best")
    assert metric("slip_error_rms", both, s=3 + 0 * T, ref=1.0, best=0.0) == pytest.approx(2)
    assert metric("slip_error_rms", both, s=3 + 0 * T, best=0.0) == pytest.approx(3)
    alternating = np.where(np.arange(600) % 2, 3.0, -1.0)  # rms of (3, -1) is sqrt(5)
    assert metric("slip_error_rms", both, s=alternating, ref=0.0) == pytest.approx(5**0.5)


def test_slip_extremes() -> None:
    s = Signals(slip="s")
    wave = np.sin(T)
    assert metric("slip_max", s, s=wave) == wave.max()
    assert metric("slip_min", s, s=wave) == wave.min()


def test_a_list_of_names_takes_the_first_that_the_loop_has() -> None:
    s = Signals(slip=("nowhere", "s"))
    assert metric("slip_max", s, s=2.0) == 2.0


# ---- torque -------------------------------------------------------------------------------------


def test_torque_ripple_is_the_worst_of_the_last_half_seconds() -> None:
    torque = np.zeros_like(T)
    torque[120] = 900  # 1.2 s: outside of every window
    torque[170] = 30  # in (1.5, 2)
    torque[200] = 700  # the tick of the change belongs to the next window
    torque[380] = -40  # in (3.5, 4)
    torque[599] = 50  # the last tick
    assert metric("torque_ripple", Signals(torque="T"), T=torque) == 50
    assert metric("torque_ripple", Signals(torque="T"), (), T=torque) == 50


def test_torque_variation_is_total_variation_by_duration() -> None:
    square = np.where(np.arange(600) % 2, 5.0, 0.0)
    assert metric("torque_variation", Signals(torque="T"), T=square) == pytest.approx(599 * 5 / 6)
    ramp = 3 * T
    assert metric("torque_variation", Signals(torque="T"), T=ramp) == pytest.approx(3 * 5.99 / 6)


# ---- adhesion and acceleration ------------------------------------------------------------------


def test_adhesion_use_leaves_out_standstill_and_signs() -> None:
    s = Signals(speed="v", adhesion="mu", best_adhesion="best")
    v = np.where(T < 3, 5.0, 0.5)
    mu = np.where(T < 3, -0.09, 0.0)
    assert metric("adhesion_use", s, v=v, mu=mu, best=0.1) == pytest.approx(0.9)
    assert metric("adhesion_use", s, v=0.5 + 0 * T, mu=mu, best=0.1) == "absent"


def test_above_ideal_is_the_distance_beyond_the_bound_or_absent() -> None:
    s = Signals(speed="v")
    distance = metric("distance", s, v=20 - T)
    ideal = {"distance": Metric(90.0, "m")}
    assert metric("above_ideal", s, v=20 - T, ideal=ideal) == pytest.approx(distance - 90.0)
    assert metric("above_ideal", s, v=20 - T) == "absent"
    data = log(v=20 - T, s=0 * T)
    data["s"].attrs |= {"units": "m/s", "positive": "traction"}
    driven = measure(Run(data, Signals(speed="v", slip="s"), (), ideal))
    assert driven["above_ideal"].value == pytest.approx(90.0 - distance)  # farther is better


def test_acceleration_variance_after_start_and_changes() -> None:
    a = np.zeros_like(T)
    a[0:50:2] = 2.0  # 25 of the 50 ticks: variance 1
    a[200:250] = 3.0  # constant
    a[400:425] = 4.0  # half of the window: variance 4
    got = metric("acceleration_variance", Signals(deceleration="a"), a=a)
    assert got == [pytest.approx(1), pytest.approx(0), pytest.approx(4)]


def test_jerk_leaves_out_the_step_of_the_rail() -> None:
    a = np.where(T < 2 - 1e-9, 0.0, np.where(T < 4 - 1e-9, 1.0, 3.0))
    assert metric("jerk_rms", Signals(deceleration="a"), a=a) == 0
    assert metric("jerk_rms", Signals(deceleration="a"), (), a=4 * T) == pytest.approx(4)
    assert metric("jerk_rms", Signals(speed="v"), (), v=20 - T**2) == pytest.approx(2, rel=2e-3)


# ---- bounds, tracking, locking ------------------------------------------------------------------


def test_exits_count_leaving_not_being_outside() -> None:
    e = np.zeros_like(T)
    e[100:150] = 2.0
    e[300] = -2.0
    assert metric("funnel_exits", Signals(funnel=("e", -1.0, 1.0)), e=e) == 2
    assert metric("funnel_exits", Signals(funnel=("e", "lo", "hi")), e=e, lo=-3.0, hi=1.0) == 1
    assert metric("barrier_exits", Signals(barrier=("e", -5.0, 5.0)), e=e) == 0
    assert metric("barrier_exits", Signals(barrier=("no", -5.0, 5.0)), e=e) == "absent"


def test_an_error_outside_from_the_start_is_an_exit() -> None:
    assert metric("funnel_exits", Signals(funnel=("e", -1.0, 1.0)), e=2.0) == 1


def test_tracking_errors() -> None:
    s = Signals(speed="v", wanted_speed="vw", position="x", wanted_position="xw")
    values = dict(v=1 + 0 * T, vw=np.where(T < 3, 1.0, 3.0), x=T, xw=T + 4)
    assert metric("speed_error_max", s, **values) == 2
    assert metric("speed_error_rms", s, **values) == pytest.approx(2**0.5)
    assert metric("position_error_max", s, **values) == pytest.approx(4)
    assert metric("position_error_rms", s, **values) == pytest.approx(4)


def test_a_slip_of_traction_counts_from_the_rim() -> None:
    """Rim at 1.95 of the vehicle is no lock; rim at rest has a slip of -v."""
    data = log(v=2.0, s=np.where(T < 1 - 1e-9, -2.0, 1.9))
    data["s"].attrs["positive"] = "traction"
    found = measure(Run(data, Signals(speed="v", slip="s"), ()))
    assert found["lock_time"].value == pytest.approx(1.0)


def test_lock_time_from_slip_speed_ratio_or_rim_speed() -> None:
    locked = (T >= 1 - 1e-9) & (T < 1.4 - 1e-9)
    v = 10 + 0 * T
    assert metric("lock_time", Signals(speed="v", slip="s"), v=v, s=np.where(locked, 9.9, 1)) == (
        pytest.approx(0.4)
    )
    UNITS["k"] = "1"
    got = metric("lock_time", Signals(speed="v", slip="k"), v=v, k=np.where(locked, 1.0, 0.1))
    assert got == pytest.approx(0.4)
    UNITS["rim"] = "m/s"
    got = metric(
        "lock_time", Signals(speed="v", wheel_speed="rim"), v=v, rim=np.where(locked, 0, 9)
    )
    assert got == pytest.approx(0.4)
    assert metric("lock_time", Signals(speed="v", wheel_speed="w"), v=v, w=0.0) == "absent"
    slow = metric("lock_time", Signals(speed="v", slip="s"), v=0.9 + 0 * T, s=0.9)
    assert slow == 0


def test_step_time_is_the_longest() -> None:
    assert metric("step_time", Signals(step_time="t"), t=np.where(T == 1.0, 3e-3, 1e-3)) == 3e-3


# ---- all together -------------------------------------------------------------------------------


def test_without_signals_nothing_is_measured() -> None:
    assert measure(Run(log(v=T), Signals())) == {}


def test_order_units_and_plain_numbers() -> None:
    s = Signals(speed="v", slip="s", reference="ref", torque="T", deceleration="a")
    found = measure(Run(log(v=20 - T, s=1.0, ref=1.0, T=5.0, a=1.0), s, (2.0, 4.0)))
    assert [n for n in METRICS if n in found] == list(found)
    assert found["torque_variation"].unit == "N m/s"
    assert found["slip_max"].unit == "m/s"
    assert found["tracking_time"] == Metric([0.0, 0.0, 0.0], "s")
    for m in found.values():
        for value in m.value if isinstance(m.value, list) else [m.value]:
            assert value is None or type(value) in (float, int)


def test_rail_changes_by_time_and_by_position() -> None:
    sections = [Section(0, "dry"), Section(2, "wet"), Section(9, "ice")]
    by_time = Scenario("s", 6.0, Rail(sections))
    assert rail_changes(log(x=2 * T), by_time, Signals()) == [2.0]
    by_way = Scenario("s", 6.0, Rail(sections, by="position"))
    assert rail_changes(log(x=2 * T), by_way, Signals(position="x")) == [1.0, 4.5]
    assert rail_changes(log(x=T), Scenario("s", 6.0), Signals()) == []
