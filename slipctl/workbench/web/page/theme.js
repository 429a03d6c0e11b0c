// Light or dark: as the system has it, until a person chooses.

import { at } from "./dom.js";

/** Take the theme, and draw what hangs on it when it changes. @param {() => void} draw */
export function followTheme(draw) {
  const take = (/** @type {string} */ name) => {
    document.documentElement.dataset.theme = name;
    draw();
  };
  take(localStorage.getItem("theme") ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"));
  at("theme").addEventListener("click", () => {
    const name = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
    localStorage.setItem("theme", name);
    take(name);
  });
}
