"""Discretisation: order, stability, step check; slow parts cost nothing between their runs."""

import cmath
import math
import re
import time
from functools import cache

import casadi as ca
import numpy as np
import pytest
from conftest import INTEGRATORS
from hypothesis import given
from hypothesis import strategies as st

from slipctl import (
    BadInput,
    Block,
    Input,
    Output,
    Param,
    Scenario,
    State,
    connect,
    every,
    flow,
    law,
    make_block,
    replicate,
    sampled,
    simulate,
    step,
    unit_delay,
)
from slipctl.analysis.linearise import operating_point
from slipctl.block.transforms import discretisation
from slipctl.certify.bounds.steps import METHODS, growth, largest_step
from slipctl.models.huang_2020 import subway_braking as subway

TICK = step(period=0.1, name="tick")(lambda: ({}, {}))
"""Block that only says how long a tick is."""


@flow(name="known")
def known(x=State("1", 1.0), t=State("1", 0.0)):
    """x' = x cos t, t' = 1: x(t) = exp(sin t), nonlinear in (x, t)."""
    return dict(x=x * ca.cos(t), t=1), {}


@flow(name="mode")
def mode(
    x=State("1", 1.0),
    y=State("1", 0.0),
    re=Param("1/s", -1.0),
    im=Param("1/s", 0.0),
):
    """z' = (re + i im) z in real numbers."""
    return dict(x=re * x - im * y, y=im * x + re * y), {}


def after(block: Block, ticks: int) -> dict[str, float]:
    """States after some ticks without inputs."""
    x = block.start()
    for _ in range(ticks):
        x, _ = block(**x)
    return x


# ---- order --------------------------------------------------------------------------------------


def test_every_method_is_in_the_tuple_of_the_property_tests():
    assert {i.method: i.order for i in INTEGRATORS} == METHODS


def test_order_of_the_method(integrator):
    """Halving the step divides the error by 2^order; the slope between h = 1/80 and 1/160 s."""
    errors = [
        abs(after(sampled(known, 2 / n, integrator.method), n)["x"] - math.exp(math.sin(2)))
        for n in (160, 320)
    ]
    slope = math.log2(errors[0] / errors[1])
    # the next term of the error is one power of h smaller: a few h, and h = 1/80
    assert slope == pytest.approx(integrator.order, abs=0.05)


def test_substeps_are_steps(integrator):
    """One tick of five substeps is five ticks of a fifth, to the bit where both are unrolled."""
    fine = after(sampled(known, 0.02, integrator.method), 5)
    assert after(sampled(known, 0.1, integrator.method, substeps=5), 1) == fine


def test_many_substeps_become_a_loop_with_the_same_numbers(integrator, monkeypatch):
    straight = sampled(known, 0.1, integrator.method, substeps=5)
    monkeypatch.setattr(discretisation, "UNROLL", 0)
    looped = sampled(known, 0.1, integrator.method, substeps=5)
    assert straight.sx
    assert not looped.sx
    assert after(looped, 3) == pytest.approx(after(straight, 3), rel=1e-14)  # operations shared


def test_outputs_are_those_at_the_start_of_the_tick(integrator):
    clock = flow(y=Output("1"), name="clock")(lambda t=State("1"): (dict(t=1.0), dict(y=t)))
    n, y = sampled(clock, 0.5, integrator.method)(t=3.0)
    assert y["y"] == 3.0
    assert n["t"] == pytest.approx(3.5, rel=1e-15)


@given(st.floats(0.01, 30), st.floats(-math.pi, math.pi))
def test_one_step_multiplies_a_mode_by_the_stability_function(size, angle):
    """|x+| / |x| = |R(h lambda)| for every method, decaying or growing, stiff or not."""
    z = cmath.rect(size, angle)
    for i in INTEGRATORS:
        if i.implicit and abs(z.imag) < 0.1 and z.real > 0.5:
            continue  # near a pole of R, where the number is large and so is its rounding
        block = sampled(mode, 1.0, i.method, check=False).with_params(re=z.real, im=z.imag)
        x, _ = block(x=1.0, y=0.0)
        # the stage is a linear solve, with a condition of about |z|
        assert math.hypot(*x.values()) == pytest.approx(growth(z, i.method), rel=1e-11)


# ---- stability and the step check ---------------------------------------------------------------

