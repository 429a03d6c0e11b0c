"""The attack on certificates of tuned loops: what holds survives it, what does not hold falls."""

from __future__ import annotations

import sys
from fractions import Fraction
from pathlib import Path

import attacked
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "certify"))

from adversary import hunt

from slipctl.certify import proofs
from slipctl.certify.catalogue import system

pytestmark = pytest.mark.second

TWISTING = {"k1": 20.0, "k2": 10.0, "L": 2.0, "T": 0.001, "band": 0.005}
FUNNEL = {"K1": 250.0, "T": 0.001, "eta_inf": 0.01, "delta_l": 1.4, "delta_u": 1.4, "W": 0.3,
          "start": 0.5}  # fmt: skip
BARRIER = {"k": 1200.0, "k_a": 0.03, "k_s": 0.02, "T": 0.02, "W": 0.004, "start": 0.5}


def verdict(name: str, numbers: dict[str, float]) -> str:
    own = system(name)
    told = proofs.exact_numbers(own, {k: Fraction(str(v)) for k, v in numbers.items()})
    return proofs.decide(own, told).verdict


@pytest.mark.parametrize(
    ("name", "numbers"),
    [("super_twisting", TWISTING), ("prescribed_performance", FUNNEL),
     ("barrier_lyapunov", BARRIER)],
)  # fmt: skip
@pytest.mark.others("long")
def test_a_promise_that_holds_survives(name: str, numbers: dict[str, float]) -> None:
    assert verdict(name, numbers) == "CERTIFIED"
    found = attacked.attack(name, numbers, copies=20, runs=1000, seed=1)
    assert found["broken"] == 0
    assert 0 < found["worst"] < 1


def test_what_the_search_comes_to_is_not_promised_away() -> None:
    worst = hunt.worst("super_twisting", TWISTING, 2000, 1)
    less = TWISTING | {"band": 0.99 * worst * TWISTING["band"]}
    assert verdict("super_twisting", less) != "CERTIFIED"


@pytest.mark.parametrize(
    ("name", "numbers"), [("prescribed_performance", FUNNEL), ("barrier_lyapunov", BARRIER)]
)
def test_a_promise_that_does_not_hold_falls(name: str, numbers: dict[str, float]) -> None:
    worse = numbers | {"W": 6 * numbers["W"]}
    assert verdict(name, worse) != "CERTIFIED"
    found = attacked.attack(name, worse, copies=5, runs=1000, seed=1)
    assert found["broken"] == 5
    assert found["worst"] >= 1
