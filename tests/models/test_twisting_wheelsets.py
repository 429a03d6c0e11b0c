"""Driven wheelsets that twist, under a train and in the file of a vehicle."""

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from slipctl import BadInput, simulate
from slipctl.models.vehicle import case
from slipctl.models.vehicle.parts import Torsion
from slipctl.models.wheel_rail.axles import Axles, rolling
from slipctl.models.wheel_rail.falling_creep import falling_creep
from slipctl.models.wheel_rail.torsion import Wheelset
from slipctl.models.wheel_rail.twisting_wheelsets import (
    damping_matrix,
    law_on_two_wheels,
    train_that_twists,
)
from slipctl.study.files import trip_files

K, LOAD, RADIUS, SPEED = 7.526e6, 105e3, 0.625, 10.0
CURVE = {"mu_0": 0.36, "A": 0.38, "B": 0.70}


def one_axle(wheelset, c, speed=SPEED):
    """A train whose speed and whose mean slip stay: a heavy body, a heavy wheelset."""
    train = rolling(law_on_two_wheels(falling_creep), Axles((1,), (0.0,), (True,)), 1e-3,
                    standing=True)  # fmt: skip
    curve = {f"adh.{k}": value for k, value in (CURVE | {"c": c}).items()}
    return train_that_twists(train, wheelset, (0,)).with_params(
        m=1e8, m_axle=2 * LOAD / 9.81, g=9.81, J=1e4, r=RADIUS, B_t=0.0, v=speed, **curve
    )


def swung(block, slip, ticks, kick=1e-3):
    """Torque of the axle and mean adhesion over ticks at a slip that a torque holds."""
    start, p = block.start(), block.pack("param", block.param_values())
    rate = np.zeros(np.size(start["rate"]))
    rate[-2:] = kick, -kick
    x = block.pack("state", start | {"omega": [(SPEED + slip) / RADIUS], "rate": rate})
    torque, mu, held, found = 0.0, [], slip, []
    for _ in range(ticks):
        torque += 100 * (slip - held)
        drive = 6e5 * (slip - held) + torque + 2e4
        x, y = block.f(
            x,
            block.pack("input", {"T": [drive], "T_b": 0.0, "F_d": 0.0, "F_m": 0.0, "F_h": 0.0}),
            p,
        )
        out = block.unpack("output", y)
        held = float(out["v_s"])
        found.append(float(out["torsion"]))
        mu.append(float(out["mu"]))
    return np.array(found), np.array(mu)


@pytest.mark.second
@pytest.mark.parametrize("slip", [0.5, 1.0, 2.0])
@pytest.mark.others("long")
def test_the_limit_cycle_has_the_torque_of_the_closed_form_and_costs_adhesion(slip):
    """37.0, 77.1 and 154.5 kN m here; another simulation has 37.0, 78.9 and 156."""
    block = one_axle(Wheelset((150.0, 150.0), (K,), (0, 1), LOAD, RADIUS), 1500.0)
    torque, mu = swung(block, slip, 3000)
    late = torque[-500:]
    assert np.ptp(late) / 2 == pytest.approx(slip * sqrt(2 * K * 150) / RADIUS, rel=0.05)
    rigid = falling_creep.with_params(**CURVE, c=1500.0)(v_s=slip, v=SPEED)["mu"]
    assert mu[-500:].mean() < 0.98 * float(rigid)


@pytest.mark.second
@pytest.mark.parametrize("inertias", [(150.0, 150.0), (700.0, 150.0, 150.0)])
@pytest.mark.parametrize(("share", "grows"), [(0.98, False), (1.02, True)])
@pytest.mark.others("long")
def test_a_mode_grows_beyond_the_critical_fall_and_not_before(inertias, share, grows):
    """The slip where the curve falls by that much of the critical fall of the wheelset."""
    stiffness = (2.2e6, K)[-(len(inertias) - 1) :]
    wheels = (len(inertias) - 2, len(inertias) - 1)
    wheelset = Wheelset(inertias, stiffness, wheels, LOAD, RADIUS)
    law = falling_creep.with_params(**CURVE, c=1500.0)

    def fall(s):
        return float(law(v_s=s - 1e-4, v=SPEED)["mu"] - law(v_s=s + 1e-4, v=SPEED)["mu"]) / 2e-4

    low, high = 2.0, 8.0  # beyond the peak the fall gets less
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (
            (middle, high) if fall(middle) > share * wheelset.critical_fall else (low, middle)
        )
    torque, _ = swung(one_axle(wheelset, 1500.0), low, 4000, kick=1e-4)
    early, late = np.ptp(torque[1000:1600]), np.ptp(torque[3400:])
    assert (late > early) == grows