FAST = 1e-4
"""Time constant in s of the stiff wheel below."""


def stiff_wheel() -> Block:
    """Dry-rail wheel so light that its slip settles with 0.1 ms.

    v_s' = -(1/m + r^2/J) F(v_s) + ..., F'(0) = m g c (b - a), so J follows from the time constant.
    """
    m, g, r, slope = 8000.0, 9.81, 0.5, 1.2 - 0.54
    J = r**2 / (1 / (FAST * m * g * slope) - 1 / m)
    return subway.plant().with_params(**{"wheel.J": J})


def test_step_check_refuses_and_what_it_recommends_passes(explicit):
    """1 ms on a wheel with 0.1 ms: refused, with a number of substeps that is the smallest."""
    plant = stiff_wheel()
    with pytest.raises(BadInput) as error:
        sampled(plant, 1e-3, explicit.method)
    text = str(error.value)
    assert f"a step of 1 ms is too long for {explicit.method}" in text
    assert "time constant on dry is 0.1 ms" in text
    assert "\n" not in text
    substeps = advised(error)
    assert sampled(plant, 1e-3, explicit.method, substeps=substeps).period == 1e-3
    with pytest.raises(BadInput, match=f"use substeps={substeps}, "):
        sampled(plant, 1e-3, explicit.method, substeps=substeps - 1)
    for method in re.findall(r"'(\w+)'", text):
        sampled(plant, 1e-3, method)


def test_step_check_speaks_of_the_worst_mode(explicit):
    """Not of the first one it meets: with modes of 1 and 0.1 ms the advice holds for both."""

    def body(x, u, p):
        return {"a": -x["a"] * 1e3, "b": -x["b"] * 1e4}, {}

    two = make_block("two", "flow", body, states=[State("1", 1.0).named(n) for n in "ab"])
    with pytest.raises(BadInput, match=r"time constant is 0\.1 ms") as error:
        sampled(two, 0.01, explicit.method)
    sampled(two, 0.01, explicit.method, substeps=advised(error))


def advised(error: pytest.ExceptionInfo) -> int:
    """Substeps that the step check recommends."""
    return int(re.search(r"substeps=(\d+)", str(error.value))[1])


def test_step_check_leaves_out_points_without_slope(explicit):
    """Torricelli's root has no slope at the empty tank where it starts."""
    tank = flow(name="tank")(lambda x=State("m"): (dict(x=-ca.sqrt(ca.fabs(x))), {}))
    assert sampled(tank, 0.1, explicit.method)()[0]["x"] == 0.0


def test_parameters_set_later_are_checked_too(explicit):
    """A plant sampled while its wheel was heavy is not run with a light one."""
    plant = sampled(subway.plant(), 1e-3, explicit.method)
    loop = connect("loop", {"plant.T_cmd": "T"}, plant=plant)
    scenario = Scenario("s", 0.01, inputs={"T": 0.0}, params={"wheel.J": 1.3})
    with pytest.raises(BadInput, match="too long"):
        simulate(loop, scenario)


def slip_after(block: Block, torque: float, seconds: float) -> tuple[float, float]:
    """Slip speed and vehicle speed after braking with a constant torque."""
    run = simulate(block, Scenario("s", seconds, inputs={"T_cmd": torque}), compile=False)
    return float(run["wheel.v_s"][-1]), float(run["wheel.v"][-1])


def steady_slip(v: float, torque: float) -> float:
    """Slip speed that stands still while the wheel slows down, v_s' = 0 on the rising branch."""
    found = operating_point(
        stiff_wheel(), {"v": v, "T_cmd": torque}, free={"omega": 2 * v}, steady=["wheel.v_s"]
    )
    return found.outputs["wheel.v_s"]


def test_explicit_methods_need_the_recommended_step(explicit):
    """With it the slip settles; with 1 ms, check switched off, it does not."""
    with pytest.raises(BadInput) as error:
        sampled(stiff_wheel(), 1e-3, explicit.method)
    substeps = advised(error)
    good, v = slip_after(sampled(stiff_wheel(), 1e-3, explicit.method, substeps), 3000, 0.2)
    bad, _ = slip_after(sampled(stiff_wheel(), 1e-3, explicit.method, check=False), 3000, 0.2)
    assert good == pytest.approx(steady_slip(v, 3000), rel=1e-4)  # v falls by 0.08 m/s meanwhile
    assert not abs(bad) < 1


