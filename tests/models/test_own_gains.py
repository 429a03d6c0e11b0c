"""Certificates of slip laws of one's own: bounds from their equations, and why there are none."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slipctl.certify import catalogue
from slipctl.certify.systems import report
from slipctl.commands.cli import main
from slipctl.study.resolve import find_loop, load_study

CAR = """
title = "car"
duration = "1 s"
[vehicle]
mode = "brake"
mass = "10 t"
axles = 1
radius = "0.42 m"
inertia = "110 kg m^2"
speed = "50 km/h"
[actuator]
kind = "lag"
torque = "15 kN m"
lag = "2 ms"
[rail]
law = "double_exponential"
[[rail.sections]]
place = "0 m"
condition = "dry"
[demand]
kind = "constant"
deceleration = "1.2 m/s^2"
[reference]
kind = "speed"
slip = "1 m/s"
[controllers.mine]
kind = "file"
block = "mine.toml:soft"
k = "90 1/s"
"""
INPUTS = {
    "v_s": '{ unit = "m/s", doc = "slip speed", positive = "braking", per = "speed" }',
    "v_best": '{ unit = "m/s", doc = "slip to hold", positive = "braking", per = "speed" }',
    "D": '{ unit = "m/s^2", doc = "what the slip falls by", positive = "braking" }',
    "T": '{ unit = "N m", doc = "torque", positive = "braking" }',
}
PARAMETERS = {"J": "110 kg m^2", "r": "0.42 m", "k": "30 1/s", "q": "5 s/m^2"}
TEXT = "J/r*(D + k*(v_best - v_s) + q*(v_best - v_s)**3)"


def made(tmp_path: Path, text: str) -> Any:
    """Study of a car with this law."""
    rows = [f'[soft]\nT_wanted = "{text}"', "[soft.inputs]"]
    rows += [f"{n} = {told}" for n, told in INPUTS.items() if re.search(rf"\b{n}\b", text)]
    rows += ["[soft.parameters]"]
    rows += [f'{n} = "{v}"' for n, v in PARAMETERS.items() if re.search(rf"\b{n}\b", text)]
    (tmp_path / "mine.toml").write_text("\n".join(rows) + "\n")
    (tmp_path / "car.toml").write_text(CAR)
    return load_study(str(tmp_path / "car.toml"))


def test_the_bounds_hold_of_every_tick_of_the_law(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the tube s' = -g1 e + d with |d| <= D at random slips; behind its lag no run leaves."""
    monkeypatch.chdir(tmp_path)
    study = made(tmp_path, TEXT)
    late, prompt = study.certificates.gains
    loop = find_loop(study, "mine")[0]
    n = {k: float(v) for k, v in late.numbers(loop).items()}
    assert n["lag"] == pytest.approx(2e-3)
    assert report(catalogue.system(late.system), n).verdict == "CERTIFIED"
    assert "lag" not in prompt.numbers(loop)
    # written anew: D of the plant, the law, and what it is told
    rng = np.random.default_rng(1)
    m, J, r, k, q, v_best = 10e3, 110.0, 0.42, 90.0, 5.0, 1.0
    mu = lambda s: 1.0 * np.exp(-0.54 * s) - np.exp(-1.2 * s)  # noqa: E731
    D = lambda s: (r**2 / J + 1 / m) * mu(s) * m * 9.81  # noqa: E731
    for _ in range(2000):
        e = rng.uniform(-n["band"], n["band"])
        told = D(v_best + e * rng.uniform(-1, 1))
        rate = told + k * -e - q * e**3 - D(v_best + e)
        assert abs(rate + n["g1"] * e) <= n["D"]
    costs = late.costs(loop)
    assert 0 < costs["tube"] < 1


@pytest.mark.parametrize(("text", "said"), [
    ("J/r*(D + k*(v_best - v_s)) + T", "it hears T"),
    ("J/r*(D + k*v_best)", "it does not hear v_s"),
])  # fmt: skip
def test_why_there_is_none(
    text: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """One line that says what of the law is in the way, with exit code 2."""
    monkeypatch.chdir(tmp_path)
    study = made(tmp_path, text)
    assert said in study.certificates.uncertified["mine"]
    assert not study.certificates.gains
    assert main(["certify", "car.toml:mine"]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1


def test_a_law_that_jumps_in_its_tube_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """No slope bounds a jump; the line says where it is."""
    monkeypatch.chdir(tmp_path)
    made(tmp_path, "J/r*(D + k*(2*v_best - v_s if v_s < v_best else v_best - v_s))")
    assert main(["certify", "car.toml:mine"]) == 2
    assert "may jump by" in capsys.readouterr().err


def test_a_law_that_rests_beside_its_reference_is_refuted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without D a proportional law rests where the torque balances the adhesion, not at v_best."""
    monkeypatch.chdir(tmp_path)
    study = made(tmp_path, "J/r*k*(2*v_best - v_s)")
    prompt = study.certificates.gains[1]
    n = {k: float(v) for k, v in prompt.numbers(find_loop(study, "mine")[0]).items()}
    assert report(catalogue.system(prompt.system), n).verdict == "REFUTED"
    assert n["g1"] == pytest.approx(90.0, rel=1e-6)
