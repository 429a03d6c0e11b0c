"""Linear models, operating points and python-control, against differences, scipy and by hand."""

import math

import control as ct
import numpy as np
import pytest
from conftest import closed_loop
from scipy.integrate import solve_ivp

from slipctl import (
    BadInput,
    Block,
    Input,
    Output,
    Param,
    RunFailed,
    Scenario,
    State,
    connect,
    every,
    flow,
    law,
    linear,
    make_block,
    nonlinear,
    operating_point,
    sampled,
    simulate,
    step,
    unit_delay,
)
from slipctl.models.brakes import brake
from slipctl.models.huang_2020 import subway_braking as subway
from slipctl.models.huang_2020 import subway_braking_control as control

M, J, R, G, A, B = 8000.0, 240.0, 0.5, 9.81, 0.54, 1.2


def start(block: Block) -> np.ndarray:
    return block.pack("state", block.start()).full().ravel()


# ---- linear -------------------------------------------------------------------------------------


def differences(f, z: np.ndarray) -> np.ndarray:
    """Central differences; error about (machine epsilon)^(2/3) of the largest slope."""
    columns = []
    for k in range(len(z)):
        h = 6e-6 * (1 + abs(z[k]))
        e = np.eye(len(z))[k] * h
        columns.append((f(z + e) - f(z - e)) / (2 * h))
    return np.array(columns).T


BLOCKS = {
    "wheelset": (subway.wheelset(), {"T_b": 9e3, "mu": 0.2, "v": 18.0, "omega": 35.0}),
    "plant": (subway.plant(brake=brake(lag=True)), {"T_cmd": 9e3, "T_b": 7e3, "omega": 38.5}),
    "sampled": (sampled(subway.plant(), 1e-3), {"T_cmd": 9e3, "omega": 38.5}),
    "implicit": (sampled(subway.plant(), 2e-3, "sdirk2"), {"T_cmd": 9e3, "omega": 38.5}),
    "loop": (closed_loop(), {"v_opt": 1.2, "plant.wheel.omega": 38.1}),
    "every": (every(sampled(subway.plant(), 1e-3), 3), {"T_cmd": 9e3, "omega": 38.5}),
    "law": (subway.double_exponential, {"v_s": 0.7}),
}


@pytest.mark.parametrize("name", BLOCKS)
def test_jacobians_are_those_of_finite_differences(name):
    """Every entry of A, B, C, D, for flows, steps, laws, SX and MX."""
    block, at = BLOCKS[name]
    system = linear(block, at)
    x, u, p = block.point(**{block.find(k, "state", "input", "param"): v for k, v in at.items()})
    z = np.concatenate([block.pack(r, v).full().ravel() for r, v in (("state", x), ("input", u))])
    p, nx = block.pack("param", p), len(block.states)

    def f(z):
        return np.concatenate([v.full().ravel() for v in block.f(z[:nx], z[nx:], p)])

    exact = np.block([[system.A, system.B], [system.C, system.D]])
    by_differences = differences(f, z)
    scale = np.abs(by_differences).max(axis=1, keepdims=True) + 1
    assert np.abs(exact - by_differences) / scale == pytest.approx(0, abs=1e-7)  # differences' own
    wanted = {"flow": 0, "step": block.period, "law": None}[block.kind]
    assert system.dt == wanted
    names = [system.state_labels, system.input_labels, system.output_labels]
    given = [block.states, block.inputs, block.outputs]
    assert names == [[n.replace(".", "_") for n in g] for g in given]


