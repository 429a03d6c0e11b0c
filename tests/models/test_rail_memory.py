"""A rail that remembers: exact recursions, reference trains, energy, and a file."""

from math import exp, expm1, pi

import numpy as np
import pytest
from casadi import sign
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from slipctl import BadInput, Input, Output, law
from slipctl.models.wheel_rail.falling_creep import falling_creep
from slipctl.models.wheel_rail.rail_memory import Cells, Layer, blended_law, rail_field
from tests.models.trains_on_layers import LEAVES, braked, places, slipping

SMOOTH = 1e-4
"""Speed in m/s that keeps a creep finite, small enough to be none."""


def level(mu, name):
    """A law without a curve: the same adhesion at any creep."""

    @law(mu=Output("1", "adhesion", positive="traction"), name=name)
    def flat(v_s=Input("m/s", "creep", positive="traction", per="speed"), v=Input("m/s", "speed")):
        return mu * sign(v_s) + 0 * v

    return flat


def passed(n, tau, force, creep, behind=None):
    """Adhesion that each of n wheels finds at a rail point, when the train has gone over it."""
    speed, fouled, clean, cell, steps = 20.0, 0.02, 0.15, 0.5, 60
    behind, h = behind or tuple(3.0 * k for k in range(n)), 1e-2
    field = rail_field(Cells(behind, cell, 50.0), h).with_params(tau=tau)
    x, values = field.start(), field.param_values()
    found = np.zeros(n)
    place = 0.0
    for _ in range(int(behind[-1] / (speed * h)) + steps):
        u = {"at": place - np.array(behind), "way": speed * h, "P": np.zeros(n)}
        share = np.ravel(field.f(*packed(field, x, u, values))[1])[:n]
        mu = (1 - share) * fouled + share * clean
        u["P"] = 2 * force * mu * creep * speed
        nxt, _ = field.f(*packed(field, x, u, values))
        x = dict(zip(field.states, split(field, nxt), strict=True))
        found = mu
        place += speed * h
    return found


def packed(field, x, u, p):
    return field.pack("state", x), field.pack("input", u), field.pack("param", p)


def split(field, column):
    at, parts = 0, []
    for s in field.states.values():
        parts.append(np.ravel(column[at : at + s.size]))
        at += s.size
    return parts


# ---- the creep law -------------------------------------------------------------------------------


def test_the_creep_law_begins_with_its_slope_and_ends_at_its_floor():
    """(2/pi)(k_A + k_S) c by creep; a locked wheel of a fast train keeps A mu_0, nearly."""
    v, e = 20.0, 1e-7
    slope = float(falling_creep(v_s=e * v, v=v)["mu"]) / e
    assert slope == pytest.approx(2 / pi * 0.4 * 300, rel=1e-4)  # v_0 is 1e-5 of it
    assert float(falling_creep(v_s=-1e4, v=1e4)["mu"]) == pytest.approx(-0.15 * 0.5, rel=0.02)
    slow = falling_creep.with_params(k_v=0.02)
    ratio = float(slow(v_s=-1e4, v=100.0)["mu"]) / float(falling_creep(v_s=-1e4, v=100.0)["mu"])
    assert ratio == pytest.approx(1 / 3, rel=0.01)


# ---- exact recursions ----------------------------------------------------------------------------

AXLES = {  # axle: practice_models table 1.5, 16 axles, mu from 0.02 to 0.15
    0.10: (0.02205, 0.0203, 0.0208, 0.0219, 0.0242),
    0.257: (0.02568, 0.0207, 0.0221, 0.0251, 0.0321),
    0.50: (0.03228, 0.0213, 0.0241, 0.0306, 0.0472),
    1.35: (0.06086, 0.0235, 0.0319, 0.0547, 0.1095),
}


@pytest.mark.parametrize("K", AXLES)
def test_each_axle_finds_what_those_before_it_left(K):
    """Table 1.5 to its digits: mu of the axles 2, 4, 8, 16 and the mean, from K = tau N e alone."""
    mu = passed(16, K / (50e3 * 0.15), 50e3, 0.15)
    mean, *rest = AXLES[K]
    assert mu.mean() == pytest.approx(mean, abs=0.6e-5)
    assert mu[[1, 3, 7, 15]] == pytest.approx(rest, abs=0.6e-4)
    exact, W = [], 0.0
    for _ in range(16):  # the recursion of the spec, without cells
        exact.append(0.15 - 0.13 * exp(-W))
        W += K * exact[-1]
    assert mu == pytest.approx(exact, rel=1e-12)


