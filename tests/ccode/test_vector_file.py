"""A person's own test vectors, ``slipctl c --vectors FILE.csv``."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from slipctl import BadInput, Input, Output, step
from slipctl.ccode.check.vectors.vector_file import read_vectors
from slipctl.commands.cli import main

LAW = """from slipctl import Input, Output, State, step


@step(period=0.001, T=Output("N m", "torque", lo=-50, hi=50))
def law(
    x=State("m", 0.0, "sum of the slip", lo=-10, hi=10),
    v_s=Input("m/s", "slip speed", lo=-5, hi=5),
):
    \"\"\"Sum of the slip.\"\"\"
    return dict(x=x + v_s * 1e-3), dict(T=v_s + x)
"""


@step(period=1e-3, y=Output("1", "number"))
def arrays(
    v=Input("m/s", "speed"),
    omega=Input("rad/s", "wheel speeds", shape=(2,)),
    table=Input("1", "numbers", shape=(2, 2)),
):
    """Inputs of each shape."""
    return {}, dict(y=v / 1.0 + omega[0] + omega[1] + table[0, 1])


def table(folder: Path, text: str) -> Path:
    """A file with this text."""
    file = folder / "mine.csv"
    file.write_text(text, encoding="utf-8")
    return file


def test_columns_become_inputs_in_their_units(tmp_path: Path) -> None:
    """Units are converted, elements put together column by column, the time passed over."""
    file = table(
        tmp_path,
        "time [s],v [km/h],omega[1] [rpm],omega[0] [rad/s],table[0],table[1],table[2],table[3]\n"
        "0,36,60,1,1,2,3,4\n0.001,72,120,2,5,6,7,8\n\n",
    )
    found = read_vectors(file, arrays)
    np.testing.assert_allclose(found["v"], [10, 20], rtol=1e-15)
    np.testing.assert_allclose(found["omega"], [[1, 2 * np.pi], [2, 4 * np.pi]], rtol=1e-15)
    assert found["table"].tolist() == [[[1, 3], [2, 4]], [[5, 7], [6, 8]]]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "begins with no head"),
        ("v\n", "has no row below its head"),
        ("time\n0\n", "no column is an input of arrays; write v [m/s]"),
        ("w\n1\n", "'w' is no input of arrays"),
        ("v [kg]\n1\n", "column v: kg cannot be turned into m/s"),
        ("v,v\n1,1\n", "its head has v twice"),
        ("omega\n1\n", "omega has 2 elements; write omega[0] to omega[1]"),
        ("omega[2]\n1\n", "omega has 2 elements"),
        ("omega[0]\n1\n", "has no column omega[1]"),
        ("v\n1\n2,3\n", "row 2: 2 cells below a head of 1"),
        ("v\n1\nfast\n", "row 2: 'fast' is no finite number"),
        ("v\nnan\n", "row 1: 'nan' is no finite number"),
    ],
)  # fmt: skip
def test_what_is_no_table_of_inputs(tmp_path: Path, text: str, said: str) -> None:
    """One line: which file, which column or row, and what instead."""
    with pytest.raises(BadInput, match=re.escape(said)) as told:
        read_vectors(table(tmp_path, text), arrays)
    assert "mine.csv" in str(told.value)
    assert "\n" not in str(told.value)


def test_a_folder_is_made_and_tested_with_them(tmp_path: Path) -> None:
    """The vectors are those of the file, in the order of its rows, and the C agrees on them."""
    (tmp_path / "my.py").write_text(LAW, encoding="utf-8")
    rows = "".join(f"{v}\n" for v in (3.6, 7.2, -7.2, 0.0))
    file, out = table(tmp_path, "v_s [km/h]\n" + rows), tmp_path / "c"
    command = ["c", f"{tmp_path / 'my.py'}:law", "--out", str(out), "--vectors", str(file)]
    assert main(command) == 0
    report = json.loads((out / "report.json").read_text(encoding="utf-8"))
    assert report["ticks"] == 4
    assert report["made_up"] is None


def test_of_a_loop_the_run_is_left_out(tmp_path: Path) -> None:
    """A controller of a study takes them too, and has the parameters of its loop."""
    out = tmp_path / "c"
    file = table(tmp_path, "v [km/h],v_opt,mu_hat,v_s\n72,1.0,0.1,0.8\n71.9,1.0,0.1,0.9\n")
    command = ["c", "subway_braking:smc", "--out", str(out), "--vectors", str(file)]
    assert main(command) == 0
    assert json.loads((out / "report.json").read_text(encoding="utf-8"))["ticks"] == 2


def test_a_wrong_table_is_told_before_anything_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is bad input of a person: one line, exit 2, no folder."""
    out, file = tmp_path / "c", table(tmp_path, "speed\n72\n")
    assert main(["c", "subway_braking:smc", "--out", str(out), "--vectors", str(file)]) == 2
    assert "'speed' is no input of" in capsys.readouterr().err
    assert not out.exists()
