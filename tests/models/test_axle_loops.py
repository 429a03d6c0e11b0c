"""Controllers of a vehicle file as they run: verdicts against the vehicle's own equations."""

from __future__ import annotations

import copy
from fractions import Fraction
from functools import cache
from importlib import resources
from types import SimpleNamespace

import numpy as np
import pytest

from slipctl.certify import certificate, proofs
from slipctl.certify.catalogue import system_of_gains
from slipctl.certify.entries import DoesNotHold
from slipctl.certify.promise import CERTIFIED, REFUTED, exact_numbers
from slipctl.errors import BadInput
from slipctl.models.vehicle import adhesion
from slipctl.models.vehicle.certificate import axle_loops
from slipctl.models.vehicle.plant import on_train
from slipctl.models.vehicle.trip import case
from slipctl.study.files import trip_files

SHIPPED = resources.files("slipctl.models.vehicle") / "files" / "metro.toml"


def asked(tmp_path, *changes):
    """System and numbers of the PID of the shipped file, with changes of its text."""
    text = SHIPPED.read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / "car.toml"
    path.write_text(text, encoding="utf-8")
    trip = trip_files.load_trip(str(path))
    (gains,) = [g for g in axle_loops.certificates(trip).gains if g.loop == "pid"]
    loop = case(trip).loops["pid"]
    system = system_of_gains(gains, loop)
    return system, exact_numbers(system, {k: float(v) for k, v in gains.numbers(loop).items()})


@pytest.mark.second
def test_the_shipped_pid_is_proved_and_a_plain_run_stays_inside(tmp_path):
    """The axle in plain Python, written here, with the worst push of its own linear loop."""
    system, n = asked(tmp_path)
    payload = proofs.write(system, n)
    assert payload["verdict"] == CERTIFIED
    assert "CERTIFIED" in certificate.check(payload)  # without the vehicle
    evidence = payload["proofs"]["sums"]["evidence"]
    proved = float(Fraction(evidence["cells"][0]["box"][0]))
    assert proved <= n["band"]
    far = max(axle(n, float(h)) for h in (n["least"], n["most"]))
    assert far < proved < 1.4 * far
    bad = copy.deepcopy(payload)
    bad["asked"]["W"]["value"] = str(n["W"] * 2)
    with pytest.raises((DoesNotHold, BadInput)):
        certificate.check(bad)


def axle(n, height, J=110.0, r=0.42, M=38e3, c=0.09, tail=0.03, a=0.54, b=1.2, davis=2.65e3):
    """Largest |e| of the PID of Zhang behind a lag and a dead time on exponentials and a tail."""
    K, W, lag = float(n["K"]), float(n["W"]), float(n["lag"])
    late, goal = round(float(n["dead"] / n["T"])), float(n["goal"])

    def curve(s):
        mu = c * (np.exp(-a * s) - np.exp(-b * s)) + tail * (1 - np.exp(-b * s))
        return height * (r * r / J + 4 / M) * M * 9.81 / 4 * mu

    def run(push):
        rest = J / r * (curve(goal) + davis / M)
        s, T, waits, integral, far = goal, rest, [rest] * late, rest, 0.0
        path = []
        for w in push:
            e = s - goal
            cmd = min(max(-K * J / r * e + integral, 0.0), 8e3)
            integral -= 1e-3 * K * K / 4 * J / r * e
            waits.append(cmd)
            s += 1e-3 * (r / J * T - curve(s) - davis / M + w)
            T += (1 - np.exp(-1e-3 / lag)) * (waits.pop(0) - T)
            path.append(s - goal)
            far = max(far, abs(s - goal))
        return far, np.array(path)

    h = run(np.array([1e-3] + [0.0] * 3000))[1]
    signs = np.sign(h[::-1])
    return max(run(W * signs)[0], run(-W * signs)[0])