def test_a_tick_is_the_differential_equation_of_each_driven_axle():
    """Random swings of two of three axles, each with its own load, radius, slip and torque."""
    wheelset = Wheelset((700.0, 190.0, 150.0), (2.2e6, K), (1, 2), LOAD, RADIUS, 0.02)
    axles = Axles((1, 1, 1), (0.0, 3.0, 6.0), (True, False, True))
    law_ = law_on_two_wheels(falling_creep)
    train = rolling(law_, axles, 1e-3, apart=("r", "dN"), standing=True)
    r, load, J = np.array([0.6, 0.62, 0.5]), np.array([2e5, 1.9e5, 1.5e5]), wheelset.inertias
    curve = {f"adh.{k}": value for k, value in (CURVE | {"c": 1500.0}).items()}
    block = train_that_twists(train, wheelset, (0, 2)).with_params(
        m=1e8, m_axle=1e4, g=9.81, J=1e3, r=r, B_t=0.0, v=SPEED, **curve
    )
    K_, C = wheelset.stiffness_matrix, damping_matrix(wheelset)
    law = falling_creep.with_params(**CURVE, c=1500.0)
    slips = np.linspace(-1, 14, 601)
    curve_of = np.array([float(law(v_s=s, v=SPEED)["mu"]) for s in slips])
    rng, start = np.random.default_rng(4), block.start()
    slip, T, moved = np.array([0.4, 1.0, 2.5]), np.array([4e3, 9e3]), []
    for _ in range(3):
        angle, rate = rng.normal(0, 2e-3, (2, 3)), rng.normal(0, 1.0, (2, 3))
        for x in (angle, rate):  # about the mean
            x -= (x @ np.array(J) / sum(J))[:, None]
        x = start | {"omega": (SPEED + slip) / r, "angle": angle.ravel(), "rate": rate.ravel()}
        u = {"T": T, "T_b": 0.0, "F_d": 0.0, "F_m": 0.0, "F_h": 0.0, "dN": load - 9.81e4}
        after, y = block.f(block.pack("state", x), block.pack("input", u),
                           block.pack("param", block.param_values()))  # fmt: skip
        after, y = block.unpack("state", after), block.unpack("output", y)
        for k, axle in enumerate((0, 2)):

            def motion(t, z, k=k, axle=axle):
                mu = np.interp(slip[axle] + r[axle] * z[4:], slips, curve_of)
                force = -K_ @ z[:3] - C @ z[3:]
                force[0] += T[k]
                force[1:] -= r[axle] * load[axle] / 2 * mu
                return np.concatenate([z[3:], force / J - force.sum() / sum(J)])

            begin = np.concatenate([angle[k], rate[k]])
            exact = solve_ivp(motion, (0, 1e-3), begin, rtol=1e-8, atol=1e-10).y[:, -1]
            got = np.concatenate(
                [np.array(after[n]).ravel()[3 * k : 3 * k + 3] for n in ("angle", "rate")]
            )
            # steps of first order, a tick is 11; angles change by 1e-3 and rates by 0.1 and more
            assert got[:3] == pytest.approx(exact[:3], abs=4e-5)
            assert got[3:] == pytest.approx(exact[3:], abs=8e-3)
            moved.append(np.abs(exact - begin)[3:].max())
            wheels = slip[axle] + r[axle] * rate[k, 1:]
            mean = sum(float(law(v_s=s, v=SPEED)["mu"]) for s in wheels) / 2
            assert float(y["mu"][axle]) == pytest.approx(mean, abs=2e-3)  # at the end of the tick
            assert float(y["torsion"][k]) == pytest.approx(K * (angle[k, 1] - angle[k, 2]))
        turning = (SPEED + slip[[0, 2]]) / r[[0, 2]] + rate[:, 1]
        assert np.array(y["omega_d"]).ravel() == pytest.approx(turning)
    assert max(moved) > 0.1


