"""Points of the prior are parameters: one curve for fit and search, in Python, C and A2L."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from slipctl import (
    Input,
    Output,
    Param,
    argmax,
    argmax_block,
    differential_evolution,
    law,
    particle_swarm,
    rls,
)
from slipctl.block.shared_numbers import warnings_of_places
from slipctl.ccode import codegen
from slipctl.ccode.compile import compilers
from slipctl.ccode.module import guard
from slipctl.commands import cli
from slipctl.errors import BadInput
from slipctl.models.zhang_2021 import hst_braking as models
from slipctl.models.zhang_2021 import hst_braking_control as control

POINTS = ("a0_at", "a1_at", "a2_at")
OTHER = {"a0_at": [0.1, 0.2, 0.4], "a1_at": [30.0, 22.0, 15.0], "a2_at": [0.08, 0.15, 0.1]}
"""Three rails that are not those of the paper."""

needs_compiler = pytest.mark.skipif(compilers.first_compiler() is None, reason="no C compiler here")


@pytest.fixture(scope="module")
def eppfc():
    return control.controller(control.prescribed(), "fitted")


def test_curve_goes_through_the_points_that_are_set():
    """At each height it is Burckhardt's curve; between, log a1 is numpy's parabola."""
    family = control.family().with_params(**OTHER)
    for a0, a1, a2 in zip(*OTHER.values(), strict=True):
        wanted = models.burckhardt(lam=0.1, a0=a0, a1=a1, a2=a2)["mu"]
        assert family(lam=0.1, a0=a0)["mu"] == pytest.approx(wanted, rel=1e-12)
    at, a1, a2 = (np.array(v) for v in OTHER.values())
    for a0 in (0.05, 0.13, 0.29, 0.7):
        x = np.clip(a0, at[0], at[2])
        steep, share = (np.exp(np.polyval(np.polyfit(at, np.log(y), 2), x)) for y in (a1, a2 / at))
        wanted = models.burckhardt(lam=0.2, a0=a0, a1=steep, a2=share * a0)["mu"]
        assert family(lam=0.2, a0=a0)["mu"] == pytest.approx(wanted, rel=1e-12)


def test_one_curve_for_fit_and_search(eppfc):
    """A point is one number of the loop; set apart in one part, it says so."""
    assert set(POINTS) <= set(eppfc.params)
    assert not [n for n in eppfc.params if n.endswith(POINTS) and "." in n]
    apart = eppfc.with_params(**{"search.a1_at": OTHER["a1_at"]})
    assert warnings_of_places(apart) == ["search.a1_at differs from a1_at"]
    values = apart.param_values()
    assert values["search.log_a1"] == pytest.approx(np.log(OTHER["a1_at"]))
    assert values["log_a1"] == pytest.approx(np.log([26.731, 24.617, 23.129]))


@law(y=Output("1", "height", lo=-1e3, hi=1e3))
def hill(
    x=Input("1", "place"),
    top=Param("1", 1.0, "place of the top", lo=0, hi=10),
    bend=Param("1", [2.0, 0.5], "curvature, steepness of the sides", shape=(2,), lo=0.1, hi=10),
    twice=Param("1", "2 * bend", "derived of what is known", shape=(2,), lo=0, hi=20),
):
    """A hill, from its place and a known vector; its top is at top + bend[1] / (2 bend[0])."""
    return twice[1] / 2 * x - bend[0] * (x - top) ** 2


SEARCHES = {
    "argmax_block": (lambda: argmax_block(hill, "x", lo=0.0, hi=5.0), "best", 1e-9),
    "evolution": (lambda: differential_evolution(hill, "x", lo=0.0, hi=5.0), "best", 1e-2),
    "evolution in ticks": (
        lambda: differential_evolution(hill, "x", lo=0.0, hi=5.0, generations=20,
                                       generations_per_tick=10), "best", 1e-1),
    "swarm": (lambda: particle_swarm(hill, {"x": (0.0, 5.0)}), "x", 1e-2),
}  # fmt: skip


@pytest.mark.parametrize("name", SEARCHES)
def test_vectors_of_a_searched_law_are_known(name):
    """Scalars are asked as inputs, a vector is a parameter, and what is derived of it with it."""
    make, best, close = SEARCHES[name]
    block = make()
    assert list(block.inputs) == ["top"]
    assert {"bend", "twice"} <= set(block.params)
    for bend in ([2.0, 0.5], [0.5, 1.5]):
        wanted = 1.5 + bend[1] / (2 * bend[0])
        if name == "swarm":
            wanted = 0.0 if wanted > 2.5 else 5.0  # it minimises: the end that is further off
        state, there = block.start(), {}
        for _ in range(4):
            given = {**state, "top": 1.5, "bend": bend}
            state, there = block(**given) if state else ({}, block(**given))
        assert there[best] == pytest.approx(wanted, rel=close, abs=close)
        if name == "swarm":
            continue
        bent = hill.with_params(bend=bend)
        found = argmax(bent, "x", lo=0.0, hi=5.0, at={"top": 1.5})
        assert found.location == pytest.approx(wanted, rel=1e-12)


def test_vectors_of_a_fitted_law_are_known():
    """Only scalars are estimated; samples of one curve give its top, with the vector set."""
    fit = rls(hill, form="window", start={"top": 1.0}, noise=1e-3).with_params(bend=[0.5, 1.5])
    assert "theta" in fit.states
    assert fit.states["theta"].shape == (1,)
    state = fit.start()
    for x in np.linspace(0, 3, 40):
        y = hill(x=float(x), top=1.7, bend=[0.5, 1.5])["y"]
        state, out = fit(**{**state, "x": float(x), "y": y})
    assert out["top"] == pytest.approx(1.7, rel=1e-6)


def test_heights_that_do_not_rise_are_refused(eppfc):
    with pytest.raises(BadInput, match=r"a0_at goes from 0.2 to 0.2 1; the places of a table must"):
        eppfc.with_params(a0_at=[0.2, 0.2, 0.3])
    with pytest.raises(BadInput, match="log_a1 is derived"):
        eppfc.with_params(log_a1=[1.0, 2.0, 3.0])


def test_no_constant_of_the_prior_is_left_in_the_text(eppfc, tmp_path: Path):
    """Numbers of the rails stand in the defaults and nowhere else; nor do their logarithms."""
    codegen.c_module(eppfc, tmp_path, "ctl")
    text = "".join(p.read_text() for p in (tmp_path / "ctl.c", *tmp_path.glob("ctl_parts*")))
    rails = [[r[n] for r in models.RAILS.values()] for n in ("a0", "a1", "a2")]
    numbers = {v for values in rails for v in values}
    numbers |= {float(v) for v in np.log(rails[1])}
    numbers |= {float(v) for v in np.log(np.divide(rails[2], rails[0])) if v}
    equations = re.sub(r"defaults = \{.*?\};", "", text, flags=re.DOTALL)
    found = {float(x) for x in re.findall(r"(?<![\w.])\d+\.\d+(?:e[+-]?\d+)?", equations)}
    assert not [a for a in numbers if any(abs(a - b) < 1e-9 * abs(a) for b in found)]
    assert ".a1_at = {26.731, 24.617, 23.129}" in text


def test_curves_over_their_heights_in_the_description(eppfc, tmp_path: Path):
    codegen.c_module(eppfc, tmp_path, "ctl")
    text = (tmp_path / "ctl.a2l").read_text()
    assert re.search(r"/begin AXIS_PTS ctl_param\.a0_at .*\n .* 3 0\.0001 2\.0\n", text)
    for name in ("a1_at", "a2_at"):
        found = re.search(
            rf"/begin CHARACTERISTIC ctl_param\.{name} .*\n  CURVE (?s:.*?)/end CHAR", text
        )
        assert found, name
        assert "AXIS_PTS_REF ctl_param.a0_at\n" in found[0]


@pytest.mark.second
@needs_compiler
@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.others("long")
def test_changed_points_in_c_are_those_in_python(eppfc, real: str, tmp_path: Path):
    """The module with other points is the block with them, and not the one without."""
    n = 400
    lam = 0.12 - 0.05 * np.cos(np.linspace(0, 12, n))  # past the peak and back
    v = np.linspace(50.0, 48.0, n)
    mu = [models.burckhardt(lam=float(x), **models.RAILS["wet"])["mu"] for x in lam]
    T_b = 0.43 * 13800 * 9.81 / 4 * np.array(mu)
    omega = v * (1 - lam) / 0.43
    inputs = {"v": v, "lam": lam, "omega": omega, "T_b": T_b, "a_demand": np.full(n, 15.0)}
    module = codegen.c_module(eppfc, tmp_path, "ctl", real=real).compile().load()
    found = {}
    for name, points in (("own", {}), ("other", OTHER)):
        block = eppfc.with_params(**points)
        state, best = block.start(), []
        for k in range(n):
            state, out = block(**{**state, **{i: float(x[k]) for i, x in inputs.items()}})
            best.append(out["search.best"])
        got = module.reset(**points).replay(inputs)["search.best"]
        assert not (module.status & ~16).any()  # outputs may be limited
        assert got == pytest.approx(best, rel=1e-9 if real == "double" else 2e-3)
        found[name] = np.array(best)
    assert np.abs(found["own"] - found["other"]).max() > 0.01


@needs_compiler
def test_heights_that_do_not_rise_are_refused_by_tune(eppfc, tmp_path: Path):
    module = codegen.c_module(eppfc, tmp_path, "ctl").compile().load()
    module.reset()
    at = np.flatnonzero(np.isclose(module._param, 0.1646))[0]
    assert np.allclose(module._param[at : at + 3], [0.1646, 0.2546, 0.3546])
    module._param[at + 1] = 0.1
    assert module._call("tune", module._param, module._state) == guard.BAD_PARAM
    module._param[at + 1] = 0.2546
    assert module._call("tune", module._param, module._state) == 0


@pytest.mark.second
@pytest.mark.long
def test_points_are_set_by_the_command(tmp_path: Path, capsys):
    """A list, each with its unit; another number of them is refused in one line."""
    assert cli.main(["c", "hst_braking:eppfc", "--set", "ctl.a1_at=[30, 26, 24]",
                     "--out", str(tmp_path / "c")]) == 0  # fmt: skip
    text = (tmp_path / "c" / "hst_braking_eppfc.c").read_text()
    assert ".a1_at = {30.0, 26.0, 24.0}" in text
    for given, words in (("[30, 26]", "takes an array (3,) in 1"), ("[a, b, c]", "is no number")):
        assert cli.main(["c", "hst_braking:eppfc", "--set", f"ctl.a1_at={given}",
                         "--out", str(tmp_path / "none")]) == 2  # fmt: skip
        assert words in capsys.readouterr().err
        assert not (tmp_path / "none").exists()