@pytest.mark.parametrize(("b", "far"), [(1.2, True), (4.0, True), (2.0, False)])
def test_the_rest_is_found_however_far_it_is_from_the_first_guess(tmp_path, b, far):
    """The reference waits while the slip ratio is more than 0.02 off; it begins at 1.21 m/s."""
    system, n = asked(tmp_path, ("s = 0.03 }", f"s = 0.03, b = {b} }}"))
    grid = np.linspace(0.2, 3.0, 28_001)
    mu = 0.09 * (np.exp(-0.54 * grid) - np.exp(-b * grid)) + 0.03 * (1 - np.exp(-b * grid))
    goal = float(n["goal"])
    assert goal == pytest.approx(grid[mu.argmax()], abs=2e-4)
    assert (abs(goal - 1.21) > 0.02 * float(n["v"])) == far
    cell = system.loop.build(n).rest(((n["least"], n["most"]),))
    assert cell.rest[0] == n["goal"]
    middle = float(n["least"] + n["most"]) / 2
    fall = middle * (0.42**2 / 110 + 4 / 38e3) * 38e3 * 9.81 / 4 * mu.max()
    davis = (1.2e3 + 12 * 50 / 3 + 4.5 * (50 / 3) ** 2) / 38e3
    assert float(cell.rest[1]) == pytest.approx(110 / 0.42 * (fall + davis), rel=1e-6)


@pytest.mark.second
def test_a_draw_is_a_height_only_where_it_multiplies_the_whole_curve(tmp_path):
    """c alone leaves the tail as it is, so that the peak moves; a factor of 1 shows nothing."""
    both, c = "plant.train.adh.c, plant.train.adh.s", "plant.train.adh.c"
    masses = [(0.42**2 / 110 + 4 / m) * m for m in (34e3, 38e3, 42e3)]
    least, most = masses[0] / masses[1], masses[2] / masses[1]
    for changes, low, high in (
        ([], 0.8, 1.2), ([(both, c)], 1.0, 1.0), ([(both, c), ("0.8:1.2", "0.8:1")], 1.0, 1.0),
        ([(both, c), ("exponential_tail", "double_exponential"), (", s = 0.03", "")], 0.8, 1.2),
    ):  # fmt: skip
        _, n = asked(tmp_path, *changes)
        found = float(n["least"]), float(n["most"])
        assert found == pytest.approx((least * low, most * high), rel=1e-9)


def test_the_pid_as_it_was_shipped_is_refuted_by_a_run(tmp_path):
    """K = 100 1/s is unstable behind 60 ms and 20 ms; without them it is not."""
    system, n = asked(tmp_path, ('K = "10 1/s"', 'K = "100 1/s"'))
    payload = proofs.write(system, n)
    assert payload["verdict"] == REFUTED
    assert "replayed" in certificate.check(payload)
    assert system.loop.why[0].startswith(
        "at rest the loop is unstable: its spectral radius is 1.01"
    )
    bad = copy.deepcopy(payload)
    bad["counterexample"]["run"]["signs"] = bad["counterexample"]["run"]["signs"][:20]
    with pytest.raises(DoesNotHold):
        certificate.check(bad)


@pytest.mark.long
def test_more_push_lag_or_dead_time_is_never_easier(tmp_path):
    """Half-widths that are proved grow with each of them."""
    from slipctl.certify.smooth.sums import Bounds, find_cell

    system, n = asked(tmp_path)
    cell = (n["least"], n["most"])
    for name, values in (("W", (0.1, 0.2)), ("dead", (0.01, 0.02)), ("lag", (0.04, 0.06))):
        widths = []
        for value in values:
            now = {**n, name: Fraction(str(value))}
            built = system.loop.build(now)
            bounds = Bounds((now["W"], Fraction(0), Fraction(0)), (Fraction(0),) * len(
                built.loop.states))  # fmt: skip
            widths.append(find_cell(built.loop, built.rest((cell,)), bounds)[1][0])
        assert widths == sorted(widths)


