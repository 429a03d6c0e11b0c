"""Identification of the running resistance, Cheng 2022: what is reached, and rows of the errata."""

from functools import cache

import numpy as np
import pytest
from errata import shows

from bench.peers.bench_pso import bench_pso
from slipctl import identify, misfit_search
from slipctl.models.cheng_2022.freight_resistance import (
    BOX,
    FORMS,
    printed_inertia,
    specific_resistance,
    swarm_settings,
)
from slipctl.models.cheng_2022.freight_traction import resistance
from slipctl.run import build
from slipctl.studies.freight_traction import identification as study

pytestmark = pytest.mark.second

SEEDS = range(1, 101)
PRINTED = swarm_settings("printed-21")
GRID = np.linspace(0, 20, 3000)


def good(a: np.ndarray, low: float, high: float) -> bool:
    """Every coefficient within 5 % and F_Z within 1 % over the range."""
    off = study.errors(a, low, high)
    return off[0] < 0.05 and off[1] < 0.01


@pytest.mark.parametrize("method", [study.SQUARES, study.PROPER])
@pytest.mark.others("long")
def test_wide_run_identifies_in_95_of_100_seeds(method):
    v, _ = study.run("wide")
    assert len(v) >= 3000
    assert v[0] == 0
    assert v[-1] == pytest.approx(20, abs=0.1)
    found = [study.METHODS[method]("wide", study.NOISE, s) for s in SEEDS]
    assert sum(good(a, 0, 20) for a in found) >= 95


def test_wide_run_identifies_from_speed_and_adhesion_only():
    """The block in the loop, without any acceleration; with noise it takes the same seeds."""
    found = [study.METHODS[study.LOOP]("wide", study.NOISE, s) for s in range(1, 11)]
    assert all(good(a, 0, 20) for a in found)


@pytest.mark.skipif(build.compiler() is None, reason="a million ticks")
def test_closed_loop_identifies_on_a_long_run_and_not_on_that_of_the_paper():
    """With observer, wheels and changes of the rail; the controller uses what is identified."""
    table = study.in_closed_loop("long")
    assert abs(table["error"][-1]) < 0.01
    assert max(abs(e) for e in table["error"][2:]) < 0.02
    assert table["identified"][-1]
    table = study.in_closed_loop("paper")
    assert not any(table["identified"])
    assert max(abs(e) for e in table["error"][4:]) < 0.1


def test_narrow_run_does_not_identify():
    found = [study.METHODS[study.SQUARES]("narrow", study.NOISE, s) for s in range(1, 31)]
    assert sum(good(a, 5, 8) for a in found) < 10
    assert study.METHODS[study.SQUARES]("narrow", 0.0, 1) == pytest.approx(study.TRUE, rel=1e-9)
    data = study.samples(np.linspace(5, 8, 3000), study.NOISE, 1)
    told = identify(specific_resistance, data)
    assert not told.identified
    assert "would pass" in told.advice
    shows("004.20", "2932", told.condition)
    for text, value in zip(("0.023", "0.0070", "0.00054"), told.deviation.values(), strict=True):
        shows("004.20", text, value)
    wide = identify(specific_resistance, study.samples(GRID, study.NOISE, 1))
    assert wide.identified
    shows("004.20", "548", wide.condition)


def test_letters_of_14_and_21():
    """The gear is between the two angular speeds; (15) has the unit of no jerk."""
    from slipctl.models.cheng_2022.freight_traction import train

    now = train(v_t=5.0, omega_m=60.0, T_m=0.0, mu=0.1)[1]
    wheel = now["v_d"] / train.params["r"].value
    shows("004.14", "6.294", 60.0 / wheel)
    assert misfit_search(specific_resistance, BOX).check_units() == []


def rank(rows: list[np.ndarray]) -> int:
    Y = np.array([r / np.linalg.norm(r) for r in rows])
    return int(np.linalg.matrix_rank(Y @ Y.T, tol=1e-10))


