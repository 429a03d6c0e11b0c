// What a person has changed: text, loop, numbers; undone, redone, and kept over a reload.

/** @typedef {{text: string | null, loop: string, scenario: string, numbers: Object<string, number>}} Now */

const MOST = 200;

export class State {
  /** @param {(now: Now, why: string) => void} changed */
  constructor(changed) {
    this.changed = changed;
    /** @type {Now} */
    this.now = { text: null, loop: "", scenario: "", numbers: {} };
    /** @type {Now[]} */
    this.past = [];
    /** @type {Now[]} */
    this.future = [];
    this.stamp = 0;
    /** Whether the last change began anew, and did not go on with the one before. */
    this.fresh = true;
    this.key = "";
  }

  /** Begin with what is open, or with what stood here before a reload. @param {string} home @param {Now} now */
  begin(home, now) {
    this.key = `now ${home}`;
    const kept = sessionStorage.getItem(this.key);
    this.now = now;
    if (kept) {
      try {
        const before = JSON.parse(kept);
        if (typeof before.loop === "string" && before.numbers) this.now = { ...now, ...before };
      } catch { /* of another version */ }
    }
    return this.now;
  }

  /** Change something; what goes on within a second is one step. @param {Partial<Now>} by @param {string} why */
  set(by, why) {
    const time = Date.now();
    this.fresh = why !== this.why || time - this.stamp > 1000;
    if (this.fresh) {
      this.past.push(this.now);
      if (this.past.length > MOST) this.past.shift();
    }
    this.why = why;
    this.stamp = time;
    this.future = [];
    this.now = { ...this.now, ...by };
    this.keep();
    this.changed(this.now, why);
  }

  undo() {
    this.step(this.past, this.future);
  }

  redo() {
    this.step(this.future, this.past);
  }

  /** @param {Now[]} from @param {Now[]} to */
  step(from, to) {
    const other = from.pop();
    if (!other) return;
    to.push(this.now);
    this.now = other;
    this.why = "";
    this.fresh = true;
    this.keep();
    this.changed(this.now, "step");
  }

  keep() {
    try {
      sessionStorage.setItem(this.key, JSON.stringify(this.now));
    } catch { /* full: it is only not kept over a reload */ }
  }
}
