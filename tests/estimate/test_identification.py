"""Identification of what a law is linear in: against numpy, closed forms, and what is refused."""

import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from slipctl import (
    BadInput,
    Input,
    Output,
    Param,
    Scenario,
    identify,
    law,
    linear_fit,
    make_block,
    misfit_search,
    simulate,
)
from slipctl.commands import cli
from slipctl.estimate.identification import swarm_fit
from slipctl.models.cheng_2022 import freight_resistance as models
from slipctl.models.cheng_2022.freight_resistance import BOX, specific_resistance, swarm_settings
from slipctl.models.cheng_2022.freight_traction import adhesion
from slipctl.run import build
from slipctl.seek import random

TRUE = np.array([0.5, 0.04, 0.0026])


def data(lo=0.0, hi=20.0, noise=0.02, seed=1, N=3000):
    v = np.linspace(lo, hi, N)
    y = specific_resistance(v=0.0)["y"] + TRUE[1] * v + TRUE[2] * v**2
    return {"v": v, "y": y + noise * np.random.default_rng(seed).standard_normal(N)}


def regressor(v):
    return np.stack([v**0, v, v**2], axis=1)


def numbers(found) -> np.ndarray:
    return np.array(list(found.values()))


def test_least_squares_is_that_of_numpy():
    d = data()
    Phi = regressor(d["v"])
    a, squares, _, s = np.linalg.lstsq(Phi, d["y"])
    found = identify(specific_resistance, d)
    assert numbers(found.values) == pytest.approx(a, rel=1e-9)
    assert found.condition == pytest.approx(s[0] / s[-1])
    variance = squares[0] / (3000 - 3)
    assert found.noise**2 == pytest.approx(variance)
    covariance = variance * np.linalg.inv(Phi.T @ Phi)
    assert numbers(found.deviation) == pytest.approx(np.sqrt(np.diag(covariance)))
    assert found.identified
    assert not found.advice


def test_without_noise_it_is_exact():
    for lo, hi in ((0, 20), (5, 8)):
        found = identify(specific_resistance, data(lo, hi, noise=0.0))
        assert numbers(found.values) == pytest.approx(TRUE, rel=1e-10)


def test_a_known_part_of_the_law_is_taken_off():
    d = data()
    found = identify(specific_resistance, d, unknown=["a2", "a3"])
    Phi = regressor(d["v"])[:, 1:]
    assert numbers(found.values) == pytest.approx(np.linalg.lstsq(Phi, d["y"] - 0.5)[0], rel=1e-9)


def test_advice_is_true():
    """What the advice says would pass does pass; a little less does not."""
    found = identify(specific_resistance, data(5, 8))
    assert not found.identified
    told = re.search(r"over v = 5 to ([\d.]+) m/s would pass; or (\d+) samples", found.advice)
    # the deviations of data that have the residual of these and the advised range
    for top, wide in ((float(told[1]), True), (0.98 * float(told[1]), False)):
        Phi = regressor(np.linspace(5, top, 3000))
        std = found.noise * np.sqrt(np.diag(np.linalg.inv(Phi.T @ Phi)))
        assert (1.96 * std <= 0.05 * numbers(found.values)).all() == wide
    share = 1.96 * numbers(found.deviation) / numbers(found.values) / 0.05
    assert 3000 * share.max() ** 2 == pytest.approx(int(told[2]), abs=1)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (data(5, 5), r"data without excitation, condition .* v = 5 to 1[345].* m/s would pass"),
        (data(5, 5.5), "condition number 4.4.*above 10000; 3000 samples spread evenly over v = 5"),
        ({"v": np.full(3000, np.nan)}, "v is nan in row 0; leave it out"),
        ({"v": np.zeros(10)}, r"column v has shape \(10,\), y \(3000,\); give one number"),
        ({"time": np.r_[0, 2, 1, 3:3000]}, "goes from 2 to 1 s in row 2; sort the rows by time"),
    ],
)
def test_bad_columns(changes, said):
    with pytest.raises(BadInput, match=said):
        identify(specific_resistance, data() | changes)


