"""What a predictive controller knows of the future: its end, references ahead, limits by laws."""

import numpy as np
import pytest
import scipy.linalg

from slipctl import (
    BadInput,
    Input,
    Output,
    Scenario,
    State,
    connect,
    flow,
    law,
    nmpc,
    one,
    sampled,
    simulate,
)
from slipctl.ccode import codegen
from slipctl.predict.trials import Driver

H = 0.1


@flow()
def cart(
    x=State("m", 0.0, "position"), v=State("m/s", 0.0, "speed"),
    F=Input("N", "force", lo=-50, hi=50), load=Input("N", "what pushes back", value=0.0),
):  # fmt: skip
    """One kilogram."""
    return dict(x=v, v=(F - load) / one("kg")), {}


@law(e=Output("m/s"), f=Output("N"))
def speed(v=Input("m/s", "speed"), w=Input("m/s", "wanted", value=0.0), F=Input("N", "force")):
    """Speed error and force."""
    return dict(e=v - w, f=F)


@law(p=Output("m"), f=Output("N"))
def place(x=Input("m", "position"), to=Input("m", "wanted", value=0.0), F=Input("N", "force")):
    """Distance to go and force."""
    return dict(p=x - to, f=F)


def test_an_input_of_a_connected_plant_goes_by_its_short_name():
    """Where two end alike, both go by their whole names."""
    from slipctl.predict.stages.joint_flow import join_flows

    apart = connect("one", {}, a=cart)
    assert join_flows("nmpc", apart, {})[1] == {"a.F": "F", "a.load": "load"}
    names = join_flows("nmpc", connect("two", {}, a=cart, b=cart), {})[1]
    assert (names["a.F"], names["b.F"]) == ("a_F", "b_F")


def make(cost, **options):
    """Controller of the cart."""
    weights = dict.fromkeys(cost.outputs, 0.3) | {next(iter(cost.outputs)): 3.0}
    return nmpc(cart, cost, "F", **{"h": H, "horizon": 10, "weights": weights, **options})


def ask(block, **given):
    """Control and status of a first tick."""
    values = {
        n: given.get(n, s.value if s.value is not None else 0) for n, s in block.inputs.items()
    }
    return Driver(block, compile=False)(*values.values())[:2]


@pytest.mark.parametrize("load", [0.0, 2.0])
@pytest.mark.parametrize("cost", [speed, place], ids=["a state unseen", "all seen"])
def test_three_stages_before_the_regulators_cost_to_go_are_a_long_horizon(cost, load):
    """Under a load the best steady state has a cost of its own, whose multiplier counts.

    2e-6: what 150 stages leave of a rotated cost, whose last stages run away from the rest.
    """
    state = dict(x=0.4, v=-0.3, load=load, w=1.0, to=2.0)
    short = ask(make(cost, horizon=3, terminal="lqr"), **state)
    long = ask(make(cost, horizon=150), **state)
    assert short == pytest.approx(long, abs=2e-6)


def test_the_gain_before_the_regulators_cost_to_go_is_that_of_riccati():
    """Against scipy's discrete algebraic Riccati equation, with the exact step of the cart."""
    A, B = np.array([[1, H], [0, 1]]), np.array([[H * H / 2], [H]])
    Q, R = np.diag([9.0, 0]), np.array([[0.09]])
    P = scipy.linalg.solve_discrete_are(A, B, Q, R)
    K = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
    for horizon in (1, 4):
        block = make(place, horizon=horizon, terminal="lqr")
        assert ask(block, x=0.2, v=0.1)[0] == pytest.approx(-float((K @ [0.2, 0.1])[0]), rel=1e-9)
        own = make(place, horizon=horizon, terminal=P)
        assert ask(own, x=0.2, v=0.1)[0] == pytest.approx(-float((K @ [0.2, 0.1])[0]), rel=1e-9)
        # shifted with its reference
        moved = ask(own, x=1.2, v=0.1, to=1.0)[0]
        assert moved == pytest.approx(-float((K @ [0.2, 0.1])[0]), rel=1e-9)


def test_a_law_of_its_own_counts_in_the_last_stage():
    """One stage, 1/2 (.3 F)^2 + 1/2 (5 (v + F h - w))^2, by hand."""

    @law(rest=Output("m/s"))
    def end(v=Input("m/s", "speed"), w=Input("m/s", "wanted")):
        """Speed error at the end."""
        return v - w

    block = make(speed, horizon=1, terminal=end, weights={"e": 3.0, "f": 0.3, "rest": 5.0})
    assert "weight_rest" in block.params
    F = 25 * H * 1.5 / (0.09 + 25 * H * H)
    assert ask(block, v=0.5, w=2.0)[0] == pytest.approx(F, rel=1e-9)