@settings(max_examples=8, deadline=None)
@given(st.floats(1e4, 1e5), st.floats(0.01, 0.5), st.floats(0.05, 1.0))
@pytest.mark.second
def test_only_the_product_counts(force, creep, K):
    """A4: tau, N and e act through K, at fixed slip."""
    here = passed(4, K / (force * creep), force, creep)
    assert here == pytest.approx(passed(4, K / (50e3 * 0.1), 50e3, 0.1), rel=1e-10)


@pytest.mark.second
def test_ten_times_the_axles_come_near_the_logistic():
    """A3: with axles of a tenth of the load the recursion is ten times nearer to its limit."""

    def far(n, K):
        mu = passed(n, K / (50e3 * 0.15), 50e3, 0.15)[-1]
        return abs(mu - 0.15 / (1 + 6.5 * np.exp(-K * 0.15 * (n - 1))))

    assert far(9, 1.0) / far(81, 0.1) == pytest.approx(10, rel=0.1)


@settings(max_examples=3, deadline=None)
@given(st.lists(st.floats(0.6, 4.0), min_size=2, max_size=3))
def test_a_train_that_is_turned_round_has_the_same_force(apart):
    """A8: equal axles at any distances; which end leads does not count once all are in the leaves.

    The second axle finds more than the first whatever lies between them, so the sum is the same.
    """
    ways = (np.cumsum([0.0, *apart]), np.cumsum([0.0, *apart[::-1]]))
    ahead, back = (passed(len(w), 1e-4, 50e3, 0.15, tuple(w)) for w in ways)
    assert ahead.sum() == pytest.approx(back.sum(), rel=1e-10)
    assert (np.diff(ahead) > 0).all()


OWN = {0.01: 0.0613, 0.05: 0.0672, 0.10: 0.0759, 0.20: 0.0993, 0.30: 0.1308, 0.50: 0.1971,
       1.00: 0.2639}  # fmt: skip


@pytest.mark.parametrize("e", OWN)
def test_a_wheel_that_finds_what_it_does_itself(e):
    """Table 1.2 to its digits: N 55 kN, .06 to .28, tau 1.8e-4; its root is found by brentq too."""
    N, tau, speed, h = 55e3, 1.8e-4, 20.0, 1e-2
    field = rail_field(Cells((0.0,), 0.5, 50.0), h, Layer(own=True)).with_params(tau=tau)
    x, p = field.start(), field.param_values()
    mu = 0.06
    for _ in range(400):
        u = {"at": np.zeros(1), "way": speed * h, "P": np.array([2 * N * mu * e * speed])}
        nxt, _ = field.f(*packed(field, x, u, p))
        x = dict(zip(field.states, split(field, nxt), strict=True))
        share = float(field.f(*packed(field, x, u, p))[1][0])
        mu = 0.06 + share * 0.22
    assert mu == pytest.approx(OWN[e], abs=0.6e-4)
    root = brentq(lambda f: f - 0.06 + 0.22 * expm1(-tau * N * e * f), 0.06, 0.28, xtol=1e-14)
    assert mu == pytest.approx(root, rel=1e-9)


def test_nothing_is_cleaned_where_nothing_cleans():
    """A1: tau = 0 has the curve of the layer, to the last bit; the share grows from 0 to 1."""
    field = rail_field(Cells((0.0, 3.0), 0.5, 50.0), 1e-2)
    u = {"at": np.zeros(2), "way": 0.2, "P": np.zeros(2)}
    shares = []
    for tau, W in ((0.0, 1e9), (1e-4, 0.0), (1e-4, 1e3), (1e-4, 1e4), (1e-4, 1e7)):
        x = field.start() | {"W": np.full(field.states["W"].size, W)}
        p = field.with_params(tau=tau).param_values()
        shares.append(float(field.f(*packed(field, x, u, p))[1][0]))
    assert shares[:2] == [0.0, 0.0]
    assert shares[2] == pytest.approx(-expm1(-0.1), rel=1e-14)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_two_layers_recover_late():
    """n = 2: half of the energy of 1 - 1/e does a fourth of the exponent, not a half."""
    field = rail_field(Cells((0.0,), 0.5, 50.0), 1e-2)
    u = {"at": np.zeros(1), "way": 0.2, "P": np.zeros(1)}
    x = field.start() | {"W": np.full(field.states["W"].size, 5e3)}
    share = {n: float(field.f(*packed(field, x, u, field.with_params(n=n).param_values()))[1][0])
             for n in (1.0, 2.0)}  # fmt: skip
    assert share[1.0] == pytest.approx(-expm1(-0.5), rel=1e-14)
    assert share[2.0] == pytest.approx(-expm1(-0.25), rel=1e-14)


