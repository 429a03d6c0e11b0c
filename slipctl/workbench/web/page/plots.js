// Curves of runs: the one that goes on in front, the last one and pinned ones behind it.

import { at, colours, fill, hue, make, short, unitOf } from "./dom.js";

/** @typedef {{time: Float32Array, panels: any[], rails: [number, string][], behind: number[], name: string, guest?: boolean}} Curves */

const HIGH = 80;
const AXIS = 20;
const DASHES = { best: [6, 3], wanted: [2, 2], main: [], axle: [] };

/** Curves of a frame. @param {any} head @param {Float32Array[]} columns @returns {Curves} */
export function curvesOf(head, columns) {
  let k = 1;
  const panels = head.panels.map((/** @type {any} */ p) => ({
    ...p, series: p.series.map((/** @type {any} */ s) => ({ ...s, values: columns[k++] })),
  }));
  return { time: columns[0], panels, rails: head.rails, behind: head.behind ?? [], name: head.loop };
}

export class Plots {
  /** @param {(time: number | null) => void} pointed @param {(time: number) => void} chosen */
  constructor(pointed, chosen) {
    this.pointed = pointed;
    this.clicked = chosen;
    /** @type {any[]} */
    this.plots = [];
    this.shape = "";
    this.axle = 0;
    /** @type {Curves | null} */
    this.now = null;
    /** @type {Curves | null} */
    this.before = null;
    /** @type {Curves[]} */
    this.pins = [];
    /** @type {[number, number] | null} */
    this.zoom = null;
    this.end = 0;
    new ResizeObserver(() => this.resize()).observe(at("plots"));
  }

  /** Series of a panel that are drawn: of the chosen axle, or of all. @param {any} panel */
  chosen(panel) {
    const many = panel.series.some((/** @type {any} */ s) => s.axle > 0);
    if (!many || this.axle) {
      return panel.series.filter((/** @type {any} */ s) => !s.axle || s.axle === this.axle);
    }
    return panel.series.filter((/** @type {any} */ s, /** @type {number} */ n) => s.looks === "axle" ||
      panel.series.findIndex((/** @type {any} */ o) => o.name === s.name && o.looks === s.looks) === n);
  }

  /** @param {Curves} curves @param {number} share */
  show(curves, share) {
    this.now = curves;
    const long = curves.time[curves.time.length - 1] / Math.max(share, 1e-6);
    this.end = share < 1 && this.before ? Math.max(this.before.time[this.before.time.length - 1], curves.time[curves.time.length - 1]) : long;
    const shape = JSON.stringify([this.axle, colours().dark, curves.panels.map((p) => [p.name, p.unit,
      p.series.map((/** @type {any} */ s) => [s.name, s.axle])])]);
    if (shape !== this.shape) {
      this.shape = shape;
      this.build(curves);
    }
    curves.panels.forEach((p, k) => {
      this.plots[k].setData([curves.time, ...this.chosen(p).map((/** @type {any} */ s) => s.values)], false);
      this.plots[k].setScale("x", this.span());
    });
  }

  /** Curves that are no run of the loop, with words; the next run takes their place.
   * @param {Curves} curves @param {string[]} words */
  guest(curves, words) {
    this.zoom = null;
    this.show({ ...curves, guest: true }, 1);
    fill(at("shown-words"), words.join("; "));
    at("shown").hidden = false;
  }

  span() {
    return this.zoom ? { min: this.zoom[0], max: this.zoom[1] } : { min: 0, max: this.end };
  }

  /** @param {Curves} curves */
  build(curves) {
    for (const plot of this.plots) plot.destroy();
    fill(at("plots"));
    this.plots = curves.panels.map((p, k) => this.panel(p, k, k + 1 === curves.panels.length));
  }