@pytest.mark.long
def test_a_dead_time_of_few_ticks_is_asked_and_another_sample_time_refused(tmp_path):
    """A tick waits in one state; the block has its sample time inside."""
    for dead, states in (("0 ms", 0), ("1 ms", 1), ("2 ms", 2)):
        system, n = asked(tmp_path, ('dead_time = "20 ms"', f'dead_time = "{dead}"'))
        built = system.loop.build(n)
        assert sum(s.startswith("q") for s in built.loop.states) == states
        assert proofs.write(system, n)["verdict"] == CERTIFIED
    with pytest.raises(BadInput, match="sample time"):
        system.loop.build({**n, "T": Fraction(1, 500)})


def test_a_rail_on_which_the_demand_rules_has_no_certificate(tmp_path):
    """On dry rail 1.2 m/s^2 needs less than the rail carries."""
    text = SHIPPED.read_text(encoding="utf-8").replace('condition = "leaves"', 'condition = "dry"')
    path = tmp_path / "dry.toml"
    path.write_text(text, encoding="utf-8")
    trip = trip_files.load_trip(str(path))
    assert not axle_loops.certificates(trip).gains
    assert "never rules" in axle_loops.certificates(trip).uncertified["pid"]


def test_a_draw_that_leaves_the_range_of_the_law_refuses_no_run(tmp_path):
    """The loops are made and the reason is told; without the draw the refusal is the file's own."""
    from slipctl.models.vehicle.study import study

    text = SHIPPED.read_text(encoding="utf-8")
    scale = '[ensemble.scale]\nadhesion = "0.5:1.2 of plant.train.adh.c"\n'
    head, tail = text[: text.index("[ensemble]")], text[text.index("[controllers.none]") :]
    found = {}
    for name, low in (("inside", "0.1"), ("beyond", "0.0011")):
        path = tmp_path / f"{name}.toml"
        changed = head.replace("leaves = { c = 0.09", f"leaves = {{ c = {low}")
        assert changed != head
        path.write_text(changed + scale + tail, encoding="utf-8")
        found[name] = study(trip_files.load_trip(str(path)))
        assert set(found[name].cases(None, True)[0].loops) >= {"none", "pid"}
    assert any(g.loop == "pid" for g in found["inside"].certificates.gains)
    assert not any(g.loop == "pid" for g in found["beyond"].certificates.gains)
    why = found["beyond"].certificates.uncertified["pid"]
    assert "[ensemble] draws what the rail's law does not know" in why


@pytest.mark.parametrize(("inputs", "hears"), [
    (["v", "F"], True), (["axle1.D", "v"], True), (["F.v", "D.omega"], False), (["v"], False),
])  # fmt: skip
def test_a_law_hears_the_force_that_is_an_input_of_its_own_or_of_a_part(inputs, hears):
    assert axle_loops.hears_force(SimpleNamespace(inputs=dict.fromkeys(inputs))) == hears


# ---- a slide protection behind the valves of an air brake ----------------------------------------


class Told:
    """A loop of which only numbers by place are asked."""

    def __init__(self, **more):
        self.numbers = {"plant.train.m": 96e3, "plant.train.J": 100.0, "plant.train.r": 0.46,
                        "plant.train.g": 9.81, **more}  # fmt: skip

    def values_by_place(self):
        return self.numbers


def valves(tmp_path, *changes):
    """What is asked of the slide protection of the shipped unit, with changes of its text."""
    text = (SHIPPED.parent / "emu.toml").read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / "emu.toml"
    path.write_text(text, encoding="utf-8")
    trip = trip_files.load_trip(str(path))
    return trip, axle_loops._AskedValves(trip, trip.controllers["wsp"])


TOP = 140 / 3.6
"""Speed of the unit in m/s."""

SLIPS = np.append(np.geomspace(axle_loops.S_1, TOP, 9)[:-1], TOP)

WHEEL = {"m": 96e3, "J": 100.0, "r": 0.46, "g": 9.81}