@pytest.mark.parametrize("order", ["uvw", "uwv", "vuw", "vwu", "wuv", "wvu"])
def test_each_missing_column_is_refused_behind_one_that_need_not_be_there(order):
    """An input that has a value needs no column; neither does the time."""
    of = {"u": Input("1", value=1.0), "v": Input("1"), "w": Input("1", value=2.0)}
    line = make_block(
        "line", "law", lambda x, u, p: ({}, {"y": p["k"] * u["v"] + u["u"] + u["w"]}),
        inputs=[of[n].named(n) for n in order], params=[Param("1", 1.0).named("k")],
        outputs=[Output("1").named("y")],
    )  # fmt: skip
    v = np.arange(5.0)
    assert identify(line, {"v": v, "y": 2 * v + 3}).values == pytest.approx({"k": 2.0})
    with pytest.raises(BadInput, match="no column 'v'"):
        identify(line, {"y": v})


def test_known_parameters_may_be_vectors():
    """Two of them, with one number between: each has its own place."""
    line = make_block(
        "line", "law",
        lambda x, u, p: ({}, {"y": p["k"] * u["v"] + p["a"][2] + 10 * p["b"] + 100 * p["c"][1]}),
        inputs=[Input("1").named("v")], outputs=[Output("1").named("y")],
        params=[Param("1", (1.0, 2.0, 3.0), shape=(3,)).named("a"), Param("1", 4.0).named("b"),
                Param("1", (5.0, 6.0), shape=(2,)).named("c"), Param("1", 1.0).named("k")],
    )  # fmt: skip
    v = np.arange(5.0)
    found = identify(line, {"v": v, "y": 2 * v + 3 + 40 + 600}, unknown=["k"])
    assert found.values == pytest.approx({"k": 2.0})
    assert found.noise == pytest.approx(0.0, abs=1e-9)


def test_other_bad_input():
    for d, said in (
        ({"v": [1.0, 2.0]}, "no column 'y'; it has v"),
        ({"v": [1.0, 2.0, 3.0], "y": [1.0, 1.0, 1.0]}, "3 samples for 3 parameters; give 4 or"),
    ):
        with pytest.raises(BadInput, match=said):
            identify(specific_resistance, d)
    with pytest.raises(BadInput, match=r"mu is not linear in a, b, c; rls\(...\) takes it"):
        linear_fit(adhesion)
    with pytest.raises(BadInput, match="has no parameter 'a4'; it has a1, a2, a3"):
        misfit_search(specific_resistance, {"a4": (0, 1)})
    with pytest.raises(BadInput, match="range of a1 = -1 N/kN is out of range"):
        misfit_search(specific_resistance, {"a1": (-1, 1)})
    with pytest.raises(BadInput, match="spread needs 3 positive numbers"):
        linear_fit(specific_resistance, spread=[1, 1, 0])
    with pytest.raises(BadInput, match="search has to be misfit_search of a1, a2, a3"):
        identify(
            specific_resistance, data(), search=misfit_search(specific_resistance, {"a1": (0, 1)})
        )
    with pytest.raises(BadInput, match="clamp has 2 numbers; give one, or 3"):
        misfit_search(specific_resistance, BOX, clamp=[0.1, 0.2])
    with pytest.raises(BadInput, match="period = 0 s must be positive"):
        models.balance(0.0)
    with pytest.raises(BadInput, match="has no form 'printed'; it has consistent, printed-21"):
        swarm_settings("printed")
    with pytest.raises(BadInput, match="has no form 'pso'; it has least_squares, swarm"):
        models.identification(method="pso")

    @law(y=Output("1"))
    def bare(u=Input("1"), k=Param("1", lo=0)):
        """A law whose parameter has no value."""
        return k * u

    with pytest.raises(BadInput):
        linear_fit(bare)


def test_a_printed_particle_moves_by_at_most_a_thousandth_of_each_coefficients_unit():
    """Cheng 2022, Table 3: the same bound for all; a share of the box takes another for each."""
    shares = swarm_settings("printed-21")["clamp"]
    assert [k * (hi - lo) for k, (lo, hi) in zip(shares, BOX.values(), strict=True)] == (
        pytest.approx([1e-3] * 3)
    )


@pytest.mark.parametrize("form", models.FORMS)
def test_swarm_minimises_half_the_sum_of_squares(form):
    """Eq (21), less its least value; the well-posed one finds its minimum, the printed one not."""
    d = data()
    search = misfit_search(specific_resistance, BOX, **swarm_settings(form))
    found = numbers(identify(specific_resistance, d, search=search, seed=3).values)
    Phi = regressor(d["v"])
    R, z = np.split(np.linalg.qr(np.column_stack([Phi, d["y"]]), mode="r")[:3], [3], axis=1)
    given = {f"R{i + 1}{j + 1}": R[i, j] for i in range(3) for j in range(i, 3)}
    given |= {f"z{i + 1}": z[i, 0] for i in range(3)}
    value = search(rng=np.array(random.state_from_seed(3)), **given)[1]["value"]
    best, least = np.linalg.lstsq(Phi, d["y"])[:2]
    e = d["y"] - Phi @ found
    assert value == pytest.approx((e @ e - least[0]) / 2, abs=1e-9)
    if form == "consistent":
        assert value < 1e-9
        assert found == pytest.approx(best, rel=1e-3)
    else:
        assert value > 1e-3


