"""Blocks written as text: they are blocks as any other, and every fault says where it stands."""

from __future__ import annotations

import math
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipctl import BadInput, Rail, Scenario, Section, from_text, simulate
from slipctl.analysis.bounds import largest_slope
from slipctl.commands.cli import main
from slipctl.draw import show
from slipctl.errors import Faults
from slipctl.models.huang_2020.subway_braking import double_exponential
from slipctl.study import resolve
from slipctl.study.files import equation_files

LAW = (
    "mu = c*(exp(-a*v_s) - exp(-b*v_s)) where v_s [m/s], c = 1 in 0 .. 5, a = 0.54 s/m, b = 1.2 s/m"
)
PI = """
e_g = g*e
z+ = z + tick*(rate*e_g - leak*z)   # leaky integral
T = clip(e_g + z,
         0, T_max)
"""
MEANS = {
    "inputs": {"e": "m/s in -30 .. 30"},
    "parameters": {"g": "12 kN s", "rate": "3 1/s", "leak": "0.5 1/s", "T_max": "8 kN m"},
    "states": {"z": "1 kN m"},
    "outputs": {"T": "N m"},
}


def test_the_same_as_python() -> None:
    """A law as text has the bits, slopes, units and equations of the same law in Python."""
    ours, theirs = from_text(LAW), double_exponential
    slopes = [b.jacobian("mu", ["v_s", "c", "a", "b"]) for b in (ours, theirs)]
    for v_s in (0.0, 0.3, 1.21, 20.0):
        assert ours(v_s=v_s) == theirs(v_s=v_s)
        a, b = (np.array(J(v_s, 1.0, 0.54, 1.2)) for J in slopes)
        assert (a == b).all()
    assert ours.check_units() == []
    assert {s.name: s.unit for s in ours.signals} == {s.name: s.unit for s in theirs.signals}
    equations = [
        show.text(b).partition("Equations")[2].partition("\n\n")[0] for b in (ours, theirs)
    ]
    assert equations[0] == equations[1]


def test_controller_with_a_state() -> None:
    """Ten ticks against the difference equation in floats; units of kN become SI."""
    block = from_text(PI, period="2 ms", **MEANS)
    assert (block.kind, block.period, list(block.outputs)) == ("step", 0.002, ["T"])
    assert "e_g = g*e" in show.text(block)  # an intermediate result keeps its letter
    log = simulate(block, Scenario("ramp", 0.02, inputs={"e": lambda t: 20 * t - 0.1}))
    z = 1000.0
    for k in range(10):
        e = 20 * (k * 0.002) - 0.1
        # 1e-12: a handful of roundings
        assert log["T"].values[k] == pytest.approx(min(max(12e3 * e + z, 0), 8e3), rel=1e-12)
        z = z + 0.002 * (3 * 12e3 * e - 0.5 * z)


def test_flow_and_tables() -> None:
    """x' is continuous; a table by points is straight between them, in SI."""
    block = from_text(
        "v' = -F(v)/m", states={"v": "20 m/s"}, parameters={"m": "2 t"},
        tables={"F": {"over": "km/h", "unit": "kN", "points": [[0, 10], [36, "8000 N"], [72, 2]]}},
    )  # fmt: skip
    assert block.kind == "flow"
    for v, force in ((0.0, 10e3), (5.0, 9e3), (10.0, 8e3), (15.0, 5e3), (30.0, 2e3)):
        slope, _ = block(v=v)
        assert slope["v"] == pytest.approx(-force / 2000, rel=1e-12)  # a few roundings


def test_tables_of_a_step_are_parameters() -> None:
    """Places that rise and heights over them, in SI; with another height it is another curve."""
    tables = {"F": {"over": "km/h", "unit": "kN", "points": [[0, 10], [36, 8], [72, 2]]}}
    text = "x+ = x + tick*v; f = F(v) where v [m/s], x [m] = 0"
    block = from_text(text, tables=tables, period="10 ms")
    at, there = block.params["F_at"], block.params["F_there"]
    assert (at.unit, at.value, at.rising) == ("m/s", (0.0, 10.0, 20.0), True)
    assert (there.unit, there.value, there.over) == ("N", (10e3, 8e3, 2e3), "F_at")
    assert block(v=15.0, x=0.0)[1]["f"] == 5e3
    assert block(v=15.0, x=0.0, F_there=[1, 2, 3])[1]["f"] == 2.5
    with pytest.raises(BadInput, match=r"F_at goes from 3 to 2 m/s; the places of a table must"):
        block(v=15.0, x=0.0, F_at=[0, 3, 2])
    with pytest.raises(Faults, match="F_at is a parameter of the table F and a name of its own"):
        from_text(text.replace("F(v)", "F(v) + F_at") + ", F_at = 2 N", tables=tables,
                  period="10 ms")  # fmt: skip
    law = from_text("f = F(v) where v [m/s]", tables=tables)
    assert not law.params  # what is searched and fitted


