"""Searches, meshes and slopes of predictive control, of problems that are written here."""

from __future__ import annotations

import math
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from slipctl import BadInput, Input, Output, Param, State, control_slopes, step
from slipctl.errors import RunFailed
from slipctl.estimate import peak
from slipctl.predict import trajectory as trajectories
from slipctl.predict.options import region
from slipctl.predict.qp.active_set import ActiveSet
from slipctl.run.measures import measured_run

# ---- regions -------------------------------------------------------------------------------------


@pytest.fixture
def search():
    """A search in two dimensions whose functions are given."""
    made = object.__new__(region._Search)
    made.L, made.boxes, made.where = np.eye(2), 0, "here"
    angles = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    made.rays = np.array([np.cos(angles), np.sin(angles)])
    return made


def below(radius):
    """Upper bound over boxes of |w|^2 - radius^2: negative within a radius."""
    return lambda low, high: np.maximum(low**2, high**2).sum(axis=0) - radius**2


def beyond(radius):
    """Upper bound of radius^2 - |w|^2: negative outside."""

    def bound(low, high):
        nearest = np.maximum(np.maximum(low, -high), 0)
        return radius**2 - (nearest**2).sum(axis=0)

    return bound


@pytest.mark.parametrize(
    ("bound", "inner", "outer", "holds"),
    [
        (below(1.0), 0.0, 0.98, True), (below(1.0), 0.0, 1.02, False),
        (below(1.0), 0.5, 0.98, True),
        (beyond(1.0), 1.02, 3.0, True), (beyond(1.0), 0.98, 3.0, False),
        (beyond(1.0), 0.0, 3.0, False), (lambda a, b: -np.ones(a.shape[1]), 0.0, 1.0, True),
        (lambda a, b: np.zeros(a.shape[1]), 0.0, 1.0, False),
    ],
)  # fmt: skip
def test_a_bound_is_negative_over_a_ring_where_it_is(search, bound, inner, outer, holds):
    assert search._holds(bound, inner, outer) == holds
    assert search.boxes > 0


def test_a_bound_that_takes_too_many_boxes_is_not_proved(search, monkeypatch):
    monkeypatch.setattr(region, "BOXES", 40)
    assert not search._holds(below(1.0), 0.0, 0.98)
    assert search.boxes > 40
    assert search._holds(below(1.0), 0.0, 0.5)


@pytest.mark.parametrize("radius", [0.3, 1.0, 4.0])
def test_the_largest_radius_is_near_to_where_a_bound_turns(search, radius):
    """From 0 on, or from an inner radius where it holds; the whole where it holds there."""
    found = search._largest(below(radius), 0.0, 5.0)
    assert 0.9 * radius <= found <= radius
    assert search._largest(below(radius), 0.0, radius / 2) == radius / 2
    assert search._largest(below(radius), 2 * radius, 3 * radius) == 2 * radius
    assert search._largest(lambda a, b: np.ones(a.shape[1]), 0.0, 1.0) == 0.0


@pytest.mark.parametrize("bent", [False, True])
@pytest.mark.parametrize(("near", "falls"), [(1.0, 1.0), (0.5, 1.0), (0.0, 1.0)])
def test_a_region_is_as_large_as_each_of_its_bounds(search, monkeypatch, bent, near, falls):
    """Limits that bend come first, then contraction about the rest, then V beyond it."""
    asked = []
    search.edge, search.bent = 2.0, bent
    names = {"_within": 0.75, "_contracts": near, "_falls": falls}
    for name in names:
        setattr(search, name, name)

    def largest(bound, inner, outer):
        asked.append((bound, inner, outer))
        return max(inner, min(names[bound], outer))

    search._largest = largest
    search._beyond = lambda r: (3.0, np.array([3.0, 0.0]), "why")
    search._state = lambda w: {"w": float(w[0])}
    search._law = lambda P, level: ("LAW", level)
    if near == 0:
        with pytest.raises(BadInput):
            search.region()
        return
    found = tuple(vars(search.region()).values())
    edge = 0.75 if bent else 2 * (1 - region.ROOM)
    inner = min(near, edge)
    r = min(falls, edge)
    assert found[2] == r * r
    assert found[3] == inner**2
    assert found[4] == 9
    assert found[-1] == ("LAW", r * r)
    wanted = [("_within", 0.0, 2 * (1 - region.ROOM))] if bent else []
    wanted += [("_contracts", 0.0, edge)]
    wanted += [("_falls", inner, edge)] if inner < edge else []
    assert asked == wanted


