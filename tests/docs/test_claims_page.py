"""Every number and order that a paper claims has a row, and docs/claims.md has every row."""

import re
from pathlib import Path

import pytest

from slipctl.study.resolve import load_study

DOCS = Path(__file__).parents[2] / "docs"

PRINTED = {
    # seconds, Table 4, per cent, gains
    "subway_braking": [0.4, 0.5, 8.0239e-5, 2.0435e-6, 5.1227e-6, 0.1, 15.0],
    # Table 4, section 5.1
    "hst_braking": [256.8391, 254.4313, 254.1955, 254.0479, 0.0679, 0.0637, 0.0564, -33.56],
    # Fig. 9(c) in km/h; Table 4: RMSE, largest error, execution and response
    "hst_traction": [2.88, -0.72, 200.0, 0.02, 0.05, 0.04, 0.07, 0.10, 0.20, 0.18, 0.25],
    # Table 1, Figs 5, 7, 8, 10 to 12 (8300 and 8250 N m)
    "freight_traction": [0.286, 0.206, 0.2855, 8.0, 0.28, 8.3, 8.25, 0.505, 0.05, 0.003],
}
"""Numbers that the papers print about their results, copied from the papers and not from us."""

ORDERS = {
    "subway_braking": ["faster than the reaching law", "control error is significantly smaller",
                       "the smaller the radius, the longer", "torque falls from dry to wet to ice",
                       "torque is stable in curves", "poor at high slip", "faster than Newton",
                       "ends the chattering", "slip is tracked within 0.1 s in curves"],
    "hst_braking": ["fixed slip brakes longest", "stops first, then E-FC", "most comfortable",
                    "no overshoot", "converges first at 0 s", "converges first at 2 s",
                    "largest overshoot", "longest adjustment time", "keeps the wheel from locking",
                    "prescribed bounds for the whole run", "best steady-state performance"],
    "hst_traction": ["order of the RMSE", "order of the largest errors", "response times",
                     "execution times", "recovers after 320 s", "because of its integral",
                     "200 s to 250 s", "tracks best", "linear extended-state observer",
                     "saturation compensation", "printed gains meet (49)",
                     "exceeds what the rail carries"],
    "freight_traction": ["without steady-state oscillation", "still rises", "oscillates",
                         "does not converge in the dry section", "less torque",
                         "never exceeds the best creep", "converges faster than plain",
                         "identify the resistance", "keeps its barrier"],
}  # fmt: skip
"""Words of the rows that hold what a paper puts in an order or calls possible."""


def numbers(claim):
    """Paper's answer of a row as a number, None of an order."""
    try:
        return None if isinstance(claim.paper, bool) else float(claim.paper)
    except (TypeError, ValueError):
        return None


@pytest.mark.parametrize("name", PRINTED)
def test_every_printed_number_and_order_has_a_row(name):
    """A row that is judged, or that says why it cannot be."""
    claims = [c for c in load_study(name).claims if c.source != "ours"]
    found = [v for c in claims if (v := numbers(c)) is not None]
    for value in PRINTED[name]:
        assert any(v == pytest.approx(value, rel=1e-9) for v in found), value
    for words in ORDERS[name]:
        assert any(words in c.claim for c in claims), words
    assert all(c.not_checkable or c.ours is not None for c in claims)


@pytest.mark.parametrize("name", PRINTED)
def test_every_row_says_where_it_stands_in_the_paper(name):
    place = re.compile(r"abstract|[Ss]ection \d|Table \d|Fig\. \d|Figs \d|Theorem \d|\(\d+\)|ours")
    for claim in load_study(name).claims:
        assert place.search(claim.source), (claim.id, claim.source)


def test_the_page_has_every_row():
    fresh = (DOCS / "claims.md").read_text(encoding="utf-8")
    for name in PRINTED:
        for claim in load_study(name).claims:
            assert f"| `{claim.id}` |" in fresh
