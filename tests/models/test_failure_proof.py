"""What the safe output promises for any numbers at all, by its equations and by intervals."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from slipctl import connect
from slipctl.certify.arithmetic.enclosure import enclose
from slipctl.models import vehicle
from slipctl.models.vehicle.air.slide_protection import watchdog
from slipctl.models.vehicle.failure import MOVES, TRIED, _axles, _supply, trust
from slipctl.models.vehicle.measurement.axle_samples import HOLD, AxleSample
from slipctl.models.vehicle.safe_output import safe_command
from slipctl.study.request import Request


def symbols(block):
    """Symbols of the states, inputs and parameters of a block, by name."""
    return [{n: ca.SX.sym(n) for n in part} for part in (block.states, block.inputs, block.params)]


@pytest.mark.parametrize("slow", [0, 1])
@pytest.mark.parametrize("driven", [False, True])
def test_an_axle_that_is_not_ready_gets_its_demand_rate_limited_whatever_else_is(driven, slow):
    """One and the same expression in all other numbers, so for any bits of them."""
    block = safe_command("demand", driven)
    x, u, p = symbols(block)
    _, y = block.expr(x | {"slow": ca.SX(slow)}, u | {"ready": ca.SX(0), "on": ca.SX(0)}, p)
    top = ca.fmin(ca.fmax(u["T_demand"], 0), p["T_max"])
    wanted = ca.fmin(top, x["T_h"] + p["rate"] * p["T_max"] * p["T"])
    assert ca.is_equal(y["T_cmd"], wanted, 50)
    assert not {"T_slip", "test", "stands", "v", "sound"} & set(map(str, ca.symvar(y["T_cmd"])))


@pytest.mark.parametrize("block", [safe_command("demand"), watchdog], ids=["command", "valves"])
def test_no_release_is_counted_beyond_its_limit_and_at_the_limit_the_demand_is_given(block):
    """Intervals, over all inputs and all states in their ranges."""
    x, u, p = symbols(block)
    nxt, _ = block.expr(x, u, p)
    values = {n: float(s.value) for n, s in block.params.items()}
    rest = ca.substitute([nxt["let_go"], nxt["back"]], [*p.values()], [ca.SX(values[n]) for n in p])
    names = [*x.values(), *u.values()]
    wide = {"let_go": (0, values["limit"]), "back": (0, 10)}
    low, high = zip(*(wide.get(str(n), (-1e9, 1e9)) for n in names), strict=True)
    f = ca.Function("f", [ca.vertcat(*names)], [ca.vertcat(*rest)])
    least, most = enclose(f, np.array([low]).T, np.array([high]).T)
    assert least[0, 0] >= 0
    assert most[0, 0] <= values["limit"]
    # where the count has come to the limit, the next state is the time of the demand
    lets = _released(x, u)
    at_limit = lets | {"let_go": ca.SX(values["limit"])}
    now, _ = block.expr({k: at_limit.get(k, v) for k, v in x.items()},
                        {k: lets.get(k, v) for k, v in u.items()},
                        {k: ca.SX(values[k]) for k in p})  # fmt: skip
    assert float(now["back"]) == values["again"]
    assert float(now["let_go"]) == 0
    _, given = block.expr({k: now[k] for k in x}, {k: lets.get(k, v) for k, v in u.items()},
                             {k: ca.SX(values[k]) for k in p})  # fmt: skip
    rests = {n: float(v) for n, v in given.items() if n in ("hold", "vent")}
    assert rests == {} or rests == {"hold": 0, "vent": 0}


def _released(x, u):
    """Numbers of states and inputs with which the axle is released."""
    usual = {n: ca.SX(1 if n in ("on", "ready", "sound", "hold_by", "vent_by") else 0)
             for n in [*x, *u]}  # fmt: skip
    return usual | {"T_demand": ca.SX(5e3), "v": ca.SX(10)}


# ---- one axle's samples stay with that axle ------------------------------------------------------

METRO = Path(vehicle.__file__).parent / "files" / "metro.toml"
AXLES = 4


def axle_of_each(signals):
    """Of each element of signals the axle that it belongs to, None where it is common to all."""
    found = []
    for name, s in signals.items():
        apart = s.shape != () and s.shape[-1] % AXLES == 0  # the copies stand beside each other
        found += [(name, k // (s.size // AXLES) if apart else None) for k in range(s.size)]
    return found


@pytest.mark.second
@pytest.mark.parametrize("law", ["pid", "super_twisting", "predictive"])
@pytest.mark.others("long")
def test_what_is_believed_of_an_axle_moves_no_state_and_no_command_of_another(law):
    """By the structure of the equations, so for any numbers and any number of ticks.

    All but ``trust``, fed with what that believes: an element of one axle depends on elements of
    the same axle and on what is common, the believed speed, the demand and the train's release.
    """
    whole = Request.read(f"{METRO}:{law}").chosen[0]["ctl"]
    wires = {k: v.replace("trust.", "believed_") for k, v in whole.wires.items()
             if not k.startswith("trust.")}  # fmt: skip
    rest = connect("rest", wires, **{n: p for n, p in whole.parts.items() if n != "trust"})
    inputs = axle_of_each(rest.inputs)
    common = {n for n, k in inputs if k is None}
    assert common == {"believed_v", "believed_demand", "believed_retry", "fall.a_R", "probe.limit"}
    given = [axle_of_each(rest.states), inputs]
    of = [axle_of_each(rest.states), axle_of_each(rest.outputs)]
    assert {n for n, k in [*given[0], *of[1]] if k is None} == set()
    seen = 0
    for (i, rows), (k, columns) in ((a, b) for a in enumerate(of) for b in enumerate(given)):
        for row, column in zip(*rest.f.jac_sparsity(i, k).get_triplet(), strict=True):
            (to, axle), (source, other) = rows[row], columns[column]
            assert other in (axle, None), f"{to} of axle {axle} takes {source} of axle {other}"
            seen += 1
    assert seen > 1000


def judged_axle(driven):
    """Signals of ``trust`` by name, each element a symbol, and its first axle, judged."""
    block = trust(AXLES, driven)
    signals = {**block.states, **block.inputs, **block.params}
    s = {n: ca.SX.sym(n, v.size) for n, v in signals.items()}
    axle = AxleSample(0, s, -1 if driven else 1)
    axle.judge(ca.SX.sym("believed"), ca.SX.sym("sensed"))
    axle.doubt(ca.SX.sym("alone"), ca.SX.sym("top"))
    return s, axle


@pytest.mark.parametrize("driven", [False, True])
def test_an_axle_is_judged_by_its_own_samples_and_the_speed_that_is_believed(driven):
    s, axle = judged_axle(driven)
    others = {str(e) for v in s.values() if v.numel() == AXLES for e in ca.vertsplit(v)[1:]}
    made = ("torque", "modelled", "odd", "omega", "ratio", "mean", "out", "still", "radius",
            "learnt", "doubted", "test", "taken", "dead", "slides")  # fmt: skip
    used = set(map(str, ca.symvar(ca.vertcat(*[getattr(axle, n) for n in made]))))
    assert not used & others
    assert {"believed", "sensed", "alone", "omega_0"} <= used


@pytest.mark.parametrize("driven", [False, True])
def test_an_axle_is_not_ready_from_the_tick_on_in_which_its_last_good_value_is_too_old(driven):
    """Then ``safe`` gives the demand, rate limited, whatever else there is: see above."""
    s, axle = judged_axle(driven)
    axle.out = ca.SX(HOLD)
    _, told = _axles(s, [axle], ca.SX.sym("wrong"), ca.SX.sym("v"), ca.SX.sym("demand"))
    assert told["ready"].is_zero()
    assert told["ok"].is_zero()


def most_tried(v, **fixed):
    """Ends of the next count of ``_supply`` for believed speeds ``v``, over all that is not fixed.

    It keeps the drive from its demand while it is above the limit ``TRIED``.
    """
    names = ("tried", "v", "seen", "given_h", "demand")
    x = {n: ca.SX.sym(n) for n in names}
    of = x | {n: ca.SX(value) for n, value in fixed.items()}
    numbers = {"tried": x["tried"], "T": ca.SX(1e-3), "T_max": ca.SX(8e3)}
    count, zero = _supply(numbers, of, of["v"], of["demand"])
    assert ca.is_equal(zero, count["tried"] > TRIED, 50)
    f = ca.Function("f", [ca.vertcat(*x.values())], [count["tried"]])
    low, high = ([(0, 2 * TRIED)[k], v[k], *[(-1e9, 1e9)[k]] * 3] for k in (0, 1))
    least, most = enclose(f, np.array([low]).T, np.array([high]).T)
    assert least[0, 0] >= -1e-12  # ends are rounded outwards
    return most[0, 0] - 1e-12


def test_a_drive_is_kept_from_its_demand_only_where_its_sensor_contradicts_a_stand():
    """Not while that is believed, or tells less, or without a demand, or in motion."""
    slow, moves = (-1e9, np.nextafter(MOVES, 0)), (MOVES, 1e9)
    assert most_tried(slow) <= 2 * TRIED  # the count stays in its range
    assert most_tried(moves) <= TRIED
    for sure in ({"seen": 1}, {"given_h": 0.99 * MOVES}, {"demand": 0}):
        assert most_tried(slow, **sure) <= 0


def test_no_axle_of_a_drive_is_ready_while_its_wheels_have_no_supply():
    s, axle = judged_axle(True)
    more = ca.SX(0)
    _, told = _axles(s, [axle], ca.SX.sym("wrong"), ca.SX.sym("v"), ca.SX.sym("demand"), more)
    assert told["ready"].is_zero()
    assert told["ok"].is_zero()
