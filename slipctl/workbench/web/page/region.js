// Where two gains are certified, refuted or undecided, with a point to drag.

import { at, colours, fill, make, short, unitOf } from "./dom.js";

const SHADES = { 1: "#CFE6F5", 1.2: "#9CCBEA", 2: "#56A5D8", 5: "#1F78B4" };
const ROOM = { left: 46, right: 8, top: 6, bottom: 30 };

/** Colour of a cell. @param {string} verdict @param {number} margin */
export function shade(verdict, margin) {
  if (verdict === "CERTIFIED") return SHADES[/** @type {1} */ (margin)] || SHADES[1];
  return verdict === "REFUTED" ? "#E69F00" : verdict === "UNDECIDED" ? "#E8E8E8" : "transparent";
}

export class Region {
  /** @param {(numbers: Object<string, number>) => void} dragged */
  constructor(dragged) {
    this.dragged = dragged;
    this.canvas = at("region");
    /** @type {any} */
    this.axes = null;
    /** @type {any[]} */
    this.rows = [];
    this.clear();
    this.canvas.addEventListener("pointerdown", (/** @type {PointerEvent} */ e) => {
      this.canvas.setPointerCapture(e.pointerId);
      this.pull(e);
    });
    this.canvas.addEventListener("pointermove", (/** @type {PointerEvent} */ e) => { if (e.buttons) this.pull(e); });
    this.canvas.addEventListener("keydown", (/** @type {KeyboardEvent} */ e) => this.key(e));
    new ResizeObserver(() => this.draw()).observe(this.canvas);
  }

  clear() {
    this.axes = null;
    this.rows = [];
    at("region-box").hidden = true;
  }

  /** @param {any} part */
  add(part) {
    if (part.x) {
      this.axes = part;
      this.rows = [];
      at("region-box").hidden = false;
    } else this.rows[part.row] = part;
    this.draw();
    this.words();
  }

  words() {
    const all = this.rows.flatMap((r) => r?.verdicts ?? []);
    const count = (/** @type {string} */ v) => all.filter((x) => x === v).length;
    const key = [["CERTIFIED", 1], ["REFUTED", 0], ["UNDECIDED", 0]].map(([v, m]) => {
      const box = make("span", {}, "■ ");
      box.style.color = shade(String(v), Number(m));
      return make("span", { className: "key" }, box, `${String(v).toLowerCase()} ${count(String(v))} `);
    });
    fill(at("region-words"), ...key, make("div", {}, "each point is decided by itself; nothing is said of what lies between. Darker: the larger margin (1.2, 2, 5)."));
  }

  /** Where the point is, by the numbers as they are. @param {Object<string, number>} numbers */
  place(numbers) {
    if (!this.axes) return;
    for (const side of [this.axes.x, this.axes.y]) {
      if (side.at in numbers) side.value = numbers[side.at];
    }
    this.draw();
  }

  box() {
    const { width, height } = this.canvas.getBoundingClientRect();
    return { x: ROOM.left, y: ROOM.top, w: width - ROOM.left - ROOM.right, h: height - ROOM.top - ROOM.bottom };
  }

  /** Share along an axis: all are by ratio, as their values are. @param {any} side @param {number} value */
  share(side, value) {
    const lo = side.values[0];
    const hi = side.values[side.values.length - 1];
    return lo > 0 && hi / lo > 4 ? Math.log(value / lo) / Math.log(hi / lo) : (value - lo) / (hi - lo);
  }

  /** @param {any} side @param {number} share */
  value(side, share) {
    const lo = side.values[0];
    const hi = side.values[side.values.length - 1];
    const within = Math.min(Math.max(share, 0), 1);
    const value = lo > 0 && hi / lo > 4 ? lo * (hi / lo) ** within : lo + (hi - lo) * within;
    return Number(value.toPrecision(3));
  }

  draw() {
    const { width, height } = this.canvas.getBoundingClientRect();
    if (!this.axes || width < 20) return;
    this.canvas.width = width * devicePixelRatio;
    this.canvas.height = height * devicePixelRatio;
    const c = this.canvas.getContext("2d");
    c.scale(devicePixelRatio, devicePixelRatio);
    const { x, y, w, h } = this.box();
    const { ink, soft } = colours();
    const n = this.axes.x.values.length;
    this.rows.forEach((row, j) => row?.verdicts.forEach((/** @type {string} */ v, /** @type {number} */ i) => {
      c.fillStyle = shade(v, row.margins[i]);
      c.fillRect(x + w * i / n, y + h - h * (j + 1) / n, w / n + 0.5, h / n + 0.5);
    }));
    c.strokeStyle = soft;
    c.strokeRect(x, y, w, h);
    c.fillStyle = soft;
    c.font = "11px system-ui";
    const { x: ax, y: ay } = this.axes;
    c.fillText(short(ax.values[0], 3), x, y + h + 12);
    c.textAlign = "right";
    c.fillText(short(ax.values[n - 1], 3), x + w, y + h + 12);
    c.fillText(short(ay.values[0], 3), x - 3, y + h);
    c.fillText(short(ay.values[n - 1], 3), x - 3, y + 10);
    c.textAlign = "center";
    c.fillText(`${ax.name}${unitOf(ax.unit)}`, x + w / 2, y + h + 24);
    c.save();
    c.translate(11, y + h / 2);
    c.rotate(-Math.PI / 2);
    c.fillText(`${ay.name}${unitOf(ay.unit)}`, 0, 0);
    c.restore();
    const half = 0.5 / n;
    const px = x + w * (half + (1 - 2 * half) * this.share(ax, ax.value));
    const py = y + h - h * (half + (1 - 2 * half) * this.share(ay, ay.value));
    c.beginPath();
    c.arc(px, py, 6, 0, 2 * Math.PI);
    c.fillStyle = ink;
    c.fill();
    c.lineWidth = 2;
    c.strokeStyle = "#fff";
    c.stroke();
  }

  /** @param {PointerEvent} e */
  pull(e) {
    if (!this.axes) return;
    const { x, y, w, h } = this.box();
    const n = this.axes.x.values.length;
    const half = 0.5 / n;
    const along = ((e.offsetX - x) / w - half) / (1 - 2 * half);
    const up = ((y + h - e.offsetY) / h - half) / (1 - 2 * half);
    this.move(this.value(this.axes.x, along), this.value(this.axes.y, up));
  }

  /** @param {KeyboardEvent} e */
  key(e) {
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowDown: [0, -1], ArrowUp: [0, 1] }[e.key];
    if (!step || !this.axes) return;
    e.preventDefault();
    const { x, y } = this.axes;
    this.move(this.value(x, this.share(x, x.value) + 0.03 * step[0]), this.value(y, this.share(y, y.value) + 0.03 * step[1]));
  }

  /** @param {number} a @param {number} b */
  move(a, b) {
    this.axes.x.value = a;
    this.axes.y.value = b;
    this.draw();
    this.dragged({ [this.axes.x.at]: a, [this.axes.y.at]: b });
  }
}
