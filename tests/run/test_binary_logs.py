"""Logs in Parquet and MDF4: the same faults and the same resampling as of text."""

from __future__ import annotations

import gc
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slipctl import BadInput, from_text
from slipctl.commands.cli import main
from slipctl.run.logs import binary_logs
from slipctl.run.logs.recorded_log import read_recording
from slipctl.run.logs.replay import replay

BLOCK = from_text("y = 2*x where x [m]")


@pytest.fixture(scope="module", autouse=True)
def _nothing_else_to_collect() -> None:
    """What a damaged file leaves is collected at once, and with it all that the suite has made."""
    gc.freeze()


def parquet(path: Path, columns: dict[str, Any], units: dict[str, str] | None = None) -> Path:
    pa = pytest.importorskip("pyarrow")
    import pyarrow.parquet as pq

    arrays = {n: v if isinstance(v, pa.Array) else pa.array(v) for n, v in columns.items()}
    about = {n: {"unit": u} for n, u in (units or {}).items()}
    fields = [pa.field(n, a.type, metadata=about.get(n)) for n, a in arrays.items()]
    pq.write_table(pa.table(list(arrays.values()), schema=pa.schema(fields)), path)
    return path


def mdf4(path: Path, *groups: dict[str, tuple[Any, Any, str]]) -> Path:
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF(version="4.10") as file:
        for group in groups:
            file.append([asammdf.Signal(np.asarray(x), np.asarray(t, dtype=float), unit=u, name=n)
                         for n, (t, x, u) in group.items()])  # fmt: skip
        file.save(path, overwrite=True)
    return path


def test_parquet_is_read_as_text_is(tmp_path: Path) -> None:
    """A row late, one twice, empty cells, units in the name or beside the column."""
    t = np.arange(40) * 0.01
    x = np.sin(9 * t)
    cells = [None if k in (7, 8) else float(v) for k, v in enumerate(x)]
    order = [0, 2, 1, *range(3, 20), 19, *range(20, 40)]
    rows = {"Time [ms]": 1e3 * t[order], "x": [cells[k] for k in order], "note": ["a"] * 41}
    file = parquet(tmp_path / "log.parquet", rows, {"x": "km"})
    text = tmp_path / "log.csv"
    text.write_text("Time [ms],x [km]\n" + "".join(
        f"{float(1e3 * t[k])!r},{'' if cells[k] is None else repr(cells[k])}\n" for k in order
    ), encoding="utf-8")  # fmt: skip
    found, same = (
        replay(BLOCK, read_recording(f), {"x": "x"}, beside={"y": "x"}, compile=False)
        for f in (file, text)
    )
    assert np.array_equal(found.data["y"].values, same.data["y"].values)
    assert np.array_equal(found.compared[0].recorded, same.compared[0].recorded, equal_nan=True)
    assert [n.replace("row 3", "line 4").replace("row 21", "line 22")
            for n in found.notes] == same.notes  # fmt: skip
    log = read_recording(file, wanted=["X"])
    assert (log.columns, list(log.table.others)) == (["x"], ["note"])
    with pytest.raises(BadInput, match="no column 'nota'; did you mean 'note'"):
        log.table.find("nota")


def test_dates_in_parquet(tmp_path: Path) -> None:
    """Times of a calendar are seconds from the first, to the last ns; a frame's index is a time."""
    pd = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    at = pd.to_datetime([1_700_000_000_000_000_001, 1_700_000_000_250_000_001])
    frame = pd.DataFrame({"x": [1.0, 2.0], "on": [True, False]}, index=at)
    frame.to_parquet(tmp_path / "log.parquet")
    log = read_recording(tmp_path / "log.parquet")
    assert list(log.time) == [0.0, 0.25]
    assert list(log.channel("on")) == [1.0, 0.0]


