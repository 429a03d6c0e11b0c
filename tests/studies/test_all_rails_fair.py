"""``all_rails``, tuned alike: one budget, draws that nobody has seen, tables that add up."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slipctl import Context, simulate
from slipctl.design.gain_search import HELD_OUT, TRAINING
from slipctl.design.slopes.polish import Polished
from slipctl.run.sweep.ensemble import World
from slipctl.studies.all_rails import fair
from slipctl.studies.all_rails.loops import NAMES, VEHICLES, loops, scenario

pytestmark = pytest.mark.second


def test_every_law_has_two_free_numbers_in_its_range() -> None:
    """Also predictive control; a range holds the hand-set number, and the declared one holds it."""
    assert set(fair.FREE) == set(NAMES)
    ours = loops("subway")
    for name, free in fair.FREE.items():
        values = ours[name].values_by_place()
        assert len(free) == 2
        for n in free:
            lo, hi = fair._range(float(values[n]), ours[name], n)
            assert lo < float(values[n]) <= hi
            assert hi / lo <= fair.SPAN**2 * (1 + 1e-12)


def test_draws_are_alike_for_every_law_and_fresh() -> None:
    """The same mass, lag, height and noise under each law; none of the search among the judged."""
    v, ours = VEHICLES["subway"], loops("subway")
    drawn = []
    for name in ("sta", "efc"):
        wanted = scenario("subway", "table_1").but(params={})
        world = World(ours[name], wanted, fair.ensemble(v, ours[name]), seed=fair.SEED,
                      signals=fair.SIGNALS, compile=False)  # fmt: skip
        drawn.append([[world.draw(s, k) for k in range(12)] for s in (TRAINING, HELD_OUT)])
        now = world.draw(HELD_OUT, 0)
        told = float(ours[name].values_by_place()["world.plant.m"])
        assert 0.9 * told <= now.numbers["world.plant.m"] <= 1.1 * told
        after = world.loop.with_params(**{"world.plant.m": now.numbers["world.plant.m"]})
        known = float(after.values_by_place()["world.fall.m"])
        assert known == pytest.approx(told)  # what the controller knows stays
    for one, other in zip(*drawn, strict=True):
        assert [d.numbers for d in one] == [d.numbers for d in other]
        assert [d.scenario.seed for d in one] == [d.scenario.seed for d in other]
    seen, judged = ({d.scenario.seed for d in ds} for ds in drawn[0])
    assert not seen & judged


def outcome(ways: dict[str, list[float | None]], hand: float) -> dict[str, Any]:
    return {
        "gains": {"law.law.k1": 2.0}, "certificate": "c", "runs": 80, "candidates": 30,
        "ways": {r: {"tuned": w, "by hand": [hand] * 3} for r, w in ways.items()},
        "profile": {w: [1.0 + hand] * len(f) for w, f in fair.SWEPT.items()},
    }  # fmt: skip


def test_tables_add_up() -> None:
    """Paired with the best of the rail; a run that fails is counted and left out of the pairs."""
    found = {
        ("subway", "sta"): outcome({"table_1": [10.0, 12.0, 14.0], "moving": [1.0, 2.0, 3.0]}, 9.0),
        ("subway", "efc"): outcome(
            {"table_1": [11.0, 12.5, 15.0], "moving": [0.5, 1.0, None]}, 8.0
        ),
    }
    table = fair.judged(found, "")
    assert table["behind the best"][0] == 0.0
    assert table["behind the best"][1] == pytest.approx(np.mean([1, 0.5, 1]))
    assert table["standard error"][1] == pytest.approx(np.std([1, 0.5, 1], ddof=1) / math.sqrt(3))
    assert table["failed runs"] == [0, 0, 0, 1]
    assert table["behind the best"][2] == 0.0  # a law that fails is not the best
    assert table["gained by tuning"][0] == pytest.approx(9.0 - 12.0)
    assert table["seen by the tuner"] == [True, True, False, False]
    rows = fair.profiles(found)
    assert set(rows["sta"]) == {1.0}
    assert set(rows["efc"]) == {0.0}


@pytest.mark.long
@pytest.mark.usefixtures("needs_compiler")
def test_a_law_is_tuned_judged_and_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A short run of one law; the second start reads it, and its numbers are plain."""
    short = VEHICLES["subway"]._replace(length=0.1)
    monkeypatch.setitem(VEHICLES, "subway", short)
    swept = {"lag": (1.0, 2.0), "sample time": (1, 4)}
    for name, value in (("RUNS", 8), ("SAMPLES", 4), ("JUDGED", 2), ("NOISES", (11,)),
                        ("SWEPT", swept)):  # fmt: skip
        monkeypatch.setattr(fair, name, value)
    monkeypatch.setattr("slipctl.design.tune.polish", lambda search: Polished("not asked"))
    context = Context(False, {}, [], folder=tmp_path)
    found = context.kept({"law": "sta"}, lambda: fair.work(context, "subway", "sta"))
    assert found["runs"] <= 8 + 48
    assert set(found["ways"]) == {"table_1", "moving"}
    assert all(len(w) == 2 for rail in found["ways"].values() for w in rail.values())
    L = float(found["certificate"].split()[2])
    k2 = found["gains"]["law.law.k2"]
    assert 0 < L <= k2 * (1 + 1e-3)
    assert len(found["profile"]["lag"]) == 2
    slow = found["profile"]["sample time"]
    assert slow[0] == found["profile"]["lag"][0]
    assert len(slow) == 2
    assert json.loads(next(tmp_path.glob("*.json")).read_text())["found"] == found


