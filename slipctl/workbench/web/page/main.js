// The page: what was changed goes to the server, what it answers to its place.

import { at, fill, make } from "./dom.js";
import { listenAside } from "./aside.js";
import { Commands } from "./commands.js";
import { Editor } from "./editor.js";
import { showBlock, showLaw } from "./law.js";
import { Pins } from "./pins.js";
import { Plots, curvesOf, timeText } from "./plots.js";
import { Region } from "./region.js";
import { showFaults, showMetrics, showWarnings } from "./side.js";
import { Sliders } from "./sliders.js";
import { Sweeps } from "./sweeps.js";
import { Talk } from "./socket.js";
import { State } from "./state.js";
import { followTheme } from "./theme.js";
import { Track } from "./track.js";

const talk = new Talk();
const track = new Track();
const plots = new Plots((time) => { track.point(time); at("state").dataset.time = timeText(time); tell(); }, (time) => signals.ask(time));
const pins = new Pins(plots);
const state = new State(changed);
const sliders = new Sliders((name, value) => {
  const numbers = { ...state.now.numbers };
  if (value === null) delete numbers[name]; else numbers[name] = value;
  state.set({ numbers }, name);
});
const region = new Region((moved) => state.set({ numbers: { ...state.now.numbers, ...moved } }, "point"));
const sweeps = new Sweeps((numbers) => state.set({ numbers }, "sweep run"));
const editor = new Editor((text) => state.set({ text, numbers: state.now.numbers }, "text"), (line, text) => talk.ask("complete", { line, text }));

/** @type {any} */
let model = null;
/** @type {any[] | null} */
let metrics = null;
/** @type {any[] | null} */
let before = null;
let said = "opening";
let begun = 0;
let command = "";
/** @type {any} */
let later = 0;
let noted = "";
/** @type {any} */
let forget = 0;

function tell(text = said) {
  said = text;
  fill(at("state"), [at("state").dataset.time, noted, said].filter(Boolean).join("   "));
}

/** What was done, for ten seconds beside what runs tell meanwhile. */
function note(/** @type {string} */ text) {
  noted = text;
  clearTimeout(forget);
  forget = setTimeout(() => { noted = ""; tell(); }, 10000);
  tell();
}

/** What a question is about. */
function about() {
  const { text, loop, scenario, numbers } = state.now;  // the whole text: a new process knows the file alone
  return { ...(text === null ? {} : { text }), loop, scenario, numbers };
}

/** @param {import("./state.js").Now} now @param {string} why */
function changed(now, why) {
  sliders.update(now.numbers);
  if (why === "step") editor.set(now.text);
  at("undo").disabled = !state.past.length;
  at("redo").disabled = !state.future.length;
  if (why === "text" || why === "step") {
    clearTimeout(later);
    later = setTimeout(() => talk.ask("text", { text: now.text }), 120);
  }
  if (why !== "text") run();
}

function run() {
  if (state.fresh) {  // what a slider passes is no run to compare with
    plots.push();
    before = metrics ?? before;
  }
  begun = performance.now();
  delete at("state").dataset.first;
  talk.ask("run", about());
  region.place(state.now.numbers);
  clearTimeout(run.rest);
}
/** @type {any} */
run.rest = 0;

/** What may wait until the run has ended and nothing moves: doubts and the verdict. */
function rest() {
  talk.ask("doubts", about());
  signals.renew();
  if (model?.certificates.names.length) talk.ask("verdict", { ...about(), name: at("gains").value });
}

function askRegion() {
  region.clear();
  if (model?.certificates.names.length) talk.ask("region", { ...about(), name: at("gains").value });
}

talk.onstate = (/** @type {string} */ text) => { if (text) tell(text); else if (!model) talk.ask("model"); };

