"""Runs: the rolled loop is the block itself, compiled or not; energy, noise, cache, failures."""

import hashlib
import json
import logging
import os
import subprocess
import sys

import casadi as ca
import numpy as np
import pytest
from conftest import BEST, closed_loop, three_rails

from slipctl import (
    BadInput,
    Block,
    Input,
    Noise,
    Output,
    Param,
    RunFailed,
    Scenario,
    State,
    connect,
    every,
    flow,
    law,
    make_block,
    sampled,
    simulate,
    step,
    unit_delay,
)
from slipctl.certify.bounds.steps import METHODS
from slipctl.models import sensors
from slipctl.models.huang_2020 import subway_braking as subway
from slipctl.models.huang_2020 import subway_braking_control as control
from slipctl.run import build


def same(a, b) -> bool:
    """Whether two runs have the same signals with the same bits."""
    return list(a) == list(b) and all(a[n].values.tobytes() == b[n].values.tobytes() for n in a)


# ---- the rolled run is the block ----------------------------------------------------------------


@pytest.mark.parametrize("compile", [True, False])
def test_every_nth_row_is_the_row_of_the_whole_run(compile, monkeypatch):
    from slipctl.run import preparation

    monkeypatch.setattr(preparation, "SCRATCH", 17)  # pieces that do not fit the rows
    block, scenario = closed_loop(), three_rails(0.3)
    whole = simulate(block, scenario, compile=compile)
    some = simulate(block, scenario, compile=compile, every=7, log=["plant.wheel.v", "ctl.T_b"])
    assert set(some.data_vars) == {"plant.wheel.v", "ctl.T_b"}
    assert some.attrs["period_s"] == pytest.approx(7e-3)
    for name in ("time", "plant.wheel.v", "ctl.T_b"):
        assert (some[name].values == whole[name].values[::7]).all()
    with pytest.raises(BadInput, match="whole number"):
        simulate(block, scenario, every=0)


def test_a_run_is_the_block_called_tick_by_tick():
    """States at the start of the tick, outputs of the tick; to the bit."""
    block = closed_loop()
    run = simulate(block, three_rails(0.3))
    x = block.start()
    u = {"v_opt": BEST, "a_demand": 10.0}
    for k in range(20):
        n, y = block(**x, **u)
        for name, value in {**{m: float(v) for m, v in x.items()}, **y}.items():
            assert float(run[name][k]) == value, name
        x = n


def slow_part() -> Block:
    """Loop with noise, quantised wheel speed, lag, and a part that runs every 16 ticks (MX)."""
    low_pass = step(y=Output("rad/s"), name="low_pass")(
        lambda s=State("rad/s", 40.0), u=Input("rad/s"): (dict(s=s + (u - s) / 4), dict(y=s))
    )
    wires = {"tooth.phi": "loop.plant.wheel.phi", "slow.u": "tooth.omega_m"}
    return connect("real", wires, loop=closed_loop(lag=True), tooth=sensors.tooth_wheel,
                   slow=every(low_pass, 16))  # fmt: skip


LOOPS = {
    "smc": lambda: closed_loop(control.reaching_law()),
    "sta": closed_loop,
    "sta proper implicit": lambda: closed_loop(
        control.super_twisting(discretisation="proper_implicit")
    ),
    "sta printed": lambda: closed_loop(control.super_twisting(gains="printed")),
    "lag": lambda: closed_loop(lag=True),
    "noise and every": slow_part,
    **{m: lambda m=m: closed_loop(lag=True, method=m) for m in METHODS},
}


@pytest.mark.second
@pytest.mark.parametrize("name", LOOPS)
@pytest.mark.others("long")
def test_compiled_and_interpreted_runs_give_the_same_bits(name, needs_compiler):
    """Across changes of rail; with saturation, jumps, noise, Newton steps and skipped parts."""
    block, run = LOOPS[name](), three_rails(0.3)
    assert same(simulate(block, run), simulate(block, run, compile=False))


