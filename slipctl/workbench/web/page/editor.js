// The file as text: numbers of lines, faults at their lines, what may be typed next.

import { at, fill, make } from "./dom.js";

export class Editor {
  /** @param {(text: string) => void} typed @param {(line: number, text: string) => void} complete */
  constructor(typed, complete) {
    this.typed = typed;
    this.complete = complete;
    this.source = at("source");
    /** @type {any[]} */
    this.faults = [];
    this.source.addEventListener("input", () => {
      this.hide();
      this.number();
      typed(this.source.value);
    });
    this.source.addEventListener("scroll", () => { at("lines").scrollTop = this.source.scrollTop; });
    this.source.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => this.key(event));
    this.source.addEventListener("blur", () => setTimeout(() => this.hide(), 200));
  }

  /** @param {string | null} text */
  set(text) {
    this.source.disabled = text === null;
    const wanted = text ?? "# a study of the library has no file; save writes its loop as one";
    if (this.source.value !== wanted) this.source.value = wanted;
    this.number();
  }

  /** Line that the cursor is on, from 1. */
  line() {
    return this.source.value.slice(0, this.source.selectionStart).split("\n").length;
  }

  number() {
    const many = this.source.value.split("\n").length;
    const bad = new Set(this.faults.map((f) => f.line));
    const box = at("lines");
    fill(box, ...Array.from({ length: many }, (_, k) =>
      make("div", { className: bad.has(k + 1) ? "bad" : "" }, String(k + 1))));
    box.scrollTop = this.source.scrollTop;
  }

  /** @param {{line: number, text: string}[]} faults */
  mark(faults) {
    this.faults = faults;
    this.number();
    fill(at("faults"), ...faults.map((f) => make("li", { onclick: () => this.go(f.line) },
      f.line ? `line ${f.line}: ${f.text}` : f.text)));
  }

  /** @param {number} line */
  go(line) {
    const start = this.source.value.split("\n").slice(0, line - 1).join("\n").length + (line > 1 ? 1 : 0);
    this.source.focus();
    this.source.setSelectionRange(start, start);
    this.source.scrollTop = Math.max(0, (line - 4) * 17.4);
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    const list = at("complete");
    if (event.ctrlKey && event.key === " ") {
      event.preventDefault();
      this.complete(this.line(), this.source.value);
      return;
    }
    if (list.hidden) return;
    const items = [...list.children];
    const now = items.findIndex((i) => i.getAttribute("aria-selected") === "true");
    if (event.key === "Escape") this.hide();
    else if (event.key === "ArrowDown" || event.key === "ArrowUp") {
      const next = (now + (event.key === "ArrowDown" ? 1 : items.length - 1)) % items.length;
      items.forEach((i, k) => i.setAttribute("aria-selected", String(k === next)));
      items[next].scrollIntoView({ block: "nearest" });
    } else if (event.key === "Enter" || event.key === "Tab") /** @type {any} */ (items[Math.max(now, 0)])?.click();
    else return;
    event.preventDefault();
  }

  /** What may stand on the line. @param {{insert: string, meaning: string}[]} found @param {number} line */
  offer(found, line) {
    if (line !== this.line()) return;
    const typed = this.source.value.split("\n")[line - 1].split("=").pop()?.trim().toLowerCase() ?? "";
    const fits = found.filter((f) => f.insert.toLowerCase().includes(typed.replace(/^\[/, "")));
    const list = at("complete");
    fill(list, ...(fits.length ? fits : found).map((f, k) => make("li", {
      "aria-selected": String(k === 0), onmousedown: (/** @type {Event} */ e) => e.preventDefault(),
      onclick: () => this.insert(f.insert, line) }, make("b", {}, f.insert), ` ${f.meaning}`)));
    list.hidden = !list.children.length;
  }

  /** @param {string} text @param {number} line */
  insert(text, line) {
    const lines = this.source.value.split("\n");
    const row = lines[line - 1];
    const at_ = row.indexOf("=");
    lines[line - 1] = at_ >= 0 && !text.endsWith(" = ") ? `${row.slice(0, at_ + 1)} ${text}` : text;
    this.source.value = lines.join("\n");
    const end = lines.slice(0, line).join("\n").length;
    this.hide();
    this.source.focus();
    this.source.setSelectionRange(end, end);
    this.number();
    this.typed(this.source.value);
  }

  hide() {
    at("complete").hidden = true;
  }
}
