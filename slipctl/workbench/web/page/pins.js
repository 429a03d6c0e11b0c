// Pinned runs: their curves and metrics stand behind the next ones, and stay over a reload.

/** @typedef {import("./plots.js").Curves} Curves */

export class Pins {
  /** @param {import("./plots.js").Plots} plots */
  constructor(plots) {
    this.plots = plots;
    /** @type {{name: string, rows: any[], curves: Curves}[]} */
    this.all = [];
    this.key = "";
  }

  /** Those that stood here before a reload. @param {string} home */
  begin(home) {
    this.key = `pins ${home}`;
    try {
      this.all = JSON.parse(sessionStorage.getItem(this.key) ?? "[]", unpacked);
    } catch { this.all = []; /* of another version */ }
    this.draw();
  }

  /** Pin the run that is in front. @param {any[]} rows its metrics */
  add(rows) {
    if (!this.plots.now || this.plots.now.guest) return;
    this.all.push({ name: `pin ${this.all.length + 1}`, rows, curves: this.plots.now });
    this.keep();
  }

  clear() {
    this.all = [];
    this.keep();
  }

  keep() {
    try {
      sessionStorage.setItem(this.key, JSON.stringify(this.all, packed));
    } catch { /* full: the last ones are only not kept over a reload */ }
    this.draw();
  }

  draw() {
    this.plots.pins.splice(0, this.plots.pins.length, ...this.all.map((p) => p.curves));
    this.plots.redraw();
  }
}

/** Columns of numbers as text. @param {string} _ @param {any} value */
function packed(_, value) {
  if (!(value instanceof Float32Array)) return value;
  let text = "";
  for (const byte of new Uint8Array(value.buffer, value.byteOffset, value.byteLength)) text += String.fromCharCode(byte);
  return { floats: btoa(text) };
}

/** @param {string} _ @param {any} value */
function unpacked(_, value) {
  if (typeof value?.floats !== "string") return value;
  return new Float32Array(Uint8Array.from(atob(value.floats), (c) => c.charCodeAt(0)).buffer);
}
