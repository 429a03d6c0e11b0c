"""Polygons of one error behind an actuator, as a file holds them: refused where altered."""

from __future__ import annotations

from decimal import Decimal
from fractions import Fraction

import pytest

from slipctl import BadInput
from slipctl.certify.arithmetic.decimal_intervals import precise
from slipctl.certify.entries import DoesNotHold
from slipctl.models.bounded_error.certificate.interval_systems import (
    check_polygons,
    find_polygons,
)
from slipctl.models.bounded_error.certificate.lagged_maps import Lagged, lag_numbers
from slipctl.models.bounded_error.certificate.scalar_maps import CubicPull, Interval

D, F = Decimal, Fraction


def behind(number, push="0.005", dead=1) -> Lagged:
    lag, T, gain, one = (number(x) for x in ("0.1", "0.05", "0.05", "1"))
    with precise(50):
        E, c1, c2, scale, left = lag_numbers(lag, T, dead)
        pulls = CubicPull(gain, one), CubicPull(gain * number("1.25"), one)
    return Lagged(*pulls, number(push), number("0.001"), left, E, c1, c2, scale)


START = Interval(D("-0.2"), D("0.3"))
STEP = D("0.05")


@pytest.fixture(scope="module")
def polygons():
    """Of a law with a lag and a dead time, for a start and for a step from where it settles."""
    exact = behind(D)
    law = behind(float)
    found = find_polygons(law, law, lambda: (exact, exact), Interval(-0.2, 0.3), 0.05,
                          (START, STEP))  # fmt: skip
    assert found is not None
    return exact, found


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"start": Interval(D("-0.35"), D("0.3"))}, "does not hold the start set"),
        ({"start": Interval(D("-0.2"), D("0.45"))}, "does not hold the start set"),
        ({"step": D("0.4")}, "a step leads out of evidence.kept"),
        ({"kept": "less moved"}, "settled moves more than evidence.kept"),
        ({"settled": "moved", "by": F(-1, 1000)}, "settled is left in a tick"),
        ({"settled": "levels", "by": F(1, 2)}, "settled is left in a tick"),
        ({"kept": "moved", "by": F(-1, 10**4)}, "moves more than|kept is left in a tick"),
        ({"settled": None}, "evidence.settled is missing"),
        ({"kept": "63"}, "must have 64 entries"),
    ],
)  # fmt: skip
def test_polygons_that_are_altered_are_refused(change, said, polygons) -> None:
    law, found = polygons
    check_polygons(law, law, START, STEP, found)
    entry = {k: dict(v) for k, v in found.items()}
    for name in {"kept", "settled"} & set(change):
        what, by = change[name], change.get("by", F(0))
        if what is None:
            del entry[name]
        elif what == "63":
            entry[name]["levels"] = entry[name]["levels"][1:]
        elif what == "levels":
            entry[name][what] = [str(F(x) * by) for x in entry[name][what]]
        elif what == "less moved":
            entry[name]["moved"] = str(F(found["settled"]["moved"]) - F(1, 10**9))
        else:
            entry[name][what] = str(F(entry[name][what]) + by)
    with pytest.raises((DoesNotHold, BadInput), match=said):
        check_polygons(law, law, change.get("start", START), change.get("step", STEP), entry)