def test_every_operation_gives_the_same_bits_compiled(needs_compiler):
    """All elementary functions on 5000 random numbers over ten decades, in one Function."""
    u, x = ca.SX.sym("u", 2), ca.SX.sym("x")
    a, b = u[0], u[1]
    unary = "sin cos tan asin acos atan sinh cosh tanh exp log sqrt sign floor ceil fabs log1p"
    binary = "atan2 fmin fmax fmod hypot power copysign"
    results = [getattr(ca, n)(a) for n in [*unary.split(), "expm1", "erf"]]
    results += [getattr(ca, n)(a, b) for n in binary.split()]
    results += [ca.sin(a) * ca.cos(a), ca.if_else(a > b, ca.exp(a), b**3), a * b + a / b - b**-2.5]
    f = ca.Function("ops", [x, u, ca.SX.sym("p", 0)], [x, ca.vertcat(*results)])
    rng = np.random.default_rng(0)
    numbers = rng.standard_normal((5000, 2)) * 10 ** rng.uniform(-5, 5, (5000, 1))
    logs = [np.empty((5000, 1 if k == 0 else len(results))) for k in (0, 1, 0, 1)]
    build.compile_roller(f).roll(np.zeros(1), numbers, np.zeros(0), *logs[:2])
    build.roll_interpreted(f, np.zeros(1), numbers, np.zeros(0), *logs[2:])
    assert (np.isnan(logs[1]) == np.isnan(logs[3])).all()
    assert np.nan_to_num(logs[1]).tobytes() == np.nan_to_num(logs[3]).tobytes()


def test_progress_changes_nothing():
    """A run in pieces has the bits of a run in one piece; the share done grows to 1."""
    done = []
    assert same(
        simulate(closed_loop(), three_rails(0.3), progress=done.append),
        simulate(closed_loop(), three_rails(0.3)),
    )
    assert done == sorted(done)
    assert done[-1] == 1
    assert len(done) > 20


# ---- physics ------------------------------------------------------------------------------------


@flow(name="meter")
def meter(
    brake=State("J", doc="work of the brake"),
    friction=State("J", doc="lost in the slipping contact"),
    resistance=State("J", doc="work of air and curve"),
    T_b=Input("N m"),
    omega=Input("rad/s"),
    v=Input("m/s"),
    F_a=Input("N"),
    v_s=Input("m/s"),
    f=Input("N"),
    W=Input("N"),
):
    """Power that leaves the wheel and its mass, by where it goes."""
    return dict(brake=T_b * omega, friction=F_a * v_s, resistance=(f + W) * v), {}


def energies(method: str, n: int) -> tuple[float, float]:
    """Kinetic energy lost in 1 s of braking from 20 m/s, and the sum of the works, in J."""
    plant = subway.plant().with_params(**{"curve.kappa": 1 / 400})
    signals = ("omega", "v", "F_a", "v_s")
    wires = {f"meter.{k}": f"plant.wheel.{k}" for k in signals}
    wires |= {"meter.f": "plant.air.f", "meter.W": "plant.curve.W", "meter.T_b": "T",
              "plant.T_cmd": "T"}  # fmt: skip
    rig = sampled(connect("rig", wires, plant=plant, meter=meter), 1 / n, method)
    run = simulate(rig, Scenario("s", 1 + 1 / n, inputs={"T": 9000.0}), compile=False)
    v, omega = run["plant.wheel.v"].values, run["plant.wheel.omega"].values
    kinetic = 8000 * v**2 / 2 + 240 * omega**2 / 2
    works = sum(float(run[f"meter.{k}"][-1]) for k in ("brake", "friction", "resistance"))
    assert float(run["meter.friction"][-1]) > 0
    return kinetic[0] - kinetic[-1], works


def test_energy_balance_of_the_braked_wheelset(integrator):
    """Brake work + friction loss + resistance = kinetic energy lost, to the order of the method.

    Torque is constant and nothing saturates, so the only error is the integrator's: it falls by
    2^order when the step is halved, from 1/400 s, a seventh of the wheel's time constant of 16 ms.
    """
    errors = []
    for n in (400, 800):
        lost, works = energies(integrator.method, n)
        errors.append(abs(lost - works))
    assert errors[0] < 0.01 * lost
    assert np.log2(errors[0] / errors[1]) == pytest.approx(integrator.order, abs=0.25)


# ---- noise --------------------------------------------------------------------------------------


@law(y=Output("m/s"), name="sensor")
def sensor(v=Input("m/s"), n=Noise(), sigma=Param("m/s", 0.1)):
    return v + sigma * n


def measured(*names: str, **changes):
    """Run of a clock with one sensor per name."""
    clock = step(period=1e-3, name="clock")(lambda t=State("m/s"): (dict(t=t), {}))
    wires = {f"{n}.v": "clock.t" for n in names}
    block = connect("loop", wires, **dict.fromkeys(names, sensor), clock=clock)
    return simulate(block, Scenario("s", **{"duration": 4.0, "seed": 7} | changes))


def test_adding_a_sensor_changes_nobody_elses_noise():
    """Streams are keyed by seed and path, whatever stands before; a longer run begins alike."""
    alone, both = measured("b"), measured("a", "b", "c")
    assert (alone["b.n"].values == both["b.n"].values).all()
    assert (measured("b", duration=5.0)["b.n"].values[:4000] == alone["b.n"].values).all()


