"""Tuning: draws by number, proved first, the same gains on any cores, files that others take."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import closed_loop, three_rails
from hypothesis import given
from hypothesis import strategies as st

from slipctl import BadInput, Ensemble, Gains, Known, Rail, Section, Signals, prepare, simulate
from slipctl.commands.cli import main
from slipctl.design import fronts, gain_files, gain_search, goals
from slipctl.design import tune as tune_module
from slipctl.design.gain_search import Candidate, is_behind
from slipctl.design.goals import Limit, Score, paired_difference, read_objective
from slipctl.design.ranges import Free
from slipctl.design.rolls import Rolls
from slipctl.design.tune import Stopped, Tuned, tune
from slipctl.errors import RunFailed
from slipctl.run.metrics import Metric
from slipctl.run.sweep.ensemble import World, read_ensemble
from slipctl.run.sweep.sweep_plan import Axis
from slipctl.seek import population

SIGNALS = Signals(speed="plant.wheel.v", slip="plant.wheel.v_s", torque="plant.brake.T_b",
                  reference="v_opt", adhesion="plant.adh.mu",
                  best_adhesion="rail.best")  # fmt: skip
KNOWN = {"rail.best": Known("1", [0.3, 0.1, 0.03])}
ENSEMBLE = Ensemble({"plant.wheel.m": "6t:9t"}, {"peak": "0.8:1.2 of plant.adh.c, rail.best"})
LOOP, SCENARIO = closed_loop(), three_rails(0.03)


def certified(loop: Any) -> dict[str, float]:
    numbers = loop.values_by_place()
    return {"k1": float(numbers["ctl.law.k1"]), "k2": float(numbers["ctl.law.k2"]), "L": 8.0}


GAINS = (Gains("sta", "sta", "super_twisting", certified),)


def tuned(out: Path | None = None, **changes: Any) -> Tuned:
    options: dict[str, Any] = {
        "scenario": SCENARIO, "signals": SIGNALS, "known": KNOWN, "samples": 4, "held_out": 4,
        "runs": 60, "compile": False, "out": out, "jobs": 2,
    }  # fmt: skip
    free = changes.pop("free", {"ctl.law.k1": (1, 60)})
    goal = changes.pop("objective", "slip_error_rms")
    return tune(changes.pop("loop", LOOP), free, goal, changes.pop("ensemble", ENSEMBLE),
                changes.pop("subject_to", ()), **(options | changes))  # fmt: skip


# ---- draws ---------------------------------------------------------------------------------------


def test_a_draw_is_the_loop_with_these_numbers_on_that_rail() -> None:
    """Bits of a draw are those of the loop set by hand and simulated on a rail written by hand."""
    world = World(LOOP, SCENARIO, ENSEMBLE, signals=SIGNALS, known=KNOWN, seed=3, compile=False)
    draw = world.draw(1, 5)
    by, mass = draw.factors["peak"], draw.numbers["plant.wheel.m"]
    assert 0.8 <= by <= 1.2
    assert 6e3 <= mass <= 9e3
    heights = {"dry": 1.0, "wet": 0.29, "ice": 0.1}  # Table 1 of Huang 2020
    sections = [
        Section(s.start, s.condition, {**s.values, "plant.adh.c": by * heights[s.condition]})
        for s in SCENARIO.rail.sections
    ]
    alone = simulate(LOOP.with_params(**{"plant.wheel.m": mass, "ctl.law.k1": 9.0}),
                     SCENARIO.but(rail=Rail(sections)), compile=False)  # fmt: skip
    found = world.metrics({"ctl.law.k1": 9.0}, draw)
    error = np.asarray(alone["plant.wheel.v_s"] - alone["v_opt"])
    assert found["slip_error_rms"].value == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-12)
    assert [*draw.known["rail.best"].values] == [by * v for v in KNOWN["rail.best"].values]
    run = prepare(LOOP, SCENARIO, compile=False)
    log = run({"plant.wheel.m": mass, "ctl.law.k1": 9.0}, rail=draw.scenario.rail)
    assert (log["plant.wheel.v"] == alone["plant.wheel.v"].values).all()
    assert (run({"ctl.law.k1": 9.0})["v_opt"] == alone["v_opt"].values).all()


@given(st.integers(0, 2**40), st.integers(0, 3), st.integers(0, 1000))
def test_draws_follow_from_their_number(seed: int, stream: int, k: int) -> None:
    """The same number gives the same draw; another stream, seed or number gives another."""
    world = object.__new__(World)
    world.seed, world.ensemble, world.known = seed, Ensemble({"a": "0:1"}), {}
    world.axes, world.factors, world.scenario = (Axis("a", 0.0, 1.0, None, "1"),), (), SCENARIO
    one = world.draw(stream, k).numbers["a"]
    assert one == world.draw(stream, k).numbers["a"]
    others = [world.draw(stream + 1, k), world.draw(stream, k + 1)]
    world.seed += 1
    assert one not in [d.numbers["a"] for d in (*others, world.draw(stream, k))]


@pytest.mark.parametrize(("table", "said"), [
    ({}, "empty"), ({"seeds": False}, "empty"), ({"draws": {}}, "did you mean 'draw'"),
    ({"draw": {"a": 3}}, 'write "lo:hi"'), ({"seeds": 1}, "true or false"), ([], "write a table"),
])  # fmt: skip
def test_ensembles_that_are_none(table: Any, said: str) -> None:
    with pytest.raises(BadInput, match=said):
        read_ensemble("e.toml", table)


@pytest.mark.parametrize(("ensemble", "said"), [
    (Ensemble({"plant.wheel.m": "9t:6t"}), "lo < hi"),
    (Ensemble({"plant.wheel.mass": "6t:9t"}), "no parameter"),
    (Ensemble({"plant.wheel.m": "6t:9t:3"}), "no number of values"),
    (Ensemble({}, {"x": "0.8:1.2"}), "0.8:1.2 of NAME"),
    (Ensemble({}, {"x": "1.2:0.8 of plant.adh.c"}), "lo < hi"),
    (Ensemble({}, {"x": "0.8:1.2 of plant.adh.d"}), "has no 'plant.adh.d'"),
    (Ensemble(seeds=True), "seeds alone, and .* has no noise"),
])  # fmt: skip
def test_ensembles_that_do_not_fit_the_loop(ensemble: Ensemble, said: str) -> None:
    with pytest.raises(BadInput, match=said):
        World(LOOP, SCENARIO, ensemble, known=KNOWN, compile=False)


def test_what_stops_a_run_stops_the_search_and_what_fails_does_not() -> None:
    """What had ended before is kept."""

    class Falls:
        def draw(self, stream: int, k: int) -> int:
            return k

        def metrics(self, numbers: Any, k: int) -> dict[str, int]:
            if k == 1:
                raise RunFailed("it fell over")
            if k == 2:
                raise OSError("no room")
            return {"k": k}

    rolls = Rolls(Falls())  # type: ignore[arg-type]
    assert rolls.all(0, [(7, {}, 0), (7, {}, 1)]) == [{"k": 0}, None]
    with pytest.raises(OSError, match="no room"):
        rolls.all(0, [(7, {}, 0), (7, {}, 2)])
    assert rolls.all(0, [(7, {}, 3)]) == [{"k": 3}]


@pytest.mark.parametrize("fails", [0, 1, 2, 3])
def test_metrics_are_those_of_the_first_draw_that_runs(fails: int) -> None:
    """Where none does, the reason of the last is told."""

    class Falls:
        def draw(self, stream: int, k: int) -> int:
            return k

        def metrics(self, numbers: Any, k: int) -> int:
            if k < fails:
                raise RunFailed(f"draw {k} fell over")
            return k

    with pytest.raises(RunFailed, match="draw 2") if fails == 3 else nullcontext():
        assert tune_module._metrics_of_first(Falls(), {}, 3) == fails  # type: ignore[arg-type]


def test_what_goes_on_is_told_up_to_its_end() -> None:
    """All runs may have ended before it has."""
    told: list[tuple[str, float]] = []
    rolls = Rolls(None)  # type: ignore[arg-type]
    rolls.progress = lambda stage, share: told.append((stage, share))
    rolls.advance()
    rolls.end()
    assert told == []
    rolls.begin("search", 4)
    for _ in range(5):
        rolls.advance()
    rolls.end()
    shares = [share for _, share in told]
    assert shares[:4] == [0.0, 0.25, 0.5, 0.75]
    assert all(0.75 < share < 1 for share in shares[4:-1])
    assert told[-1] == ("search", 1.0)


def test_seeds_have_no_effect_where_nothing_is_noisy() -> None:
    """A loop without noise takes the draws of one with noise, and says so in one line."""
    draw = {"plant.wheel.m": "6t:9t"}
    world, without = (World(LOOP, SCENARIO, Ensemble(draw, seeds=s), known=KNOWN, compile=False)
                      for s in (True, False))  # fmt: skip
    assert [*world.notes] == [
        "loop has no noise in scenario three_rails: seeds have no effect there"
    ]
    assert not without.notes
    assert world.draw(0, 3).numbers == without.draw(0, 3).numbers


# ---- what is wanted ------------------------------------------------------------------------------


@pytest.mark.parametrize(("text", "value"), [
    ("a", 3.0), ("a + 2*b", 7.0), (" -1*b+0.5 * a", -0.5), ("1e-1*a - b", -1.7),
])  # fmt: skip
def test_sums_of_metrics(text: str, value: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """A sum is what it says; of a list the worst row counts, the least where large is good."""
    monkeypatch.setattr(goals, "METRICS", {"a": 0, "b": 0})
    metrics = {"a": Metric([1.0, 3.0], "1"), "b": Metric(2.0, "1")}
    assert read_objective(text).value(metrics) == pytest.approx(value)
    assert read_objective("-1*a").value(metrics) == -1.0
    assert read_objective("a").value({"a": Metric([1.0, None], "1")}) == math.inf


@pytest.mark.parametrize("text", ["", "a b", "a**2", "2", "0*a", "a+", "c"])
def test_sums_that_are_none(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(goals, "METRICS", {"a": 0, "b": 0})
    with pytest.raises(BadInput):
        read_objective(text)


rows = st.lists(st.floats(-5, 5), min_size=1, max_size=20)


@given(rows, st.floats(0.05, 1.0))
def test_a_share_of_the_draws(overs: Sequence[float], share: float) -> None:
    """A limit with a share is kept exactly if that share of the draws keeps it."""
    limit = Limit("", "a", True, 1.0, "1", share)
    keep = sum(o <= 0 for o in overs)
    assert (limit.missed(overs) == 0) == (keep >= share * len(overs) - 1e-9)


@given(st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), min_size=2, max_size=20))
def test_who_is_better_everywhere_is_never_given_up(pairs: Sequence[tuple[float, float]]) -> None:
    """Nobody is given up who is better or equal on each draw; at the end the mean decides."""
    low, high = [min(p) for p in pairs], [max(p) for p in pairs]
    one, other = (Candidate(k, {}, np.zeros(1), Score(v, [[]] * len(v)))
                  for k, v in enumerate((low, high)))  # fmt: skip
    assert not is_behind(one, other, ())
    assert is_behind(one, other, (), final=True) == (
        not np.mean(low) < np.mean(high)
    ) or math.isclose(np.mean(low), np.mean(high))
    mean, error = paired_difference(low, high)
    d = np.subtract(low, high)
    assert mean == pytest.approx(d.mean())
    assert error**2 * len(d) * (len(d) - 1) == pytest.approx(((d - d.mean()) ** 2).sum(), abs=1e-9)


def test_limits_come_before_the_objective() -> None:
    """Who misses a limit that the other keeps is given up; a share is judged at the end only."""
    every = Limit("", "a", True, 1.0, "1")
    few = Limit("", "a", True, 1.0, "1", 0.5)
    good = Candidate(0, {}, np.zeros(1), Score([5.0] * 4, [[-1.0]] * 4))
    bad = Candidate(1, {}, np.zeros(1), Score([1.0] * 4, [[1.0], [1.0], [1.0], [-1.0]]))
    assert is_behind(bad, good, [every])
    assert not is_behind(bad, good, [few])
    assert is_behind(bad, good, [few], final=True)
    assert not is_behind(good, bad, [every], final=True)


# ---- the search ----------------------------------------------------------------------------------


def test_a_draw_that_is_lost_counts_as_worst_and_the_rest_still_decides() -> None:
    """Fewer lost draws win; where as many are lost, those that both reach decide."""
    inf = math.inf
    hand, same, fewer = [10.0, inf, 12.0, 14.0], [9.0, inf, 11.0, 13.0], [20.0, 20.0, 20.0, 20.0]
    assert paired_difference(same, hand) == (-1.0, 0.0)
    assert paired_difference(fewer, hand)[0] == -inf
    assert paired_difference(hand, fewer)[0] == inf
    assert paired_difference([1.0, inf, 3.0], [inf, 2.0, 4.0])[0] == -1.0, "each lost one"
    by_hand, better = (
        Candidate(k, {}, np.zeros(1), Score(v, [[]] * 4)) for k, v in enumerate((hand, same))
    )
    assert not is_behind(better, by_hand, (), final=True)
    assert is_behind(by_hand, better, (), final=True)
    score = Score([], [])
    gain_search.add(
        score, {"stopping_distance": Metric(None, "m")}, read_objective("stopping_distance"), ()
    )
    gain_search.add(score, None, read_objective("stopping_distance"), ())
    assert score.values == [inf, inf]
    assert score.in_words() == "never reached"
    assert by_hand.score.in_words() == "12, never in 1 of 4 draws"


@given(st.floats(1e-6, 1e6), st.floats(1.001, 1e6), st.lists(st.floats(0, 1), min_size=1))
def test_the_box_and_its_cube(lo: float, ratio: float, shares: Sequence[float]) -> None:
    """Points of the cube lie in the range and come back; a trial stays in the cube."""
    box = population.Box([lo], [lo * ratio])
    for s in shares:
        x = box.point(np.array([s]))
        assert lo <= x[0] <= lo * ratio
        assert box.share(x)[0] == pytest.approx(s, abs=1e-6)
    members = population.first(6, 2, 1)
    assert sorted(np.floor(6 * members[:, 0])) == [*range(6)]
    trial = population.trial(members, 0, 1, (1, len(shares)))
    assert ((trial >= 0) & (trial <= 1)).all()


@pytest.mark.long
def test_as_good_as_a_fine_grid() -> None:
    """One gain: no point of a grid of 60 is better on the same draws, at a tenth of its runs."""
    found = tuned(runs=100)
    search = found.search
    rolls = Rolls(search.rolls.world)
    grid = [float(x) for x in np.geomspace(1, 60, 60)]
    means = []
    for n, x in enumerate(grid):
        asked = [(n, {"ctl.law.k1": x}, k) for k in range(search.samples)]
        means.append(np.mean([m["slip_error_rms"].value for m in rolls.all(0, asked) if m]))
    assert search.best.score.mean() <= min(means) * 1.002  # a step of the grid is 7 %
    assert search.spent < 0.75 * rolls.done
    assert search.best.score.mean() <= search.by_hand.score.mean()


@pytest.mark.long
def test_the_same_on_any_cores_and_nothing_runs_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One thread finds what four find; the same call again runs nothing and finds the same."""
    one, four = (tuned(tmp_path / str(j), jobs=j) for j in (1, 4))
    assert one.gains == four.gains
    assert one.judged.tuned == four.judged.tuned
    with monkeypatch.context() as patched:
        patched.setattr(World, "metrics", _refuse_but_once(World.metrics))
        again = tuned(tmp_path / "1")
    assert again.gains == one.gains
    assert again.slices == one.slices
    with pytest.raises(BadInput, match="holds another search: its seed differs"):
        tuned(tmp_path / "1", seed=2)


