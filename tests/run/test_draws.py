"""What varies from run to run: sequences, draws of an ensemble, and what may not vary."""

from __future__ import annotations

import inspect
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import qmc

from slipctl import BadInput, Input, Known, Output, Param, Rail, Scenario, Section, State, step
from slipctl.run.numbers import _other
from slipctl.run.sweep.ensemble import Ensemble, World, load_ensemble, read_ensemble
from slipctl.run.sweep.sweep_plan import BATCH, plan_of


@step(period=0.01, y=Output("m/s", "speed"))
def car(
    v=State("m/s", 5.0, "speed", lo=0, hi=50),
    heard=Input("m/s", "noisy", value=0.0, noise=0.1, change=9.0),
    m=Param("kg", 100.0, "mass", lo=1, hi=1000),
    c=Param("1", 0.5, "height", lo=0, hi=2),
    row=Param("1", (1.0, 2.0), "two", shape=(2,)),
):
    """Slows by its adhesion."""
    return dict(v=v - 0.01 * c * row[0] + 0 * m), dict(y=v + heard)


RAIL = Rail([Section(0, None, {"c": 0.5}), Section(0.1, None, {"c": 0.2})])
PLAIN = Scenario("plain", 0.2)
RAILED = Scenario("railed", 0.2, RAIL)


