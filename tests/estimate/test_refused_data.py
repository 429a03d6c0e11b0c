"""Data that no fit can use, and what a column says of the parameters of a law."""

from __future__ import annotations

import pytest

from slipctl import BadInput, Input, Output, Param, State, ekf, fit, fit_over_time, flow, law, rls
from slipctl.certify.entries import DoesNotHold
from slipctl.design import gain_files
from slipctl.estimate.curve import parameters_of_columns
from slipctl.estimate.log_fit.rollout import free_state
from slipctl.tables.table import read_table


@law(y=Output("m", "out"))
def line(
    a=Input("m", "in"), u=Input("s", "beside", value=1.0), k=Param("1", 2.0, "gain", lo=0, hi=9),
    d=Param("m", 0.5, "offset"), free=Param("m", 0.0, "another"),
):  # fmt: skip
    return k * a * u + d + free


@law(y=Output("m", "out"))
def bare(a=Input("m", "in"), k=Param("1", None, "no value")):
    return k * a


@law(y=Output("1", "out"))
def root(a=Input("1", "in"), k=Param("1", -2.0, "gain", lo=-9, hi=9)):
    import casadi as ca

    return ca.sqrt(k * a)


@flow(y=Output("m", "level"))
def tank(x=State("m", 0.0, "level"), q=Input("m/s", "inflow")):
    return {"x": q}, {"y": x}


@flow(y=Output("m", "level"))
def vector(x=State("m", (0.0, 0.0), "levels", shape=(2,)), q=Input("m/s", "inflow")):
    import casadi as ca

    return {"x": ca.vertcat(q, q)}, {"y": x[0]}


@flow(y=Output("m", "level"))
def none(q=Input("m", "inflow")):
    return {}, {"y": q}


@flow(q=Output("m/s", "the inflow"))
def echo(x=State("m", 0.0, "level"), q=Input("m/s", "inflow"), c=Param("1", 1.0, "c")):
    return {"x": c * q}, {"q": q}


def filtered(block, measured):
    return ekf(block, measured, ["x"], prior={"x": 1.0}, noise=dict.fromkeys(measured, 0.1),
               period=0.1)  # fmt: skip


DATA = {"a": [1.0, 2.0, 3.0], "y": [2.5, 4.5, 6.5]}
REFUSED = [
    (lambda: fit(line, {"y": [1.0, 2.0]}, ["k"]), "a"),
    (lambda: fit(bare, DATA, ["k"]), "bare.k has no value"),
    (lambda: fit(root, {"a": [1.0, 2.0], "y": [1.0, 1.4]}, ["k"]),
     "root is not finite at the start"),
    (lambda: fit(line, DATA | {"k": [2.0, 3.0, 4.0]}, ["d"]),
     "the column k goes from 2 to 4 1, but line has one k; fit each by itself"),
    (lambda: fit(line, DATA | {"k": [3.0] * 3}, ["d"], at={"k": 2.0}),
     "has a column k, and k = 2 1 is given; leave out one"),
    (lambda: fit(line, DATA | {"k": [30.0] * 3}, ["d"]), "k = 30 is out of range"),
    (lambda: fit_over_time(vector, {"time": [0, 1, 2], "q": [1, 1, 1], "y": [0, 1, 2]}, "y"),
     "vector.x is no single number; a fit over time takes those"),
    (lambda: fit_over_time(none, {"time": [0, 1, 2], "q": [1, 1, 1], "y": [0, 1, 2]}, "y"),
     "none has no state; a fit over time takes a flow that has one"),
    (lambda: rls(tank, period=0.1), "tank is a flow; only the parameters of a law"),
    (lambda: filtered(echo, ["q"]), "q is an input or parameter and an output"),
    (lambda: filtered(echo, []), "measured names no state or output"),
    (lambda: filtered(echo, ["x", "x"]), "measured names x twice"),
    (lambda: filtered(vector, ["x"]), r"x has shape \(2,\); only scalars can be estimated"),
    (lambda: gain_files.check({"format": 10**6}), "the certificate"),
    (lambda: gain_files.check({"format": 1, "other": 1}), "other"),
    (lambda: gain_files.check({"format": 1, "exact": [
        {"name": "a", "bounds_times": "1", "certificate": 3}]}),
     r"exact\[0\].certificate must hold a certificate"),
    (lambda: gain_files.check({"format": 1, "exact": [{"name": "a"}]}), "exact"),
]  # fmt: skip


@pytest.mark.parametrize(("made", "said"), REFUSED)
def test_what_no_fit_and_no_filter_can_use_is_refused(made, said):
    with pytest.raises((BadInput, DoesNotHold), match=said):
        made()


def test_a_column_of_one_value_gives_a_parameter(tmp_path):
    """Empty columns, those of inputs and those told otherwise give none; whatever their order."""
    cells = {"u": "2", "d": "", "k": "3", "free": "1"}
    for order in (list(cells), list(cells)[::-1]):
        rows = [",".join(["other", *order])]
        rows += [",".join([str(k), *(cells[n] for n in order)]) for k in range(3)]
        (tmp_path / "log.csv").write_text("\n".join(rows), encoding="utf-8")
        table = read_table(tmp_path / "log.csv")
        assert parameters_of_columns(line, "log", table, {}) == {"k": 3.0, "free": 1.0}
        assert parameters_of_columns(line, "log", table, {"k": 3.0}) == {"free": 1.0}
        (tmp_path / "log.csv").write_text(
            "\n".join(rows).replace("d", "d [A]").replace(",,", ",7,")
        )
        assert parameters_of_columns(line, "log", read_table(tmp_path / "log.csv"), {})["k"] == 3.0
    (tmp_path / "log.csv").write_text("a [m],y [m]\n1,\n,2\n", encoding="utf-8")
    with pytest.raises(BadInput, match="no row in which a, u, y all have a number"):
        fit(line, tmp_path / "log.csv", ["k"])
    assert gain_files.check({"format": 1}) == ""


def test_the_state_whose_start_is_sought():
    assert free_state(tank, "y") == "x"
    assert free_state(echo, "q") == "x"


def test_a_unit_that_is_turned_twice_is_told_and_one_that_nobody_means_refused(tmp_path):
    rows = "".join(f"{k},{2 * k}\n" for k in range(1, 6))
    path = tmp_path / "log.csv"
    for text, told in (("a/1000", True), ("a/3", False)):
        path.write_text(f"a [mm],y [m]\n{rows}", encoding="utf-8")
        found = fit(bare, path, ["k"], start={"k": 1.0}, columns={"a": text})
        assert told == any("turns a a second time" in note for note in found.notes)
    path.write_text(f"a [Mm],y [m]\n{rows}", encoding="utf-8")
    with pytest.raises(BadInput, match="is a million m"):
        fit(bare, path, ["k"], start={"k": 1.0})