@pytest.mark.parametrize("v_s", [0.0, 0.5, 1.2098601, 3.0])
def test_slip_dynamics_by_hand(v_s):
    """(v, omega) -> v_s of the wheelset on dry rail, by pencil.

    With F' = m g mu'(v_s) and D = f'(v):
    A = [[-(F' + D)/m, r F'/m], [r F'/J, -r^2 F'/J]], B = [0, -1/J]; for D = 0 the modes are 0 and
    -(1/m + r^2/J) F': stable below the peak, unstable beyond.
    """
    plant = subway.plant().with_params(**{"air.k1": 0.0, "air.k2": 0.0})
    system = linear(plant, {"v": 20.0, "omega": (20 - v_s) / R, "T_cmd": 5e3}, outputs=["v_s", "v"])
    F = M * G * (B * math.exp(-B * v_s) - A * math.exp(-A * v_s))
    by_hand = np.array([[-F / M, R * F / M], [R * F / J, -(R**2) * F / J]])
    assert system.A[1:3, 1:3] == pytest.approx(by_hand, rel=1e-12, abs=1e-9)
    assert system.B.ravel() == pytest.approx([0, 0, -1 / J, 0], rel=1e-14)
    assert pytest.approx(np.array([[0, 1, -R, 0], [0, 1, 0, 0]]), rel=1e-14) == system.C
    mode = -(1 / M + R**2 / J) * F
    modes = np.linalg.eigvals(system.A).real
    assert modes[np.argmax(np.abs(modes))] == pytest.approx(mode, rel=1e-9, abs=1e-5)
    # torque to slip without the integrators: (r/J) / (s - mode)
    slip = system["wheel_v_s", "T_cmd"]
    s = 3j
    assert complex(slip(s)) == pytest.approx(R / J / (s - mode), rel=1e-6)


def test_sampling_a_linear_flow_is_the_matrix_exponential():
    """RK4 agrees with python-control's exact discretisation to (h lambda)^5 / 120 = 2e-10."""
    straight = make_block(
        "straight", "flow", lambda x, u, p: ({"x": -30 * x["x"] + u["u"]}, {"y": x["x"]}),
        states=[State("1").named("x")], inputs=[Input("1").named("u")],
        outputs=[Output("1").named("y")],
    )  # fmt: skip
    exact = ct.sample_system(linear(straight, {"u": 0.0}), 1e-3)
    ours = linear(sampled(straight, 1e-3), {"u": 0.0})
    assert pytest.approx(exact.A, abs=3e-10) == ours.A
    assert pytest.approx(exact.B, abs=3e-10) == ours.B
    assert ours.dt == 1e-3


def test_inputs_and_outputs_are_chosen_in_order_states_too():
    """Matrix elements have their place in the name; without outputs the states are seen."""
    system = linear(BLOCKS["plant"][0], BLOCKS["plant"][1], ["T_cmd"], ["wheel.x", "mu", "v_s"])
    assert system.output_labels == ["wheel_x", "adh_mu", "wheel_v_s"]
    assert system.C[0].tolist() == [1, 0, 0, 0, 0]
    matrix = make_block(
        "b", "step", lambda x, u, p: ({"X": p["A"] @ x["X"] + u["u"][0]}, {}), period=0.1,
        states=[State("1", 0.0, shape=(2, 2)).named("X")],
        inputs=[Input("1", shape=(2,)).named("u")],
        params=[Param("1", [[1, 2], [3, 4]], shape=(2, 2)).named("A")],
    )  # fmt: skip
    system = linear(matrix, {"u": 0.0})
    assert system.state_labels == ["X[0,0]", "X[1,0]", "X[0,1]", "X[1,1]"]
    assert system.input_labels == ["u[0]", "u[1]"]
    assert system.output_labels == system.state_labels
    assert (np.kron(np.eye(2), [[1, 2], [3, 4]]) == system.A).all()
    assert system.B.tolist() == [[1, 0]] * 4


def test_a_parameter_may_be_an_input():
    """Slope by a mass, with what is derived from it: exact, by hand; loops without inputs too."""

    @flow(name="disc")
    def disc(omega=State("rad/s", 4.0), m=Param("kg", 10.0), J=Param("kg m^2", "m / 8")):
        return dict(omega=-omega / J), {}

    system = linear(disc, inputs=["m"])
    assert pytest.approx(np.array([[-0.8]]), rel=1e-14) == system.A
    assert pytest.approx(np.array([[0.32]]), rel=1e-14) == system.B  # 8 omega / m^2
    with pytest.raises(BadInput, match=r"needs an input and an output; .* inputs=\['m'\]"):
        linear(disc)


