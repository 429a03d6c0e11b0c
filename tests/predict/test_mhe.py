"""Moving-horizon estimation: against the Kalman filter, and against all samples at once."""

import math

import numpy as np
import pytest
import scipy.optimize

from slipctl import BadInput, Input, Output, Param, State, c_module, ekf, flow, mhe, one
from slipctl.predict.trials import Driver

H = 0.05
ARRIVAL = dict(x=1.0, v=1.0, d=2.0)
DRIFT = dict(x=1e-3, v=1e-2, d=1.0)


@flow()
def cart(
    x=State("m", 0.0, "position"), v=State("m/s", 0.0, "speed"),
    F=Input("N", "force", value=0.0), d=Input("m/s^2", "what pushes", value=0.0),
):  # fmt: skip
    """One kilogram."""
    return dict(x=v, v=F / one("kg") + d), {}


def make(**options):
    """Estimator of the cart from its position."""
    return mhe(cart, "x", 0.01, ARRIVAL, **{"drift": DRIFT, "period": H, "samples": 8, **options})


def run(block, samples, forces, seen=None):
    """Outputs of every tick, by name."""
    tick, rows = Driver(block, compile=False), []
    for k, (x, F) in enumerate(zip(samples, forces, strict=True)):
        given = {"x": x, "F": F, "seen_x": 1.0 if seen is None else seen[k]}
        rows.append(tick(*(given[n] for n in block.inputs)))
    return dict(zip(block.outputs, np.array(rows).T, strict=True))


def at_once(samples, forces, seen, low=-np.inf, high=np.inf):
    """Last state of the best motion through all samples, by bounded least squares; its squares."""
    n = len(samples)
    A = np.array([[1, H, H * H / 2], [0, 1, H], [0, 0, 1]])
    B = np.array([H * H / 2, H, 0])
    rows, right = [], []
    for i in range(3):
        row = np.zeros(3 * n)
        row[i] = 1 / math.sqrt(list(ARRIVAL.values())[i])
        rows.append(row)
        right.append(0.0)
    for k in range(n):
        if seen[k]:
            row = np.zeros(3 * n)
            row[3 * k] = 1 / 0.1
            rows.append(row)
            right.append(samples[k] / 0.1)
        for i in range(3 if k + 1 < n else 0):
            row, s = np.zeros(3 * n), math.sqrt(list(DRIFT.values())[i] * H)
            row[3 * k + 3 + i] = 1 / s
            row[3 * k : 3 * k + 3] -= A[i] / s
            rows.append(row)
            right.append(B[i] * forces[k] / s)
    lo, hi = np.full(3 * n, -np.inf), np.full(3 * n, np.inf)
    lo[2::3], hi[2::3] = low, high
    rows, right = np.array(rows), np.array(right)
    if np.isfinite(low):
        z = scipy.optimize.lsq_linear(rows, right, (lo, hi), tol=1e-14, method="bvls").x
    else:
        z = np.linalg.lstsq(rows, right, rcond=None)[0]
    return z[-3:], float(np.sum((rows @ z - right) ** 2))


def test_the_misfit_of_one_sample_is_all_of_its_squares():
    log = run(make(), [0.7, 0.2], [0.3, 0.0])
    for n in (1, 2):
        squares = at_once([0.7, 0.2][:n], [0.3, 0.0][:n], [1, 1])[1]
        assert log["misfit"][n - 1] == pytest.approx(squares / n, rel=1e-6)