def test_noise_is_normal_and_its_own_per_sensor():
    """Mean 0, variance 1, no correlation: within 4 standard errors of 4000 numbers."""
    run = measured("a", "b")
    a, b = run["a.n"].values, run["b.n"].values
    assert abs(a.mean()) < 4 / np.sqrt(4000)
    assert abs(a.var() - 1) < 4 * np.sqrt(2 / 4000)
    assert abs(np.mean(a * b)) < 4 / np.sqrt(4000)


def test_seed_and_factor_of_the_noise():
    first, again, other = measured("a"), measured("a"), measured("a", seed=8)
    assert same(first, again)
    assert not (first["a.n"].values == other["a.n"].values).any()
    assert not measured("a", noise=0.0)["a.n"].values.any()
    assert (measured("a", noise=2.0)["a.n"].values == 2 * first["a.n"].values).all()


# ---- what stops a run ---------------------------------------------------------------------------


@pytest.mark.parametrize("compile", [True, False])
@pytest.mark.parametrize("progress", [None, lambda share: None])
def test_nan_stops_the_run_with_block_signal_and_time(compile, progress):
    """1e200 squared is beyond doubles: infinite in the state of tick 2, at t = 0.2 s."""
    body = lambda z=State("m", 1.0), ok=State("1"): (dict(z=z * 1e200, ok=ok), {})  # noqa: E731
    block = connect("loop", {}, fine=unit_delay(value=1.0), car=step(period=0.1, name="car")(body))
    run = Scenario("s", 9.0, inputs={"fine.u": 0.0})
    with pytest.raises(RunFailed, match=r"^loop: car\.z \[m\] became inf at t = 0\.2 s$"):
        simulate(block, run, compile=compile, progress=progress)


def one_input(shape=(), value=None, unit="1", **options) -> Block:
    """Step y = u, z+ = u with one input of any kind."""
    return make_block(
        "b", "step", lambda x, u, p: ({"z": u["u"]}, {"y": u["u"]}), period=0.25,
        states=[State(unit, 0.0, shape=shape).named("z")],
        inputs=[Input(unit, shape=shape, value=value, **options).named("u")],
        outputs=[Output(unit, shape=shape).named("y")],
    )  # fmt: skip


@pytest.mark.parametrize(
    ("feed", "words"),
    [
        (np.nan, "its feed has NaN or infinite values"),
        (lambda t: t / 0, "NaN or infinite"),
        (lambda t: t[1:], r"gives an array \(7,\), wanted is \(8,\)"),
        (12.0, "b.u = 12 is out of range"),
        (((0, 1), (1, -3)), "b.u = -3 is out of range"),
        (((1, 1), (0, 2)), "in order of time"),
        ((), "in order of time"),
        ("fast", "is no number, steps or function"),
        (((0, "a"),), "is no number, steps or function"),
    ],
)
@pytest.mark.filterwarnings("ignore:divide by zero", "ignore:invalid value")
def test_feeds_that_cannot_be_are_refused(feed, words):
    with pytest.raises(BadInput, match=words):
        simulate(one_input(lo=-2, hi=10), Scenario("s", 2.0, inputs={"u": feed}))


@pytest.mark.parametrize("compile", [True, False])
@pytest.mark.parametrize(
    ("shape", "value", "feed", "wanted"),
    [
        ((), 3, None, [3.0] * 4),  # a Python integer
        ((), None, 2, [2.0] * 4),
        ((), None, ((0, 1), (0.5, 4)), [1, 1, 4, 4]),
        ((), None, lambda t: 3.0, [3.0] * 4),
        ((2,), None, 5.0, [[5, 5]] * 4),
        ((2,), [1, 2], None, [[1, 2]] * 4),
        ((2,), None, lambda t: np.stack([t, 4 * t], 1), [[0, 0], [0.25, 1], [0.5, 2], [0.75, 3]]),
        ((2, 2), [[1, 2], [3, 4]], None, [[[1, 2], [3, 4]]] * 4),
        ((2, 2), None, ((0, 1), (0.75, [[1, 2], [3, 4]])),
         [[[1, 1], [1, 1]]] * 3 + [[[1, 2], [3, 4]]]),
    ],
)  # fmt: skip
def test_feeds_reach_the_block_as_they_are(shape, value, feed, wanted, compile):
    inputs = {} if feed is None else {"u": feed}
    block = one_input(shape, value)
    run = simulate(block, Scenario("s", 1.0, inputs=inputs), compile=compile, log=["u", "y", "z"])
    for name in "uy":
        assert run[name].values.tolist() == np.array(wanted, dtype=float).tolist()
    assert run["z"].values[1:].tolist() == run["u"].values[:-1].tolist()