@cache
def top_of(law):
    """Largest adhesion of a curve, closer and closer about its top."""
    low, high = 1e-3, TOP
    for _ in range(3):
        slips = np.geomspace(low, high, 24)
        mu = [float(law(v_s=s, v=TOP)["mu"]) for s in slips]
        at = int(np.argmax(mu))
        low, high = slips[max(at - 1, 0)], slips[min(at + 1, len(slips) - 1)]
    return max(mu)


def falls_at(law, peak=None, m=96e3, n=8, worked=8, r=0.46, J=100.0):
    """What the slip of an axle falls by at slips, in m/s^2, of one or of all worked axles."""
    mu = np.array([float(law(v_s=s, v=TOP)["mu"]) for s in SLIPS])
    if peak is not None:
        mu *= peak / top_of(law)
    return (r**2 / J + worked / m) * mu * m * 9.81 / n


def sampled(block, output, over, gap, **at):
    """Ends of an output at some slips, in the place of an enclosure."""
    assert over == {"v_s": (axle_loops.S_1, TOP)}
    found = [float(block(v_s=s, **at)[output]) for s in SLIPS]
    return min(found), max(found)


@pytest.fixture
def quick(monkeypatch):
    """Bounds at some slips instead of proven ones."""
    monkeypatch.setattr(axle_loops, "enclosure", sampled)


@pytest.fixture
def known(monkeypatch):
    """What the slip falls by at least and most, told."""
    monkeypatch.setattr(axle_loops._AskedValves, "_enclosed", lambda self, n: (4.0, 64.0))


TWO_CARS = (
    '[[vehicle.cars]]                         # or mass, axles and places of the whole vehicle\n'
    'count = 2\nmass = "48 t"',
    '[[vehicle.cars]]\ncount = 1\nmass = "40 t"\nlength = "20 m"\nbogie_centres = "14 m"\n'
    'wheelbase = "2.5 m"\n[[vehicle.cars]]\ncount = 1\nmass = "56 t"',
)  # fmt: skip
DRAWS = (
    'draw = { m = "88 t:104 t" }',
    'draw = { m = "88 t:104 t" }\nscale = { peak = "0.7:1.25 of plant.train.adh.mu_0" }',
)
WET = (
    'dry = { mu_0 = 0.3, A = 0.4, B = "0.3 s/m" }',
    'dry = { mu_0 = 0.3, A = 0.4, B = "0.3 s/m" }\nwet = { mu_0 = 0.16, A = 0.4, B = "0.2 s/m" }',
)
PLACE = (
    'places = [{ from = "150 m", to = "350 m" }]',
    'places = [{ from = "150 m", to = "350 m", peak = 0.03 }, { from = "1 m", to = "2 m" }]',
)
PATCHES = ("seeds = true",
           'seeds = true\npatches = { number = [1, 2], length = ["5 m", "9 m"], peak = [0.02, 0.4],'
           ' from = "0 m", to = "100 m" }')  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "peaks", "masses", "scales", "loads"),
    [
        ((), (0.05,), (88e3, 104e3), (1, 1), (1, 1)),
        ((DRAWS, WET), (0.05,), (88e3, 104e3), (0.7, 1.25), (1, 1)),
        ((PLACE,), (0.03, 0.05), (88e3, 104e3), (1, 1), (1, 1)),
        ((PATCHES,), (0.05, 0.02, 0.4), (88e3, 104e3), (1, 1), (1, 1)),
        (((DRAWS[0], ""), TWO_CARS), (0.05,), (96e3,), (1, 1), (40 / 48, 56 / 48)),
        ((("peak = 0.05", ""), WET), (None,), (88e3, 104e3), (1, 1), (1, 1)),
    ],
)  # fmt: skip
def test_the_adhesion_behind_valves_is_that_of_every_rail_layer_and_load(
    tmp_path, quick, changes, peaks, masses, scales, loads
):
    """Least: the weakest curve, of one axle alone. Largest: the strongest, of all axles at once."""
    trip, asked_of = valves(tmp_path, *changes)
    clean, layer = adhesion.rail_law(trip), adhesion.layer_law(trip, trip.rail.contamination)
    curves = [(on_train(clean.with_params(**values)), None) for values in clean.conditions.values()]
    curves += [(on_train(layer), peak) for peak in peaks]
    least = min(falls_at(c, p, m=m, worked=1).min() for c, p in curves for m in masses)
    most = max(falls_at(c, p, m=m).max() for c, p in curves for m in masses)
    low, high = asked_of._falls(WHEEL)
    assert low == pytest.approx(least * scales[0] * loads[0], rel=1e-4)
    assert high == pytest.approx(most * scales[1] * loads[1], rel=1e-4)


