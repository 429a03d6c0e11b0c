"""Random numbers exact in double and float; differential evolution does what it says, in C too."""

import ctypes
import math
import re
import subprocess

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.peers.bench_de import bench_de
from bench.speed import peer_library
from slipctl import BadInput, Block, Input, Output, Param, differential_evolution, law
from slipctl.models.huang_2020.subway_braking import TABLE_1, double_exponential, peak_slip
from slipctl.run import build
from slipctl.seek import random
from slipctl.seek.evolution import schedule
from slipctl.seek.random import FACTORS, MODULI, advance, quick_floor, rounder, uniform, whole_below

STATES = [np.arange(1, m) for m in MODULI]
"""Every state of each part of the generator."""

RANGE = {"lo": 0.01, "hi": 10.0}
DRY = TABLE_1["dry"]


def search(subject: Block = double_exponential, **options) -> Block:
    return differential_evolution(subject, "v_s", **(RANGE | options))


def roll(block: Block, u: np.ndarray, compiled: bool, **start) -> tuple[np.ndarray, np.ndarray]:
    """States and outputs of one tick per row of inputs, by the virtual machine or compiled."""
    x = np.array(ca.DM(block.pack("state", block.start(**start))).full()).ravel()
    p = np.array(ca.DM(block.pack("param", block.param_values())).full()).ravel()
    x_log, y_log = np.empty((len(u), x.size)), np.empty((len(u), block.f.size1_out(1)))
    if compiled:
        roller = build.compile_roller(block.f)
        assert roller is not None
        assert roller.roll(x, u, p, x_log, y_log) == len(u)
    else:
        build.roll_interpreted(block.f, x, u, p, x_log, y_log)
    return np.vstack([x_log[1:], x]), y_log


def random_curves(count: int) -> np.ndarray:
    """Rows (c, a, b) of the issue's box; the best slip is inside the range in all of it."""
    rng = np.random.default_rng(2020)
    return rng.uniform([0.02, 0.2, 0.8], [1.0, 0.6, 2.0], (count, 3))


# ---- the generator -------------------------------------------------------------------------------


@pytest.mark.parametrize("real", [np.float64, np.float32], ids=["double", "float"])
def test_every_step_is_exact(real):
    K = real(1.5 / np.finfo(real).eps)
    for f, m, states in zip(FACTORS, MODULI, STATES, strict=True):
        assert (m - 1) * f < 2**24
        product = real(f) * states.astype(real)
        quotient = product * real(1 / m)
        for floored in (np.floor(quotient), ((quotient - real(0.5)) + K) - K):
            assert (product - real(m) * floored == f * states % m).all()


@pytest.mark.parametrize("real", [np.float64, np.float32], ids=["double", "float"])
@pytest.mark.parametrize("n", [1, 2, 47, 49, 123, 499])
def test_whole_numbers_below_n_are_exact_and_even(real, n):
    K = real(1.5 / np.finfo(real).eps)
    for m, states in zip(MODULI, STATES, strict=True):
        drawn = states * n // m
        quotient = (states.astype(real) * real(n)) * real(1 / m)
        for floored in (np.floor(quotient), ((quotient - real(0.5)) + K) - K):
            assert (floored == drawn).all()
        counts = np.bincount(drawn, minlength=n)
        assert counts.max() - counts.min() <= 2


def test_expressions_are_the_generator():
    state, K = ca.SX.sym("state", 3), ca.SX.sym("K", 2)
    one = rounder()(random.state_from_seed(1))
    assert (np.array(one.full()) == 1.5 * 2**52).all()
    step = ca.Function("step", [state, K], [advance(state), advance(state, quick_floor(K))])
    numbers = ca.Function("numbers", [state], [uniform(state), whole_below(state, 1, 48)])
    parts = [int(v) for v in random.state_from_seed(7)]
    for _ in range(200):
        expected = [f * v % m for f, v, m in zip(FACTORS, parts, MODULI, strict=True)]
        plain, quick = (np.array(v.full()).ravel() for v in step(parts, one))
        assert (plain == expected).all()
        assert (quick == expected).all()
        u, o = (float(v) for v in numbers(parts))
        assert u == pytest.approx(sum(v / m for v, m in zip(parts, MODULI, strict=True)) % 1)
        assert o == parts[1] * 48 // MODULI[1]
        parts = expected


