// All signals of the loop at the time that was clicked.

import { at, fill, make, short, unitOf } from "./dom.js";

export class Signals {
  /** @param {import("./socket.js").Talk} talk @param {() => Object<string, any>} about */
  constructor(talk, about) {
    this.talk = talk;
    this.about = about;
    /** @type {number | null} */
    this.time = null;
    /** @type {any[]} */
    this.rows = [];
    talk.on("signals", (head) => {
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
