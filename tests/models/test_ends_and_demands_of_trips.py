"""Ends of what a controller holds, how its inputs are judged, demands and logs of a trip."""

from __future__ import annotations

from dataclasses import replace
from math import log, pi, sqrt
from types import SimpleNamespace

import numpy as np
import pytest
from drawn_points import Draw, assert_same, values

from slipctl import Section
from slipctl.models.huang_2020.subway_braking import double_exponential
from slipctl.models.vehicle import Constant, Lag, Stretch, Track, Trip, Vehicle, contamination
from slipctl.models.vehicle import ranges as ends
from slipctl.models.vehicle import trip as trips
from slipctl.models.vehicle.books import known_of_trip
from slipctl.models.vehicle.contamination import patches_of_seed
from slipctl.models.vehicle.control import wheel
from slipctl.models.vehicle.parts import (
    Contamination,
    Davis,
    DemandAlone,
    NoisyWheel,
    Profile,
    Sensors,
    Slope,
    ToothWheel,
    WheelsOnly,
)
from slipctl.models.wheel_damage import flash_temperature, wear_rate

TRIP = Trip(
    duration=6.0,
    vehicle=Vehicle(mass=27e3, places=(0.0, 5.0, 12.0), axles=3, inertia=100.0, radius=0.5,
                    speed=20.0, gravity=9.7, resistance=Davis(a=300.0, b=20.0, c=5.0)),
    actuator=Lag(torque=8e3, lag=0.05, dead_time=0.03, rate=4e4),
    rail=Track(law="double_exponential", sections=(Stretch(place=0.0, condition="dry"),)),
    controllers={"none": DemandAlone()},
)  # fmt: skip


# ---- ends ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("tuned", [False, True])
@pytest.mark.parametrize("judges", [False, True])
def test_what_a_controller_holds_ends_where_the_trip_says(monkeypatch, tuned, judges):
    monkeypatch.setattr(ends, "of_those", lambda block, rows: {n: r[:2] for n, r in rows.items()})
    monkeypatch.setattr(ends, "of_inputs", lambda trip, w: {"fastest": 130.0, "most": 400.0})
    block = SimpleNamespace(params={"T_max": 1} if tuned else {}, states={"trust.v_h": 1} if judges
                            else {}, outputs={"trust.T_b": 1} if tuned else {})  # fmt: skip
    rows = ends.with_control_ranges(block, TRIP, wheel(TRIP))
    rim = 1.2 * 0.5 * 400  # 240
    slip = 130 + rim
    full, all_, top = (1.0, 3.0, 1.25)
    torques = {"trust.torque": (0, full), "trust.total": (0, all_), "trust.T_b": (-top, top)}
    for name, (low, high) in torques.items():
        found = rows.pop(name)
        if tuned:
            assert found == (f"{low!r} * T_max" if low else 0, f"{high!r} * T_max")
        else:
            assert found == (low * 8e3, high * 8e3)
    far, time, speed = (-2e6, 2e6), (0, 1e3), (-2, 130.0)
    wanted = {
        **dict.fromkeys(("slip.v_s", "meter.slips", "meter.v_s_m", "sample.v_s",
                         "estimator.kept"), (-slip, slip)),
        **dict.fromkeys(("slip.omega_s", "meter.omegas"), (-5 * slip, 5 * slip)),
        "meter.torques": far, "meter.mu_m": (-1e3, 1e3), "sample.mu": (-2, 2),
        **dict.fromkeys(("watch.ruling", "watch.on", "trust.learnt", "trust.seen",
                         "trust.kept_pace", "trust.up"), (0, 1)),
        "watch.idle": (0, 1e9), "reference.v_best": (0, 130.0), "fill.v_best": (0, 130.0),
        **dict.fromkeys(("trust.omega_h", "trust.mean"), (-400, 400)),
        **dict.fromkeys(("trust.rim", "trust.lead_h"), (-rim, rim)),
        "trust.radius": (0.18, 1.1), "trust.doubt": (-60.1, 1.8), "trust.ratio": (0.8, 1.2),
        "trust.bias": (-1, 1), **dict.fromkeys(("trust.v_h", "trust.v", "trust.given_h"), speed),
        "trust.demand_h": far, "trust.demand": far,
        **dict.fromkeys((f"trust.{n}" for n in (
            "out", "good", "still", "freed", "odd", "off", "on", "back", "age", "demand_out",
            "let_go", "lost_v", "lost_rim")), time),
        "trust.ban": (0, 10), "trust.rest": (0, 10), "trust.tried": (0, 2),
        "trust.moved": (-1e3, 1e3),
    } | ({} if judges else {"T_demand": far})  # fmt: skip
    assert set(rows) == set(wanted)
    for name, row in wanted.items():
        assert rows[name] == pytest.approx(row), name


