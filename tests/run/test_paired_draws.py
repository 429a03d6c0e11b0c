"""Differences of sweeps on the same draws are those of runs with the same numbers."""

from types import SimpleNamespace

import numpy as np
import pytest

from slipctl.study.report.sweep_page import paired_differences


def swept(rows):
    """A sweep with these runs: number, what was drawn, distance."""
    runs = [(k, {"m": m}, {}, "") for k, m, _ in rows]
    return SimpleNamespace(runs=runs, column=lambda _: np.array([d for *_, d in rows]))


def test_runs_are_paired_by_number_and_draw():
    """One that only the other has, and one with another mass, have no partner."""
    base = swept([(0, 1.0, 10.0), (2, 3.0, 30.0), (3, 4.0, 40.0)])
    other = swept([(0, 1.0, 11.0), (1, 2.0, 99.0), (2, 3.0, 33.0), (3, 5.0, 99.0)])
    assert paired_differences({"a": base, "b": other}, "distance")["b"] == pytest.approx([1, 3])


def test_what_neither_reaches_is_no_difference_and_what_one_does_not_is_infinite():
    base = swept([(0, 1.0, np.inf), (1, 1.0, np.inf), (2, 1.0, 5.0)])
    other = swept([(0, 1.0, np.inf), (1, 1.0, 7.0), (2, 1.0, np.inf)])
    found = paired_differences({"a": base, "b": other}, "distance")["b"]
    assert found.tolist() == [0.0, -np.inf, np.inf]


def test_sweeps_without_a_common_draw_have_no_differences():
    other = swept([(7, 1.0, 2.0)])
    assert paired_differences({"a": swept([(0, 1.0, 1.0)]), "b": other}, "distance") == {}
