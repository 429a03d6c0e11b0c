// The rail as the vehicle passes it: each stretch in its colour, the vehicle where it is.

import { at, colours, short } from "./dom.js";
import { railHue } from "./plots.js";

export class Track {
  constructor() {
    this.canvas = at("track");
    /** @type {import("./plots.js").Curves | null} */
    this.curves = null;
    /** @type {number | null} */
    this.time = null;
    this.canvas.title = "click plays the run along the track";
    this.canvas.addEventListener("click", () => this.play());
    new ResizeObserver(() => this.draw()).observe(this.canvas);
  }

  /** @param {import("./plots.js").Curves} curves */
  show(curves) {
    this.curves = curves;
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

  draw() {
    const { width, height } = this.canvas.getBoundingClientRect();
    if (!this.curves || width < 10) return;
    this.canvas.width = width * devicePixelRatio;
    this.canvas.height = height * devicePixelRatio;
    const c = this.canvas.getContext("2d");
    c.scale(devicePixelRatio, devicePixelRatio);
    const { ink, soft, dark } = colours();
    const t = this.curves.time;
    const first = this.way(t[0]);
    const long = Math.max(this.way(t[t.length - 1]) - first, 1e-9);
    const x = (/** @type {number} */ time) => 4 + (width - 8) * (this.way(time) - first) / long;
    c.font = "10px system-ui";
    this.curves.rails.forEach(([start, name], k) => {
      const stop = this.curves?.rails[k + 1]?.[0] ?? t[t.length - 1];
      c.globalAlpha = dark ? 0.5 : 1;
      c.fillStyle = railHue(name);
      c.fillRect(x(start), 19, x(stop) - x(start), 8);
      c.globalAlpha = 1;
      c.fillStyle = soft;
      if (x(stop) - x(start) > 40) c.fillText(name, x(start) + 3, 12, x(stop) - x(start) - 4);
    });
    const now = this.time ?? t[t.length - 1];
    c.fillStyle = ink;
    c.beginPath();
    c.arc(Math.min(x(now), width - 5), 17, 4, 0, 2 * Math.PI);
    c.fill();
    const text = `${short(this.way(now) - first, 4)} m`;
    c.fillText(text, Math.min(Math.max(x(now) - 50, 2), width - 50), 12);
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
