// Figures over time that zoom and share their time axis and cursor.
// Each <figure> carries its curves as JSON; without this script, and on paper, its picture stays.
(() => {
"use strict";
const LEFT = 64, RIGHT = 8, TOP = 6, BELOW = 20;
const groups = new Map();                       // by the span of time: what shares its axis

const numbers = (text, lo, hi) => {             // 16 bits a number, little end first; 65535: none
  const raw = atob(text), out = new Float64Array(raw.length / 2);
  for (let i = 0; i < out.length; i++) {
    const v = raw.charCodeAt(2 * i) + 256 * raw.charCodeAt(2 * i + 1);
    out[i] = v === 65535 ? NaN : lo + (hi - lo) * v / 65534;
  }
  return out;
};
const node = (name, attributes, parent) => {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const k in attributes) made.setAttribute(k, attributes[k]);
  return parent ? parent.appendChild(made) : made;
};
const element = (name, kind, text, parent) => {
  const made = document.createElement(name);
  made.className = kind; made.textContent = text;
  return parent.appendChild(made);
};
const ticks = (lo, hi, many) => {               // three at least, so that there is a scale
  const rough = (hi - lo) / many, ten = 10 ** Math.floor(Math.log10(rough));
  const steps = [10, 5, 2, 1, 0.5, 0.2].filter(k => k * ten < rough * 4);
  const held = k => Math.floor(hi / (k * ten) + 1e-9) - Math.ceil(lo / (k * ten) - 1e-9) + 1;
  const step = ten * ([1, 2, 5, 10].filter(k => k * ten >= rough * 0.999 && held(k) > 2)[0]
    ?? steps.find(k => held(k) > 2) ?? 0.2);
  const out = [];
  for (let k = Math.ceil(lo / step - 1e-9); k * step <= hi + 1e-9 * step; k++)
    out.push(+(k * step).toPrecision(12));
  return out;
};
const shown = v => {
  const a = Math.abs(v);
  if (a !== 0 && (a < 1e-3 || a >= 1e6)) return v.toExponential(2);
  return String(+v.toPrecision(5));
};
const first = (x, t) => {                       // of the points at t or later
  let lo = 0, hi = x.length;
  while (lo < hi) { const m = (lo + hi) >> 1; if (x[m] < t) lo = m + 1; else hi = m; }
  return lo;
};

// Curve in a view as columns: middle, smallest and largest; points where they are few.
const columns = (c, a, b, width) => {
  const from = Math.max(0, first(c.x, a) - 1), to = Math.min(c.x.length, first(c.x, b) + 2);
  let each = Math.max(1, Math.ceil((to - from) / width));
  if (c.pairs) each += each % 2;                // smallest and largest stay together
  const out = [];
  for (let i = from - (c.pairs ? from % 2 : 0); i < to; i += each) {
    let lo = Infinity, hi = -Infinity, t = 0, n = 0;
    for (let k = i; k < Math.min(i + each, c.x.length); k++) {
      const v = c.y[k];
      if (!Number.isNaN(v)) { lo = Math.min(lo, v); hi = Math.max(hi, v); }
      t += c.x[k]; n++;
    }
    out.push(n && lo <= hi ? [t / n, lo, hi] : [t / Math.max(n, 1), NaN, NaN]);
  }
  return out;
};

const draw = (figure, group) => {
  const inner = figure.box.clientWidth - LEFT - RIGHT;
  if (inner < 50) return;
  const X = t => LEFT + (t - group.a) / (group.b - group.a) * inner;
  figure.X = X; figure.inner = inner;
  const fitted = panel => {                     // range of what is in view
    let lo = Infinity, hi = -Infinity;
    for (const c of panel.curves) if (!figure.hidden.has(c.name))
      for (const [t, l, h] of columns(c, group.a, group.b, inner))
        if (t >= group.a && t <= group.b && !Number.isNaN(l)) { lo = Math.min(lo, l); hi = Math.max(hi, h); }
    return [lo, hi];
  };
  figure.panels.forEach((panel, k) => {
    const last = k === figure.panels.length - 1, high = panel.high, svg = panel.svg;
    svg.setAttribute("height", TOP + high + (last ? BELOW + 16 : BELOW));
    svg.setAttribute("width", LEFT + inner + RIGHT);
    svg.replaceChildren();
    let lo = panel.lo, hi = panel.hi;
    const views = panel.curves.map(c => figure.hidden.has(c.name) ? []
      : columns(c, group.a, group.b, inner));
    if (group.a > group.x0 || group.b < group.x1 || figure.hidden.size || figure.moved) {
      lo = Infinity; hi = -Infinity;            // panels of one quantity have one range
      for (const p of figure.panels) if (p.label === panel.label) {
        const [l, h] = fitted(p);
        lo = Math.min(lo, l); hi = Math.max(hi, h);
      }
      if (!(lo <= hi)) { lo = panel.lo; hi = panel.hi; }
      const room = 0.06 * (hi - lo) || Math.abs(hi) * 1e-3 || 1;
      lo -= room; hi += room;
    }
    const Y = v => TOP + high * (hi - v) / (hi - lo);
    for (const [from, to, colour, name] of panel.bands) {
      const l = Math.max(from, group.a), r = Math.min(to, group.b);
      if (l >= r) continue;
      node("rect", { class: "rail", x: X(l), y: TOP, width: X(r) - X(l), height: high, fill: colour }, svg);
      if (from > group.a) node("line", { class: "edge", x1: X(l), x2: X(l), y1: TOP, y2: TOP + high }, svg);
      if (name) node("text", { class: "soft", x: (X(l) + X(r)) / 2, y: TOP + 11, "text-anchor": "middle" }, svg).textContent = name;
    }
    for (const v of ticks(lo, hi, Math.max(3, high / 30))) {
      node("line", { class: "grid", x1: LEFT, x2: LEFT + inner, y1: Y(v), y2: Y(v) }, svg);
      node("text", { x: LEFT - 6, y: Y(v) + 4, "text-anchor": "end" }, svg).textContent = shown(v);
    }
    for (const t of ticks(group.a, group.b, inner / 90)) {
      node("line", { class: "grid", x1: X(t), x2: X(t), y1: TOP, y2: TOP + high }, svg);
      node("text", { x: X(t), y: TOP + high + 14, "text-anchor": "middle" }, svg).textContent = shown(t);
    }
    if (last) node("text", { x: LEFT + inner / 2, y: TOP + high + 31, "text-anchor": "middle" }, svg).textContent = "time [s]";
    const curves = node("svg", { x: LEFT, y: TOP, width: inner, height: high,
      viewBox: `${LEFT} ${TOP} ${inner} ${high}` }, svg);   // cuts off what is outside
    panel.curves.forEach((c, j) => {
      let line = "", up = "", down = "", pen = false, thick = false;
      const area = () => { if (up && thick) node("path", { d: up + down + "Z", fill: c.colour, class: "range" }, curves); up = down = ""; thick = false; };
      for (const [t, l, h] of views[j]) {
        if (Number.isNaN(l)) { pen = false; area(); continue; }
        const x = X(t).toFixed(1);
        line += `${pen ? "L" : "M"}${x} ${Y((l + h) / 2).toFixed(1)}`;
        up += `${up ? "L" : "M"}${x} ${Y(h).toFixed(1)}`;
        down = `L${x} ${Y(l).toFixed(1)}` + down;
        thick = thick || Y(l) - Y(h) > 1; pen = true;
      }
      area();
      if (line) node("path", { d: line, stroke: c.colour, "stroke-width": c.thin ? 1 : 1.6,
        "stroke-dasharray": c.dash, class: "curve" }, curves);
    });
    panel.cursor = node("line", { class: "cursor", y1: TOP, y2: TOP + high, visibility: "hidden" }, svg);
    panel.chosen = node("rect", { class: "chosen", y: TOP, height: high, visibility: "hidden" }, svg);
  });
  figure.reset.hidden = group.a === group.x0 && group.b === group.x1;
  point(figure, group);
};

const point = (figure, group) => {
  const t = group.cursor, inside = t !== null && t >= group.a && t <= group.b;
  figure.time.textContent = inside ? `${shown(+t.toPrecision(5))} s` : "";
  for (const panel of figure.panels) {
    panel.cursor.setAttribute("visibility", inside ? "visible" : "hidden");
    if (inside) for (const e of ["x1", "x2"]) panel.cursor.setAttribute(e, figure.X(t));
    for (const c of panel.curves) {
      let text = "";
      if (inside && c.x.length) {
        const i = Math.max(0, Math.min(first(c.x, t), c.x.length - 1));
        const j = c.pairs ? i ^ 1 : i;          // the other of its pair
        const l = Math.min(c.y[i], c.y[j] ?? c.y[i]), h = Math.max(c.y[i], c.y[j] ?? c.y[i]);
        text = h - l > 0.01 * (panel.hi - panel.lo) ? `${shown(+l.toPrecision(3))} to ${shown(+h.toPrecision(3))}`
          : Number.isNaN(l) ? "" : shown(+l.toPrecision(4));
      }
      c.said.textContent = text;
    }
  }
};

const view = (group, a, b) => {
  const least = (group.x1 - group.x0) * 1e-4;
  if (b - a < least) { const m = (a + b) / 2; a = m - least / 2; b = m + least / 2; }
  group.a = Math.max(group.x0, a); group.b = Math.min(group.x1, b);
  for (const figure of group.figures) draw(figure, group);
};
const cursor = (group, t) => {
  group.cursor = t;
  for (const figure of group.figures) if (figure.X) point(figure, group);
};

const listen = (svg, figure, group) => {
  const time = e => {
    const x = e.clientX - svg.getBoundingClientRect().left;
    return Math.min(group.b, Math.max(group.a, group.a + (x - LEFT) / figure.inner * (group.b - group.a)));
  };
  let begin = null;
  const mark = t => {
    for (const f of group.figures) for (const p of f.panels) {
      if (!p.chosen) continue;
      p.chosen.setAttribute("visibility", t === null ? "hidden" : "visible");
      if (t === null) continue;
      p.chosen.setAttribute("x", f.X(Math.min(begin, t)));
      p.chosen.setAttribute("width", Math.abs(f.X(t) - f.X(begin)));
    }
  };
  svg.addEventListener("pointerdown", e => { if (e.button === 0) { begin = time(e); svg.setPointerCapture(e.pointerId); } });
  svg.addEventListener("pointermove", e => { cursor(group, time(e)); if (begin !== null) mark(time(e)); });
  svg.addEventListener("pointerup", e => {
    if (begin === null) return;
    const a = Math.min(begin, time(e)), b = Math.max(begin, time(e));
    mark(null); begin = null;
    if (b - a > 4 / figure.inner * (group.b - group.a)) view(group, a, b);
  });
  svg.addEventListener("pointercancel", () => { if (begin !== null) mark(null); begin = null; });
  svg.addEventListener("pointerleave", () => { if (begin === null) cursor(group, null); });
  svg.addEventListener("dblclick", () => view(group, group.x0, group.x1));
  svg.addEventListener("keydown", e => {
    const wide = group.b - group.a, at = group.cursor ?? (group.a + group.b) / 2;
    const keys = {
      ArrowLeft: () => cursor(group, Math.max(group.a, at - wide / 100)),
      ArrowRight: () => cursor(group, Math.min(group.b, at + wide / 100)),
      "+": () => view(group, at - wide / 4, at + wide / 4),
      "-": () => view(group, at - wide, at + wide),
      0: () => view(group, group.x0, group.x1),
    };
    if (e.key in keys && !e.ctrlKey && !e.metaKey) { keys[e.key](); e.preventDefault(); }
  });
};

const everyFigure = [];
const choose = axle => {                        // one axle for all figures of the page
  for (const [figure, group] of everyFigure) {
    if (!figure.select) continue;
    figure.select.value = String(Math.min(axle, figure.select.length - 1));
    figure.moved = true;
    for (const panel of figure.panels) {
      if (panel.byAxle[axle]) panel.bands = panel.byAxle[axle];
      panel.head.textContent = panel.name.replace(/axle \d+/, `axle ${axle + 1}`);
      for (const c of panel.curves) if (c.axles[axle]) Object.assign(c, c.axles[axle]);
    }
    draw(figure, group);
  }
};

document.querySelectorAll("figure > script[type='application/json']").forEach(script => {
  const data = JSON.parse(script.textContent), at = script.parentElement;
  const [x0, x1] = data.span, key = `${x0}:${x1}`;
  if (!groups.has(key)) groups.set(key, { x0, x1, a: x0, b: x1, cursor: null, figures: [] });
  const group = groups.get(key);
  const box = document.createElement("div");
  box.className = "live";
  at.insertBefore(box, at.firstChild);
  const figure = { box, hidden: new Set(), panels: [] };
  const bar = element("div", "bar", "", box);
  element("span", "soft", "Drag to zoom, double-click for all. ", bar);
  figure.reset = element("button", "reset", "All of the time", bar);
  figure.time = element("span", "at", "", bar);
  figure.reset.addEventListener("click", () => view(group, x0, x1));
  const most = Math.max(0, ...data.panels.flatMap(p => p.curves.map(c => c.axles.length)));
  if (most > 1) {
    const now = /axle (\d+)/.exec(data.panels.map(p => p.label).join());
    figure.select = document.createElement("select");
    figure.select.setAttribute("aria-label", "axle");
    for (let k = 0; k < most; k++) figure.select.add(new Option(`axle ${k + 1}`, k));
    figure.select.value = String(now ? now[1] - 1 : 0);
    figure.select.addEventListener("change", () => choose(Number(figure.select.value)));
    bar.insertBefore(figure.select, bar.firstChild);
  }
  const order = [...new Set(data.panels.flatMap(p => p.curves.map(c => c.name)))];
  data.panels.forEach(p => {
    const panel = { lo: p.range[0], hi: p.range[1], bands: p.bands, byAxle: p.byAxle, high: p.high,
      label: p.label, name: p.label, curves: [] };
    const head = element("div", "head", "", box);
    panel.head = element("span", "what", p.label, head);
    const said = {};
    for (const c of [...p.curves].sort((a, b) => order.indexOf(a.name) - order.indexOf(b.name))) {
      const key = element("button", "key", c.name, head);
      const pen = key.insertBefore(document.createElementNS("http://www.w3.org/2000/svg", "svg"), key.firstChild);
      node("line", { x1: 0, x2: 22, y1: 5, y2: 5, stroke: c.colour, "stroke-dasharray": c.dash, "stroke-width": 2 }, pen);
      key.title = `show or hide ${c.name}`;
      key.setAttribute("aria-pressed", "true");
      said[c.name] = element("b", "", "", key);
      key.addEventListener("click", () => {
        const hide = !figure.hidden.has(c.name);
        figure.hidden[hide ? "add" : "delete"](c.name);
        box.querySelectorAll(".key").forEach(k => { if (k.title === key.title) k.setAttribute("aria-pressed", String(!hide)); });
        draw(figure, group);
      });
    }
    for (const c of p.curves)
      panel.curves.push({ ...c, x: numbers(c.x, x0, x1), y: numbers(c.y, ...c.ends), said: said[c.name],
        axles: c.axles.map(a => ({ pairs: a.pairs, x: numbers(a.x, x0, x1), y: numbers(a.y, ...a.ends) })) });
    panel.svg = node("svg", { tabindex: 0, role: "img", "aria-label": `${p.label} over time` });
    box.appendChild(panel.svg);
    listen(panel.svg, figure, group);
    figure.panels.push(panel);
  });
  at.classList.add("on");
  group.figures.push(figure);
  everyFigure.push([figure, group]);
  let width = box.clientWidth;
  draw(figure, group);
  new ResizeObserver(() => {
    if (box.clientWidth === width) return;
    width = box.clientWidth;
    requestAnimationFrame(() => draw(figure, group));
  }).observe(box);
});
})();
