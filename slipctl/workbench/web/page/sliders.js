// A slider for each number: range, unit, default and source.

import { at, fill, make, short, unitOf } from "./dom.js";

const STEPS = 400;

/** Number at a place of a slider. @param {any} s @param {number} place */
export function valueAt(s, place) {
  const share = place / STEPS;
  const value = s.by_ratio ? s.left * (s.right / s.left) ** share : s.left + (s.right - s.left) * share;
  return Number(value.toPrecision(4));
}

/** Place of a number on its slider. @param {any} s @param {number} value */
export function placeOf(s, value) {
  const share = s.by_ratio ? Math.log(value / s.left) / Math.log(s.right / s.left)
    : (value - s.left) / (s.right - s.left);
  return Math.round(STEPS * Math.min(Math.max(share, 0), 1));
}

export class Sliders {
  /** @param {(name: string, value: number | null) => void} moved */
  constructor(moved) {
    this.moved = moved;
    /** @type {any[]} */
    this.list = [];
    /** @type {Object<string, number>} */
    this.numbers = {};
    /** @type {Map<string, any>} */
    this.rows = new Map();
    at("find").addEventListener("input", () => this.show());
  }

  /** @param {any[]} list @param {Object<string, number>} numbers */
  set(list, numbers) {
    this.list = list;
    this.rows.clear();
    const box = at("slider-list");
    fill(box);
    let group = "";
    for (const s of list) {
      if (s.group !== group) {
        group = s.group;
        box.append(make("h3", {}, group));
      }
      box.append(this.row(s));
    }
    this.update(numbers);
    this.show();
  }

  /** @param {any} s */
  row(s) {
    const range = make("input", { type: "range", min: 0, max: STEPS, step: 1, "aria-label": s.name,
      oninput: () => this.moved(s.name, valueAt(s, Number(range.value))) });
    const number = make("input", { className: "number", "aria-label": `${s.name}, number`,
      onchange: () => this.typed(s, number) });
    const reset = make("button", { title: `back to ${short(s.value)}`,
      onclick: () => this.moved(s.name, null) }, "↺");
    const ends = `${s.lo === null ? "no least" : short(s.lo)} to ${s.hi === null ? "no most" : short(s.hi)}`;
    const told = [s.doc, `default ${short(s.value)}${unitOf(s.unit)}`, `may be ${ends}`, s.source];
    const words = told.filter(Boolean).join("; ");
    const line = make("div", { className: "slider", title: `${s.name}: ${words}` },
      make("span", { className: "name" }, s.name),
      make("span", {}, number, make("span", { className: "unit" }, s.unit === "1" ? "" : s.unit), reset),
      range, make("span", { className: "doc" }, words));
    this.rows.set(s.name, { s, line, range, number, reset });
    return line;
  }

  /** @param {any} s @param {any} input */
  typed(s, input) {
    const value = Number(input.value.replace(",", "."));
    if (input.value.trim() && Number.isFinite(value)) this.moved(s.name, value);
    else this.update(this.numbers);
  }

  /** @param {Object<string, number>} numbers */
  update(numbers) {
    this.numbers = numbers;
    for (const { s, line, range, number, reset } of this.rows.values()) {
      const moved = s.name in numbers;
      const value = moved ? numbers[s.name] : s.value;
      range.value = placeOf(s, value);
      if (document.activeElement !== number || moved) number.value = short(value, 6);
      line.classList.toggle("moved", moved);
      reset.disabled = !moved;
    }
  }

  show() {
    const wanted = at("find").value.trim().toLowerCase();
    for (const { s, line } of this.rows.values()) {
      line.hidden = Boolean(wanted) && !`${s.name} ${s.doc} ${s.unit}`.toLowerCase().includes(wanted);
      line.style.display = line.hidden ? "none" : "";
    }
  }
}
