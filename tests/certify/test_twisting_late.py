"""Super-twisting behind a lag, a dead time or with noise: the sets hold runs, the runs replay."""

import math
from fractions import Fraction

import numpy as np
import pytest

from slipctl.certify import catalogue, proofs
from slipctl.certify.entries import DoesNotHold
from slipctl.errors import BadInput
from slipctl.models.super_twisting.certificate import twisting_late
from slipctl.models.super_twisting.certificate.twisting_late import Late
from slipctl.models.super_twisting.certificate.twisting_rows import Law

F = Fraction
SYSTEM = catalogue.system("super_twisting")
LATE = [("3", "1.5", "0", 1, "0"), ("3", "1.5", ".5", 0, "0"), ("2", "1.1", ".02", 0, ".2"),
        ("8", "4", ".3", 2, ".5"), ("1.8", "1.3", "0", 0, ".5")]  # fmt: skip


def late(k1, k2, lag, dead, noise):
    return Late(Law(F(k1), F(k2), F(1), F(noise)), F(lag), dead)


def run(law, d, n):
    """Explicit steps in floats, (ticks,) or (ticks, runs): |y| tick by tick."""
    k1, k2, lag, j = float(law.law.k1), float(law.law.k2), float(law.lag), law.dead
    y, v, phi, a = (np.zeros(d.shape[1:]) for _ in range(4))
    left, line, out = math.exp(-1 / lag) if lag else 0.0, [y] * j, []
    for push, heard in zip(d, n, strict=True):
        seen = y + heard
        line = [*line, v - k1 * np.sign(seen) * np.sqrt(abs(seen))]
        v = v - k2 * np.sign(seen)
        u, line = line[0], line[1:]
        y = y + phi + u + lag * (1 - left) * (a - u)
        a = u + left * (a - u)
        phi = phi + push
        out.append(abs(y))
    return np.array(out)


@pytest.mark.parametrize("numbers", LATE)
def test_sets_hold_random_runs(numbers):
    law = late(*numbers)
    found = twisting_late.find(law)
    assert found.holds()
    rng = np.random.default_rng(1)
    hold = rng.integers(1, 30, 400)
    d = np.stack([rng.choice([-1.0, 1.0], 400) for _ in range(400)])
    for i in range(1, 400):  # held for a while, in half of the runs
        d[i] = np.where((i % hold > 0) & (hold > 8), d[i - 1], d[i])
    n = rng.choice([-1.0, 0.0, 1.0], (400, 400)) * float(law.law.N)
    assert run(law, d, n).max() <= found.y


@pytest.mark.parametrize("numbers", LATE)
def test_runs_that_are_found_are_runs_and_lie_below_the_bound(numbers):
    """Noise alone: within 2 times; behind a lag or a dead time the bound is looser."""
    law = late(*numbers)
    found = twisting_late.find(law)
    loose = 2 if not law.lag and not law.dead else 20
    d, n = twisting_late.search(law, found.y / loose)
    reached = twisting_late.replay(law, d, n)
    assert found.y / loose < reached <= found.y
    same = run(law, np.array(d, float), np.array(n, float))[-1]
    assert same == pytest.approx(float(reached), rel=1e-6)  # some ten ticks of doubles
    assert twisting_late.replay(law, [*d[:-1], F(11, 10)], n) is None
    assert twisting_late.replay(law, d, [*n[:-1], law.law.N + 1]) is None


@pytest.mark.parametrize("numbers", LATE)
def test_with_few_digits_a_replay_says_less_and_never_more(numbers):
    """A bound from below: it rises to the truth with the digits, if no sign is left open."""
    law, rng, told = late(*numbers), np.random.default_rng(5), 0
    for _ in range(20):
        d = [law.law.L * int(s) for s in rng.choice([-1, 1], 12)]
        n = [law.law.N * int(s) for s in rng.choice([-1, 0, 1], 12)]
        true = twisting_late.replay(law, d, n, digits=900)
        found = [twisting_late.replay(law, d, n, digits) for digits in (6, 9, 12, 30, 250)]
        found = [bound for bound in found if bound is not None]
        told += len(found)
        assert all(bound <= true for bound in found)
        assert found[-1] == pytest.approx(float(true), abs=1e-9)  # a root halves the digits
    assert told > 20


@pytest.mark.parametrize(("asked", "verdict"), [
    ("T=.001 noise=1e-6", "CERTIFIED"),
    ("T=.001 noise=2e-6 band=3e-6", "REFUTED"),
    ("T=.001 noise=1e-6 band=7e-6", "CERTIFIED"),
    ("T=.001 lag=1e-5 band=6e-6", "CERTIFIED"),
    ("T=.001 lag=.0005 band=3e-6", "REFUTED"),
    ("T=.001 lag=.0005 noise=1e-7 dead=.0015", "CERTIFIED"),
    ("T=.001 dead=.001 band=1e-5", "REFUTED"),
    ("T=.001 dead=.001 band=5e-5", "UNDECIDED"),  # 2.1e-5 is reached, 7.9e-5 is proved
    ("lag=.001", "UNDECIDED"),  # no proof in continuous time
    ("T=.001 delta=.1 noise=1e-6", "UNDECIDED"),
])  # fmt: skip
def test_verdicts(asked, verdict):
    numbers = {k: F(v) for k, v in (part.split("=") for part in asked.split())}
    payload = proofs.write(SYSTEM, {"k1": F(3), "k2": F(3, 2), "L": F(1), **numbers})
    assert payload["verdict"] == verdict
    assert payload["promise"]["from"] == "x1 = x2 = 0, nothing under way"
    proofs.check(SYSTEM, payload)


def test_from_rest_proves_nothing_of_other_starts():
    """Without noise, lag and dead time the promise is from every start: the set does not count."""
    numbers = {"k1": F(3), "k2": F(3, 2), "L": F(1), "T": F(1, 1000)}
    payload = proofs.write(SYSTEM, numbers)
    assert payload["promise"]["from"] == "every start"
    assert list(payload["proofs"]) == ["sampled"]
    other = proofs.write(SYSTEM, {**numbers, "noise": F(1, 10**12)})
    moved = {**payload, "proofs": {"late": other["proofs"]["late"]}}
    with pytest.raises((DoesNotHold, BadInput)):
        proofs.check(SYSTEM, moved)


def test_altered_certificates_fail():
    asked = {"k1": F(3), "k2": F(3, 2), "L": F(1), "T": F(1, 1000), "lag": F(1, 4000)}
    payload = proofs.write(SYSTEM, asked)
    evidence = payload["proofs"]["late"]["evidence"]
    for name, value in {"P": str(F(evidence["P"]) / 2), "ticks": 2, "parts": 10**7,
                        "bound": str(F(evidence["bound"]) / 2)}.items():  # fmt: skip
        altered = {**payload, "proofs": {"late": {"evidence": {**evidence, name: value}}}}
        with pytest.raises((DoesNotHold, BadInput)):
            proofs.check(SYSTEM, altered)
    payload = proofs.write(SYSTEM, {**asked, "band": F(2, 10**6)})
    entry = payload["counterexample"]
    for name, value in {"start": "x", "d": entry["run"]["d"][:2], "noise": ["0"]}.items():
        altered = {**entry, "run": {**entry["run"], name: value}}
        with pytest.raises((DoesNotHold, BadInput)):
            proofs.check(SYSTEM, {**payload, "counterexample": altered})
