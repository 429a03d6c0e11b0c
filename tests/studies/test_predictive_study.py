"""The study ``predictive``: its helpers against code that shares nothing with them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from slipctl import Experiment, RunFailed, Table, simulate
from slipctl.commands.cli import main
from slipctl.predict import reference
from slipctl.predict.trials import Driver
from slipctl.studies.predictive import experiments, study
from slipctl.studies.predictive.loops import GAINS, cases
from slipctl.studies.predictive.problems import (
    ROAD,
    axle_problem,
    car_price,
    problems,
    rolled,
    run,
)  # fmt: skip
from slipctl.studies.predictive.reference_speed import reference_speed

pytestmark = pytest.mark.second


def test_every_row_can_be_answered_without_full():
    """Each experiment that a row may ask for is among those of a plain run."""
    assert set(study.experiments) <= set(study.plain)
    assert len([c for c in study.claims if c.ours is not None]) >= 8


def test_the_grid_of_pi_gains_rolls_the_loop_of_the_study():
    """The same cost as the connected loop, simulated; both are rounding apart."""
    case = cases({}, False)[1]
    log = simulate(case.loops["pid"], case.scenario, compile=False)
    x = np.column_stack([log[f"plant.{n}"].values for n in ("v", "q", "xi")])
    u = log["ctl.T"].values
    costs = [car_price(b, a) for a, b in zip(u, x[1:], strict=False)]  # all but the last tick
    p = problems()["car"]
    part = p._replace(given=p.given[: len(ROAD) - 1])
    found, _ = experiments.pi_costs(part, [GAINS["car"][0]], [GAINS["car"][1]])
    assert found[0] == pytest.approx(sum(costs), rel=1e-9)


def test_a_wrong_answer_has_no_numbers(monkeypatch):
    """OSQP stopped after five steps: its row is empty, as its answer leaves the conditions."""
    poor = reference.OSQP | {"osqp": {"verbose": False, "max_iter": 5}}
    monkeypatch.setattr(reference, "QUADRATIC", {"osqp": (poor,)})
    assert run(problems()["reference"], slice(0, 3), solver="osqp")["cost"] is None
    with pytest.raises(RunFailed):
        rolled(problems()["reference"], Driver(axle_problem().make(solver="osqp"), compile=False))


def test_osqp_keeps_a_hard_limit_and_prices_one_that_nobody_can_keep():
    """As rows where a control keeps them; with a price from a slip that is beyond its limit."""
    hard = axle_problem(hard={"s": (-0.1, 0.019)}, horizon=6)
    ticks = {w: Driver(hard.make(**o), compile=False) for w, o in experiments.WAYS.items()
             if w in ("one iteration", "OSQP")}  # fmt: skip
    for given in ((10, 10.05, 1, 0, 0.3, 0.02), (10, 10.4, 4, 0, 0.3, 0.02)):
        ours, theirs = (t(*given) for t in ticks.values())
        assert theirs[0] == pytest.approx(ours[0], abs=1e-6)
        assert theirs[3] < reference.DEVIATION
    assert ours[1] == 3


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.others("long")
def test_a_window_with_the_sign_of_slip_is_solved_in_every_tick(seed):
    """With seed 2 the interior point method stood still in one tick; the window is beyond it."""
    table = reference_speed(SimpleNamespace(seed=seed, compile=True))
    assert table["ticks not solved"] == [0, 0]
    assert table["ticks below the rim"][1] == 0
    assert table["rms error"][1] < 0.7 * table["rms error"][0]


def test_a_plain_run_does_the_experiments_that_the_study_names(monkeypatch, tmp_path, capsys):
    small = {n: Experiment(n, lambda context: Table("t", {"one": ("1", [1.0])})) for n in "ab"}
    case = cases({}, False)[1]
    few = replace(
        study, experiments=small, plain=("car", "a"), claims=(), headline="", figures={},
        cases=lambda models, quick: [replace(case, loops={"pid": case.loops["pid"]})],
    )  # fmt: skip
    monkeypatch.setattr("slipctl.study.resolve.load_study", lambda name: few)
    assert main(["run", "predictive", "--out", str(tmp_path / "o"), "--no-compile", "-q"]) == 0
    text = (tmp_path / "o" / "tables.json").read_text(encoding="utf-8")
    assert '"a"' in text
    assert '"b"' not in text


@pytest.mark.long
@pytest.mark.usefixtures("needs_compiler")
def test_what_ipopt_calls_is_compiled_or_the_study_says_that_it_is_not(monkeypatch, tmp_path):
    """The same numbers either way; ours and OSQP's are never compiled there."""
    monkeypatch.chdir(tmp_path)
    p = axle_problem(4)
    found = experiments.by_way(p, "IPOPT")
    plain = experiments.by_way(p, "IPOPT", compile=False)
    assert (found.pop("how"), plain.pop("how")) == ("compiled", "interpreted")
    assert found == plain
    assert experiments.by_way(p, "one iteration")["how"] == "interpreted"

    def fails():
        raise RuntimeError("no compiler")

    monkeypatch.setattr(experiments.reference, "compile_callbacks", fails)
    assert experiments.by_way(p, "IPOPT") == plain | {"how": "interpreted"}
    assert list(tmp_path.iterdir()) == []
