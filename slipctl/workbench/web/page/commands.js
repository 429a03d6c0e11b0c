// What the command line does for the page: report, tune, sweep, replay; it goes on while one edits.

import { at, fill, make, short } from "./dom.js";

/** Texts of a box, between semicolons or blanks. @param {string} id */
function texts(id) {
  return at(id).value.split(/;|,\s+|\s+(?=[\w.]+=)/).map((/** @type {string} */ t) => t.trim()).filter(Boolean);
}

export class Commands {
  /** @param {(what: Object<string, any>) => void} ask @param {(numbers: Object<string, number>) => void} take
   * @param {(text: string) => void} note */
  constructor(ask, take, note) {
    this.ask = ask;
    this.take = take;
    this.note = note;
    this.going = "";
    for (const name of ["report", "tune", "sweep", "replay"]) at(name).addEventListener("click", () => this.begin(name));
    addEventListener("beforeunload", (event) => { if (this.going) event.preventDefault(); });
  }

  /** Ranges to begin with, where none were typed. @param {[string, number, number][]} given */
  offer(given) {
    const ranges = given.map(([name, lo, hi]) => `${name}=${short(lo, 3)}:${short(hi, 3)}`).join(" ");
    const typed = at("ranges").value;
    if (!typed || typed === this.offered) at("ranges").value = ranges;
    this.offered = ranges;
  }

  /** A recorded log that is open stands in its box. @param {any} model */
  ofLog(model) {
    for (const name of ["report", "tune", "sweep", "c-ask", "c-board", "effects-ask", "save"]) at(name).disabled = Boolean(model.log);
    if (!model.log || at("log").value === model.log) return;
    at("log").value = model.log;
    at("part").value = model.part;
  }

  /** Metrics that a search may make least. @param {any[]} rows */
  goals(rows) {
    const known = rows.filter((r) => r.better === "low");
    if (at("goal").options.length === known.length) return;
    fill(at("goal"), ...known.map((r) => make("option", { value: r.key }, r.name)));
  }

  /** @param {string} name */
  begin(name) {
    const what = name === "replay"
      ? { log: at("log").value, part: at("part").value, columns: texts("columns"), beside: texts("beside") }
      : name === "report" ? {} : { ranges: texts("ranges"), metric: at("goal").value, draws: Number(at("count").value) };
    this.ask({ command: name, ...what });
    this.show(name, "it begins");
  }

  /** @param {string} name @param {string} text */
  show(name, text) {
    this.going = name;
    fill(at("command"), make("div", {}, `${name}: ${text} `, make("button", { id: "stop", onclick: () => this.ask({ command: "stop" }) }, "stop")));
  }

  /** @param {any} head */
  hear(head) {
    if (head.faults) {
      this.going = "";
      fill(at("command"), ...head.faults.map((/** @type {string} */ t) => make("div", { className: "no" }, t)));
    } else if (!head.end) this.show(head.command, head.progress);
    else {
      this.going = "";
      const gains = Object.entries(head.gains ?? {});
      fill(at("command"),
        gains.length ? make("button", { id: "take", onclick: () => this.take(Object.fromEntries(gains)) },
          `take ${gains.map(([n, v]) => `${n.split(".").pop()} = ${short(v)}`).join(", ")}`) : null,
        make("pre", { className: "code" }, head.said),
        head.file ? make("div", { className: "soft" }, `report: ${head.file}`) : null,
        head.line ? make("div", { className: "soft" }, head.line) : null);
      if (head.file) this.note(`${head.command}: ${head.file}`);
    }
  }
}