def of(**changes):
    trip = replace(TRIP, **changes)
    return ends.of_inputs(trip, wheel(trip))


ALPHA = 2 * (8e3 + 9e3 * 9.7 * 0.5) / 100.0
"""Largest acceleration of a wheel with a factor of two: brake and adhesion of 1, rad/s^2."""


def test_a_tooth_wheel_is_off_by_its_edges_and_from_rest_by_a_tooth():
    sensors = Sensors(wheel_speed=ToothWheel(teeth=90, jitter=3e-6, clock=2e-6))
    found, tooth = of(sensors=sensors), 2 * pi / 90
    assert found["noise"] == pytest.approx(0.1 + (1.2 * 40) ** 2 / tooth * (8 * 3e-6 + 4e-6))
    assert found["noise_slow"] == pytest.approx(sqrt(2 * ALPHA * tooth))
    assert found["slow"] == pytest.approx(2 * found["noise_slow"])
    assert (found["most"], found["omega_start"]) == (1.5 * 120 / 0.5, 40.0)
    react = 0.3 + 1.2 * 0.05 + 0.03 + 8e3 / 4e4
    assert found["react"] == pytest.approx(react)
    assert found["pace"] == pytest.approx(2 * 0.15 + 2 * 0.5 * found["noise"] + 0.5)
    for k, part in enumerate((300.0, 20.0, 5.0)):
        assert found[f"resist_{k}"] == pytest.approx(part / (3 * wheel(TRIP).m))
    assert wheel(TRIP).m == 9e3
    slow = of(sensors=sensors, vehicle=replace(TRIP.vehicle, speed=0.2))
    assert slow["noise"] == pytest.approx(0.1 + 2.4**2 / tooth * (8 * 3e-6 + 4e-6))


def test_a_noisy_wheel_is_off_by_eight_deviations_a_step_and_what_lost_samples_hide():
    part = NoisyWheel(deviation=0.02, step=0.05, dropout=0.01)
    found = of(sensors=Sensors(wheel_speed=part))
    lost = log(1e-9) / log(0.01)
    assert lost == pytest.approx(4.5)
    assert found["noise"] == pytest.approx(0.1 + 0.16 + 0.05 + 4.5e-3 * ALPHA)
    assert found["noise_slow"] == found["slow"] == 0
    plain = of(sensors=Sensors(wheel_speed=replace(part, dropout=0.0)))
    assert plain["noise"] == pytest.approx(0.1 + 0.16 + 0.05)
    wheels = of(sensors=Sensors(wheel_speed=replace(part, dropout=0.0),
                                vehicle_speed=WheelsOnly()))  # fmt: skip
    assert wheels["gate"] == pytest.approx(0.15 + 0.5 * 0.31)
    assert wheels["pace"] == 1e3


def test_heights_of_a_curve_are_at_least_those_of_its_points():
    over = {"c": (0.1, 0.5), "a": (0.4, 0.6), "b": (1.1, 1.4)}
    low, high = ends.height_of(double_exponential, over, (-5.0, 20.0))
    worst = 0.5 * (np.exp(0.4 * 5) - np.exp(1.4 * 5))
    assert -0.5 * np.exp(1.4 * 5) <= low <= worst
    assert 2 < high <= 0.5 * np.exp(0.6 * 5)  # a box of intervals: no point has it
    assert ends.height_of(double_exponential, over, (0.0, 20.0)) == (-2.0, 2.0)
    wide = ends.height_of(double_exponential, {"b": (-1e9, 1e9)}, (-5.0, 20.0))
    assert wide[0] == -ends.STEEP


# ---- demand --------------------------------------------------------------------------------------


def demanded(part, s, many):
    return values(trips.demand(replace(TRIP, demand=part)), s, many)


