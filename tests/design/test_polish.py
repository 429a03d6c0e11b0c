"""Steps of a search along slopes: on bowls whose bottom is known."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from slipctl.design import goals
from slipctl.design.slopes import polish as polish_
from slipctl.errors import BadInput
from slipctl.run.metrics import Metric

WISHES = (0.3, 1.1)
"""Where each of two draws would have the number; the range is -1 to 3."""


class Bowl:
    """A search of one number: each draw asks for it near to its wish."""

    def __init__(self, start=-0.6, limit=None, refused=lambda x: False, holds=lambda c: True):
        self.objective = goals.read_objective("slip_error_rms")
        self.frees = [SimpleNamespace(name="k")]
        self.rolls = SimpleNamespace(world=None, draw=lambda kind, k: k, all=self._all, done=77)
        self.box = SimpleNamespace(by_share=lambda share: np.array([4.0]))
        self.samples, self.seed, self.thought, self.spent = len(WISHES), 1, 0, 0
        self.limits, self.limit, self.refused, self.holds = [], limit, refused, holds
        self.extended = []
        self.best = self.candidate(np.array([(start + 1) / 4]))

    def candidate(self, share):
        x = 4 * float(share[0]) - 1
        if self.refused(x):
            return None
        values = [(x - w) ** 2 for w in WISHES]
        missed = 0.0 if self.limit is None else max(0.0, x - self.limit)
        score = SimpleNamespace(mean=lambda: float(np.mean(values)), lost=lambda: 0,
                                missed=lambda limits: missed)  # fmt: skip
        return SimpleNamespace(numbers={"k": x}, share=np.array(share), score=score)

    def _all(self, kind, asked):
        [(_, numbers, k)] = asked
        return [{"slip_error_rms": Metric((numbers["k"] - WISHES[k]) ** 2, "m/s")}]

    def extend(self, made, samples):
        self.extended += [(c.numbers["k"], samples) for c in made]

    def behind(self, one, other, final):
        assert final
        bad = one.score.missed(self.limits) > other.score.missed(self.limits)
        return bad or one.score.mean() >= other.score.mean()


@pytest.fixture
def slopes(monkeypatch):
    """Exact ones, times a factor."""
    factor = [1.0]

    class Exact:
        def __init__(self, world, names):
            assert names == ["k"]

        def of(self, numbers, draw, metrics):
            slope = 2 * (numbers["k"] - WISHES[draw])
            return {m: np.array([factor[0] * slope]) for m in metrics}

    monkeypatch.setattr(polish_, "Slopes", Exact)
    return factor


def test_steps_end_at_the_bottom_of_the_mean_over_the_draws(slopes) -> None:
    search = Bowl()
    before = search.best.score.mean()
    found = polish_.polish(search)
    assert search.best.numbers["k"] == pytest.approx(0.7, abs=1e-4)
    assert found.gained == pytest.approx(before - 0.16, abs=1e-6)
    assert found.apart < 1e-6
    assert "the mean fell by 1.69 along it" in found.text()
    assert search.spent == 77
    assert all(n == 2 for _, n in search.extended)
    assert search.thought > 0


def test_steps_stay_inside_the_range(slopes) -> None:
    search = Bowl(start=2.9)
    polish_.polish(search)
    assert all(-1 <= x <= 3 for x, _ in search.extended)


def test_a_wrong_slope_is_not_used(slopes) -> None:
    slopes[0] = 1.001
    search = Bowl()
    found = polish_.polish(search)
    assert (search.best.numbers["k"], search.extended) == (pytest.approx(-0.6), [])
    assert found.apart > 1e-4
    assert found.text().endswith("not used")


def test_a_step_that_misses_a_limit_or_a_certificate_ends_it(slopes) -> None:
    """What was tried before stands; the best one is never left for a worse one."""
    short = Bowl(limit=0.0)
    polish_.polish(short)
    assert short.best.numbers["k"] <= 0
    assert sum(x > 0 for x, _ in short.extended) == 1  # the last one
    assert short.extended[-1][0] > 0
    refused = Bowl(refused=lambda x: x > 0)
    polish_.polish(refused)
    assert refused.best.numbers["k"] <= 0
    alone = Bowl(holds=lambda c: False)
    found = polish_.polish(alone)
    assert alone.best.numbers["k"] == pytest.approx(-0.6)
    assert found.gained == 0


def test_where_there_is_no_slope_it_says_why(monkeypatch) -> None:
    search = Bowl()
    search.objective = goals.read_objective("slip_max")
    assert polish_.polish(search).text() == "no exact gradient: slip_max has no slope"
    search = Bowl()
    search.best.score.lost = lambda: 1
    assert "never reaches the metric" in polish_.polish(search).why

    def refuse(*given):
        raise BadInput("its tick jumps")

    monkeypatch.setattr(polish_, "Slopes", refuse)
    assert polish_.polish(Bowl()).why == "its tick jumps"