talk.on("model", (head) => {
  if (head.faults) {
    tell(head.faults[0]);
    return;
  }
  if (head.broken) {
    fill(at("home"), head.home);
    state.begin(head.home, { text: head.text, loop: "", scenario: "", numbers: {} });
    state.now = { ...state.now, text: head.text };
    editor.set(head.text);
    editor.mark(head.found);
    /** @type {any} */ (document.querySelector("[data-tab=text]")).click();
    tell(`the file has ${head.found.length} fault${head.found.length > 1 ? "s" : ""}; it runs when it has none`);
    return;
  }
  const first = !model;
  model = head;
  document.title = `${head.home}, slipctl`;
  fill(at("home"), head.home);
  at("home").title = head.title;
  if (first) {
    const now = state.begin(head.home, { text: state.key ? state.now.text : head.text, loop: head.loop, scenario: head.scenario, numbers: {} });
    editor.set(now.text);
    pins.begin(head.home);
    if (now.text !== head.text || now.loop !== head.loop || now.scenario !== head.scenario) {
      talk.ask("model", { text: now.text, loop: now.loop, scenario: now.scenario });
    }
  }
  state.now = { ...state.now, loop: head.loop, scenario: head.scenario };
  fill(at("loop"), ...head.loops.map((/** @type {[string, string]} */ [loop, scenario]) => make("option", {
    value: `${loop}@${scenario}`, selected: loop === head.loop && scenario === head.scenario },
    head.loops.some((/** @type {[string, string]} */ o) => o[1] !== scenario) ? `${loop}, ${scenario}` : loop)));
  const known = new Set(head.sliders.map((/** @type {any} */ s) => s.name));
  const numbers = Object.fromEntries(Object.entries(state.now.numbers).filter(([n]) => known.has(n)));
  state.now = { ...state.now, numbers };
  sliders.set(head.sliders, numbers);
  commands.offer(head.sliders.filter((/** @type {any} */ s) => s.group === "law").slice(0, 2)
    .map((/** @type {any} */ s) => [s.name, s.left, s.right]));
  fill(at("gains"), ...head.certificates.names.map((/** @type {string} */ n) => make("option", { value: n }, n)));
  at("gains").hidden = !head.certificates.names.length;
  at("draws").disabled = !head.ensemble;
  if (!head.certificates.names.length) showFaults("verdict", [`no certificate: ${head.certificates.why}`]);
  fill(at("ensemble"), head.ensemble ? "" : "the file declares no ensemble");
  at("undo").disabled = !state.past.length;
  at("redo").disabled = !state.future.length;
  plots.shape = "";
  sweeps.show(head.sweep);
  commands.ofLog(head);
  run();
  askRegion();
  if (!at("law").hidden) talk.ask("law", about());
  if (!at("block").hidden) talk.ask("block", about());
});

talk.on("run", (head, columns) => {
  if (head.faults || head.metrics) {
    clearTimeout(run.rest);
    run.rest = setTimeout(rest, 150);
  }
  if (head.faults) {
    tell(head.faults[0]);
    showWarnings(head.faults);
  } else if (head.rows) {
    const curves = { ...curvesOf(head, columns), guest: Boolean(model?.log) };  // a recorded log is no run
    at("shown").hidden = true;
    const many = Math.max(0, ...curves.panels.flatMap((p) => p.series.map((/** @type {any} */ s) => s.axle)));
    if (many !== at("axle").options.length - 1) {
      fill(at("axle"), make("option", { value: 0 }, "all"), ...Array.from({ length: many }, (_, k) => make("option", { value: k + 1 }, String(k + 1))));
      plots.axle = 0;
    }
    plots.show(curves, head.share);
    track.show(curves);
    const spent = performance.now() - begun;
    at("state").dataset.first ??= String(spent);
    at("state").dataset.spent = String(spent);
    at("state").dataset.run = `${head.id} ${head.share}`;
    tell(`${head.share < 1 ? `${Math.round(100 * head.share)} % of the run` : `run in ${Math.round(spent)} ms`}${head.compiled ? "" : ", interpreted while it compiles"}`);
  } else if (head.metrics) {
    metrics = head.metrics;
    command = head.command;
    commands.goals(head.metrics);
    showMetrics(head.metrics, before, pins.all);
    at("state").dataset.done = String(head.id);
  }
});

