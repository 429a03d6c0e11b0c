"""One plan for several plants, prices, and plants over distance."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from slipctl import (
    BadInput,
    Input,
    Output,
    Param,
    Scenario,
    State,
    flow,
    interpolated,
    law,
    nmpc,
    one,
    over_distance,
    sampled,
    simulate,
)
from slipctl.ccode import codegen
from slipctl.draw import show
from slipctl.predict.trials import Driver
from slipctl.studies.predictive.slip_problem import axle
from slipctl.studies.predictive.slip_problem import make as slip

H = 0.1


@flow()
def cart(
    v=State("m/s", 0.0, "speed"), F=Input("N", "force", lo=-50, hi=50),
    load=Input("N", "what pushes back", value=1.0), m=Param("kg", 2.0, "mass"),
):  # fmt: skip
    """A mass."""
    return dict(v=(F - load) / m), {}


@law(e=Output("m/s"), f=Output("N"))
def speed(v=Input("m/s", "speed"), w=Input("m/s", "wanted", value=1.0), F=Input("N", "force")):
    """Speed error and force."""
    return dict(e=v - w, f=F)


def make(horizon=6, **options):
    """Controller of the cart."""
    weights = {"e": 3.0, "f": 0.3} | options.pop("weights", {})
    return nmpc(cart, speed, "F", h=H, horizon=horizon, weights=weights, **options)


@pytest.mark.parametrize("solver", ["riccati", "osqp", "ipopt"])
def test_one_plan_for_two_plants_is_one_least_squares_problem(solver):
    """Half a mass and twice the load, or as it is; 1e-6: the comparison solvers end there."""
    rows, right = [], []
    for mass, load in ((2.0, 1.0), (1.0, 2.0)):
        for k in range(7):
            rows.append(3 * np.r_[np.full(k, H / mass), np.zeros(6 - k)] / np.sqrt(2))
            right.append(3 * (1.0 - 0.2 + k * H * load / mass) / np.sqrt(2))
    rows += list(0.3 * np.eye(6))
    force = np.linalg.lstsq(np.array(rows), np.r_[right, np.zeros(6)], rcond=None)[0][0]
    block = make(scenarios=[{}, {"m": 0.5, "load": 2.0}], solver=solver)
    assert list(block.inputs) == ["v", "load", "w"]
    assert block(v=0.2)[1]["F"] == pytest.approx(force, abs=1e-6)


@pytest.mark.parametrize(("solver", "shared"), [("riccati", 1), ("riccati", 3), ("osqp", 1),
                                                 ("ipopt", 1)])  # fmt: skip
def test_a_plan_that_branches_is_one_least_squares_problem(solver, shared):
    """Half a mass and twice the load, or as it is; its own forces after ``shared`` stages."""
    N = 6
    rows, right = [], []
    for i, (mass, load) in enumerate(((2.0, 1.0), (1.0, 2.0))):
        own = [k if k < shared else k + i * (N - shared) for k in range(N)]  # places of its forces
        for k in range(N + 1):
            row = np.zeros(2 * N - shared)
            row[own[:k]] = 3 * H / mass / np.sqrt(2)
            rows.append(row)
            right.append(3 * (1.0 - 0.2 + k * H * load / mass) / np.sqrt(2))
        for k in range(N):
            row = np.zeros(2 * N - shared)
            row[own[k]] = 0.3 / np.sqrt(2)
            rows.append(row)
            right.append(0.0)
    force = np.linalg.lstsq(np.array(rows), np.array(right), rcond=None)[0][0]
    block = make(scenarios=[{}, {"m": 0.5, "load": 2.0}], shared=shared, solver=solver)
    assert list(block.inputs) == ["v", "load", "w"]
    assert list(block.outputs) == ["F", "status", "passes", "residual"]
    assert [n for n in block.params if n.startswith("F")] == ["F_lo", "F_hi"]
    assert block(v=0.2)[1]["F"] == pytest.approx(force, abs=1e-6)
    assert abs(force - make(scenarios=[{}, {"m": 0.5, "load": 2.0}])(v=0.2)[1]["F"]) > 1e-3
    text = " ".join(show.text(block, False).split())
    stages = f"one plan for {shared} of the stages, then one for each, the mean of their costs"
    assert stages in text


RATE = 20.0
"""Largest rate of the force in N/s: 2 N from stage to stage."""


def branched(v, before, shared, moves):
    """First force of two carts within the rate, N = 6: bounded least squares in its steps.

    A stage that is shared, or held as one that is, has one step for both.
    """
    N, held = 6, [k > 0 for m in moves for k in range(m)]
    names, steps = {}, []
    for i in (0, 1):
        rows = []
        for k in range(N):
            row = rows[-1].copy() if rows else np.zeros(2 * N)
            if not held[k]:
                row[names.setdefault((k, i * (k >= shared)), len(names))] = 1
            rows.append(row)
        steps.append(np.array(rows)[:, : 2 * N])
    A, b = [], []
    for F, (mass, load) in zip(steps, ((2.0, 1.0), (1.0, 2.0)), strict=True):
        for k in range(N + 1):
            A.append(3 * H / mass * F[:k].sum(axis=0))
            b.append(3 * (1.0 - v + k * H * load / mass - k * H / mass * before))
        A += list(0.03 * F)
        b += [-0.03 * before] * N
    A = np.array(A)[:, : len(names)]
    found = lsq_linear(A, b, (-RATE * H, RATE * H), method="bvls", tol=1e-14)
    return before + found.x[0], abs(abs(found.x) - RATE * H) < 1e-9


@pytest.mark.parametrize("solver", ["riccati", "osqp", "ipopt"])
@pytest.mark.parametrize(("shared", "moves"), [(1, [1] * 6), (3, [1] * 6), (1, [2, 2, 2])],
                         ids=str)  # fmt: skip
def test_a_plan_that_branches_keeps_rates(solver, shared, moves):
    """A branch begins at the control that was shared: tick after tick, as by steps on a tree."""
    block = make(
        scenarios=[{}, {"m": 0.5, "load": 2.0}], shared=shared, solver=solver, moves=moves,
        rates={"F": RATE}, weights={"f": 0.03},
    )  # fmt: skip
    tick, before, most = Driver(block, compile=False), 0.0, 0
    for v in (0.2, 0.5, 1.1, 1.3, 0.9):
        force, tight = branched(v, before, shared, moves)
        out = dict(zip(block.outputs, tick(v, 1.0, 1.0), strict=True))
        assert out["status"] == 0
        assert out["F"] == pytest.approx(force, abs=1e-6)
        before, most = out["F"], max(most, tight.sum())
    assert most > 2  # rates hold in several stages


@pytest.mark.second
@pytest.mark.long
def test_a_branch_of_the_axle_behind_a_rate_is_ipopts():
    """Over a change of rail; 1e-5: IPOPT's end, 1e-8 of its slopes; the rate is kept."""
    given = {"horizon": 8, "scenarios": [{"mu_p": 0.6}, {}], "shared": 1, "rates": {"u": 20.0}}
    ours, theirs, one_plan = (
        Driver(slip(**given | k), compile=False)
        for k in ({"iterations": 6}, {"solver": "ipopt"}, {"iterations": 6, "shared": None})
    )  # fmt: skip
    plant, p = sampled(axle, 0.02, "rk4", 4).f, axle.pack("param", axle.param_values())
    x, before, bolder = np.array([10, 10.05, 1.0, 0.0]), 1.0, 0.0
    for k in range(24):
        seen = (*x, 0.3 if k < 12 else 0.12, 0.02)
        u, status = ours(*seen)[:2]
        assert status == 0
        assert u == pytest.approx(theirs(*seen)[0], abs=1e-5)
        assert abs(u - before) <= 0.4 * (1 + 1e-12)
        before, bolder = u, max(bolder, u - one_plan(*seen)[0])
        x = np.array(plant(x, [u, *seen[4:]], p)[0]).ravel()
    assert bolder > 0.05