@pytest.mark.parametrize("over", ["time", "speed", "position"])
@pytest.mark.parametrize("force", [False, True])
def test_a_table_of_demands_holds_or_is_joined(over, force):
    """By time and place it holds until the next entry; by speed it is joined by lines."""
    level, at = (0.4, 1.3, -0.2, 0.9), (0.0, 3.0, 7.0, 12.0)
    level = tuple(1e3 * x for x in level) if force else level
    level = tuple(abs(x) for x in level)
    part = Profile(over=over, at=at, **{"force" if force else "deceleration": level})
    d = Draw(500, 1)
    s = {"t": d.even(0, 15), "v": d.even(-15, 15), "x": d.even(0, 15), "m": d.even(2e4, 4e4),
         "r": d.even(0.3, 0.6), "J": d.even(60, 160), "T": d.even(1e-3, 0.1)}  # fmt: skip
    _, after, told = demanded(part, s, 500)
    where = {"time": s["t"], "speed": np.abs(s["v"]), "position": s["x"]}[over]
    held = np.array(level)[np.searchsorted(at, where, side="right") - 1]
    now = np.interp(where, at, level) if over == "speed" else held
    torque = s["r"] * now / 3 if force else s["r"] * s["m"] / 3 * now + s["J"] / s["r"] * now
    assert_same(told, {"wanted": now, "T_demand": torque})
    assert_same(after, {"t": s["t"] + s["T"]})


def test_the_numbers_of_a_demand_are_those_of_the_vehicle():
    block = trips.demand(replace(TRIP, demand=Constant(deceleration=0.8)))
    found = {n: float(v) for n, v in block.param_values().items()}
    assert {n: found[n] for n in ("r", "J", "m", "level")} == {
        "r": 0.5, "J": 100.0, "m": 27e3, "level": 0.8}  # fmt: skip
    most = trips.demand(TRIP)
    assert float(most(v=1.0, x=0.0)["T_demand"]) == 8e3


def test_sections_of_a_rail_begin_where_condition_or_gradient_changes():
    track = Track(law="double_exponential", sections=(
        Stretch(place=0.0, condition="dry"), Stretch(place=30.0, condition="wet"),
        Stretch(place=80.0, condition="ice"),
    ), gradient=(Slope(place=0.0, gradient=0.01), Slope(place=30.0, gradient=-0.02),
                 Slope(place=55.0, gradient=0.03)))  # fmt: skip
    found = trips.rail(replace(TRIP, rail=track))
    assert found.by == "plant.train.x"
    assert list(found.sections) == [
        Section(0.0, "dry", {"slope": 0.01}), Section(30.0, "wet", {"slope": -0.02}),
        Section(55.0, "wet", {"slope": 0.03}), Section(80.0, "ice", {"slope": 0.03}),
    ]  # fmt: skip
    timed = replace(track, gradient=0.0, sections=(
        Stretch(time=0.0, condition="dry"), Stretch(time=4.0, condition="ice")))  # fmt: skip
    found = trips.rail(replace(TRIP, rail=timed))
    assert (found.by, list(found.sections)) == (
        "time", [Section(0.0, "dry"), Section(4.0, "ice")])  # fmt: skip


# ---- logs ----------------------------------------------------------------------------------------

LAYER = Contamination(law="falling_creep", condition="leaves", tau=3e-5)
LAYERED = replace(TRIP, rail=Track(law="falling_creep", contamination=LAYER,
                                   sections=(Stretch(place=0.0, condition="clean"),)))  # fmt: skip


def logged(**rows):
    return {f"plant.train.{n}": np.array(v) for n, v in rows.items()}


def test_the_books_of_energy_lose_what_no_power_took():
    powers = dict(P_drive=[7.0, 1.0, 4.0, 9.0], P_brake=[1.0, 2.0, 5.0, 1.0],
                  P_bearing=[0.1, 0.3, 0.2, 0.4], P_slip=[2.0, 1.5, 3.0, 2.5],
                  P_d=[0.5, -0.6, 0.7, 0.8])  # fmt: skip
    net = np.array([7 - 3.6, 1 - 3.2, 4 - 8.9])
    energy = 50.0 + np.concatenate([[0], np.cumsum(net)]) * 1e-3
    energy[2:] += 0.3
    found = known_of_trip(TRIP)["books.error"].values(logged(E_kin=energy, **powers))
    assert found == pytest.approx(np.array([0, 0, 0.3, 0.3]) / energy.max())


def test_wear_and_heat_of_contacts_are_those_of_half_of_their_power():
    vehicle = replace(LAYERED.vehicle, patch=1.1e-4, patch_half_length=6e-3,
                      radius=(0.5, 0.48, 0.46))  # fmt: skip
    known = known_of_trip(replace(LAYERED, vehicle=vehicle))
    v, P = np.array([10.0, -4.0, 0.02]), np.array([[9e3, 2e4, 400.0]] * 3)
    omega = np.array([[18.0, 12.0, 1.0], [-3.0, 7.0, 8.0], [0.0, 1.0, 2.0]])
    log = logged(v=v, P_contact=P, omega=omega)
    speed = np.array([10.0, 4.0, 0.1])[:, None]
    wear = known["contact.wear"].values(log)
    assert wear == pytest.approx(np.asarray(wear_rate(P / 2 / speed, 1.1e-4)))
    heat = known["contact.flash"].values(log)
    rim = np.abs(omega) * [0.5, 0.48, 0.46]
    assert heat == pytest.approx(flash_temperature(P / 2, speed, rim, 1.1e-4, 6e-3))