def test_a_sobol_sequence_is_scipys_also_behind_what_is_made_at_once():
    plan = plan_of(car, PLAIN, ["m=10:30", "v=1:2", "c=0:1:2"], samples=BATCH, seed=7,
                   design="sobol")  # fmt: skip
    name = next(n for n in ("rng", "seed") if n in inspect.signature(qmc.Sobol).parameters)
    points = qmc.Sobol(2, scramble=True, **{name: np.random.default_rng(7)}).random(plan.size)
    for run in (0, 1, BATCH - 1, BATCH, BATCH + 5, plan.size - 1):
        numbers = plan.numbers(run)
        assert numbers["m"] == pytest.approx(10 + 20 * points[run, 0], rel=1e-14)
        assert numbers["v"] == pytest.approx(1 + points[run, 1], rel=1e-14)
        assert numbers["c"] == run % 2
        assert plan.place(run) == (run % 2, run // 2)


def test_a_grid_of_two_axes_comes_point_by_point():
    plan = plan_of(car, PLAIN, {"m": (10, 30, 3), "c": (0, 1, 2)})
    assert plan.size == 6
    assert [tuple(plan.numbers(k).values()) for k in range(6)] == [
        (10, 0), (10, 1), (20, 0), (20, 1), (30, 0), (30, 1)]  # fmt: skip
    assert [plan.place(k) for k in (0, 1, 5)] == [(0, 0, 0), (0, 1, 0), (2, 1, 0)]


PLANS = [
    (["m"], "write P=lo:hi:n for n values"), (["m=1"], "write P=lo:hi:n"),
    (["m=1:"], "write P=lo:hi:n"), (["m=1:2:3:4"], "write P=lo:hi:n"),
    (["m=1:2:x"], "'x' is no number of values"), (["m=1:2:1"], "'1' is no number of values"),
    (["m=2:1"], "2 to 1 is no range"), (["m=2:2"], "2 to 2 is no range"),
    (["q=1:2"], "car has no parameter 'q'"),
    (["row=1:2"], r"row has several numbers, shape \(2,\)"),
    (["m=0:2"], "--vary m = 0"), (["m=1:2000"], "--vary m = 2000"), (["m=1 s:2 s"], r"m \[kg\]"),
    (["m=1:2", "m=3:4"], "--vary names m twice"), ([], "needs something to vary"),
    ({"m": 3}, r"give \(lo, hi\) or \(lo, hi, n\)"), ({"m": (1, 2, 3, 4)}, "give .lo, hi."),
    (["m=1:2:100000", "c=0:1:100000"], "1e.10 runs; at most 1e.08"),
]  # fmt: skip


@pytest.mark.parametrize(("vary", "said"), PLANS)
def test_what_is_no_plan_is_refused(vary, said):
    with pytest.raises(BadInput, match=said):
        plan_of(car, PLAIN, vary)


def test_what_the_rail_or_the_scenario_sets_is_not_varied():
    with pytest.raises(BadInput, match="the rail sets c in scenario railed, so it has no effect"):
        plan_of(car, RAILED, ["c=0:1"])
    with pytest.raises(BadInput, match="scenario plain sets v; it has no effect"):
        plan_of(car, PLAIN.but(start={"v": 3.0}), ["v=1:2"])
    for more in ({"samples": 0}, {"seed": -1}, {"design": "halton"}):
        with pytest.raises(BadInput, match=next(iter(more))):
            plan_of(car, PLAIN, ["m=1:2"], **more)


def world(ensemble, scenario=PLAIN, **more):
    return World(car, scenario, ensemble, compile=False, **more)


@pytest.mark.parametrize("names", ["c, best", "best, c"])
def test_a_draw_is_of_its_number_in_its_ranges_and_scales_what_it_names(names):
    """A number of the loop, one of the rail in each section, and what is known beside."""
    scale = {"f": f"0.5:0.8 of {names}", "g": "1:2 of v"}
    ensemble = Ensemble({"m": "50:150"}, scale, seeds=True)
    known = {"best": Known("m/s", [1.0, 3.0]), "other": Known("m/s", 4.0)}
    drawn = world(ensemble, RAILED, known=known, seed=3)
    assert [(a.name, a.lo, a.hi) for a in drawn.ranges] == [
        ("m", 50, 150), ("f", 0.5, 0.8), ("g", 1, 2)]  # fmt: skip
    seen = []
    for k in range(20):
        draw = drawn.draw(0, k)
        by = draw.factors
        assert 50 <= draw.numbers["m"] <= 150
        assert 0.5 <= by["f"] <= 0.8
        assert draw.numbers["v"] == pytest.approx(5.0 * by["g"])
        assert [s.values["c"] for s in draw.scenario.rail.sections] == pytest.approx(
            [0.5 * by["f"], 0.2 * by["f"]]
        )
        assert draw.known["best"].values == pytest.approx([by["f"], 3.0 * by["f"]])
        assert draw.known["other"].values == 4.0
        assert draw.numbers == drawn.draw(0, k).numbers != drawn.draw(1, k).numbers
        seen.append((draw.numbers["m"], draw.scenario.seed))
    assert len(set(seen)) == len({s for _, s in seen}) == 20
    assert min(m for m, _ in seen) < 75
    assert max(m for m, _ in seen) > 125


def test_a_run_of_a_sweep_keeps_what_varies_beside_what_is_drawn():
    drawn = world(Ensemble({"m": "50:150"}, {"g": "1:2 of v"}))
    numbers, draw = drawn.run({"m": 60.0, "g": 1.5, "c": 0.3}, 4)
    assert numbers == {"m": 60.0, "v": 7.5, "c": 0.3}
    assert draw.factors == {"g": 1.5}
    noise = [drawn.run({"m": 60.0, "g": 1.0}, k)[1].scenario.seed for k in (1, 1, 2)]
    assert noise[0] == noise[1] == PLAIN.seed  # seeds are not drawn


ENSEMBLES = [
    ("draw = 3", r"draw is 3; write \[draw\]"), ("[draw]\nm = 3", 'draw.m is 3; write "lo:hi"'),
    ("scale = []", r"scale is \[\]; write \[scale\]"), ("seeds = 1", "seeds is 1; write true or"),
    ("draws = {}", "no entry 'draws' of an ensemble; did you mean 'draw'"), ("", "is empty"),
    ("seeds = false", "is empty"), ("[draw", "is no TOML file"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "said"), ENSEMBLES)
def test_what_is_no_ensemble_is_refused_with_its_file(text, said, tmp_path: Path):
    path = tmp_path / "e.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(BadInput, match=rf"e\.toml.*{said}"):
        load_ensemble(str(path))


def test_an_ensemble_is_read_as_it_is_told_and_known_by_its_entries(tmp_path: Path):
    path = tmp_path / "e.toml"
    path.write_text('seeds = true\n[draw]\nm = "5:6"\n[scale]\ng = "1:2 of v"\n', encoding="utf-8")
    read = load_ensemble(str(path))
    assert read == Ensemble({"m": "5:6"}, {"g": "1:2 of v"}, True)
    assert read.told() == {"seeds": True, "draw": {"m": "5:6"}, "scale": {"g": "1:2 of v"}}
    assert json.loads(json.dumps(read.told())) == read.told()
    assert read.hash == Ensemble({"m": "5:6"}, {"g": "1:2 of v"}, True).hash
    assert read.hash != Ensemble({"m": "5:6"}, {"g": "1:2 of v"}).hash
    with pytest.raises(BadInput, match=r"cannot read .*none\.toml"):
        load_ensemble(str(tmp_path / "none.toml"))
    with pytest.raises(BadInput, match="the ensemble is 3; write a table with"):
        read_ensemble("here", 3)


WORLDS = [
    ({"m": "1:2:3"}, {}, "draw m: write lo:hi, no number of values"),
    ({}, {"f": "2 of v"}, 'scale f: .*write "0.8:1.2 of NAME, NAME"'),
    ({}, {"f": "2:1 of v"}, "2 to 1 is no range"),
    ({}, {"f": "1:2 of q"}, "car has no 'q'"),
    ({}, {"f": "1:2 of row"}, r"row has several numbers, shape \(2,\)"),
    ({}, {"f": "1:2 of late"}, "late follows from the log; it is not scaled"),
]


@pytest.mark.parametrize(("draw", "scale", "said"), WORLDS)
def test_what_cannot_be_drawn_is_refused(draw, scale, said):
    with pytest.raises(BadInput, match=said):
        world(Ensemble(draw, scale), known={"late": Known("m/s", lambda log: 1.0)})


def test_seeds_where_nothing_is_noisy_are_refused_or_told():
    quiet = PLAIN.but(noise=0.0)
    with pytest.raises(BadInput, match="draws seeds alone, and car has no noise in scenario plain"):
        world(Ensemble(seeds=True), quiet)
    both = world(Ensemble({"m": "50:60"}, seeds=True), quiet)
    assert both.notes == ("car has no noise in scenario plain: seeds have no effect there",)


@pytest.mark.parametrize("hi", [4.0, 9.0])
@pytest.mark.parametrize("numbers", [(1.0, 4.0), (4.0, 1.0), (4.0, 4.0), (2.0, 3.0)])
def test_a_number_that_is_to_be_seen_is_none_of_those_before(numbers, hi):
    """In its range, within a billionth, whichever of them it was."""
    signals = [Param("1", v, lo=0, hi=hi).named(f"p{k}") for k, v in enumerate(numbers)]
    signals.insert(0, Param("1", "2*p1").named("derived"))
    found = _other(signals, 4.0)
    assert found not in numbers
    assert found == pytest.approx(4.0, rel=1e-8)
    assert found <= hi
    row = _other([Param("1", (1.0, 4.0), shape=(2,), hi=hi).named("row")], (2.0, 4.0))
    assert row[1] != 4.0
    assert row == pytest.approx([2.0, 4.0], rel=1e-8)


def test_what_an_ensemble_cannot_be_made_of_is_refused_as_it_is_made():
    for given in ({"draw": 3}, {"scale": "0.8:1.2 of m"}, {"draw": {"m": "1:2"}, "seeds": "yes"}):
        with pytest.raises(BadInput):
            Ensemble(**given)


def test_more_numbers_than_a_sobol_sequence_has_are_refused(monkeypatch):
    monkeypatch.setattr(qmc.Sobol, "MAXDIM", 1)
    with pytest.raises(BadInput, match="draws at most 1 numbers"):
        plan_of(car, PLAIN, ["m=10:30", "v=1:2"], samples=4, design="sobol").numbers(0)