def test_numbers_are_even_and_independent():
    state = ca.SX.sym("state", 3)
    after = advance(state)
    count, bins = 20_000, 20
    draw = ca.Function("draw", [state], [after, uniform(after)]).mapaccum(count)
    u = np.array(draw(random.state_from_seed(3))[1].full()).ravel()
    assert u.min() >= 0
    assert u.max() < 1
    # chi-square of numbers and of pairs; its mean is the number of cells less one, and five
    # standard deviations sqrt(2 cells) are never passed by a fair generator
    for cells in (np.histogram(u, bins)[0], np.histogram2d(u[:-1], u[1:], bins)[0]):
        expected = cells.sum() / cells.size
        chi = ((cells - expected) ** 2 / expected).sum()
        assert abs(chi - cells.size) < 5 * math.sqrt(2 * cells.size)


@given(st.integers(0, 2**63))
def test_any_seed_gives_a_state(seed):
    state = random.state_from_seed(seed)
    assert all(1 <= v <= m - 1 and v == int(v) for v, m in zip(state, MODULI, strict=True))


def test_seeds_give_states_of_their_own():
    states = {tuple(random.state_from_seed(seed)) for seed in range(2000)}
    assert len(states) == 2000


@pytest.mark.parametrize("seed", [-1, 0.5])
def test_no_such_seed(seed):
    with pytest.raises(BadInput, match=r"seed = .* whole number"):
        random.state_from_seed(seed)


# ---- the algorithm -------------------------------------------------------------------------------


