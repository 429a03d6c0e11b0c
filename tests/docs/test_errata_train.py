"""Misprints of paper 003 that concern the train: resistance, motors, brakes; see test_errata."""

import numpy as np
import pytest
from errata import shows

from slipctl import Rail, Scenario, Section, connect, simulate
from slipctl.models.wang_2025 import hst_traction as hst
from slipctl.models.wheel_rail.contact import peak


def test_resistance_is_in_km_per_h():
    v = 200 / 3.6
    shows("003.5", "38.2", hst.resistance(v=v)["F_d"] / 1e3)
    shows("003.5", "55.6", v)
    shows("003.5", "7.3", (6.796 + 0.062 * v + 0.00143 * v**2) * 500 / 1e3)


def test_traction_limit_has_a_corner():
    shows("003.6", "305.6", 5.5e6 / 18 / 1e3)
    shows("003.6", "18.212", 5.5e6 / 302e3)
    assert float(hst.tractive_effort(18.212)) == pytest.approx(302e3, rel=1e-4)


def test_force_of_a_pad():
    p = {k: float(v) for k, v in hst.air_brake.param_values().items()}
    pad = np.pi / 4 * p["d_z"] ** 2 * p["p_max"] * p["gamma_z"] * p["eta_z"]
    shows("003.7", "0.170", p["d_z"])
    shows("003.7", "19.3", pad / 1e3)
    shows("003.7", "15.0", p["z"] * pad * p["phi_k"] * p["R_m"] / p["r"] / 1e3)
    _, outputs = hst.air_brake(p=450e3, F_cmd=0.0)
    assert outputs["F_b"] == pytest.approx(15e3, rel=1e-12)


def test_braking_has_32_axles():
    grip = peak(40.0, "ice").value * 153125
    shows("003.12", "87.9", 10 * grip / 1e3)
    shows("003.12", "281", 32 * grip / 1e3)
    shows("003.12", "480", 32 * 15.0)
    shows("003.12", "0.176", 10 * grip / 500e3)
    shows("003.12", "0.563", 32 * grip / 500e3)


@pytest.mark.second
def test_printed_33_feeds_a_slipping_wheel():
    found = {}
    for form in ("consistent", "printed-33"):
        loop = connect("loop", {"plant.F_contr": "F"}, plant=hst.plant(motor=hst.motor(form)))
        rail = Rail([Section(0, "ice"), Section(5, "oily")])
        log = simulate(loop, Scenario("s", 15.0, rail, inputs={"F": 250e3}, start={"v": 40.0}))
        power = 10 * float((log["plant.motor.T"] * log["plant.train.omega_d"])[-1, 0])
        found[form] = (float(log["plant.train.v_s_max"][-1]), power / 1e6)
        creep = log["plant.train.v_s_max"].values[-1000:]
        assert (np.diff(creep) > 0).all() == (form == "printed-33")
    shows("003.22", "29.3", found["consistent"][0])
    shows("003.22", "212", found["printed-33"][0])
    shows("003.22", "33.8", found["printed-33"][1])
