"""Ranges that are proved hold what is sampled, and are not much wider."""

import importlib

import casadi as ca
import numpy as np
import pytest
from casadi import acos, asin, sin
from enclosures import LAWS, case, compared, default

import slipctl as sc
from slipctl import BadInput
from slipctl.analysis.bounds import _of_column, enclosure
from slipctl.certify.arithmetic.enclosure import largest
from slipctl.study.resolve import load_block, model_files


@pytest.mark.second
@pytest.mark.parametrize("name", LAWS)
@pytest.mark.others("long")
def test_an_enclosure_holds_every_sample_and_is_not_much_wider(name):
    """1.3 times at most, over slips and parameters; ``.ci/full`` tries 10 000 boxes."""
    law = load_block(name)
    cases = [case(name, seed) for seed in range(4)]
    if name != "contact_reference.carter":  # its six ranges with a kink take seconds: .ci/full
        cases.append(compared(law, default(law, name), np.random.default_rng(0), 0.1))
    for found in cases:
        assert not found.lost
        assert found.wide <= 1.3


def test_every_adhesion_law_of_the_models_is_among_them():
    """What has a slip and gives ``mu`` is enclosed, be it in a file that comes later."""
    made = set()
    for name in model_files():
        blocks = vars(importlib.import_module(f"slipctl.models.{name}")).values()
        laws = [b for b in blocks if isinstance(b, sc.Block) and b.kind == "law" and b.conditions]
        made |= {b.name for b in laws if "mu" in b.outputs and {"v_s", "lam"} & set(b.inputs)}
    assert made == {name.rpartition(".")[2] for name in LAWS}


def test_a_range_in_closed_form():
    """The arc cosine falls, the arc sine rises, and their sum is pi/2 everywhere."""

    @sc.law(y=sc.Output("1"))
    def arc(u=sc.Input("1")):
        return acos(u) + asin(u) + sin(3 * u)

    low, high = enclosure(arc, "y", {"u": (0.0, 0.9)}, 1e-3)
    assert low <= np.pi / 2
    assert high >= np.pi / 2 + 1
    assert high - low <= 1.01


def test_what_has_no_range_is_refused():
    @sc.law(y=sc.Output("1"))
    def law(u=sc.Input("1")):
        return u

    with pytest.raises(BadInput, match="has no output 'z'"):
        enclosure(law, "z", {"u": (0, 1)})
    with pytest.raises(BadInput, match=r"range 1\.\.1 of u is empty"):
        enclosure(law, "y", {"u": (1, 1)})
    with pytest.raises(BadInput, match=r"range 0\.\.inf of u is not finite; write"):
        enclosure(law, "y", {"u": (0, np.inf)})


def test_few_boxes_are_enough():
    """Slopes bound a box from its middle: without them 200 000 boxes leave this one half open."""
    law = load_block("contact.polach")
    f = _of_column(law, law.function(), 0, ("v_s", "B", "v_min"), {"v": 20.0})
    x = ca.SX.sym("x", 3)
    slope = ca.Function("slope", [x], [ca.gradient(f(x), x)])
    low, high = np.array([0.0763, 0.52, 0.98]), np.array([4.62, 0.58, 1.02])
    found = largest(f, low, high, 1e-3, slope=slope)
    assert found.boxes < 1000
    assert found.bound - found.reached <= 1e-3
    share = np.random.default_rng(1).random((3, 20_000))
    seen = float(np.array(f(low[:, None] + (high - low)[:, None] * share)).max())
    assert found.reached - 1e-3 <= seen <= found.bound
