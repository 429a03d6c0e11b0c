"""A table of peaks is parameters: in Python, in C and for a calibration tool."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from slipctl import Input, Output, Param, argmax_table, law
from slipctl.ccode import codegen
from slipctl.ccode.compile import compilers
from slipctl.ccode.module import guard
from slipctl.errors import BadInput
from slipctl.models.wang_2025.hst_traction_adhesion import usable_adhesion
from slipctl.models.wheel_rail import contact


@law(
    y=Output("1", "height"),
    conditions={"low": {"top": 1.0}, "high": {"top": 2.0}},
)
def hump(
    x=Input("m", "place"),
    w=Input("s", "time"),
    top=Param("m", 1.0, "place of the top without time", lo=0, hi=5),
):
    """A hump with its top at top + w^2/4, 3 - w high."""
    return 3 - w - (x - top - w**2 / 4) ** 2


@pytest.fixture(scope="module")
def table():
    return argmax_table(hump, "x", "w", lo=0.0, hi=5.0, span=(0.0, 2.0), error=0.01)


def test_it_is_straight_between_its_points(table):
    """As numpy has it, inside, at the points and beyond the ends, which hold; also when set."""
    rng = np.random.default_rng(2)
    n = table.params["w_at"].size
    for points in ({}, {"w_at": np.sort(rng.uniform(0, 2, n)), "best_low": rng.uniform(0, 5, n)}):
        p = table.param_values(**points)
        for w in (-1.0, 0.0, 2.0, 3.0, *p["w_at"], *rng.uniform(0, 2, 20)):
            got = table(w=float(w), **points)
            for name in ("best", "value"):
                wanted = [np.interp(w, p["w_at"], p[f"{name}_{c}"]) for c in ("low", "high")]
                assert got[name] == pytest.approx(wanted, rel=1e-12)


def test_it_is_that_of_the_law(table):
    for w in (0.1, 0.8, 1.7):
        got = table(w=w)
        assert got["best"] == pytest.approx([1 + w**2 / 4, 2 + w**2 / 4], rel=0.01)
        assert got["value"] == pytest.approx([3 - w, 3 - w], rel=0.01)


def test_conditions_are_names():
    with pytest.raises(BadInput, match=re.escape("condition 'a b' is no name")):
        argmax_table(hump, "x", "w", lo=0.0, hi=5.0, span=(0.0, 2.0), conditions={"a b": {}})


@pytest.mark.skipif(compilers.first_compiler() is None, reason="no C compiler here")
@pytest.mark.parametrize("real", ["double", "float"])
def test_c_has_no_number_of_it_but_as_parameters(table, real: str, tmp_path: Path):
    """A search in a loop, the bits of Python, other points too; and tune looks at the places."""
    module = codegen.c_module(table, tmp_path, "ctl", real=real).compile().load()
    text = "".join(p.read_text() for p in (tmp_path / "ctl.c", *tmp_path.glob("ctl_parts*")))
    assert "reached(param->w_at, " in text
    assert text.count("[before + 1];") == 4
    assert "element(" not in text
    n = table.params["w_at"].size
    places = np.round(np.linspace(0, 2, n), 3)
    for points in ({}, {"w_at": places, "value_high": places**2}):
        module.reset(**points)
        for w in np.linspace(-1, 3, 41):
            ours, there = table(w=float(w), **points), module.step(w=float(w))
            for name in ours:
                close = 0.0 if real == "double" else 1e-5
                assert there[name] == pytest.approx(ours[name], rel=close, abs=close)
    module._param[1] = module._param[0]
    assert module._call("tune", module._param, module._state) == guard.BAD_PARAM


def test_tables_are_curves_over_one_axis(table, tmp_path: Path):
    codegen.c_module(table, tmp_path, "ctl")
    text = (tmp_path / "ctl.a2l").read_text()
    assert text.count("/begin AXIS_PTS ctl_param.w_at ") == 1
    assert len(re.findall(r"\n  CURVE ", text)) == 4
    assert text.count("AXIS_PTS_REF ctl_param.w_at\n") == 4


# ---- the table of the anti-slip limit ------------------------------------------------------------


def test_other_curves_have_another_table():
    """Nothing is stale: peaks are those of the curves with their new numbers."""
    usable = usable_adhesion(2)
    patch = contact.patch(7e4)
    mu_0 = [0.4, 0.3, 0.2, 0.1, 0.08]
    other = usable.with_params(**{f"axle.curves.{n}": v for n, v in patch.items()})
    other = other.with_params(**{"axle.curves.mu_0": mu_0})
    for v in (0.7, 27.1, 64.9):
        got = other["peaks"](v=v)
        for k, (name, row) in enumerate(contact.SURFACES.items()):
            own = contact.polach.with_params(**patch)
            true = contact.peak(v, {**row, "mu_0": mu_0[k]}, own)
            assert got["best"][k] == pytest.approx(true.location, rel=1e-3), name
            assert got["value"][k] == pytest.approx(true.value, rel=1e-3), name
    back = other.with_params(
        **{n: v for n, v in usable.param_values().items()
           if n.startswith("axle.curves.") and not usable.params[n].derived}
    )  # fmt: skip
    assert (back["peaks"](v=3.0)["best"] == usable["peaks"](v=3.0)["best"]).all()


def test_a_table_that_was_set_stays():
    usable = usable_adhesion(2)
    n = usable.params["peaks.v_at"].size
    given = usable.with_params(**{"peaks.best_dry": np.full(n, 0.2)})
    given = given.with_params(**{"axle.curves.mu_0": [0.4, 0.3, 0.2, 0.1, 0.08]})
    assert given["peaks"](v=3.0)["best"][0] == 0.2
    assert given["peaks"](v=3.0)["best"][1] == usable["peaks"](v=3.0)["best"][1]
