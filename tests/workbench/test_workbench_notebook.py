"""The workbench in a cell of a notebook: the page as one text, its questions as messages."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
import sys
import time

import numpy as np
import pytest
from workbench_frames import answered, read

pytest.importorskip("anywidget", reason="the extra notebook is not installed")

import slipctl
from slipctl import BadInput
from slipctl.workbench.answers import Answers
from slipctl.workbench.desk import Desk
from slipctl.workbench.web.notebook_page import joined_modules, page_text

VIEW = "7"


@pytest.fixture
def cell(tmp_path, monkeypatch):
    """A widget, and what it sent."""
    monkeypatch.chdir(tmp_path)
    widget = slipctl.open("subway_braking:sta", compile=False)
    sent: list = []
    monkeypatch.setattr(widget, "send", lambda said, buffers=None: sent.append((said, buffers)))
    yield widget, sent
    widget.close()


def fetched(widget, sent, kind):
    """Frames of a kind until its answer has ended."""
    found = []
    for _ in range(3000):
        widget._handle_custom_msg({"view": VIEW, "look": True}, [])
        said, buffers = sent.pop()
        assert said["view"] == VIEW
        found += [read(b) for b in buffers if read(b)[0]["kind"] == kind]
        if kind in said["ended"]:
            return found
        time.sleep(0.02)
    raise AssertionError(f"no answer to {kind}")


def test_a_cell_gets_the_run_that_a_script_gets(cell):
    """The same curves bit by bit, from a process beside the kernel."""
    widget, sent = cell
    fetched(widget, sent, "model")  # it is read as soon as it is open
    question = {"kind": "run", "id": 5, "numbers": {"ctl.law.k1": 31.0}}
    widget._handle_custom_msg({"view": VIEW, "ask": json.dumps(question)}, [])
    curves = [(h, c) for h, c in fetched(widget, sent, "run") if h.get("share") == 1.0]
    desk = Desk("subway_braking:sta", compile=False)
    wanted = [(h, c) for h, c in answered(Answers(desk), **question) if h.get("share") == 1.0]
    assert len(curves) == len(wanted) == 1
    assert curves[0][0]["id"] == 5
    for one, other in zip(curves[0][1], wanted[0][1], strict=True):
        assert np.array_equal(one, other, equal_nan=True)


def test_nonsense_of_a_cell_is_left(cell):
    widget, sent = cell
    for said in (None, 5, "x", {}, {"ask": 3}, {"ask": "{"}, {"ask": '{"kind": "none"}'},
                 {"ask": "x" * 10**6}):  # fmt: skip
        widget._handle_custom_msg(said, [])
    assert not sent


def test_what_is_no_file_is_refused_before_a_cell_is_made(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(BadInput, match="there is no file"):
        slipctl.open("nothing.toml")
    assert "open" not in slipctl.__all__  # a star must not take Python's own away


def test_the_page_of_a_cell_loads_nothing():
    """One text: no address of a server in it, and each name of a module is found."""
    text = page_text()
    assert not re.search(r'(?:src|href)="', text)
    assert "import {" not in joined_modules("main")
    assert 'data-notebook="yes"' in text


@pytest.mark.skipif(shutil.which("node") is None, reason="there is no node")
def test_the_joined_script_is_right(tmp_path):
    (tmp_path / "joined.js").write_text(joined_modules("main"), encoding="utf-8")
    checked = subprocess.run(["node", "--check", str(tmp_path / "joined.js")], capture_output=True)
    assert checked.returncode == 0, checked.stderr


@pytest.mark.second
def test_a_kernel_shows_it(tmp_path):
    """A cell of a real kernel that ends with it shows a widget, whose processes end with it."""
    nbclient = pytest.importorskip("nbclient", reason="the extra notebook is not installed")
    nbformat = pytest.importorskip("nbformat", reason="the extra notebook is not installed")
    code = (
        "import slipctl\nshown = slipctl.open('subway_braking:sta', compile=False)\nshown",
        "import multiprocessing\nshown.close()\nprint(multiprocessing.active_children())",
    )
    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(c) for c in code])
    book.metadata["kernelspec"] = {"name": "python3", "display_name": "", "language": "python"}
    nbclient.NotebookClient(book, timeout=120, resources={"metadata": {"path": tmp_path}}).execute()
    kinds = [kind for o in book.cells[0].outputs for kind in o.get("data", {})]
    assert "application/vnd.jupyter.widget-view+json" in kinds
    assert book.cells[1].outputs[0]["text"].strip() == "[]"


@pytest.mark.second
def test_a_browser_moves_a_slider_of_a_cell(cell, tmp_path):
    """The module of the cell in a real browser; its messages go to the widget and back."""
    browser_module = pytest.importorskip("browser")
    if browser_module.executable() is None:
        pytest.skip("there is no chromium on this machine")
    widget, sent = cell
    script = widget._esm if isinstance(widget._esm, str) else str(widget._esm)
    setup = """
      window.out = []; window.hears = [];
      window.model = { get: (n) => ({ height: 700, page: window.pageText })[n],
        send: (said) => window.out.push(said), on: (_, f) => window.hears.push(f), off: () => {} };
      window.answer = (said, texts) => { const buffers = texts.map((t) =>
        new DataView(Uint8Array.from(atob(t), (c) => c.charCodeAt(0)).buffer));
        for (const f of window.hears) f(said, buffers); };"""
    (tmp_path / "cell.html").write_text(
        f"<!doctype html><link rel=icon href='data:,'><body><script>{setup}\nwindow.pageText ="
        f" {json.dumps(widget.page).replace('</', '<' + chr(92) + '/')};</script>"
        f"<script type=module>{script.replace('export default', 'const made =')}\n"
        "made.render({ model: window.model, el: document.body });</script>", encoding="utf-8"
    )  # fmt: skip
    inside = "document.querySelector('iframe').contentDocument"
    browser = browser_module.Browser()

    def pump(wanted):
        for _ in range(3000):
            for said in browser.run("window.out ? window.out.splice(0) : []"):
                widget._handle_custom_msg(said, [])
                while sent:
                    told, buffers = sent.pop(0)
                    texts = [base64.b64encode(b).decode() for b in buffers]
                    browser.run(f"window.answer({json.dumps(told)}, {json.dumps(texts)})")
            if found := browser.run(wanted):
                return found
            time.sleep(0.02)
        raise AssertionError(f"never true: {wanted}; {browser.complaints}")

    try:
        browser.page("Page.navigate", url=(tmp_path / "cell.html").as_uri())
        pump(f"document.querySelector('iframe') && {inside}.getElementById('state')?.dataset.done")
        before = browser.run(f"{inside}.getElementById('metrics').textContent")
        browser.run(
            f"(() => {{ const r = {inside}.querySelector('input[type=range]');"
            " r.value = 40; r.dispatchEvent(new Event('input', {bubbles: true})); })()"
        )
        pump(f"{inside}.getElementById('metrics').textContent !== {before!r}")
        assert browser.run(f"{inside}.querySelectorAll('.panel canvas').length") == 5
        assert browser.complaints == []
        if sys.platform.startswith("linux"):
            browser.picture(tmp_path / "cell.png")
    finally:
        browser.close()
