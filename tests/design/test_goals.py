"""Limits of a search as a person writes them, several at once."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from slipctl import BadInput
from slipctl.design import page
from slipctl.design.goals import Limit, Proved, Score, read_limits
from slipctl.run.measures.measured_run import Metric

THERE = {"slip_max": Metric(1.0, "m/s"), "torque": Metric(1.0, "N m")}
CERTIFICATES = ("sta", "rest")


def read(*texts: str) -> tuple[list[Limit], list[Proved]]:
    return read_limits(texts, THERE, CERTIFICATES, "loop")


def test_each_of_several_is_read_whatever_stands_before_it() -> None:
    limits, proved = read(
        "certified", " sta.certified ", "margin>=1.2", "slip_max@0.95<=7.2km/h", "rest.margin>=3",
        "torque>=8kN m", "slip_max@1.<=1m/s",
    )  # fmt: skip
    assert [(p.name, p.margin) for p in proved] == [
        ("", 1.0), ("sta", 1.0), ("", 1.2), ("rest", 3.0)]  # fmt: skip
    assert [(x.metric, x.upper, x.value, x.unit, x.share) for x in limits] == [
        ("slip_max", True, pytest.approx(2.0), "m/s", 0.95), ("torque", False, 8e3, "N m", 1.0),
        ("slip_max", True, 1.0, "m/s", 1.0),
    ]  # fmt: skip
    assert [x.text for x in limits] == [
        "slip_max@0.95<=7.2km/h", "torque>=8kN m", "slip_max@1.<=1m/s"]  # fmt: skip
    assert [p.text for p in proved][1:3] == ["sta.certified", "margin>=1.2"]


@pytest.mark.parametrize(("value", "upper", "found"), [
    (2.0, True, 0.5), (2.0, False, -0.5), (-2.0, True, 2.5), (0.0, True, 3.0), (0.0, False, -3.0),
])  # fmt: skip
def test_a_value_is_beyond_a_limit_by_a_share_of_it(value, upper, found) -> None:
    """Of a limit of zero in its unit; in every draw where nobody says else."""
    limit = Limit("x", "x", upper, value, "m")
    assert limit.beyond(3.0) == found
    assert limit.missed([-1.0] * 9 + [0.25]) == 0.25
    score = Score([1.0] * 3, [[-1.0], [0.5], [0.75]])
    assert [score.missed([limit], k) for k in (1, 2, None)] == [0.0, 0.5, 0.75]
    assert Limit("x", "x", upper, value, "m", 0.9).missed([-1.0] * 9 + [0.25]) == 0


@pytest.mark.parametrize(("text", "said"), [
    ("margin<=1.2", "write margin>=M, M from 1 to 1e6"), ("margin@0.5>=1.2", "write margin>=M"),
    ("margin>=0.99", "write margin>=M"), ("margin>=1.1e6", "write margin>=M"),
    ("stb.margin>=2", "has no certificate 'stb'; did you mean 'sta'"),
    ("x.certified", "has no certificate 'x'"), ("slip_mix<=1m/s", "has no metric 'slip_mix'; did"),
    ("slip_max@0<=1m/s", "the share of draws is 0; write 0.95"),
    ("slip_max@1.1<=1m/s", "the share of draws is 1.1"), ("slip_max<1m/s", "write METRIC<=VALUE"),
    ("slip_max<=1kg", "another dimension"),
])  # fmt: skip
def test_what_is_no_limit_is_refused(text: str, said: str) -> None:
    with pytest.raises(BadInput, match=said):
        read("certified", text)


def test_without_certificates_none_is_asked() -> None:
    for text in ("certified", "margin>=2"):
        with pytest.raises(BadInput, match="loop has no certificate; its study declares no gains"):
            read_limits([text], THERE, (), "loop")


@pytest.mark.parametrize(("terms", "drawn"), [
    ([(1, "slip_max")], True), ([(2, "slip_max")], False), ([(1, "torque")], False),
    ([(1, "slip_max"), (1, "torque")], False),
])  # fmt: skip
def test_a_limit_is_drawn_beside_the_objective_that_is_its_metric_alone(terms, drawn) -> None:
    (limit,), _ = read("slip_max<=2m/s")
    search = SimpleNamespace(best=0, by_hand=0, limits=[limit])
    its = SimpleNamespace(by_hand=SimpleNamespace(values=[1.0, 3.0]))
    fig = page._judged_picture(SimpleNamespace(search=search), terms, ("slip", "m/s"), its)
    (axis,) = fig.get_axes()
    at = [line for line in axis.get_lines() if np.ravel(line.get_ydata()).tolist() == [2.0, 2.0]]
    assert bool(at) == drawn