@pytest.mark.long
@pytest.mark.usefixtures("needs_compiler")
@pytest.mark.parametrize("real", ["double", "float"])
def test_generated_c_branches_behind_a_rate(real, tmp_path):
    n = 12
    given = {"v": np.linspace(0.2, 1.3, n), "load": np.ones(n), "w": np.ones(n)}
    block = make(
        scenarios=[{}, {"m": 0.5, "load": 2.0}], shared=2, rates={"F": RATE}, horizon=4, passes=6,
        rescue=0,
    )  # fmt: skip
    report = codegen.check(block, given, tmp_path, real=real)
    assert report["passed"]
    if real == "double":
        assert all(d["relative"] == 0 for d in report["signals"].values())


@pytest.mark.second
@pytest.mark.long
def test_a_plan_that_branches_is_less_careful_and_keeps_the_limits_of_each():
    """The first step has to do for both carts; what later ticks measure, it may count on."""
    given = {"scenarios": [{}, {"m": 0.5}], "hard": {"v": (-5.0, 0.5)}, "weights": {"f": 0.01}}
    block = make(shared=1, **given)
    out = block(v=0.0, w=5.0)[1]
    assert out["status"] == 0
    assert out["F"] == pytest.approx(1 + 0.5 / 0.1, rel=1e-6)  # the lighter one gets to .5 m/s
    rail = dict(v=10.0, q=10.15, T=5.0, xi=0.0, mu_p=0.3, s_ref=0.02)
    pair = {"horizon": 12, "scenarios": [{"mu_p": 0.6}, {}]}
    careful, branched, ipopt = (
        slip(**pair, **k)(**rail)[1]["u"]
        for k in ({"iterations": 30}, {"iterations": 30, "shared": 1},
                  {"solver": "ipopt", "shared": 1})
    )  # fmt: skip
    assert branched == pytest.approx(ipopt, abs=1e-5)
    assert branched > careful + 1
    assert hidden(slip(**pair, shared=1), 0.6) < 0.035


