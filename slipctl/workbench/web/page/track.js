// The rail as the train passes it: what it carries at each place, and each axle where it is.

import { at, colours, hue, short } from "./dom.js";
import { railHue } from "./plots.js";

const TOP = 15;
const HIGH = 8;

export class Track {
  constructor() {
    this.canvas = at("track");
    /** @type {import("./plots.js").Curves | null} */
    this.curves = null;
    /** @type {number | null} */
    this.time = null;
    /** What each axle found at each place, and the scale: made once for a run and a width. @type {any} */
    this.found = null;
    this.canvas.title = "click plays the run along the track: the rail has the adhesion that the last axle that passed it found";
    this.canvas.addEventListener("click", () => this.play());
    new ResizeObserver(() => { this.found = null; this.draw(); }).observe(this.canvas);
  }

  /** @param {import("./plots.js").Curves} curves */
  show(curves) {
    this.curves = curves;
    this.found = null;
    this.draw();
  }

  /** @param {number | null} time */
  point(time) {
    this.time = time;
    this.draw();
  }

  /** Way at a time. @param {number} time */
  way(time) {
    const panel = this.curves?.panels.find((p) => p.name === "distance");
    if (!this.curves || !panel) return 0;
    const t = this.curves.time;
    let lo = 0;
    let hi = t.length - 1;
    while (hi - lo > 1) {
      const mid = (lo + hi) >> 1;
      if (t[mid] <= time) lo = mid; else hi = mid;
    }
    return panel.series[0].values[time >= t[hi] ? hi : lo];
  }

  /** Best adhesion that each axle found, over the pixels of the rail; none where the run has none.
   * @param {import("./plots.js").Curves} curves @param {number[]} behind @param {(place: number) => number} x @param {number} width */
  foundBy(curves, behind, x, width) {
    const best = curves.panels.find((p) => p.name === "adhesion")?.series.filter((/** @type {any} */ s) => s.looks === "best") ?? [];
    const way = curves.panels.find((p) => p.name === "distance")?.series[0].values;
    if (!best.length || !way) return null;
    let most = 1e-9;
    const rows = behind.map((far, k) => {
      const row = new Float32Array(Math.ceil(width)).fill(NaN);
      const { values } = best[Math.min(k, best.length - 1)];
      let last = Math.max(Math.floor(x(way[0] - far)), 0);
      for (let i = 0; i < way.length; i++) {
        const to = Math.min(Math.floor(x(way[i] - far)), row.length - 1);
        for (; last <= to; last++) row[last] = values[i];
        if (values[i] > most) most = values[i];
      }
      return row;
    });
    return { rows, most };
  }

  draw() {
    const { width, height } = this.canvas.getBoundingClientRect();
    if (!this.curves || width < 10) return;
    this.canvas.width = width * devicePixelRatio;
    this.canvas.height = height * devicePixelRatio;
    const c = this.canvas.getContext("2d");
    c.scale(devicePixelRatio, devicePixelRatio);
    const { ink, soft, dark } = colours();
    const t = this.curves.time;
    const behind = this.curves.behind.length ? this.curves.behind : [0];
    const first = this.way(t[0]) - Math.max(...behind);
    const long = Math.max(this.way(t[t.length - 1]) - first, 1e-9);
    const place = (/** @type {number} */ s) => 4 + (width - 8) * (s - first) / long;
    const x = (/** @type {number} */ time) => place(this.way(time));
    this.found ??= { of: this.foundBy(this.curves, behind, place, width) };
    const now = this.time ?? t[t.length - 1];
    const here = this.way(now);
    c.font = "10px system-ui";
    this.curves.rails.forEach(([start, name], k) => {
      const left = k ? x(start) : 4;
      const stop = x(this.curves?.rails[k + 1]?.[0] ?? t[t.length - 1]);
      if (!this.found.of) {
        c.globalAlpha = dark ? 0.5 : 1;
        c.fillStyle = railHue(name);
        c.fillRect(left, TOP, stop - left, HIGH);
        c.globalAlpha = 1;
      }
      c.fillStyle = soft;
      if (stop - left > 40) c.fillText(name, left + 3, 12, stop - left - 4);
    });
    if (this.found.of) {
      const { rows, most } = this.found.of;
      for (let px = 4; px < width - 4; px++) {
        let value = NaN;
        rows.forEach((/** @type {Float32Array} */ row, /** @type {number} */ k) => {
          if ((k === 0 || place(here - behind[k]) >= px) && !Number.isNaN(row[px])) value = row[px];
        });
        c.fillStyle = Number.isNaN(value) ? soft : adhesionHue(value / most);
        c.fillRect(px, TOP, 1.2, HIGH);
      }
    }
    behind.forEach((far, k) => {
      c.fillStyle = behind.length > 1 ? hue(k) : ink;
      c.beginPath();
      c.arc(Math.min(Math.max(place(here - far), 4), width - 4), TOP + HIGH + 3, 3, 0, 2 * Math.PI);
      c.fill();
    });
    c.fillStyle = ink;
    c.fillText(`${short(here - this.way(t[0]), 4)} m`, Math.min(Math.max(place(here) - 50, 2), width - 50), 12);
  }

  /** Play the run, five seconds a second where it is long. */
  play() {
    const curves = this.curves;
    if (!curves) return;
    const end = curves.time[curves.time.length - 1];
    const pace = Math.max(1, end / 6);
    const begun = performance.now();
    const step = () => {
      const time = pace * (performance.now() - begun) / 1000;
      if (curves !== this.curves || time >= end) {
        this.point(null);
        return;
      }
      this.point(time);
      requestAnimationFrame(step);
    };
    step();
  }
}

/** From little adhesion, orange, to much, blue. @param {number} share of the best in the run */
function adhesionHue(share) {
  const from = [213, 94, 0];
  const middle = [240, 228, 180];
  const to = [0, 114, 178];
  const w = Math.sqrt(Math.min(Math.max(share, 0), 1));  // slippery rails differ more than dry ones
  const [a, b, by] = w < 0.6 ? [from, middle, w / 0.6] : [middle, to, (w - 0.6) / 0.4];
  return `rgb(${a.map((v, k) => Math.round(v + by * (b[k] - v))).join(" ")})`;
}