def test_a_state_is_inside_up_to_the_level_of_its_ellipsoid(search):
    @step(y=Output("1", "nothing"))
    def model(a=State("m", 0.0, "place"), b=State("m/s", 0.0, "speed")):
        """Two states."""
        return dict(a=a, b=b), dict(y=a)

    search.names, search.rest = ["a", "b"], np.array([1.0, -2.0])
    search.s = SimpleNamespace(horizon=SimpleNamespace(model=model))
    P = np.array([[2.0, 0.5], [0.5, 1.0]])
    block = search._law(P, 4.0)
    for at in ((1.0, -2.0), (2.0, -2.0), (1.0, 0.0), (0.0, -3.0), (3.0, 1.0)):
        e = np.array(at) - search.rest
        assert float(block(a=at[0], b=at[1])["inside"]) == pytest.approx(e @ P @ e / 4)


# ---- trajectories --------------------------------------------------------------------------------


@pytest.fixture
def problem(monkeypatch):
    """A problem whose solutions are told, by guess and mesh."""
    asked = []
    values: dict[tuple, float | None] = {}

    class Problem:
        phases, sign, unit = [1, 2], -1.0, "m"

        def __init__(self, *given):
            asked.append(("made", given))

        def scale_by(self, guesses):
            asked.append(("scale", tuple(guesses)))

        def guess(self, log):
            return f"of {log}"

        def solve(self, n, guess):
            asked.append(("solve", n, guess))
            value = values[n, guess]
            return None if value is None else (value, f"{n} {guess}")

        def log(self, solution):
            return f"log of {solution}"

    monkeypatch.setattr(trajectories, "_Problem", Problem)

    def run(guesses=(), tolerance=0.1, meshes=4, intervals=8):
        plant = SimpleNamespace(name="car")
        return trajectories.trajectory(
            plant, "SCENARIO", "u", minimise="x", bounds=None, limits=None, end=None,
            guesses=guesses, intervals=intervals, tolerance=tolerance, meshes=meshes,
        )  # fmt: skip

    return SimpleNamespace(run=run, values=values, asked=asked)


def test_the_best_of_all_guesses_is_refined_until_it_rests(problem):
    problem.values.update({
        (8, "of a"): 5.0, (8, "of b"): 3.0, (8, "of c"): None, (16, "8 of b"): 2.0,
        (32, "16 8 of b"): 1.95,
    })  # fmt: skip
    found = problem.run(guesses=("a", "b", "c"))
    assert found[0] == -1.95
    assert found[1] == "m"
    assert found[2] == "log of 32 16 8 of b"
    assert found[3] == ((16, -3.0), (32, -2.0), (64, -1.95))
    assert found[4][:2] == (-5.0, -3.0)
    assert math.isnan(found[4][2])
    assert problem.asked[1] == ("scale", ("a", "b", "c"))
    assert [a[1:] for a in problem.asked if a[0] == "solve"] == [
        (8, "of a"), (8, "of b"), (8, "of c"), (16, "8 of b"), (32, "16 8 of b")]  # fmt: skip


def test_without_a_guess_the_plant_at_rest_is_one(problem):
    problem.values.update({(8, "of None"): 5.0, (16, "8 of None"): 5.1})
    assert problem.run()[0] == -5.1
    assert problem.run(tolerance=0.1000001)[3] == ((16, -5.0), (32, -5.1))


def test_a_trajectory_that_does_not_rest_is_refused(problem):
    problem.values.update({(8, "of None"): None})
    with pytest.raises(RunFailed, match="1 guesses"):
        problem.run()
    problem.values.update({(8, "of None"): 5.0, (16, "8 of None"): None})
    with pytest.raises(RunFailed, match="16 intervals"):
        problem.run()
    problem.values.update({(16, "8 of None"): 4.0, (32, "16 8 of None"): 3.5})
    with pytest.raises(RunFailed, match=r"0\.5 m"):
        problem.run(meshes=3)
    with pytest.raises(RunFailed):
        problem.run(meshes=1)


# ---- slopes of a tick ----------------------------------------------------------------------------


def controller(status=0.0, jump=0.0):
    @step(y=Output("1", "command"), status=Output("1", "status"))
    def block(x=State("1", 2.0, "sum"), u=Input("1", "error"), w=Input("1", "list", shape=(2,)),
              k=Param("1", 3.0, "gain"), c=Param("1", 1.0, "offset")):  # fmt: skip
        """A square."""
        cut = jump * ca.floor(u)
        return dict(x=x + u), dict(y=k * u**2 + c * x + w[0] + cut, status=status + 0 * u)

    return block


