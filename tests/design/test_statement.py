"""Statements of fresh draws: counted, checked in integers, run again bit for bit."""

from __future__ import annotations

import copy
import json
import math
import re
from collections.abc import Mapping, Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from test_tune import tuned

from slipctl import RunFailed
from slipctl.certify.arithmetic import binomial
from slipctl.certify.entries import DoesNotHold
from slipctl.commands.certificates import check
from slipctl.commands.cli import main
from slipctl.design import page, statement
from slipctl.design.gain_search import FIRST_PROOF
from slipctl.design.goals import Limit, read_objective
from slipctl.errors import BadInput
from slipctl.run.metrics import Metric
from slipctl.run.sweep.ensemble import Ensemble


@pytest.fixture(autouse=True)
def few_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half of all draws, with an error of 1 in 10: 4 draws, then 5, then 5."""
    monkeypatch.setattr(statement, "SHARE", Fraction(1, 2))
    monkeypatch.setattr(statement, "BETA", Fraction(1, 10))


def stated(out: Path | None = None, **changes: Any) -> Any:
    return tuned(out, prove=True, **({"runs": 4} | changes)).statement


@pytest.mark.long
def test_draws_of_a_statement_are_its_own(tmp_path: Path) -> None:
    """No draw of the search or of the judgement is among them, nor of another attempt."""
    world = tuned(runs=4).search.rolls.world
    drawn = [world.draw(s, k).numbers["plant.wheel.m"] for s in range(5) for k in range(20)]
    assert len(set(drawn)) == len(drawn)
    found = stated()
    assert found["attempt"] == 1
    assert found["draws"] == binomial.draws_needed(Fraction(1, 2), Fraction(1, 10)) == 4
    draw = world.draw(FIRST_PROOF, 3)
    gains = dict(tuned(runs=4).gains)
    value = world.metrics(gains, draw)["slip_error_rms"].value
    assert found["values"][3] == value.hex()


@pytest.mark.long
def test_a_statement_that_falls_short_is_followed_by_another(tmp_path: Path) -> None:
    """One that reached its share stays; else the next attempt has draws and a level of its own."""
    good = stated(tmp_path / "good")
    assert stated(tmp_path / "good") == good
    narrow = {"free": {"ctl.law.k1": (19.9, 20.1)}, "runs": 4}
    rolls = tuned(**narrow).search.rolls
    least = min(rolls.world.metrics({}, rolls.draw(0, k))["slip_error_rms"].value for k in range(4))
    # the best of the four draws keeps this limit, and so do few of others
    limit = {"subject_to": [f"slip_error_rms@0.25<={1.0005 * least!r}m/s"]}
    found = [stated(tmp_path / "bad", **narrow, **limit) for _ in range(3)]
    assert [f["attempt"] for f in found] == [1, 2, 3]
    assert [f["draws"] for f in found] == [4, 5, 5]  # 0.5^4 < 1/10, 0.5^5 < 1/20, < 1/30
    assert len({v for f in found for v in f["values"]}) == 14
    for f in found[:2]:
        assert not all(c.reached for c in statement.check({**f, "set": [], "swapped": []}))


@pytest.mark.parametrize(("attempt", "whole"), [(1, "1/10"), (2, "3/20"), (3, "11/60")])
def test_attempts_are_counted(attempt: int, whole: str) -> None:
    """The j-th has a j-th of the error; what is told is the sum over all of them."""
    assert statement.level(attempt) == Fraction(1, 10 * attempt)
    assert statement.error_chance(attempt) == Fraction(whole)


def test_numbers_are_rounded_to_the_safe_side() -> None:
    """A bound that is told is not below the largest draw, a share not above what is proved."""
    claim = statement.Claim("x", 9, 0, Fraction(98765432, 10**8), Fraction(1, 2))
    assert "98.7654 %" in claim.line(Fraction(1, 3 * 10**6))
    assert "3.33334e-7" in claim.line(Fraction(1, 3 * 10**6))
    assert statement._bound(92.80000001, "m") == "92.8001 m"
    assert statement._bound(-92.80009, "m") == "-92.8000 m"


@pytest.mark.long
def test_an_altered_statement_does_not_hold() -> None:
    """Counts, shares, draws and the ensemble belong together."""
    found = {**stated(subject_to=["slip_max<=3m/s"]), "set": [], "swapped": []}
    assert len(statement.lines(found)) == 2

    def altered(*path: Any, value: Any) -> dict[str, Any]:
        other = copy.deepcopy(found)
        inner = other
        for key in path[:-1]:
            inner = inner[key]
        inner[path[-1]] = value
        return other

    for other in (
        altered("claims", 0, "violations", value=1),
        altered("claims", 0, "share", value="99/100"),
        altered("claims", 0, "values", 0, value=(99.0).hex()),
        altered("ensemble", "draw", "plant.wheel.m", value="6t:7t"),
        altered("attempt", value=9),
    ):
        with pytest.raises(DoesNotHold):
            statement.check(other)
    for other in (
        altered("draws", value=3), altered("values", 0, value="nan"), altered("draws", value=True),
        altered("values", 0, value=1.5), altered("ensemble", value={}), altered("more", value=1),
        altered("claims", 0, "limit", value=[]), altered("values", 0, value="0x1p99999"),
    ):  # fmt: skip
        with pytest.raises(BadInput):
            statement.check(other)


@pytest.mark.long
def test_draws_run_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """``--rerun`` repeats draws of a study's loop; one bit of a value or a gain is noticed."""
    line = ["tune", "subway_braking:sta@base", "--free", "k1=15:30", "--minimise", "distance",
            "--samples", "4", "--runs", "4", "--held-out", "2", "--prove", "--subject-to",
            "slip_max<=2m/s", "--out", str(tmp_path)]  # fmt: skip
    monkeypatch.setattr(page, "page", lambda found, command: "")  # drawing takes its time
    assert main(line) == 0
    file = tmp_path / "certificate.json"
    assert main(["check", str(file), "--rerun", "2"]) == 0
    assert "2 draws run again, bit for bit" in capsys.readouterr().out
    payload = json.loads(file.read_text())
    payload["gains"]["ctl.law.k1"]["value"] = "15.5"
    file.write_text(json.dumps(payload))
    with pytest.raises(RunFailed, match="gives distance ="):
        check.rerun(str(file), 1)
    del payload["statistical"]
    file.write_text(json.dumps(payload))
    assert main(["check", str(file), "--rerun", "2"]) == 2
    assert main(["check", str(file), "--rerun", "0"]) == 2
    assert "holds no statement" in capsys.readouterr().err


