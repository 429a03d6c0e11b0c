// Elements, and numbers as a reader wants them.

/** Element by its id. @param {string} id @returns {any} */
export function at(id) {
  return document.getElementById(id);
}

/** New element with properties and children; nothing of it is read as HTML.
 * @param {string} tag @param {Object<string, any>} [given] @param {...any} children @returns {any} */
export function make(tag, given = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(given)) {
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (name in made) /** @type {any} */ (made)[name] = value;
    else made.setAttribute(name, value);
  }
  made.append(...children.filter((c) => c !== null && c !== undefined));
  return made;
}

/** Replace what is in an element. @param {Element} box @param {...any} children */
export function fill(box, ...children) {
  box.replaceChildren(...children.filter((c) => c !== null && c !== undefined));
}

/** A number with four digits. @param {number | null | undefined} value @param {number} digits */
export function short(value, digits = 4) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e6 || size < 1e-4) return value.toExponential(digits - 2).replace("e+", "e");
  return String(Number(value.toPrecision(digits)));
}

/** A unit behind a number. @param {string} unit */
export function unitOf(unit) {
  return unit === "1" ? "" : ` ${unit}`;
}

/** Typeset equations: the server writes MathML, with every letter of the text escaped.
 * @param {[string, string][]} rows */
export function equations(rows) {
  const body = make("tbody");
  for (const [left, right] of rows) {
    const row = make("tr");
    for (const side of right ? [left, right] : [left]) {
      const cell = make("td", right ? {} : { colSpan: 2 });
      cell.innerHTML = `<math display="block">${side}</math>`;
      row.append(cell);
    }
    body.append(row);
  }
  return make("div", { className: "equations" }, make("table", {}, body));
}

/** Colours of the page, as canvases need them. */
export function colours() {
  const style = getComputedStyle(document.documentElement);
  const of = (/** @type {string} */ name) => style.getPropertyValue(name).trim();
  return { ink: of("--ink"), soft: of("--soft"), line: of("--line"), page: of("--page"),
    ghost: of("--ghost"), dark: document.documentElement.dataset.theme === "dark" };
}

/** Colours of axles, which people who do not see red and green can tell apart. */
const BRIGHT = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#7A5195", "#8C8C8C"];
const DARK = ["#56B4E9", "#FF9A57", "#3FD3A5", "#E9A3CB", "#A9D8F7", "#F2C14E", "#B79AD1", "#B8B8B8"];

/** Colour of a number, on the page as it is. @param {number} k */
export function hue(k) {
  return (colours().dark ? DARK : BRIGHT)[k % BRIGHT.length];
}