@pytest.mark.parametrize(
    ("block", "changes", "words"),
    [
        (subway.plant(), {}, r"plant is continuous; sampled\(plant, h, method\) first"),
        (unit_delay(), {}, "has no period"),
        (one_input(value=0.0), {"duration": 0.1}, "shorter than one tick of 0.25 s"),
        (one_input(value=0.0), {"params": {"m": 1.0}}, "b has no param 'm'"),
        (one_input(value=0.0), {"start": {"zz": 1.0}}, "b has no state 'zz'; did you mean 'z'?"),
        (one_input(value=0.0), {"inputs": {"v": 1.0}}, "b has no input 'v'; it has u"),
        (one_input(value=0.0), {"start": {"z": np.nan}}, "b.z is NaN"),
        (one_input(), {}, r"b.u \[1\] is not fed"),
        (closed_loop(), {"params": {"m": 9e3}}, "'m' could be plant.m or ctl.m; write which"),
    ],
)  # fmt: skip
def test_scenarios_that_do_not_fit_are_refused(block, changes, words):
    with pytest.raises(BadInput, match=words):
        simulate(block, Scenario("s", **{"duration": 1.0} | changes))


def test_unknown_names_in_the_log_are_refused():
    with pytest.raises(BadInput, match="no signal 'yy' to log; did you mean 'y'"):
        simulate(one_input(value=1.0), Scenario("s", 1.0), log=["yy"])


# ---- the result ---------------------------------------------------------------------------------


def test_the_log_says_what_it_holds():
    """Units, meaning, sign convention; version, seed and parameters with units as attributes."""
    changes = {"seed": 3, "params": {"plant.m": 9e3}, "start": {"plant.wheel.v": 15}}
    run = simulate(closed_loop(), three_rails(0.3, **changes))
    v_s = run["plant.wheel.v_s"]
    assert v_s.attrs == {
        "units": "m/s", "long_name": "slip speed, vehicle minus rim", "positive": "braking",
    }  # fmt: skip
    assert (run.time.attrs["units"], run.attrs["seed"], run.attrs["format"]) == ("s", 3, 1)
    assert json.loads(run.attrs["parameters"])["plant.m"] == {"value": 9000.0, "unit": "kg"}
    assert float(run["plant.wheel.omega"][0]) == 30.0  # v / r follows the start
    assert run.sizes["time"] == 300


def test_where_a_state_and_an_output_share_a_name_the_log_holds_the_output():
    """As a wire from that name does."""
    body = lambda v=State("1", 1.0): (dict(v=v + 1), dict(v=10 * v))  # noqa: E731
    clash = step(period=0.1, name="a", v=Output("1"))(body)
    run = simulate(connect("c", {"d.u": "a.v"}, a=clash, d=unit_delay()), Scenario("s", 0.5))
    assert run["a.v"].values.tolist() == [10, 20, 30, 40, 50]
    assert run["d.last"].values.tolist() == [0, 10, 20, 30, 40]


# ---- compile cache ------------------------------------------------------------------------------


SCRIPT = """
import hashlib, sys
from slipctl import Scenario, sampled, simulate
from slipctl.models.huang_2020.subway_braking import plant
run = simulate(sampled(plant(), 1e-3), Scenario("s", 1.0, inputs={"T_cmd": 9e3}))
print(hashlib.sha256(run["wheel.v_s"].values.tobytes()).hexdigest())
"""


