"""What the page lists at a clicked time, by its own script, with a page that holds words alone."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from slipctl import registry

PAGE = Path(registry.__file__).parent / "workbench" / "web" / "page"

SCRIPT = """
const made = {};
const box = (name) => made[name] ??= { kids: [], hidden: false, value: "", style: {}, click() {},
  setAttribute() {}, addEventListener() {}, append(...k) { this.kids.push(...k); },
  replaceChildren(...k) { this.kids = k; } };
globalThis.document = { getElementById: box, querySelector: box,
  createElement: () => box(String(Math.random())), createTextNode: (t) => t };
const { Signals } = await import("./signals.mjs");
let hear;
const asked = [];
const talk = { on: (kind, act) => { hear = act; }, ask: (...what) => asked.push(what) };
const plots = { now: null };
const page = new Signals(talk, () => ({}), plots);
page.ask(1);
plots.now = { guest: true, time: [0, 0.5, 1.02, 2], panels: [
  { name: "x1", unit: "m/s", series: [{ name: "x1", values: [1, 2, 3, 4] }] },
  { name: "y", unit: "1", series: [{ name: "computed", values: [5, 6, 7, 8] },
                                   { name: "recorded", values: [9, 10, 11, 12] }] }] };
page.ask(1);
hear({ signals: [{ name: "late", values: [0], unit: "1", doc: "" }], time: 1 });
const rows = page.rows.map((r) => [r.name, r.values[0], r.unit]);
plots.now = { guest: false };
page.renew();
console.log(JSON.stringify([rows, asked.length]));
"""


@pytest.mark.skipif(shutil.which("node") is None, reason="there is no node")
def test_curves_that_are_no_run_of_the_loop_tell_their_own_values(tmp_path: Path) -> None:
    """Of a worst disturbance or a replay; an answer of the run that comes late changes nothing."""
    for name in ("signals", "dom"):
        text = (PAGE / f"{name}.js").read_text(encoding="utf-8")
        (tmp_path / f"{name}.mjs").write_text(text.replace("./dom.js", "./dom.mjs"))
    (tmp_path / "page.mjs").write_text(SCRIPT)
    done = subprocess.run(["node", "page.mjs"], cwd=tmp_path, capture_output=True, text=True)
    assert done.stderr == ""
    rows, asked = json.loads(done.stdout)
    assert rows == [["x1", 3, "m/s"], ["y, computed", 7, "1"], ["y, recorded", 11, "1"]]
    assert asked == 2  # before and after, of the run