def test_inertia_and_clamp_of_the_printed_swarm():
    """279e-3 to 171e-3; a particle moves .001 at most, so one at a1 >= .9 stays above .6."""
    assert float(models.printed_inertia(0.0)) == pytest.approx(0.27926, abs=1e-5)
    assert float(models.printed_inertia(1.0)) == pytest.approx(0.17108, abs=1e-5)
    box = {"a1": (0.9, 1.9), **{k: BOX[k] for k in ("a2", "a3")}}
    slow = swarm_settings("printed-21") | {"iterations": 5}
    found = [identify(specific_resistance, data(), seed=s,
                      search=misfit_search(specific_resistance, box, **slow)).values["a1"]
             for s in (1, 2, 3)]  # fmt: skip
    assert min(found) > 0.9  # five steps of .001 do not lead to the bound, where the minimum lies


def weighted(d, lam, spread, noise, centre):
    """Ridge regression with weights, in closed form: what forgetting with a prior gives.

    With w the weight that the k-th oldest sample has left, the prior comes back with 1 - lam each
    tick, so that it has weight 1 all the time.
    """
    Phi, N = regressor(d["v"]), len(d["v"])
    w = lam ** np.arange(N - 1, -1, -1)
    L = np.diag((noise / spread) ** 2)
    return np.linalg.solve(Phi.T @ (w[:, None] * Phi) + L, Phi.T @ (w * d["y"]) + L @ centre)


@pytest.mark.parametrize("lam", [1.0, 0.99])
def test_recursive_fit_is_weighted_ridge_regression(lam):
    d = data(N=400)
    spread, noise = np.array([0.3, 0.05, 0.004]), 0.05
    block = linear_fit(specific_resistance, spread=spread, period=1.0, forgetting=lam, noise=noise)
    log = fed(block, d)
    found = [float(log[k][-1]) for k in BOX]
    assert found == pytest.approx(weighted(d, lam, spread, noise, TRUE), rel=1e-8)


def fed(block, columns):
    """Log of a step block with columns as its inputs."""
    N = len(next(iter(columns.values())))
    inputs = {k: (lambda t, c=c: c) for k, c in columns.items()}
    return simulate(block, Scenario("s", N * block.period, inputs=inputs), compile=False)


def test_forgetting_without_excitation_goes_home():
    """After 4000 samples at one speed P is that of what is known besides, not lam^-k of it."""
    v = np.full(4000, 5.0)
    y = 0.9 + 0.06 * v + 0.004 * v**2  # another train than the law believes
    block = linear_fit(specific_resistance, period=1.0, forgetting=0.98, noise=0.02)
    log = fed(block, {"v": v, "y": y})
    a = np.array([float(log[k][-1]) for k in BOX])
    assert a @ [1, 5, 25] == pytest.approx(y[0], rel=1e-3)  # what is excited is known
    assert (np.abs(a - TRUE) < 1.5 * TRUE).all()
    assert np.abs([log[k][-1] - log[k][2000] for k in BOX]).max() < 1e-9
    assert log["identified"].values.max() == 0


def test_recursive_fit_knows_when_it_knows():
    d = data(N=3000)
    log = fed(linear_fit(specific_resistance, period=1.0, noise=0.02), d)
    told = np.flatnonzero(log["identified"].values)
    assert 300 < told[0] < 2500  # not from the first piece, but long before the end
    assert log["identified"].values[-1] == 1
    for k, true in zip(BOX, TRUE, strict=True):
        assert abs(log[k].values[told] / true - 1).max() < 0.1


def test_fewer_than_two_samples_per_unknown_tell_nothing():
    """Three unknowns and no noise: known with the seventh sample, however good the first six."""
    block = linear_fit(specific_resistance, spread=[1e3] * 3, period=1.0, noise=1e-9, accuracy=0.1)
    told = fed(block, data(noise=0.0, N=10))["identified"].values
    assert told.tolist() == [0] * 6 + [1] * 4


