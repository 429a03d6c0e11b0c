"""Wrong samples in closed loop: the short table. All of it: ``bench.faults``."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from bench import faults
from bench.loops import wrong_samples as ws
from bench.loops.closed_loop import ClosedLoop, Wrong
from bench.loops.wrong_samples import KINDS, Fault
from bench.state_shifts import kept
from slipctl import BadInput, Input, Output, Param, State, c_module, ranged, simulate, step
from slipctl.ccode.check.vectors.run_inputs import record_part
from slipctl.ccode.compile import compilers
from slipctl.ccode.module import guard
from slipctl.run import store
from slipctl.study import resolve

pytestmark = pytest.mark.second

try:
    compilers.compilers()
except BadInput:
    pytest.skip("no C compiler on this machine", allow_module_level=True)

CANNOT_BE = ("NaN", "infinity", "10000", "65535", "times 2", "times 1e30", "flipped")


@pytest.fixture(scope="module")
def eppfc():
    """Loop and scenario of the estimator-based controller with its sensors."""
    loop, case = resolve.find_loop(resolve.load_study("hst_braking"), "eppfc@real")
    return loop, case.scenario


@pytest.mark.long
def test_a_wheel_speed_that_cannot_be_does_no_harm(eppfc, tmp_path):
    """One tick and ten: told in each of them, forgotten after 100 ms, the wheel does not lock."""
    found = ws.faults(
        eppfc[0], "ctl", eppfc[1], tmp_path, [1.5], "plant.wheel.omega", kinds=CANNOT_BE,
        lengths=(1, 10), signals=["omega"],
    )  # fmt: skip
    assert len(found) == 2 * len(CANNOT_BE)
    assert [f for f in found if not f.passed] == []
    assert all(f.told == f.cannot_be == f.ticks for f in found)


@pytest.mark.long
def test_other_inputs_that_are_missing_do_no_harm(eppfc, tmp_path):
    found = ws.faults(
        eppfc[0], "ctl", eppfc[1], tmp_path, [1.5], "plant.wheel.omega",
        kinds=("NaN", "times 1e30"), lengths=(1, 10), signals=["T_b", "a_m"],
    )  # fmt: skip
    assert [f for f in found if not f.passed] == []
    assert {f.signal for f in found} == {"T_b", "a_m"}


def closed(name, folder):
    """The loop of a controller, which is a compiled module with the parameters of its run."""
    _, loop, part, scenario = next(faults.controllers([name]))
    _, params = record_part(loop, part, scenario, 1)
    module = c_module(loop[part], folder, "ctl", period=loop.period).compile().load()
    return ClosedLoop(loop, part, scenario, module.reset(**params))


MISSING = ("NaN", "times 1e30")
SHORT = {
    "subway_braking:sta": ("v_s", "v"),
    "hst_braking:eppfc": ("omega", "T_b"),
    "hst_traction:hosm_limited": ("omega", "v"),
    "freight_traction:smes_robust": ("omega_m", "T_m"),
}
"""A controller of each system, and inputs that are measured."""


@pytest.mark.parametrize("name", [
    pytest.param(n, marks=pytest.mark.long) if n.startswith("hst") else n for n in SHORT
])  # fmt: skip
def test_missing_samples_do_no_harm_to_any_system(name, tmp_path):
    """One tick and ten, at one instant; all the others are in ``bench.faults``."""
    _, loop, part, scenario = next(faults.controllers([name]))
    where = faults.WHERE[name.partition(":")[0]]
    found = ws.faults(
        loop, part, scenario, tmp_path, where.at[:1], where.wheel, kinds=MISSING, lengths=(1, 10),
        signals=SHORT[name], settling=faults.settling(loop[part]),
    )  # fmt: skip
    assert len(found) == 2 * len(MISSING) * len(SHORT[name])
    assert [f for f in found if not f.passed] == []
    assert all(f.told == f.ticks for f in found)


@pytest.mark.long
@pytest.mark.parametrize("name", ["hst_braking:eppfc_free", "subway_braking:sta_online"])
def test_a_wrong_sample_of_the_adhesion_is_taken_back(name, tmp_path):
    """It tells a change of the rail; what was known before is in force again when it is over."""
    _, loop, part, scenario = next(faults.controllers([name]))
    where = faults.WHERE[name.partition(":")[0]]
    signal = "mu_m" if "mu_m" in loop[part].inputs else "T_b"
    found = ws.faults(
        loop, part, scenario, tmp_path, where.at[:1], where.wheel, kinds=("times 2",),
        lengths=(10,), signals=[signal], settling=faults.settling(loop[part]),
    )  # fmt: skip
    assert [f.passed for f in found] == [True]


@pytest.mark.long
def test_the_loop_in_c_is_that_of_python(tmp_path):
    """Bit for bit, with a part that sees at once what it gives (a brake without lag) and without.

    What the faults are judged by is a plant compiled from the same Function as ``simulate`` has.
    """
    for name in ("hst_braking:pid", "subway_braking:sta"):
        _, loop, part, scenario = next(faults.controllers([name]))
        scenario = scenario.but(duration=0.5)
        data = simulate(loop, scenario)
        _, params = record_part(loop, part, scenario, 1)
        module = c_module(loop[part], tmp_path / part, "ctl", period=loop.period)
        whole = ClosedLoop(loop, part, scenario, module.compile().load().reset(**params))
        course = whole.run(whole.ticks)
        assert whole.passes == (2 if name.startswith("hst") else 1)
        names = [m.name for m in whole.plan.layout.outputs for _ in range(m.size)]
        command = names.index("T_out" if "T_out" in names else "T_b")
        expected = data[f"{part}.{names[command]}"].values
        np.testing.assert_array_equal(course.outputs[:, command], expected)
        assert np.ptp(expected) > 1e3
        assert not course.status.any()


@pytest.mark.parametrize("name", ["hst_braking:eppfc@real", "hst_braking:pid"])
@pytest.mark.others("long")
def test_a_controller_is_never_refused_for_good(name, tmp_path):
    """100 ticks without the wheel speed, in the middle of a run: the wheel slides meanwhile.

    With a meter that took the jump for an acceleration, and resets in the order of the wires, the
    estimator was off its range and the module refused to the end of the run.
    """
    whole = closed(name, tmp_path)
    whole.run(3200)
    omega = list(whole.plan.block.inputs).index("omega")
    course = whole.run(1000, Wrong(omega, 100, 0.0, np.nan))
    refused = course.status & guard.REFUSED != 0
    assert refused[20:100].all()
    assert refused[100:].sum() <= 4 * guard.PATIENCE
    assert not refused[400:].any()


def test_a_flipped_slip_is_seen_and_does_no_harm(tmp_path):
    """A braked wheel does not run ahead of the rail: ten ticks of it locked the wheel."""
    _, loop, part, scenario = next(faults.controllers(["hst_braking:pid"]))
    found = ws.faults(
        loop, part, scenario, tmp_path, [1.5], faults.WHERE["hst_braking"].wheel, kinds=["flipped"],
        lengths=(10, 100), signals=["lam"], settling=faults.settling(loop[part]),
    )  # fmt: skip
    assert [(f.told, f.passed) for f in found] == [(10, True), (100, True)]


def test_what_cannot_be_true_is_told_by_the_last_true_sample_and_by_pairs():
    """Ends 0 and 9, a change of 1 a tick, noise of 0.5, and 2 before the fault."""
    read = np.array([5.0, 5.0, 5.0, 5.0, -1.0, np.nan, 5.0, 5.5, 7.5, 3.0])
    #      from 2 on:  3.5  4.5  5.5 ...  so 5 may be true from its third tick on; 7.5 is 2 further,
    #      and 3 is 4.5 further than the one before
    found = ws._cannot_be(read, 2.0, 0.0, 9.0, 1.0, 0.5)
    assert found.tolist() == [True, True, False, False, True, True, False, False, True, True]
    spike = ws._cannot_be(np.full(4, 6.5), 2.0, 0.0, 9.0, 1.0, 0.5)
    assert spike.tolist() == [True, True, True, False]


def test_the_true_value_is_a_jump_where_a_wrong_one_was_believed():
    """Stuck at 2 while it rose by 1 a tick to 7: at 2 a tick and noise of 0.5, 3 ticks are lost."""
    truth = np.arange(7.0, 20.0)
    stuck = np.full(5, 2.0), truth, np.full(5, True)
    assert ws._way(*stuck, 2.0, 2.0, 0.5) == 3
    # it may be 2.5 away at first, then 4.5, 6.5, 8.5; it is 5, 6, 7, 8
    never = np.full(5, 99.0), truth, np.full(5, False)
    assert ws._way(*never, 2.0, 2.0, 0.5) == 0
    assert ws._way(*stuck, 2.0, 0.0, 0.5) == 0


def test_what_is_told_is_read_instead(tmp_path):
    """Rows of inputs that the rest of the loop does not give; NaN where it does."""
    whole = closed("subway_braking:sta", tmp_path)
    whole.run(500)
    begin = whole.keep()
    plain = whole.run(20)
    k = list(whole.plan.block.inputs).index("v_opt")
    told = np.full((20, plain.truth.shape[1]), np.nan)
    told[:, k] = plain.truth[:, k]
    whole.go_back(begin)
    np.testing.assert_array_equal(whole.run(20, told=told).outputs, plain.outputs)
    told[5:, k] *= 1.1
    whole.go_back(begin)
    other = whole.run(20, told=told)
    np.testing.assert_array_equal(other.read[:, k], told[:, k])
    np.testing.assert_array_equal(other.outputs[:5], plain.outputs[:5])
    assert (other.outputs[5:] != plain.outputs[5:]).any()


def test_a_controller_that_watches_reads_true_samples(tmp_path):
    """What a fault is judged by: a module that read the truth while another one was in charge."""
    whole = closed("subway_braking:sta", tmp_path)
    whole.run(1500)
    begin = whole.keep()
    k = list(whole.plan.block.inputs).index("v_s")
    course = whole.run(200, Wrong(k, 100, 2.0, 0.0))
    assert (course.read[:100, k] == 2 * course.truth[:100, k]).all()
    np.testing.assert_array_equal(course.read[100:], course.truth[100:])
    whole.go_back(begin)
    plain = whole.run(200)
    state = whole.keep()[2]
    whole.go_back(begin)
    whole.watch(plain.truth)
    np.testing.assert_array_equal(whole.keep()[2], state)


def test_missing_wheel_speed_leaves_no_wrong_adhesion(tmp_path):
    """100 ticks of NaN: what the wheel lost meanwhile was an acceleration; it took 0.6 s."""
    _, loop, part, scenario = next(faults.controllers(["hst_braking:pid"]))
    found = ws.faults(
        loop, part, scenario, tmp_path, [1.5], faults.WHERE["hst_braking"].wheel, kinds=["NaN"],
        lengths=(100,), signals=["omega"], settling=faults.settling(loop[part]),
    )  # fmt: skip
    assert [(f.told, f.passed) for f in found] == [(100, True)]


def test_a_slope_that_wrong_samples_taught_is_forgotten(tmp_path):
    """A wheel speed held for ten ticks moves the force while the slip rests: a slope of -5e6 N.

    Its end tells a change of the rail. The slope outlived that, until the slip moved again.
    """
    _, loop, part, scenario = next(faults.controllers(["hst_braking:eppfc_gradient"]))
    found = ws.faults(
        loop, part, scenario, tmp_path, [1.5], faults.WHERE["hst_braking"].wheel,
        kinds=["NaN", "stuck", "times 2"], lengths=(10, 100), signals=["omega"],
        settling=faults.settling(loop[part]),
    )  # fmt: skip
    assert [f.forgotten for f in found] == [True] * 6
    assert [f.told for f in found if f.ticks == 10] == [10, 0, 10]


def test_a_law_that_restarts_for_ever_walks_in_a_cycle(tmp_path):
    """Points as printed give no force, so the funnel restarts every 90 to 190 ms without a fault.

    A fault shifts that cycle; its means are the same.
    """
    _, loop, part, scenario = next(faults.controllers(["hst_braking:points_printed"]))
    found = ws.faults(
        loop, part, scenario, tmp_path, [3.2], faults.WHERE["hst_braking"].wheel,
        kinds=["times 1.1"], lengths=(1, 10), signals=["lam"], settling=faults.settling(loop[part]),
    )  # fmt: skip
    assert [f.passed for f in found] == [True] * 2
    counts = np.cumsum(np.arange(1000) % 90 == 0).astype(float)
    rest = np.zeros(1000)
    assert ws._counting(np.column_stack([rest, counts]), 500) == 90
    assert ws._counting(np.column_stack([rest, counts]), 80) == 0
    assert ws._counting(np.column_stack([rest, -counts, np.sin(counts)]), 500) == 0


@pytest.mark.long
def test_the_printed_search_forgets_nothing():
    """(40) adds steps by the sign of a slope that hears nothing of it: all of a shift is left."""
    assert kept("hst_braking:search_printed")["search.best_h"] == pytest.approx(1, rel=1e-9)
    assert kept("hst_braking:eppfc_gradient")["search.best_h"] < 0.2


@pytest.mark.long
def test_a_target_that_no_train_follows_does_no_harm(tmp_path):
    """A wrong acceleration winds the law up at its limit; up to 5 m/s^2 it took 0.9 s to unwind."""
    _, loop, part, scenario = next(faults.controllers(["hst_traction:hosm_limited"]))
    found = ws.faults(
        loop, part, scenario, tmp_path, [12.0], faults.WHERE["hst_traction"].wheel,
        kinds=["lower end", "upper end"], lengths=(100,), signals=["a_d"],
        settling=faults.settling(loop[part]),
    )  # fmt: skip
    assert [f.passed for f in found] == [True] * 2


@pytest.mark.long
@pytest.mark.parametrize("name", ["all_rails:pid", "all_rails:sta", "all_rails:hosm"])
def test_a_best_slip_of_the_wrong_sign_is_seen(name, tmp_path):
    """No search looks there; the range was -20 to 20 m/s."""
    _, loop, part, scenario = next(faults.controllers([name]))
    found = ws.faults(
        loop, part, scenario, tmp_path, [1.5], faults.WHERE["all_rails"].wheel,
        kinds=["flipped", "times 100"], lengths=(1, 10), signals=["v_best"],
        settling=faults.settling(loop[part]),
    )  # fmt: skip
    assert [f.told for f in found] == [1, 1, 10, 10]
    assert all(f.forgotten for f in found)


@pytest.mark.long
@pytest.mark.parametrize("name", ["pid", "nmpc", "nmpc_told_dry"])
def test_missing_samples_do_no_harm_to_predictive_control(name, tmp_path):
    """What is left of its conditions of optimality is rounding, and judged by what it may be."""
    _, loop, part, scenario = next(faults.controllers([f"predictive:{name}"]))
    found = ws.faults(
        loop, part, scenario, tmp_path, [2.0], faults.WHERE["predictive"].wheel,
        kinds=MISSING, lengths=(1, 10),
    )  # fmt: skip
    assert len(found) == 4 * len(loop[part].inputs)
    assert all(f.forgotten for f in found)
    assert all(f.told == f.ticks for f in found)


@pytest.mark.parametrize(
    ("name", "real"),
    [("search_printed", "double"), ("eppfc_estimated", "double"), ("eppfc_printed", "float")],
)
@pytest.mark.others("long")
def test_constant_inputs_refuse_no_tick_for_ever(name, real, tmp_path):
    """No train does that; a search, a bias and a fit ran to the ends of their ranges and stayed.

    In float the printed law met the pole at the end of its funnel: 0.999999999 was 1 there.
    """
    _, loop, part, _ = next(faults.controllers([f"hst_braking:{name}"]))
    module = c_module(loop[part], tmp_path, "ctl", period=loop.period, real=real)
    module = module.compile().load().reset()
    module.replay({n: np.zeros(6000) for n in loop[part].inputs})
    assert not (np.array(module.status)[2000:] & guard.REFUSED).any()


def test_what_a_controller_remembers():
    """By hand, from the parameters of the study."""
    allowed = {}
    for name in ("subway_braking:smc", "subway_braking:sta", "hst_braking:pid",
                 "freight_traction:smes_robust", "freight_traction:improved_robust"):  # fmt: skip
        _, loop, part, _ = next(faults.controllers([name]))
        allowed[name.partition(":")[2]] = faults.settling(loop[part]), faults.cycle(loop[part])
    law, turning, fit, slides, locks = (allowed[n][0] for n in allowed)
    assert (law(0.1), turning(0.1)) == (pytest.approx(0.1), pytest.approx(0.2))
    assert fit(0.01) == pytest.approx(0.1 + 24 * 0.005 + 0.01)
    assert slides(0.1) == pytest.approx(0.1 + 2 * 0.1 / 1.0)
    assert locks(0.1) == pytest.approx(0.1 + 0.05 + 4 * 0.02 / 0.1 + np.log(50) / 1.2)
    assert [c for _, c in allowed.values()] == pytest.approx([0, 0, 0, 0.2, 0.4])
    _, loop, part, _ = next(faults.controllers(["hst_braking:eppfc_gradient"]))
    tau = 3000 / (0.5 * 23.129 * 0.1246 * 13.8e3 * 9.81 / 4)  # about the peak of dry rail
    walks = 0.02 + tau * np.log(0.01 / (0.01 * tau)) + 0.01 * np.log(50)
    assert faults.settling(loop[part])(0.01) == pytest.approx(0.1 + walks + 0.01)
    assert faults.rests(loop[part]) == {"search.best_h": pytest.approx(0.01 * tau)}
    _, loop, part, _ = next(faults.controllers(["hst_braking:search_printed"]))
    assert 0.1 < faults.settling(loop[part])(0.0) < 0.1 + walks  # without the reference's filter
    _, loop, part, _ = next(faults.controllers(["hst_traction:asmc_limited"]))
    assert faults.settling(loop[part])(0.01) == pytest.approx(0.1 + np.log(50) * 2 * 10 / 15)
    _, loop, part, _ = next(faults.controllers(["predictive:nmpc"]))
    assert faults.settling(loop[part])(0.01) == pytest.approx(0.1 + 20 * 0.02)


@pytest.mark.long
def test_true_samples_in_the_place_of_wrong_ones_are_back(tmp_path, monkeypatch):
    """What is measured is the fault: of a run that reads the truth every tick is as without it."""
    monkeypatch.setitem(KINDS, "true", (1.0, 0.0))
    for name in ("all_rails:nmpc", "all_rails:barrier", "all_rails:hosm", "all_rails:sta"):
        _, loop, part, scenario = next(faults.controllers([name]))
        found = ws.faults(
            loop, part, scenario, tmp_path, [1.5], faults.WHERE["all_rails"].wheel, kinds=["true"],
            lengths=(1, 100),
        )  # fmt: skip
        assert len(found) == 2 * len(loop[part].inputs)
        assert {(f.back, f.settled, f.own, f.alike) for f in found} == {(1.0, 0.0, 0.0, 0.0)}


@pytest.mark.long
def test_a_fit_in_the_rest_of_the_loop_is_no_harm(tmp_path):
    """One NaN: told, forgotten; the loop goes another way, as it does for 1e-9 of a slip.

    A best slip of 6 m/s is inside its range. The filter remembers 100 ticks of it for longer than
    it may, and no comparison calls that forgotten.
    """
    _, loop, part, scenario = next(faults.controllers(["all_rails:nmpc"]))
    found = ws.faults(
        loop, part, scenario, tmp_path, [1.5], faults.WHERE["all_rails"].wheel,
        kinds=["NaN", "upper end"], lengths=(1, 100), signals=["v_s", "v_best"],
        settling=faults.settling(loop[part]),
    )  # fmt: skip
    at = {(f.signal, f.kind, f.ticks): f for f in found}
    nan, high = at["v_s", "NaN", 1], at["v_best", "upper end", 100]
    assert nan.allowed == pytest.approx(0.1 + np.log(50) * 0.06, abs=1e-3)
    assert nan.told == 1
    assert nan.settled > nan.allowed
    assert nan.forgotten
    assert min(high.own, high.alike) > high.allowed
    assert high.alike < 0.5


def test_a_file_that_was_begun_goes_on(tmp_path, monkeypatch, capsys):
    """It had a format of its own, which nothing reads."""
    monkeypatch.setattr(faults, "ProcessPoolExecutor", ThreadPoolExecutor)
    monkeypatch.setattr(faults, "table", lambda name: [])
    out = tmp_path / "found.json"
    names = ["gain_bounds:sta", "gain_bounds:smc"]
    assert faults.main([names[0], "--out", str(out)]) == 0
    assert faults.main([*names, "--out", str(out), "--missing"]) == 0
    assert [line.partition(": ")[0] for line in capsys.readouterr().out.splitlines()] == names
    assert list(store.read_json(out)["controllers"]) == names


def test_harm_that_the_evidence_tells_is_no_failure(tmp_path, monkeypatch):
    """Each fault for itself: one more of the same controller is."""
    known, new = (
        Fault("v", kind, 1, 0.3, 1, 1, 0, 0.5, np.inf, np.inf, np.inf, 0.1, "T_b", False)
        for kind in ("NaN", "10000")
    )
    monkeypatch.setattr(faults, "ProcessPoolExecutor", ThreadPoolExecutor)
    monkeypatch.setattr(faults, "table", lambda name: [known])
    told, name = tmp_path / "told.json", "gain_bounds:sta"
    assert faults.main([name, "--out", str(told)]) == 1
    store.write_json(told, {"numbers": {"wrong_samples": store.read_json(told)}})
    assert faults.harm_of(store.read_json(told)) == {(name, "v", "NaN", 1, 0.3)}
    assert faults.main([name, "--told", str(told)]) == 0
    monkeypatch.setattr(faults, "table", lambda name: [known, new])
    assert faults.main([name, "--told", str(told)]) == 1


@pytest.mark.long
def test_an_integral_that_is_wound_up_is_harm(tmp_path):
    """Same samples, another command: the difference is small in a range of 2e9 N m."""
    _, loop, part, scenario = next(faults.controllers(["all_rails:sta"]))
    (found,) = ws.faults(
        loop, part, scenario, tmp_path, [1.5], faults.WHERE["all_rails"].wheel, kinds=["stuck"],
        lengths=[100], signals=["v_s"], settling=faults.settling(loop[part]),
    )  # fmt: skip
    assert found.alike > found.allowed
    assert not found.forgotten


def test_outputs_that_chatter_are_compared_by_means():
    """A square wave of two ticks and the same one tick later: as numbers they never agree."""
    k = np.arange(400)
    wave = np.where(k % 2 == 0, 20e3, 0.0)[:, None]
    assert np.abs(wave[1:] - wave[:-1]).min() == 20e3
    assert np.abs(ws._means(wave[1:], 50) - ws._means(wave[:-1], 50)).max() == 0
    ramp = np.arange(10.0)[:, None]
    np.testing.assert_allclose(ws._means(ramp, 4)[:, 0], np.arange(7) + 1.5)
    assert ws._settled(np.arange(200) >= 40) == pytest.approx(39, abs=1)  # 1 % of 160 is 1.6
    assert ws._settled(np.arange(200) >= 190) == np.inf


def test_what_a_value_cannot_be():
    """Without the rule of the guards: range, and the change since the last good value."""
    read = np.array([1.0, 5.0, 1.9, np.nan, 3.8, np.inf, -1.0])
    told = ws._cannot_be(read, 0.5, 0.0, 10.0, 1.0, 0.0)
    assert told.tolist() == [False, True, False, True, False, True, True]


def test_ranges_of_a_block_that_is_made():
    """``ranged`` changes ranges and nothing else; what it cannot declare is told."""

    @step(y=Output("N", "force"))
    def made(
        x=State("1", 0.0, "sum", lo=-5, hi=5), u=Input("1", "number"), k=Param("N", 2.0, "gain")
    ):
        """A block with a state."""
        return dict(x=x + u), dict(y=k * x)

    block = ranged(made, Output("N", lo="-k", hi=3).named("y"), u=Input("1", lo=-1, hi="k / 2"))
    assert block(x=1.0, u=0.5) == made(x=1.0, u=0.5)
    assert block.ends(block.inputs["u"], {"k": 2.0}) == ([-1], [1.0], [], [])
    assert block.ends(block.outputs["y"], {"k": 2.0}) == ([-2.0], [3], [], [])
    for wrong, said in (
        (dict(v=Input("1")), "made has no input 'v'"),
        (dict(u=Input("N")), "made.u is in 1, its range in N"),
        (dict(u=Input("1", hi="q")), "uses 'q'"),
    ):
        with pytest.raises(BadInput, match=said):
            ranged(made, **wrong)
    with pytest.raises(BadInput, match="is not an expression"):
        Input("1", hi="1 +")
    with pytest.raises(BadInput, match="largest change per tick is 0"):
        Input("1", change=0)


CURED = {
    "hst_traction:asmc_limited": ("v", ("lower end", "times 1.1", "times 2"), (25.0,)),
    "hst_traction:hosm_limited": ("x_d", ("times 1.1", "stuck"), (25.0,)),
    "hst_braking:efc": ("omega", ("stuck",), (3.2,)),
    "predictive:pid": ("s_ref", ("upper end", "times 2"), (0.6, 2.0)),
    "predictive:nmpc": ("v", ("lower end", "times 1.1", "times 2", "stuck"), (0.6, 2.0)),
}
"""Inputs that were wrong for 100 ticks: a range tells noise, rate and other inputs apart; refused
ticks count for slow parts; an integral stands while the command is at an end."""

SLOW = ("hst_traction:asmc_limited", "hst_traction:hosm_limited", "hst_braking:efc",
        "predictive:nmpc")  # fmt: skip


@pytest.mark.parametrize("name", [
    pytest.param(n, marks=pytest.mark.long) if n in SLOW else n for n in CURED
])  # fmt: skip
def test_a_hundred_wrong_ticks_do_no_harm(name, tmp_path):
    signal, kinds, at = CURED[name]
    _, loop, part, scenario = next(faults.controllers([name]))
    found = ws.faults(
        loop, part, scenario, tmp_path, at, faults.WHERE[name.partition(":")[0]].wheel, kinds=kinds,
        lengths=(100,), signals=[signal], settling=faults.settling(loop[part]),
    )  # fmt: skip
    assert len(found) == len(kinds) * len(at)
    assert all(f.forgotten for f in found)


@pytest.mark.long
def test_a_rim_that_stands_under_its_train_is_told(tmp_path):
    """By its own change it was believed after five ticks, and the plan went to the end."""
    _, loop, part, scenario = next(faults.controllers(["predictive:nmpc"]))
    found = ws.faults(
        loop, part, scenario, tmp_path, [0.6, 2.0], faults.WHERE["predictive"].wheel,
        kinds=["lower end"], lengths=(1, 10, 100), signals=["q"],
    )  # fmt: skip
    assert [f.told for f in found] == 2 * [1, 10, 100]
    assert all(f.forgotten for f in found)
