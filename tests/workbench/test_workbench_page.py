"""A real browser clicks through the workbench; pictures are kept, and it must not complain once."""

from __future__ import annotations

import os
import statistics
from pathlib import Path

import pytest

pytest.importorskip("starlette", reason="the extra workbench is not installed")
pytest.importorskip("uvicorn", reason="the extra workbench is not installed")
pytest.importorskip("websockets", reason="the extra workbench is not installed")

from browser import Browser, executable
from test_workbench_server import serving

from slipctl import registry
from slipctl.workbench.sources.openings import Opening

pytestmark = [
    pytest.mark.second,
    pytest.mark.skipif(executable() is None, reason="there is no chromium on this machine"),
]

METRO = registry.folder("models") / "vehicle" / "files" / "metro.toml"
DONE = "document.getElementById('state').dataset.done"


@pytest.fixture(scope="module")
def pictures(tmp_path_factory) -> Path:
    """Folder of the pictures: $SLIPCTL_PICTURES, or one that pytest keeps for a while."""
    named = os.environ.get("SLIPCTL_PICTURES")
    folder = Path(named) if named else tmp_path_factory.mktemp("pictures")
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def slide(browser: Browser, name: str, place: int) -> None:
    """Move a slider to a place, as a drag does."""
    browser.run(
        f"(() => {{ const r = document.querySelector('input[type=range][aria-label=\"{name}\"]');"
        f" r.value = {place}; r.dispatchEvent(new Event('input', {{bubbles: true}})); }})()"
    )


def after(browser: Browser, act) -> str:
    """What the page says when the run that an act asks for has ended."""
    before = browser.run(DONE)
    act()
    browser.wait(f"{DONE} && {DONE} !== {before!r}", 90)
    return browser.run("document.getElementById('state').textContent")


METRIC = (
    "[...document.querySelectorAll('#metrics tbody tr')].find("
    "r => r.children[0].textContent === 'NAME').children[1].textContent"
)


def metric(browser: Browser, name: str) -> str:
    return browser.run(METRIC.replace("NAME", name))


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    with serving(Opening("hst_braking:eppfc", str(folder))) as server:
        browser = Browser()
        try:
            browser.open(server.address)
            browser.wait(DONE, 120)
            yield browser
        finally:
            browser.close()


def test_a_slider_moves_the_curve_within_a_moment(study, pictures):
    spent = []
    for place in range(150, 350, 10):
        after(study, lambda place=place: slide(study, "ctl.law.K1", place))
        spent.append(float(study.run("document.getElementById('state').dataset.spent")))
    middle, late = statistics.median(spent), sorted(spent)[18]
    print(f"slider to curve: median {middle:.0f} ms, 95 % {late:.0f} ms")
    assert middle < 1500  # of a loaded machine; 120 is wanted of an idle one
    assert study.run("document.querySelectorAll('.panel canvas').length") == 5
    study.picture(pictures / "study.png")


def test_a_number_out_of_range_is_told_in_words(study):
    study.run(
        "(() => { const r = document.querySelector("
        "'input.number[aria-label=\"ctl.law.K1, number\"]');"
        " r.value = '-5'; r.dispatchEvent(new Event('change')); })()"
    )
    assert "outside" in study.wait(
        "document.getElementById('state').textContent.includes('outside') &&"
        " document.getElementById('state').textContent"
    )
    after(study, lambda: study.click("#undo"))
    assert study.run("document.getElementById('redo').disabled") is False


def test_the_point_of_the_region_is_dragged(study, pictures):
    points = "document.getElementById('region-words').textContent.match(/\\d+(?= )/g)"
    study.wait(f"({points} || []).slice(0, 3).reduce((a, b) => a + Number(b), 0) === 121", 240)
    x, y, w, h = study.run(
        "(() => { const b = document.getElementById('region').getBoundingClientRect();"
        " return [b.x, b.y, b.width, b.height]; })()"
    )

    def drag():
        study.mouse("mousePressed", x + 0.4 * w, y + 0.5 * h, buttons=1)
        study.mouse("mouseMoved", x + 0.9 * w, y + 0.2 * h, buttons=1)
        study.mouse("mouseReleased", x + 0.9 * w, y + 0.2 * h)

    after(study, drag)
    assert study.run("document.querySelectorAll('.slider.moved').length") >= 2
    study.wait("document.getElementById('verdict').textContent.includes('✓ certified')", 60)
    study.picture(pictures / "region.png")