@pytest.mark.second
def test_a_proven_range_of_adhesion_holds_that_of_slips(tmp_path):
    """And is hardly wider."""
    _, asked_of = valves(tmp_path)
    low, high = asked_of._falls(WHEEL)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(axle_loops, "enclosure", sampled)
        least, most = asked_of._enclosed(WHEEL)
    assert least - 0.02 * (most - least) <= low <= least
    assert most <= high <= 1.2 * most  # of so few slips none is at the top


def test_what_the_slip_falls_by_is_asked_once_for_its_numbers(tmp_path, monkeypatch):
    _, asked_of = valves(tmp_path)
    seen = []
    monkeypatch.setattr(asked_of, "_enclosed", lambda n: seen.append(n) or (n["m"], 9.0))
    assert asked_of._falls(WHEEL) == (96e3, 9.0)
    assert asked_of._falls(dict(reversed(WHEEL.items()))) == (96e3, 9.0)
    assert asked_of._falls({**WHEEL, "m": 90e3}) == (90e3, 9.0)
    assert len(seen) == 2


SLOW = ('deceleration = "1.0 m/s^2"', 'deceleration = "0.5 m/s^2"')
TORQUE = 0.46 * 104e3 * 0.5 / 8 + 100 * 0.5 / 0.46
"""Of the heaviest unit, that slows down by half as much as in the file."""


def test_numbers_behind_valves_are_those_of_the_file(tmp_path, known):
    """Resistance and gradient of the lightest, the torque of the heaviest that the brake takes."""
    push = ("[controllers.none]", '[certify]\npush = "0.25 m/s^2"\n[controllers.none]')
    _, asked_of = valves(tmp_path, SLOW, push)
    found = asked_of.numbers(Told())
    davis = (12 * 96 + 0.02 * 96 * TOP**2) / 88e3
    assert found.pop("W") == pytest.approx(0.25 + davis + 0.015 * 9.81)
    assert found.pop("least") == 4 / 64
    assert found.pop("demand") == pytest.approx(TORQUE)
    assert found == {"noise": 0.0, "dead": 0.06, "T": 0.01, "most": 1.0, "v": pytest.approx(TOP),
                     "band": pytest.approx(TOP)}  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "demand", "band"),
    [
        ((), 6e3, TOP),
        ((('deceleration = "1.0 m/s^2"', 'force = "80 kN"'),), 0.46 * 80e3 / 8, TOP),
        ((SLOW, ("[limits]", '[certify]\nslip = "5 m/s"\n[limits]')), TORQUE, 5.0),
    ],
)  # fmt: skip
def test_torque_and_slip_behind_valves_are_what_is_asked(tmp_path, known, changes, demand, band):
    found = valves(tmp_path, *changes)[1].numbers(Told())
    assert found["demand"] == pytest.approx(demand)
    assert found["band"] == pytest.approx(band)


def test_a_brake_that_weighs_brakes_the_lightest_as_the_heaviest(tmp_path, known):
    """A lighter unit that is taken for one of 110 t brakes by as much more; none brakes less."""
    for weighed, share in (("110 t", 110 / 88), ("80 t", 1.0)):
        changes = ('pulse = "20 ms"', f'weighed = "{weighed}"\npulse = "20 ms"')
        found = valves(tmp_path, SLOW, changes)[1].numbers(Told())
        assert found["demand"] == pytest.approx(TORQUE * share)


