"""The description of an FMU: FMPy reads it by the schema, and it says what the block declares."""

from __future__ import annotations

import tempfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from slipctl import Input, Output, Param, State, connect, flow, law, sampled, step
from slipctl.block.block import Block
from slipctl.ccode.compile.template import fill_template
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.ship import fmu_source, fmu_xml

fmpy = pytest.importorskip("fmpy")


@step(
    period=0.01, T=Output("N m", "torque", lo=-50, hi=50),
    K=Output("1", "matrix", shape=(2, 2)), w=Output("rad/s"),
)  # fmt: skip
def lag(
    y=State("N m", "d", "lagged"),
    u=Input("N m", "wanted", lo=-100, hi=100, positive="braking"),
    q=Input("m/s^2", "two of them <&>", value=[1.0, -2.0], shape=(2,)),
    P=State("m^.5", np.arange(4).reshape(2, 2), "matrix", shape=(2, 2)),
    tau=Param("s", 0.5, "time constant", "chosen", lo=0.01),
    d=Param("N m", "2*tau*r", "derived"),
    r=Param("N m/s", 3.0, "rate", lo=0, hi=10),
):
    """First-order lag with a matrix beside it."""
    return dict(y=y + 0.01 / tau * (u - y), P=0.9 * P), dict(T=y, K=P, w=q[0] * tau)


@flow(p=Output("m"), push=Output("N"))
def mass(
    x=State("m", 1.0, "place"),
    v=State("m/s", 0.0, "speed"),
    F=Input("N", "force"),
    G=Input("N", "another force"),
    m=Param("kg", 2.0, "mass", lo=1),
):
    """Mass on a line."""
    return dict(x=v, v=(F + G) / m), dict(p=x, push=2 * G)


@law(y=Output("s"))
def late(u=Input("s"), T=Param("s", 2.0, "lag", lo=0, hi=9)):
    """Sum."""
    return u + T


def described(block: Block, version: int, now: bool = False, period: float | None = 0.01):
    """What FMPy reads, which it holds against the schema."""
    text = fmu_xml.description(Plan(block, "ctl", period), version, "{a-b}", now)
    return text, {v.name: v for v in variables(text)}, fmpy_reads(text)


def fmpy_reads(text: str):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "modelDescription.xml")
        path.write_text(text, encoding="utf-8")
        return fmpy.read_model_description(str(path), validate=True)


def variables(text: str):
    return fmpy_reads(text).modelVariables


@pytest.mark.parametrize("version", [2, 3])
def test_each_element_of_a_signal_is_a_variable_with_its_range_and_start(version: int) -> None:
    """Arrays column by column, as C has them; what is computed from others may be set, roughly."""
    _, found, told = described(lag, version)
    want = {
        "u": ("input", "discrete", None, "N m", -100, 100, 0),
        "q[1]": ("input", "discrete", None, "m/s^2", None, None, 1),
        "q[2]": ("input", "discrete", None, "m/s^2", None, None, -2),
        "tau": ("parameter", "tunable", "exact", "s", 0.01, None, 0.5),
        "r": ("parameter", "tunable", "exact", "N m/s", 0, 10, 3),
        "d": ("calculatedParameter", "tunable", "calculated", "N m", None, None, None),
        "y": ("local", "discrete", "approx", "N m", None, None, 3),
        "P[1,1]": ("local", "discrete", "exact", "m^.5", None, None, 0),
        "P[2,1]": ("local", "discrete", "exact", "m^.5", None, None, 2),
        "P[1,2]": ("local", "discrete", "exact", "m^.5", None, None, 1),
        "P[2,2]": ("local", "discrete", "exact", "m^.5", None, None, 3),
        "T": ("output", "discrete", "calculated", "N m", -50, 50, None),
        "w": ("output", "discrete", "calculated", "rad/s", None, None, None),
    }
    for name, row in want.items():
        v = found[name]
        numbers = [None if x is None else float(x) for x in (v.min, v.max, v.start)]
        assert (v.causality, v.variability, v.unit) == (row[0], row[1], row[3]), name
        assert row[2] is None or v.initial == row[2], name
        assert numbers == [None if x is None else float(x) for x in row[4:]], name
    assert [n for n in found if n.startswith(("P", "K"))] == [
        f"{a}[{i},{j}]" for a in "PK" for j in (1, 2) for i in (1, 2)
    ]
    references = [int(v.valueReference) for v in found.values()]
    assert sorted(references) == list(range(len(references)))
    assert "positive = braking" in found["u"].description
    assert "source: chosen" in found["tau"].description
    assert "two of them <&>" in found["q[2]"].description
    assert found["w"].description == "w"  # where nothing is said of it, its name
    assert float(told.defaultExperiment.stepSize) == 0.01
    assert told.coSimulation.modelIdentifier == "ctl"


