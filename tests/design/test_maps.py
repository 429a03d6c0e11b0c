"""Maps: each point is decided as it is by itself; what is drawn is what was decided."""

from __future__ import annotations

import json
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from slipctl import BadInput
from slipctl.certify import catalogue
from slipctl.certify.promise import exact_numbers
from slipctl.certify.proofs import decide
from slipctl.commands.certificates.certify import loop_verdict
from slipctl.commands.cli import main
from slipctl.design import gain_points, maps
from slipctl.design.gain_points import replaced_numbers
from slipctl.draw import regions
from slipctl.study.jobs import Cores

SYSTEM = catalogue.system("super_twisting")
GIVEN = {"k1": 3.0, "k2": 2.0, "L": 1.0}


def drawn(axes: str = "k1=0.5:8,k2=0.5:8", points: int = 9, jobs: int = 1) -> maps.Map:
    with Cores(jobs) as cores:
        at = replaced_numbers(SYSTEM, GIVEN)
        return maps.drawn_map(at, maps.read_axes(axes, SYSTEM, GIVEN), "a law", points, cores)


def test_regions_are_those_of_the_theory() -> None:
    """k2 <= L is refuted by a constant disturbance; k1^2 >= 8 (k2 + L), k2 > L cannot overshoot."""
    found = drawn()
    xs, ys = (a.values(9) for a in (found.x, found.y))
    for row, k2 in zip(found.verdicts, ys, strict=True):
        for verdict, k1 in zip(row, xs, strict=True):
            if k2 <= 1:
                assert verdict == "REFUTED"
            elif k1**2 >= 8 * (k2 + 1):
                assert verdict == "CERTIFIED"
    assert {v for row in found.verdicts for v in row} <= {"CERTIFIED", "REFUTED", "UNDECIDED"}
    assert found.here == "CERTIFIED"


def test_a_margin_is_a_factor_on_the_bound() -> None:
    """A point of margin m is certified with L = m; the next level above it is not."""
    found = drawn(points=4)
    levels = (1.0, *maps.LEVELS)
    for margins, k2 in zip(found.margins, found.y.values(4), strict=True):
        for m, k1 in zip(margins, found.x.values(4), strict=True):
            for level in levels:
                at = exact_numbers(
                    SYSTEM, {"k1": float(k1), "k2": float(k2), "L": Fraction(str(level))}
                )
                assert (decide(SYSTEM, at).verdict == "CERTIFIED") == (level <= m)


@pytest.mark.parametrize("hole", ["UNDECIDED", BadInput("no"), ArithmeticError()])
@pytest.mark.parametrize("at", range(len(maps.LEVELS)))
def test_a_margin_is_that_up_to_which_every_one_is_proved(hole, at, monkeypatch) -> None:
    """What is proved beyond one that is not counts for nothing."""

    def decide(system: Any, level: float) -> Any:
        if level != maps.LEVELS[at]:
            return SimpleNamespace(verdict="CERTIFIED")
        if isinstance(hole, str):
            return SimpleNamespace(verdict=hole)
        raise hole

    monkeypatch.setattr(maps.proofs, "decide", decide)
    monkeypatch.setattr(maps, "exact_numbers", lambda system, given: 1.0)
    monkeypatch.setattr(maps, "with_margin", lambda system, numbers, level: level)
    found = maps.point_verdict(lambda point: (None, point), {})  # type: ignore[arg-type, return-value]
    assert found == ("CERTIFIED", (1.0, *maps.LEVELS)[at])