  /** @param {any} panel @param {number} k @param {boolean} last */
  panel(panel, k, last) {
    const { ink, soft, line } = colours();
    const series = this.chosen(panel);
    const keys = series.filter((/** @type {any} */ s, /** @type {number} */ n) =>
      series.findIndex((/** @type {any} */ o) => o.name === s.name && o.looks === s.looks) === n || s.looks === "axle");
    const values = keys.map(() => make("b", {}));
    const box = make("div", { className: "panel" }, make("h3", {}, make("b", {}, panel.name + (panel.unit === "1" ? "" : ` [${panel.unit}]`)),
      ...keys.map((/** @type {any} */ s, /** @type {number} */ n) => {
        const mark = make("span", { className: "key" }, `${s.looks !== "axle" ? s.name : n && keys[n - 1].name === s.name ? s.axle : `${s.name} ${s.axle}`} `, values[n]);
        mark.style.color = this.hue(s);
        return mark;
      })));
    at("plots").append(box);
    const axis = { stroke: soft, grid: { stroke: line, width: 0.6 }, ticks: { stroke: line, width: 0.6 }, font: "11px system-ui" };
    const plot = new /** @type {any} */ (window).uPlot({
      width: Math.max(at("plots").clientWidth, 100), height: HIGH + (last ? AXIS : 0), legend: { show: false },
      cursor: { sync: { key: "time" }, drag: { x: true, y: false, setScale: false }, points: { size: 5 } },
      scales: { x: { time: false, auto: false }, y: { range: (/** @type {any} */ _, /** @type {number} */ lo, /** @type {number} */ hi) => this.range(k, lo, hi) } },
      axes: [{ ...axis, size: last ? AXIS : 0, ticks: { show: false }, values: last ? undefined : () => [] }, { ...axis, size: 48, space: 22, values: (/** @type {any} */ _, /** @type {number[]} */ at) => at.map((n) => (n !== 0 && Math.abs(n) < 1e-3 ? n.toExponential() : short(n))) }], padding: [4, 8, 0, 0],
      series: [{}, ...series.map((/** @type {any} */ s) => ({ stroke: this.hue(s), dash: DASHES[/** @type {"main"} */ (s.looks)] || [],
        width: s.looks === "axle" ? 1.1 : 1.5, points: { show: false } }))],
      hooks: {
        drawClear: [(/** @type {any} */ u) => this.behind(u, k)],
        setSelect: [(/** @type {any} */ u) => this.select(u)],
        setCursor: [(/** @type {any} */ u) => this.cursor(u, k, keys, values)],
        ready: [(/** @type {any} */ u) => this.wheel(u)],
      },
    }, [[0], ...series.map(() => [0])], box);
    plot.root.style.color = ink;
    return plot;
  }

  /** @param {any} s */
  hue(s) {
    const { ink, soft } = colours();
    if (s.looks === "axle") return hue(s.axle - 1);
    return s.looks === "best" ? ink : s.looks === "wanted" ? soft : hue(0);
  }

  /** Range of values with those of the runs behind. @param {number} k @param {number} lo @param {number} hi */
  range(k, lo, hi) {
    for (const run of this.ghosts()) {
      for (const s of run.panels[k]?.name === this.now?.panels[k]?.name ? this.chosen(run.panels[k]) : []) {
        for (const v of s.values) {
          if (v < lo || lo === null) lo = v;
          if (v > hi || hi === null) hi = v;
        }
      }
    }
    if (lo === null || lo === undefined || !(hi > lo)) return [(lo ?? 0) - 1, (lo ?? 0) + 1];
    const room = 0.04 * (hi - lo);
    return [lo - room, hi + room];
  }

  ghosts() {
    return [...(this.before ? [this.before] : []), ...this.pins];
  }

  /** Stretches of the rail, and the runs behind. @param {any} u @param {number} k */
  behind(u, k) {
    const { ghost, dark } = colours();
    const { left, top, width, height } = u.bbox;
    const x = (/** @type {number} */ t) => u.valToPos(t, "x", true);
    u.ctx.save();
    u.ctx.beginPath();
    u.ctx.rect(left, top, width, height);
    u.ctx.clip();
    const rails = this.now ? this.now.rails : [];
    rails.forEach(([start, name], n) => {
      const stop = n + 1 < rails.length ? rails[n + 1][0] : this.end;
      u.ctx.fillStyle = railHue(name);
      u.ctx.globalAlpha = dark ? 0.2 : 0.32;
      u.ctx.fillRect(x(start), top, x(stop) - x(start), height);
    });
    u.ctx.globalAlpha = 1;
    this.ghosts().forEach((run, n) => {
      const panel = run.panels[k];
      if (!panel || panel.name !== this.now?.panels[k].name) return;
      u.ctx.strokeStyle = run === this.before ? ghost : hue(3 + (n % 5));
      u.ctx.lineWidth = devicePixelRatio;
      for (const s of this.chosen(panel)) {
        if (s.looks === "best" || s.looks === "wanted") continue;
        u.ctx.beginPath();
        for (let i = 0; i < run.time.length; i++) u.ctx.lineTo(x(run.time[i]), u.valToPos(s.values[i], "y", true));
        u.ctx.stroke();
      }
    });
    u.ctx.restore();
  }

