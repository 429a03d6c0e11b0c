"""Rungs of a ladder of swings, one by one, and choices that a model of Wang 2025 does not have."""

from __future__ import annotations

from typing import Any

import pytest

from slipctl import BadInput
from slipctl.models.wang_2025 import hst_traction_control
from slipctl.models.wang_2025.certificate import saturated_motion as swing
from slipctl.models.wang_2025.certificate.saturated_motion import Saturated

LAW = Saturated(2.0, 3.0, (9.0, 30.0), (40.0, 50.0))


def ladder(monkeypatch: pytest.MonkeyPatch, found: list[Any], law: Saturated = LAW) -> list[Any]:
    """What is asked of each turn, where turns give these in turn; the answer last."""
    asked: list[Any] = []
    left = list(found)

    def turn(of: Saturated, s: float, above: bool, steps: int) -> Any:
        asked.append((of, s, above, steps))
        return left.pop(0)

    monkeypatch.setattr(swing, "turn", turn)
    return [swing._ladder(law, 10.0, 7), asked]


def test_each_rung_begins_where_the_last_one_came_to_rest(monkeypatch) -> None:
    """Down to where 2 far + 3 speed is no more than the least of the four limits."""
    said, asked = ladder(monkeypatch, [(8.0, 1.0, 9.0), (5.0, 0.5, 6.0), (2.0, 0.25, 4.0),
                                       (1.0, 0.2, 1.5)])  # fmt: skip
    assert said is True
    assert [s for _, s, _, _ in asked] == [10.0, 8.0, 5.0, 2.0]
    assert {(of, above, steps) for of, _, above, steps in asked} == {(LAW, True, 7)}


@pytest.mark.parametrize(("found", "rungs", "wanted"), [
    ([None], 1, False), ([(10.0, 0.0, 1.0)], 1, False), ([(9.0, 1.0, 9.5), None], 2, False),
    ([(9.0, 1.0, 9.5), (9.0, 0.0, 0.0)], 2, False), ([(0.5, 4.0, 1.0), (0.2, 4.0, 0.1)], 2, None),
    ([(3.0, 0.0, 4.5), (1.0, 0.0, 4.5)], 2, True), ([(3.0, 0.0, 2.0), (1.0, 1.0, 2.0)], 2, True),
])  # fmt: skip
def test_a_ladder_ends_where_it_comes_no_nearer(found, rungs, wanted, monkeypatch) -> None:
    """The furthest that counts is the start or the other side, whichever is further."""
    if wanted is None:  # too fast for that: it goes on
        with pytest.raises(IndexError):
            ladder(monkeypatch, found)
        return
    said, asked = ladder(monkeypatch, found)
    assert (said, len(asked)) == (wanted, rungs)


def test_a_ladder_has_so_many_rungs_and_no_more(monkeypatch) -> None:
    monkeypatch.setattr(swing, "RUNGS", 3)
    said, asked = ladder(monkeypatch, [(9.0, 9.0, 9.0), (8.0, 9.0, 8.0), (7.0, 9.0, 8.0), None])
    assert (said, len(asked)) == (False, 3)


def test_where_both_sides_differ_a_ladder_goes_down_from_each(monkeypatch) -> None:
    asked: list[Any] = []
    answers = {LAW: True, LAW.turned(): False}

    def one(of: Saturated, s: float, steps: int) -> bool:
        asked.append((of, s, steps))
        return answers[of]

    monkeypatch.setattr(swing, "_ladder", one)
    assert not swing.dies_out(LAW, 4.0, 9)
    assert asked == [(LAW, 4.0, 9), (LAW.turned(), 4.0, 9)]
    answers[LAW.turned()] = True
    assert swing.dies_out(LAW, 4.0, 9)
    answers[LAW] = False
    assert not swing.dies_out(LAW, 4.0, 9)
    alike = Saturated(2.0, 3.0, (9.0, 30.0), (9.0, 30.0))
    answers[alike] = True
    asked.clear()
    assert swing.dies_out(alike, 4.0)
    assert asked == [(alike, 4.0, swing.STEPS)]


@pytest.mark.parametrize(("given", "said"), [
    ({"gains": "own"}, "own"), ({"form": "printed-41"}, "printed-41"),
    ({"gains": "printed", "form": "own"}, "own"),
])  # fmt: skip
def test_a_form_or_gains_that_there_are_not_are_refused(given, said) -> None:
    with pytest.raises(BadInput, match=f"higher_order.*{said}"):
        hst_traction_control.higher_order(**given)