def test_swapped_and_certified() -> None:
    """It replaces the law of a loop, and its slope is bounded by the proof of any block."""
    from conftest import closed_loop

    loop = closed_loop()
    other = loop.swap("plant.adh", from_text(LAW))
    rail = Rail([Section(0, None)])
    scenario = Scenario("short", 0.05, rail, inputs={"v_opt": 1.2, "a_demand": 0.0})
    known = set(loop.inputs)
    scenario = scenario.but(inputs={k: v for k, v in scenario.inputs.items() if k in known})
    a, b = (simulate(x, scenario, compile=False) for x in (loop, other))
    assert all((a[n].values == b[n].values).all() for n in b)
    bound = largest_slope(from_text(LAW), "mu", "v_s", {"v_s": (0.0, 5.0)})
    true = 1.2 - 0.54  # at v_s = 0: c (b - a), the steepest place of this law
    assert true <= bound.value <= 1.002 * true  # 0.1 % is what largest_slope promises


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("mu = c*v where v_s [m/s], c = 1 s/m", ["mu: column 8: 'v' is not declared"]),
        ("mu = k*v_s where v_s [m/s], kk = 1 s/m", ["column 6: 'k' is not declared; did you mean"]),
        ("mu = c*v_s where v_s [m/s], c = 1 s/m, d = 3", ["d: the parameter d is used nowhere"]),
        ("mu = v_s + 3 where v_s [m/s]",
         ["column 6: 'v_s' [m/s] cannot be added to '3' [1]; give the number its unit"]),
        ("mu = exp(-a*v) + exp(b*v) where v [m/s], a = 1, b = 2",
         ["column 6: exp takes", "column 18: exp takes"]),
        ("F [N] = 3", ["is no equation"]),
        ("F = m*v where F [N], m = 3 kg, v [m/s]", ["column 5: this is [N s], not [N]"]),
        ("F = m*a where F [kN], m = 3 t, a [m/s^2]",
         ["column 5: this is [N], not [kN]; numbers are kept in SI, say F [N]"]),
        ("mu = v where v [mm/ss]", ["v: unit 'mm/ss' cannot be read"]),
        ("mu = c where c = 3 in 5 .. 9", ["out of range"]),
        ("mu = c where c = 3 in 9 .. 5", ["c: its range begins at 9, above its end 5"]),
        ("mu = c where c = three", ["c: 'three' is no number with a unit"]),
        ("mu = 1; mu = 2", ["mu has two equations"]),
        ("a = b; b = a", ["a, b need one another"]),
        ("x' = 1; y+ = 1 where x [1] = 0, y [1] = 0", ["one block has one of them"]),
        ("x+ = x", ["the state x needs its unit and start"]),
        ("x+ = tick*x where x [1] = 0", ["tick is the period of a step"]),
        ("exp = 3", ["exp is a function or constant; write exp_"]),
        ("lambda = 3", ["is a word of the grammar"]),
        ("mu = c on wet: d = 3 where c = 1", ["there is no parameter 'd'"]),
        ("mu = foo(v)*c where v [m/s", ["there is no function foo"]),
        ("a = v + m; b = a*v; c = 2*v; d = c - m where v [m/s], m [kg]",
         ["a: column 5: 'v' [m/s] cannot be added", "d: column 34: "]),
        ("mu = c on wet c = 2 on icy d = 3 where c = 1", ["'on wet c = 2'", "'on icy d = 3'"]),
        ("", ["there is no equation"]),
    ],
)  # fmt: skip
def test_faults(text: str, said: list[str]) -> None:
    """Each fault says where it is, what it is and what would be right."""
    with pytest.raises(Faults) as told:
        from_text(text)
    for part in said:
        assert any(part in line for line in told.value.lines), told.value.lines


FILE = """\
# two blocks
[law]
mu = "c*(exp(-a*v_s) - exp(-b*v_s))"
[law.inputs]
v_s = "m/s"
[law.parameters]
c = "1.0 in 0 .. 5"
a = { value = "0.54 s/m", doc = "slow" }
b = "1.2 s/m"
[law.conditions]
dry = { c = 1.0 }
wet = { c = 0.4, a = "0.6 s/m" }

[other]
"x'" = "-k*x"
parameters = { k = "2 1/s" }
states = { x = "1 m" }
"""