@pytest.mark.parametrize("h", [1e-3, 1e-2, 0.1])
def test_implicit_methods_hold_a_stiff_wheel_at_any_step(implicit, h):
    """A-stable and more: 10 to 1000 time constants in one step, and the slip settles."""
    slip, v = slip_after(sampled(stiff_wheel(), h, implicit.method), 3000, 1.0)
    # steady slip moves with v by 1e-5 m/s in a step of 0.1 s
    assert slip == pytest.approx(steady_slip(v, 3000), rel=1e-4)


@cache
def stiff_step(h=None, *args, **options) -> Block:
    """The stiff wheel, sampled or (without h) continuous, made once."""
    return stiff_wheel() if h is None else sampled(stiff_wheel(), h, *args, **options)


@pytest.mark.second
@given(st.sampled_from([1e-4, 1e-3, 1e-2]), st.floats(5, 40), st.floats(0, 1.1), st.floats(0, 9e3))
def test_implicit_stages_are_solved(h, v, v_s, torque):
    """On the rising branch of the curve, from 1 to 100 time constants, eight iterations do.

    Implicit Euler: x+ = x + h f(x+) to rounding. SDIRK2: as with sixteen iterations.
    """
    x = {"wheel.x": 0.0, "wheel.v": v, "wheel.omega": (v - v_s) / 0.5, "wheel.phi": 0.0}
    n, _ = stiff_step(h, "implicit_euler")(**x, T_cmd=torque)
    rate, _ = stiff_step()(**n, T_cmd=torque)
    for name, value in n.items():
        assert value == pytest.approx(x[name] + h * rate[name], rel=1e-9, abs=1e-9)
    n, _ = stiff_step(h, "sdirk2")(**x, T_cmd=torque)
    more, _ = stiff_step(h, "sdirk2", newton=16)(**x, T_cmd=torque)
    assert n == pytest.approx(more, rel=1e-9, abs=1e-9)


@given(st.floats(1e-3, 1e5), st.floats(math.pi / 2 + 1e-7, math.pi))
def test_the_largest_step_is_the_edge_of_stability(size, angle):
    """|R| <= 1 up to it and > 1 just beyond, from undamped to real modes; infinite if A-stable."""
    for sign in (1, -1):
        eigenvalue = cmath.rect(size, sign * angle)
        for i in INTEGRATORS:
            h = largest_step(eigenvalue, i.method)
            if i.implicit:
                assert h == math.inf
                continue
            for share in np.linspace(0, 1, 30):
                assert growth(share * h * eigenvalue, i.method) <= 1 + 1e-11  # tolerance inside
            assert growth(1.001 * h * eigenvalue, i.method) > 1


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: sampled(known, 0.0), "h = 0 s must be positive"),
        (lambda: sampled(known, math.nan), "h = nan s must be positive"),
        (lambda: sampled(known, 0.1, "rk5"), "unknown method 'rk5'; did you mean 'rk4'?"),
        (lambda: sampled(known, 0.1, substeps=0), "must be a whole number >= 1"),
        (lambda: sampled(known, 0.1, substeps=1.5), "must be a whole number >= 1"),
        (lambda: sampled(unit_delay(), 0.1), "unit_delay is a step; only a flow can be sampled"),
        (lambda: every(known, 2), "a flow has no ticks; sampled"),
        (lambda: every(unit_delay(), 0), "n = 0 must be a whole number >= 1"),
        (lambda: every(unit_delay(), math.nan), "n = nan must be a whole number >= 1"),
        (lambda: every(unit_delay(), 2, offset=2), "offset = 2 must be a whole number in 0..1"),
    ],
)
def test_wrong_times_are_refused(make, words):
    with pytest.raises(BadInput, match=words):
        make()


# ---- every, unit_delay --------------------------------------------------------------------------


@step(y=Output("1"), name="counter")
def counter(s=State("1", 1.0), u=Input("1")):
    """s+ = 2 s + u, y = s + 10 u: both remember which ticks were run."""
    return dict(s=2 * s + u), dict(y=s + 10 * u)


