"""``slipctl compare``: what was changed comes first, differences are those of the numbers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import closed_loop, three_rails

from slipctl import BadInput, Signals, sweep
from slipctl.commands import compare
from slipctl.commands.cli import main
from slipctl.run import store


def run_folder(folder: Path, distance: float, m: float, loop: str = "sta") -> str:
    """A folder as ``slipctl run`` leaves it."""
    store.write_json(folder / "metrics.json", {
        "study": "s", "quick": False, "seed": {"base": 1}, "slipctl_version": "0.1.0",
        "parameters": {loop: {"car.m": {"value": m, "unit": "kg"}, "J": {"value": 1, "unit": "1"}}},
        "scenarios": {"base": {loop: {
            "distance": {"value": distance, "unit": "m"},
            "settling_time": {"value": [0.1, None], "unit": "s", "rows": ["dry", "wet"]},
        }}},
    })  # fmt: skip
    return str(folder)


def test_runs(tmp_path: Path, capsys: Any) -> None:
    """One parameter differs and is listed, one does not; a time that never came says so."""
    a, b = run_folder(tmp_path / "a", 80.0, 8e3), run_folder(tmp_path / "b", 82.5, 9e3)
    assert main(["compare", a, b]) == 0
    lines = [" ".join(x.split()) for x in capsys.readouterr().out.splitlines()]
    assert lines.index("sta: car.m kg 8000 9000") < lines.index("distance m 80 82.5 +2.5")
    assert "settling_time, dry s 0.1 0.1 0" in lines
    assert "settling_time, wet s never never –" in lines
    assert not any("J" in x for x in lines)
    assert main(["compare", a, b, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["metrics"]["base/sta"][0]["difference"] == [2.5]
    assert [c["what"] for c in found["changed"]] == ["sta: car.m"]
    other = run_folder(tmp_path / "c", 70.0, 8e3, "pid")
    assert main(["compare", a, other]) == 0  # the only loop of each
    assert "base/sta | base/pid" in capsys.readouterr().out


def test_sweeps(tmp_path: Path, capsys: Any) -> None:
    """Medians are those of the runs, differences those of runs on the same draws."""
    signals = Signals(speed="plant.wheel.v", slip="plant.wheel.v_s")
    found = []
    for name, m in (("a", 8e3), ("b", 16e3)):
        loop = closed_loop().with_params(**{"plant.wheel.m": m})
        found.append(sweep(loop, three_rails(0.05), {"ctl.law.k1": (5, 20)}, tmp_path / name,
                           samples=5, signals=signals, compile=False))  # fmt: skip
    assert main(["compare", str(tmp_path / "a"), str(tmp_path / "b"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [c["what"] for c in told["changed"]] == ["numbers and inputs"]
    (rows,) = told["metrics"].values()
    for row in rows:
        if "," in row["metric"]:
            continue
        a, b = (f.column(row["metric"]) for f in found)
        if not np.isfinite([a, b]).all():
            assert row["values"] == [None, None], "JSON has no infinity"
            assert row["never"] == [5, 5]
            continue
        assert row["values"] == [float(np.median(a)), float(np.median(b))]
        low, middle, high = np.quantile(b - a, (0.05, 0.5, 0.95))
        assert row["difference"] == [pytest.approx(middle)]
        assert row["paired"] == [pytest.approx([low, high])]
        assert row["beyond_spread"] == [bool(low > 0 or high < 0)]


@pytest.mark.parametrize("names", [["a"], ["a", "nowhere"], ["a", "torn"], ["a", "b"]])
def test_bad_folders(names: list[str], tmp_path: Path, capsys: Any) -> None:
    """One folder, none, a torn file, nothing in common: one line each."""
    run_folder(tmp_path / "a", 1.0, 1.0)
    run_folder(tmp_path / "b", 1.0, 1.0, "pid")
    other = json.loads((tmp_path / "b" / "metrics.json").read_text())
    other["scenarios"]["base"]["smc"] = {}
    (tmp_path / "b" / "metrics.json").write_text(json.dumps(other))
    (tmp_path / "torn").mkdir()
    (tmp_path / "torn" / "metrics.json").write_text('{"format": 1, "scenarios": {"base": 3}}')
    assert main(["compare", *(str(tmp_path / n) for n in names)]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


NO_NUMBERS = {
    "scenarios/base/sta/distance/value": ["x", True, {}, [[{}]], "1e999"],
    "scenarios/base/sta/distance/unit": [3, None, ["m"]],
    "scenarios/base/sta": [3, []],
    "parameters/sta/car.m": [-1, None, "8 t"],
    "parameters/sta/car.m/unit": [[1, 2]],
    "parameters/sta/car.m/value": ["heavy", {}],
    "parameters": [3, []],
}
"""What stands in a damaged file in place of what a run wrote, by the keys to it."""


@pytest.mark.parametrize(("keys", "odd"), [(k, v) for k, vs in NO_NUMBERS.items() for v in vs])
def test_damaged_metrics_are_refused_by_their_file(tmp_path: Path, keys: str, odd: Any) -> None:
    a, b = run_folder(tmp_path / "a", 80.0, 8e3), run_folder(tmp_path / "b", 82.5, 9e3)
    path = tmp_path / "b" / "metrics.json"
    found = json.loads(path.read_text(encoding="utf-8"))
    *outer, last = keys.split("/")
    at = found
    for key in outer:
        at = at[key]
    at[last] = odd
    path.write_text(json.dumps(found), encoding="utf-8")
    with pytest.raises(BadInput, match=r"metrics\.json is no file of slipctl"):
        compare.read(b)
    assert compare.read(a).units["distance"] == "m"


@pytest.mark.parametrize("text", ["[" * 50_000, '{"format": 1, "scenarios": {}', "null"])
def test_what_is_no_json_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "metrics.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(BadInput, match="no JSON file of slipctl"):
        compare.read(str(tmp_path))


def test_metrics_in_two_units_are_not_compared(tmp_path: Path) -> None:
    a, b = run_folder(tmp_path / "a", 80.0, 8e3), run_folder(tmp_path / "b", 82.5, 8e3)
    path = tmp_path / "b" / "metrics.json"
    path.write_text(path.read_text(encoding="utf-8").replace('"m"', '"km"'), encoding="utf-8")
    with pytest.raises(BadInput, match=r"distance is in m .* in km"):
        compare.metric_rows([compare.read(a), compare.read(b)])
