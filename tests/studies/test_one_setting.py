"""One setting reaches all places: every loop against the same loop built without any share.

The settings are those of ``one_setting.py``, which takes all of them over whole runs.
"""

import re
from pathlib import Path

import numpy as np
import one_setting
import pytest
from one_setting import SETTINGS, STUDIES, cases, compare, loops

from slipctl import BadInput, Scenario, simulate, studies

pytestmark = pytest.mark.second


def chosen() -> list[tuple[str, int, str, str, float]]:
    """One setting of each loop, in turn; of a bound without wheels ``m`` for ``r`` and ``J``."""
    every = [one for study in STUDIES for one in loops(study)]
    turn = [(*one, *SETTINGS[2 * k % 9]) for k, one in enumerate(every)]
    wheels = {"r": "m", "J": "m"}
    return [(study, k, name, wheels.get(what, what) if name.startswith("ideal") else what, factor)
            for study, k, name, what, factor in turn]  # fmt: skip


@pytest.mark.parametrize(("study", "k", "name", "what", "factor"), chosen(), ids=lambda x: f"{x}")
@pytest.mark.others("long")
def test_one_setting_equals_every_place_by_hand(study, k, name, what, factor):
    (found,) = compare(study, k, name, [(what, factor)], whole=False)
    assert found.startswith(("equal", "refused"))


def test_a_place_that_is_left_out_is_found():
    """The comparison itself: a mass of the plant alone is another run."""
    study, k, name = next(one for one in loops("subway_braking") if one[2] == "sta")
    assert compare(study, k, name, [("m", 0.8)], whole=False) == ["equal"]
    names = one_setting.by_hand
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            one_setting, "by_hand",
            lambda *a: {n: v for n, v in names(*a).items() if not n.startswith("ctl.")},
        )  # fmt: skip
        (found,) = compare(study, k, name, [("m", 0.8)], whole=False)
    assert "differs by" in found


EMPTY = {
    "u_sw": "switching part of a law",
    "integral": "integral part of a law",
    "v_H": "integral of a sliding mode",
    "d_hat": "perturbation of a law",
    "d_h": "disturbance of an observer",
    "lam": "saturation compensation",
    "k_a": "adapted gain, begins at its smallest",
    "eta_h": "funnel, begins at its own parameter",
    "count": "counter",
    "rolled": "ticks counted, begins at as many as are asked for",
    "before": "whether something happened before",
    "carried": "force carried above a speed, none yet",
    "lam_f": "slip of the last tick",
    "chi_h": "slope, not known yet",
    "P": "covariance",
    **dict.fromkeys(("age", "waited"), "time since something happened"),
    "z2": "adhesion torque, not known yet",
    "T_L": "load torque, not known yet",
    "last": "surface, the first until the curves tell",
    "active": "whether caution rules",
    "elapsed": "time of a probe",
    "probing": "whether it probes",
    "x": "wanted slip, refused where the plant is too far from it; filter of a reference",
    "limited": "reference, known beforehand",
    "smooth": "reference, known beforehand",
    "best_h": "reference, known beforehand",
    "first": "reference, known beforehand",
    "b_h": "bias of a sensor",
    "rng": "random numbers",
    **dict.fromkeys(("theta", "scatter", "mean", "Lambda", "unsettled", "damping", "kept",
                     "shifts", "echoed"), "fit of a curve; its deviation is stated"),
    **dict.fromkeys(("v", "g", "mode", "side", "turn", "xi", "eta", "phase", "a", "th", "awake"),
                    "seeker, begins its search at 0"),
    **dict.fromkeys(("hi", "lo", "k"), "extremes between two rows of a log"),
    **dict.fromkeys(("inner", "X", "U", "S", "applied", "planned"), "where a solver starts"),
    **dict.fromkeys(("P_F_a", "P_vv", "P_vb", "P_bb"), "covariance"),
    "F_last": "estimated force, as the filter begins",
}  # fmt: skip
"""Memory that begins the same wherever the plant begins, by its name, and why."""

STARTED = {"v": 17.0, "v_t": 3.0, "omega": 31.0, "omega_m": 45.0, "phi": 5.0, "T_b": 900.0,
           "P_c": 7e4, "F_m": 4e3, "T_m": 2e3, "p": 6e4}  # fmt: skip
"""Start values of plants, by name: with slip, and with motors and brakes at work."""


