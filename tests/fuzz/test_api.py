"""The public doors refuse what means nothing, in one line that names the argument."""

import math
import pickle

import casadi as ca
import heavy_calls
import numpy as np
import pytest
from calls import METHODS, SCENARIO, VALID, answer, hump, tick, wrong_calls

import slipctl as sc
from slipctl import BadInput


@pytest.mark.parametrize("name", VALID)
def test_the_calls_that_the_wrong_ones_are_made_of_are_right(name):
    args, kwargs = VALID[name]
    assert getattr(sc, name)(*args, **kwargs) is not None


@pytest.mark.second
@pytest.mark.filterwarnings("ignore")
def test_wrong_kinds_of_arguments_are_refused_by_name():
    """No error from inside, no hang: an argument is refused, or there is nothing wrong with it."""
    ends = [(name, place, answer(name, call)) for name, place, call in wrong_calls()]
    assert [end for end in ends if end[2]] == []


def fed(feed):
    return sc.simulate(tick, SCENARIO.but(inputs={"u": feed}), compile=False)


@pytest.mark.parametrize(
    ("feed", "said"),
    [
        ([(0, 0.0), (math.nan, 500.0)], "in order of time"),
        ([(0, 0.0), (0.02, 1.0), (0.02, 2.0)], "in order of time"),
        ([(0.02, 1.0)], "starts at 0.02 s"),
        (1 + 2j, "no real number"),
        ("5", "no real number"),
        ([(0, "5")], "no real number"),
        (lambda t: t + 1j, "no real number"),
        (lambda t: t / 0 if t.size else 1 // 0, "NaN or infinite"),
        (lambda t: 1 // 0, "its feed function fails on 5 times: ZeroDivisionError"),
    ],
)
@pytest.mark.filterwarnings("ignore")
def test_a_feed_that_means_nothing_is_refused(feed, said):
    with pytest.raises(BadInput, match="feed") as error:
        fed(feed)
    assert said in str(error.value)


@pytest.mark.parametrize("end", ["lo", "hi"])
def test_nan_is_no_end_of_a_range(end):
    """A comparison with NaN is false, so that such a range would never refuse anything."""
    with pytest.raises(BadInput, match="NaN"):
        sc.Param("1", 1.0, **{end: math.nan})


@pytest.mark.parametrize(
    "declared",
    [
        lambda: sc.Param("1", 1.0, lo=2, hi=1),
        lambda: sc.Param("1", math.nan),
        lambda: sc.State("1", math.inf),
        lambda: sc.Param("1", 1.0, shape=(0,)),
        lambda: sc.law(y=sc.Output("1"))(lambda u=sc.Input("furlong^"): u),
        lambda: sc.Param("1", [1.0, 2.0], shape=(3,)),
    ],
)
def test_a_signal_that_means_nothing_is_refused(declared):
    with pytest.raises(BadInput):
        declared()


@pytest.mark.parametrize(
    "call",
    [
        lambda: sc.least_squares([[1.0], [math.nan], [2.0]], [1, 2, 3]),
        lambda: sc.peak_bound(hump, "v", math.nan, {"v": [1, 2, 3]}, 1e-3),
        lambda: sc.peak_bound(hump, "v", 1.0, {"v": [1, 2, 3]}, 1e-3, spread={"c": -1}),
        lambda: sc.seek_limits(sc.sliding_seek(0.01), steepest=math.nan, curvature=-1),
        lambda: sc.linear_fit(*VALID["linear_fit"][0], period=-1),
        lambda: sc.identify(*VALID["identify"][0], accuracy=-1),
        lambda: sc.c_module(tick, "nowhere", period=math.nan),
        lambda: sc.argmax_table(
            *VALID["argmax_table"][0], lo=0.1, hi=5, span=(1, 2), error=math.nan
        ),
        lambda: sc.connect("l", {"": "a.y"}, a=tick),
        lambda: sc.connect("l", {"a.u": "a b"}, a=tick),
        lambda: sc.simulate(tick, sc.Scenario("long", 1e12, inputs={"u": 1.0})),
        lambda: sc.interpolated((1.0, 2.0), [[1, 2], [3]], np.array([1.0, 2.0])),
        lambda: sc.interpolated(1.0, np.array(1.0), [1]),
        lambda: sc.Block("b", "law", lambda x, u, p: ({}, {}), np.ma.masked),
        lambda: hump.jacobian("mu", np.array(1.0)),
        lambda: sc.c_module(tick, 256 * "x", period=0.01),
    ],
)  # fmt: skip
def test_numbers_that_mean_nothing_are_refused(call):
    with pytest.raises(BadInput):
        call()


def test_a_period_of_another_float_type_is_a_period(tmp_path):
    """A report of one is JSON."""
    made = sc.c_module(hump, tmp_path / "c", period=np.float32(1.5))
    assert made is not None


def test_a_door_keeps_what_it_guards():
    """Signature, pickle and result are those of the function inside."""
    from slipctl.run import simulation

    assert sc.simulate.__wrapped__ is simulation.simulate
    assert pickle.loads(pickle.dumps(sc.simulate)) is sc.simulate
    assert fed(1.0).equals(simulation.simulate(tick, SCENARIO, compile=False))
    assert float(fed(np.float32(1))["y"][-1]) == float(fed(ca.DM(1))["y"][-1])


def test_every_public_name_is_called_wrongly():
    """The list of the random calls has all that ``slipctl`` gives."""
    assert set(sc.__all__) - {"__version__"} == set(heavy_calls.every_name()) - set(METHODS)


QUICK = [n for n in heavy_calls.every_name() if n not in heavy_calls.HEAVY]


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("names", [QUICK, pytest.param([*heavy_calls.HEAVY],
                                                       marks=pytest.mark.second)])  # fmt: skip
def test_random_wrong_calls_end_in_our_words(names, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    heavy_calls.prepared_folder()
    assert [*heavy_calls.found_foreign(names, 4, 3)] == []


@pytest.mark.parametrize("given", [float("nan"), {}, "x", None])
def test_a_range_that_is_no_signal_is_refused(given):
    with pytest.raises(BadInput, match="is no signal"):
        sc.ranged(tick, u=given)
