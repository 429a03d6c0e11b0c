"""FMUs: FMPy validates them, and what they compute is what Python computes, bit for bit."""

from __future__ import annotations

import zipfile
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import three_rails
from controllers import REPRESENTATIVE

from slipctl import BadInput, Block, Input, Output, Param, State, law, sampled, simulate, step
from slipctl.ccode import codegen
from slipctl.ccode.check import comparison
from slipctl.ccode.compile import compilers, platforms
from slipctl.models import brakes
from slipctl.models.huang_2020 import subway_braking

pytestmark = pytest.mark.second

fmpy = pytest.importorskip("fmpy")
validate_fmu = pytest.importorskip("fmpy.validation").validate_fmu
if compilers.first_compiler() is None:
    pytest.skip("no C compiler on this machine", allow_module_level=True)

VERSIONS = (2, 3)


@step(period=0.01, T=Output("N m", "torque", lo=-50, hi=50), K=Output("1", "matrix", shape=(2, 2)))
def lag(
    y=State("N m", "d", "lagged"),
    u=Input("N m", "wanted", lo=-100, hi=100, positive="braking"),
    P=State("m^.5", np.arange(4).reshape(2, 2), "matrix", shape=(2, 2)),
    tau=Param("s", 0.1, "time constant", "chosen", lo=0.01),
    d=Param("N m", "2*tau*r", "derived"),
    r=Param("N m/s", 3.0, "rate", lo=0, hi=10),
):
    """First-order lag with a matrix beside it."""
    return dict(y=y + 0.01 / tau * (u - y), P=0.9 * P), dict(T=y, K=P)


class Fmu:
    """One instance, by FMPy's thin wrapper."""

    def __init__(self, path: Path, folder: Path) -> None:
        where = fmpy.extract(str(path), str(folder))
        self.d = fmpy.read_model_description(str(path))
        kind = fmpy.fmi2.FMU2Slave if self.d.fmiVersion == "2.0" else fmpy.fmi3.FMU3Slave
        self.fmu = kind(
            guid=self.d.guid if self.d.fmiVersion == "2.0" else self.d.instantiationToken,
            unzipDirectory=where, modelIdentifier=self.d.coSimulation.modelIdentifier,
            instanceName="one",
        )  # fmt: skip
        self.two = self.d.fmiVersion == "2.0"
        self.at = {v.name: v.valueReference for v in self.d.modelVariables}
        self.fmu.instantiate(loggingOn=False)
        self.time = 0.0

    def begin(self, **start: float) -> Fmu:
        self.set(**start)
        if self.two:
            self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        return self

    def set(self, **values: float) -> None:
        if values:
            at = [self.at[n] for n in values]
            (self.fmu.setReal if self.two else self.fmu.setFloat64)(at, list(values.values()))

    def get(self, *names: str) -> list[float]:
        at = [self.at[n] for n in names]
        return list((self.fmu.getReal if self.two else self.fmu.getFloat64)(at))

    def status(self) -> int:
        at = [self.at["status"]]
        return int((self.fmu.getInteger if self.two else self.fmu.getInt32)(at)[0])

    def step(self, size: float) -> None:
        self.fmu.doStep(currentCommunicationPoint=self.time, communicationStepSize=size)
        self.time += size

    def close(self) -> None:
        self.fmu.terminate()
        self.fmu.freeInstance()


