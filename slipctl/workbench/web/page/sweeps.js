// Runs of a sweep: a dot each, a metric over a number; a click runs the loop with its numbers.

import { at, colours, fill, hue, make, short, unitOf } from "./dom.js";

const HIGH = 170;
const NEAR = 12;

export class Sweeps {
  /** @param {(numbers: Object<string, number>) => void} take */
  constructor(take) {
    this.take = take;
    /** @type {any} */
    this.sweep = null;
    this.canvas = at("runs");
    this.chosen = -1;
    for (const id of ["sweep-x", "sweep-y"]) at(id).addEventListener("change", () => this.draw());
    this.canvas.addEventListener("click", (/** @type {MouseEvent} */ e) => this.click(e));
    this.canvas.addEventListener("keydown", (/** @type {KeyboardEvent} */ e) => this.key(e));
    new ResizeObserver(() => this.draw()).observe(this.canvas);
  }

  /** @param {any} sweep of the model that is open, or nothing */
  show(sweep) {
    const first = !this.sweep;
    this.sweep = sweep ?? null;
    at("sweep-of").hidden = !sweep;
    if (!sweep || !first) return;
    fill(at("sweep-x"), ...sweep.axes.map((/** @type {string} */ n) => make("option", { value: n }, n)), make("option", { value: "" }, "number of the run"));
    fill(at("sweep-y"), ...sweep.metrics.map((/** @type {any} */ m, /** @type {number} */ k) => make("option", { value: k }, m.name)));
    const broken = sweep.runs.filter((/** @type {any} */ r) => r.failed).length;
    const words = [`${sweep.runs.length} runs of ${sweep.folder}`, sweep.missing ? `${sweep.missing} are missing` : "",
      broken ? `${broken} broke off` : "", sweep.kept, sweep.lost.length ? `no slider has ${sweep.lost.join(", ")}: a click leaves them` : "",
      sweep.swapped.length ? `made with --swap ${sweep.swapped.join(" ")}, which the page does not` : ""];
    fill(at("sweep-words"), words.filter(Boolean).join("; "));
    this.draw();
  }

  /** Dots with their run, in pixels of the canvas. */
  dots() {
    const { width } = this.canvas.getBoundingClientRect();
    const name = at("sweep-x").value;
    const k = Number(at("sweep-y").value);
    const all = this.sweep.runs.map((/** @type {any} */ r, /** @type {number} */ n) => ({ n, x: name ? r.all[name] : r.run, y: r.metrics[k] }))
      .filter((/** @type {any} */ d) => Number.isFinite(d.x) && Number.isFinite(d.y));
    const ends = (/** @type {number[]} */ v) => [v.reduce((a, b) => Math.min(a, b), Infinity), v.reduce((a, b) => Math.max(a, b), -Infinity)];
    const limit = this.sweep.metrics[k].limit;
    const [x0, x1] = ends(all.map((/** @type {any} */ d) => d.x));
    const [y0, y1] = ends([...all.map((/** @type {any} */ d) => d.y), ...(limit === null ? [] : [limit])]);
    const place = (/** @type {number} */ v, /** @type {number} */ lo, /** @type {number} */ hi) => (hi > lo ? (v - lo) / (hi - lo) : 0.5);
    const px = (/** @type {number} */ v) => 50 + (width - 62) * place(v, x0, x1);
    const py = (/** @type {number} */ v) => 10 + (HIGH - 42) * (1 - place(v, y0, y1));
    return { all: all.map((/** @type {any} */ d) => ({ ...d, px: px(d.x), py: py(d.y) })), x0, x1, y0, y1, limit, py, name, width };
  }

  draw() {
    const { width } = this.canvas.getBoundingClientRect();
    if (!this.sweep || width < 20) return;
    this.canvas.width = width * devicePixelRatio;
    this.canvas.height = HIGH * devicePixelRatio;
    const c = this.canvas.getContext("2d");
    c.scale(devicePixelRatio, devicePixelRatio);
    const { soft, ink } = colours();
    const { all, x0, x1, y0, y1, limit, py, name } = this.dots();
    c.font = "11px system-ui";
    c.fillStyle = soft;
    if (!all.length) { c.fillText("no run has it", 50, 40); return; }
    c.fillText(short(x0, 3), 50, HIGH - 18);
    c.fillText(name || "run", width / 2 - 20, HIGH - 4);
    c.textAlign = "right";
    c.fillText(short(x1, 3), width - 8, HIGH - 18);
    c.fillText(short(y1, 3), 46, 14);
    c.fillText(short(y0, 3), 46, HIGH - 32);
    c.textAlign = "left";
    if (limit !== null) {
      c.strokeStyle = ink;
      c.setLineDash([5, 4]);
      c.strokeRect(50, py(limit), width - 58, 0);
      c.setLineDash([]);
    }
    for (const d of all) {
      const bad = limit !== null && d.y > limit;
      c.strokeStyle = c.fillStyle = bad ? hue(1) : hue(0);
      c.beginPath();
      c.arc(d.px, d.py, d.n === this.chosen ? 5 : 3, 0, 7);
      if (bad) c.stroke(); else c.fill();
    }
  }

  /** @param {MouseEvent} e */
  click(e) {
    if (!this.sweep) return;
    const { all } = this.dots();
    const far = (/** @type {any} */ d) => Math.hypot(d.px - e.offsetX, d.py - e.offsetY);
    const best = all.reduce((/** @type {any} */ a, /** @type {any} */ b) => (!a || far(b) < far(a) ? b : a), null);
    if (best && far(best) < NEAR) this.choose(best.n);
  }

  /** @param {KeyboardEvent} e */
  key(e) {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[e.key];
    if (!step || !this.sweep) return;
    e.preventDefault();
    const order = this.dots().all.sort((/** @type {any} */ a, /** @type {any} */ b) => a.x - b.x);
    const now = order.findIndex((/** @type {any} */ d) => d.n === this.chosen);
    const next = order[Math.min(Math.max(now + step, 0), order.length - 1)];
    if (next) this.choose(next.n);
  }

  /** @param {number} n */
  choose(n) {
    this.chosen = n;
    const run = this.sweep.runs[n];
    const k = Number(at("sweep-y").value);
    const metric = this.sweep.metrics[k];
    fill(at("sweep-run"), `run ${run.run}: ${Object.entries(run.all).map(([name, v]) => `${name} = ${short(/** @type {number} */ (v))}`).join(", ")}; `
      + `${metric.name} ${short(run.metrics[k])}${unitOf(metric.unit)}${run.failed ? `; ${run.failed}` : ""}`);
    this.draw();
    this.take(run.numbers);
  }
}
