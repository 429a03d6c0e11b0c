"""What ``slipctl certify`` says that a gain needs: with it the criterion holds."""

from __future__ import annotations

import re

import pytest

from slipctl.certify import catalogue, systems
from slipctl.commands.certificates.certify import needs

BOUND = re.compile(r"(\w+) ([<>]=) ([\d.e+-]+) \(is ([\d.e+-]+)\)")

ASKED = [
    ("super_twisting", {"k1": 1.0, "k2": 0.5, "L": 1.0}, "REFUTED"),
    ("super_twisting", {"k1": 3.0, "k2": 1.5, "L": 1.0}, "CERTIFIED"),
    ("super_twisting", {"k1": 1.2, "k2": 1.1, "L": 1.0}, "CERTIFIED"),
]


@pytest.mark.parametrize(("name", "numbers", "verdict"), ASKED)
def test_what_a_gain_needs_makes_its_criterion_hold(name, numbers, verdict):
    system = catalogue.SYSTEMS[name]
    report = systems.report(system, numbers)
    said = needs(report)
    assert report.verdict == verdict
    assert BOUND.search(said)
    certified = report.verdict == systems.CERTIFIED
    assert said.startswith("nearest limit " if certified else ("needs ", "no limit"))
    for part in said.partition(" " if not certified else "limit ")[2].split("; "):
        criterion = part.partition(":")[0].split()[-1]
        for gain, side, bound, now in BOUND.findall(part):
            assert float(now) == pytest.approx(numbers[gain], rel=1e-3)
            for factor, holds in ((1.01, side == ">="), (0.99, side == "<=")):
                moved = systems.report(system, numbers | {gain: float(bound) * factor})
                assert (moved.criteria[criterion].holds is True) == holds, (part, factor)