@pytest.fixture(scope="module")
def lags(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("lag")
    codegen.export(lag, folder, fmus=True)
    return folder


def opened(folder: Path, version: int, tmp_path: Path, name: str = "lag") -> Fmu:
    return Fmu(folder / f"{name}_fmi{version}.fmu", tmp_path / f"{name}{version}")


# ---- valid, and the same numbers -----------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("name", REPRESENTATIVE)
def test_representative_controllers_as_fmu(name: str, tmp_path: Path) -> None:
    """Valid by FMPy; simulated by FMPy on made-up inputs, every output is that of the C module."""
    from slipctl.ccode.module.plan import Plan
    from slipctl.ccode.ship.fmu_xml import variables

    block = REPRESENTATIVE[name]()
    period = block.period or 1e-3
    # the binary that runs here; test_windows.py has the other
    codegen.export(
        block, tmp_path, "ctl", fmus=True, period=period, platforms=[str(platforms.this_platform())]
    )
    rows = comparison.trial_rows(Plan(block))[:60]
    module = codegen.CModule(tmp_path, Plan(block, "ctl")).compile().load()
    wanted, _ = module.replay_rows(rows)
    found = variables(Plan(block, "ctl", period))
    names, outputs = ([v.name for v in found if v.causality == c] for c in ("input", "output"))
    dtype = [("time", float), *((n, float) for n in names)]
    table = np.zeros(len(rows), dtype)
    table["time"] = np.arange(len(rows)) * period
    for k, n in enumerate(names):
        table[n] = rows[:, k]
    for version in VERSIONS if len(found) < 300 else (3,):  # FMPy parses each name for long
        path = str(tmp_path / f"ctl_fmi{version}.fmu")
        assert validate_fmu(path) == []
        result = fmpy.simulate_fmu(
            path, stop_time=len(rows) * period, output_interval=period, input=table, output=outputs,
            debug_logging=False, validate=False,
        )  # fmt: skip
        assert len(result) == len(rows) + 1
        got = np.column_stack([result[n][1:] for n in outputs])
        np.testing.assert_array_equal(got, wanted)


def test_a_parameter_may_have_the_name_of_an_output(tmp_path: Path) -> None:
    """A shared number T beside an output T: FMI wants a name for each."""
    from slipctl import connect

    @law(y=Output("s"))
    def late(u=Input("s"), T=Param("s", 2.0, "lag", lo=0, hi=9)):
        return u + T

    pair = connect("pair", {"late.u": "u", "T": "late.y"}, share={"T": "*.T"}, late=late)
    codegen.export(pair, tmp_path, fmus=True, period=0.01)
    for version in VERSIONS:
        path = str(tmp_path / f"pair_fmi{version}.fmu")
        assert validate_fmu(path) == []
        names = [v.name for v in fmpy.read_model_description(path).modelVariables]
        assert len(names) == len(set(names))
        table = np.array([(0.0, 1.0), (0.05, 1.0)], [("time", float), ("u", float)])
        result = fmpy.simulate_fmu(
            path, stop_time=0.05, output_interval=0.01, input=table, output=["T"],
            start_values={"parameter.T": 3.0},
        )  # fmt: skip
        assert result["T"][-1] == 4.0


@pytest.fixture(scope="module")
def subway() -> tuple[Block, Any]:
    from slipctl.studies.subway_braking.loops import MODELS, perfect

    loop = perfect(MODELS, MODELS["sta"])
    return loop, simulate(loop, three_rails(1.5))


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.others("long")
def test_plant_and_controller_split_between_two_fmus(
    version: int, subway: tuple[Block, Any], tmp_path: Path
) -> None:
    """Python's closed loop, tick by tick, from two FMUs that a master connects."""
    loop, log = subway
    parts = {}
    for name in ("plant", "ctl"):
        params = codegen.logged_params(loop, name, log)
        block = loop[name].with_params(**{k: float(v) for k, v in params.items()})
        codegen.export(
            block, tmp_path / name, name, fmus=True, period=loop.period,
            platforms=[str(platforms.this_platform())],
        )  # fmt: skip
        parts[name] = opened(tmp_path / name, version, tmp_path, name).begin()
    plant, ctl = parts["plant"], parts["ctl"]
    wires = [(d, s) for d, s in loop.wires.items() if d.startswith(("ctl.", "plant."))]
    feeds = {
        d: log[d if d in log else s].values for d, s in wires if s in loop.inputs
    }  # what comes from outside
    inner = {d: s for d, s in wires if s not in loop.inputs}
    compared = ["wheel.v", "wheel.omega", "wheel.x", "adh.mu"]
    ticks, rails = 1500, loop["plant.adh"].conditions
    for k in range(ticks):
        if k % 500 == 0:
            rail = rails[("dry", "wet", "ice")[k // 500]]
            plant.set(**{f"adh.{n}": v for n, v in rail.items()})  # tuned while it runs
        for d, s in inner.items():
            if d.startswith("ctl."):
                ctl.set(**{d[4:]: plant.get(s.partition(".")[2])[0]})
        for d, v in feeds.items():
            part, _, port = d.partition(".")
            parts[part].set(**{port: float(v[k])})
        wanted = [float(log[f"plant.{n}"].values[k]) for n in compared]
        assert plant.get(*compared) == wanted, k
        ctl.step(loop.period)
        assert ctl.get("T_b") == [float(log["ctl.T_b"].values[k])], k
        plant.set(T_cmd=ctl.get("T_b")[0])
        plant.step(loop.period)
    for part in parts.values():
        part.close()


def test_fmpy_opens_a_part_of_a_loop_with_its_recorded_inputs(subway: tuple[Block, Any]) -> None:
    """What ``python -m bench.fmus`` does with every controller and plant."""
    from bench.fmus import opened_by_fmpy

    loop, _ = subway
    scenario = three_rails(1.5).but(start={"plant.wheel.v": 11.0}, params={"plant.m": 9000.0})
    for row in opened_by_fmpy(loop, "plant", scenario, 0.1).values():
        wanted = {"ticks": 100, "relative": 0.0, "status_differs": 0, "valid": True}
        assert row == wanted | {"passed": True}


@pytest.mark.long
def test_fmpy_opens_a_train_with_valves_on_leaves(tmp_path: Path) -> None:
    """Eight axles of `slipctl new emu` come to the leaves after 3.9 s, and the valves vent."""
    from bench.fmus import opened_by_fmpy
    from slipctl.models.vehicle import case
    from slipctl.study.files.trip_files import load_trip

    written = resources.files("slipctl.models.vehicle") / "files" / "emu.toml"
    found = case(load_trip(str(written)))
    for row in opened_by_fmpy(found.loops["wsp"], "plant", found.scenario, 5.0).values():
        assert (row["relative"], row["status_differs"], row["valid"]) == (0.0, 0, True)


def test_a_difference_from_python_is_found(subway: tuple[Block, Any]) -> None:
    from bench import fmus

    wanted = {"T": np.array([1.0, 2.0]), "status": np.array([0, 8])}
    result = np.array([(0.0, 0), (1.0, 0), (2.5, 0)], [("T", float), ("status", int)])
    assert fmus._compared(wanted, result) == {
        "ticks": 2, "relative": 0.25, "worst": "T", "status_differs": 1,
    }  # fmt: skip


# ---- steps ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("version", VERSIONS)
def test_a_step_of_any_size_holds_the_last_tick(version: int, lags: Path, tmp_path: Path) -> None:
    """A controller has done the ticks that begin before the end of a step, whatever its size."""
    f = opened(lags, version, tmp_path).begin()
    f.set(u=10.0)
    y, ticks, at = float(lag.start()["y"]), 0, 0
    for size in (5, 5, 7, 3, 1, 1, 18, 30, 14, 1, 5):  # ms; the tick is 10 ms
        f.step(size / 1000)
        at += size
        while ticks < -(-at // 10):
            x, out = lag(y=y, u=10.0)
            y, ticks = x["y"], ticks + 1
        assert f.get("T", "y") == [out["T"], y]
    f.close()


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.others("long")
def test_a_master_with_any_interval_ends(version: int, tmp_path: Path) -> None:
    """FMPy, which tries again for ever what is discarded; a plant holds the ticks that are over."""
    plant = sampled(subway_braking.plant(brake=brakes.brake()), 1e-3, "rk4", substeps=10)
    codegen.export(plant, tmp_path, "plant", fmus=True)
    name, given = str(tmp_path / f"plant_fmi{version}.fmu"), {"T_cmd": 1500.0}

    def speeds(**more: float) -> tuple[np.ndarray, np.ndarray]:
        found = fmpy.simulate_fmu(name, start_values=given, output=["wheel.v"], **more)
        return found["time"], found["wheel.v"]

    _, every = speeds(stop_time=0.022, output_interval=1e-3)
    for more in ({"stop_time": 0.0205}, {"stop_time": 0.0201, "output_interval": 7e-4}):
        t, v = speeds(**more)
        assert t[-1] == pytest.approx(more["stop_time"], abs=8e-4)
        assert v.tolist() == every[np.floor(t / 1e-3 + 1e-6).astype(int)].tolist()


@pytest.mark.parametrize("version", VERSIONS)
def test_a_step_that_is_none_is_an_error_at_once(version: int, lags: Path, tmp_path: Path) -> None:
    f = opened(lags, version, tmp_path).begin()
    f.set(u=10.0)
    f.step(0.05)  # five ticks
    y = float(lag.start()["y"])
    for _ in range(5):
        (x, out) = lag(y=y, u=10.0)
        y = x["y"]
    assert f.get("T", "y") == [out["T"], y]
    for size in (0.0, -0.01, np.nan, np.inf):
        if size == 0.0:
            f.step(size)  # allowed, and nothing happens
            continue
        with pytest.raises(Exception, match=r"fmi\dDoStep failed with status 3 \(error\)"):
            f.step(size)
    assert f.get("T", "y") == [out["T"], y]
    f.time = 0.5  # not where the last step ended
    with pytest.raises(Exception, match="error"):
        f.step(0.01)
    f.time = 0.05
    f.step(0.01)
    assert f.get("T") == [y]
    f.close()


@pytest.mark.parametrize("version", VERSIONS)
def test_guards_are_told(version: int, lags: Path, tmp_path: Path) -> None:
    f = opened(lags, version, tmp_path).begin()
    for u, status, T in ((1.0, 0, 0.6), (np.nan, 1, 0.64), (200.0, 8, 0.676), (1.0, 0, 0.7084)):
        f.set(u=u)
        f.step(0.01)
        assert f.status() == status
        assert f.get("T") == pytest.approx([T], abs=1e-12)
    f.close()


# ---- parameters ----------------------------------------------------------------------------------


@pytest.mark.parametrize("version", VERSIONS)
def test_parameters_are_tunable_and_derived_ones_follow(
    version: int, lags: Path, tmp_path: Path
) -> None:
    f = opened(lags, version, tmp_path).begin(r=5.0)
    assert f.get("d", "y") == [1.0, 1.0]
    assert f.get("K[1,2]", "P[2,1]") == [0.0, 2.0]  # K was not computed yet
    f.set(r=1.0)
    assert f.get("d", "y") == [pytest.approx(0.2), 1.0]
    with pytest.raises(Exception, match="discard"):
        f.set(r=11.0)
    assert f.get("r") == [1.0]
    with pytest.raises(Exception, match="error"):
        f.set(d=1.0)
    f.step(0.01)
    assert f.get("K[1,2]", "K[2,1]") == [1.0, 2.0]
    f.close()
    g = opened(lags, version, tmp_path / "g")
    with pytest.raises(Exception, match="ExitInitializationMode failed"):
        g.begin(tau=0.0)
    g.fmu.freeInstance()


# ---- start values --------------------------------------------------------------------------------


@step(period=0.01, z=Output("1", "sum", lo=-1e3, hi=1e3))
def chain(
    q=State("1", [1.0, 2.0, 3.0], "before the others, and an array", shape=(3,)),
    a=State("1", 1.5, "free", lo=-10, hi=10),
    b=State("1", "a**2 * g", "computed from a state and a derived parameter", lo=-100, hi=100),
    c=State("1", "fabs(b) + k", "computed from a computed one", shape=(2,)),
    k=Param("1", 0.3, "offset", lo=0, hi=1),
    g=Param("1", "k/7", "derived"),
):
    """Start values that use one another."""
    z = a / 3 + b * 0.7 + c[0] * c[1]
    return dict(q=q, a=0.9 * a, b=0.8 * b + 0.01 * a, c=0.5 * c + b), dict(z=z)


def simulated(path: Path, start: dict[str, float], outputs: list[str], ticks: int, h: float) -> Any:
    return fmpy.simulate_fmu(
        str(path), stop_time=ticks * h, output_interval=h, start_values=start, output=outputs,
        debug_logging=False,
    )  # fmt: skip


@pytest.mark.parametrize("version", VERSIONS)
def test_start_values_set_by_fmpy_start_the_same_run_as_in_python(
    version: int, tmp_path: Path
) -> None:
    """Those that were not set are computed from those that were, as ``start`` does."""
    codegen.export(chain, tmp_path, fmus=True)
    path = tmp_path / f"chain_fmi{version}.fmu"
    assert validate_fmu(str(path)) == []
    d = {v.name: v for v in fmpy.read_model_description(str(path)).modelVariables}
    assert (d["a"].initial, d["b"].initial, d["c[2]"].initial) == ("exact", "approx", "approx")
    assert float(d["b"].start) == chain.start()["b"]
    elements = {"a": -2.75, "c[1]": 4.0}
    for given, params in (
        ({}, {}), ({"a": -2.75}, {}), ({"b": -7.1}, {"k": 0.9}), (elements, {"k": 0.9}),
    ):  # fmt: skip
        block = chain.with_params(**params)
        x: dict[str, Any] = block.start(**{n: v for n, v in given.items() if n in block.states})
        if "c[1]" in given:
            x["c"] = np.array([given["c[1]"], x["c"][1] if x["c"].ndim else x["c"]])
        names = ["a", "b", "c[1]", "c[2]"]
        result = simulated(path, given | params, ["z", *names], 5, 0.01)
        assert list(result[0][names]) == [x["a"], x["b"], *np.broadcast_to(x["c"], 2)]
        for row in result[1:]:
            x, out = block(**x)
            assert list(row[["z", *names]]) == [out["z"], x["a"], x["b"], *x["c"]]


@pytest.mark.parametrize("version", VERSIONS)
def test_start_values_are_refused_late_and_off_range_and_forgotten_by_reset(
    version: int, tmp_path: Path
) -> None:
    codegen.export(chain, tmp_path, fmus=True)
    f = opened(tmp_path, version, tmp_path, "chain")
    f.set(a=2.0)
    b = f.get("b")
    assert b == [chain.start(a=2.0)["b"]]  # seen before the initialization is over
    f.begin()
    assert f.get("a", "b") == [2.0, *b]
    with pytest.raises(Exception, match="error"):
        f.set(a=1.0)
    assert f.get("a", "b") == [2.0, *b]
    f.step(0.05)
    f.fmu.reset()
    assert f.get("a", "b") == [1.5, chain.start()["b"]]
    f.time = 0.0
    f.begin(b=0.25)
    assert f.get("a", "b", "c[1]") == [1.5, 0.25, 0.25 + 0.3]
    f.close()
    for bad in ({"a": 11.0}, {"a": np.nan}, {"b": 1e3}, {"c[2]": np.inf}):
        g = opened(tmp_path, version, tmp_path / "g", "chain")
        with pytest.raises(Exception, match="ExitInitializationMode failed"):
            g.begin(**bad)
        g.fmu.freeInstance()


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.others("long")
def test_a_plant_starts_at_another_speed(version: int, tmp_path: Path) -> None:
    """The wheel turns with the train: its start value, v/r, follows the one that was set."""
    plant = sampled(subway_braking.plant(brake=brakes.brake()), 1e-3, "rk4")
    (v,) = (n for n in plant.states if n.endswith("wheel.v"))
    (omega,) = (n for n in plant.states if n.endswith("wheel.omega"))
    codegen.export(plant, tmp_path, "plant", fmus=True)
    path = tmp_path / f"plant_fmi{version}.fmu"
    names = {m.name.removeprefix("state."): m.name
             for m in fmpy.read_model_description(str(path)).modelVariables}  # fmt: skip
    result = simulated(path, {names[v]: 7.3, "T_cmd": 3e3}, [names[v], names[omega]], 20, 1e-3)
    moved = plant.with_params(**{v: 7.3})
    x = {n: float(value) for n, value in moved.start().items()}
    for row in result:
        assert list(row[[names[v], names[omega]]]) == [x[v], x[omega]]
        x, _ = moved(T_cmd=3e3, **x)


# ---- state of the FMU ----------------------------------------------------------------------------


@pytest.mark.parametrize("version", VERSIONS)
def test_state_is_kept_restored_and_serialised(version: int, lags: Path, tmp_path: Path) -> None:
    f = opened(lags, version, tmp_path).begin()
    f.set(u=3.0)
    f.step(0.02)
    get, put = ((f.fmu.getFMUstate, f.fmu.setFMUstate) if version == 2
                else (f.fmu.getFMUState, f.fmu.setFMUState))  # fmt: skip
    kept = get()
    f.step(0.01)
    once = f.get("T", "y", "P[2,2]")
    f.step(0.1)
    put(kept)
    f.time = 0.02
    f.step(0.01)
    assert f.get("T", "y", "P[2,2]") == once
    pack, unpack = ((f.fmu.serializeFMUstate, f.fmu.deSerializeFMUstate) if version == 2
                    else (f.fmu.serializeFMUState, f.fmu.deserializeFMUState))  # fmt: skip
    data = pack(kept)
    other = opened(lags, version, tmp_path / "other").begin()
    there = (other.fmu.deSerializeFMUstate if version == 2 else other.fmu.deserializeFMUState)(data)
    (other.fmu.setFMUstate if version == 2 else other.fmu.setFMUState)(there)
    other.time = 0.02
    other.step(0.01)
    assert other.get("T", "y", "P[2,2]") == once
    with pytest.raises(Exception, match="error"):
        unpack(b"x" + bytes(data)[1:])
    f.close()
    other.close()


# ---- the archive ---------------------------------------------------------------------------------


def test_same_bytes_units_and_sources(lags: Path, tmp_path: Path) -> None:
    codegen.export(lag, tmp_path / "again", fmus=True)
    for version in VERSIONS:
        name = f"lag_fmi{version}.fmu"
        raw = (lags / name).read_bytes()
        assert raw == (tmp_path / "again" / name).read_bytes()
        assert str(lags).encode() not in raw
        with zipfile.ZipFile(lags / name) as archive:
            names = archive.namelist()
            text = archive.read(f"sources/fmi{version}.c").decode()
        assert {"sources/lag.c", "sources/lag.h", "modelDescription.xml"} <= set(names)
        assert ("sources/buildDescription.xml" in names) == (version == 3)
        assert '#include "fmi' not in text  # it needs no header of anybody else
        d = fmpy.read_model_description(str(lags / name))
        found = {u.name: u for u in d.unitDefinitions}
        torque = found["N m"]
        assert (torque.baseUnit.kg, torque.baseUnit.m, torque.baseUnit.s) == (1, 2, -2)
        assert [u.name for u in torque.displayUnits] == ["kN m"]
        assert found["m^.5"].baseUnit is None  # FMI knows whole exponents only
        (u,) = (v for v in d.modelVariables if v.name == "u")
        assert (u.unit, u.min, u.max) == ("N m", "-100.0", "100.0")
        assert "positive = braking" in u.description
        assert d.defaultExperiment.stepSize == "0.01"
    other = codegen.export(lag.with_params(tau=0.2), tmp_path / "other", fmus=True)
    assert (other.folder / "lag_fmi2.fmu").read_bytes() != (lags / "lag_fmi2.fmu").read_bytes()


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.others("long")
def test_sources_compile_alone_and_two_fmus_link(version: int, lags: Path, tmp_path: Path) -> None:
    compiler = compilers.compilers()[0]
    codegen.export(lag, tmp_path / "b", "other", fmus=True)
    objects = []
    for folder, name in ((lags, "lag"), (tmp_path / "b", "other")):
        with zipfile.ZipFile(folder / f"{name}_fmi{version}.fmu") as archive:
            archive.extractall(tmp_path / name)
        for source in (tmp_path / name / "sources").glob("*.c"):
            objects.append(source.with_suffix(".o"))
            compilers.compile_object(
                compiler, source, objects[-1], "-fPIC", "-Wno-unused-parameter",
                f"-DFMI{version}_FUNCTION_PREFIX={name}_",
            )  # fmt: skip
    compilers.link(compiler, objects, tmp_path / "both.so", "-shared")
    defined = (compilers.symbols(tmp_path / "both.so") or {"defined": []})["defined"]
    assert {f"lag_fmi{version}DoStep", f"other_fmi{version}DoStep"} <= set(defined)


@pytest.mark.parametrize("version", VERSIONS)
def test_the_command_in_its_documentation_builds_a_binary(
    version: int, lags: Path, tmp_path: Path
) -> None:
    """FMPy runs what it builds, with the numbers of the binary that was in the archive."""
    import html
    import re
    import subprocess

    path = lags / f"lag_fmi{version}.fmu"
    folder = tmp_path / "unpacked"
    with zipfile.ZipFile(path) as archive:
        archive.extractall(folder)
    (command,) = re.findall("<code>(.*?)</code>", (folder / "documentation/index.html").read_text())
    (binary,) = folder.glob("binaries/*/lag.so")
    shipped = fmpy.simulate_fmu(str(folder), stop_time=0.05, output_interval=0.01)
    binary.unlink()
    words = html.unescape(command).replace("-o lag.so", f"-o {binary}")
    subprocess.run(words, shell=True, cwd=folder, check=True)
    built = fmpy.simulate_fmu(str(folder), stop_time=0.05, output_interval=0.01)
    assert list(built) == list(shipped)


def test_dependencies_say_what_passes_at_once(tmp_path: Path) -> None:
    """A plant's speed does not depend on the torque of this moment; a law's output does."""
    from slipctl.ccode.module.plan import Plan
    from slipctl.ccode.ship.fmu_xml import feedthrough, is_plant

    plant = sampled(subway_braking.plant(brake=brakes.brake()), 1e-3, "rk4")
    assert is_plant(plant)
    assert not is_plant(lag)
    through = feedthrough(Plan(plant, "p"))
    outputs, inputs = list(plant.outputs), list(plant.inputs)
    assert outputs.index("wheel.v_s") not in through
    assert inputs.index("T_cmd") in through[outputs.index("brake.T_b")]

    @law(y=Output("1"), z=Output("1"))
    def both(u=Input("1"), w=Input("1")):
        """Passes one."""
        return dict(y=2 * u, z=u + w)

    codegen.export(both, tmp_path, fmus=True)
    f = opened(tmp_path, 3, tmp_path, "both").begin()
    f.set(u=1.5)
    assert f.get("y", "z") == [3.0, 1.5]
    f.step(0.123)
    f.set(u=2.0, w=1.0)
    assert f.get("y", "z", "time") == [4.0, 3.0, 0.123]
    f.close()
    text = zipfile.ZipFile(tmp_path / "both_fmi3.fmu").read("modelDescription.xml").decode()
    assert '<Output valueReference="2" dependencies="0"/>' in text


def test_what_cannot_be_an_fmu(tmp_path: Path) -> None:
    @step(y=Output("1"))
    def timeless(x=State("1"), u=Input("1")):
        """No period."""
        return dict(x=u), dict(y=x)

    with pytest.raises(
        BadInput, match=r"timeless has no period.*write @step\(period=0\.01, \.\.\.\), in s"
    ):
        codegen.export(timeless, tmp_path / "out", fmus=True)
    assert not (tmp_path / "out").exists()
    (tmp_path / "lag_fmi2.fmu").write_bytes(b"mine")
    with pytest.raises(BadInput, match=r"lag_fmi2\.fmu was not written by slipctl"):
        codegen.export(lag, tmp_path, fmus=True)
    assert [p.name for p in tmp_path.iterdir()] == ["lag_fmi2.fmu"]
