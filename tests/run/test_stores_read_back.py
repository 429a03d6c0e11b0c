"""A sweep of a store that is written here, read back by number, place, metric and signal."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from slipctl import BadInput, Input, Output, Scenario, Signals, State, open_sweep, step
from slipctl.run.metrics import Metric
from slipctl.run.sweep import sweep_export
from slipctl.run.sweep import sweep_store as stores
from slipctl.run.sweep.ensemble import Ensemble, World
from slipctl.run.sweep.sweep_plan import Axis, Plan
from slipctl.run.sweep.sweep_runs import Measured
from slipctl.run.sweep.sweep_store import Ended

DRAWN = (Axis("m", 1.0, 3.0, None, "kg"), Axis("c", 0.0, 1.0, 2, "1"))
GRID = (Axis("m", 1.0, 3.0, 3, "kg"), Axis("c", 0.0, 1.0, 2, "1"))


def made(folder: Path, axes, samples: int, runs, **more):
    """The sweep of these runs: run k gives k, (10 k, 10 k + 1) and, late, k ticks of v."""
    plan = Plan(axes, samples, 7, "random")
    about = {"vary": [[a.name, a.lo, a.hi, a.points, a.unit] for a in axes], "samples": samples,
             "seed": 7, "design": "random", "loop": "toy", "period_s": 0.5, **more}  # fmt: skip
    store = stores.begin(folder, about)
    store.add(
        Ended(k, plan.numbers(k), {
            "distance": Metric(float(k), "m"), "lock_time": Metric(2.0 * k, "s"),
            "pair": Metric([10.0 * k, 10.0 * k + 1], "N", ("dry", "wet")),
            "late": Metric([5.0 + k], "s")},
            logs={"v": k + 0.1 * np.arange(1 + k % 3)} if "logs" in more else {})
        for k in runs
    )  # fmt: skip
    store.close()
    return open_sweep(folder), plan


def test_a_dataset_has_each_number_at_its_place(tmp_path):
    """Run 3 has not ended: it is NaN; samples are counted behind the grid."""
    sweep, plan = made(tmp_path, DRAWN, 3, [0, 1, 2, 4, 5])
    assert (sweep.plan, sweep.missing, sweep.failed) == (plan, 1, {})
    found = sweep.dataset()
    assert dict(found.sizes) == {"c": 2, "sample": 3, "pair_row": 2, "late_row": 1}
    assert found["c"].values.tolist() == [0, 1]
    want = np.array([[0, 2, 4], [1, np.nan, 5]])  # run k is at (k % 2, k // 2)
    assert np.array_equal(found["distance"].values, want, equal_nan=True)
    assert np.array_equal(found["lock_time"].values, 2 * want, equal_nan=True)
    assert np.array_equal(found["pair"].values[..., 0], 10 * want, equal_nan=True)
    assert np.array_equal(found["pair"].values[..., 1], 10 * want + 1, equal_nan=True)
    assert np.array_equal(found["late"].values[..., 0], 5 + want, equal_nan=True)
    assert found["pair_row"].values.tolist() == ["dry", "wet"]
    assert found["late_row"].values.tolist() == ["0"]
    runs = ([0, 2, 4], [1, 3, 5])
    masses = [[plan.numbers(k)["m"] if k != 3 else np.nan for k in row] for row in runs]
    assert np.array_equal(found["m"].values, masses, equal_nan=True)
    assert [found[n].attrs["units"] for n in ("m", "c", "distance", "pair")] == ["kg", "1", "m",
                                                                                "N"]  # fmt: skip


def test_each_number_of_the_metrics_has_its_name(tmp_path):
    """One with a number for each rail has one by rail; one of a single number has it alone."""
    sweep, _ = made(tmp_path, GRID, 1, [0, 2, 5])
    found = {name: (unit, values.tolist()) for name, unit, values in sweep.labelled()}
    assert found == {
        "distance": ("m", [0, 2, 5]), "lock_time": ("s", [0, 4, 10]),
        "pair, dry": ("N", [0, 20, 50]), "pair, wet": ("N", [1, 21, 51]), "late": ("s", [5, 7, 10]),
    }  # fmt: skip
    assert sweep.missing == 3


@pytest.mark.parametrize(("axes", "samples"), [(DRAWN, 3), (GRID, 1)])
@pytest.mark.parametrize("chunk", [1, 8 * 3 * 2 * 2, 2**20])
def test_logs_are_put_at_their_places_a_batch_at_a_time(axes, samples, chunk, tmp_path,
                                                        monkeypatch):  # fmt: skip
    """Of a run that ended earlier the rest is NaN."""
    monkeypatch.setattr(sweep_export, "CHUNK", chunk)
    more = {"logs": ["v"], "log_units": {"v": "m/s"}}
    sweep, plan = made(tmp_path, axes, samples, range(6), **more)
    shape = (2, 3) if axes is DRAWN else (3, 2)
    found, batches = np.full((*shape, 3), -1.0), []

    def put(name, where, values):
        assert name == "v"
        found[where] = values
        batches.append(where)

    sweep_export._fill(sweep, 3, put)
    want = np.full((*shape, 3), np.nan)
    for k in range(6):
        place = plan.place(k)[:2] if axes is GRID else (plan.place(k)[0], plan.place(k)[1])
        want[place][: 1 + k % 3] = k + 0.1 * np.arange(1 + k % 3)
    assert np.array_equal(found, want, equal_nan=True)
    along, size = sweep_export._batch(sweep, 3)
    assert along == (1 if axes is DRAWN else 0)
    assert len(batches) == math.ceil(3 / size[along])
    assert sweep_export._signals(sweep) == [("v", "m/s")]
    assert sweep_export._time(sweep, 3).tolist() == [0, 0.5, 1.0]


def test_a_log_that_is_kept_is_read_and_one_that_is_not_is_told(tmp_path):
    more = {"logs": ["v"], "log_units": {"v": "m/s"}}
    sweep, _ = made(tmp_path / "a", GRID, 1, [0, 2, 5], **more)
    log = sweep.log(2)
    assert log["v"].values == pytest.approx([2.0, 2.1, 2.2])
    assert log["time"].values.tolist() == [0, 0.5, 1.0]
    assert log["v"].attrs["units"] == "m/s"
    assert [k for k, _ in sweep.logs([5, 1, 2])] == [5, 2]
    assert sweep.longest() == 3
    with pytest.raises(BadInput, match=r"a keeps no log of run 1: run 1 has not ended"):
        sweep.log(1)
    without, _ = made(tmp_path / "b", GRID, 1, [0])
    with pytest.raises(BadInput, match=r"b keeps no log of run 0: it was made without --log"):
        without.log(0)


def test_a_store_that_says_of_no_sweep_what_it_is_is_refused(tmp_path, monkeypatch):
    stores.begin(tmp_path, {"loop": "toy", "samples": 3}).close()
    with pytest.raises(BadInput, match="is no store of a sweep: 'vary'"):
        open_sweep(tmp_path)
    sweep, _ = made(tmp_path / "a", GRID, 1, [0])

    def odd(self):
        raise ValueError("odd")

    monkeypatch.setattr(stores.Store, "runs", odd)
    with pytest.raises(BadInput, match="is no store of a sweep: odd"):
        _ = sweep.runs


@step(period=0.1, y=Output("1"), row=Output("1", shape=(2,)))
def grows(
    v=State("1", 1.0), heard=Input("1", "noisy", value=0.0, noise=0.1, change=9.0),
    by=Input("1", value=1.0),
):  # fmt: skip
    """Breaks, the sooner the faster it grows."""
    import casadi as ca

    return dict(v=v * by), dict(y=v + heard, row=ca.vertcat(v, by))


def test_single_numbers_alone_are_kept_of_a_run():
    with pytest.raises(BadInput, match=r"row has shape \(2,\); --log keeps single numbers"):
        Measured(grows, Scenario("s", 1.0), Signals(), logs=("y", "row"), compile=False)


def test_a_run_that_breaks_has_a_fingerprint_of_how_it_broke():
    def of(by, **more):
        scenario = Scenario("s", 1.0, inputs={"by": by}, noise=0, **more)
        return Measured(grows, scenario, Signals(), compile=False).fingerprint()

    assert of(1e200) == of(1e200)
    assert of(1e200) != of(1e40)  # breaks later
    assert of(1.0) != of(2.0)


def test_what_is_drawn_together_follows_from_the_seed_of_a_draw():
    also = Ensemble(also=lambda seed: {"v": 1.0 + seed % 7}, seeds=True)
    world = World(grows, Scenario("s", 1.0), also, compile=False, seed=5)
    draws = [world.draw(0, k) for k in range(6)]
    assert [d.numbers for d in draws] == [{"v": 1.0 + d.scenario.seed % 7} for d in draws]
    assert len({d.scenario.seed for d in draws}) == 6
    assert world.notes == ("grows has no noise in scenario s: seeds have no effect there",)
