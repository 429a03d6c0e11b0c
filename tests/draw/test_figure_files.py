"""Files of figures: where panels stand, and that SVG and PNG show what matplotlib would draw."""

from __future__ import annotations

import io
from itertools import combinations

import numpy as np
import pytest

from slipctl.draw import figure_files, layout, plots


@pytest.mark.parametrize(
    ("shape", "high", "titles", "shared", "ratio", "names"),
    [
        ((1, 1), 1.0, False, False, 1.0, 0), ((3, 1), 1e5, False, True, 1.0, 2),
        ((1, 2), 1e-6, True, False, 2.0, 3), ((2, 2), 123.4, True, False, 1.0, 1),
        ((2, 3), 3e5, False, True, 2.0, 3),
    ],
)  # fmt: skip
def test_panels_with_their_labels_lie_in_the_figure_and_on_no_other(
    shape, high, titles, shared, ratio, names
) -> None:
    rows, columns = shape
    shares = [*[1.0] * (columns - 1), ratio]
    fig, axes = plots.panels(rows, columns, sharex=shared, gridspec_kw={"width_ratios": shares})
    t = np.linspace(0.0, 1.0, 20)
    with plots.style():
        for axis in axes.flat:
            for k in range(names):
                axis.plot(t, high * t * (k + 1), label=f"controller {k}")
            axis.set_ylabel("torque [kN m]")
            axis.set_title("wet rail" if titles else "")
        axes[-1, 0].set_xlabel("time [s]")
        if names:
            axes[0, 0].legend()
    plots.svg_text(fig)
    fig.set_layout_engine("none")
    pixel = fig.dpi / 72
    boxes = [axis.get_tightbbox() for axis in fig.axes]
    boxes += [legend.get_tightbbox() for legend in fig.legends]
    for box in boxes:
        assert min(box.x0, box.y0) > -pixel
        assert box.x1 < fig.bbox.x1 + pixel
        assert box.y1 < fig.bbox.y1 + pixel
    for one, other in combinations(boxes, 2):
        beside = one.x1 <= other.x0 + pixel or other.x1 <= one.x0 + pixel
        assert beside or one.y1 <= other.y0 + pixel or other.y1 <= one.y0 + pixel
    widths = [axis.get_position().width for axis in axes[0]]
    assert widths == pytest.approx([share * widths[0] / shares[0] for share in shares])


@pytest.mark.parametrize("hidden", [0, 1])
def test_a_panel_that_is_hidden_takes_no_room_from_others(hidden):
    """Whichever of them it is, the labels of the other lie in the figure."""
    fig, axes = plots.panels(2)
    for axis in axes.flat:
        axis.set_ylabel("torque [kN m]")
        axis.set_xlabel("time [s]")
    axes[hidden, 0].set_visible(False)
    plots.svg_text(fig)
    fig.set_layout_engine("none")
    box = axes[1 - hidden, 0].get_tightbbox()
    assert min(box.x0, box.y0) > -1
    assert box.x1 < fig.bbox.x1 + 1


def picture():
    """A figure of all that figures here are made of, but letters."""
    fig, axes = plots.panels(1, 2)
    t = np.linspace(0.0, 6.0, 400)
    with plots.style():
        axes[0, 0].plot(t, np.sin(t), "--")
        axes[0, 0].fill_between(t, np.sin(t), 0.3, alpha=0.3)
        axes[0, 0].axvspan(1.0, 2.0, color="#EEEEEE")
        axes[0, 0].set_ylim(-0.5, 0.9)  # what lies outside is cut off
        axes[0, 1].plot(t[::20], np.cos(t[::20]), "o", ms=4)
        axes[0, 1].bar([1, 2], [0.5, 0.8], hatch="///", edgecolor="white")
        axes[0, 1].scatter([3, 4, 5], [0.1, 0.2, 0.3], s=[5, 20, 80], c=["r", "g", "b"])
        axes[0, 1].contourf([0, 3, 6], [-1, 0], [[0, 1, 2], [2, 1, 0]], levels=[0.5, 1.5])
        for axis in axes.flat:
            axis.tick_params(labelbottom=False, labelleft=False)
    fig.set_layout_engine("none")
    return fig