def dense(v, ahead, loads):
    """First force of the unlimited problem over N stages, as one least-squares problem."""
    N = len(ahead) - 1
    rows, right = [], []
    for k in range(N + 1):
        row = np.zeros(N)
        row[:k] = H  # v_k = v + h sum (F - load)
        rows.append(3 * row)
        right.append(3 * (ahead[k] - v + H * sum(loads[:k])))
    for k in range(N):
        row = np.zeros(N)
        row[k] = 0.3
        rows.append(row)
        right.append(0.0)
    return np.linalg.lstsq(np.array(rows), np.array(right), rcond=None)[0][0]


@pytest.mark.parametrize("solver", ["riccati", "osqp", "ipopt"])
def test_references_and_loads_ahead_count_when_they_come(solver):
    """1e-6: the comparison solvers end there."""
    ahead, loads = np.r_[np.zeros(4), np.ones(7)], np.r_[np.zeros(2), np.full(9, 1.5)]
    block = make(speed, preview=["w", "load"], solver=solver)
    assert block.inputs["w"].shape == (11,)
    force, status = ask(block, v=0.2, w=ahead, load=loads)
    assert status == 0
    assert force == pytest.approx(dense(0.2, ahead, loads), abs=1e-6)
    level = ask(block, v=0.2, w=1.0, load=1.5)[0]
    assert level == pytest.approx(
        ask(make(speed, solver=solver), v=0.2, w=1.0, load=1.5)[0], abs=1e-9
    )


def test_a_limit_ahead_is_met_in_time_where_the_rate_is_tight():
    """The largest force falls to 1 N in the sixth stage; 10 N/s begin the way down before it."""
    block = make(
        speed, bounds={"F": (-50.0, "F_max")}, rates={"F": 10.0}, preview=["F_max"], rescue=30
    )
    tick, v, forces, limits = Driver(block, compile=False), 0.0, [], []
    for k in range(16):
        at = k + np.arange(11)
        limit = np.where(at < 9, 20.0, 1.0)
        F, status, *_ = tick(0.0, v, 0.0, 100.0, limit)
        assert status == 0
        forces.append(F)
        limits.append(limit[0])
        v += H * F
    assert (np.array(forces) <= np.array(limits) + 1e-9).all()
    assert max(forces) == pytest.approx(5.0, abs=1e-6)  # up by 1 N a tick, and down in time
    assert np.abs(np.diff(forces)).max() <= 1 + 1e-9
    # a fall that comes too soon is told, and the rate kept
    late = Driver(block, compile=False)
    for _ in range(8):
        F, status, *_ = late(0.0, 0.0, 0.0, 100.0, 20.0)
    F, status, *_ = late(0.0, 0.0, 0.0, 100.0, np.r_[20.0, np.full(10, 1.0)])
    assert status == 3
    assert pytest.approx(7.0, abs=1e-6) == F


def test_inequalities_of_a_law_are_kept_on_the_way_and_at_the_end():
    """A place that it can always brake before, a parabola; and at rest at the end."""

    @law(stop=Output("m", lo=-100, hi=1.0))
    def braking(x=Input("m", "position"), v=Input("m/s", "speed")):
        """Where 3 m/s^2 come to rest."""
        return x + v * v / (6 * one("m/s^2"))

    @law(still=Output("m/s", lo=-0.02, hi=0.02))
    def standing(v=Input("m/s", "speed")):
        """Speed at the end."""
        return v

    block = make(
        place, horizon=20, path=braking, final=standing, bounds={"F": (-3.2, 3.2)}, iterations=3
    )
    assert {"stop_max", "still_min"} <= set(block.params)
    tick, x, v, stops = Driver(block, compile=False), 0.0, 0.0, []
    for k in range(30):
        F, status, *_ = tick(x, v, 0.0, 5.0)
        assert status == 0
        if k == 0:
            plan = block.unpack("state", tick.x)["X"]
            assert abs(float(plan[-1])) < 0.02 + 1e-6  # the last planned speed
        x, v = x + H * v + H * H / 2 * F, v + H * F
        stops.append(x + v * v / 6)
    assert max(stops) < 1 + 1e-4  # three iterations leave that of the parabola
    assert x == pytest.approx(1.0, abs=0.01)
    soft = make(place, path=braking, soft={"stop": (-100.0, 1.0, 0.0, 0.01)})
    assert ask(soft, to=5.0)[0] > 3.2  # a soft one is given up for its price


