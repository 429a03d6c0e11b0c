"""Controllers of a vehicle file as they run: verdicts against the vehicle's own equations."""

from __future__ import annotations

import copy
from fractions import Fraction
from importlib import resources
from types import SimpleNamespace

import numpy as np
import pytest

from slipctl.certify import certificate, proofs
from slipctl.certify.catalogue import system_of_gains
from slipctl.certify.entries import DoesNotHold
from slipctl.certify.promise import CERTIFIED, REFUTED, exact_numbers
from slipctl.errors import BadInput
from slipctl.models.vehicle.certificate import axle_loops
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