def by_hand(n, crossover, generations, seed, c, a, b, lo=0.01, hi=10.0, F0=0.5):
    """The search in plain Python: whole numbers draw, floats move; returns (rng, best, value)."""
    rng = [int(v) for v in random.state_from_seed(seed)]

    def draw():
        rng[:] = [f * v % m for f, v, m in zip(FACTORS, rng, MODULI, strict=True)]
        return list(rng)

    def mu(v):
        return c * (math.exp(-(a * v)) - math.exp(-(b * v)))

    members = []
    for _ in range(n):
        u = 0.0  # one after the other: since Python 3.12 ``sum`` carries what rounding loses
        for v, m in zip(draw(), MODULI, strict=True):
            u += v * (1 / m)
        members.append(lo + (hi - lo) * (u - math.floor(u)))
    values = [mu(v) for v in members]
    for G in range(1, generations + 1):
        F = float(schedule(float(G), float(generations), F0))
        before = list(zip(members, values, strict=True))
        for i in range(n):
            x, y, z = draw()
            ring = [(i + 1 + k) % n for k in range(n - 1)]  # all the others
            partners = [
                ring.pop(v * len(ring) // m) for v, m in zip((x, y, z), MODULI, strict=True)
            ]
            r, s, t = (before[k][0] for k in partners)
            place = r + F * (s - t)
            if place < lo:
                place = 2 * lo - place
            if place > hi:
                place = 2 * hi - place
            place = max(place, lo)
            trial = x * (n - 1) % MODULI[0] < crossover * MODULI[0]
            if trial and mu(place) >= before[i][1]:
                members[i], values[i] = place, mu(place)
    best = max(range(n), key=values.__getitem__)
    return rng, members[best], values[best]


@pytest.mark.second
@given(
    n=st.integers(4, 23),
    crossover=st.sampled_from([0.0, 0.3, 0.6, 1.0]),
    generations=st.integers(1, 12),
    seed=st.integers(0, 10**6),
    curve=st.tuples(st.floats(0.02, 1), st.floats(0.2, 0.6), st.floats(0.8, 2)),
)
def test_block_is_the_algorithm_bit_for_bit(n, crossover, generations, seed, curve):
    block = search(population=n, crossover=crossover, generations=generations, seed=seed)
    state, y = block(**dict(zip("cab", curve, strict=True)))
    rng, best, value = by_hand(n, crossover, generations, seed, *curve)
    assert state["rng"].tolist() == rng
    assert y == {"best": best, "value": value}


@given(st.integers(1, 400))
def test_factor_falls_from_2_F0_to_F0(generations):
    F = [float(schedule(float(G), float(generations), 0.5)) for G in range(1, generations + 1)]
    assert F[0] == pytest.approx(1.0)
    assert (np.diff(F) <= 0).all()
    if generations > 30:  # 2^exp(1 - Gm) is 1 to rounding
        assert F[-1] == pytest.approx(0.5, rel=1e-12)


def test_the_best_member_is_never_lost():
    block = search(generations_per_tick=1)
    _, y = roll(block, np.tile([DRY[k] for k in block.inputs], (299, 1)), compiled=False)
    assert (np.diff(y[:, 1]) >= 0).all()


def test_200_random_curves_within_1e_6():
    block, rows = search(), random_curves(200)
    assert list(block.inputs) == ["c", "a", "b"]
    true = np.log(rows[:, 2] / rows[:, 1]) / (rows[:, 2] - rows[:, 1])
    assert (true > RANGE["lo"]).all()
    assert (true < RANGE["hi"]).all()
    _, y = roll(block, rows, compiled=build.compiler() is not None)
    # values alone tell places apart down to sqrt(eps mu/|mu''|), some 1e-8 m/s on these curves
    assert np.abs(y[:, 0] - true).max() < 1e-6
    c, a, b = rows.T
    assert y[:, 1] == pytest.approx(c * (np.exp(-a * true) - np.exp(-b * true)), rel=1e-14)


def test_each_search_goes_on_with_the_random_numbers():
    block = search(generations=12)
    rows = np.tile([DRY[k] for k in block.inputs], (2, 1))
    x, y = roll(block, rows, compiled=False)
    assert y[0, 0] != y[1, 0]
    again, second = block(**DRY, rng=x[0])
    assert second["best"] == y[1, 0]
    assert (again["rng"] == x[1]).all()
    assert search(generations=12, seed=2)(**DRY)[1]["best"] != y[0, 0]


def test_peak_at_the_end_of_the_range():
    best = search(lo=2.0)(**DRY)[1]["best"]  # beyond the peak the curve only falls
    assert 2.0 <= best < 2.0 + 1e-6
    best = search(hi=0.5)(**DRY)[1]["best"]
    assert 0.5 - 1e-6 < best <= 0.5


@law(y=Output("1", "height"))
def logarithm(v_s=Input("m/s", "argument"), edge=Param("m/s", 1.0, "NaN below", lo=0)):
    """Height of a law that is not defined all over the range: log(v_s - edge) - v_s + edge."""
    return ca.log(v_s - edge) - v_s + edge


@law(y=Output("1", "height"))
def fenced(v_s=Input("m/s", "argument"), steep=Param("1", 1e6, "slope outside")):
    """Height that gives away whether the law was evaluated outside 3..4."""
    return v_s + steep * (ca.fmax(0, v_s - 4) + ca.fmax(0, 3 - v_s))


def test_a_value_that_is_nan_never_wins():
    y = differential_evolution(logarithm, "v_s", lo=0.0, hi=3.0)(edge=1.0)[1]
    assert y["best"] == pytest.approx(2.0, abs=1e-6)
    spread = differential_evolution(logarithm, "v_s", lo=0.0, hi=3.0, generations_per_tick=1)
    x, _ = roll(spread, np.ones((3, 1)), compiled=False)
    assert np.isfinite(x).all()  # a run stops at a state that is NaN


@pytest.mark.parametrize("F0", [0.5, 2.0])
def test_no_member_leaves_the_range(F0):
    block = differential_evolution(fenced, "v_s", lo=3.0, hi=4.0).with_params(F0=F0)
    y = block(steep=1e6)[1]
    assert 4.0 - 1e-6 < y["value"] <= 4.0


# ---- spread over ticks ---------------------------------------------------------------------------


@pytest.mark.parametrize("per_tick", [1, 4, 12])
def test_spread_over_ticks_it_is_the_same_search(per_tick):
    whole = search(generations=24)
    spread = search(generations=24, generations_per_tick=per_tick)
    ticks = 24 // per_tick
    curves = random_curves(2)
    x, y = roll(spread, np.repeat(curves, ticks, axis=0), compiled=False)
    x_whole, y_whole = roll(whole, curves, compiled=False)
    assert (y[ticks - 1 :: ticks] == y_whole).all()
    assert (x[ticks - 1 :: ticks, :3] == x_whole).all()
    if ticks > 2:  # in the second search the result of the first one is held
        assert (y[ticks : 2 * ticks - 1] == y_whole[0]).all()


def test_a_search_works_on_the_parameters_read_at_its_start():
    spread = search(generations=24, generations_per_tick=6)
    first, other = random_curves(2)
    _, steady = roll(spread, np.tile(first, (4, 1)), compiled=False)
    _, changed = roll(spread, np.vstack([first, other, other, other]), compiled=False)
    assert (steady == changed).all()


def test_ticks_that_do_not_divide_the_search():
    spread = search(generations=60, generations_per_tick=7)
    _, y = roll(spread, np.tile([DRY[k] for k in spread.inputs], (9, 1)), compiled=False)
    assert abs(y[-1, 0] - float(peak_slip(**DRY))) < 1e-6


# ---- in C ----------------------------------------------------------------------------------------


@pytest.mark.second
@pytest.mark.parametrize(
    "options",
    [{}, {"population": 47, "crossover": 1.0}, {"generations_per_tick": 60},
     {"form": "printed-alg1"}],
    ids=["paper", "odd", "spread", "printed"],
)  # fmt: skip
@pytest.mark.others("long")
def test_compiled_gives_the_same_bits(options, needs_compiler):
    block, rows = search(**options), random_curves(30)
    interpreted, compiled = (roll(block, rows, c) for c in (False, True))
    for one, other in zip(interpreted, compiled, strict=True):
        assert one.tobytes() == other.tobytes()


def test_peers_in_c_give_the_same_bits(needs_compiler):
    block, rows = search(seed=5), random_curves(30)
    x, y = roll(block, rows, compiled=True)
    library = peer_library("de")
    for which in (0, 1):
        rng, found = np.array(random.state_from_seed(5)), np.empty((len(rows), 2))
        pointers = [a.ctypes.data_as(ctypes.c_void_p) for a in (rng, rows, found)]
        library.peer_de(which, ctypes.c_long(len(rows)), *pointers)
        assert (rng == x[-1]).all()
        assert found.tobytes() == y.tobytes()


@pytest.mark.long
def test_benchmark_compares_equals(needs_compiler):
    found = bench_de(rounds=1)
    assert found["same_bits"]
    assert found["evaluations"] == 15050
    assert min(found[k]["ratio"] for k in ("ours_vs_c", "scipy_vs_ours")) > 0  # it says how fast


FLOAT_MAIN = """
#include <stdio.h>
int main(void) {
  float x[3] = {RNG}, u[3] = {CURVE}, p[4] = {0.01f, 10.0f, 0.6f, 0.5f}, n[3], y[2];
  static float w[20000];
  static const float* arg[200];
  static float* res[200];
  static long long iw[200];
  arg[0] = x; arg[1] = u; arg[2] = p; res[0] = n; res[1] = y;
  if (differential_evolution(arg, res, iw, w, 0)) return 1;
  printf("%.9g %.9g %.9g %.9g\\n", n[0], n[1], n[2], y[0]);
  return 0;
}
"""


def test_random_numbers_are_the_same_in_single_precision(tmp_path, needs_compiler):
    block = search()
    assert list(block.params) == ["lo", "hi", "crossover", "F0"]
    generator = ca.CodeGenerator("search.c", {"casadi_real": "float"})
    generator.add(block.f)
    start = ", ".join(f"{v:.0f}" for v in random.state_from_seed(1))
    curve = ", ".join(f"{DRY[k]}f" for k in block.inputs)
    text = generator.dump() + FLOAT_MAIN.replace("RNG", start).replace("CURVE", curve)
    (tmp_path / "search.c").write_text(text)
    command = [
        build.compiler(),
        "-O2",
        "-ffp-contract=off",
        "-w",
        "search.c",
        "-o",
        "search",
        "-lm",
    ]
    subprocess.run(command, cwd=tmp_path, check=True)
    said = subprocess.run([tmp_path / "search"], check=True, capture_output=True, text=True).stdout
    *rng, best = (float(v) for v in said.split())
    assert rng == block(**DRY)[0]["rng"].tolist()
    # sqrt(eps mu/|mu''|) of single precision is 1e-3 m/s here
    assert abs(best - float(peak_slip(**DRY))) < 5e-3


# ---- refusals ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"population": 3}, "population = 3 must be a whole number in 4..500"),
        ({"population": "x"}, "population = 'x' must be a whole number in 4..500"),
        ({"population": 10.5}, "population = 10.5"),
        ({"lo": 2.0, "hi": 2.0}, "give lo < hi"),
        ({"hi": math.inf}, "give lo < hi"),
        ({"crossover": 1.1}, "crossover = 1.1 must lie in 0..1"),
        ({"crossover": "x"}, "crossover takes a number, not 'x'"),
        ({"crossover": math.nan}, "crossover = nan"),
        ({"generations": 0}, "generations = 0 must be a whole number >= 1"),
        ({"generations_per_tick": 0}, "generations_per_tick = 0 must be a whole number in 1..300"),
        ({"generations_per_tick": 301}, "generations_per_tick = 301"),
        ({"seed": -4}, "seed = -4"),
        ({"form": "printed"}, "has no form 'printed'; it has consistent, printed-alg1"),
        ({"maximise": "nu"}, "has no output 'nu'; it has mu"),
        ({"over": "v"}, "has no input 'v'"),
    ],
)
def test_refused_in_one_line(options, words):
    over = options.pop("over", "v_s")
    with pytest.raises(BadInput) as error:
        differential_evolution(double_exponential, over, **(RANGE | options))
    assert words in str(error.value)
    assert "\n" not in str(error.value)