def test_a_loop_behind_valves_is_made_once_for_its_numbers(tmp_path, known, monkeypatch):
    """Of the machine and the filter as the loop has them; the band makes no other loop."""
    trip, asked_of = valves(tmp_path)
    made = []

    def noted(machine, axle, n):
        made.append((machine, axle, dict(n)))
        return object()

    monkeypatch.setattr(axle_loops, "air_loop", noted)
    own = axle_loops.slide_protection(trip, trip.controllers["wsp"], axle_loops.wheel(trip))
    machine = own[0]["machine"]
    name = next(iter(machine.params))
    value = float(machine.param_values()[name])
    place = f"ctl.machine.{name}"
    told = Told(**{place: np.array([value * 1.01, value * 1.02]), "ctl.rim.T_f": 0.07})
    system = asked_of.system(told)
    n = {"T": Fraction(1, 100), "dead": Fraction(6, 100), "W": Fraction(1, 2)}
    first = system.loop.build({**n, "band": Fraction(9)})
    assert system.loop.build({**n, "band": Fraction(8)}) is first
    assert system.loop.build(n) is first
    assert system.loop.build({**n, "W": Fraction(1)}) is not first
    assert len(made) == 2
    machine_, axle, numbers = made[0]
    assert numbers["W"] == Fraction(1, 2)
    assert made[1][2]["W"] == 1
    assert axle.lever == pytest.approx(0.46 / 100)
    assert (axle.T_f, axle.s_1) == (0.07, axle_loops.S_1)
    assert axle.peak == 64.0
    assert axle.brake is trip.actuator
    values = machine_.param_values()
    assert float(values[name]) == pytest.approx(value * 1.02)
    before = {k: float(v) for k, v in machine.param_values().items() if k != name}
    derived = {k for k, p in machine.params.items() if p.derived}
    assert {k: float(v) for k, v in values.items() if k in before and k not in derived} == {
        k: v for k, v in before.items() if k not in derived
    }
    made.clear()
    other = asked_of.system(Told())
    other.loop.build(n)
    assert made[0][1].T_f == trip.controllers["wsp"].filter
    assert float(made[0][0].param_values()[name]) == pytest.approx(value)


def test_what_is_asked_behind_valves_is_said(tmp_path):
    """The speed, the push, and whether a locked wheel or a slip is the bound."""
    said = valves(tmp_path)[1].words()
    assert "140 km/h" in said
    assert "locks" in said
    said = valves(tmp_path, ("[limits]", '[certify]\nslip = "5 m/s"\n[limits]'))[1].words()
    assert "locks" not in said


def test_a_slide_protection_is_asked_behind_air_alone(tmp_path):
    """Load that moves between axles and pads whose friction changes have a reason instead."""
    trip, _ = valves(tmp_path)
    part = trip.controllers["wsp"]
    assert axle_loops.is_asked(trip, part)
    (one,), why = axle_loops._on_rails(trip, part)
    assert isinstance(one, axle_loops._AskedValves)
    assert one.rail == "any"
    assert why == ""
    moved, _ = valves(tmp_path, ('length = "20 m"', 'length = "20 m"\nheight = "1.6 m"'))
    some, why = axle_loops._on_rails(moved, part)
    assert (list(some), bool(why)) == ([], True)
    found = axle_loops.certificates(moved, of=(axle_loops.SlideProtection,))
    assert list(found.gains) == []
    assert list(found.uncertified) == ["wsp"]
    found = axle_loops.certificates(trip, of=(axle_loops.SlideProtection,))
    assert [(g.name, g.loop, g.system) for g in found.gains] == [("wsp", "wsp", "slide_loop")]
    assert found.uncertified == {}