@pytest.mark.parametrize(
    ("block", "options", "words"),
    [
        (subway.plant(), {}, r"plant needs the input T_cmd \[N m\]"),
        (subway.plant(), {"at": {"T": 1.0}}, "plant has no state or input or param 'T'"),
        (subway.plant(), {"at": {"wheel.m": 1.0}}, "wheel.m is shared as m; write m"),
        (subway.plant(), {"at": {"m": -1.0}}, "out of range"),
        (subway.plant(), {"at": {"T_cmd": 0}, "outputs": ["slip"]}, "no output or state 'slip'"),
        (control.super_twisting(), {"at": {"v_s": 1.0, "v_ref": 1.0, "T_eq": 9e3}},
         r"the slope of .* by v_s is (nan|inf)"),
    ],
)  # fmt: skip
def test_what_cannot_be_linearised_is_told(block, options, words):
    with pytest.raises(BadInput, match=words):
        linear(block, **options)


# ---- operating points ---------------------------------------------------------------------------


def test_steady_slip_and_its_torque_in_closed_form():
    """v_s' = 0 while the wheel slows down: T = r F + (J / (r m)) (F + f + W)."""
    for v, v_s, rail in ((20.0, 1.0, "dry"), (12.0, 2.5, "wet"), (5.0, 0.3, "ice")):
        plant = subway.plant().with_params(
            **{f"adh.{k}": c for k, c in subway.TABLE_1[rail].items()}, **{"curve.kappa": 1 / 400}
        )
        found = operating_point(
            plant, {"v": v, "wheel.v_s": v_s}, free=["omega", "T_cmd"], steady=["wheel.v_s"]
        )
        c = subway.TABLE_1[rail]["c"]
        F = M * G * c * (math.exp(-A * v_s) - math.exp(-B * v_s))
        f, W = 150 + 5 * v + 0.35 * v**2, 0.6 / 400 * M * G
        assert found.outputs["adh.mu"] * M * G == pytest.approx(F, rel=1e-12)
        assert found.inputs["T_cmd"] == pytest.approx(R * F + J / (R * M) * (F + f + W), rel=1e-10)
        assert found.states["wheel.omega"] == pytest.approx((v - v_s) / R, rel=1e-12)
        assert found.rates["wheel.v"] == pytest.approx(-(F + f + W) / M, rel=1e-10)
        assert found.rates["wheel.v"] == pytest.approx(R * found.rates["wheel.omega"], rel=1e-9)
        # the law of the controller gives the same torque
        equivalent = control.equivalent_torque(mu_hat=found.outputs["adh.mu"], f_hat=f, W_hat=W)
        assert found.inputs["T_cmd"] == pytest.approx(equivalent["T_eq"], rel=1e-10)


def test_the_start_chooses_between_two_slips():
    """One torque below the peak has a slip on each side of it."""
    plant = subway.plant()
    below = operating_point(plant, {"v": 20, "T_cmd": 8e3}, {"omega": 39.9}, ["wheel.v_s"])
    beyond = operating_point(plant, {"v": 20, "T_cmd": 8e3}, {"omega": 35.0}, ["wheel.v_s"])
    assert below.outputs["wheel.v_s"] < 1.2098601 < beyond.outputs["wheel.v_s"]
    for point in (below, beyond):
        assert point.rates["wheel.v"] == pytest.approx(R * point.rates["wheel.omega"], rel=1e-9)
    stable = [np.linalg.eigvals(linear(plant, p).A).real.max() < 1e-3 for p in (below, beyond)]
    assert stable == [True, False]


def test_equilibrium_of_a_step_and_of_a_flow():
    """x+ = x and x' = 0: the discretised plant with thrust against air has the flow's top speed."""

    @flow(y=Output("m/s"), name="coach")
    def coach(v=State("m/s", 20.0, lo=0), F=Input("N"), m=Param("kg", 8e3)):
        return dict(v=(F - 150 - 5 * v - 0.35 * v**2) / m), dict(y=v)

    top = (-5 + math.sqrt(25 + 4 * 0.35 * 850)) / 0.7
    for block in (coach, sampled(coach, 0.1), sampled(coach, 0.1, "implicit_euler")):
        found = operating_point(block, {"F": 1000.0})
        assert found.states["v"] == pytest.approx(top, rel=1e-9)
        assert found.rates["v"] == pytest.approx(0, abs=1e-9)
    assert operating_point(coach, {"y": 30.0}, free=["v", "F"]).inputs["F"] == pytest.approx(615)