@law(still=Output("m/s", lo=5.0, hi=6.0))
def fast(v=Input("m/s", "speed")):
    """Speed at the end."""
    return v


@law(pull=Output("N", lo=-1, hi=1))
def pull(F=Input("N", "force")):
    """The control itself."""
    return F


@law(v=Output("m/s", lo=-1, hi=1))
def same(v=Input("m/s", "speed")):
    """The name of a state."""
    return v


@law(e=Output("m/s"))
def twice(v=Input("m/s", "speed")):
    """A name of the cost."""
    return v


@law(free=Output("m/s"))
def free(v=Input("m/s", "speed")):
    """No limit."""
    return v


@law(f=Output("N"))
def only_force(F=Input("N", "force")):
    """Sees no state."""
    return F


@law(e=Output("m/s"))
def only_speed(v=Input("m/s", "speed")):
    """No weight of the control."""
    return v


BAD = [
    (dict(terminal="lqg"), "takes names of residuals, a law, 'lqr', or a symmetric 2 by 2"),
    (dict(terminal=np.eye(3)), "a symmetric 2 by 2 matrix"),
    (dict(terminal=[[1.0, 0.5], [0.0, 1.0]]), "a symmetric 2 by 2 matrix"),
    (dict(terminal=np.diag([1.0, -2.0])), "has the eigenvalue -2; make it positive semidefinite"),
    (dict(terminal="lqr", at={"z": 1.0}), "at has 'z', which is no state, control or held input"),
    (dict(terminal="lqr", at={"v": "x"}), "at v takes a number"),
    (dict(at={"v": 1.0}), "at= is the point of terminal='lqr'"),
    (dict(cost=only_force, terminal="lqr"), "depends on no state|no residual of the cost sees"),
    (dict(cost=only_speed, terminal="lqr"), "needs a residual of every control"),
    (dict(terminal=twice), "two laws have a residual 'e'"),
    (dict(terminal=pull), "pull of the last law depends on the control"),
    (dict(preview=["z"]), "preview of 'z', which is no held input or named bound"),
    (dict(preview="w"), "give a list of names"),
    (dict(preview=["hi"], bounds={"F": (-1.0, "hi")}, moves=(5, 5)), "preview no bound with it"),
    (dict(final=fast, hard={"v": (-1.0, 1.0)}), "keeps v above 5 and v below 1: nothing is left"),
    (dict(final=pull), "pull of the final law depends on the control"),
    (dict(path=same), "v of the path law is a name of cart too"),
    (dict(path=free), "free has no range; declare its lo= or hi="),
    (dict(path=cart), "the path cart is a flow; give a law of limits"),
    (dict(path=3), "path"),
]  # fmt: skip


@pytest.mark.parametrize(("options", "text"), BAD, ids=[t for _, t in BAD])
def test_bad_input_is_one_line(options, text):
    with pytest.raises(BadInput, match=text) as error:
        make(**({"cost": speed} | options))
    assert "\n" not in str(error.value)


def test_a_preview_that_is_too_short_is_told_before_a_run():
    """As the feed of a scenario: both shapes that would pass are named."""
    block = nmpc(cart, speed, "F", h=H, horizon=5, preview=["w"])
    loop = connect(
        "loop",
        {"ctl.x": "cart.x", "ctl.v": "cart.v", "cart.F": "ctl.F"},
        ctl=block,
        cart=sampled(cart, H),
    )
    short = Scenario("short", 1.0, inputs={"ctl.w": np.ones(4)})
    with pytest.raises(BadInput, match=r"gives an array \(4,\), wanted is \(10, 6\) or, for all"):
        simulate(loop, short, compile=False)


def test_a_preview_that_is_too_short_is_told():
    block = make(speed, preview=["w"])
    with pytest.raises(BadInput, match=r"w takes an array \(11,\)"):
        block(x=0.0, v=0.0, w=np.zeros(5))


@pytest.mark.long
@pytest.mark.usefixtures("needs_compiler")
def test_generated_c_takes_arrays_ahead(tmp_path):
    """A preview and the regulator's cost to go in C: what Python gives."""
    block = make(speed, horizon=4, preview=["w"], terminal="lqr")
    n = 20
    given = {
        "x": np.zeros(n), "v": np.linspace(0, 1, n), "load": np.zeros(n),
        "w": np.array([np.linspace(k, k + 1, 5) for k in range(n)]),
    }  # fmt: skip
    report = codegen.check(block, given, tmp_path)
    assert report["passed"]
