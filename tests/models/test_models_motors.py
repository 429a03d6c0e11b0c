"""Motor with field orientation: the equivalent circuit of the textbook, plate, loops, limits."""

import numpy as np
import pytest

from slipctl import Output, Rail, Scenario, Section, State, connect, sampled, simulate, step
from slipctl.models import motors
from slipctl.models.wang_2025 import hst_traction as hst

H = 1e-4


@step(period=H, w=Output("rad/s", "speed of the axle"))
def spin(w=State("rad/s", 40.0, "speed of the axle")):
    return dict(w=w), dict(w=w)


def run(v, F, seconds=2.0, **values):
    """Drive at a held speed; the force is commanded at 0.5 s."""
    drive = motors.vector_drive(v).with_params(**values)
    wires = {"d.omega": "spin.w", "d.F_cmd": "F"}
    loop = connect("loop", wires, d=sampled(drive, H, "rk4"), spin=spin)
    inputs = {"F": [(0, 0.0), (0.5, F)]}
    return simulate(loop, Scenario("s", seconds, inputs=inputs, start={"spin.w": v / 0.445}))


def circuit(U, omega_e, slip, R_s, R_r, L_ls, L_lr, L_m, p):
    """Stator current (effective) and torque of the T circuit at a phase voltage (effective)."""
    rotor, main = R_r / slip + 1j * omega_e * L_lr, 1j * omega_e * L_m
    stator = U / (R_s + 1j * omega_e * L_ls + rotor * main / (rotor + main))
    current = abs(stator * main / (rotor + main))
    return abs(stator), 3 * current**2 * R_r / slip / (omega_e / p)


def test_data_give_the_plate():
    plate = motors.PLATE
    omega_e = 2 * np.pi * plate["f"]
    I, T = circuit(plate["U"] / 3**0.5, omega_e, plate["slip"], **motors.CIRCUIT, p=plate["p"])
    assert pytest.approx(plate["I"], rel=0.015) == I
    assert T * (1 - plate["slip"]) * omega_e / plate["p"] == pytest.approx(plate["P"], rel=0.015)


@pytest.mark.parametrize(("v", "F"), [(5.0, 30.2e3), (18.0, 20e3), (40.0, 13e3), (80.0, 6.5e3)])
def test_steady_state_is_that_of_the_equivalent_circuit(v, F):
    log = run(v, F)
    names = ("loops.u_d", "loops.u_q", "flux.omega_sl")
    names += ("machine.i_d", "machine.i_q", "machine.T_m")
    end = {k: float(log[f"d.{k}"][-1]) for k in names}
    values = {k: float(motors.machine.param_values()[k])
              for k in ("R_s", "R_r", "L_ls", "L_lr", "L_m", "p")}  # fmt: skip
    omega_e = values["p"] * 2.5 * v / 0.445 + end["flux.omega_sl"]
    U = np.hypot(end["loops.u_d"], end["loops.u_q"]) / 2**0.5
    I, T = circuit(U, omega_e, end["flux.omega_sl"] / omega_e, **values)
    assert pytest.approx(end["machine.T_m"], rel=1e-9) == T
    assert pytest.approx(np.hypot(end["machine.i_d"], end["machine.i_q"]) / 2**0.5, rel=1e-9) == I
    assert end["machine.T_m"] == pytest.approx(F * 0.445 / 2.5, rel=1e-9)
    assert float(log["d.loops.full"].max()) < 1


def test_torque_rises_with_the_bandwidth_of_the_loops():
    """First order at alpha = 2 pi 100/s, 30 times faster than the lag of 50 ms."""
    log = run(18.0, 20e3, 0.55)
    at = 5000
    t = np.arange(len(log["d.T"]) - at) * H
    T = log["d.T"].values[at:] / 0.445
    np.testing.assert_allclose(T, 20e3 * (1 - np.exp(-2 * np.pi * 100 * t)), atol=1)


def test_wrong_rotor_resistance_turns_the_frame_away_from_the_flux():
    log = run(18.0, 20e3, 6.0, **{"flux.R_r": 1.5 * motors.flux_model.params["R_r"].value})
    assert abs(float(log["d.machine.psi_q"][-1])) > 0.1 * float(log["d.machine.psi_d"][-1])
    assert float(log["d.T"][-1]) / 0.445 != pytest.approx(20e3, rel=0.02)
    right = run(18.0, 20e3, 1.0)
    assert abs(float(right["d.machine.psi_q"][-1])) < 1e-12


@pytest.mark.second
@pytest.mark.long
def test_drive_in_the_train_and_what_the_lag_leaves_out():
    """On ice both let the wheels go alike, because the power limit rules; the response differs."""
    rail = Rail([Section(0, "dry"), Section(0.6, "ice"), Section(1.4, "dry")])
    force, creep = {}, {}
    for name, motor in (("lag", None), ("drive", motors.vector_drive(30.0))):
        loop = connect("loop", {"plant.F_contr": "F"}, plant=hst.plant(motor=motor, h=H))
        inputs = {"F": [(0, 0.0), (0.1, 170e3)]}
        log = simulate(loop, Scenario("s", 3.0, rail, inputs=inputs, start={"v": 30.0}))
        force[name] = log["plant.train.F_rim"].values
        creep[name] = log["plant.train.v_s_max"].values
    assert force["drive"][5999] == pytest.approx(force["lag"][5999], rel=1e-3)
    risen = {k: np.argmax(f > 0.9 * 170e3) * H - 0.1 for k, f in force.items()}
    assert risen["lag"] == pytest.approx(0.05 * np.log(10), rel=0.02)
    assert risen["drive"] == pytest.approx(np.log(10) / (2 * np.pi * 100), rel=0.05)
    peak = creep["lag"].max()
    assert peak > 5
    assert np.abs(creep["drive"] - creep["lag"]).max() < 0.1 * peak
    assert log["plant.motor.loops.full"].values.max() < 1  # the voltage suffices