def test_the_worst_disturbance_is_run_on_a_click(study, pictures):
    """What the certificate has of it, or a line that says what it has not; the run comes back."""
    study.wait("document.getElementById('worst')", 60)
    study.click("#worst")
    study.wait("document.getElementById('worst-words').textContent.length > 10", 60)
    words = study.run("document.getElementById('worst-words').textContent")
    assert "Traceback" not in words
    study.picture(pictures / "worst.png")


def test_pins_stand_beside_the_run(study):
    study.click("#pin")
    after(study, lambda: slide(study, "ctl.law.K1", 60))
    heads = study.run("[...document.querySelectorAll('#metrics thead th')].map(h => h.textContent)")
    assert "pin 1" in heads
    study.click("#unpin")


def test_the_plots_zoom_together_at_thirty_frames_a_second(study):
    frames = study.run("""(async () => {
      const over = document.querySelector('.u-over'), b = over.getBoundingClientRect();
      const turn = (y, shift) => over.dispatchEvent(new WheelEvent('wheel',
        {deltaY: y, shiftKey: shift, clientX: b.x + 200, clientY: b.y + 20, cancelable: true}));
      for (let k = 0; k < 5; k++) turn(-100, false);
      const begun = performance.now();
      for (let k = 0; k < 60; k++) {
        turn(k % 20 < 10 ? 100 : -100, true);
        await new Promise(requestAnimationFrame);
      }
      const spent = performance.now() - begun;
      over.dispatchEvent(new MouseEvent('dblclick'));
      return 60000 / spent; })()""")
    print(f"panning at {frames:.0f} frames a second")
    assert frames > 8  # of a loaded machine; 30 are wanted of an idle one


def test_the_law_and_the_blocks_are_shown(study, pictures):
    study.click("[data-tab=law]")
    study.wait("document.querySelector('#law-plot canvas') && document.querySelector('#law math')")
    assert "0.181" in study.run("document.getElementById('law-words').textContent")
    study.picture(pictures / "law.png")
    study.click("[data-tab=block]")
    study.wait("document.querySelector('#block .diagram img')")
    study.click("#block button[aria-label='open ctl']")
    study.wait("document.querySelector('#block b').textContent !== 'loop'")
    study.picture(pictures / "blocks.png")
    study.click("[data-tab=sliders]")


def test_a_click_on_a_time_shows_all_signals(study, pictures):
    x, y = study.run(
        "(() => { const b = document.querySelector('#plots .u-over').getBoundingClientRect();"
        " return [b.x + 0.5 * b.width, b.y + 0.5 * b.height]; })()"
    )
    for kind in ("mouseMoved", "mousePressed", "mouseReleased"):
        study.mouse(kind, x, y)
    study.wait("document.querySelectorAll('#signals-list tr').length > 20", 60)
    study.run("document.getElementById('signals-find').value = 'v_s'")
    study.run("document.getElementById('signals-find').dispatchEvent(new Event('input'))")
    shown = "[...document.querySelectorAll('#signals-list th')].map(h => h.textContent)"
    assert study.run(f"{shown}.length > 0 && {shown}.every(n => n.length > 2)")
    study.picture(pictures / "signals.png")
    study.click("[data-tab=sliders]")


def test_state_and_pins_survive_a_reload(study):
    study.click("#pin")
    after(study, lambda: slide(study, "m", 250))
    before = study.run("document.querySelectorAll('.slider.moved').length")
    assert before
    pinned = "[...document.querySelectorAll('#metrics tbody tr')].map(r => r.cells[3].textContent)"
    metrics = study.run(pinned)
    study.run("window.old = true")
    study.page("Page.reload")
    study.wait(f"!window.old && document.readyState === 'complete' && {DONE}", 60)
    assert study.run("document.querySelectorAll('.slider.moved').length") == before
    assert study.run(pinned) == metrics
    study.click("#unpin")


def test_c_stands_beside_it(study, pictures):
    study.click("#c-ask")
    study.wait("document.querySelector('#c pre.code') || document.querySelector('#c .soft')", 400)
    said = study.run("document.getElementById('c').textContent")
    assert "replayed against Python: the same" in said
    assert "hst_braking_eppfc.c" in said
    study.run("document.getElementById('c-ask').scrollIntoView()")
    study.picture(pictures / "c.png")


