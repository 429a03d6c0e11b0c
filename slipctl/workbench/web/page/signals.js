// All signals at the time that was clicked: of the loop, or of curves in the middle that are no run of it.

import { at, fill, make, short, unitOf } from "./dom.js";

export class Signals {
  /** @param {import("./socket.js").Talk} talk @param {() => Object<string, any>} about
   * @param {import("./plots.js").Plots} plots */
  constructor(talk, about, plots) {
    this.talk = talk;
    this.about = about;
    this.plots = plots;
    /** @type {number | null} */
    this.time = null;
    /** @type {any[]} */
    this.rows = [];
    talk.on("signals", (head) => {
      if (plots.now?.guest) return;  // asked before the curves that are shown now
      this.rows = head.signals ?? [];
      fill(at("signals-words"), head.faults?.[0] ?? `at ${short(head.time, 5)} s, ${this.rows.length} signals; of a state the value before the tick`);
      this.show();
    });
    at("signals-find").addEventListener("input", () => this.show());
  }

  /** @param {number} time */
  ask(time) {
    this.time = time;
    /** @type {any} */ (document.querySelector("[data-tab=signals]")).click();
    this.renew();
  }

  /** Ask again, of a run with other numbers. */
  renew() {
    if (this.time === null || at("signals").hidden) return;
    const { now } = this.plots;
    if (now?.guest) {
      const row = now.time.reduce((best, t, k) => (Math.abs(t - (this.time ?? 0)) < Math.abs(now.time[best] - (this.time ?? 0)) ? k : best), 0);
      this.rows = now.panels.flatMap((p) => p.series.map((/** @type {any} */ s) => (
        { name: p.series.length > 1 ? `${p.name}, ${s.name}` : p.name, doc: "", unit: p.unit, values: [s.values[row]] })));
      fill(at("signals-words"), `at ${short(now.time[row], 5)} s of what the middle shows, ${this.rows.length} signal${this.rows.length === 1 ? "" : "s"}`);
      this.show();
      return;
    }
    fill(at("signals-words"), `rolling to ${short(this.time, 5)} s`);
    this.talk.ask("signals", { ...this.about(), time: this.time });
  }

  show() {
    const wanted = at("signals-find").value.trim().toLowerCase();
    fill(at("signals-list"), ...this.rows
      .filter((r) => `${r.name} ${r.doc}`.toLowerCase().includes(wanted))
      .map((r) => make("tr", { title: r.doc }, make("th", {}, r.name),
        make("td", { className: "n" }, `${r.values.map((/** @type {number} */ v) => short(v, 4)).join("  ")}${unitOf(r.unit)}`))));
  }
}
