"""What no estimator, bound or seeker can use is refused by a line that says what is wanted."""

from __future__ import annotations

import math

import pytest

from slipctl import (
    BadInput,
    Input,
    Output,
    Param,
    law,
    least_squares,
    peak_bound,
    perturbation_seek,
    probe,
    rls,
    seek_limits,
)
from slipctl.estimate.misfit import regressor
from slipctl.tables.table import read_table


@law(y=Output("1", "height"))
def hill(v=Input("1", "place"), A=Param("1", 2.0, "height"), B=Param("1", 1.0, "steepness"),
         C=Param("1", None, "shift")):  # fmt: skip
    return A * v - B * v**2 + C


@law(y=Output("1", "1"), z=Output("1", "2"))
def pair(v=Input("1", "in"), a=Param("1", 1.0, "factor")):
    return {"y": a * v, "z": a}


@law(y=Output("1", "sum"))
def vector(v=Input("1", "in", shape=(2,)), a=Param("1", 1.0, "factor")):
    return a * (v[0] + v[1])


def of_many(n):
    params = ", ".join(f"p{k}=Param('1', 1.0, 'factor')" for k in range(n))
    body = " + ".join(f"p{k} * v" for k in range(n))
    names = {"Param": Param, "Input": Input, "Output": Output, "law": law}
    exec(f"@law(y=Output('1', 'y'))\ndef many(v=Input('1', 'v'), {params}):\n return {body}", names)
    return names["many"]


def bound(**changes):
    given = {"over": "v", "at": 1.0, "samples": {"v": [1.0, 2.0]}, "noise": 0.1,
             "unknown": ["A", "B"], "C": 0.0}  # fmt: skip
    return peak_bound(hill, **(given | changes))


START = {"A": 1.0, "B": 1.0, "C": 0.0}
BAD = {
    "no start": (lambda: rls(hill, period=0.1), "give start={'C': ...} in 1"),
    "start of another": (lambda: rls(hill, period=0.1, start={"D": 1.0}), "start has 'D'"),
    "start of printed-16": (
        lambda: rls(hill, period=0.1, form="printed-16", start=START), "starts at zero"),
    "twice": (lambda: rls(hill, period=0.1, unknown=["A", "A"]), "parameter is named twice"),
    "which output": (lambda: rls(pair, period=0.1), "say which output is measured"),
    "ten unknowns": (lambda: regressor(of_many(10), None, None), "10 unknowns; give 1 to 9"),
    "period": (
        lambda: probe(hill, over="v", within=(0.1, 1.0), period=0.0, unknown=["A", "B"]),
        "period = 0 s must be positive"),
    "within": (
        lambda: probe(hill, over="v", within=(1.0, 0.1), period=0.1, unknown=["A", "B"]),
        "within = .* must be .lowest, highest."),
    "not finite": (lambda: bound(samples={"v": [1.0, math.inf]}), "samples must be finite"),
    "a table": (lambda: bound(samples={"v": [[1.0], [2.0]]}), "lists of one length"),
    "another sample": (lambda: bound(samples={"v": [1.0], "w": [1.0]}), "has no 'w'"),
    "sample missing": (lambda: bound(samples={}), r"samples lack v \[1\]"),
    "no scalar": (
        lambda: peak_bound(vector, over="v", at=1.0, samples={"v": [1.0]}, noise=0.1),
        "has inputs that are no scalars"),
    "no seeker": (lambda: seek_limits(pair, steepest=1.0, curvature=-1.0), "is no seeker"),
    "flat map": (
        lambda: seek_limits(perturbation_seek(0.01), steepest=1.0, curvature=0.0), "has no peak"),
    "rows of one": (lambda: least_squares([1.0, 2.0], [1.0, 2.0]), "must be rows of finite"),
    "no finite rows": (lambda: least_squares([[math.nan]] * 3, [1.0] * 3), "rows of finite"),
    "words": (lambda: least_squares([["a"]], [1.0]), "regressor and measured are no numbers"),
}  # fmt: skip


@pytest.mark.parametrize("what", BAD)
def test_it_is_refused_with_what_is_wanted(what):
    call, words = BAD[what]
    with pytest.raises(BadInput, match=words):
        call()


@pytest.mark.parametrize("raw", [b"v,mu\n1,\0\n", bytes(range(256)) * 2, b"\xff\xfe\x00\xd8v"])
def test_a_table_that_is_no_text_says_how_to_save_it(raw, tmp_path):
    (tmp_path / "a.csv").write_bytes(raw)
    with pytest.raises(BadInput, match=r"a\.csv is no text; save it as CSV, a head and a row"):
        read_table(tmp_path / "a.csv")


def test_a_number_beyond_what_can_be_squared_is_told_with_its_line(tmp_path):
    (tmp_path / "a.csv").write_text("v,mu\n1,2\n1e300,2\n", encoding="utf-8")
    table = read_table(tmp_path / "a.csv")
    with pytest.raises(BadInput, match=r"'1e300' in line 3 is beyond what can be squared"):
        table.numbers("v")
