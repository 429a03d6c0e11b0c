"""Warnings read off a log, each against a log by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipctl.run.warnings import wheels

TIME = np.arange(10) / 10


@given(st.lists(st.booleans(), max_size=12))
def test_the_longest_span_is_the_first_of_the_longest(true):
    begin, end = wheels.longest_span(np.array(true, dtype=bool))
    assert all(true[begin:end])
    spans = "".join("x" if t else " " for t in true).split()
    longest = max(map(len, spans), default=0)
    assert end - begin == longest
    if longest:
        assert begin == "".join("x" if t else " " for t in true).index("x" * longest)


def rows(*places, axles=None):
    """1 in these rows of ten, 0 in the others; of several axles by a list for each."""
    if axles is not None:
        return np.stack([rows(*own) for own in axles], axis=1)
    return np.isin(np.arange(10), places).astype(float)


RELEASED = [
    ({}, []),
    ({"ctl.safe.released": rows(3, 4)},
     ["axle 1 was released for too long, and got the demand at 0.3 s; [control] release and"
      " release_still"]),
    ({"ctl.safe.released": rows(axles=[(), (0, 1, 5, 8)])},
     ["axle 2 was released for too long, and got the demand at 0 s, 3 times; [control] release and"
      " release_still"]),
    ({"ctl.trust.retry": rows(6, 7)},
     ["the train was released for too long, and got the demand at 0.6 s; [control] release_train"]),
    # the limit of the train ends the releases of its axles, which are not told once more
    ({"ctl.trust.retry": rows(6, 7), "ctl.safe.released": rows(axles=[(6, 7), (2, 6)])},
     ["the train was released for too long, and got the demand at 0.6 s; [control] release_train",
      "axle 2 was released for too long, and got the demand at 0.2 s; [control] release and"
      " release_still"]),
]  # fmt: skip


@pytest.mark.parametrize(("log", "said"), RELEASED)
def test_a_release_that_its_limit_ended_is_told_once(log, said):
    assert list(wheels._ended_releases({"time": TIME} | log)) == said


def test_columns_of_the_driven_axles_are_told_as_these():
    """Slip control works axles 2 and 4 of four."""
    log = {"time": TIME, "ctl.safe.released": rows(axles=[(), (5,)])}
    (said,) = wheels._ended_releases(log, worked=(1, 3))
    assert said.startswith("axle 4 was released for too long")
    assert [wheels.axle_of_column((1, 3), k, 4) for k in range(4)] == [1, 2, 3, 4]


def test_a_valve_counts_from_its_first_hold_to_its_last():
    below = np.array([0, 1, 1, 1, 1, 1, 1, 0, 1, 1], dtype=bool)[:, None]
    holds = np.array([1, 0, 1, 0, 0, 1, 0, 0, 1, 0], dtype=bool)[:, None]
    found = wheels._first_to_last(below, holds)[:, 0]
    assert np.flatnonzero(found).tolist() == [2, 3, 4, 5, 8]
    assert not wheels._first_to_last(below, np.zeros_like(holds)).any()


def test_a_speed_that_is_further_off_than_it_says_is_told_where_it_is_worst():
    v = np.linspace(20, 11, 10)
    log = {"time": TIME, "plant.train.v": v, "speed.error": np.full(10, 0.5),
           "speed.v_m": v + 0.4}  # fmt: skip
    assert list(wheels._wrong_speed(log)) == []
    off = np.array([0, 0, 0.6, 0, -0.9, 0.7, 0, 0, 0, 0])
    (line,) = wheels._wrong_speed(log | {"speed.v_m": v + off})
    assert f"is {15.1:.3g} m/s at 0.4 s, the true speed 16 m/s" in line
    assert "exceeds the 0.5 m/s" in line
    wider = log["speed.error"] + 0.5 * (np.arange(10) == 4)
    (line,) = wheels._wrong_speed(log | {"speed.v_m": v + off, "speed.error": wider})
    assert "at 0.5 s" in line
    assert list(wheels._wrong_speed({k: x for k, x in log.items() if k != "speed.error"})) == []