def data(n, seed=0):
    """Samples and forces of white noise: the sum of squares does not care for the truth."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=n), rng.normal(size=n)


@pytest.mark.parametrize("samples", [2, 5, 12])
def test_a_linear_problem_without_limits_gives_the_kalman_filter(samples):
    """For any window; 1e-8: each noise has 1e-10 of its curvature added."""
    known = run(ekf(cart, "x", ("x", "v", "d"), prior=ARRIVAL, noise=0.01, drift=DRIFT, period=H),
                *data(25))  # fmt: skip
    found = run(make(samples=samples), *data(25))
    for n in ("x", "v", "d"):
        assert found[n] == pytest.approx(known[n], abs=1e-8)
    assert not found["status"].any()


def test_missing_samples_are_left_out():
    """Also longer than the window; a missing value may be anything."""
    samples, forces = data(25)
    seen = np.ones(25)
    seen[4:7] = seen[11:21] = 0
    wrong = np.where(seen > 0, samples, 1e6)
    found = run(make(), wrong, forces, seen)
    last, _ = at_once(samples, forces, seen)
    assert [found[n][-1] for n in ("x", "v", "d")] == pytest.approx(list(last), abs=1e-7)


def test_a_sample_that_comes_late_or_out_of_order_is_put_in_its_place():
    """Taken at ticks 2 and 3, told at 5 and 4; tick 9 tells one again that has left the window.

    Against all samples in order at once, of those that have come by then.
    """
    rng = np.random.default_rng(5)
    samples, forces = rng.normal(size=10), rng.normal(size=10)
    told = {0: 0, 1: 1, 4: 3, 5: 2, 6: 6, 7: 7, 8: 8, 9: 0}  # tick: when it was taken
    block = make(late="x", samples=8)
    assert list(block.inputs) == ["x", "seen_x", "age_x", "F"]
    tick, whole = Driver(block, compile=False), Driver(make(late="x", samples=10), compile=False)
    for k in range(10):
        taken = told.get(k, k)
        given = (samples[taken], float(k in told), k - taken, forces[k])
        here, all_ = (dict(zip(block.outputs, t(*given), strict=True)) for t in (tick, whole))
        seen = [any(told.get(j) == i for j in range(k + 1)) for i in range(k + 1)]
        state, squares = at_once(samples[: k + 1], forces, seen)
        assert [all_[n] for n in "xvd"] == pytest.approx(state, abs=1e-9)
        assert all_["misfit"] * sum(seen) == pytest.approx(squares, abs=1e-9)
        assert [here[n] for n in "xvd"] == pytest.approx(state, abs=1e-9)


def test_a_window_over_all_samples_with_limits_is_bounded_least_squares():
    """d >= 0 at every sample; scipy's active set on the whole; the squares are the misfit.

    2e-5: the interior point leaves 1e-6 of the size of a limit where it hardly presses.
    """
    samples, forces = data(12, seed=4)
    found = run(make(samples=12, limits={"d": (0.0, 20.0)}), samples, forces)
    free = run(make(samples=12), samples, forces)
    assert free["d"].min() < -0.1
    for n in (3, 7, 12):
        last, squares = at_once(samples[:n], forces[:n], np.ones(n), low=0.0)
        k = n - 1
        assert [found[s][k] for s in ("x", "v", "d")] == pytest.approx(list(last), abs=2e-5)
        assert found["misfit"][k] == pytest.approx(squares / n, rel=1e-6)
    assert found["d"].min() >= 0
    assert not found["status"].any()
    # its price: a soft limit gives way
    soft = run(make(samples=12, limits={"d": (0.0, 50.0, 0.5)}), samples, forces)
    assert free["d"].min() < soft["d"].min() < 0


@flow(rim=Output("m/s", "speed of the rim"))
def wheel(
    w=State("rad/s", 10.0, "wheel speed"), T=Input("N m", "torque", value=0.0),
    J=Param("kg m^2", 2.0, "inertia", lo=0.1, hi=10), r=Param("m", 0.5, "radius", lo=0.1, hi=1),
):  # fmt: skip
    """Wheel whose inertia and radius are not known."""
    return dict(w=T / J), dict(rim=r * w)


def test_parameters_are_unknowns_too_and_the_misfit_is_one():
    """Inertia and radius from noisy speeds; nonlinear in both. Four deviations of each mean."""
    rng, n = np.random.default_rng(2), 400
    T = 20 * np.sign(np.sin(np.arange(n) / 15))
    w = 10 + np.concatenate([[0], np.cumsum(T[:-1] / 3.0 * 0.01)])
    block = mhe(
        wheel, ("w", "rim"), dict(w=0.01**2, rim=0.01**2), dict(w=1.0, J=1.0, r=0.01),
        drift=dict(w=1e-6, J=0.0, r=0.0), period=0.01, samples=20, limits={"J": (0.5, 8.0)},
    )  # fmt: skip
    tick, rows = Driver(block, compile=False), []
    for k in range(n):
        given = dict(w=w[k] + 0.01 * rng.normal(), rim=0.42 * w[k] + 0.01 * rng.normal(), T=T[k])
        given |= dict(seen_w=1.0, seen_rim=1.0)
        rows.append(tick(*(given[s] for s in block.inputs)))
    found = dict(zip(block.outputs, np.array(rows).T, strict=True))
    assert found["J"][-1] == pytest.approx(3.0, abs=0.05)
    assert found["r"][-1] == pytest.approx(0.42, abs=4 * 0.01 / 10 / math.sqrt(n))
    # 40 numbers a window, 20 windows that do not overlap
    assert found["misfit"][20::20].mean() == pytest.approx(1.0, abs=4 * math.sqrt(2 / 800))


def test_a_broken_sample_is_told_and_it_begins_afresh():
    samples, forces = data(20)
    broken = samples.copy()
    broken[9] = math.nan
    found = run(make(limits={"d": (0.0, 50.0)}), broken, forces)
    assert list(np.flatnonzero(found["status"])) == [9]
    assert found["status"][9] == 2
    afresh = run(make(limits={"d": (0.0, 50.0)}), samples[10:], forces[10:])
    assert found["d"][10:] == pytest.approx(afresh["d"], abs=1e-9)
    assert np.isfinite(found["d"]).all()


def test_a_limited_output_may_read_what_nothing_else_reads():
    """A speed above that of a rim, which only the limit knows of: it was a traceback."""

    @flow(gap=Output("m/s", "over the rim"))
    def speed(v=State("m/s", 0.0, "speed"), rim=Input("m/s", "rim"), a_m=Input("m/s^2")):
        """Integrated acceleration."""
        return dict(v=a_m), dict(gap=v - rim)

    block = mhe(
        speed, "v", 1.0, {"v": 1.0}, drift={"v": 1.0}, limits={"gap": (0.0, 10.0)}, period=0.1,
        samples=4,
    )  # fmt: skip
    tick = Driver(block, compile=False)
    given = {"v": 0.0, "seen_v": 1.0, "a_m": 0.0, "rim": 2.0}
    out = dict(zip(block.outputs, tick(*(given[n] for n in block.inputs)), strict=True))
    assert out["v"] == pytest.approx(2.0, abs=1e-6)  # without the limit it is 0
    assert out["status"] == 0


BAD = [
    (dict(arrival={}), "arrival = {}"),
    (dict(arrival=np.array([[1, 2], [2, 1]])), r"arrival = array\(\[\[1, 2\], \[2, 1\]\]\); give"),
    (dict(arrival={"x": 1.0, "v": 0.0, "d": 1.0}), "arrival.*must be positive"),
    (dict(arrival={"v": 1.0, "d": 1.0}, drift=dict(v=1.0, d=1.0)), "x is measured and not estim"),
    (dict(arrival={"x": 1.0, "z": 1.0}), "no state or input or param 'z'"),
    (dict(noise=-1.0), "noise.*must be positive"),
    (dict(noise={"z": 1.0}), "noise has 'z'"),
    (dict(drift=dict(x=1.0)), "drift lacks 'v'"),
    (dict(measurements="z"), "'z'"),
    (dict(samples=1), "samples = 1 must be a whole number >= 2"),
    (dict(period=0.0), "period = 0 s must be positive"),
    (dict(limits={"d": (1.0, 0.0)}), "d from 1 to 0 m/s\\^2 leaves nothing"),
    (dict(limits={"d": (None, None)}), "d has no range"),
    (dict(limits={"d": ("a", 1.0)}), "limits of d: an end takes a number"),
    (dict(limits={"d": 1.0}), r"limits of d: 1.0 is not \(lo, hi\)"),
    (dict(limits={"F": (0.0, 1.0)}), "limits of 'F', which is not estimated"),
    (dict(limits=3), "give limits="),
    (dict(late="z"), "late = 'z', which is not measured"),
    (dict(late=3), "late = 3, which is not measured"),
    (dict(limits={"d": (0.0, 1.0)}, rescue=0), "hard limits need rescue="),
]


@pytest.mark.parametrize(("options", "text"), BAD, ids=[t for _, t in BAD])
def test_bad_input_is_one_line(options, text):
    given = {"measurements": "x", "noise": 0.01, "arrival": ARRIVAL, "drift": DRIFT, **options}
    with pytest.raises(BadInput, match=text) as error:
        mhe(cart, given.pop("measurements"), given.pop("noise"), given.pop("arrival"), **given)
    assert "\n" not in str(error.value)


@pytest.mark.second
@pytest.mark.usefixtures("needs_compiler")
def test_generated_c_repeats_the_estimator(tmp_path):
    """With a limit that holds, in double: the numbers of Python, to the rounding of sums."""
    samples, forces = data(12, seed=4)
    block = make(samples=3, limits={"d": (0.0, 50.0)}, passes=3, rescue=40)
    unit = c_module(block, tmp_path).compile().load()
    state = block.start()
    python = run(block, samples, forces)
    for k in range(12):
        state, out = unit(**state, x=samples[k], F=forces[k], seen_x=1.0)
        assert out["d"] == pytest.approx(python["d"][k], abs=1e-9)