@given(st.integers(1, 5), st.integers(0, 4), st.lists(st.integers(-9, 9), min_size=1, max_size=23))
def test_every_is_a_decimated_run_held_between(n, offset, u):
    """Against a plain loop that runs at the ticks offset, offset + n, ...; exact integers."""
    offset %= n
    block = every(counter, n, offset)
    x, s, y = block.start(), 1.0, 0.0
    for k, value in enumerate(u):
        x, out = block(**x, u=value)
        if k % n == offset:
            s, y = 2 * s + value, s + 10 * value
        assert (x["s"], out["y"]) == (s, y)


def test_every_of_a_law_samples_and_holds_it():
    """Also inside another every, and where the output's range excludes the zero it starts at."""
    twice = law(y=Output("1", lo=1, hi=99), name="twice")(lambda u=Input("1"): 2 * u)
    block = every(every(twice, 2), 3)
    x, outputs = block.start(), []
    for u in range(1, 14):
        x, out = block(**x, u=float(u))
        outputs.append(out["y"])
    assert outputs == [2, 2, 2, 2, 2, 2, 14, 14, 14, 14, 14, 14, 26]
    assert every(twice, 2).period is None
    assert every(step(period=0.3, name="b")(lambda: ({}, {})), 3).period == pytest.approx(0.1)


class Count(ca.Callback):
    """Identity that counts how often it is evaluated."""

    def __init__(self):
        ca.Callback.__init__(self)
        self.calls = 0
        self.construct("count", {})

    def eval(self, arg):
        self.calls += 1
        return arg


def counting(count: Count) -> Block:
    def body(x, u, p):
        return {"s": count(x["s"]) + 1}, {"y": x["s"]}

    return make_block("work", "step", body, states=[State("1", 0.0).named("s")],
                      outputs=[Output("1").named("y")], sx=False)  # fmt: skip


@pytest.mark.parametrize(("n", "offset"), [(1, 0), (4, 0), (4, 3), (50, 7)])
def test_skipped_work_is_not_computed(n, offset):
    """Counted: the inside runs at its own ticks and at no other."""
    count = Count()
    loop = connect("loop", {}, work=every(counting(count), n, offset), tick=TICK)
    run = simulate(loop, Scenario("s", 10.0), compile=False)
    assert count.calls == len(range(offset, 100, n))
    assert float(run["work.s"][-1]) == len(range(offset, 99, n))


@pytest.mark.second
def test_skipped_work_takes_no_time_when_compiled(needs_compiler):
    """A heavy part every 40 ticks: at least 8 times as fast as at each tick (40 would be ideal)."""
    x = ca.MX.sym("x")
    inner = ca.Function("inner", [x], [ca.sin(x) + x]).fold(20_000)

    def seconds(n):
        heavy = make_block("work", "step", lambda x, u, p: ({"s": inner(x["s"])}, {}),
                           states=[State("1", 0.1).named("s")], sx=False)  # fmt: skip
        loop = connect("loop", {}, work=every(heavy, n), tick=TICK)
        simulate(loop, Scenario("s", 0.1))  # compile
        times = []
        for _ in range(3):
            began = time.thread_time()  # of the processor: what else runs here does not count
            simulate(loop, Scenario("s", 40.0))
            times.append(time.thread_time() - began)
        return min(times)

    assert seconds(1) > 8 * seconds(40)


def test_unit_delay_gives_the_value_of_the_tick_before():
    delay = unit_delay("m", value=7.0, shape=(2,))
    loop = connect("loop", {"d.u": "u", "y": "d.y"}, d=delay, tick=TICK)
    u = lambda t: np.stack([t, -t], axis=1)  # noqa: E731
    run = simulate(loop, Scenario("s", 1.0, inputs={"u": u}), log=["u", "y"])
    assert (run["y"].values[0] == 7.0).all()
    assert (run["y"].values[1:] == run["u"].values[:-1]).all()


@flow(a=Output("m/s^2", "acceleration"))
def sprung(
    x=State("m", 1.0),
    v=State("m/s", 0.0),
    F=Input("N", "force", value=0.0),
    m=Param("kg", 2.0, lo=0.1),
    k=Param("N/m", 8.0),
):
    """m x'' = F - k x."""
    a = (F - k * x) / m
    return dict(x=v, v=a), dict(a=a)


@step()
def damping(
    v=Input("m/s", "speed"),
    F=State("N", 0.0, "force of the tick before"),
    m=Param("kg", 2.0, lo=0.1),
    d=Param("N s/m", 1.0),
):
    """A damper that knows the mass."""
    return dict(F=-d * m * v), {}