@pytest.mark.parametrize("version", [2, 3])
def test_units_are_those_of_si_or_named_alone(version: int) -> None:
    """A root of a metre is no unit of FMI; a tool may show what people read."""
    _, _, told = described(lag, version)
    units = {u.name: u for u in told.unitDefinitions}
    assert set(units) == {"N m", "m/s^2", "s", "N m/s", "m^.5", "1", "rad/s"}
    powers = {n: {k: getattr(u.baseUnit, k) for k in ("kg", "m", "s", "rad")}
              for n, u in units.items() if u.baseUnit is not None}  # fmt: skip
    assert {k: int(v) for k, v in powers["N m/s"].items()} == {"kg": 1, "m": 2, "s": -3, "rad": 0}
    assert {k: int(v) for k, v in powers["rad/s"].items()} == {"kg": 0, "m": 0, "s": -1, "rad": 1}
    assert "m^.5" not in powers
    shown = {n: [(d.name, float(d.factor)) for d in u.displayUnits] for n, u in units.items()}
    assert shown["N m"] == [("kN m", 1e-3)]
    assert shown["rad/s"] == [("r/min", pytest.approx(60 / (2 * np.pi)))]
    assert shown["m/s^2"] == []


def test_what_tools_show_instead_is_as_large() -> None:
    from slipctl.block.units.unit_algebra import unit

    for name, (shown, factor) in fmu_xml.DISPLAY.items():
        if shown == "r/min":
            continue  # turns, which the algebra has not
        assert unit(name).dims == unit(shown).dims
        assert unit(name).scale / unit(shown).scale == pytest.approx(factor, rel=1e-12)


@pytest.mark.parametrize("version", [2, 3])
def test_a_plant_tells_its_present_state_and_what_passes_at_once(version: int) -> None:
    """The push is that of the second force at once; where the mass is, is not that of a force."""
    block = sampled(mass, 0.01, "rk4")
    text, found, told = described(block, version, now=True)
    assert [found[n].causality for n in ("x", "v", "p", "push")] == ["output"] * 4
    assert [float(found[n].start) for n in ("x", "v")] == [1.0, 0.0]
    outputs = {u.variable.name: [v.name for v in u.dependencies] for u in told.outputs}
    assert outputs == {"x": [], "v": [], "p": [], "push": ["G"], "status": []}
    first = [u.variable.name for u in told.initialUnknowns]
    assert first == ["p", "push", "status"]
    _, _, held = described(block, version, now=False)
    assert all(not u.dependencies for u in held.outputs)
    assert text.startswith("<?xml")


@pytest.mark.parametrize("version", [2, 3])
def test_of_a_controller_derived_parameters_and_outputs_are_unknown_at_first(version: int) -> None:
    _, _, told = described(lag, version)
    first = [u.variable.name for u in told.initialUnknowns]
    assert first == ["d", "T", "K[1,1]", "K[2,1]", "K[1,2]", "K[2,2]", "w", "status"]


@pytest.mark.parametrize("version", [2, 3])
def test_each_variable_has_a_name_of_its_own(version: int) -> None:
    """Where an output has the name of a state, a parameter, the status or the time."""

    @step(period=0.1, y=Output("1"), status=Output("1"), time=Output("s"), u=Output("1"))
    def twice(y=State("1", 2.0, "kept"), v=Input("1", "given")):
        """Many names twice."""
        return dict(y=v), dict(y=y + v, status=v, time=2 * v, u=v)

    _, found, told = described(twice, version)
    names = [v.name for v in told.modelVariables]
    assert len(names) == len(set(names))
    assert found["state.y"].causality == "local"
    assert found["y"].causality == "output"
    assert found["status_"].causality == "output"
    assert ("time_" in found) == (version == 3)
    pair = connect("pair", {"late.u": "u", "T": "late.y"}, share={"T": "*.T"}, late=late)
    _, found, told = described(pair, version)
    assert float(found["parameter.T"].start) == 2
    assert found["T"].causality == "output"


@pytest.mark.parametrize("version", [2, 3])
def test_without_a_period_no_size_of_a_step_is_told(version: int) -> None:
    text, _, _ = described(late, version, period=None)
    assert "tepSize=" not in text.replace("canHandleVariableCommunicationStepSize=", "")


def test_the_page_and_the_list_of_sources_name_what_there_is() -> None:
    plan = Plan(lag, "ctl", 0.01)
    text = fmu_xml.page(plan)
    for v in fmu_xml.variables(plan):
        assert f"<tr><td>{v.name}</td><td>{v.member.signal.unit}</td><td>{v.causality}</td>" in text
    assert "two of them &lt;&amp;&gt;" in text
    root = ElementTree.fromstring(fill_template("buildDescription.xml", n="ctl"))
    assert [e.get("name") for e in root.iter("SourceFile")] == ["ctl.c", "fmi3.c"]
    assert root.find("BuildConfiguration").get("modelIdentifier") == "ctl"


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("real", ["double", "float"])
def test_the_interface_knows_where_each_reference_lies(version: int, real: str) -> None:
    """Groups in the order of the description, each from where the one before ends."""
    plan = Plan(lag, "ctl", 0.01, real=real)
    text = fmu_source.interface(plan, version, "{a-b}", now=True)
    counts = [("in", 3), ("param", 2), ("derived", 1), ("state", 5), ("out", 6)]
    assert sum(n for _, n in counts) == len(fmu_xml.variables(plan))
    places = ["k < FIRST_PARAM", "k < FIRST_DERIVED", "k < FIRST_STATE", "k < FIRST_OUT",
              "k < STATUS"]  # fmt: skip
    assert [text.index(p) for p in places] == sorted(text.index(p) for p in places)
    for k, v in enumerate([0.0, 1.0, -2.0]):
        at = ("m->in.u", "m->in.q[0]", "m->in.q[1]")[k]
        assert f"{at} = {v}" in text
    assert "@" not in text.replace("@brief", "")
    assert '"{a-b}"' in text
