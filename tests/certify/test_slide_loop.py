"""A state machine of a vehicle file: asked with its own block, its brake and a short axle."""

from __future__ import annotations

import copy
import json

import pytest

from slipctl.certify import catalogue, proofs
from slipctl.certify.cells.mode_runs import worst_runs
from slipctl.certify.entries import DoesNotHold
from slipctl.certify.promise import CERTIFIED, REFUTED, exact_numbers
from slipctl.errors import BadInput
from slipctl.study import resolve
from slipctl.study.request import Request
from tests.leaves_trip import leaves_trip

LAW = """
[wsp]
doc = "Holds above a slip, and never vents; or vents"
equations = \"\"\"
mode+ = 2*vents if v_s > s_hi else (1 if v_s > s_lo else 0)
T_wanted = 0*T_top if mode > 1.5 else (T_top if mode < 0.5 else T)
\"\"\"
outputs = { T_wanted = "N m" }
[wsp.inputs]
v_s = { unit = "m/s", doc = "slip", positive = "braking", per = "speed" }
T = { unit = "N m", doc = "brake torque", positive = "braking" }
[wsp.parameters]
s_hi = "1.2 m/s"
s_lo = "0.7 m/s"
T_top = "9 kN m"
vents = VENTS
[wsp.states]
mode = { start = 0 }
"""


def trip_of(asked):
    """Text of the vehicle's file, with the keys of its table ``[certify]``."""
    return leaves_trip(
        """kind = "valve"
torque = "9 kN m"
fill = "100 ms"
vent = "100 ms"
""",
        f"""[certify]
{asked}
[controllers.wsp]
kind = "file"
block = "wsp.toml:wsp"
""",
    )


def system_of(folder, vents, asked):
    (folder / "wsp.toml").write_text(LAW.replace("VENTS", str(vents)), encoding="utf-8")
    (folder / "t.toml").write_text(trip_of(asked), encoding="utf-8")
    study = resolve.load_study("t.toml")
    gains = next(g for g in study.certificates.gains if g.loop == "wsp")
    loop = Request.of(study, "wsp", []).chosen[0]
    system = catalogue.system_of_gains(gains, loop)
    numbers = {k: float(v) for k, v in gains.numbers(loop).items()}
    return system, exact_numbers(system, numbers)


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.mark.long
def test_a_machine_that_never_vents_locks_the_wheel_and_the_run_replays(tmp_path):
    """Without the vehicle too: the file holds the tick. Another start is no counterexample."""
    system, numbers = system_of(tmp_path, 0.5, "push = '0.1 m/s^2'")
    assert float(numbers["band"]) == 10
    payload = proofs.write(system, numbers)
    assert payload["verdict"] == REFUTED
    payload = json.loads(json.dumps(payload))
    proofs.check(system, payload)
    proofs.check(catalogue.OF_LOOPS["slide_loop"], payload)
    bad = copy.deepcopy(payload)
    bad["asked"]["band"]["value"] = "1000"
    with pytest.raises((DoesNotHold, BadInput)):
        proofs.check(system, bad)
    bad = copy.deepcopy(payload)
    bad["counterexample"]["run"]["loop"]["start"][0] = ["9", "9"]
    with pytest.raises((DoesNotHold, BadInput)):
        proofs.check(catalogue.OF_LOOPS["slide_loop"], bad)


@pytest.mark.long
def test_its_mode_is_a_mode_and_its_slip_is_that_of_the_brake(tmp_path):
    """Real are the slip and the pressure; the machine that vents stays far below a locked wheel."""
    system, numbers = system_of(tmp_path, 1, "slip = '0.9 m/s'")
    loop = system.loop.build(numbers)
    assert len(loop.reals) == 2
    assert len(loop.modes) == 1
    far = worst_runs(loop, 600).worst["s", 1][0]
    assert 0.9 < far < 5
    assert proofs.decide(system, numbers).verdict == REFUTED


@pytest.mark.long
def test_a_machine_of_a_vehicle_file_is_certified_near_its_worst_run(tmp_path):
    """At most 1.45 times what runs come to; the file is checked without the vehicle too."""
    system, numbers = system_of(tmp_path, 1, "slip = '2.2 m/s'")
    payload = json.loads(json.dumps(proofs.write(system, numbers)))
    assert payload["verdict"] == CERTIFIED
    far = worst_runs(system.loop.build(numbers), 1000).worst["s", 1][0]
    assert 2.2 / 1.45 < far < 2.2
    proofs.check(catalogue.OF_LOOPS["slide_loop"], payload)
