"""What a search asks of certificates: which, with which margin, up to which one, and how often."""

from __future__ import annotations

from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import pytest

from slipctl.certify.promise import CERTIFIED, INPUT, UNDECIDED
from slipctl.design import promises
from slipctl.design.goals import Proved
from slipctl.design.promises import Promises, promises_of_loop, with_margin
from slipctl.errors import BadInput

F = Fraction
NAMES = ("sta", "rest", "late")


def gains(name: str, loop: str = "a") -> Any:
    return SimpleNamespace(
        name=name, system=name, loop=loop, numbers=lambda of: {"k": 2, "L": of.L}
    )


ALL = tuple(map(gains, NAMES))


@pytest.mark.parametrize(("wanted", "kept", "found"), [
    ([], (), []), ([("", 1.2)], (), [("sta", 1.2), ("rest", 1.2), ("late", 1.2)]),
    ([("", 1.2)], ("rest",), [("rest", 1.2)]), ([], ("rest", "sta"), [("sta", 1.0), ("rest", 1.0)]),
    ([("late", 2.0), ("", 1.5)], ("sta",), [("sta", 1.5), ("late", 2.0)]),
    ([("sta", 2.0), ("sta", 1.5)], ("sta",), [("sta", 2.0)]),
    ([("sta", 0.5)], ("sta",), [("sta", 1.0)]), ([("sta", 1.0)], ("sta",), [("sta", 1.0)]),
])  # fmt: skip
def test_what_has_to_be_is_what_was_proved_and_what_is_wanted(wanted, kept, found) -> None:
    """The larger margin counts; a wish without a name speaks of what was proved by hand."""
    asked = tuple(Proved(f"{n}>={m}", n, m) for n, m in wanted)
    its = Promises(ALL, asked, kept)
    assert [(g.name, m) for g, m, _ in its.needed()] == found
    for g, margin, text in its.needed():
        names = {f"{p.name}>={p.margin}" for p in asked if p.margin == margin} or {
            f"{g.name}.certified"}  # fmt: skip
        assert text in names


@pytest.fixture
def decided(monkeypatch) -> Any:
    """Certificates that hold up to a margin each; what was asked of them."""
    told = SimpleNamespace(up_to={"sta": 3.0, "rest": 0.5, "late": 1.7}, asked=[])

    def verdict(self: Any, of: Any, loop: Any, margin: float = 1.0) -> str:
        told.asked.append((of.name, margin))
        return CERTIFIED if margin <= told.up_to[of.name] else UNDECIDED

    monkeypatch.setattr(Promises, "verdict", verdict)
    monkeypatch.setattr(promises, "is_last", lambda of: of.name == "late")
    return told


def test_a_margin_is_found_by_doubling_and_halving(decided) -> None:
    its = Promises(ALL)
    found = its.margin(ALL[0], None)  # type: ignore[arg-type]
    assert found <= 3.0 < found + 2.0 / 2**promises.STEPS * 1.001
    assert [m for _, m in decided.asked][:5] == [1.0, 2.0, 4.0, 3.0, 3.5]
    assert len(decided.asked) == 3 + promises.STEPS
    decided.asked.clear()
    assert its.margin(ALL[1], None) == 0.0  # type: ignore[arg-type]
    assert decided.asked == [("rest", 1.0)]
    decided.up_to["sta"] = 1e300
    far = its.margin(ALL[0], None)  # type: ignore[arg-type]
    assert far <= promises.FARTHEST < 2 * far


def test_of_a_long_proof_a_few_margins_are_asked_and_those_that_are_wanted(
    decided, monkeypatch
) -> None:
    monkeypatch.setattr(promises, "MARGINS", (1.0, 1.5, 2.0, 4.0))
    late = ALL[2]
    assert Promises(ALL).margin(late, None) == 1.5  # type: ignore[arg-type]
    assert [m for _, m in decided.asked] == [1.0, 1.5, 2.0]
    its = Promises(ALL, (Proved("", "late", 1.6), Proved("", "sta", 1.65)))
    assert its.margin(late, None) == 1.6  # type: ignore[arg-type]
    decided.up_to["late"] = 9.0
    assert its.margin(late, None) == 4.0  # type: ignore[arg-type]
    decided.up_to["late"] = 0.9
    assert its.margin(late, None) == 0.0  # type: ignore[arg-type]


