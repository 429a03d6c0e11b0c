// Questions that stand beside the run: signals of a time, certificate, worst disturbance, effects, ensemble, C.

import { at, fill, make } from "./dom.js";
import { curvesOf } from "./plots.js";
import { Signals } from "./signals.js";
import { exactWords, showC, showEffects, showEnsemble, showFaults, showVerdict } from "./side.js";

/** @param {import("./socket.js").Talk} talk @param {() => Object<string, any>} about
 * @param {import("./plots.js").Plots} plots */
export function listenAside(talk, about, plots) {
  /** @type {any[]} */
  let effects = [];

  talk.on("verdict", (head) => {
    if (!head.verdict) { showFaults("verdict", head.faults); return; }
    showVerdict(head.verdict);
    at("verdict").append(make("button", { id: "worst", title: "the law against the worst disturbance that is allowed, in the middle",
      onclick: () => talk.ask("worst", { ...about(), name: at("gains").value }) }, "run the worst disturbance"), make("div", { id: "worst-words", className: "soft" }));
  });
  talk.on("worst", (head, columns) => {
    if (head.faults) { showFaults("worst-words", head.faults); return; }
    fill(at("worst-words"), ...head.said.map((/** @type {string} */ t) => make("div", {}, t)));
    plots.guest(curvesOf(head, columns), [`${head.loop}: the law alone, against its worst disturbance`, ...head.said]);
  });
  talk.on("effects", (head) => {
    if (head.effect) effects.push(head.effect);
    const words = head.faults?.[0] ?? (head.exact ? exactWords(head.exact) : head.why ? `differences of two runs; there are no exact slopes: ${head.why}` : "working it out");
    showEffects(effects, words);
  });
  talk.on("draws", (head) => {
    if (head.faults) showFaults("ensemble", head.faults);
    else if (head.ensemble) showEnsemble(head.ensemble);
  });
  talk.on("c", (head) => (head.c ? showC(head.c) : showFaults("c", head.faults)));

  at("draws").addEventListener("click", () => { fill(at("ensemble"), "drawing"); talk.ask("draws", about()); });
  at("effects-ask").addEventListener("click", () => { effects = []; showEffects([], "working it out"); talk.ask("effects", about()); });
  at("c-ask").addEventListener("click", () => { fill(at("c"), "writing, compiling, replaying"); talk.ask("c", about()); });
  at("c-board").addEventListener("click", () => { fill(at("c"), "writing, compiling, running it on the emulated board"); talk.ask("c", { ...about(), target: "cortex-m4" }); });
  return new Signals(talk, about, plots);
}
