"""A state machine of a vehicle file is tuned, and what is found is proved by cells."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest

from slipctl.certify import catalogue
from slipctl.certify.promise import CERTIFIED, UNDECIDED
from slipctl.commands.cli import main
from slipctl.design import gain_files, promises
from slipctl.design.goals import Proved
from slipctl.design.promises import Promises
from slipctl.study import resolve
from slipctl.study.request import Request
from tests.leaves_trip import leaves_trip

MACHINE = """
[wsp]
doc = "Fills, holds and vents by the slip"
equations = \"\"\"
mode+ = 2 if v_s > s_hi else (1 if v_s > s_lo else 0)
T_wanted = 0*T_top if mode > 1.5 else (T_top if mode < 0.5 else T)
\"\"\"
outputs = { T_wanted = "N m" }
[wsp.inputs]
v_s = { unit = "m/s", doc = "slip", positive = "braking", per = "speed" }
T = { unit = "N m", doc = "brake torque", positive = "braking" }
[wsp.parameters]
s_hi = "1.2 m/s in 0.1 .. 30"
s_lo = "0.7 m/s in 0.1 .. 30"
T_top = "9 kN m"
[wsp.states]
mode = { start = 0 }
"""
"""Its numbers are proved to stay below 3 m/s; one that vents from 2 m/s on comes to 3.6 m/s."""

ACTUATOR = """kind = "valve"
torque = "9 kN m"
fill = "100 ms"
vent = "100 ms"
"""

REST = """[control]
period = "10 ms"
[certify]
slip = "3 m/s"
[ensemble]
[ensemble.draw]
m = "36 t:40 t"
[controllers.wsp]
kind = "file"
block = "wsp.toml:wsp"
"""


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "wsp.toml").write_text(MACHINE, encoding="utf-8")
    (tmp_path / "t.toml").write_text(leaves_trip(ACTUATOR, REST), encoding="utf-8")


@pytest.mark.parametrize("last", [True, False])
def test_a_margin_is_that_up_to_which_every_one_is_proved(last, monkeypatch):
    """What is proved beyond a gap counts for nothing, in steps and in halvings."""
    gains = SimpleNamespace(name="stable")
    asked = Promises((gains,), kept=("stable",))
    monkeypatch.setattr(promises, "is_last", lambda of: last)

    def margin(*gaps):
        def verdict(self, of, loop, m=1.0):
            return UNDECIDED if any(a <= m < b for a, b in gaps) else CERTIFIED

        monkeypatch.setattr(Promises, "verdict", verdict)
        return asked.margin(gains, None)

    assert margin() == (promises.MARGINS[-1] if last else promises.FARTHEST)
    assert margin((0.0, 1.1)) == 0
    assert margin((1.05, 1e9)) == (1.0 if last else pytest.approx(1.05, rel=0.01))
    assert margin((1.2, 1.3)) == (1.0 if last else promises.FARTHEST)
    assert margin((1.3, 1e9)) == (1.25 if last else pytest.approx(1.3, rel=0.01))
    assert margin((1.3, 5.0), (6.0, 7.0)) == (1.25 if last else pytest.approx(1.3, rel=0.01))


def test_what_is_asked_is_the_bounds_as_they_are_unless_a_margin_is_said(monkeypatch):
    gains = SimpleNamespace(name="stable", numbers=lambda loop: {})
    of = Promises((gains,), (Proved("margin>=1.5", "", 1.5),))
    assert of.needed() == [(gains, 1.5, "margin>=1.5")]
    kept = Promises((gains, SimpleNamespace(name="other")), kept=("stable",))
    assert kept.needed() == [(gains, 1.0, "stable.certified")]
    monkeypatch.setattr(promises.catalogue, "system_of_gains", lambda gains, loop: "system")
    monkeypatch.setattr(promises, "exact_numbers", lambda system, numbers: numbers)
    monkeypatch.setattr(promises, "with_margin", lambda system, numbers, margin: margin)
    monkeypatch.setattr(promises, "is_last", lambda of: False)
    monkeypatch.setattr(promises.proofs, "decide",
                        lambda system, margin: SimpleNamespace(verdict=margin))  # fmt: skip
    assert of.asked(gains, None) == ("system", 1.0)
    assert of.decision(gains, None).verdict == of.verdict(gains, None) == 1.0
    assert of.verdict(gains, None, 2.0) == 2.0


def test_a_proof_is_written_of_the_bounds_and_of_the_margin_that_is_asked(monkeypatch):
    """One that nobody asks for is written once."""
    gains = tuple(SimpleNamespace(name=n) for n in ("asked", "beside"))
    of = Promises(gains, (Proved("asked.margin>=1.5", "asked", 1.5),))
    found = SimpleNamespace(tuned_loop=lambda: "loop", promises=of, frees=(), gains={}, name="x",
                            statement=None)  # fmt: skip
    monkeypatch.setattr(gain_files, "certificate", lambda g, loop, of, margin: (g.name, margin))
    exact = gain_files.certificate_of(found, "slipctl tune")["exact"]
    assert [e["certificate"] for e in exact] == [("asked", 1.0), ("asked", 1.5), ("beside", 1.0)]
    assert [float(e["bounds_times"]) for e in exact] == [1.0, 1.5, 1.0]


@pytest.mark.long
def test_a_machine_is_tuned_to_one_that_is_proved(capsys, tmp_path):
    """The largest slip is wanted, so the proof decides; the file is checked without a search."""
    line = ["tune", "t.toml:wsp", "--free", "s_hi=1:8", "--minimise=-slip_max",
            "--subject-to", "wsp.certified", "--samples", "4", "--runs", "40", "--held-out", "4",
            "--out", "out", "--json"]  # fmt: skip
    assert main(line) == 0
    found = json.loads(capsys.readouterr().out)
    best = float(found["gains"]["ctl.law.s_hi"]["value"])
    assert 1 <= best < 2
    assert main(["check", "out/certificate.json"]) == 0
    said = json.loads((tmp_path / "out" / "certificate.json").read_text(encoding="utf-8"))
    assert {e["certificate"]["verdict"] for e in said["exact"]} == {CERTIFIED}


@pytest.mark.long
def test_a_machine_without_a_proof_is_refused_by_the_runs_of_another_one():
    """What leaves the bound in such a run is not certified, and its own search says REFUTED."""
    study = resolve.load_study("t.toml")
    gains = next(g for g in study.certificates.gains if g.loop == "wsp")
    loop = Request.of(study, "wsp", []).chosen[0]
    promises = Promises((gains,), kept=(gains.name,))
    late = loop.with_params(**{"ctl.law.s_hi": 6.0})
    assert not promises.fails(late)  # no run is known
    assert promises.verdict(gains, loop) == CERTIFIED
    assert not promises.fails(loop)
    assert promises.fails(late) == f"{gains.name}.certified"
    assert promises.verdict(gains, late) != CERTIFIED
    assert promises.fails_last(late)
    assert not promises.fails_last(loop)
    system = catalogue.system_of_gains(gains, loop)
    runs = system.loop.worst_runs(promises.asked(gains, loop)[1])
    assert all(np.isin(signs, (-1, 1)).all() for _, signs in runs)
    assert not system.loop.exceeds(promises.asked(gains, loop)[1], runs)