def test_a_point_can_be_handed_to_linear():
    """Changed parameters included."""
    found = operating_point(
        subway.plant(), {"v": 20, "v_s": 1.0, "adh.c": 0.3}, ["omega", "T_cmd"], ["wheel.v_s"]
    )
    at = {"v": 20, "omega": 38, "adh.c": 0.3, "T_cmd": found.inputs["T_cmd"]}
    assert (linear(subway.plant(), found).A == linear(subway.plant(), at).A).all()


@pytest.mark.parametrize(
    ("fixed", "options", "error", "words"),
    [
        ({"v": 20, "T_cmd": 1e5}, {"free": ["omega"]}, RunFailed,
         r"at wheel.omega = .* there remains rate of wheel.omega = .*; start elsewhere"),
        ({"T_cmd": 0.0}, {"free": ["x"]}, RunFailed,
         "rate of wheel.x does not depend on what is free"),
        ({"v": 20}, {"free": ["omega"]}, BadInput,
         r"needs the input T_cmd \[N m\]"),
        ({"v": 20, "v_s": 1.0, "T_cmd": 0}, {"free": ["omega"], "steady": ["wheel.v_s"]}, BadInput,
         r"1 unknowns \(wheel.omega\) and 2 equations \(rate of wheel.v_s = 0, wheel.v_s - 1"),
        ({"v": 20, "T_cmd": 0}, {"free": ["v"]}, BadInput, "wheel.v is both fixed and free"),
        ({"speed": 20}, {}, BadInput, "has no state or input or param or output 'speed'"),
        ({"v": 20, "m": 1.0}, {}, BadInput, "out of range"),
    ],
)  # fmt: skip
def test_what_has_no_operating_point_is_told(fixed, options, error, words):
    with pytest.raises(error, match=words):
        operating_point(subway.plant(), fixed, **options)


def test_a_law_has_no_operating_point():
    with pytest.raises(BadInput, match="is a law"):
        operating_point(subway.double_exponential)


def test_the_printed_plant_has_no_braking_equilibrium():
    """Equation (6) as printed holds a slip only with a torque that drives."""
    printed = subway.plant(wheel=subway.wheelset("printed-6"))
    found = operating_point(
        printed, {"v": 20, "wheel.v_s": 1.0}, ["omega", "T_cmd"], steady=["wheel.v_s"]
    )
    assert found.inputs["T_cmd"] < 0


# ---- python-control -----------------------------------------------------------------------------


def test_python_control_and_scipy_simulate_the_plant_as_we_do():
    """Braking at 9 kN m for 1 s from rolling: three integrators, one trajectory."""
    plant = subway.plant()
    times = np.linspace(0, 1, 101)
    theirs = ct.input_output_response(
        nonlinear(plant), times, np.full(101, 9e3), X0=start(plant),
        solve_ivp_kwargs={"rtol": 1e-9, "atol": 1e-9, "method": "LSODA"},
    )  # fmt: skip
    p = plant.pack("param", plant.param_values())
    scipy = solve_ivp(lambda t, x: plant.f(x, 9e3, p)[0].full().ravel(), (0, 1), start(plant),
                      t_eval=times, rtol=1e-9, atol=1e-9, method="LSODA")  # fmt: skip
    ours = simulate(sampled(plant, 0.01, substeps=20), Scenario("s", 1.01, inputs={"T_cmd": 9e3}))
    # tolerances of the two others, over 100 time constants of the wheel
    assert theirs.states[2] == pytest.approx(ours["wheel.omega"].values, abs=1e-6)
    assert scipy.y[2] == pytest.approx(ours["wheel.omega"].values, abs=1e-6)
    slip = theirs.outputs[theirs.output_labels.index("wheel_v_s")]
    assert slip == pytest.approx(ours["wheel.v_s"].values, abs=1e-6)


