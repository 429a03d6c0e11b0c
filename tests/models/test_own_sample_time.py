"""A law of one's own that is slower than the controllers around it."""

from __future__ import annotations

from dataclasses import replace
from importlib import resources

import numpy as np
import pytest

from slipctl import BadInput, simulate
from slipctl.models.vehicle import OwnLaw, loop, scenario
from slipctl.models.vehicle.certificate import axle_loops
from slipctl.models.vehicle.trip import case
from slipctl.study.files import trip_files

SHIPPED = resources.files("slipctl.models.vehicle") / "files" / "metro.toml"
PI = """
[pi]
period = "{period}"
equations = '''
f+ = f + tick/T_f*(v_s - f)
I+ = clip(I + tick*Ki*(v_best - f), 0*T_lim, T_lim)
T_wanted = clip(Kp*(v_best - f) + I, 0*T_lim, T_lim)
'''
outputs = {{ T_wanted = "N m" }}
[pi.inputs]
v_s = {{ unit = "m/s", positive = "braking", per = "speed" }}
v_best = {{ unit = "m/s", positive = "braking", per = "speed" }}
[pi.parameters]
Kp = "1 kN s"
Ki = "2 kN"
T_f = "20 ms"
T_lim = "8 kN m"
[pi.states]
I = "2 kN m"
f = "0 m/s"
"""


def trip_of(folder, period, control=None):
    text = PI.format(period=period)
    (folder / "pi.toml").write_text(text, encoding="utf-8")
    trip = trip_files.load_trip(str(SHIPPED))
    own = {"pi": OwnLaw(block=f"{folder}/pi.toml:pi")}
    changed = replace(trip.control, period=control) if control else trip.control
    return replace(trip, controllers=own, control=changed, ensemble=None)


@pytest.mark.second
@pytest.mark.long
def test_it_holds_between_its_own_samples(tmp_path):
    trip = replace(trip_of(tmp_path, "10 ms"), duration=5.0, end="")
    log = simulate(loop(trip, "pi"), scenario(trip))
    wanted = log["ctl.law.T_wanted"].values
    moved = np.flatnonzero(np.any(np.diff(wanted, axis=0) != 0, axis=1)) + 1
    spread = np.unique(moved % 10)
    assert moved.size > 100
    assert spread.size <= wanted.shape[1]  # each axle in a tick of its own
    commands = log["ctl.T_cmd"].values
    assert (np.diff(commands, axis=0) != 0).any(axis=1).sum() > moved.size  # the demand moves each


@pytest.mark.parametrize("period", ["3 ms", "25 ms", "10.5 ms"])
def test_one_that_never_meets_the_controllers_is_refused(tmp_path, period):
    trip = trip_of(tmp_path, period, 0.01)
    with pytest.raises(BadInput, match=r"every 0\.01 s \(\[control\] period\)"):
        loop(trip, "pi")


@pytest.mark.second
def test_its_certificate_is_that_of_its_own_sample_time(tmp_path):
    """Between two samples nothing of it changes, so that a fast task around it adds nothing."""
    numbers = []
    for control in (0.001, 0.01):
        trip = trip_of(tmp_path, "10 ms", control)
        (gains,) = axle_loops.certificates(trip).gains
        numbers.append(gains.numbers(case(trip).loops["pi"]))
    assert numbers[0] == numbers[1]
    assert numbers[0]["T"] == 0.01


def test_a_lead_beside_a_slow_law_has_no_certificate(tmp_path):
    trip = trip_of(tmp_path, "10 ms")
    own = {"pi": replace(trip.controllers["pi"], lead=2.0)}
    trip = replace(trip, controllers=own)
    (gains,) = axle_loops.certificates(trip).gains
    with pytest.raises(BadInput, match="lead = 1"):
        gains.numbers(case(trip).loops["pi"])