def test_the_damping_of_each_mode_is_its_ratio():
    wheelset = Wheelset((700, 190, 150), (2.2e6, K), (1, 2), LOAD, RADIUS, 0.02)
    C, K_ = damping_matrix(wheelset), wheelset.stiffness_matrix
    M = np.diag(1 / np.array(wheelset.inertias))
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [-M @ K_, -M @ C]])
    found = [e for e in np.linalg.eigvals(A) if e.imag > 1]
    assert [-e.real / abs(e) for e in found] == pytest.approx([0.02, 0.02], rel=1e-9)


DRIVEN = """
[vehicle]
mode = "drive"
mass = "38 t"
inertia = "110 kg m^2"
speed = "20 km/h"
[vehicle.torsion]
stiffness = "3.78e6 N m/rad"
[actuator]
kind = "lag"
torque = "8 kN m"
lag = "60 ms"
[rail]
law = "exponential_tail"
[[rail.sections]]
time = "0 s"
condition = "dry"
[demand]
kind = "constant"
acceleration = "1.2 m/s^2"
[controllers.none]
kind = "none"
"""


def trip_of(tmp_path, text):
    path = tmp_path / "my.toml"
    path.write_text(text, encoding="utf-8")
    return trip_files.load_trip(str(path))


@pytest.mark.second
def test_on_a_dry_rail_the_axle_carries_half_of_the_motor_s_torque_and_nothing_else_changes(
    tmp_path,
):
    made = trip_of(tmp_path, DRIVEN)
    rigid = replace(made, vehicle=replace(made.vehicle, torsion=None))
    ways = []
    for trip in (made, rigid):
        found = case(trip)
        log = simulate(found.loops["none"], found.scenario.but(duration=2.0))
        ways.append(float(log["plant.train.x"].values[-1]))
        if trip is made:
            torque, motor = log["plant.train.torsion"].values[-1], log["plant.T"].values[-1]
            np.testing.assert_allclose(torque, motor / 2, rtol=1e-3)
    assert ways[0] == pytest.approx(ways[1], rel=1e-5)


@pytest.mark.second
def test_a_rail_that_remembers_takes_wheelsets_that_twist(tmp_path):
    layer = '[rail.contamination]\ncondition = "leaves"\n[demand]'
    made = trip_of(tmp_path, DRIVEN.replace("[demand]", layer))
    found = case(made)
    log = simulate(found.loops["none"], found.scenario.but(duration=0.05), compile=False)
    torque, motor = log["plant.train.torsion"].values[-1], log["plant.T"].values[-1]
    np.testing.assert_allclose(torque, motor / 2, rtol=0.2)  # still winding up
    assert (torque > 0).all()


@pytest.mark.parametrize(("old", "new", "said"), [
    ('mode = "drive"', 'mode = "brake"', r"vehicle.torsion: is of a driven vehicle"),
    ("[actuator]", 'rotor = "50 kg m^2"\n[actuator]', r"torsion.rotor: .*shaft belong together"),
    ("[actuator]", 'rotor = "120 kg m^2"\nshaft = "1e6 N m/rad"\n[actuator]',
     r"torsion.rotor: is 120 kg m\^2, the wheelset with it 110"),
    ('stiffness = "3.78e6 N m/rad"', "", r"vehicle.torsion: .*stiffness"),
])  # fmt: skip
def test_what_is_no_wheelset_is_refused_where_it_stands(tmp_path, old, new, said):
    text = DRIVEN.replace(old, new)
    if "brake" in new:
        text = text.replace("acceleration", "deceleration")
    with pytest.raises(BadInput, match=said):
        trip_of(tmp_path, text)


def test_a_rotor_takes_its_part_of_the_inertia():
    part = Torsion(stiffness=K, rotor=30.0, shaft=1e6)
    assert list(part.misfits()) == []
    assert list(part.faults_of_vehicle(True, [110.0, 110.0], [0.42, 0.42])) == []
    assert [k for k, _ in part.faults_of_vehicle(True, [110.0, 90.0], [0.42, 0.42])] == ["torsion"]