@pytest.mark.long
def test_every_free_number_does_something(monkeypatch: pytest.MonkeyPatch) -> None:
    """A law whose free numbers were idle would not be tuned; PID had such ones."""
    monkeypatch.setitem(VEHICLES, "subway", VEHICLES["subway"]._replace(length=0.2))
    v, ours = VEHICLES["subway"], loops("subway")
    for name, free in fair.FREE.items():
        wanted = scenario("subway", "table_1").but(params={})
        world = World(ours[name], wanted, fair.ensemble(v, ours[name]), seed=fair.SEED,
                      signals=fair.SIGNALS, free=list(free), compile=False)  # fmt: skip
        world.wanted = ("distance",)
        values, draw = ours[name].values_by_place(), world.draw(HELD_OUT, 0)
        found = [fair._way(world, {}, draw, 1.0)]
        found += [fair._way(world, {n: 0.5 * float(values[n])}, draw, 1.0) for n in free]
        assert len(set(found)) == 3, name
        assert None not in found


@pytest.mark.parametrize("name", ["sta", "barrier", "hosm", "nmpc"])
@pytest.mark.others("long")
def test_a_slower_law_computes_with_its_own_sample_time(name: str) -> None:
    """Each 4th tick of the vehicle; what is discretised has 4 ms, and sensors and plant keep 1."""
    slow = loops("subway", 4, (name,))[name]
    assert slow.period == 1e-3
    values = slow.values_by_place()
    ticks = {n: float(x) for n, x in values.items() if n.rpartition(".")[2] in ("T", "T_s")}
    assert {x for n, x in ticks.items() if n.startswith("law.")} <= {4e-3}
    assert {x for n, x in ticks.items() if n.startswith("world.")} == {1e-3}
    assert len(ticks) > 2
    assert set(fair.FREE[name]) <= set(values)
    if name != "sta":  # it insists on a period, which is that of its own ticks
        assert slow["law"].period == 1e-3
    log = simulate(slow, scenario("subway", "table_1").but(duration=0.4), compile=False)
    held = log["limits.T_cmd"].values.reshape(-1)[:400].reshape(100, 4)
    assert np.ptp(held, axis=1).max() == 0.0
    assert len(set(held[:, 0])) > 2