def test_a_search_a_sweep_and_a_replay_run_beside_it(study, pictures, tmp_path):
    """Gains of a search are taken by a click; a sweep can be stopped; a log stands in the plots."""
    done = "document.querySelector('#command pre.code')"
    study.run("document.getElementById('ranges').value = 'ctl.law.K1=10:40'")
    study.run("document.getElementById('count').value = '2'")
    study.click("#sweep")
    study.wait("document.querySelector('#stop')", 60)
    study.wait(f"{done} && {done}.textContent.includes('2 runs')", 240)
    study.run("document.getElementById('ranges').scrollIntoView()")
    study.picture(pictures / "sweep_on_page.png")
    study.run("document.getElementById('count').value = '2000'")
    study.click("#sweep")
    study.wait("document.querySelector('#stop')", 60)
    study.click("#stop")
    assert study.wait(f"{done} && {done}.textContent.includes('stopped')", 60)


def test_the_browser_asked_nobody_else_and_did_not_complain(study):
    assert study.complaints == []
    assert all(r.startswith(("http://127.0.0.1:", "ws://127.0.0.1:", "data:", "about:"))
               for r in study.requests)  # fmt: skip


@pytest.mark.parametrize(
    "dark", [False, pytest.param(True, marks=pytest.mark.long)], ids=["light", "dark"]
)
def test_a_file_is_edited_run_and_saved(tmp_path, monkeypatch, pictures, dark):
    text = METRO.read_text(encoding="utf-8").replace('duration = "17 s"', 'duration = "1 s"')
    text = text.replace('end = "standstill" ', "# ")
    (tmp_path / "metro.toml").write_text(text)
    monkeypatch.chdir(tmp_path)
    with serving(Opening("metro.toml:pid", str(tmp_path), (), False)) as server:
        browser = Browser(dark=dark)
        try:
            browser.open(server.address)
            browser.wait(DONE, 120)
            assert metric(browser, "distance").endswith(" m")
            browser.picture(pictures / f"metro_{'dark' if dark else 'light'}.png")
            browser.click("[data-tab=text]")
            type_over(browser, "axles = 4", "axels = 4")
            browser.wait("document.querySelector('#faults li')")
            assert "did you mean 'axles'" in browser.run(
                "document.getElementById('faults').textContent"
            )
            browser.wait(f"{SHADOW}.querySelectorAll('.cm-lint-marker-error').length === 1")
            browser.picture(pictures / f"faults_{'dark' if dark else 'light'}.png")
            type_over(browser, "axels = 4", "axles = 4")
            # a key of the table is offered while it is typed, Tab takes it
            type_over(browser, "axles = 4", "axles = 4\nrotatin")
            browser.key("g")
            browser.wait(f"{SHADOW}.querySelector('.cm-tooltip-autocomplete li')")
            browser.picture(pictures / f"offered_{'dark' if dark else 'light'}.png")
            browser.press("Tab", 9)
            browser.wait(f"{VIEW}.state.doc.toString().includes('\\nrotating_mass = ')")
            type_over(browser, "\nrotating_mass = ", "")
            before = metric(browser, "distance")
            type_over(browser, '"60 km/h"', '"66 km/h"')
            browser.wait(f"{METRIC.replace('NAME', 'distance')} !== {before!r}", 90)
            browser.click("#save")
            browser.wait(
                "document.getElementById('state').textContent.includes('saved metro.toml')", 60
            )
            saved = (tmp_path / "metro.toml").read_text()
            assert saved == text.replace('speed = "60 km/h"', 'speed = "66 km/h"')
            assert sorted(os.listdir(tmp_path)) == ["metro.toml"]
            assert browser.complaints == []
        finally:
            browser.close()


VIEW = (
    "CodeMirror.EditorView.findFromDOM("
    "document.getElementById('editor').shadowRoot.querySelector('.cm-editor'))"
)
SHADOW = "document.getElementById('editor').shadowRoot"


def type_over(browser: Browser, old: str, new: str) -> None:
    """Replace a word of the file, the last place of it, and leave the cursor behind it."""
    browser.run(
        f"(() => {{ const v = {VIEW}; const k = v.state.doc.toString().lastIndexOf({old!r});"
        f" v.focus(); v.dispatch({{ changes: {{ from: k, to: k + {len(old)}, insert: {new!r} }},"
        f" selection: {{ anchor: k + {len(new)} }}, userEvent: 'input.type' }}); }})()"
    )