def _refuse_but_once(metrics: Any) -> Any:
    left = [1]  # the metrics that the loop has are asked for

    def once(*args: Any) -> Any:
        left[0] -= 1
        assert left[0] >= 0
        return metrics(*args)

    return once


@pytest.mark.long
def test_stopped(tmp_path: Path) -> None:
    """Ctrl-C gives the best so far; the same call goes on to what an unbroken one finds."""

    def stop(text: str) -> None:
        if text.startswith("generation 1"):
            raise KeyboardInterrupt

    with pytest.raises(Stopped) as stopped:
        tuned(tmp_path, tell=stop)
    best = stopped.value.best
    assert best.judged is None
    assert "was stopped" in gain_files.gains_text(best, "")
    assert tuned(tmp_path).gains == tuned().gains


@pytest.mark.long
def test_what_is_not_proved_is_not_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each candidate that ran is certified; of k2 below L = 8 none ever is."""
    ran: set[float] = set()
    real = World.metrics

    def noted(self: World, numbers: Any, draw: Any) -> Any:
        ran.add(numbers["ctl.law.k2"])
        return real(self, numbers, draw)

    monkeypatch.setattr(World, "metrics", noted)
    found = tuned(free={"ctl.law.k2": (1, 60)}, gains=GAINS)
    assert min(ran) > 8.0  # k2 > L is necessary
    assert found.search.refused
    assert found.margins["sta"][0] >= 1.0
    margin = tuned(free={"ctl.law.k2": (1, 60)}, gains=GAINS, subject_to=["margin>=1.5"])
    assert margin.gains["ctl.law.k2"] > 12.0


@pytest.mark.parametrize(("changes", "said"), [
    ({"free": {}}, "nothing is free"),
    ({"free": {"k1": None}}, "k1 has no range"),
    ({"free": {"ctl.law.k1": (5, 2)}}, "lo < hi"),
    ({"free": {"ctl.law.k1": (5, "inf")}}, "no number"),
    ({"free": ["ctl.law.k1=1:2:5"]}, "without a number of values"),
    ({"free": ["k3=1:2"]}, "no parameter"),
    ({"free": ["ctl.law.k1=1:2", "ctl.law.k1=3:4"]}, "twice"),
    ({"free": {"plant.wheel.m": (6e3, 9e3)}}, "the ensemble draws it"),
    ({"free": {"plant.adh.c": (0.1, 1)}}, "the rail sets"),
    ({"objective": "jerk"}, "no metric 'jerk'"),
    ({"objective": "funnel_exits"}, "has no metric 'funnel_exits' to minimise"),
    ({"subject_to": ["torque_ripple<8kN m"]}, "write METRIC<=VALUE"),
    ({"subject_to": ["torque_ripple<=8m"]}, "another dimension"),
    ({"subject_to": ["torque<=8kN m"]}, "did you mean"),
    ({"subject_to": ["slip_max@1.5<=2m/s"]}, "share of draws"),
    ({"subject_to": ["margin>=1.2"]}, "has no certificate"),
    ({"subject_to": ["margin<=1.2"], "gains": GAINS}, "write margin>=M"),
    ({"subject_to": ["smc.margin>=1.2"], "gains": GAINS}, "no certificate 'smc'"),
    ({"subject_to": ["margin>=9"], "gains": GAINS}, "nothing in the ranges meets 'margin>=9'.*is"
     " proved up to .* times the bounds, 9 are wanted"),
    ({"subject_to": ["slip_max<=1mm/s"]}, "nothing in the ranges meets 'slip_max<=1mm/s': the"
     " closest, .*=.*, comes to .* m/s"),
    ({"samples": 3}, "--samples = 3"),
])  # fmt: skip
def test_what_cannot_be_asked(changes: dict[str, Any], said: str) -> None:
    """Each is one line that says what it is, and how close the closest came."""
    with pytest.raises(BadInput, match=said) as error:
        tuned(**({"runs": 12} | changes))
    assert "\n" not in str(error.value)


# ---- files and commands --------------------------------------------------------------------------


@pytest.mark.second
def test_gains_reach_every_door(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """``--set gains.toml`` of run, sweep and c gives the number that was found, to the last bit."""
    number = 17.300000000000001
    free = Free("ctl.law.k1", "k1", 1.0, 60.0, "m^.5/s^1.5", 20.0)
    search = object.__new__(gain_search.Search)
    found = Tuned(LOOP, "subway_braking:sta@base", (free,), {free.name: number}, search, None, (),
                  {})  # fmt: skip
    file = tmp_path / "gains.toml"
    file.write_text(gain_files.gains_text(found, "slipctl tune ..."))
    run = ["run", "subway_braking", "--quick", "--loop", "sta", "--scenario", "base",
           "--no-compile", "--set", str(file), "--out", str(tmp_path / "run")]  # fmt: skip
    assert main(run) == 0
    log = simulate_attrs(tmp_path / "run" / "logs" / "base" / "sta.nc")
    assert json.loads(log["parameters"])["ctl.law.k1"]["value"] == number
    assert main(["c", "subway_braking:sta", "--set", str(file), "--out", str(tmp_path / "c")]) == 0
    assert f".law_k1 = {number!r}," in (tmp_path / "c" / "subway_braking_sta.c").read_text()
    other = ["run", "subway_braking", "--loop", "smc", "--set", str(file), "--out", str(tmp_path)]
    assert main(other) == 2
    assert "no loop 'sta' runs" in capsys.readouterr().err
    file.write_text('loop = "a:b"')
    assert main(run) == 2
    assert "holds no gains" in capsys.readouterr().err


def simulate_attrs(path: Path) -> Any:
    import xarray

    with xarray.open_dataset(path) as data:
        return dict(data.attrs)


@pytest.mark.long
def test_the_certificate_is_checked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """``slipctl check`` proves each promise of the file anew; an altered one does not hold."""
    found = tuned(gains=GAINS, subject_to=["margin>=1.05"])
    payload = gain_files.certificate_of(found, "slipctl tune ...")
    file = tmp_path / "certificate.json"
    file.write_text(json.dumps(payload))
    assert main(["check", str(file)]) == 0
    assert capsys.readouterr().out.count("CERTIFIED") == 2  # as it is, and at 1.05 times the bound
    payload["exact"][0]["certificate"]["asked"]["L"]["value"] = "1"
    file.write_text(json.dumps(payload))
    assert main(["check", str(file)]) == 1
    payload["extra"] = 1
    file.write_text(json.dumps(payload))
    assert main(["check", str(file)]) == 2


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Gains, certificate and report of a study's loop; bad lines end with 2."""
    line = ["tune", "subway_braking:sta@base", "--free", "k1=15:30", "--minimise", "distance",
            "--samples", "4", "--runs", "8", "--out", str(tmp_path / "out")]  # fmt: skip
    assert main([*line[:4], "k1", *line[5:]]) == 2
    assert main(["tune", "subway_braking", *line[2:]]) == 2
    assert main(["tune", "hst_braking:eppfc", *line[2:]]) == 2
    capsys.readouterr()
    assert main(["tune", "subway_braking:stb", *line[2:]]) == 2
    assert "did you mean 'sta'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("free", "goals", "runs", "wanted"),
    [
        ({"ctl.law.k1": (1, 60)}, "slip_error_rms", None, 250),
        ({"ctl.law.k1": (1, 60), "ctl.law.k2": (1, 60)}, "slip_error_rms", None, 500),
        ({"ctl.law.k1": (1, 60), "ctl.law.k2": (1, 60)}, ["slip_error_rms", "torque_ripple"],
         None, 1000),
        ({"ctl.law.k1": (1, 60)}, ["slip_error_rms", "torque_ripple"], 77, 77),
    ],
)  # fmt: skip
def test_a_search_may_run_250_times_for_each_number_and_objective(
    free, goals, runs, wanted, monkeypatch
):
    seen = []

    def asked(self: Any) -> Any:
        seen.append((type(self).__name__, self.runs, len(self.frees), len(self.objectives)))
        raise BadInput("enough")

    for kind in (gain_search.Search, fronts.FrontSearch):
        monkeypatch.setattr(kind, "run", asked)
    with pytest.raises(BadInput, match="enough"):
        tuned(free=free, objective=goals, runs=runs)
    several = isinstance(goals, list)
    kind = "FrontSearch" if several else "Search"
    assert seen == [(kind, wanted, len(free), len(goals) if several else 1)]


@pytest.mark.parametrize(
    ("number", "said"),
    [
        ({"runs": 0}, "--runs"), ({"runs": 2.5}, "--runs"), ({"samples": 3}, "--samples"),
        ({"samples": 10_001}, "--samples"), ({"seed": -1}, "--seed"), ({"held_out": 1}, "held-out"),
        ({"jobs": -1}, "--jobs"), ({"loop": 3}, "tune: the loop"),
    ],
)  # fmt: skip
def test_a_number_that_no_search_can_have_is_refused_before_it_runs(number, said) -> None:
    with pytest.raises(BadInput, match=said):
        tuned(**number)