@pytest.mark.long
def test_1375_draws_say_99_percent(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the share and the chance of the command; of 1375 draws, one beyond a limit is too many.

    The tail is that of the binomial: (1 - 1/100)^1375 <= 1e-6 < (1 - 1/100)^1374.
    """
    monkeypatch.undo()
    tail = Fraction(99, 100)
    assert tail**1375 <= statement.BETA < tail**1374
    limit = {"subject_to": ["slip_max<=9m/s"], "runs": 4, "compile": True}
    found = {**tuned(prove=True, **limit).statement, "set": [], "swapped": []}
    assert (found["draws"], found["attempt"], len(set(found["values"]))) == (1375, 1, 1375)
    for line in statement.lines(found):
        assert "in at least 99.0002 % of draws, confidence 1 - 1e-6: 0 of 1375 fresh" in line
    kept = statement.check(found)[1]
    assert kept.reached
    assert kept.share >= tail
    seen = [float.fromhex(v) for v in found["claims"][0]["values"]]
    worst = [s if k else 9.5 for k, s in enumerate(seen)]
    beyond = statement._claim(Limit("", "slip_max", True, 9.0, "m/s"), worst, statement.BETA)
    found["claims"][0] = beyond
    missed = statement.check(found)[1]
    assert missed.violations == 1
    assert not missed.reached
    beyond["share"] = str(tail)  # more than its draws prove
    with pytest.raises(DoesNotHold, match="do not prove the share 99/100"):
        statement.check(found)


# ---- a statement by hand -------------------------------------------------------------------------


def by_hand(**changes: Any) -> dict[str, Any]:
    """Ten draws of which one is lost, and a limit that two of them are beyond."""
    seen = [0.1 * k for k in range(1, 11)]
    ensemble = Ensemble(draw={"m": "1 t:2 t"})
    claim = {
        "text": "x <= .85", "metric": "x", "upper": True, "limit": (0.85).hex(), "unit": "m/s",
        "wanted": "1/5", "violations": 2,
        "share": str(1 - binomial.largest_share(10, 2, Fraction(1, 10))),
        "values": [v.hex() for v in seen],
    }  # fmt: skip
    return {
        "ensemble": ensemble.told(), "hash": ensemble.hash, "scenario": "base", "seed": 3,
        "attempt": 1, "draws": 10, "objective": "x", "unit": "m/s",
        "values": [*(v.hex() for v in seen[:-1]), math.inf.hex()],
        "claims": [claim | changes.pop("claim", {})],
    } | changes  # fmt: skip


def test_a_statement_counts_its_draws() -> None:
    value, limit = statement.check(by_hand())
    assert (value.draws, value.violations, limit.draws, limit.violations) == (10, 1, 10, 2)
    # largest p that one of ten, or two, would still allow with a tenth: the binomial tail
    for claim in (value, limit):
        p = 1 - float(claim.share)
        tail = sum(math.comb(10, k) * p**k * (1 - p) ** (10 - k)
                   for k in range(claim.violations + 1))  # fmt: skip
        assert tail == pytest.approx(0.1, rel=1e-3)
    assert (value.text, limit.wanted) == ("x has a value", Fraction(1, 5))
    assert not value.reached or value.share >= statement.SHARE
    whole = by_hand(values=[(0.125 * k).hex() for k in range(10)], unit="1")
    assert statement.check(whole)[0].text == "x <= 1.125"
    line = statement.lines(by_hand())[1]
    assert line.startswith("x <= 0.8")
    assert "2 of 10 fresh draws are beyond" in line
    assert f"(ensemble {by_hand()['hash'][:16]}, seed 3, attempt 1)" in line
    below = {"upper": False, "limit": (0.25).hex()}
    assert statement.check(by_hand(claim=below))[1].text.startswith("x >= 0.25")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"hash": "0" * 64}, "the hash is not that of the ensemble"),
        ({"claim": {"violations": 1}}, "1 violations are not what its draws show"),
        ({"claim": {"share": "99/100"}}, "do not prove the share 99/100"),
        ({"claim": {"share": "-1"}}, "do not prove the share -1"),
        ({"values": [1.0] * 10}, "'1.0' is no number as a hexadecimal text"),
        ({"values": ["0" * 41] * 10}, "is no number as a hexadecimal text"),
        ({"values": ["one"] * 10}, "'one' is no number as a hexadecimal text"),
        ({"values": ["0x1p99999"] * 10}, "is no number as a hexadecimal text"),
        ({"values": ["nan"] * 10}, "a number in it is nan"),
        ({"values": ["0x1p0"] * 9}, "statistical.values"),
        ({"attempt": 0}, "statistical.attempt"),
        ({"attempt": 1001}, "statistical.attempt"),
        ({"seed": -1}, "statistical.seed"),
        ({"draws": 0}, "statistical.draws"),
    ],
)
def test_a_statement_that_its_draws_do_not_show_is_refused(changes: Any, said: str) -> None:
    with pytest.raises((DoesNotHold, BadInput), match=re.escape(said)):
        statement.check(by_hand(**changes))


@pytest.mark.parametrize("value", ["1/3", "2/3", "123456.7", "1/7000000", "12345678", "9999999.9"])
def test_a_number_of_a_statement_is_rounded_to_its_side(value: str) -> None:
    exact = Fraction(value)
    sides = ROUND_FLOOR, ROUND_CEILING
    low, high = (Fraction(statement._rounded(exact, side)) for side in sides)
    assert low <= exact <= high
    assert high - low <= exact / 10**5
    assert statement.level(4) == statement.BETA / 4
    assert statement.error_chance(3) == statement.BETA * Fraction(11, 6)


# ---- of draws that are made up -------------------------------------------------------------------


class Rolls:
    """Draws with these values of a metric, None of one that failed; how many are kept."""

    def __init__(
        self, values: Sequence[float | None], kept: Mapping[int, int] | None = None
    ) -> None:
        self.values, self.kept, self.asked = values, dict(kept or {}), list[int]()
        self.world = SimpleNamespace(
            ensemble=Ensemble({"plant.m": "6t:9t"}), seed=7,
            scenario=SimpleNamespace(name="base"),
        )  # fmt: skip

    def count(self, kind: int) -> int:
        return self.kept.get(kind, 0)

    def begin(self, text: str, many: int) -> None:
        pass

    def all(self, kind: int, asked: Sequence[Any]) -> list[Any]:
        self.asked.append(kind)
        assert [(k, n) for k, n, _ in asked] == [(5, {"k1": 2.0})] * len(asked)
        found = [self.values[k % len(self.values)] for _, _, k in asked]
        return [
            None if v is None
            else {"slip_max": Metric(v, "m/s"), "distance": Metric(9 * v, "m")} for v in found
        ]  # fmt: skip


def search(rolls: Rolls, *limits: Limit) -> Any:
    return SimpleNamespace(
        rolls=rolls, objective=read_objective("distance"), limits=limits,
        best=SimpleNamespace(number=5, numbers={"k1": 2.0}),
    )  # fmt: skip


def made(values: Sequence[float | None], *limits: Limit) -> dict[str, Any]:
    return {**statement.prove(search(Rolls(values), *limits)), "set": [], "swapped": []}


UPPER = Limit("slip_max<=3m/s", "slip_max", True, 3.0, "m/s")
LOWER = Limit("slip_max@0.25>=2m/s", "slip_max", False, 2.0, "m/s", 0.25)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.one_of(st.floats(0.5, 6), st.just(3.0), st.none()), min_size=4, max_size=4))
def test_a_claim_counts_the_draws_beyond_its_limit(values: list[float | None]) -> None:
    """On the limit is kept; a run that failed keeps none, and has no value of the objective."""
    found = made(values, UPPER, LOWER)
    first, upper, lower = statement.check(found)
    lost = sum(v is None for v in values)
    assert upper.violations == lost + sum(v is not None and v > 3 for v in values)
    assert lower.violations == lost + sum(v is not None and v < 2 for v in values)
    assert (first.violations, first.draws) == (lost, 4)
    assert (upper.wanted, lower.wanted) == (Fraction(1, 2), Fraction(1, 4))
    for c in (first, upper, lower):
        assert c.share == 1 - binomial.largest_share(4, c.violations, Fraction(1, 10))
        assert c.reached == (c.share >= c.wanted)
    assert upper.text == "slip_max <= 3 m/s"
    assert lower.text == "slip_max >= 2 m/s"
    if lost:
        assert first.text == "distance has a value"
    else:
        most = float(first.text.removeprefix("distance <= ").removesuffix(" m"))
        largest = 9 * max(v for v in values if v is not None)
        assert largest <= most < 1.0001 * largest + 1e-3
    said = statement.lines(found)
    assert len(said) == 3
    for line, c in zip(said, (first, upper, lower), strict=True):
        assert line.startswith(f"{c.text} in at least ")
        assert f"{c.violations} of 4 fresh draws are beyond" in line
        assert ("were wanted" in line) == (not c.reached)
        assert line.endswith("seed 7, attempt 1)")
        told = Fraction(line.partition("in at least ")[2].partition(" %")[0])
        assert 0 <= 100 * c.share - told < Fraction(1, 100)


def test_what_falls_short_is_followed_by_draws_of_its_own() -> None:
    """What is there already and reached its share is taken again; what did not has another one."""
    good, bad = Rolls([1.0], {FIRST_PROOF: 4}), Rolls([5.0], {FIRST_PROOF: 4, FIRST_PROOF + 1: 5})
    assert statement.prove(search(good, UPPER))["attempt"] == 1
    assert good.asked == [FIRST_PROOF]
    found = statement.prove(search(bad, UPPER))
    assert (found["attempt"], found["draws"]) == (3, 5)
    assert bad.asked == [FIRST_PROOF, FIRST_PROOF + 1, FIRST_PROOF + 2]
    begun = Rolls([5.0], {FIRST_PROOF: 3})  # it was stopped before its last draw
    assert statement.prove(search(begun, UPPER))["attempt"] == 1


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("claims", 0, "violations"), 0), (("claims", 0, "violations"), 2),
        (("claims", 0, "share"), "99/100"), (("claims", 0, "share"), "2"),
        (("claims", 0, "share"), "-1/2"), (("claims", 0, "values", 1), (9.0).hex()),
        (("claims", 0, "upper"), False), (("claims", 0, "limit"), (0.1).hex()),
        (("ensemble", "draw", "plant.m"), "6t:7t"), (("hash",), "0"), (("attempt",), 9),
    ],
)  # fmt: skip
def test_what_its_draws_do_not_show_does_not_hold(path: Sequence[Any], value: Any) -> None:
    found = made([1.0, 2.0, 5.0, 2.5], UPPER)
    statement.check(found)
    with pytest.raises(DoesNotHold):
        statement.check(_with(found, path, value))


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("draws",), 3), (("draws",), True), (("draws",), 0), (("attempt",), 0), (("seed",), -1),
        (("attempt",), 1001), (("values", 0), "nan"), (("values", 0), 1.5), (("values", 0), "x"),
        (("values", 0), "0x1p99999"), (("values", 0), "0" * 41), (("values",), []),
        (("ensemble",), {}), (("ensemble",), 3), (("more",), 1), (("claims", 0, "limit"), []),
        (("claims", 0, "values"), []), (("claims", 0, "wanted"), 0.5), (("claims",), 3),
        (("claims", 0, "violations"), 5), (("claims", 0, "more"), 5),
    ],
)  # fmt: skip
def test_what_is_no_statement_is_refused(path: Sequence[Any], value: Any) -> None:
    with pytest.raises(BadInput):
        statement.check(_with(made([1.0, 2.0, 5.0, 2.5], UPPER), path, value))


def _with(found: dict[str, Any], path: Sequence[Any], value: Any) -> dict[str, Any]:
    """The same with another entry."""
    other = copy.deepcopy(found)
    inner: Any = other
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    return other


def test_draws_that_are_run_again_hang_on_the_whole_file() -> None:
    """Nobody knows them before; as many as asked, each once, and all where there are no more."""
    one = statement.repeated_draws({"a": 1}, 5, 100)
    assert one == sorted(set(one)) == statement.repeated_draws({"a": 1}, 5, 100)
    assert len(one) == 5
    assert set(one) <= set(range(100))
    assert one != statement.repeated_draws({"a": 2}, 5, 100)
    assert statement.repeated_draws({"a": 1}, 500, 9) == list(range(9))


@pytest.mark.parametrize(
    ("payload", "said"),
    [
        ({}, "holds no statement of draws; slipctl tune ... --prove writes one"),
        ({"statistical": {"set": 3}, "loop": "subway_braking:sta@base"}, "set must be a list"),
        ({"statistical": {"swapped": [3]}, "loop": "subway_braking:sta@base"}, "swapped must be"),
        ({"statistical": {}, "loop": "subway_braking"}, "it must be STUDY:LOOP@SCENARIO"),
        ({"statistical": {}, "loop": "subway_braking:sta"}, "it must be STUDY:LOOP@SCENARIO"),
        ({"statistical": {}, "loop": "subway_braking:sta@base", "gains": {"k1": 3}}, "no numbers"),
        ({"statistical": {}, "loop": "subway_braking:sta@base"}, "are no numbers by name"),
    ],
)  # fmt: skip
def test_a_file_whose_draws_cannot_run_again_says_why(
    payload: dict[str, Any], said: str, tmp_path: Path
) -> None:
    file = tmp_path / "certificate.json"
    file.write_text(json.dumps(payload))
    with pytest.raises(BadInput, match=said):
        check.rerun(str(file), 2)