def test_a_limit_is_that_of_every_scenario():
    """The lighter cart gets to 1 m/s first: .1 s (F - 1 N)/1 kg."""
    block = make(scenarios=[{}, {"m": 0.5}], hard={"v": (-5.0, 0.5)}, weights={"f": 0.01})
    out = block(v=0.0, w=5.0)[1]
    assert out["status"] == 0
    assert out["F"] == pytest.approx(1 + 0.5 / 0.1, rel=1e-6)
    assert [n for n in block.params if n.startswith("v_")] == ["v_min", "v_max"]
    text = show.text(block, False)
    assert "as it is; 0.5 m: one plan, the mean of their costs" in text
    assert "v_min <= v[k] <= v_max" in text


def hidden(block, share, ticks=60):
    """Largest slip where the adhesion is a share of what the controller is told."""
    tick, plant = Driver(block, compile=False), sampled(axle, 0.02, "rk4", 4).f
    x, p, most = np.array([10, 10.05, 1.0, 0.0]), axle.pack("param", axle.param_values()), 0.0
    for _ in range(ticks):
        u = tick(*x, 0.3, 0.02)[0]
        x = np.array(plant(x, [u, 0.3 * share, 0.02], p)[0]).ravel()
        most = max(most, (x[1] - x[0]) / np.sqrt(x[0] ** 2 + 0.25))
    return most


@pytest.mark.second
def test_a_rail_worse_than_told_does_not_make_the_wheel_spin():
    """60 % of the adhesion: believed whole, slip is six times the wanted .02."""
    assert hidden(slip(horizon=12), 0.6) > 0.1
    assert hidden(slip(horizon=12, scenarios=[{"mu_p": 0.6}, {}]), 0.6) < 0.022


@law(power=Output("N m/s"))
def energy(v=Input("m/s", "speed"), F=Input("N", "force")):
    """Power of the force."""
    return F * v


@pytest.mark.parametrize("grow", [1.0, 1.3])
def test_a_price_is_added_as_it_is(grow):
    """A price of the force shifts it by -price/weight^2; power, not convex, against IPOPT."""

    @law(F_=Output("N"))
    def pull(F=Input("N", "force")):
        """The force."""
        return F

    alone = {"weights": {"e": 1e-6, "f": 0.3, "F_": 0.2}, "economic": pull, "grow": grow}
    assert make(**alone)(v=0.0, w=0.0)[1]["F"] == pytest.approx(-0.2 / 0.09, rel=1e-5)
    given = {"economic": energy, "weights": {"power": 0.5}, "grow": grow}
    ours, theirs = make(iterations=20, **given), make(solver="ipopt", **given)
    out = ours(v=0.5, w=1.0)[1]
    assert out["F"] == pytest.approx(theirs(v=0.5, w=1.0)[1]["F"], abs=1e-5)
    assert out["F"] < make(grow=grow)(v=0.5, w=1.0)[1]["F"] - 0.1
    assert "of [weight_power power]" in show.text(make(**given | {"grow": 1.0}), False)