def test_channels_of_several_time_bases(tmp_path: Path) -> None:
    """Each is held or interpolated from its own samples; arithmetic takes the last of the other."""
    fast, slow = np.arange(0, 1, 0.01), np.arange(0.005, 1, 0.1)
    file = mdf4(
        tmp_path / "log.mf4",
        {"Wheel": (fast, 3.6 * fast, "km/h"), "Raw": (fast, np.arange(100, dtype=np.int16), "-")},
        {"Train": (slow, slow, "m/s"), "Other": (slow, slow, "m")},
    )
    log = read_recording(file, wanted=["Wheel", "train[m/s] - Wheel"])
    assert log.columns == ["Wheel", "Train"]
    assert sorted(log.table.others) == ["Other", "Raw"]
    assert log.spacing == pytest.approx(0.01)
    assert log.gaps == []
    block = from_text("y = 2*v where v [m/s]")
    for rule, wanted in (("hold", np.floor(fast / 0.1 + 1e-9) * 0.1), ("linear", fast)):
        found = replay(block, log, {"v": "Train"}, period=0.01, rule=rule, compile=False)
        y = found.data["y"].values[:80]
        at = found.data.attrs["log_start_s"]
        assert at == pytest.approx(0.005)
        assert np.allclose(y, 2 * (wanted[:80] + at), atol=1e-9)  # roundings of the ticks' times
        assert not any("empty" in n for n in found.notes)
    difference = replay(block, log, {"v": "Wheel - Train"}, period=0.01, compile=False)
    held = 0.005 + 0.1 * np.floor((fast - 0.005) / 0.1 + 1e-9)
    first = difference.data.attrs["log_start_s"]
    assert first == pytest.approx(0.01)
    assert np.allclose(difference.data["y"].values, 2 * (fast - held)[1:], atol=1e-9)


def test_invalid_samples_and_texts_of_mdf(tmp_path: Path) -> None:
    """What is marked invalid is an empty cell; a channel of texts has no numbers."""
    asammdf = pytest.importorskip("asammdf")
    t = np.arange(10) * 0.1
    bad = np.zeros(10, dtype=bool)
    bad[4] = True
    signals = [
        asammdf.Signal(t**2, t, unit="m", name="x", invalidation_bits=bad),
        asammdf.Signal(np.array([b"on"] * 10), t, name="state", encoding="utf-8"),
    ]
    with asammdf.MDF(version="4.10") as file:
        file.append(signals)
        file.save(tmp_path / "log.mf4", overwrite=True)
    log = read_recording(tmp_path / "log.mf4")
    assert list(np.flatnonzero(np.isnan(log.channel("x")))) == [4]
    assert np.isnan(log.channel("state")).all()
    found = replay(BLOCK, log, {"x": "x"}, compile=False)
    assert any("1 empty cells" in n for n in found.notes)
    with pytest.raises(BadInput, match="times of its own; leave --time out"):
        read_recording(tmp_path / "log.mf4", "t")
    with pytest.raises(BadInput, match="no channel that is asked for"):
        read_recording(tmp_path / "log.mf4", wanted=["y"])


@pytest.mark.parametrize("content", [b"PAR1", b"MDF ", b"UnFi"])
@pytest.mark.parametrize("more", [b"", b"PAR1", bytes(range(256)) * 3, b"    4.10    \x00" * 20])
def test_damaged_files(content: bytes, more: bytes, tmp_path: Path, capsys: Any) -> None:
    """A file that only begins well is one line."""
    pytest.importorskip("pyarrow")
    pytest.importorskip("asammdf")
    file = tmp_path / "log.dat"
    file.write_bytes(content + more)
    line = ["replay", str(file), "--with", "y = 2*x where x [m]", "--out", str(tmp_path / "out")]
    assert main(line) == 2
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 1, told
    assert str(file) in told[0]


