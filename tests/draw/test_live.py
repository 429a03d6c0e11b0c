"""Figures over time that zoom: read off a figure, in a page, in a browser."""

import base64
import json
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import numpy as np
import pytest

from slipctl.draw import live, plots

T = np.linspace(0, 10, 20001)


def figure(**more):
    """Two panels: a slow curve that another hides, a curve that chatters."""
    fig, axes = plots.panels(2, sharex=True)
    slow = {"a": (T, np.sin(T)), "b": (T, np.sin(T) + 1e-3 * np.cos(T))} | more
    plots.lines(slow, ("time", "s"), ("slip", "m/s"), axis=axes[0, 0])
    plots.chatter(axes[1, 0], {"c": (T, np.sign(np.sin(700 * T)))}, ("torque", "kN m"))
    axes[0, 0].set_xlabel("")
    axes[0, 0].axvspan(2, 4, color="#E4EEF6", lw=0, zorder=-5)
    axes[0, 0].axhline(0.5, ls=":")
    return fig


def test_panels_lines_bands_and_differences_are_read_off_a_figure():
    found = live.of_figure(figure())
    assert found.span == (0.0, 10.0)
    first, difference, last = found.panels
    assert first.label == "slip [m/s]"
    assert [c.name for c in first.curves] == ["a", "b", "reference"]
    assert np.array_equal(first.curves[0].y, np.sin(T)), "all points, not those of the picture"
    assert first.bands == [(2.0, 4.0, "#e4eef6", "")]
    assert np.allclose(difference.curves[0].y, -1e-3 * np.cos(T))
    assert found.hidden == ["slip: a and b differ by at most 0.001 m/s"]
    assert len(last.curves[0].t) == len(T)


def test_what_is_the_same_is_said_and_needs_no_panel():
    fig = plots.lines({"a": (T, T), "b": (T, T)}, ("time", "s"), ("slip", "m/s"))
    found = live.of_figure(fig)
    assert (len(found.panels), found.hidden) == (1, ["slip: a and b are the same"])


@pytest.mark.parametrize(
    "fig",
    [
        plots.lines({"a": (T, T)}, ("slip", "1"), ("adhesion", "1")),
        plots.lines({"a": (T[1:], T[1:])}, ("time", "s"), ("slip", "1"), log="y"),
        plots.bars({"g": {"a": 1.0}}, ("distance", "m")),
    ],
)
def test_what_does_not_go_over_time_stays_a_picture(fig):
    assert live.of_figure(fig) is None


def test_thinning_keeps_the_ends_of_each_column_and_gaps():
    y = np.sign(np.sin(700 * T))
    y[5000:5200] = np.nan
    y[123] = 7.0
    t, kept, pairs = live.thin_curve(T, y, 600)
    assert pairs
    assert len(t) == 600
    assert (np.diff(t) >= 0).all()
    assert np.nanmax(kept) == 7.0
    low, high = kept.reshape(-1, 2).min(1), kept.reshape(-1, 2).max(1)
    assert np.mean((low == -1) & (high == 1)) > 0.9
    assert np.isnan(kept).any()
    assert live.thin_curve(T[:600], y[:600], 600)[2] is False


def test_text_is_small_and_the_same_each_time_and_closes_no_script():
    def text():
        found = live.of_figure(figure(**{"</script>": (T, np.cos(T))}))
        return live.text(found, 1000)

    assert text() == text()
    assert "<" not in text()
    assert len(text()) < 1000 * 4 * 4 / 3 * 6 + 4000
    told = json.loads(text())
    c = told["panels"][0]["curves"][0]
    steps = np.frombuffer(base64.b64decode(c["y"]), dtype="<u2")
    y = c["ends"][0] + (c["ends"][1] - c["ends"][0]) * steps / 65534
    t = np.frombuffer(base64.b64decode(c["x"]), dtype="<u2") / 65534 * 10
    assert np.abs(y - np.sin(t)).max() < 2e-4


def test_a_page_shares_its_bytes_among_its_curves():
    found = live.of_figure(figure())
    for many in (1, 30, 300):
        points = live.share([found] * many)
        assert live.LEAST <= points <= live.POINTS
        if points > live.LEAST:
            assert len(live.text(found, points)) * many < 1.05 * live.ALL + many * 2000


