"""Figures: what a reader relies on; and equations as MathML."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
import pytest
import toy_study

from slipctl import BadInput
from slipctl.block.units.unit_algebra import display_scale
from slipctl.draw import figure_files, looks, mathml, plots, show
from slipctl.run.results import NotRun
from slipctl.study import case_setup, execution, resolve


@pytest.fixture(scope="module")
def results():
    cases, models = case_setup.prepare(toy_study.study, quick=True)
    return execution.run(toy_study.study, cases, models, quick=True, experiments=False)


def test_loops_keep_their_colour() -> None:
    known = [plots.colour(n) for n in ("ideal", "smc", "sta", "sta_online")]
    assert len(set(known)) == 4
    assert plots.colour("sta_printed") == plots.colour("sta")
    both = ["sta", "sta_printed"]
    assert plots.dash("sta_printed", both) != plots.dash("sta", both)
    assert plots.dash("sta_printed") == plots.dash("sta")
    many = ["none", "mine", "wsp", "pid", "sta", "super_twisting", "sta_printed", "text"]
    hues = plots.hues_of(many)
    assert hues["sta_printed"] == hues["sta"]
    assert len({hues[n] for n in many}) == len(many) - 1, "no two controllers have one colour"
    assert plots.colour("never_seen") == plots.colour("never_seen") in plots.PALETTE


def test_units_as_a_reader_expects_them() -> None:
    assert plots.pretty("kg m^2") == "kg m²"
    assert plots.pretty("m/s^2") == "m/s²"
    assert plots.pretty("m2/s4") == "m²/s⁴"
    assert plots.pretty("m^.5/s^1.5") == "m^.5/s^1.5"
    assert plots.label("slip", "m/s") == "slip [m/s]"
    assert plots.label("share", "1") == "share"


def test_envelope_keeps_every_peak() -> None:
    t = np.linspace(0, 1, 100_001)
    y = np.sin(5 * t)
    y[31_415], y[77_777] = 9, -9
    few_t, few = plots.envelope(t, y, 500)
    assert len(few) <= 2000
    assert (few.max(), few.min()) == (9, -9)
    assert np.all(np.diff(few_t) > 0)
    assert (few_t[0], few_t[-1]) == (0, 1)
    assert plots.envelope(t[:100], y[:100], 500)[1] is not y
    assert np.array_equal(plots.envelope(t[:100], y[:100], 500)[1], y[:100])


def test_a_curve_that_lies_on_another_is_dashed() -> None:
    """Both are seen: below 0.8 % of the height apart over a fifth of the length is one line."""
    t = np.linspace(0, 1, 200)
    same = t + 0.004 * np.sin(40 * t)
    assert looks.covered_curves((t, same), [(t, t)]) == 1
    assert looks.covered_curves((t, same + 0.05), [(t, t)]) == 0
    assert looks.covered_curves((t[::2], same[::2]), [(t, t), (t, t)]) == 2  # other abscissas too
    fig = plots.lines({"efc": (t, t), "eppfc": (t, same), "pid": (t, 1 - t)}, ("t", "s"), ("y", ""))
    solid = [line.get_linestyle() == "-" for line in fig.axes[0].get_lines()]
    assert solid == [True, False, True]


def test_a_loop_has_one_line_in_all_panels_of_a_figure() -> None:
    """Its legend says which; a loop above another has more gaps than it in each of them."""
    t = np.linspace(0, 1, 200)
    order = ["a", "b", "c"]
    apart = looks.line_styles(
        [{"a": (t, t), "b": (t, t)}, {"b": (t, 1 - t), "c": (t, 1 - t)}], order
    )
    assert [looks.DASHES.index(apart[name]) for name in order] == [0, 1, 2]
    fig, axes = plots.panels(1, 2)
    for axis, away in zip(axes.flat, (0.5, 0.0), strict=True):
        plots.lines({"efc": (t, t), "eppfc": (t, t + away), "pid": (t, 1 - t)}, ("t", "s"),
                    ("y", ""), axis=axis)  # fmt: skip
    looks.legends_aside(fig)
    drawn = [[line._unscaled_dash_pattern for line in axis.get_lines()] for axis in axes.flat]
    assert drawn[0] == drawn[1]
    assert len({str(dashes) for dashes in drawn[0]}) == 2
    assert len(fig.legends) == 1


def test_no_legend_lies_in_a_panel() -> None:
    """Where a name means one line: one legend above; else each panel has its own beside it."""
    t = np.linspace(0, 1, 50)

    def drawn(left: dict, right: dict):
        fig, axes = plots.panels(1, 2)
        for axis, curves in zip(axes[0], (left, right), strict=True):
            plots.lines(curves, ("t", "s"), ("y", ""), axis=axis)
        plots.svg_text(fig)
        return fig

    one = drawn({"sta": (t, t), "smc": (t, -t)}, {"smc": (t, -t), "sta": (t, t)})
    assert [t.get_text() for t in one.legends[0].get_texts()] == ["sta", "smc"]
    two = drawn({"dry": (t, t), "ice": (t, -t)}, {"1 m/s": (t, -t), "5 m/s": (t, t)})
    assert not two.legends
    for fig in (one, two):
        for axis in fig.axes:
            if axis.get_legend() is not None:
                panel, box = axis.get_window_extent(), axis.get_legend().get_window_extent()
                assert box.x0 >= panel.x1 or box.y1 <= panel.y0


def test_a_legend_of_its_own_handles_stays_whole() -> None:
    """Areas and marks that only the legend names: nothing of it is lost on its way."""
    fig, axes = plots.panels()
    axes[0, 0].plot([0, 1], [0, 1], color=plots.BLUE)
    mark = axes[0, 0].plot([0.5], [0.2], "x")[0]
    area = axes[0, 0].axhspan(0, 0.5, color=plots.GREY)
    axes[0, 0].legend([mark, area], ["used", "certified"])
    plots.svg_text(fig)
    assert [t.get_text() for t in fig.legends[0].get_texts()] == ["used", "certified"]


def test_train_and_rim_stand_in_a_panel_for_each_loop(results) -> None:
    fig = plots.speeds(results, "base", ("soft", "hard"))
    log = results.log("base", "hard")
    lines = {line.get_label(): line.get_ydata() for line in fig.axes[1].get_lines()}
    rim, vehicle = lines["rim, hard"], lines["vehicle"]
    slip = results.signal("base", "hard", "slip")
    assert np.allclose(rim, log["plant.car.v"].values - slip)
    assert np.array_equal(vehicle, log["plant.car.v"].values)


def test_traces_have_units_bands_and_one_legend(results) -> None:
    fig = plots.traces(results, "base", signals=[("slip", "reference"), "torque", "plant.car.v"])
    labels = [a.get_ylabel() for a in fig.axes]
    assert labels == ["slip speed [m/s]", "torque [kN m]", "speed [m/s]"]
    assert fig.axes[-1].get_xlabel() == "time [s]"
    assert fig.axes[0].get_xlim() == (0, 0.6)
    assert [t.get_text() for t in fig.legends[0].get_texts()] == ["soft", "hard", "wanted slip"]
    assert {t.get_text() for t in fig.axes[0].texts} == {"dry", "ice"}
    with pytest.raises(BadInput, match="no loop of base logs 'torqe'"):
        plots.traces(results, "base", signals=["torqe"])


def test_what_was_not_run_is_not_drawn(results) -> None:
    with pytest.raises(NotRun, match="nobody was not run"):
        plots.traces(results, "nobody", signals=["slip"])


def test_every_helper_labels_its_axes() -> None:
    y = ("error", "m/s")
    drawn = [
        plots.lines({"a": ([0, 1], [0, 1]), "b": ([0, 1], [1, 0])}, ("time", "s"), y),
        plots.bars({"base": {"smc": 1.0, "sta": None}}, y, limit=("allowed", 0.5)),
        plots.spread({"dry": [0.1, 0.2, 0.4], "ice": [0.3, float("nan")]}, y, log=True),
    ]
    for fig in drawn:
        assert fig.axes[0].get_ylabel() == "error [m/s]"
    fig = plots.laws(toy_study.adhesion, upto=5.0, peaks={"dry": (1.386, 0.25)})
    assert fig.axes[0].get_xlabel() == "slip speed [m/s]"
    dry = fig.axes[0].lines[0]
    assert dry.get_ydata()[200] == pytest.approx(toy_study.adhesion(s=2.5)["mu"])


def test_a_figure_is_the_same_every_time(results) -> None:
    def draw():
        return toy_study.slip(results)

    assert plots.svg_text(draw(), "x") == plots.svg_text(draw(), "x")
    assert figure_files.pictures(draw(), "x") == figure_files.pictures(draw(), "x")


# ---- MathML -------------------------------------------------------------------------------------


def rendered(latex: str) -> str:
    text = mathml.render(latex)
    ElementTree.fromstring(f"<math>{text}</math>")
    return text


def test_mathml_of_each_construct() -> None:
    assert "<mfrac><mrow><mi>r</mi></mrow><mrow><mi>J</mi></mrow></mfrac>" in rendered(
        r"\frac{r}{J}"
    )
    assert "<msub><mi>T</mi><mrow><mi>b</mi></mrow></msub>" in rendered("T_{b}")
    assert "<msubsup>" in rendered("x_{1}^{2}")
    assert "<mi>ω</mi>" in rendered(r"\dot{\omega}")
    assert '<mover accent="true">' in rendered(r"\hat{\mu}")
    assert "<msqrt>" in rendered(r"\sqrt{\left|s\right|}")
    assert "<mn>1.5</mn>" in rendered("1.5 < x")
    assert "&lt;" in rendered("1.5 < x")
    assert (
        rendered(r"\begin{cases} 1 & x \le 0 \\ 2 & \text{otherwise} \end{cases}").count("<mtr>")
        == 2
    )
    assert "<mtext>unheard</mtext>" in rendered(r"\unheard{x}")
    words = '<mi mathvariant="normal">{}</mi>'
    assert words.format("a{b}c") + "<mo>+</mo><mi>d</mi>" in rendered(r"\mathrm{a{b}c} + d")
    assert words.format("T_b") + "<mi>x</mi>" in rendered(r"\mathrm{T\_b}x")


def test_what_follows_cases_stands_behind_them() -> None:
    text = rendered(r"x = \begin{cases} 1 & a \\ 2 & b \end{cases} + c")
    assert text.endswith("</mtable></mrow><mo>+</mo><mi>c</mi></mrow>")


def test_rows_of_a_display() -> None:
    rows = mathml.page("$$\n\\begin{aligned}\nx &= \\begin{cases} 1 & a \\\\ 2 & b \\end{cases} "
                       "\\\\\n&\\textbf{part} \\\\\ny &= 2\n\\end{aligned}\n$$")  # fmt: skip
    assert len(rows) == 3
    assert [bool(right) for _, right in rows] == [True, False, True]


@pytest.mark.parametrize("model", resolve.models())
def test_every_model_has_well_formed_equations(model: str) -> None:
    """Of each block; a function that needs arguments makes none by its name alone."""
    shown = False
    for name in resolve.models()[model][1]:
        try:
            block = resolve.load_block(f"{model}.{name}")
        except BadInput as error:
            if "is a function that needs" not in str(error):
                raise
            continue
        shown = True
        for left, right in mathml.page(show.latex(block)):
            for side in (left, right):
                ElementTree.fromstring(f"<math>{side}</math>")
            assert "<mtext>" not in right or "otherwise" in right or "built" in right, name
    blocks = resolve.models()[model][1]
    assert shown or not blocks or model in (
        "converters", "hst_traction_peaks", "ranges", "axles", "torsion", "twisting_wheelsets",
    )  # fmt: skip


def test_chatter_hides_no_other_signal():
    """Mean of each column as a line; what it covers is drawn behind the lines, see-through."""
    _, axes = plots.panels()
    t = np.arange(6000) / 1e3
    plots.chatter(axes[0, 0], {"smc": (t, np.where(np.arange(6000) % 2, 3.0, -1.0))}, ("F", "kN"))
    (line,) = axes[0, 0].lines
    assert line.get_ydata() == pytest.approx(1.0)  # 20 samples in a column, an even number
    (area,) = axes[0, 0].collections
    assert area.get_alpha() < 0.5
    assert area.get_zorder() < line.get_zorder()
    edges = area.get_paths()[0].vertices[:, 1]
    assert (edges.min(), edges.max()) == (-1.0, 3.0)


@pytest.mark.parametrize(
    ("unit", "drawn"), [("N", "kN"), ("N m", "kN m"), ("N m/s", "kN m/s"), ("m/s", "m/s")]
)
def test_forces_are_drawn_in_kilonewtons(unit, drawn):
    factor, shown = display_scale(unit)
    assert shown == drawn
    assert factor == (1.0 if unit == drawn else 1e-3)


def test_a_legend_of_many_names_is_no_wider_than_its_figure():
    """Seven rails of the freight study stood off both ends of their picture."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    from slipctl.models.cheng_2022.freight_traction import adhesion

    fig = plots.laws(adhesion, upto=11.0)
    looks.legends_aside(fig)
    canvas = FigureCanvasAgg(fig)
    canvas.draw()
    box = fig.legends[0].get_window_extent(canvas.get_renderer())
    assert box.x0 >= 0
    assert box.x1 <= fig.bbox.width