talk.on("text", (head) => {
  const found = head.found ?? (head.faults ?? []).map((/** @type {string} */ text) => ({ line: 0, text }));
  editor.mark(found);
  tell(found.length ? `the file has ${found.length} fault${found.length > 1 ? "s" : ""}` : "the file is right");
  if (!found.length && state.now.text !== model?.text) talk.ask("model", { text: state.now.text, loop: state.now.loop, scenario: state.now.scenario });
});
talk.on("doubts", (head) => showWarnings(head.warnings ?? []));
talk.on("complete", (head) => editor.offer(head.found ?? [], head.line));
talk.on("edit", (head) => {
  if (head.faults) { fill(at("law-faults"), ...head.faults.map((/** @type {string} */ t) => make("li", {}, t))); return; }
  editor.set(head.text);
  state.set({ text: head.text }, "text");
});
talk.on("law", (head) => {
  fill(at("law-faults"), ...(head.faults ?? []).map((/** @type {string} */ t) => make("li", {}, t)));
  if (!head.law) return;
  showLaw(head.law);
  if (document.activeElement !== at("typed") && head.typed) at("typed").value = head.typed;
});
talk.on("block", (head) => (head.block ? showBlock(head.block, (path) => talk.ask("block", { ...about(), path })) : showFaults("block", head.faults)));
talk.on("region", (head) => {
  if (head.faults) showFaults("region-words", head.faults);
  else if (head.region) {
    region.add(head.region);
    const { x, y } = head.region;
    if (x) commands.offer([x, y].map((a) => [a.at, a.values[0], a.values[a.values.length - 1]]));
  }
});
talk.on("save", (head) => {
  if (head.faults) { tell(head.faults[0]); return; }
  if (model.text !== null) {
    state.set({ text: head.text, numbers: {} }, "save");
    editor.set(head.text);
    talk.ask("model", { text: head.text, loop: state.now.loop, scenario: state.now.scenario });
  }
  note([`saved ${head.file}`, ...head.notes].join("; "));
});
const commands = new Commands((what) => talk.send("command", { ...about(), ...what }), (found) => state.set({ numbers: { ...state.now.numbers, ...found } }, "found"), note);
talk.on("command", (head, columns) => {
  if (head.rows) plots.guest(curvesOf(head, columns), ["a recorded log, replayed"]);
  else commands.hear(head);
});
const signals = listenAside(talk, about, plots);
talk.on("refused", (head) => tell(head.faults[0]));

// ---- what a person does ----

at("loop").addEventListener("change", () => {
  const [loop, scenario] = at("loop").value.split("@");
  state.set({ loop, scenario, numbers: {} }, "loop");
  talk.ask("model", { ...(state.now.text === null ? {} : { text: state.now.text }), loop, scenario });
});
at("axle").addEventListener("change", () => { plots.axle = Number(at("axle").value); plots.redraw(); });
at("gains").addEventListener("change", () => { rest(); askRegion(); });
at("back").addEventListener("click", run);
at("undo").addEventListener("click", () => state.undo());
at("redo").addEventListener("click", () => state.redo());
const besideMetrics = () => { if (metrics) showMetrics(metrics, before, pins.all); };
at("pin").addEventListener("click", () => { if (metrics) pins.add(metrics); besideMetrics(); });
at("unpin").addEventListener("click", () => { pins.clear(); besideMetrics(); });
const save = () => { tell("saving"); talk.ask("save", { ...about(), name: "" }); };
at("save").addEventListener("click", save);
at("copy").addEventListener("click", () => { navigator.clipboard?.writeText(command).catch(() => undefined); tell(command); });
at("typed").addEventListener("input", () => {
  clearTimeout(later);
  later = setTimeout(() => talk.ask("law", { ...about(), law: at("typed").value }), 120);
});
at("use-law").addEventListener("click", () => talk.ask("edit", { ...about(), text: state.now.text, keys: ["rail", "law"], value: JSON.stringify(at("typed").value.trim()) }));
for (const tab of document.querySelectorAll("[data-tab]")) {
  tab.addEventListener("click", () => {
    const name = /** @type {HTMLElement} */ (tab).dataset.tab ?? "";
    for (const other of document.querySelectorAll("[data-tab]")) other.setAttribute("aria-selected", String(other === tab));
    for (const box of document.querySelectorAll(".tab")) /** @type {HTMLElement} */ (box).hidden = box.id !== name;
    if (name === "law") talk.ask("law", { ...about(), ...(at("typed").value ? { law: at("typed").value } : {}) });
    if (name === "block") talk.ask("block", about());
  });
}
followTheme(() => {
  plots.redraw();
  track.draw();
  region.draw();
  sweeps.draw();
  if (!at("law").hidden) talk.ask("law", about());
});
addEventListener("keydown", (event) => {
  if (!event.ctrlKey && !event.metaKey) return;
  const typing = document.activeElement?.matches("textarea, #editor");
  if (event.key === "s") { event.preventDefault(); save(); }
  else if (!typing && event.key === "z") { event.preventDefault(); state.undo(); }
  else if (!typing && event.key === "y") { event.preventDefault(); state.redo(); }
});