def test_a_number_that_a_certificate_follows_has_a_place_at_either_end_of_its_range(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It is moved up, or down where it may not go up; one in a point of a range has no place."""
    monkeypatch.setattr(gain_points, "places", lambda *given: ("ctl.k", "ctl.k"))
    monkeypatch.setattr(gain_points, "check_guards", lambda loop: None)

    def place(k: float, lo: float, hi: float, name: str = "k") -> str | None:
        def moved(**own: float) -> Any:
            (value,) = own.values()
            if not lo <= value <= hi:
                raise BadInput("outside")
            return SimpleNamespace(k=value)

        gains = SimpleNamespace(numbers=lambda loop: {"k": loop.k, "fixed": 7.0})
        loop = SimpleNamespace(k=k, with_params=moved)
        points = gain_points.GainPoints(gains, loop, "ctl")  # type: ignore[arg-type]
        return points.place(name)

    assert place(2.0, 1.0, 2.0) == place(2.0, 2.0, 9.0) == place(2.0, 0.0, 9.0) == "ctl.k"
    assert place(2.0, 2.0, 2.0) is None
    assert place(2.0, 0.0, 9.0, "fixed") is None


def test_cores_change_nothing_and_cells_touch() -> None:
    """Two processes find what one finds; borders lie between cells that differ, and only there."""
    one = drawn(points=5)
    assert one == drawn(points=5, jobs=2)
    codes = np.array([[0, 0, 1], [0, 1, 1]])
    edges = np.arange(4.0)
    lines = regions._borders(codes, edges, edges[:3])
    assert sorted(lines) == [
        [(1.0, 1.0), (1.0, 2.0)], [(1.0, 1.0), (2.0, 1.0)], [(2.0, 0.0), (2.0, 1.0)]
    ]  # fmt: skip


def test_an_axis_without_a_range_goes_from_a_tenth_to_ten_times_the_design_point() -> None:
    x, y = maps.read_axes("k1,k2=1:60", SYSTEM, GIVEN)
    assert (x.lo, x.hi) == pytest.approx((GIVEN["k1"] / 10, GIVEN["k1"] * 10))
    assert (y.lo, y.hi) == (1.0, 60.0)


@pytest.mark.parametrize(("axes", "said"), [
    ("k1", "write two numbers"), ("k1,k1", "write two numbers"), ("k1,k3", "has no 'k3'"),
    ("k1=5:1,k2", "lo < hi"), ("k1=5,k2", "write k1=LO:HI"), ("k1=1:2m,k2", "another dimension"),
    ("k1,T", "T is not given"), ("", "has no ''"),
])  # fmt: skip
def test_axes_that_are_none(axes: str, said: str) -> None:
    with pytest.raises(BadInput, match=said):
        maps.read_axes(axes, SYSTEM, GIVEN)


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Picture and data; other lines end with 2."""
    given = ["k1=3", "k2=2", "L=1"]
    line = ["certify", "super_twisting", "--set", *given, "--map", "k1,k2", "--points", "3"]
    assert main([*line, "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    data: dict[str, Any] = json.loads((tmp_path / "map.json").read_text())
    flat = [v for row in data["verdicts"] for v in row]
    assert f"{flat.count('CERTIFIED')} CERTIFIED" in said
    assert data["verdict_here"] == "CERTIFIED"
    assert [*data["axes"]] == ["k1", "k2"]
    for end in ("png", "svg"):
        assert (tmp_path / f"map.{end}").stat().st_size > 1000
    for bad in (
        [*line, "--json"], [*line, "--set", "k3=2"], ["certify", "subway_braking", "--map", "a,b"],
        ["certify", "subway_braking:stb"], [*line, "--out", str(tmp_path / "a.json")],
    ):  # fmt: skip
        assert main(bad) == 2


def test_a_loop_answers_without_a_typed_number(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """``STUDY:LOOP`` gives the certificates of the loop, and one verdict of all at the top."""
    assert main(["certify", "subway_braking:sta", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert list(found)[:4] == ["format", "study", "loop", "verdict"]
    assert found["verdict"] == found["gains"]["sta"]["verdict"] == "CERTIFIED"
    line = ["certify", "subway_braking:smc", "--map", "g1,g2", "--points", "2"]
    assert main([*line, "--out", str(tmp_path)]) == 0
    assert "the design point is REFUTED" in capsys.readouterr().out


def test_a_point_of_a_map_is_what_certify_says_of_the_loop_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where a bound depends on a gain, it is the bound at the point: one loop, one verdict."""
    axes = "k1=20:80,k2=2:20"
    line = ["certify", "subway_braking:sta", "--map", axes, "--points", "2"]
    assert main([*line, "--out", str(tmp_path)]) == 0
    capsys.readouterr()
    found = json.loads((tmp_path / "map.json").read_text())
    bounds = set()
    for k2, row in zip(found["axes"]["k2"]["values"], found["verdicts"], strict=True):
        for k1, verdict in zip(found["axes"]["k1"]["values"], row, strict=True):
            gains = [f"ctl.law.k1={k1!r}m^.5/s^1.5", f"ctl.law.k2={k2!r}m/s^3"]
            assert main(["certify", "subway_braking:sta", "--set", *gains, "--json"]) == 0
            said = json.loads(capsys.readouterr().out)
            assert said["gains"]["sta"]["verdict"] == verdict
            bounds.add(said["gains"]["sta"]["gains"]["L"]["value"])
    assert len(bounds) > 1
    assert found["verdicts"][0] == ["CERTIFIED", "REFUTED"]  # the bound of k1 = 20 would prove both


@pytest.mark.parametrize(("name", "said"), [
    ("hst_braking:pid", "its integral and its limits have no criterion"),
    ("all_rails:nmpc", "the solution of a program at each tick"),
    ("predictive:nmpc", "its terminal weight knows no limits"),
    ("own.py:loop", "declares no study, so it does not say what loop has to withstand"),
])  # fmt: skip
def test_what_has_no_criterion_is_told_in_a_line(
    name: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    Path("own.py").write_text("loop = 1\n")
    assert main(["certify", name]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1


@pytest.mark.parametrize(("verdicts", "whole"), [
    (["CERTIFIED", "CERTIFIED"], "CERTIFIED"), (["CERTIFIED", "UNDECIDED"], "UNDECIDED"),
    (["UNDECIDED", "REFUTED", "CERTIFIED"], "REFUTED"),
])  # fmt: skip
def test_one_verdict_of_several(verdicts: list[str], whole: str) -> None:
    class Answer:
        def __init__(self, verdict: str) -> None:
            self.report = type("Report", (), {"verdict": verdict})

    assert loop_verdict([Answer(v) for v in verdicts]) == whole  # type: ignore[misc]


@pytest.mark.parametrize("points", [2, 5, 9])
def test_cells_of_a_picture_meet_half_way_between_points(points: int) -> None:
    """In the middle on a straight scale, at the geometric mean on a logarithmic one."""
    line, log = maps.Axis("a", 2.0, 6.0, "1"), maps.Axis("b", 1.0, 100.0, "1")
    at, edges = line.values(points), maps._edges(line, points)
    assert at == pytest.approx(np.linspace(2.0, 6.0, points))
    assert edges[1:-1] == pytest.approx((at[1:] + at[:-1]) / 2)
    assert (edges[0] + edges[1]) / 2 == pytest.approx(2.0)
    at, edges = log.values(points), maps._edges(log, points)
    assert at == pytest.approx(np.geomspace(1.0, 100.0, points))
    assert edges[1:-1] == pytest.approx(np.sqrt(at[1:] * at[:-1]))
    assert np.sqrt(edges[-1] * edges[-2]) == pytest.approx(100.0)