def processes(count: int, cache) -> list[str]:
    """Run the script in this many processes at once on one cache; gives what they print."""
    environment = os.environ | {"SLIPCTL_CACHE": str(cache)}
    running = [
        subprocess.Popen([sys.executable, "-c", SCRIPT], env=environment, text=True,
                         stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        for _ in range(count)
    ]  # fmt: skip
    results = [p.communicate(timeout=120) for p in running]
    assert all(p.returncode == 0 for p in running), results
    return [out.strip() + err for out, err in results]


@pytest.mark.second
@pytest.mark.long
def test_parallel_runs_share_the_cache_and_a_foreign_file_is_built_again(tmp_path, needs_compiler):
    """Two processes at once on a cold cache: one library, nothing half-written, the same bits."""
    first, second = processes(2, tmp_path)
    (library,) = (p for p in tmp_path.iterdir() if p.suffix != ".sum")  # no scratch folder left
    assert first == second
    assert library.suffix == ".so"
    library.write_bytes(b"of another machine, say")
    (again,) = processes(1, tmp_path)
    assert again.startswith(first)
    assert "is damaged, building it again" in again
    run = simulate(sampled(subway.plant(), 1e-3), Scenario("s", 1.0, inputs={"T_cmd": 9e3}),
                   compile=False)  # fmt: skip
    assert hashlib.sha256(run["wheel.v_s"].values.tobytes()).hexdigest() == first


def test_without_a_compiler_everything_still_works(no_compiler):
    assert build.compile_roller(closed_loop().f) is None
    assert float(simulate(closed_loop(), three_rails(0.3))["plant.wheel.v"][-1]) < 20


def test_an_unusable_cache_folder_only_costs_time(tmp_path, monkeypatch, caplog, needs_compiler):
    file = tmp_path / "file"
    file.write_text("not a folder")
    monkeypatch.setenv("SLIPCTL_CACHE", str(file))
    with caplog.at_level(logging.WARNING):
        run = simulate(closed_loop(), three_rails(0.3))
    assert "going on without" in caplog.text
    assert same(run, simulate(closed_loop(), three_rails(0.3), compile=False))


def test_a_second_run_does_not_compile(tmp_path, monkeypatch, needs_compiler):
    monkeypatch.setenv("SLIPCTL_CACHE", str(tmp_path))
    first = simulate(closed_loop(), three_rails(0.3))
    monkeypatch.setattr(build, "_build", lambda *a: pytest.fail("compiled again"))
    assert same(first, simulate(closed_loop(), three_rails(0.3)))


@pytest.mark.second
def test_a_library_of_another_loop_or_a_damaged_one_is_not_loaded(
    tmp_path, monkeypatch, caplog, needs_compiler
):
    """Its name is not trusted: the content must be what was built under it; else it is rebuilt."""
    monkeypatch.setenv("SLIPCTL_CACHE", str(tmp_path))
    right = simulate(closed_loop(), three_rails(0.3))
    (mine,) = tmp_path.glob("*.so")
    build.compile_roller(one_input(value=1.0).f)
    (other,) = set(tmp_path.glob("*.so")) - {mine}
    whole = mine.read_bytes()
    for content in (other.read_bytes(), whole[: len(whole) // 2], whole[:-1] + b"x", b""):
        mine.unlink()  # a library that is loaded must not change
        mine.write_bytes(content)
        with caplog.at_level(logging.WARNING):
            assert same(simulate(closed_loop(), three_rails(0.3)), right)
        assert f"{mine.name} in the cache is damaged, building it again" in caplog.text
        assert mine.read_bytes() == whole
        caplog.clear()
    mine.unlink()
    mine.write_bytes(other.read_bytes())
    seal = mine.with_suffix(".sum")
    seal.write_bytes(other.with_suffix(".sum").read_bytes())
    assert same(simulate(closed_loop(), three_rails(0.3)), right)
    assert mine.read_bytes() == whole


def test_folders_of_killed_compiles_are_removed(tmp_path, monkeypatch, needs_compiler):
    monkeypatch.setenv("SLIPCTL_CACHE", str(tmp_path))
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    for number in (dead.pid, os.getpid()):
        (tmp_path / f"{build.BUILDING}{number}.x").mkdir()
    simulate(closed_loop(), three_rails(0.3))
    assert [p.name for p in tmp_path.glob(".*")] == [f"{build.BUILDING}{os.getpid()}.x"]


def test_levels_of_the_compiler_give_the_same_bits(tmp_path, monkeypatch, needs_compiler):
    """A short run is compiled faster, a long one better."""
    monkeypatch.setenv("SLIPCTL_CACHE", str(tmp_path))
    short = simulate(closed_loop(), three_rails(0.3))
    monkeypatch.setattr(build, "LONG", 1)
    assert same(simulate(closed_loop(), three_rails(0.3)), short)
    assert len(list(tmp_path.glob("*.so"))) == 2


def test_the_compiled_roll_refuses_arrays_that_do_not_fit(needs_compiler):
    """What it would read beyond the end, or as other bits, is an error before the call."""
    roller = build.compile_roller(one_input(value=1.0).f)
    x, u, p, log = np.zeros(1), np.zeros((4, 1)), np.zeros(0), np.zeros((4, 1))
    assert roller.roll(x, u, p, log, log.copy()) == 4
    for wrong in (np.zeros((4, 2)), np.zeros((4, 1), dtype=int)):
        with pytest.raises(ValueError, match="takes"):
            roller.roll(x, wrong, p, log, log.copy())