# ---- reference trains ----------------------------------------------------------------------------

CREEPING = blended_law(falling_creep.with_params(v_0=SMOOTH * 10, **LEAVES),
                       falling_creep.with_params(v_0=SMOOTH * 10))  # fmt: skip
"""v_0 at its least: 1 mm/s, which is none here."""


@pytest.mark.second
@pytest.mark.parametrize(
    ("cars", "slip", "tau", "stop"),
    [(2, (0.10,) * 8, 1e-4, 698.838),
     pytest.param(2, "greedy", 1e-4, 755.894, marks=pytest.mark.long),
     (1, (0.25, 0.20, 0.10, 0.05), 1.8e-4, 666.706)],
    ids=["G1", "G2", "G3"],
)  # fmt: skip
def test_trains_with_given_slip_stop_where_another_code_says(cars, slip, tau, stop):
    """G1 to G3 of practice_cases, to 1e-5, with cells of 0.25 m and ticks of 1 ms."""
    assert slipping(CREEPING, places(cars), slip, tau) == pytest.approx(stop, rel=1e-5)


def test_sixteen_axles_of_the_anchor():
    """A7: K = .257, .02 to .15, no drag, 55 mph: 1206.65 +- .1 m, with the train's length."""
    flat = blended_law(level(0.02, "layer"), level(0.15, "steel"))
    K, N, e = 0.257, 50e3, 0.15
    way = slipping(flat, places(4), (e,) * 16, K / (N * e), v0=55 * 0.44704, load=N, drag=False,
                   cap=1.0)  # fmt: skip
    assert way == pytest.approx(1206.65, abs=0.1)


CASES = {
    "T1": (dict(behind=places(1), demand=1.0, tau=1e-4), 738.017, 54.477, 13.7536e6, 51.68),
    "T2": (dict(behind=places(1), demand=0.9, tau=1e-4, layer={}), 371.270, 29.066, 0.0357e6, 0.0),
    "T3": (dict(behind=(0.0, 8.0), demand=0.6, tau=3.4e-5, stretch=(60.0, 140.0)), 547.903, 42.965,
           1.0838e6, 0.265),
}  # fmt: skip


@pytest.mark.second
@pytest.mark.parametrize("case", CASES)
@pytest.mark.others("long")
def test_trains_without_protection_stop_where_another_code_says(case):
    """T1 to T3: way and time to 1e-4, heat to its digits, the longest lock to two of its own ticks.

    The energy of the train and that on the rail agree to 1e-12 and better.
    """
    given_, way, time, heat, locked = CASES[case]
    stop = braked(**given_)
    assert stop.way == pytest.approx(way, rel=1e-4)
    assert stop.time == pytest.approx(time, rel=1e-4)
    assert stop.heat == pytest.approx(heat, rel=1e-4, abs=50)  # .0357 MJ has three digits
    assert stop.locked.max() == pytest.approx(locked, abs=0.005)
    assert abs(stop.field_error) < 1e-12
    assert abs(stop.train_error) < 1e-12


@pytest.mark.second
@pytest.mark.parametrize(("cell", "h"), [(2.0, 4e-3), (0.4, 1e-3), (0.31, 2e-3), (0.05, 2e-4)])
@pytest.mark.others("long")
def test_energy_is_exact_at_any_step_and_cell(cell, h):
    """A5, A6: what the train gives is on the rail, however coarse step and cell are."""
    stop = braked((0.0, 8.0), 0.6, 3.4e-5, (60.0, 140.0), cell=cell, h=h)
    assert abs(stop.field_error) < 1e-12
    assert abs(stop.train_error) < 1e-12


# ---- what is refused -----------------------------------------------------------------------------


