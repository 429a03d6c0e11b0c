// What a run came to: metrics, doubts, certificate, effects of numbers, ensemble, C.

import { at, fill, make, short, unitOf } from "./dom.js";

/** Number of a metric; in each table the run before and the pinned ones stand beside it.
 * @param {any[]} rows @param {any[] | null} before @param {{name: string, rows: any[]}[]} pins */
export function showMetrics(rows, before, pins) {
  const others = pins.filter((p) => p.rows);
  const head = make("tr", {}, make("th", {}, "metric"), make("th", {}, "now"), make("th", {}, "change"),
    ...others.map((p) => make("th", {}, p.name)), make("th", {}, "limit"));
  const body = rows.map((row) => {
    const old = before?.find((r) => r.key === row.key);
    const change = old && old.value !== null && row.value !== null ? row.value - old.value : null;
    const better = change && row.better ? (change < 0) === (row.better === "low") : null;
    const kept = row.kept === null ? "" : row.kept ? "yes" : "no";
    return make("tr", { title: row.meaning }, make("th", {}, row.name),
      make("td", { className: `n ${kept}` }, row.shown, row.value === null ? "" : unitOf(row.unit)),
      make("td", { className: `n ${better === null ? "" : better ? "yes" : "no"}` },
        change === null || change === 0 ? "" : `${change > 0 ? "+" : ""}${short(change, 3)}`),
      ...others.map((p) => make("td", { className: "n" }, p.rows.find((r) => r.key === row.key)?.shown ?? "–")),
      make("td", { className: `n ${kept}` }, row.limit === null ? ""
        : `${row.kept ? "✓" : "✗"} ${row.limit_shown}${unitOf(row.unit)}`));
  });
  fill(at("metrics"), make("thead", {}, head), make("tbody", {}, ...body));
}

/** @param {string[]} lines */
export function showWarnings(lines) {
  fill(at("warnings"), ...lines.map((text) => make("div", {}, text)));
}

/** @param {any} v */
export function showVerdict(v) {
  const kind = { CERTIFIED: "yes", REFUTED: "no" }[/** @type {"REFUTED"} */ (v.verdict)] ?? "soft";
  const mark = { CERTIFIED: "✓ ", REFUTED: "✗ " }[/** @type {"REFUTED"} */ (v.verdict)] ?? "? ";
  const margins = v.margins.filter((/** @type {any} */ m) => m.number in v.numbers).slice(0, 6).map((/** @type {any} */ m) =>
    make("tr", {}, make("th", {}, m.criterion.replaceAll("_", " ")),
      make("td", {}, `${m.number} ${m.side === "largest" ? "≤" : "≥"} ${short(m.value)}${unitOf(v.units[m.number])}`),
      make("td", { className: "n" }, `is ${short(v.numbers[m.number])}`)));
  fill(at("verdict"), make("span", { className: kind }, mark + v.verdict.toLowerCase()),
    make("details", {}, make("summary", {}, "what is promised"), make("div", {}, v.promise),
      v.bounds ? make("div", { className: "soft" }, `bounds: ${v.bounds}`) : null),
    v.shows ? make("div", {}, `counterexample: ${v.shows}`) : null,
    ...v.open.map((/** @type {string} */ text) => make("div", {}, `neither proved nor refuted: ${text}`)),
    v.witness.length ? make("details", {}, make("summary", {}, "worst disturbance"), make("pre", { className: "code" }, v.witness.join("\n"))) : null,
    margins.length ? make("details", {}, make("summary", {}, "margins"), make("table", {}, ...margins)) : null);
}

/** What a number does, as a table that grows. @param {any[]} rows @param {string} words */
export function showEffects(rows, words) {
  const names = [...new Set(rows.flatMap((r) => Object.keys(r.effects ?? {})))];
  const head = make("tr", {}, make("th", {}, "+1 % of"), ...names.map((n) => make("th", {}, n.replaceAll("_", " "))));
  const body = rows.map((r) => make("tr", {}, make("th", { title: r.name }, r.name.split(".").slice(-2).join(".")),
    ...(r.why ? [make("td", { colSpan: names.length || 1 }, r.why)] : names.map((n) => {
      const e = r.effects[n];
      return make("td", { className: "n" }, !e || e.by === null ? "–" : `${e.by > 0 ? "+" : ""}${short(e.by, 2)}${unitOf(e.unit)}`);
    }))));
  fill(at("effects"), rows.length ? make("table", {}, make("thead", {}, head), make("tbody", {}, ...body)) : "",
    make("div", { className: "soft" }, words));
}

/** @param {any} exact */
export function exactWords(exact) {
  const said = Object.entries(exact).map(([metric, by]) => `${metric.replaceAll("_", " ")}: `
    + Object.entries(by).map(([n, v]) => `${n.split(".").pop()} ${short(v, 3)}`).join(", "));
  return `exact slopes along the run, from CasADi: ${said.join("; ")}`;
}

/** @param {any} e */
export function showEnsemble(e) {
  const dots = Object.entries(e.limits).map(([name, limit]) => {
    const values = e.values[name].map((/** @type {any} */ v) => (v === null || v === undefined ? "never" : short(Array.isArray(v) ? Math.max(...v) : v, 3)));
    return make("div", {}, `${name.replaceAll("_", " ")} (at most ${short(limit)}): ${values.join(", ")}`);
  });
  fill(at("ensemble"), make("div", {}, make("b", {}, `${e.runs} of ${e.draws} draws: `), e.text),
    make("details", {}, make("summary", {}, "each draw"), ...dots),
    ...e.notes.map((/** @type {string} */ n) => make("div", {}, n)));
}

/** @param {any} c */
export function showC(c) {
  const code = make("pre", { className: "code" });
  const names = Object.keys(c.files);
  const main = names.find((n) => n.endsWith(".c") && !/^(test_|example|cortex)/.test(n)) ?? names[0];
  const pick = make("select", { "aria-label": "file of C", onchange: () => { code.textContent = c.files[pick.value]; } },
    ...names.map((n) => make("option", { value: n, selected: n === main }, `${n}, ${c.files[n].split("\n").length} lines`)));
  code.textContent = c.files[main];
  const sizes = Object.entries(c.bytes).map(([k, v]) => make("tr", {}, make("th", {}, k), make("td", { className: "n" }, v ? `${v.text} B of code, ${v.data + v.bss} B of data` : "")));
  fill(at("c"), make("table", {}, ...sizes, make("tr", {}, make("th", {}, "state of one instance"), make("td", { className: "n" }, `${c.state_bytes ?? "–"} B`)),
    ...c.targets.map((/** @type {any} */ t) => make("tr", {}, make("th", {}, t.target), make("td", { className: "n" },
      t.instructions ? `${Math.round(t.instructions.mean)} instructions a step, at most ${t.instructions.most}` : "")))),
    make("div", { className: c.checked && !c.passed ? "no" : "soft" }, c.checked ? (c.passed ? "replayed against Python: the same" : "it differs from Python")
      : "no C compiler: it was written and not checked"),
    make("details", {}, make("summary", {}, "what was checked"), make("pre", { className: "code" }, c.report)), pick, code);
}

/** A fault of a question, where its answer would stand. @param {string} id @param {string[]} faults */
export function showFaults(id, faults) {
  fill(at(id), ...faults.map((text) => make("div", { className: "soft" }, text)));
}
