"""Tables as people have them: what is read right, and what is refused with its row and cause."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from dialects import speeds

from slipctl import BadInput
from slipctl.block.units.unit_algebra import parse_quantity, unit
from slipctl.models.trials import coasting
from slipctl.run.logs.log_signals import source_of
from slipctl.run.logs.recorded_log import Recording, read_recording
from slipctl.tables.columns import unit_of_column
from slipctl.tables.heads import other_unit_in_name, unit_in_name
from slipctl.tables.layout import text_of
from slipctl.tables.table import read_table

V = [3.6 * v for v in speeds()][:400]
HEAD = "t [s];v [km/h]\n"


def rows(line: Callable[[float, float, int], str]) -> str:
    return "".join(line(k / 10, v, k) + "\n" for k, v in enumerate(V))


def plain(t: float, v: float, k: int) -> str:
    return f"{t:.1f};{v:.2f}"


def comma(x: float, digits: int) -> str:
    return f"{x:.{digits}f}".replace(".", ",")


def clock(t: float, begin: float = 28800.0) -> str:
    t += begin
    return f"{int(t // 3600) % 24:02d}:{int(t // 60) % 60:02d}:{t % 60:06.3f}"


READ = {
    "quoted decimal commas": "t [s],v [km/h]\n" + rows(
        lambda t, v, k: f'"{comma(t, 1)}","{comma(v, 2)}"'),
    "a mark behind each row": HEAD + rows(lambda t, v, k: plain(t, v, k) + ";"),
    "formulas": HEAD + rows(lambda t, v, k: f'="{t:.1f}";="{v:.2f}"'),
    "the index of a frame": ",t,v [km/h]\n" + rows(lambda t, v, k: f"{k},{t:.1f},{v:.2f}"),
    "a number of each row": "Nr;Zeit;v [km/h]\n" + rows(lambda t, v, k: f"{k};{plain(t, v, k)}"),
    "numpy": "# t [s], v [km/h]\n" + rows(lambda t, v, k: f"{t:.18e},{v:.18e}"),
    "blanks": "t[s]   v[km/h]\n" + rows(lambda t, v, k: f"{t:8.1f} {v:8.2f}"),
    "markdown": "| t [s] | v [km/h] |\n|---|---|\n" + rows(
        lambda t, v, k: f"| {t:.1f} | {v:.2f} |"),
    "a 1 among units": "t;v;x\ns;km/h;1\n" + rows(lambda t, v, k: plain(t, v, k) + ";3"),
    "units above": "s;km/h\nt;v\n" + rows(plain),
    "units and types": "t;v\nfloat;float\ns;km/h\n" + rows(plain),
    "the form of a clock": "Zeit;v\nhh:mm:ss;km/h\n" + rows(
        lambda t, v, k: f"{clock(t)};{v:.2f}"),
    "pairs before the head": "".join(f"par {k};{1.5 * k}\n" for k in range(29)) + HEAD
    + rows(plain),
    "Swiss thousands": "t [ms];v [mm/s]\n" + rows(
        lambda t, v, k: f"{1000 * t:,.0f};{v / 0.0036:,.1f}".replace(",", "'")),
    "narrow blanks": "t [ms];v [mm/s]\n" + rows(
        lambda t, v, k: f"{1000 * t:,.0f};{v / 0.0036:,.1f}".replace(",", "\u202f")),
    "thousands of ms": "t [ms];v [km/h]\n" + rows(
        lambda t, v, k: f"{1000 * t:,.0f}".replace(",", ".") + f";{comma(v, 2)}"),
    "midnight": "Zeit;v [km/h]\n" + rows(lambda t, v, k: f"{clock(t, 86380)};{v:.2f}"),
    "minutes of a spreadsheet": "Zeit;v [km/h]\n" + rows(
        lambda t, v, k: f"{clock(t, 3580)[3:-2]};{v:.2f}"),
    "days of a spreadsheet": "Zeit;v [km/h]\n" + rows(
        lambda t, v, k: f"{45413.4 + t / 86400:.9f};{v:.2f}"),
    "date and time": "Datum;Uhrzeit;v [km/h]\n" + rows(
        lambda t, v, k: f"1.5.24;{clock(t)};{v:.2f}"),
    "lines of old Macs": (HEAD + rows(plain)).replace("\n", "\r"),
    "the head again": (HEAD + rows(plain)).replace("\n20.0;", f"\n{HEAD}20.0;"),
    "unit in a name": "time_ms,vKmh\n" + rows(lambda t, v, k: f"{1000 * t:.0f},{v:.2f}"),
    "cm/s in a name": "t [s];v_cms\n" + rows(lambda t, v, k: f"{t:.1f};{v / 0.036:.1f}"),
    "unit behind in": "Zeit in s;v in km/std\n" + rows(plain),
    "unit behind a slash": "t/s;v/(km/h)\n" + rows(plain),
    "Fortran": HEAD + rows(lambda t, v, k: f"{t:.6E};{v:.8E}".replace("E", "D")),
    "one clock in two columns": "log_s [s];log_ms [ms];v [km/h]\n" + rows(
        lambda t, v, k: f"{t:.1f};{1000 * t:.0f};{v:.2f}"),
    "a cycle time beside the time": "cycle [ms];run [s];v [km/h]\n" + rows(
        lambda t, v, k: f"100;{plain(t, v, k)}"),
    "columns that share a name": "t [s];v [km/h];x;x\n" + rows(
        lambda t, v, k: plain(t, v, k) + ";0;1"),
}  # fmt: skip

REFUSED = {
    "a decimal comma between commas": (
        "t [s],v [km/h]\n" + rows(lambda t, v, k: f"{t:.0f},{f'{v:g}'.replace('.', ',')}"),
        r"line 2 has 3 cells, its head 2.*decimal comma"),
    "its other half in a column without name": (
        "t [s],v [km/h],\n" + rows(lambda t, v, k: f"{k},{comma(v, 2)}"), "line 2 .*decimal comma"),
    "its other half in another column": (
        "t [s],v [km/h],door\n" + rows(lambda t, v, k: f"{k},{comma(v, 2)}"), "one number"),
    "no times": ("Nr;v [km/h]\n" + rows(lambda t, v, k: f"{k};{v:.2f}"), "no column of times"),
    "ms without a unit": ("t;v [km/h]\n" + rows(lambda t, v, k: f"{1000 * t:.0f};{v:.2f}"),
                          "s would be 100 s from row to row"),
    "two units of time": ("time_ms [s];v [km/h]\n" + rows(plain), "its head s and its name ms"),
    "two units of speed": ("t [s];v_kmh [m/s]\n" + rows(plain), "never overruled"),
    "another dimension in a name": ("t [s];v_rpm\n" + rows(plain), "in rpm by its name"),
    "a temperature by its name": ("t [s];v_degC\n" + rows(plain), "in degC by its name"),
    "other units further on": (
        ("t;v\ns;km/h\n" + rows(plain)).replace("\n20.0;", "\nt;v\ns;m/s\n20.0;"), "line 203"),
    "a word": (HEAD + rows(plain).replace("30.0;", "30.0;12. Mai "), "'12. Mai .*' in line 302"),
    "other marks in a column": (HEAD + rows(lambda t, v, k: f"{t};{comma(v, 2)}" if k == 9 else
                                            plain(t, v, k)), "in line 11 has other marks"),
    "three digits": ("t [ms];v [km/h]\n" + rows(lambda t, v, k: f"{100 * k};{v:.3f}"),
                     r"in line 2 may be 79\.293 or 79293"),
    "a time for each signal": ("t_door [s];door;t_v [s];v [km/h]\n" + rows(
        lambda t, v, k: f"{2 * t:.1f};0;{plain(t, v, k)}"), "t_door and t_v may both be the time"),
    "a time for each signal, by name": ("Time_a [s];Time_v [s];v [km/h]\n" + rows(
        lambda t, v, k: f"{t + k // 200:.1f};{plain(t, v, k)}"), "Time_a and Time_v may both"),
    "newest first": (HEAD + "".join(reversed(rows(plain).splitlines(keepends=True))), "fall"),
    "coarse times": ("Zeit;v [km/h]\n" + rows(lambda t, v, k: f"{clock(t)[:8]};{v:.2f}"),
                     "time of the row before, the first in line 3"),
    "hours and minutes, or minutes and seconds": (
        "Zeit;v [km/h]\n" + rows(lambda t, v, k: f"{clock(t)[:5]};{v:.2f}"),
        "line 2: '08:00' is no"),
    "a quote that is open": (HEAD + rows(lambda t, v, k: f"{t};{v:.2f}" + ';"x' * (k == 395)),
                             "quotes stand in pairs"),
    "two lines in one": (HEAD + rows(plain).replace("\n30.0", "30.0"), "line 301 has 3 cells"),
}  # fmt: skip


def read(text: str, file: Path) -> tuple[Recording, np.ndarray]:
    file.write_text(text, encoding="utf-8", newline="")
    log = read_recording(file)
    name = next((n for n in log.columns if n.startswith("v")), "v")
    return log, source_of(coasting, log, coasting.states["v"], name).values(log)


@pytest.mark.parametrize("what", READ)
def test_it_is_read_right(what: str, tmp_path: Path) -> None:
    log, v = read(READ[what], tmp_path / "log.csv")
    assert np.allclose(log.time, np.arange(400) / 10, atol=1e-4)  # days have nine digits
    assert np.allclose(v, np.array(V) / 3.6, atol=0.0015)  # half a hundredth of a km/h


@pytest.mark.parametrize("head", ["°C", "degC", "degF"])
def test_a_temperature_is_no_speed_whatever_one_says_of_it(head: str, tmp_path: Path) -> None:
    file = tmp_path / "log.csv"
    file.write_text(f"t [s];v [{head}]\n" + rows(plain), encoding="utf-8")
    with pytest.raises(BadInput, match="offset"):
        source_of(coasting, read_recording(file), coasting.states["v"], "v[m/s]")


@pytest.mark.parametrize("what", REFUSED)
def test_it_is_refused_with_row_and_cause(what: str, tmp_path: Path) -> None:
    text, said = REFUSED[what]
    with pytest.raises(BadInput, match=said) as error:
        read(text, tmp_path / "log.csv")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("name", "wanted", "unit", "other"), [
    ("F_kN", "N", "kN", ""), ("TorqueNm", "N m", "Nm", ""), ("v_cms", "m/s", "cm/s", ""),
    ("v_kN", "m/s", "", "kN"), ("v_degC", "m/s", "", "degC"), ("T_degC", "K", "", ""),
    ("slip_percent", "1", "%", ""), ("bar", "m/s", "", ""), ("vKmh", "m/s", "km/h", ""),
    ("RPM", "rad/s", "rpm", ""), ("rpm1", "rad/s", "rpm", ""), ("rpm_2", "rad/s", "rpm", ""),
    ("kmh_front", "m/s", "km/h", ""), ("bar", "Pa", "bar", ""), ("a_mps2", "m/s^2", "m/s^2", ""),
    ("way_km", "m", "km", ""), ("gap_mm2", "m", "mm", ""), ("p_MPa", "Pa", "MPa", ""),
    ("U_kV", "V", "kV", ""), ("yaw_deg_s", "rad/s", "deg/s", ""), ("turn_deg", "rad", "deg", ""),
    ("w_Hz", "rad/s", "Hz", ""), ("km_run", "m", "", ""), ("v_2", "m/s", "", ""),
])  # fmt: skip
def test_a_unit_in_a_name(name: str, wanted: str, unit: str, other: str) -> None:
    """That of the wanted dimension, which may be all of the name; or another one that ends it."""
    assert (unit_in_name(name, wanted), other_unit_in_name(name, wanted)) == (unit, other)


@pytest.mark.parametrize("mark", [".", ","])
def test_a_person_says_the_decimal_mark(mark: str, tmp_path: Path) -> None:
    file = tmp_path / "log.csv"
    file.write_text("t [ms];x\n" + "".join(f"{k};1{mark}{k:03d}\n" for k in range(100)))
    assert read_recording(file, decimal=mark).channel("x")[7] == 1.007
    other = "," if mark == "." else "."
    assert read_recording(file, decimal=other).channel("x")[7] == 1007


@pytest.mark.parametrize(("text", "same"), [
    ("U/min", "rpm"), ("Km/h", "km/h"), ("KM/H", "km/h"), ("Bar", "bar"), ("Promille", "‰"),
    ("Prozent", "%"), ("mps", "m/s"), ("msec", "ms"), ("usec", "us")])  # fmt: skip
def test_units_as_people_write_them(text: str, same: str) -> None:
    assert unit(text).same(unit(same))


def test_a_gradient_is_said_by_its_ratio() -> None:
    assert parse_quantity("1 in 25", "1") == 0.04
    assert parse_quantity("-1:40", "%") == pytest.approx(-2.5)
    assert parse_quantity("1 in -25", "1") == -0.04
    with pytest.raises(BadInput, match="is no gradient"):
        parse_quantity("1 in 0", "1")
    with pytest.raises(BadInput):
        parse_quantity("1 in 25", "m/s")
    for text in ("°C", "°F", "degC"):
        with pytest.raises(BadInput, match="scale with an offset"):
            unit(text)


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="needs a device without end")
def test_what_has_no_end_is_refused(monkeypatch) -> None:
    """A device says that it has 0 bytes, and gives as many as are read."""
    monkeypatch.setattr("slipctl.tables.layout.LARGEST", 1 << 20)
    with pytest.raises(BadInput, match="1 MB or more"):
        text_of(Path("/dev/zero"))


def marked(value: str, every: int = 90) -> str:
    """Rows of which some have a number that marks a missing one."""
    return HEAD + rows(lambda t, v, k: f"{t:.1f};{value}" if k % every == 7 else plain(t, v, k))


@pytest.mark.parametrize(
    "value",
    ["-999.25", "3.4028235e38", "9.9E37", "65535.00"],
)
def test_a_number_that_no_sensor_gives_is_refused_with_its_row(value: str, tmp_path: Path) -> None:
    file = tmp_path / "log.csv"
    file.write_text(marked(value), encoding="utf-8")
    log = read_recording(file)
    with pytest.raises(BadInput, match=r"first in line 9.*missing value"):
        log.channel("v")


def test_a_number_that_stands_alone_is_told_and_a_wheel_that_locks_is_not(tmp_path: Path) -> None:
    file = tmp_path / "log.csv"
    file.write_text(marked("0.00"), encoding="utf-8")
    log = read_recording(file)
    assert np.sum(log.channel("v") == 0) == 5
    assert any("5 values far from the values before and after, 0 (the first in line 9)" in n
               for n in log.notes)  # fmt: skip
    held = HEAD + rows(lambda t, v, k: plain(t, v * (not 50 < k < 90), k))
    flags = "t [s];v\n" + rows(lambda t, v, k: f"{t:.1f};{int(k % 90 == 7)}")
    for text in (held, flags, HEAD + rows(plain)):
        file.write_text(text, encoding="utf-8")
        log = read_recording(file)
        assert np.isfinite(log.channel("v")).all()
        assert not any("far from" in n for n in log.notes)


def test_an_integer_that_overflows_is_refused_with_its_row(tmp_path: Path) -> None:
    def wrapped(t: float, v: float, k: int) -> str:
        raw = round(32000 + 20 * k)
        return f"{t:.1f};{(raw + 32768) % 65536 - 32768}"

    file = tmp_path / "log.csv"
    file.write_text("t [s];v [mm/s]\n" + rows(wrapped), encoding="utf-8")
    with pytest.raises(BadInput, match="in line 41 follows 32760: the logger's number overflows"):
        read_recording(file).channel("v")


@pytest.mark.parametrize("value", ["-999", "65535", "1e30", "9.96921e36"])
def test_a_stretch_of_marks_of_missing_values_is_refused_with_its_row(
    value: str, tmp_path: Path
) -> None:
    def lost(t: float, v: float, k: int) -> str:
        return f"{t:.1f};{value if 60 <= k < 90 else f'{v:.2f}'}"

    file = tmp_path / "log.csv"
    file.write_text(HEAD + rows(lost), encoding="utf-8")
    with pytest.raises(BadInput, match=r"the first in line 62\) is far beyond all other values"):
        read_recording(file).channel("v")
    pa = pytest.importorskip("pyarrow")
    typed = tmp_path / "log.parquet"
    speed = np.where(np.arange(90) % 30 == 7, float(value), np.arange(90) // 9)  # whole numbers
    table = pa.table({"t [s]": np.arange(90.0), "v [km/h]": speed})
    pytest.importorskip("pyarrow.parquet").write_table(table, typed)
    with pytest.raises(BadInput, match=r"the first in row 8\) is far beyond all other values"):
        read_recording(typed).channel("v")


def test_a_value_that_is_held_and_then_jumps_is_told(tmp_path: Path) -> None:
    def held(t: float, v: float, k: int) -> str:
        return plain(t, 20.0 - 0.05 * (60 if 60 <= k < 90 else k), k)

    def stands(t: float, v: float, k: int) -> str:
        return plain(t, max(0.0, 20.0 - 0.3 * k), k)

    file = tmp_path / "log.csv"
    for line, told in ((held, True), (stands, False)):
        file.write_text(HEAD + rows(line), encoding="utf-8")
        log = read_recording(file)
        log.channel("v")
        assert told == any("30 rows from line 62 on, then it jumps" in n for n in log.notes)


@pytest.mark.parametrize(("mark", "refused"), [(";", True), (",", False)])
def test_whole_thousands_of_ms_may_be_meant_unless_commas_part_the_cells(
    mark: str, refused: bool, tmp_path: Path
) -> None:
    file = tmp_path / "log.csv"
    lines = (f"{k / 10:.3f}{mark}{20 - 0.05 * k:.2f}" for k in range(10, 40))
    file.write_text(f"t [ms]{mark}v [km/h]\n" + "\n".join(lines), encoding="utf-8")
    if refused:
        with pytest.raises(BadInput, match=r"'1\.000' in line 2 may be 1\.000 or 1000"):
            read_recording(file)
    else:
        assert read_recording(file).time[-1] == pytest.approx(2.9e-3)


def test_a_column_is_found_by_its_name_in_any_letters_or_by_its_head(tmp_path: Path):
    """Where two differ in their letters alone, only as written; what is not there is told."""
    path = tmp_path / "log.csv"
    path.write_text("t [s];Speed [km/h];force;Force\n0;1;2;3\n1;2;3;4\n")
    table = read_table(path)
    assert table.find("Speed") == table.find("speed") == table.find("SPEED") == "Speed"
    assert table.find("Speed [km/h]") == "Speed"
    assert (table.find("force"), table.find("Force")) == ("force", "Force")
    for name in ("FORCE", "velocity", "", "speed [km/h]"):
        with pytest.raises(BadInput, match=r"log\.csv has no column"):
            table.find(name)
    with pytest.raises(BadInput, match="did you mean 'Speed'"):
        table.find("sped")
    path.write_text("t [s];x;x;y\n0;1;2;3\n1;2;3;4\n")
    with pytest.raises(BadInput, match="its head has two columns 'x'; rename one"):
        read_table(path).find("x")
    assert read_table(path).numbers("y").tolist() == [3, 4]


@pytest.mark.parametrize(("value", "fine"), [("0.95e100", True), ("1.05e100", False)])
def test_a_number_beyond_what_can_be_squared_is_refused_whatever_its_sign(tmp_path, value, fine):
    path = tmp_path / "log.csv"
    for sign in ("", "-"):
        path.write_text(f"t [s];v\n0;{sign}{value}\n1;2\n", encoding="utf-8")
        if fine:
            assert abs(read_table(path).numbers("v")[0]) == float(value)
        else:
            with pytest.raises(BadInput, match="beyond what can be squared"):
                read_table(path).numbers("v")


@pytest.mark.parametrize("value", [999, 9999, 32767, 65535, 2**32 - 1, 1e20, 1e30, 3.4028235e38])
def test_what_loggers_write_for_nothing_is_refused_in_a_few_rows_too(tmp_path, value):
    """Of either sign; a number that is larger by a twentieth is one."""
    path = tmp_path / "log.csv"
    for number in (value, -value, 1.05 * value):
        text = f"t [s];v\n0;1.5\n1;{number!r}\n2;{number!r}\n3;1.25\n"
        path.write_text(text, encoding="utf-8")
        if number == 1.05 * value:
            assert read_table(path).numbers("v")[1] == number
        else:
            with pytest.raises(BadInput, match=r"line 3.*missing value"):
                read_table(path).numbers("v")


def sampled(values: list[float], file: Path) -> Recording:
    """A log with a row of each value, in 10 ms."""
    lines = (f"{k / 100:.2f};{v!r}\n" for k, v in enumerate(values))
    file.write_text("t [s];v [m/s]\n" + "".join(lines), encoding="utf-8")
    return read_recording(file)


@pytest.mark.parametrize("rows_of_it", [1, 3])
def test_a_number_that_stands_alone_is_told_of_a_sensor_that_is_slower_than_the_log(
    tmp_path: Path, rows_of_it: int
) -> None:
    """Four rows have the same speed, so that most steps are zero."""
    speed = [20.0 + 0.1 * (k // 4) for k in range(160)]
    held = sampled(speed, tmp_path / "log.csv")
    held.channel("v")
    assert not held.notes
    speed[40 : 40 + rows_of_it] = [655.35] * rows_of_it
    log = sampled(speed, tmp_path / "log.csv")
    log.channel("v")
    assert any("1 value far from" in n and "655.35 (line 42)" in n for n in log.notes)


@pytest.mark.parametrize("row", [0, 4, 9])
def test_one_mark_of_a_missing_value_is_told_in_a_few_rows_and_at_an_end(tmp_path: Path, row: int):
    values = [20.0 + k for k in range(10)]
    values[row] = -9999.0
    log = sampled(values, tmp_path / "log.csv")
    log.channel("v")
    assert any(f"-9999 (line {row + 2}); where it marks" in n for n in log.notes)


@pytest.mark.parametrize(("bits", "step"), [(8, 0.02), (16, 3), (16, -3), (32, 1000)])
def test_a_count_without_a_sign_that_begins_anew_is_refused(tmp_path: Path, bits: int, step: float):
    begin = 2**bits - 30 * step if step > 0 else -30 * step
    values = [(begin + step * k) % 2**bits for k in range(60)]
    with pytest.raises(BadInput, match="the logger's number overflows"):
        sampled(values, tmp_path / "log.csv").channel("v")
    for code in (22.0, 2.0**bits - 1):  # two marks are told as such
        text = [20.0 + k for k in range(40)]
        text[5] = text[6] = 2.0**bits - 1
        text[9] = code
        with pytest.raises(BadInput, match="missing value") if bits > 8 else nullcontext():
            sampled(text, tmp_path / "log.csv").channel("v")
    fine = [v + 0.3 * 2**bits for v in values]
    assert np.isfinite(sampled(fine, tmp_path / "log.csv").channel("v")).all()


@pytest.mark.parametrize("head", ["v [km/h] x10", "v [km/h]*0.1", "v [km/h] /10", "v*10 [km/h]",
                                  "v × 100 (km/h)", "v [10 km/h]"])  # fmt: skip
def test_a_number_beside_a_unit_is_no_part_of_a_name(tmp_path: Path, head: str) -> None:
    """Nothing tells whether the values are to be multiplied or have been: no such unit is read."""
    file = tmp_path / "log.csv"
    file.write_text(f"t [s];{head}\n0;1\n1;2\n", encoding="utf-8")
    table = read_table(file)
    assert "v" in table.cells
    with pytest.raises(BadInput, match="cannot be read"):
        unit_of_column(table, "v", "", "m/s", [])
    assert unit_of_column(table, "v", "km/h", "m/s", []) == "km/h"


def test_a_time_without_a_sign_that_begins_anew_is_a_further_run(tmp_path: Path) -> None:
    lines = (f"{(65400 + 10 * k) % 65536};{k}" for k in range(40))
    (tmp_path / "log.csv").write_text("time [ms];v\n" + "\n".join(lines), encoding="utf-8")
    assert read_recording(tmp_path / "log.csv").begins == (14,)


@pytest.mark.parametrize(("head", "wanted"), [("p [Mbar]", "Pa"), ("p [Mm]", "m"), ("p [Ms]", "s")])
def test_a_million_bar_is_meant_by_nobody(tmp_path: Path, head: str, wanted: str) -> None:
    file = tmp_path / "log.csv"
    file.write_text(f"t [s];{head}\n0;1\n1;2\n", encoding="utf-8")
    with pytest.raises(BadInput, match="is a million"):
        unit_of_column(read_table(file), "p", "", wanted, [])
