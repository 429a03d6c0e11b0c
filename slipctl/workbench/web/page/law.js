// The adhesion law: curve, peak, slope, how far it was measured, equations; and parts of the loop.

import { at, colours, equations, fill, hue, make, short, unitOf } from "./dom.js";

/** @type {any} */
let plot = null;

/** @param {any} law */
export function showLaw(law) {
  const { soft, line } = colours();
  plot?.destroy();
  fill(at("law-plot"));
  const axis = { stroke: soft, grid: { stroke: line, width: 0.6 }, ticks: { stroke: line, width: 0.6 }, font: "11px system-ui" };
  const peaks = (/** @type {any} */ u) => {
    for (const [k, c] of law.curves.entries()) {
      if (c.peak_at === null || c.peak_at === undefined) continue;
      u.ctx.fillStyle = hue(k);
      u.ctx.beginPath();
      u.ctx.arc(u.valToPos(c.peak_at, "x", true), u.valToPos(c.peak, "y", true), 4 * devicePixelRatio, 0, 7);
      u.ctx.fill();
    }
    if (law.measured_to) {
      const x = u.valToPos(law.measured_to, "x", true);
      u.ctx.strokeStyle = soft;
      u.ctx.setLineDash([4, 4]);
      u.ctx.beginPath();
      u.ctx.moveTo(x, u.bbox.top);
      u.ctx.lineTo(x, u.bbox.top + u.bbox.height);
      u.ctx.stroke();
      u.ctx.setLineDash([]);
    }
  };
  plot = new /** @type {any} */ (window).uPlot({
    width: at("left").clientWidth - 24, height: 190, legend: { show: false },
    scales: { x: { time: false } },
    axes: [{ ...axis, label: `slip ${law.slip}${law.unit === "1" ? "" : ` [${law.unit}]`}`, labelSize: 16, size: 26 }, { ...axis, size: 44 }],
    series: [{}, ...law.curves.map((/** @type {any} */ _, /** @type {number} */ k) => ({ stroke: hue(k), width: 1.5, points: { show: false } }))],
    hooks: { draw: [peaks] },
  }, [law.curves[0].x, ...law.curves.map((/** @type {any} */ c) => c.y)], at("law-plot"));
  fill(at("law-words"), make("b", {}, law.name), ` ${law.doc}`,
    make("table", {}, make("thead", {}, make("tr", {}, ...["rail", "peak", "at", "slope at no slip"].map((t) => make("th", {}, t)))),
      ...law.curves.map((/** @type {any} */ c, /** @type {number} */ k) => {
        const name = make("th", {}, c.name || law.name);
        name.style.color = hue(k);
        return make("tr", {}, name, make("td", { className: "n" }, c.why ?? short(c.peak)),
          make("td", { className: "n" }, c.peak_at === null ? "no peak here" : short(c.peak_at) + unitOf(law.unit)),
          make("td", { className: "n" }, short(c.slope)));
      })), make("div", { className: "soft" }, law.reach || "it is not said how far it was measured"));
  fill(at("law-equations"), equations(law.equations));
}

/** What is clicked over a box of a diagram. @param {string} name @param {number[]} box @param {() => void} act */
function boxButton(name, box, act) {
  const made = make("button", { className: "over-box", title: `open ${name}`, "aria-label": `open ${name}`, onclick: act });
  ["left", "top", "width", "height"].forEach((side, k) => { made.style[side] = `${box[k]}px`; });
  return made;
}

/** A part of the loop. @param {any} b @param {(path: string) => void} open */
export function showBlock(b, open) {
  const path = b.path ? b.path.split(".") : [];
  const crumbs = [make("button", { onclick: () => open("") }, "loop"), ...path.map((/** @type {string} */ n, /** @type {number} */ k) =>
    make("button", { onclick: () => open(path.slice(0, k + 1).join(".")) }, n))];
  const parts = b.parts.map((/** @type {string} */ n) => make("button", { onclick: () => open([...path, n].join(".")) }, n));
  const picture = b.diagram ? make("div", { className: "diagram" }, make("img", { alt: `diagram of ${b.name}`,
    src: `data:image/svg+xml;charset=utf-8,${encodeURIComponent(b.diagram)}` }),
    ...Object.entries(b.boxes).map(([n, box]) => boxButton(n, box, () => open([...path, n].join("."))))) : null;
  fill(at("block"), make("div", {}, ...crumbs), make("div", {}, make("b", {}, b.name), ` ${b.doc}`),
    parts.length ? make("div", {}, "open ", ...parts) : null, picture,
    b.equations.length ? equations(b.equations) : null,
    b.text ? make("details", {}, make("summary", {}, "signals and Jacobian"), make("pre", { className: "code" }, b.text)) : null,
    make("table", {}, ...b.signals.map((/** @type {any} */ s) => make("tr", {}, make("th", {}, s.name), make("td", {}, s.role),
      make("td", {}, s.unit === "1" ? "" : s.unit), make("td", {}, s.doc)))));
}