  /** @param {any} u */
  select(u) {
    const { left, width } = u.select;
    if (width > 4) this.setZoom(u.posToVal(left, "x"), u.posToVal(left + width, "x"));
    u.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
  }

  /** @param {number | null} from @param {number} [to] */
  setZoom(from, to) {
    this.zoom = from === null ? null : [Math.max(from, 0), Math.min(/** @type {number} */ (to), this.end)];
    for (const plot of this.plots) plot.setScale("x", this.span());
  }

  /** Wheel zooms about the pointer, with shift it pans; a double click shows all. @param {any} u */
  wheel(u) {
    u.over.addEventListener("wheel", (/** @type {WheelEvent} */ event) => {
      event.preventDefault();
      const { min, max } = this.span();
      const push = event.deltaY || event.deltaX;
      if (event.shiftKey) {
        const by = Math.min(Math.max(Math.sign(push) * 0.1 * (max - min), -min), this.end - max);
        this.setZoom(min + by, max + by);
        return;
      }
      const here = u.posToVal(event.clientX - u.over.getBoundingClientRect().left, "x");
      const by = push > 0 ? 1.25 : 0.8;
      if ((max - min) * by >= this.end) this.setZoom(null);
      else this.setZoom(here - (here - min) * by, here + (max - here) * by);
    }, { passive: false });
    u.over.addEventListener("dblclick", () => this.setZoom(null));
    let down = 0;
    u.over.addEventListener("mousedown", (/** @type {MouseEvent} */ event) => { down = event.clientX; });
    u.over.addEventListener("mouseup", (/** @type {MouseEvent} */ event) => {
      if (Math.abs(event.clientX - down) < 4 && u.cursor.idx !== null && u.cursor.idx !== undefined) this.clicked(u.data[0][u.cursor.idx]);
    });
  }

  /** @param {any} u @param {number} k @param {any[]} keys @param {any[]} values */
  cursor(u, k, keys, values) {
    const row = u.cursor.idx;
    const series = this.now ? this.chosen(this.now.panels[k] ?? { series: [] }) : [];
    keys.forEach((s, n) => {
      const found = series.find((/** @type {any} */ o) => o.name === s.name && o.axle === s.axle);
      values[n].textContent = row === null || row === undefined || !found ? "" : short(found.values[row], 3);
    });
    if (k === 0) this.pointed(row === null || row === undefined ? null : u.data[0][row]);
  }

  resize() {
    const width = at("plots").clientWidth;
    if (width > 50) this.plots.forEach((plot, k) => plot.setSize({ width, height: HIGH + (k + 1 === this.plots.length ? AXIS : 0) }));
  }

  /** The run in front becomes the one behind. */
  push() {
    if (this.now && !this.now.guest) this.before = this.now;
  }

  redraw() {
    if (!this.now) return;
    this.shape = "";
    this.show(this.now, 1);
  }
}

const RAILS = { dry: "#c9c9c9", wet: "#8fc1e3", leaves: "#d9a05b", ice: "#bfe6ea", snow: "#dfe9f5" };

/** Colour of a rail by its name. @param {string} name */
export function railHue(name) {
  const known = Object.entries(RAILS).find(([word]) => name.includes(word));
  return known ? known[1] : "#e4d6ef";
}

/** Name and value of a time. @param {number | null} time */
export function timeText(time) {
  return time === null ? "" : `t = ${short(time, 4)}${unitOf("s")}`;
}