def test_matrix_of_20_cannot_be_inverted():
    v, mu = study.run("wide")
    F_Z = study.TRUE @ [v**0, v, v**2]
    k = np.arange(len(v))
    ranks = []
    for adhesion, creep in ((mu + 0.01 * np.sin(0.01 * k), 1), (mu, 1), (mu, 0)):
        a = (study.WEIGHT * adhesion - F_Z) * 9.8 / 1000  # x1'
        alpha = (a + creep * np.sin(0.013 * k)) * 6.294 / 0.625  # x3'
        ranks.append(rank([v, v**2, a, v**0, -(v**0), alpha]))
    assert ranks == [5, 4, 3]
    for text, value in zip("543", ranks, strict=True):
        shows("004.16", text, value)


def test_inertia_of_the_printed_swarm():
    shows("004.18", "0.279", float(printed_inertia(1 / 300)))
    shows("004.18", "0.171", float(printed_inertia(1.0)))


@cache
def without_noise(seeds: int = 20, **changes) -> np.ndarray:
    """Coefficients of a swarm, with some of its printed settings replaced, by seed."""
    block = misfit_search(specific_resistance, BOX, **(PRINTED | changes))
    data = study.samples(GRID, 0.0, 1)
    return np.array([
        list(identify(specific_resistance, data, search=block, seed=s).values.values())
        for s in range(1, seeds + 1)
    ])  # fmt: skip


def test_what_stops_the_printed_swarm():
    for text, changes in (
        ("2", {}),
        ("20", dict(inertia=0.73, c1=1.5, c2=1.5)),
        ("8", dict(clamp=0.5)),
        ("2", dict(iterations=900)),
    ):
        found = without_noise(**changes)
        shows("004.19", text, sum(good(a, 0, 20) for a in found))
    shows("004.19", "0.3", 300 * 0.001)
    clamp = dict(zip(BOX, PRINTED["clamp"], strict=True))
    assert clamp == pytest.approx({"a1": 0.001, "a2": 0.01, "a3": 0.1})
    shows("004.19", "10", 100 * clamp["a3"])


def test_swarm_of_the_paper_against_its_own_scatter():
    paper, true = np.array([0.505, 0.05, 0.003]), study.TRUE
    shows("004.20", "25", 100 * (paper[1] / true[1] - 1))
    shows("004.20", "15", 100 * (paper[2] / true[2] - 1))
    for text, v in (("1.0", 0), ("8.5", 5), ("12.5", 10), ("15.6", 20)):
        row = np.array([1.0, v, v * v])
        shows("004.20", text, 100 * (row @ paper / (row @ true) - 1))
    found = without_noise()
    mean, std = found.mean(axis=0), found.std(axis=0)
    for text, value in zip(("0.514", "0.0335", "0.0030"), mean, strict=True):
        shows("004.20", text, value)
    for text, value in zip(("0.035", "0.0095", "0.00047"), std, strict=True):
        shows("004.20", text, value)
    assert (np.abs(paper - mean) < 2 * std).all()
    assert without_noise(**swarm_settings()) == pytest.approx(np.tile(true, (20, 1)), rel=1e-6)
    assert FORMS == ("consistent", "printed-21")


def test_unit_of_the_resistance():
    shows("004.21", "2.34", study.TRUE @ [1, 20, 400])
    shows("004.21", "312", study.TRUE @ [1, 36, 36**2] * 6e6 * 9.8 / 1000 / 1e3)
    shows("004.21", "68", resistance(v=10.0)["F_Z"] / 1e3)


def test_tables_of_the_study():
    """Convergence: the well-posed swarm arrives, the printed one stops; what a range tells."""
    table = study.convergence(quick=True)
    last = table.where("rms misfit", method=study.PROPER, iterations=300)
    assert last < 1e-6 < 1e-3 < table.where("rms misfit", method=study.PRINTED, iterations=300)
    told = study.excitation()
    assert told.where("identified", **{"from": 0, "to": 20}) is True
    assert told.where("identified", **{"from": 5, "to": 8}) is False


@pytest.mark.long
@pytest.mark.skipif(build.compiler() is None, reason="no C compiler")
def test_benchmark_compares_equals():
    """Generated C, from samples to coefficients, finds what numpy finds; it says how fast."""
    found = bench_pso(rounds=1)
    assert found["difference"] < 1e-5
    assert found["numpy_vs_ours"]["ratio"] > 0