def test_missing_extras(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One line names the extra."""
    for begin, module, extra in ((b"PAR1", "pyarrow", "parquet"), (b"MDF ", "asammdf", "mdf4")):
        (tmp_path / "log").write_bytes(begin)
        monkeypatch.setitem(sys.modules, module, None)
        with pytest.raises(BadInput, match=rf"needs the extra {extra}: pip install .*\[{extra}\]"):
            read_recording(tmp_path / "log")


def test_too_large(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file is refused before it is read; fewer columns may pass."""
    rows = {"t": np.arange(100.0), "x": np.arange(100.0), "z": np.arange(100.0)}
    file = parquet(tmp_path / "log.parquet", rows)
    monkeypatch.setattr(binary_logs, "LARGEST", 8 * 200)
    with pytest.raises(BadInput, match="cut it into logs"):
        read_recording(file)
    assert read_recording(file, wanted=["x"]).columns == ["x"]


def test_a_channel_without_times_is_told_and_those_behind_it_are_read(tmp_path: Path) -> None:
    asammdf = pytest.importorskip("asammdf")
    t, file = np.arange(5.0), tmp_path / "log.mf4"
    with asammdf.MDF(version="4.10") as made:
        for name in ("lost", "x", "z"):
            made.append([asammdf.Signal(2 * t, t, name=name)])
        made.groups[0].channels[0].sync_type = 2  # an angle
        made.save(file, overwrite=True)
    found = read_recording(file)
    assert found.columns == ["x", "z"]
    assert any("lost" in note for note in found.notes)


@pytest.mark.parametrize(
    ("changes", "scale"),
    [({}, 1.0), ({"unit": "ms"}, 1e-3), ({"unit": ""}, 1.0), ({"unit": "ticks"}, 1.0),
     ({"unit": "t"}, 0.0), ({"sync_type": 2}, 0.0),
     ({"sync_type": 3, "unit": "m"}, 0.0), ({"sync_type": 0, "channel_type": 0}, 0.0)],
)  # fmt: skip
def test_places_angles_and_counts_of_a_measurement_are_no_times(
    changes: dict[str, Any], scale: float, tmp_path: Path
) -> None:
    """A master in ms is in ms; what is over a distance or has no master is left out, and told."""
    asammdf = pytest.importorskip("asammdf")
    t, file = np.arange(5.0), tmp_path / "log.mf4"
    with asammdf.MDF(version="4.10") as made:
        made.append([asammdf.Signal(t, 4 * t, name="x")])
        for name, value in changes.items():
            setattr(made.groups[0].channels[0], name, value)
        made.save(file, overwrite=True)
    if scale:
        assert read_recording(file, wanted=["x"]).time == pytest.approx(4 * scale * t)
    else:
        with pytest.raises(BadInput, match=r"x \(without times\)"):
            read_recording(file, wanted=["x"])


def test_of_channels_that_share_a_name_the_first_is_read(tmp_path: Path) -> None:
    """Those behind are read as ever; a file that is too large is told as such."""
    t = np.arange(4.0)
    groups = [{n: (t, k + t, "m")} for k, n in ((10, "x"), (20, "z"), (30, "x"), (40, "w"))]
    log = read_recording(mdf4(tmp_path / "log.mf4", *groups))
    assert log.columns == ["x", "z", "w"]
    assert [log.channel(n)[0] for n in log.columns] == [10, 20, 40]
    assert "2 channels are called x; the first is read" in log.notes


def test_too_many_numbers_of_a_measurement_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    t = np.arange(100.0)
    file = mdf4(tmp_path / "log.mf4", dict.fromkeys("wxz", (t, t, "m")))
    monkeypatch.setattr(binary_logs, "LARGEST", 8 * 150)
    with pytest.raises(BadInput, match="cut it into logs"):
        read_recording(file)
    assert read_recording(file, wanted=["x"]).columns == ["x"]


def test_a_measurement_of_one_sample_is_no_log(tmp_path: Path) -> None:
    file = mdf4(tmp_path / "log.mf4", {"x": ([2.0], [1.0], "m")})
    with pytest.raises(BadInput, match="has 1 different times; a log needs two or more"):
        read_recording(file)
