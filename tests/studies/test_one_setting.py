"""One setting reaches all places: every loop against the same loop built without any share.

The loops by hand are made by the studies too, but with sharing switched off; each place is then
set by a table of names that knows nothing of shares. ``ONE_SETTING=all`` takes every setting of
every loop, over whole runs.
"""

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from slipctl import BadInput, Block, Case, RunFailed, Scenario, simulate
from slipctl.block import connection
from slipctl.study import doors

ALL = os.environ.get("ONE_SETTING") == "all"
STUDIES = ("subway_braking", "hst_braking", "freight_traction", "hst_traction", "all_rails")
SPEED = {"freight": "train.v_t", "hst_traction": "train.v"}
SETTINGS = [("speed", 0.3), ("speed", 0.7), ("speed", 1.3)] + [
    (what, f) for what in ("m", "r", "J") for f in (0.8, 1.2)
]
SCALING_MASS = ("law.scale.m", "law.torque.m", "law.law.m")
"""Mass of a law that drives another vehicle: a scale of its own, no vehicle has it."""


@contextmanager
def without_shares() -> Iterator[None]:
    """Connections that ignore ``share``, also when a block is built again with other values."""
    kept = connection.bind
    connection.bind = lambda *_: {}
    try:
        yield
    finally:
        connection.bind = kept


def forget() -> None:
    """Drop the parts that loops have in common: those with shares and those without differ."""
    for name in ("hst_braking", "subway_braking", "freight_traction", "hst_traction"):
        made = __import__(f"slipctl.studies.{name}.loops", fromlist=["x"])
        for f in vars(made).values():
            getattr(f, "cache_clear", lambda: None)()


@cache
def cases(study: str, shared: bool) -> list[Case]:
    with nullcontext() if shared else without_shares():
        if not shared:
            forget()
        if study == "all_rails" and not shared:  # its scenarios speak of shared numbers
            made = __import__("slipctl.studies.all_rails.loops", fromlist=["x"])
            return [replace(c, loops=made.loops(c.scenario.name.partition("_")[0]))
                    for c in cases(study, True)]  # fmt: skip
        found = doors.build_cases(doors.load_study(study), quick=True)
        # a scenario with a difference on purpose, or a lag set by its shared name
        return [c for c in found if not c.scenario.name.startswith(("demand", "lag50"))]


def loops(study: str) -> list[tuple[str, int, str]]:
    """Every loop once: those of the scenarios without sensors, then those with."""
    found: dict[tuple[str, str], tuple[str, int, str]] = {}
    for k, case in enumerate(cases(study, True)):
        sensors = case.scenario.name in ("real", "estimated", "noise")
        world = case.scenario.name.partition("_")[0] if study == "all_rails" else ""
        for n in case.loops:
            found.setdefault((n, f"{sensors}{world}{case.scenario.name == 'position'}"),
                             (study, k, n))  # fmt: skip
    return list(found.values())


def chosen() -> list[tuple[str, int, str, str, float]]:
    """All settings of all loops, or one of each in turn and all of one per study."""
    rows = []
    at = 0
    for study in STUDIES:
        for one in loops(study):
            rows += [(*one, *SETTINGS[k % 9]) for k in (range(9) if ALL else [at])]
            at += 2
    return rows


def by_hand(block: Block, study: str, scenario: str, what: str, value: float) -> Block:
    """Block without shares in which each place is set, ``value`` times what it was."""
    freight = study == "freight_traction" or scenario.startswith("freight")
    numbers = block.values_by_place()
    new: dict[str, float | np.ndarray] = {}
    names = {"m": {"m", "m_axle", "Q"} - ({"m_axle"} if freight else set())}.get(what, {what})
    for n, v in numbers.items():
        if n.rpartition(".")[2] in names and block.params[n].unit in ("kg", "kg m^2", "m", "N"):
            if n in SCALING_MASS and ("law.scale.m" in numbers or freight):
                continue
            new[n] = v * value
    start = {k: float(np.ravel(v)[0]) for k, v in block.start().items() if np.size(v)}
    speed = next(k for k in start if k.endswith((".wheel.v", ".train.v", ".train.v_t")))
    v = start[speed] or (30.0 if study == "hst_traction" else 0.0)
    v *= value if what == "speed" else 1.0
    new[speed] = v
    plant = speed.rpartition(".")[0]
    if f"{plant}.r" not in numbers:
        return block.with_params(**new)
    omega = v / float(np.ravel(new.get(f"{plant}.r", numbers[f"{plant}.r"]))[0])
    for n in [*block.params, *block.states]:
        last = n.rpartition(".")[2]
        if last == "omega_start":
            new[n] = omega
        elif last == "v_h":
            new[n] = v
        elif n.endswith("observer.omega_m"):
            new[n] = v * float(numbers[f"{plant}.R_g"]) / (v / omega)
    return block.with_params(**new)


@pytest.mark.parametrize(("study", "k", "name", "what", "factor"), chosen(), ids=lambda x: f"{x}")
def test_one_setting_equals_every_place_by_hand(study, k, name, what, factor):
    case, bare = cases(study, True)[k], cases(study, False)[k]
    loop, scenario = case.loops[name], case.scenario
    with without_shares():  # a loop is made when it is asked for
        forget()
        hand = bare.loops[name]
        forget()
    freight = study == "freight_traction" or scenario.name.startswith("freight")
    place = SPEED.get("freight" if freight else study, "wheel.v")
    full = next(n for n in loop.states if n.endswith("." + place))
    now = {"m": "m", "J": "J", "r": "r"}
    if what == "speed":
        base = float(np.ravel(loop.start()[full])[0]) or 30.0
        told = {place: base * factor}
    elif now[what] not in loop.params:
        pytest.skip(f"{name} has no {what}")  # a bound without wheels
    else:
        told = {what: loop.param_values()[what] * factor}
        if study == "hst_traction":
            told[place] = 30.0
    known = {s.name for s in loop.signals if s.role != "param"}
    log = [n for n in case.log if n in known] if case.log else None
    solver = sorted(n for n in known if n.endswith((".nmpc.status", ".nmpc.passes")))
    if log is not None and ALL:
        log += [n for n in solver if n not in log]
    length = scenario.duration if ALL else 0.2
    run = Scenario("s", length, scenario.rail, scenario.inputs, seed=scenario.seed)
    outcomes = []
    for shared in (True, False):
        try:
            with nullcontext() if shared else without_shares():
                made = (loop.with_params(**told) if shared
                        else by_hand(hand, study, scenario.name, what, factor))  # fmt: skip
                outcomes.append(simulate(made, run, compile=ALL, log=log))
        except (BadInput, RunFailed) as error:
            outcomes.append(str(error))
    one, two = outcomes
    if isinstance(one, str) or isinstance(two, str):
        for said in (one, two):  # refused, or a printed law that breaks: in both
            assert re.search("out of range|too long|became", str(said)), said
        return
    assert set(one.data_vars) == set(two.data_vars)
    for n in one.data_vars:
        a, b = one[n].values, two[n].values
        # equal numbers meet in another order of operations: roundings, far below a wrong number. In
        # whole runs of nmpc they are 1.7e-10 in the estimated curve, and the law, whose command
        # follows its peak, makes 7.5 times that of them, 1.3e-9; its solver does the same each tick
        limit = 1e-8 if ALL and name == "nmpc" else 1e-9
        if n in solver:
            assert np.array_equal(a, b), n
        assert np.abs(a - b).max() <= limit * max(1.0, np.abs(b).max()), n


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
                     "shifts"), "fit of a curve; its deviation is stated"),
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