def test_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A table of a TOML file is a block; all faults of it are told, each with its line."""
    file = tmp_path / "own.toml"
    file.write_text(FILE)
    law = resolve.load_block(f"{file}:law")
    assert law.conditions == {"dry": {"c": 1.0}, "wet": {"c": 0.4, "a": 0.6}}
    assert law(v_s=1.0) == double_exponential(v_s=1.0)
    assert resolve.load_block(f"{file}:other")(x=3.0)[0] == {"x": -6.0}
    with pytest.raises(BadInput, match="has several blocks"):
        resolve.load_block(str(file))
    file.write_text(FILE.replace("exp(-a", "exq(-a").replace('"1.2 s/m"', '"1.2 s/q"'))
    assert main(["show", f"{file}:law"]) == 2
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 2
    assert f"{file}, line 3: law.mu: column 4: there is no function exq" in told[0]
    assert f"{file}, line 9: law.parameters.b: " in told[1]


def test_line_of_a_key() -> None:
    """Keys in tables, inline tables and texts of several lines are found; a comment is no line."""
    text = 'title = """\na\n"""\n\n# x\n[a]\nb = 1\n[a.c]\nd = { e = 3 }\n'
    places = {("title",): 1, ("a",): 6, ("a", "b"): 7, ("a", "c", "d"): 9, ("a", "c", "d", "e"): 9,
              ("a", "z"): 6, ("x", "a"): 1, ("a", "x", "b"): 6}  # fmt: skip
    assert {keys: equation_files.line_of(text, keys) for keys in places} == places


def test_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A law typed in the command line is shown, and fitted to points that it made itself."""
    assert main(["show", LAW]) == 0
    assert "mu = c*(exp(-a*v_s) - exp(-b*v_s))" in capsys.readouterr().out
    v = np.linspace(0.1, 6, 30)
    mu = 0.4 * (np.exp(-0.6 * v) - np.exp(-1.5 * v))
    curve = tmp_path / "curve.csv"
    rows = [f"{x:.10g},{y:.10g}" for x, y in zip(v, mu, strict=True)]
    curve.write_text("\n".join(["v_s [m/s],mu [1]", *rows]))
    out = tmp_path / "fit"
    assert main(["fit", str(curve), "--law", LAW, "--out", str(out)]) == 0
    fitted = resolve.load_block(f"{out / 'fitted.py'}:law")
    # 1e-6: the points have ten digits
    found = [float(fitted.param_values()[n]) for n in "cab"]
    assert np.allclose(found, [0.4, 0.6, 1.5], rtol=1e-6)


@pytest.mark.parametrize("name", ["T [N m] = 3", "mu == 3", "= 3"])
def test_no_equation(name: str) -> None:
    """What looks like an equation and is none is not told as a model that is missing."""
    with pytest.raises(BadInput, match="is no equation; write name = expression"):
        resolve.load_block(name)


WORDS = st.sampled_from(
    ["mu", "=", "c", "*", "exp", "(", ")", "-", "v_s", " where ", "[m/s]", ",", " on ", "wet:", ";",
     "\n", "x'", "x+", " in ", "..", "0.5", "s/m", "if", "else", "<", "1", "[", "]", "{", "'", '"',
     "__import__", "lambda", "9**9", "µ", "#", "\x00", "import os"]
)  # fmt: skip


@pytest.mark.second
@given(st.one_of(st.lists(WORDS, max_size=40).map("".join), st.text(max_size=80)))
def test_hostile_texts(text: str) -> None:
    """Whatever is typed becomes a block or faults in less than two seconds."""
    begun = time.process_time()
    with suppress(BadInput):
        from_text(text).check_units()
    assert time.process_time() - begun < 2.0


@given(st.lists(WORDS, max_size=20).map("".join), st.integers(0, len(FILE)))
def test_hostile_files(tmp_path_factory: pytest.TempPathFactory, text: str, at: int) -> None:
    """A file with anything in the middle of it is read or told."""
    file = tmp_path_factory.mktemp("f") / "own.toml"
    file.write_text(FILE[:at] + text + FILE[at:], encoding="utf-8")
    with suppress(BadInput):
        assert equation_files.load(f"{file}:law").outputs


@pytest.mark.second
def test_largest_texts_are_quick() -> None:
    """The longest texts that are read take less than two seconds."""
    sums = "; ".join(f"y{k} = y{k - 1}*y{k - 1} + x" for k in range(1, 200))
    for text in (f"y0 = x; {sums} where x [1]", "y = " + " + ".join(["x"] * 190) + " where x [1]"):
        begun = time.process_time()
        assert math.isfinite(from_text(text)(x=0.1)["y0" if "y0" in text else "y"])
        assert time.process_time() - begun < 2.0
