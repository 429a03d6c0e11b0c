"""The file of a fitted law: who runs it has the fitted law."""

from __future__ import annotations

import numpy as np
import pytest

from slipctl import Input, Output, Param, fit, from_text, law
from slipctl.commands.fit import figure, model_text
from slipctl.models.huang_2020.subway_braking import double_exponential

EQUATION = "y = c*(1 - exp(-k*u)) + d + 0*b*k where c = 2, k = 1 s, u [1/s], d = 0, b [1/s] = c/k"
TOML = """
[my]
equations = "y = c*(1 - exp(-k*u)) + d"
outputs = { y = "1" }
[my.inputs]
u = { unit = "1/s", doc = "in" }
[my.parameters]
c = 2
k = "1 s"
d = 0
"""


@pytest.mark.parametrize("kind", ["equation", "toml", "model", "model of a file"])
def test_the_file_of_a_fit_makes_the_fitted_law(kind, tmp_path):
    u = np.linspace(0.1, 6, 30)
    if kind.startswith("model"):
        base, given, free = double_exponential, {"a": 0.6}, ["c"]
        name = "double_exponential"
        name = f"huang_2020.subway_braking.{name}" if "file" in kind else name
        curve = {"v_s": u, "mu": 0.8 * (np.exp(-0.6 * u) - np.exp(-1.2 * u))}
    else:
        given, free = {"d": 0.5}, ["c", "k"]
        path = tmp_path / "my.toml"
        path.write_text(TOML, encoding="utf-8")
        name = EQUATION if kind == "equation" else f"{path}:my"
        from slipctl.study.resolve import load_block

        base = from_text(EQUATION) if kind == "equation" else load_block(name)
        curve = {"u": u, "y": 1.5 * (1 - np.exp(-0.7 * u)) + 0.5}
    found = fit(base.with_params(**given), curve, free)
    text = model_text(found, base, name, "slipctl fit it")
    made: dict = {}
    exec(compile(text, "law.py", "exec"), made)
    law, wanted = made["law"], found.law
    for n, p in wanted.params.items():
        if not p.derived:
            assert law.params[n].value == pytest.approx(p.value, rel=1e-12), n
    (output,) = wanted.outputs
    at = {next(iter(wanted.inputs)): 1.3}
    assert float(law(**at)[output]) == pytest.approx(float(wanted(**at)[output]), rel=1e-12)
    rows = {k.split("=")[0].strip(): k for k in text.splitlines() if "#" in k}
    assert set(rows) == {*given, *free}  # what is as it was stands in the law itself
    assert all("given" in rows[n] for n in given)
    assert all("+-" in rows[n] for n in free)
    assert "    slipctl fit it" in text
    assert f"{len(u)} points" in text


def test_a_parameter_that_is_as_it_was_hides_none_behind_it():
    """Wherever it stands: one that follows from others, one that nobody touched."""
    said = "y = a + c*u + b + d where a = 1, b [1] = 2*a, c = 2, d = 0, u [1]"
    base, u = from_text(said), np.linspace(0.0, 1.0, 20)
    found = fit(base.with_params(d=0.5), {"u": u, "y": 3.5 + 4 * u}, ["c"])
    text = model_text(found, base, said, "slipctl fit it")
    rows = {k.split("=")[0].strip() for k in text.splitlines() if "#" in k}
    assert rows == {"c", "d"}


@law(y=Output("m", "height"))
def plane(u=Input("s", "time"), w=Input("1", "share"), a=Param("m/s", 1.0, "slope"),
          b=Param("m", 1.0, "other slope")):  # fmt: skip
    """A plane over time and share."""
    return a * u + b * w


@pytest.mark.parametrize("still", [True, False])
@pytest.mark.parametrize("wide", [True, False])
def test_the_figure_of_a_fit_has_points_curve_and_residuals(still, wide):
    """A line where nothing else varies; else a mark at each point."""
    u = np.geomspace(0.01, 9, 20) if wide else np.linspace(0.1, 9, 20)
    w = np.full(20, 0.5) if still else np.linspace(0, 1, 20)
    measured = 2 * u + 3 * w + 0.01 * np.sin(7 * u)
    found = fit(plane, {"u": u, "w": w, "y": measured}, ["a"] if still else ["a", "b"])
    fig = figure(found, "a title")
    above, below = fig.axes[:2]
    points, fitted = above.get_lines()
    assert points.get_linestyle() == "None"
    np.testing.assert_allclose(points.get_ydata(), measured)
    x, y = np.asarray(fitted.get_xdata()), np.asarray(fitted.get_ydata())
    if still:
        assert (x[0], x[-1], len(x)) == (pytest.approx(u.min()), pytest.approx(u.max()), 400)
        np.testing.assert_allclose(y, [float(found.law(u=a, w=0.5)["y"]) for a in x])
        steps = np.diff(np.log(x) if wide else x)
        np.testing.assert_allclose(steps, steps[0], rtol=1e-6)
    else:
        np.testing.assert_allclose(x, u)
        np.testing.assert_allclose(y, measured - found.residuals)
        assert fitted.get_marker() == "x"
    np.testing.assert_allclose(below.get_lines()[0].get_ydata(), found.residuals)
    assert below.get_xscale() == ("log" if wide else "linear")
    assert {t.get_text() for t in above.get_legend().get_texts()} == {"measured", "fitted"}