@law(y=Output("1", "height"))
def clashing(v_s=Input("m/s", "argument"), lo=Param("m/s", 1.0, "has the name of a setting")):
    return -((v_s - lo) ** 2)


@law(y=Output("1", "height", shape=(2,)))
def of_vectors(v_s=Input("m/s", "argument"), k=Param("m/s", [1.0, 2.0], "vector", shape=(2,))):
    return v_s * k


@pytest.mark.parametrize(
    ("subject", "words"),
    [
        (clashing, "clashing.lo is a name of the search itself; rename it"),
        (of_vectors, "inputs, and what is searched for the best of, must be scalars"),
        (search(), "only a law of scalar expressions can be searched"),
    ],
    ids=["clash", "vectors", "no law"],
)
def test_laws_that_cannot_be_searched(subject, words):
    with pytest.raises(BadInput, match=re.escape(words)):
        search(subject)


@pytest.mark.parametrize("population", [7, 20, 23])
def test_a_peak_is_found_by_populations_of_any_size(population):
    """Less than are drawn at once, twice as many, and some more than that."""

    @law(y=Output("1", "height"))
    def hill(x=Input("1", "place"), r=Input("1", "where it is highest")):
        return ca.exp(-((x - r) ** 2))

    found = differential_evolution(hill, "x", lo=0.0, hi=2.0, population=population, generations=30)
    assert found(r=0.7)[1]["best"] == pytest.approx(0.7, abs=0.01)
