"""A run that is to be doubted says so, and one that is not is silent."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from casadi import fmin, if_else, vertcat

from slipctl import (
    Input,
    Noise,
    Output,
    Param,
    Rail,
    Scenario,
    Section,
    State,
    connect,
    flow,
    law,
    rls,
    sampled,
    simulate,
    step,
)
from slipctl.commands.cli import main
from slipctl.models import vehicle
from slipctl.models.brakes import brake
from slipctl.run.metrics import Metric
from slipctl.run.preparation import prepare
from slipctl.run.roles import Signals
from slipctl.run.warnings.doubts import doubt_signals, warnings_of_log, warnings_of_loop
from slipctl.study.report.texts import absent

H = 1e-2


@flow()
def cart(v=State("m/s", 4.0, "speed"), T_b=Input("N m", "torque", positive="braking")):
    """A cart that its brake slows."""
    return dict(v=-T_b * 1e-5), {}


@step(T_cmd=Output("N m", "command", positive="braking", lo=0, hi="T_max"), period=H)
def driver(
    T_wanted=Param("N m", 50.0, "wanted"),
    T_max=Param("N m", 100.0, "largest", lo=1),
    n=State("1", 0.0, "nothing"),
):
    """Asks for the same all the time."""
    return dict(n=n), dict(T_cmd=fmin(T_wanted, T_max))


@step(period=H)
def stuck(
    held=State("m/s", 5.0, "estimate of the speed", deviation="sqrt(P)", truth="v"),
    P=State("(m/s)^2", 0.01, "its variance"),
    v=Input("m/s", "measured speed"),
):
    """An estimator that believes itself and not what it measures."""
    return dict(held=held + 0 * v, P=P), {}


def told(loop, seconds, rail=None):
    scenario = Scenario("s", seconds, rail)
    log = prepare(loop, scenario, compile=False)(doubt=True)
    return [] if log.watched is None else warnings_of_log(loop, scenario, log.watched)


def loop_of(**given):
    wires = {"plant.T_b": "ctl.T_cmd"}
    if "est" in given:
        wires["est.v"] = "plant.v"
    ctl = given.pop("ctl", driver)
    return connect("loop", wires, plant=sampled(cart, H, "rk4"), ctl=ctl, **given)


@pytest.mark.parametrize(
    ("seconds", "P", "lines"),
    [(2.0, 0.01, 1), (0.9, 0.01, 0), (2.0, 0.25, 0)],  # 1 m/s off; 3 deviations are 0.3 or 1.5
)
def test_an_estimate_that_stays_off_is_told_with_time_and_size(seconds, P, lines):
    found = told(loop_of(est=stuck.with_params(P=P)), seconds)
    assert len(found) == lines
    if lines:
        assert found[0].startswith(
            "est.held errs by more than 3 of its own standard deviations from 0 s"
        )
        assert "at the end 5 m/s for a true 3.99" in found[0]
        assert found[0].endswith("with a deviation of 0.1 m/s")


@law(mu=Output("1", "adhesion"), conditions={"dry": {"c": 0.4}, "ice": {"c": 0.1}})
def linear(s=Input("1", "slip", value=0.5), c=Param("1", 0.2, "height", lo=1e-3)):
    """Adhesion."""
    return c * s


@pytest.mark.parametrize(("gain", "lines"), [(1.0, 0), (1.5, 1)])
def test_a_fit_is_held_against_what_the_rail_sets(gain, lines):
    """What is measured is wrong by the gain, so the fit is off by its logarithm; 0.405."""

    @law(m=Output("1", "measured"))
    def sensor(mu=Input("1", "adhesion"), n=Noise(), k=Param("1", gain, "gain")):
        """A sensor that is sure of itself."""
        return k * mu + 1e-3 * n

    fit = rls(linear, form="window", period=H, window=16, iterations=3, start={"c": 0.3})
    made = connect(
        "loop", {"look.mu": "adh.mu", "fit.mu": "look.m"}, adh=linear, look=sensor,
        fit=fit.with_params(noise=1e-3, settling=1.0), ctl=driver,
    )  # fmt: skip
    found = told(made, 4.0, Rail([Section(0, "dry"), Section(2.0, "ice")]))
    assert len(found) == lines, found
    assert all("fit.theta for log(c) errs" in line for line in found)


@pytest.mark.parametrize(("wanted", "lines"), [(50.0, 0), (200.0, 1), (0.0, 0)])
def test_a_command_at_its_limit_for_most_of_a_run_is_told(wanted, lines):
    found = told(loop_of(ctl=driver.with_params(T_wanted=wanted)), 1.0)
    assert found == ["ctl.T_cmd is at its limit, 100 N m, for 100 % of the run"][:lines]


@pytest.mark.parametrize(("rate", "lines"), [(1e5, 0), (60.0, 1)])
def test_a_rate_at_its_limit_for_most_of_a_run_is_told(rate, lines):
    """50 N m at 60 N m/s take 0.83 s of 1 s."""
    act = sampled(brake(lag=True, rate=True), H, "rk4").with_params(R_max=rate)
    plant = connect("plant", {"act.T_cmd": "T_cmd", "cart.T_b": "act.T_b"}, act=act,
                    cart=sampled(cart, H, "rk4"))  # fmt: skip
    found = told(connect("loop", {"plant.T_cmd": "ctl.T_cmd"}, plant=plant, ctl=driver), 1.0)
    assert len(found) == lines
    assert all("plant.act.R is at its limit, 60 N m/s" in line for line in found)


def test_noise_below_quantisation_is_told():
    from slipctl.models.sensors import noisy_sensor

    def lines(sigma, q):
        sensor = noisy_sensor("m/s").with_params(sigma=sigma, q=q)
        loop = connect("loop", {"y.u": "plant.v"}, plant=sampled(cart, H, "rk4"), y=sensor)
        return warnings_of_loop(loop, Scenario("s", 1.0, inputs={"plant.T_b": 0.0}))

    assert len(lines(0.01, 0.1)) == 1
    assert "y.sigma = 0.01 m/s is below the 0.0289 m/s of the quantisation" in lines(0.01, 0.1)[0]
    assert not lines(0.05, 0.1)  # 0.1/sqrt(12) = 0.029
    assert not lines(0.0, 0.1)
    assert not lines(0.01, 0.0)


def test_an_input_that_no_wire_feeds_is_told_where_there_is_a_signal_of_its_name():
    @step(y=Output("m/s", "what it sees"), period=H)
    def look(n=State("1", 0.0), v=Input("m/s", "speed", value=0.0)):
        """Takes a speed, or none."""
        return dict(n=n), dict(y=v)

    def lines(wires, **inputs):
        plant = sampled(cart, H, "rk4")
        loop = connect("loop", {"plant.T_b": "ctl.T_cmd"} | wires, plant=plant, ctl=driver,
                       look=look)  # fmt: skip
        return warnings_of_loop(loop, Scenario("s", 1.0, inputs=inputs))

    assert lines({}) == ["no wire feeds look.v, so it keeps 0.0 m/s; wire it to plant.v?"]
    assert not lines({"look.v": "plant.v"})
    assert not lines({}, **{"look.v": 3.0})


def test_what_is_watched_changes_no_number_and_is_no_part_of_the_log():
    loop = loop_of(est=stuck)
    run = prepare(loop, Scenario("s", 1.5), compile=False)
    one, other = run(), run(doubt=True)
    assert doubt_signals(loop) == {"est.held", "est.P", "plant.v", "ctl.T_cmd"}
    assert list(one) == list(other)
    assert all(np.array_equal(one[n], other[n]) for n in one)
    assert one.told() == other.told()[: len(one.told())]
    assert "errs by more than" in simulate(loop, Scenario("s", 1.5)).attrs["told"]


def test_a_metric_that_a_loop_has_not_is_told_with_the_reason():
    metric = {"tracking_time": Metric(1.0, "s"), "stopping_distance": Metric(3.0, "m")}
    log = {"slip": 0, "v": 0}
    results = SimpleNamespace(
        metrics={"base": {"one": metric, "other": {}}},
        data={"base": {"one": log | {"ref": 0}, "other": log}},
        study=SimpleNamespace(signals=Signals(slip="slip", reference="ref", speed="v"), limits={}),
    )
    assert absent(results, "base") == [
        "tracking_time of other: not shown, there is no reference",
    ]
    results.metrics["base"]["other"] = metric
    assert absent(results, "base") == []


@pytest.mark.second
def test_warnings_stand_at_the_top_of_output_and_report(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    text = (Path(vehicle.__file__).parent / "files" / "metro.toml").read_text(encoding="utf-8")
    short = text[: text.index("[controllers.pid]")]
    Path("good.toml").write_text(short, encoding="utf-8")
    Path("weak.toml").write_text(short.replace('torque = "8 kN m"', 'torque = "1 kN m"'),
                                 encoding="utf-8")  # fmt: skip
    line = "ctl.T_cmd of axle 1 is at its limit, 1000 N m, for 100 % of the run"
    for name in ("weak", "good"):
        assert main(["-q", "run", f"{name}.toml", "--quick", "--no-compile", "--jobs", "1"]) == 0
        said = capsys.readouterr().out
        page = Path("out", name, "report.html").read_text(encoding="utf-8")
        assert (line in " ".join(said.split())) == (line in page) == (name == "weak")
        if name == "weak":
            assert said.index("warning: ") < said.index("scenario base")
            assert page.index(line) < page.index("<nav>")
    assert main(["-q", "run", "weak.toml", "--quick", "--no-compile", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["warnings"]
    assert {"text": line, "runs": "base: none"} in found
    assert [f for f in found if "sections of the rail" not in f["text"]] == found[1:]


@step(y=Output("N m", "command of two axles", positive="braking", lo="-T_max", hi="T_max",
               shape=(2,)), period=H)  # fmt: skip
def two_axles(
    T_max=Param("N m", 100.0, "largest", lo=1),
    share=Param("1", 0.6, "of a second at the limit"),
    sign=Param("1", 1.0, "of the limit"),
    t=State("s", 0.0, "time"),
):
    """The second axle is at its limit for a share of a second, the first one never."""
    second = if_else(t < share - H / 2, sign * T_max, 0.0)
    return dict(t=t + H), dict(y=vertcat(0.5 * T_max, second))


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("share", "lines"), [(0.4, 0), (0.5, 0), (0.52, 1), (0.6, 1), (1.0, 1)])
def test_a_limit_either_way_is_told_by_axle_and_share(share, lines, sign):
    """Above half of the run, of the axle that is there longest, whichever end it is."""
    handed = connect("ctl", {"T_cmd": "two.y"}, two=two_axles.with_params(share=share, sign=sign))

    @step(total=Output("N m", "sum"), period=H)
    def brakes(T=Input("N m", "torque", positive="braking", shape=(2,))):
        """Takes the commands of both."""
        return {}, dict(total=T[0] + T[1])

    found = told(connect("loop", {"plant.T": "ctl.T_cmd"}, plant=brakes, ctl=handed), 1.0)
    axle = f"of axle 2 is at its limit, 100 N m, for {100 * share:.0f} % of the run"
    assert [line.partition(" ")[2] for line in found][:1] == [axle][:lines]


def test_every_limit_that_is_logged_is_told_whatever_is_not():
    """Two drivers at their limits; of the first one nothing is logged, of either one each."""
    from slipctl.run.warnings import doubts

    ctl = driver.with_params(T_wanted=200.0)
    loop = connect("loop", {"one.T_b": "a.T_cmd", "two.T_b": "b.T_cmd"}, a=ctl, b=ctl,
                   one=sampled(cart, H, "rk4"), two=sampled(cart, H, "rk4"))  # fmt: skip
    full, time = np.full(10, 100.0), np.arange(10) * H
    for given in (("a",), ("b",), ("a", "b")):
        log = {"time": time} | {f"{n}.T_cmd": full for n in given}
        assert [line.split()[0] for line in doubts._limited(loop, log)] == [
            f"{n}.T_cmd" for n in given
        ]


@pytest.mark.parametrize(
    ("unit", "said"),
    [
        ("1", "0 .. 2, at 0.03 s, and comes to 5"),
        ("m/s", "0 .. 2 m/s, at 0.03 s, and comes to 5 m/s"),
    ],
)
def test_a_state_off_its_range_is_told_with_place_size_and_unit(unit, said):
    from slipctl.run.warnings import doubts

    @step(period=H)
    def counter(n=State(unit, 1.0, "count", lo=0.0, hi=2.0)):
        """Counts."""
        return dict(n=n), {}

    log = {"time": np.arange(6) * H, "n": np.array([1.0, 2.0, 2.0, 3.0, 5.0, 1.0])}
    (line,) = doubts._off_range(counter, log)
    assert line.startswith(f"n leaves its range, {said}")
    assert not list(doubts._off_range(counter, {**log, "n": np.clip(log["n"], 0, 2)}))