def run(seconds=200.0, T=0.05, h=0.0, mu=0.2862):
    """Speed of the train of (14) under constant adhesion, by scipy; and the adhesion."""
    M, g, W, n_d = 6e6, 9.8, 3e4, 8

    def rate(t, v):
        return (n_d * mu * W * g - (TRUE @ [1, v[0], v[0] ** 2]) * M * g / 1000) / M

    t = np.arange(0, seconds, T)
    found = solve_ivp(rate, (0, seconds), [0.0], t_eval=t, rtol=1e-11, atol=1e-12)
    return {"v_t": found.y[0], "mu_hat": np.full(len(t), mu)}


def test_integral_form_is_exact_but_for_the_trapezoidal_rule():
    """The coefficients come out without any derivative, off by h^2 and less than 1e-4 at .1 s."""
    worst = {}
    for T in (0.4, 0.8):
        columns = run(T=T)
        log = fed(models.balance(T), columns)
        regression = np.stack([log[k].values for k in ("one_f", "v_f", "v2_f")], axis=1)
        a = np.linalg.lstsq(regression, log["y"].values)[0]
        worst[T] = np.abs(a / TRUE - 1).max()
    assert worst[0.8] < 1e-3
    assert worst[0.4] < worst[0.8] / 2


@pytest.mark.parametrize("tau", [0.5, 2.0, 8.0])
def test_integral_form_holds_at_once_for_any_filter(tau):
    """Trapezoidal data, and any start speed: the balance closes to rounding in the first ticks."""
    T, rng = 0.1, np.random.default_rng(2)
    a = rng.uniform(-0.1, 0.1, 60)
    v = 7 + np.concatenate([[0], np.cumsum((a[1:] + a[:-1]) / 2 * T)])
    F_Z = (0.5 + 0.04 * v + 0.0026 * v**2) * 6e6 * 9.8 / 1000
    mu = (6e6 * a + F_Z) / (8 * 3e4 * 9.8)
    log = fed(models.balance(T).with_params(tau_f=tau), {"v_t": v, "mu_hat": mu})
    right = sum(c * log[k].values for c, k in zip(TRUE, ("one_f", "v_f", "v2_f"), strict=True))
    assert log["y"].values == pytest.approx(right, abs=1e-12)
    assert log["one_f"].values[1] > 0


@pytest.mark.parametrize("method", ["least_squares", "swarm"])
def test_in_the_loop_from_speed_and_adhesion_only(method):
    """0 to 19 m/s in 200 s, noise of .02 N/kN on the adhesion: F_Z within 1 % over that range."""
    T = 0.05
    columns = run(T=T)
    noise = 0.02 * 6e6 / 1000 / (8 * 3e4)  # .02 N/kN as adhesion
    columns["mu_hat"] = columns["mu_hat"] + noise * np.random.default_rng(4).standard_normal(4000)
    settings = {} if method == "least_squares" else dict(ticks=1000, iterations=150)
    log = fed(models.identification(T, method, **settings), columns)
    place = "fit" if method == "least_squares" else "pso.search"
    a = np.array([float(log[f"{place}.{k}"][-1]) for k in BOX])
    assert abs(a / TRUE - 1).max() < 0.05
    grid = regressor(np.linspace(0, 19, 50))
    assert abs(grid @ a / (grid @ TRUE) - 1).max() < 0.01
    last = regressor(columns["v_t"][-1:])[0] @ TRUE * 6e6 * 9.8 / 1000
    assert float(log["res.F_Z"][-1]) == pytest.approx(last, rel=0.01)


@pytest.mark.long
@pytest.mark.skipif(build.compiler() is None, reason="no C compiler")
def test_c_of_the_identification(tmp_path):
    """`slipctl c ... --check --real float`: sums, solution and swarm; double: the benchmark."""
    file = tmp_path / "mine.py"
    file.write_text(
        "from slipctl.models.cheng_2022.freight_resistance import identification\n"
        "whole = identification(method='swarm', ticks=40, particles=5, iterations=9)\n"
    )
    words = ["c", f"{file}:whole", "--out", str(tmp_path / "c"), "--check", "--real", "float"]
    assert cli.main(words) == 0


def test_a_swarm_searches_at_each_tick_unless_told_otherwise():
    made = [swarm_fit(specific_resistance, BOX, **k) for k in ({}, {"ticks": 1}, {"ticks": 2})]
    told = [m.f.serialize() for m in made]
    assert told[0] == told[1] != told[2]
