"""What rounding to float may do to a module, where no trial was made."""

import numpy as np

from slipctl import Input, Output, State, step
from slipctl.ccode.check import expected
from slipctl.ccode.write.plan import Plan


@step(period=0.01, y=Output("1", "lagged"))
def lag(x=State("1", 0.7, "lagged"), u=Input("1", "wanted")):
    return {"x": 0.5 * x + u}, {"y": x}


def test_roundings_of_a_stable_module_do_not_grow():
    """x+ = x/2 + u: each tick moves x by its rounding, and forgets half of what came before."""
    u = 0.3 + 0.1 * np.sin(np.arange(80))
    x = [0.7]
    for v in u:
        x.append(0.5 * x[-1] + v)
    states, outputs = np.array(x[1:])[:, None], np.array(x[:-1])[:, None]
    plan = Plan(lag, None, None, "float")
    status = np.zeros(len(u), dtype=int)
    run = expected.Expected(u[:, None], outputs, states, status, {}, frozenset())
    worst = expected._spread(plan, run, {})
    eps = 2.0**-24
    assert worst.min() > 0
    assert worst.max() <= 4 * eps * np.abs(x).max()  # geometric series of 1/2, and the input's own