POINT = {"u": 1.5, "w": [0.25, 0.5], "x": 2.0}


def test_slopes_of_a_tick_are_its_derivatives():
    found = control_slopes(controller(), ["u", "k", "c"], **POINT)
    assert found.of["y"] == pytest.approx({"u": 2 * 3 * 1.5, "k": 1.5**2, "c": 2.0})
    assert found.doubtful == ()
    assert max(found.apart.values()) < 1e-6
    one = control_slopes(controller(), "u", **POINT, k=5.0)
    assert one.of["y"] == pytest.approx({"u": 2 * 5 * 1.5})


def test_slopes_of_what_is_no_number_or_jumps_are_refused():
    for name in ("w", "x", "never", "y"):
        with pytest.raises(BadInput, match=name):
            control_slopes(controller(), name, **POINT)
    with pytest.raises(BadInput, match="status 2"):
        control_slopes(controller(status=2.0), "u", **POINT)
    with pytest.raises(BadInput, match="jumps"):
        control_slopes(controller(jump=1.0), "u", **{**POINT, "u": 2.0})
    assert control_slopes(controller(jump=1.0), "u", **POINT).of["y"]["u"] == pytest.approx(9)


# ---- small ones ----------------------------------------------------------------------------------


def test_passes_are_made_one_by_one_where_they_are_exact():
    made = SimpleNamespace(exactly=True, _once=lambda z, *data: z * 2 + data[0])
    assert ActiveSet.passed(made, 1, 3, (5,)) == ((1 * 2 + 5) * 2 + 5) * 2 + 5
    assert ActiveSet.passed(made, 1, 0, (5,)) == 1
    told = []
    made = SimpleNamespace(exactly=False, _passing=lambda *a, **k: told.append((a, k)) or "DONE")
    assert ActiveSet.passed(made, 1, 3, (5,), True) == "DONE"
    assert told == [((3, 1, 5), {"begun": True})]


def test_a_function_of_a_run_enters_a_table_by_its_name():
    table = {}
    metric = measured_run.entry(table)

    @metric("how far", "less", ("speed",), event=True)
    def _distance(run):
        return run

    @metric("how much")
    def slip(run):
        return run

    assert list(table) == ["distance", "slip"]
    one, two = table.values()
    assert tuple(vars(one).values()) == (_distance, "how far", "less", ("speed",), True, False)
    assert tuple(vars(two).values()) == (slip, "how much", "", (), False, False)
    assert slip(3) == 3


@pytest.mark.parametrize("seed", range(4))
def test_a_deviation_is_that_of_the_inverse_information(seed):
    """sqrt(g I^-1 g'); infinite where nothing is known along g, and of the rest where it is."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(5, 3)) * np.array([1.0, 1e6, 1e-6])
    g = rng.normal(size=3) * np.array([1.0, 1e6, 1e-6])
    information = root.T @ root
    scale = np.sqrt(np.diag(information))
    scaled = information / np.outer(scale, scale)
    exact = math.sqrt((g / scale) @ np.linalg.solve(scaled, g / scale))
    assert peak._deviation(g, root) == pytest.approx(exact, rel=1e-9)
    blind = np.column_stack([root, np.zeros(5)])
    assert peak._deviation(np.append(g, 0.0), blind) == pytest.approx(exact, rel=1e-9)
    assert peak._deviation(np.append(g, 1.0), blind) == math.inf
    twice = np.column_stack([root, root[:, 0]])  # only the sum of two is seen
    assert peak._deviation(np.array([1.0, 0, 0, 1.0]), twice) == pytest.approx(
        peak._deviation(np.array([1.0, 0, 0]), root), rel=1e-6)  # fmt: skip
    assert peak._deviation(np.array([1.0, 0, 0, -1.0]), twice) == math.inf


def test_numbers_of_a_probe_that_looks_are_three_more():
    for looks, many in ((False, 5), (True, 8)):
        found = peak._probe_numbers("m/s", 0.5, 3.0, looks)
        assert len(found) == many
        by_name = {s.name: s for s in found}
        assert (by_name["lowest"].value, by_name["highest"].value) == (0.5, 3.0)
        assert by_name["lowest"].unit == by_name["highest"].unit == "m/s"
        assert ("again" in by_name) == looks
        for s in found:
            assert s.lo <= s.value <= s.hi
            assert s.check(s.name, s.value) == s.value
            with pytest.raises(BadInput):
                s.check(s.name, s.hi * 2 + 1)