@pytest.mark.parametrize("study", STUDIES)
@pytest.mark.others("long")
def test_what_remembers_begins_as_the_plant_does(study):
    """Every memory moves with the plant's start, or is one of those that begin empty."""
    for _, k, name in loops(study):
        loop = cases(study, True)[k].loops[name]
        values = {n: v for n in loop.states for b, _, last in [n.rpartition(".")]
                  if "plant" in b.split(".") and (v := STARTED.get(last))}  # fmt: skip
        plant = [n for n in loop.states if "plant" in n.split(".")]
        if not [n for n in loop.states if n not in plant]:
            continue  # a bound
        try:
            moved = loop.with_params(**values)
            before, after = loop.start(), moved.start()
        except BadInput as error:
            if "out of range" not in str(error):
                raise
            continue
        for n, v in values.items():
            assert np.all(after[n] == v), n
        for n in loop.states:
            last = n.rpartition(".")[2]
            if last == "torques" and not {"T_b", "P_c"} & {m.rpartition(".")[2] for m in values}:
                continue  # a brake without memory: its torque is what the controller asks for
            if n in plant or last in EMPTY or last == "tick" or "held_" in n:
                continue
            if last.startswith("former_") or last in ("agreed", "summed"):
                continue  # nothing is, before the first change
            same = np.array_equal(np.asarray(before[n]), np.asarray(after[n]))
            assert not same or n.endswith("tooth.age"), f"{name}: {n} stays {before[n]}"


def test_what_remembers_holds_what_the_plant_gives_at_the_first_tick():
    """Starts against outputs of the plant itself, which know nothing of shares."""
    seen = set()
    pairs = {
        "meter.torques": "brake.T_b", "dead.waiting": "brake.T_b", "observer.T_last": "net.T",
        "meter.slips": ("wheel.lam", "wheel.v_s"), "slope.lam_last": "wheel.lam",
        "tooth.omega_h": "wheel.omega", "observer.z1": "train.omega_d",
        "observer.omega_m": "train.omega_m", "fusion.v_h": "wheel.v",
        "offset.s_h": "slip_true",
    }  # fmt: skip
    for study in STUDIES:
        for _, k, name in loops(study):
            case = cases(study, True)[k]
            loop = case.loops[name]
            wanted = {n: pairs[e] for n in loop.states
                      for e in [".".join(n.split(".")[-2:])] if e in pairs}  # fmt: skip
            if set(wanted) <= seen:
                continue
            values = {n: v for n in loop.states for b, _, last in [n.rpartition(".")]
                      if "plant" in b.split(".") and (v := STARTED.get(last))}  # fmt: skip
            try:
                moved = loop.with_params(**values)
                start = moved.start()
            except BadInput:
                continue
            ends = [e for v in wanted.values() for e in ([v] if isinstance(v, str) else v)]
            names = {
                n: e
                for n in [*loop.outputs, *loop.states]
                for e in ends
                if ("." + n).endswith("." + e) and ("plant." in n or e in ("net.T", "slip_true"))
            }
            scenario = case.scenario.but(duration=loop.period, start={}, params={}, noise=0.0)
            log = simulate(moved, scenario, compile=False, log=list(names))
            for n, told in wanted.items():
                told = [told] if isinstance(told, str) else list(told)
                at = min(
                    (m for m, e in names.items() if e in told), key=lambda m: told.index(names[m])
                )
                value = np.asarray(log[at].values[0])
                # slips and torques are differences of large numbers
                assert start[n] == pytest.approx(
                    np.broadcast_to(value, np.shape(start[n])), rel=1e-9, abs=1e-9
                ), f"{study} {name} {n}"
                seen.add(n)
    assert {n.partition(".")[2] for n in seen} >= {"observer.z1", "observer.T_last", "fusion.v_h"}


def test_the_predictive_law_begins_with_the_force_that_the_train_has():
    loop = next(c.loops["mpc"] for c in cases("hst_traction", True) if "mpc" in c.loops)
    moved = loop.with_params(**{"motor.F_m": 4e3, "plant.brake.p": 6e4, "train.v": 20.0})
    log = simulate(
        moved, Scenario("s", loop.period, inputs=dict.fromkeys(("x_d", "v_d", "a_d"), 0.0)),
        compile=False, log=["plant.motor.T", "plant.brake.T_b"],
    )  # fmt: skip
    # 10 driven and 32 braked axles of 0.445 m
    force = 10 * float(log["plant.motor.T"].values[0, 0]) - 32 * log["plant.brake.T_b"].values[0]
    assert float(moved.start()["ctl.strategy.law.F_last"]) == pytest.approx(force / 0.445)


def test_where_a_plant_starts_is_told_in_its_model_alone():
    """Studies take the places of start values from the models: no study spells one of a plant."""
    folder = Path(studies.__path__[0])
    spelled = re.compile(
        r"\"(?:v|omega|omega_m|phi|T_b|P_c|v_s|lam)_start\b[^\"]*\":\s*\[?\"plant\."
    )
    for name in ("subway_braking", "freight_traction", "hst_braking", "all_rails"):
        for file in (folder / name).glob("*.py"):
            assert not spelled.search(file.read_text(encoding="utf-8")), file
