// The file as text, in CodeMirror: colours, faults at their lines, what may be typed next.

import { at, fill, make } from "./dom.js";

/** @type {any} */
const code = /** @type {any} */ (window).CodeMirror;

const LOOK = code.EditorView.theme({
  "&": { height: "100%", fontSize: "12px", color: "var(--ink)", backgroundColor: "var(--page)" },
  ".cm-scroller": { fontFamily: 'ui-monospace, "DejaVu Sans Mono", monospace', lineHeight: "1.45" },
  ".cm-gutters": { backgroundColor: "var(--fill)", color: "var(--soft)", border: "0" },
  ".cm-activeLine, .cm-activeLineGutter": { backgroundColor: "color-mix(in srgb, var(--blue) 8%, transparent)" },
  ".cm-content": { caretColor: "var(--ink)" },
  ".cm-cursor": { borderLeftColor: "var(--ink)" },
  "&.cm-focused .cm-selectionBackground, .cm-selectionBackground, ::selection": {
    backgroundColor: "color-mix(in srgb, var(--blue) 30%, transparent) !important" },
  ".cm-gutter-lint": { width: "1em" },
  ".cm-lint-marker-error": { content: "normal", color: "var(--no)" },
  ".cm-lint-marker-error::before": { content: '"\u25cf"' },
  ".cm-lintRange-error": { backgroundImage: "none", textDecoration: "underline wavy var(--no)" },
  ".cm-diagnostic-error": { borderLeftColor: "var(--no)" },
  ".cm-tooltip, .cm-panels": { color: "var(--ink)", backgroundColor: "var(--fill)", border: "1px solid var(--line)" },
  ".cm-tooltip.cm-tooltip-autocomplete > ul": { maxWidth: "30em", fontFamily: "inherit" },
  ".cm-tooltip-autocomplete ul li[aria-selected]": { backgroundColor: "var(--blue)", color: "var(--page)" },
  ".cm-completionDetail": { fontStyle: "normal", color: "inherit", opacity: ".8" },
});
const { tags } = code;
const COLOURS = code.HighlightStyle.define([
  { tag: tags.comment, color: "var(--soft)", fontStyle: "italic" },
  { tag: [tags.string, tags.number, tags.bool, tags.atom], color: "var(--blue)" },
  { tag: [tags.propertyName, tags.definition(tags.variableName)], color: "var(--ink)" },
]);
const LONGEST_WAIT = 3000;

export class Editor {
  /** @param {(text: string) => void} typed @param {(line: number, text: string) => void} complete */
  constructor(typed, complete) {
    this.complete = complete;
    /** @type {((found: any[]) => void) | null} */
    this.answered = null;
    this.asked = 0;
    this.editable = new code.Compartment();
    const root = at("editor").attachShadow({ mode: "open" });
    this.view = new code.EditorView({ root, parent: root, extensions: [
      LOOK, code.syntaxHighlighting(COLOURS), code.StreamLanguage.define(code.toml),
      code.lineNumbers(), code.lintGutter(), code.highlightActiveLine(), code.highlightSelectionMatches(),
      code.history(), code.search({ top: true }),
      code.autocompletion({ override: [(/** @type {any} */ where) => this.suggest(where)], selectOnOpen: false, icons: false }),
      code.Prec.highest(code.keymap.of([{ key: "Tab", run: takeFirst }, { key: "Ctrl-Space", run: code.startCompletion }])),
      code.keymap.of([...code.defaultKeymap, ...code.historyKeymap, ...code.searchKeymap]),
      this.editable.of([]),
      code.EditorView.contentAttributes.of({ "aria-label": "text of the file", spellcheck: "false" }),
      code.EditorView.updateListener.of((/** @type {any} */ update) => {
        if (update.docChanged && !update.transactions.some((/** @type {any} */ t) => t.annotation(code.Transaction.remote))) typed(this.text);
      }),
    ] });
  }

  get text() {
    return this.view.state.doc.toString();
  }

  /** Another text, as a step of undo shows it; the part that stays is not touched. @param {string | null} text */
  set(text) {
    const wanted = text ?? "# a study of the library has no file; save writes its loop as one";
    const now = this.text;
    const effects = this.editable.reconfigure(text === null ? code.EditorState.readOnly.of(true) : []);
    let from = 0;
    while (from < Math.min(now.length, wanted.length) && now[from] === wanted[from]) from += 1;
    let end = 0;
    while (end < Math.min(now.length, wanted.length) - from && now[now.length - 1 - end] === wanted[wanted.length - 1 - end]) end += 1;
    const changes = now === wanted ? [] : { from, to: now.length - end, insert: wanted.slice(from, wanted.length - end) };
    this.view.dispatch({ changes, effects, annotations: code.Transaction.remote.of(true) });
  }

  /** @param {{line: number, text: string}[]} faults */
  mark(faults) {
    const { doc } = this.view.state;
    const marks = faults.filter((f) => f.line >= 1 && f.line <= doc.lines).map((f) => {
      const line = doc.line(f.line);
      return { from: line.from + (line.text.length - line.text.trimStart().length), to: line.to, severity: "error", message: f.text };
    });
    this.view.dispatch(code.setDiagnostics(this.view.state, marks));
    fill(at("faults"), ...faults.map((f) => make("li", { onclick: () => this.go(f.line) },
      f.line ? `line ${f.line}: ${f.text}` : f.text)));
  }

  /** @param {number} number */
  go(number) {
    const { doc } = this.view.state;
    const { from } = doc.line(Math.max(1, Math.min(number, doc.lines)));
    this.view.dispatch({ selection: { anchor: from }, effects: code.EditorView.scrollIntoView(from, { y: "center" }) });
    this.view.focus();
  }

  /** What may stand here, from the server: keys of the table, or values of the key. @param {any} where */
  async suggest(where) {
    const line = where.state.doc.lineAt(where.pos);
    const before = line.text.slice(0, where.pos - line.from);
    if (!where.explicit && !/[\w\[.]$/.test(before)) return null;
    if (/#/.test(before)) return null;
    this.answered?.([]);
    this.asked = line.number;
    const found = await new Promise((answered) => {
      this.answered = answered;
      setTimeout(answered, LONGEST_WAIT, []);
      this.complete(line.number, this.text);
    });
    if (where.aborted || !found.length) return null;
    const value = before.match(/=\s*$|=\s*(?=\S+[^=]*$)/);
    const from = line.from + (value ? (value.index ?? 0) + value[0].length : before.length - before.trimStart().length);
    return { from, options: found.map((/** @type {any} */ f) => ({ label: f.insert, detail: f.meaning })) };
  }

  /** The server's answer. @param {{insert: string, meaning: string}[]} found @param {number} line */
  offer(found, line) {
    if (line === this.asked) this.answered?.(found);
  }
}

/** Tab takes what is chosen, else the first that is offered. @param {any} view */
function takeFirst(view) {
  if (code.completionStatus(view.state) !== "active") return false;
  return code.acceptCompletion(view) || (code.moveCompletionSelection(true)(view) && code.acceptCompletion(view));
}
