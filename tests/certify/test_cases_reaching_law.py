"""Cases 1 and 2 of the outside attack: the reaching law with a disturbance, a lag, any orbit."""

from fractions import Fraction

import numpy as np
import pytest

from slipctl.certify import catalogue, proofs
from slipctl.certify.entries import DoesNotHold
from slipctl.errors import BadInput
from slipctl.models.huang_2020.certificate import relay_proof, relay_sets

F = Fraction
SYSTEM = catalogue.system("reaching_law")


def written(text):
    numbers = {k: F(v) for k, v in (part.split("=") for part in text.split())}
    payload = proofs.write(SYSTEM, numbers)
    assert set(numbers) <= set(payload["asked"])
    proofs.check(SYSTEM, payload)
    return payload


@pytest.mark.parametrize(("asked", "verdict"), [
    ("g1=36 g2=12 T=.001 D=11 band=.0062", "REFUTED"),  # constant d = D gives 22.9 mm/s
    ("g1=36 g2=12 T=.001 D=11 band=.0229", "REFUTED"),
    ("g1=36 g2=12 T=.001 D=11 band=.023", "CERTIFIED"),
    ("g1=36 g2=12 T=.001 D=2.62 band=.0062", "REFUTED"),
    ("g1=36 g2=12 T=.001 D=2.62 band=.0147", "CERTIFIED"),
    ("g1=36 g2=12 T=.001 D=13 band=.1", "CERTIFIED"),  # |s| <= 27.8 mm/s
    ("g1=36 g2=12 T=.001 D=13 band=.0277", "REFUTED"),
    ("g1=66 g2=12 T=.016 lag=.0563 band=.19", "REFUTED"),
    ("g1=66 g2=12 T=.016 lag=.0563 band=.307", "REFUTED"),
    ("g1=66 g2=12 T=.016 lag=.0563 band=.46", "CERTIFIED"),
    ("g1=36 g2=12 T=.001 lag=.0042 band=.0125", "REFUTED"),
    ("g1=36 g2=12 T=.001 lag=.0042 band=.01403", "REFUTED"),
    ("g1=36 g2=12 T=.001 lag=.0042 band=.0165", "CERTIFIED"),
    ("g1=0 g2=12 T=.001 lag=.0042 band=.0061", "REFUTED"),  # 9 mm/s never decays
    ("g1=0 g2=12 T=.001 lag=.0042 band=.0135", "REFUTED"),
    ("g1=0 g2=12 T=.001 lag=.0042 D=3 band=.03", "REFUTED"),
    ("g1=0 g2=12 T=.001 lag=.0042 band=.0165", "CERTIFIED"),
    ("g1=36 g2=12 T=1e-9 lag=.02 band=.0001", "UNDECIDED"),  # lag/T = 2e7: no wrong word
    ("g1=0 g2=12 T=.001 D=12", "REFUTED"),
    ("g1=0 g2=12 T=.001 band=.0061", "REFUTED"),  # 9 mm/s and -3 mm/s in turn, for ever
    ("g1=0 g2=12 T=.001 band=.012", "CERTIFIED"),
    ("g1=3000 g2=12 T=.001 lag=.001", "REFUTED"),
])  # fmt: skip
def test_cases(asked, verdict):
    payload = written(asked)
    assert payload["verdict"] == verdict
    assert payload["time"] == "as sampled"


def swing(g1, g2, T, D, d):
    s, out = 1e-12, 0.0
    for i in range(5000):
        s += T * (-g1 * s - g2 * np.sign(s) + d(s))
        out = max(out, abs(s)) if i > 4000 else 0.0
    return out


def test_largest_s_without_a_lag_is_reached():
    """Constant and alternating d come to what the closed form says, where it says they do."""
    for g1, g2, T, D in ((36, 12, 1e-3, 0.1), (800, 12, 1e-3, 5), (36, 12, 1e-3, 13)):
        most = relay_proof.no_lag_band(g1, g2, T, D)
        assert swing(g1, g2, T, D, lambda s, D=D: D) == pytest.approx(most, rel=1e-6)
    most = relay_proof.no_lag_band(1500, 12, 1e-3, 5)
    assert swing(1500, 12, 1e-3, 5, lambda s: -5 * np.sign(s)) == pytest.approx(most, rel=1e-6)


@pytest.mark.parametrize(
    "gains",
    [
        ("36", "12", ".001", ".0042", "3"),
        ("0", "12", ".001", ".0042", "0"),
        ("66", "12", ".016", ".0563", "4"),
        ("5", "1", ".5", ".1", "2"),
    ],
)
def test_polygons_hold_points(gains):
    """Random runs that start in the polygon stay in what is computed of it, tick after tick."""
    law = relay_sets.Relay(*map(F, gains))
    start = relay_sets.find(law)
    assert start.holds()
    ticker = relay_sets.Ticker(start)
    rng = np.random.default_rng(4)
    corners = np.array([[float(x) for x in p] for p in start.corners])
    weights = rng.dirichlet(np.full(len(corners), 0.2), 3000)
    s, a = (weights @ corners).T
    g1, g2, T, lag, D = map(float, gains)
    for _ in range(60):
        u, left = -g1 * s - g2 * np.sign(s), np.exp(-T / lag)
        s, a = (s + T * u + lag * (a - u) * (1 - left) + T * D * rng.choice([-1, 0.4, 1], len(s)),
                u + (a - u) * left)  # fmt: skip
        ticker.tick()
        side = np.where(s >= 0, 1.0, -1.0)
        x, y = s * side / float(ticker.unit[0]), a * side / float(ticker.unit[1])
        P = np.array(ticker.points, float)
        ahead = np.roll(P, -1, axis=0)
        for (p, q), (p2, q2) in zip(P, ahead, strict=True):  # left of every side, to a unit
            reach = np.hypot(p2 - p, q2 - q)
            assert (((p2 - p) * (y - q) - (q2 - q) * (x - p)) / reach >= -0.01).all()


def test_altered_certificates_fail():
    payload = written("g1=36 g2=12 T=.001 lag=.0042 D=3")
    evidence = payload["proofs"]["polygon"]["evidence"]
    half = [[str(F(s) / 4), str(F(a) / 4)] for s, a in evidence["corners"]]
    for name, value in {"bound": "1/30", "ticks": 3, "corners": half}.items():
        proof = {"polygon": {"evidence": {**evidence, name: value}}}
        with pytest.raises((DoesNotHold, BadInput)):
            proofs.check(SYSTEM, {**payload, "proofs": proof})
    payload = written("g1=66 g2=12 T=.016 lag=.0563 band=.19")
    run = payload["counterexample"]["run"]
    for name, value in {"signs": run["signs"][1:], "d": ["1"] * len(run["d"]),
                        "start": {"s": "1", "a": "0"}}.items():  # fmt: skip
        other = {**payload["counterexample"], "run": {**run, name: value}}
        with pytest.raises((DoesNotHold, BadInput)):
            proofs.check(SYSTEM, {**payload, "counterexample": other})