def braced(**values: float) -> Block:
    """A loop with all ways to be in another time, with numbers given to its parts by hand."""

    def has(block: Block) -> Block:
        known = {n: v for n, v in values.items() if n in (*block.params, *block.states)}
        return block.with_params(**known)

    parts = {
        "mass": sampled(has(sprung), 0.01, "rk4", substeps=2),
        "ctl": every(has(damping), 3),
        "many": replicate(sampled(has(sprung), 0.01, "euler"), 2, distinct=["k"]),
    }
    wires = {"ctl.v": "mass.v", "mass.F": "ctl.F"}
    return connect("braced", wires, share={"m": "*.m"}, **parts)


def test_blocks_that_differ_in_numbers_share_their_equations():
    loop = braced()
    changed = loop.with_params(**{"m": 3.0, "ctl.d": 0.5, "mass.k": 9.0, "mass.v": 0.25})
    by_hand = braced(m=3.0, d=0.5)
    assert changed.f is loop.f  # nothing is worked out again
    assert changed.f.serialize() == by_hand.f.serialize()  # and it is what would come out
    log, other = (simulate(b, Scenario("s", 0.3)) for b in (loop, changed))
    assert not np.array_equal(log["mass.x"], other["mass.x"])
    _, y = changed(**{"ctl.F": 1.5})
    assert y["mass.a"] == (1.5 - 9.0 * 1.0) / 3.0


def test_another_structure_has_its_own_equations():
    loop = braced()
    apart = loop.with_params(**{"ctl.m": 3.0})  # leaves the share: one more parameter
    assert apart.f is not loop.f
    assert apart.f.size1_in(2) == loop.f.size1_in(2) + 1
    assert loop.renamed("other").f.name() == "other"
    assert loop.with_params(m=3.0).renamed("other").f.name() == "other"
    held = step(name="held", period=0.01)(lambda v=Input("m/s"), F=State("N"): ({"F": v}, {}))
    swapped = loop.swap("ctl", held)
    assert swapped.f is not loop.f


@pytest.mark.parametrize("method", ["rk4", "euler"])
def test_an_accepted_step_follows_a_wheel_that_locks(method):
    """The mode of a locking wheel under the largest torque counts, and not that of the start alone.

    The right speeds are those of scipy's Radau. The longest step that is accepted and one that is
    half as long again stand on both sides of the bound.
    """
    from scipy.integrate import solve_ivp

    from slipctl.models import brakes
    from slipctl.models.huang_2020 import subway_braking

    m, J, r, g, v_0, T, end = 8000.0, 240.0, 0.5, 9.81, 5.0, 20e3, 1.2

    def rates(_, y):
        v, w = y
        s = v - r * w
        mu = np.sign(s) * (np.exp(-0.54 * abs(s)) - np.exp(-1.2 * abs(s)))
        fall = mu * g + (150 + 5 * v + 0.35 * v * v) / m
        return [-fall, (r * mu * m * g - T * np.clip(w / 0.1, -1, 1)) / J]

    right = solve_ivp(rates, (0, end), [v_0, v_0 / r], "Radau", rtol=1e-10, atol=1e-12).y[:, -1]
    plant = subway_braking.plant(brake=brakes.brake())
    with pytest.raises(BadInput, match="wheels that stand with the largest inputs") as refused:
        sampled(plant, 0.05, method)
    longest = float(re.search(r"allows (\S+) ms", str(refused.value))[1]) * 1e-3
    h = end / np.ceil(end / (0.98 * longest))
    start = {"wheel.v": v_0, "wheel.omega": v_0 / r}
    scenario = Scenario("x", end + h, inputs={"T_cmd": T}, start=start)
    log = simulate(sampled(plant, h, method), scenario, compile=False)
    k = int(np.argmin(abs(log["time"].values - end)))
    assert log["wheel.omega"].values[k] == pytest.approx(right[1], abs=0.02)
    assert log["wheel.v"].values[k] == pytest.approx(right[0], abs=0.02)
    late = sampled(plant, 1.5 * longest, method, check=False)
    log = simulate(late, scenario, compile=False)
    assert abs(log["wheel.omega"].values[-100:] - right[1]).max() > 0.05