def test_what_fails_is_the_first_thing_and_a_long_proof_is_left_to_the_end(decided) -> None:
    """Before it, a candidate is run as badly as others were."""
    wishes = (Proved("late>=2", "late", 2.0), Proved("rest>=1", "rest", 1.0),
              Proved("sta>=2", "sta", 2.0))  # fmt: skip
    its = Promises(ALL, wishes)
    leaves: list[Any] = []
    object.__setattr__(its, "_leaves", lambda g, loop, margin: leaves.append((g.name, margin)))
    assert its.fails(None) == "rest>=1"  # type: ignore[arg-type]
    assert decided.asked == [("sta", 2.0), ("rest", 1.0)]
    assert its.fails_last(None) == "late>=2"  # type: ignore[arg-type]
    decided.up_to = {"sta": 2.0, "rest": 1.0, "late": 2.0}
    assert its.fails(None) == its.fails_last(None) == ""  # type: ignore[arg-type]
    assert leaves == [("late", 2.0)]
    object.__setattr__(its, "_leaves", lambda g, loop, margin: True)
    assert its.fails(None) == "late>=2"  # type: ignore[arg-type]
    assert its.has_last()
    assert not Promises(ALL, wishes[1:]).has_last()


def test_a_long_proof_is_made_once_for_a_loop_and_told(monkeypatch) -> None:
    """With the worst runs of its loop, of which the last ones are remembered."""
    made: list[Any] = []
    said: list[str] = []
    monkeypatch.setattr(promises, "REMEMBERED", 3)
    monkeypatch.setattr(promises, "is_last", lambda of: of.name == "late")
    system = SimpleNamespace(loop=SimpleNamespace(
        worst_runs=lambda numbers: [numbers["L"], -numbers["L"]],
        exceeds=lambda numbers, runs: made.append(("exceeds", list(runs))) or numbers["L"] > 9,
    ))  # fmt: skip
    monkeypatch.setattr(promises.catalogue, "system_of_gains", lambda of, loop: system)
    monkeypatch.setattr(promises, "exact_numbers", lambda of, own: own)
    monkeypatch.setattr(
        promises, "with_margin", lambda of, own, margin: {**own, "L": own["L"] * margin}
    )

    def decide(of: Any, numbers: Any) -> Any:
        made.append(numbers["L"])
        if numbers["L"] > 100:
            raise BadInput("means nothing")
        return SimpleNamespace(verdict=CERTIFIED if numbers["L"] < 5 else UNDECIDED)

    monkeypatch.setattr(promises.proofs, "decide", decide)
    ticks = iter(range(100))
    monkeypatch.setattr(promises, "perf_counter", lambda: float(next(ticks)))
    its = Promises(ALL, tell=said.append)

    def loop(L: float) -> Any:
        return SimpleNamespace(L=L, values_by_place=lambda: {"ctl.L": L, "ctl.k": 2.0})

    late, quick = ALL[2], ALL[0]
    assert [its.verdict(late, loop(v)) for v in (3.0, 3.0, 4.0)] == [CERTIFIED] * 3
    assert its.verdict(late, loop(3.0), 2.0) == UNDECIDED
    assert made == [3.0, 4.0, 6.0]
    assert said == ["late: CERTIFIED after 1 s", "late: CERTIFIED after 1 s",
                    "late with bounds times 2: UNDECIDED after 1 s"]  # fmt: skip
    assert its._runs == {"late": [-4.0, 6.0, -6.0]}
    made.clear()
    assert its.verdict(quick, loop(3.0)) == its.verdict(quick, loop(3.0)) == CERTIFIED
    assert made == [3.0, 3.0]
    assert its.verdict(quick, loop(101.0)) == UNDECIDED
    made.clear()
    assert not its._leaves(late, loop(3.0), 2.0)
    assert its._leaves(late, loop(3.0), 4.0)
    assert made == [("exceeds", [-4.0, 6.0, -6.0])] * 2


def test_bounds_of_what_is_withstood_are_widened_and_times_only_where_there_is_nothing_else() -> (
    None
):
    def number(unit: str, role: Any = None, lowest: bool = False) -> Any:
        return SimpleNamespace(unit=unit, role=role, lowest=lowest)

    kinds: Any = {"k": number("1/s"), "L": number("m", INPUT), "T": number("s", INPUT),
                  "low": number("N", INPUT, True), "none": number("m", INPUT)}  # fmt: skip
    system: Any = SimpleNamespace(numbers=kinds)
    given = {"k": F(2), "L": F(3), "T": F(1, 100), "low": F(6), "none": F(0)}
    assert with_margin(system, given, 1.5) == {
        "k": F(2), "L": F(9, 2), "T": F(1, 100), "low": F(4), "none": F(0)}  # fmt: skip
    below = with_margin(system, given | {"low": F(-6)}, 1.5)
    assert below["low"] == F(-9)
    few = {n: given[n] for n in ("k", "T", "none")}
    assert with_margin(system, few, 3.0) == {"k": F(2), "T": F(3, 100), "none": F(0)}


def test_certificates_of_a_loop_are_those_of_its_scenario_or_of_any() -> None:
    declared = [gains(n, loop) for n, loop in
                (("p", "a"), ("q", "b"), ("r", "a@wet"), ("s", "a@dry"), ("t", "a"))]  # fmt: skip
    assert [g.name for g in promises_of_loop(declared, "a", "wet")] == ["p", "r", "t"]
    assert [g.name for g in promises_of_loop(declared, "b", "wet")] == ["q"]