def test_a_step_block_runs_in_python_control_to_the_bit():
    """Discrete loops have no integrator between: the same states after 50 ticks."""
    loop = closed_loop()
    times = np.arange(50) * 1e-3
    u = np.array([[1.2] * 50, [10.0] * 50])
    theirs = ct.input_output_response(nonlinear(loop), times, u, X0=start(loop))
    ours = simulate(loop, Scenario("s", 0.05, inputs={"v_opt": 1.2, "a_demand": 10.0}))
    for k, name in enumerate(loop.states):
        assert (theirs.states[k] == ours[name].values).all(), name


@pytest.mark.filterwarnings("ignore:Unused")  # the wheel's other signals
def test_interconnection_by_python_control_is_ours():
    """Wheelset, adhesion law and a controller of python-control, joined there and here."""

    @law(T_b=Output("N m"), name="pi")
    def gain(v_s=Input("m/s")):
        return 9e3 - 4e3 * v_s

    parts = {"wheel": subway.wheelset(), "adh": subway.double_exponential, "pi": gain}
    wires = {"wheel.mu": "adh.mu", "adh.v_s": "wheel.v_s", "pi.v_s": "wheel.v_s",
             "wheel.T_b": "pi.T_b"}  # fmt: skip
    ours = connect("loop", wires, **parts)
    systems = [nonlinear(b.renamed(n)) for n, b in parts.items()]
    theirs = ct.interconnect(systems, [list(w) for w in wires.items()], inplist=["wheel.f"],
                             outlist=["wheel.v_s"])  # fmt: skip
    x, u = start(ours) - [0, 0, 3.0, 0], np.zeros(len(ours.inputs))
    p = ours.pack("param", ours.param_values())
    assert theirs.dynamics(0, x, [0.0]) == pytest.approx(
        ours.f(x, u, p)[0].full().ravel(), rel=1e-13
    )  # fmt: skip
    linear_there = ct.linearize(theirs, x, [0.0], eps=1e-6)
    by_states = dict(zip(ours.states, x, strict=True))
    assert pytest.approx(linear_there.A, abs=1e-3) == linear(ours, by_states).A  # theirs: one-sided


def test_parameters_change_in_python_control_by_name():
    """Derived ones follow, impossible ones are refused, those of other systems are left alone."""

    @flow(y=Output("1"), name="b")
    def block(x=State("1", 1.0), k=Param("1", 2.0, lo=0), double=Param("1", "2 * k")):
        return dict(x=-double * x), dict(y=k)

    system = nonlinear(block)
    assert system.dynamics(0, [1.0], [], {"k": 3.0}) == [-6.0]
    assert system.dynamics(0, [1.0], [], {}) == [-4.0]
    assert system.output(0, [1.0], [], {"b.k": 5.0, "c.k": 6.0, "q": 7.0}) == [5.0]
    with pytest.raises(BadInput, match="out of range"):
        system.dynamics(0, [1.0], [], {"k": -3.0})


def test_time_bases_are_those_of_the_blocks():
    """0 continuous, the period of a step, open for a step without one, none for a law."""
    tick = step(period=0.25, name="tick")(lambda x=State("1"): (dict(x=x), {}))
    blocks = (subway.plant(), tick, unit_delay(), subway.double_exponential)
    bases = {b: nonlinear(b).dt for b in blocks}
    assert list(bases.values()) == [0, 0.25, True, None]
    for block, base in bases.items():
        if block.inputs:
            assert linear(block, dict.fromkeys(block.inputs, 0.5)).dt == base


def test_names_that_collide_without_dots_stay_different():
    deep = connect("a", {}, b_d=unit_delay())
    block = connect("c", {}, a=deep, a_b=connect("a_b", {}, d=unit_delay()))
    assert list(block.states) == ["a.b_d.last", "a_b.d.last"]
    assert nonlinear(block).state_labels == ["a_b_d_last", "a_b_d_last_"]
