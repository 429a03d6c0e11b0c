"""Control without offset: a plant that is not the model, its steady error, and what is refused."""

import casadi as ca
import numpy as np
import pytest

from slipctl import BadInput, Input, Output, Param, State, flow, law, nmpc, one, sampled
from slipctl.ccode import codegen
from slipctl.draw import show
from slipctl.predict.trials import Driver
from slipctl.studies.predictive.slip_problem import make as slip


@flow()
def car(
    v=State("m/s", 0.0, "speed"), F=State("N", 0.0, "force"),
    F_cmd=Input("N", "command", lo=-50, hi=50), grade=Input("1", "slope", value=0.05),
    load=Input("N", "what pushes back", value=0.0), m=Param("kg", 2.0, "mass"),
):  # fmt: skip
    """A mass on a slope behind a lag of 0.1 s."""
    return dict(
        v=(F - load) / m - 9.81 * one("m/s^2") * grade, F=(F_cmd - F) / (0.1 * one("s"))
    ), {}


@law(e=Output("m/s"), lag=Output("N"))
def tracking(
    v=Input("m/s", "speed"), w=Input("m/s", "wanted"), F=Input("N", ""), F_cmd=Input("N", "")
):
    """Speed error, and the force still to come."""
    return dict(e=v - w, lag=F_cmd - F)


@law(e=Output("m/s"), f=Output("N"))
def effort(v=Input("m/s", "speed"), w=Input("m/s", "wanted"), F_cmd=Input("N", "")):
    """Speed error and force: at rest on a slope one of them stays."""
    return dict(e=v - w, f=F_cmd)


def make(cost=tracking, at=1.0, **options):
    """Controller of the car."""
    point = {} if at is None else {"at": {"w": at}}
    return nmpc(car, cost, "F_cmd", h=0.05, weights={"e": 10.0}, **point, **options)


def driven(block, ticks=200, prepares=0, mass=2.2, load=0.0):
    """Speed, force and outputs on a plant that is 10 % heavier than the model."""
    tick, truth = Driver(block, compile=False), sampled(car, 0.05, "rk4").f
    x, rows = np.zeros(2), []
    for _ in range(ticks):
        known = {"v": x[0], "F": x[1], "w": 1.0, "grade": 0.05, "load": 0.0}
        given = [known[n] for n in block.inputs]
        for _ in range(prepares):
            tick.prepare(np.nan, np.nan, *given[2:])
        rows.append([*x, *tick(*given)])
        x = np.array(truth(x, [rows[-1][2], 0.05, load], ca.DM(mass))[0]).ravel()
    return np.array(rows)


@pytest.mark.parametrize("unknown", ["v", "load"])
def test_a_mass_that_is_10_percent_wrong_leaves_no_offset(unknown):
    """On a slope of 5 % the lack is .2 kg g .05: as a rate -.05 g / 10, as a load 2 kg of that."""
    assert abs(driven(make(at=None))[-1, 0] - 1) > 1e-2
    rows = driven(make(offset_free=unknown))
    assert rows[-1, 0] == pytest.approx(1, abs=1e-12)
    assert (rows[:, 3] == 0).all()
    lack = 0.2 * 9.81 * 0.05
    assert rows[-1, -1] == pytest.approx(-lack / 2 if unknown == "v" else lack, rel=1e-10)


def test_the_estimate_shrinks_by_its_share_and_a_nan_leaves_it():
    """It acts as at the point, over which W_0 is a hundredth: the error falls by .2/1.01 a tick."""
    block = make(offset_free="load")
    lack = 0.7 - driven(block, 20, mass=2.0, load=0.7)[:, -1]
    assert lack[1:] / lack[:-1] == pytest.approx(1 - 0.2 / 1.01)
    tick = Driver(block, compile=False)
    for v in (0.0, 0.3, 0.5):
        before = tick(v, 0.0, 0.05, 1.0)[-1]
    assert tick(np.nan, 0.0, 0.05, 1.0)[-1] == before
    assert tick(0.1, 0.0, 0.05, 1.0)[-1] == before  # nothing was expected


def test_in_two_parts_it_gives_the_same_bits():
    whole = driven(make(offset_free="v"), 30)
    for prepares in (0, 1, 2):
        assert (driven(make(offset_free="v", split=True), 30, prepares) == whole).all()


def test_it_is_told():
    text = show.text(make(offset_free="v"), False)
    assert "estimated  unmodelled_v: constant, learnt from what each tick missed" in text


BAD = [
    (dict(offset_free="z"), "offset_free: 'z' is no state and no held input"),
    (dict(offset_free="F_cmd"), "offset_free: 'F_cmd' is no state and no held input"),
    (dict(offset_free=3), "offset_free = 3; give states or held inputs by name"),
    (dict(offset_free=["v", "v"]), "names something twice"),
    (dict(offset_free=["load", "grade"]), "load and grade cannot be distinguished"),
    (dict(offset_free="load", at=None), "the point of the slopes lacks w; give at="),
    (
        dict(offset_free="load", cost=effort),
        "with another load no steady state has all",
    ),
    (dict(offset_free="F"), "with another unmodelled_F no steady state has all residuals zero"),
    (dict(offset_free="load", preview=["load"]), "preview of 'load', which is no held input"),
]


@pytest.mark.parametrize(("options", "text"), BAD, ids=[t for _, t in BAD])
def test_bad_input_is_one_line(options, text):
    with pytest.raises(BadInput, match=text) as error:
        make(**options)
    assert "\n" not in str(error.value)


def test_an_input_without_effect_at_the_point_is_refused():
    """Adhesion is seen where there is slip, of a vehicle that goes on."""
    assert slip(offset_free="mu_p", at={"q": 10.2, "T": 3.0}).inputs.keys() >= {"v", "s_ref"}
    with pytest.raises(BadInput, match="with another unmodelled_xi no steady"):
        slip(offset_free="xi", at={"q": 10.2, "T": 3.0})
    with pytest.raises(BadInput, match="mu_p changes no state at the point"):
        slip(offset_free="mu_p", at={"q": 10.0, "T": 0.0, "u": 0.0})


@pytest.mark.long
@pytest.mark.usefixtures("needs_compiler")
def test_generated_c_estimates_too(tmp_path):
    block = make(horizon=4, offset_free="load")
    n = 20
    given = {"v": np.linspace(0, 1, n), "F": np.zeros(n), "grade": np.full(n, 0.05),
             "w": np.ones(n)}  # fmt: skip
    assert codegen.check(block, given, tmp_path)["passed"]
