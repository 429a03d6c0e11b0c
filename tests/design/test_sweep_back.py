"""Pieces of a search: the sweep back along a run, proofs asked once, runs that are kept."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from slipctl import (
    BadInput,
    End,
    Ensemble,
    Output,
    Param,
    Rail,
    RunFailed,
    Scenario,
    Section,
    Signals,
    State,
    connect,
    law,
    step,
)
from slipctl.certify.promise import CERTIFIED, UNDECIDED
from slipctl.design import gain_files, gain_search, levels, promises, ranges, rolls, tune
from slipctl.design.goals import Proved
from slipctl.design.judgement import CLOSE, _close
from slipctl.design.promises import Promises
from slipctl.design.rolls import MANY, Rolls
from slipctl.design.slopes import gradients
from slipctl.design.slopes.backward import Backward
from slipctl.design.slopes.gradients import Slopes, operations
from slipctl.run.metrics import Metric
from slipctl.run.sweep.ensemble import Draw, World

# ---- back along a run ----------------------------------------------------------------------------

X, U, P = ca.SX.sym("x", 3), ca.SX.sym("u", 1), ca.SX.sym("p", 2)
NEXT = ca.vertcat(0.9 * X[0] + P[0] * X[1] * U[0], ca.sin(X[0]) + P[1] * X[2], X[1] + U[0] * P[0])
GIVEN = ca.vertcat(X[0] * X[2] * P[1], X[1] ** 2 + U[0])
TICK = ca.Function("tick", [X, U, P], [NEXT, GIVEN])
JACOBIANS = ca.Function("by", [X, U, P], [
    ca.jacobian(NEXT, X), ca.jacobian(NEXT, P), ca.jacobian(GIVEN, X), ca.jacobian(GIVEN, P),
])  # fmt: skip


def rolled(ticks: int) -> Any:
    """A run of the tick, with its states before each tick and its outputs."""
    rng = np.random.default_rng(4)
    u, p = rng.normal(size=(ticks, 1)), np.array([0.3, -0.6])
    x, y, now = [], [], rng.normal(size=3)
    for k in range(ticks):
        x.append(now)
        after, given = TICK(now, u[k], p)
        y.append(np.array(given).ravel())
        now = np.array(after).ravel()
    return SimpleNamespace(x=np.array(x), u=u, y=np.array(y)), p


@pytest.mark.parametrize("solves", [False, True])
@pytest.mark.parametrize(("first", "last"), [(0, 7), (2, 5), (6, 7), (0, 1)])
def test_a_sweep_back_is_the_chain_rule_tick_by_tick(solves: bool, first: int, last: int) -> None:
    """Whether the tick is written out or called; here by the Jacobians of each tick."""
    whole, p = rolled(7)
    rng = np.random.default_rng(5)
    at_x, at_y = rng.normal(size=(7, 3)), rng.normal(size=(7, 2))
    adjoint = rng.normal(size=3)
    back = Backward(TICK, solves, compile=False)
    by_x, by_p = back.over(whole, (first, last, p), adjoint, at_x, at_y)
    wanted_x, wanted_p = adjoint.copy(), np.zeros(2)
    for k in reversed(range(first, last)):
        n_x, n_p, y_x, y_p = (j.full() for j in JACOBIANS(whole.x[k], whole.u[k], p))
        wanted_p += n_p.T @ wanted_x + y_p.T @ at_y[k]
        wanted_x = n_x.T @ wanted_x + y_x.T @ at_y[k] + at_x[k]
    np.testing.assert_allclose(by_x, wanted_x, rtol=1e-12)
    np.testing.assert_allclose(by_p, wanted_p, rtol=1e-12)


@step(period=0.1, w=Output("m/s", "twice"))
def falls(
    v=State("m/s", 5.0, "speed"),
    x=State("m", 0.0, "way"),
    a=Param("m/s^2", 1.0, "deceleration", lo=0, hi=9),
):
    """A body that slows down."""
    return dict(v=v - 0.1 * a, x=x + 0.1 * v), dict(w=2 * v)


TICKS = 30
SCENARIO = Scenario("base", 0.1 * TICKS, Rail([Section(0.0)]))


def world(part: Any = falls, scenario: Scenario = SCENARIO, **signals: str) -> World:
    loop = connect("loop", {"w": "car.w"}, car=part)
    signals = signals or {"speed": "car.v", "position": "car.x"}
    return World(loop, scenario, Ensemble({"car.a": "1m/s^2:2m/s^2"}), signals=Signals(**signals),
                 known={}, free=("car.a",), compile=False)  # fmt: skip


def draw(own: World) -> Draw:
    return Draw({}, own.scenario, {}, {})


def distance(v: np.ndarray, way: float) -> float:
    """Way at the last tick, and from the last two speeds beyond it."""
    return float(way + 0.1 * (1.5 * v[-1] - 0.5 * v[-2]))


@pytest.mark.parametrize("signals", [
    {"speed": "car.v", "position": "car.x"}, {"speed": "car.v"},
])  # fmt: skip
def test_the_slope_of_a_distance_is_that_of_the_way_or_of_the_speeds(signals) -> None:
    """The speed is linear in the deceleration; without a position its mean between ticks counts."""
    own = world(**signals)
    by_a = -0.1 * np.arange(TICKS)
    way = 0.1 * (by_a[:-1].sum() if "position" in signals
                 else (by_a[:-1] + by_a[1:]).sum() / 2)  # fmt: skip
    found = Slopes(own, ["car.a"]).of({"car.a": 1.5}, draw(own), ["distance"])
    assert found["distance"].tolist() == [pytest.approx(distance(by_a, way), rel=1e-12)]
    up, down = (own.metrics({"car.a": a}, draw(own))["distance"].value for a in (2.0, 1.0))
    assert found["distance"][0] == pytest.approx(up - down, rel=1e-9)


def solving(part: Any) -> Any:
    """The same part, as if it solved a problem in each tick."""
    made = copy.copy(part)
    made.composition = replace(part.composition, solves="a problem")
    return made


def test_beside_a_part_that_solves_the_tick_is_called_and_no_part_may_jump() -> None:
    own, other = world(solving(falls)), world()
    slopes = Slopes(own, ["car.a"])
    assert slopes._back.solves
    assert not Slopes(other, ["car.a"])._back.solves
    one, same = (s.of({}, draw(own), ["distance"])["distance"]
                 for s in (slopes, Slopes(other, ["car.a"])))  # fmt: skip
    assert one[0] == pytest.approx(same[0], rel=1e-12)
    assert one[0] != 0

    @step(period=0.1, w=Output("m/s"))
    def jumps(v=State("m/s", 5.0), x=State("m", 0.0), a=Param("m/s^2", 1.0)):
        return dict(v=v - 0.1 * a, x=x + 0.1 * v), dict(w=ca.sign(v))

    slopes._refuse_jump_of("car", solving(jumps))  # what solves has its active set
    with pytest.raises(BadInput, match=r"a sign .*\(car\)"):
        slopes._refuse_jump_of("car", jumps)
    slopes._refuse_jump_of("car", falls)

    @law(w=Output("1"))
    def plain(c=Param("1", 1.0)):
        return ca.floor(c)

    both = connect("both", {"w": "car.w"}, car=solving(falls), other=plain)
    beside = World(both, SCENARIO, Ensemble({"car.a": "1m/s^2:2m/s^2"}), known={},
                   signals=Signals(speed="car.v"), free=("car.a",), compile=False)  # fmt: skip
    with pytest.raises(BadInput, match=r"a quantiser .*\(other\)"):
        Slopes(beside, ["car.a"])


def test_a_tick_that_is_too_long_and_what_has_no_slope_are_refused(monkeypatch) -> None:
    own = world()
    many = operations(own.measured.prepared.whole({}).f)
    monkeypatch.setattr(gradients, "LONGEST", many)
    slopes = Slopes(own, ["car.a"])
    with pytest.raises(BadInput, match="slip_max"):
        slopes.of({}, draw(own), ["distance", "slip_max"])
    monkeypatch.setattr(gradients, "LONGEST", many - 1)
    with pytest.raises(BadInput, match="longer"):
        Slopes(own, ["car.a"])
    ends = SCENARIO.but(end=End("car.v", below=1.0))
    with pytest.raises(BadInput, match="ends"):
        gradients.refuse_scenario(ends)
    place = SCENARIO.but(rail=Rail([Section(0.0)], by="position"))
    with pytest.raises(BadInput, match="place"):
        gradients.refuse_scenario(place)
    gradients.refuse_scenario(SCENARIO)
    gradients.refuse_scenario(SCENARIO.but(rail=None))


def test_operations_of_calls_are_those_of_what_is_called() -> None:
    """Of a map so often as it has columns, of a switch those of each case."""
    s = ca.SX.sym("s", 2)
    f = ca.Function("f", [s], [ca.sin(s[0]) * s[1]])
    g = ca.Function("g", [s], [s[0] + 1])
    a, b = f.n_instructions(), g.n_instructions()
    assert (operations(f), operations(g)) == (a, b)
    assert operations(f.map(5)) == 5 * a
    x, k = ca.MX.sym("x", 2), ca.MX.sym("k")
    once = ca.Function("once", [x], [f(x) + 1])
    assert operations(once) == once.n_instructions() - 1 + a
    twice = ca.Function("twice", [x], [f(x) * g(2 * x)])
    assert operations(twice) == twice.n_instructions() - 2 + a + b
    either = ca.Function.if_else("either", f, g)
    assert operations(either) == a + b
    chosen = ca.Function("chosen", [k, x], [either(k, x)])
    assert operations(chosen) == chosen.n_instructions() - 1 + a + b
    wide = ca.MX.sym("wide", 2, 5)
    mapped = ca.Function("mapped", [wide], [f.map(5)(wide)])
    assert operations(mapped) == mapped.n_instructions() - 1 + 5 * a


# ---- proofs that take long -----------------------------------------------------------------------


class Loop:
    """A loop whose numbers are told; it leaves its bound in runs that are above its gain."""

    def __init__(self, **values: float) -> None:
        self.values = values

    def values_by_place(self) -> Mapping[str, float]:
        return self.values


class Machine:
    """What is asked of a certificate: worst runs of a point, and what exceeds its bound there."""

    def __init__(self) -> None:
        self.put_to: list[Any] = []

    def worst_runs(self, numbers: Any) -> list[Any]:
        return [(numbers["k"], n) for n in range(10)]

    def exceeds(self, numbers: Any, runs: list[Any]) -> bool:
        self.put_to.append((numbers, list(runs)))
        return any(k > numbers["k"] for k, _ in runs)


@pytest.fixture
def proved(monkeypatch) -> Any:
    """Certificates ``late``, whose proof takes long, and ``soon``; proved from a gain of 2 on."""
    asked: list[Any] = []
    machine = Machine()
    system = SimpleNamespace(loop=machine)

    def decide(of: Any, numbers: Any) -> Any:
        asked.append(numbers)
        good = numbers["k"] >= 2 * numbers["times"]
        return SimpleNamespace(verdict=CERTIFIED if good else UNDECIDED, promise="it stays")

    monkeypatch.setattr(promises.catalogue, "PROVED_LAST", {"late"})
    monkeypatch.setattr(promises.catalogue, "system_of_gains", lambda gains, loop: system)
    monkeypatch.setattr(promises, "exact_numbers", lambda of, own: own)
    monkeypatch.setattr(promises, "with_margin",
                        lambda of, numbers, margin: numbers | {"times": margin})  # fmt: skip
    monkeypatch.setattr(promises.proofs, "decide", decide)
    return SimpleNamespace(asked=asked, machine=machine, system=system)


def gains(name: str) -> Any:
    def numbers(loop: Loop) -> Mapping[str, float]:
        if "k" not in loop.values:
            raise BadInput("no gain")
        return loop.values

    return SimpleNamespace(name=name, system=name, numbers=numbers)


LATE, SOON = gains("late"), gains("soon")


def test_a_long_proof_is_asked_once_of_the_same_numbers_and_told(proved) -> None:
    told: list[str] = []
    of = Promises((LATE, SOON), tell=told.append)
    for _ in range(2):
        assert of.decision(LATE, Loop(k=3.0)).verdict == CERTIFIED
        assert of.verdict(LATE, Loop(k=1.0)) == UNDECIDED
        assert of.verdict(LATE, Loop(k=3.0), 1.25) == CERTIFIED
        assert of.verdict(LATE, Loop(k=3.0, c=1.0)) == CERTIFIED
        assert of.verdict(SOON, Loop(k=3.0)) == CERTIFIED
        assert of.verdict(LATE, Loop()) == UNDECIDED
    assert [(a["k"], a["times"], "c" in a) for a in proved.asked] == [
        (3.0, 1.0, False), (1.0, 1.0, False), (3.0, 1.25, False), (3.0, 1.0, True),
        (3.0, 1.0, False), (3.0, 1.0, False),  # soon, each time
    ]  # fmt: skip
    assert [line.partition(" after")[0] for line in told] == [
        f"late: {CERTIFIED}", f"late: {UNDECIDED}", f"late with bounds times 1.25: {CERTIFIED}",
        f"late: {CERTIFIED}",
    ]  # fmt: skip
    assert all(line.endswith(" s") for line in told)
    assert of.promise(LATE, Loop(k=3.0)) == "it stays"


def test_a_candidate_meets_the_worst_runs_of_earlier_ones_before_any_long_proof(proved) -> None:
    """The last ones; a candidate whose numbers mean nothing leaves its bound."""
    of = Promises((SOON, LATE), (Proved("late wanted", "late", 1.5), Proved("soon wanted", "soon",
                  1.0)), kept=())  # fmt: skip
    assert of.has_last()
    assert of.fails(Loop(k=3.0)) == ""  # nothing is known of it yet
    assert of.fails(Loop(k=1.0)) == "soon wanted"
    assert proved.machine.put_to == [({"k": 3.0, "times": 1.5}, [])]
    assert of.fails_last(Loop(k=3.0)) == ""
    assert of.fails_last(Loop(k=2.0)) == "late wanted"
    assert of.fails_last(Loop(k=2.5)) == "late wanted"
    assert of.fails_last(Loop(k=3.0)) == ""
    assert of.fails(Loop(k=2.75)) == "late wanted"  # the runs of 3.0 are too much
    numbers, runs = proved.machine.put_to[-1]
    assert numbers == {"k": 2.75, "times": 1.5}
    every = [(k, n) for k in (3.0, 2.0, 2.5) for n in range(10)]
    assert runs == every[-promises.REMEMBERED :]
    assert of.fails(Loop(k=3.0)) == ""
    assert of._leaves(LATE, Loop(), 1.0)
    alone = Promises((SOON,), kept=("soon",))
    assert not alone.has_last()
    assert (alone.fails(Loop(k=1.0)), alone.fails_last(Loop(k=1.0))) == ("soon.certified", "")


def test_a_certificate_of_a_long_proof_is_of_what_was_found(proved, monkeypatch) -> None:
    monkeypatch.setattr(promises.proofs, "certificate_entries", lambda *given: ("entries", *given))
    monkeypatch.setattr(promises.proofs, "write", lambda *given: ("written", *given))
    of = Promises((LATE, SOON))
    loop = Loop(k=4.0)
    what, system, numbers, found = promises.certificate(LATE, loop, of, 1.5)
    assert (what, system, numbers) == ("entries", proved.system, {"k": 4.0, "times": 1.5})
    assert found is of.decision(LATE, loop, 1.5)
    assert promises.certificate(SOON, loop, of, 1.5) == (
        "written", proved.system, {"k": 4.0, "times": 1.5})  # fmt: skip
    assert len(proved.asked) == 1


# ---- runs that are kept --------------------------------------------------------------------------


class Kept:
    """A store with two runs of before."""

    def __init__(self) -> None:
        self.added: list[Any] = []

    def units(self) -> Mapping[str, Any]:
        return {"distance": ("m",), "slip_max": ("m/s",)}

    def runs(self) -> Any:
        number = MANY + 4  # the first candidate, the fourth draw
        yield number, {"k": 1.0}, {"distance": 9.0, "slip_max": [1.0, 2.0]}, ""
        yield number + 1, {"k": 1.0}, {}, "it broke"

    def add(self, ended: list[Any]) -> None:
        self.added += ended


class Rolled:
    """A world whose metric is the sum of all that it is given."""

    def __init__(self) -> None:
        self.drawn: list[Any] = []
        self.run: list[Any] = []

    def draw(self, stream: int, k: int) -> Any:
        self.drawn.append((stream, k))
        return stream, k

    def metrics(self, numbers: Any, draw: Any) -> Any:
        self.run.append((numbers["k"], draw))
        if numbers["k"] < 0:
            raise RunFailed("it became NaN")
        return {"distance": Metric(numbers["k"] + 10 * draw[1] + 100 * draw[0], "m")}


def test_runs_that_are_kept_are_not_made_again(monkeypatch) -> None:
    world_, store = Rolled(), Kept()
    told: list[Any] = []
    made = Rolls(world_, 1, store)  # type: ignore[arg-type]
    made.progress = lambda stage, share: told.append((stage, share))
    assert (made.count(0), made.count(1)) == (2, 0)
    made.begin("search", 4)
    first = made.all(0, [(0, {"k": 1.0}, 4), (0, {"k": 1.0}, 5), (0, {"k": 1.0}, 6),
                         (1, {"k": -1.0}, 4)])  # fmt: skip
    assert first[0] == {"distance": Metric(9.0, "m"), "slip_max": Metric([1.0, 2.0], "m/s")}
    assert first[1:] == [None, {"distance": Metric(61.0, "m")}, None]
    assert sorted(world_.run) == [(-1.0, (0, 4)), (1.0, (0, 6))]
    assert sorted((e.run, e.failed) for e in store.added) == [
        (MANY + 6, ""), (2 * MANY + 4, "it became NaN")]  # fmt: skip
    assert (made.done, made.count(0)) == (4, 4)
    assert told[0] == ("search", 0.0)
    assert told[1] == ("search", 0.5)
    assert told[-1] == ("search", 0.999)
    made.end()
    assert told[-1] == ("search", 1.0)
    assert made.all(0, [(0, {"k": 1.0}, 6)]) == [{"distance": Metric(61.0, "m")}]
    assert len(world_.run) == 2
    made.all(1, [(0, {"k": 1.0}, 6), (2, {"k": 2.0}, 6)])
    assert made.done == 5
    assert [made.count(k) for k in range(3)] == [4, 2, 0]
    assert store.added[-1].run == (MANY + 3) * MANY + 6


def test_draws_of_a_search_are_made_once_those_of_a_statement_each_time() -> None:
    made = Rolls(world_ := Rolled())  # type: ignore[arg-type]
    for stream in (0, 1, 2):
        for _ in range(2):
            assert made.draw(stream, 7) == (stream, 7)
    assert world_.drawn == [(0, 7), (1, 7), (2, 7), (2, 7)]
    assert made.count(0) == 0
    assert rolls.FILE.endswith(".sqlite")


def test_a_folder_of_a_search_is_begun_with_what_it_is_told(tmp_path, monkeypatch) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(tune.sweep_store, "begin", lambda *given: asked.append(given) or "open")
    told = {"loop": "pid"}
    assert tune._begun(str(tmp_path), told) == "open"
    assert asked == [(tmp_path, {"loop": "pid"}, rolls.FILE, "search")]
    assert asked[0][1] is not told
    with tune._begun(None, told) as nothing:
        assert nothing is None
    assert len(asked) == 1


def test_what_is_wanted_is_measured_alone_and_what_was_proved_stays_so(proved, monkeypatch) -> None:
    """A proof that takes long is told before it is made."""
    told: list[str] = []
    there = {"distance": Metric(1.0, "m"), "slip_max": Metric(2.0, "m/s"),
             "lock_time": Metric(0.0, "s")}  # fmt: skip
    asked: list[Any] = []
    monkeypatch.setattr(tune, "_metrics_of_first", lambda *given: asked.append(given) or there)
    own: Any = SimpleNamespace(loop=Loop(k=3.0), wanted=())
    weak = gains("weak")
    weak.numbers = lambda loop: {"k": 1.0}
    of = Promises((LATE, SOON, weak), tell=told.append)
    frees: Any = [SimpleNamespace(name="k", now=4.0)]
    goals, limits, found = tune._wanted(
        own, frees, "own", "distance", ["slip_max<=3m/s", "soon.certified"], of, 7)  # fmt: skip
    assert asked == [(own, {"k": 4.0}, 7)]
    assert [g.text for g in goals] == ["distance"]
    assert [limit.metric for limit in limits] == ["slip_max"]
    assert own.wanted == ("distance", "slip_max")
    assert found.kept == ("late", "soon")
    assert [p.name for p in found.wanted] == ["soon"]
    assert told[0].startswith("late: ")
    assert len(told) == 2  # and what came of it
    assert (found.gains, found.tell) == (of.gains, of.tell)


# ---- what is told and refused --------------------------------------------------------------------


def test_a_statement_is_written_into_the_certificate_with_its_settings(monkeypatch) -> None:
    found = SimpleNamespace(tuned_loop=lambda: "loop", promises=Promises(()), frees=[
        SimpleNamespace(name="k", unit="N")], gains={"k": 0.1}, name="x",
        statement={"within": 9, "of": 10})  # fmt: skip
    said = gain_files.certificate_of(found, "slipctl tune", ("m=2",), ["adh=b"])
    assert said["statistical"] == {"within": 9, "of": 10, "set": ["m=2"], "swapped": ["adh=b"]}
    assert said["gains"] == {"k": {"value": "0.1", "unit": "N"}}
    found.statement = None
    assert "statistical" not in gain_files.certificate_of(found, "slipctl tune")
    monkeypatch.setattr(gain_files.certificates, "check", lambda entry: f"holds: {entry['a']}")
    monkeypatch.setattr(gain_files.statement, "lines", lambda entry: [f"of {entry['of']}", "end"])
    entry = {"name": "n" * 50, "bounds_times": "1.0", "certificate": {"a": 1}}
    other = entry | {"name": "m", "certificate": {"a": 2}}
    payload = said | {"exact": [entry, other]}
    assert gain_files.check(payload).splitlines() == [
        f"{'n' * 40}: holds: 1", "m: holds: 2", "of 10", "end"]  # fmt: skip
    del payload["statistical"]
    assert gain_files.check(payload).splitlines() == [f"{'n' * 40}: holds: 1", "m: holds: 2"]
    with pytest.raises(BadInput, match=r"exact\[1\]"):
        gain_files.check(payload | {"exact": [entry, other | {"certificate": 3}]})


def test_a_name_of_several_numbers_is_refused(monkeypatch) -> None:
    loop = SimpleNamespace(params={"ctl.k": 1, "other.k": 2, "ctl.x": 3, "k2": 4})
    found = {"k": ["other.k", "more.k"], "x": ["ctl.x"], "none": []}
    monkeypatch.setattr(ranges, "targets", lambda loop, short: found[short])
    assert ranges._meant("k", loop, "ctl") == "ctl.k"  # type: ignore[arg-type]
    assert ranges._meant("x", loop, "own") == "ctl.x"  # type: ignore[arg-type]
    assert ranges._meant("none", loop, "own") == "none"  # type: ignore[arg-type]
    with pytest.raises(BadInput, match=r"k means 2 numbers.*other.k, more.k"):
        ranges._meant("k", loop, "own")  # type: ignore[arg-type]


def test_levels_need_a_metric_that_the_loop_has() -> None:
    ended = SimpleNamespace(failed="", metrics={"distance": 1, "slip_max": 2})
    measured = SimpleNamespace(ended=lambda number, given: ended)
    nothing = np.zeros(0)
    with pytest.raises(BadInput, match="distance, slip_max"):
        levels.levels(measured, "lock_time", ("a", "b"), nothing, nothing)  # type: ignore[arg-type]
    ended.failed = "it became NaN"
    with pytest.raises(BadInput, match="it became NaN"):
        levels.levels(measured, "distance", ("a", "b"), nothing, nothing)  # type: ignore[arg-type]


def test_a_metric_that_has_no_number_is_no_objective() -> None:
    there = {"distance": Metric(np.nan, "m"), "slip_max": Metric(1.0, "m/s")}
    with pytest.raises(BadInput, match="own: distance"):
        gain_search.goals_of_loop("distance", (), there, "own", ())
    goals, limits, proved_ = gain_search.goals_of_loop("slip_max", (), there, "own", ())
    assert [g.metrics for g in goals] == [("slip_max",)] or [*goals[0].metrics] == ["slip_max"]
    assert (limits, proved_) == ([], [])


def test_a_search_that_is_stopped_has_the_best_so_far() -> None:
    best: Any = SimpleNamespace(gains={"k": 1.0})
    stopped = tune.Stopped(best)
    assert stopped.best is best
    assert isinstance(stopped, KeyboardInterrupt)
    assert stopped.args == ()


def test_what_is_drawn_without_effect_is_told_and_what_is_free_is_not_drawn() -> None:
    told: list[str] = []
    own: Any = SimpleNamespace(
        notes=["a note", "another"], axes=[SimpleNamespace(name="m")],
        factors=[SimpleNamespace(numbers=("c", "d"))],
    )  # fmt: skip
    frees: Any = [SimpleNamespace(name="k")]
    tune._apart(frees, own, told.append)
    assert told == ["a note", "another"]
    for name in ("m", "c", "d"):
        with pytest.raises(BadInput, match=f"^{name} "):
            tune._apart([*frees, SimpleNamespace(name=name)], own, told.append)


def test_the_range_in_which_an_objective_is_kept_is_linear_between_its_points() -> None:
    """Up to where it is lost, up to the last point, or up to one that has no value."""
    at = 10.0
    more = CLOSE * at
    free: Any = None
    rows = [1.0, 2.0, 4.0, 5.0]
    low, high = _close(free, rows, [at + 2 * more, at, at, at + 4 * more], 3.0, at)
    assert (low, high) == (pytest.approx(1.5), pytest.approx(4.25))
    assert _close(free, rows, [at] * 4, 3.0, at) == (1.0, 5.0)
    nan = float("nan")
    assert _close(free, rows, [nan, at, nan, at], 3.0, at) == (2.0, 3.0)
    assert _close(free, rows, [at, nan, at, nan], 3.0, at) == (3.0, 4.0)


def test_bounds_of_a_margin_are_larger_and_the_lowest_smaller() -> None:
    def number(role: str, unit: str, lowest: bool = False) -> Any:
        return SimpleNamespace(role=role, unit=unit, lowest=lowest)

    of: Any = SimpleNamespace(numbers={
        "d": number(promises.INPUT, "N"), "T": number(promises.INPUT, "s"),
        "k": number("gain", "N"), "least": number(promises.INPUT, "N", True),
        "zero": number(promises.INPUT, "m"),
    })  # fmt: skip
    numbers = {n: Fraction(v) for n, v in (("d", 3), ("T", 2), ("k", 5), ("least", 6), ("zero", 0))}
    assert promises.with_margin(of, numbers, 1.5) == {
        "d": Fraction(9, 2), "T": 2, "k": 5, "least": 4, "zero": 0}  # fmt: skip
    times = {n: numbers[n] for n in ("T", "k")}
    assert promises.with_margin(of, times, 1.5) == {"T": 3, "k": 5}
