"""What the safe output promises for any numbers at all, by its equations and by intervals."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from slipctl.certify.enclosure import enclose
from slipctl.models.vehicle.air.slide_protection import watchdog
from slipctl.models.vehicle.safe_output import safe_command


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