def test_wheel_has_the_program():
    told = tomllib.loads(Path("pyproject.toml").read_text(encoding="utf-8"))
    assert told["tool"]["setuptools"]["package-data"]["slipctl.draw"] == ["*.js"]
    script = live.script()
    assert "</script" not in script
    assert set(re.findall(r"https?://[^\"]+", script)) == {"http://www.w3.org/2000/svg"}
    assert len(script) < 20_000, "uPlot has 53 kB"


# ---- in a browser --------------------------------------------------------------------------------

BROWSER = shutil.which("chromium") or shutil.which("chromium-browser")

ACT = """
const said = [], svgs = document.querySelectorAll(".live > svg");
const put = (svg, kind, share) => {
  const r = svg.getBoundingClientRect();
  svg.setPointerCapture = () => {};
  svg.dispatchEvent(new PointerEvent(kind, { clientX: r.left + 64 + share * (r.width - 72),
    clientY: r.top + 20, button: 0, pointerId: 1, bubbles: true }));
};
const times = svg => [...svg.querySelectorAll("text")]
  .filter(t => t.getAttribute("text-anchor") === "middle").map(t => t.textContent).join(" ");
const note = what => said.push([what, svgs.length, times(svgs[0]), times(svgs[3]),
  [...document.querySelectorAll(".key b")].map(b => b.textContent).join("|"),
  svgs[2].querySelectorAll(".range").length, svgs[0].querySelectorAll(".curve").length,
  getComputedStyle(document.querySelector("figure > img")).display]);
setTimeout(() => {
  note("all");
  put(svgs[0], "pointerdown", 0.2); put(svgs[0], "pointermove", 0.4);
  put(svgs[0], "pointerup", 0.4);
  put(svgs[0], "pointermove", 0.5); note("zoomed");
  document.querySelector(".key").click(); note("hidden");
  svgs[0].dispatchEvent(new MouseEvent("dblclick")); note("back");
  document.body.setAttribute("data-said", JSON.stringify(said));
}, 50);
"""


def page(more=""):
    text = live.text(live.of_figure(figure()), 2000)
    fig = f'<figure><img alt=""><script type="application/json">{text}</script></figure>'
    return (
        f"<!DOCTYPE html><meta charset=utf-8><style>:root{{--rail:1}}{live.STYLE}</style>{fig}{fig}"
        f"<script>window.onerror = m => document.title = m;{live.script()}{more}</script>"
    )


@pytest.mark.skipif(BROWSER is None, reason="there is no chromium")
def test_zoom_and_cursor_are_shared_in_a_browser(tmp_path):
    file = tmp_path / "page.html"
    file.write_text(page(ACT), encoding="utf-8")
    command = [
        str(BROWSER), "--headless=new", "--no-sandbox", "--disable-gpu", "--window-size=900,900",
        "--no-first-run", "--disable-background-networking", "--disable-component-update",
        "--disable-sync", "--disable-dev-shm-usage",
        f"--user-data-dir={tmp_path / 'profile'}", "--virtual-time-budget=2000", "--dump-dom",
        file.as_uri(),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert "<title>" not in done.stdout, "an error in the program"
    found = re.search(r'data-said="([^"]*)"', done.stdout)
    assert found, done.stderr[-500:]
    said = {row[0]: row[1:] for row in json.loads(found[1].replace("&quot;", '"'))}
    many, times, other, values, ranges, curves, picture = said["all"]
    assert (many, picture, curves) == (6, "none", 3)
    assert times.startswith("0 ")
    assert other == times
    assert ranges == 1, "what chatters is an area"
    assert values.replace("|", "") == ""
    _, times, other, values, *_ = said["zoomed"]
    first, *_, last = (float(t) for t in times.split() if t != "time")
    assert 2 <= first < last <= 4
    assert other == times, "the other figure goes along"
    shown = values.split("|")
    assert shown[: len(shown) // 2] == shown[len(shown) // 2 :]
    assert abs(float(shown[0]) - np.sin(3.0)) < 0.01
    assert said["hidden"][5] == 2
    assert said["back"][1] == said["all"][1]