def test_places_of_a_draw_are_as_many_as_drawn_and_the_rest_is_nowhere(monkeypatch):
    drawn = SimpleNamespace(many=(2, 4), begin=100.0, end=400.0, length=(5.0, 20.0),
                            peak=(0.03, 0.06))  # fmt: skip
    trip = SimpleNamespace(ensemble=SimpleNamespace(patches=drawn), vehicle=TRIP.vehicle,
                           rail=SimpleNamespace(contamination=LAYER))  # fmt: skip
    field = SimpleNamespace(params={"start": np.zeros(5)})
    monkeypatch.setattr(contamination, "field_of_rail", lambda trip: field)
    monkeypatch.setattr(contamination, "layer_law", lambda trip, part: "law")
    monkeypatch.setattr(contamination, "peak_of_layer", lambda law, speed: 0.05)
    patches, counts = patches_of_seed(trip), set()
    for seed in range(12):
        found = {n.rpartition(".")[2]: v for n, v in patches(seed).items()}
        many = int((found["start"] < 1e7).sum())
        counts.add(many)
        start, end, factor = (found[n][:many] for n in ("start", "end", "factor"))
        assert (np.diff(start) > 0).all()
        assert ((start >= 100) & (start <= 400)).all()
        assert ((end - start >= 5) & (end - start <= 20)).all()
        assert ((factor >= 0.6) & (factor <= 1.2)).all()
        assert (found["start"][many:] == 1e7).all()
        assert (found["end"][many:] == 1e7).all()
        assert (found["factor"][many:] == 1).all()
        assert {len(v) for v in found.values()} == {5}
        again = patches(seed)
        assert all((again[n] == v).all() for n, v in patches(seed).items())
    assert counts == {2, 3, 4}


def test_the_best_under_each_axle_is_that_of_its_section_and_layer(monkeypatch):
    """Each axle stands somewhere else; a stand-in tells what is asked for each section."""
    asked = []

    class Peaks:
        def __init__(self, law, condition, speed):
            _, _, name = condition.split()
            self.number = {"dry": 1.0, "wet": 2.0, "ice": 3.0}[name]
            asked.append((name, speed))

        def at(self, v, height, share):
            return 10 * self.number + v / 100, self.number + height / 10 + share / 100

    monkeypatch.setattr(contamination, "Peaks", Peaks)
    contamination._peaks.cache_clear()
    track = trips.Rail([Section(0.0, "dry"), Section(6.0, "wet"), Section(40.0, "ice")],
                       by="plant.train.x")  # fmt: skip

    class Law:
        conditions = {n: f"numbers of {n}" for n in ("dry", "wet", "ice")}  # noqa: RUF012

    law = Law()
    monkeypatch.setattr(contamination, "on_train", lambda block: law)
    monkeypatch.setattr(contamination, "contaminated_law", lambda trip, block: law)
    x, v = np.array([3.0, 17.0, 45.0]), np.array([30.0, -12.0, 5.0])
    log = logged(x=x, v=v) | {"time": np.array([0.0, 0.1, 0.2])}
    number = np.array([[1, 1, 1], [2, 2, 1], [3, 3, 2]])  # axles are 0, 5 and 12 m behind
    found = contamination.best_under_axles(TRIP, double_exponential, track)
    slip = found["rail.best_slip"].values(log)
    assert slip == pytest.approx(10 * number + np.abs(v)[:, None] / 100)
    peak = found["rail.best_adhesion"].values(log)
    assert peak == pytest.approx(number + 0.01)  # a share of 1 without a layer
    assert set(asked) == {("dry", 30.0), ("wet", 30.0), ("ice", 30.0)}
    contamination._peaks.cache_clear()
    share = np.array([[0.2, 0.4, 0.6]] * 3)
    height = np.array([[0.5, 1.5, 2.0]] * 3)
    log |= {"plant.field.recovered": share, "plant.field.height": height}
    found = contamination.best_under_axles(LAYERED, double_exponential, track)
    peak = found["rail.best_adhesion"].values(log)
    assert peak == pytest.approx(number + (1 - share) * height / 10 + share / 100)
    contamination._peaks.cache_clear()
