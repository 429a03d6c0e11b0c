// The one websocket: questions up as JSON, answers down as bytes.

import { lineTo } from "./link.js";

/** @typedef {{[name: string]: any}} Head */

/** Columns of a frame: length of the head, the head as JSON, then numbers of 32 bits.
 * @param {ArrayBuffer} data @returns {{head: Head, columns: Float32Array[]}} */
export function decode(data) {
  const long = new DataView(data).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, long)));
  const columns = [];
  for (let start = 4 + long; head.rows && start < data.byteLength; start += 4 * head.rows) {
    columns.push(new Float32Array(data, start, head.rows));
  }
  return { head, columns };
}

export class Talk {
  constructor() {
    /** @type {Object<string, (head: Head, columns: Float32Array[]) => void>} */
    this.hears = {};
    /** @type {Object<string, number>} */
    this.last = {};
    this.number = 0;
    /** @type {Object<string, string>} */
    this.waiting = {};
    this.onstate = (/** @type {string} */ _) => {};
    this.window = sessionStorage.getItem("window") || "";
    if (!this.window) {
      const drawn = crypto.getRandomValues(new Uint8Array(16));
      this.window = [...drawn].map((b) => b.toString(16).padStart(2, "0")).join("");
      sessionStorage.setItem("window", this.window);
    }
    this.connect();
  }

  connect() {
    this.socket = lineTo(this.window);
    this.socket.binaryType = "arraybuffer";
    this.socket.onopen = () => {
      this.onstate("");
      const waiting = Object.values(this.waiting);
      this.waiting = {};
      for (const text of waiting) this.socket?.send(text);
    };
    this.socket.onmessage = (/** @type {any} */ event) => this.hear(event.data);
    this.socket.onclose = () => {
      this.onstate("slipctl has ended, or does not answer; what you typed is kept here");
      setTimeout(() => this.connect(), 1500);
    };
  }

  /** Ask; of each kind only the newest question's answer is heard.
   * @param {string} kind @param {Head} [what] */
  ask(kind, what = {}) {
    this.number += 1;
    this.last[kind] = this.number;
    const text = JSON.stringify({ kind, id: this.number, ...what });
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(text);
    else this.waiting[kind] = text;
    return this.number;
  }

  /** Ask what goes on for long: its answers are heard after a reload too.
   * @param {string} kind @param {Head} what */
  send(kind, what) {
    this.socket?.send(JSON.stringify({ kind, id: 0, ...what }));
  }

  /** @param {ArrayBuffer} data */
  hear(data) {
    const { head, columns } = decode(data);
    const known = this.last[head.kind];
    if (head.id && head.id !== known) return;
    this.hears[head.kind]?.(head, columns);
  }

  /** @param {string} kind @param {(head: Head, columns: Float32Array[]) => void} hear */
  on(kind, hear) {
    this.hears[kind] = hear;
  }
}