def test_of_more_than_ten_names_below_an_axis_neighbours_stand_on_lines_of_their_own():
    few, many = (looks.names_below({f"name_{k}": 0 for k in range(n)}) for n in (10, 14))
    assert not any("\n" in n for n in few)
    assert [n.startswith("\n") for n in many] == [bool(k % 2) for k in range(14)]


def within(text, fig):
    """Box of a text of a figure in its pixels."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(fig)
    canvas.draw()
    return text.get_window_extent(canvas.get_renderer())


def test_that_a_run_was_quick_is_said_within_the_figure():
    fig, _ = plots.panels()
    plots.mark_quick(fig)
    box = within(fig.texts[0], fig)
    assert 0 <= box.x0 < box.x1 <= fig.bbox.width
    assert 0 <= box.y0 < box.y1 <= fig.bbox.height


def test_rails_are_named_right_above_the_panel(results):
    fig = plots.traces(results, "base", signals=["slip"])
    axis = fig.axes[0]
    for text in axis.texts:
        assert within(text, fig).y0 == pytest.approx(axis.bbox.y1, abs=6)


def test_rails_that_come_later_are_shown_where_the_first_is_over(results):
    axis = plots.traces(results, "base", signals=["slip"], span=(0.4, 0.6)).axes[0]
    assert [t.get_text() for t in axis.texts] == ["ice"]
    assert axis.get_xlim() == (0.4, 0.6)


def test_a_reference_is_drawn_once_where_loops_share_it_and_else_for_each(results):
    """Whatever order the loops stand in."""
    log = results.log("base", "soft")
    other = log.assign({n: log[n] + 1.0 for n in log})
    for logs in ([log, log, other], [log, other, log], [other, log, log]):
        _, axes = plots.panels()
        named = dict(zip("abc", logs, strict=True))
        plots._references(axes[0, 0], results, named, "reference", None, {})
        assert len({tuple(line.get_ydata()) for line in axes[0, 0].lines}) == 2
        assert len(axes[0, 0].lines) == 2


@pytest.mark.parametrize(("apart", "share", "found"), [
    (0.0079, 1.0, 1), (0.0084, 1.0, 0), (0.0, 0.205, 1), (0.0, 0.195, 0),
])  # fmt: skip
def test_two_curves_look_like_one_within_008_of_the_height_over_a_fifth(apart, share, found):
    x = np.linspace(0, 1, 1001)
    y = np.where(x <= share, apart, 0.5)
    assert looks.covered_curves((x, y), [(x, 0 * x)], height=1.0) == found


def test_a_legend_of_one_lower_panel_stands_in_the_middle_above_it():
    fig, axes = plots.panels(2)
    axes[0, 0].plot([0, 1], [0, 1])
    plots.lines({"a": ([0, 1], [0, 1]), "b": ([0, 1], [1, 0])}, ("t", "s"), ("y", ""),
                axis=axes[1, 0])  # fmt: skip
    looks.legends_aside(fig)
    panel = axes[1, 0]
    box = within(panel.get_legend(), fig)
    assert (box.x0 + box.x1) / 2 == pytest.approx((panel.bbox.x0 + panel.bbox.x1) / 2, abs=2)
    assert panel.bbox.y1 <= box.y0 < panel.bbox.y1 + 12
