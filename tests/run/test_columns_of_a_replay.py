"""What a block hears over a log: columns with their units, numbers that are set, gaps, faults."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from slipctl import BadInput, Input, Output, Param, State, connect, flow, step
from slipctl.errors import Faults
from slipctl.run.logs import log_signals
from slipctl.run.logs.recorded_log import read_recording
from slipctl.run.logs.replay import replay

H = 0.1
U = [1.0, 2.0, 4.0, 3.0, 0.0, -1.0, 5.0, 6.0]


@step(period=H, y=Output("m/s", "weighed"), z=Output("1", "count"), row=Output("1", shape=(2,)))
def sums(
    n=State("m/s", 0.0, "sum so far"),
    u=Input("m/s", "first", lo=-10, hi=10),
    w=Input("1", "weight", value=2.0),
    h=Input("1", "height"),
    k=Param("1", 3.0, "gain"),
):
    """Sums what it hears."""
    import casadi as ca

    return dict(n=n + u), dict(y=k * u * w, z=h, row=ca.vertcat(h, h))


def log_of(tmp_path: Path, head: str, *columns: list[float], gap: float | None = None):
    rows = [",".join("" if v != v else repr(v) for v in row) for row in zip(*columns, strict=True)]
    file = tmp_path / "log.csv"
    file.write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    return read_recording(file, gap=gap)


def times(many: int = 8) -> list[float]:
    return [round(H * k, 6) for k in range(many)]


def run(log, mapping, **more):
    return replay(sums, log, mapping, compile=False, **more)


def test_columns_by_name_by_map_and_numbers_that_are_set(tmp_path):
    """u in km/h by --map, h by its own name, w as declared or set, k and the start set."""
    log = log_of(tmp_path, "time [s],speed [km/h],h [-]", times(), [3.6 * v for v in U], [0.5] * 8)
    found = run(log, {"u": "speed"})
    assert found.data["y"].values == pytest.approx(3.0 * 2.0 * np.array(U))
    assert found.data["z"].values == pytest.approx([0.5] * 8)
    assert any("h is read from the column of its name" in line for line in found.notes)
    assert any("w is not mapped; it is 2, as declared" in line for line in found.notes)
    log = read_recording(tmp_path / "log.csv")
    given = {"w": "50 %", "k": "4", "n": "36 km/h"}
    found = run(log, {"u": "speed"}, settings=given)
    assert found.data["y"].values == pytest.approx(4.0 * 0.5 * np.array(U))
    assert found.data["n"].values == pytest.approx(10.0 + np.cumsum([0.0, *U[:-1]]))
    assert not any("w is not mapped" in line for line in found.notes)


def test_arithmetic_of_columns_takes_parameters_and_is_missing_where_one_is(tmp_path):
    """b is empty in each second row: there the last sum is held."""
    b = np.array([1.0, np.nan, 3.0, np.nan, 5.0, np.nan, 7.0, np.nan])
    log = log_of(
        tmp_path, "time [s],a [km/h],b [m/s],h", times(), [3.6 * v for v in U], b.tolist(), U
    )
    found = run(log, {"u": "a + b/k - 1*b", "h": "h*2"})
    wanted = np.repeat((np.array(U) + b / 3 - b)[::2], 2)
    assert found.data["y"].values == pytest.approx(6.0 * wanted)
    assert found.data["z"].values == pytest.approx(2 * np.array(U))
    assert any("u = a + b/k - 1*b (a from km/h to m/s)" in line for line in found.notes)


def test_missing_and_impossible_samples_are_bridged_as_the_rule_says(tmp_path):
    """Empty in rows 2 and 3, 99 m/s off the range in row 6: held, or a straight line."""
    x = [1.0, 2.0, np.nan, np.nan, 6.0, 5.0, 99.0, 7.0]
    log = log_of(tmp_path, "time [s],u,h", times(), x, [1.0] * 8)
    hold = run(log, {"u": "u[m/s]"})
    assert hold.data["y"].values / 6 == pytest.approx([1, 2, 2, 2, 6, 5, 5, 7])
    line = run(log, {"u": "u[m/s]"}, rule="linear")
    assert line.data["y"].values / 6 == pytest.approx([1, 2, 10 / 3, 14 / 3, 6, 5, 6, 7])
    for found, how in ((hold, "the last value held"), (line, "a straight line across")):
        assert any(f"u: 2 empty cells, {how}, for 0.3 s at most" in n for n in found.notes)
        assert any(f"u: 1 samples off -10 .. 10 m/s, {how}" in n for n in found.notes)


def test_what_is_beside_is_compared_where_the_log_has_samples(tmp_path):
    """Five ticks are without a row: there nothing is compared; another unit is turned."""
    at = [t for t in times(14) if not 0.45 < t < 0.95]
    u = [1.0 + k for k in range(len(at))]
    log = log_of(
        tmp_path, "time [s],u [m/s],h,there [km/h]", at, u, u, [21.6 * v for v in u], gap=0.3
    )
    found = run(log, {}, beside={"y": "there", "n": "u"})
    assert found.gaps == [(0.4, 1.0)]
    inside = found.outside_gaps()
    assert list(np.flatnonzero(~inside)) == [5, 6, 7, 8, 9]
    y, n = found.compared
    assert (y.output, y.unit, n.output) == ("y", "m/s", "n")
    assert np.isnan(y.recorded[5:10]).all()
    assert y.recorded[inside] == pytest.approx(y.computed[inside])
    assert n.recorded[inside] == pytest.approx(u)
    assert any("1 gaps, the last value held: 0.4 .. 1 s" in line for line in found.notes)


def test_a_flow_runs_at_the_spacing_of_the_log_or_at_a_period_that_is_told(tmp_path):
    @flow()
    def cart(v=State("m/s", 2.0, "speed"), a=Input("m/s^2", "acceleration")):
        """Drives."""
        return dict(v=a), {}

    log = log_of(tmp_path, "time [s],a [m/s^2]", times(), [0.5] * 8)
    for period, many in ((None, 8), (0.05, 15), (0.15, 5)):
        found = replay(cart, log, {}, period=period, compile=False)
        ticks = np.arange(many) * (period or H)
        assert found.data["v"].values == pytest.approx(2.0 + 0.5 * ticks)
        assert not any("resampled" in line for line in found.notes)
    slow = replay(cart, log, {}, period=0.25, compile=False)
    assert any("samples every 0.1 s are resampled to ticks of 0.25 s" in x for x in slow.notes)


FAULTS = [
    ({"u": "nothing"}, {}, {}, "--map u: .*'nothing'"),
    ({"u": "h"}, {}, {}, "--map u: "),
    ({"q": "h"}, {}, {}, "--map q: sums has no input 'q'"),
    ({"u": "a + h"}, {}, {}, "--map u: a . h: "),
    ({"u": "a*q"}, {}, {}, "--map u: .*'q'"),
    ({"u": "a"}, {"w": "3 m"}, {}, "--set w"),
    ({"u": "a"}, {"q": "3"}, {}, "--set sums has no .*'q'"),
    ({"u": "a"}, {"u": "11 m/s"}, {}, "--set u = 11"),
    ({"u": "a"}, {}, {"q": "a"}, "--beside q: sums has no output or state 'q'"),
    ({"u": "a"}, {}, {"y": "nothing"}, "--beside y: "),
    ({}, {}, {}, r"sums.u \[m/s\] is not fed; write --map u=COLUMN, or --set u=VALUE;"),
]  # fmt: skip


@pytest.mark.parametrize(("mapping", "settings", "beside", "said"), FAULTS)
def test_what_is_wrong_is_told_with_what_a_person_wrote(mapping, settings, beside, said, tmp_path):
    log = log_of(tmp_path, "time [s],a [m/s],h [-]", times(), U, U)
    with pytest.raises(Faults, match=said):
        run(log, mapping, settings=settings, beside=beside)


def test_a_log_that_gives_no_run_is_refused(tmp_path):
    log = log_of(tmp_path, "time [s],u [m/s],h", times(), [50.0] * 8, U)
    with pytest.raises(BadInput, match=r"log.csv: u has no sample that u may take"):
        run(log, {})
    good = log_of(tmp_path, "time [s],u [m/s],h", times(), U, U)
    with pytest.raises(BadInput, match="there is no rule 'lineal'; did you mean 'linear'"):
        run(good, {}, rule="lineal")
    with pytest.raises(BadInput, match=r"sums has a period of 0\.1 s; leave --period out"):
        run(good, {}, period=0.2)
    with pytest.raises(BadInput, match="row is no single number; compare another output"):
        run(good, {}, beside={"row": "h"})


def test_a_part_of_a_log_is_as_if_only_that_were_there(tmp_path):
    log = log_of(tmp_path, "time [s],u [m/s],h", times(), U, U)
    part = log.between(0.2, 0.5)
    assert list(part.time) == pytest.approx([0.2, 0.3, 0.4, 0.5])
    assert list(part.channel("u")) == U[2:6]
    assert run(part, {}).data["y"].values == pytest.approx(6.0 * np.array(U[2:6]))
    with pytest.raises(
        BadInput, match=r"fewer than two samples from 0.31 s to 0.45 s .* ends at 0.7"
    ):
        log.between(0.31, 0.45)


@pytest.mark.parametrize(("spacing", "lines"), [(0.048, 1), (0.052, 0)])
def test_samples_that_are_closer_than_half_a_tick_are_told(spacing, lines, tmp_path):
    t = [round(spacing * k, 6) for k in range(20)]
    log = log_of(tmp_path, "time [s],u,h", t, [1.0] * 20, [1.0] * 20)
    told = [line for line in run(log, {}).notes if "anti-aliasing" in line]
    assert len(told) == lines


@pytest.mark.parametrize("gaps", [1, 5, 6, 9])
def test_five_gaps_are_told_with_their_times_and_all_are_counted(gaps, tmp_path):
    t = [H * k for k in range(10 * gaps + 10) if k < 10 or k % 10 > 2]
    log = log_of(tmp_path, "time [s],u,h", t, [1.0] * len(t), [1.0] * len(t), gap=0.15)
    (told,) = [line for line in run(log, {}).notes if "gaps" in line]
    assert told.startswith(f"{gaps} gaps")
    assert told.count(" .. ") == min(gaps, 5)
    assert told.endswith(", ...") == (gaps > 5)


def test_innovations_are_those_outputs_that_are_called_so(tmp_path):
    names = ("innovation", "innovation_v", "residual", "nis", "y")

    @step(period=H, **{n: Output("1") for n in names})
    def filtered(n=State("1", 0.0), u=Input("1")):
        """Says what it did not expect."""
        return dict(n=u), dict.fromkeys(names, u - n)

    log = log_of(tmp_path, "time [s],u", times(), U)
    for block, home in ((filtered, ""), (connect("loop", {"a.u": "u"}, a=filtered), "a.")):
        found = replay(block, log, {}, compile=False).innovations
        assert found == [home + n for n in names[:-1]]


def test_samples_that_are_slow_for_the_ticks_are_told(tmp_path):
    """As where times in ms are read in s."""
    for spacing, told in ((3.0, True), (1.0, False)):
        t = [spacing * k for k in range(4)]
        log = log_of(tmp_path, "time,u,h", t, U[:4], U[:4])
        assert told == any("are slow for ticks of 0.1 s" in line for line in run(log, {}).notes)


@pytest.mark.parametrize(("text", "told"), [
    ("a/3.6", True), ("0.2778*a", True), ("a*1000/3600", False), ("a / 3", False),
    ("b/3.6", False), ("3.6*a[km/h] + b", True), ("a + 3.61*b", False),
])  # fmt: skip
def test_a_number_that_turns_a_unit_a_second_time_is_told(text, told, tmp_path):
    log = log_of(tmp_path, "time [s],a [km/h],b [m/s]", times(), U, U)
    log_signals.source_of(sums, log, sums.inputs["u"], text)
    assert told == any("turns a a second time" in line for line in log.notes)


def test_a_column_of_its_name_that_cannot_be_it_is_told_beside_the_others(tmp_path):
    """A weight is no speed; what is not there is told behind it."""
    log = log_of(tmp_path, "time [s],u [kg],w [N]", times(), U, U)
    with pytest.raises(Faults) as told:
        run(log, {})
    assert [line.partition(": ")[0] for line in told.value.lines[:2]] == [
        "the column u", "the column w"]  # fmt: skip
    assert told.value.lines[2].startswith("sums.h [1] is not fed; write --map h=COLUMN")


def test_a_vector_and_a_second_run_are_not_replayed(tmp_path):
    @step(period=H, y=Output("1"))
    def pair(u=Input("1", shape=(2,))):
        """Adds two."""
        return {}, dict(y=u[0] + u[1])

    log = log_of(tmp_path, "time [s],u", times(), U)
    with pytest.raises(BadInput, match=r"u has shape \(2,\); a column gives one number"):
        replay(pair, log, {}, compile=False)
    again = log_of(tmp_path, "time [s],u [m/s],h", [*times(4), *times(4)], U, U)
    with pytest.raises(BadInput, match="goes back in line 6, where a further run begins; a replay"):
        run(again, {})


def test_inputs_behind_one_that_is_set_or_told_are_fed(tmp_path):
    """u by --map, w set, and then h by its name."""
    log = log_of(tmp_path, "time [s],a [m/s],h", times(), U, [0.5 * v for v in U])
    found = run(log, {"u": "a"}, settings={"w": "3"})
    assert found.data["z"].values == pytest.approx(0.5 * np.array(U))
    assert found.data["y"].values == pytest.approx(9.0 * np.array(U))
