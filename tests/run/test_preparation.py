"""A prepared run gives what ``with_params`` and ``simulate`` give, bits and refusals."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
import pytest
from conftest import closed_loop, three_rails
from hypothesis import given
from hypothesis import strategies as st

from slipctl import (
    BadInput,
    Block,
    End,
    Param,
    RunFailed,
    Scenario,
    State,
    connect,
    flow,
    prepare,
    sampled,
    simulate,
    sweep,
)
from slipctl.run import build
from slipctl.run.preparation import Prepared
from slipctl.study import resolve

TICKS = 25


@cache
def loops() -> dict[str, tuple[Block, Scenario, Prepared]]:
    """One of each: no shares, rail by time; shares, rail by position, noise; many axles."""
    made = {"plain": (closed_loop(lag=True), three_rails(TICKS * 1e-3))}
    for study, scenario, loop in (
        ("subway_braking", "real", "sta_online"),
        ("hst_braking", "real", "eppfc"),
        ("hst_traction", "base", "pid"),
    ):
        found = resolve.load_study(study)
        case = next(c for c in found.cases(found.models, False) if c.scenario.name == scenario)
        block = case.loops[loop]
        made[study] = (block, case.scenario.but(duration=TICKS * float(block.period or 0)))
    return {n: (b, s, prepare(b, s, compile=False)) for n, (b, s) in made.items()}


def outcome(run):
    """Bits by name of what a run gives, or its refusal."""
    try:
        return {str(n): np.asarray(v).tobytes() for n, v in run().items()}
    except (BadInput, RunFailed) as error:
        return f"{type(error).__name__}: {error}"


@pytest.mark.second
@given(st.sampled_from(["plain", "subway_braking", "hst_braking", "hst_traction"]), st.data())
def test_a_prepared_run_is_with_params_and_simulate(which: str, data: st.DataObject) -> None:
    """Any parameters, start values, shared numbers and single places of them, in and off range."""
    loop, scenario, run = loops()[which]
    known = [*loop.params, *loop.states, *loop.sharing.aliases]
    names = data.draw(st.lists(st.sampled_from(known), min_size=1, max_size=3, unique=True))
    numbers = {}
    for n in names:
        signal = loop.params.get(n) or loop.states.get(n) or loop.params[loop.sharing.name(n)]
        factor = data.draw(st.sampled_from([1.0, 0.9, 1.1, 1.25, 0.02, 30.0, -1.0]))
        value = 1.0 if signal.value is None or signal.derived else signal.value
        numbers[n] = factor * np.asarray(value, dtype=float)
    wanted = outcome(
        lambda: simulate(loop.with_params(**numbers), scenario, compile=False).variables
    )
    assert outcome(lambda: run(numbers)) == wanted
    assert outcome(lambda: run({n: v * 1.0 for n, v in numbers.items()})) == wanted


@pytest.mark.parametrize(
    ("which", "name"),
    [("plain", "ctl.law.k1"), ("subway_braking", "m"), ("hst_braking", "ctl.law.eta_0")],
)
def test_a_number_that_only_changes_a_value_makes_nothing_again(which, name, monkeypatch) -> None:
    loop, _, run = loops()[which]
    value = float(loop.params[name].value)
    run({name: value * 1.01})

    def with_params(self, **values):
        raise AssertionError("the loop was made again")

    monkeypatch.setattr(Block, "with_params", with_params)
    first, second = run({name: value * 1.02}), run({name: value})
    assert any(not np.array_equal(first[n], second[n]) for n in first)


def test_a_step_too_long_for_the_new_number_is_refused_in_the_same_words() -> None:
    @flow()
    def decay(x=State("m", 1.0), c=Param("1/s", 1.0, lo=0.0)):
        return dict(x=-c * x), {}

    loop = sampled(decay, 1e-2, "rk4")
    run = prepare(loop, Scenario("fall", 0.1), compile=False)
    assert run({"c": 2.0})["x"][-1] < run({"c": 1.5})["x"][-1]
    with pytest.raises(BadInput) as wanted:
        loop.with_params(c=1e3)
    with pytest.raises(BadInput) as said:
        run({"c": 1e3})
    assert str(said.value) == str(wanted.value)


@pytest.mark.parametrize("name", ["a", "b"])
def test_every_part_refuses_a_step_too_long_for_the_new_number(name: str) -> None:
    @flow()
    def decay(x=State("m", 1.0), c=Param("1/s", 1.0, lo=0.0)):
        return dict(x=-c * x), {}

    part = sampled(decay, 1e-2, "rk4")
    run = prepare(connect("both", {}, a=part, b=part), Scenario("fall", 0.1), compile=False)
    assert run({f"{name}.c": 2.0})[f"{name}.x"][-1] < run({f"{name}.c": 1.5})[f"{name}.x"][-1]
    with pytest.raises(BadInput):
        run({f"{name}.c": 1e3})


def test_threads_give_the_bits_of_single_runs() -> None:
    """Compiled, so that they do run at the same time."""
    loop, scenario, _ = loops()["plain"]
    run = prepare(loop, scenario, log=["plant.wheel.v", "ctl.T_b"])
    assert set(run()) == {"time", "plant.wheel.v", "ctl.T_b"}
    sets = [{"ctl.law.k1": 1.0 + k / 50} for k in range(12)]
    with ThreadPoolExecutor(4) as pool:
        many = list(pool.map(run, sets))
    for numbers, log in zip(sets, many, strict=True):
        alone = simulate(loop.with_params(**numbers), scenario)
        assert all(log[n].tobytes() == alone[n].values.tobytes() for n in log)


def test_a_seed_is_that_of_the_scenario() -> None:
    loop, scenario, run = loops()["subway_braking"]
    first, other = run(seed=5), run(seed=6)
    alone = simulate(loop, scenario.but(seed=5), compile=False)
    assert all(first[n].tobytes() == alone[n].values.tobytes() for n in first)
    assert any(first[n].tobytes() != other[n].tobytes() for n in first)


@pytest.mark.parametrize(("every", "steps"), [(1, False), (1, True), (7, True)])
def test_a_run_that_ends_before_is_the_beginning_of_the_whole_run(every: int, steps: bool) -> None:
    """It ends at the first tick by which the signal has been there so long, however it is cut."""
    loop, scenario, _ = loops()["plain"]
    whole = simulate(loop, scenario.but(duration=0.2), compile=False)
    v, hold = whole["plant.wheel.v"].values, 5
    level = float(v[60])
    there = v <= level
    wanted = next(k for k in range(hold - 1, v.size) if there[k - hold + 1 : k + 1].all())
    end = End("plant.wheel.v", below=level, hold=hold * float(loop.period or 0.0))
    short = prepare(loop, scenario.but(duration=0.2, end=end), compile=False, every=every)(
        progress=(lambda share: None) if steps else None
    )
    assert short["time"][-1] == whole["time"].values[: wanted + 1 : every][-1]
    for n in short:
        assert short[n].tobytes() == whole[n].values[: wanted + 1 : every].tobytes()
    never = simulate(loop, scenario.but(duration=0.2, end=End("plant.wheel.v", above=1e3)),
                     compile=False)  # fmt: skip
    assert never["time"].size == v.size


def test_what_ends_no_run_is_refused() -> None:
    loop, scenario, _ = loops()["plain"]
    with pytest.raises(BadInput, match="one of below= and above="):
        End("plant.wheel.v")
    with pytest.raises(BadInput, match=r"no signal 'plant\.wheel\.w'"):
        prepare(loop, scenario.but(end=End("plant.wheel.w", below=1.0)))


def test_what_is_refused_is_refused_when_it_is_prepared() -> None:
    loop, scenario, _ = loops()["plain"]
    with pytest.raises(BadInput, match=r"no signal 'plant\.wheel\.w' to log"):
        prepare(loop, scenario, log=["plant.wheel.w"])
    with pytest.raises(BadInput, match="whole number"):
        prepare(loop, scenario, every=0)
    with pytest.raises(BadInput, match=r"has no parameter 'ctl\.law\.k9'"):
        prepare(loop, scenario)({"ctl.law.k9": 1.0})


def test_many_runs_are_worth_the_best_code(tmp_path, monkeypatch) -> None:
    """A sweep is compiled for all of its ticks, its first look at the loop too."""
    asked = []
    monkeypatch.setattr(build, "compile_roller", lambda f, ticks=0: asked.append(ticks))
    loop, scenario, _ = loops()["plain"]
    sweep(loop, scenario, ["ctl.law.k1=5:6"], tmp_path, samples=4, jobs=1)
    assert set(asked) == {4 * TICKS}
    prepare(loop, scenario)()
    assert asked[-1] == TICKS


def test_a_numbered_block_is_apart_from_what_it_was_made_of() -> None:
    loop = loops()["plain"][0]
    new = loop._numbered({"ctl.law.k1": 7.0})
    assert float(new.params["ctl.law.k1"].value) == 7
    assert float(loop.params["ctl.law.k1"].value) == 20


@given(st.sampled_from(["plain", "subway_braking", "hst_braking", "hst_traction"]))
def test_a_run_in_pieces_is_the_whole_run(which: str) -> None:
    """Each piece has the first rows of the whole log, with its bits; the last one has them all."""
    run = loops()[which][2]
    whole, shares, rows = run(), [], 0
    for share, so_far in run.pieces():
        part = so_far()
        assert len(part["time"]) > rows
        rows = len(part["time"])
        shares.append(share)
        assert all(part[n].tobytes() == whole[n][:rows].tobytes() for n in whole)
    assert len(shares) > 1
    assert rows == len(whole["time"])
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