def test_one_pass_shows_what_two_passes_show() -> None:
    """The SVG is the same text; of the pixels, those differ that lie on the edge of something."""
    svg, png = figure_files.pictures(picture())
    with plots.style():
        assert figure_files._svg(picture(), "") == svg
        other = figure_files._png(picture(), "")
    a, b = (read(data) for data in (png, other))
    assert a.shape == b.shape
    assert a.std() > 0.05
    # text has none here; an edge may fall on either side of the middle of a pixel
    assert np.mean(np.abs(a - b).max(axis=-1) > 0.25) < 0.002


def read(data: bytes) -> np.ndarray:
    """Pixels of a PNG."""
    from matplotlib.image import imread

    return imread(io.BytesIO(data))


def test_letters_stand_at_the_same_place_in_both() -> None:
    """The words of a figure: where the SVG has them, and within a pixel where the PNG has them."""
    fig, axes = plots.panels()
    fig.set_layout_engine("none")
    with plots.style():
        axes[0, 0].set_axis_off()
        axes[0, 0].text(0.5, 0.5, "adhesion", ha="right", va="bottom", fontsize=20)
        fig.text(0.9, 0.9, "90°", rotation=90)
    png = read(figure_files.pictures(fig)[1])
    ink = np.argwhere(png[:, : png.shape[1] * 3 // 4, :3].mean(axis=-1) < 0.5)
    box = axes[0, 0].texts[0].get_window_extent()  # in points, from below
    scale = figure_files.PIXELS / figure_files.POINTS
    top, bottom = png.shape[0] - box.y1 * scale, png.shape[0] - box.y0 * scale
    (first, left), (last, right) = ink.min(axis=0), ink.max(axis=0)
    assert box.x0 * scale - 2 < left < right < box.x1 * scale + 2
    assert top - 2 < first < last < bottom + 2


@pytest.mark.second
def test_pixels_within_a_figure_are_drawn_too() -> None:
    fig, axes = plots.panels()
    with plots.style():
        axes[0, 0].pcolormesh(np.arange(12.0).reshape(3, 4), rasterized=True)
    svg, png = figure_files.pictures(fig)
    assert "<image" in svg
    assert len(np.unique(read(png).reshape(-1, 4), axis=0)) > 12


def test_a_figure_whose_panels_are_placed_by_hand_stays_as_it_is():
    """And one without panels is drawn too."""
    fig, axes = plots.panels()
    axes[0, 0].remove()
    figure_files.pictures(fig)
    by_hand = fig.add_axes((0.2, 0.3, 0.4, 0.5))
    by_hand.plot([0, 1], [0, 1])
    figure_files.pictures(fig)
    assert by_hand.get_position().bounds == pytest.approx((0.2, 0.3, 0.4, 0.5))


def test_panels_along_a_length_share_what_their_labels_leave():
    """By their ratios; of a grid whose last columns are empty, by those that are there."""
    before, after = np.array([0.1, 0.2, 0.3]), np.array([0.4, 0.5, 0.6])
    begins, long = layout._along(before, after, [1, 2, 1], 6.1)
    assert long == pytest.approx([1.0, 2.0, 1.0])
    assert begins == pytest.approx([0.1, 1.7, 4.5])
    begins, long = layout._along(before[:1], after[:1], [1, 2, 1], 4.5)
    assert (begins, long) == (pytest.approx([0.1]), pytest.approx([4.0]))
    begins, long = layout._along(before, after, [1, 1, 2], 1.0)  # no room: a tenth of an inch each
    assert long == pytest.approx([0.075, 0.075, 0.15])