def test_cells_that_two_axles_would_share_are_refused():
    with pytest.raises(BadInput, match=r"2\.1 m between two axles"):
        Cells((0.0, 2.1, 14.0), 2.2)
    assert Cells((0.0, 2.1, 14.0), 2.1).count == 8
    with pytest.raises(BadInput, match=r"0.1 m is shorter than the 0.15 m of a step"):
        rail_field(Cells((0.0, 2.1), 0.1), 1e-3)


def test_a_train_that_rolls_back_finds_what_it_had_found():
    """Energy stays exact, and the way forward begins where the train had been."""
    field = rail_field(Cells((0.0, 3.0), 0.5, 50.0), 1e-2)
    x, p, given_ = field.start(), field.param_values(), 0.0
    ways = [0.2] * 40 + [-0.1] * 15 + [0.1] * 15 + [0.0] * 3 + [0.2] * 40
    seen, at = [], 0.0
    for way in ways:
        heat = np.array([3e4, 1e4])
        u = {"at": at - np.array([0.0, 3.0]), "way": way, "P": heat}
        nxt, y = field.f(*packed(field, x, u, p))
        seen.append(float(y[4 + 1]))
        x = dict(zip(field.states, split(field, nxt), strict=True))
        given_ += heat.sum() * 1e-2
        at += way
    energy = float(field.f(*packed(field, x, u, p))[1][-1])
    assert energy == pytest.approx(given_, rel=1e-13)
    assert seen[40] == seen[70]  # there again


def test_slopes_of_the_field_are_those_of_its_equations():
    """Derivatives by W and tau against differences, where a wheel is within its cell."""
    import casadi as ca

    field = rail_field(Cells((0.0, 3.0), 0.5, 50.0), 1e-2).with_params(tau=2e-4, n=1.5)
    x = field.start() | {"phase": 0.3, "W": np.linspace(1e3, 6e3, field.states["W"].size)}
    u = {"at": np.array([0.0, -3.0]), "way": 0.2, "P": np.array([3e4, 1e4])}
    at = [ca.DM(c) for c in packed(field, x, u, field.param_values())]
    for k in (0, 2):
        slope = np.array(ca.DM(field.f.jacobian()(*at, *field.f(*at))[3 + k]))
        size = at[k].numel()
        for j in range(size):
            step = max(abs(float(at[k][j])), 1.0) * 1e-6 if k == 0 else abs(float(at[k][j])) * 1e-6
            if step == 0:
                continue
            ends = []
            for side in (1, -1):
                moved = [ca.DM(c) for c in at]
                moved[k][j] += side * step
                ends.append(np.array(field.f(*moved)[1]).ravel())
            difference = (ends[0] - ends[1]) / (2 * step)
            assert slope[:, j] == pytest.approx(difference, rel=1e-5, abs=1e-7)


@given(st.floats(0, 5e4), st.floats(0, 2e3), st.sampled_from([1.0, 2.0]))
def test_a_layer_recovers_by_energy_and_by_time_together(energy, time, n):
    """1 - exp(-(tau W)^n - t/T_dry) inside of the place, 1 outside, by the text of the module."""
    layer = Layer(drying=True)
    field = rail_field(Cells((0.0,), 0.5, 10.0), 1e-2, layer).with_params(
        tau=3.4e-5, n=n, T_dry=600.0, start=[5.0], end=[8.0]
    )
    x = field.start() | {"W": np.full(field.states["W"].shape, energy), "t": time}
    for at, inside in ((4.9, False), (6.0, True), (8.1, False)):
        u = {"at": np.array([at]), "way": 0.0, "P": np.zeros(1)}
        share = float(np.ravel(field.f(*packed(field, x, u, field.param_values()))[1])[0])
        wanted = -expm1(-((3.4e-5 * energy) ** n) - time / 600.0) if inside else 1.0
        assert share == pytest.approx(wanted, rel=1e-9, abs=1e-12)


def test_a_layer_that_dries_is_fouled_and_feels_its_own_contact_has_its_usual_numbers():
    layer = Layer(drying=True, fouling=True, own=True)
    field = rail_field(Cells((0.0, 3.0), 0.5, 50.0), 1e-3, layer)
    numbers = field.param_values()
    assert (numbers["T_dry"], numbers["T_foul"], numbers["v_0"]) == (600.0, 600.0, 0.1)
    assert np.shape(field.start()["W_own"]) == (2,)