def test_a_plant_over_distance():
    """Constant force: v^2 = v_0^2 + 2 a s, and the clock is (v - v_0)/a."""
    along = over_distance(cart)
    log = simulate(
        sampled(along, 1.0),
        Scenario("way", 51.0, start={"v": 2.0}, inputs={"F": 3.0, "load": 1.0}),
        compile=False,
    )
    v = np.sqrt(4 + 2 * np.arange(51))
    assert log["v"].values == pytest.approx(v, rel=1e-4)
    assert log["clock"].values == pytest.approx(v - 2, abs=1e-3)


def test_a_plan_over_distance_begins_before_the_hill():
    """30 stages of 10 m; a hill of 50 m after 20 m whose load the force alone cannot bear."""
    block = nmpc(
        over_distance(cart), speed, "F", h=10.0, horizon=30, weights={"e": 0.3, "f": 0.1},
        bounds={"F": (-4.0, 4.0)}, preview=["load"], iterations=3,
    )  # fmt: skip
    hill = np.where((np.arange(31) >= 2) & (np.arange(31) < 7), 4.5, 0.0)
    level = block(v=10.0, w=10.0, clock=0.0, load=np.zeros(31))[1]["F"]
    before = block(v=10.0, w=10.0, clock=0.0, load=hill)[1]["F"]
    assert level == pytest.approx(0, abs=1e-6)
    assert before > 0.2


def test_a_hill_at_its_place_is_seen_before_it_comes():
    """A table over the plant's own place: the plan reads it where it expects to be."""

    @flow()
    def hilly(
        x=State("m", 0.0, "place"), v=State("m/s", 0.0, "speed"),
        F=Input("N", "force", lo=-4, hi=4),
    ):  # fmt: skip
        """A kilogram, and a hill from 20 m to 70 m that takes 4.5 N."""
        hill = interpolated(x / one("m"), [20, 25, 65, 70], [0, 4.5, 4.5, 0]) * one("N")
        return dict(x=v, v=(F - hill) / one("kg")), {}

    block = nmpc(
        hilly, speed, "F", h=1.0, horizon=30, weights={"e": 0.3, "f": 0.1}, iterations=5,
        substeps=4,
    )  # fmt: skip
    force = {x: block(x=x, v=10.0, w=10.0)[1]["F"] for x in (-500.0, 10.0, 30.0)}
    assert force[-500.0] == pytest.approx(0, abs=1e-9)
    assert 0.2 < force[10.0] < 1  # not there yet
    assert force[30.0] == 4


@pytest.mark.parametrize(
    ("xs", "ys", "said"),
    [([0, 1], [1], "2 places and 1 values"), ([], [], "no places"), ([1, 1], [0, 0], "rising")],
)
def test_a_table_that_is_none_is_refused(xs, ys, said):
    with pytest.raises(BadInput, match=said):
        interpolated(0.5, xs, ys)


BAD = [
    (lambda: make(scenarios=[{}]), "scenarios are two or more"),
    (lambda: make(scenarios={"m": 2.0}), "give a list of {name: factor}"),
    (lambda: make(scenarios=[{}, {"z": 2.0}]), "'z'"),
    (lambda: make(scenarios=[{}, {"F": 2.0}]), "F is no held input and no free parameter"),
    (lambda: make(scenarios=[{}, {"m": -2.0}]), "the factor of m = -2 must be positive"),
    (lambda: make(shared=1), "shared= is of scenarios="),
    (lambda: make(scenarios=[{}, {}], shared=6), "shared = 6 stages of 6 leave none"),
    (lambda: make(scenarios=[{}, {}], shared=0), "shared = 0 must be a whole number >= 1"),
    (lambda: make(scenarios=[{}, {}], terminal="lqr"), "goes without offset_free="),
    (lambda: make(economic=energy, terminal="lqr"), "economic= goes without 'lqr'"),
    (lambda: make(economic=cart), "the price cart is a flow; give a law of prices"),
    (lambda: make(economic=speed), "two laws have a residual"),
    (lambda: over_distance(speed), "it is a law; give the flow"),
    (lambda: over_distance(axle, "T"), "T .kN m. is no speed; name a scalar state in m/s"),
    (lambda: over_distance(cart, least=0.0), "least = 0 m/s must be positive"),
    (lambda: over_distance(over_distance(cart)), "it has a state clock"),
    (lambda: over_distance(cart, "x"), "'x'"),
]


@pytest.mark.parametrize(("call", "text"), BAD, ids=[t for _, t in BAD])
def test_bad_input_is_one_line(call, text):
    with pytest.raises(BadInput, match=text) as error:
        call()
    assert "\n" not in str(error.value)
